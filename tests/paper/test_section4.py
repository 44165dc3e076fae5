"""Section 4 of the paper: the canonical test case, its closed forms, its numbers and its slips."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from support.drives import AMPLITUDE, OMEGA, PAPER_GAP, PAPER_SERVO, PERIOD, Printed, axis, run_drive
from support.paper_equations import damping_case, open_gap

from ph_post.drive.backlash import gap_constant, motor_gap
from ph_post.drive.harmonic import motion_after_pickup, phase_constants, steady_motion
from ph_post.drive.intervals import backlash_interval
from ph_post.drive.steady_state import first_reversal, steady_interval
from ph_post.types import Servo

EPS = 2.0**-52
GAIN = 25.0 / (0.35 * 1.0 * 0.0005)
GAP = 0.125664


def printed() -> Printed:
    return Printed(0.0005, 0.005, GAIN, 1.0, AMPLITUDE, OMEGA)


def exact_orbit() -> tuple[mp.mpf, mp.mpf, mp.mpf]:
    """t_i, x_i and Δt of the settled orbit, from the printed equations at 50 digits."""
    return printed().settled(GAP, (3.005, 0.25, 0.119))


def test_printed_p_q_phi() -> None:
    p, q, phi = phase_constants(PAPER_SERVO, 1.0, OMEGA)
    assert (f"{p:.6f}", f"{q:.6f}", f"{phi:.6f}") == ("-1.000130", "0.002619", "1.088448")
    assert (p, q, phi) == pytest.approx((float(printed().p), float(printed().q), float(printed().phi)), rel=4 * EPS)


def test_eq18_and_eq20_are_the_steady_motion() -> None:
    """-g solves b ẍ + c ẋ + x = a sin Ωt, by sympy; and our values are those of the printed g."""
    t, b, c, a, w = sp.symbols("t b c a Omega", positive=True)
    below = (b * w**2 - 1) ** 2 + (c * w) ** 2
    g = a * ((b * w**2 - 1) * sp.sin(w * t) + c * w * sp.cos(w * t)) / below
    x = -g
    assert sp.simplify(b * sp.diff(x, t, 2) + c * sp.diff(x, t) + x - a * sp.sin(w * t)) == 0
    times = np.linspace(0.0, 12.0, 25)
    ours = steady_motion(PAPER_SERVO, AMPLITUDE, OMEGA, times)
    for row, function in zip(ours, (printed().g, printed().g_dot, printed().g_ddot), strict=True):
        exact = [-float(function(mp.mpf(float(time)))) for time in times]
        assert row == pytest.approx(exact, abs=8 * EPS * AMPLITUDE * 2.0)  # Ωt <= 2π: an ulp of 8 in the angle


@pytest.mark.parametrize("c", [0.005, 0.1, 2.0**-4 + 1e-9, 2.0**-4 - 1e-9, 0.0625 * (1 + 2.0**-40)])
def test_eq19_and_its_derivatives_as_printed(c: float) -> None:
    """All digits in both printed cases, and arbitrarily near to the critical one between them."""
    b = 0.0005 if c in (0.005, 0.1) else 2.0**-10
    t_s, x_i = 3.125, 0.25
    t = np.array([3.125, 3.1328125, 3.25, 3.5, 4.5, 9.0])
    ours = motion_after_pickup(Servo(b=b, c=c), AMPLITUDE, OMEGA, t_s, x_i, t)
    with mp.workdps(60):
        reference = Printed(b, c, GAIN, 1.0, AMPLITUDE, OMEGA)
        exact = np.array([[float(v) for v in reference.motion(mp.mpf(t_s), mp.mpf(x_i), mp.mpf(float(s)))] for s in t])
    # Rounding of g(t_s) enters x as it is, ẋ times the loop's frequency 1/√b, ẍ times 1/b.
    scale = AMPLITUDE * np.array([1.0, 1.0 / math.sqrt(b), 1.0 / b])
    assert np.all(np.abs(ours.T - exact) <= 16 * EPS * scale)


def test_eq19_in_the_critical_case_that_is_missing() -> None:
    """ERRATA: Δ = 0 is not printed; the limit of either case by sympy is, and it is what is used."""
    lam, gamma, tau, z, v = sp.symbols("lambda gamma tau z v", positive=True)
    under = sp.exp(-gamma * tau) * ((gamma * z + v) / lam * sp.sin(lam * tau) + z * sp.cos(lam * tau))
    critical = sp.limit(under, lam, 0)
    servo = Servo(b=2.0**-10, c=2.0**-4)
    assert damping_case(servo) == "critical"
    start, start_dot = (-row for row in steady_motion(servo, AMPLITUDE, OMEGA, 3.125)[:2])
    values = {
        gamma: sp.Float(32, 40),
        z: sp.Float(float(0.25 + start), 40),
        v: sp.Float(float(start_dot), 40),
    }
    for tau_value in (0.0078125, 0.125, 0.375):
        free = float(critical.subs(values).subs(tau, sp.Float(tau_value, 40)))
        ours = motion_after_pickup(servo, AMPLITUDE, OMEGA, 3.125, 0.25, 3.125 + tau_value)[0]
        steady = steady_motion(servo, AMPLITUDE, OMEGA, 3.125 + tau_value)[0]
        assert ours - steady == pytest.approx(free, abs=8 * EPS * AMPLITUDE)


def test_lines_printed_with_y_are_the_underdamped_case_of_x() -> None:
    """ERRATA: differentiating x of (19), Δ < 0, gives the lines printed as ẏ and ÿ."""
    lam, gamma, tau, c1, c2 = sp.symbols("lambda gamma tau c_1 c_2", real=True)
    sine, cosine = sp.sin(lam * tau), sp.cos(lam * tau)
    x = sp.exp(-gamma * tau) * (c1 * sine + c2 * cosine)
    y_dot = sp.exp(-gamma * tau) * ((lam * c1 - gamma * c2) * cosine - (gamma * c1 + lam * c2) * sine)
    y_ddot = sp.exp(-gamma * tau) * (
        ((gamma**2 - lam**2) * c2 - 2 * lam * gamma * c1) * cosine
        + ((gamma**2 - lam**2) * c1 + 2 * lam * gamma * c2) * sine
    )
    assert sp.simplify(sp.diff(x, tau) - y_dot) == 0
    assert sp.simplify(sp.diff(x, tau, 2) - y_ddot) == 0


def test_eq21_eq22_and_the_motors_speed() -> None:
    t_i, x_i = 3.005, 0.25003341707
    gap = open_gap(GAIN, 1.0, AMPLITUDE, OMEGA, t_i, x_i)
    assert gap.sense == -1
    with mp.workdps(50):
        reference = printed()
        exact_error = abs(AMPLITUDE * mp.sin(reference.W * mp.mpf(t_i)) - mp.mpf(x_i))
        for dt in (1e-4, 0.01, 0.1, 0.118, 1.0, 5.0, 11.0):
            known = (mp.mpf(t_i), mp.mpf(x_i), mp.mpf(dt))
            # t_i and x_i are floats near 3 and 0.25: their difference X - x_i is known to an ulp of a.
            lost = float(4 * EPS * AMPLITUDE / exact_error)
            assert gap.motor_angle(dt) == pytest.approx(float(reference.angle(*known)), rel=lost)
            assert gap.motor_speed(dt) == pytest.approx(float(reference.speed(*known)), rel=lost)
            assert gap.Q(dt, GAP) == pytest.approx(gap.motor_angle(dt) + GAP, rel=EPS)


def test_derivative_of_q_is_the_motors_speed() -> None:
    reference = printed()
    with mp.workdps(50):
        known = (mp.mpf("3.005"), mp.mpf("0.25003"))
        slope = mp.diff(lambda dt: reference.angle(*known, dt), mp.mpf("0.1"))
        assert abs(slope / reference.speed(*known, mp.mpf("0.1")) - 1) < mp.mpf(10) ** -20


def test_second_derivative_of_q_has_the_factor_a() -> None:
    """ERRATA: Q''(0) is C (a sin Ωt_i - x_i); as printed, without the a, it has the wrong sign here."""
    with mp.workdps(50):
        reference = printed()
        t_i, x_i = mp.mpf("3.005"), mp.mpf("0.25003341707")
        second = mp.diff(lambda dt: reference.angle(t_i, x_i, dt), 0, 2)
        right = reference.C * (reference.a * mp.sin(reference.W * t_i) - x_i)
        wrong = reference.C * (mp.sin(reference.W * t_i) - x_i)
        assert abs(second / right - 1) < mp.mpf(10) ** -15
        assert right < 0 < wrong


def test_starting_estimate_is_nearly_twice_the_root() -> None:
    with mp.workdps(50):
        t_i, x_i, dt = map(float, exact_orbit())
    gap = open_gap(GAIN, 1.0, AMPLITUDE, OMEGA, t_i, x_i)
    assert gap.starting_estimate(GAP) / dt == pytest.approx(1.9, abs=0.05)
    assert gap.motor_speed(0.0) == 0.0  # Q'(0) = 0: no Newton step from there


def test_printed_equation_21_loses_digits_and_ours_does_not() -> None:
    """ERRATA: as printed, in floats, (21)-(22) miss Δt by 1e-10 s three periods after the start."""
    with mp.workdps(50):
        exact = printed()
        t_i, x_i, _ = (float(value) for value in exact_orbit())
        t_i += 6 * PERIOD
        gap = open_gap(GAIN, 1.0, AMPLITUDE, OMEGA, t_i, x_i)
        error = abs(gap.error)
        worst = lost = 0.0
        for dt in np.linspace(0.1, 0.13, 31).tolist():
            known = (mp.mpf(t_i), mp.mpf(x_i), mp.mpf(dt))
            angle, speed = exact.angle(*known), exact.speed(*known)
            with mp.workprec(53):
                as_printed = printed().angle(*known)
            lost = max(lost, float(abs((as_printed - angle) / speed)))
            worst = max(worst, float(abs((gap.motor_angle(dt) - angle) / speed)))
    assert lost > 1e-10
    # Ours keep what the floats t_i and x_i give them: X(t_i) - x_i to an ulp of a; θ/ω < 0.13 s.
    assert worst < 0.13 * 8 * EPS * AMPLITUDE / error


def test_settled_orbit_to_rounding() -> None:
    """Formed as differences throughout, Δt, lag and x_i hold all digits."""
    with mp.workdps(50):
        t_i, x_i, dt = exact_orbit()
        lag = float(t_i - mp.pi / printed().W / 2)
    orbit = steady_interval(PAPER_SERVO, PAPER_GAP, AMPLITUDE, OMEGA)
    assert orbit is not None
    assert orbit.duration == pytest.approx(float(dt), rel=16 * EPS)
    assert orbit.lag == pytest.approx(lag, rel=16 * EPS)
    assert orbit.position == pytest.approx(float(x_i), rel=4 * EPS)
    assert abs(orbit.residual) <= 16 * EPS * GAP


def test_numbers_of_section_4_2() -> None:
    orbit, note = backlash_interval(axis(), AMPLITUDE, OMEGA)
    assert orbit is not None
    assert note == ""
    assert f"{orbit.lag:.9f} {orbit.duration:.8f} {orbit.position:.11f}" == "0.005000674 0.11874297 0.25003341707"
    assert f"{orbit.lag:.6f} {orbit.duration:.6f}" == "0.005001 0.118743"  # as the paper prints them
    first = first_reversal(PAPER_SERVO, PAPER_GAP, AMPLITUDE, OMEGA)
    assert f"{first.lag:.9f}" == "0.005000546"
    assert (gap_constant(axis()), motor_gap(PAPER_GAP)) == pytest.approx((GAIN, GAP), rel=2 * EPS)


def test_first_reversal_to_rounding() -> None:
    """From x(0) = 0, ẋ(0) = aΩ: the deviation from the steady motion then is g(0), aΩ + ġ(0)."""
    with mp.workdps(50):
        reference = printed()
        place, speed = reference.g(mp.mpf(0)), reference.a * reference.W + reference.g_dot(mp.mpf(0))
        gamma, lam = reference.gamma, reference.lam

        def x(t: mp.mpf) -> mp.mpf:
            free = place * mp.cos(lam * t) + (speed + gamma * place) / lam * mp.sin(lam * t)
            return mp.exp(-gamma * t) * free - reference.g(t)

        t_i = mp.findroot(lambda t: mp.diff(x, t), mp.mpf(3.005))
        x_i = x(t_i)
        dt = mp.findroot(lambda dt: reference.angle(t_i, x_i, dt) + mp.mpf(GAP), mp.mpf(0.1187))
        lag = float(t_i - mp.pi / reference.W / 2)
    first = first_reversal(PAPER_SERVO, PAPER_GAP, AMPLITUDE, OMEGA)
    # t_i itself is found, near 3 s, to a few ulps; the lag is what is left of it.
    assert first.lag == pytest.approx(lag, abs=8 * EPS * 3.0)
    assert first.position == pytest.approx(float(x_i), rel=8 * EPS)
    # x_i - X changes by ΔX = x_i Ω² lag δt with an error δt of t_i: 1e-15 of itself is not exceeded.
    assert first.duration == pytest.approx(float(dt), rel=1e-13)


def test_motion_from_reversal_to_reversal_settles_to_the_orbit() -> None:
    """The paper's own way: Newton for t_i from 0.9 T, Newton for Δt, one reversal after the other."""
    first = first_reversal(PAPER_SERVO, PAPER_GAP, AMPLITUDE, OMEGA)
    t_i, x_i, duration = PERIOD / 2 + first.lag, first.position, first.duration
    for _ in range(4):
        t_s, guess = t_i + duration, t_i + 0.9 * PERIOD
        for _ in range(8):
            _, x_dot, x_ddot = motion_after_pickup(PAPER_SERVO, AMPLITUDE, OMEGA, t_s, x_i, guess)
            guess -= float(x_dot / x_ddot)
        x_i = float(motion_after_pickup(PAPER_SERVO, AMPLITUDE, OMEGA, t_s, x_i, guess)[0])
        t_i = guess
        duration = open_gap(GAIN, 1.0, AMPLITUDE, OMEGA, t_i, x_i).duration(GAP) or math.nan
    orbit = steady_interval(PAPER_SERVO, PAPER_GAP, AMPLITUDE, OMEGA)
    assert orbit is not None
    assert t_i % PERIOD - PERIOD / 2 == pytest.approx(orbit.lag, abs=1e-12)
    assert abs(x_i) == pytest.approx(orbit.position, rel=1e-14)
    assert duration == pytest.approx(orbit.duration, rel=1e-11)  # through X(t_i) - x_i with t_i near 27 s


def test_integrated_drive_settles_to_the_orbit() -> None:
    """All of section 3.3 in the time domain, by scipy, from rest, with no closed form at all."""
    reversals = run_drive(PAPER_SERVO, GAIN, 1.0, GAP, AMPLITUDE, OMEGA, count=3)
    first, settled = reversals[0], reversals[-1]
    orbit = steady_interval(PAPER_SERVO, PAPER_GAP, AMPLITUDE, OMEGA)
    begin = first_reversal(PAPER_SERVO, PAPER_GAP, AMPLITUDE, OMEGA)
    assert orbit is not None
    for run, ours in ((first, begin), (settled, orbit)):
        assert run.lag == pytest.approx(ours.lag, abs=2e-9)  # relative tolerance 1e-11 of the integration
        assert run.position == pytest.approx(ours.position, abs=1e-10)
        assert run.duration == pytest.approx(ours.duration, abs=2e-8)


def test_standstill_travel_falls_with_the_feed() -> None:
    """Figure 7: the distance travelled during the standstill falls as T grows."""
    travel = []
    for period in (2.0, 4.0, 6.0, 12.0, 24.0):
        orbit = steady_interval(PAPER_SERVO, PAPER_GAP, AMPLITUDE, math.pi / period)
        assert orbit is not None
        travel.append(math.pi * AMPLITUDE / period * orbit.duration)
    assert travel == sorted(travel, reverse=True)
