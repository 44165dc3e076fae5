"""Planners that follow the path exactly as a model: look-ahead, and the motion.

Blocks are straight. At a corner the speed along the path is the same before and behind it, and bounded by the rule
of the firmware. In between a block speeds up, keeps its speed and slows down at one acceleration. A queue begins and
ends at rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from ph_post.bounds import in_parts
from ph_post.compiling import compiled, lean
from ph_post.gcode.program import PartProgram
from ph_post.simulate.controllers.chords import StraightBlocks
from ph_post.simulate.controllers.corner_rules import corner_rule, corner_speeds
from ph_post.simulate.controllers.durations import check_duration
from ph_post.types import Array, BoolArray, ExactPath, IntArray, KlipperCorner

_PART: Final = 1 << 12
"""Blocks whose times are worked out at a time."""

ROUNDING: Final = 1e-9
"""Part of a period by which a motion may be longer than whole periods."""


@lean
def _gain(push: Array, length: Array, k: int) -> float:
    """Return by how much the squared speed grows in a block [m²/s²]."""
    return 2.0 * push[k] * length[k]  # type: ignore[no-any-return]


@compiled
def look_ahead(begin: Array, length: Array, push: Array, joined: BoolArray, depth: int) -> None:
    """Lower the squared speeds at the beginnings of blocks to what they can have; Grbl's and Marlin's way.

    Parameters
    ----------
    begin : Array, shape (n,)
        At first those of :func:`corner_speeds` [m²/s²].
    length, push, joined
        As there.
    depth : int
        Blocks that are looked ahead, 0 for all: the last of them is taken to end at rest.
    """
    count = length.size
    for k in range(count - 1, -1, -1):
        after = begin[k + 1] if k + 1 < count and joined[k + 1] else 0.0
        begin[k] = min(begin[k], after + _gain(push, length, k))
    if depth > 0:
        ahead, last = 0.0, 0
        for k in range(count):
            if not joined[k]:
                last, ahead = k, 0.0
            while last < min(k + depth, count) and (last == k or joined[last]):
                ahead += _gain(push, length, last)
                last += 1
            begin[k] = min(begin[k], ahead)
            ahead -= _gain(push, length, k)
    for k in range(count):
        if k + 1 < count and joined[k + 1]:
            begin[k + 1] = min(begin[k + 1], begin[k] + _gain(push, length, k))
        begin[k] = max(begin[k], 0.0)


@compiled
def block_squares(begin: Array, after: Array, length: Array, speed: Array, push: Array) -> Array:
    """Return the squared speeds at the beginning, in the middle and at the end of blocks (n, 3) [m²/s²].

    They are worked out from those at the beginning and at the end.
    """
    found = np.empty((length.size, 3))
    for k in range(length.size):
        found[k, 0], found[k, 2] = begin[k], after[k]
        found[k, 1] = min(speed[k] ** 2, 0.5 * (begin[k] + after[k] + _gain(push, length, k)))
    return found


@compiled
def look_ahead_smoothly(
    limit: Array, length: Array, speed: Array, push: Array, joined: BoolArray, smooth: float
) -> Array:
    """Return the squared speeds at the beginning, in the middle and at the end of blocks; Klipper's way.

    A second look-ahead with the acceleration `smooth` [m/s²] says how fast blocks may become that have to slow
    down again. `limit` and `speed` are those of :func:`corner_speeds`; the result is that of :func:`block_squares`.
    """
    count = length.size
    gain = 2.0 * push * length
    even = np.minimum(2.0 * smooth * length, gain)
    begin, even_begin, found = limit.copy(), np.zeros(count), np.empty((count, 3))
    for k in range(1, count):
        if joined[k]:
            begin[k] = min(begin[k], begin[k - 1] + gain[k - 1])
            even_begin[k] = min(begin[k], even_begin[k - 1] + even[k - 1])
    after = even_after = peak = 0.0
    waiting = count
    for k in range(count - 1, -1, -1):
        if k + 1 == count or not joined[k + 1]:
            after = even_after = peak = 0.0
            waiting = k + 1
        reach, even_reach = after + gain[k], even_after + even[k]
        begin[k] = min(begin[k], reach)
        found[k, 0], found[k, 2] = begin[k], after
        even_now = min(even_begin[k], even_reach)
        if even_now < even_reach:  # it can gain speed
            if even_now + even[k] > even_after or waiting > k + 1:
                peak = min(speed[k] ** 2, 0.5 * (even_now + even_reach))
                _cruise(found, k + 1, waiting, peak)
            found[k, 1] = min(0.5 * (begin[k] + reach), speed[k] ** 2, peak)
            found[k, 0], found[k, 2] = min(found[k, 0], found[k, 1]), min(found[k, 2], found[k, 1])
            waiting = k
        after, even_after = begin[k], even_now
    return found


@lean
def _cruise(found: Array, first: int, last: int, peak: float) -> None:
    """Fill the blocks that can only slow down: none is faster than the one before it."""
    for k in range(first, last):
        peak = min(peak, found[k, 0])
        found[k, 0] = found[k, 1] = peak
        found[k, 2] = min(found[k, 2], peak)


@compiled
def block_times(square: Array, length: Array, push: Array) -> Array:
    """Return the times [s] for which blocks speed up, keep their speed and slow down, shape (n, 3)."""
    times = np.empty(square.shape)
    for k in range(length.size):
        first, middle, last = math.sqrt(square[k, 0]), math.sqrt(square[k, 1]), math.sqrt(square[k, 2])
        times[k, 0], times[k, 2] = (middle - first) / push[k], (middle - last) / push[k]
        way = length[k] - 0.5 * (2.0 * square[k, 1] - square[k, 0] - square[k, 2]) / push[k]
        times[k, 1] = max(way, 0.0) / middle
    return times


@compiled
def sample(
    square: Array, times: Array, push: Array, length: Array, begins: Array, period: float, way: Array, block: IntArray
) -> None:
    """Fill the block and the way along it [m] of every period.

    Parameters
    ----------
    square, times : Array, shape (n, 3)
        Of :func:`block_squares` and :func:`block_times`.
    push, length : Array, shape (n,)
        [m/s²] and [m]
    begins : Array, shape (n,)
        When each block begins [s]; before it the axes rest where the one before it ended.
    period : float
        [s]
    way, block : Array and IntArray, shape (rows,)
    """
    row, last = 0, length.size - 1
    for k in range(last + 1):
        first, middle = math.sqrt(square[k, 0]), math.sqrt(square[k, 1])
        up, steady = times[k, 0], times[k, 0] + times[k, 1]
        done = steady + times[k, 2]
        gained = 0.5 * (first + middle) * up
        while row < way.size:
            time = row * period - begins[k]
            if time > done and k < last and row * period >= begins[k + 1]:
                break
            block[row] = k
            if time <= 0.0:
                way[row] = 0.0
            elif time < up:
                way[row] = (first + 0.5 * push[k] * time) * time
            elif time < steady:
                way[row] = gained + middle * (time - up)
            elif time < done:
                left = done - time
                way[row] = length[k] - (math.sqrt(square[k, 2]) + 0.5 * push[k] * left) * left
            else:
                way[row] = length[k]
            way[row] = min(max(way[row], 0.0), length[k])
            row += 1


class Trapezoids(NamedTuple):
    """Speeds and times of n blocks.

    `square` (n, 3): squared speeds at the beginning, in the middle and at the end [m²/s²]; `times` (n, 3): of
    speeding up, keeping the speed and slowing down [s]; `begins` (n,): when each begins [s]; `total` [s].
    """

    square: Array
    times: Array
    begins: Array
    total: float


def plan_trapezoids(blocks: StraightBlocks, planner: ExactPath, limits: Array) -> Trapezoids:
    """Plan the speeds of blocks.

    Parameters
    ----------
    blocks : StraightBlocks
    planner : ExactPath
    limits : Array, shape (3, 2)
        Velocity [m/s] and acceleration [m/s²] of the axes.

    Returns
    -------
    Trapezoids
    """
    square = _squares(blocks, corner_limits(blocks, planner, limits), planner, limits)(slice(None))
    times = block_times(square, blocks.length, blocks.push)
    taken = times.sum(axis=1)
    begins = np.cumsum(blocks.pause + taken) - taken
    return Trapezoids(square, times, begins, float(begins[-1] + taken[-1]) if taken.size else 0.0)


def smooth_acceleration(corner: KlipperCorner, shared: float) -> float:
    """Return the acceleration [m/s²] that Klipper counts on for lines that it soon slows down behind.

    Half of the `shared` one of the axes [m/s²] where the machine file names none.
    """
    return 0.5 * shared if corner.accel_to_decel is None else min(corner.accel_to_decel, shared)


def corner_limits(blocks: StraightBlocks, planner: ExactPath, limits: Array) -> Array:
    """Return what corners allow where blocks begin, as :func:`corner_speeds`: all that their directions are for."""
    rule, numbers = corner_rule(planner, float(limits[:2, 1].min()))
    most = np.ascontiguousarray(limits[:, 1])
    found: Array = corner_speeds(
        rule, numbers, blocks.unit, blocks.length, blocks.speed, blocks.push, most, blocks.joined
    )
    return found


def _squares(blocks: StraightBlocks, limit: Array, planner: ExactPath, limits: Array) -> Callable[[slice], Array]:
    """Plan blocks with the limits of corners, which are overwritten.

    Returns what gives the squared speeds of :class:`Trapezoids` of some blocks, (n, 3) [m²/s²].
    """
    if isinstance(planner.corner, KlipperCorner):
        smooth = smooth_acceleration(planner.corner, float(limits[:2, 1].min()))
        found: Array = look_ahead_smoothly(limit, blocks.length, blocks.speed, blocks.push, blocks.joined, smooth)
        return found.__getitem__
    look_ahead(limit, blocks.length, blocks.push, blocks.joined, planner.blocks or 0)

    def of(rows: slice) -> Array:
        behind = slice(rows.start + 1 if rows.start else 1, rows.stop + 1 if rows.stop else None)
        after = np.where(blocks.joined[behind], limit[behind], 0.0)
        begin = limit[rows]
        after = np.append(after, np.zeros(begin.size - after.size))
        return np.asarray(block_squares(begin, after, blocks.length[rows], blocks.speed[rows], blocks.push[rows]))

    return of


def count_periods(
    blocks: StraightBlocks, planner: ExactPath, limits: Array, period: float, program: PartProgram
) -> int:
    """Count the periods that blocks of which no row is wanted take, as :func:`plan_exact`, however many.

    Their `corner` is overwritten.

    Raises
    ------
    TooLargeError
        Where there is no end to them, as of a feed that is nearly none.
    """
    took, begin = blocks.corner, 0.0
    took[~blocks.joined] = 0.0
    squares = _squares(blocks, took, planner, limits)
    for part in in_parts(took.size, _PART):
        times = block_times(squares(part), blocks.length[part], blocks.push[part]).sum(axis=1)
        # Summed in their order, as all of them together are.
        ends = np.cumsum(np.append(begin, blocks.pause[part] + times))
        # The limits of these blocks are not needed any more.
        took[part], begin = blocks.pause[part] + times, float(ends[-1])
    if not math.isfinite(begin):
        check_duration(program, blocks.motion, took, period)
    total = begin - float(times[-1]) + float(times[-1])
    return math.ceil(total / period - ROUNDING)


def _meet_turns(
    blocks: StraightBlocks, begins: Array, period: float, way: Array, block: IntArray, position: Array
) -> None:
    """Move the rows next to where an axis turns back between two blocks onto these places.

    Motors come there, and carry their tables along; between two rows it would not show.
    """
    turns = 1 + np.flatnonzero((blocks.unit[1:] * blocks.unit[:-1] < 0.0).any(axis=1) & blocks.joined[1:])
    row = np.rint(begins[turns] / period).astype(np.int64)
    inside = (row > 0) & (row < way.size - 1)
    way[row[inside]], block[row[inside]], position[row[inside]] = 0.0, turns[inside], blocks.start[turns[inside]]


class ExactRun(NamedTuple):
    """Blocks, what is planned for them, and the number of periods from the first row to the last."""

    blocks: StraightBlocks
    plan: Trapezoids
    periods: int


def plan_exact(
    blocks: StraightBlocks, planner: ExactPath, limits: Array, period: float, program: PartProgram
) -> ExactRun:
    """Plan blocks, with the speeds of :func:`plan_trapezoids`, and count the periods that they take.

    Raises
    ------
    TooLargeError
        Where there are too many.
    """
    plan = plan_trapezoids(blocks, planner, limits)
    if blocks.length.size == 0:
        return ExactRun(blocks, plan, 0)
    check_duration(program, blocks.motion, blocks.pause + plan.times.sum(axis=1), period)
    return ExactRun(blocks, plan, math.ceil(plan.total / period - ROUNDING))


class Passage(NamedTuple):
    """When and how fast a program passes places, as its controller plans it in n blocks; dwells take no time.

    `place` (n,) is where they begin along the program [m], `begins` when [s]; `length` [m], `push` [m/s²] and `square`
    (n, 3) [m²/s²] as of :class:`Trapezoids`.
    """

    place: Array
    begins: Array
    length: Array
    push: Array
    square: Array

    def at(self, places: Array) -> tuple[Array, Array]:
        """Return when [s] and how fast [m/s] places along the program are passed, the shape of those."""
        if not self.place.size:
            return np.zeros(places.shape), np.zeros(places.shape)
        block = np.maximum(np.searchsorted(self.place, places, side="right") - 1, 0)
        length, push, square = self.length[block], self.push[block], np.moveaxis(self.square[block], -1, 0)
        way = np.clip(places - self.place[block], 0.0, length)
        before, most, after = square
        first, fastest, _ = np.sqrt(square)
        up, down = before + 2.0 * push * way, after + 2.0 * push * (length - way)
        speed = np.sqrt(np.minimum(np.minimum(up, down), most))
        reached = (fastest - first) / push
        ramps = 0.5 * (2.0 * most - before - after) / push
        lowers = reached + np.maximum(length - ramps, 0.0) / fastest
        steady = reached + (way - 0.5 * (most - before) / push) / fastest
        lowered = lowers + (fastest - speed) / push
        time = np.where(up <= np.minimum(most, down), (speed - first) / push, np.where(down <= most, lowered, steady))
        return self.begins[block] + time, speed


def plan_passage(blocks: StraightBlocks, planner: ExactPath, limits: Array, along: Array) -> Passage:
    """Plan blocks of which no row is wanted, however long they take; their `corner` is overwritten.

    `along` (m + 1,) is where motions begin, as :func:`~ph_post.gcode.motion_parts.places_along` has them [m].
    """
    limit = blocks.corner
    limit[~blocks.joined] = 0.0
    square = _squares(blocks, limit, planner, limits)(slice(None))
    taken = block_times(square, blocks.length, blocks.push).sum(axis=1)
    way = np.cumsum(blocks.length) - blocks.length
    head = np.flatnonzero(np.diff(blocks.motion, prepend=np.int32(-1)))
    place = along[blocks.motion] + way - np.repeat(way[head], np.diff(head, append=way.size))
    return Passage(place, np.cumsum(taken) - taken, blocks.length, blocks.push, square)


def exact_rows(run: ExactRun, period: float, *, meet_turns: bool = False) -> tuple[Array, IntArray, Array, Array]:
    """Return position (m, 3) [m], motion and share of it in every period, and the ways (m - 1,) [m] between them.

    The first row is the beginning, and the last the end, at rest. To `meet_turns` the rows next to where an axis turns
    back are moved there, by half a period at most; the ways stay.
    """
    blocks, plan = run.blocks, run.plan
    if blocks.length.size == 0:
        return np.zeros((1, 3)), np.array([-1]), np.zeros(1), np.zeros(0)
    count = run.periods + 1
    way, block = np.empty(count), np.empty(count, dtype=np.int64)
    sample(plan.square, plan.times, blocks.push, blocks.length, plan.begins, period, way, block)
    position = _positions(blocks.start, blocks.end, blocks.length, way, block)
    steps = steps_of(position)
    if meet_turns:
        _meet_turns(blocks, plan.begins, period, way, block, position)
    share = blocks.share0[block] + way / blocks.length[block] * (blocks.share1[block] - blocks.share0[block])
    motion = blocks.motion[block].astype(np.int64)
    motion[0], share[0], share[-1] = -1, 0.0, blocks.share1[-1]
    return position, motion, share, steps


@compiled
def _positions(start: Array, end: Array, length: Array, way: Array, block: IntArray) -> Array:
    """Positions (m, 3) [m] of rows that have come some way along blocks; the last is the end of all."""
    position = np.empty((way.size, 3))
    for row in range(way.size):
        k = block[row]
        part = way[row] / length[k]
        for axis in range(3):
            whole = end[k, axis] - start[k, axis]
            position[row, axis] = end[k, axis] if part == 1.0 else start[k, axis] + part * whole
    position[-1] = end[-1]
    return position


def steps_of(position: Array) -> Array:
    """Ways (m - 1,) [m] from row to row of positions (m, 3) [m]."""
    return np.asarray(np.sqrt((np.diff(position, axis=0) ** 2).sum(axis=1)))
