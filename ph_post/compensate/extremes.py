"""The smallest value of a polynomial in Bernstein form on [0, 1]."""

from __future__ import annotations

import numpy as np

from ph_post.geometry.bernstein import subdivide
from ph_post.types import Array

_HALVINGS = 64
"""More than enough: the distance between control polygon and graph falls fourfold each time."""


def lowest_value(coefficients: Array) -> float:
    """Smallest value on [0, 1], to rounding.

    The control polygon bounds the graph; pieces that cannot hold the minimum are dropped, the others halved.

    Examples
    --------
    >>> lowest_value(np.array([1.0, -1.0, 1.0]))
    0.0
    """
    pieces = np.atleast_2d(np.asarray(coefficients, dtype=np.float64))
    slack = value_rounding(coefficients)
    best = float(pieces[:, [0, -1]].min())
    for _ in range(_HALVINGS):
        pieces = pieces[pieces.min(axis=-1) < best - slack]
        if not pieces.size:
            break
        pieces = np.concatenate(subdivide(pieces))
        best = min(best, float(pieces[:, [0, -1]].min()))
    return best


def value_rounding(coefficients: Array) -> float:
    """How far rounding may move a value: n + 1 products of no more than the largest coefficient."""
    return float(np.finfo(np.float64).eps * coefficients.size * np.abs(coefficients).max())
