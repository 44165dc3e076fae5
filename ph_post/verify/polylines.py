"""Polylines of motions within a sagitta, and the decision of the Fréchet distance of two polylines."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from ph_post.compiling import compiled, lean
from ph_post.gcode.program import ARC, CUBIC, NURBS, Motions, expand, plane_columns
from ph_post.types import Array, IntArray
from ph_post.units import MM

_NONE = (2.0, -1.0)
"""An empty interval."""


@lean
def _free(a: Array, b: Array, p: Array, bound: float) -> tuple[float, float]:
    """Part of the segment from a to b, in [0, 1], that lies within the bound of p."""
    square, along, rest = 0.0, 0.0, -bound * bound
    for k in range(3):
        way, apart = b[k] - a[k], a[k] - p[k]
        square += way * way
        along += way * apart
        rest += apart * apart
    if square == 0.0:
        return (0.0, 1.0) if rest <= 0.0 else _NONE
    middle = -along / square
    root = middle * middle - rest / square
    if root < 0.0:
        return _NONE
    low, high = max(0.0, middle - np.sqrt(root)), min(1.0, middle + np.sqrt(root))
    return (low, high) if low <= high else _NONE


@lean
def _first_apart(p: Array, q: Array, bound: float) -> int:
    """First point of q that is not near the first of p; q's size where a point of p is not near q's first."""
    for j in range(q.shape[0]):
        if _free(q[j], q[j], p[0], bound)[0] > 1.0:
            return j
    for i in range(p.shape[0]):
        if _free(p[i], p[i], q[0], bound)[0] > 1.0:
            return int(q.shape[0])
    return -1


@lean
def _left_edge(p: Array, q: Array, bound: float, low: Array, high: Array) -> int:
    """Move on along q while p waits at its first point; returns the last segment of q that is reached."""
    for j in range(q.shape[0] - 1):
        low[j], high[j] = _free(q[j], q[j + 1], p[0], bound)
        if low[j] > 0.0:
            return j - 1
        if high[j] < 1.0:
            return j
    return int(q.shape[0] - 2)


@lean
def _pass_column(
    p: Array,
    q: Array,
    i: int,
    span: tuple[int, int],
    below: tuple[float, float],
    bound: float,
    low: Array,
    high: Array,
) -> tuple[int, int]:
    """Cross the cells of segment i of p; `span` are the segments of q whose left edges are reached.

    `low` and `high` hold the reachable part of each segment of q, from the i-th point of p, and become those
    from the next point. Returns the span there.
    """
    first, last = q.shape[0], -1
    j = 0 if below[0] <= below[1] else span[0]
    while j < q.shape[0] - 1 and (j <= span[1] or below[0] <= below[1]):
        left = (low[j], high[j]) if span[0] <= j <= span[1] else _NONE
        right, above = _NONE, _NONE
        if below[0] <= below[1] or left[0] <= left[1]:
            a, b = _free(q[j], q[j + 1], p[i + 1], bound)
            right = (a, b) if below[0] <= below[1] else (max(a, left[0]), b)
            c, d = _free(p[i], p[i + 1], q[j + 1], bound)
            above = (c, d) if left[0] <= left[1] else (max(c, below[0]), d)
        low[j], high[j] = right
        if right[0] <= right[1]:
            first, last = min(first, j), j
        below = above
        j += 1
    return first, last


@lean
def _within(p: Array, q: Array, bound: float, low: Array, high: Array) -> int:
    """Decide for one pair: -1 where q follows p, else the first point of q that cannot be reached."""
    segments = q.shape[0] - 1
    if p.shape[0] == 1 or segments == 0:
        return int(_first_apart(p, q, bound))
    if _free(p[0], p[0], q[0], bound)[0] > 1.0:
        return 0
    span = (0, _left_edge(p, q, bound, low, high))
    farthest, waits = span[1], True
    for i in range(p.shape[0] - 1):
        below = _NONE
        if waits:
            below = _free(p[i], p[i + 1], q[0], bound)
            waits = below[1] >= 1.0
        span = _pass_column(p, q, i, span, below, bound, low, high)
        farthest = max(farthest, span[1])
        if span[1] < 0 and not waits:
            return int(farthest + 1)
    return -1 if span[1] == segments - 1 and high[segments - 1] >= 1.0 else int(farthest + 1)


@compiled
def first_unreached(p: Array, p_first: IntArray, q: Array, q_first: IntArray, bound: Array) -> IntArray:
    """Decide for each pair of polylines if their Fréchet distance is within a bound.

    Parameters
    ----------
    p, q : ndarray, shape (n, 3)
        Points [m] of all polylines, one after the other.
    p_first, q_first : ndarray, shape (k + 1,)
        Where each begins. A polyline may be a single point, not empty.
    bound : ndarray, shape (k,)
        Largest distance [m].

    Returns
    -------
    ndarray, shape (k,)
        -1 where `q` follows `p`, else the first point of `q` that cannot be reached.
    """
    longest = 1
    for k in range(bound.size):
        longest = max(longest, q_first[k + 1] - q_first[k])
    low, high = np.empty(longest), np.empty(longest)
    stuck = np.empty(bound.size, dtype=np.int64)
    for k in range(bound.size):
        stuck[k] = _within(p[p_first[k] : p_first[k + 1]], q[q_first[k] : q_first[k + 1]], bound[k], low, high)
    return stuck


_LEAST = 2
"""An arc has at least so many chords a half turn, however small it is."""

_LENGTH_SAGITTA = 1e-3 * MM
"""Sagitta of the chords that a spline is measured by [m]."""

_PIECES = 4096
"""A spline is never cut into more chords than this."""


class Polylines(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Polylines of k motions: `points` (n, 3) [m], those of motion i from ``first[i]`` on; (k + 1,)."""

    points: Array
    first: IntArray


def polylines(motions: Motions, which: IntArray, sagitta: float) -> Polylines:
    """Draw a polyline along each of the motions, from its start to its end.

    Parameters
    ----------
    motions : Motions
        Motions whose ends are known.
    which : ndarray, shape (k,)
        Numbers of the motions wanted.
    sagitta : float
        Largest distance of a chord from its motion [m].
    """
    pieces = np.ones(which.size, dtype=np.int64)
    arcs = np.flatnonzero(motions.kind[which] == ARC)
    pieces[arcs] = _arc_pieces(motions, which[arcs], sagitta)
    curves = {
        place: _curve_points(motions, int(which[place]), sagitta)
        for place in np.flatnonzero(np.isin(motions.kind[which], (CUBIC, NURBS))).tolist()
    }
    for place, points in curves.items():
        pieces[place] = len(points) - 1
    first = np.concatenate([[0], np.cumsum(pieces + 1)])
    number, motion = expand(np.zeros_like(pieces), pieces + 1)
    points = places_on(motions, which[motion], number / pieces[motion])
    points[first[1:] - 1] = motions.end[which]
    for place, curve in curves.items():
        points[first[place] : first[place + 1]] = curve
    return Polylines(points=points, first=first)


def motion_lengths(motions: Motions, which: IntArray) -> Array:
    """Lengths of motions [m]; coordinates that are not known do not count."""
    length = np.linalg.norm(np.nan_to_num(motions.end[which] - motions.start[which]), axis=1)
    arcs = np.flatnonzero(motions.kind[which] == ARC)
    third = plane_columns(motions.plane[which[arcs]])[:, 2:]
    rise = np.take_along_axis(motions.end[which[arcs]] - motions.start[which[arcs]], third, axis=1)[:, 0]
    radius = 0.5 * np.add(*radii(motions, which[arcs]))
    length[arcs] = np.hypot(radius * motions.angle[which[arcs]], np.nan_to_num(rise))
    curves = np.flatnonzero(np.isin(motions.kind[which], (CUBIC, NURBS)))
    for place in curves.tolist():
        points = np.nan_to_num(_curve_points(motions, int(which[place]), _LENGTH_SAGITTA))
        length[place] = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    return np.asarray(length)


def places_on(motions: Motions, which: IntArray, share: Array) -> Array:
    """Points (k, 3) [m] of lines and arcs at a share of each; of splines, of the line between their ends."""
    start, end = motions.start[which], motions.end[which]
    points = np.asarray(start + (end - start) * share[:, None])
    arcs = np.flatnonzero(motions.kind[which] == ARC)
    _bend(motions, which[arcs], share[arcs], points, arcs)
    return points


def radii(motions: Motions, which: IntArray) -> tuple[Array, Array]:
    """Radii of arcs at their starts and ends [m]."""
    columns = plane_columns(motions.plane[which])[:, :2]
    begin, finish = (
        np.take_along_axis(ends[which], columns, axis=1) - motions.center[which]
        for ends in (motions.start, motions.end)
    )
    return np.hypot(*begin.T), np.hypot(*finish.T)


def _arc_pieces(motions: Motions, arcs: IntArray, sagitta: float) -> IntArray:
    radius = np.maximum(np.maximum(*radii(motions, arcs)), sagitta)
    step = 2.0 * np.arccos(1.0 - np.minimum(sagitta / radius, 1.0 - math.cos(math.pi / (2 * _LEAST))))
    return np.maximum(1, np.ceil(np.abs(motions.angle[arcs]) / step)).astype(np.int64)


def _bend(motions: Motions, arcs: IntArray, share: Array, points: Array, rows: IntArray) -> None:
    """Put rows of points on the circles of their arcs; a radius that changes does so evenly."""
    columns = plane_columns(motions.plane[arcs])[:, :2]
    begin, finish = radii(motions, arcs)
    radius = begin + (finish - begin) * share
    spoke = np.take_along_axis(motions.start[arcs], columns, axis=1) - motions.center[arcs]
    turned = np.arctan2(spoke[:, 1], spoke[:, 0]) + motions.angle[arcs] * share
    for column, wave in ((0, np.cos), (1, np.sin)):
        points[rows, columns[:, column]] = motions.center[arcs, column] + radius * wave(turned)


def _curve_points(motions: Motions, motion: int, sagitta: float) -> Array:
    """Points of a cubic or a NURBS, closer and closer until no chord leaves it by more than the sagitta."""
    pieces = 8
    coarse = _evaluate(motions, motion, pieces)
    while True:
        fine = _evaluate(motions, motion, 2 * pieces)
        off = np.nan_to_num(fine[1::2] - 0.5 * (coarse[:-1] + coarse[1:]))
        if pieces >= _PIECES or float(np.abs(off).max()) <= 0.5 * sagitta:
            return fine
        pieces, coarse = 2 * pieces, fine


def _evaluate(motions: Motions, motion: int, pieces: int) -> Array:
    """Evaluate a spline by its clamped uniform knots, in homogeneous coordinates, at even parameters."""
    from scipy.interpolate import BSpline  # slow to load, and only splines need it

    if motion in motions.control:
        order, control, weights = 4, motions.control[motion], np.ones(4)
    else:
        order, control, weights = motions.nurbs[motion]
    spans = len(control) - order + 1
    knots = np.pad(np.arange(spans + 1.0), order - 1, mode="edge")
    raised = BSpline(knots, np.column_stack([control * weights[:, None], weights]), order - 1)
    points = raised(np.linspace(0.0, spans, pieces + 1))
    return np.asarray(points[:, :3] / points[:, 3:])
