"""Sharp corners replaced by PH quintics: in 50 digits on their sides' tangents and curvatures, and within the
tolerance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mpmath import mp, mpf
from scipy.spatial import cKDTree

from ph_post.api.corners import with_rounded_corners
from ph_post.geometry.corner_curves import CurveEnd, corner_curve, reach_of_deviation
from ph_post.geometry.corner_rounding import round_sharp_corners
from ph_post.geometry.curves import PH, Arc, Bezier, Line, Nurbs, Polynomial
from ph_post.geometry.joints import SHARP_CORNER_RAD, find_joints
from ph_post.geometry.track import Track
from ph_post.types import Curve, Path, Segment

MM = 1e-3


@pytest.fixture(autouse=True)
def fifty_digits():
    with mp.workdps(50):
        yield


def path_of(*curves: Curve, closed: bool = False) -> Path:
    return Track.from_curves(curves, closed).path


def control_points(curve: PH) -> list[list[mpf]]:
    """Control points of a planar PH quintic from its preimage, by the products of [5] written out."""
    (u0, v0), (u1, v1), (u2, v2) = ([mpf(float(x)) for x in row] for row in curve.preimage)
    w0, w1, w2 = mpmath.mpc(u0, v0), mpmath.mpc(u1, v1), mpmath.mpc(u2, v2)
    hodograph = [w0**2, w0 * w1, (2 * w1**2 + w0 * w2) / 3, w1 * w2, w2**2]
    points = [mpmath.mpc(*(mpf(float(x)) for x in curve.start))]
    for one in hodograph:
        points.append(points[-1] + one / 5)
    return points


def at(points: list, u: mpf, order: int = 0):
    """Derivative of a Bézier curve of degree 5 by its parameter."""
    for _ in range(order):
        n = len(points) - 1
        points = [n * (b - a) for a, b in pairwise(points)]
    while len(points) > 1:
        points = [(1 - u) * a + u * b for a, b in pairwise(points)]
    return points[0]


def curvature(points: list, u: mpf) -> mpf:
    first, second = at(points, u, 1), at(points, u, 2)
    return mpmath.im(mpmath.conj(first) * second) / abs(first) ** 3


def from_ray(point, corner, direction):
    """Distance of a point from the side that ends (or begins) in the corner and points away from it."""
    seen = (point - corner) / direction
    return abs(mpmath.im(seen)) if mpmath.re(seen) >= 0 else abs(seen)


@pytest.mark.parametrize("degrees", [1, 10, 38.7, 90, 120, 150, 174, -1, -60, -90, -174])
@pytest.mark.parametrize("turn", [0.0, 0.3, 2.2, -3.0])
@pytest.mark.thinned(12)
def test_between_lines_it_is_a_quintic_of_continuous_curvature_at_the_tolerance(degrees: float, turn: float) -> None:
    tolerance, angle = 2e-5, math.radians(degrees)
    directions = np.exp(1j * turn), np.exp(1j * (turn + angle))
    place = np.array([0.031, -0.017])
    length = 4.0 * reach_of_deviation(abs(angle), tolerance)
    ends = [place + length * np.array([one.real, one.imag]) for one in (-directions[0], directions[1])]
    first, curve, last = (
        one.curve
        for one in round_sharp_corners(path_of(Line([ends[0], place]), Line([place, ends[1]])), tolerance).path.segments
    )
    assert isinstance(curve, PH)
    points = control_points(curve)
    assert len(points) == 6, "a quintic"
    corner = mpmath.mpc(*(mpf(float(x)) for x in place))
    to_first, to_last = ((mpmath.mpc(*map(float, one)) - corner) for one in ends)
    to_first, to_last = to_first / abs(to_first), to_last / abs(to_last)
    size = abs(points[-1] - points[0])
    for side, u, away in ((first, mpf(0), to_first), (last, mpf(1), to_last)):
        here = at(points, u)
        meets = mpmath.mpc(*(mpf(float(x)) for x in side.derivatives(1.0 if u == 0 else 0.0)[0, 0]))
        assert abs(here - meets) < 1e-12 * size + 1e-17
        assert abs(mpmath.im((here - corner) / away)) < 1e-9 * tolerance, "on the side"
        tangent = at(points, u, 1)
        assert abs(mpmath.im(tangent / away)) < 1e-10 * abs(tangent), "along the side"
    tightest = abs(curvature(points, mpf(1) / 2))
    assert max(abs(curvature(points, mpf(0))), abs(curvature(points, mpf(1)))) < 1e-9 * tightest, (
        "as straight as the sides"
    )
    fine = [mpf(k) / 200 for k in range(201)]
    distances = [abs(at(points, u) - corner) for u in fine]
    assert abs(min(distances) - mpf(tolerance)) < 1e-9 * tolerance, "the tolerance is used"
    assert min(range(201), key=distances.__getitem__) == 100
    to_sides = max(min(from_ray(at(points, u), corner, away) for away in (to_first, to_last)) for u in fine)
    assert to_sides <= tolerance
    bends = [curvature(points, u) for u in fine]
    rising = [b - a for a, b in pairwise(bends)]
    sign = mpmath.sign(bends[100])
    assert all(sign * one > 0 for one in rising[1:99]), "up to one maximum"
    assert all(sign * one < 0 for one in rising[101:199])


@given(st.floats(0.01, 3.0), st.floats(1e-6, 1.0))
def test_reach_and_tightest_curvature_are_the_closed_forms(angle: float, deviation: float) -> None:
    c, s = mpmath.cos(mpf(angle) / 2), mpmath.sin(mpf(angle) / 2)
    sigma = mpf(deviation) / (s / 80 + s / c / 30)
    # r' = w², w = √σ ((1 - u)² + e^{iφ} u²), integrated numerically
    half = mpmath.expj(mpf(angle) / 2)

    def rate(u):
        return sigma * ((1 - u) ** 2 + half * u**2) ** 2

    to_middle, whole = mpmath.quad(rate, [0, mpf(1) / 2]), mpmath.quad(rate, [0, 1])
    reach = abs(whole) / (2 * c)
    assert abs(mpf(reach_of_deviation(angle, deviation)) / reach - 1) < 1e-13
    assert abs(abs(to_middle - reach) / mpf(deviation) - 1) < mpf("1e-30")
    ends = np.array([1.0, 0.0]), np.array([math.cos(angle), math.sin(angle)])
    none, size = np.zeros(2), float(reach)
    curve = corner_curve(
        CurveEnd(place=-size * ends[0], tangent=ends[0], bend=none),
        CurveEnd(place=size * ends[1], tangent=ends[1], bend=none),
    )
    assert curve is not None
    tightest = 16 * s / (sigma * mpmath.cos(mpf(angle) / 4) ** 4)
    assert abs(mpf(float(curve.curvature(0.5)[0])) / tightest - 1) < 1e-9


def between_curves() -> dict[str, Path]:
    weighted = Nurbs(2, [0, 0, 0, 1, 1, 1], [[0, 0], [0.01, 0.01], [0.02, 0]], [1.0, 0.6, 1.0])
    spline = Nurbs(3, [0, 0, 0, 0, 1, 2, 2, 2, 2], [[0, 0], [0.004, 0.01], [0.01, 0.01], [0.014, 0.002], [0.02, 0]])
    ring = PH([0, 0], np.array([[0.1, 0.0], [0.1, 0.06], [0.06, 0.1]]))
    end = ring.derivatives(1.0)[0, 0]
    return {
        "line, arc": path_of(Line([[0, 0], [0.01, 0]]), Arc([0.01, 0], [0.02, 0.01], [0.02, 0], "cw")),
        "arc, line": path_of(Arc([0, 0], [0.01, 0], [0.005, -0.001], "cw"), Line([[0.01, 0], [0.01, 0.02]])),
        "arc, arc": path_of(
            Arc([0, 0], [0.01, 0], [0.005, 0.002], "ccw"), Arc([0.01, 0], [0.02, 0], [0.015, 0.001], "cw")
        ),
        "arc in space": path_of(
            Line([[0, 0, 0.003], [0.01, 0, 0.003]]), Arc([0.01, 0, 0.003], [0.02, 0.01, 0.003], [0.02, 0, 0.003], "cw")
        ),
        "bezier, bezier": path_of(
            Bezier([[0, 0], [0.005, 0.01], [0.01, 0]]),
            Bezier([[0.01, 0], [0.012, -0.001], [0.015, -0.001], [0.02, 0.01]]),
        ),
        "polynomial, line": path_of(Polynomial([[0.0, 0.01], [0.0, 0.0, 0.01]]), Line([[0.01, 0.01], [0.03, 0.01]])),
        "weighted, line": path_of(weighted, Line([[0.02, 0], [0.03, 0.005]])),
        "spline, line": path_of(spline, Line([[0.02, 0], [0.03, 0.005]])),
        "ph, line": path_of(ring, Line([end, end + np.array([0.01, 0.0])])),
        "two lines in a spline": path_of(Nurbs(1, [0, 0, 1, 2, 2], [[0, 0], [0.01, 0], [0.01, 0.01]])),
    }


@pytest.mark.parametrize("name", between_curves())
@pytest.mark.thinned(12)
def test_between_curves_tangent_and_curvature_are_continuous_within_the_tolerance(name: str) -> None:
    path, tolerance = between_curves()[name], 2e-5
    found = round_sharp_corners(path, tolerance)
    (corner,) = found.corners
    assert 0.9 * tolerance < corner.deviation <= tolerance
    assert not corner.why
    track = Track(found.path)
    joints = find_joints(track)
    assert joints.angle.max() < 1e-9
    ends = [one.curve.derivatives(np.array(one.curve.domain))[0] for one in found.path.segments]
    assert max(np.abs(a[1] - b[0]).max() for a, b in pairwise(ends)) < 1e-15
    tight = 0.1 / tolerance
    assert np.abs(joints.curvature_jump).max() < 1e-8 * tight
    before = Track(path)
    new, old = [one.derivatives(*one.locate(np.linspace(0.0, one.length, 200_001)))[0] for one in (track, before)]
    assert cKDTree(old).query(new)[0].max() <= tolerance
    assert cKDTree(new).query(old)[0].max() <= tolerance + 1e-8, "a sample beside the corner"
    assert np.allclose(new[[0, -1]], old[[0, -1]], rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("name", ["line, arc", "arc, line", "arc, arc"])
def test_between_arcs_it_holds_in_fifty_digits(name: str) -> None:
    path, tolerance = between_curves()[name], 2e-5
    sides = [one.curve for one in path.segments]
    (curve,) = (one.curve for one in round_sharp_corners(path, tolerance).path.segments if isinstance(one.curve, PH))
    points = control_points(curve)

    def off(side: Curve, point) -> mpf:
        if isinstance(side, Line):
            a, b = (mpmath.mpc(*map(float, side.derivatives(u)[0, 0])) for u in (0.0, 1.0))
            return abs(mpmath.im((point - a) / (b - a)) * abs(b - a))
        assert isinstance(side, Arc)
        return abs(abs(point - mpmath.mpc(*map(float, side.center))) - mpf(side.radius))

    fine = [at(points, mpf(k) / 300) for k in range(301)]
    assert max(off(sides[0], fine[0]), off(sides[1], fine[-1])) < 1e-16, "it begins and ends on its sides"
    assert max(min(off(side, point) for side in sides) for point in fine) <= tolerance
    corner = mpmath.mpc(*map(float, sides[1].derivatives(0.0)[0, 0]))
    assert min(abs(point - corner) for point in fine) <= tolerance
    for side, u in ((sides[0], mpf(0)), (sides[1], mpf(1))):
        bend = mpf(0)
        if isinstance(side, Arc):
            bend = (1 if side.turn == "ccw" else -1) / mpf(side.radius)
        assert abs(curvature(points, u) - bend) < 1e-8 / tolerance


def test_where_sides_are_short_the_largest_curve_that_fits_is_taken() -> None:
    corners = [[0, 0], [1e-3, 0], [1e-3, 1e-4], [2e-3, 1e-4]]
    lines = [Line(pair) for pair in pairwise(corners)]
    found = round_sharp_corners(path_of(*lines), 2e-4)
    one, two = found.corners
    assert (
        one.deviation == pytest.approx(0.49e-4 / reach_of_deviation(math.pi / 2.0, 1.0)) == pytest.approx(two.deviation)
    )
    assert one.why == "its sides are short"
    middle = found.path.segments[2].curve
    assert 0.0 < middle.derivatives(1.0)[0, 0][1] - middle.derivatives(0.0)[0, 0][1] < 0.03e-4
    # The other corner asks for little: this one may take what it leaves.
    wide = round_sharp_corners(
        path_of(Line([[0, 0], [1, 0]]), Line([[1, 0], [1, 1e-3]]), Line([[1, 1e-3], [0.5, -0.865]])), 1e-4
    )
    assert wide.corners[0].deviation == pytest.approx(1e-4)


def test_some_corners_stay_sharp_and_are_named() -> None:
    back = path_of(Line([[0, 0], [0.01, 0]]), Line([[0.01, 0], [0, 0]]), Line([[0, 0], [0, 0.01]]))
    rounded = with_rounded_corners(back, 2e-5)
    assert rounded.remarks == (
        "1 corner is rounded, within 20 µm",
        "1 corner stays sharp: the path turns back on itself (at X10 Y0)",
    )
    rapid = Path(
        name="",
        source="",
        axes=("X", "Y"),
        feed=0.01,
        closed=False,
        segments=(Segment(curve=Line([[0, 0], [0.01, 0]])), Segment(curve=Line([[0.01, 0], [0.01, 0.01]]), rapid=True)),
    )
    assert with_rounded_corners(rapid, 2e-5).remarks == (
        "1 corner stays sharp: a rapid begins or ends there (at X10 Y0)",
    )
    twisted = path_of(Line([[0, 0, 0], [0.01, 0, 0]]), Bezier([[0.01, 0, 0], [0.01, 0.01, 0], [0.01, 0.01, 0.01]]))
    assert (
        "no curve of continuous curvature was found between its sides" in with_rounded_corners(twisted, 2e-5).remarks[0]
    )
    smooth = path_of(Line([[0, 0], [0.01, 0]]))
    assert with_rounded_corners(smooth, 2e-5).remarks == (
        "--corner-tolerance: the path has no sharp corner between its ends",
    )
    assert with_rounded_corners(smooth, None) is smooth


def test_the_seam_of_a_closed_path_stays_and_feeds_are_the_lower_of_both() -> None:
    corners = [[0, 0], [0.01, 0], [0.01, 0.01], [0, 0]]
    lines = [Line(pair) for pair in pairwise(corners)]
    feeds = (None, 0.02, 0.005)
    segments = tuple(Segment(curve=line, feed=feed) for line, feed in zip(lines, feeds, strict=True))
    path = Path(name="", source="", axes=("X", "Y"), feed=0.01, closed=True, segments=segments)
    found = round_sharp_corners(path, 2e-5)
    assert len(found.corners) == 2
    assert [one.feed for one in found.path.segments] == [None, 0.01, 0.02, 0.005, 0.005]
    assert [one.rounded for one in found.path.segments] == [False, True, False, True, False]


steps = st.tuples(st.floats(-3.1, 3.1), st.floats(0.05, 20.0))


@example([(0.0, 1.0), (1e-5, 1.0)], 1.0, False)
@settings(deadline=None, max_examples=60)
@given(st.lists(steps, min_size=2, max_size=8), st.floats(1e-3, 5.0), st.booleans())
def test_random_polygons_stay_within_the_tolerance(
    ways: Sequence[tuple[float, float]], within: float, space: bool
) -> None:
    points, heading = [np.zeros(3 if space else 2)], 0.0
    for number, (turn, size) in enumerate(ways):
        heading += turn
        step = size * MM * np.array([math.cos(heading), math.sin(heading), 0.3 * (-1) ** number])
        points.append(points[-1] + step[: points[0].size])
    path = path_of(*(Line(pair) for pair in pairwise(points)))
    found = round_sharp_corners(path, within * MM)
    assert all(one.deviation <= within * MM * (1.0 + 1e-9) for one in found.corners)
    track, before = Track(found.path), Track(path)
    allowed = max((one.deviation for one in found.corners), default=0.0)
    sharp = sum(not one.deviation for one in found.corners)
    after, original = find_joints(track).angle, find_joints(before).angle
    assert (after > SHARP_CORNER_RAD).sum() == sharp
    faint = original[(original > 1e-6) & (original <= SHARP_CORNER_RAD)]  # no corners: they are run through, and stay
    assert after[(after > 1e-6) & (after <= SHARP_CORNER_RAD)] == pytest.approx(faint, abs=1e-9)
    new = track.derivatives(*track.locate(np.linspace(0.0, track.length, 4001)))[0]
    ends = [one.curve.derivatives(np.array([0.0, 1.0]))[0] for one in before.path.segments]
    distance = np.min([_from_segment(new, *pair) for pair in ends], axis=0)
    assert distance.max() <= allowed * (1.0 + 1e-9) + 1e-12


def _from_segment(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    chord = end - start
    along = np.clip((points - start) @ chord / (chord @ chord), 0.0, 1.0)
    return np.linalg.norm(points - start - along[:, None] * chord, axis=1)
