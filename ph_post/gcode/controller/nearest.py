"""Where a motion stands on the lines and arcs of a program, and how far it is from them.

A program runs over itself, so that the nearest place of all says little: the place that is meant is followed
from row to row, and the distance is taken to what lies a little before and behind it.
"""

from __future__ import annotations

import math

import numpy as np

from ph_post.gcode.controller.legs import Legs
from ph_post.simulate.compiling import compiled, inner
from ph_post.types import Array, IntArray

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
def _foot(shapes: Array, row: int, x: Array, near: float, work: Array) -> float:
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
        local = _foot(shapes, k, x, expected - starts[k], work)
        _point(shapes, k, local, work)
        off = PREFERENCE * (starts[k] + local - expected)
        square = _square(x, work)
        if square + off * off < best:
            least, best, best_leg, best_s = square, square + off * off, k, starts[k] + local
        k += 1
    return least, best_leg, best_s


@compiled
def follow(
    shapes: Array, starts: Array, position: Array, reach: float, wide: float
) -> tuple[IntArray, Array]:
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
def feet(shapes: Array, starts: Array, position: Array, place: Array, reach: Array) -> tuple[Array, Array]:
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
            square, s = _to(shapes, k, position[row], place[row] - starts[k], work)
            if square < best:
                best, at = square, starts[k] + s
            k -= 1
        k = first + 1
        while k <= last and starts[k] <= place[row] + reach[row]:
            square, s = _to(shapes, k, position[row], place[row] - starts[k], work)
            if square < best:
                best, at = square, starts[k] + s
            k += 1
        distance[row], foot[row] = math.sqrt(best), at
    return distance, foot


@inner
def _to(shapes: Array, row: int, x: Array, near: float, work: Array) -> tuple[float, float]:
    """Squared distance from a leg, and where on it that is [m from its beginning]."""
    s = _foot(shapes, row, x, near, work)
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
