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


HALF: Final = 0.5


def close_brackets(function: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Return the root of each component of `function` between `low` and `high`, by Chandrupatla's method.

    Inverse quadratic steps where three points allow them, halving where they do not [1]_.

    Parameters
    ----------
    function : callable
        Maps an array of shape (n,) to one of that shape, component by component.
    low, high : ndarray, shape (n,)
        Where it has opposite signs; zero counts as either.

    Raises
    ------
    SolveError
        Where a bracket does not close.

    References
    ----------
    .. [1] T. R. Chandrupatla, Advances in Engineering Software 28 (1997) 145-149.

    Examples
    --------
    >>> close_brackets(lambda x: x * x - np.array([2.0, 9.0]), np.ones(2), np.full(2, 5.0)).round(12).tolist()
    [1.414213562373, 3.0]
    """
    a, b = high.copy(), low.copy()
    fa, fb = function(a), function(b)
    fraction = np.full_like(a, HALF)
    for _ in range(STEPS):
        best = np.where(np.abs(fa) < np.abs(fb), a, b)
        slack = RELATIVE_PRECISION * np.abs(best)
        width = np.abs(b - a)
        open_still = (width > 2.0 * slack) & (np.minimum(np.abs(fa), np.abs(fb)) != 0.0)
        if not open_still.any():
            return np.asarray(best)
        least = np.minimum(slack / np.where(width > 0.0, width, 1.0), HALF)
        t = a + np.clip(fraction, least, 1.0 - least) * (b - a)
        t = np.where(open_still, t, best)
        ft = np.asarray(function(t))
        same = np.sign(ft) == np.sign(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = t, ft
        fraction = _next_fraction(a, b, c, fa, fb, fc)
    raise SolveError(f"{int(open_still.sum())} of {low.size} roots did not close in {STEPS} steps")


def _next_fraction(a: Array, b: Array, c: Array, fa: Array, fb: Array, fc: Array) -> Array:
    """Where between a and b to look next, as fraction of the way from a."""
    with np.errstate(divide="ignore", invalid="ignore"):
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        smooth = (phi * phi < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
        step = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
    return np.where(smooth & np.isfinite(step), step, HALF)
