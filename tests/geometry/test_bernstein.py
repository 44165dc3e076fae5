"""Bernstein forms against exact rational arithmetic."""

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from ph_post.geometry import bernstein, exact_polynomials

EPS = np.finfo(float).eps
DEGREES = [0, 1, 2, 5, 9, 20]


def random_form(degree, seed=0):
    return np.random.default_rng([seed, degree]).normal(size=degree + 1)


def exact_value(c, u):
    """De Casteljau's rule in rational arithmetic."""
    u, rest = Fraction(u), [Fraction(x) for x in c]
    while len(rest) > 1:
        rest = [(1 - u) * a + u * b for a, b in pairwise(rest)]
    return rest[0]


def close(found, exact, scale, steps):
    """Within `steps` roundings of numbers of size `scale`."""
    error = max(abs(Fraction(float(a)) - b) for a, b in zip(np.ravel(found), exact, strict=True))
    return error <= Fraction(steps * EPS * scale)


@pytest.mark.parametrize("degree", DEGREES)
def test_values(degree):
    c, u = random_form(degree), np.array([0.0, 1e-9, 0.1, 0.5, 0.75, 1.0])
    assert close(bernstein.evaluate(c, u), [exact_value(c, x) for x in u.tolist()], np.abs(c).max(), 4 * degree + 4)


def test_the_basis_is_a_partition_of_one_and_exact_at_the_ends():
    values = bernstein.basis(7, [0.0, 0.3, 1.0])
    assert values[0].tolist() == [1.0] + [0.0] * 7
    assert values[2].tolist() == [0.0] * 7 + [1.0]
    assert values.sum(axis=1) == pytest.approx(1.0, abs=20 * EPS)


def test_a_batch_is_evaluated_row_by_row():
    c = np.stack([random_form(4, seed) for seed in range(3)])
    u = np.array([0.2, 0.4, 0.9])
    assert bernstein.evaluate(c, u).tolist() == [float(bernstein.evaluate(c[i], u[i])) for i in range(3)]


@pytest.mark.parametrize("degree", DEGREES)
def test_derivative_of_the_antiderivative(degree):
    c = random_form(degree)
    assert bernstein.derivative(bernstein.integrate(c)) == pytest.approx(
        c, abs=4 * (degree + 1) ** 2 * EPS * np.abs(c).max()
    )


def test_derivatives_count_down_to_zero():
    assert bernstein.derivative([1.0, 2.0, 4.0], 2).tolist() == [2.0]
    assert bernstein.derivative([1.0, 2.0, 4.0], 3).tolist() == [0.0]
    assert bernstein.derivative([3.0]).tolist() == [0.0]


@pytest.mark.parametrize("degrees", [(0, 3), (1, 1), (4, 4), (7, 12)])
def test_product(degrees):
    a, b = random_form(degrees[0], 1), random_form(degrees[1], 2)
    exact = exact_polynomials.product(*exact_polynomials.rows([a, b]))
    for u in (Fraction(1, 3), Fraction(4, 5)):  # the exact product itself, against values
        assert exact_value(exact, u) == exact_value(a, u) * exact_value(b, u)
    assert close(bernstein.product(a, b), exact, np.abs(a).max() * np.abs(b).max(), 2 * sum(degrees) + 4)


@pytest.mark.parametrize("at", [0.5, 0.3, 0.0, 1.0])
def test_subdivision(at):
    c = random_form(6)
    left, right = bernstein.subdivide(c, at)
    for u in (0.0, 0.25, 1.0):
        cut = Fraction(at)
        exact = [exact_value(c, cut * Fraction(u)), exact_value(c, cut + (1 - cut) * Fraction(u))]
        assert close([bernstein.evaluate(left, u), bernstein.evaluate(right, u)], exact, np.abs(c).max(), 40)


def test_subdivision_of_a_batch_at_different_places():
    c, at = np.stack([random_form(3, seed) for seed in range(2)]), np.array([0.25, 0.5])
    left, right = bernstein.subdivide(c, at)
    for row in range(2):
        one = bernstein.subdivide(c[row], at[row])
        assert [left[row].tolist(), right[row].tolist()] == [one[0].tolist(), one[1].tolist()]


def test_elevation_keeps_the_polynomial():
    c = random_form(4)
    assert close(
        bernstein.elevate(c, 3),
        exact_polynomials.product(exact_polynomials.rows([c])[0], (Fraction(1),) * 4),
        3.0,
        20,
    )


@pytest.mark.parametrize("domain", [(0.0, 1.0), (-2.0, 5.0), (0.25, 0.5)])
def test_power_basis_there_and_back(domain):
    power = random_form(5)
    c = bernstein.from_power(power, domain)
    ends = [sum(Fraction(p) * Fraction(x) ** k for k, p in enumerate(power)) for x in domain]
    scale = sum(abs(p) * max(map(abs, domain)) ** k for k, p in enumerate(power))
    assert close(c[[0, -1]], ends, scale, 40)
    # Back through divided differences: each division by the width costs that factor once.
    grown = scale * (1.0 + max(map(abs, domain)) / (domain[1] - domain[0])) ** 5 * math.comb(5, 2) * 2**5
    assert bernstein.to_power(c, domain) == pytest.approx(power, abs=40 * EPS * grown)


def test_exact_conversion_from_powers():
    power = tuple(Fraction(k + 1, 7) for k in range(6))
    c = exact_polynomials.from_power(power, (Fraction(3), Fraction(7, 2)))
    for u in (Fraction(0), Fraction(1, 3), Fraction(1)):
        x = 3 + u / 2
        assert exact_value(c, u) == sum(p * x**k for k, p in enumerate(power))


def test_exact_integral():
    c = tuple(map(Fraction, (2, 0, 3)))
    whole = exact_polynomials.integrate(c, Fraction(5))
    assert whole == (5, Fraction(17, 3), Fraction(17, 3), Fraction(20, 3))
    assert exact_polynomials.combine((2, c), (-1, c)) == c
