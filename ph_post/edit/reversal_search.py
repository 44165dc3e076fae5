"""Find the changes of lasting offsets that the reversals of a program ask for, and what each is worth."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np
from msgspec.structs import replace

from ph_post.compensate.friction import braked
from ph_post.compiling import compiled, read_only
from ph_post.dialects.base import Dialect
from ph_post.edit.crossing_ground import CrossingGround
from ph_post.edit.crossing_search import CrossingSearch
from ph_post.edit.crossing_shapes import fastest_along
from ph_post.edit.edits import EditOptions
from ph_post.edit.positions import (
    RESTART,
    Restart,
    approach_again,
    find_restarts,
    moves,
    placed_once,
    position_from,
    resting_places,
    shiftable,
    told_once,
)
from ph_post.edit.preconditions import (
    cutting_feed,
    why_indivisible,
)
from ph_post.edit.reversals import (
    CARRIED,
    CHAIN,
    LAST,
    MOTION,
    SHARE,
    SHARE0,
    SHARE1,
    SIGN,
    chain_spans,
    find_reversals,
    section_spans,
)
from ph_post.gcode.motion_parts import places_along
from ph_post.gcode.paths import places_words
from ph_post.gcode.program import AXES, LINE, RAPID, PartProgram
from ph_post.gcode.working import travels
from ph_post.types import Array, BoolArray, IntArray, Machine

LITTLE: Final = 0.01
"""Where less slowdown [part of the time] is allowed nothing is spent on lines for a restart."""


def motion_times(program: PartProgram, machine: Machine) -> Array:
    """Time of every motion at its feed [s], shape (m,), ramps and corners left out."""
    motions = program.motions
    length = np.diff(places_along(motions))
    velocity = np.array([machine.axes[name].limits.velocity if name in machine.axes else math.inf for name in AXES])
    columns = (motions.start, motions.end, motions.feed, motions.duration, fastest_along(program, machine))
    return np.asarray(_times(motions.kind, length, velocity, tuple(map(read_only, columns))))


@compiled
def _times(kind: Any, length: Any, velocity: Any, columns: Any) -> Any:
    """Return the times of :func:`motion_times`; 0 where it is not known, or endless."""
    start, end, feed, duration, fastest = columns
    found = np.zeros(kind.size)
    for n in range(kind.size):
        if kind[n] == RAPID:
            time = 0.0
            for axis in range(3):
                way = abs(end[n, axis] - start[n, axis])
                time = time if np.isnan(way) else max(time, way / velocity[axis])
        else:
            time = duration[n] if duration[n] > 0.0 else length[n] / feed[n]
            time = time if np.isnan(time) else max(time, length[n] / fastest[n])
        if time < math.inf:
            found[n] = time
    return found


class ReversalSearch:
    """Search for the offset changes of all axes by dead band; keeps what all searches share.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    dialect : Dialect
    sides : dict
        Offsets of an axis that moves to minus, and to plus, by axis [m].
    sections : BoolArray, shape (s,)
        Sections that may be shifted, see :func:`~ph_post.edit.reversals.section_spans`.
    options : EditOptions
    left : sequence of tuple
        First motion, and the one behind the last, of stretches in which no axis is shifted: each is a chain of its own
        here, and so is what is before and behind it; no offset lasts beyond.
    slow : Array, shape (m,), optional
        Feed of the motions that are passed more slowly [m/s], infinite for others.
    """

    def __init__(
        self,
        program: PartProgram,
        machine: Machine,
        dialect: Dialect,
        sides: dict[str, tuple[float, float]],
        sections: BoolArray,
        options: EditOptions,
        left: Sequence[tuple[int, int]] = (),
        slow: Array | None = None,
    ) -> None:
        self.program, self.dialect = program, dialect
        self.sides, self.amplitude = sides, {name: max(map(abs, pair)) for name, pair in sides.items()}
        times = motion_times(program, machine)
        self.time = float(times.sum())
        self._divide(sections, left)
        named = shiftable(program)
        self._restarts = self._find_restarts(machine, times, named, late=options.max_slowdown >= LITTLE)
        feed = np.nan_to_num(cutting_feed(program, times), copy=False)
        times[program.motions.kind == RAPID] = 0.0
        self._clock = np.zeros(times.size + 1)
        np.cumsum(times, out=self._clock[1:])
        del times
        np.minimum(feed, fastest_along(program, machine), out=feed)
        self._feed = feed if slow is None else np.minimum(feed, slow, out=feed)
        self._from = -options.position_from
        self._moving = moves(program.motions)
        self._places = [resting_places(program.motions, axis) if self._from else [] for axis in range(2)]
        ground = CrossingGround(program, machine, dialect, sides, self._feed, self.low, options, named)
        self.crossings = CrossingSearch(ground, self._whole, self._restarts)
        self._given_up: dict[tuple[str, str], set[int]] = {}
        self.for_now: list[tuple[str, int, str]] = []
        self._leave_unsure()

    def _divide(self, sections: BoolArray, left: Sequence[tuple[int, int]]) -> None:
        """Divide sections at the ends of what is left alone, and say which of them are open to each axis."""
        motions = self.program.motions
        ends = [place for span in left for place in span if place < motions.kind.size]
        self._whole = np.unique(np.append(chain_spans(motions)[0], np.array(ends, dtype=np.int64)))
        within, _ = section_spans(motions)
        self.low = np.union1d(within, self._whole)
        self.high = np.append(self.low[1:], motions.kind.size)
        opened = sections[np.searchsorted(within, self.low, side="right") - 1]
        opened &= np.logical_or.reduceat(motions.kind != RAPID, self.low)
        for begin, end in left:
            opened &= (self.low < begin) | (self.low >= end)
        self.open = {name: opened.copy() for name in self.amplitude}

    def _find_restarts(self, machine: Machine, times: Array, named: BoolArray, *, late: bool) -> list[Restart]:
        """Find where the program may be started again, `late` more than once in a chain; chains are those here."""
        # A table that runs on behind a rapid is anywhere in its backlash.
        flies = any(math.isfinite(braked(machine.axes[name])) for name in self.amplitude)
        apart = 0.0 if flies else RESTART
        restarts = find_restarts(self.program, times, named, late=late, apart=apart)
        chain = np.searchsorted(self._whole, [one.first for one in restarts], side="right") - 1
        return [replace(one, chain=number) for one, number in zip(restarts, chain.tolist(), strict=True)]

    def _leave_unsure(self) -> None:
        """Give up sections in which no cut can be written, as nobody knows what its F would mean."""
        motions = self.program.motions
        modes = np.array([modal.feed_mode == 0 for modal in self.program.modal], dtype=np.bool_)
        if not modes.any():
            return
        unsure = np.logical_or.reduceat(modes[self.program.state[motions.block]], self.low)
        for name, open_ in self.open.items():
            for section in np.flatnonzero(unsure & open_).tolist():
                self.give_up(name, section, "something not understood may have changed what F means")

    def changes(self, band: dict[str, float]) -> dict[str, Array]:
        """Find the changes of every axis, and those to no offset at the ends of chains; rows as of `find_reversals`."""
        return {name: self._one(name, width) for name, width in band.items()}

    def _one(self, name: str, band: float) -> Array:
        axis, (section, low, high, end) = AXES.index(name), self._spans(name)
        # A rapid whose number cannot take a change is no place for one; what a print goes through the air is.
        view = self.crossings.ground.view
        kind = view[0].copy()
        kind[(kind == RAPID) & ~self._carries(axis)] = LINE
        if self.crossings.ground.beam.tool == "extruder":
            taken = self.crossings.ground.shiftable[:, axis] & self._absolute & self._moving[:, axis]
            kind[taken & travels(self.program)] = RAPID
        rows = find_reversals(
            (kind, *view[1:]),
            axis,
            self._feed,
            self.program.motions.exact,
            low,
            high,
            np.ones(low.size, dtype=np.bool_),
            np.full(low.size, band),
        )
        rows[:, CHAIN] = np.searchsorted(self._whole, low[rows[:, CHAIN].astype(np.int64)], side="right") - 1
        self._put_behind_breaks(rows)
        rows = self.crossings.ground.threads.around(rows, axis, self._carries(axis))
        minus, plus = self.sides[name]
        tells = self.crossings.ground.shiftable[:, axis] & self._absolute
        if axis < 2:
            side = 1.0 if abs(plus) <= abs(minus) else -1.0
            rows = placed_once(rows, self._restarts, self._moving[:, axis], axis, side)
            rows = approach_again(self._from_one_side(rows, axis), self._restarts, axis)
            tells &= ~self.crossings.ground.beam.works.on & (view[0] != RAPID)
            rows = told_once(rows, self.program.motions, tells, self._whole, axis, side, beyond=True)
        elif 0.0 in (minus, plus):
            rows = told_once(rows, self.program.motions, tells, self._whole, axis, 1.0 if plus else -1.0)
        # What was added where the axis is left alone goes again.
        span = np.searchsorted(low, rows[:, MOTION], side="right") - 1
        inside = (span >= 0) & (rows[:, MOTION] < end[np.maximum(span, 0)]) if low.size else span >= 0
        rows[:, CHAIN] = span
        return self._closed(rows[inside], axis, section, low, high)

    def _put_behind_breaks(self, rows: Array) -> None:
        """Let an axis that rests on a line that ends a chain, as ``G1 G43 Z2 H1``, come to its side behind that line.

        What is written before it would be in the chain before.
        """
        behind = self._breaks[rows[:, MOTION].astype(np.int64)] & (rows[:, SHARE] == 0.0)
        behind &= (rows[:, LAST] > rows[:, MOTION]) | (rows[:, SHARE1] == 1.0)
        rows[np.ix_(behind, [SHARE, SHARE0])] = 1.0

    @cached_property
    def _breaks(self) -> BoolArray:
        """Mask (m,) of the motions on lines that end a chain and begin another."""
        return np.isin(self.program.motions.block, [one.block for one in self.program.breaks[1:-1]])

    def _carries(self, axis: int) -> BoolArray:
        """Mask (m,) of the motions that may change the offset of an axis as they move it."""
        motions = self.program.motions
        start, end = motions.start[:, axis], motions.end[:, axis]
        rests = (start == end) | np.isnan(start) | np.isnan(end)
        return np.asarray(self.crossings.ground.shiftable[:, axis] | rests)

    def _from_one_side(self, rows: Array, axis: int) -> Array:
        if not self._from:
            return rows
        motions, name = self.program.motions, AXES[axis]
        own = self.section_of(np.array([first for first, _ in self._places[axis]]))
        places = [
            place for place, section in zip(self._places[axis], own.tolist(), strict=True) if self.open[name][section]
        ]
        return position_from(
            rows, places, motions, self._whole, axis, self._from, self.crossings.ground.overshoot[name]
        )

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
        moves = self.crossings.ground.moves(axis, low, high)
        rapids = moves[moves < cut]
        return cut if (moves >= cut).any() or not rapids.size else int(rapids[-1])

    def _closed(self, rows: Array, axis: int, section: IntArray, lows: IntArray, highs: IntArray) -> Array:
        """Add the change to no offset at the end of every span that has changes, and name spans by first sections.

        The last rapid of the axis takes the offset back where nothing cuts after it, or the last one that names it, the
        first one where cuts follow that leave the axis alone; else a stop behind the last motion does.
        """
        motions = self.program.motions
        ends = []
        for span in np.unique(rows[:, CHAIN]).astype(np.int64).tolist():
            low, high = int(lows[span]), int(highs[span])
            last = low + int(np.flatnonzero(motions.kind[low:high] != RAPID)[-1])
            goes_on = high < motions.chain.size and motions.chain[high] == motions.chain[high - 1]
            behind = slice(last + 1, high)
            after = np.flatnonzero(motions.start[behind, axis] != motions.end[behind, axis])
            if not after.size and not goes_on:
                after = np.flatnonzero(self.crossings.ground.shiftable[behind, axis])
            motion = last + 1 + int(after[0 if goes_on else -1]) if after.size else high - 1
            rapid = after.size > 0 and bool(self.crossings.ground.shiftable[motion, axis])
            motion = motion if rapid else high - 1
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

    def gain(self, name: str, rows: Array, low: IntArray | None = None, high: IntArray | None = None) -> Array:
        """Squares of the offsets of an axis, summed over the time [m² s] in which the tool cuts in sections, (s,).

        Or from each motion of `low` (s,) to before that of `high`.
        """
        low, high = (self.low, self.high) if low is None or high is None else (low, high)
        motion = rows[:, MOTION].astype(np.int64)
        if not motion.size:
            return np.zeros(low.size)
        at = self._clock[motion] + rows[:, SHARE] * (self._clock[motion + 1] - self._clock[motion])
        minus, plus = self.sides[name]
        square = np.where(rows[:, SIGN] > 0.0, plus**2, np.where(rows[:, SIGN] < 0.0, minus**2, 0.0))
        at = np.append(at, self._clock[-1])
        reached = np.append(0.0, np.cumsum(square * np.diff(at)))
        return np.asarray(np.interp(self._clock[high], at, reached) - np.interp(self._clock[low], at, reached))

    def give_up(self, name: str, section: int, why: str, *, for_now: bool = False) -> None:
        """Leave an axis uncompensated in a section, for a reason that warnings give, or `for_now`."""
        if for_now:
            self.for_now.append((name, section, why))
        self.open[name][section] = False
        self._given_up.setdefault((name, why), set()).add(section)

    def divided(self, begin: int, end: int) -> range:
        """Divide the section at a motion; return the numbers of the sections from there to before another motion.

        What cuts nothing is no section of its own: it stays with what is before or behind it.
        """
        number = int(np.searchsorted(self.low, begin, side="right")) - 1
        low, cuts = int(self.low[number]), self.program.motions.kind != RAPID
        if not cuts[begin : self.high[number]].any():
            number += 1
        elif cuts[low:begin].any():
            self.low = np.insert(self.low, number + 1, begin)
            self.high = np.append(self.low[1:], self.high[-1])
            self.open = {name: np.insert(one, number + 1, one[number]) for name, one in self.open.items()}
            for place, sections in self._given_up.items():
                both = {number + 1} if number in sections else set()
                self._given_up[place] = both | {n + (n > number) for n in sections}
            self.for_now = [(name, n + (n > number), why) for name, n, why in self.for_now]
            self.crossings = self.crossings.divided(self.low)
            number += 1
        return range(number, int(np.searchsorted(self.low, end)))

    def take_again(self, places: Collection[tuple[str, int, str]]) -> None:
        """Take again what was left for now: axes in sections, with the reasons."""
        for name, section, why in places:
            self.open[name][section] = True
            self._given_up[name, why].discard(section)
        taken = set(places)
        self.for_now = [place for place in self.for_now if place not in taken]

    @property
    def warnings(self) -> list[str]:
        """What is not compensated, a warning for each axis and reason."""
        found = []
        for (name, why), sections in self._given_up.items():
            if not sections:
                continue
            where = stretch_words(self.program, [(int(self.low[n]), int(self.high[n])) for n in sorted(sections)])
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
            found |= self._unwritable(name, rows)
        return found

    def _unwritable(self, name: str, rows: Array) -> bool:
        """Give up sections whose first line goes over to G91: no word before could shift an axis of unknown place."""
        program, found = self.program, False
        heads = np.isin(rows[:, MOTION], self._whole) & (rows[:, SHARE] == 0.0)
        for motion, section in rows[heads][:, [MOTION, CHAIN]].astype(np.int64).tolist():
            block = int(program.motions.block[motion])
            turned = program.modal_after(block - 1).absolute and not program.modal_after(block).absolute
            if turned and self.open[name][section]:
                why = f"{program.line_words(block)} goes over to G91 from where its position may not be known"
                self.give_up(name, section, why)
                found = True
        absolute = self._absolute[rows[:, MOTION].astype(np.int64)]
        chain = np.searchsorted(self._whole, rows[:, MOTION], side="right") - 1
        floating = self._floating[:, AXES.index(name)]
        lost = floating & np.isin(np.arange(floating.size), chain[absolute])
        for section in rows[lost[chain]][:, CHAIN].astype(np.int64).tolist():
            if self.open[name][section]:
                self.give_up(name, section, "G91 alone moves it, and where it is under G90 is not known")
                found = True
        return found

    @cached_property
    def _absolute(self) -> BoolArray:
        """Mask (m,) of the motions behind which lines name places."""
        modes = np.array([modal.absolute for modal in self.program.modal], dtype=np.bool_)
        return np.asarray(modes[self.program.state[self.program.motions.block]])

    @cached_property
    def _floating(self) -> BoolArray:
        """Mask (c, 3) of what is shifted by itself and the axes that nothing but increments moves in its chain.

        An axis that moves from a place to which a line under G90 has brought it does not float: that place can be
        written under G90 too.
        """
        motions, chains = self.program.motions, chain_spans(self.program.motions)[0]
        moves = (motions.start != motions.end) & ~np.isnan(motions.end)
        # A line that names the place at which an axis stands tells it as well.
        told = (moves | self.crossings.ground.shiftable) & self._absolute[:, None] & np.isfinite(motions.end)
        known = np.isfinite(motions.start) & np.logical_or.accumulate(told)
        placed = np.logical_or.reduceat(told | (moves & known), chains)
        found = np.logical_or.reduceat(moves, chains) & ~placed
        return np.asarray(found[np.searchsorted(chains, self._whole, side="right") - 1])


def joined_spans(spans: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Join spans, in order, of which one ends where the next begins.

    Examples
    --------
    >>> joined_spans([(1, 3), (3, 5), (7, 8)])
    [(1, 5), (7, 8)]
    """
    found: list[tuple[int, int]] = []
    for begin, end in spans:
        if found and found[-1][1] == begin:
            found[-1] = found[-1][0], end
        else:
            found.append((begin, end))
    return found


def stretch_words(program: PartProgram, stretches: Sequence[tuple[int, int]]) -> str:
    """Name the lines of stretches, first motion and the one behind the last, for a warning."""
    block = program.motions.block
    return places_words(program, [(int(block[begin]), int(block[end - 1])) for begin, end in joined_spans(stretches)])
