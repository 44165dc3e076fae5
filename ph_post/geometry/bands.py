"""Compiled distance of points from the band between two ways that are run side by side.

All functions stand in this file, as numba's cache looks at the file of the entry points alone.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.types import Array, IntArray

STEP: Final = 1e-8
"""Steps of a band that are shorter in all [m] are one: at rests and at ends a command comes to a place for long."""

THINNED: Final = 1e-6
"""Steps of a band [m] up to which several that are straight are one: what it takes is not up to how slow a way is."""

STRAIGHT: Final = 1e-10
"""Distance [m] from the straight way within which such steps are."""

FLAT: Final = 1e-12
"""Squared sine of a triangle's angle below which its edges are all that there is of it."""


BOX: Final = 64
"""Rows of a band that share a box, which is looked at before they are."""


class Band:
    """The band between two ways that are run side by side.

    It is what lies between the same rows of both: a surface of triangles, which may be as narrow as a line.

    Parameters
    ----------
    one, other : Array, shape (m, 3)
        The ways [m].
    """

    def __init__(self, one: Array, other: Array) -> None:
        steps = [np.sqrt((np.diff(way, axis=0) ** 2).sum(axis=1)) for way in (one, other)]
        ways = np.concatenate([[0.0], np.cumsum(np.maximum(*steps))])
        self._kept = np.flatnonzero(np.diff(np.floor(ways / STEP), prepend=-1.0))
        kept = (np.ascontiguousarray(values[self._kept]) for values in (one, other, ways))
        self._kept = self._kept[_needed(*kept)]
        self._one, self._other, self._ways = (np.ascontiguousarray(values[self._kept]) for values in (one, other, ways))
        self._low = -_highest(np.maximum(-self._one, -self._other))
        self._high = _highest(np.maximum(self._one, self._other))

    def distances(self, points: Array, rows: IntArray, reach: float) -> Array:
        """Distances of points from the band, near the rows of its ways that the points belong to.

        Parameters
        ----------
        points : Array, shape (n, 3)
            [m].
        rows : IntArray, shape (n,)
            A row of the ways for each point.
        reach : float
            How far before and behind its row a point may be [m], along the longer of the ways.

        Returns
        -------
        Array, shape (n,)
            [m].

        Examples
        --------
        >>> way = np.stack([np.linspace(0.0, 1.0, 11), np.zeros(11), np.zeros(11)], axis=1)
        >>> points = np.array([[0.52, 0.3, 0.0], [0.52, -0.1, 0.0]])
        >>> Band(way, way + [0.0, 0.2, 0.0]).distances(points, np.array([5, 5]), 0.5).round(6).tolist()
        [0.1, 0.1]
        """
        near = np.searchsorted(self._kept, rows, side="right") - 1
        boxes = self._low, self._high
        return _distances(np.ascontiguousarray(points), near, self._one, self._other, self._ways, boxes, reach)


def _highest(places: Array) -> Array:
    """Return the highest of each coordinate in every box: it goes from its first row to that of the following one."""
    begins = np.arange(0, len(places), BOX)
    found = np.maximum.reduceat(places, begins, axis=0)
    found[:-1] = np.maximum(found[:-1], places[begins[1:]])
    return found


@compiled
def _needed(one: Array, other: Array, ways: Array) -> IntArray:
    """Return the rows without which a band would be another, the first and the last among them."""
    kept, count, row = np.empty(ways.size, dtype=np.int64), 0, 0
    while row < ways.size:
        kept[count], span = row, 1
        count += 1
        while row + 2 * span < ways.size and ways[row + 2 * span] - ways[row] <= THINNED:
            if not _is_straight(one, other, ways, row, row + 2 * span):
                break
            span *= 2
        row += span
    return kept[:count]


@lean
def _is_straight(one: Array, other: Array, ways: Array, first: int, last: int) -> bool:
    """Return whether both ways go straight on between two rows, side by side."""
    for axis in range(3):
        begin, way = one[first, axis], one[last, axis] - one[first, axis]
        other_begin, other_way = other[first, axis], other[last, axis] - other[first, axis]
        if abs(way - other_way) > STRAIGHT:
            return False
        for row in range(first + 1, last):
            share = (ways[row] - ways[first]) / (ways[last] - ways[first])
            off = abs(one[row, axis] - begin - share * way)
            if max(off, abs(other[row, axis] - other_begin - share * other_way)) > STRAIGHT:
                return False
    return True


@compiled
def _distances(
    points: Array, near: IntArray, one: Array, other: Array, ways: Array, boxes: tuple[Array, Array], reach: float
) -> Array:
    found = np.empty(points.shape[0])
    for n in range(points.shape[0]):
        point, begin = points[n], near[n]
        first = _nearest_in_boxes(point, begin, one, other, ways, boxes, reach)
        least = min(first, _from_line(point, one[begin], other[begin]))
        for step in (1, -1):
            row, away, box = begin, _from_line(point, one[begin], other[begin]), -1
            while 0 <= row + step < ways.size and abs(ways[row] - ways[begin]) <= reach:
                following = row + step
                apart = abs(ways[following] - ways[row])
                own = min(row, following) // BOX
                # What is too far away for anything as near as what is known is passed over, by ever longer steps.
                if apart < away - least:
                    beyond = row + 2 * step
                    while 0 <= beyond < ways.size and abs(ways[beyond] - ways[row]) < away - least:
                        following, beyond = beyond, 2 * beyond - row
                    away -= abs(ways[following] - ways[row])
                elif own != box and _from_box(point, boxes, own) > least:
                    following = min(BOX * (own + 1), ways.size - 1) if step > 0 else BOX * own
                    away = _from_box(point, boxes, own)
                else:
                    box = own
                    away = _from_line(point, one[following], other[following])
                    least = min(least, away)
                    if apart >= away - least:
                        k = min(row, following)
                        least = min(least, _from_sides(point, one[k], other[k], one[k + 1], other[k + 1]))
                row = following
        found[n] = least
    return found


@inner
def _nearest_in_boxes(
    point: Array, begin: int, one: Array, other: Array, ways: Array, boxes: tuple[Array, Array], reach: float
) -> float:
    """Distance of a point from some row that is about the nearest, where there are many; infinite where there are few.

    A point far away is nearly as far from all of them, so that each would have to be looked at.
    """
    first = np.searchsorted(ways, ways[begin] - reach)
    last = np.searchsorted(ways, ways[begin] + reach, side="right") - 1
    least, nearest = math.inf, -1
    if last - first <= 4 * BOX:
        return least
    for box in range(first // BOX + 1, last // BOX):
        away = _from_box(point, boxes, box)
        if away < least:
            least, nearest = away, box
    found = math.inf
    for row in range(BOX * nearest, BOX * nearest + BOX):
        found = min(found, _from_line(point, one[row], other[row]))
    return found


@lean
def _from_box(point: Array, boxes: tuple[Array, Array], box: int) -> float:
    """Return a distance of a point than which nothing in a box is nearer, but for rounding."""
    low, high = boxes
    square = 0.0
    for k in range(3):
        square += max(low[box, k] - point[k], point[k] - high[box, k], 0.0) ** 2
    return math.sqrt(square)


@lean
def _from_sides(point: Array, a: Array, b: Array, c: Array, d: Array) -> float:
    """Distance of a point from what lies between a line from a to b and the following from c to d, but for these."""
    along = min(_from_line(point, a, c), _from_line(point, a, d), _from_line(point, b, d))
    return min(along, _from_inside(point, a, b, d), _from_inside(point, a, d, c))


@lean
def _from_line(point: Array, a: Array, b: Array) -> float:
    square, dot = 0.0, 0.0
    for k in range(3):
        square += (b[k] - a[k]) ** 2
        dot += (b[k] - a[k]) * (point[k] - a[k])
    share = min(max(dot / square, 0.0), 1.0) if square > 0.0 else 0.0
    distance = 0.0
    for k in range(3):
        distance += (point[k] - a[k] - share * (b[k] - a[k])) ** 2
    return math.sqrt(distance)


@lean
def _from_inside(point: Array, a: Array, b: Array, c: Array) -> float:
    """Distance of a point from a triangle where the foot of its perpendicular is inside, else infinity."""
    uu, uv, vv, up, vp = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        u, v, p = b[k] - a[k], c[k] - a[k], point[k] - a[k]
        uu, uv, vv, up, vp = uu + u * u, uv + u * v, vv + v * v, up + u * p, vp + v * p
    area = uu * vv - uv * uv
    if area <= FLAT * uu * vv or area <= 0.0:
        return math.inf
    first, second = (vv * up - uv * vp) / area, (uu * vp - uv * up) / area
    if first < 0.0 or second < 0.0 or first + second > 1.0:
        return math.inf
    distance = 0.0
    for k in range(3):
        distance += (point[k] - a[k] - first * (b[k] - a[k]) - second * (c[k] - a[k])) ** 2
    return math.sqrt(distance)
