"""The window through which inverse dynamics sees the path.

Where the curvature jumps, as between a line and an arc, the exact lead jumps by b v² Δκ, which no axis follows. So the
path and what leads it are both seen through one smooth window of some rows. Its second moment is zero: what bends
evenly stays where it is, and only what the servo could not do either is rounded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np

from ph_post.drive.cascade import memory_of_inverse
from ph_post.drive.command_filters import mean_delay
from ph_post.types import Array, Axis, Machine, Servo, frozen

SHORTEST: Final = 8
"""Rows that the window reaches to either side at least."""

WIDTH: Final = 2.0
"""Reach of the window to either side, in units of the servo's √b, or c / 2 where that is longer."""

END: Final = 2e-6
"""What may be left of the error that an integrator asks for when a led motion has come to its end [m]."""

LETTING_GO: Final = 3
"""Reaches of the window in which it is let go."""

LEAST: Final = 1e-7
"""Lead [m] below which it changes nothing worth speaking of."""


class LeadWindow(msgspec.Struct, frozen=True, kw_only=True):
    """How a led command is smoothed: `spacing` [s] of the cells of its speed, `half` the rows to either side."""

    spacing: float
    half: int


def lead_window(machine: Machine, axes: Sequence[str], width: float = 1.0) -> LeadWindow | None:
    """Return the window for some axes of a machine, so many times as wide as usual; None where none of them lags.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> lead_window(read_machine("mill"), ("X", "Y"))
    LeadWindow(spacing=0.015, half=30)
    >>> lead_window(read_machine("stepper"), ("X", "Y")) is None
    True
    """
    unit = max(_unit(machine.axes[name]) for name in axes)
    if unit == 0.0:
        return None
    period = machine.servo_period
    # The command of a motion that arrives late begins before it, while the motion still rests.
    cascades = [machine.axes[name].servo.cascade for name in axes]
    early = max(0.0 if cascade is None else mean_delay(cascade) for cascade in cascades)
    unit *= width
    spacing = max(unit, 0.5 * SHORTEST * period) + 0.5 * early
    return LeadWindow(spacing=spacing, half=max(round(WIDTH * unit / period), SHORTEST))


def _unit(axis: Axis) -> float:
    """Time in which a servo answers [s]."""
    return max(math.sqrt(axis.servo.b), 0.5 * axis.servo.c)


@lru_cache(maxsize=32)
def weights(half: int) -> Array:
    """Weights of 2 half + 1 rows that leave cubics as they are: (1 - x²)³ (p + q x²) with p, q by the moments.

    Examples
    --------
    >>> w, x = weights(8), np.arange(-8.0, 9.0)
    >>> bool(abs(w.sum() - 1.0) < 1e-14), bool(abs(w @ x**2) < 1e-12)
    (True, True)
    """
    x2 = (np.arange(-half, half + 1) / (half + 1.0)) ** 2
    bell = (1.0 - x2) ** 3
    moments = [float(bell @ x2**k) for k in range(3)]
    p, q = np.linalg.solve([moments[:2], moments[1:]], [1.0, 0.0])
    return frozen(bell * (p + q * x2))


def smoothed(rows: Array, half: int, rests: tuple[bool, bool] = (True, True)) -> Array:
    """See rows (n, dim) through the window.

    Parameters
    ----------
    rows : Array
    half : int
        Rows that the window reaches to either side.
    rests : tuple of bool
        Whether what the rows tell of stands still before the first and behind the last. Where it does not, the rows
        there stay as they are.
    """
    from scipy.ndimage import convolve1d

    seen: Array = convolve1d(rows, weights(half), axis=0, mode="nearest")
    if all(rests):
        return seen
    rise = np.clip(np.arange(len(rows)) / half - 1.0, 0.0, 1.0)
    rise = rise**3 * (10.0 + rise * (6.0 * rise - 15.0))
    inside = np.where(rests[0], 1.0, rise) * np.where(rests[1], 1.0, rise[::-1])
    return np.asarray(rows + inside[:, np.newaxis] * (seen - rows))


def memory_of_lead(servo: Servo) -> float:
    """Return the time constant in which the lead of a motion dies away behind a stop [s]; 0 where there is no such.

    A cascade's forward paths and integrator are unwound by the zeros of its response. An integrator of a single loop
    holds c v while the axis moves. Where it is to stop at once, it is commanded back by as much, and less and less as
    the integrator empties itself: by exp(-k t), k being the slower zero of k_d s² + s + k_i.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> memory_of_lead(read_machine("mill").axes["X"].servo)
    0.0
    """
    if servo.cascade is not None:
        return memory_of_inverse(servo.cascade)
    return 1.0 / _slowest(servo) if servo.ki_over_kp > 0.0 else 0.0


def _slowest(servo: Servo) -> float:
    """Rate [1/s] at which the slower solution of k_d ë + ė + k_i e = 0 dies away."""
    square = 1.0 - 4.0 * servo.kd_over_kp * servo.ki_over_kp
    if square < 0.0:
        return 0.5 / servo.kd_over_kp
    return 2.0 * servo.ki_over_kp / (1.0 + math.sqrt(square))


def let_go(servos: Sequence[Servo], window: LeadWindow, rows: int) -> Array:
    """Part of the lead (rows,) that the rows of a motion which ends at rest have: integrators let go at its end."""
    part = np.ones(rows)
    if any(memory_of_lead(servo) for servo in servos):
        fall = np.clip((rows - 1.0 - np.arange(rows)) / (LETTING_GO * window.half), 0.0, 1.0)
        part = fall**4 * (35.0 + fall * (-84.0 + fall * (70.0 - 20.0 * fall)))
    return part
