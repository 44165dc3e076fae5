"""How far shapes reach."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ph_post.geometry.arc import Arc
from ph_post.geometry.base import PiecewiseCurve
from ph_post.geometry.curves import Bezier, Line
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.stationary import find_stationary
from ph_post.geometry.track import Track
from ph_post.io.drawing.shapes import Shape
from ph_post.types import Array
from ph_post.units import MM


def extents_of(shapes: Iterable[Shape]) -> Array | None:
    """Return the least and the largest coordinates, shape (2, 3), in the shapes' unit; None of nothing.

    Curves are looked at where they turn, not at samples or control points.
    """
    curves = [_curve(shape) for shape in shapes]
    if not curves:
        return None
    track = Track.from_curves(curves)
    turns = find_stationary(track)
    ends = np.arange(len(track.pieces))
    piece = np.concatenate([turns.piece, ends, ends])
    u = np.concatenate([turns.u, np.zeros(len(ends)), np.ones(len(ends))])
    places = track.derivatives(piece, u)[0] / MM
    return np.array([places.min(axis=0), places.max(axis=0)])


def _curve(shape: Shape) -> PiecewiseCurve:
    """Return the curve of a shape, its unit taken for mm."""
    points = shape.points * MM
    if shape.kind == "line":
        return Line(points)
    if shape.kind == "arc":
        return Arc(points[0], points[1], points[2], shape.turn)
    if shape.kind == "bezier":
        return Bezier(points)
    assert shape.knots is not None
    return Nurbs(len(shape.knots) - len(points) - 1, shape.knots, points, shape.weights)
