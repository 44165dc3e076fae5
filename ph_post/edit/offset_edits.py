"""Plan backlash offsets of axes whose backlash is outside their loop."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.compensate.offsets import DWELL, may_shift
from ph_post.compensate.plan_warnings import friction_warnings, round_up, side_warnings
from ph_post.dialects.base import Dialect
from ph_post.edit.affordable import AffordedChanges, affordable_reversals
from ph_post.edit.beams import BeamGuard, run_beside
from ph_post.edit.chord_joints import chord_joints
from ph_post.edit.corner_joints import corner_joints
from ph_post.edit.crossing_search import PlannedChanges
from ph_post.edit.cutter_contours import CutterContours
from ph_post.edit.edits import EditOptions, Edits, StopEdit, join_stops, no_offsets, runs_of
from ph_post.edit.gentle_feeds import GentleFeeds, gentle_feeds
from ph_post.edit.preconditions import (
    blocked_chains,
    double_compensation,
    program_units,
    warn_blocked,
    warn_climbing,
    warn_unknown,
    why_lifted,
    why_not_editable,
    written_offsets,
)
from ph_post.edit.reversal_search import ReversalSearch, motion_times
from ph_post.edit.reversals import (
    chain_spans,
    section_spans,
)
from ph_post.edit.threads import Threads
from ph_post.errors import InputError
from ph_post.gcode.program import AXES, RAPID, PartProgram
from ph_post.simulate.controllers.moves import moved_axes
from ph_post.types import Axis, BoolArray, Machine
from ph_post.units import MM

SINGLY: Final = 3
"""Plans behind which one place that a beam would mark is left; behind a further one all is, from the first on."""

BEAM_ROUNDS: Final = 8
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
    said = tuple(side_warnings(machine.axes[name] for name in moved_axes(program)))
    nothing = Edits(runs=no_offsets(program.motions.kind.size), warnings=said)
    axes = [machine.axes[name] for name in AXES if name in machine.axes and may_shift(machine.axes[name])]
    if (why := why_lifted(program)) and any(axis.name == "Z" for axis in axes):
        axes = [axis for axis in axes if axis.name != "Z"]
        said += (f"axis Z not compensated: {why}",)
        nothing = replace(nothing, warnings=said)
    if not axes or program.motions.kind.size == 0:
        return nothing
    troubles = why_not_editable(program, mixed=True)
    if troubles:
        return replace(nothing, warnings=(*said, *(f"program not compensated: {trouble}" for trouble in troubles)))
    _check_overshoot(axes, options)
    planner = _OffsetPlanner(program, machine, dialect, options, axes)
    found = planner.plan(gentle=True)
    # Time is for crossings first: an axis that is left alone does more harm than tables that run on.
    found = planner.plan(gentle=False) if found.dips and found.short else found
    return replace(found, warnings=(*said, *found.warnings))


SHARE: Final = 0.75
"""Part of the time allowed that gentle feeds may take."""


class _PlannedFeeds(NamedTuple):
    """The feeds at which tables do not run on, those that there is time for, and what all of them take [s]."""

    feeds: GentleFeeds
    needed: float

    @property
    def time(self) -> float:
        """Time that those take which there is time for [s]."""
        return sum(self.feeds.times)


class _Choice(NamedTuple):
    """The changes that are worth their time, how they are made, and what is left as it is.

    `unmarked` are the numbers of the beam's runs that a shift would mark, `refused` and `radii` what
    :class:`~ph_post.edit.cutter_contours.CutterContours` says of its contours, and `untied` what
    :class:`~ph_post.edit.threads.Threads` says of threads that are left.
    """

    search: ReversalSearch
    afforded: AffordedChanges
    planned: PlannedChanges
    unmarked: frozenset[int]
    refused: Mapping[int, str]
    radii: Mapping[int, float]
    untied: Mapping[int, str]


class _OffsetPlanner:
    """Plans the offsets of a program's `axes`; keeps what all plans share."""

    def __init__(
        self, program: PartProgram, machine: Machine, dialect: Dialect, options: EditOptions, axes: Sequence[Axis]
    ) -> None:
        self._program, self._machine, self._dialect, self._options = program, machine, dialect, options
        units = program_units(program)[0]
        self._sides = {axis.name: written_offsets(axis, dialect, units) for axis in axes}
        self._amplitude = {name: max(map(abs, pair)) for name, pair in self._sides.items()}
        self._blocked = blocked_chains(program)
        self._beam, self._contours = BeamGuard(program, machine), CutterContours(program)
        self._open = _open_sections(program, self._beam.works.on, self._blocked, options.left)
        self._threads = Threads(program)
        self._runs = self._beam.runs()
        self._total = max(float(motion_times(program, machine).sum()), options.cycle, 1e-9)
        self._slow = gentle_feeds(program, machine, dialect, self._amplitude)

    def plan(self, *, gentle: bool) -> Edits:
        """Plan them, with `gentle` feeds where tables would run on, as far as there is time for those."""
        slow = self._gentle_feeds(SHARE * self._options.max_slowdown * self._total if gentle else 0.0)
        choice = self._choose(slow)
        edits = self._edits(choice, slow)
        return replace(edits, warnings=tuple(self._warnings(choice, slow, edits)))

    def _gentle_feeds(self, most: float) -> _PlannedFeeds:
        """Find the feeds at which tables do not run on in open sections, those first that together take `most` [s]."""
        if any(axis.loop.encloses_backlash and axis.gap.lost_motion > 0.0 for axis in self._machine.axes.values()):
            return _PlannedFeeds(self._slow.within(-1.0, lambda _: None), 0.0)
        low, _ = section_spans(self._program.motions)

        def section(motion: int) -> int | None:
            number = int(np.searchsorted(low, motion, side="right")) - 1
            left = any(first <= motion < last for first, last in self._options.stretches)
            return number if self._open[number] and not left else None

        return _PlannedFeeds(self._slow.within(most, section), sum(self._slow.times))

    def _choose(self, slow: _PlannedFeeds) -> _Choice:
        """Choose changes, anew without what refuses them: runs of a beam that they mark, contours and threads."""
        options, contours, runs = self._options, self._contours, self._runs
        options = replace(options, max_slowdown=options.max_slowdown - slow.time / self._total)
        unmarked, refused = frozenset[int](), contours.left()
        untied: dict[int, str] = {}
        for number in range(BEAM_ROUNDS + len(contours.contours) + len(self._threads.spans)):
            threads = [self._threads.spans[n] for n in sorted(untied)]
            left = sorted([*(runs[run] for run in unmarked), *contours.spans(refused), *threads, *options.stretches])
            search = ReversalSearch(
                self._program, self._machine, self._dialect, self._sides, self._open, options, left, slow.feeds.feed
            )
            afforded = affordable_reversals(search, options)
            planned = search.crossings.plan(afforded.changes, afforded.coarser)
            again, radii = contours.refused(afforded.changes, planned.stops, planned.crossings, self._sides)
            if again.keys() > refused.keys():
                refused = {**again, **refused}
                continue
            broken = self._threads.refused(planned.stops, planned.crossings, planned.offset, self._sides)
            if broken.keys() > untied.keys():
                untied = {**broken, **untied}
                continue
            if not planned.burnt:
                break
            found = {run_beside(runs, motion) for motion in planned.burnt}
            if number + 2 >= BEAM_ROUNDS or found <= unmarked:
                found = set(range(len(runs)))
            elif number >= SINGLY:
                # Each time another one would be marked.
                found = set(range(min(found), len(runs)))
            unmarked |= found
        return _Choice(search, afforded, planned, unmarked, refused, radii, untied)

    def _edits(self, choice: _Choice, slow: _PlannedFeeds) -> Edits:
        crossings, stops, approaches, offset, _ = choice.planned
        ground = choice.search.crossings.ground
        shifted = {one.axis for one in crossings} | {shift.axis for stop in stops for shift in stop.shifts}
        shifted |= {name for name in self._amplitude if offset[:, AXES.index(name)].any()}
        used = {name: size for name, size in self._amplitude.items() if name in shifted}
        return Edits(
            runs=runs_of(offset),
            stops=self._with_halts(
                join_stops(list(found)) for _, found in groupby(stops, lambda one: (one.motion, one.share))
            ),
            crossings=crossings,
            amplitude=used,
            followed=tuple(name for name in self._amplitude if len(choice.afforded.changes[name])),
            one_sided={name: 1 if self._sides[name][0] == 0.0 else -1 for name in used if 0.0 in self._sides[name]},
            pulse=approaches,
            kept=ground.kept(crossings),
            rounding=ground.rounding_of(crossings),
            joints=chord_joints(self._program.motions, self._machine, crossings) | corner_joints(ground, crossings),
            dips=tuple(one for one in slow.feeds.dips if offset[one.motion[-1]].any()),
            slowdown=choice.afforded.slowdown + slow.time / self._total,
            short=choice.afforded.short,
            spared=choice.afforded.spared,
        )

    def _with_halts(self, stops: Iterable[StopEdit]) -> tuple[StopEdit, ...]:
        """Add stops at the ends of motions at which the path is to halt: a cutter may rest there, no other tool."""
        found = list(stops)
        halts = self._options.halts - {one.motion for one in found if one.approach}
        # No block stands between the turns of a thread, or between the moves of a contour with cutter compensation.
        halts -= frozenset(np.flatnonzero(self._program.threads | (self._contours.number >= 0)).tolist())
        if self._beam.tends or not halts:
            return tuple(found)
        there = {one.motion for one in found if one.share == 1.0}
        found += [StopEdit(motion=motion, share=1.0, pause=0.0, shifts=()) for motion in halts - there]
        found.sort(key=lambda one: one.motion)
        return tuple(_resting(one) if one.share == 1.0 and one.motion in halts else one for one in found)

    def _warnings(self, choice: _Choice, slow: _PlannedFeeds, edits: Edits) -> Iterator[str]:
        """Say what is left as it is and why, then what has to be known of what is changed."""
        program, options = self._program, self._options
        yield from warn_blocked(program, self._blocked)
        yield from warn_unknown(program, self._amplitude)
        yield from choice.afforded.warnings
        yield from self._beam.warn_left([self._runs[run] for run in sorted(choice.unmarked)])
        yield from self._contours.words(choice.refused, choice.radii, choice.planned.offset)
        yield from self._threads.words(choice.untied, choice.planned.offset)
        more = slow.needed / self._total
        allows = round_up(max(more / SHARE, options.pace * (more + choice.afforded.slowdown)))
        # Where the time allows them, they were tried, and something else is at fault.
        if slow.needed > slow.time and allows > options.max_slowdown:
            yield (
                "friction would hold all tables at lower feeds on tight arcs and before stops, which would add"
                f" {slow.needed:.2g} s: --max-slowdown {allows:g} allows them"
            )
        if edits.amplitude:
            yield from friction_warnings(edits.amplitude, self._beam.tool, climbs=False)
            if self._beam.tool == "cutter":
                yield from warn_climbing(program)
            yield from double_compensation(program, self._dialect, self._machine)
            yield from self._dialect.notices.cautions


def _resting(stop: StopEdit) -> StopEdit:
    """Let a stop rest before its moves and behind each: they would be rounded with the corner."""
    shifts = tuple(replace(shift, pause=max(shift.pause, DWELL)) for shift in stop.shifts)
    return replace(stop, pause=max(stop.pause, DWELL), shifts=shifts)


def _check_overshoot(axes: list[Axis], options: EditOptions) -> None:
    for axis in axes:
        if options.overshoot is not None and options.overshoot < axis.gap.lost_motion:
            raise InputError(
                "--overshoot",
                f"less than the lost motion of {axis.name}",
                expected=f">= {axis.gap.lost_motion / MM:g} mm",
                got=f"{options.overshoot / MM:g} mm",
            )


def _open_sections(
    program: PartProgram, works: BoolArray, blocked: dict[str, BoolArray], left: Collection[int]
) -> BoolArray:
    """Mask of the sections in which the tool works, and that may be shifted (s,)."""
    motions = program.motions
    low, _ = section_spans(motions)
    cuts = np.logical_or.reduceat(works if works.any() else motions.kind != RAPID, low)
    cuts &= ~np.isin(np.arange(low.size), list(left))
    chain = np.searchsorted(chain_spans(motions)[0], low, side="right") - 1
    for marks in blocked.values():
        cuts &= ~marks[chain]
    return np.asarray(cuts)
