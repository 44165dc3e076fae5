"""Fit a polyline with lines, arcs and Hermite interpolants; tangents at its vertices."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.gcode.arcs import swept_angle
from ph_post.gcode.fitting.arcs import find_arcs
from ph_post.gcode.fitting.hermite import fill_pieces, write_interpolants
from ph_post.gcode.fitting.samples import ROUND, SMOOTH, STRAIGHT, PolylineFit, mark_corners
from ph_post.types import Array, BoolArray, IntArray

SPACE: Final = 3
"""Coordinates of a vertex."""

BASE: Final = 64.0
"""Points that a tangent is taken from are so many tolerances apart at least: it then errs by a hundredth of a
radian at most where every one of them is off by a whole tolerance."""

MOST: Final = 5
"""Points of a stencil: the tangent errs by the fourth power of their distance."""

FEW: Final = 3
"""Points of a stencil where steps are so uneven that more would say nothing: the tangent is between the chords."""

STRAYS: Final = 1.5
"""Times the turn there by which a tangent may be off a chord: half of it is usual."""


@lean
def _stencil(along: Array, first: int, last: int, k: int, base: float, out: IntArray) -> int:
    """Choose up to MOST vertices about k in first … last, `base` apart if there is room; return their number."""
    out[0], left, right = k, 0, 0
    low, high, count = k, k, 1
    while count < MOST:
        turn_left = left <= right
        found = -1
        for _ in range(2):
            if turn_left:
                j = low - 1
                while j > first and along[low] - along[j] < base:
                    j -= 1
                if j >= first and low > first:
                    found, low, left = j, j, left + 1
                    break
            else:
                j = high + 1
                while j < last and along[j] - along[high] < base:
                    j += 1
                if j <= last and high < last:
                    found, high, right = j, j, right + 1
                    break
            turn_left = not turn_left
        if found < 0:
            break
        out[count] = found
        count += 1
    return count


@lean
def _differentiate(points: Array, along: Array, which: IntArray, count: int, out: Array) -> bool:
    """Write the unit tangent at vertex which[0]: the derivative of the polynomial through all (Lagrange).

    Return False where it has none, as where both ends of a small closed curve are all that is far enough apart.
    """
    out[0] = out[1] = out[2] = 0.0
    here = along[which[0]]
    for j in range(1, count):
        x = along[which[j]] - here
        weight = 1.0 / x
        for other in range(1, count):
            if other != j:
                y = along[which[other]] - here
                weight *= y / (y - x)
        for axis in range(3):
            out[axis] += weight * (points[which[j], axis] - points[which[0], axis])
    size = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2)
    if size == 0.0:
        return False
    for axis in range(3):
        out[axis] /= size
    return True


@inner
def _lengths(points: Array) -> tuple[Array, Array]:
    """Length of the sampled curve up to every vertex: chords, each longer by what it cuts off its arc."""
    n = len(points)
    chord, turn, along = np.empty(n - 1), np.zeros(n), np.zeros(n)
    for k in range(n - 1):
        square = 0.0
        for axis in range(3):
            square += (points[k + 1, axis] - points[k, axis]) ** 2
        chord[k] = math.sqrt(square)
        if k > 0:
            bent = 0.0
            for axis in range(3):
                a = (points[k, axis] - points[k - 1, axis]) / chord[k - 1]
                bent += ((points[k + 1, axis] - points[k, axis]) / chord[k] - a) ** 2
            turn[k] = math.sqrt(bent)
    for k in range(n - 1):
        swept = min(0.5 * (turn[k] + turn[k + 1]), 1.0)
        along[k + 1] = along[k] + chord[k] * (1.0 + swept * swept / 24.0)
    return along, turn


@lean
def _strays(points: Array, turn: Array, first: int, last: int, k: int, tolerance: float, tangent: Array) -> bool:
    """Return True if the tangent at vertex k, of a curve from first to last, is not about between the chords there."""
    for near in (k - 1, k):
        if first <= near < last:
            size, off = 0.0, 0.0
            for axis in range(3):
                size += (points[near + 1, axis] - points[near, axis]) ** 2
            size = math.sqrt(size)
            for axis in range(3):
                off += (tangent[axis] - (points[near + 1, axis] - points[near, axis]) / size) ** 2
            # At an end of the curve the next turn says how much it may bend up to there.
            bend = turn[k] if first < k < last else turn[k + 1] if k == first else turn[k - 1]
            if math.sqrt(off) > STRAYS * bend + 3.0 * tolerance / size:
                return True
    return False


@compiled
def _tangents(points: Array, corners: BoolArray, lines: BoolArray, tolerance: float) -> tuple[Array, Array, Array]:
    n = len(points)
    along, turn = _lengths(points)
    tangent = np.zeros((n, 2, 3))
    which, first = np.empty(MOST, dtype=np.int64), 0
    while first < n - 1:
        last = first + 1
        if lines[first]:
            first = last
            continue
        while last < n - 1 and not lines[last] and not corners[last]:
            last += 1
        for k in range(first, last + 1):
            count = _stencil(along, first, last, k, BASE * tolerance, which)
            side = 0 if k == last else 1
            found = _differentiate(points, along, which, count, tangent[k, side])
            if count > FEW and (not found or _strays(points, turn, first, last, k, tolerance, tangent[k, side])):
                found = _differentiate(points, along, which, FEW, tangent[k, side])
            if not found:
                _chord(points, min(k, last - 1), min(k, last - 1) + 1, tangent[k, side])
            if first < k < last:
                for axis in range(3):
                    tangent[k, 0, axis] = tangent[k, 1, axis]
        if first > 0 and lines[first - 1] and not corners[first]:
            _chord(points, first - 1, first, tangent[first, 1])
        if last < n - 1 and lines[last] and not corners[last]:
            _chord(points, last, last + 1, tangent[last, 0])
        first = last
    return tangent, along, turn


@lean
def _chord(points: Array, i: int, j: int, out: Array) -> None:
    size = 0.0
    for axis in range(3):
        out[axis] = points[j, axis] - points[i, axis]
        size += out[axis] ** 2
    for axis in range(3):
        out[axis] /= math.sqrt(size)


def find_tangents(points: Array, corners: BoolArray, lines: BoolArray, tolerance: float) -> tuple[Array, Array, Array]:
    """Estimate the tangents of what is sampled.

    Parameters
    ----------
    points : Array, shape (n, 3)
        Vertices [m].
    corners, lines : BoolArray
        As :func:`ph_post.gcode.fitting.samples.mark_corners` has them.
    tolerance : float
        How far vertices may be off the curve [m].

    Returns
    -------
    tangent : Array, shape (n, 2, 3)
        Unit tangents of what comes in at a vertex and of what goes out; zero where that is a line.
    along : Array, shape (n,)
        Length of the curve up to every vertex [m].
    turn : Array, shape (n,)
        How much the polyline turns at every vertex (chord of the angle), 0 at its ends.
    """
    found: tuple[Array, Array, Array] = _tangents(points, corners, lines, tolerance)
    return found


def fit_polyline(
    points: Array, tolerance: float, cuts: BoolArray | None = None, sharp: BoolArray | None = None
) -> PolylineFit:
    """Fit lines, arcs and smooth curves to a polyline.

    Corners stay corners and straight lines stay lines. What samples a smooth curve becomes arcs where one
    circle explains it, else PH quintics (in a plane of the first two axes) or cubics, each as long as the
    tolerance allows. Pieces end in vertices and follow each other with one tangent there, but for corners:
    exactly where interpolants meet anything, within MEETS_AT (arcs.py) where arcs or lines meet each other.

    Parameters
    ----------
    points : Array, shape (n, 2 or 3)
        Vertices [m], neighbours apart.
    tolerance : float
        Largest distance [m] of a vertex from the curve; and of the curve from the polyline, to which the
        sagitta of the chord is added, as vertices are taken for samples of a curve.
    cuts : BoolArray, shape (n,), optional
        Vertices at which a piece has to end, though not smoothness.
    sharp : BoolArray, shape (n,), optional
        Vertices that are corners in any case; a step between two of them is a line.

    Returns
    -------
    PolylineFit

    Examples
    --------
    >>> angle = np.linspace(0.0, 1.0, 9)
    >>> circle = 0.02 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    >>> fit = fit_polyline(circle, 1e-6)
    >>> fit.kind.tolist() == [ROUND], round(float(fit.circle[0, 2]), 12)
    (True, 0.02)
    """
    vertices = np.ascontiguousarray(points, dtype=np.float64)
    if points.shape[1] < SPACE:
        vertices = np.zeros((len(points), SPACE))
        vertices[:, : points.shape[1]] = points
    none = np.zeros(len(points), dtype=np.bool_)
    stops = none if cuts is None else cuts
    corners, lines = mark_corners(vertices, tolerance, none if sharp is None else sharp)
    tangent, along, turn = find_tangents(vertices, corners, lines, tolerance)
    kinds, firsts, lasts, circles = find_arcs(vertices, along, tangent, corners, lines, stops, tolerance)
    taken = np.zeros(len(points), dtype=np.int64)
    taken[firsts] = lasts
    kind, first, last, foot = fill_pieces(vertices, along, turn, tangent, lines, corners | stops, taken, tolerance)
    del taken, lines, corners
    circle = np.zeros((kind.size, 4))
    known = np.flatnonzero(kind == ROUND)
    kind[known], circle[known] = kinds, circles
    smooth = np.flatnonzero(kind == SMOOTH)
    control, speed = np.zeros((kind.size, 6, 3)), np.zeros((kind.size, 5))
    degree = np.where(kind == STRAIGHT, 1, 0)
    control[smooth], speed[smooth], degree[smooth] = write_interpolants(
        vertices, along, turn, tangent, first[smooth], last[smooth], tolerance, foot
    )
    del tangent, along, turn  # as large as the program
    _place_feet(vertices, kind, first, last, circle, foot)
    return PolylineFit(
        kind=kind,
        first=first,
        last=last,
        circle=circle,
        degree=degree,
        control=control,
        speed=speed,
        foot=foot,
    )


def _place_feet(points: Array, kind: IntArray, first: IntArray, last: IntArray, circle: Array, foot: Array) -> None:
    """Find where the vertices are on lines and arcs, and at the ends of all pieces."""
    piece = np.repeat(np.arange(kind.size), last - first)
    straight, bent = (np.flatnonzero(kind[piece] == one) for one in (STRAIGHT, ROUND))
    start = points[first[piece[straight]]]
    way = points[last[piece[straight]]] - start
    foot[straight] = ((points[straight] - start) * way).sum(axis=1) / (way * way).sum(axis=1)
    center, sense = circle[piece[bent], :2], circle[piece[bent], 3]
    start, end, here = (points[rows, :2] - center for rows in (first[piece[bent]], last[piece[bent]], bent))
    total, part = (swept_angle(start, one, sense) for one in (end, here))
    foot[bent] = part / total
    foot[first], foot[-1] = 0.0, 1.0
