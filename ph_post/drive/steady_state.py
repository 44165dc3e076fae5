"""The steady state of an axis with the gap inside its loop on a circle, for one motor or a grid of motors.

The steady state repeats with the opposite sign after half a period: the axis reverses, stands for Δt, and
follows the loop for the rest. For a given Δt everything else is linear (:mod:`ph_post.drive.orbit`), so one
equation in Δt remains: the motor's angle after Δt is the gap. Reversals of the axis other than the one near
the command's (ringing) are ignored, as the paper does by starting Newton's method at 0.9 T; they are counted
and reported.

Over a grid of β and C the orbit for a given standstill depends on the loop alone, so that all pairs are
bracketed and closed at once.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, sections 4.1, 4.2 and 5.3.
"""

from __future__ import annotations

import math
import sys
from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.drive.backlash import motor_gain, motor_gap
from ph_post.drive.free_motor import ANGLE, free_motor_responses
from ph_post.drive.harmonic import GROWTH
from ph_post.drive.orbit import (
    OrbitProblem,
    OrbitReversal,
    OrbitReversals,
    count_ringing,
    first_reversal_state,
    state_problem,
    steady_reversal,
    steady_reversals,
)
from ph_post.drive.roots import close_bracket, close_brackets
from ph_post.drive.servo import effective_damping, is_stable
from ph_post.errors import SolveError
from ph_post.types import Array, BacklashInterval, BoolArray, Gap, Servo

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
NOT_TAKEN_UP: Final = "the motor does not cross the backlash between two reversals of the command"
TURNS_BACK: Final = "there is no orbit with one crossing of the backlash each way: the motor turns back inside it"
NOT_CROSSED: Final = "the motor does not cross the backlash within a period of the command, or comes back inside it"
NO_REVERSAL: Final = "the axis does not reverse within one and a half periods of the command"


def steady_interval(servo: Servo, gap: Gap, amplitude: float, omega: float) -> BacklashInterval | None:
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
    return _interval(problem, reversal, standstill, motor_gain(servo, gap) * amplitude, amplitude, omega), note


def _solve(problem: OrbitProblem) -> tuple[float, OrbitReversal, str]:
    """ΩΔt, the reversal and a note on ringing; SolveError where there is no such orbit."""
    standstill = _find_standstill(problem) if problem.gap else 0.0
    reversal = steady_reversal(problem, standstill)
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


def scaled_problem(servo: Servo, gap: Gap, amplitude: float, omega: float) -> OrbitProblem | str:
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
    """Return whether every constant that is given is 0 or of a size with which the arithmetic cannot overflow."""
    loop = (servo.b, servo.c, servo.ki_over_kp, servo.kd_over_kp)
    dead_zone = (
        gap.lost_motion,
        gap.motor_angle,
        gap.gear_ratio,
        gap.travel_per_rad,
        gap.inertia_fraction,
        gap.beta,
    )
    return _are_within(LARGEST, amplitude, omega, *filter(None, loop + dead_zone))


def _are_within(largest: float, *values: float) -> bool:
    return all(1.0 / largest < value < largest for value in values)


def _find_standstill(problem: OrbitProblem) -> float:
    """ΩΔt: the first at which the motor's angle, on the orbit that stands so long, is the gap."""

    def excess(standstill: float) -> float:
        try:
            return -steady_reversal(problem, standstill).gap.motor_angle(standstill) - problem.gap
        except SolveError:  # exactly at a pole
            return sys.float_info.max

    drive = abs(steady_reversal(problem, 0.0).gap.drive)
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


def _crosses_once(problem: OrbitProblem, reversal: OrbitReversal, standstill: float) -> bool:
    """Return whether the axis reverses from a maximum and the motor's angle stays between the flanks until Δt."""
    if reversal.place <= 0.0 or reversal.gap.drive >= 0.0:
        return False
    angles = [-reversal.gap.motor_angle(standstill * k / CHECKS) for k in range(1, CHECKS)]
    return all(0.0 <= angle <= problem.gap * (1.0 + SLACK) for angle in angles)


def _interval(
    problem: OrbitProblem,
    reversal: OrbitReversal,
    standstill: float,
    scale: float,
    amplitude: float,
    omega: float,
) -> BacklashInterval:
    """Scale back; `scale` is C a, so that scale/Ω² is the unit of the motor's angle."""
    residual = reversal.gap.Q(standstill, problem.gap) if standstill else 0.0
    return BacklashInterval(
        lag=reversal.phase / omega,
        duration=standstill / omega,
        position=amplitude * reversal.place,
        residual=residual * (scale / omega / omega),
    )


CHUNK: Final = 16384
"""Pairs of β and C solved at a time: their arrays then stay within some ten megabytes."""


class SteadyIntervals(NamedTuple):
    """Lag [s], Δt [s], x_i [m] as in BacklashInterval, shape (n_beta, n_C); NaN where there is no orbit."""

    lag: Array
    duration: Array
    position: Array


def with_motor(servo: Servo, gap: Gap, beta: float, gain: float) -> Gap:
    """Return a gap as it is, crossed by a motor of other β and C; C = N/(η r b) is put into η."""
    eta = (gap.gear_ratio or 1.0) / (gain * (gap.travel_per_rad or 1.0) * servo.b)
    return msgspec.structs.replace(gap, beta=beta, inertia_fraction=eta)


def steady_intervals(
    servo: Servo, gap: Gap, amplitude: float, omega: float, beta: Array, gain: Array
) -> SteadyIntervals:
    """Find the orbit of :func:`ph_post.drive.steady_state.find_orbit` for every pair of β and C.

    Implements the tables of Δt "for various combinations of the parameters β and C" in section 5.3 of [1]_,
    under a constant feed.

    Parameters
    ----------
    servo, gap : Servo, Gap
        P, PI or PID; β and η of the gap are not looked at.
    amplitude, omega : float
        a [m] and Ω [1/s], positive.
    beta, gain : ndarray, shapes (n_beta,), (n_C,)
        β [1/s], not negative, and C [rad/(m s²)], positive.
    """
    betas, gains = (grid.ravel() for grid in np.meshgrid(beta, gain, indexing="ij"))
    columns = np.full((3, betas.size), np.nan)
    problem = _common_problem(servo, gap, amplitude, omega, beta, gain)
    if problem is not None:
        sizes = motor_gap(gap) * omega * omega / (gains * amplitude)
        for start in range(0, betas.size, CHUNK):
            part = slice(start, start + CHUNK)
            columns[:, part] = _solve_grid(problem, betas[part] / omega, sizes[part])
        columns *= np.array([[1.0 / omega], [1.0 / omega], [amplitude]])
        unsettled = np.flatnonzero(np.isinf(columns[1]))
    else:
        unsettled = np.arange(betas.size)
    for index in unsettled.tolist():
        motor = with_motor(servo, gap, float(betas[index]), float(gains[index]))
        orbit, _ = find_orbit(servo, motor, amplitude, omega)
        columns[:, index] = (math.nan,) * 3 if orbit is None else (orbit.lag, orbit.duration, orbit.position)
    return SteadyIntervals(*columns.reshape(3, len(beta), len(gain)))


def _common_problem(
    servo: Servo, gap: Gap, amplitude: float, omega: float, beta: Array, gain: Array
) -> OrbitProblem | None:
    """Loop and command in units of a and 1/Ω; None where a corner of the grid leaves the range of sizes.

    None also where there is no gap: those few orbits are left to the scalar code.
    """
    if motor_gap(gap) == 0.0:
        return None
    corners = [(float(b), float(c)) for b in (beta.min(), beta.max()) for c in (gain.min(), gain.max())]
    problems = [scaled_problem(servo, with_motor(servo, gap, *corner), amplitude, omega) for corner in corners]
    first = problems[0]
    return None if isinstance(first, str) or any(isinstance(one, str) for one in problems) else first


def _solve_grid(problem: OrbitProblem, beta: Array, size: Array) -> Array:
    """Return phase, standstill and place for pairs of β/Ω and gap Δθ_m Ω²/(C a), shape (3, n).

    NaN where there is no orbit; an infinite standstill where the scalar code must look.
    """
    try:
        low, high = _brackets(problem, beta, size)
        found = np.flatnonzero(high > 0.0)
        answer = np.full((3, beta.size), np.nan)
        if found.size:
            answer[:, found] = _close(problem, beta[found], size[found], low[found], high[found])
    except SolveError:  # an orbit exactly at a pole
        answer = np.full((3, beta.size), np.inf)
    return answer


def _brackets(problem: OrbitProblem, beta: Array, size: Array) -> tuple[Array, Array]:
    """First stretch of standstills over which the motor's angle rises past the gap; 0, 0 if none does.

    The search is the scalar code's, so that both find the same one of several orbits.
    """
    drive = abs(float(steady_reversals(problem, np.zeros(1)).drive[0]))
    estimate = np.minimum((24.0 * size) ** 0.25, np.sqrt(2.0 * size / drive) if drive else np.inf)
    low, high = np.zeros_like(size), np.minimum(0.25 * estimate, LONGEST_STEP)
    below, searching = -size, np.arange(size.size)
    while searching.size:
        ends = high[searching]
        above = _turned(steady_reversals(problem, ends), beta[searching], ends) - size[searching]
        on = searching[~((below[searching] < 0.0) & (above >= 0.0))]
        below[searching] = above
        low[on], high[on] = high[on], np.minimum(np.minimum(GROWTH * high[on], high[on] + LONGEST_STEP), LAST)
        lost = on[low[on] >= LAST]
        low[lost] = high[lost] = 0.0
        searching = on[low[on] > 0.0]
    return low, high


def _close(problem: OrbitProblem, beta: Array, size: Array, low: Array, high: Array) -> Array:
    """Close the brackets; what closes on a jump, and no root, is left to the scalar code."""

    def excess(standstill: Array, beta: Array, size: Array) -> Array:
        return _turned(steady_reversals(problem, standstill), beta, standstill) - size

    standstill = close_brackets(excess, low, high, beta, size)
    reversals = steady_reversals(problem, standstill)
    answer = np.stack([reversals.phase, standstill, reversals.place])
    answer[:, ~_cross_once(reversals, beta, size, standstill)] = np.nan
    jumps = ~(np.abs(excess(standstill, beta, size)) <= SLACK * size)
    answer[1, jumps] = np.inf
    return answer


def _turned(reversals: OrbitReversals, beta: Array, standstill: Array) -> Array:
    """How far the motor has turned, in units of C a/Ω², towards the flank ahead: f(Δt) - f(0) of Eq. (21)."""
    unit = free_motor_responses(ANGLE, beta, standstill)
    servo = reversals.servo
    total = reversals.drive * unit.step + reversals.cosine * unit.sine - reversals.sine * unit.versine
    if servo.ki_over_kp:
        swept = reversals.cosine * unit.versine - reversals.sine * unit.lagging
        total = total + servo.ki_over_kp * (reversals.error * unit.ramp + swept)
    if servo.kd_over_kp:
        total = total - servo.kd_over_kp * (reversals.sine * unit.sine + reversals.cosine * unit.versine)
    return -total


def _cross_once(reversals: OrbitReversals, beta: Array, size: Array, standstill: Array) -> BoolArray:
    """Return whether the axis reverses from a maximum and the motor stays between the flanks until Δt."""
    once: BoolArray = (reversals.place > 0.0) & (reversals.drive < 0.0)
    for part in range(1, CHECKS):
        turned = _turned(reversals, beta, standstill * (part / CHECKS))
        once &= (turned >= 0.0) & (turned <= size * (1.0 + SLACK))
    return once
