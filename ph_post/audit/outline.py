"""Motions as polylines that leave them by no more than a given sagitta, all of them at once."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from ph_post.audit.align import expand
from ph_post.gcode.reader.record import ARC, CUBIC, NURBS, Motions, plane_columns
from ph_post.types import Array, IntArray
from ph_post.units import MM

_LEAST = 2
"""An arc has at least so many chords a half turn, however small it is."""

_LENGTH_SAGITTA = 1e-3 * MM
"""How far the chords leave a spline whose length is taken [m]."""

_PIECES = 4096
"""A spline is never cut into more chords than this."""


class Outline(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Polylines of k motions: `points` (n, 3) [m], those of motion i from ``first[i]`` on; (k + 1,)."""

    points: Array
    first: IntArray


def outline(motions: Motions, which: IntArray, sagitta: float) -> Outline:
    """Lay a polyline through each of the motions, its start and end included.

    Parameters
    ----------
    motions : Motions
        Motions whose ends are known.
    which : ndarray, shape (k,)
        Numbers of the motions wanted.
    sagitta : float
        How far a chord may leave its motion [m].
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
    share = number / pieces[motion]
    start, end = motions.start[which][motion], motions.end[which][motion]
    points = np.asarray(start + (end - start) * share[:, None])
    rows = np.flatnonzero(motions.kind[which[motion]] == ARC)
    _bend(motions, which[motion[rows]], share[rows], points, rows)
    points[first[1:] - 1] = motions.end[which]
    for place, curve in curves.items():
        points[first[place] : first[place + 1]] = curve
    return Outline(points=points, first=first)


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
    u = np.linspace(0.0, 1.0, pieces + 1)
    if motion in motions.control:
        t = u[:, None]
        b = motions.control[motion]
        return np.asarray(
            (1 - t) ** 3 * b[0] + 3 * (1 - t) ** 2 * t * b[1] + 3 * (1 - t) * t**2 * b[2] + t**3 * b[3]
        )
    order, control, weights = motions.nurbs[motion]
    return _nurbs_points(order, control, weights, u)


def _nurbs_points(order: int, control: Array, weights: Array, u: Array) -> Array:
    """De Boor's algorithm on a clamped uniform knot vector, in homogeneous coordinates."""
    degree, spans = order - 1, len(control) - order + 1
    knots = np.concatenate([np.zeros(degree), np.arange(spans + 1), np.full(degree, spans)]).astype(float)
    x = u * spans
    span = np.clip(np.floor(x).astype(np.int64), 0, spans - 1) + degree
    raised = np.hstack([control * weights[:, None], weights[:, None]])
    d = [raised[span - degree + j] for j in range(order)]
    for r in range(1, order):
        for j in range(degree, r - 1, -1):
            low, high = knots[span - degree + j], knots[span + j + 1 - r]
            alpha = ((x - low) / (high - low))[:, None]
            d[j] = (1.0 - alpha) * d[j - 1] + alpha * d[j]
    return np.asarray(d[degree][:, :3] / d[degree][:, 3:])
