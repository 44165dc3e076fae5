"""Judge a compensated part program by equations of the tests' own: what the table does before and after.

When the motors are where, a model of the controller's planner says, which is held to real planners elsewhere. What the
table makes of it, and how far that is from the path, is worked out here: words by :mod:`support.reference_player`,
motors that lag and tables with play by :mod:`support.two_masses`, on every combination of initial sides, and distances
by a search tree. A stretch of cuts between two rapids is held against the same stretch of the original.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .reference_player import Move, interpret, run
from .two_masses import body_of, settling, table_of

Floats = NDArray[np.float64]

DENSE = 0.01
"""Distance of the samples of a path [mm]."""

BEGINS = 0.02
"""A cut has begun this far behind a rapid [mm]."""

BESIDE = (-3, -2, -1, 0, 1, 2)
"""Straight lines that are looked at beside the nearest sample: where moves meet, some are very short."""

SEEN, AGAIN = 1e-4, 10
"""Distance [mm] that a path that is passed once explains, and how many samples else are looked at."""

WAYS = 3.0
"""A move of one axis behind a rapid by at most so many of its gaps only winds it up."""


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
        self.moves = [move for move in interpret(text) if move.length > 0.0]
        air = winds_up(self.moves, gaps)
        rapid = np.array([move.mode == 0 or move.line in air for move in self.moves])
        self.run_of = np.cumsum(np.diff(rapid, prepend=True) != 0)
        self.line_run = {move.line: int(k) for move, k in zip(self.moves, self.run_of, strict=True)}
        self.points, self.trees = {}, {}
        self.rapid_runs = set(self.run_of[rapid].tolist())
        self.begins = {}
        for k in np.unique(self.run_of).tolist():
            own = [move for move, number in zip(self.moves, self.run_of, strict=True) if number == k]
            points = run(own, DENSE).motor
            before = self.points[k - 1][-int(tail / DENSE) :] if k - 1 in self.rapid_runs and tail else points[:1]
            points = np.concatenate([before, points])
            apart = np.append(True, (np.diff(points, axis=0) != 0.0).any(axis=1))
            self.points[k] = points[apart]
            self.begins[k] = int(apart[: len(before)].sum()) - 1
            self.trees[k] = cKDTree(self.points[k])

    def nearest(self, places: Floats, run_of: NDArray[np.int64]) -> tuple[Floats, Floats]:
        """Nearest points (n, 3) [mm] of each place's run, and how far along it they are, in samples."""
        found, along = np.empty_like(places), np.empty(len(places))
        for k in np.unique(run_of).tolist():
            own = run_of == k
            found[own], along[own] = self._nearest(self.points[k], self.trees[k], places[own])
        return found, along

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
    """A program's motors (n, 3) [mm], the original's run of each row, and which rows count."""

    motor: Floats
    run_of: NDArray[np.int64]
    counted: NDArray[np.bool_]


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


def played(text: str, original: Stretches, command, lines: NDArray[np.int64], gaps: Floats, settled: float) -> Played:
    """Rows of a program: `command` in SI units, `lines` (n,) the line of each of them, from 1."""
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
    return Played(motor, numbers, cuts & (command.t >= settled))


def _tables(motor: Floats, machine, sides, *, gaps: bool = True) -> Floats:
    """Tables [mm] of motors [mm] as commanded; an axis that gravity holds has no play."""
    columns = []
    for column, name in enumerate("XYZ"):
        axis = machine.axes[name]
        body = body_of(axis, factor=1.0 if gaps and axis.gravity_side is None else 0.0)
        own = 1e-3 * motor[:, column]
        columns.append(1e3 * table_of(body, own, machine.servo_period, sides[column], own[0]))
    return np.stack(columns, axis=1)


def sides_of(machine) -> list[tuple[int, ...]]:
    """Every combination of the sides on which the axes may begin."""
    known = [{"+": (1,), "-": (-1,)}.get(machine.axes[name].gap.initial_flank, (1, -1)) for name in "XYZ"]
    return list(product(*known))


def measure(program: Played, plain: Played, path: Stretches, machine) -> Measured:
    """Errors of a program; `plain` is the original's motion, the same object where that is measured."""
    rows = program.counted
    none = (1, 1, 1)
    theirs = _tables(plain.motor, machine, none, gaps=False)
    paced = _tables(path.nearest(program.motor, program.run_of)[0], machine, none, gaps=False)[rows]
    free, free_at = path.nearest(theirs, plain.run_of)
    own = _away(path, paced, program.run_of[rows])
    runs = program.run_of[rows]
    first: tuple[Floats, Floats, Floats] | None = None
    found = []
    for sides in sides_of(machine):
        table = _tables(program.motor, machine, sides)[rows]
        if first is None:
            which = np.ones(len(table), dtype=bool)
            error, gap = np.empty(len(table)), np.empty(len(table))
        else:
            which = (table != first[0]).any(axis=1)
            error, gap = first[1].copy(), first[2].copy()
        near, at = path.nearest(table[which], runs[which])
        away = table[which] - near
        error[which] = 1e-3 * np.linalg.norm(away, axis=1)
        there = _looked_up(at, runs[which], free_at, plain.run_of, theirs - free)
        apart = np.linalg.norm(table[which] - paced[which], axis=1)
        gap[which] = 1e-3 * np.minimum(_to_segment(away, own[which], there), apart)
        first = first or (table, error, gap)
        found.append((error, gap))
    worst = Sizes(*(max(values) for values in zip(*(_sizes(error) for error, _ in found), strict=True)))
    pairs = [max(map(_sizes, errors))[:2] for errors in zip(*found, strict=True)]
    return Measured(worst, *pairs)


def _sizes(error: Floats) -> tuple[float, float, float]:
    if not error.size:
        return 0.0, 0.0, 0.0
    return float(error.max()), float(np.sqrt(np.mean(error**2))), float(np.quantile(error, 0.95))


def _away(path: Stretches, places: Floats, runs: NDArray[np.int64]) -> Floats:
    return places - path.nearest(places, runs)[0]


def _looked_up(at: Floats, runs, known: Floats, known_runs, values: Floats) -> Floats:
    """Values (m, 3) that are known at places of runs, at other places of the same runs."""
    found = np.zeros((len(at), 3))
    for k in np.unique(runs).tolist():
        own, theirs = runs == k, known_runs == k
        order = np.argsort(known[theirs], kind="stable")
        if order.size:
            for axis in range(3):
                found[own, axis] = np.interp(at[own], known[theirs][order], values[theirs][order, axis])
    return found


def _to_segment(points: Floats, a: Floats, b: Floats) -> Floats:
    way = b - a
    share = np.clip(((points - a) * way).sum(axis=1) / np.maximum((way * way).sum(axis=1), 1e-30), 0.0, 1.0)
    return np.linalg.norm(points - a - share[:, None] * way, axis=1)


def gaps_of(machine) -> Floats:
    """Lost motion of X, Y and Z [mm]."""
    return np.array([1e3 * machine.axes[name].gap.lost_motion for name in "XYZ"])


def tail_of(machine) -> float:
    """Way [mm] that a table may be behind in a rapid."""
    return 1e3 * LATE * max(axis.servo.c * axis.limits.velocity for axis in machine.axes.values())


def settled_time(machine) -> float:
    """Time at the beginning that does not count [s]."""
    return settling([body_of(machine.axes[name]) for name in "XYZ"])
