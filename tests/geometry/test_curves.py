"""Curves: values and derivatives against exact definitions, exact pieces, and what is refused."""

import math
from fractions import Fraction
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from scipy.interpolate import BSpline

from ph_post.errors import InputError
from ph_post.geometry.curves import Arc, Bezier, Line, Polynomial
from ph_post.geometry.nurbs import Nurbs, bezier_spans
from ph_post.geometry.ph import PH

EPS = np.finfo(float).eps
ROOT_HALF = math.sqrt(0.5)
CIRCLE = {
    "knots": [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4],
    "points": [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]],
    "weights": [1, ROOT_HALF, 1, ROOT_HALF, 1, ROOT_HALF, 1, ROOT_HALF, 1],
}


def cox_de_boor(degree, knots, points, t):
    """The definition of a B-spline curve, in exact numbers."""
    last = max(k for k in range(len(knots) - 1) if knots[k] < knots[k + 1])

    def basis(i, p):
        if p == 0:
            return int(knots[i] <= t < knots[i + 1] or (i == last and t == knots[i + 1]))
        total = Fraction(0)
        if knots[i + p] > knots[i]:
            total += (t - knots[i]) / (knots[i + p] - knots[i]) * basis(i, p - 1)
        if knots[i + p + 1] > knots[i + 1]:
            total += (knots[i + p + 1] - t) / (knots[i + p + 1] - knots[i + 1]) * basis(i + 1, p - 1)
        return total

    values = [basis(i, degree) for i in range(len(points))]
    return [sum(b * x for b, x in zip(values, column, strict=True)) for column in zip(*points, strict=True)]


def casteljau(control, u):
    rest = [list(point) for point in control]
    while len(rest) > 1:
        rest = [[(1 - u) * a + u * b for a, b in zip(p, q, strict=True)] for p, q in pairwise(rest)]
    return rest[0]


def fractions(rows):
    return tuple(tuple(map(Fraction, row)) for row in rows)


def test_polynomial_derivatives_are_those_of_the_powers():
    x, y = [1.0, -2.0, 0.5, 3.0, 1.0, 0.25], [0.0, 1.0, 4.0, -1.0]
    curve = Polynomial([x, y], (-1.0, 3.0))
    xi = np.array([-1.0, 0.3, 2.9, 3.0])
    found = curve.derivatives(xi, 4)
    for axis, power in enumerate((x, y)):
        for order in range(5):
            exact = np.polynomial.Polynomial(power).deriv(order)(xi)
            # Differences of control points up to 1500 in size, over the domain's width 4.
            assert found[order, :, axis] == pytest.approx(exact, abs=100 * EPS * 1500 * 2**order)


def test_polynomial_far_from_its_origin_is_converted_without_loss():
    power = (Fraction(-(10**6)), Fraction(2000), Fraction(-1))  # -(xi - 1000)² expanded
    curve = Polynomial([power, (Fraction(0), Fraction(1))], (1000.0, 1001.0))
    assert curve.pieces[0].control[:, 0].tolist() == [0.0, 0.0, -1.0]


@pytest.mark.parametrize("degree", [1, 3, 5, 20])
def test_bezier_derivatives_by_exact_differences(degree):
    points = np.random.default_rng(degree).normal(size=(degree + 1, 3))
    curve, u = Bezier(points), Fraction(5, 16)
    net = fractions(points)
    for order in range(min(degree, 4) + 1):
        exact = np.array(casteljau(net, u), dtype=float) * math.perm(degree, order)
        scale = math.perm(degree, order) * 2**order * np.abs(points).max()
        found = curve.derivatives(float(u), order)[order, 0]
        assert found == pytest.approx(exact, abs=4 * (degree + 4) * EPS * scale)
        net = [[b - a for a, b in zip(p, q, strict=True)] for p, q in pairwise(net)]


def test_derivatives_beyond_the_degree_vanish():
    assert not np.any(Line([[0, 0], [1, 2]]).derivatives([0.5], 4)[2:])


SPLINES = {
    "clamped": (3, [0, 0, 0, 0, 1, 2, 4, 4, 4, 4], 6),
    "double and triple knots": (3, [0, 0, 0, 0, 1, 1, 2, 2, 2, 3, 3, 3, 3], 9),
    "unclamped": (3, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9], 6),
    "ends of multiplicity p": (2, [0, 0, 1, 2, 3, 3], 3),
    "uneven": (4, [-1, -1, 0, 0.1, 0.2, 0.7, 0.7, 0.9, 1.5, 2, 2, 2], 7),
}


@pytest.mark.parametrize("name", SPLINES)
@pytest.mark.parametrize("rational", [False, True])
def test_nurbs_by_the_definition(name, rational):
    degree, knots, count = SPLINES[name]
    rng = np.random.default_rng(count)
    points, weights = rng.normal(size=(count, 2)), rng.uniform(0.3, 3.0, count)
    curve = Nurbs(degree, knots, points, weights if rational else None)
    assert curve.domain == (knots[degree], knots[count])
    used = [Fraction(w) if rational else Fraction(1) for w in weights]
    homogeneous = [(*(w * Fraction(x) for x in p), w) for w, p in zip(used, points, strict=True)]
    exact_knots = [Fraction(t) for t in knots]
    for xi in np.linspace(*curve.domain, 17):
        *place, w = cox_de_boor(degree, exact_knots, homogeneous, Fraction(xi))
        exact = [float(x / w) for x in place]
        assert curve.derivatives(xi)[0, 0] == pytest.approx(exact, abs=60 * EPS)


@pytest.mark.parametrize("name", SPLINES)
def test_nurbs_derivatives_by_scipy(name):
    degree, knots, count = SPLINES[name]
    points = np.random.default_rng(count).normal(size=(count, 2))
    curve, spline = Nurbs(degree, knots, points), BSpline(np.array(knots, dtype=float), points, degree)
    low, high = curve.domain
    xi = np.linspace(low, high, 23)[1:-1]
    xi = xi[~np.isin(xi, knots)]
    found = curve.derivatives(xi, degree)
    for order in range(degree + 1):
        # Each derivative divides by knot spans of 0.1 at least.
        scale = math.perm(degree, order) * (2 / 0.1) ** order * 3
        assert found[order] == pytest.approx(spline(xi, order), abs=100 * EPS * scale)


def test_rational_derivatives_against_mpmath():
    weights = [1.0, 0.4, 2.5, 1.0]
    points = [[0.0, 0.0], [1.0, 2.0], [3.0, -1.0], [4.0, 1.0]]
    curve = Nurbs(3, [0, 0, 0, 0, 1, 1, 1, 1], points, weights)
    with mpmath.workdps(40):
        for axis in range(2):

            def value(u, axis=axis):
                b = [mpmath.binomial(3, k) * u**k * (1 - u) ** (3 - k) * weights[k] for k in range(4)]
                return mpmath.fdot(b, [p[axis] for p in points]) / mpmath.fsum(b)

            taylor = mpmath.taylor(value, mpmath.mpf("0.375"), 4)
            exact = [float(c * mpmath.factorial(k)) for k, c in enumerate(taylor)]
            found = curve.derivatives(0.375, 4)[:, 0, axis]
            assert found == pytest.approx(exact, rel=1e-12, abs=1e-12)


def test_a_circle_as_nurbs():
    curve = Nurbs(2, **CIRCLE)
    place = curve.derivatives(np.linspace(0, 4, 101))[0]
    assert np.hypot(*place.T) == pytest.approx(1.0, abs=8 * EPS)
    assert len(curve.pieces) == 4
    assert curve.pieces[0].kind == "rational"


def test_equal_weights_cancel():
    curve = Nurbs(2, [0, 0, 0, 1, 1, 1], [[0, 0], [1, 1], [2, 0]], [3.0, 3.0, 3.0])
    assert curve.pieces[0].kind == "polynomial"
    assert curve.pieces[0].control.tolist() == [[0, 0], [1, 1], [2, 0]]


def test_a_knot_of_full_multiplicity_may_cut_the_curve_in_two():
    knots = [0, 0, 0, 1, 1, 1, 2, 2, 2]
    points = [[0, 0], [1, 1], [2, 0], [2, 0], [3, -1], [4, 0]]
    curve = Nurbs(2, knots, points)
    assert [piece.control.tolist() for piece in curve.pieces] == [points[:3], points[3:]]
    with pytest.raises(InputError, match=r"comes apart at knot 1; .* got a gap of 1e\+03 mm"):
        Nurbs(2, knots, [*points[:3], [2, 1], *points[4:]])


def test_spans_that_stand_still_are_left_out():
    points = [[0, 0], [1, 1], [2, 0], [2, 0], [2, 0], [3, 0], [4, 4]]
    curve = Nurbs(2, [0, 0, 0, 1, 1, 2, 2, 3, 3, 3], points)
    assert [(piece.xi0, piece.xi1) for piece in curve.pieces] == [(0.0, 1.0), (2.0, 3.0)]
    assert len(curve.exact_pieces()) == 2
    assert curve.domain == (0.0, 3.0)
    assert curve.derivatives([1.5, 3.0])[0].tolist() == [[2.0, 0.0], [4.0, 4.0]]


def test_knot_insertion_is_exact():
    knots = tuple(map(Fraction, (0, 0, 0, 0, 1, 3, 7, 7, 7, 7)))
    points = fractions(np.random.default_rng(1).integers(-9, 9, size=(6, 2)).tolist())
    for (t0, t1), control in bezier_spans(3, knots, points):
        for u in (Fraction(0), Fraction(2, 5), Fraction(9, 10)):
            assert casteljau(control, u) == cox_de_boor(3, knots, points, t0 + u * (t1 - t0))


def test_exact_data_go_through_untouched():
    third = Fraction(1, 3)
    points = ((Fraction(0), Fraction(0)), (third, Fraction(1)))
    assert Line([[0, 0], [1 / 3, 1]], exact=points).exact_pieces()[0].control == points
    assert Bezier([[0, 0], [1 / 3, 1]], exact=points).exact_pieces()[0].control == points
    exact = (((Fraction(0), third), (Fraction(1), Fraction(0))), (Fraction(0), Fraction(3)))
    curve = Polynomial([[0, 1 / 3], [1, 0]], (0, 3), exact=exact)
    assert curve.exact_pieces()[0].control == ((0, 1), (1, 1))
    knots, weights = tuple(map(Fraction, (0, 0, 1, 1))), (Fraction(1), third)
    spline = Nurbs(1, [0, 0, 1, 1], [[0, 0], [1 / 3, 1]], [1, 1 / 3], exact=(knots, points, weights))
    assert spline.exact_pieces()[0].control == ((0, 0, 1), (third**2, third, third))


def test_floats_count_as_exact_where_nothing_else_is_given():
    assert Line([[0, 0], [0.1, 1]]).exact_pieces()[0].control[1][0] == Fraction(0.1)
    assert Arc([0.1, 0], [0.1, 0], [0, 0], "cw").exact == fractions([[0.1, 0], [0.1, 0], [0, 0]])
    assert Arc([0.1, 0], [0.1, 0], [0, 0], "cw").exact_pieces() == (None,)


@pytest.mark.parametrize(("turn", "end", "sweep"), [("ccw", [0, 2], 0.5), ("cw", [0, 2], -1.5), ("cw", [2, 0], -2.0)])
def test_arc_derivatives(turn, end, sweep):
    arc = Arc([2, 0], end, [0, 0], turn)
    xi, omega = np.array([0.0, 0.2, 1.0]), sweep * math.pi
    found = arc.derivatives(xi, 4)
    for order in range(5):
        exact = (1j * omega) ** order * 2.0 * np.exp(1j * omega * xi)
        # The angle is rounded, to 8 eps of it and the radius.
        assert found[order, :, 0] == pytest.approx(exact.real, abs=16 * EPS * 2.0 * abs(omega) ** (order + 1))
        assert found[order, :, 1] == pytest.approx(exact.imag, abs=16 * EPS * 2.0 * abs(omega) ** (order + 1))
    assert arc.length == pytest.approx(2 * abs(omega), rel=4 * EPS)


def test_arc_in_space_keeps_its_height():
    arc = Arc([1, 0, 5], [-1, 0, 5], [0, 0, 5], "ccw")
    found = arc.derivatives([0.5], 1)
    assert found[:, 0] == pytest.approx(np.array([[0, 1, 5], [-math.pi, 0, 0]]), abs=4 * EPS)


def test_ends_that_meet_are_a_full_circle():
    arc = Arc([1, 0], [1, 0.9e-9], [0, 0], "cw")
    assert arc.full
    assert arc.sweep == -math.tau
    assert not Arc([1, 0], [1, 1.1e-9], [0, 0], "ccw").full


def test_a_radius_that_disagrees_a_little_is_the_mean():
    arc = Arc([1, 0], [0, 1 + 0.8e-9], [0, 0], "ccw")
    assert arc.radius == pytest.approx(1 + 0.4e-9, abs=EPS)


def test_speed_and_curvature_of_a_parabola():
    curve = Polynomial([[0, 1], [0, 0, 1]], (-1, 1))
    xi = np.array([-0.5, 0.0, 0.7])
    sigma = np.sqrt(1 + 4 * xi**2)
    found = curve.speed(xi, 2)
    assert found[0] == pytest.approx(sigma, rel=8 * EPS)
    assert found[1] == pytest.approx(4 * xi / sigma, abs=16 * EPS)
    assert found[2] == pytest.approx(4 / sigma**3, rel=32 * EPS)
    assert curve.curvature(xi) == pytest.approx(2 / sigma**3, rel=16 * EPS)


def test_arc_length_and_back():
    curve = Polynomial([[0, 1], [0, 0, 1]], (0, 2))
    xi = np.linspace(0, 2, 11)
    exact = 0.5 * xi * np.sqrt(1 + 4 * xi**2) + 0.25 * np.arcsinh(2 * xi)
    assert curve.arc_length(xi) == pytest.approx(exact, abs=1e-13)
    assert curve.parameter(exact) == pytest.approx(xi, abs=1e-13)


TWO, THREE = [[0, 0], [1, 0]], [[0, 0], [1, 1], [2, 0]]
REFUSED = {
    "line of three": (lambda: Line(THREE), "wrong number of points; expected 2; got 3"),
    "line of no length": (lambda: Line([[1, 1], [1, 1]]), "zero length; .* got 0 mm"),
    "bezier of one": (lambda: Bezier([[1, 1]]), "too few points; expected at least 2; got 1"),
    "bezier of no length": (
        lambda: Bezier([[1, 1], [1, 1 + 9e-10], [1, 1]]),
        "zero length; .*; got 9e-07 mm",
    ),
    "constant polynomial": (lambda: Polynomial([[1], [2]]), "zero length"),
    "empty domain": (lambda: Polynomial([[1, 1], [2, 2]], (1, 1)), "empty domain; .* got "),
    "preimage of zeros": (lambda: PH([0, 0], [[0, 0], [0, 0]]), "zero length"),
    "spatial preimage in the plane": (
        lambda: PH([0, 0], [[1, 0, 0, 0]]),
        "wrong number of preimage components; expected 2; got 4",
    ),
    "radii": (
        lambda: Arc([1, 0], [0, 1.1], [0, 0], "ccw"),
        "not at one distance from the center; .*; got 1000 mm and 1100 mm",
    ),
    "radius of zero": (lambda: Arc([1, 0], [1, 0], [1, 0], "ccw"), "radius is zero"),
    "arc of no length": (
        lambda: Arc([1e-10, 0], [1e-10, 0], [0, 0], "ccw"),
        "zero length; .*; got 6.28e-07 mm",
    ),
    "arc out of plane": (
        lambda: Arc([1, 0, 0], [0, 1, 1], [0, 0, 0], "ccw"),
        "leaves its plane; .*; got 0, 1000, 0 mm",
    ),
    "degree": (lambda: Nurbs(0, [0, 1, 2], TWO), "degree is too low; expected at least 1; got 0"),
    "too few points": (
        lambda: Nurbs(3, [0] * 4 + [1] * 4, THREE),
        "too few points .*; expected at least 4; got 3",
    ),
    "knots": (lambda: Nurbs(2, [0, 0, 1, 1], THREE), r"number of knots; expected 6 \(.*\); got 4"),
    "falling knots": (lambda: Nurbs(1, [0, 2, 1, 3], TWO), "knots fall; .*; got 2 before 1"),
    "often": (
        lambda: Nurbs(1, [0, 0, 1, 1, 1, 2, 2], [*TWO, *THREE]),
        "knot 1 is repeated too often; expected at most 2 times; got 3",
    ),
    "no span": (
        lambda: Nurbs(1, [0, 1, 1, 2], TWO),
        "the knots span nothing; expected t_p < t_n; got 1 twice",
    ),
    "weights": (lambda: Nurbs(1, [0, 0, 1, 1], TWO, [1, 0]), "weight is not positive; expected > 0; got 0"),
    "number of weights": (lambda: Nurbs(1, [0, 0, 1, 1], TWO, [1]), "number of weights; expected 2; got 1"),
    "nurbs of no length": (lambda: Nurbs(1, [0, 0, 1, 1], [[1, 1], [1, 1]]), "zero length"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_impossible_data_are_refused(name):
    make, message = REFUSED[name]
    with pytest.raises(InputError, match=message):
        make()
