"""One reversal of an axis with the gap inside its loop, in the command's own units, as linear algebra.

Amplitude and angular frequency of the command are 1, X = cos τ with the command's reversal at τ = 0. The
axis follows the loop's steady harmonic motion plus a free deviation (position, speed and, for PI and PID,
the integral of the error). Small quantities are formed directly, never as the difference of place and
command: in the paper's example X - x is 1e-4 of either when the gap opens.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 4.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.drive.free_motor import SPEED, free_motor_response, free_motor_responses
from ph_post.drive.harmonic import OpenGap
from ph_post.drive.roots import close_bracket
from ph_post.drive.servo import (
    WELL_CONDITIONED,
    effective_damping,
    free_motion,
    harmonic_response,
    propagate,
    ringing,
)
from ph_post.errors import SolveError
from ph_post.types import Array, Servo

FADED: Final = 40.0
"""Decay times after which ringing is below rounding (exp(-40) = 4e-18)."""

SAMPLES_PER_RING: Final = 16
"""Samples on each period of the ringing when the axis' reversals are looked for."""

MOST_SAMPLES: Final = 1600
"""Samples at most on the ringing: its first hundred periods."""

FEWEST_SAMPLES: Final = 64
"""Samples on the slow part of the motion."""

SAMPLE_CONDITION: Final = 1e9
"""Condition number of the loop's modes with which samples are good enough: they need signs, not digits."""


class OrbitProblem(msgspec.Struct, frozen=True, kw_only=True):
    """Loop, motor and gap in units of the amplitude a and of 1/Ω.

    `gap` is Δθ_m Ω²/(C a); `response` and `error` are x/X and (X - x)/X of the steady motion.
    """

    servo: Servo
    beta: float
    gap: float
    response: complex
    error: complex

    @property
    def delay(self) -> float:
        """Phase of the steady motion behind the command."""
        return -cmath.phase(self.response)


class OrbitReversal(msgspec.Struct, frozen=True, kw_only=True):
    """A reversal at the axis' maximum.

    `phase` behind the command's reversal, `place` where the axis stands, the `gap` it opens, and, on a
    settled orbit, the deviation from the steady motion at pick-up.
    """

    phase: float
    place: float
    gap: OpenGap
    at_pickup: tuple[float, ...]


def state_problem(servo: Servo, beta: float, gap: float) -> OrbitProblem:
    """Return the problem of a loop that is already in the command's units."""
    response, error = harmonic_response(servo, 1.0)
    return OrbitProblem(servo=servo, beta=beta, gap=gap, response=response, error=error)


def steady_reversal(problem: OrbitProblem, standstill: float) -> OrbitReversal:
    """Return the reversal of the orbit x(τ + π) = -x(τ) on which the axis stands for `standstill`.

    With E the free propagation over the rest of the half period and d what standing adds to the deviation,
    the orbit closes when the deviation z after pick-up obeys -E z + d = z (plus what the integrator gains
    from it); the speed is 0 at the reversal for one phase only.
    """
    added = _added_by_standing(standstill, problem.servo)
    close = _close_third_order if problem.servo.ki_over_kp else _close_second_order
    at_pickup, at_reversal = close(problem.servo, standstill, added)
    chi = math.atan2(at_reversal[1][1], 1.0 - at_reversal[1][0])
    swing = abs(problem.response)
    weights = (swing * math.sin(chi), swing * math.cos(chi))
    return _reversal(problem, chi, _combine(at_reversal, weights), _combine(at_pickup, weights))


Columns = Sequence[Sequence[float]]
"""A row for position, speed and, with an integrator, ∫e; its two entries stand for the sine and the cosine
of the steady motion's phase χ at the reversal."""


def _combine(columns: Columns, weights: tuple[float, float]) -> tuple[float, ...]:
    return tuple(row[0] * weights[0] + row[1] * weights[1] for row in columns)


def _added_by_standing(standstill: float, servo: Servo) -> Columns:
    """Change of the deviation while the axis stands and the steady motion, cos(χ + s), goes on."""
    sine, versine = math.sin(standstill), 2.0 * math.sin(0.5 * standstill) ** 2
    rows = [(sine, versine), (-versine, sine)]
    if servo.ki_over_kp:
        lagging = free_motor_response(SPEED, 0.0, 1.0, standstill).versine  # s - sin s
        rows.append((-versine, -lagging))
    return rows


def _close_second_order(servo: Servo, standstill: float, added: Columns) -> tuple[Columns, Columns]:
    """Solve (1 + E) z = d for z at pick-up; -E z = z - d at the reversal is formed as a product."""
    e11, e12, e21, e22 = free_motion(servo, math.pi - standstill)
    determinant = (1.0 + e11) * (1.0 + e22) - e12 * e21
    (place, speed) = added
    at_pickup = (
        [((1.0 + e22) * x - e12 * v) / determinant for x, v in zip(place, speed, strict=True)],
        [((1.0 + e11) * v - e21 * x) / determinant for x, v in zip(place, speed, strict=True)],
    )
    columns = list(zip(*at_pickup, strict=True))
    at_reversal = ([-e11 * x - e12 * v for x, v in columns], [-e21 * x - e22 * v for x, v in columns])
    return at_pickup, at_reversal


def _close_third_order(servo: Servo, standstill: float, added: Columns) -> tuple[Columns, Columns]:
    """Likewise with an integrator, which sums the deviation in place while the axis stands."""
    over = propagate(servo, math.pi - standstill)
    system = np.eye(3) + over
    system[2] -= standstill * over[0]
    try:
        at_pickup = np.linalg.solve(system, np.array(added))
    except np.linalg.LinAlgError as error:
        raise SolveError("the loop resonates with the command: there is no orbit at this standstill") from error
    return at_pickup.tolist(), (-over @ at_pickup).tolist()


def first_reversal_state(problem: OrbitProblem) -> OrbitReversal | None:
    """Return the first reversal from x = 0, ẋ = aΩ at τ = -π/2, where X = 0; None if none comes in time."""
    start = np.array([-problem.response.imag, *(problem.error.real,) * 2])
    if not problem.servo.ki_over_kp:
        start = start[:2]

    def speed(t: float | Array, condition: float = WELL_CONDITIONED) -> Array:
        steady = abs(problem.response) * np.cos(np.asarray(t) - problem.delay)
        return np.asarray(steady + (propagate(problem.servo, t, condition) @ start)[..., 1])

    times = _sampling(problem.servo, 3.0 * math.pi)
    reversed_at = np.flatnonzero(speed(times, SAMPLE_CONDITION) < 0.0)
    if reversed_at.size == 0:
        return None
    index = int(reversed_at[0])
    before = float(times[index - 1]) if index else 0.0
    t = close_bracket(lambda value: float(speed(value)), before, float(times[index]))
    deviation = tuple((propagate(problem.servo, t) @ start).tolist())
    return _reversal(problem, t - 0.5 * math.pi - problem.delay, deviation, deviation)


def _reversal(
    problem: OrbitProblem, chi: float, deviation: tuple[float, ...], at_pickup: tuple[float, ...]
) -> OrbitReversal:
    """Assemble a reversal from the steady motion's phase `chi` and the deviation there."""
    servo, swing = problem.servo, abs(problem.response)
    place, speed = deviation[:2]
    integral = deviation[2] if servo.ki_over_kp else 0.0
    phase = chi + problem.delay
    braking = servo.b * swing * math.cos(chi) + place + effective_damping(servo) * speed
    gap = OpenGap(
        gain=1.0,
        beta=problem.beta,
        amplitude=1.0,
        omega=1.0,
        sine=math.cos(phase),
        cosine=-math.sin(phase),
        error=(problem.error * cmath.exp(1j * phase)).real - place,
        drive=servo.ki_over_kp * integral - braking,
        ki_over_kp=servo.ki_over_kp,
        kd_over_kp=servo.kd_over_kp,
    )
    return OrbitReversal(phase=phase, place=swing * math.cos(chi) + place, gap=gap, at_pickup=at_pickup)


def count_ringing(problem: OrbitProblem, reversal: OrbitReversal, standstill: float) -> int:
    """Reversals of the axis between pick-up and the end of the half period, seen on samples of its speed."""
    times = _sampling(problem.servo, math.pi - standstill)
    chi = reversal.phase - problem.delay
    steady = -abs(problem.response) * np.sin(chi + standstill + times)
    deviation = propagate(problem.servo, times, SAMPLE_CONDITION) @ np.array(reversal.at_pickup)
    speed = steady + deviation[:, 1]
    return int(np.count_nonzero(np.diff(speed > 0.0))) + int(speed[0] > 0.0)


def _sampling(servo: Servo, span: float) -> Array:
    """Lay times inside (0, span), dense while the loop rings."""
    coarse = np.linspace(0.0, span, FEWEST_SAMPLES + 2)[1:-1]
    frequency, decay = ringing(servo)
    if frequency == 0.0:
        return coarse
    step = 2.0 * math.pi / frequency / SAMPLES_PER_RING
    count = min(FADED / decay, span) / step
    fine = step * np.arange(1, min(int(count), MOST_SAMPLES) + 1)
    return np.union1d(coarse, fine[fine < span])


class OrbitReversals(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The reversals at the axis' maximum of the orbits that stand for given times.

    `phase`, `place` as in :class:`ph_post.drive.orbit.OrbitReversal`; the others as in
    :class:`ph_post.drive.harmonic.OpenGap`, all of one shape, in units of a and 1/Ω.
    """

    servo: Servo
    phase: Array
    place: Array
    sine: Array
    cosine: Array
    error: Array
    drive: Array


def steady_reversals(problem: OrbitProblem, standstill: Array) -> OrbitReversals:
    """Return the reversals of the orbits x(τ + π) = -x(τ) on which the axis stands for `standstill`.

    Parameters
    ----------
    problem : OrbitProblem
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
    return OrbitReversals(
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
        at_pickup = np.linalg.solve(system, _added_by_standing_grid(servo, standstill))
    except np.linalg.LinAlgError as error:
        raise SolveError(
            "the loop resonates with the command: there is no orbit at one of these standstills"
        ) from error
    return np.asarray(-over @ at_pickup)


def _added_by_standing_grid(servo: Servo, standstill: Array) -> Array:
    """Change of the deviation while the axis stands and the steady motion goes on, shape (n, state, 2)."""
    sine, versine = np.sin(standstill), 2.0 * np.sin(0.5 * standstill) ** 2
    rows = [np.stack([sine, versine], axis=-1), np.stack([-versine, sine], axis=-1)]
    if servo.ki_over_kp:
        lagging = free_motor_responses(SPEED, np.zeros(1), standstill).versine  # s - sin s
        rows.append(np.stack([-versine, -lagging], axis=-1))
    return np.stack(rows, axis=1)
