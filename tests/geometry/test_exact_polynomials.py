"""Exact isolation against roots known by construction and against sympy's own differentiation."""

from __future__ import annotations

import math
from fractions import Fraction

import mpmath
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st
from support.amount import examples

from ph_post.geometry import exact_polynomials

U = sympy.Symbol("u")


def bernstein(expression: sympy.Expr, degree: int) -> tuple[Fraction, ...]:
    """Bernstein coefficients of a polynomial expression in u."""
    power = [sympy.Poly(expression, U).coeff_monomial(U**i) for i in range(degree + 1)]
    return tuple(
        sum(
            (
                Fraction(int(a.p), int(a.q)) * Fraction(math.comb(k, i), math.comb(degree, i))
                for i, a in enumerate(power[: k + 1])
            ),
            Fraction(0),
        )
        for k in range(degree + 1)
    )


def expression(coefficients: tuple[Fraction, ...]) -> sympy.Expr:
    n = len(coefficients) - 1
    terms = [
        sympy.Rational(a.numerator, a.denominator) * math.comb(n, k) * U**k * (1 - U) ** (n - k)
        for k, a in enumerate(coefficients)
    ]
    return sympy.expand(sympy.Add(*terms))


def test_multiplicities_are_told_apart() -> None:
    polynomial = U * (3 * U - 1) ** 2 * (7 * U - 5) ** 3 * (9 * U - 8) * (U - 1) ** 2 * (U**2 + 1)
    roots = exact_polynomials.isolate(bernstein(polynomial, 11))
    assert [root.multiplicity for root in roots] == [1, 2, 3, 1, 2]
    for root, value in zip(
        roots, [Fraction(0), Fraction(1, 3), Fraction(5, 7), Fraction(8, 9), Fraction(1)], strict=True
    ):
        assert root.low <= value <= root.high
        assert root.high - root.low <= exact_polynomials.WIDTH
        assert root.middle == pytest.approx(float(value), abs=2.0**-53)


def test_intervals_of_irrational_roots_are_disjoint_and_narrow() -> None:
    """Two roots 2e-25 apart, 1/√2 between them."""
    close = ((2 * U**2 - 1) ** 2 - sympy.Rational(1, 10**49)) * (U - 3)
    first, second = exact_polynomials.isolate(bernstein(close, 5))
    assert first.high <= second.low
    with mpmath.workdps(60):
        for root, sign in ((first, -1), (second, 1)):
            value = mpmath.sqrt((1 + sign * mpmath.mpf(10) ** mpmath.mpf("-24.5")) / 2)
            assert mpmath.mpf(root.low.numerator) / root.low.denominator <= value
            assert value <= mpmath.mpf(root.high.numerator) / root.high.denominator


def test_the_zero_polynomial_has_no_roots() -> None:
    assert exact_polynomials.isolate((Fraction(0), Fraction(0), Fraction(0))) == ()


COORDINATE = st.fractions(-5, 5, max_denominator=9)
WEIGHT = st.fractions(Fraction(1, 9), 5, max_denominator=9)


@settings(max_examples=examples(30))
@given(st.lists(st.tuples(COORDINATE, WEIGHT), min_size=2, max_size=5))
def test_rational_numerator_against_sympy(points: list[tuple[Fraction, Fraction]]) -> None:
    control = [(x * w, w) for x, w in points]
    numerator = exact_polynomials.derivative(control, 0, rational=True)
    x, w = (expression(tuple(column)) for column in zip(*control, strict=True))
    expected = sympy.diff(x, U) * w - x * sympy.diff(w, U)
    assert sympy.expand(expected - expression(numerator)) == 0


def test_polynomial_derivative_is_the_differences() -> None:
    assert exact_polynomials.derivative(
        [(Fraction(1), Fraction(2)), (Fraction(3), Fraction(5)), (Fraction(2), Fraction(9))],
        1,
        rational=False,
    ) == (Fraction(3), Fraction(4))


def test_value_has_the_sign_and_size_of_the_polynomial() -> None:
    coefficients = (Fraction(1, 2), Fraction(-3), Fraction(5, 7), Fraction(-1, 9))
    value = expression(coefficients).subs(U, sympy.Rational(3, 11))
    scaled = exact_polynomials.value_at(exact_polynomials.integers(coefficients), 3, 11)
    assert Fraction(scaled, 11**3 * math.lcm(2, 7, 9)) == Fraction(int(value.p), int(value.q))


def test_sharpen_reaches_rounding_where_floats_cannot() -> None:
    """Roots 2e-10 apart: a double's value of the polynomial is noise over a hundred times their distance."""
    gap = Fraction(1, 10**10)
    middle = Fraction(1, 3)
    polynomial = (U - sympy.Rational(1, 3)) ** 2 - sympy.Rational(1, 10**20)
    coefficients = bernstein(polynomial * (U + 2), 3)
    for root, start in ((middle - gap, 1 / 3 - 1.3e-10), (middle + gap, 1 / 3 + 0.8e-10)):
        assert exact_polynomials.sharpen(coefficients, start) == pytest.approx(float(root), abs=2.0**-53)


def test_sharpen_refuses_a_double_root() -> None:
    assert exact_polynomials.sharpen(bernstein((3 * U - 1) ** 2, 2), 0.3333) is None


@given(st.lists(st.integers(-6, 6), min_size=1, max_size=7))
def test_counts_against_sturm(values: list[int]) -> None:
    coefficients = tuple(Fraction(value) for value in values)
    roots = exact_polynomials.isolate(coefficients)
    polynomial = sympy.Poly(expression(coefficients), U)
    assert len(roots) == (0 if polynomial.is_zero else polynomial.count_roots(0, 1))
    assert list(roots) == sorted(roots, key=lambda root: root.low)


@given(st.lists(st.tuples(st.fractions(-9, 9), st.fractions(1, 9)), min_size=2, max_size=5), st.booleans())
def test_rounded_derivative_is_the_derivative_rounded_once(
    control: list[tuple[Fraction, Fraction]], rational: bool
) -> None:
    expected = [float(value) for value in exact_polynomials.derivative(control, 0, rational=rational)]
    assert exact_polynomials.rounded_derivative(control, 0, rational=rational) == expected
