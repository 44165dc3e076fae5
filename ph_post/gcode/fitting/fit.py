"""Fit what short straight moves sample: lines, arcs and Hermite interpolants."""

from __future__ import annotations

import numpy as np

from ph_post.gcode.fitting.arcs import find_arcs
from ph_post.gcode.fitting.hermite import fill, write_interpolants
from ph_post.gcode.fitting.marks import mark
from ph_post.gcode.fitting.record import ROUND, SMOOTH, STRAIGHT, Fit
from ph_post.gcode.fitting.tangents import find_tangents
from ph_post.types import Array, BoolArray, IntArray


def fit_polyline(
    points: Array, tolerance: float, cuts: BoolArray | None = None, sharp: BoolArray | None = None
) -> Fit:
    """Fit a polyline with lines, arcs and smooth curves.

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
    Fit

    Examples
    --------
    >>> angle = np.linspace(0.0, 1.0, 9)
    >>> circle = 0.02 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    >>> fit = fit_polyline(circle, 1e-6)
    >>> fit.kind.tolist() == [ROUND], round(float(fit.circle[0, 2]), 12)
    (True, 0.02)
    """
    vertices = np.zeros((len(points), 3))
    vertices[:, : points.shape[1]] = points
    none = np.zeros(len(points), dtype=np.bool_)
    stops = none if cuts is None else cuts
    corners, lines = mark(vertices, tolerance, none if sharp is None else sharp)
    tangent, along, turn = find_tangents(vertices, corners, lines, tolerance)
    kinds, firsts, lasts, circles = find_arcs(vertices, along, tangent, corners, lines, stops, tolerance)
    taken = np.zeros(len(points), dtype=np.int64)
    taken[firsts] = lasts
    kind, first, last, foot = fill(vertices, along, turn, tangent, lines, corners | stops, taken, tolerance)
    circle = np.zeros((kind.size, 4))
    known = np.flatnonzero(kind == ROUND)
    kind[known], circle[known] = kinds, circles
    smooth = np.flatnonzero(kind == SMOOTH)
    control, speed = np.zeros((kind.size, 6, 3)), np.zeros((kind.size, 5))
    degree = np.where(kind == STRAIGHT, 1, 0)
    control[smooth], speed[smooth], degree[smooth] = write_interpolants(
        vertices, along, turn, tangent, first[smooth], last[smooth], tolerance, foot
    )
    _place_feet(vertices, kind, first, last, circle, foot)
    return Fit(
        kind=kind, first=first, last=last, circle=circle, degree=degree, control=control, speed=speed,
        foot=foot,
    )  # fmt: skip


def _place_feet(
    points: Array, kind: IntArray, first: IntArray, last: IntArray, circle: Array, foot: Array
) -> None:
    """Find where the vertices are on lines and arcs, and at the ends of all pieces."""
    piece = np.repeat(np.arange(kind.size), last - first)
    start, end = points[first[piece]], points[last[piece]]
    here = points[:-1]
    straight = np.flatnonzero(kind[piece] == STRAIGHT)
    way = (end - start)[straight]
    foot[straight] = ((here - start)[straight] * way).sum(axis=1) / (way * way).sum(axis=1)
    bent = np.flatnonzero(kind[piece] == ROUND)
    center, sense = circle[piece[bent], :2], circle[piece[bent], 3]
    total, part = (_angle(start[bent, :2] - center, one[bent, :2] - center, sense) for one in (end, here))
    foot[bent] = part / total
    foot[first], foot[-1] = 0.0, 1.0


def _angle(a: Array, b: Array, sense: Array) -> Array:
    """Angle [rad] in [0, 2π) from a to b in the given sense."""
    cross, dot = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)
    return np.asarray(np.mod(sense * np.arctan2(cross, dot), 2.0 * np.pi))
