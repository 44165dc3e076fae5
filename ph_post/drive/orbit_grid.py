"""The reversals of :mod:`ph_post.drive.orbit` for an array of standstills at once.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 4.
"""

from __future__ import annotations

import cmath
import math

import msgspec
import numpy as np

from ph_post.drive.forced import SPEED
from ph_post.drive.forced_grid import free_motor_responses
from ph_post.drive.orbit import Problem
from ph_post.drive.servo import effective_damping, propagate
from ph_post.errors import SolveError
from ph_post.types import Array, Servo


class Reversals(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The reversals at the axis' maximum of the orbits that stand for given times.

    `phase`, `place` as in :class:`ph_post.drive.orbit.Reversal`; the others as in
    :class:`ph_post.drive.harmonic.OpenGap`, all of one shape, in units of a and 1/Ω.
    """

    servo: Servo
    phase: Array
    place: Array
    sine: Array
    cosine: Array
    error: Array
    drive: Array


def settled_reversals(problem: Problem, standstill: Array) -> Reversals:
    """Return the reversals of the orbits x(τ + π) = -x(τ) on which the axis stands for `standstill`.

    Parameters
    ----------
    problem : Problem
        Its β and gap are not looked at.
    standstill : ndarray, shape (n,)
        ΩΔt.

    Raises
    ------
    SolveError
        Where a loop with an integrator has no orbit at one of them.
    """
    servo = problem.servo
    columns = _at_reversal(servo, standstill)  # (n, state, 2)
    chi = np.arctan2(columns[:, 1, 1], 1.0 - columns[:, 1, 0])
    swing = abs(problem.response)
    sine, cosine = swing * np.sin(chi), swing * np.cos(chi)
    deviation = columns[:, :, 0] * sine[:, np.newaxis] + columns[:, :, 1] * cosine[:, np.newaxis]
    place, speed = deviation[:, 0], deviation[:, 1]
    integral = deviation[:, 2] if servo.ki_over_kp else np.zeros_like(place)
    phase = chi + problem.delay
    braking = servo.b * cosine + place + effective_damping(servo) * speed
    length, angle = cmath.polar(problem.error)
    return Reversals(
        servo=servo,
        phase=phase,
        place=cosine + place,
        sine=np.cos(phase),
        cosine=-np.sin(phase),
        error=length * np.cos(angle + phase) - place,
        drive=servo.ki_over_kp * integral - braking,
    )


def _at_reversal(servo: Servo, standstill: Array) -> Array:
    """Deviation from the steady motion at the reversal, for its sine and its cosine, shape (n, state, 2)."""
    over = propagate(servo, math.pi - standstill)
    system = np.eye(over.shape[-1]) + over
    if servo.ki_over_kp:  # the integrator sums the deviation in place while the axis stands
        system[:, 2] -= standstill[:, np.newaxis] * over[:, 0]
    try:
        at_pickup = np.linalg.solve(system, _added_by_standing(servo, standstill))
    except np.linalg.LinAlgError as error:
        raise SolveError(
            "the loop resonates with the command: there is no orbit at one of these standstills"
        ) from error
    return np.asarray(-over @ at_pickup)


def _added_by_standing(servo: Servo, standstill: Array) -> Array:
    """Change of the deviation while the axis stands and the steady motion goes on, shape (n, state, 2)."""
    sine, versine = np.sin(standstill), 2.0 * np.sin(0.5 * standstill) ** 2
    rows = [np.stack([sine, versine], axis=-1), np.stack([-versine, sine], axis=-1)]
    if servo.ki_over_kp:
        lagging = free_motor_responses(SPEED, np.zeros(1), standstill).versine  # s - sin s
        rows.append(np.stack([-versine, -lagging], axis=-1))
    return np.stack(rows, axis=1)
