"""The first crossing of a level by many functions at once, searched outward from zero."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import msgspec
import numpy as np

from ph_post.types import Array, BoolArray, IntArray

Function = Callable[[IntArray, Array], Array]
"""Values of the functions numbered by (n,) at their places (n, k), shape (n, k)."""

MIDWAY: Final = 0.6
"""Place between the start and the guess that is tried too, as a share of the way."""

GROWTH: Final = 1.5
"""Longest step outward, over the distance."""

PATIENCE: Final = 3
"""Steps after which what is still under way is not like a power, and is hurried on."""

CREEP: Final = 1.03
"""Shortest step outward then, over the distance."""

SHRINK: Final = 0.1
"""Shortest step inward, where the function is above the level long before the guess."""

POWERS: Final = (1.0, 6.0)
"""A deviation grows with the third power of the distance or so; a secant far from that is not believed."""

PLAIN: Final = 2
"""A function rises plainly where it grows faster than this power of the distance."""

LOW: Final = 0.2
"""Below this part of the level a function may do what it likes: it is far from crossing."""

FINE: Final[tuple[tuple[int, float], ...]] = ((16, 0.8), (64, 0.98), (512, 1.0))
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
    slope, `plain` says whether the function has plainly risen all the way.
    """

    reach: Array
    low: Array
    below: Array
    high: Array
    above: Array
    slope: Array
    plain: BoolArray


def first_crossings(
    function: Function, reach: Array, guess: Array, level: float, *, places: int = 0
) -> tuple[Array, BoolArray]:
    """Find how far every function stays at or below `level`, up to `reach`.

    A function that does not plainly rise, as one does that begins with a cube, is looked at more densely.
    What is narrower than the steps may be missed elsewhere: where it may exist, ask for more `places`.

    Parameters
    ----------
    function : callable
        Not negative, zero at 0.
    reach : Array, shape (n,)
        Largest argument that is tried.
    guess : Array, shape (n,)
        Where the crossing may be, > 0; may be infinite.
    level : float
        > 0.
    places : int
        Number of places to look at on the way to every extent, in any case.

    Returns
    -------
    extent : Array, shape (n,)
        Where the function crosses the level: from below, between 0.999 of it and all of it.
    crossed : array of bool, shape (n,)
        True where the function exceeds the level just behind; elsewhere `extent` is `reach`.

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
    stages = FINE
    if places:
        doubtful, stages = np.flatnonzero(reach > 0.0), ((places, FINE[1][1]), (8 * places, FINE[2][1]))
    for count, near in stages:
        doubtful = _look_again(function, search, doubtful, count, level, near)
    return search.low, np.isfinite(search.high) | (search.below >= (1.0 - CLOSE) * level)


def _begin(function: Function, search: _Search, end: Array, level: float) -> None:
    """Look at `end` and a place before it, or less far where that turns out to be too far."""
    on = np.flatnonzero(end > 0.0)
    for _ in range(STEPS):
        t0, t1 = MIDWAY * end[on], end[on]
        v0, v1 = function(on, np.stack([t0, t1], axis=1)).T
        clear, met = v1 <= level, (v0 <= level) & (v1 > level)
        search.low[on], search.below[on] = np.where(clear, t1, t0), np.where(clear, v1, v0)
        search.high[on[met]], search.above[on[met]] = t1[met], v1[met]
        search.slope[on] = _slope(t0, v0, t1, v1)
        search.plain[on] = _rises(t0, v0, t1, v1, level)
        early = v0 > level
        on = on[early]
        if on.size == 0:
            return
        search.high[on] = np.inf
        end[on] = t0[early] * np.clip(np.cbrt(level / v0[early]), SHRINK, 1.0)
    search.low[on] = search.below[on] = 0.0


def _finish(function: Function, search: _Search, on: IntArray, level: float) -> None:
    """Step outward, and into the bracket once there is one, until the level is met or the reach is."""
    for step in range(STEPS):
        low, high, below = search.low[on], search.high[on], search.below[on]
        apart = low < (1.0 - GRAIN) * high
        on = on[(below < (1.0 - CLOSE) * level) & (low < search.reach[on]) & apart]
        if on.size == 0:
            return
        t = _outward(search, on, level, step)
        met = np.isfinite(search.high[on])
        t[met] = _inward(search, on[met], level, step)
        v = function(on, t[:, None])[:, 0]
        low, below = search.low[on], search.below[on]
        over = v > level
        search.high[on[over]], search.above[on[over]] = t[over], v[over]
        search.slope[on] = _slope(low, below, t, v)
        search.plain[on] &= _rises(low, below, t, v, level)
        search.low[on[~over]], search.below[on[~over]] = t[~over], v[~over]


def _outward(search: _Search, on: IntArray, level: float, step: int) -> Array:
    """Guess where the functions meet the level, by their last logarithmic slopes."""
    low, below, slope = search.low[on], search.below[on], search.slope[on]
    ratio = np.divide(_target(level), below, out=np.full(on.size, np.inf), where=below > 0.0)
    growth = np.minimum(ratio ** (1.0 / np.clip(slope, *POWERS)), GROWTH)
    growth[slope <= 0.0] = GROWTH
    least = 1.0 if step < PATIENCE else CREEP
    place: Array = np.minimum(low * np.maximum(growth, least), search.reach[on])
    return place


def _inward(search: _Search, on: IntArray, level: float, step: int) -> Array:
    """Guess where the functions meet the level, by power laws through the ends of their brackets, or half-way."""
    low, high, below, above = (x[on] for x in (search.low, search.high, search.below, search.above))
    if step % 3 == 2 or step > 3 * PATIENCE:
        return 0.5 * (low + high)
    # From nothing, a cube.
    start, value = np.where(below > 0.0, low, 0.5 * high), np.where(below > 0.0, below, 0.125 * above)
    place = high * (_target(level) / above) ** (1.0 / _slope(start, value, high, above))
    margin = 1e-3 * (high - low)
    return np.clip(place, low + margin, high - margin)


def _target(level: float) -> float:
    """Value that is tried for: in the middle of what is close enough."""
    return (1.0 - 0.5 * CLOSE) * level


def _rises(t0: Array, v0: Array, t1: Array, v1: Array, level: float) -> BoolArray:
    """Return true where the values clearly rise from one place to the next, or are far below the level at both."""
    rises: BoolArray = (v1 * t0**PLAIN >= v0 * t1**PLAIN) | (np.maximum(v0, v1) <= LOW * level)
    return rises


def _slope(t0: Array, v0: Array, t1: Array, v1: Array) -> Array:
    """Logarithmic slope between two places."""
    tiny = np.finfo(np.float64).tiny
    rise = np.log(np.maximum(v1, tiny)) - np.log(np.maximum(v0, tiny))
    slope: Array = rise / (np.log(t1) - np.log(np.maximum(t0, tiny)))
    return slope


def _look_again(function: Function, search: _Search, rows: IntArray, count: int, level: float, near: float) -> IntArray:
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
