"""The way of a table in a crossing: it waits while its motor is in the backlash."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.edit.crossing_shapes import points_along

SHORTEST_TANGENT = 1e-12
"""Tangents that are shorter have no direction."""


@inner
def _places(knots: Any, samples: int) -> Any:
    """Places in equal steps from the first knot to the last, and the knots, in order and each once."""
    step = (knots[-1] - knots[0]) / (samples - 1)
    found, count, at = np.empty(samples + knots.size), 0, 0
    for n in range(samples):
        place = n * step + knots[0] if n < samples - 1 else knots[-1]
        while at < knots.size and knots[at] <= place:
            if count == 0 or found[count - 1] != knots[at]:
                found[count] = knots[at]
                count += 1
            at += 1
        if count == 0 or found[count - 1] != place:
            found[count] = place
            count += 1
    return found[:count]


@lean
def _slopes(values: Any, s: Any, out: Any) -> None:
    """Differentiate each column by places of any distance, to the second order inside."""
    last = s.size - 1
    for k in range(values.shape[1]):
        out[0, k] = (values[1, k] - values[0, k]) / (s[1] - s[0])
        out[last, k] = (values[last, k] - values[last - 1, k]) / (s[last] - s[last - 1])
        for n in range(1, last):
            before, behind = s[n] - s[n - 1], s[n + 1] - s[n]
            a = -behind / (before * (before + behind))
            b = (behind - before) / (before * behind)
            c = before / (behind * (before + behind))
            out[n, k] = a * values[n - 1, k] + b * values[n, k] + c * values[n + 1, k]


@lean
def _product(one: Any, other: Any) -> Any:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


@inner
def _motor(path: Any, s: Any, knots: Any, added: Any, line: Any, points: Any) -> Any:
    """Way of the motor: the path with what is added to it, and straight blocks between some of the knots."""
    motor, part = np.empty(path.shape), 0
    for n in range(s.size):
        while part < knots.size - 2 and s[n] >= knots[part + 1]:
            part += 1
        low, high = knots[part], knots[part + 1]
        # At a knot between two parts the later one counts, if it is a straight block.
        own = part if line[part + 1] or part == 0 or s[n] > low else part - 1
        share = (s[n] - knots[own]) / (knots[own + 1] - knots[own])
        for k in range(3):
            if line[own + 1]:
                motor[n, k] = points[own, k] + share * (points[own + 1, k] - points[own, k])
            elif s[n] == high:
                motor[n, k] = path[n, k] + added[part + 1, k]
            else:
                slope = (added[part + 1, k] - added[part, k]) / (high - low)
                motor[n, k] = path[n, k] + (slope * (s[n] - low) + added[part, k])
    return motor


@compiled
def follow_table(
    view: Any,
    along: Any,
    knots: Any,
    added: Any,
    line: Any,
    points: Any,
    column: int,
    before: Any,
    after: float,
    samples: int,
) -> Any:
    """Follow a table through a crossing.

    Parameters
    ----------
    view, along : tuple, Array
        Of :func:`~ph_post.edit.crossing_shapes.points_along`.
    knots : Array, shape (k,)
        Places of the crossing along the program [m], rising.
    added : Array, shape (k, 3)
        What is added to the path there [m].
    line : BoolArray, shape (k,)
        Parts, by the knot at their end, that are straight blocks.
    points : Array, shape (k, 3)
        Where the motor is at the knots [m].
    column : int
        The axis that crosses its backlash.
    before : Array, shape (3,)
        Offsets of all axes before the crossing [m].
    after : float
        That of the axis behind it [m].
    samples : int
        Places that are looked at beside the knots.

    Returns
    -------
    s : Array, shape (n,)
        Places along the program [m].
    path, table : Array, shape (n, 3)
        The path there, and where the table is then [m].
    error : float
        Its largest distance from the path's tangent there [m].
    ahead : Array, shape (n,)
        Way along the path by which the place of the path that is nearest to the table lies ahead [m].
    """
    s = _places(knots, samples)
    path = points_along(view, along, s)
    table = _motor(path, s, knots, added, line, points)
    low, high = min(before[column], after), max(before[column], after)
    held = table[0, column] - before[column]
    for n in range(s.size):
        held = min(max(held, table[n, column] - high), table[n, column] - low)
        for k in range(3):
            table[n, k] -= before[k]
        table[n, column] = held
    tangent, bend, ahead, error = np.empty(path.shape), np.empty(path.shape), np.empty(s.size), 0.0
    _slopes(path, s, tangent)
    for n in range(s.size):
        length = max(math.sqrt(_product(tangent[n], tangent[n])), SHORTEST_TANGENT)
        for k in range(3):
            tangent[n, k] /= length
    _slopes(tangent, s, bend)
    for n in range(s.size):
        off = table[n] - path[n]
        ahead[n] = _product(off, tangent[n])
        across = off - ahead[n] * tangent[n]
        error = max(error, math.sqrt(_product(across, across)))
        # Towards the centre of curvature a place is shorter than the path.
        ahead[n] /= 1.0 - _product(off, bend[n])
    return s, path, table, error, ahead
