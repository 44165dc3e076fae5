"""An axis with ideal backlash behind its motor, and how far its way is along another one.

The motor follows its command exactly, and friction holds the table wherever the backlash lets it: the table moves
only while the motor pushes it. Along straight lines that way is straight between known points, so nothing is sampled.
"""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.compiling import compiled, lean
from ph_post.types import Array, IntArray

_MOST = 4
"""A line of the motor is cut in no more pieces: each of three axes may take up its table once."""

_SHORTER = 1.5
"""The original is no longer, between two points of the table, than this many times the way between them."""

_REACH = 4.0
"""Multiples of the bound by which the search goes beyond that."""


class TableWay(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Ways of the table behind k polylines of the motor.

    `points` (n, 3) [m], those of polyline i from ``first[i]`` on; `owner` (n,) the point of the motor at which
    the line ends on which the table is there; `place` (m,) the point of the table for each point of the motor;
    `turned` (m, 3) +1 or -1 where the motor comes to the other side of an axis' backlash on the line to it.
    """

    points: Array
    first: IntArray
    owner: IntArray
    place: IntArray
    turned: NDArray[np.int8]


def follow_play(motor: Array, first: IntArray, sides: Array, start: Array, spare: Array) -> TableWay:
    """Return the ways of the table behind polylines of the motor.

    Parameters
    ----------
    motor : Array, shape (m, 3)
        Points of all polylines, one after the other [m].
    first : IntArray, shape (k + 1,)
        Where each begins.
    sides : Array, shape (k, 3, 2)
        What the motor is ahead of the table while it pushes it to minus, and to plus [m]; the same number twice
        for an axis without backlash.
    start : Array, shape (k, 3)
        What it is ahead at first [m].
    spare : Array, shape (k,)
        Distance from a side of the backlash that counts as being there [m].
    """
    points, owner, place, turned, ends = _follow(motor, first, sides, start, spare)
    return TableWay(points=points, first=ends, owner=owner, place=place, turned=turned)


@compiled
def _follow(motor: Any, first: Any, sides: Any, start: Any, spare: Any) -> Any:
    points = np.empty((_MOST * motor.shape[0], 3))
    owner = np.empty(_MOST * motor.shape[0], dtype=np.int64)
    place = np.empty(motor.shape[0], dtype=np.int64)
    turned = np.zeros((motor.shape[0], 3), dtype=np.int8)
    ends = np.zeros(first.size, dtype=np.int64)
    table, cuts, side = np.empty(3), np.empty(_MOST), np.zeros(3, dtype=np.int64)
    n = 0
    for k in range(first.size - 1):
        for a in range(3):
            table[a] = motor[first[k], a] - start[k, a]
            # A motor that has come back a little, as behind the lowest point of an arc, is on its side all the same.
            side[a] = _side_of(start[k, a], sides[k, a], math.inf)
            points[n, a] = table[a]
        owner[n], place[first[k]] = first[k], n
        n += 1
        for m in range(first[k] + 1, first[k + 1]):
            for a in range(3):
                way = motor[m, a] - motor[m - 1, a]
                touch = table[a] + (sides[k, a, 1] if way > 0.0 else sides[k, a, 0])
                cuts[a] = (touch - motor[m - 1, a]) / way if way != 0.0 else 1.0
            cuts[3] = 1.0
            cuts.sort()
            for c in range(_MOST):
                if c < _MOST - 1 and (cuts[c] <= 0.0 or cuts[c] >= 1.0):
                    continue
                for a in range(3):
                    there = motor[m - 1, a] + cuts[c] * (motor[m, a] - motor[m - 1, a]) if c < 3 else motor[m, a]
                    points[n, a] = min(max(table[a], there - sides[k, a, 1]), there - sides[k, a, 0])
                owner[n] = m
                n += 1
            place[m] = n - 1
            for a in range(3):
                table[a] = points[n - 1, a]
                now = _side_of(motor[m, a] - table[a], sides[k, a], spare[k])
                if now * side[a] < 0:
                    turned[m, a] = now
                side[a] = now if now != 0 else side[a]
        ends[k + 1] = n
    return points[:n].copy(), owner[:n].copy(), place, turned, ends


@lean
def _side_of(ahead: float, sides: Any, spare: float) -> int:
    """Return the side on which the motor touches the table, 0 where it touches none or there is no backlash."""
    near = min(spare, 0.1 * (sides[1] - sides[0]))
    if sides[1] <= sides[0]:
        return 0
    return 1 if ahead >= sides[1] - near else -1 if ahead <= sides[0] + near else 0


@compiled
def possible_sides(ends: Any, chain: Any, swings: Any, sides: Any) -> Array:
    """Return what the motor of an axis may be ahead of its table before each motion, least and most [m], (k, 2).

    Nothing is known at the beginning of a chain.

    Parameters
    ----------
    ends : tuple of Array, shape (k,)
        Positions of the axis at start and end [m].
    chain : IntArray, shape (k,)
        Number of the chain of each motion.
    swings : tuple of Array
        Of :func:`ph_post.verify.path.swings_of`.
    sides : tuple of float
        What it is ahead while it moves to minus, and to plus [m].
    """
    out = np.empty((chain.size, 2))
    low, high = sides[0], sides[1]
    number, middle, radius, begin, sweep = swings
    for k in range(chain.size):
        if k == 0 or chain[k] != chain[k - 1]:
            low, high = sides[0], sides[1]
        out[k, 0], out[k, 1] = low, high
        at, end = ends[0][k], ends[1][k]
        if math.isnan(at) or math.isnan(end):
            low, high = (low, high) if math.isnan(end) else (sides[0], sides[1])
            continue
        arc = number[k] - 1
        if arc >= 0 and radius[arc] > 0.0:
            step = 1.0 if sweep[arc] > 0.0 else -1.0
            n = math.floor(begin[arc]) + 1.0 if sweep[arc] > 0.0 else math.ceil(begin[arc]) - 1.0
            while (n - begin[arc] - sweep[arc]) * step < 0.0:
                there = middle[arc] + (radius[arc] if n % 2.0 == 0.0 else -radius[arc])
                low = min(max(low + there - at, sides[0]), sides[1])
                high = min(max(high + there - at, sides[0]), sides[1])
                at = there
                n += step
        low = min(max(low + end - at, sides[0]), sides[1])
        high = min(max(high + end - at, sides[0]), sides[1])
    return out


@lean
def _nearest(points: Any, k: int, along: Any, low: float, high: float, spot: Any) -> tuple[float, float]:
    """Return the place nearest to a spot on a line, from `low` to `high` along the polyline, and its distance [m]."""
    length = along[k + 1] - along[k]
    if length <= 0.0:
        share = 0.0
    else:
        dot = 0.0
        for a in range(3):
            dot += (spot[a] - points[k, a]) * (points[k + 1, a] - points[k, a])
        share = min(max(dot / (length * length), (low - along[k]) / length, 0.0), (high - along[k]) / length, 1.0)
    square = 0.0
    for a in range(3):
        apart = points[k, a] + share * (points[k + 1, a] - points[k, a]) - spot[a]
        square += apart * apart
    return along[k] + share * length, math.sqrt(square)


@lean
def _distance_to(a: Any, b: Any, spot: Any) -> float:
    """Return the distance [m] of a spot from the line between two points."""
    square, dot = 0.0, 0.0
    for k in range(3):
        square += (b[k] - a[k]) * (b[k] - a[k])
        dot += (spot[k] - a[k]) * (b[k] - a[k])
    share = min(max(dot / square, 0.0), 1.0) if square > 0.0 else 0.0
    rest = 0.0
    for k in range(3):
        apart = a[k] + share * (b[k] - a[k]) - spot[k]
        rest += apart * apart
    return math.sqrt(rest)


@compiled
def align(way: Any, way_first: Any, along: Any, table: Any, table_first: Any, bound: Any) -> Any:
    """Find where the points of other polylines are along given ones, in order of travel.

    Parameters
    ----------
    way : Array, shape (n, 3)
        Points [m] of the polylines to be followed; those of polyline i from ``way_first[i]`` on, `along` (n,) [m] from
        its beginning.
    table, table_first : Array, IntArray
        The others, as many.
    bound : Array, shape (k,)
        Distance [m] that counts as being there.

    Returns
    -------
    tuple of Array, shape (m,)
        Place of each point along its polyline [m], and the distance [m] of the other one on the way to it: from its
        end, and from what is passed, to the line on which it goes.
    """
    place, apart = np.zeros(table.shape[0]), np.zeros(table.shape[0])
    for i in range(table_first.size - 1):
        low, high = way_first[i], way_first[i + 1]
        k, passed, at, total = low, low, 0.0, along[high - 1]
        for j in range(table_first[i], table_first[i + 1]):
            if high - low == 1:
                apart[j] = _distance_to(way[low], way[low], table[j])
                continue
            step = 0.0
            if j > table_first[i]:
                step = _distance_to(table[j - 1], table[j - 1], table[j])
            begin = min(at + max(step - 2.0 * bound[i], 0.0), total)
            finish = min(at + _SHORTER * step + _REACH * bound[i], total) if j > table_first[i] else 0.0
            begin = min(begin, finish)
            while k < high - 2 and along[k + 1] < begin:
                k += 1
            best, found = math.inf, at
            n = k
            while n < high - 1 and (along[n] <= finish or n == k):
                spot, gap = _nearest(way, n, along, begin, finish, table[j])
                if gap < best - 1e-12:
                    best, found = gap, spot
                elif best <= bound[i] and gap > best + bound[i]:
                    break
                n += 1
            while passed < high and along[passed] < found:
                if along[passed] > at and j > table_first[i]:
                    best = max(best, _distance_to(table[j - 1], table[j], way[passed]))
                passed += 1
            at = max(at, found)
            place[j], apart[j] = at, best
            while k < high - 2 and along[k + 1] < at:
                k += 1
    return place, apart


@compiled
def nearest_there(way: Any, way_first: Any, along: Any, which: Any, span: Any, spot: Any) -> Array:
    """Return how far spots (q, 3) are from stretches of polylines [m], shape (q,).

    `which` (q,) the polyline of each, `span` (q, 2) the stretch [m] along it; the others as in :func:`align`.
    """
    out = np.empty(which.size)
    for q in range(which.size):
        low, high = way_first[which[q]], way_first[which[q] + 1]
        if high - low == 1:
            out[q] = _distance_to(way[low], way[low], spot[q])
            continue
        begin, finish = max(span[q, 0], 0.0), min(span[q, 1], along[high - 1])
        k = max(low, low + np.searchsorted(along[low:high], begin, side="right") - 1)
        k = min(k, high - 2)
        best = math.inf
        while k < high - 1 and (along[k] <= finish or best == math.inf):
            best = min(best, _nearest(way, k, along, begin, finish, spot[q])[1])
            k += 1
        out[q] = best
    return out
