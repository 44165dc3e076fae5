"""Section 3 of the paper: the loop, the dead zone and the motor in it, equation by equation."""

from __future__ import annotations

import math
from collections.abc import Callable

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from support.drives import AMPLITUDE, OMEGA, PAPER_GAP, PAPER_SERVO, Printed, axis
from support.paper_equations import (
    freewheel,
    loop_gain,
    motor_motion,
    open_gap,
    servo_from_constants,
    table_decay_rate,
    total_inertia,
    transmission,
)

from ph_post.drive.backlash import gap_constant, motor_gap
from ph_post.drive.free_motor import ANGLE, SPEED, free_motor_response
from ph_post.drive.harmonic import motion_after_pickup
from ph_post.drive.servo import discriminant, harmonic_response, rates
from ph_post.types import Servo

EPS = 2.0**-52


def closed_loop() -> tuple[sp.Expr, dict[str, sp.Symbol]]:
    """x/X of the block diagram without backlash, in the physical constants."""
    names = "s N J B k_p k_i k_d k_a k_t r"
    symbols = dict(zip(names.split(), sp.symbols(names, positive=True), strict=True))
    s, n, j, damping, kp, ki, kd, ka, kt, r = symbols.values()
    forward = (kp + ki / s + kd * s) * ka * kt / (j * s + damping) / n / s * r
    return sp.cancel(forward / (1 + forward)), symbols


def test_eq7_is_of_third_order_with_our_coefficients() -> None:
    """ERRATA: b x⃛ + (c + kd/kp) ẍ + ẋ + (ki/kp) x = (kd/kp) Ẍ + Ẋ + (ki/kp) X, with b and c of (9)."""
    loop, v = closed_loop()
    gain = v["k_p"] * v["k_a"] * v["k_t"] * v["r"]
    b, c = v["N"] * v["J"] / gain, v["N"] * v["B"] / gain
    ki, kd, s = v["k_i"] / v["k_p"], v["k_d"] / v["k_p"], v["s"]
    ours = (kd * s**2 + s + ki) / (b * s**3 + (c + kd) * s**2 + s + ki)
    assert sp.simplify(loop - ours) == 0
    assert sp.degree(sp.denom(sp.together(loop)), s) == 3


def test_eq7_as_normalised_diverges_without_an_integrator() -> None:
    """ERRATA: with the factor of x and X made 1, the others grow without bound as k_i goes to 0."""
    loop, v = closed_loop()
    denominator = sp.Poly(sp.denom(sp.together(loop)), v["s"])
    normalised = denominator.coeff_monomial(v["s"] ** 3) / denominator.coeff_monomial(1)
    assert sp.limit(normalised, v["k_i"], 0) is sp.oo


@pytest.mark.parametrize("kd", [0.0, 0.01])
@pytest.mark.parametrize("ki", [0.0, 3.0])
def test_eq7_and_eq8_in_the_frequency_domain(ki: float, kd: float) -> None:
    servo = Servo(b=0.0005, c=0.005, ki_over_kp=ki, kd_over_kp=kd)
    b, c, i, d, w = (sp.Rational(value) for value in (0.0005, 0.005, ki, kd, 7.0))
    s = sp.I * w
    exact = (d * s**2 + s + i) / (b * s**3 + (c + d) * s**2 + s + i)
    response, error = harmonic_response(servo, 7.0)
    assert response == pytest.approx(complex(exact.evalf(30)), rel=8 * EPS)
    assert error == pytest.approx(complex((1 - exact).evalf(30)), rel=8 * EPS)


def test_eq8_is_eq7_integrated_once_for_a_p_controller() -> None:
    loop, v = closed_loop()
    gain = v["k_p"] * v["k_a"] * v["k_t"] * v["r"]
    b, c, s = v["N"] * v["J"] / gain, v["N"] * v["B"] / gain, v["s"]
    assert sp.simplify(loop.subs({v["k_i"]: 0, v["k_d"]: 0}) - 1 / (b * s**2 + c * s + 1)) == 0


def test_eq9_from_physical_constants() -> None:
    gain = loop_gain(k_p=50.0, k_a=2.0, k_t=0.5, travel_per_rad=0.25, gear_ratio=25.0)
    servo = servo_from_constants(inertia=0.001, damping=0.01, gain=gain)
    assert servo.b == pytest.approx(25 * 0.001 / (50 * 2 * 0.5 * 0.25), rel=4 * EPS)
    assert servo.c == pytest.approx(25 * 0.01 / (50 * 2 * 0.5 * 0.25), rel=4 * EPS)


def test_eq10_counts_the_closing_but_not_the_opening_as_open() -> None:
    t = [0.9, 1.0, 1.1, 1.5, 1.6, 3.0, 3.2]
    assert transmission(t, [1.0, 3.0], [0.5, 0.1]).tolist() == [1, 1, 0, 0, 1, 1, 1]


def test_eq11_is_no_transfer_function() -> None:
    """ERRATA: h(t) multiplies ω_m in time; the product of their transforms is another signal's."""
    s, t = sp.symbols("s t", positive=True)
    motor = t
    output = sp.integrate(motor * sp.exp(-s * t), (t, 0, 1)) + sp.integrate(motor * sp.exp(-s * t), (t, 2, sp.oo))
    printed_h = 1 / s - sp.exp(-s) / s * (1 - sp.exp(-s))
    product = printed_h * sp.integrate(motor * sp.exp(-s * t), (t, 0, sp.oo))
    assert abs(float((output - product).subs(s, 1))) > 0.05


def test_eq12_inertia_reflected_through_the_gears() -> None:
    assert total_inertia(motor=0.002, gear=0.0005, axis=0.625, gear_ratio=25.0) == pytest.approx(0.0035, rel=4 * EPS)


def test_eq13_loop_gain_gives_b_and_c() -> None:
    """With no backlash in it (H = 1), K/(K + (Js + B)s) is 1/(b s² + c s + 1)."""
    gain = loop_gain(50.0, 2.0, 0.5, 0.25, 25.0)
    servo = servo_from_constants(inertia=0.001, damping=0.01, gain=gain)
    s = 3j
    assert gain / (gain + (0.001 * s + 0.01) * s) == pytest.approx(harmonic_response(servo, 3.0)[0], rel=8 * EPS)


def test_freewheel_of_a_table_at_rest_is_rest() -> None:
    alpha = table_decay_rate(PAPER_SERVO, inertia_fraction=0.35, beta=1.0)
    assert alpha == pytest.approx((10.0 - 0.35) / 0.65, rel=8 * EPS)
    assert freewheel(2.0, alpha, [0.0, 0.1])[1] == pytest.approx(2.0 * math.exp(-0.1 * alpha), rel=4 * EPS)
    assert not freewheel(0.0, alpha, [0.0, 0.1, 5.0]).any()


def test_table_decay_rate_is_b_over_j_of_the_axis() -> None:
    j_motor, j_axis, b_motor, b_axis = 0.001, 0.8, 0.002, 5.0
    j, b = j_motor + j_axis / 625, b_motor + b_axis / 625
    servo = servo_from_constants(inertia=j, damping=b, gain=2.0)
    alpha = table_decay_rate(servo, inertia_fraction=j_motor / j, beta=b_motor / j_motor)
    assert alpha == pytest.approx(b_axis / j_axis, rel=1e-14)


def test_eq14_holds_at_pickup() -> None:
    motion = motion_after_pickup(PAPER_SERVO, AMPLITUDE, OMEGA, 3.1, 0.25, 3.1)
    assert motion[0] == pytest.approx(0.25, rel=2 * EPS)
    assert motion[1] == pytest.approx(0.0, abs=EPS * AMPLITUDE * OMEGA)


def test_eq16_gain_is_the_number_printed_in_section_4() -> None:
    assert f"{gap_constant(axis()):.6e}" == "1.428571e+05"
    assert motor_gap(PAPER_GAP) == 0.125664


def test_eqs15_to_17_solve_the_motors_equation() -> None:
    """ω̇ + βω = C (X - x_i), θ̇ = ω, ω(0) = θ(0) = 0, by sympy for the paper's command."""
    t = sp.symbols("t", nonnegative=True)
    beta, w, a, x, start = (sp.Rational(v) for v in (1, "1/2", "1/4", "6/25", "3"))
    command = a * sp.sin(w * (start + t))
    omega = sp.integrate(
        sp.exp(-beta * (t - sp.Symbol("u"))) * (command.subs(t, sp.Symbol("u")) - x), (sp.Symbol("u"), 0, t)
    )
    assert sp.simplify(sp.diff(omega, t) + beta * omega - (command - x)) == 0
    theta = sp.integrate(sp.expand(omega), (t, 0, sp.Rational(1, 5)))
    gap = open_gap(gain=1.0, beta=1.0, amplitude=0.25, omega=0.5, t_i=3.0, x_i=0.24)
    # X(t_i) - x_i is a difference of floats near a: no more than an ulp of a is known of it.
    tolerance = 4 * EPS * 0.25
    assert gap.motor_speed(0.2) == pytest.approx(float(omega.subs(t, sp.Rational(1, 5)).evalf(30)), abs=0.2 * tolerance)
    assert gap.motor_angle(0.2) == pytest.approx(float(theta.evalf(30)), abs=0.02 * tolerance)


def test_eq17_by_quadrature_and_in_closed_form() -> None:
    gap = open_gap(gap_constant(axis()), 1.0, AMPLITUDE, OMEGA, 3.005, 0.25003341707)
    speed, angle = motor_motion(
        lambda t: AMPLITUDE * np.sin(OMEGA * (3.005 + t)), 0.25003341707, gap_constant(axis()), 1.0, 0.1
    )
    # Inside the quadrature X - x_i is a difference of floats near a = 0.25, which grows later.
    lost = 4 * EPS * AMPLITUDE / abs(gap.error)
    assert speed == pytest.approx(gap.motor_speed(0.1), rel=lost)
    assert angle == pytest.approx(gap.motor_angle(0.1), rel=lost)


def convolve(order: int, beta: float, omega: float, t: float) -> list[float]:
    """Convolve the five forcings with exp(-βu) or (1 - exp(-βu))/β, by quadrature at 30 digits."""
    rate, turn, end = map(mp.mpf, (beta, omega, t))
    forcings: list[Callable[[mp.mpf], mp.mpf]] = [
        lambda u: mp.mpf(1),
        lambda u: u,
        lambda u: mp.sin(turn * u),
        lambda u: 2 * mp.sin(turn * u / 2) ** 2,
        lambda u: u - mp.sin(turn * u) / turn,
    ]

    def kernel(u: mp.mpf) -> mp.mpf:
        if order == SPEED:
            return mp.exp(-rate * u)
        return -mp.expm1(-rate * u) / rate if rate else u

    def integral(forcing: Callable[[mp.mpf], mp.mpf]) -> mp.mpf:
        return mp.quad(lambda u: kernel(end - u) * forcing(u), mp.linspace(0, end, 2 + int(beta * t / 10)))

    return [float(integral(forcing)) for forcing in forcings]


@pytest.mark.parametrize("order", [SPEED, ANGLE])
@pytest.mark.parametrize(
    ("beta", "omega", "t"),
    [
        (0.0, 2.0, 1.0),
        (1.0, 0.5, 0.1),
        (2.9, 1.9, 1.0),  # on both sides of where the recurrences change over
        (3.1, 1.9, 1.0),
        (2.9, 2.1, 1.0),
        (3.1, 2.1, 1.0),
        (0.1, 6.0, 1.0),
        (80.0, 0.01, 1.0),
        (1e-9, 1e-3, 1.0),
    ],
)
def test_closed_forms_of_the_motor_in_the_gap(order: int, beta: float, omega: float, t: float) -> None:
    with mp.workdps(30):
        exact = convolve(order, beta, omega, t)
    # At most ten roundings, each magnified by less than two in a recurrence.
    assert free_motor_response(order, beta, omega, t) == pytest.approx(exact, rel=20 * EPS)


def test_printed_constants_of_the_loop() -> None:
    printed = Printed(0.0005, 0.005, 1.0, 1.0, AMPLITUDE, OMEGA)
    assert discriminant(PAPER_SERVO) == pytest.approx(-0.001975, rel=4 * EPS)
    gamma, lam, *_ = rates(PAPER_SERVO)
    assert f"{gamma:.6g} {lam:.6f}" == "5 44.440972"
    assert lam == pytest.approx(float(printed.lam), rel=4 * EPS)
