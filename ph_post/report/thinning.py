"""Which rows of a long motion are drawn, so that what is drawn is still true where it matters."""

from __future__ import annotations

from typing import Final

import numpy as np

from ph_post.types import Array, BoolArray, IntArray

INSIDE: Final = 8.0
"""A row inside of a window is worth so many outside."""

KEPT_A_GROUP: Final = 5
"""Rows that are kept of a group at most: the first, and those of the lowest and highest of two quantities."""


def rows_to_draw(error: Array, feed: Array, inside: BoolArray, always: IntArray, most: int) -> IntArray:
    """Choose rows (m,), ascending: all of a short motion, of a long one the telling ones.

    A long motion is cut into groups of neighbours, eight times as fine inside of windows. Of each the first
    row is kept, and those in which error and feed are lowest and highest: a peak stays as high as it is.

    Parameters
    ----------
    error, feed : Array, shape (n,)
    inside : BoolArray, shape (n,)
        Whether a row lies in a window.
    always : IntArray
        Rows that are kept whatever else is.
    most : int
        How many rows are kept at most, apart from those.

    Examples
    --------
    >>> error = np.zeros(1000); error[500] = 1.0
    >>> none = np.zeros(1000, dtype=bool)
    >>> kept = rows_to_draw(error, np.zeros(1000), none, np.array([7]), 100)
    >>> len(kept) <= 102, {7, 500, 999} <= set(kept.tolist())
    (True, True)
    """
    count = error.size
    if count <= most:
        return np.arange(count)
    worth = np.cumsum(np.where(inside, INSIDE, 1.0))
    kept = np.arange(0)
    for rows_a_group in range(2, KEPT_A_GROUP + 1):
        groups = most // rows_a_group
        group = np.minimum(worth / worth[-1] * groups, groups - 1).astype(np.int64)
        firsts = np.flatnonzero(np.diff(group, prepend=-1))
        kept = np.unique(np.concatenate([firsts, *_extremes(error, firsts), *_extremes(feed, firsts)]))
        # Of neighbours that rise or fall one row is two of them.
        if kept.size <= most:
            break
    return np.unique(np.concatenate([kept, always, [count - 1]]))


def _extremes(values: Array, firsts: IntArray) -> tuple[IntArray, IntArray]:
    """Rows of the lowest and of the highest value of each group."""
    group = np.repeat(np.arange(firsts.size), np.diff(firsts, append=values.size))
    order = np.lexsort((values, group))
    return order[firsts], order[np.append(firsts[1:], values.size) - 1]


def evenly(count: int, most: int) -> IntArray:
    """Return the numbers of at most so many of `count` rows, spread evenly; the first and last are there."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, most).astype(np.int64))


def lowest_and_highest(values: Array, firsts: IntArray) -> Array:
    """Return the lowest and the highest value of each group of neighbours.

    Parameters
    ----------
    values : Array, shape (n,)
    firsts : IntArray, shape (m,)
        First rows of the groups.

    Returns
    -------
    Array, shape (2, m)
        NaN where all of a group are missing.
    """
    if values.size == 0:
        return np.zeros((2, 0))
    known = np.isfinite(values)
    low = np.minimum.reduceat(np.where(known, values, np.inf), firsts)
    high = np.maximum.reduceat(np.where(known, values, -np.inf), firsts)
    return np.where(np.isfinite(low), np.stack([low, high]), np.nan)
