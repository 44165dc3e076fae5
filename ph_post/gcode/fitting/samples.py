"""Classify the vertices of a polyline: samples of a curve, straight lines, corners; the record of a fit."""

from __future__ import annotations

import math
from typing import Final

import msgspec
import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.types import Array, BoolArray, IntArray

SHARP: Final = 0.6
"""Turn [rad] at a vertex that is a corner whatever is around it: who samples a curve takes more than ten
chords to a turn."""

LARGEST_SAGITTA: Final = 5e-5
"""Largest sagitta [m] of a chord that samples a curve: tolerances of roughing paths. What turns more, for the
length of its steps, is a polygon that is meant."""

JUMP: Final = 3.0
"""A vertex that turns so many times as much as the curvature on either side of it says is a corner. From one
step to the next a well sampled curve does not even double its curvature."""

JOINT: Final = 0.25
"""Part of the next turn by which a line may miss the tangent of the curve that it runs into."""

SLACK: Final = 0.01
"""Turn [rad] that is no corner where nothing else is known: half a degree."""

LONGER: Final = 4.0
"""A straight stretch so many times as long as both its neighbours is a line: samplers hold the sagitta, and
steps then grow by the root of the radius."""

BENT: Final = 4.0
"""So many tolerances a curve has to leave such a line, taken on by half its length, or its steps are those
that rounding makes of a flat curve."""

FEWEST: Final = 4
"""Fewest straight stretches that are taken for a curve: fewer may as well be a chamfered corner."""

COLLINEAR: Final = 1e-10
"""Points within so much [m] of a straight line are on it: rounding of the coordinates."""


@lean
def is_flat(points: Array, first: int, last: int) -> bool:
    """Return True if vertices `first` to `last` have the same third coordinate."""
    flat = True
    for k in range(first + 1, last + 1):
        flat = flat and points[k, 2] == points[first, 2]
    return flat


@lean
def _turn(points: Array, i: int, j: int, k: int) -> float:
    """Angle [rad] between the straight lines from vertex i to j and from j to k."""
    along, ax, ay, az = 0.0, 0.0, 0.0, 0.0
    x0, y0, z0 = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    x1, y1, z1 = points[k, 0] - points[j, 0], points[k, 1] - points[j, 1], points[k, 2] - points[j, 2]
    along = x0 * x1 + y0 * y1 + z0 * z1
    ax, ay, az = y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1
    return math.atan2(math.sqrt(ax * ax + ay * ay + az * az), along)


@lean
def _off(points: Array, i: int, j: int, k: int) -> float:
    """Distance of vertex j from the straight line through i and k, infinite where it lies outside."""
    x0, y0, z0 = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    x1, y1, z1 = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    square, along = x1 * x1 + y1 * y1 + z1 * z1, x0 * x1 + y0 * y1 + z0 * z1
    if not 0.0 < along < square:
        return np.inf
    ax, ay, az = y0 * z1 - z0 * y1, z0 * x1 - x0 * z1, x0 * y1 - y0 * x1
    return math.sqrt((ax * ax + ay * ay + az * az) / square)


@lean
def _distance(points: Array, i: int, j: int) -> float:
    x, y, z = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    return math.sqrt(x * x + y * y + z * z)


@inner
def _stretches(points: Array, sharp: BoolArray) -> IntArray:
    """Vertices at which straight stretches begin and end: collinear steps in one sense are one stretch."""
    n = len(points)
    node = np.empty(n, dtype=np.int64)
    node[0], count, last = 0, 1, 0
    for k in range(1, n - 1):
        if sharp[k] or _off(points, last, k, k + 1) > COLLINEAR:
            node[count] = k
            count += 1
            last = k
    node[count] = n - 1
    return node[: count + 1]


@inner
def _corners(node: IntArray, length: Array, turn: Array, sharp: BoolArray, tolerance: float) -> BoolArray:
    """Find which nodes are corners; the ends are."""
    m = len(length)
    corner = np.zeros(m + 1, dtype=np.bool_)
    corner[0] = corner[m] = True
    for k in range(1, m):
        short = min(length[k - 1], length[k])
        corner[k] = sharp[node[k]] or turn[k] > SHARP or short * turn[k] > 8.0 * LARGEST_SAGITTA
    hard = corner.copy()
    for k in range(1, m):
        bend = 0.0
        for other in (k - 1, k + 1):
            if not hard[other]:
                bend = max(bend, 2.0 * turn[other] / (length[other - 1] + length[other]))
        short = min(length[k - 1], length[k])
        corner[k] |= turn[k] > JUMP * bend * short + 3.0 * tolerance / short + SLACK
    return corner


@lean
def _leaves(
    points: Array, node: IntArray, length: Array, corner: BoolArray, k: int, step: int, tolerance: float
) -> bool:
    """Return True if, on one side, stretch k is long beside the next and the curve turns away from it."""
    near, far = (k + 1, k) if step > 0 else (k, k + 1)
    if corner[near]:
        return True
    if length[k] <= LONGER * length[k + step]:
        return False
    square = length[k] * length[k]
    while not corner[near]:
        near += step
        along, size = 0.0, 0.0
        for x in range(3):
            way = points[node[near], x] - points[node[far], x]
            there = points[node[k + 1], x] - points[node[k], x]
            along += way * there * step
            size += way * way
        if size - along * along / square > (BENT * tolerance) ** 2:
            return True
        if along > 1.5 * square:
            return False
    return False


@lean
def _sagitta(length: Array, turn: Array, corner: BoolArray, k: int) -> float:
    """Sagitta [m] of a curve that stretch k would be a chord of: a circle divides the turn at a vertex by lengths."""
    share = 0.0
    for end, beside in ((k, k - 1), (k + 1, k + 1)):
        if not corner[end]:
            share += turn[end] * length[k] / (length[k] + length[beside])
    return float(share * length[k] / 8.0)


@inner
def _lines(points: Array, node: IntArray, length: Array, turn: Array, corner: BoolArray, tolerance: float) -> BoolArray:
    """Find which stretches are straight lines."""
    m = len(length)
    line = np.zeros(m, dtype=np.bool_)
    for k in range(m):
        line[k] = _sagitta(length, turn, corner, k) > LARGEST_SAGITTA or (
            _leaves(points, node, length, corner, k, -1, tolerance)
            and _leaves(points, node, length, corner, k, 1, tolerance)
        )
    first = 0
    for k in range(m + 1):
        # a run of stretches that may sample a curve ends before a line and at a corner
        if k == m or line[k] or (corner[k] and k > first):
            if k - first < FEWEST:
                for inside in range(first, k):
                    line[inside] = True
            first = k
        if k < m and line[k]:
            first = k + 1
    return line


@lean
def _misses(points: Array, node: IntArray, length: Array, turn: Array, k: int, forwards: bool) -> bool:
    """Angle between a line and the circle through the first three nodes of the curve behind its end k."""
    step = 1 if forwards else -1
    first = length[k] if forwards else length[k - 1]
    second = length[k + 1] if forwards else length[k - 2]
    share = first / (first + second)
    miss = 0.0
    a, b, c, d = node[k - step], node[k], node[k + step], node[k + 2 * step]
    before = _distance(points, a, b)
    for x in range(3):
        u0 = (points[c, x] - points[b, x]) / first
        u1 = (points[d, x] - points[c, x]) / second
        tangent = u0 - share * (u1 - u0)
        miss += (tangent - (points[b, x] - points[a, x]) / before) ** 2
    return bool(math.sqrt(miss) > JOINT * turn[k + step] + SLACK)


@compiled
def _mark(points: Array, tolerance: float, sharp: BoolArray) -> tuple[BoolArray, BoolArray]:
    node = _stretches(points, sharp)
    m = len(node) - 1
    length, turn = np.empty(m), np.zeros(m + 1)
    for k in range(m):
        length[k] = _distance(points, node[k], node[k + 1])
    for k in range(1, m):
        turn[k] = _turn(points, node[k - 1], node[k], node[k + 1])
    corner = _corners(node, length, turn, sharp, tolerance)
    line = _lines(points, node, length, turn, corner, tolerance)
    for k in range(1, m):
        slack = 3.0 * tolerance / min(length[k - 1], length[k])
        if line[k - 1] and line[k]:
            corner[k] = True
        elif line[k - 1] and not corner[k] and turn[k] > slack:
            corner[k] = _misses(points, node, length, turn, k, True)
        elif line[k] and not corner[k] and turn[k] > slack:
            corner[k] = _misses(points, node, length, turn, k, False)
    corners, lines = np.zeros(len(points), dtype=np.bool_), np.zeros(len(points) - 1, dtype=np.bool_)
    for k in range(m):
        corners[node[k]] = corner[k]
        for step in range(node[k], node[k + 1]):
            lines[step] = line[k]
    corners[-1] = True
    return corners, lines


def mark_corners(points: Array, tolerance: float, sharp: BoolArray) -> tuple[BoolArray, BoolArray]:
    """Distinguish corners from samples of a curve, and straight lines from its chords.

    Parameters
    ----------
    points : Array, shape (n, 3)
        Vertices [m], neighbours apart.
    tolerance : float
        How far they may be off the curve [m].
    sharp : BoolArray, shape (n,)
        Vertices that are corners in any case.

    Returns
    -------
    corners : (n,)
        Vertices at which the direction may jump, both ends included, and those between two lines.
    lines : (n - 1,)
        Steps that are, or belong to, a straight line. Where a line meets a curve and there is no corner, the
        line is the curve's tangent.
    """
    corners, lines = _mark(points, tolerance, sharp)
    return corners, lines


STRAIGHT, ROUND, SMOOTH = range(3)
"""Kind of a piece: a line; an arc in the plane of the first two axes; a Hermite interpolant."""


class PolylineFit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Pieces through the vertices of a polyline, p of them, each from vertex `first` to vertex `last`.

    `circle` (p, 4) of arcs: centre [m], radius [m] and sense, 1 from the first axis to the second. `control`
    (p, 6, 3) [m]: the control points of quintics; those of a cubic are the first four. `speed` (p, 5) [m]
    the Bernstein coefficients of ds/du of PH quintics. `degree` (p,) 1 of lines, 0 of arcs, 3 or 5 (then PH)
    of Hermite interpolants. `foot` (n,): the parameter in [0, 1] of its piece at which each vertex is
    nearest; a vertex where pieces meet counts to the later one, 0, and the last is 1.
    """

    kind: IntArray
    first: IntArray
    last: IntArray
    circle: Array
    degree: IntArray
    control: Array
    speed: Array
    foot: Array
