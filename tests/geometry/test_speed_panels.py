"""Arc length and its inverse against mpmath at 30 digits, next to cusps too."""

import math
from fractions import Fraction
from itertools import pairwise, product

import mpmath
import numpy as np
import pytest

from ph_post.geometry import speed_panels
from ph_post.geometry.curves import Bezier, Line, Polynomial
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.track import Track

EPS = np.finfo(float).eps
RELATIVE = 1e-12
"""What the project promises; panels are resolved about 100 times better."""


def powers(form):
    """Power coefficients, lowest first, of a Bernstein form in exact numbers."""
    n, c, result = len(form) - 1, [Fraction(x) for x in form], []
    for k in range(n + 1):
        result.append(math.comb(n, k) * c[0])
        c = [b - a for a, b in pairwise(c)]
    return result


def times(p, q):
    result = [Fraction(0)] * (len(p) + len(q) - 1)
    for (i, a), (j, b) in product(enumerate(p), enumerate(q)):
        result[i + j] += a * b
    return result


def slope(p):
    return [k * a for k, a in enumerate(p)][1:] or [Fraction(0)]


class Reference:
    """Arc length of a (rational) Bézier curve by mpmath, from exact coefficients."""

    def __init__(self, control, weights=None):
        factors = [Fraction(1)] * len(control) if weights is None else [Fraction(x) for x in weights]
        self.bottom = powers(factors) if weights is not None else [Fraction(1)]
        self.tops = []
        for column in zip(*control, strict=True):
            place = powers([w * Fraction(x) for w, x in zip(factors, column, strict=True)])
            left, right = times(slope(place), self.bottom), times(place, slope(self.bottom))
            size = max(len(left), len(right))
            left, right = ([*one, *[Fraction(0)] * (size - len(one))] for one in (left, right))
            self.tops.append([a - b for a, b in zip(left, right, strict=True)])

    def places(self, xi):
        """Where to cut: the quadrature is good at ends of any kind, and near-singular places become ends."""
        square = np.sum([np.array(times(top, top), dtype=float) for top in self.tops], axis=0)
        near = [z.real for z in np.roots(square[::-1]) if abs(z.imag) < 0.3 and 0 < z.real < 1]
        return sorted({*xi, *near})

    def lengths(self, xi):
        with mpmath.workdps(30):
            tops = [[mpmath.mpf(x.numerator) / x.denominator for x in reversed(top)] for top in self.tops]
            bottom = [mpmath.mpf(x.numerator) / x.denominator for x in reversed(self.bottom)]

            def speed(u):
                return mpmath.sqrt(sum(mpmath.polyval(top, u) ** 2 for top in tops)) / mpmath.polyval(bottom, u) ** 2

            total, result = mpmath.mpf(0), {0.0: 0.0}
            for a, b in pairwise(self.places([0.0, *xi])):
                total += mpmath.quad(speed, [a, b])
                result[b] = float(total)
        return np.array([result[x] for x in xi])


def check(curve, reference):
    """Compare with the quadrature at several places, then the inverse with the function."""
    xi = [0.2, 0.83, 1.0]
    exact = reference.lengths(xi)
    assert curve.arc_length(xi) == pytest.approx(exact, abs=RELATIVE * exact[-1])
    assert curve.length == pytest.approx(exact[-1], rel=RELATIVE)
    s = np.linspace(0.0, curve.length, 1001)
    assert curve.arc_length(curve.parameter(s)) == pytest.approx(s, abs=1e-14 * curve.length)


@pytest.mark.parametrize(("degree", "dim"), [(2, 2), (3, 3), (5, 2), (5, 3), (11, 2), (20, 2)])
def test_bezier(degree, dim):
    control = np.random.default_rng([degree, dim]).normal(size=(degree + 1, dim))
    check(Bezier(control), Reference(control))


def test_rational_bezier():
    rng = np.random.default_rng(5)
    control, weights = rng.normal(size=(5, 2)) + 100.0, rng.uniform(0.2, 4.0, 5)
    check(Nurbs(4, [0] * 5 + [1] * 5, control, weights), Reference(control, weights))


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("place", [0.3, 0.0007])
def test_near_cusp(place, gap):
    # The hodograph 2 (t - place, gap) all but vanishes; 0.0007 lies before the first node of the whole piece.
    control = np.array([[0.0, 0.0], [-place, gap], [1.0 - 2.0 * place, 2.0 * gap]])
    curve = Bezier(control)
    assert curve.speed(place)[0, 0] == pytest.approx(2 * gap, rel=1e-6)
    check(curve, Reference(control))


@pytest.mark.parametrize("place", [0.3, 0.0007, 0.75 + 0.0003, 0.9999])
def test_cusp_inside_a_piece(place):
    # r' = (t - place) (1, 2t + 1): the speed has a kink.
    curve = Polynomial([[0, -place, 0.5], [0, -place, 0.5 - place, 2 / 3]])
    xi = [0.5 * place, place, 0.5 * (1.0 + place), 1.0]
    with mpmath.workdps(30):

        def signed(t):
            return mpmath.quad(lambda x: (x - mpmath.mpf(place)) * mpmath.sqrt(1 + (2 * x + 1) ** 2), [0, t])

        back = signed(place)
        exact = [float(-signed(t) if t <= place else signed(t) - 2 * back) for t in xi]
    assert curve.arc_length(xi) == pytest.approx(exact, abs=RELATIVE * exact[-1])
    assert curve.length == pytest.approx(exact[-1], rel=RELATIVE)
    s = np.linspace(0, curve.length, 1001)
    assert curve.arc_length(curve.parameter(s)) == pytest.approx(s, abs=1e-14 * curve.length)


def test_semicubical_cusp_in_closed_form():
    curve = Polynomial([[0, 0, 1], [0, 0, 0, 1]], (-1.0, 1.5))
    one_side = [((4 + 9 * t * t) ** 1.5 - 8) / 27 for t in (1.0, 1.5)]
    assert curve.length == pytest.approx(sum(one_side), rel=RELATIVE)


def test_cusp_of_higher_order():
    # r' = (2t - 1)³ (3, 4): the minimum is flat, and there is no telling where it is to the last digit.
    power = np.polynomial.Polynomial([-1, 2]) ** 4 / 8
    curve = Polynomial([3 * power.coef, 4 * power.coef], (0.1, 1.2))
    exact = 5 / 8 * (0.8**4 + 1.4**4)
    assert curve.length == pytest.approx(exact, rel=RELATIVE)


@pytest.mark.parametrize("repeated", [2, 3])
def test_repeated_control_points_at_the_ends(repeated):
    control = [[0, 0]] * repeated + [[1, 3], [2, 1]] + [[4, 0]] * repeated
    check(Bezier(control), Reference(control))


def test_a_straight_line_in_disguise():
    curve = Bezier([[0, 0], [0, 0], [3, 4], [3, 4]])
    xi = np.linspace(0, 1, 9)
    assert curve.arc_length(xi) == pytest.approx(5 * xi**2 * (3 - 2 * xi), abs=1e-14)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_any_size_will_do(scale):
    control = np.random.default_rng(8).normal(size=(6, 2))
    assert Bezier(scale * control).length == pytest.approx(scale * Bezier(control).length, rel=1e-14)


def test_lengths_do_not_depend_on_the_order_of_asking():
    curves = [Bezier(control) for control in np.random.default_rng(2).normal(size=(30, 4, 2))]
    whole, single = Track.from_curves(curves), Track.from_curves(curves)
    piece = np.arange(30)
    u = np.random.default_rng(3).uniform(size=30)
    together = whole.arc_length(piece, u)
    for k in np.random.default_rng(4).permutation(30).tolist():
        alone = single.arc_length(piece[k : k + 1], u[k : k + 1])[0]
        assert alone == pytest.approx(together[k], abs=4 * EPS * whole.length)


def test_quadrature_and_panels_agree():
    curve = Bezier(np.random.default_rng(9).normal(size=(7, 2)))
    assert curve.arc_length(1.0)[0] == pytest.approx(curve.length, rel=1e-13)


def test_every_row_of_a_large_table_comes_back():
    rng = np.random.default_rng(0)
    track = Track.from_curves([Bezier(control) for control in rng.normal(size=(50, 6, 2))])
    s = rng.uniform(0, track.length, 20000)
    piece, u = track.locate(s)
    assert np.all((u >= 0) & (u <= 1))
    assert np.abs(track.arc_length(piece, u) - s).max() <= 4 * EPS * track.length
    assert np.all(np.diff((piece + u)[np.argsort(s)]) >= 0)


def test_lines_are_exact():
    track = Track.from_curves([Line([[0, 0], [3, 4]]), Line([[3, 4], [3, 5]])])
    piece, u = track.locate(np.array([0.0, 2.5, 5.0, 5.25, 6.0]))
    assert piece.tolist() == [0, 0, 1, 1, 1]
    assert u.tolist() == [0.0, 0.5, 0.0, 0.25, 1.0]


def test_a_speed_that_cannot_be_resolved_is_an_error(monkeypatch):
    monkeypatch.setattr(speed_panels, "MAX_ROUNDS", 2)
    with pytest.raises(speed_panels.SolveError, match=r"arc length of piece 0: not resolved on a panel of 0\.25"):
        Polynomial([[0, -0.3, 0.5], [0, -0.3, 0.2, 2 / 3]]).length.hex()


def test_the_length_of_an_ellipse_in_nurbs_form():
    # Radii 3 and 1: the perimeter is 4 a E(e²).
    w = math.sqrt(0.5)
    points = np.array([[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]]) * [3, 1]
    curve = Nurbs(2, [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4], points, [1, w, 1, w, 1, w, 1, w, 1])
    with mpmath.workdps(30):
        exact = float(12 * mpmath.ellipe(mpmath.mpf(8) / 9))
    assert curve.length == pytest.approx(exact, rel=RELATIVE)
