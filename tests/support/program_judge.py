"""Judge a compensated part program by equations of the tests' own: what the table does before and after.

When the motors are where, a model of the controller's planner says, which is held to real planners elsewhere. What the
table makes of it, and how far that is from the path, is worked out here: words by :mod:`support.reference_player`,
motors that lag and tables with play by :mod:`support.two_masses`, on every combination of initial sides, and distances
from the lines that a row stands for. A stretch of cuts between two rapids is held against the same stretch of the
original.
"""

from __future__ import annotations

import math
import re
from itertools import product
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .reference_player import Move, interpret, run
from .two_masses import Body, behind, body_of, motor_of, settling

Floats = NDArray[np.float64]

SHIFTED = 0.25
"""Motors no farther [mm] from where a path ends than this may be shifted there by the backlash of all axes."""

DENSE = 0.01
"""Distance of the samples of a path [mm]."""

SAME = 1e-9
"""Places [mm] that differ by no more than rounding."""

BEGINS = 0.02
"""A cut has begun this far behind a rapid [mm]."""

BESIDE = (-3, -2, -1, 0, 1, 2)
"""Straight lines that are looked at beside the nearest sample: where moves meet, some are very short."""

SEEN, AGAIN = 1e-4, 10
"""Distance [mm] that a path that is passed once explains, and how many samples else are looked at."""

WAYS = 3.0
"""A move of one axis behind a rapid by at most so many of its gaps only winds it up."""


ROUNDED = 10.0
"""A controller that makes one line of several may round a corner so far [mm] before and behind it."""

NEAR, LONG = 0.2, 5.0
"""A table is no farther from where it would be without backlash than so much [mm], and so many of the largest gap."""

NARROWED = 40
"""A place between two rows is found to a ten-millionth of them."""

LATE = 5.0
"""So many time constants is a table behind."""


class Sizes(NamedTuple):
    """Largest error, its root mean square and 95th percentile [m], each the worst of all sides."""

    max: float
    rms: float
    most: float


class Measured(NamedTuple):
    """Errors by all causes and by backlash alone; `pair` is (max, rms) [m] of the sides where the largest is worst."""

    all: Sizes
    all_pair: tuple[float, float]
    gap_pair: tuple[float, float]


class Stretches:
    """The moves of a program in runs of rapids and of cuts, in turn; each a list of dense points [mm].

    What only winds up an axis behind a rapid, on a machine of such gaps (3,) [mm], is in the air, and no cut. While a
    cut begins a table that lags is still on the rapid before: its last `tail` [mm] belongs to the path of the cut.
    """

    def __init__(self, text: str, gaps: Floats, tail: float = 0.0) -> None:
        self.text = text
        self.moves = [move for move in interpret(text) if move.length > 0.0]
        air = winds_up(self.moves, gaps)
        rapid = np.array([move.mode == 0 or move.line in air for move in self.moves])
        self.run_of = np.cumsum(np.diff(rapid, prepend=True) != 0)
        self.line_run = {move.line: int(k) for move, k in zip(self.moves, self.run_of, strict=True)}
        self.points, self.trees, self.spans = {}, {}, {}
        self.rapid_runs = set(self.run_of[rapid].tolist())
        self.begins = {}
        for k in np.unique(self.run_of).tolist():
            own = [move for move, number in zip(self.moves, self.run_of, strict=True) if number == k]
            sampled = run(own, DENSE)
            points = sampled.motor
            before = self.points[k - 1][-int(tail / DENSE) :] if k - 1 in self.rapid_runs and tail else points[:1]
            points = np.concatenate([before, points])
            apart = np.append(True, (np.abs(np.diff(points, axis=0)) > SAME).any(axis=1))
            self.points[k] = points[apart]
            self.begins[k] = int(apart[: len(before)].sum()) - 1
            self.trees[k] = cKDTree(self.points[k])
            # First and last sample of each move.
            at = np.cumsum(apart)[len(before) :] - 1
            ends = np.searchsorted(sampled.owner, np.arange(len(own)), side="right") - 1
            self.spans[k] = (np.array([move.line for move in own]), np.append(self.begins[k], at[ends[:-1]]), at[ends])

    def nearest(self, places: Floats, run_of: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Nearest points (n, 3) [mm] of each place's run, and how far along it they are, in samples."""
        found, along = np.empty_like(places), np.empty(len(places))
        for k in np.unique(run_of).tolist():
            own = run_of == k
            found[own], along[own] = self._nearest(self.points[k], self.trees[k], places[own])
        return found, along

    def samples(self, number: int, first: int, last: int) -> tuple[int, int]:
        """Samples of a run from where its lines `first` to before `last` begin to where the next move ends.

        On that a controller is that rounds a corner.
        """
        lines, begins, ends = self.spans[number]
        low, high = np.searchsorted(lines, [first, last])
        return int(np.append(begins, ends[-1])[low]), int(ends[min(high, ends.size - 1)])

    def distances(self, places: Floats, run_of: NDArray[np.int64], window: NDArray[np.int64]) -> Floats:
        """Distances (n,) [mm] of places from their runs, between the samples (n, 2) of a window."""
        found = np.empty(len(places))
        for k in np.unique(run_of).tolist():
            own = run_of == k
            found[own] = _within(places[own], self.points[k], window[own])
        return found

    def nearest_on(self, places: Floats, moves: list[Move]) -> Floats:
        """Nearest points (n, 3) [mm] of some moves."""
        points = run(moves, DENSE).motor
        return self._nearest(points, cKDTree(points), places)[0]

    @staticmethod
    def _nearest(points: Floats, tree: cKDTree, places: Floats) -> tuple[Floats, Floats]:
        near = tree.query(places)[1]
        best, at = points[near].copy(), near.astype(float)
        least = np.linalg.norm(places - best, axis=1)

        def improve(rows: NDArray[np.int64], low: NDArray[np.int64]) -> None:
            begin, way = points[low], points[low + 1] - points[low]
            square = np.maximum((way * way).sum(axis=1), 1e-30)
            share = np.clip(((places[rows] - begin) * way).sum(axis=1) / square, 0.0, 1.0)
            foot = begin + share[:, None] * way
            off = np.linalg.norm(places[rows] - foot, axis=1)
            less = off < least[rows]
            best[rows[less]], at[rows[less]] = foot[less], (low + share)[less]
            least[rows[less]] = off[less]

        for step in BESIDE:
            improve(np.arange(len(places)), np.clip(near + step, 0, len(points) - 2))
        # Where a path comes to a place several times, the nearest sample may be that of another time.
        rows = np.flatnonzero((least > SEEN) & (least < DENSE))
        if rows.size:
            for column in np.atleast_2d(tree.query(places[rows], AGAIN)[1].T):
                for step in (-1, 0):
                    improve(rows, np.clip(np.minimum(column, len(points) - 1) + step, 0, len(points) - 2))
        return best, at


class Played(NamedTuple):
    """A program's motors (n, 3) [mm], the original's run of each row, which rows count, and the line of each.

    `window` (n, 2) are the samples of the run between which the table is, which goes along the path in its order.
    `free` (n, 3) are the motors without the offsets that the program gave them, `exact` the path next to them.
    """

    motor: Floats
    run_of: NDArray[np.int64]
    counted: NDArray[np.bool_]
    line: NDArray[np.int64]
    window: NDArray[np.int64]
    free: Floats
    exact: Floats


class Origin(NamedTuple):
    """What a line of a program stands for: lines of the original from `first` to before `last`, and if it is new."""

    first: int
    last: int
    new: bool


def origins(text: str) -> list[Origin]:
    """Read from its marks what each line of a program stands for, from line 1; line 0 is what is before."""
    found, at, added, old, own = [Origin(0, 0, False)], 1, 0, 0, False
    for line in text.splitlines():
        change = re.match(r"(?:\(|; )ph-post: \+(\d+) -(\d+)", line)
        own = re.match(r"(?:\(|; )ph-post", line) is not None or (own and re.match(r"(?:\(|; )  ", line) is not None)
        if added:
            found.append(Origin(at - old, at, True))
            added -= 1
        elif change:
            added, old = int(change[1]), int(change[2])
            at += old
            found.append(Origin(at - old, at, True))
        elif own:
            found.append(Origin(at, at, True))
        else:
            found.append(Origin(at, at + 1, False))
            at += 1
    return found


def without_offsets(
    text: str, original: Stretches, motor: Floats, lines: NDArray[np.int64], own: Stretches, plain: Played
) -> tuple[Floats, Floats]:
    """Motors without offsets, and the path next to them on the lines that they run.

    Where these are new the motors are those of the original on the lines that were there, as far along as those of the
    program are along the new ones. Moves end as far from where the moves end for which they stand as their offsets are;
    between two ends these grow with the way.
    """
    stands = origins(text)
    free, exact = motor.copy(), motor.copy()
    keys = [(*stands[move.line][:2], int(k)) for move, k in zip(own.moves, own.run_of, strict=True)]
    theirs = list(zip(original.moves, original.run_of.tolist(), strict=True))
    before, begin = np.zeros(3), 0
    while begin < len(keys):
        end = begin + 1
        while end < len(keys) and keys[end] == keys[begin]:
            end += 1
        first, last, number = keys[begin]
        done = [move for move, k in theirs if move.line < last and k <= number]
        after = own.moves[end - 1].end - (done[-1].end if done else original.moves[0].start)
        until = own.moves[end].line if end < len(keys) else len(stands)
        rows = np.flatnonzero((lines >= own.moves[begin].line) & (lines < until))
        if rows.size:
            low = max(rows[0] - 1, 0)
            way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(motor[low : rows[-1] + 1], axis=0), axis=1)))
            among = [move for move, k in theirs if first <= move.line < last and k == number]
            way = np.minimum(way, arrived(motor[low : rows[-1] + 1] - after, way, among[-1].end) if among else way[-1])
            share = (way / way[-1] if way[-1] else np.ones_like(way))[rows - low, None]
            free[rows] -= (1.0 - share) * before + share * after
            if not stands[own.moves[begin].line].new:
                exact[rows] = original.nearest_on(free[rows], among) if among else done[-1].end
            else:
                # What is added between two moves is where the first of them ends.
                passed = share[:, 0] if among else np.ones(rows.size)
                exact[rows] = along(run(among or done[-1:], DENSE).motor, passed)
                free[rows] = run_along(plain, among or done[-1:], passed)
        before, begin = after, end
    return free, exact


def arrived(places: Floats, way: Floats, end: Floats) -> float:
    """Way after which motors, less what they end with, only shift about an end: from the first rest near it on."""
    near = np.linalg.norm(places - end, axis=1) < SHIFTED
    near = np.logical_and.accumulate(near[::-1])[::-1]
    rests = np.flatnonzero(near[1:] & (np.diff(way) == 0.0))
    return float(way[rests[0]] if rests.size else way[-1])


def along(points: Floats, share: Floats) -> Floats:
    """Places (n, 3) [mm] at shares (n,) of the way through some points."""
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    return np.stack([np.interp(share * way[-1], way, column) for column in points.T], axis=1)


def run_along(played: Played, moves: list[Move], share: Floats) -> Floats:
    """Motors (n, 3) [mm] that run some moves, at shares (n,) of the way of these."""
    ends = np.cumsum([move.length for move in moves])
    number = np.minimum(np.searchsorted(ends, share * ends[-1]), len(moves) - 1)
    found = np.empty((len(share), 3))
    for k in np.unique(number).tolist():
        own, rows = number == k, np.flatnonzero(played.line == moves[k].line)
        part = 1.0 - (ends[k] - share[own] * ends[-1]) / moves[k].length
        found[own] = along(played.motor[max(rows[0] - 1, 0) : rows[-1] + 1], part) if rows.size else moves[k].end
    return found


def winds_up(moves: list[Move], gaps: Floats) -> set[int]:
    """Lines that bring one axis alone onto its side behind a rapid, at most twice an axis."""
    found: set[int] = set()
    open_, moved = False, [0, 0, 0]
    for move in moves:
        if move.mode == 0:
            open_, moved = True, [0, 0, 0]
            continue
        way = np.abs(move.end - move.start)
        axis = int(way.argmax())
        alone = move.mode == 1 and np.count_nonzero(way > 1e-9) == 1
        open_ = open_ and alone and way[axis] <= WAYS * gaps[axis] and moved[axis] < 2
        if open_:
            found.add(move.line)
            moved[axis] += 1
    return found


def played(
    text: str,
    original: Stretches,
    command,
    lines: NDArray[np.int64],
    gaps: Floats,
    settled: float,
    late: float,
    plain: Played | None = None,
) -> Played:
    """Rows of a program: `command` in SI units, `lines` (n,) the line of each of them, from 1.

    Tables are at most `late` [s] behind. `plain` is the original.
    """
    motor = np.zeros((len(command.t), 3))
    motor[:, ["XYZ".index(name) for name in command.axes]] = 1e3 * command.position
    own = Stretches(text, gaps)
    assert len(own.points) == len(original.points), "rapids are not those of the original"
    numbers = np.array([own.line_run.get(int(line), -1) for line in lines])
    known = np.flatnonzero(numbers >= 0)
    numbers = numbers[known[np.maximum(np.searchsorted(known, np.arange(numbers.size), side="right") - 1, 0)]]
    cuts = ~np.isin(numbers, list(own.rapid_runs))
    _, along = original.nearest(motor, numbers)
    begins = np.array([original.begins.get(k, 0) for k in range(int(numbers.max()) + 1)])
    cuts &= (along - begins[numbers]) * DENSE > BEGINS
    free, exact = motor, original.nearest(motor, numbers)[0]
    if plain is not None:
        free, exact = without_offsets(text, original, motor, np.maximum.accumulate(lines), own, plain)
    window = windows(text, original, lines, numbers, math.ceil(late / command.period), NEAR + LONG * gaps.max())
    return Played(motor, numbers, cuts & (command.t >= settled), lines, window, free, exact)


def windows(
    text: str, original: Stretches, lines: NDArray[np.int64], numbers: NDArray[np.int64], rows: int, beyond: float
) -> NDArray[np.int64]:
    """Samples (n, 2) between which the table is that is so many rows behind, and so far [mm] before and behind that."""
    stands = origins(text)
    found = np.empty((len(lines), 2), dtype=np.int64)
    for k in np.unique(numbers).tolist():
        own = np.flatnonzero(numbers == k)
        known, which = np.unique(lines[own], return_inverse=True)
        low, high = np.array([original.samples(k, *stands[line][:2]) for line in known.tolist()]).T[:, which]
        low = np.append(np.zeros(rows, dtype=np.int64), np.minimum.accumulate(low[::-1])[::-1])[: own.size]
        slack = math.ceil((beyond + ROUNDED) / DENSE)
        found[own] = np.stack([low - slack, np.maximum.accumulate(high) + slack], axis=1)
    return found


def _bodies(machine) -> list[Body]:
    """X, Y and Z; an axis that gravity holds has no play."""
    axes = [machine.axes[name] for name in "XYZ"]
    return [body_of(axis, factor=1.0 if axis.gravity_side is None else 0.0) for axis in axes]


def _motors(program: Floats, machine) -> Floats:
    """Motors (n, 3) [mm] that are commanded to be at places (n, 3) [mm]."""
    one = zip(_bodies(machine), 1e-3 * program.T, strict=True)
    return 1e3 * np.stack([motor_of(body, own, machine.servo_period) for body, own in one], axis=1)


def sides_of(machine) -> list[tuple[int, ...]]:
    """Every combination of the sides on which the axes may begin."""
    known = [{"+": (1,), "-": (-1,)}.get(machine.axes[name].gap.initial_flank, (1, -1)) for name in "XYZ"]
    return list(product(*known))


def measure(program: Played, path: Stretches, machine) -> Measured:
    """Errors of a program.

    By backlash alone is how far the table is from the way that it takes without any, with motors that go without
    offsets; what is between that and the way of the exact path is the controller's rounding.
    """
    rows = np.flatnonzero(program.counted)
    runs = program.run_of[rows]
    motors = _motors(program.motor, machine)
    band = [motors if way is program.motor else _motors(way, machine) for way in (program.free, program.exact)]
    steps = [np.linalg.norm(np.diff(one, axis=0), axis=1) for one in band]
    way, step, near = np.append(0.0, np.cumsum(steps[0])), np.maximum(*steps), NEAR + LONG * gaps_of(machine).max()
    first: tuple[Floats, Floats, Floats] | None = None
    found = []
    every = sides_of(machine)
    tables = {
        (k, side): 1e3 * behind(body, 1e-3 * motors[:, k], side)[rows]
        for k, body in enumerate(_bodies(machine))
        for side in {sides[k] for sides in every}
    }
    for sides in every:
        table = np.stack([tables[one] for one in enumerate(sides)], axis=1)
        if first is None:
            which = np.ones(len(table), dtype=bool)
            error, gap = np.empty(len(table)), np.empty(len(table))
        else:
            which = (table != first[0]).any(axis=1)
            error, gap = first[1].copy(), first[2].copy()
        error[which] = 1e-3 * path.distances(table[which], runs[which], program.window[rows][which])
        gap[which] = 1e-3 * _from_band(table[which], rows[which], *band, way, step, near)
        first = first or (table, error, gap)
        found.append((error, gap))
    worst = Sizes(*(max(values) for values in zip(*(_sizes(error) for error, _ in found), strict=True)))
    pairs = [max(map(_sizes, errors))[:2] for errors in zip(*found, strict=True)]
    return Measured(worst, *pairs)


def _sizes(error: Floats) -> tuple[float, float, float]:
    if not error.size:
        return 0.0, 0.0, 0.0
    return float(error.max()), float(np.sqrt(np.mean(error**2))), float(np.quantile(error, 0.95))


@numba.njit(cache=True)
def _within(places, points, window):  # type: ignore[no-untyped-def]
    """Distances (n,) of places from the lines between points, from one of a window (n, 2) to another.

    Points are no farther from each other than `DENSE`.
    """
    found = np.empty(len(places))
    for n in range(len(places)):
        k, high = max(window[n, 0], 0), min(window[n, 1], len(points) - 1)
        least = _from_line(places[n], points[high], points[high])
        while k < high:
            away = _from_line(places[n], points[k], points[k + 1])
            least = min(least, away)
            k += max(1, int((away - least) / DENSE))
        found[n] = least
    return found


@numba.njit(cache=True)
def _from_band(points, rows, one, other, way, step, near):  # type: ignore[no-untyped-def]
    """Distances (n,) of points from all straight lines between two ways, no farther along the first than `near`.

    From row to row neither goes farther than `step` (m - 1,).
    """
    found = np.empty(len(points))
    for n in range(len(points)):
        low = np.searchsorted(way, way[rows[n]] - near)
        high = np.searchsorted(way, way[rows[n]] + near, side="right")
        away = np.empty(high - low)
        for k in range(low, high):
            away[k - low] = _from_line(points[n], one[k], other[k])
        least = away.min()
        for k in range(low, high - 1):
            if min(away[k - low], away[k - low + 1]) - step[k] < least:
                least = min(least, _between(points[n], one[k : k + 2], other[k : k + 2]))
        found[n] = least
    return found


@numba.njit(cache=True)
def _between(point, one, other):  # type: ignore[no-untyped-def]
    """Least distance of a point from the lines between two rows of two ways, by halving where it falls."""
    low, high = 0.0, 1.0
    best = np.inf
    ends = np.empty((2, 3))
    for _ in range(NARROWED):
        third = (high - low) / 3.0
        a = _from_place(point, one, other, low + third, ends)
        b = _from_place(point, one, other, high - third, ends)
        best = min(best, a, b)
        if a < b:
            high -= third
        else:
            low += third
    return best


@numba.njit(cache=True)
def _from_place(point, one, other, share, ends):  # type: ignore[no-untyped-def]
    for k in range(3):
        ends[0, k] = one[0, k] + share * (one[1, k] - one[0, k])
        ends[1, k] = other[0, k] + share * (other[1, k] - other[0, k])
    return _from_line(point, ends[0], ends[1])


@numba.njit(cache=True)
def _from_line(point, a, b):  # type: ignore[no-untyped-def]
    square = along = 0.0
    for k in range(3):
        square += (b[k] - a[k]) ** 2
        along += (point[k] - a[k]) * (b[k] - a[k])
    share = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
    off = 0.0
    for k in range(3):
        off += (point[k] - a[k] - share * (b[k] - a[k])) ** 2
    return np.sqrt(off)


def gaps_of(machine) -> Floats:
    """Lost motion of X, Y and Z [mm]."""
    return np.array([1e3 * machine.axes[name].gap.lost_motion for name in "XYZ"])


def lag_of(machine) -> float:
    """Time [s] that a table may be behind."""
    return LATE * max(axis.servo.c for axis in machine.axes.values())


def tail_of(machine) -> float:
    """Way [mm] that a table may be behind in a rapid."""
    return 1e3 * LATE * max(axis.servo.c * axis.limits.velocity for axis in machine.axes.values())


def settled_time(machine) -> float:
    """Time at the beginning that does not count [s]."""
    return settling([body_of(machine.axes[name]) for name in "XYZ"])
