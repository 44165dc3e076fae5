"""Section 2: the formulas of the osculating circle, derived once and compared with the code."""

from itertools import pairwise

import numpy as np
import pytest
import sympy

from ph_post.geometry import frenet

X, Y = (sympy.symbols(f"{name}1:6", real=True) for name in "xy")
"""x', x'', …, of a general curve."""

S, K0, K1, K2 = sympy.symbols("s kappa_0 kappa_1 kappa_2", real=True)


def along(expression):
    """d/ds of Eq. (1): differentiate with respect to ξ, divide by σ."""
    total = sum(expression.diff(v) * w for jet in (X, Y) for v, w in pairwise(jet))
    return total / SIGMA


SIGMA = sympy.sqrt(X[0] ** 2 + Y[0] ** 2)
KAPPA = (X[0] * Y[1] - X[1] * Y[0]) / SIGMA**3


def cross(i, j):
    """(r^(i) × r^(j)) · z"""
    return X[i - 1] * Y[j - 1] - X[j - 1] * Y[i - 1]


def dot(i, j):
    return X[i - 1] * X[j - 1] + Y[i - 1] * Y[j - 1]


SIGMA_1 = dot(1, 2) / SIGMA
SIGMA_2 = (dot(1, 3) + dot(2, 2) - SIGMA_1**2) / SIGMA
KAPPA_1 = (cross(1, 3) - 3 * SIGMA**2 * SIGMA_1 * KAPPA) / SIGMA**4
KAPPA_2 = (
    cross(2, 3)
    + cross(1, 4)
    - 3 * SIGMA * (2 * SIGMA_1**2 + SIGMA * SIGMA_2) * KAPPA
    - 7 * SIGMA**3 * SIGMA_1 * KAPPA_1
) / SIGMA**5
"""As printed."""


def test_the_printed_derivatives_of_the_speed_are_its_derivatives():
    assert sympy.simplify(along(SIGMA) * SIGMA - SIGMA_1) == 0
    assert sympy.simplify(along(SIGMA_1) * SIGMA - SIGMA_2) == 0


def test_the_printed_derivatives_of_the_curvature_are_its_derivatives():
    assert sympy.simplify(along(KAPPA) - KAPPA_1) == 0
    assert sympy.simplify(along(KAPPA_1) - KAPPA_2) == 0


def test_the_code_computes_the_derivatives_of_the_curvature():
    jets = np.random.default_rng(0).normal(size=(5, 20, 2))
    found = frenet.curvatures(jets)
    for column in range(20):
        numbers = {
            v: sympy.Rational(float(jets[k + 1, column, a]))
            for a, jet in enumerate((X, Y))
            for k, v in enumerate(jet[:4])
        }
        derived = (KAPPA, along(KAPPA), along(along(KAPPA)))
        exact = [float(e.subs(numbers).evalf(40)) for e in derived]
        # κ̈ is a sum of terms of size |r''|³ / σ⁶ and the like.
        sigma = float(np.linalg.norm(jets[1, column]))
        size = max(1.0, float(np.abs(jets[1:, column]).max()) / sigma**2)
        assert found[:, column] == pytest.approx(exact, abs=1e-13 * size**3)


def expansion(kappa):
    """The curve with curvature kappa(s), from its tangent's angle; components along t0 and n0 up to s^4."""
    angle = sympy.integrate(kappa, (S, 0, S))
    parts = (sympy.series(f(angle), S, 0, 4).removeO() for f in (sympy.cos, sympy.sin))
    return [sympy.expand(sympy.integrate(sympy.expand(part), (S, 0, S))) for part in parts]


def test_equation_3_is_the_taylor_expansion():
    t0, n0 = expansion(K0 + K1 * S + K2 * S**2 / 2)
    along_t0 = S - K0**2 * S**3 / 6 - 3 * K0 * K1 * S**4 / 24
    along_n0 = K0 * S**2 / 2 + K1 * S**3 / 6 - (K0**3 - K2) * S**4 / 24
    assert sympy.expand(t0 - along_t0) == 0
    assert sympy.expand(n0 - along_n0) == 0


def test_equations_4_and_5_are_what_the_circle_leaves():
    curve, circle = expansion(K0 + K1 * S + K2 * S**2 / 2), expansion(K0)
    deviation = [sympy.expand(a - b) for a, b in zip(curve, circle, strict=True)]
    printed = [-3 * K0 * K1 * S**4 / 24, K1 * S**3 / 6 + K2 * S**4 / 24]
    assert [sympy.expand(a - b) for a, b in zip(deviation, printed, strict=True)] == [0, 0]
    assert [d.subs(K1, 0) for d in deviation] == [0, K2 * S**4 / 24]


def test_the_code_follows_equation_3():
    """d^k r / ds^k in the frame (t0, n0) are the coefficients of (3), k! times."""
    jets = np.random.default_rng(1).normal(size=(5, 50, 2))
    r = frenet.arc_derivatives(jets)
    kappa, kappa_1, kappa_2 = frenet.curvatures(jets)
    t0 = r[1]
    n0 = np.stack([-t0[:, 1], t0[:, 0]], axis=1)
    in_frame = [(np.sum(d * t0, axis=1), np.sum(d * n0, axis=1)) for d in r[2:]]
    expected = [(0 * kappa, kappa), (-(kappa**2), kappa_1), (-3 * kappa * kappa_1, kappa_2 - kappa**3)]
    for found, exact in zip(in_frame, expected, strict=True):
        size = max(np.abs(exact[0]).max(), np.abs(exact[1]).max())
        assert found[0] == pytest.approx(exact[0], abs=1e-12 * size)
        assert found[1] == pytest.approx(exact[1], abs=1e-12 * size)
