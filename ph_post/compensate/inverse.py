"""The inverse of a servo: what a command has beyond the motion that it is to make.

The motion gives the controller's output, and the output the position error that is added to the position. For a P
controller it is X = x + c ẋ + b ẍ while a side drives the table (Eq. 8 of [1]_), and X = x_i + η b (m̈ + β ṁ) while the
motor crosses the gap (Eq. 16, in units of the table). A cascade is inverted as one system, by
:mod:`ph_post.drive.cascade`.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from ph_post.drive.cascade import (
    MovedBody,
    engaged_body,
    memory_of_inverse,
    offset_of_force,
    offset_of_motion,
    steady_offset,
)
from ph_post.types import Array, Axis, Servo, frozen


def motor_inertia(axis: Axis) -> float:
    """Return η b [s²], the position error that a motor alone takes for each m/s² while it crosses the gap."""
    return (axis.gap.inertia_fraction or 0.0) * axis.servo.b


def lead_of_motion(axis: Axis, speed: Array, acceleration: Array, period: float) -> Array:
    """Return what the command of a motion of motor and table together is beyond it [m], (n,).

    Parameters
    ----------
    axis : Axis
    speed, acceleration : Array, shape (n,)
        [m/s, m/s²].
    period : float
        [s].
    """
    servo = axis.servo
    if servo.cascade is not None:
        return offset_of_motion(servo.cascade, engaged_body(servo), speed, period)
    return error_for(servo, servo.b * acceleration + servo.c * speed, period)


def lead_of_crossing(axis: Axis, speed: Array, acceleration: Array, force: Array | None, period: float) -> Array:
    """Return what is commanded for a motor that crosses its gap, beyond its way where that is behind its loop [m].

    Inside the loop the table rests meanwhile, and the motor is alone.

    Parameters
    ----------
    axis : Axis
    speed, acceleration : Array, shape (n,)
        Of the motor, beside what it does with the table [m/s, m/s²].
    force : Array, shape (n,), or None
        What else resists it, F/K [m].
    period : float
        [s].
    """
    servo, beta = axis.servo, axis.gap.beta or 0.0
    inside, cascade = axis.loop.encloses_backlash, servo.cascade
    if cascade is not None:
        body, inertia = engaged_body(servo), motor_inertia(axis)
        if inside:
            body = MovedBody(inertia, inertia * beta, float(cascade.velocity_feedback == "motor"), 0.0)
        crossing = offset_of_motion(cascade, body, speed, period)
        return crossing if force is None else crossing + offset_of_force(cascade, force, period)
    alone = motor_inertia(axis) * (acceleration + beta * speed)
    output = alone if inside else servo.b * acceleration + servo.c * speed
    return error_for(servo, output if force is None else output + force, period)


def lead_of_force(axis: Axis, force: Array, period: float) -> Array:
    """Return what is commanded beyond a motion that a force resists, F/K [m], (n,)."""
    if axis.servo.cascade is not None:
        return offset_of_force(axis.servo.cascade, force, period)
    return error_for(axis.servo, force, period)


def lead_when_steady(axis: Axis, speed: Array, acceleration: Array) -> Array:
    """Return the lead of motions that are even for long [m], of any shape."""
    servo = axis.servo
    by_speed, by_acceleration = servo.c, servo.b
    if servo.cascade is not None:
        by_speed, by_acceleration = steady_offset(servo.cascade, engaged_body(servo))
    return np.asarray(by_acceleration * acceleration + by_speed * speed)


def remembers(servo: Servo) -> bool:
    """Whether the lead depends on more of a motion than one place of it."""
    return bool(servo.ki_over_kp or servo.kd_over_kp) or servo.cascade is not None


def lead_memory(servo: Servo) -> float:
    """Return the time constant in which a cascade's lead of a force that steps dies away [s]; 0 of a single loop."""
    if servo.cascade is None:
        return 0.0
    return max(memory_of_inverse(servo.cascade), 1.0 / (servo.cascade.integral_rate or math.inf))


def error_for(servo: Servo, output: Array, period: float) -> Array:
    """Position error that makes the controller of a single loop give `output` [m], both sampled.

    Solves (k_d/k_p) ė + e + (k_i/k_p) ∫e = u for e, with u linear between samples; for a P controller e = u.
    """
    if servo.ki_over_kp == 0.0 and servo.kd_over_kp == 0.0:
        return output
    from scipy.signal import lfilter

    # Before the first sample there was steady motion: the integrator holds all of it, or the error does.
    steady = 0.0 if servo.ki_over_kp else output[0]
    return np.asarray(lfilter(*_error_filter(servo, period), output - output[0])) + steady


@lru_cache(maxsize=64)
def _error_filter(servo: Servo, period: float) -> tuple[Array, Array]:
    """Numerator and denominator of the filter that :func:`error_for` applies to samples."""
    from scipy.signal import cont2discrete

    numerator, denominator = [1.0, 0.0], [servo.kd_over_kp, 1.0, servo.ki_over_kp]
    if servo.ki_over_kp == 0.0:
        numerator, denominator = [1.0], [servo.kd_over_kp, 1.0]
    elif servo.kd_over_kp == 0.0:
        denominator = [1.0, servo.ki_over_kp]
    system: Any = (numerator, denominator)
    b, a, _ = cont2discrete(system, period, method="foh")
    return frozen(np.squeeze(b)), frozen(a)
