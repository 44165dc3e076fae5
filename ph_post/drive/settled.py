"""The orbit an axis with the gap inside its loop settles to on a circle, and its first reversal from rest.

The settled orbit repeats with the opposite sign after half a period, as the paper's does: the axis
reverses, stands for Δt, and follows the loop for the rest. For a given Δt everything else is linear
(:mod:`ph_post.drive.orbit`), so one equation in Δt remains: the motor's angle after Δt is the gap.
Reversals of the axis other than the one near the command's (ringing) are left out, as the paper does by
starting Newton's method at 0.9 T; they are counted and told.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, sections 4.1 and 4.2.
"""

from __future__ import annotations

import math
import sys
from typing import Final

from ph_post.drive.gap import motor_gain, motor_gap
from ph_post.drive.harmonic import GROWTH
from ph_post.drive.orbit import (
    Problem,
    Reversal,
    count_ringing,
    first_reversal_state,
    settled_reversal,
    state_problem,
)
from ph_post.drive.roots import close_bracket
from ph_post.drive.servo import effective_damping, is_stable
from ph_post.errors import SolveError
from ph_post.types import BacklashInterval, Gap, Servo

LARGEST: Final = 1e30
"""Largest value in SI units that is computed with, and inverse of the smallest: no product overflows."""

LARGEST_RATIO: Final = 1e18
"""Likewise for ratios between the times (or lengths) of loop, motor and command."""

LONGEST_STEP: Final = math.pi / 48.0
"""Longest step in the search for ΩΔt over its range (0, π)."""

LAST: Final = math.pi * (1.0 - 1e-6)
"""End of that search: at π the axis would not move at all."""

CHECKS: Final = 8
"""Places inside the interval at which the motor's angle is looked at."""

SLACK: Final = 1e-9
"""Excess of the motor's angle over the gap, relative, that is rounding: a root with more is a jump (the
orbit of a PI loop can have poles in Δt)."""

OUT_OF_RANGE: Final = "the times of loop, motor and command are too far apart to be computed"
UNDAMPED: Final = "the loop's free motion does not die out, so that there is no settled orbit"
NOT_TAKEN_UP: Final = "the motor does not cross the gap between two reversals of the command"
TURNS_BACK: Final = "there is no orbit with one crossing of the gap each way: the motor turns back inside it"
NOT_CROSSED: Final = (
    "the motor does not cross the gap within a period of the command, or comes back inside it"
)
NO_REVERSAL: Final = "the axis does not reverse within one and a half periods of the command"


def settled_orbit(servo: Servo, gap: Gap, amplitude: float, omega: float) -> BacklashInterval | None:
    """Return the backlash interval of the settled orbit; None where :func:`find_orbit` says why."""
    return find_orbit(servo, gap, amplitude, omega)[0]


def find_orbit(servo: Servo, gap: Gap, amplitude: float, omega: float) -> tuple[BacklashInterval | None, str]:
    """Find the orbit of period 2T to which the axis settles under X = a sin Ωt, with feedback from the table.

    Implements Eqs. (14)-(22) of [1]_ for the repetitive behaviour of section 4.2; the integrator of a PI or
    PID controller runs on in the gap.

    Parameters
    ----------
    servo, gap : Servo, Gap
    amplitude, omega : float
        a [m] and Ω [1/s], positive.

    Returns
    -------
    interval : BacklashInterval or None
        `position` is that of a maximum, about the centre of the swing.
    note : str
        Why there is none, or what was left out; empty otherwise.
    """
    problem = scaled_problem(servo, gap, amplitude, omega)
    if isinstance(problem, str):
        return None, problem
    try:
        standstill, reversal, note = _solve(problem)
    except SolveError as error:
        return None, str(error)
    return _interval(
        problem, reversal, standstill, motor_gain(servo, gap) * amplitude, amplitude, omega
    ), note


def _solve(problem: Problem) -> tuple[float, Reversal, str]:
    """ΩΔt, the reversal and a note on ringing; SolveError where there is no such orbit."""
    standstill = _find_standstill(problem) if problem.gap else 0.0
    reversal = settled_reversal(problem, standstill)
    if not _crosses_once(problem, reversal, standstill):
        raise SolveError(TURNS_BACK)
    rings = count_ringing(problem, reversal, standstill) if standstill else 0
    note = f"the axis rings: {rings} reversals between two of the command's are left out" if rings else ""
    return standstill, reversal, note


def first_reversal(servo: Servo, gap: Gap, amplitude: float, omega: float) -> BacklashInterval:
    """Return the first reversal from x(0) = 0, ẋ(0) = aΩ under X = a sin Ωt, and the interval it opens.

    Implements the start of section 4.2 of [1]_. A PI or PID controller starts with an empty integrator.

    Raises
    ------
    SolveError
        Where the axis does not reverse in time, or the motor does not cross the gap.
    """
    problem = scaled_problem(servo, gap, amplitude, omega)
    if isinstance(problem, str):
        raise SolveError(problem)
    reversal = first_reversal_state(problem)
    if reversal is None:
        raise SolveError(NO_REVERSAL)
    standstill = reversal.gap.duration(problem.gap) if problem.gap else 0.0
    if standstill is None:
        raise SolveError(NOT_CROSSED)
    return _interval(problem, reversal, standstill, motor_gain(servo, gap) * amplitude, amplitude, omega)


def scaled_problem(servo: Servo, gap: Gap, amplitude: float, omega: float) -> Problem | str:
    """Scale the problem by a and 1/Ω, or say why it has no settled orbit."""
    if not is_computable(servo, gap, amplitude, omega):
        return OUT_OF_RANGE
    if not is_stable(servo):
        return UNDAMPED
    scaled = Servo(
        b=servo.b * omega * omega,
        c=servo.c * omega,
        ki_over_kp=servo.ki_over_kp / omega,
        kd_over_kp=servo.kd_over_kp * omega,
    )
    beta = (gap.beta or 0.0) / omega
    size = motor_gap(gap) / motor_gain(servo, gap) / amplitude * omega * omega
    may_be_zero = (scaled.c, scaled.ki_over_kp, scaled.kd_over_kp, beta, size)
    if not _are_within(LARGEST_RATIO, scaled.b, effective_damping(scaled), *filter(None, may_be_zero)):
        return OUT_OF_RANGE
    return state_problem(scaled, beta, size)


def is_computable(servo: Servo, gap: Gap, amplitude: float, omega: float) -> bool:
    """Whether every constant that is given is 0 or of a size with which the arithmetic cannot overflow."""
    loop = (servo.b, servo.c, servo.ki_over_kp, servo.kd_over_kp)
    dead_zone = (
        gap.lost_motion, gap.motor_angle, gap.gear_ratio, gap.travel_per_rad, gap.inertia_fraction, gap.beta
    )  # fmt: skip
    return _are_within(LARGEST, amplitude, omega, *filter(None, loop + dead_zone))


def _are_within(largest: float, *values: float) -> bool:
    return all(1.0 / largest < value < largest for value in values)


def _find_standstill(problem: Problem) -> float:
    """ΩΔt: the first at which the motor's angle, on the orbit that stands so long, is the gap."""

    def excess(standstill: float) -> float:
        try:
            return -settled_reversal(problem, standstill).gap.motor_angle(standstill) - problem.gap
        except SolveError:  # exactly at a pole
            return sys.float_info.max

    drive = abs(settled_reversal(problem, 0.0).gap.drive)
    estimate = min((24.0 * problem.gap) ** 0.25, math.sqrt(2.0 * problem.gap / drive) if drive else math.inf)
    low, high = 0.0, min(0.25 * estimate, LONGEST_STEP)
    below = -problem.gap
    while low < LAST:
        above = excess(high)
        if below < 0.0 <= above:
            root = close_bracket(excess, low, high)
            if abs(excess(root)) <= SLACK * problem.gap:
                return root
        low, high, below = high, min(GROWTH * high, high + LONGEST_STEP, LAST), above
    raise SolveError(NOT_TAKEN_UP)


def _crosses_once(problem: Problem, reversal: Reversal, standstill: float) -> bool:
    """Whether the axis reverses from a maximum and the motor's angle stays between the flanks until Δt."""
    if reversal.place <= 0.0 or reversal.gap.drive >= 0.0:
        return False
    angles = [-reversal.gap.motor_angle(standstill * k / CHECKS) for k in range(1, CHECKS)]
    return all(0.0 <= angle <= problem.gap * (1.0 + SLACK) for angle in angles)


def _interval(
    problem: Problem, reversal: Reversal, standstill: float, scale: float, amplitude: float, omega: float
) -> BacklashInterval:
    """Scale back; `scale` is C a, so that scale/Ω² is the unit of the motor's angle."""
    residual = reversal.gap.Q(standstill, problem.gap) if standstill else 0.0
    return BacklashInterval(
        lag=reversal.phase / omega,
        duration=standstill / omega,
        position=amplitude * reversal.place,
        residual=residual * (scale / omega / omega),
    )
