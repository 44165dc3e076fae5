"""Turning points: every kind, and every place where a root may be missed or invented."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from ph_post.analysis.certification import certify
from ph_post.analysis.turning_points import find_turning_points
from ph_post.geometry.curves import Arc, Bezier, Line, Polynomial
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.ph import PH
from ph_post.geometry.piecewise import PiecewiseCurve
from ph_post.geometry.reversals import StationaryPoints, find_stationary_points
from ph_post.geometry.track import Track
from ph_post.types import TurningPoint
from ph_post.units import MM

QUARTER = 0.5519150244935106  # tangent length of a cubic that is nearly a quarter of a circle


def turning_points(*curves: PiecewiseCurve, closed: bool = False) -> tuple[TurningPoint, ...]:
    """Turning points of a path, found and certified."""
    track = Track.from_curves(curves, closed=closed)
    certificate = certify(track)
    assert certificate.ok, certificate.words
    return find_turning_points(track)


def summary(points: tuple[TurningPoint, ...]) -> list[tuple[str, int, float, str, str]]:
    return [(p.kind, p.segment, round(p.xi, 12), p.axis, p.sense) for p in points]


def power(*coefficients: str) -> tuple[Fraction, ...]:
    return tuple(Fraction(c) for c in coefficients)


def exact_polynomial(x: tuple[Fraction, ...], y: tuple[Fraction, ...]) -> Polynomial:
    """A polynomial curve on [0, 1] in mm with its exact data."""
    floats = [[float(c) * MM for c in axis] for axis in (x, y)]
    return Polynomial(floats, (0.0, 1.0), exact=((x, y), power("0", "1")))


def from_velocity(*coefficients: str) -> tuple[Fraction, ...]:
    """Antiderivative of a polynomial."""
    return (Fraction(0), *(c / (k + 1) for k, c in enumerate(power(*coefficients))))


UP = power("0", "10")


def test_parabola_has_the_curvature_of_its_vertex() -> None:
    """y = 3/4 - a x² (in 10 mm): κ = -2a, κ̇ = 0, κ̈ = -3κ³ at the vertex."""
    (point,) = turning_points(Bezier(np.array([[-1.0, 0.0], [0.0, 1.5], [1.0, 0.0]]) * 10 * MM))
    kappa = -2.0 * 0.75 / (10 * MM)
    assert (point.kind, point.axis, point.sense, point.segment) == ("smooth", "Y", "max", 0)
    assert point.xi == 0.5
    assert point.position == pytest.approx(7.5 * MM, rel=1e-15)
    assert point.curvature == pytest.approx(kappa, rel=1e-14)
    assert point.curvature_dot == 0.0
    assert point.curvature_ddot == pytest.approx(-3.0 * kappa**3, rel=1e-13)
    assert (point.torsion, point.normal) == (0.0, -1.0)


def test_inflectional_tangent_is_no_turning_point() -> None:
    assert turning_points(Polynomial([[0.0, 0.0, 0.0, 0.01], [0.0, 0.01]], (-1.0, 1.0))) == ()


def test_double_root_of_exact_data_is_no_turning_point() -> None:
    """x' = (xi - 1/3)²: as doubles the coefficients have two roots or none."""
    assert turning_points(exact_polynomial(from_velocity("1/9", "-2/3", "1"), UP)) == ()


def test_triple_root_is_one_turning_point() -> None:
    """x' = (xi - 1/3)³."""
    (point,) = turning_points(exact_polynomial(from_velocity("-1/27", "1/3", "-1", "1"), UP))
    assert (point.kind, point.sense) == ("smooth", "min")
    assert point.xi == pytest.approx(1 / 3, abs=1e-16)
    assert point.curvature == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("apart", [Fraction(1, 10**4), Fraction(1, 10**8), Fraction(1, 10**12)])
def test_nearly_double_roots_are_two(apart: Fraction) -> None:
    """x' = (xi - 1/3)² - apart²."""
    velocity = (str(Fraction(1, 9) - apart**2), "-2/3", "1")
    points = turning_points(exact_polynomial(from_velocity(*velocity), UP))
    assert [(p.axis, p.sense) for p in points] == [("X", "max"), ("X", "min")]
    for point, sign in zip(points, (-1, 1), strict=True):
        assert point.xi == pytest.approx(float(Fraction(1, 3) + sign * apart), abs=1e-15)


def test_nearly_a_double_root_is_none() -> None:
    velocity = (str(Fraction(1, 9) + Fraction(1, 10**24)), "-2/3", "1")
    assert turning_points(exact_polynomial(from_velocity(*velocity), UP)) == ()


def oval(noise: float = 0.0, seed: int = 0) -> list[Bezier]:
    """Four cubics with their turning points in the joints; `noise` in ulps."""
    rng = np.random.default_rng(seed)
    quarter = np.array([[1.0, 0.0], [1.0, QUARTER], [QUARTER, 1.0], [0.0, 1.0]])
    curves = []
    for k in range(4):
        turn = np.array(
            [
                [math.cos(k * math.pi / 2), -math.sin(k * math.pi / 2)],
                [math.sin(k * math.pi / 2), math.cos(k * math.pi / 2)],
            ]
        ).round()
        points = (quarter @ turn.T) * np.array([0.03, 0.02]) + np.array([0.1, 0.2])
        curves.append(Bezier(points + noise * rng.choice([-1, 0, 1], points.shape) * np.spacing(points)))
    return curves


def test_roots_in_joints_count_once() -> None:
    assert summary(turning_points(*oval(), closed=True)) == [
        ("smooth", 0, 0.0, "X", "max"),
        ("smooth", 0, 1.0, "Y", "max"),
        ("smooth", 1, 1.0, "X", "min"),
        ("smooth", 2, 1.0, "Y", "min"),
    ]


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.thinned(4)
def test_an_ulp_of_noise_in_the_joints_changes_nothing(seed: int) -> None:
    points = turning_points(*oval(noise=1.0, seed=seed), closed=True)
    assert sorted((p.axis, p.sense) for p in points) == [
        ("X", "max"),
        ("X", "min"),
        ("Y", "max"),
        ("Y", "min"),
    ]
    for point in points:
        near = [0.0, 0.25, 0.5, 0.75, 1.0]
        length = Track.from_curves(oval()).length
        assert min(abs(point.s / length - place) for place in near) < 1e-12


@pytest.mark.parametrize("seed", range(40))
def test_an_ulp_of_noise_at_an_inflection_in_a_joint_invents_nothing(seed: int) -> None:
    """x = t³ on both sides of the joint: with noise the doubles turn there twice."""
    rng = np.random.default_rng(seed)
    first = np.array([[-1.0, -1.0], [0.0, -2 / 3], [0.0, -1 / 3], [0.0, 0.0]]) * 0.01 + 0.3
    second = (0.6 - first)[::-1]
    noisy = [Bezier(p + rng.choice([-1, 0, 1], p.shape) * np.spacing(p)) for p in (first, second)]
    assert find_turning_points(Track.from_curves(noisy)) == ()


def test_sharp_corners_turn_the_axes_that_change_direction() -> None:
    zigzag = [
        Line([[0, 0], [0.01, 0.01]]),
        Line([[0.01, 0.01], [0.02, 0.0]]),
        Line([[0.02, 0.0], [0.01, -0.01]]),
    ]
    points = turning_points(*zigzag)
    assert summary(points) == [("corner", 0, 1.0, "Y", "max"), ("corner", 1, 1.0, "X", "max")]
    for point in points:
        assert (point.curvature, point.curvature_dot, point.curvature_ddot) == (None, None, None)
        assert (point.torsion, point.normal) == (None, None)


def test_going_back_along_a_line_is_a_corner_of_both_axes() -> None:
    points = turning_points(Line([[0, 0], [0.01, 0.02]]), Line([[0.01, 0.02], [0, 0]]))
    assert summary(points) == [("corner", 0, 1.0, "X", "max"), ("corner", 0, 1.0, "Y", "max")]


def test_going_back_inside_a_segment_is_a_cusp_of_both_axes() -> None:
    points = turning_points(Bezier([[0, 0], [0.01, 0.02], [0, 0]]))
    assert summary(points) == [("cusp", 0, 0.5, "X", "max"), ("cusp", 0, 0.5, "Y", "max")]
    assert all(point.curvature is None for point in points)


def test_a_cusp_turns_only_the_axis_that_goes_back() -> None:
    """x' has a double root where y' has a simple one."""
    points = turning_points(Bezier(np.array([[0, 0], [1, 1], [0, 1], [1, 0]]) * 0.01))
    assert summary(points) == [("cusp", 0, 0.5, "Y", "max")]


def test_the_speed_of_a_ph_curve_may_vanish_without_a_reversal() -> None:
    """A preimage through zero: the hodograph has a double root, and the direction stays."""
    assert turning_points(PH([0, 0], np.array([[-0.1, -0.2], [0.1, 0.2]]))) == ()


def test_dwell_is_where_the_axis_moves_back() -> None:
    """A slot: the straight sides are two still pieces each for Y."""
    side = [Line([[0, 0], [0.04, 0]]), Line([[0.04, 0], [0.1, 0]])]
    back = [Line([[0.1, 0.02], [0.05, 0.02]]), Line([[0.05, 0.02], [0, 0.02]])]
    ends = [Arc([0.1, 0], [0.1, 0.02], [0.1, 0.01], "ccw"), Arc([0, 0.02], [0, 0], [0, 0.01], "ccw")]
    points = turning_points(*side, ends[0], *back, ends[1], closed=True)
    assert summary(points) == [
        ("dwell", 1, 1.0, "Y", "min"),
        ("smooth", 2, 0.5, "X", "max"),
        ("dwell", 4, 1.0, "Y", "max"),
        ("smooth", 5, 0.5, "X", "min"),
    ]
    # After a dwell the outgoing side answers: the arc of radius 10 mm.
    assert points[0].curvature == pytest.approx(100.0, rel=1e-13)
    assert points[0].normal == pytest.approx(1.0)


def test_still_stretch_across_the_seam() -> None:
    """A rectangle that begins in the middle of its lower side: Y stands still on both sides of the seam."""
    corners = [[0.05, 0.0], [0.1, 0.0], [0.1, 0.04], [0.0, 0.04], [0.0, 0.0], [0.05, 0.0]]
    lines = [Line([a, b]) for a, b in pairwise(corners)]
    points = turning_points(*lines, closed=True)
    assert summary(points) == [
        ("dwell", 0, 1.0, "Y", "min"),
        ("dwell", 1, 1.0, "X", "max"),
        ("dwell", 2, 1.0, "Y", "max"),
        ("dwell", 3, 1.0, "X", "min"),
    ]
    assert all(point.curvature is None for point in points)


def test_a_dwell_that_ends_in_the_seam_belongs_to_the_first_segment() -> None:
    corners = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.04], [0.0, 0.04], [0.0, 0.0]]
    lines = [Line([a, b]) for a, b in pairwise(corners)]
    assert summary(turning_points(*lines, closed=True))[0] == ("dwell", 0, 0.0, "X", "min")
    # An open path begins there, and nothing reverses.
    assert summary(turning_points(*lines)) == [("dwell", 1, 1.0, "X", "max"), ("dwell", 2, 1.0, "Y", "max")]


def test_standing_still_before_moving_on_is_no_turning_point() -> None:
    stairs = [[0, 0], [0.01, 0], [0.01, 0.01], [0.02, 0.01], [0.02, 0.02]]
    assert turning_points(*[Line([a, b]) for a, b in pairwise(stairs)]) == ()


def test_travel_below_a_picometre_is_standing_still() -> None:
    wave = Bezier([[0, 0], [0.01, 4e-13], [0.02, -4e-13], [0.03, 0]])
    assert turning_points(wave) == ()
    assert len(turning_points(Bezier([[0, 0], [0.01, 4e-11], [0.02, -4e-11], [0.03, 0]]))) == 2


@pytest.mark.parametrize("turn", ["ccw", "cw"])
@pytest.mark.parametrize("start", [(0.25, 0.0), (0.15, 0.2), (0.0, 0.25), (-0.2, 0.15), (-0.07, -0.24)])
def test_full_circle_from_any_start(start: tuple[float, float], turn: str) -> None:
    circle = Arc(start, start, (0.0, 0.0), turn)  # type: ignore[arg-type]
    points = turning_points(circle, closed=True)
    assert sorted((p.axis, p.sense) for p in points) == [
        ("X", "max"),
        ("X", "min"),
        ("Y", "max"),
        ("Y", "min"),
    ]
    for point in points:
        assert point.kind == "smooth"
        assert abs(point.position) == pytest.approx(0.25, rel=1e-15)
        assert abs(point.curvature or 0.0) == pytest.approx(4.0, rel=1e-14)
        assert (point.curvature_dot, point.curvature_ddot, point.torsion) == (0.0, 0.0, 0.0)
    # Not run as a loop, an extreme at its ends is none.
    on_axis = 0.0 in start
    assert len(turning_points(circle)) == (3 if on_axis else 4)


def test_arcs_from_quadrant_to_quadrant() -> None:
    arcs = [
        Arc([0.1, 0.2], [0.0, 0.3], [0.0, 0.2], "ccw"),
        Arc([0.0, 0.3], [-0.1, 0.2], [0.0, 0.2], "ccw"),
        Arc([-0.1, 0.2], [0.1, 0.2], [0.0, 0.2], "ccw"),
    ]
    assert summary(turning_points(*arcs, closed=True)) == [
        ("smooth", 0, 0.0, "X", "max"),
        ("smooth", 0, 1.0, "Y", "max"),
        ("smooth", 1, 1.0, "X", "min"),
        ("smooth", 2, 0.5, "Y", "min"),
    ]


def test_arc_into_its_mirror_image_reverses_nothing_at_the_joint_it_passes() -> None:
    """An S of two arcs that meet with a vertical tangent: X has an inflection there, Y none."""
    s_curve = [
        Arc([0.0, 0.0], [0.01, 0.01], [0.0, 0.01], "ccw"),
        Arc([0.01, 0.01], [0.02, 0.02], [0.02, 0.01], "cw"),
    ]
    assert turning_points(*s_curve) == ()


@pytest.mark.parametrize("nudge", [-1e-9, -1e-12, 1e-12, 1e-9])
def test_arc_that_ends_next_to_a_quadrant(nudge: float) -> None:
    """A turn that goes on for 1e-12 rad beyond the quadrant has the extreme inside."""
    end = [0.25 * math.cos(math.pi / 2 + nudge), 0.25 * math.sin(math.pi / 2 + nudge)]
    points = find_turning_points(Track.from_curves([Arc([0.25, 0.0], end, [0.0, 0.0], "ccw")]))
    assert len(points) == (1 if nudge > 0 else 0)


def test_rational_circle() -> None:
    w = math.sqrt(0.5)
    control = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]]
    knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
    circle = Nurbs(2, knots, np.array(control) * 0.05, [1, w, 1, w, 1, w, 1, w, 1])
    points = turning_points(circle, closed=True)
    assert summary(points) == [
        ("smooth", 0, 0.0, "X", "max"),
        ("smooth", 0, 1.0, "Y", "max"),
        ("smooth", 0, 2.0, "X", "min"),
        ("smooth", 0, 3.0, "Y", "min"),
    ]
    for point in points:
        assert abs(point.curvature or 0.0) == pytest.approx(20.0, rel=1e-12)
        assert (point.curvature_dot, point.curvature_ddot) == (0.0, 0.0)


def test_three_axes_may_reverse_at_one_place() -> None:
    """(t², t, -t²) turns X and Z at once, with normal components of 1/√2."""
    curve = Polynomial([[0, 0, 0.01], [0, 0.01], [0, 0, -0.01]], (-1.0, 1.0))
    x, z = turning_points(curve)
    assert (x.axis, x.sense, z.axis, z.sense) == ("X", "min", "Z", "max")
    assert (x.index, z.index, x.s) == (0, 1, z.s)
    assert x.normal == pytest.approx(math.sqrt(0.5))
    assert z.normal == pytest.approx(-math.sqrt(0.5))
    assert x.curvature == pytest.approx(200.0 * math.sqrt(2.0))


def test_torsion_of_a_twisted_cubic() -> None:
    """(t², t, t³) in units of 0.01 m: at t = 0 κ = 2, τ = -3 for this handedness."""
    (point,) = turning_points(Polynomial([[0, 0, 0.01], [0, 0.01], [0, 0, 0, 0.01]], (-1.0, 1.0)))
    assert point.curvature == pytest.approx(200.0)
    assert point.torsion == pytest.approx(-300.0)


def test_joint_takes_the_curvature_of_its_earlier_side() -> None:
    big = Arc([0.0, -0.02], [0.02, 0.0], [0.0, 0.0], "ccw")
    small = Arc([0.02, 0.0], [0.01, 0.01], [0.01, 0.0], "ccw")
    (point,) = turning_points(big, small)
    assert (point.segment, point.xi, point.sense) == (0, 1.0, "max")
    assert point.curvature == pytest.approx(50.0)


def test_doubled_control_points_at_a_joint_do_not_hide_a_reversal() -> None:
    """Where the earlier side's speed vanishes in the joint, the later side's curvature is told."""
    first = Bezier(np.array([[0.0, -1.0], [1.0, -0.5], [1.0, 0.0], [1.0, 0.0]]) * 0.01)
    second = Bezier(np.array([[1.0, 0.0], [1.0, 0.5], [0.0, 1.0]]) * 0.01)
    (point,) = turning_points(first, second)
    assert (point.kind, point.segment, point.axis) == ("smooth", 0, "X")
    # κ = (n - 1)/n |P0P1 × P1P2| / |P0P1|³ of a Bézier curve, n = 2.
    assert point.curvature == pytest.approx(0.5 * (0.5 * 1.0) / 0.5**3 / 0.01)


def test_points_are_ordered_and_numbered() -> None:
    points = turning_points(*oval(), closed=True)
    assert [point.index for point in points] == [0, 1, 2, 3]
    assert [point.s for point in points] == sorted(point.s for point in points)


def test_a_path_without_reversals_has_none() -> None:
    assert turning_points(Line([[0, 0], [1, 1]])) == ()


def test_certificate_isolates_every_root() -> None:
    """Y' has the roots 1/4 and 3/4, X' the double root 1/2."""
    x, y = from_velocity("1/4", "-1", "1"), from_velocity("3/16", "-1", "1")
    certificate = certify(Track.from_curves([exact_polynomial(x, y)]))
    assert certificate.ok
    assert (certificate.exact, certificate.found) == (2, 2)
    by_axis = {entry.axis: entry for entry in certificate.entries}
    assert by_axis["X"].multiplicities == (2,)
    assert by_axis["Y"].multiplicities == (1, 1)
    for (low, high), root in zip(by_axis["Y"].intervals, (Fraction(1, 4), Fraction(3, 4)), strict=True):
        assert low <= root <= high
        assert high - low < Fraction(1, 10**18)
    assert certificate.words[0] == "2 turning points, counted exactly: found, nothing missing, nothing invented."


@pytest.mark.parametrize("fault", ["missing", "invented", "moved"])
def test_certificate_tells_what_floating_point_got_wrong(fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(track: Track) -> StationaryPoints:
        right = find_stationary_points(track)
        if fault == "missing":
            return StationaryPoints(axis=right.axis[1:], piece=right.piece[1:], u=right.u[1:])
        if fault == "moved":
            return StationaryPoints(axis=right.axis, piece=right.piece, u=right.u + 1e-10)
        axis, piece = np.append(right.axis, 1), np.append(right.piece, 0)
        return StationaryPoints(axis=axis, piece=piece, u=np.append(right.u, 0.9))

    monkeypatch.setattr("ph_post.analysis.certification.find_stationary_points", wrong)
    certificate = certify(Track.from_curves([Bezier([[0.0, 0.0], [0.01, 0.02], [0.02, 0.0]])]))
    assert not certificate.ok
    assert len(certificate.words) > 2
