"""Compiled search for the closest points of a path of lines, arcs, helices, spirals and rational Bézier pieces.

A piece runs through a parameter s from 0 to its extent, which is what the caller likes: a length [m], or 1. All
functions stand in this file, as numba's cache looks at the file of the entry points alone.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.types import Array, IntArray

# Columns of a table of pieces; the first four are vectors.
ORIGIN, FIRST, SECOND, RISE = range(0, 12, 3)
RADIUS, SWEEP, EXTENT, GROWTH, SCALE, CONTROL, ORDER, COLUMNS = range(12, 20)

NEWTON: Final = 3
"""Steps of Newton's method towards the closest point of a helix or spiral; an arc needs none."""

GOLDEN: Final = 0.5 * (math.sqrt(5.0) - 1.0)

SECTIONS: Final = 48
"""Golden sections of a stretch of a Bézier piece: 1e-10 of it is left."""

PREFERENCE: Final = 0.3
"""Distance [m] that a place is worth per metre that it is off the way travelled."""

TRUST: Final = 0.1
"""Part of that by which the way travelled is corrected in every row: no command creeps back along a path unnoticed."""

SLACK: Final = 0.4
"""Distance along the other path within which a nearer place is sought, relative to the distance between them.

The alignment that makes the sum of all distances small is slack by about that much beside a corner. What goes
astray by d is still found to be off, by 0.6 d where it runs along the path itself.
"""

PROBES: Final = 256
"""Samples of a long reach that are looked at first."""

SAME: Final = 1e-6
"""Squared distances that differ by no more than this part of them are the same."""

NO_CONTROL: Final = np.zeros((0, 4))
"""The control points of a path without Bézier pieces."""


def make_pieces(count: int) -> Array:
    """Return an empty table of pieces, shape (count, COLUMNS).

    A line is ``origin + s first`` with SCALE = 1 / first². An arc has a RADIUS > 0 and is ``origin + p rise +
    radius (1 + p growth) (cos(p sweep) first + sin(p sweep) second)`` with p = s / EXTENT. A Bézier piece has ORDER > 0
    homogeneous control points (x w, y w, z w, w) from row CONTROL of a table of its own.
    """
    pieces = np.zeros((count, COLUMNS))
    pieces[:, EXTENT] = pieces[:, SCALE] = 1.0
    return pieces


@compiled
def points_at(pieces: Array, control: Array, row: IntArray, s: Array) -> Array:
    """Points (n, 3) [m] of the pieces `row` (n,) at the parameters `s` (n,)."""
    points = np.empty((row.size, 3))
    for k in range(row.size):
        _put_point(pieces, control, row[k], s[k], points[k])
    return points


@compiled
def pieces_at(starts: Array, place: Array) -> IntArray:
    """Return the piece (m,) of a path on which each place (m,) along it is [m], the first or last for one beyond it.

    Parameters
    ----------
    starts : Array, shape (n + 1,)
        As of :func:`follow_path`.
    place : Array, shape (m,)
        Quick where most are next to the one before.
    """
    found, piece = np.empty(place.size, dtype=np.int64), 0
    for row in range(place.size):
        piece = _piece_at(starts, place[row], piece)
        found[row] = piece
    return found


@compiled
def follow_path(
    pieces: Array, starts: Array, position: Array, low: Array, reach: float, wide: float
) -> tuple[IntArray, Array]:
    """Follow a command along a path of lines and arcs: the piece of every row, and how far along it is [m].

    Parameters
    ----------
    pieces : Array, shape (n, COLUMNS)
        Without a gap between them, their extents their lengths.
    starts : Array, shape (n + 1,)
        Length before each piece, and of all [m].
    position : Array, shape (m, 3)
        The command [m].
    low : Array, shape (m,)
        Place before which that of each row is not [m].
    reach, wide : float
        How far off the way travelled a place is looked for [m], and how far where none is found within
        `reach` of the command.
    """
    count = position.shape[0]
    piece, place = np.zeros(count, dtype=np.int64), np.zeros(count)
    work = np.empty(3)
    at, s, expected = 0, 0.0, 0.0
    for row in range(count):
        if row > 0:
            expected += math.sqrt(_square(position[row], position[row - 1]))
        s, expected = max(s, low[row]), max(expected, low[row])
        off, k, new = _best(pieces, starts, position[row], at, s, expected, low[row], reach, work)
        if off > reach * reach:
            off, k, new = _best(pieces, starts, position[row], at, s, expected, low[row], wide, work)
        at, s = k, new
        expected += TRUST * (s - expected)
        piece[row], place[row] = at, s
    return piece, place


@compiled
def closest_within(pieces: Array, starts: Array, position: Array, place: Array, reach: Array) -> tuple[Array, Array]:
    """Closest points of a path of lines and arcs to positions (m, 3), within `reach` (m,) of a `place` (m,) [m].

    Parameters
    ----------
    pieces, starts
        As of :func:`follow_path`.
    position, place, reach

    Returns
    -------
    distance, s : Array, shape (m,)
        Distances, and places along the path [m].
    """
    count, last = position.shape[0], pieces.shape[0] - 1
    distance, at = np.empty(count), np.empty(count)
    work, first = np.empty(3), 0
    for row in range(count):
        first = _piece_at(starts, place[row], first)
        best, at[row] = math.inf, place[row]
        k = first
        while k >= 0 and starts[k + 1] >= place[row] - reach[row]:
            square, s = _distance_to(pieces, k, position[row], place[row] - starts[k], work)
            if square < best:
                best, at[row] = square, starts[k] + s
            k -= 1
        k = first + 1
        while k <= last and starts[k] <= place[row] + reach[row]:
            square, s = _distance_to(pieces, k, position[row], place[row] - starts[k], work)
            if square < best:
                best, at[row] = square, starts[k] + s
            k += 1
        distance[row] = math.sqrt(best)
    return distance, at


@compiled
def closest_on(
    pieces: Array, starts: Array, position: Array, place: Array, first: IntArray, end: IntArray
) -> tuple[IntArray, Array]:
    """Closest points of some of the lines and arcs of a path to positions (m, 3), of turns that nearest to a `place`.

    Parameters
    ----------
    pieces, starts, position, place
        As of :func:`closest_within`.
    first, end : IntArray, shape (m,)
        The first of the pieces for each position, and the one behind the last.

    Returns
    -------
    piece : IntArray, s : Array, shape (m,)
        The piece of each, and how far along the path [m].
    """
    count = position.shape[0]
    piece, at = first.copy(), np.empty(count)
    work = np.empty(3)
    for row in range(count):
        best, at[row] = math.inf, starts[first[row]]
        for k in range(first[row], end[row]):
            square, s = _distance_to(pieces, k, position[row], place[row] - starts[k], work)
            if square < best:
                best, piece[row], at[row] = square, k, starts[k] + s
    return piece, at


@compiled
def closest_in_order(
    points: Array,
    reach: IntArray,
    pieces: Array,
    control: Array,
    piece: IntArray,
    s: Array,
    samples: Array,
    ways: Array,
) -> tuple[Array, IntArray, Array]:
    """Closest points of a path to other points, in the order of travel.

    Parameters
    ----------
    points : Array, shape (n, 3)
        [m].
    reach : IntArray, shape (n, 4)
        First and last sample of the path that each point belongs to, and those of their whole stretch.
    pieces, control
        The path.
    piece, s, samples, ways
        The path's samples: their pieces and parameters, the points (m, 3) [m] and the ways up to them (m,) [m].

    Returns
    -------
    tuple of Array (n, 3), IntArray (n,), Array (n,)
        The closest points [m], their pieces and parameters.
    """
    found, work = np.empty_like(points), np.empty(3)
    on, at = np.empty(points.shape[0], dtype=np.int64), np.empty(points.shape[0])
    for k in range(points.shape[0]):
        nearest = _nearest(points[k], reach[k, 0], reach[k, 1], samples)
        slack = SLACK * math.sqrt(_square(points[k], samples[nearest]))
        first, last = reach[k, 0], reach[k, 1]
        while first > reach[k, 2] and ways[reach[k, 0]] - ways[first - 1] <= slack:
            first -= 1
        while last < reach[k, 3] and ways[last + 1] - ways[reach[k, 1]] <= slack:
            last += 1
        nearest = _nearest(points[k], first, last, samples)
        least = _square(points[k], samples[nearest])
        found[k], on[k], at[k] = samples[nearest], piece[nearest], s[nearest]
        if last - first > PROBES:
            first, last = max(first, nearest - PROBES // 2), min(last, nearest + PROBES // 2)
        # A sample stands between two parts, and at a joint there are two samples: so two more on either side.
        for j in range(max(first - 1, 1), min(last + 3, piece.size)):
            if piece[j - 1] == piece[j] and s[j - 1] < s[j]:
                if math.sqrt(_square(points[k], samples[j])) - (ways[j] - ways[j - 1]) >= math.sqrt(least):
                    continue
                v = _closest_between(pieces, control, piece[j], points[k], s[j - 1], s[j], work)
                _put_point(pieces, control, piece[j], v, work)
                distance = _square(points[k], work)
                if distance < least:
                    least, on[k], at[k] = distance, piece[j], v
                    found[k] = work
    return found, on, at


@inner
def _piece_at(starts: Array, place: float, near: int) -> int:
    """Return the last piece that begins at a place or before it, which may be one that is near, or the following."""
    last = starts.size - 2
    for k in (near, near + 1):
        if k <= last and starts[k] <= place < starts[k + 1]:
            return k
    return min(max(int(np.searchsorted(starts, place, side="right")) - 1, 0), last)


@lean
def _square(x: Array, y: Array) -> float:
    """Squared distance of two points."""
    total = 0.0
    for k in range(3):
        total += (x[k] - y[k]) ** 2
    return total


@lean
def _put_point(pieces: Array, control: Array, row: int, s: float, out: Array) -> None:
    """Put the point of any piece at s into `out`."""
    if pieces[row, ORDER] > 0.0:
        first, order = int(pieces[row, CONTROL]), int(pieces[row, ORDER])
        _put_bezier(control[first : first + order], s / pieces[row, EXTENT], out)
    else:
        _put_on_arc(pieces, row, s, out)


@inner
def _put_bezier(control: Array, u: float, out: Array) -> None:
    """Put the point of a rational Bézier piece into `out`, by de Casteljau's steps."""
    points = control.copy()
    for level in range(control.shape[0] - 1, 0, -1):
        for i in range(level):
            for k in range(4):
                points[i, k] = (1.0 - u) * points[i, k] + u * points[i + 1, k]
    for k in range(3):
        out[k] = points[0, k] / points[0, 3]


@lean
def _put_on_arc(pieces: Array, row: int, s: float, out: Array) -> None:
    """Put the point of a line, arc, helix or spiral at s into `out`."""
    if pieces[row, RADIUS] == 0.0:
        for k in range(3):
            out[k] = pieces[row, ORIGIN + k] + s * pieces[row, FIRST + k]
        return
    part = s / pieces[row, EXTENT]
    angle = pieces[row, SWEEP] * part
    radius = pieces[row, RADIUS] * (1.0 + part * pieces[row, GROWTH])
    c, d = math.cos(angle), math.sin(angle)
    for k in range(3):
        out[k] = pieces[row, ORIGIN + k] + part * pieces[row, RISE + k]
        out[k] += radius * (c * pieces[row, FIRST + k] + d * pieces[row, SECOND + k])


@lean
def _closest_on_arc(pieces: Array, row: int, x: Array, near: float, low: float, high: float, work: Array) -> float:
    """Parameter between `low` and `high` where a line or planar arc is closest; of its turns that next to `near`."""
    along, across = 0.0, 0.0
    for k in range(3):
        along += (x[k] - pieces[row, ORIGIN + k]) * pieces[row, FIRST + k]
        across += (x[k] - pieces[row, ORIGIN + k]) * pieces[row, SECOND + k]
    if pieces[row, RADIUS] == 0.0:
        foot: float = min(max(along * pieces[row, SCALE], low), high)
        return foot
    sweep, extent = pieces[row, SWEEP], pieces[row, EXTENT]
    angle = math.atan2(across, along)
    turn = 2.0 * math.pi
    angle += turn * round((sweep * min(max(near, low), high) / extent - angle) / turn)
    s = angle / sweep * extent
    if s < low or s > high:
        _put_on_arc(pieces, row, low, work)
        to_begin = _square(x, work)
        _put_on_arc(pieces, row, high, work)
        to_end = _square(x, work)
        if abs(to_begin - to_end) <= SAME * to_begin:
            # Both ends of a full turn.
            s = low if near - low < high - near else high
        else:
            s = low if to_begin < to_end else high
    found: float = s
    return found


@lean
def _refined(pieces: Array, row: int, x: Array, s: float, low: float, high: float, work: Array) -> float:
    """Closest parameter of a helix or spiral by Newton's method, from that of the arc below it."""
    rise = abs(pieces[row, RISE + 0]) + abs(pieces[row, RISE + 1]) + abs(pieces[row, RISE + 2])
    if rise + abs(pieces[row, GROWTH]) == 0.0:
        return s
    rate = pieces[row, SWEEP] / pieces[row, EXTENT]
    widening = pieces[row, RADIUS] * pieces[row, GROWTH] / pieces[row, EXTENT]
    for _ in range(NEWTON):
        _put_on_arc(pieces, row, s, work)
        radius = pieces[row, RADIUS] + s * widening
        c, d = math.cos(rate * s), math.sin(rate * s)
        slope, bend = 0.0, 0.0
        for k in range(3):
            turned = c * pieces[row, SECOND + k] - d * pieces[row, FIRST + k]
            inward = c * pieces[row, FIRST + k] + d * pieces[row, SECOND + k]
            first = radius * rate * turned + pieces[row, RISE + k] / pieces[row, EXTENT] + widening * inward
            slope += (work[k] - x[k]) * first
            bend += first * first - (work[k] - x[k]) * radius * rate * rate * inward
            bend += 2.0 * (work[k] - x[k]) * widening * rate * turned
        if bend <= 0.0:
            break
        s = min(max(s - slope / bend, low), high)
    return s


@lean
def _closest_between(pieces: Array, control: Array, row: int, x: Array, low: float, high: float, work: Array) -> float:
    """Parameter of a short stretch of any piece that is closest to a point."""
    if pieces[row, ORDER] == 0.0:
        s = _closest_on_arc(pieces, row, x, 0.5 * (low + high), low, high, work)
        return _refined(pieces, row, x, s, low, high, work)
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    _put_point(pieces, control, row, left, work)
    at_left = _square(x, work)
    _put_point(pieces, control, row, right, work)
    at_right = _square(x, work)
    for _ in range(SECTIONS):
        if at_left <= at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            _put_point(pieces, control, row, left, work)
            at_left = _square(x, work)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            _put_point(pieces, control, row, right, work)
            at_right = _square(x, work)
    return 0.5 * (low + high)


@lean
def _distance_to(pieces: Array, row: int, x: Array, near: float, work: Array) -> tuple[float, float]:
    """Squared distance from a whole line or arc, and its parameter there."""
    extent = pieces[row, EXTENT]
    s = _closest_on_arc(pieces, row, x, near, 0.0, extent, work)
    s = _refined(pieces, row, x, s, 0.0, extent, work)
    _put_on_arc(pieces, row, s, work)
    return _square(x, work), s


@lean
def _best(
    pieces: Array,
    starts: Array,
    x: Array,
    at: int,
    s: float,
    expected: float,
    low: float,
    reach: float,
    work: Array,
) -> tuple[float, int, float]:
    """Squared distance, piece and place of the best place from `reach` before to `reach` behind s and the expected.

    It is not before `low`.
    """
    last = pieces.shape[0] - 1
    least, best, best_piece, best_s = math.inf, math.inf, at, s
    k = at
    while k > 0 and starts[k] > min(s, expected) - reach:
        k -= 1
    while k <= last and starts[k] <= max(s, expected) + reach:
        begin = max(low - starts[k], 0.0)
        if begin <= pieces[k, EXTENT]:
            local = _closest_on_arc(pieces, k, x, expected - starts[k], begin, pieces[k, EXTENT], work)
            _put_on_arc(pieces, k, local, work)
            off = PREFERENCE * (starts[k] + local - expected)
            square = _square(x, work)
            if square + off * off < best:
                least, best, best_piece, best_s = square, square + off * off, k, starts[k] + local
        k += 1
    return least, best_piece, best_s


@lean
def _nearest(point: Array, first: int, last: int, samples: Array) -> int:
    """Nearest of the samples `first` to `last`; of very many, the nearest around the nearest probe."""
    step = max((last - first) // PROBES, 1)
    nearest = _nearest_by(point, first, last, step, samples)
    if step > 1:
        nearest = _nearest_by(point, max(nearest - step, first), min(nearest + step, last), 1, samples)
    return nearest


@lean
def _nearest_by(point: Array, first: int, last: int, step: int, samples: Array) -> int:
    nearest, least = first, np.inf
    for j in range(first, last + 1, step):
        distance = _square(point, samples[j])
        if distance < least:
            nearest, least = j, distance
    return nearest
