"""Guard the part: no program is written that makes it worse than its original would, or takes longer than allowed."""

from __future__ import annotations

import math
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.api.results import ProgramMotion
from ph_post.bounds import LONGEST_SIMULATED
from ph_post.edit.edits import EditOptions
from ph_post.errors import PhPostError
from ph_post.gcode.paths import line_words
from ph_post.gcode.program import PartProgram, PlaceArray
from ph_post.simulate.assess import is_nominal, run_scenarios
from ph_post.types import Array, Scenario
from ph_post.units import MM

WORSE: Final = 1.01
"""An error that grows by less than this factor has not grown."""

SMALL: Final = 0.5e-3 * MM
"""Nor has one that grows by less [m], which rounding to the decimals of a program does."""

SLACK: Final = 0.005
"""The time allowed is kept to within this part of the program's time."""

MOST: Final = 1.1
"""An error cannot grow by more lost motions than this."""

ROUNDS: Final = 4
"""Plans that are tried before a program is left as it is."""

SHOWN: Final = 3
"""Places that a warning names."""


class GuardFinding(msgspec.Struct, frozen=True, kw_only=True):
    """What a compensated program does to the part: the chains it makes worse, and its time over the original's."""

    worse: frozenset[int]
    slowdown: float


def compare_motions(before: ProgramMotion, after: ProgramMotion) -> GuardFinding | None:
    """Compare a compensated program with its original on the machine, chain by chain.

    The largest, the root mean square and the 95th percentile of the distance from the path are compared, each for
    the worst initial sides.

    Parameters
    ----------
    before, after : ProgramMotion

    Returns
    -------
    GuardFinding or None
        None where a program is too long to be simulated, cannot be, or does not move.
    """
    try:
        moves = before.command.t.size and after.command.t.size
        if not moves or max(before.time, after.time) > LONGEST_SIMULATED:
            return None
        one, other = (_chain_errors(motion) for motion in (before, after))
    except (PhPostError, MemoryError):
        return None
    worse = (other > WORSE * one + SMALL).any(axis=1)
    # Offsets and backlash together move a table by no more than its lost motion: beyond that the place along a path
    # that runs over itself was lost, and nothing is known. The checker has followed the crossings all the same.
    lost = math.sqrt(sum(axis.gap.lost_motion**2 for axis in before.machine.axes.values()))
    worse &= other[:, 0] <= one[:, 0] + MOST * lost
    return GuardFinding(
        worse=frozenset(np.flatnonzero(worse).tolist()), slowdown=after.time / max(before.time, 1e-9) - 1.0
    )


def _chain_errors(motion: ProgramMotion) -> Array:
    """Largest, root mean square and 95th percentile of the error of every chain [m], shape (c, 3)."""
    cut, chains = motion.cut, motion.original.motions.chain
    chain, count = chains[cut.motion], int(chains.max(initial=-1)) + 1

    def errors(scenario: Scenario) -> Array:
        return _by_chain(cut.simulate(scenario)[1][cut.counted], chain[cut.counted], count)

    tried = [one for one in cut.scenarios() if is_nominal(one)]
    return np.asarray(np.max(run_scenarios(errors, tried), axis=0))


def _by_chain(distance: Array, chain: PlaceArray, count: int) -> Array:
    found = np.zeros((count, 3))
    order = np.argsort(chain, kind="stable")
    edges = np.searchsorted(chain[order], np.arange(count + 1))
    for number in np.flatnonzero(np.diff(edges)).tolist():
        own = distance[order[edges[number] : edges[number + 1]]]
        found[number] = own.max(), np.sqrt((own * own).mean()), np.quantile(own, 0.95)
    return found


def tightened(options: EditOptions, finding: GuardFinding, allowed: float) -> EditOptions | None:
    """Return the options for another plan; None where the finding is good.

    Parameters
    ----------
    options : EditOptions
        Of the plan that was judged.
    finding : GuardFinding
    allowed : float
        Slowdown that was asked for.
    """
    over = finding.slowdown - allowed
    if not finding.worse and over <= SLACK:
        return None
    less = max(options.max_slowdown - max(over, 0.0) - SLACK, 0.0) if over > SLACK else options.max_slowdown
    if over > SLACK and options.max_slowdown == 0.0:
        less = -1.0
    return replace(options, max_slowdown=less, left=options.left | finding.worse)


def chain_words(program: PartProgram, chains: frozenset[int]) -> str:
    """Name the lines of chains for a warning, the first few of them."""
    motions = program.motions
    own = (motions.block[motions.chain == number] for number in sorted(chains)[:SHOWN])
    spans = [line_words(int(blocks[0]), int(blocks[-1])) for blocks in own]
    more = f" and {len(chains) - SHOWN} more places" if len(chains) > SHOWN else ""
    return ", ".join(spans) + more
