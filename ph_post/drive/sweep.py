"""The settled backlash interval over whole grids of β and C, as section 5.3 of [1]_ wants it off line.

Which orbit closes on a standstill of a given length depends on the loop alone; β and C only decide which of
these standstills brings the motor across its gap. That leaves one equation in Δt for every pair of β and C;
all of them are bracketed and closed at once, by the steps that :mod:`ph_post.drive.settled` takes for one.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, sections 4.1, 4.2 and 5.3.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.drive.forced import ANGLE
from ph_post.drive.forced_grid import free_motor_responses
from ph_post.drive.gap import motor_gap
from ph_post.drive.harmonic import GROWTH
from ph_post.drive.orbit import Problem
from ph_post.drive.orbit_grid import Reversals, settled_reversals
from ph_post.drive.root_grid import close_brackets
from ph_post.drive.settled import CHECKS, LAST, LONGEST_STEP, SLACK, find_orbit, scaled_problem
from ph_post.errors import SolveError
from ph_post.types import Array, BoolArray, Gap, Servo

CHUNK: Final = 16384
"""Pairs of β and C solved at a time: their arrays then stay within some ten megabytes."""


class Settled(NamedTuple):
    """Lag [s], Δt [s], x_i [m] as in BacklashInterval, shape (n_beta, n_C); NaN where there is no orbit."""

    lag: Array
    duration: Array
    position: Array


def with_motor(servo: Servo, gap: Gap, beta: float, gain: float) -> Gap:
    """Return a gap as it is, crossed by a motor of other β and C; C = N/(η r b) is put into η."""
    eta = (gap.gear_ratio or 1.0) / (gain * (gap.travel_per_rad or 1.0) * servo.b)
    return msgspec.structs.replace(gap, beta=beta, inertia_fraction=eta)


def settled_orbits(
    servo: Servo, gap: Gap, amplitude: float, omega: float, beta: Array, gain: Array
) -> Settled:
    """Find the orbit of :func:`ph_post.drive.settled.find_orbit` for every pair of β and C.

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
            columns[:, part] = _solve(problem, betas[part] / omega, sizes[part])
        columns *= np.array([[1.0 / omega], [1.0 / omega], [amplitude]])
        unsettled = np.flatnonzero(np.isinf(columns[1]))
    else:
        unsettled = np.arange(betas.size)
    for index in unsettled.tolist():
        motor = with_motor(servo, gap, float(betas[index]), float(gains[index]))
        orbit, _ = find_orbit(servo, motor, amplitude, omega)
        columns[:, index] = (math.nan,) * 3 if orbit is None else (orbit.lag, orbit.duration, orbit.position)
    return Settled(*columns.reshape(3, len(beta), len(gain)))


def _common_problem(
    servo: Servo, gap: Gap, amplitude: float, omega: float, beta: Array, gain: Array
) -> Problem | None:
    """Loop and command in units of a and 1/Ω; None where a corner of the grid leaves the range of sizes.

    None also where there is no gap: those few orbits are left to the scalar code.
    """
    if motor_gap(gap) == 0.0:
        return None
    corners = [(float(b), float(c)) for b in (beta.min(), beta.max()) for c in (gain.min(), gain.max())]
    problems = [
        scaled_problem(servo, with_motor(servo, gap, *corner), amplitude, omega) for corner in corners
    ]
    first = problems[0]
    return None if isinstance(first, str) or any(isinstance(one, str) for one in problems) else first


def _solve(problem: Problem, beta: Array, size: Array) -> Array:
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


def _brackets(problem: Problem, beta: Array, size: Array) -> tuple[Array, Array]:
    """First stretch of standstills over which the motor's angle rises past the gap; 0, 0 if none does.

    The search is the scalar code's, so that both find the same one of several orbits.
    """
    drive = abs(float(settled_reversals(problem, np.zeros(1)).drive[0]))
    estimate = np.minimum((24.0 * size) ** 0.25, np.sqrt(2.0 * size / drive) if drive else np.inf)
    low, high = np.zeros_like(size), np.minimum(0.25 * estimate, LONGEST_STEP)
    below, searching = -size, np.arange(size.size)
    while searching.size:
        ends = high[searching]
        above = _turned(settled_reversals(problem, ends), beta[searching], ends) - size[searching]
        on = searching[~((below[searching] < 0.0) & (above >= 0.0))]
        below[searching] = above
        low[on], high[on] = high[on], np.minimum(np.minimum(GROWTH * high[on], high[on] + LONGEST_STEP), LAST)
        lost = on[low[on] >= LAST]
        low[lost] = high[lost] = 0.0
        searching = on[low[on] > 0.0]
    return low, high


def _close(problem: Problem, beta: Array, size: Array, low: Array, high: Array) -> Array:
    """Close the brackets; what closes on a jump, and no root, is left to the scalar code."""

    def excess(standstill: Array) -> Array:
        return _turned(settled_reversals(problem, standstill), beta, standstill) - size

    standstill = close_brackets(excess, low, high)
    reversals = settled_reversals(problem, standstill)
    answer = np.stack([reversals.phase, standstill, reversals.place])
    answer[:, ~_crosses_once(reversals, beta, size, standstill)] = np.nan
    jumps = ~(np.abs(excess(standstill)) <= SLACK * size)
    answer[1, jumps] = np.inf
    return answer


def _turned(reversals: Reversals, beta: Array, standstill: Array) -> Array:
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


def _crosses_once(reversals: Reversals, beta: Array, size: Array, standstill: Array) -> BoolArray:
    """Whether the axis reverses from a maximum and the motor stays between the flanks until Δt."""
    once: BoolArray = (reversals.place > 0.0) & (reversals.drive < 0.0)
    for part in range(1, CHECKS):
        turned = _turned(reversals, beta, standstill * (part / CHECKS))
        once &= (turned >= 0.0) & (turned <= size * (1.0 + SLACK))
    return once
