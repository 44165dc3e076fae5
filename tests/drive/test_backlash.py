"""Eq. (32): the motor in the gap under a feed that changes with time."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.optimize import brentq
from support.drives import AMPLITUDE, OMEGA, PAPER_GAP, PAPER_SERVO, axis
from support.paper_equations import motor_motion, open_gap

from ph_post.drive.backlash import gap_constant, modulated_interval
from ph_post.types import Gap, Servo

Motion = Callable[[NDArray[np.float64]], NDArray[np.float64]]
GAIN = gap_constant(axis())


def constant(value: float) -> Motion:
    return lambda t: np.full_like(t, value)


def by_quadrature(position: Motion, x_i: float, high: float) -> float:
    """Δt from Eqs. (15) and (17) with the convolution by Gauss-Legendre quadrature."""

    def excess(t: float) -> float:
        return abs(motor_motion(position, x_i, GAIN, 1.0, t)[1]) - 0.125664

    return float(brentq(excess, 1e-3, high, rtol=1e-15, xtol=1e-18))


def dip(ratio: float, t_star: float = 0.5) -> Motion:
    """X(t) of Eqs. (26)-(30) as in section 6: n = 10, all V_k = V_c but V_5, on the circle of 250 mm."""
    f = (256.0 * ratio - 193.0) / 63.0
    speeds = [1.0] * 5 + [f] + [1.0] * 5
    sums = np.concatenate([[0.0], np.cumsum(speeds)]) / 11.0

    def position(t: NDArray[np.float64]) -> NDArray[np.float64]:
        tau = np.clip((t + t_star) / (2.0 * t_star), 0.0, 1.0)
        binomials = [math.comb(11, k) for k in range(12)]
        swept = sum(binomials[k] * sums[k] * (1.0 - tau) ** (11 - k) * tau**k for k in range(12))
        after = np.maximum(t - t_star, 0.0)
        angle = OMEGA * (2.0 * t_star * (swept - 0.5 * sums[-1]) + after)
        return -2.0 * AMPLITUDE * np.sin(0.5 * angle) ** 2  # ρ (cos Θ - 1)

    return position


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_constant_error_in_closed_form(sense: float) -> None:
    """θ = C e (t - (1 - exp(-βt))/β)/β."""
    interval, note = modulated_interval(axis(), constant(0.1 + sense * 1e-4), 0.1, 2.0)
    assert interval is not None
    assert note == ""
    error = abs((0.1 + sense * 1e-4) - 0.1)
    t = interval.duration
    assert GAIN * error * (t + math.expm1(-t)) == pytest.approx(0.125664, rel=1e-11)
    assert interval.position == 0.1
    assert interval.lag == 0.0
    assert abs(interval.residual) < 1e-12


def test_harmonic_command_is_that_of_eq22() -> None:
    t_i, x_i = 3.005, 0.25003341707
    interval, _ = modulated_interval(axis(), lambda t: AMPLITUDE * np.sin(OMEGA * (t_i + t)), x_i, 1.0)
    exact = open_gap(GAIN, 1.0, AMPLITUDE, OMEGA, t_i, x_i).duration(0.125664)
    assert interval is not None
    # X - x_i is formed from floats near a: 2^-53 a beside 3.4e-5 m; the integration's tolerance is 1e-12.
    assert interval.duration == pytest.approx(exact, rel=4e-12)


@pytest.mark.parametrize("ratio", [1.0, 0.25, 0.0])
def test_dip_of_the_paper_by_two_ways(ratio: float) -> None:
    position = dip(ratio)
    x_i = 3.3e-5  # the servo lags a little behind: the axis stands beyond the turning point
    interval, _ = modulated_interval(axis(), position, x_i, 2.0)
    assert interval is not None
    assert interval.duration == pytest.approx(by_quadrature(position, x_i, 2.0), rel=1e-10)


def test_deeper_dip_takes_longer_over_the_gap() -> None:
    found = [modulated_interval(axis(), dip(ratio), 3.3e-5, 2.0)[0] for ratio in (1.0, 0.5, 0.25)]
    durations = [interval.duration for interval in found if interval is not None]
    assert durations == sorted(durations)
    assert len(durations) == 3


def test_integrator_runs_on_in_the_gap() -> None:
    """PI with a constant error e: ω̇ + βω = C (e + k_i (∫e + e t)), convolved by hand."""
    servo = Servo(b=0.0005, c=0.005, ki_over_kp=4.0)
    interval, _ = modulated_interval(axis(servo), constant(1e-4), 0.0, 2.0, integral=1e-5)
    assert interval is not None
    t = interval.duration
    step = t + math.expm1(-t)
    ramp = 0.5 * t * t - step
    assert GAIN * ((1e-4 + 4.0 * 1e-5) * step + 4.0 * 1e-4 * ramp) == pytest.approx(0.125664, rel=1e-11)


def test_differential_part_acts_on_the_command_alone() -> None:
    """PD with X - x_i = v t: ω̇ + βω = C v (t + k_d)."""
    servo = Servo(b=0.0005, c=0.005, kd_over_kp=0.1)
    interval, _ = modulated_interval(axis(servo), lambda t: -1e-3 * t, 0.0, 2.0)
    assert interval is not None
    t = interval.duration
    step = t + math.expm1(-t)
    assert GAIN * 1e-3 * (0.1 * step + 0.5 * t * t - step) == pytest.approx(0.125664, rel=1e-11)


def test_stiff_motor() -> None:
    """β of 1e5 /s over 2 s: θ is nearly C e t/β. The implicit method's tolerance is 1e-9 a step."""
    gap = replace(PAPER_GAP, beta=1e5)
    interval, _ = modulated_interval(axis(gap=gap), constant(0.2), 0.0, 2.0)
    assert interval is not None
    exact = 0.125664 * 1e5 / (GAIN * 0.2) + 1e-5
    assert interval.duration == pytest.approx(exact, rel=1e-7)


def test_words_where_there_is_no_interval() -> None:
    interval, note = modulated_interval(axis(gap=Gap(lost_motion=1e-4), feedback="motor"), constant(1.0), 0.0, 1.0)
    assert interval is None
    assert "outside" in note
    interval, note = modulated_interval(axis(), constant(1e-9), 0.0, 0.1)
    assert interval is None
    assert "in the time looked at" in note
    interval, note = modulated_interval(axis(), constant(0.0), 0.0, 0.1)
    assert interval is None
    assert "in the time looked at" in note
    interval, note = modulated_interval(axis(), lambda t: 1e-5 * np.where(t < 0.05, 1.0, -1.0), 0.0, 0.5)
    assert interval is None
    assert "comes back to the side it has left" in note


def test_no_gap_no_time() -> None:
    gap = replace(PAPER_GAP, motor_angle=0.0, lost_motion=0.0)
    interval, _ = modulated_interval(axis(PAPER_SERVO, gap), constant(1.0), 0.0, 1.0)
    assert interval is not None
    assert interval.duration == 0.0
