"""Backlash intervals by feedback: the gap in the loop, the play behind it, the words where there is none."""

from __future__ import annotations

import math
import time

import mpmath as mp
import numpy as np
import pytest
from msgspec.structs import replace
from support.drives import AMPLITUDE, OMEGA, PAPER_GAP, PAPER_SERVO, Printed, axis, gap_of
from support.paper_equations import motor_motion, open_gap

from ph_post.drive.backlash import gap_constant, motor_gain, motor_gap
from ph_post.drive.intervals import backlash_interval, play_interval
from ph_post.drive.steady_state import find_orbit, first_reversal
from ph_post.errors import InputError, SolveError
from ph_post.types import EffectSetting, Gap, Servo

EPS = 2.0**-52


@pytest.mark.parametrize(
    ("natural", "damping", "beta", "gain", "period", "fraction"),
    [
        (45.0, 0.11, 1.0, 1.4e5, 6.0, 1e-3),
        (300.0, 0.7, 20.0, 1e4, 0.7, 1e-2),
        (300.0, 3.0, 5.0, 1e6, 0.2, 1e-4),
        (20.0, 1.0, 0.2, 1e3, 3.0, 0.1),
        (900.0, 0.3, 100.0, 1e5, 20.0, 1e-6),
        (100.0, 8.0, 0.01, 1e5, 1.0, 0.3),
    ],
)
def test_settled_orbit_is_that_of_the_printed_equations(
    natural: float, damping: float, beta: float, gain: float, period: float, fraction: float
) -> None:
    """From stiff to soft, ringing to creeping: the three unknowns of (19)-(22) against 50 digits."""
    servo = Servo(b=1.0 / natural**2, c=2.0 * damping / natural)
    omega = math.pi / period
    gap = gap_of(gain, beta, fraction * gain * 0.05 / omega**2, servo.b)
    orbit, _ = find_orbit(servo, gap, 0.05, omega)
    assert orbit is not None
    with mp.workdps(50):
        reference = Printed(servo.b, servo.c, motor_gain(servo, gap), beta, 0.05, omega)
        half = mp.pi / reference.W / 2
        start = (float(half) + orbit.lag, orbit.position, orbit.duration)
        t_i, x_i, dt = reference.settled(motor_gap(gap), start)
        exact = (float(t_i - half), float(x_i), float(dt))
    assert orbit.duration == pytest.approx(exact[2], rel=16 * EPS)
    # Lag and place carry the free motion, whose phase λ (T - Δt) is known to an ulp of itself.
    turns = 16 * EPS * max(1.0, natural * period)
    assert orbit.lag == pytest.approx(exact[0], rel=turns)
    assert orbit.position == pytest.approx(exact[1], rel=turns)


def play(motor: np.ndarray, lost_motion: float) -> np.ndarray:
    """The play operator, sample by sample."""
    table = np.empty_like(motor)
    here = motor[0]
    for index, place in enumerate(motor):
        here = min(max(here, place - 0.5 * lost_motion), place + 0.5 * lost_motion)
        table[index] = here
    return table


@pytest.mark.parametrize("feedback", ["motor", "none"])
def test_play_behind_the_loop(feedback: str) -> None:
    """Against the play operator on samples of the settled motion, 0.1 ms apart."""
    drive = axis(gap=Gap(lost_motion=0.004), feedback=feedback)
    interval, note = backlash_interval(drive, AMPLITUDE, OMEGA)
    assert interval is not None
    assert note == ""
    step = 1e-4
    t = np.arange(0.0, 18.0, step)
    below = complex(1.0 - 0.0005 * OMEGA**2, 0.005 * OMEGA)
    motor = np.imag(AMPLITUDE / below * np.exp(1j * OMEGA * t))
    table = play(motor, 0.004)
    standing = np.flatnonzero((np.diff(table) == 0.0) & (t[1:] > 14.0) & (t[1:] < 16.0))
    assert standing.size * step == pytest.approx(interval.duration, abs=2 * step)
    # The reversal is where the motor's is, found from samples that lie symmetrically about it.
    assert t[standing[0]] - 15.0 == pytest.approx(interval.lag, abs=2 * step)
    assert table.max() == pytest.approx(interval.position, rel=1e-9)  # 1 - cos(Ω step/2) of a sample beside the top


def test_ideal_stepper_in_closed_form() -> None:
    drive = axis(Servo(b=0.0, c=0.0), Gap(lost_motion=1e-4), "none")
    interval, note = backlash_interval(drive, 0.02, 1.0)
    assert interval is not None
    assert note == ""
    assert interval.lag == 0.0
    # The reference loses half of 1e-16/(1 - x) in 1 - x = 0.005.
    assert interval.duration == pytest.approx(math.acos(1.0 - 1e-4 / 0.02), rel=1e-13)
    assert interval.position == pytest.approx(0.02 - 0.5e-4, rel=2 * EPS)


def test_play_of_the_whole_swing_and_of_more() -> None:
    servo, swing = Servo(b=0.0, c=0.0), 0.001
    interval, _ = play_interval(servo, Gap(lost_motion=2.0 * swing), swing, 4.0)
    assert interval is not None
    assert interval.duration == pytest.approx(math.pi / 4.0, rel=2 * EPS)
    assert interval.position == 0.0
    interval, note = play_interval(servo, Gap(lost_motion=2.1 * swing), swing, 4.0)
    assert interval is None
    assert "lost motion" in note


def test_play_does_not_shrink_with_the_feed() -> None:
    """The standstill covers the same piece of the path at every feed: modulation does not help here."""
    travel = [
        feed * interval.duration
        for feed in (0.001, 0.01, 0.1)
        if (interval := play_interval(Servo(b=0.0, c=0.0), Gap(lost_motion=1e-4), 0.05, feed / 0.05)[0])
    ]
    assert travel == pytest.approx([travel[0]] * 3, rel=8 * EPS)


@pytest.mark.parametrize("feedback", ["load", "motor", "none"])
def test_no_gap_no_standstill(feedback: str) -> None:
    gap = replace(PAPER_GAP, lost_motion=0.0, motor_angle=0.0)
    interval, note = backlash_interval(axis(gap=gap, feedback=feedback), AMPLITUDE, OMEGA)
    assert interval is not None
    assert note == ""
    assert interval.duration == 0.0
    assert interval.residual == 0.0
    below = complex(1.0 - 0.0005 * OMEGA**2, 0.005 * OMEGA)
    assert interval.position == pytest.approx(AMPLITUDE / abs(below), rel=4 * EPS)
    assert interval.lag == pytest.approx(math.atan2(below.imag, below.real) / OMEGA, rel=4 * EPS)


@pytest.mark.parametrize(
    ("amplitude", "omega"),
    [(0.0, 1.0), (1.0, 0.0), (math.nan, 1.0), (1.0, math.inf), (-1.0, 1.0), (1.0, math.nan)],
)
def test_no_swing(amplitude: float, omega: float) -> None:
    interval, note = backlash_interval(axis(), amplitude, omega)
    assert interval is None
    assert "positive" in note


def test_gap_never_taken_up() -> None:
    """A swing so small that the motor is still inside the gap when the command comes back."""
    interval, note = backlash_interval(axis(), 1e-8, OMEGA)
    assert interval is None
    assert "does not cross the backlash" in note


@pytest.mark.parametrize("feedback", ["load", "motor", "none"])
def test_loop_that_does_not_settle(feedback: str) -> None:
    for servo in (Servo(b=0.0005, c=0.0), Servo(b=0.0005, c=0.005, ki_over_kp=11.0)):
        interval, note = backlash_interval(axis(servo, feedback=feedback), AMPLITUDE, OMEGA)
        assert interval is None
        assert "does not die out" in note


def test_times_too_far_apart() -> None:
    for amplitude, omega in ((1e-300, 1.0), (1.0, 1e-200), (1e200, 1.0), (1.0, 1e200)):
        interval, note = backlash_interval(axis(), amplitude, omega)
        assert interval is None
        assert note != ""


def test_loop_without_inertia_crosses_at_once() -> None:
    interval, note = backlash_interval(axis(Servo(b=0.0, c=0.005)), AMPLITUDE, OMEGA)
    assert interval is not None
    assert interval.duration == 0.0
    assert interval.lag == pytest.approx(math.atan(0.005 * OMEGA) / OMEGA, rel=4 * EPS)
    assert "inertia" in note


def test_ringing_is_told() -> None:
    """A quarter of the damping: the axis rings back after pick-up, which the orbit leaves out."""
    servo = Servo(b=0.0005, c=0.00125)
    orbit, note = find_orbit(servo, PAPER_GAP, AMPLITUDE, OMEGA)
    assert orbit is not None
    assert note.startswith("the axis rings: ")
    t_s = 3.0 + orbit.lag + orbit.duration
    reference = Printed(servo.b, servo.c, 1.0, 1.0, AMPLITUDE, OMEGA)  # the ringing has a period of 0.14 s
    t = np.linspace(t_s + 1e-4, 9.0 + orbit.lag - 1e-4, 1500)
    backwards = [reference.motion(mp.mpf(t_s), mp.mpf(orbit.position), mp.mpf(float(s)))[1] > 0 for s in t]
    counted = int(np.count_nonzero(np.diff(backwards)))
    assert counted > 0
    assert f"rings: {counted} reversals" in note


def test_gap_inside_the_loop_needs_its_constants() -> None:
    with pytest.raises(InputError, match="gear_ratio"):
        gap_constant(axis(gap=Gap(lost_motion=1e-4)))
    with pytest.raises(InputError, match=r"axes\.X"):
        gap_constant(axis(gap=Gap(lost_motion=1e-4)))
    with pytest.raises(InputError, match="gear_ratio"):
        motor_gap(Gap(lost_motion=1e-4))
    assert motor_gap(replace(PAPER_GAP, motor_angle=None)) == pytest.approx(0.125664, rel=4 * EPS)


def test_first_reversal_says_why_there_is_none() -> None:
    with pytest.raises(SolveError, match="die out"):
        first_reversal(Servo(b=0.0005, c=0.0), PAPER_GAP, AMPLITUDE, OMEGA)
    with pytest.raises(SolveError, match="does not cross the backlash"):
        first_reversal(PAPER_SERVO, PAPER_GAP, 1e-9, OMEGA)
    with pytest.raises(SolveError, match="does not reverse"):
        first_reversal(Servo(b=1e6, c=1.0), PAPER_GAP, AMPLITUDE, OMEGA)  # a mass that nothing stops


def test_motor_that_comes_back_to_its_old_flank() -> None:
    """(15) returns to zero there; the gap does not close on the other side."""
    gap = open_gap(gain=1.0, beta=0.0, amplitude=1.0, omega=1.0, t_i=-0.1, x_i=0.0)
    assert gap.motor_angle(1e-3) < 0.0
    assert gap.duration(1.0) is None
    assert open_gap(1.0, 0.0, 1.0, 1.0, 0.0, 0.0).duration(1.0) is None  # no force at the opening: no sense yet


def test_quadrature_that_cannot_settle_says_so() -> None:
    with pytest.raises(SolveError, match="residual"):
        motor_motion(lambda t: np.where(t < 1.0 / 3.0, 0.0, 1.0), 0.0, 1.0, 1.0, 1.0)


def test_axes_with_effects_are_served_from_memory_too() -> None:
    """Effects hold mappings, which cannot be hashed; the interval does not depend on them."""
    effects = (EffectSetting(name="coulomb_friction", parameters={"force": 20.0}),)
    plain, _ = backlash_interval(axis(), AMPLITUDE, OMEGA)
    assert backlash_interval(replace(axis(), effects=effects), AMPLITUDE, OMEGA)[0] is plain


@pytest.mark.slow
def test_thousands_of_turning_points_take_seconds() -> None:
    """About 1 ms each; the bound leaves room for a slow machine."""
    start = time.process_time()
    for index in range(500):
        assert backlash_interval(axis(), AMPLITUDE + 1e-6 * index, OMEGA)[0] is not None
    assert time.process_time() - start < 2.5
