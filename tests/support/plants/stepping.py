"""Integration from event to event with scipy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]

LONGEST = 0.02
SHORTEST = 1e-6
"""[s] The first step behind an event: a longer one could leave and return, and call that the same event."""

WATCHED = 0.004
"""[s] The longest step where an event is waited for."""


def stop(function: Callable[[float, Any], float], direction: int) -> Any:
    """Make an event that ends an integration, of a function that passes zero upwards (1) or downwards (-1)."""

    def event(t: float, y: Floats) -> float:
        return function(t, y)

    event.terminal, event.direction = True, direction  # type: ignore[attr-defined]
    return event


def solve(
    rhs: Any, start: float, y: Sequence[float], grid: Floats, end: float, stops: Sequence[Any] = ()
) -> tuple[Floats, float, list[float], int]:
    """Integrate to the end or the first event: rows at the grid, and time, state and index of the event."""
    scale = [1e-11 if i % 2 == 0 else 1e-9 for i in range(len(y))]
    steps = {"max_step": LONGEST}
    if stops:
        steps = {"max_step": WATCHED, "first_step": min(SHORTEST, end - start)}
    found = solve_ivp(
        rhs,
        (start, end),
        y,
        "DOP853",
        t_eval=grid,
        events=list(stops) or None,
        rtol=1e-8,
        atol=scale,
        **steps,
    )
    if not found.success:
        raise RuntimeError(found.message)
    rows = found.y.T if len(found.t) else np.empty((0, len(y)))
    if found.status == 1:
        which = next(i for i, times in enumerate(found.t_events) if len(times))
        return rows, float(found.t_events[which][-1]), found.y_events[which][-1].tolist(), which
    return rows, end, rows[-1].tolist() if len(rows) else list(y), -1
