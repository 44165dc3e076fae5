"""Deviation of a command from the path of a program, on every machine that a machine file leaves possible.

A program runs over itself, so that the nearest place of all says little: the commanded place is followed
from row to row, and the distance is taken to the stretch of path a little before and behind it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace
from scipy.ndimage import maximum_filter1d

from ph_post.compiling import compiled, inner
from ph_post.drive.axes import gaps_of
from ph_post.errors import InputError
from ph_post.gcode.program import AXES, PartProgram
from ph_post.simulate.assess import resting_axes, scenarios
from ph_post.simulate.contour import ContourError, contour_error, settling_time
from ph_post.simulate.controllers.legs import Legs
from ph_post.simulate.controllers.run import limit_table, programmed
from ph_post.simulate.machine import simulate
from ph_post.types import Array, BoolArray, Command, IntArray, Machine, Run, Scenario

PREFERENCE = 1e-3
"""What a place that is off the way travelled by one metre is worth, in metres of distance."""

# Columns of a table of shapes: the origin stands first.
FIRST, SECOND, RISE, RADIUS, SWEEP, LENGTH, SHAPE = 3, 6, 9, 12, 13, 14, 15

NEWTON = 3
"""Steps of Newton's method towards the nearest place of a helix, of an arc in a plane none is needed."""


def shapes_of(legs: Legs) -> Array:
    """Put the shapes of lines and arcs into one table, shape (n, SHAPE)."""
    vectors = (legs.origin, legs.first, legs.second, legs.rise)
    return np.column_stack([*vectors, legs.radius, legs.sweep, legs.length])


@inner
def _point(shapes: Array, row: int, s: float, out: Array) -> None:
    """Put the point of a leg at s from its beginning into `out`."""
    if shapes[row, RADIUS] == 0.0:
        for k in range(3):
            out[k] = shapes[row, k] + s * shapes[row, FIRST + k]
        return
    part = s / shapes[row, LENGTH]
    angle = shapes[row, SWEEP] * part
    c, d = math.cos(angle), math.sin(angle)
    for k in range(3):
        out[k] = shapes[row, k] + part * shapes[row, RISE + k]
        out[k] += shapes[row, RADIUS] * (c * shapes[row, FIRST + k] + d * shapes[row, SECOND + k])


@inner
def _closest(shapes: Array, row: int, x: Array, near: float, work: Array) -> float:
    """Where on a leg a point is nearest [m from its beginning]; of an arc's turns that next to `near`."""
    length = shapes[row, LENGTH]
    if shapes[row, RADIUS] == 0.0:
        s = 0.0
        for k in range(3):
            s += (x[k] - shapes[row, k]) * shapes[row, FIRST + k]
        foot: float = min(max(s, 0.0), length)
        return foot
    along, across = 0.0, 0.0
    for k in range(3):
        along += (x[k] - shapes[row, k]) * shapes[row, FIRST + k]
        across += (x[k] - shapes[row, k]) * shapes[row, SECOND + k]
    sweep = shapes[row, SWEEP]
    angle = math.atan2(across, along)
    turn = 2.0 * math.pi
    angle += turn * round((sweep * min(max(near, 0.0), length) / length - angle) / turn)
    s = angle / sweep * length
    if s < 0.0 or s > length:
        _point(shapes, row, 0.0, work)
        to_begin = _square(x, work)
        _point(shapes, row, length, work)
        s = 0.0 if to_begin < _square(x, work) else length
    found: float = s
    return found


@inner
def _square(x: Array, y: Array) -> float:
    total = 0.0
    for k in range(3):
        total += (x[k] - y[k]) ** 2
    return total


@inner
def _best(
    shapes: Array, starts: Array, x: Array, at: int, s: float, expected: float, reach: float, work: Array
) -> tuple[float, int, float]:
    """Squared distance, leg and place of the best place between s - reach and expected + reach."""
    last = shapes.shape[0] - 1
    least, best, best_leg, best_s = math.inf, math.inf, at, s
    k = at
    while k > 0 and starts[k] > s - reach:
        k -= 1
    while k <= last and starts[k] <= expected + reach:
        local = _closest(shapes, k, x, expected - starts[k], work)
        _point(shapes, k, local, work)
        off = PREFERENCE * (starts[k] + local - expected)
        square = _square(x, work)
        if square + off * off < best:
            least, best, best_leg, best_s = square, square + off * off, k, starts[k] + local
        k += 1
    return least, best_leg, best_s


@compiled
def follow(shapes: Array, starts: Array, position: Array, reach: float, wide: float) -> tuple[IntArray, Array]:
    """Follow a command along a program: the leg of every row, and how far along it [m].

    Parameters
    ----------
    shapes : Array, shape (n, SHAPE)
        Of :func:`shapes_of`, without a gap between them.
    starts : Array, shape (n + 1,)
        Length of what lies before each leg [m].
    position : Array, shape (m, 3)
        The command [m].
    reach, wide : float
        How far off the way travelled a place is looked for [m], and how far where none is found within
        `reach` of the command.
    """
    count = position.shape[0]
    leg, place = np.zeros(count, dtype=np.int64), np.zeros(count)
    work = np.empty(3)
    at, s = 0, 0.0
    for row in range(count):
        way = math.sqrt(_square(position[row], position[row - 1])) if row > 0 else 0.0
        off, k, new = _best(shapes, starts, position[row], at, s, s + way, reach, work)
        if off > reach * reach:
            off, k, new = _best(shapes, starts, position[row], at, s, s + way, wide, work)
        at, s = k, new
        leg[row], place[row] = at, s
    return leg, place


@compiled
def closest_points(shapes: Array, starts: Array, position: Array, place: Array, reach: Array) -> tuple[Array, Array]:
    """Find what lies within `reach` (m,) of the `place` (m,) of positions (m, 3), and is nearest to them [m].

    Returns
    -------
    distance, foot : Array, shape (m,)
        How far it is, and where along the program [m].
    """
    count, last = position.shape[0], shapes.shape[0] - 1
    distance, foot = np.empty(count), np.empty(count)
    work = np.empty(3)
    for row in range(count):
        first = min(max(int(np.searchsorted(starts, place[row], side="right")) - 1, 0), last)
        best, at = math.inf, place[row]
        k = first
        while k >= 0 and starts[k + 1] >= place[row] - reach[row]:
            square, s = _distance_to(shapes, k, position[row], place[row] - starts[k], work)
            if square < best:
                best, at = square, starts[k] + s
            k -= 1
        k = first + 1
        while k <= last and starts[k] <= place[row] + reach[row]:
            square, s = _distance_to(shapes, k, position[row], place[row] - starts[k], work)
            if square < best:
                best, at = square, starts[k] + s
            k += 1
        distance[row], foot[row] = math.sqrt(best), at
    return distance, foot


@inner
def _distance_to(shapes: Array, row: int, x: Array, near: float, work: Array) -> tuple[float, float]:
    """Squared distance from a leg, and where on it that is [m from its beginning]."""
    s = _closest(shapes, row, x, near, work)
    rise = abs(shapes[row, RISE + 0]) + abs(shapes[row, RISE + 1]) + abs(shapes[row, RISE + 2])
    for _ in range(NEWTON if rise > 0.0 else 0):
        s = _improved(shapes, row, x, s, work)
    _point(shapes, row, s, work)
    return _square(x, work), s


@inner
def _improved(shapes: Array, row: int, x: Array, s: float, work: Array) -> float:
    """One step of Newton's method towards the nearest place of a helix."""
    _point(shapes, row, s, work)
    rate = shapes[row, SWEEP] / shapes[row, LENGTH]
    c, d = math.cos(rate * s), math.sin(rate * s)
    slope, bend = 0.0, 0.0
    for k in range(3):
        turned = c * shapes[row, SECOND + k] - d * shapes[row, FIRST + k]
        inward = c * shapes[row, FIRST + k] + d * shapes[row, SECOND + k]
        first = shapes[row, RADIUS] * rate * turned + shapes[row, RISE + k] / shapes[row, LENGTH]
        slope += (work[k] - x[k]) * first
        bend += first * first - (work[k] - x[k]) * shapes[row, RADIUS] * rate * rate * inward
    if bend <= 0.0:
        return s
    better: float = min(max(s - slope / bend, 0.0), shapes[row, LENGTH])
    return better


SLACK: Final = 1e-4
"""What lies so far [m] before and behind the place that is meant always belongs to it."""

GAPS: Final = 2.0
"""So many times the largest gap may a command be off the path, and its place off the way travelled."""

WIDE: Final = 0.02
"""How far from the way travelled the place is looked for [m] where a corner is cut."""


class ProgramError(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """How far a command leaves the path of a program while the tool cuts, as `assess` tells it of a path.

    `errors` one a scenario, None where nothing is cut. `error` the largest at the file's values, with its
    `run` and, a row each, the `distance` of the table from the path [m] and whether it is `counted`: rapids
    are not, nor is the beginning, for five servo time constants. `error_worst` is the largest of all, in the
    scenario `worst`. `motion` is the number of the program's motion that every row belongs to, `place` how
    far along the program [m].
    """

    scenarios: tuple[Scenario, ...]
    errors: tuple[ContourError | None, ...]
    error: ContourError | None
    error_worst: ContourError | None
    worst: Scenario
    run: Run
    distance: Array
    counted: BoolArray
    motion: IntArray
    place: Array


class CutPath:
    """The path of a program, made ready to measure from.

    Parameters
    ----------
    program : PartProgram
    machine : Machine

    Raises
    ------
    InputError
        Where the program has no motion.
    """

    def __init__(self, program: PartProgram, machine: Machine) -> None:
        legs = programmed(program, limit_table(machine))
        kept = np.flatnonzero(legs.length > 0.0)
        if kept.size == 0:
            raise InputError(program.name, "the program moves nothing that is understood")
        self.legs = Legs(*(np.ascontiguousarray(column[kept]) for column in legs))
        self.starts = np.concatenate([[0.0], np.cumsum(self.legs.length)])
        self._shapes = shapes_of(self.legs)
        self._machine = machine

    def follow(self, command: Command) -> tuple[IntArray, Array]:
        """Leg of every row of a command, and its place along the program [m]."""
        position = self._in_space(command.axes, command.position)
        drives = [self._machine.axes[name] for name in command.axes]
        pairs = zip(drives, command.position.T, strict=True)
        gaps = [float(gaps_of(axis, column).max()) for axis, column in pairs]
        return follow(self._shapes, self.starts, position, SLACK + GAPS * max(gaps), WIDE)

    def command_distance(self, command: Command, place: Array) -> Array:
        """How far a command itself is from the path in every row [m]."""
        position = self._in_space(command.axes, command.position)
        return closest_points(self._shapes, self.starts, position, place, np.full(len(position), SLACK))[0]

    def distance(self, run: Run, place: Array) -> Array:
        """How far the table is from the path in every row of a run [m]."""
        return self.feet(run, place)[0]

    def feet(self, run: Run, place: Array) -> tuple[Array, Array]:
        """How far the table is from the path in every row of a run [m], and from where along it [m]."""
        executed = self._in_space(run.axes, run.executed)
        return closest_points(self._shapes, self.starts, executed, place, SLACK + self._lag(run))

    def points(self, place: Array, axes: Sequence[str] = AXES) -> Array:
        """Points at places (n,) along the program [m], shape (n, axes) [m]."""
        legs = self.legs
        leg = np.clip(np.searchsorted(self.starts, place, side="right") - 1, 0, legs.length.size - 1)
        way = np.clip(place - self.starts[leg], 0.0, legs.length[leg])
        share = way / legs.length[leg]
        angle = (legs.sweep[leg] * share)[:, None]
        turned = np.cos(angle) * legs.first[leg] + np.sin(angle) * legs.second[leg]
        radius = legs.radius[leg][:, None]
        arc = radius * turned + legs.rise[leg] * share[:, None]
        found = legs.origin[leg] + np.where(radius > 0.0, arc, legs.first[leg] * way[:, None])
        return np.asarray(found[:, [AXES.index(name) for name in axes]])

    def place_of(self, motion: IntArray, share: Array) -> Array:
        """Places along the program [m] of shares (0 to 1) of its motions, each of shape (n,)."""
        legs = self.legs
        known = np.stack([legs.motion + legs.share0, legs.motion + legs.share1], axis=1).ravel()
        places = np.stack([self.starts[:-1], self.starts[1:]], axis=1).ravel()
        return np.asarray(np.interp(motion + share, known, places))

    def _lag(self, run: Run) -> Array:
        """How far the table may be behind the command in every row [m]."""
        late = 2.0 * max(self._machine.axes[name].servo.c for name in run.axes)
        rows = 1 + math.ceil((late + settling_time(self._machine, run.axes)) / run.period)
        steps = np.sqrt((np.diff(run.commanded, axis=0, prepend=run.commanded[:1]) ** 2).sum(axis=1))
        fastest = maximum_filter1d(steps, rows, origin=(rows - 1) // 2, mode="nearest")
        return np.asarray(late / run.period * fastest)

    def _in_space(self, axes: Sequence[str], values: Array) -> Array:
        """Fill in the axes that the command has not, which stand where the program begins."""
        full = np.empty((len(values), len(AXES)))
        begin = self.legs.origin[0] + self.legs.radius[0] * self.legs.first[0]
        full[:] = begin
        for number, name in enumerate(axes):
            full[:, AXES.index(name)] = values[:, number]
        return full


def program_error(
    command: Command, machine: Machine, program: PartProgram, tried: Sequence[Scenario] = ()
) -> ProgramError:
    """Simulate a command in every scenario, and measure how far the table leaves a program's path.

    Parameters
    ----------
    command : Command
        Of this program as it is, or compensated; from a model or a real controller.
    machine : Machine
    program : PartProgram
        The program that says where the path is.
    tried : sequence of Scenario, optional
        In place of those that the machine file leaves open.
    """
    command = moving_axes(command)
    path = CutPath(program, machine)
    tried = tuple(tried) or scenarios(machine, command.axes, resting_axes(command))
    leg, place = path.follow(command)
    counted = (path.legs.rapid[leg] == 0.0) & (command.t >= settling_time(machine, command.axes))

    def measure(scenario: Scenario) -> tuple[ContourError | None, Run, Array]:
        run = simulate(command, machine, scenario)
        distance = path.distance(run, place)
        return contour_error(distance[counted]), run, distance

    first, *others = tried
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        errors = (measure(first)[0], *pool.map(lambda one: measure(one)[0], others))
    sizes = [-1.0 if error is None else error.max for error in errors]
    nominal = [k for k, one in enumerate(tried) if one.gap == one.beta == one.gain == 1.0] or [0]
    decides, worst = max(nominal, key=lambda k: sizes[k]), int(np.argmax(sizes))
    _, run, distance = measure(tried[decides])
    return ProgramError(
        scenarios=tried,
        errors=errors,
        error=errors[decides],
        error_worst=errors[worst],
        worst=tried[worst],
        run=run,
        distance=distance,
        counted=counted,
        motion=path.legs.motion[leg].astype(np.int64),
        place=place,
    )


def moving_axes(command: Command) -> Command:
    """Leave out the axes that stand still all the time; at least one stays."""
    moves = [number for number in range(len(command.axes)) if np.ptp(command.position[:, number]) > 0.0] or [0]
    if len(moves) == len(command.axes):
        return command
    axes = tuple(command.axes[number] for number in moves)
    return replace(command, axes=axes, position=np.ascontiguousarray(command.position[:, moves]))
