"""Batched root isolation against roots that are known by construction, and against 50-digit mpmath."""

from __future__ import annotations

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ph_post.geometry.root_isolation import EPS, find_roots, sign_changes
from ph_post.types import Array


def bernstein_from_roots(roots: list[Fraction], factor: Fraction = Fraction(1)) -> list[Fraction]:
    """Bernstein coefficients of factor * Π (u - root), exactly."""
    power = [factor]
    for root in roots:
        power = [a - root * b for a, b in zip([Fraction(0), *power], [*power, Fraction(0)], strict=True)]
    n = len(power) - 1
    return [
        sum((power[i] * Fraction(math.comb(k, i), math.comb(n, i)) for i in range(k + 1)), Fraction(0))
        for k in range(n + 1)
    ]


def rounded(rows: list[list[Fraction]]) -> tuple[Array, Array]:
    """Rows of coefficients as floats, with the bound on what rounding once did to them."""
    c = np.array([[float(value) for value in row] for row in rows])
    exact = np.array([[Fraction(float(value)) == value for value in row] for row in rows])
    return c, np.where(exact, 0.0, EPS * np.abs(c))


def test_known_simple_roots_are_all_found() -> None:
    rng = np.random.default_rng(1)
    rows, inside = [], []
    for _ in range(400):
        places = rng.choice(np.arange(-300, 400), size=5, replace=False)
        roots = [Fraction(int(place), 101) + Fraction(1, 1000) for place in places]
        rows.append(bernstein_from_roots(roots, Fraction(int(rng.integers(1, 9)))))
        inside.append(sorted(root for root in roots if 0 < root < 1))
    found = find_roots(*rounded(rows))
    assert found.undecided.size == 0
    assert found.row.tolist() == [k for k, roots in enumerate(inside) for _ in roots]
    exact = np.array([float(root) for roots in inside for root in roots])
    assert np.all(np.abs(found.u - exact) <= found.error)
    assert np.all((found.low <= exact) & (exact <= found.high))


@pytest.mark.parametrize("degree", [1, 2, 4, 7, 9])
def test_against_mpmath(degree: int) -> None:
    c = np.random.default_rng(degree).normal(size=(25, degree + 1))
    found = find_roots(c, np.zeros((25, 1)))
    assert found.undecided.size == 0
    with mpmath.workdps(50):
        for k, row in enumerate(c):
            power = [
                sum(
                    mpmath.mpf(float(row[i])) * math.comb(degree, j) * math.comb(j, i) * (-1) ** (j - i)
                    for i in range(j + 1)
                )
                for j in range(degree + 1)
            ]
            roots = mpmath.polyroots(power[::-1], maxsteps=200, extraprec=200)
            real = sorted(root.real for root in map(mpmath.mpc, roots) if abs(root.imag) < mpmath.mpf("1e-30"))
            real = [root for root in real if 0 < root < 1]
            mine = found.u[found.row == k]
            assert len(mine) == len(real)
            assert all(abs(a - b) <= e for a, b, e in zip(mine, real, found.error[found.row == k], strict=True))


@pytest.mark.parametrize("apart", [Fraction(1, 10**3), Fraction(1, 10**6)])
def test_nearly_double_roots_are_two(apart: Fraction) -> None:
    middle = Fraction(1, 3)
    found = find_roots(*rounded([bernstein_from_roots([middle - apart, middle + apart, Fraction(5)])]))
    assert found.row.tolist() == [0, 0]
    exact = np.array([float(middle - apart), float(middle + apart)])
    assert np.all(np.abs(found.u - exact) <= found.error)


def test_nearly_a_double_root_is_none() -> None:
    """(u - 1/3)² + 1e-12 touches nothing."""
    row = bernstein_from_roots([Fraction(1, 3)] * 2)
    found = find_roots(*rounded([[value + Fraction(1, 10**12) for value in row]]))
    assert found.row.size == 0
    assert found.undecided.size == 0


@pytest.mark.parametrize("multiplicity", [2, 3, 4])
def test_multiple_roots_are_never_decided_wrongly(multiplicity: int) -> None:
    """An even root is left undecided; an odd one may be bracketed, but then its error bound tells."""
    found = find_roots(*rounded([bernstein_from_roots([Fraction(1, 3)] * multiplicity + [Fraction(-2)])]))
    if multiplicity % 2 == 0:
        assert found.undecided.tolist() == [0]
    else:
        assert found.undecided.tolist() == [0] or np.all(found.error > 1e-14)


def test_a_double_root_at_a_cut_is_undecided() -> None:
    assert find_roots(*rounded([bernstein_from_roots([Fraction(1, 2)] * 2)])).undecided.tolist() == [0]


def test_simple_root_at_the_first_cut() -> None:
    found = find_roots(*rounded([bernstein_from_roots([Fraction(1, 2), Fraction(1, 4), Fraction(3, 4)])]))
    assert found.u.tolist() == pytest.approx([0.25, 0.5, 0.75], abs=1e-15)


def test_exact_zeros_at_the_ends_are_not_listed() -> None:
    rows = [[0.0, 1.0, 2.0], [0.0, -1.0, 2.0], [0.0, 0.0, 1.0], [1.0, -1.0, 0.0], [0.0, 0.0, 0.0]]
    found = find_roots(np.array(rows), np.zeros((5, 1)))
    assert found.undecided.size == 0
    assert found.row.tolist() == [1, 3]
    # u (4 u - 2) and (1 - u) (1 - 3 u).
    assert found.u.tolist() == pytest.approx([0.5, 1 / 3], abs=1e-15)


def test_doubt_is_handed_back() -> None:
    c = np.array([[1e-17, 1.0, 2.0], [1.0, 1e-17, 1.0], [1.0, 1e-17, -1.0], [1.0, 2.0, 3.0]])
    found = find_roots(c, np.full((4, 1), 1e-16))
    assert found.undecided.tolist() == [0]
    assert found.row.tolist() == [2]


def test_sign_changes_skip_zeros_and_tell_doubt() -> None:
    c = np.array([[1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [1.0, 1e-20, -1.0], [1.0, 1e-20, 1.0]]).T
    e = np.array([[0.0] * 3, [0.0] * 3, [1e-18] * 3, [1e-18] * 3]).T
    changes, certain = sign_changes(c, e)
    assert changes.tolist() == [1, 0, 1, 0]
    assert certain.tolist() == [True, True, True, False]


def test_no_rows_and_constants() -> None:
    assert find_roots(np.empty((0, 4)), np.zeros((0, 1))).u.size == 0
    assert find_roots(np.array([[1.0], [0.0], [-2.0]]), np.zeros((3, 1))).u.size == 0


@given(st.lists(st.integers(-9, 9), min_size=2, max_size=8))
def test_small_integers_against_sturm(values: list[int]) -> None:
    """Small integers make zeros, multiple roots and roots at cuts; Sturm's theorem counts them."""
    import sympy

    found = find_roots(np.array([values], dtype=float), np.zeros((1, 1)))
    if found.undecided.size or not any(values):
        return
    u = sympy.Symbol("u")
    n = len(values) - 1
    terms = [a * math.comb(n, k) * u**k * (1 - u) ** (n - k) for k, a in enumerate(values)]
    polynomial = sympy.Poly(sympy.Add(*terms), u)
    ends = sum(polynomial.eval(end) == 0 for end in (0, 1))
    assert found.u.size == polynomial.count_roots(0, 1) - ends
