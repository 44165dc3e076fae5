"""What the linear servo alone makes of a command, and how long it remembers.

The loop b ẍ + c ẋ = e + (k_i/k_p) ∫e + (k_d/k_p) ė without gap, friction or any other effect: the yardstick
that a record is held against before anything is simulated.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy import signal

from ph_post.types import Array, Axis, Servo

TIME_CONSTANTS: Final = 10.0
"""Servo time constants after which the start is forgotten: e^-10 of it is left."""


def linear_response(command: Array, servo: Servo, period: float) -> Array:
    """Answer of the linear servo to a command that is linear between its samples.

    Parameters
    ----------
    command : Array, shape (n,)
        [m]; the axis rests at its first value before the record begins.
    servo : Servo
    period : float
        [s].

    Returns
    -------
    Array, shape (n,)
        [m].
    """
    if servo.b <= 0.0 and servo.c <= 0.0:
        return command.copy()
    b, a, _ = signal.cont2discrete(_loop(servo, period), 1.0, method="foh")
    start = command[0]
    answer = signal.lfilter(np.ravel(b), a, command - start) + start
    return np.asarray(answer, dtype=np.float64)


def servo_memory(servo: Servo) -> float:
    """Time constant of the servo's slowest answer, the larger of 2 b/c and c [s]."""
    return max(2.0 * servo.b / servo.c, servo.c) if servo.c > 0.0 else 0.0


def settling_time(axis: Axis) -> float:
    """Time after which an axis has forgotten how it started [s]."""
    return TIME_CONSTANTS * servo_memory(axis.servo)


def taken_up(command: Array, travel: float) -> int:
    """First sample by which a command has swept so much [m]: from there its past does not matter to a play.

    The last sample where it never does, or all of what it sweeps where that is less; 0 where it never moves.
    """
    swept = np.maximum.accumulate(command) - np.minimum.accumulate(command)
    return int(np.argmax(swept >= min(travel, float(swept[-1])))) if swept[-1] > 0.0 else 0


def _loop(servo: Servo, period: float) -> tuple[Array, Array]:
    """Transfer function of the closed loop in units of the period, numerator and denominator."""
    b, c = servo.b / period**2, servo.c / period
    ki, kd = servo.ki_over_kp * period, servo.kd_over_kp / period
    integral = [ki] if ki else []
    return _stripped([kd, 1.0, *integral]), _stripped([b, c + kd, 1.0, *integral])


def _stripped(coefficients: list[float]) -> Array:
    """Coefficients from the first that is not zero on."""
    first = next(number for number, value in enumerate(coefficients) if value != 0.0)
    return np.array(coefficients[first:])
