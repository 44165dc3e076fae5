"""Row-wise reductions, distances from polylines, runs of row numbers, and bisection to the last digit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from ph_post.compiling import compiled, read_only
from ph_post.types import Array, IntArray

TINY: Final = float(np.finfo(np.float64).tiny)
"""Squared length of a chord that has none."""


def largest(values: Array) -> Array:
    """Largest value of every row.

    Parameters
    ----------
    values : Array, shape (n, k)

    Returns
    -------
    Array, shape (n,)

    Examples
    --------
    >>> largest(np.array([[1.0, 3.0], [2.0, 0.0]])).tolist()
    [3.0, 2.0]
    """
    result = values[:, 0].copy()
    for column in values.T[1:]:
        np.maximum(result, column, out=result)
    return result


def smallest(values: Array) -> Array:
    """Smallest value of every row of `values` (n, k), shape (n,)."""
    return -largest(-values)


def norm(values: Array) -> Array:
    """Euclidean norm of every row of `values` (n, k), shape (n,)."""
    squared: Array = np.einsum("nk,nk->n", values, values)
    return np.sqrt(squared)


def polyline_distances(points: Array, line: Array) -> Array:
    """Distances of points from a polyline, shape (n,).

    Parameters
    ----------
    points : Array, shape (n, dim)
    line : Array, shape (m, dim)
        Points of the polyline.

    Examples
    --------
    >>> polyline_distances(np.array([[1.0, 2.0], [5.0, 0.0]]), np.array([[0.0, 0.0], [4.0, 0.0]])).tolist()
    [2.0, 1.0]
    """
    found: Array = _polyline_distances(read_only(points), read_only(line))
    return found


@compiled
def _polyline_distances(points: Any, line: Any) -> Any:
    found = np.full(points.shape[0], np.inf)
    for n in range(points.shape[0]):
        for m in range(line.shape[0] - 1):
            square, part, away = TINY, 0.0, 0.0
            for k in range(points.shape[1]):
                chord = line[m + 1, k] - line[m, k]
                square += chord * chord
                part += (points[n, k] - line[m, k]) * chord
            share = min(max(part / square, 0.0), 1.0)
            for k in range(points.shape[1]):
                away += (points[n, k] - line[m, k] - share * (line[m + 1, k] - line[m, k])) ** 2
            found[n] = min(found[n], away)
    return np.sqrt(found)


def runs(rows: IntArray) -> list[IntArray]:
    """Cut sorted row numbers into runs of consecutive ones.

    Examples
    --------
    >>> [run.tolist() for run in runs(np.array([3, 4, 7]))]
    [[3, 4], [7]]
    """
    return np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if rows.size else []


def bisect(is_below: Callable[[float], bool], low: float, high: float) -> tuple[float, float]:
    """Close [low, high] around the place where `is_below` turns from true to false.

    Returns
    -------
    low, high : float
        Neighbouring numbers, the last with `is_below` and the first without.

    Examples
    --------
    >>> bisect(lambda x: x < 1.0 / 3.0, 0.0, 1.0)[1] == 1.0 / 3.0
    True
    """
    while low < (middle := 0.5 * (low + high)) < high:
        if is_below(middle):
            low = middle
        else:
            high = middle
    return low, high


def zigzag(values: Array, band: float) -> tuple[IntArray, IntArray]:
    """Find the turns of a zigzag: where it goes back by more than a band.

    Parameters
    ----------
    values : Array, shape (n,)
    band : float
        A way back that is no longer is none.

    Returns
    -------
    places : IntArray, shape (m,)
        Row 0, then the farthest row before each way back, the last one of equals. Empty where nothing moves.
    senses : IntArray, shape (m,)
        1 where the values rise behind it, -1 where they fall.

    Examples
    --------
    >>> zigzag(np.array([0.0, 5.0, 4.9, 5.1, 5.1, 0.0, 3.0]), 1.0)
    (array([0, 4, 5]), array([ 1, -1,  1]))
    """
    places, senses = [0], [0]
    lowest = highest = 0
    listed = values.tolist()
    for row, value in enumerate(listed):
        lowest = row if value <= listed[lowest] else lowest
        highest = row if value >= listed[highest] else highest
        way = senses[-1]
        if way <= 0 and value > listed[lowest] + band:
            turn, sense, highest = lowest, 1, row
        elif way >= 0 and value < listed[highest] - band:
            turn, sense, lowest = highest, -1, row
        else:
            continue
        if way:
            places.append(turn)
            senses.append(sense)
        else:
            senses[0] = sense
    if not senses[0]:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    return np.array(places), np.array(senses)
