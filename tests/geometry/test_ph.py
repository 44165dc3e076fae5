"""Pythagorean-hodograph curves: the identities in exact arithmetic, lengths, and the Hermite quintic."""

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
import sympy

from ph_post.errors import InputError
from ph_post.geometry import exact_polynomials
from ph_post.geometry.ph import PH, absolute_rotation, ph_hermite

EPS = np.finfo(float).eps
T = sympy.Symbol("t")
PREIMAGES = [(1, 2), (2, 2), (3, 2), (7, 2), (1, 4), (2, 4), (4, 4)]


def rational_preimage(degree, components):
    numbers = np.random.default_rng([degree, components]).integers(-20, 20, size=(degree + 1, components))
    return tuple(tuple(Fraction(int(x), 7) for x in row) for row in numbers)


def symbolic(coefficients):
    """The polynomial with these Bernstein coefficients."""
    n = len(coefficients) - 1
    terms = [sympy.Rational(c) * sympy.binomial(n, k) * T**k * (1 - T) ** (n - k) for k, c in enumerate(coefficients)]
    return sympy.expand(sympy.Add(*terms))


def exact_curve(preimage):
    start = tuple(Fraction(k) for k in range(2 if len(preimage[0]) == 2 else 3))
    floats = [[float(x) for x in row] for row in preimage]
    return PH([float(x) for x in start], floats, exact=(start, preimage)), start


@pytest.mark.parametrize(("degree", "components"), PREIMAGES)
def test_the_identity_holds_exactly(degree, components):
    preimage = rational_preimage(degree, components)
    curve, start = exact_curve(preimage)
    (piece,) = curve.exact_pieces()
    axes = [symbolic(column) for column in zip(*piece.control, strict=True)]
    parts = [symbolic(column) for column in zip(*preimage, strict=True)]
    speed = sympy.expand(sum(part**2 for part in parts))
    assert sympy.expand(sum(sympy.diff(axis, T) ** 2 for axis in axes) - speed**2) == 0
    assert [axis.subs(T, 0) for axis in axes] == [sympy.Rational(x) for x in start]
    assert len(piece.control) == 2 * degree + 2
    # and the floats are those numbers, rounded
    assert curve.pieces[0].control == pytest.approx(np.array(piece.control, dtype=float), abs=1e-14 * 400)
    exact_length = float(sympy.integrate(speed, (T, 0, 1)))
    assert curve.length == pytest.approx(exact_length, rel=16 * EPS)


def test_the_hodograph_is_the_one_of_the_path_file():
    u, v, p, q = rational_preimage(1, 4)[0]
    curve, _ = exact_curve(((u, v, p, q),))
    hodograph = [u * u + v * v - p * p - q * q, 2 * (u * q + v * p), 2 * (v * q - u * p)]
    first, last = curve.exact_pieces()[0].control
    assert [b - a for a, b in zip(first, last, strict=True)] == hodograph
    planar, _ = exact_curve(((u, v),))
    first, last = planar.exact_pieces()[0].control
    assert [b - a for a, b in zip(first, last, strict=True)] == [u * u - v * v, 2 * u * v]


@pytest.mark.parametrize(("degree", "components"), PREIMAGES)
def test_arc_length_is_the_exact_polynomial(degree, components):
    preimage = rational_preimage(degree, components)
    curve, _ = exact_curve(preimage)
    speed = sum(symbolic(column) ** 2 for column in zip(*preimage, strict=True))
    exact = sympy.integrate(sympy.expand(speed), T)
    xi = [0.0, 0.125, 0.3, 0.5, 0.99, 1.0]
    values = [float(exact.subs(T, sympy.Rational(x))) for x in xi]
    assert curve.arc_length(xi) == pytest.approx(values, abs=64 * EPS * values[-1])
    back = curve.parameter(values)
    assert curve.arc_length(back) == pytest.approx(values, abs=64 * EPS * values[-1])


def test_a_preimage_of_high_degree_keeps_its_digits():
    preimage = np.random.default_rng(3).normal(size=(21, 2))
    curve = PH([0, 0], preimage)
    parts = exact_polynomials.rows(preimage.T)
    speed = exact_polynomials.combine(*((1, exact_polynomials.product(part, part)) for part in parts))
    integral = exact_polynomials.integrate(speed, Fraction(0))
    for xi in (0.05, 0.5, 0.93):
        rest = list(integral)
        while len(rest) > 1:
            rest = [a + Fraction(xi) * (b - a) for a, b in pairwise(rest)]
        assert abs(Fraction(curve.arc_length(xi)[0]) - rest[0]) < 1e-14 * curve.length


CASES = [
    ([[0, 0], [10, 5]], [[3, 0], [0, 3]]),
    ([[0, 0], [10, 0]], [[10, 20], [10, -20]]),
    ([[1, 2], [0, 0]], [[5, 1], [4, -3]]),
    ([[0, 0], [1, 0]], [[-3, 1], [-2, -2]]),
    ([[0, 0], [0, 8]], [[0, 9], [0, 7]]),
]


def four_interpolants(points, derivatives):
    """All planar PH quintics with these data, by solving for the middle coefficient over again."""
    chord = complex(*points[1]) - complex(*points[0])
    d0, d1 = complex(*derivatives[0]), complex(*derivatives[1])
    found = []
    for w2 in (np.sqrt(d1), -np.sqrt(d1)):
        w0 = np.sqrt(d0)
        # integral of w²: (w0² + w0 w1 + (2 w1² + w0 w2) / 3 + w1 w2 + w2²) / 5 = chord
        middle = np.roots([2 / 3, w0 + w2, d0 + d1 + w0 * w2 / 3 - 5 * chord])
        found += [(w0, w1, w2) for w1 in middle]
    return found


def rotation_by_sampling(w):
    """Twice the variation of arg w over a fine grid; good to the square of its step."""
    t = np.linspace(0, 1, 20001)
    value = w[0] * (1 - t) ** 2 + 2 * w[1] * t * (1 - t) + w[2] * t**2
    return 2 * float(np.abs(np.angle(value[1:] / value[:-1])).sum())


@pytest.mark.parametrize(("points", "derivatives"), CASES)
def test_hermite_interpolates(points, derivatives):
    curve = ph_hermite(points, derivatives)
    found = curve.derivatives([0, 1], 1)
    assert found[0] == pytest.approx(np.array(points), abs=64 * EPS * 40)
    assert found[1] == pytest.approx(np.array(derivatives), abs=64 * EPS * 40)


@pytest.mark.parametrize(("points", "derivatives"), CASES)
def test_hermite_turns_least(points, derivatives):
    rotations = [rotation_by_sampling(w) for w in four_interpolants(points, derivatives)]
    chosen = [complex(*row) for row in ph_hermite(points, derivatives).preimage]
    assert rotation_by_sampling(chosen) == pytest.approx(min(rotations), abs=1e-6)
    assert absolute_rotation(tuple(chosen)) == pytest.approx(min(rotations), abs=1e-6)


def test_absolute_rotation_of_all_four():
    for w in four_interpolants(*CASES[0]):
        assert absolute_rotation(w) == pytest.approx(rotation_by_sampling(w), abs=1e-6)


def test_absolute_rotation_counts_a_cusp_as_half_a_turn_of_the_tangent_each_way():
    # w = 2t - 1: the hodograph (2t - 1)² never turns, its preimage passes through zero: arg w jumps by π.
    assert absolute_rotation((-1 + 0j, 0j, 1 + 0j)) == pytest.approx(2 * math.pi, rel=4 * EPS)


def test_hermite_keeps_a_straight_line_straight():
    curve = ph_hermite([[0, 0], [3, 4]], [[3, 4], [3, 4]])
    assert curve.pieces[0].control == pytest.approx(np.linspace([0, 0], [3, 4], 6), abs=32 * EPS)


@pytest.mark.parametrize(
    ("points", "derivatives", "message"),
    [
        ([[1, 1], [1, 1]], [[1, 0], [0, 1]], "zero length"),
        ([[0, 0], [1, 1]], [[1, 0], [0, 0]], "derivative is zero"),
    ],
)
def test_impossible_hermite_data(points, derivatives, message):
    with pytest.raises(InputError, match=message):
        ph_hermite(points, derivatives)
