"""Section 5 of the paper: its equations, in exact arithmetic or 50 digits, and its slips."""

from __future__ import annotations

import math
from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

from ph_post.compensate import profile, shapes
from ph_post.compensate.shapes import single
from ph_post.errors import InputError
from ph_post.types import FeedProfile

EPS = 2.0**-52
TAU, F = sp.symbols("tau f")


def bernstein(coefficients: list, tau: sp.Symbol = TAU) -> sp.Expr:
    """Eq. (26) as printed."""
    n = len(coefficients) - 1
    return sum(v * sp.binomial(n, k) * (1 - tau) ** (n - k) * tau**k for k, v in enumerate(coefficients))


def one_different(n: int) -> list:
    """The coefficients of Figure 8 relative to V_c: all 1 but the middle one, f."""
    return [F if k == n // 2 else sp.Integer(1) for k in range(n + 1)]


def make_profile(coefficients: np.ndarray, cruise: float = 0.125, t_star: float = 0.5) -> FeedProfile:
    shape = single(coefficients)
    return FeedProfile(
        window=0,
        shape=shape,
        cruise=cruise,
        t_star=t_star,
        s_star=shapes.half_length(shape, cruise, t_star),
        ratio=shapes.middle_ratio(shape),
    )


def random_coefficients(seed: int, n: int) -> np.ndarray:
    """Dyadic numbers, so that sympy and the library mean the same polynomial."""
    rng = np.random.default_rng(seed)
    return np.concatenate([[1.0, 1.0], rng.integers(-96, 128, n - 3) / 64.0, [1.0, 1.0]])


def test_eq24_maps_the_interval() -> None:
    assert profile.normalised_time(np.array([-0.5, 0.0, 0.5]), 0.5).tolist() == [0.0, 0.5, 1.0]


@pytest.mark.parametrize("n", [4, 6, 10])
def test_eq26_and_eq25_against_sympy(n: int) -> None:
    coefficients = random_coefficients(n, n)
    V = bernstein([sp.Rational(Fraction(c)) for c in coefficients])
    given = make_profile(coefficients)
    t = np.linspace(-0.5, 0.5, 33)  # dyadic: τ is exact
    exact = [float(sp.Rational(1, 8) * V.subs(TAU, sp.Rational(Fraction(x)) + sp.Rational(1, 2))) for x in t]
    assert profile.feed(given, t) == pytest.approx(exact, rel=0.0, abs=0.125 * shapes.rounding(single(coefficients)))
    # Eq. (25): d/dt = d/dτ / (2 t_star), and 2 t_star = 1 here.
    slope = sp.diff(V, TAU)
    exact = [float(sp.Rational(1, 8) * slope.subs(TAU, sp.Rational(Fraction(x)) + sp.Rational(1, 2))) for x in t]
    assert profile.acceleration(given, t) == pytest.approx(
        exact, abs=0.125 * 4 * n * shapes.rounding(single(coefficients))
    )


def test_the_feed_around_the_profile_is_constant_and_joins_it_smoothly() -> None:
    given = make_profile(profile.coefficients_from_ratio(0.25, 10))
    assert profile.feed(given, np.array([-0.7, -0.5, 0.5, 9.0])).tolist() == [0.125] * 4
    assert profile.acceleration(given, np.array([-0.7, -0.5, 0.5, 9.0])).tolist() == [0.0] * 4


@pytest.mark.parametrize(("n", "constant", "factor", "over"), [(4, 5, 3, 8), (10, 193, 63, 256)])
def test_middle_values_as_printed(n: int, constant: int, factor: int, over: int) -> None:
    middle = sp.expand(bernstein(one_different(n)).subs(TAU, sp.Rational(1, 2)))
    assert middle == (constant + factor * F) / sp.Integer(over)
    assert profile.middle_weight(n) == factor / over


@pytest.mark.parametrize("n", [4, 6, 8, 10, 14, 20])
def test_middle_value_for_every_even_degree(n: int) -> None:
    middle = sp.expand(bernstein(one_different(n)).subs(TAU, sp.Rational(1, 2)))
    weight = sp.Rational(sp.binomial(n, n // 2), 2**n)
    assert sp.expand(middle - (1 + weight * (F - 1))) == 0
    assert profile.middle_weight(n) == float(weight)


@pytest.mark.parametrize(("n", "bound"), [(4, Fraction(-5, 3)), (10, Fraction(-193, 63))])
def test_bounds_for_a_positive_feed(n: int, bound: Fraction) -> None:
    for shift, positive in ((1e-9, True), (-1e-9, False)):
        coefficients = np.ones(n + 1)
        coefficients[n // 2] = float(bound) + shift
        assert shapes.is_non_negative(single(coefficients)) is positive
        # The single coefficient is far below zero on both sides of the bound: it must not decide.
        assert coefficients.min() < -1.6


def test_factor_formula_of_section_6() -> None:
    # Where one operation each is rounded the two may differ by a few units in the last place.
    for ratio in (1.0, 0.25, -0.4, -0.5, 1.3):
        assert profile.middle_factor(ratio, 10) == pytest.approx((256 * ratio - 193) / 63, rel=8 * EPS)
        coefficients = profile.coefficients_from_ratio(ratio, 10)
        assert shapes.middle_ratio(single(coefficients)) == pytest.approx(
            ratio, abs=shapes.rounding(single(coefficients))
        )


def test_figure_8() -> None:
    # Quartic with f = -1.5, degree 10 with f = -2.8: (5 - 4.5) / 8 and (193 - 176.4) / 256.
    for n, f, middle in ((4, -1.5, 0.0625), (10, -2.8, 16.6 / 256)):
        coefficients = np.ones(n + 1)
        coefficients[n // 2] = f
        low, high = shapes.extremes(single(coefficients))
        assert low == pytest.approx(middle, abs=shapes.rounding(single(coefficients)))
        assert high == 1.0


def test_eq27_by_integration() -> None:
    coefficients = random_coefficients(3, 10)
    V = bernstein([sp.Rational(Fraction(c)) for c in coefficients])
    t_star = sp.Rational(3, 8)
    exact = float(t_star * sp.Rational(1, 8) * sp.integrate(V, (TAU, 0, 1)))
    found = shapes.half_length(single(coefficients), 0.125, 0.375)
    assert found == pytest.approx(exact, rel=4 * EPS)
    assert shapes.half_duration(single(coefficients), 0.125, found) == pytest.approx(0.375, rel=4 * EPS)


@pytest.mark.parametrize("n", [4, 10])
def test_traversal_time_factor(n: int) -> None:
    mean = sp.integrate(bernstein(one_different(n)), (TAU, 0, 1))
    assert sp.simplify(1 / mean - (n + 1) / (n + F)) == 0
    f = profile.middle_factor(0.25, n)
    assert profile.traversal_factor(f, n) == (n + 1) / (n + f)
    # It is 2 t_star over the time 2 s_star / V_c that constant feed takes.
    coefficients = profile.coefficients_from_ratio(0.25, n)
    ratio = 0.5 / (shapes.half_length(single(coefficients), 0.125, 0.5) / 0.125)
    assert profile.traversal_factor(f, n) == pytest.approx(ratio, rel=8 * EPS)


@pytest.mark.parametrize("n", [4, 10])
def test_eq28_with_its_exponent_put_right(n: int) -> None:
    coefficients = random_coefficients(n + 1, n)
    V = bernstein([sp.Rational(Fraction(c)) for c in coefficients])
    S = [sp.Integer(0)]
    S += [sum(sp.Rational(Fraction(c)) for c in coefficients[:k]) / (n + 1) for k in range(1, n + 2)]
    ours = bernstein(S)  # exponent n + 1 - k
    assert sp.expand(sp.diff(ours, TAU) - V) == 0
    assert ours.subs(TAU, 0) == 0
    found = shapes.distance_coefficients(coefficients)
    assert found == pytest.approx([float(value) for value in S], abs=shapes.rounding(single(coefficients)))
    # As printed, (1 - τ)^(n - k), it is not the integral; the last term is not even a polynomial.
    printed = sum(value * sp.binomial(n + 1, k) * (1 - TAU) ** (n - k) * TAU**k for k, value in enumerate(S))
    assert sp.simplify(sp.diff(printed, TAU) - V) != 0
    assert sp.limit(printed, TAU, 1, "-") in (sp.oo, -sp.oo)


def test_eq29_and_eq30_in_fifty_digits() -> None:
    coefficients = profile.coefficients_from_ratio(0.25, 10)
    given = make_profile(coefficients, cruise=0.25 * math.pi / 3, t_star=0.5)
    radius = 0.25
    t = np.array([-0.9, -0.5, -0.31, -1e-3, 0.0, 1e-7, 0.118743, 0.44, 0.5, 1.0])
    X, Y = profile.commanded_position(given, radius, t)
    with mp.workdps(50):
        V = [mp.mpf(float(c)) * mp.mpf(given.cruise) for c in coefficients]
        for k, time in enumerate(t):
            angle = _angle(V, mp.mpf(float(time)), mp.mpf(given.t_star), mp.mpf(radius))
            # Θ is the difference of numbers near 1 rad, a few ulps each; 1 - cos loses nothing beyond that.
            error = 32 * EPS
            assert float(profile.commanded_angle(given, radius, t[k : k + 1])[0]) == pytest.approx(
                float(angle), abs=error
            )
            assert X[k] == pytest.approx(
                float(radius * (mp.cos(angle) - 1)), abs=radius * error * abs(float(mp.sin(angle))) + 1e-30
            )
            assert Y[k] == pytest.approx(float(radius * mp.sin(angle)), abs=radius * error)


def _angle(V: list[mp.mpf], t: mp.mpf, t_star: mp.mpf, radius: mp.mpf) -> mp.mpf:
    """Θ(t) by integrating Eq. (26) numerically, and at constant feed beyond the profile."""
    n = len(V) - 1

    def feed(tau: mp.mpf) -> mp.mpf:
        return mp.fsum(v * mp.binomial(n, k) * (1 - tau) ** (n - k) * tau**k for k, v in enumerate(V))

    inside = min(max(t, -t_star), t_star)
    s_star = mp.fsum(V) * t_star / (n + 1)
    way = 2 * t_star * mp.quad(feed, [0, (inside + t_star) / (2 * t_star)])
    return (-s_star + way + V[0] * (t - inside)) / radius


def test_the_lead_in_of_section_5_2() -> None:
    # T_star = t_star + ρ (Θ_star - θ_star) / V_c, and there the command is at -Θ_star = -π/2 (section 6).
    given = make_profile(profile.coefficients_from_ratio(0.25, 10), cruise=0.25 * math.pi / 3, t_star=0.5)
    T = profile.lead_duration(given, 0.25, math.pi / 2)
    theta = given.s_star / 0.25
    assert pytest.approx(0.5 + 0.25 * (math.pi / 2 - theta) / given.cruise, rel=4 * EPS) == T
    assert profile.commanded_angle(given, 0.25, np.array([-T, T])) == pytest.approx(
        [-math.pi / 2, math.pi / 2], rel=4 * EPS
    )


def test_slip_in_section_5_3() -> None:
    """θ_* + V_c (t - t_star) / ρ holds from t_star on; from the end of the backlash it would jump."""
    given = make_profile(profile.coefficients_from_ratio(0.25, 10), cruise=0.25 * math.pi / 3, t_star=0.5)
    t = np.array([0.118743, 0.5, 0.8])
    printed = given.s_star + given.cruise * (t - given.t_star)
    ours = profile.travelled(given, t)
    assert ours[1:] == pytest.approx(printed[1:], rel=8 * EPS)
    assert abs(ours[0] - printed[0]) > 0.01


def test_slip_in_the_sign_of_the_initial_condition() -> None:
    """(30) has X(-T_star) = ρ (cos Θ_star - 1); section 5.3 prints ρ (1 - cos Θ_star) for x there."""
    given = make_profile(profile.coefficients_from_ratio(1.0, 10), cruise=0.25, t_star=0.5)
    X, Y = profile.commanded_position(given, 0.25, np.array([-profile.lead_duration(given, 0.25, 1.0)]))
    assert X[0] == pytest.approx(0.25 * (math.cos(1.0) - 1.0), rel=8 * EPS)
    assert Y[0] == pytest.approx(-0.25 * math.sin(1.0), rel=8 * EPS)


@pytest.mark.parametrize("seed", range(12))
def test_extremes_against_the_roots_of_the_derivative(seed: int) -> None:
    coefficients = random_coefficients(seed, 4 + 2 * (seed % 5))
    V = sp.Poly(sp.expand(bernstein([sp.Rational(Fraction(c)) for c in coefficients])), TAU)
    places = [sp.Integer(0), sp.Integer(1)]
    places += [root for root in sp.real_roots(V.diff(TAU)) if 0 <= root.evalf(30) <= 1] if V.degree() > 0 else []
    values = [float(V.as_expr().subs(TAU, place.evalf(40))) for place in places]
    low, high = shapes.extremes(single(coefficients))
    slack = 4 * shapes.rounding(single(coefficients))
    assert low == pytest.approx(min(values), abs=slack)
    assert high == pytest.approx(max(values), abs=slack)
    assert shapes.is_non_negative(single(coefficients)) is (min(values) >= 0.0)


def test_a_feed_that_touches_zero_is_not_negative() -> None:
    for n in (4, 6, 10, 14):
        assert shapes.is_non_negative(profile.dip(0.0, n))


def test_softening_keeps_the_ends_and_scales_the_dip() -> None:
    coefficients = profile.coefficients_from_ratio(0.25, 10)
    assert shapes.soften(single(coefficients), 0.0).pieces[0].coefficients.tolist() == coefficients.tolist()
    assert shapes.soften(single(coefficients), 1.0).pieces[0].coefficients.tolist() == [1.0] * 11
    assert shapes.middle_ratio(shapes.soften(single(coefficients), 0.5)) == pytest.approx(0.625, rel=8 * EPS)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ((1, 1, 0.5, 1, 0.9), "jump at the ends"),
        ((1, 0.9, 0.5, 0.9, 1), "jump at the ends"),
        ((1, 1, 1, 1), "not a degree"),
        ((1, 1, 1), "not a degree"),
        ((1, 1, math.nan, 1, 1), "not a number"),
    ],
)
def test_coefficients_that_cannot_be(values: tuple[float, ...], words: str) -> None:
    with pytest.raises(InputError, match=words):
        profile.explicit_coefficients(values)


@pytest.mark.parametrize("degree", [2, 5, 0, -4])
def test_degrees_that_cannot_be(degree: int) -> None:
    with pytest.raises(InputError, match="even, 4 or more"):
        profile.coefficients_from_ratio(0.5, degree)
