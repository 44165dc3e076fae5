"""Plan the offsets of axes beside X, Y and Z: in their own words, by short moves of their own, or not at all.

Such an axis has one place behind each of its moves, and what it does meanwhile is a line in time. Behind its loop
its table follows half the backlash late, so each word carries that half towards the side to which the axis moves, as
those of X, Y and Z do. Where it turns back, its motor has to go through the backlash while its table rests:

1. A rapid takes that along, and so does a move at feed of this axis alone: table and tool stay where they are until
   the motor has arrived, and go the same way then.
2. In the midst of cuts that move it beside other axes a move of its own, by the backlash alone, stands between the two
   lines, or between others at which it rests.
3. Behind an unknown place, and where it shall come to all places from one side, a rapid is followed by two short ones:
   beyond the place, and back to it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.plan_warnings import round_up
from ph_post.dialects.base import Dialect
from ph_post.drive.axes import side_offsets
from ph_post.edit.affordable import SPARE, too_costly
from ph_post.edit.block_words import next_relying
from ph_post.edit.edits import EditOptions
from ph_post.edit.preconditions import FINE, why_not_editable, word_decimals
from ph_post.edit.reversal_search import motion_times
from ph_post.gcode import codes
from ph_post.gcode.further import FurtherMoves, further_moves, unit_of
from ph_post.gcode.program import RAPID, PartProgram, chain_heads
from ph_post.gcode.working import working_motions
from ph_post.types import ROTARY_AXES, Array, Axis, IntArray, Machine
from ph_post.units import DEGREE, MINUTE

BAND: Final = 0.1
"""Part of its backlash by which an axis may turn back without that it counts as a reversal."""

BEYOND: Final = 2.0
"""Times its backlash that an axis comes from beyond its place, unless an overshoot is asked for."""

_FEWEST: Final = 4
"""Fewest steps of the last decimal that a backlash has to have, so that half a step is no more than an eighth of it."""

_TRIED: Final = 50
"""Lines between two moves of an axis that are tried for a move of its own."""

_INVERSE, _PER_MINUTE = 93, 94
"""Feed modes in which moves of its own are written."""

_CLAMPED, _RELEASED = 10.0, 11.0
"""M words that clamp and release rotary axes."""

_MODES: Final = ("G0", "G1", "G2", "G3")
"""Motion modes between whose lines another line may stand."""

_HALF_TURN: Final = 0.5 * math.tau

_SHORTEST: Final = 1e-9
"""Least time of a program [s]; where it moves nothing by a known way, its time is not known."""


class AddedMoves(msgspec.Struct, frozen=True, kw_only=True):
    """Moves of one axis alone, before line `block`: `steps` of its offset there, each a place beside `place`.

    `label` says what for; `absolute`, `motion` and `inverse` are the modes in force there, and `at` the offset before.
    `feed` [rad/s, m/s] is the one in force, infinite where it does not hold for them.
    """

    letter: str
    block: int
    place: float
    at: int
    steps: tuple[int, ...]
    label: str
    motion: str
    absolute: bool
    inverse: bool
    feed: float


class Stand(msgspec.Struct, frozen=True, kw_only=True):
    """A place at which an axis is to be while the tool works, and where its motor is then in the changed program.

    In the order of the program; `counts` where something is cut there; the rest are ways of the motor. rad, or m.
    """

    place: float
    motor: float
    counts: bool


class FurtherAxisPlan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The plan of one axis: steps added to its words, by word, and moves of its own.

    `step` is one of them [rad, m], `sides` the offsets while it moves to minus and to plus [steps]; `beyond` [steps] is
    the longest way beyond a place; `done` of `reversals` are compensated; `stands` are all places in order; `left`
    names stretches that stay as they are, with the reason.
    """

    axis: Axis
    step: float
    decimals: int
    sides: tuple[int, int]
    beyond: int
    shifts: Mapping[int, int]
    added: tuple[AddedMoves, ...]
    done: int
    reversals: int
    stands: tuple[Stand, ...]
    left: tuple[str, ...]

    @property
    def cost(self) -> float:
        """Time that its moves in the midst of cuts cost [s]: from rest to rest, at most at its speed and their feed."""
        limits, cost = self.axis.limits, 0.0
        for one in self.added:
            if one.motion == "G1":
                way = abs(one.steps[-1] - one.at) * self.step
                cost += way / min(limits.velocity, one.feed) + 2.0 * math.sqrt(way / limits.acceleration)
        return cost

    @property
    def added_moves(self) -> int:
        """Number of moves of its own."""
        return sum(len(one.steps) for one in self.added)


def further_decimals(letter: str, dialect: Dialect, units: float) -> int:
    """Return the decimals of the words of an axis in a program whose unit of lengths is `units` [m]."""
    return min(dialect.numbers.decimals, FINE) if letter in ROTARY_AXES else word_decimals(dialect, units)


def plan_further(
    program: PartProgram, machine: Machine, dialect: Dialect, options: EditOptions
) -> tuple[list[FurtherAxisPlan], list[str]]:
    """Plan the offsets of all axes beside X, Y and Z that a machine has and a program moves.

    Returns
    -------
    plans : list of FurtherAxisPlan
    said : list of str
        Warnings, a sentence each.
    """
    moved, plans = further_moves(program), list[FurtherAxisPlan]()
    lost = {name: axis for name, axis in machine.further.items() if axis.gap.lost_motion > 0.0}
    asked = {name: axis for name, axis in lost.items() if name in moved and moved[name].block.size}
    said = [
        f"axis {name} not compensated: {dialect.name} programs are passed through where it moves"
        for name in lost
        if name not in program.language.further and np.any(program.words.letter == ord(name))
    ]
    if not asked:
        return plans, said
    troubles, time = why_not_editable(program), float(motion_times(program, machine).sum())
    for name, axis in asked.items():
        planner = _AxisPlanner(program, dialect, axis, options, moved[name], machine)
        if axis.loop.encloses_backlash:
            said.append(f"axis {name} not compensated: its backlash is inside the loop")
        elif planner.signed:
            said.append(f"axis {name} not compensated: {planner.signed} says by its sign which way round it turns")
        elif troubles or planner.coarse:
            why = [*troubles, f"the decimals of {dialect.name} are too few for its backlash"][0]
            said.append(f"axis {name} not compensated: {why}")
        else:
            plan, total = planner.plan(), max(time, planner.time, _SHORTEST)
            if plan.cost > (options.max_slowdown + SPARE) * total:
                need = round_up(plan.cost / total)
                planner.no_stops = too_costly(plan.cost, need)
                plan = planner.plan()
            plans.append(plan)
            said += plan.left
            setting = dialect.notices.signed_turns if name in ROTARY_AXES and (plan.shifts or plan.added) else ""
            said += [f"{setting} must be 0 for axis {name}: a sign would turn it the other way"] if setting else []
    return plans, said


class _Left(Exception):  # noqa: N818 - no error: a chain that stays as it is
    """A reason why a chain of moves is left as it is."""


class _Draft:
    """What one chain becomes, as far as it is known: steps of the words, moves of its own, places, counts.

    `sign` is the direction in which the axis moved last, 0 where not known; `begin` and `carried` [steps] are its
    offsets before and behind the last move.
    """

    def __init__(self) -> None:
        self.shifts: dict[int, int] = {}
        self.added: list[AddedMoves] = []
        self.stands: list[Stand] = []
        self.beyond = self.reversals = 0
        self.sign = self.begin = self.carried = 0


class _AxisPlanner:
    def __init__(
        self,
        program: PartProgram,
        dialect: Dialect,
        axis: Axis,
        options: EditOptions,
        moves: FurtherMoves,
        machine: Machine,
    ) -> None:
        self._program, self._axis, self._moves, self._options = program, axis, moves, options
        units = program.modal[program.state[moves.block[0]]].units
        self._decimals = further_decimals(axis.name, dialect, units)
        self._step = unit_of(axis.name, units) * 10.0**-self._decimals
        minus, plus = side_offsets(axis)
        self._sides = round(minus / self._step), round(plus / self._step)
        over = BEYOND * axis.gap.lost_motion
        if options.overshoot is not None and axis.name not in ROTARY_AXES:
            over = max(options.overshoot, axis.gap.lost_motion)
        self._over = math.ceil(over / self._step - 1e-6)
        tool = working_motions(program, machine.tool).tool
        self.no_stops = "" if tool == "cutter" else "a stop where it turns back would show"
        self._wraps = program.language.shortest and axis.name in ROTARY_AXES
        self._cuts = _cut_lines(program)
        words = program.words
        clamps = (words.letter == ord("M")) & np.isin(words.value, (_CLAMPED, _RELEASED))
        self._clamps = words.block[clamps].astype(np.int64)
        self._clamped = words.value[clamps] == _CLAMPED

    @property
    def coarse(self) -> bool:
        """Whether its backlash is no more than a few steps of the last decimal."""
        return self._axis.gap.lost_motion < (_FEWEST - 0.5) * self._step

    @property
    def signed(self) -> str:
        """A zero with a minus sign, which is a way round where no place is a whole turn away; empty without one."""
        words, found = self._program.words, self._moves.word[self._moves.absolute]
        if self._axis.name not in ROTARY_AXES or np.any(np.abs(words.value[found]) * DEGREE >= math.tau):
            return ""
        found = found[words.value[found] == 0.0]
        texts = (self._program.data[words.start[word] : words.end[word]] for word in found.tolist())
        return next((text.decode("ascii", "replace") for text in texts if b"-" in text), "")

    @property
    def time(self) -> float:
        """Time that the axis takes for its moves by themselves [s]."""
        way = np.nansum(np.abs(self._moves.end - self._moves.start))
        return float(way) / self._axis.limits.velocity

    def plan(self) -> FurtherAxisPlan:
        """Return the plan of all chains."""
        moves, left, drafts, missed = self._moves, [], [], 0
        chains = np.flatnonzero(chain_heads(moves.chain))
        for low, high in zip(chains.tolist(), [*chains[1:].tolist(), moves.block.size], strict=True):
            draft = _Draft()
            try:
                self._chain(draft, low, high)
            except _Left as why:
                where = self._program.line_words(int(moves.block[low]), int(moves.block[high - 1]))
                left.append(f"axis {self._axis.name} not compensated in {where}: {why}")
                missed += self._reversals(low, high)
                draft = self._plain(low, high)
            drafts.append(draft)
        done = sum(draft.reversals for draft in drafts)
        return FurtherAxisPlan(
            axis=self._axis,
            step=self._step,
            decimals=self._decimals,
            sides=self._sides,
            beyond=max(draft.beyond for draft in drafts),
            shifts={word: steps for draft in drafts for word, steps in draft.shifts.items() if steps},
            added=tuple(moves for draft in drafts for moves in draft.added),
            done=done,
            reversals=done + missed,
            stands=tuple(stand for draft in drafts for stand in draft.stands),
            left=tuple(left),
        )

    def _turns(self, low: int, high: int) -> IntArray:
        """Direction of each move of a chain, within the dead band that of the way on which it lies; 0: not known."""
        moves, turns, band = self._moves, np.zeros(high - low, dtype=np.int64), BAND * self._axis.gap.lost_motion
        cuts = [low, *(n for n in range(low, high) if self._unclear(n)), high]
        for first, last in pairwise(cuts):
            # Behind an unclear move its end is known.
            begin, places = first, np.append(moves.start[first:last][:1], moves.end[first:last])
            if first < last and self._unclear(first):
                begin, places = first + 1, moves.end[first:last]
            turns[begin - low : last - low] = leg_signs(places, max(band, self._step))
        return turns

    def _unclear(self, n: int) -> bool:
        """Return true where the way to a place is not known, or may be the other way round."""
        away = self._moves.end[n] - self._moves.start[n]
        # With another offset behind it than before it goes farther.
        near = self._axis.gap.lost_motion + 2.0 * self._step
        wraps = self._wraps and self._moves.absolute[n] and abs(away) > _HALF_TURN - near
        return bool(np.isnan(self._moves.start[n]) or wraps)

    def _reversals(self, low: int, high: int) -> int:
        """Count the reversals of a chain."""
        turns = self._turns(low, high)
        turns = turns[turns != 0]
        return int(np.count_nonzero(np.diff(turns)))

    def _plain(self, low: int, high: int) -> _Draft:
        """Return a chain that stays as it is."""
        draft = _Draft()
        for n in range(low, high):
            self._stand(draft, n, high)
        return draft

    def _works(self, n: int, high: int) -> bool:
        """Return true where something is cut on a move, or while the axis rests behind it."""
        moves = self._moves
        until = int(moves.block[n + 1]) if n + 1 < high else self._end(n)
        first, last = np.searchsorted(self._cuts, [moves.block[n], until])
        return bool(last > first) or not moves.rapid[n]

    def _end(self, n: int) -> int:
        """Return the line before which nothing may last that was added to a move."""
        return int(self._moves.ends[self._moves.chain[n]])

    def _line(self, n: int) -> str:
        """Name the line of a move."""
        return self._program.line_words(self._moves.block[n])

    def _chain(self, draft: _Draft, low: int, high: int) -> None:
        """Plan a chain of moves.

        Raises
        ------
        _Left
            With the reason why it stays as it is.
        """
        moves, turns, wanted = self._moves, self._turns(low, high), -self._options.position_from
        for n in range(low, high):
            turn, unclear, draft.begin = int(turns[n - low]), self._unclear(n), draft.carried
            onto = bool(wanted) and moves.rapid[n] and turn not in (0, wanted) and self._works(n, high)
            if np.isnan(moves.end[n]):
                raise _Left(f"{self._line(n)} moves it from where its place is not known")
            if moves.rapid[n] and (unclear or onto):
                draft.reversals += int(onto and not unclear)
                self._approach(draft, n, wanted or next((int(one) for one in turns[n + 1 - low :] if one), 1))
            elif unclear and not np.isnan(moves.start[n]):
                raise _Left(f"{self._line(n)} turns it by half a turn or more, which may be either way round")
            elif not unclear:
                self._go(draft, n, turn)
            self._stand(draft, n, high)
        last = high - 1
        if draft.carried and self._idle(last, high) and not self._approached(draft, last):
            # Nothing is cut behind this rapid, which takes the offset back.
            draft.shifts[int(moves.word[last])] = 0 if moves.absolute[last] else -draft.begin
            draft.stands[-1] = Stand(place=moves.end[last], motor=moves.end[last], counts=False)
        elif draft.carried:
            self._return(draft, last)

    def _approach(self, draft: _Draft, n: int, sign: int) -> None:
        """Let a rapid lead to the place itself, and moves behind it beyond it and back, to the offset.

        Where the way round depends on how far it is, the rapid keeps the offset before, and goes as far as it did.
        """
        at = draft.begin if self._wraps and self._moves.absolute[n] else 0
        draft.shifts[int(self._moves.word[n])] = at if self._moves.absolute[n] else -draft.begin
        draft.sign, draft.carried = sign, self._sides[sign > 0]
        beyond = draft.carried - sign * self._over
        self._add(draft, int(self._moves.block[n]) + 1, n, at, (beyond, draft.carried), f"{self._axis.name} approach")
        draft.beyond = max(draft.beyond, self._over)

    def _go(self, draft: _Draft, n: int, turn: int) -> None:
        """Let a move carry its offset, and change it on the way or before it where the axis turns back."""
        moves = self._moves
        short = abs(moves.end[n] - moves.start[n]) < self._axis.gap.lost_motion
        if turn not in (0, draft.sign) and (draft.sign or not short):
            wanted = self._sides[turn > 0]
            draft.reversals += int(draft.sign != 0)
            if draft.sign and not (moves.rapid[n] or moves.alone[n]):
                self._cross(draft, n, wanted)
                draft.begin = wanted
            draft.sign, draft.carried = turn, wanted
        draft.shifts[int(moves.word[n])] = draft.carried - (0 if moves.absolute[n] else draft.begin)

    def _stand(self, draft: _Draft, n: int, high: int) -> None:
        """Note the places before and behind a move, as far as they are known."""
        moves = self._moves
        beside = not (moves.rapid[n] or moves.alone[n])
        if (beside or not draft.stands) and not np.isnan(moves.start[n]):
            motor = moves.start[n] + draft.begin * self._step
            draft.stands.append(Stand(place=moves.start[n], motor=motor, counts=beside))
        if np.isnan(moves.end[n]):
            return
        if self._approached(draft, n):
            beyond = moves.end[n] + draft.added[-1].steps[0] * self._step
            draft.stands.append(Stand(place=moves.end[n], motor=beyond, counts=False))
        motor = moves.end[n] + draft.carried * self._step
        draft.stands.append(Stand(place=moves.end[n], motor=motor, counts=self._works(n, high)))

    def _idle(self, n: int, high: int) -> bool:
        """Return true where nothing is cut behind a move up to the end of the program."""
        return not self._works(n, high) and self._end(n) == self._program.breaks[-1].block

    def _approached(self, draft: _Draft, n: int) -> bool:
        """Return true where moves of its own bring the axis to its place behind a move."""
        return bool(draft.added) and draft.added[-1].block == int(self._moves.block[n]) + 1

    def _cross(self, draft: _Draft, n: int, wanted: int) -> None:
        """Add a move of its own between two others."""
        if self.no_stops:
            raise _Left(self.no_stops)
        first = int(self._moves.block[n - 1]) + 1
        spots = range(int(self._moves.block[n]), first - 1, -1)
        sign = "+" if wanted > draft.carried else "-"
        self._add_first(draft, spots, n - 1, wanted, f"crossing {self._axis.name}{sign}")

    def _return(self, draft: _Draft, n: int) -> None:
        """Take the offset back behind the last move of a chain, before a clamp or what ends the chain."""
        last, end = int(self._moves.block[n]), self._end(n)
        closes = self._clamps[self._clamped & (self._clamps > last)]
        end = min(end, int(closes[0])) if closes.size else end
        self._add_first(draft, range(end, last, -1), n, 0, f"{self._axis.name} to 0")

    def _add_first(self, draft: _Draft, spots: range, n: int, wanted: int, label: str) -> None:
        """Add a move to another offset before the first line of some that allows it."""
        whys = []
        for block in spots[:_TRIED]:
            why = self._why_not(block, n)
            if not why:
                self._add(draft, block, n, draft.carried, (wanted,), label)
                return
            whys.append(why)
        raise _Left(whys[0])

    def _add(self, draft: _Draft, block: int, n: int, at: int, steps: tuple[int, ...], label: str) -> None:
        modal = self._program.modal_after(block - 1)
        motion = "G0" if modal.motion == "G0" else "G1"
        feeds = motion == "G1" and modal.feed_mode == _PER_MINUTE
        unit = unit_of(self._axis.name, modal.units) / MINUTE
        draft.added.append(
            AddedMoves(
                letter=self._axis.name,
                block=block,
                place=float(self._moves.end[n]),
                at=at,
                steps=steps,
                label=label,
                motion=motion,
                absolute=modal.absolute,
                inverse=modal.feed_mode == _INVERSE and motion == "G1",
                feed=self._program.feed_after(block - 1) * unit if feeds else math.inf,
            )
        )

    def _why_not(self, block: int, n: int) -> str:
        """Return why no move of its own may stand before a line; empty where one may."""
        program, modal = self._program, self._program.modal_after(block - 1)
        shut = self._clamps[self._clamps < block]
        at_feed, per_minute = modal.motion != "G0", modal.feed_mode == _PER_MINUTE
        relied = modal.motion not in ("G0", "G1") and next_relying(program, block) is not None
        whys = {
            "it is clamped": bool(shut.size and self._clamped[shut.size - 1]),
            "its place is not known": modal.absolute and not self._moves.placed[self._moves.chain[n]],
            "no line may be added": modal.motion not in _MODES or modal.compensation not in (None, "G40"),
            f"the mode {modal.motion} has to last": relied,
            "the feed is one a turn (G95)": at_feed and not per_minute and modal.feed_mode != _INVERSE,
            "the feed is not known": at_feed and per_minute and not program.feed_after(block - 1) > 0.0,
        }
        return next((f"{why} before {program.line_words(block)}" for why, holds in whys.items() if holds), "")


def leg_signs(places: Array, band: float) -> IntArray:
    """Return the direction (-1, 1) of each way between places (n,), which turns where it goes back by more than a band.

    Shape (n - 1,); 0 before it has gone any way.

    Examples
    --------
    >>> leg_signs(np.array([0.0, 0.0, 5.0, 4.9, 6.0, 2.0]), 0.2).tolist()
    [0, 1, 1, 1, -1]
    """
    signs, sign, low, high = np.zeros(max(places.size - 1, 0), dtype=np.int64), 0, 0, 0
    for k in range(1, places.size):
        signs[k - 1] = sign
        low = k if places[k] <= places[low] else low
        high = k if places[k] >= places[high] else high
        if sign != 1 and places[k] - places[low] > band:
            sign, begin, high = 1, low, k
        elif sign != -1 and places[high] - places[k] > band:
            sign, begin, low = -1, high, k
        else:
            continue
        signs[begin:k] = sign
    return signs


def _cut_lines(program: PartProgram) -> IntArray:
    """Return the lines that cut, or may, in order."""
    kept = (codes.STAYING_G, codes.STAYING_M)
    passed = [
        np.arange(one.first, one.last + 1) for one in program.notes if one.why < codes.QUIET and one.why not in kept
    ]
    alone = [moves.block[~moves.rapid] for moves in further_moves(program).values()]
    cuts = program.motions.block[program.motions.kind != RAPID]
    return np.unique(np.concatenate([cuts, *passed, *alone])).astype(np.int64)
