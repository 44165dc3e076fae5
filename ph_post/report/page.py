"""Frame of every page (one file with data, style and script), and thinning of long motions.

Thinning keeps the rows that matter: extremes of error and feed, and what lies in windows.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable
from importlib import resources
from typing import Any, Final, Literal

import msgspec
import numpy as np

from ph_post.types import Array, BoolArray, IntArray

Kind = Literal["motion", "diff", "diagnosis", "batch"]


def make_page(kind: Kind, title: str, data: dict[str, Any], lines: Iterable[str]) -> str:
    """Put a page together.

    Parameters
    ----------
    kind : str
        Whose script draws it: that of ``pages/KIND.js``, on top of what all share.
    title : str
        Of the window.
    data : dict
        What the script draws, without NaN and infinity.
    lines : iterable of str
        The same in words, for a reader without scripts.

    Returns
    -------
    str
        HTML that asks the network for nothing.
    """
    parts = {
        "title": html.escape(title),
        "style": _text("page.css"),
        "lines": html.escape("\n".join(lines)),
        "script": _text("page.js") + _text(f"{kind}.js"),
        # No "<" inside the script: a "</script" from a file would end it.
        "data": msgspec.json.encode(data).decode().replace("<", "\\u003c"),
    }
    pieces = _text("page.html").split("@@")
    # What stands in a part is never looked at again: nothing from a file is taken for the page's own.
    return "".join(parts[piece] if number % 2 else piece for number, piece in enumerate(pieces))


def numbers(values: Array, decimals: int) -> list[float | None]:
    """Return values (n,) rounded for a page, as short as can be; None where there is none.

    Examples
    --------
    >>> numbers(np.array([2.0, 0.123456, np.nan]), 4)
    [2, 0.1235, None]
    """
    rounded = np.round(values, decimals) + 0.0
    return [None if not math.isfinite(one) else int(one) if one == int(one) else one for one in rounded.tolist()]


def _text(name: str) -> str:
    return resources.files(__package__).joinpath("pages", name).read_text(encoding="utf-8")


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
