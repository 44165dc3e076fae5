"""Places on a motion, parts of it, and their lengths."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ph_post.compiling import compiled, read_only
from ph_post.errors import InputError
from ph_post.gcode.program import ARC, CUBIC, NURBS, PLANE_AXES, Motions, PlaceArray, plane_columns
from ph_post.types import Array, IntArray


def split_cubic(control: Array, shares: Sequence[float]) -> list[Array]:
    """Return the control points (4, d) of the parts of a cubic Bézier between parameters, by de Casteljau.

    Examples
    --------
    >>> line = np.array([[0.0], [1.0], [2.0], [3.0]])
    >>> [part.ravel().tolist() for part in split_cubic(line, [0.0, 0.5, 1.0])]
    [[0.0, 0.5, 1.0, 1.5], [1.5, 2.0, 2.5, 3.0]]
    """
    return [
        np.array([_blossom(control, [low] * (3 - n) + [high] * n) for n in range(4)]) for low, high in pairwise(shares)
    ]


def _blossom(control: Array, parameters: Sequence[float]) -> Array:
    points = control
    for u in parameters:
        points = (1.0 - u) * points[:-1] + u * points[1:]
    return np.asarray(points[0])


def place(motions: Motions, k: int, share: float) -> Array:
    """Return the point [m] of a motion at a share of it, shape (3,).

    Raises
    ------
    InputError
        Inside a NURBS, which is not divided.
    """
    start, end = motions.start[k], motions.end[k]
    if share <= 0.0:
        return np.array(start)
    if share >= 1.0:
        return np.array(end)
    if motions.kind[k] == ARC:
        return _on_arc(motions, k, share)
    if motions.kind[k] == CUBIC:
        return _blossom(motions.control[k], [share] * 3)
    if motions.kind[k] == NURBS:
        raise InputError(f"block {motions.block[k] + 1}", "a NURBS cannot be divided", expected="its ends")
    return np.array(start + share * (end - start))


def _on_arc(motions: Motions, k: int, share: float) -> Array:
    """Point of an arc; on a quadrant it is exactly as far from the centre as the arc's start."""
    a, b, _ = PLANE_AXES[int(motions.plane[k])]
    point = motions.start[k] + share * (motions.end[k] - motions.start[k])
    x, y = motions.start[k][[a, b]] - motions.center[k]
    first = np.arctan2(y, x)
    x1, y1 = motions.end[k][[a, b]] - motions.center[k]
    radius = (1.0 - share) * np.hypot(x, y) + share * np.hypot(x1, y1)
    angle = first + share * motions.angle[k]
    point[[a, b]] = motions.center[k] + radius * np.array([np.cos(angle), np.sin(angle)])
    return np.asarray(point)


def part_length(motions: Motions, k: int, low: float, high: float) -> float:
    """Length of a part of a motion [m]; for a cubic, the length of a fine polygon."""
    if motions.kind[k] == CUBIC:
        points = np.nan_to_num([place(motions, k, u) for u in np.linspace(low, high, 65)])
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    if motions.kind[k] != ARC:
        way = motions.end[k] - motions.start[k]
        return float((high - low) * np.linalg.norm(np.nan_to_num(way) if np.isnan(way).any() else way))
    a, b, axis = PLANE_AXES[int(motions.plane[k])]
    start, end, center = motions.start[k], motions.end[k], motions.center[k]
    # As of many arcs, which takes ten times as long for one.
    swept = np.hypot(start[a] - center[0], start[b] - center[1]) * motions.angle[k]
    rise = end[axis] - start[axis]
    return float((high - low) * np.hypot(swept, 0.0 if np.isnan(rise) else rise))


def arc_lengths(motions: Motions, arcs: IntArray) -> Array:
    """Lengths [m] of arcs and helices by their numbers, shape (k,); an unknown rise does not count."""
    planes = plane_columns(motions.plane[arcs])
    start = np.take_along_axis(motions.start[arcs], planes[:, :2], axis=1) - motions.center[arcs]
    rise = np.take_along_axis(motions.end[arcs] - motions.start[arcs], planes[:, 2:], axis=1)[:, 0]
    swept = np.hypot(start[:, 0], start[:, 1]) * motions.angle[arcs]
    return np.asarray(np.hypot(swept, np.nan_to_num(rise)))


def chord_lengths(motions: Motions, rows: PlaceArray | slice = slice(None)) -> Array:
    """Return the distances of the ends of motions from their starts [m], shape (k,); an unknown way counts as 0."""
    return np.asarray(_chords(read_only(motions.start[rows]), read_only(motions.end[rows])))


@compiled
def _chords(start: Any, end: Any) -> Any:
    found = np.empty(start.shape[0])
    for n in range(found.size):
        square = 0.0
        for axis in range(3):
            way = end[n, axis] - start[n, axis]
            square += 0.0 if np.isnan(way) else way * way
        found[n] = np.sqrt(square)
    return found


def places_along(motions: Motions) -> Array:
    """Return where the motions begin along the program, and where the last one ends [m], shape (m + 1,).

    Within a motion places go by its share; a cubic counts with the length of its polygon.
    """
    length = chord_lengths(motions)
    arcs = np.flatnonzero(motions.kind == ARC)
    length[arcs] = arc_lengths(motions, arcs)
    for k, control in motions.control.items():
        length[k] = np.sqrt((np.diff(np.nan_to_num(control), axis=0) ** 2).sum(axis=1)).sum()
    found = np.zeros(length.size + 1)
    np.cumsum(np.nan_to_num(length, copy=False), out=found[1:])
    return found
