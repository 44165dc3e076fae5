"""How far a function stays below a level, going outward from where it is zero; many functions at a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import msgspec
import numpy as np

from ph_post.types import Array, BoolArray, IntArray

Function = Callable[[IntArray, Array], Array]
"""Values of the functions numbered by (n,) at their places (n, k), shape (n, k)."""

CELL: Final = np.array([0.5, 0.8, 1.0])
"""Where the way to the guess is looked at."""

GROWTH: Final = 1.4
"""Longest step outward, over the distance."""

SHRINK: Final = 0.1
"""Shortest step inward, where the function is above the level long before the guess."""

POWERS: Final = (1.0, 6.0)
"""A deviation grows with the third power of the distance or so; a secant far from that is not believed."""

LOW: Final = 0.1
"""Below this part of the level a function may do what it likes: it is far from crossing."""

FINE: Final = ((16, 0.8), (64, 0.98), (512, 1.0))
"""Places looked at where a function does not plainly rise, and how near to the level its maxima may then come
before more are: between two places it may lie above."""

CLOSE: Final = 1e-3
"""A crossing is solved until the value is within this part of the level, from below."""

STEPS: Final = 200
"""Bound on the steps of a search; bisection alone takes 50."""

GRAIN: Final = 1e-13
"""Relative width of a bracket that cannot be halved any more: there the function jumps."""


class _Search(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Searches under way, one a function.

    At `low` (value `below`) and all the way to it the function is not above the level, at `high` (value
    `above`) it is; `high` is infinite as long as no such place is known. `slope` is the last logarithmic
    slope, `plain` says whether the function has risen all the way.
    """

    reach: Array
    low: Array
    below: Array
    high: Array
    above: Array
    slope: Array
    plain: BoolArray


def first_crossings(function: Function, reach: Array, guess: Array, level: float) -> tuple[Array, BoolArray]:
    """Find how far every function stays at or below `level`, up to `reach`.

    A function that does not plainly rise (faster than the distance, as one that begins with a cube does) is
    looked at more densely.

    Parameters
    ----------
    function : callable
        Not negative, zero at 0.
    reach : Array, shape (n,)
        How far to look.
    guess : Array, shape (n,)
        Where the crossing may be, > 0; may be infinite.
    level : float
        > 0.

    Returns
    -------
    extent : Array, shape (n,)
        Where the function crosses the level: from below, between 0.999 of it and all of it.
    crossed : array of bool, shape (n,)
        Whether the function exceeds the level just behind; elsewhere `extent` is `reach`.

    Examples
    --------
    >>> extent, crossed = first_crossings(lambda k, t: t**3, np.array([1.0, 4.0]), np.array([1.0, 3.0]), 8.0)
    >>> extent.round(2).tolist(), crossed.tolist()
    ([1.0, 2.0], [False, True])
    """
    search = _Search(
        reach=reach,
        low=np.zeros(reach.size),
        below=np.zeros(reach.size),
        high=np.full(reach.size, np.inf),
        above=np.full(reach.size, np.inf),
        slope=np.full(reach.size, 3.0),
        plain=np.ones(reach.size, dtype=bool),
    )
    _begin(function, search, np.minimum(reach, guess), level)
    _finish(function, search, np.flatnonzero(reach > 0.0), level)
    doubtful = np.flatnonzero(~search.plain)
    for count, near in FINE:
        doubtful = _look_again(function, search, doubtful, count, level, near)
    return search.low, np.isfinite(search.high) | (search.below >= (1.0 - CLOSE) * level)


def _begin(function: Function, search: _Search, end: Array, level: float) -> None:
    """Look at the way to `end`, or less far where that turns out to be too far."""
    on = np.flatnonzero(end > 0.0)
    for _ in range(STEPS):
        t = end[on, None] * CELL
        v = function(on, t)
        over = v > level
        first = np.where(over.any(axis=1), over.argmax(axis=1), CELL.size)
        early = first == 0
        # The last two places before the level is exceeded, or the one before and the one behind.
        k = np.clip(first, 1, CELL.size - 1)[:, None]
        (t0, t1), (v0, v1) = (
            (np.take_along_axis(x, k - 1, 1)[:, 0], np.take_along_axis(x, k, 1)[:, 0]) for x in (t, v)
        )
        search.slope[on] = _slope(t0, v0, t1, v1)
        last = ~over[:, -1] & ~early
        search.low[on], search.below[on] = np.where(last, t1, t0), np.where(last, v1, v0)
        met = (first < CELL.size) & ~early
        search.high[on[met]], search.above[on[met]] = t1[met], v1[met]
        falls = (v[:, 1:] * t[:, :-1] < v[:, :-1] * t[:, 1:]) & (v[:, :-1] > LOW * level)
        search.plain[on] = ~np.any(falls & (np.arange(1, CELL.size) <= first[:, None]), axis=1)
        on, v0 = on[early], v[early, 0]
        if on.size == 0:
            return
        end[on] *= CELL[0] * np.clip(np.cbrt(level / v0), SHRINK, 1.0)
    search.low[on] = search.below[on] = 0.0


def _finish(function: Function, search: _Search, on: IntArray, level: float) -> None:
    """Step outward, and into the bracket once there is one, until the level is met or the reach is."""
    for step in range(STEPS):
        low, high, below = search.low[on], search.high[on], search.below[on]
        apart = low < (1.0 - GRAIN) * high
        on = on[(below < (1.0 - CLOSE) * level) & (low < search.reach[on]) & apart]
        if on.size == 0:
            return
        t = _next_place(search, on, level, halve=step % 4 == 3)
        v = function(on, t[:, None])[:, 0]
        low, below = search.low[on], search.below[on]
        search.slope[on] = _slope(low, below, t, v)
        over = v > level
        search.high[on[over]], search.above[on[over]] = t[over], v[over]
        search.plain[on] &= (v * low >= below * t) | (below <= LOW * level)
        search.low[on[~over]], search.below[on[~over]] = t[~over], v[~over]


def _next_place(search: _Search, on: IntArray, level: float, *, halve: bool) -> Array:
    """Where the function meets the level, going by its logarithmic slope; or half-way into the bracket."""
    low, high, below, above = search.low[on], search.high[on], search.below[on], search.above[on]
    target = (1.0 - 0.5 * CLOSE) * level
    ratio = np.divide(target, below, out=np.full(on.size, np.inf), where=below > 0.0)
    outward = np.minimum(low * np.minimum(ratio ** (1.0 / search.slope[on]), GROWTH), search.reach[on])
    met = np.isfinite(high)
    top, value = np.where(met, high, 1.0), np.where(met, above, level)
    slope = np.where(low > 0.0, _slope(low, below, top, value), 3.0)
    inward = top * (target / value) ** (1.0 / slope)
    margin = 1e-3 * (top - low)
    inward = np.clip(inward, low + margin, top - margin)
    if halve:
        inward = 0.5 * (low + top)
    return np.where(met, inward, outward)


def _slope(t0: Array, v0: Array, t1: Array, v1: Array) -> Array:
    """Logarithmic slope between two places, within POWERS."""
    tiny = np.finfo(np.float64).tiny
    rise = np.log(np.maximum(v1, tiny)) - np.log(np.maximum(v0, tiny))
    run = np.log(np.maximum(t1, tiny)) - np.log(np.maximum(t0, tiny))
    return np.clip(rise / np.where(run == 0.0, 1.0, run), *POWERS)


def _look_again(
    function: Function, search: _Search, rows: IntArray, count: int, level: float, near: float
) -> IntArray:
    """Look at `count` places up to the extent found; return those whose maxima come near to the level."""
    if rows.size == 0:
        return rows
    t = search.low[rows, None] * np.linspace(0.0, 1.0, count + 1)
    v = function(rows, t)
    over = v > level
    first = np.where(over.any(axis=1), over.argmax(axis=1), count + 1)
    met = np.flatnonzero(first <= count)
    for place, value, column in ((search.low, search.below, first - 1), (search.high, search.above, first)):
        place[rows[met]], value[rows[met]] = t[met, column[met]], v[met, column[met]]
    _finish(function, search, rows[met], level)
    peak = (v[:, 1:-1] >= v[:, :-2]) & (v[:, 1:-1] >= v[:, 2:]) & (v[:, 1:-1] > near * level)
    return rows[np.any(peak & (np.arange(1, count) < first[:, None]), axis=1)]
