"""Speed, curvature, torsion and normal against closed forms and symbolic differentiation."""

import numpy as np
import pytest
import sympy

from ph_post.geometry import frenet
from ph_post.geometry.curves import Line
from ph_post.geometry.ph import PH

EPS = np.finfo(float).eps


def helix(radius, pitch, t):
    """Derivatives of (R cos t, R sin t, p t) up to order 4, shape (5, n, 3)."""
    z = [pitch * t, np.full_like(t, pitch), *[np.zeros_like(t)] * 3]
    circle = [radius * 1j**k * np.exp(1j * t) for k in range(5)]
    return np.stack([np.stack([c.real, c.imag, z[k]], axis=1) for k, c in enumerate(circle)])


def test_helix():
    radius, pitch = 10.0, 5.0 / (2 * np.pi)
    d = helix(radius, pitch, np.linspace(0, 7, 12))
    square = radius**2 + pitch**2
    kappa, kappa_dot, kappa_ddot = frenet.curvatures(d)
    assert kappa == pytest.approx(radius / square, rel=16 * EPS)
    assert kappa_dot == pytest.approx(0, abs=32 * EPS * kappa[0] ** 2)
    assert kappa_ddot == pytest.approx(0, abs=64 * EPS * kappa[0] ** 3)
    assert frenet.torsion(d) == pytest.approx(pitch / square, rel=32 * EPS)
    inward = -np.stack([np.cos(np.linspace(0, 7, 12)), np.sin(np.linspace(0, 7, 12)), np.zeros(12)], axis=1)
    assert frenet.normal(d) == pytest.approx(inward, abs=32 * EPS)
    # |K̇| is the √(κ̇² + κ²τ²) of the windows in space
    speed_of_turning = np.linalg.norm(frenet.curvature_vectors(d)[1], axis=1)
    assert speed_of_turning == pytest.approx(radius * pitch / square**2, rel=32 * EPS)


def test_a_left_handed_helix_has_negative_torsion():
    d = helix(1.0, -1.0, np.array([0.3]))
    assert frenet.torsion(d)[0] == pytest.approx(-0.5, rel=16 * EPS)


T = sympy.Symbol("t")
TWISTED = (T + T**2 / 2, T**2 - T**3, sympy.Rational(1, 3) * T**3 + T**5)


def symbolic_invariants(at):
    """κ, κ̇, κ̈ and τ of the twisted curve, by differentiating their definitions."""
    r = sympy.Matrix(TWISTED)
    first, second, third = (r.diff(T, k) for k in (1, 2, 3))
    sigma = sympy.sqrt(first.dot(first))
    cross = first.cross(second)
    kappa = sympy.sqrt(cross.dot(cross)) / sigma**3
    kappa_dot = kappa.diff(T) / sigma
    kappa_ddot = kappa_dot.diff(T) / sigma
    tau = cross.dot(third) / cross.dot(cross)
    return [float(e.subs(T, at).evalf(30)) for e in (kappa, kappa_dot, kappa_ddot, tau)]


@pytest.mark.parametrize("at", ["0", "1/3", "9/10"])
def test_a_twisted_curve_by_symbolic_differentiation(at):
    at = sympy.Rational(at)
    d = np.array([[[float(x.diff(T, k).subs(T, at)) for x in TWISTED]] for k in range(5)])
    found = [*frenet.curvatures(d)[:, 0], frenet.torsion(d)[0]]
    exact = symbolic_invariants(at)
    assert found == pytest.approx(exact, abs=1e-13 * max(map(abs, exact)))


def test_speed_derivatives_by_symbolic_differentiation():
    r = sympy.Matrix(TWISTED)
    sigma = sympy.sqrt(r.diff(T).dot(r.diff(T)))
    at = sympy.Rational(2, 5)
    d = np.array([[[float(x.diff(T, k).subs(T, at)) for x in TWISTED]] for k in range(5)])
    exact = [float(sigma.diff(T, k).subs(T, at).evalf(30)) for k in range(4)]
    assert frenet.speed(d)[:, 0] == pytest.approx(exact, rel=1e-13)


def test_a_planar_curve_in_space_has_the_same_curvature_but_for_its_sign():
    d = np.random.default_rng(0).normal(size=(5, 7, 2))
    lifted = np.concatenate([d, np.zeros((5, 7, 1))], axis=2)
    planar, spatial = frenet.curvatures(d), frenet.curvatures(lifted)
    sign = np.sign(planar[0])
    assert spatial == pytest.approx(planar * sign, rel=1e-12)
    assert not np.any(frenet.torsion(lifted))
    assert not np.any(frenet.torsion(d))
    assert frenet.normal(lifted)[:, :2] == pytest.approx(frenet.normal(d), abs=32 * EPS)


def test_a_straight_line_has_no_curvature_and_no_normal():
    d = Line([[0, 0, 0], [1, 2, 2]]).derivatives([0.5], 4)
    assert frenet.curvatures(d).tolist() == [[0.0]] * 3
    assert frenet.torsion(d).tolist() == [0.0]
    assert frenet.normal(d).tolist() == [[0.0, 0.0, 0.0]]


def test_an_inflection_in_space_is_seen_from_its_right():
    # r = (t, t³, 0) has κ = |6 t| + O(t⁵) about t = 0.
    d = np.zeros((5, 1, 3))
    d[1, 0, 0], d[3, 0, 1] = 1.0, 6.0
    assert frenet.curvatures(d)[:, 0].tolist() == [0.0, 6.0, 0.0]
    # r = (t, t⁴, 0) has κ = 12 t²
    d = np.zeros((5, 1, 3))
    d[1, 0, 0], d[4, 0, 1] = 1.0, 24.0
    assert frenet.curvatures(d)[:, 0].tolist() == [0.0, 0.0, 24.0]


def test_fewer_derivatives_give_fewer_invariants():
    d = np.random.default_rng(1).normal(size=(5, 3, 3))
    assert frenet.curvatures(d[:3]) == pytest.approx(frenet.curvatures(d)[:1], rel=8 * EPS)
    assert frenet.curvatures(d[:4]) == pytest.approx(frenet.curvatures(d)[:2], rel=8 * EPS)
    assert frenet.curvature(d).tolist() == frenet.curvatures(d[:3])[0].tolist()


def test_the_speed_of_a_ph_curve_is_its_polynomial():
    curve = PH([0, 0, 0], [[1, 2, 0, 1], [0, 1, 1, -1], [2, 0, 1, 1]])
    u = np.linspace(0, 1, 9)
    basis = np.stack([(1 - u) ** 2, 2 * u * (1 - u), u**2], axis=1)
    parts = basis @ curve.preimage
    assert curve.speed(u)[0] == pytest.approx((parts**2).sum(axis=1), rel=64 * EPS)
