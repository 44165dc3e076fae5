"""One axis after the other, integrated by scipy's DOP853 with event functions: a reference for simulations.

It is written from section 3 of the paper (doi:10.1007/s00170-021-08515-z) alone and shares no code with
the library. The command is linear between its samples; the integration restarts at each of them, where
derivatives of the command jump, and at each event. The equations are in `reference_modes.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

from .reference_drive import Drive, Engaged, Ramp
from .reference_modes import LoadAxis, MotorAxis

RTOL = 1e-11
ATOL = 1e-15
PATIENCE = 2000
"""Events between two samples after which a motion counts as endless chatter."""


class Event(NamedTuple):
    """What happened, and when [s]."""

    t: float
    kind: str


class Motion(NamedTuple):
    """Table and motor (in units of the table) at the samples [m], and the events between them."""

    table: NDArray[np.float64]
    motor: NDArray[np.float64]
    events: list[Event]

    def times(self, *kinds: str) -> list[float]:
        """When events of these kinds happened [s]."""
        return [event.t for event in self.events if event.kind in kinds]


def simulate_axis(
    drive: Drive,
    samples: ArrayLike,
    period: float,
    *,
    flank: int = 1,
    position: float | None = None,
    speed: float = 0.0,
    integral: float = 0.0,
    refine: int = 1,
) -> Motion:
    """Integrate one axis.

    Parameters
    ----------
    drive : Drive
    samples : array_like, shape (n,)
        The command [m] at 0, period, 2 period, …; linear in between.
    period : float
        [s].
    flank : {1, -1}
        Flank of the gap that the motor touches at first.
    position, speed, integral : float
        Where the axis is at first [m] (absent: where the command is), the motor's side where the loop closes
        over it; how fast it moves [m/s]; and the integrator's ∫e [m s].
    refine : int
        Equal parts into which the time between samples is cut, so that no two events hide in one step.
    """
    X = np.asarray(samples, dtype=np.float64)
    start = float(X[0]) if position is None else position
    if drive.feedback != "load" and drive.b == drive.c == 0.0:
        return _stepper(drive, X, period, flank)
    kind = LoadAxis if drive.feedback == "load" else MotorAxis
    axis = kind(drive, start, speed, flank)
    axis.y[-1] = integral
    table, motor = np.empty(X.size), np.empty(X.size)
    events: list[Event] = []
    table[0], motor[0] = axis.places()
    for k in range(X.size - 1):
        for ramp, end in _ramps(X, k, period, drive.delay, refine):
            _follow(axis, ramp, end, events)
        table[k + 1], motor[k + 1] = axis.places()
    return Motion(table, motor, events)


def simulate(
    drives: Sequence[Drive], samples: ArrayLike, period: float, flanks: Sequence[int] | int = 1
) -> list[Motion]:
    """Integrate the columns of a command of shape (n, axes), each from rest on its own."""
    columns = np.asarray(samples, dtype=np.float64).T
    each = [flanks] * len(drives) if isinstance(flanks, int) else flanks
    return [
        simulate_axis(drive, column, period, flank=flank)
        for drive, column, flank in zip(drives, columns, each, strict=True)
    ]


def _ramps(X: NDArray[np.float64], k: int, period: float, delay: float, refine: int) -> list[tuple[Ramp, float]]:
    """Straight pieces of the delayed command between samples k and k + 1, each with its end [s]."""
    whole, part = divmod(delay / period, 1.0)
    cuts = sorted({i / refine for i in range(refine + 1)} | {part})
    found = []
    for low, high in pairwise(cuts):
        first = k - int(whole) - (1 if low < part else 0)
        slope = (X[first + 1] - X[first]) / period if first >= 0 else 0.0
        since = low - part + (1.0 if low < part else 0.0)
        value = X[first] + slope * since * period if first >= 0 else X[0]
        found.append((Ramp((k + low) * period, float(value), float(slope)), (k + high) * period))
    return found


def _follow(axis: LoadAxis | MotorAxis, ramp: Ramp, end: float, events: list[Event]) -> None:
    """Integrate along one straight piece of the command, through every event on it."""
    t = ramp.t
    events += [Event(t, kind) for kind in axis.begin(ramp)]
    for _ in range(PATIENCE):
        mode = axis.mode(t)
        run = solve_ivp(
            axis.rate,
            (t, end),
            axis.y,
            method="DOP853",
            rtol=RTOL,
            atol=ATOL,
            first_step=end - t,
            events=mode.functions,
        )
        assert run.success, run.message
        axis.y = run.y[:, -1]
        t = float(run.t[-1])
        if run.status == 0:
            return
        struck = next(i for i, times in enumerate(run.t_events) if times.size)
        events += [Event(t, kind) for kind in axis.strike(mode, struck, t)]
        if end - t <= 4.0 * np.spacing(end):
            return
    raise AssertionError(f"endless chatter at t = {t:.9f} s")


def _stepper(drive: Drive, X: NDArray[np.float64], period: float, flank: int) -> Motion:
    """An ideal stepper: the motor is where the command is, and the table follows with play."""
    half = 0.5 * drive.gap
    x, engaged = float(X[0]) - flank * half, flank
    table, events = [x], []
    for k, (before, after) in enumerate(zip(X[:-1].tolist(), X[1:].tolist(), strict=True)):
        way = int(np.sign(after - before))
        if way == -engaged != 0 and half:
            left, engaged = engaged, Engaged.NONE
            events.append(Event(k * period, "opens"))
        flanks = {way * half + x: way} if way and engaged == Engaged.NONE else {}
        for place, side in flanks.items():
            if (after - place) * way >= 0.0:
                when = (k + (place - before) / (after - before)) * period
                events.append(Event(when, "falls back" if side == left else "picks up"))
                engaged = side
        if engaged != Engaged.NONE:
            x = after - engaged * half
        table.append(x)
    return Motion(np.array(table), X.copy(), events)


__all__ = ["Drive", "Event", "Motion", "simulate", "simulate_axis"]
