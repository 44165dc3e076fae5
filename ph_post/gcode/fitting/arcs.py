"""Find the arcs that explain short straight moves."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.gcode.fitting.samples import ROUND, STRAIGHT, is_flat
from ph_post.types import Array, BoolArray, IntArray

STEPS: Final = 5
"""Fewest steps of an arc or of a line that is found among short steps: fewer fit anything."""

WIDER: Final = 4.0
"""A stretch is looked at with so many times the tolerance too."""

FARTHER: Final = 1.15
"""With WIDER tolerance a stretch that is a true arc ends where it did, while one of a curve whose curvature
changes is longer by the cube root of WIDER, 1.59, and by its square root, 2, where a line is laid along it;
about an extremum of the curvature, or an inflection, from a start before it, by 1.2 or 1.3."""

BULGE: Final = 0.25
"""Part of the tolerance that a line may bulge which ends only with the run: the vertices of a line are off it
by rounding, either way, and those of a curve all to one side."""

SPILT: Final = 0.1
"""Part of a stretch, and two steps besides, that is given back at an end that is no corner: within the
tolerance it has run on into what comes next."""

WIDEST: Final = 0.6
"""Distance of a circle's centre from the chord, over its radius, on the side of the arc: at most 1.4 half
turns in one arc, beyond which its ends are too near to each other to determine the circle."""

MEETS_AT: Final = 5e-4
"""Angle [rad] by which neighbouring arcs may miss each other's tangents: half of what counts as a corner."""


@lean
def _circle(points: Array, i: int, j: int, out: Array) -> bool:
    """Find the circle through i and j nearest to what lies between, in `out`: centre, radius, sense; False if none.

    With y across the chord c and y_c the centre's place on its bisector, x² + y² - c²/4 = 2 y y_c on the
    circle: one unknown, by least squares.
    """
    ex, ey = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
    chord = math.sqrt(ex * ex + ey * ey)
    if chord == 0.0:
        return False
    ex, ey = ex / chord, ey / chord
    mx, my = 0.5 * (points[i, 0] + points[j, 0]), 0.5 * (points[i, 1] + points[j, 1])
    top, bottom, side = 0.0, 0.0, 0.0
    for k in range(i + 1, j):
        px, py = points[k, 0] - mx, points[k, 1] - my
        x, y = px * ex + py * ey, py * ex - px * ey
        top += y * (x * x + y * y - 0.25 * chord * chord)
        bottom += 2.0 * y * y
        side += y
    if bottom == 0.0 or side == 0.0:
        return False
    far = top / bottom
    sense = 1.0 if side > 0.0 else -1.0
    radius = math.sqrt(0.25 * chord * chord + far * far)
    out[0], out[1], out[2], out[3] = mx - far * ey, my + far * ex, radius, -sense
    return far * sense < WIDEST * radius


@lean
def _round_holds(points: Array, i: int, j: int, tolerance: float, out: Array) -> bool:
    """Return True if one arc from i to j explains what is between, each vertex ahead of the one before."""
    if not _circle(points, i, j, out):
        return False
    cx, cy, radius, sense = out[0], out[1], out[2], out[3]
    for k in range(i, j + 1):
        x, y = points[k, 0] - cx, points[k, 1] - cy
        if abs(math.sqrt(x * x + y * y) - radius) > tolerance:
            return False
        if k > i:
            u, v = points[k - 1, 0] - cx, points[k - 1, 1] - cy
            if sense * (u * y - v * x) <= 0.0:
                return False
    return True


@lean
def _straight_holds(points: Array, i: int, j: int, tolerance: float) -> bool:
    ex, ey, ez = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    if size == 0.0:
        return False
    ex, ey, ez = ex / size, ey / size, ez / size
    before = 0.0
    for k in range(i + 1, j + 1):
        x, y, z = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
        along = x * ex + y * ey + z * ez
        if along <= before or x * x + y * y + z * z - along * along > tolerance * tolerance:
            return False
        before = along
    return True


@lean
def _holds(points: Array, i: int, j: int, tolerance: float, kind: int, out: Array) -> bool:
    if kind == STRAIGHT:
        return _straight_holds(points, i, j, tolerance)
    return _round_holds(points, i, j, tolerance, out)


@lean
def _reach(points: Array, i: int, j: int, last: int, tolerance: float, kind: int, out: Array) -> int:
    """Find the farthest vertex, from j on, up to which one line or arc from i holds; i where none does."""
    if not _holds(points, i, j, tolerance, kind, out):
        return i
    bad = last + 1
    while j < last:
        ahead = min(last, j + max(1, (j - i) // 2))
        if not _holds(points, i, ahead, tolerance, kind, out):
            bad = ahead
            break
        j = ahead
    while bad - j > 1:
        middle = (j + bad) // 2
        if _holds(points, i, middle, tolerance, kind, out):
            j = middle
        else:
            bad = middle
    return j


@lean
def _found(
    points: Array, along: Array, first: int, i: int, last: int, tolerance: float, kind: int, out: Array
) -> tuple[int, int]:
    """End of a true line or arc from i, i where there is none; and how far the tolerance alone would go."""
    if i + STEPS > last:
        return i, i
    j = _reach(points, i, i + 3, last, tolerance, kind, out)
    if j < i + STEPS:
        return i, j
    if kind == STRAIGHT and j == last and i > first and _bulge(points, i, j) > BULGE * tolerance:
        return i, j
    wider = j
    if j < last and not _is_wide(points, i, j, kind, out):
        wider = _reach(points, i, j, last, WIDER * tolerance, kind, out)
    return (j if along[wider] - along[i] <= FARTHER * (along[j] - along[i]) else i), j


@inner
def _bulge(points: Array, i: int, j: int) -> float:
    """Height of the parabola over the chord from i to j that is as high on the mean as the vertices are."""
    chord, total, along, size = np.zeros(3), np.zeros(3), 0.0, 0.0
    for axis in range(3):
        chord[axis] = points[j, axis] - points[i, axis]
        for k in range(i + 1, j):
            total[axis] += points[k, axis] - points[i, axis]
        along += total[axis] * chord[axis]
        size += chord[axis] * chord[axis]
    square = 0.0
    for axis in range(3):
        square += (total[axis] - along / size * chord[axis]) ** 2
    return 1.5 * math.sqrt(square) / (j - i - 1)


@lean
def _is_wide(points: Array, i: int, j: int, kind: int, out: Array) -> bool:
    """Return True if an arc ends only because it is as long as an arc may be: more than half a turn."""
    if kind == STRAIGHT or not _circle(points, i, j, out):
        return False
    ex, ey = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
    mx, my = 0.5 * (points[i, 0] + points[j, 0]), 0.5 * (points[i, 1] + points[j, 1])
    return bool(out[3] * (ex * (out[1] - my) - ey * (out[0] - mx)) < 0.0)


@lean
def _end_tangents(points: Array, i: int, j: int, kind: int, circle: Array, out: Array) -> None:
    """Write the unit tangents of a line or an arc at both its ends."""
    for end in range(2):
        k = i if end == 0 else j
        if kind == STRAIGHT:
            for axis in range(3):
                out[end, axis] = points[j, axis] - points[i, axis]
        else:
            out[end, 0] = -circle[3] * (points[k, 1] - circle[1])
            out[end, 1] = circle[3] * (points[k, 0] - circle[0])
            out[end, 2] = 0.0
        size = math.sqrt(out[end, 0] ** 2 + out[end, 1] ** 2 + out[end, 2] ** 2)
        for axis in range(3):
            out[end, axis] /= size


@lean
def _apart(a: Array, b: Array) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@lean
def _set_tangents(tangent: Array, ends: Array, a: int, b: int, first: int, last: int) -> None:
    """Give the vertices a and b the tangents of what runs between them, on both sides inside a run."""
    for axis in range(3):
        tangent[a, 1, axis], tangent[b, 0, axis] = ends[0, axis], ends[1, axis]
        if a > first:
            tangent[a, 0, axis] = ends[0, axis]
        if b < last:
            tangent[b, 1, axis] = ends[1, axis]


@compiled
def _scan(
    points: Array,
    along: Array,
    tangent: Array,
    corners: BoolArray,
    lines: BoolArray,
    cuts: BoolArray,
    tolerance: float,
    kinds: IntArray,
    firsts: IntArray,
    lasts: IntArray,
    circles: Array,
) -> int:
    n, count, first = len(points), 0, 0
    circle, ends = np.zeros(4), np.zeros((2, 3))
    while first < n - 1:
        last = first + 1
        while last < n - 1 and lines[first] == lines[last] and not corners[last] and not cuts[last]:
            last += 1
        if lines[first]:
            first = last
            continue
        flat = is_flat(points, first, last)
        i, joined = first, corners[first]
        while i < last:
            kind = STRAIGHT
            j, reached = _found(points, along, first, i, last, tolerance, kind, circle)
            if j == i and flat:
                kind = ROUND
                j, reached = _found(points, along, first, i, last, tolerance, kind, circle)
            if j == i:
                i, joined = i + max(1, (reached - i) // 2), False
                continue
            wide = _is_wide(points, i, j, kind, circle)
            spilt = 2 + int(SPILT * (j - i))
            _ends_of(points, i, j, kind, circle, tolerance, ends)
            a = i if joined or (i == first and _apart(ends[0], tangent[i, 1]) <= MEETS_AT) else i + spilt
            b = j
            if not wide and not (j == last and (corners[j] or _apart(ends[1], tangent[j, 0]) <= MEETS_AT)):
                b = j - spilt
            if b - a < STEPS or not _ends_of(points, a, b, kind, circle, tolerance, ends):
                i, joined = j, False
                continue
            if count > 0 and lasts[count - 1] == a and _apart(ends[0], tangent[a, 0]) > MEETS_AT:
                i, joined = i + spilt, False
                continue
            _set_tangents(tangent, ends, a, b, first, last)
            kinds[count], firsts[count], lasts[count] = kind, a, b
            for k in range(4):
                circles[count, k] = circle[k]
            count += 1
            i, joined = b, wide
        first = last
    return count


@lean
def _ends_of(points: Array, i: int, j: int, kind: int, circle: Array, tolerance: float, ends: Array) -> bool:
    """Write the end tangents of a line or an arc from i to j, and return True if it holds."""
    good = _holds(points, i, j, tolerance, kind, circle)
    _end_tangents(points, i, j, kind, circle, ends)
    return good


def find_arcs(
    points: Array,
    along: Array,
    tangent: Array,
    corners: BoolArray,
    lines: BoolArray,
    cuts: BoolArray,
    tolerance: float,
) -> tuple[IntArray, IntArray, IntArray, Array]:
    """Find the true lines and arcs among the samples of curves.

    Parameters
    ----------
    points, along, tangent, corners, lines
        See :func:`ph_post.gcode.fitting.polyline.find_tangents`; the tangents at the ends of what is found
        are set to its own.
    cuts : BoolArray, shape (n,)
        Vertices that no piece may run across.
    tolerance : float
        How far vertices may be off [m].

    Returns
    -------
    kind, first, last : IntArray, shape (p,)
        STRAIGHT or ROUND, and the vertices at both ends.
    circle : Array, shape (p, 4)
        Of arcs: centre [m], radius [m], and 1 where they turn from the first axis to the second, else -1.
    """
    most = len(points) // STEPS + 1
    kinds, firsts, lasts = (np.zeros(most, dtype=np.int64) for _ in range(3))
    circles = np.zeros((most, 4))
    count = _scan(points, along, tangent, corners, lines, cuts, tolerance, kinds, firsts, lasts, circles)
    return kinds[:count], firsts[:count], lasts[:count], circles[:count]
