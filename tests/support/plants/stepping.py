"""Integration with scipy of what moves without events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]

LONGEST = 0.02


def solve(rhs: Any, y: Sequence[float], grid: Floats) -> Floats:
    """Integrate from time 0: rows at the grid."""
    scale = [1e-11 if i % 2 == 0 else 1e-9 for i in range(len(y))]
    found = solve_ivp(rhs, (0.0, float(grid[-1])), y, "DOP853", t_eval=grid, rtol=1e-8, atol=scale, max_step=LONGEST)
    if not found.success:
        raise RuntimeError(found.message)
    return found.y.T
