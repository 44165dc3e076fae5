"""Closing a bracket to rounding."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Final

from ph_post.errors import SolveError

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
