"""Plan backlash offsets of axes whose backlash is outside their loop."""

from __future__ import annotations

from collections.abc import Collection
from itertools import groupby
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.compensate.offsets import may_shift
from ph_post.compensate.plan_warnings import friction_warnings, round_up, side_warnings
from ph_post.dialects.base import Dialect
from ph_post.edit.affordable import affordable_reversals
from ph_post.edit.beams import BeamGuard, run_beside
from ph_post.edit.chord_joints import chord_joints
from ph_post.edit.corner_joints import corner_joints
from ph_post.edit.cutter_contours import CutterContours
from ph_post.edit.edits import EditOptions, Edits, join_stops
from ph_post.edit.gentle_feeds import GentleFeeds, gentle_feeds
from ph_post.edit.preconditions import (
    blocked_chains,
    double_compensation,
    program_units,
    warn_blocked,
    warn_climbing,
    warn_unknown,
    why_not_editable,
    written_offsets,
)
from ph_post.edit.reversal_search import ReversalSearch, motion_times
from ph_post.edit.reversals import (
    chain_spans,
    section_spans,
)
from ph_post.errors import InputError
from ph_post.gcode.program import AXES, RAPID, PartProgram
from ph_post.simulate.controllers.moves import moved_axes
from ph_post.types import Axis, BoolArray, Machine, sealed
from ph_post.units import MM

BEAM_ROUNDS: Final = 6
"""Plans that are made before nothing is shifted wherever a beam is on."""


def plan_offsets(program: PartProgram, machine: Machine, dialect: Dialect, options: EditOptions) -> Edits:
    """Plan the offsets of all axes whose backlash is outside the loop.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    dialect : Dialect
        Offsets are rounded to its decimals.
    options : EditOptions

    Returns
    -------
    Edits
        With stops, but no dips; `warnings` name what is not compensated.

    Raises
    ------
    InputError
        Where the dialect's decimals are too few for an axis.
    """
    found = _planned(program, machine, dialect, options, gentle=True)
    # Time is for crossings first: an axis that is left alone does more harm than tables that run on.
    return _planned(program, machine, dialect, options, gentle=False) if found.dips and found.short else found


def _planned(program: PartProgram, machine: Machine, dialect: Dialect, options: EditOptions, *, gentle: bool) -> Edits:
    """Plan them, with `gentle` feeds where tables would run on, as far as there is time for those."""
    said = tuple(side_warnings(machine.axes[name] for name in moved_axes(program)))
    nothing = Edits(offset=sealed(np.zeros((program.motions.kind.size, 3))), warnings=said)
    axes = [machine.axes[name] for name in AXES if name in machine.axes and may_shift(machine.axes[name])]
    if not axes or program.motions.kind.size == 0:
        return nothing
    troubles = why_not_editable(program)
    if troubles:
        said += tuple(f"program not compensated: {trouble}" for trouble in troubles)
        return Edits(offset=nothing.offset, warnings=said)
    units = program_units(program)[0]
    sides = {axis.name: written_offsets(axis, dialect, units) for axis in axes}
    amplitude = {name: max(map(abs, pair)) for name, pair in sides.items()}
    blocked = blocked_chains(program)
    _check_overshoot(axes, options)
    beam = BeamGuard(program, machine)
    open_ = _open_sections(program, blocked, options.left)
    runs, unmarked = beam.runs(), frozenset[int]()
    contours = CutterContours(program)
    refused = contours.left()
    total = max(float(motion_times(program, machine).sum()), options.cycle, 1e-9)
    feeds, needed = _gentle_feeds(program, machine, dialect, amplitude, options, open_, total if gentle else 0.0)
    slower = sum(feeds.times) / total
    options = replace(options, max_slowdown=options.max_slowdown - slower)
    for number in range(BEAM_ROUNDS + len(contours.contours)):
        left = sorted([*(runs[run] for run in unmarked), *contours.spans(refused), *options.stretches])
        search = ReversalSearch(program, machine, dialect, amplitude, sides, open_, options, left, feeds.feed)
        afforded = affordable_reversals(search, options)
        changes = afforded.changes
        crossings, stops, pulse, offset, burnt = search.crossings.plan(changes, afforded.coarser)
        again, radii = contours.refused(changes, stops, crossings, sides)
        if again.keys() > refused.keys():
            refused = {**again, **refused}
            continue
        if not burnt:
            break
        found = {run_beside(runs, motion) for motion in burnt}
        unmarked |= found if number + 2 < BEAM_ROUNDS and not found <= unmarked else set(range(len(runs)))
    shifted = {one.axis for one in crossings} | {shift.axis for stop in stops for shift in stop.shifts}
    shifted |= {name for name in amplitude if offset[:, AXES.index(name)].any()}
    used = {name: size for name, size in amplitude.items() if name in shifted}
    edits = Edits(
        offset=sealed(offset),
        stops=tuple(join_stops(list(found)) for _, found in groupby(stops, lambda one: (one.motion, one.share))),
        crossings=crossings,
        amplitude=used,
        followed=tuple(name for name in amplitude if len(changes[name])),
        one_sided={name: 1 if sides[name][0] == 0.0 else -1 for name in used if 0.0 in sides[name]},
        pulse=pulse,
        kept=search.crossings.ground.kept(crossings),
        rounding=search.crossings.ground.rounding_of(crossings),
        joints=chord_joints(program.motions, machine, crossings) | corner_joints(search.crossings.ground, crossings),
        dips=tuple(one for one in feeds.dips if offset[one.motion[-1]].any()),
        slowdown=afforded.slowdown + slower,
        short=afforded.short,
    )
    warnings = [*said, *warn_blocked(program, blocked), *warn_unknown(program, amplitude), *afforded.warnings]
    warnings += beam.warn_left([runs[run] for run in sorted(unmarked)])
    warnings += contours.words(refused, radii, edits.offset)
    allows = round_up(max(needed / total / SHARE, options.pace * (needed / total + afforded.slowdown)))
    # Where the time allows them, they were tried, and something else is at fault.
    if needed > sum(feeds.times) and allows > options.max_slowdown + slower:
        warnings.append(
            "friction would hold all tables at lower feeds on tight arcs and before stops, which would add"
            f" {needed:.2g} s: --max-slowdown {allows:g} allows them"
        )
    if edits.amplitude:
        own = double_compensation(program, dialect, machine)
        warnings += [
            *friction_warnings(edits.amplitude, beam.tool, climbs=False),
            *(warn_climbing(program) if beam.tool == "cutter" else ()),
            *own,
            *dialect.notices.cautions,
        ]
    return replace(edits, warnings=tuple(warnings))


SHARE: Final = 0.75
"""Part of the time allowed that gentle feeds may take."""


def _gentle_feeds(
    program: PartProgram,
    machine: Machine,
    dialect: Dialect,
    amplitude: Collection[str],
    options: EditOptions,
    sections: BoolArray,
    total: float,
) -> tuple[GentleFeeds, float]:
    """Return the feeds at which tables do not run on in open `sections` (s,), as far as there is time for them.

    The other number is the time that all of them take [s]; `total` is the program's, 0 where there are to be none.
    """
    found = gentle_feeds(program, machine, dialect, amplitude)
    if any(axis.loop.encloses_backlash and axis.gap.lost_motion > 0.0 for axis in machine.axes.values()):
        return found.within(-1.0, lambda _: None), 0.0
    low, _ = section_spans(program.motions)

    def section(motion: int) -> int | None:
        number = int(np.searchsorted(low, motion, side="right")) - 1
        left = any(first <= motion < last for first, last in options.stretches)
        return number if sections[number] and not left else None

    return found.within(SHARE * options.max_slowdown * total, section), sum(found.times)


def _check_overshoot(axes: list[Axis], options: EditOptions) -> None:
    for axis in axes:
        if options.overshoot is not None and options.overshoot < axis.gap.lost_motion:
            raise InputError(
                "--overshoot",
                f"less than the lost motion of {axis.name}",
                expected=f">= {axis.gap.lost_motion / MM:g} mm",
                got=f"{options.overshoot / MM:g} mm",
            )


def _open_sections(program: PartProgram, blocked: dict[str, BoolArray], left: Collection[int]) -> BoolArray:
    """Mask of the sections that cut and may be shifted (s,)."""
    motions = program.motions
    low, _ = section_spans(motions)
    cuts = np.logical_or.reduceat(motions.kind != RAPID, low)
    cuts &= ~np.isin(np.arange(low.size), list(left))
    chain = np.searchsorted(chain_spans(motions)[0], low, side="right") - 1
    for marks in blocked.values():
        cuts &= ~marks[chain]
    return np.asarray(cuts)
