"""Guard the part: no program is written that makes it worse than its original would, or takes longer than allowed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.api.results import ProgramMotion
from ph_post.bounds import LONGEST_SIMULATED
from ph_post.edit.affordable import SPARE
from ph_post.edit.edits import EditOptions
from ph_post.edit.reversals import section_spans
from ph_post.errors import PhPostError
from ph_post.gcode.program import PlaceArray
from ph_post.geometry.numeric import runs
from ph_post.simulate.assess import is_nominal, run_scenarios
from ph_post.simulate.controllers.deviation import FollowedCut
from ph_post.simulate.controllers.unknown import unknown_motions
from ph_post.types import Array, BoolArray, IntArray, Scenario
from ph_post.units import MM

WORSE: Final = 1.01
"""An error that grows by less than this factor has not grown."""

SMALL: Final = 0.5e-3 * MM
"""Nor has one of a part of the program that grows by less [m], which rounding to the decimals of a program does."""

LEAST: Final = 0.02e-3 * MM
"""Errors of the whole program that differ by less [m] are the same."""

SLACK: Final = 5e-4
"""The time allowed is kept to within this part of the program's time, which is known in steps."""

MARGIN: Final = 0.9
"""Part of the slack that another plan is to keep."""

LATE: Final = 3
BELOW: Final = 0.985
"""Behind so many plans that take too long each other one aims at so much of the time that the one before aimed at:
plans that come nearer and nearer to all that is allowed are too many."""

STEPS: Final = 100_000
"""Places, at equal steps along its way, at which an error is looked at in a section at most."""

ROUNDS: Final = 8
"""Plans that are tried before a program is left as it is."""


ENOUGH: Final = 0.95
"""Part of the time allowed that a plan is to take where there was more to do."""

MOST: Final = 3.0
"""Times the time that was reckoned for a plan which another one is given at most."""

FURTHER: Final = 3
"""Plans that are tried beside a good one that was short of time."""


class GuardFinding(msgspec.Struct, frozen=True, kw_only=True):
    """What a compensated program does to the part: the sections it makes worse, and its time over the original's.

    `runs_on` are those of them that only a table makes worse which runs on in its backlash. `slowdown` is found by
    running it, `planned` what was reckoned for it; `rms` is the error of the whole program [m]. `places` are the
    motions in which nothing but the largest error of such a section is larger, first and last of each stretch of them,
    and `corners` the motions at whose ends that is. Of a program that is too long to be `simulated` no more is known
    than its time. `gains` says that the part is better as a whole, or may be where its places are not known. `remains`
    is the rms of the whole over the original's where none of the three errors of the whole has grown, else infinite.
    """

    worse: frozenset[int]
    slowdown: float
    planned: float
    rms: float = 0.0
    runs_on: frozenset[int] = frozenset()
    places: tuple[tuple[int, int], ...] = ()
    corners: frozenset[int] = frozenset()
    simulated: bool = True
    gains: bool = True
    remains: float = math.inf


class Guard:
    """Compares compensated programs with their original on the machine, section by section and as a whole.

    The largest, the root mean square and the 95th percentile of the distance from the path are compared, each for
    the worst initial sides, and where tables may run on in their backlash for each way in which they may.

    Parameters
    ----------
    before : ProgramMotion
    """

    def __init__(self, before: ProgramMotion) -> None:
        self._before = before

    @cached_property
    def _errors(self) -> list[Array]:
        """Errors of the original, which are the same for every plan."""
        return _section_errors(self._before)

    def compare(self, after: ProgramMotion, planned: float) -> GuardFinding | None:
        """Compare a compensated program, for which a slowdown `planned` was reckoned.

        Returns
        -------
        GuardFinding or None
            None where a program cannot be simulated.
        """
        before = self._before
        try:
            slowdown = after.time / max(before.time, 1e-9) - 1.0
            if max(before.time, after.time) > LONGEST_SIMULATED:
                return GuardFinding(worse=frozenset(), slowdown=slowdown, planned=planned, simulated=False)
            one, other = self._errors, _section_errors(after)
            stays, *running = map(_worse_sections, one, other)
            places, corners = _worse_places(after, one[0], other[0], stays.difference(*running))
        except (PhPostError, MemoryError):
            return None
        return GuardFinding(
            worse=stays.union(*running),
            runs_on=frozenset().union(*running) - stays,
            places=places,
            corners=corners,
            slowdown=slowdown,
            planned=planned,
            rms=float(other[0][-1, 1]),
            gains=_gains(one, other) or bool(unknown_motions(before.original).any()),
            remains=math.inf if any(map(_grown, one, other)) else float(other[0][-1, 1] / max(one[0][-1, 1], LEAST)),
        )


def _worse_sections(one: Array, other: Array) -> frozenset[int]:
    """Numbers of the sections whose errors, as of `_section_errors`, are larger than those of the original."""
    grown = _exceeds(other[:-1], WORSE * one[:-1] + SMALL)
    grown[:, 0] &= ~_outweighed(one, other)
    # A percentile of a section alone grows where a corner that was far off comes nearer and stays behind for longer.
    grown[:, 2] &= (other[:-1, :2] >= one[:-1, :2]).any(axis=1)
    worse = grown.any(axis=1)
    if not worse.any() and _grown(one, other):
        worse = _blamed(one, other)
    return frozenset(np.flatnonzero(worse).tolist())


def _grown(one: Array, other: Array) -> bool:
    """Return whether an error of a whole program, of those of `_section_errors`, is larger than the original's."""
    return bool(_exceeds(other[-1:], WORSE * one[-1:] + LEAST).any())


def _gains(one: Sequence[Array], other: Sequence[Array]) -> bool:
    """Return whether the largest error of a whole program falls, or its root mean square, by errors of each way."""
    return any(bool((after[-1, :2] < before[-1, :2]).any()) for before, after in zip(one, other, strict=True))


def _exceeds(errors: Array, most: Array) -> BoolArray:
    """Mask (n, 3) of the largest, the rms and the percentile of errors (n, 4) that are above the most allowed.

    By time a percentile grows with how long the tool stops at one place, along the way with how short it is elsewhere:
    the part has more of an error where both have grown.
    """
    above = errors > most
    return np.stack([*above[:, :2].T, above[:, 2:].all(axis=1)], axis=1)


def _worse_places(
    after: ProgramMotion, one: Array, other: Array, worse: frozenset[int]
) -> tuple[tuple[tuple[int, int], ...], frozenset[int]]:
    """Return the motions, first and last, in which sections are worse whose largest errors alone have grown.

    With them come the motions at whose ends those errors are: the one before, where that is nearer.
    """
    rest = np.asarray(_exceeds(other, one)[:, 1:].any(axis=1))
    own, whole = WORSE * one[:, 0] + SMALL, WORSE * one[-1, 0] + LEAST
    # One that is no worse by itself is blamed for the whole program.
    most = np.where(other[:, 0] > own, own, whole)
    alone = [n for n in worse if not rest[n] and other[n, 0] > most[n]]
    if not alone:
        return (), frozenset()
    cut = after.cut
    low, _ = section_spans(after.original.motions)
    motion = cut.motion[cut.counted]
    section = np.searchsorted(low, motion, side="right") - 1
    apart = np.max(
        run_scenarios(cut.counted_distances, [one for one in cut.scenarios() if is_nominal(one)]),
        axis=0,
    )
    rows = np.flatnonzero(np.isin(section, alone) & (apart > most[section]))
    found = np.unique(motion[rows])
    ends = (np.searchsorted(motion, motion[rows], side=side) for side in ("left", "right"))
    corners = motion[rows] - (2 * rows < sum(ends))
    return tuple((int(run[0]), int(run[-1])) for run in runs(found)), frozenset(corners.tolist())


def _outweighed(one: Array, other: Array) -> BoolArray:
    """Mask of the sections (s,) whose largest error grows by less than their root mean square falls.

    Where a motor lags, a corner is cut by more than backlash, and a table that waits in it cuts the corner a little
    less. In the whole program the largest error may not grow for that.
    """
    gained = one[:-1, 1] - other[:-1, 1]
    within = other[:-1, 0] <= WORSE * one[-1, 0] + LEAST
    return np.asarray((other[:-1, 0] - one[:-1, 0] <= gained) & within)


def _blamed(one: Array, other: Array) -> BoolArray:
    """Mask of the sections (s,) that make a program worse as a whole, by errors as of `_section_errors`."""
    largest = other[:-1, 0] > WORSE * one[-1, 0] + LEAST
    if largest.any():
        return np.asarray(largest)
    more = other[:-1] - one[:-1]
    grown = np.maximum(more[:, 1], more[:, 2:].min(axis=1))
    return np.asarray(grown >= max(float(grown.max()), 0.0))


def _section_errors(motion: ProgramMotion) -> list[Array]:
    """Largest, rms, and 95th percentile by time and along the way of each section's error, and of all [m], (s + 1, 4).

    The first are those of tables that stay in their backlash where nothing pushes them, then come tables that run on.
    """
    cut = motion.cut
    low, _ = section_spans(motion.original.motions)
    section = np.searchsorted(low, cut.motion[cut.counted], side="right") - 1
    sections = _rows_by_section(section, low.size)
    del section

    def errors(scenario: Scenario) -> Array:
        return _by_section(cut.counted_distances(scenario), _ways(cut, scenario), sections)

    tried = [one for one in cut.scenarios() if is_nominal(one) or one.runs_on is not None]
    found = dict(zip(tried, run_scenarios(errors, tried), strict=True))
    cut.forget()
    stays = np.max([own for one, own in found.items() if one.runs_on is None], axis=0)
    return [stays, *(own for one, own in found.items() if one.runs_on is not None)]


def _rows_by_section(section: IntArray, count: int) -> list[PlaceArray | slice]:
    """Return the rows of each of so many sections, and of all, by the section (n,) of each row."""
    if not (section[1:] < section[:-1]).any():
        # One section after the other: what is taken of a million rows is no copy.
        edges = np.searchsorted(section, np.arange(count + 1)).tolist()
        return [*(slice(low, high) for low, high in pairwise(edges)), slice(0, section.size)]
    order = np.argsort(section, kind="stable").astype(np.int32)
    edges = np.searchsorted(section[order], np.arange(count + 1)).tolist()
    return [*(order[low:high] for low, high in pairwise(edges)), order]


def _ways(cut: FollowedCut, scenario: Scenario) -> Array:
    """Return the ways of the rows that count [m]: how far the table goes, or its motor along the path."""
    way = _steps(cut.place)
    for axis in cut.runs.tables(scenario):
        np.maximum(way, _steps(axis), out=way)
    return way[cut.counted]


def _steps(places: Array) -> Array:
    """Return how far each of some places (n,) is from the one before it, 0 of the first."""
    found = np.empty(places.size)
    found[:1] = 0.0
    np.subtract(places[1:], places[:-1], out=found[1:])
    return np.abs(found, out=found)


def _by_section(distance: Array, way: Array, sections: Sequence[PlaceArray | slice]) -> Array:
    """Errors of the rows of each section, as of `_section_errors`."""
    found = np.zeros((len(sections), 4))
    for number, rows in enumerate(sections):
        own = distance[rows]
        if own.size:
            even = own[_evenly(way[rows])]
            found[number] = own.max(), np.sqrt((own * own).mean()), percentile(own), percentile(even)
    return found


def percentile(values: Array) -> float:
    """Return the 95th percentile of values (n,), as numpy's quantile, which takes thirty times as long for few."""
    at = 0.95 * (values.size - 1)
    low = int(at)
    high = min(low + 1, values.size - 1)
    below, above = np.partition(values, (low, high))[[low, high]].tolist()
    share, step = at - low, above - below
    return float(above - step * (1.0 - share) if share >= 0.5 else below + step * share)


def _evenly(way: Array) -> IntArray:
    """Return rows at equal steps along ways (n,) [m], as many as there are up to :data:`STEPS`."""
    along = np.cumsum(way)
    if along[-1] <= 0.0:
        return np.arange(way.size)
    number = min(way.size, STEPS)
    return np.asarray(np.searchsorted(along, (np.arange(number) + 0.5) * (along[-1] / number)))


def tightened(
    options: EditOptions, finding: GuardFinding, allowed: float, count: int, *, late: int = 0
) -> EditOptions | None:
    """Return the options for another plan; None where the finding is good.

    Parameters
    ----------
    options : EditOptions
        Of the plan that was judged.
    finding : GuardFinding
    allowed : float
        Slowdown that was asked for.
    count : int
        Number of the program's sections.
    late : int, optional
        Number of plans before it that took too long.
    """
    over = finding.slowdown > allowed + SLACK
    if not finding.worse and not over:
        return None
    less = options.max_slowdown
    if over:
        # What the planner takes is so many times what was reckoned.
        aim = BELOW ** max(late + 1 - LATE, 0) * allowed + MARGIN * SLACK
        share = aim / finding.slowdown
        less = share * finding.planned - SPARE if finding.planned > 0.0 else -1.0
    left = options.left | with_neighbours(finding.worse, options.left, count)
    return replace(options, max_slowdown=less, left=left)


def by_what_is_done(finding: GuardFinding, left: frozenset[int], count: int) -> GuardFinding:
    """Let a finding say nothing of sections that are left alone between others that are: they are as they were.

    Where samples of their errors fall may differ by more than what is allowed.

    Examples
    --------
    >>> found = GuardFinding(worse=frozenset({0, 3, 6}), slowdown=0.0, planned=0.0, rms=0.0)
    >>> sorted(by_what_is_done(found, frozenset({0, 1, 3, 5, 6, 7}), 9).worse)
    [3]
    """
    beside = {n for n in range(-1, count + 1) if n in left or not 0 <= n < count}
    alone = {n for n in finding.worse if beside >= {n - 1, n, n + 1}}
    return replace(finding, worse=finding.worse - alone, runs_on=finding.runs_on - alone)


def otherwise(options: EditOptions, finding: GuardFinding, allowed: float, over: float) -> EditOptions:
    """Return the options for another plan beside a good one that was short of time.

    It takes what is left of the time where that is much, or half of it where that was too much; where little is left it
    goes by what gains most.

    Parameters
    ----------
    options : EditOptions
        Of the plan that was judged, in which the time was reckoned to be too short.
    finding : GuardFinding
    allowed : float
        Slowdown that was asked for.
    over : float
        Slowdown that was too much for a plan, infinite where none was.
    """
    less = options.max_slowdown
    more = finding.planned * min(allowed / max(finding.slowdown, 1e-9), MOST)
    more = max(more, less + 0.5 * (allowed - finding.slowdown))
    if more >= over:
        more = 0.5 * (less + over)
    if finding.slowdown < ENOUGH * allowed and less < more:
        return replace(options, max_slowdown=more)
    return replace(options, max_slowdown=allowed, largest_first=True)


def with_neighbours(found: frozenset[int], left: frozenset[int], count: int) -> frozenset[int]:
    """Add the neighbours of sections that were left alone already: there what is done beside them is at fault.

    Examples
    --------
    >>> sorted(with_neighbours(frozenset({2, 7}), frozenset({2}), 9))
    [1, 2, 3, 7]
    """
    return found | {n + step for n in found & left for step in (-1, 1) if 0 <= n + step < count}
