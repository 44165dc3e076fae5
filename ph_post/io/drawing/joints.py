"""Making one shape begin where the one before ends, moving no point by more than a tolerance.

Points are moved only where they are farther apart than the path file's 1e-6 mm, and then meet exactly.
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.io.drawing.shapes import Shape, angles, line, radius_of, reach, transformed, with_ends
from ph_post.types import Array

SAME: Final = 0.5e-6
"""Ends that are no farther apart are left as they are [mm]: half of what a path file allows."""


class Joint(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Two shapes that meet, what had to be put between them, and how far a point was moved at most."""

    before: Shape
    between: Shape | None
    after: Shape
    moved: float


def gap_of(before: Shape, after: Shape) -> float:
    """Return the distance from the end of one shape to the start of the other."""
    return float(np.linalg.norm(after.start - before.end))


def meet(before: Shape, after: Shape, same: float, most: float) -> Joint:
    """Close the gap between two shapes.

    Both go half the way; but an arc stays as it is where the other shape is none. Two arcs are moved with
    their angles kept where that moves none of their points too far; else, and where a shape is hardly longer
    than the gap, a line bridges it.

    Parameters
    ----------
    before, after : Shape
        In this order.
    same : float
        Distance up to which nothing need be done, in the shapes' unit.
    most : float
        How far a point may go, both ends' moves together.
    """
    gap = gap_of(before, after)
    if gap <= same:
        return Joint(before=before, between=None, after=after, moved=0.0)
    middle = 0.5 * (before.end + after.start)
    if before.kind == "arc" and after.kind != "arc":
        middle = before.end
    elif after.kind == "arc" and before.kind != "arc":
        middle = after.start
    left = _moved(before, before.start, middle, gap, most)
    right = _moved(after, middle, after.end, gap, most)
    if left is None or right is None:
        return Joint(before=before, between=line(before.end, after.start), after=after, moved=0.0)
    return Joint(before=left[0], between=None, after=right[0], moved=max(left[1], right[1]))


def close(shape: Shape, same: float) -> list[Shape]:
    """Close the gap between the end and the start of one shape; see :func:`meet`."""
    if gap_of(shape, shape) <= same:
        return [shape]
    if shape.kind in {"line", "arc"} or reach(shape) <= 4.0 * gap_of(shape, shape):
        return [shape, line(shape.end, shape.start)]
    middle = 0.5 * (shape.start + shape.end)
    return [with_ends(shape, middle, middle)]


def _moved(shape: Shape, start: Array, end: Array, gap: float, most: float) -> tuple[Shape, float] | None:
    """Move a shape's ends; None where a point would go too far, or the shape is too short for it."""
    moves = max(float(np.linalg.norm(start - shape.start)), float(np.linalg.norm(end - shape.end)))
    if moves == 0.0:
        return shape, 0.0
    if reach(shape) <= 4.0 * gap:
        return None
    if shape.kind != "arc":
        return with_ends(shape, start, end), moves
    # an arc moves as a whole, and once for each of its ends
    return _moved_arc(shape, start, end, 0.5 * most)


def _moved_arc(shape: Shape, start: Array, end: Array, most: float) -> tuple[Shape, float] | None:
    """Turn and scale an arc so that its ends go where they should, in the plane: z -> p z + q."""
    a, b = (complex(*point[:2]) for point in shape.points[:2])
    u, v = complex(*start[:2]), complex(*end[:2])
    if a == b or start[2] != shape.start[2] or end[2] != shape.end[2]:
        return None
    p = (v - u) / (b - a)
    q = u - p * a
    # |(p - 1) z + q| over the arc is at most what it is at the centre, and at a radius from there
    center = complex(*shape.points[2, :2])
    furthest = abs((p - 1.0) * center + q) + abs(p - 1.0) * radius_of(shape)
    if furthest > most:
        return None
    matrix = np.eye(4)
    matrix[:2, :2] = [[p.real, -p.imag], [p.imag, p.real]]
    matrix[:2, 3] = q.real, q.imag
    made = transformed(shape, matrix)
    exact = np.array(made.points)
    exact[0], exact[1] = start, end
    made = msgspec.structs.replace(made, points=exact)
    return (made, furthest) if abs(angles(made)[1] - angles(shape)[1]) < 1e-6 else None
