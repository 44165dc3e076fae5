"""Whether two polylines are the same way: from end to end, in order, nowhere farther apart than a bound.

The Fréchet distance, decided by the reachable part of the free space: H. Alt, M. Godau, "Computing the
Fréchet distance between two polygonal curves", Int. J. Comput. Geom. Appl. 5 (1995). Only cells
that can be reached are looked at, which are few for curves that lie close together.
"""

from __future__ import annotations

import numpy as np

from ph_post.simulate.compiling import compiled, inner
from ph_post.types import Array, IntArray

_NONE = (2.0, -1.0)
"""An empty interval."""


@inner
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


@inner
def _first_apart(p: Array, q: Array, bound: float) -> int:
    """First point of q that is not near the first of p; q's size where a point of p is not near q's first."""
    for j in range(q.shape[0]):
        if _free(q[j], q[j], p[0], bound)[0] > 1.0:
            return j
    for i in range(p.shape[0]):
        if _free(p[i], p[i], q[0], bound)[0] > 1.0:
            return int(q.shape[0])
    return -1


@inner
def _left_edge(p: Array, q: Array, bound: float, low: Array, high: Array) -> int:
    """Move on along q while p waits at its first point; returns the last segment of q that is reached."""
    for j in range(q.shape[0] - 1):
        low[j], high[j] = _free(q[j], q[j + 1], p[0], bound)
        if low[j] > 0.0:
            return j - 1
        if high[j] < 1.0:
            return j
    return int(q.shape[0] - 2)


@inner
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


@inner
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
def follow(p: Array, p_first: IntArray, q: Array, q_first: IntArray, bound: Array) -> IntArray:
    """Decide for each pair of polylines whether they are within their bound of each other, in order.

    Parameters
    ----------
    p, q : ndarray, shape (n, 3)
        Points [m] of all polylines, one after the other.
    p_first, q_first : ndarray, shape (k + 1,)
        Where each begins. A polyline may be a single point, not empty.
    bound : ndarray, shape (k,)
        How far apart they may be [m].

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
        stuck[k] = _within(
            p[p_first[k] : p_first[k + 1]], q[q_first[k] : q_first[k + 1]], bound[k], low, high
        )
    return stuck
