"""PI, PD and PID loops with the gap inside: against the P closed form, and against integration from rest."""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace
from support.drives import AMPLITUDE, OMEGA, PAPER_GAP, PAPER_SERVO, run_drive

from ph_post.drive.backlash import motor_gain, motor_gap
from ph_post.drive.steady_state import find_orbit, first_reversal
from ph_post.types import Servo


def test_vanishing_integrator_is_the_closed_form() -> None:
    """The third-order path with k_i at 1e-12: what k_i does is far below what is compared."""
    orbit, _ = find_orbit(PAPER_SERVO, PAPER_GAP, AMPLITUDE, OMEGA)
    nearly, _ = find_orbit(replace(PAPER_SERVO, ki_over_kp=1e-12), PAPER_GAP, AMPLITUDE, OMEGA)
    assert orbit is not None
    assert nearly is not None
    # ∫e over half a period is below a T = 1.5 m s: k_i ∫e < 2e-12 m beside X - x_i = 3.4e-5 m, 5e-8 of it at
    # the very most; lag and place hang on bẍ alone, whose share of that is b Ω² = 1.4e-4.
    assert nearly.duration == pytest.approx(orbit.duration, rel=5e-8)
    assert nearly.lag == pytest.approx(orbit.lag, rel=1e-9)
    assert nearly.position == pytest.approx(orbit.position, rel=1e-11)


def test_pd_loop_is_a_p_loop_until_the_gap_opens() -> None:
    """k_d adds to c in the loop, but acts on Ẋ alone in the gap, where the axis stands."""
    orbit, _ = find_orbit(Servo(b=0.0005, c=0.005, kd_over_kp=1e-12), PAPER_GAP, AMPLITUDE, OMEGA)
    plain, _ = find_orbit(PAPER_SERVO, PAPER_GAP, AMPLITUDE, OMEGA)
    assert orbit is not None
    assert plain is not None
    # k_d Ẋ <= 1e-12 · 0.131 m beside X - x_i = 3.4e-5 m.
    assert orbit.duration == pytest.approx(plain.duration, rel=4e-9)


@pytest.mark.parametrize(
    "servo",
    [
        Servo(b=0.0005, c=0.02, ki_over_kp=2.0),
        Servo(b=0.0005, c=0.005, kd_over_kp=0.02),
        Servo(b=0.0005, c=0.01, ki_over_kp=3.0, kd_over_kp=0.02),
    ],
)
@pytest.mark.parametrize("beta", [0.0, 1.0, 40.0])
@pytest.mark.thinned(6)
def test_settled_orbit_and_first_reversal_by_integration(servo: Servo, beta: float) -> None:
    """Eight reversals from rest: T is 2 s, the slowest mode's time 1/2 s: exp(-28) of the start is left."""
    gap = replace(PAPER_GAP, beta=beta)
    omega = math.pi / 2.0
    orbit, note = find_orbit(servo, gap, AMPLITUDE, omega)
    begin = first_reversal(servo, gap, AMPLITUDE, omega)
    assert orbit is not None
    assert note == ""
    reversals = run_drive(servo, motor_gain(servo, gap), beta, motor_gap(gap), AMPLITUDE, omega, count=8)
    for run, ours in ((reversals[0], begin), (reversals[-1], orbit)):
        assert run.lag == pytest.approx(ours.lag, abs=2e-9)  # relative tolerance 1e-11 of the integration
        assert run.position == pytest.approx(ours.position, abs=1e-9)
        assert run.duration == pytest.approx(ours.duration, abs=2e-8)
