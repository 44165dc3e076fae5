"""Roots in a bracket, closed to rounding, one or many at once."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Final

import numpy as np

from ph_post.errors import SolveError
from ph_post.types import Array

RELATIVE_PRECISION: Final = 4.0 * sys.float_info.epsilon
"""Relative width at which a bracket counts as closed: the least that scipy's brentq takes."""

STEPS: Final = 200
"""Steps granted; brentq takes about 10."""


def close_bracket(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the root of `function` between `low` and `high`, where it has opposite signs.

    Raises
    ------
    SolveError
        With the residual, where the bracket does not close.

    Examples
    --------
    >>> round(close_bracket(lambda x: x * x - 2.0, 1.0, 2.0), 12)
    1.414213562373
    """
    from scipy.optimize import brentq

    root, report = brentq(
        function,
        low,
        high,
        xtol=sys.float_info.min,
        rtol=RELATIVE_PRECISION,
        maxiter=STEPS,
        full_output=True,
        disp=False,
    )
    if not report.converged:
        raise SolveError(f"no root closed in [{low:.17g}, {high:.17g}] (residual {function(root):.3g})")
    return float(root)


def close_brackets(function: Callable[..., Array], low: Array, high: Array, *args: Array) -> Array:
    """Return the root of each component of `function` between `low` and `high`, by Chandrupatla's method.

    Parameters
    ----------
    function : callable
        ``function(x, *args)`` maps arrays of one shape to an array of that shape, component by component; it
        is called with those components alone that are not closed yet.
    low, high : ndarray, shape (n,)
        Where it has opposite signs; zero counts as either.
    args : ndarray, shape (n,)
        Further arguments of the function.

    Raises
    ------
    SolveError
        If a bracket does not close.

    Examples
    --------
    >>> squares = np.array([2.0, 9.0])
    >>> close_brackets(lambda x, square: x * x - square, np.ones(2), np.full(2, 5.0), squares).round(12).tolist()
    [1.414213562373, 3.0]
    """
    from scipy.optimize.elementwise import find_root

    # brentq counts half the width, find_root the whole.

    found = find_root(
        function,
        (low, high),
        args=args,
        tolerances={"xatol": 0.0, "xrtol": 2.0 * RELATIVE_PRECISION, "fatol": 0.0, "frtol": 0.0},
        maxiter=STEPS,
    )
    if not found.success.all():
        raise SolveError(f"{int((~found.success).sum())} of {low.size} roots did not close in {STEPS} steps")
    return np.asarray(found.x)
