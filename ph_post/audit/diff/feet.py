"""Points of exact curves, and the nearest point of one stretch of a path to a point of another."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.audit.diff.outline import ANGLE, AXES, CENTER, END, FIRST, ORDER, START
from ph_post.simulate.compiling import compiled, inner
from ph_post.types import Array, IntArray

STEPS: Final = 48
"""Golden sections of a stretch of a curve: 1e-10 of it is left."""

GOLDEN: Final = 0.5 * (math.sqrt(5.0) - 1.0)

SLACK: Final = 0.4
"""How far along the other path a nearer place may be than where a point belongs, relative to the distance.

The alignment that makes the sum of all distances small is slack by about that much beside a corner. What goes
astray by d is still found to be off, by 0.6 d where it runs along the path itself.
"""

PROBES: Final = 256
"""Samples of a long reach that are looked at first."""


@compiled
def places(table: Array, control: Array, piece: IntArray, u: Array) -> Array:
    """Points (n, 3) [m] of the pieces `piece` (n,) at `u` (n,)."""
    points = np.empty((piece.size, 3))
    for k in range(piece.size):
        points[k, 0], points[k, 1], points[k, 2] = place(table[piece[k]], control, u[k])
    return points


@compiled
def feet(
    points: Array,
    reach: IntArray,
    table: Array,
    control: Array,
    piece: IntArray,
    u: Array,
    samples: Array,
    ways: Array,
) -> tuple[Array, IntArray, Array]:
    """Nearest points of a path to other points, in the order of travel.

    Parameters
    ----------
    points : Array, shape (n, 3)
        [m].
    reach : IntArray, shape (n, 4)
        First and last sample of the path that each point belongs to, and those of their whole stretch.
    table, control
        The path's outline.
    piece, u, samples, ways
        The path's samples: where they are on it, the points (m, 3) [m] and the way up to them (m,) [m].

    Returns
    -------
    tuple of Array (n, 3), IntArray (n,), Array (n,)
        The nearest points [m], their pieces and u.
    """
    found = np.empty_like(points)
    on, at = np.empty(points.shape[0], dtype=np.int64), np.empty(points.shape[0])
    for k in range(points.shape[0]):
        nearest = _nearest(points[k], reach[k, 0], reach[k, 1], samples)
        least = _square(points[k], samples[nearest, 0], samples[nearest, 1], samples[nearest, 2])
        slack = SLACK * math.sqrt(least)
        first, last = reach[k, 0], reach[k, 1]
        while first > reach[k, 2] and ways[reach[k, 0]] - ways[first - 1] <= slack:
            first -= 1
        while last < reach[k, 3] and ways[last + 1] - ways[reach[k, 1]] <= slack:
            last += 1
        nearest = _nearest(points[k], first, last, samples)
        least = _square(points[k], samples[nearest, 0], samples[nearest, 1], samples[nearest, 2])
        found[k], on[k], at[k] = samples[nearest], piece[nearest], u[nearest]
        if last - first > PROBES:
            first, last = max(first, nearest - PROBES // 2), min(last, nearest + PROBES // 2)
        # A sample stands between two parts, and at a joint there are two samples: so two more on either side.
        for j in range(max(first - 1, 1), min(last + 3, piece.size)):
            if piece[j - 1] == piece[j] and u[j - 1] < u[j]:
                near = math.sqrt(_square(points[k], samples[j, 0], samples[j, 1], samples[j, 2]))
                if near - (ways[j] - ways[j - 1]) >= math.sqrt(least):
                    continue
                v = _foot(points[k], table[piece[j]], control, u[j - 1], u[j])
                x, y, z = place(table[piece[j]], control, v)
                distance = _square(points[k], x, y, z)
                if distance < least:
                    least, on[k], at[k] = distance, piece[j], v
                    found[k, 0], found[k, 1], found[k, 2] = x, y, z
    return found, on, at


@inner
def _nearest(point: Array, first: int, last: int, samples: Array) -> int:
    """Nearest of the samples `first` to `last`; of very many, the nearest around the nearest probe."""
    step = max((last - first) // PROBES, 1)
    nearest = _nearest_by(point, first, last, step, samples)
    if step > 1:
        nearest = _nearest_by(point, max(nearest - step, first), min(nearest + step, last), 1, samples)
    return nearest


@inner
def _nearest_by(point: Array, first: int, last: int, step: int, samples: Array) -> int:
    nearest, least = first, np.inf
    for j in range(first, last + 1, step):
        distance = _square(point, samples[j, 0], samples[j, 1], samples[j, 2])
        if distance < least:
            nearest, least = j, distance
    return nearest


@inner
def _square(point: Array, x: float, y: float, z: float) -> float:
    square: float = (point[0] - x) ** 2 + (point[1] - y) ** 2 + (point[2] - z) ** 2
    return square


@inner
def _foot(point: Array, row: Array, control: Array, low: float, high: float) -> float:
    """Where a piece is nearest between two parameters: of a line at once, of a curve by golden sections."""
    if row[ANGLE] == 0.0 and row[ORDER] == 0.0:
        dx, dy, dz = row[END] - row[START], row[END + 1] - row[START + 1], row[END + 2] - row[START + 2]
        ahead = (
            (point[0] - row[START]) * dx + (point[1] - row[START + 1]) * dy + (point[2] - row[START + 2]) * dz
        )
        square = dx * dx + dy * dy + dz * dz
        at = ahead / square if square > 0.0 else low
        return min(max(at, low), high)
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    x, y, z = place(row, control, left)
    at_left = _square(point, x, y, z)
    x, y, z = place(row, control, right)
    at_right = _square(point, x, y, z)
    for _ in range(STEPS):
        if at_left <= at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            x, y, z = place(row, control, left)
            at_left = _square(point, x, y, z)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            x, y, z = place(row, control, right)
            at_right = _square(point, x, y, z)
    return 0.5 * (low + high)


@inner
def place(row: Array, control: Array, u: float) -> tuple[float, float, float]:
    """Point of a piece at u in [0, 1] [m]; of an arc whose radii disagree the radius changes evenly."""
    if row[ORDER] > 0.0:
        return _on_spline(control[int(row[FIRST]) : int(row[FIRST] + row[ORDER])], u)
    x = row[START] + u * (row[END] - row[START])
    y = row[START + 1] + u * (row[END + 1] - row[START + 1])
    z = row[START + 2] + u * (row[END + 2] - row[START + 2])
    if row[ANGLE] == 0.0 or u * (1.0 - u) == 0.0:
        return x, y, z
    at = np.array([x, y, z])
    a, b = int(row[AXES]), int(row[AXES + 1])
    ray_a, ray_b = row[START + a] - row[CENTER], row[START + b] - row[CENTER + 1]
    radius = math.hypot(ray_a, ray_b)
    last = math.hypot(row[END + a] - row[CENTER], row[END + b] - row[CENTER + 1])
    scale = 1.0 + u * (last / radius - 1.0)
    cos, sin = math.cos(u * row[ANGLE]) * scale, math.sin(u * row[ANGLE]) * scale
    at[a] = row[CENTER] + cos * ray_a - sin * ray_b
    at[b] = row[CENTER + 1] + sin * ray_a + cos * ray_b
    return at[0], at[1], at[2]


@inner
def _on_spline(control: Array, u: float) -> tuple[float, float, float]:
    """Point of a rational Bézier piece, by de Casteljau's steps."""
    points = control.copy()
    for level in range(control.shape[0] - 1, 0, -1):
        for i in range(level):
            for k in range(4):
                points[i, k] = (1.0 - u) * points[i, k] + u * points[i + 1, k]
    return points[0, 0] / points[0, 3], points[0, 1] / points[0, 3], points[0, 2] / points[0, 3]
