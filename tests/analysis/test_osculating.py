"""Windows against an independent evaluation of the path, its arc length and its circles."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from msgspec.structs import replace
from numpy.polynomial import Polynomial as Power
from numpy.polynomial import chebyshev, legendre

from ph_post.analysis.osculating import circles_at, deviation, estimate_half_length, find_windows
from ph_post.analysis.turning_points import find_turning_points
from ph_post.geometry.curves import Arc, Bezier, Line, Polynomial
from ph_post.geometry.piecewise import PiecewiseCurve
from ph_post.geometry.track import Track
from ph_post.types import Array, TurningPoint, Window
from ph_post.units import MM


def windows_of(
    *curves: PiecewiseCurve, closed: bool = False, tolerance: float = 0.005 * MM
) -> tuple[Track, tuple[TurningPoint, ...], tuple[Window, ...]]:
    track = Track.from_curves(curves, closed=closed)
    points = find_turning_points(track)
    return track, points, find_windows(track, points, tolerance)


NODES, WEIGHTS = legendre.leggauss(8)


class Reference:
    """A polynomial curve on [0, 1] by its power coefficients alone, arc length by composite quadrature."""

    def __init__(self, coefficients: Array) -> None:
        self.axes = [[Power(row).deriv(k) if k else Power(row) for row in coefficients] for k in range(3)]
        self.knots = np.linspace(0.0, 1.0, 401)
        half = 0.5 * np.diff(self.knots)
        middle = 0.5 * (self.knots[1:] + self.knots[:-1])
        speed = self.speed((middle[:, None] + half[:, None] * NODES).ravel()).reshape(-1, 8)
        self.lengths = np.concatenate([[0.0], np.cumsum(half * (speed @ WEIGHTS))])

    def derivative(self, xi: Array, order: int) -> Array:
        return np.stack([axis(xi) for axis in self.axes[order]], axis=-1)

    def speed(self, xi: Array) -> Array:
        return np.linalg.norm(self.derivative(xi, 1), axis=-1)

    def arc_length(self, xi: Array) -> Array:
        """From 0 to xi, by eight nodes on the rest of each interval."""
        k = np.clip(np.searchsorted(self.knots, xi, side="right") - 1, 0, 399)
        half = 0.5 * (xi - self.knots[k])
        places = self.knots[k][:, None] + half[:, None] * (NODES + 1.0)
        return self.lengths[k] + half * (self.speed(places.ravel()).reshape(-1, 8) @ WEIGHTS)

    def parameter(self, s: Array) -> Array:
        xi = np.interp(s, self.lengths, self.knots)
        for _ in range(4):
            xi = np.clip(xi - (self.arc_length(xi) - s) / self.speed(xi), 0.0, 1.0)
        return xi

    def deviation(self, xi0: float, xi: Array) -> Array:
        """|r - c| at equal arc length from xi0."""
        at = np.array([xi0])
        r, d1, d2 = (self.derivative(at, k)[0] for k in range(3))
        tangent = d1 / np.linalg.norm(d1)
        bend = (d2 - (d2 @ tangent) * tangent) / (d1 @ d1)
        kappa = np.linalg.norm(bend)
        s = (self.arc_length(xi) - self.arc_length(at))[:, None]
        circle = r + np.sin(kappa * s) / kappa * tangent + (1.0 - np.cos(kappa * s)) / kappa**2 * bend
        return np.linalg.norm(self.derivative(xi, 0) - circle, axis=1)


def are_within_tolerance(curves: int, *, windows: int, by_deviation: int) -> None:
    """Nowhere above 1.000 ε inside, at least 0.99 ε at the end that bounds a window."""
    rng = np.random.default_rng(7)
    bounded = total = 0
    for number in range(curves):
        dimension = 2 if number % 2 else 3
        coefficients = rng.normal(size=(dimension, rng.integers(4, 8))) * 0.05
        tolerance = 10.0 ** rng.uniform(-8.0, -4.0)
        _, points, found = windows_of(Polynomial(coefficients), tolerance=tolerance)
        reference = Reference(coefficients)
        for window in found:
            total += 1
            xi0 = points[window.turning_point].xi
            ends = np.array([window.s - window.half_length, window.s + window.half_length])
            low, high = reference.parameter(ends)
            inside = reference.deviation(xi0, np.linspace(low, high, 301))
            at_ends = reference.deviation(xi0, np.array([low, high]))
            assert inside.max() <= tolerance * (1.0 + 1e-6) + 1e-14, (number, window)
            if window.limited_by == "deviation":
                bounded += 1
                assert at_ends.max() >= 0.99 * tolerance, (number, window)
    assert total > windows
    assert bounded > by_deviation


def test_random_curves() -> None:
    are_within_tolerance(60, windows=70, by_deviation=50)


def test_a_circle_is_bounded_by_its_neighbours_only() -> None:
    radius = 0.25
    _, _, windows = windows_of(Arc([radius, 0], [radius, 0], [0, 0], "ccw"), closed=True)
    assert len(windows) == 4
    for window in windows:
        assert window.half_length == pytest.approx(radius * math.pi / 4, rel=1e-14)
        assert (window.limited_by, window.estimate, window.contact_order) == ("neighbour", math.inf, 4)
        assert window.notes == ("shortened to half the way to the neighbouring turning point",)


def test_windows_reach_over_the_seam() -> None:
    """One loop, cut at a turning point and elsewhere: the windows are the same."""
    control = np.array([[[0.03, 0.0], [0.03, 0.01], [0.02, 0.02], [0.0, 0.02]]])
    control = np.concatenate([control, -control[:, ::-1] * [1, -1], -control, control[:, ::-1] * [1, -1]])
    control[1], control[3] = control[0][::-1] * [-1, 1], control[0][::-1] * [1, -1]
    curves = [Bezier(points) for points in control]
    halves = [Bezier(half) for half in _halves(control[0])]
    whole, _, first = windows_of(*curves, closed=True)
    _, _, second = windows_of(halves[1], *curves[1:], halves[0], closed=True)
    assert len(first) == len(second) == 4
    assert first[0].s == 0.0
    shift = second[-1].s
    for window in first:
        place = (window.s + shift) % whole.length
        other = min(second, key=lambda w: abs(w.s - place))
        assert other.half_length == pytest.approx(window.half_length, rel=1e-3)
        assert other.limited_by == window.limited_by == "deviation"


def _halves(points: Array) -> tuple[Array, Array]:
    left, right = [points[0]], [points[-1]]
    while len(points) > 1:
        points = 0.5 * (points[:-1] + points[1:])
        left.append(points[0])
        right.append(points[-1])
    return np.array(left), np.array(right[::-1])


def test_one_turning_point_on_an_open_path_is_bounded_by_its_end() -> None:
    _, _, (window,) = windows_of(Arc([0.0, -0.02], [0.0, 0.02], [0.0, 0.0], "ccw"))
    assert window.half_length == pytest.approx(0.02 * math.pi / 2)
    assert (window.limited_by, window.notes) == ("end", ("shortened: it reaches the end of the path",))


def test_a_turning_point_at_the_very_end_of_a_path_has_a_window_of_no_length() -> None:
    """As the rounding of an arc's end has it, where no other point has a side."""
    track, (point,), _ = windows_of(Arc([0.0, -0.02], [0.0, 0.02], [0.0, 0.0], "ccw"))
    (window,) = find_windows(track, (replace(point, s=track.length),), 5e-6)
    assert (window.half_length, window.limited_by) == (0.0, "end")


def test_a_corner_bounds_a_window() -> None:
    """An arc over 120° about its extreme, with straight lines at an angle to it."""
    a, b = (0.02 * np.array([math.cos(t), math.sin(t)]) for t in (-math.pi / 3, math.pi / 3))
    lines = Line([a - [0.1, 0.0], a]), Line([b, b - [0.1, 0.0]])
    track, points, windows = windows_of(lines[0], Arc(a, b, [0.0, 0.0], "ccw"), lines[1])
    assert [(p.kind, p.axis) for p in points] == [("smooth", "X")]
    assert windows[0].half_length == pytest.approx(0.02 * math.pi / 3)
    assert (windows[0].limited_by, windows[0].notes) == ("corner", ("shortened: it reaches a corner",))
    assert windows[0].s == pytest.approx(0.5 * track.length)


def test_a_cusp_bounds_a_window_and_has_none() -> None:
    """x' = t², y' = t (t - 0.3): Y goes back in a cusp at 0 and turns smoothly at 0.3."""
    curve = Polynomial([[0, 0, 0, 0.01 / 3], [0, 0, -0.0015, 0.01 / 3]], (-1.0, 1.0))
    _, points, windows = windows_of(curve, tolerance=0.1 * MM)
    assert [(p.kind, p.axis, p.sense) for p in points] == [("cusp", "Y", "max"), ("smooth", "Y", "min")]
    assert [(w.turning_point, w.limited_by) for w in windows] == [(1, "corner")]
    assert windows[0].half_length == pytest.approx(points[1].s - points[0].s)


def test_turning_points_close_to_each_other_have_windows_of_their_own() -> None:
    """x' has two roots 2 µm of arc length apart, within ε = 5 µm: each window is true to its own circle."""
    apart = 1e-4
    x = [0.0, 0.01 * (1 / 9 - apart**2), -0.01 / 3, 0.01 / 3]
    _, points, windows = windows_of(Polynomial([x, [0.0, 0.01]]))
    assert len(points) == 2
    assert points[1].s - points[0].s == pytest.approx(2 * apart * 0.01, rel=1e-3)
    assert [(w.members, w.limited_by) for w in windows] == [((0,), "neighbour"), ((1,), "neighbour")]
    assert windows[0].half_length == pytest.approx(0.5 * (points[1].s - points[0].s))


def test_axes_that_reverse_together_share_a_window() -> None:
    _, points, windows = windows_of(Polynomial([[0, 0, 0.01], [0, 0.01], [0, 0, -0.01]], (-1.0, 1.0)))
    assert (len(points), len(windows)) == (2, 1)
    assert windows[0].members == (0, 1)
    assert "shared by 2 turning points at one place" in windows[0].notes


def test_where_the_curvature_jumps_each_side_has_its_own_circle() -> None:
    """Two arcs with a common vertical tangent: both circles are the path."""
    big = Arc([0.0, -0.02], [0.02, 0.0], [0.0, 0.0], "ccw")
    small = Arc([0.02, 0.0], [0.01, 0.01], [0.01, 0.0], "ccw")
    track, points, (window,) = windows_of(big, small)
    assert window.half_length == pytest.approx(0.01 * math.pi / 2)
    assert window.limited_by == "end"
    assert "the curvature jumps here: each side has its own circle" in window.notes
    before, after = circles_at(track, points)
    assert before.bend[0].tolist() == pytest.approx([-50.0, 0.0])
    assert after.bend[0].tolist() == pytest.approx([-100.0, 0.0])
    s = np.linspace(-window.half_length, window.half_length, 101)
    assert deviation(track, points[0], s).max() < 1e-16


def test_corners_have_no_window() -> None:
    assert windows_of(Line([[0, 0], [0.01, 0.01]]), Line([[0.01, 0.01], [0.02, 0.0]]))[2] == ()
    assert windows_of(Line([[0, 0], [0.01, 0.01]]))[2] == ()


def test_deviation_is_that_of_the_reference() -> None:
    coefficients = np.array([[0.0, 0.01, -0.03, 0.02], [0.0, 0.02, 0.01, -0.02]])
    track, points, _ = windows_of(Polynomial(coefficients))
    reference = Reference(coefficients)
    for point in points:
        low, high = -point.s, track.length - point.s
        s = np.linspace(low, high, 57)
        expected = reference.deviation(point.xi, reference.parameter(point.s + s))
        assert deviation(track, point, s) == pytest.approx(expected, abs=1e-15)


def extent(track: Track, point: TurningPoint, tolerance: float) -> float:
    """True half length, by bisection on the deviation of both sides."""
    low, high = 0.0, min(point.s, track.length - point.s)
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = deviation(track, point, np.array([-middle, middle])).max() > tolerance
        low, high = (low, middle) if above else (middle, high)
    return low


@pytest.mark.parametrize(
    ("coefficients", "order", "expected"),
    [
        # κ̇ does not vanish: what (6) leaves out is smaller by a factor of s, which goes as ε^(1/3).
        ([[0.0, 0.0, 0.02, 0.01], [0.0, 0.02, 0.003]], 2, 1 / 3),
        # An extremum of the curvature on a curve symmetric about it: by a factor of s², ε^(2/4).
        ([[0.0, 0.0, 0.02, 0.0, 0.01], [0.0, 0.02]], 3, 1 / 2),
        # In space √(κ̇² + κ²τ²) takes the place of |κ̇|.
        ([[0.0, 0.0, 0.02, 0.01], [0.0, 0.02, 0.003], [0.0, 0.001, 0.0, 0.03]], 2, 1 / 3),
    ],
)
def test_the_estimate_becomes_true_at_the_expected_order(
    coefficients: list[list[float]], order: int, expected: float
) -> None:
    """Ratio of Eq. (6) to the true half length: 1 + O(ε^expected)."""
    rows = [row + [0.0] * (5 - len(row)) for row in coefficients]
    track = Track.from_curves([Polynomial(rows, (-1.0, 1.0))])
    point = next(p for p in find_turning_points(track) if p.axis == "X" and abs(p.xi) < 1e-9)
    tolerances = 10.0 ** np.array([-9.0, -10.0, -11.0])
    errors = [abs(estimate_half_length(point, e) / extent(track, point, e) - 1.0) for e in tolerances]
    assert errors[-1] < 0.02
    slopes = np.diff(np.log(errors)) / np.diff(np.log(tolerances))
    assert slopes == pytest.approx(expected, rel=0.1)
    (window,) = (w for w in find_windows(track, find_turning_points(track), 1e-9) if w.s == point.s)
    assert window.contact_order == order
    assert window.half_length == pytest.approx(extent(track, point, 1e-9), rel=1e-3)


def test_helix_is_limited_by_its_torsion() -> None:
    """R 10, pitch 5: curvature and torsion are constant, yet the half extent at 10 µm is 4.2 mm."""
    radius, rise = 10 * MM, 5 * MM / (2.0 * math.pi)
    turn = chebyshev.Chebyshev.interpolate(lambda x: radius * np.cos(0.5 * math.pi * x), 16)
    wave = chebyshev.Chebyshev.interpolate(lambda x: radius * np.sin(0.5 * math.pi * x), 16)
    rows = [series.convert(kind=Power).coef for series in (turn, wave)]
    helix = Polynomial([*rows, [0.0, rise * 0.5 * math.pi]], (-1.0, 1.0))
    _, points, windows = windows_of(helix, tolerance=0.01 * MM)
    (point,) = (p for p in points if p.axis == "X")
    speed = math.hypot(radius, rise)
    assert point.curvature == pytest.approx(radius / speed**2, rel=1e-9)
    assert point.torsion == pytest.approx(rise / speed**2, rel=1e-6)
    window = next(w for w in windows if w.turning_point == point.index)
    with mpmath.workdps(30):
        kappa, sigma = mpmath.mpf(radius) / speed**2, mpmath.mpf(speed)

        def excess(s: mpmath.mpf) -> mpmath.mpf:
            t = s / sigma
            helix_point = mpmath.matrix([radius * mpmath.cos(t), radius * mpmath.sin(t), rise * t])
            bow, along = (1 - mpmath.cos(kappa * s)) / kappa, mpmath.sin(kappa * s) / kappa
            circle = mpmath.matrix([radius - bow, along * radius / sigma, along * rise / sigma])
            return mpmath.norm(helix_point - circle) - mpmath.mpf(10) ** -5

        true = float(mpmath.findroot(excess, mpmath.mpf("0.0042")))
    assert true == pytest.approx(4.2 * MM, rel=0.02)
    assert window.half_length == pytest.approx(true, rel=1e-3)
    assert window.half_length <= true * (1.0 + 1e-9)
    assert window.limited_by == "deviation"
    kappa_tau = radius * rise / speed**4
    assert window.estimate == pytest.approx((6.0 * 0.01 * MM / kappa_tau) ** (1 / 3), rel=1e-4)


def loops(count: int) -> list[Bezier]:
    """C2 quintics along a curve of many loops: windows that reach over several joints."""
    t = np.linspace(0.0, 1.0, count + 1)
    turns = 2.0 * math.pi * count / 12.0

    def derivative(order: int) -> Array:
        wave = turns**order * np.cos(turns * t + (order + np.array([[0.0], [-1.0]])) * math.pi / 2)
        drift = (0.37 * turns) ** order * np.cos(0.37 * turns * t + order * math.pi / 2)
        return (np.array([[5.0], [4.0]]) * wave + 0.5 * drift).T * MM / count**order

    return [Bezier(points) for points in quintics(*(derivative(order) for order in range(3)))]


def quintics(p: Array, v: Array, a: Array) -> Array:
    """Control points of quintics through points with first and second derivatives, a step apart."""
    rows = [
        p[:-1],
        p[:-1] + v[:-1] / 5,
        p[:-1] + 2 * v[:-1] / 5 + a[:-1] / 20,
        p[1:] - 2 * v[1:] / 5 + a[1:] / 20,
        p[1:] - v[1:] / 5,
        p[1:],
    ]
    return np.stack(rows, axis=1)


@pytest.mark.parametrize("tolerance", [1e-8, 1e-6, 5e-6, 1e-4])
def test_windows_over_many_joints(tolerance: float) -> None:
    track, points, windows = windows_of(*loops(240), tolerance=tolerance)
    assert len(windows) > 50
    for window in windows:
        s = np.linspace(-window.half_length, window.half_length, 401)
        found = deviation(track, points[window.turning_point], s)
        assert found.max() <= tolerance * (1.0 + 1e-9)
        if window.limited_by == "deviation":
            assert max(found[0], found[-1]) >= 0.99 * tolerance


@pytest.mark.parametrize("tolerance", [2e-6, 5e-6, 5.9e-6, 7e-6])
@pytest.mark.parametrize("place", [0.1, 0.24, 0.5])
def test_a_narrow_bump_far_out_ends_a_window(place: float, tolerance: float) -> None:
    """An arc of R 50 with a bump of 6 µm on 0.5 mm of its length, in quintics of 0.2 mm."""
    radius, height, width = 50 * MM, 6e-6, 0.25 / 50
    angle = np.linspace(-0.8, 0.8, 401)
    step = angle[1] - angle[0]
    bump = height * np.exp(-(((angle - place) / width) ** 2))
    slope = -2.0 * (angle - place) / width**2 * bump
    bend = (4.0 * ((angle - place) / width**2) ** 2 - 2.0 / width**2) * bump
    out = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    rho = (radius + bump)[:, None]
    p, v = rho * out, (rho * across + slope[:, None] * out) * step
    a = ((bend[:, None] - rho) * out + 2.0 * slope[:, None] * across) * step**2
    curves = [Bezier(points) for points in quintics(p, v, a)]
    track, points, windows = windows_of(*curves, tolerance=tolerance)
    window = min(windows, key=lambda w: abs(w.s - 0.5 * track.length))
    s = np.linspace(-window.half_length, window.half_length, 20_001)
    found = deviation(track, points[window.turning_point], s)
    assert found.max() <= tolerance * (1.0 + 1e-9)
    if tolerance < height:
        assert window.limited_by == "deviation"
        assert window.half_length == pytest.approx(radius * place, abs=1 * MM)
        assert max(found[0], found[-1]) >= 0.99 * tolerance
    else:
        assert window.half_length > radius * place + 1 * MM
