"""Plan backlash offsets of axes behind their loop, and choose the reversals that are worth their time."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import groupby
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.compensate.offsets import may_shift
from ph_post.compensate.plan_warnings import friction_warnings, round_up, varying_backlash_warnings
from ph_post.dialects.base import Dialect
from ph_post.edit.beams import BeamGuard, run_beside
from ph_post.edit.chord_joints import chord_joints
from ph_post.edit.crossing_search import APPROACH, CrossingSearch
from ph_post.edit.crossings import COARSER
from ph_post.edit.edits import EditOptions, Edits, join_stops
from ph_post.edit.positions import approach_again, find_restarts, position_from, resting_places
from ph_post.edit.preconditions import (
    blocked_chains,
    cutting_feed,
    double_compensation,
    program_units,
    warn_blocked,
    warn_climbing,
    warn_unknown,
    why_indivisible,
    why_not_editable,
    written_offsets,
)
from ph_post.edit.reversals import (
    CARRIED,
    CHAIN,
    FIRST,
    MOTION,
    SHARE,
    SHARE0,
    SIGN,
    chain_spans,
    find_reversals,
    motion_view,
    section_spans,
)
from ph_post.errors import InputError
from ph_post.gcode.motion_parts import places_along
from ph_post.gcode.paths import places_words
from ph_post.gcode.program import AXES, RAPID, PartProgram
from ph_post.simulate.controllers.run import moved_axes
from ph_post.types import Array, Axis, BoolArray, IntArray, Machine, frozen, sealed
from ph_post.units import MM


def motion_times(program: PartProgram, machine: Machine) -> Array:
    """Time of every motion at its feed [s], shape (m,), ramps and corners left out."""
    motions = program.motions
    with np.errstate(invalid="ignore", divide="ignore"):
        way = np.nan_to_num(np.abs(motions.end - motions.start))
        length = np.diff(places_along(motions))
        rapid = np.zeros(length.size)
        for column, name in enumerate(AXES):
            if name in machine.axes:
                rapid = np.maximum(rapid, way[:, column] / machine.axes[name].limits.velocity)
        cut = np.where(motions.duration > 0.0, motions.duration, length / motions.feed)
        return np.nan_to_num(np.where(motions.kind == RAPID, rapid, cut), posinf=0.0)


SPARE: Final = 3e-3
"""Part of a program's time that does not count as slower."""

LITTLE: Final = 0.01
"""Where less slowdown [part of the time] is allowed nothing is spent on lines for a restart."""

BEAM_ROUNDS: Final = 6
"""Plans that are made before nothing is shifted wherever a beam is on."""

LEAVING_ROUNDS: Final = 6
"""Times that sections are chosen to be left alone before the dead band is raised."""

TIGHTER: Final = 0.98
"""Part of what should be enough that is allowed the next time."""

_HALVINGS: Final = 6
"""Halvings of the range of the dead band, down to a sixtieth of it."""


class ReversalSearch:
    """Search for the offset changes of all axes by dead band; keeps what all searches share.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    dialect : Dialect
    amplitude : dict
        Offset by axis [m].
    sides : dict
        Offsets of an axis that moves to minus, and to plus, by axis [m].
    sections : BoolArray, shape (s,)
        Sections that may be shifted, see :func:`~ph_post.edit.reversals.section_spans`.
    options : EditOptions
    left : sequence of tuple
        First motion, and the one behind the last, of stretches in which no axis is shifted: each is a chain of its own
        here, and so is what is before and behind it; no offset lasts beyond.
    """

    def __init__(
        self,
        program: PartProgram,
        machine: Machine,
        dialect: Dialect,
        amplitude: dict[str, float],
        sides: dict[str, tuple[float, float]],
        sections: BoolArray,
        options: EditOptions,
        left: Sequence[tuple[int, int]] = (),
    ) -> None:
        self.program, self.machine, self.dialect = program, machine, dialect
        self.amplitude, self.sides = amplitude, sides
        self.times = motion_times(program, machine)
        begins = chain_spans(program.motions)[0]
        ends = [place for span in left for place in span if place < program.motions.kind.size]
        self._whole = np.unique(np.append(begins, np.array(ends, dtype=np.int64)))
        within, _ = section_spans(program.motions)
        self.low = np.union1d(within, self._whole)
        self.high = np.append(self.low[1:], program.motions.kind.size)
        cuts = np.where(program.motions.kind != RAPID, self.times, 0.0)
        self._clock = np.append(0.0, np.cumsum(cuts))
        opened = sections[np.searchsorted(within, self.low, side="right") - 1]
        opened &= np.logical_or.reduceat(program.motions.kind != RAPID, self.low)
        for begin, end in left:
            opened &= (self.low < begin) | (self.low >= end)
        self.open = {name: opened.copy() for name in amplitude}
        self._view = motion_view(program.motions)
        self._feed = np.nan_to_num(cutting_feed(program, self.times))
        # No less than what the numbers of the program can say of the backlash.
        self._overshoot = {
            name: APPROACH * (plus - minus) if options.overshoot is None else max(options.overshoot, plus - minus)
            for name, (minus, plus) in sides.items()
        }
        self._from = -options.position_from
        self._places = [resting_places(program.motions, axis) if self._from else [] for axis in range(2)]
        restarts = find_restarts(program, self.times, late=options.max_slowdown >= LITTLE)
        chain = np.searchsorted(self._whole, [one.first for one in restarts], side="right") - 1
        self._restarts = [replace(one, chain=number) for one, number in zip(restarts, chain.tolist(), strict=True)]
        self.crossings = CrossingSearch(
            program,
            machine,
            dialect,
            sides,
            self._feed,
            self.low,
            self._whole,
            self._overshoot,
            self._restarts,
            part_side=options.part_side,
        )
        self._given_up: dict[tuple[str, str], set[int]] = {}
        self._for_now: list[tuple[str, int, str]] = []

    def changes(self, band: dict[str, float]) -> dict[str, Array]:
        """Find the changes of every axis, and those to no offset at the ends of chains; rows as of `find_reversals`."""
        return {name: self._one(name, width) for name, width in band.items()}

    def _one(self, name: str, band: float) -> Array:
        axis, (section, low, high, end) = AXES.index(name), self._spans(name)
        rows = find_reversals(
            self._view,
            axis,
            self._feed,
            self.program.motions.exact,
            low,
            high,
            np.ones(low.size, dtype=np.bool_),
            np.full(low.size, band),
        )
        rows[:, CHAIN] = np.searchsorted(self._whole, low[rows[:, CHAIN].astype(np.int64)], side="right") - 1
        if axis < 2:
            rows = approach_again(self._from_one_side(rows, axis), self._restarts, axis)
        # What was added where the axis is left alone goes again.
        span = np.searchsorted(low, rows[:, MOTION], side="right") - 1
        inside = (span >= 0) & (rows[:, MOTION] < end[np.maximum(span, 0)]) if low.size else span >= 0
        rows[:, CHAIN] = span
        return self._closed(rows[inside], axis, section, low, high)

    def _from_one_side(self, rows: Array, axis: int) -> Array:
        if not self._from:
            return rows
        motions, name = self.program.motions, AXES[axis]
        own = self.section_of(np.array([first for first, _ in self._places[axis]]))
        places = [
            place for place, section in zip(self._places[axis], own.tolist(), strict=True) if self.open[name][section]
        ]
        return position_from(rows, places, motions, self._whole, axis, self._from, self._overshoot[name])

    def _spans(self, name: str) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Return what lies between sections that an axis leaves alone: the first section, the motions, where cuts end.

        The rapids of the next section belong to them: those take the offset back. Where an axis is taken up in the
        midst of a chain, the cut says to which side, or else the last rapid that moves the axis.
        """
        open_ = self.open[name]
        chain, kind = np.searchsorted(self._whole, self.low, side="right"), self.program.motions.kind
        same = np.append(False, chain[1:] == chain[:-1])
        first = np.flatnonzero(open_ & ~(same & np.append(False, open_[:-1])))
        last = np.flatnonzero(open_ & ~np.append(same[1:] & open_[1:], False))
        low, high = self.low[first].copy(), self.high[last].copy()
        for n in np.flatnonzero(same[first]).tolist():
            low[n] = self._takes_up(AXES.index(name), int(low[n]), int(self.high[first[n]]))
        for n in np.flatnonzero(np.append(same[1:], False)[last]).tolist():
            while high[n] < kind.size and kind[high[n]] == RAPID:
                high[n] += 1
        return first, low, high, self.high[last]

    def _takes_up(self, axis: int, low: int, high: int) -> int:
        """Return the first motion that says to which side an axis is taken up in a section."""
        motions = self.program.motions
        cut = low + int(np.argmax(motions.kind[low:high] != RAPID))
        moves = self.crossings.moves(axis, low, high)
        rapids = moves[moves < cut]
        return cut if (moves >= cut).any() or not rapids.size else int(rapids[-1])

    def _closed(self, rows: Array, axis: int, section: IntArray, lows: IntArray, highs: IntArray) -> Array:
        """Add the change to no offset at the end of every span that has changes, and name spans by first sections.

        The last rapid of the axis takes the offset back where nothing cuts after it, the first one where cuts follow
        that leave the axis alone; else a stop behind the last motion does.
        """
        motions = self.program.motions
        ends = []
        for span in np.unique(rows[:, CHAIN]).astype(np.int64).tolist():
            low, high = int(lows[span]), int(highs[span])
            last = low + int(np.flatnonzero(motions.kind[low:high] != RAPID)[-1])
            after = np.flatnonzero(motions.start[last + 1 : high, axis] != motions.end[last + 1 : high, axis])
            rapid = after.size > 0
            goes_on = high < motions.chain.size and motions.chain[high] == motions.chain[high - 1]
            motion = last + 1 + int(after[0 if goes_on else -1]) if rapid else high - 1
            row = np.zeros(rows.shape[1])
            row[[MOTION, SHARE, SIGN, CARRIED, CHAIN]] = motion, 1.0, 0.0, rapid, span
            ends.append(row)
        if not ends:
            return rows
        every = np.concatenate([rows, ends])
        # A stable sort: of two changes in one rapid the one to none comes last.
        every = every[np.argsort(every[:, CHAIN], kind="stable")]
        every[:, CHAIN] = section[every[:, CHAIN].astype(np.int64)]
        return np.asarray(every)

    def section_of(self, motion: Array) -> IntArray:
        """Return the numbers of the sections of motions (n,)."""
        return np.asarray(np.searchsorted(self.low, motion, side="right") - 1)

    def cost(self, changes: dict[str, Array], coarser: float = 1.0) -> float:
        """Return the time that changes cost [s], with errors of crossings up to a multiple of the least."""
        return self.crossings.cost(changes, coarser)

    def gain(self, name: str, rows: Array) -> Array:
        """Squares of the offsets of an axis, summed over the time [m² s] in which the tool cuts in sections, (s,)."""
        motion, ends = rows[:, MOTION].astype(np.int64), self._clock[np.append(self.low, self.times.size)]
        if not motion.size:
            return np.zeros(self.low.size)
        at = self._clock[motion] + rows[:, SHARE] * (self._clock[motion + 1] - self._clock[motion])
        minus, plus = self.sides[name]
        square = np.where(rows[:, SIGN] > 0.0, plus**2, np.where(rows[:, SIGN] < 0.0, minus**2, 0.0))
        at = np.append(at, self._clock[-1])
        return np.diff(np.interp(ends, at, np.append(0.0, np.cumsum(square * np.diff(at)))))

    def give_up(self, name: str, section: int, why: str, *, for_now: bool = False) -> None:
        """Leave an axis uncompensated in a section, for a reason that warnings give, or `for_now`."""
        if for_now:
            self._for_now.append((name, section, why))
        self.open[name][section] = False
        self._given_up.setdefault((name, why), set()).add(section)

    def take_again(self) -> None:
        """Take again what was left for now."""
        for name, section, why in self._for_now:
            self.open[name][section] = True
            self._given_up[name, why].discard(section)
        self._for_now.clear()

    @property
    def warnings(self) -> list[str]:
        """What is not compensated, a warning for each axis and reason."""
        found = []
        for (name, why), sections in self._given_up.items():
            if not sections:
                continue
            where = _stretch_words(self.program, [(int(self.low[n]), int(self.high[n])) for n in sorted(sections)])
            found.append(f"axis {name} not compensated in {where}: {why}")
        return found

    def unsplit(self, changes: dict[str, Array]) -> bool:
        """Give up sections in which a motion cannot be divided at a reversal; return true where there was one."""
        found = False
        for name, rows in changes.items():
            inside = rows[(rows[:, SHARE] > 0.0) & (rows[:, SHARE] < 1.0)]
            section = self.section_of(inside[:, MOTION])
            for motion, share, number in zip(*inside[:, [MOTION, SHARE]].T.tolist(), section.tolist(), strict=True):
                why = why_indivisible(self.program, self.dialect, int(motion), share)
                if why and self.open[name][number]:
                    self.give_up(name, number, why)
                    found = True
            found |= self._unknown_sides(name, rows)
        return found

    def _unknown_sides(self, name: str, rows: Array) -> bool:
        """Give up sections in which a cut from an unknown place ends where an axis is to be shifted first."""
        motions, found = self.program.motions, False
        if 0.0 not in self.sides[name]:
            # Half of the backlash to either side is no worse than the plain program, whichever side it is.
            return False
        first = np.append(True, np.diff(rows[:, CHAIN]) != 0.0)[: len(rows)]
        for row in rows[first & (rows[:, SIGN] != 0.0)]:
            begin, section = int(row[FIRST]), int(row[CHAIN])
            cuts = motions.kind[begin] != RAPID and row[SHARE0] == 1.0
            if cuts and np.isnan(motions.start[begin, AXES.index(name)]) and self.open[name][section]:
                self.give_up(
                    name, section, f"the motion in line {motions.block[begin] + 1} leaves it on an unknown side"
                )
                found = True
        return found


def section_words(program: PartProgram, sections: Collection[int]) -> str:
    """Name the lines of sections for a warning, the first few stretches of them."""
    low, high = section_spans(program.motions)
    return _stretch_words(program, [(int(low[n]), int(high[n])) for n in sorted(sections)])


def _stretch_words(program: PartProgram, stretches: Sequence[tuple[int, int]]) -> str:
    joined: list[list[int]] = []
    for begin, end in stretches:
        if joined and joined[-1][1] == begin:
            joined[-1][1] = end
        else:
            joined.append([begin, end])
    block = program.motions.block
    return places_words([(int(block[begin]), int(block[end - 1])) for begin, end in joined])


class AffordedChanges(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Changes within the time allowed: by axis the rows of :func:`~ph_post.edit.reversals.find_reversals`.

    `coarser` is the largest error of crossings as a multiple of the least, `slowdown` what they cost, relative;
    `short` where that is too much for all of them.
    """

    changes: dict[str, Array]
    coarser: float
    slowdown: float
    warnings: list[str]
    short: bool = False


def affordable_reversals(search: ReversalSearch, options: EditOptions) -> AffordedChanges:
    """Find the changes that keep within the allowed slowdown.

    The dead band begins with the tolerance, and crossings with their least error. Where that costs too much, crossings
    may be coarser; then sections are left alone whose crossings cost most for what they gain, and where there is but
    one, axes; last the dead band is raised, up to half the lost motion of each axis.
    """
    # Ramps and rapids take longer than the motions at their feeds.
    total = max(float(search.times.sum()), options.cycle, 1e-9)
    # What the planner takes is known to a few thousandths.
    allowed = (options.max_slowdown + SPARE) * total
    found = _search_raised(search, options, 0.0)
    while search.unsplit(found):
        found = _search_raised(search, options, 0.0)
    every = search.cost(found)
    for coarser in (1.0, *COARSER):
        cost = every if coarser == 1.0 else search.cost(found, coarser)
        if cost <= allowed:
            return AffordedChanges(changes=found, coarser=coarser, slowdown=cost / total, warnings=search.warnings)
    budget = allowed
    for number in range(LEAVING_ROUNDS):
        if number:
            search.take_again()
        _leave_costly(search, options, budget, round_up(every / total))
        # What is left may cost more once its neighbours are gone.
        cost = search.cost(_search_raised(search, options, 1.0), COARSER[-1])
        if cost <= allowed:
            break
        budget *= TIGHTER * allowed / cost
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        kept = search.cost(_search_raised(search, options, middle), COARSER[-1]) <= allowed
        low, high = (low, middle) if kept else (middle, high)
    found = _search_raised(search, options, high)
    widest = max(_bands(search, options, high).values())
    said = [
        f"moves below {widest / MM:.4g} mm are ignored to keep within --max-slowdown:"
        f" --max-slowdown {round_up(every / total):g} would compensate all above {options.tolerance / MM:g} mm"
    ]
    return AffordedChanges(
        changes=found,
        coarser=COARSER[-1],
        slowdown=search.cost(found, COARSER[-1]) / total,
        warnings=[*search.warnings, *(said if any(len(rows) for rows in found.values()) else [])],
        short=True,
    )


def _leave_costly(search: ReversalSearch, options: EditOptions, allowed: float, need: float) -> None:
    """Leave sections alone, or axes in them, until the widest dead band keeps within the time allowed.

    First go those that cost most for what they gain: the squares of the offsets for as long as they cut with them. What
    is cheap may leave too little time for what gains most: that can be asked for first.
    """
    found = _search_raised(search, options, 1.0)
    cost = _section_costs(search, found)
    total = sum(float(one.sum()) for one in cost.values())
    if total <= allowed:
        return
    gain = {name: search.gain(name, rows) for name, rows in found.items()}

    left = {(name, n) for name in cost for n in np.flatnonzero(cost[name]).tolist()}
    spent = 0.0
    for units in (
        [(set(cost), n) for n in range(search.low.size)],
        [({name}, n) for n in range(search.low.size) for name in cost],
    ):

        def worth(unit: tuple[set[str], int]) -> float:
            names, n = unit
            price = 1.0 if options.largest_first else sum(float(cost[name][n]) for name in names)
            return sum(float(gain[name][n]) for name in names) / max(price, 1e-12)

        for names, n in sorted(units, key=worth, reverse=True):
            wanted = [(name, n) for name in sorted(names) if (name, n) in left]
            price = sum(float(cost[name][n]) for name, _ in wanted)
            if wanted and spent + price <= allowed:
                spent += price
                left.difference_update(wanted)
    for name in cost:
        own = sorted(n for axis, n in left if axis == name)
        price = float(cost[name][own].sum())
        for n in own:
            why = f"its crossings would cost {price:.2g} s; --max-slowdown {need:g} would allow them"
            search.give_up(name, n, why, for_now=True)


def _section_costs(search: ReversalSearch, found: dict[str, Array]) -> dict[str, Array]:
    """Time that the changes of each axis cost in every section [s], by axis (s,)."""
    column, motion, times = search.crossings.costs(found, COARSER[-1])
    costs = {name: np.zeros(search.low.size) for name in found}
    for name, cost in costs.items():
        own = column == AXES.index(name)
        np.add.at(cost, search.section_of(motion[own]), times[own])
    return costs


def _search_raised(search: ReversalSearch, options: EditOptions, raised: float) -> dict[str, Array]:
    return search.changes(_bands(search, options, raised))


def _bands(search: ReversalSearch, options: EditOptions, raised: float) -> dict[str, float]:
    """Dead bands by axis [m]: `raised` from the tolerance (0) to half the lost motion (1)."""
    return {
        name: options.tolerance + raised * max(half - options.tolerance, 0.0) for name, half in search.amplitude.items()
    }


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
    said = tuple(varying_backlash_warnings(machine.axes[name] for name in moved_axes(program)))
    nothing = Edits(offset=frozen(np.zeros((program.motions.kind.size, 3))), warnings=said)
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
    for number in range(BEAM_ROUNDS):
        left = [runs[run] for run in sorted(unmarked)]
        search = ReversalSearch(program, machine, dialect, amplitude, sides, open_, options, left)
        afforded = affordable_reversals(search, options)
        changes = afforded.changes
        crossings, stops, pulse, offset, burnt = search.crossings.plan(changes, afforded.coarser)
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
        kept=search.crossings.kept(crossings),
        joints=chord_joints(program.motions, machine, crossings),
        slowdown=afforded.slowdown,
        short=afforded.short,
    )
    warnings = [*said, *warn_blocked(program, blocked), *warn_unknown(program, amplitude), *afforded.warnings]
    warnings += beam.warn_left([runs[run] for run in sorted(unmarked)])
    if edits.amplitude:
        own = double_compensation(program, dialect, machine)
        warnings += [
            *friction_warnings(edits.amplitude, beam.tool, climbs=False),
            *(warn_climbing(program) if beam.tool == "cutter" else ()),
            *own,
            *dialect.notices.cautions,
        ]
    return replace(edits, warnings=tuple(warnings))


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
