"""The contour error: nearest places against closed forms, roots in many digits, dense sampling; its sums."""

import math
from itertools import pairwise
from pathlib import Path

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.plans import make_machine

from ph_post.errors import InputError
from ph_post.files.path import read_path
from ph_post.geometry.curves import Arc, Bezier, Line, Polynomial
from ph_post.geometry.ph import PH
from ph_post.geometry.track import Track
from ph_post.simulate import cells
from ph_post.simulate.contour import (
    ContourError,
    Nominal,
    TurningError,
    contour_error,
    first_counted,
    settling_time,
    turning_errors,
)
from ph_post.types import Axis, Command, Gap, Limits, Machine, Servo, TurningPoint

PATHS = sorted((Path(__file__).resolve().parents[2] / "paths").glob("*.json"))
EXACT = 1e-10
"""What the search promises of a distance [m]."""
SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]


def nominal_of(*curves, closed=False):
    return Nominal(Track.from_curves(curves, closed=closed))


def lines(points, closed=False):
    ends = [*points, points[0]] if closed else points
    return nominal_of(*(Line(pair) for pair in pairwise(ends)), closed=closed)


def nearest(nominal, positions, hint=0.0):
    positions = np.array(positions, dtype=float)
    return nominal.nearest(positions, np.broadcast_to(np.float64(hint), len(positions)))


def nearest_by_roots(coefficients, point, low, high):
    """Distance of a point from a polynomial curve: all stationary places and both ends, in 40 digits."""
    with mpmath.workdps(40):
        total = [mpmath.mpf(0)]
        for axis, value in zip(coefficients, point, strict=True):
            off = [mpmath.mpf(c) for c in axis]
            off[0] -= mpmath.mpf(float(value))
            total = added(total, times(off, [k * c for k, c in enumerate(off)][1:]))
        while total[-1] == 0:
            total.pop()
        guess = [mpmath.mpc(complex(root)) for root in np.roots([float(c) for c in total[::-1]])]
        roots = mpmath.polyroots(total[::-1], maxsteps=500, extraprec=400, roots_init=guess)
        places = [r.real for r in roots if abs(r.imag) < 1e-12 and low <= r.real <= high] + [low, high]
        return float(
            min(
                mpmath.norm([mpmath.polyval(axis[::-1], u) - v for axis, v in zip(coefficients, point, strict=True)])
                for u in places
            )
        )


def times(a, b):
    product = [mpmath.mpf(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            product[i + j] += x * y
    return product


def added(a, b):
    size = max(len(a), len(b))
    filled = [list(v) + [mpmath.mpf(0)] * (size - len(v)) for v in (a, b)]
    return [x + y for x, y in zip(*filled, strict=True)]


@pytest.fixture(scope="module")
def circle():
    return nominal_of(Arc([0.25, 0], [0.25, 0], [0, 0], "ccw"), closed=True)


def test_a_circle_is_radius_minus_distance_from_its_centre(circle):
    rng = np.random.default_rng(1)
    angle, radius = rng.uniform(0, 2 * np.pi, 2000), rng.uniform(0, 0.6, 2000)
    found = circle.nearest(radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1), 0.25 * angle)
    np.testing.assert_allclose(found.error, 0.25 - radius, rtol=0, atol=EXACT)
    off = np.abs(found.s - 0.25 * angle)
    # Towards the centre more and more places are almost equally near.
    close = np.abs(radius - 0.25) < 0.05
    assert np.minimum(off, circle.length - off)[close].max() < 1e-9


def test_at_the_centre_of_a_circle_the_place_commanded_is_the_nearest(circle):
    hint = np.linspace(0.01, 1.5, 40)
    found = circle.nearest(np.zeros((40, 2)), hint)
    np.testing.assert_allclose(found.error, 0.25, rtol=0, atol=EXACT)
    assert np.abs(found.s - hint).max() < 0.25 * 2 * np.pi / circle.cells


def test_a_clockwise_circle_has_its_outside_to_the_left():
    found = nearest(nominal_of(Arc([1, 0], [1, 0], [0, 0], "cw"), closed=True), [[1.5, 0], [0, 0.5]])
    np.testing.assert_allclose(found.error, [0.5, -0.5], rtol=0, atol=EXACT)


def test_the_seam_of_a_closed_path_is_a_place_like_others(circle):
    """Executed before the seam while the command is behind it, and the other way round."""
    lag = 0.004
    hint = np.array([0.001, 0.002, circle.length - 0.001])
    angle = (hint + np.array([-lag, -lag, lag])) / 0.25
    found = circle.nearest(0.2499 * np.stack([np.cos(angle), np.sin(angle)], 1), hint)
    np.testing.assert_allclose(found.error, 1e-4, rtol=0, atol=EXACT)
    np.testing.assert_allclose(found.s, np.mod(0.25 * angle, circle.length), rtol=0, atol=1e-9)


def test_a_line_measures_across_and_clamps_at_open_ends():
    found = nearest(lines([[0, 0], [2, 0]]), [[1, 0.25], [1, -0.25], [-3, 4], [5, -4], [3, 0], [2, 0]])
    assert found.error.tolist() == [0.25, -0.25, 5.0, -5.0, 1.0, 0.0]
    assert found.s.tolist() == [1.0, 1.0, 0.0, 2.0, 2.0, 2.0]


def test_corners_of_a_square():
    square = lines(SQUARE, closed=True)
    points = [[0.5, 0.1], [1.3, -0.4], [-0.3, -0.4], [0.5, -0.2], [0.9, 0.9], [0.1, 0.2], [-0.1, 0.5]]
    found = nearest(square, points)
    np.testing.assert_allclose(found.error, [0.1, -0.5, -0.5, -0.2, 0.1, 0.1, -0.1], rtol=0, atol=1e-15)
    # The vertex at the seam has the arc length of either end.
    assert found.s[2] in {0.0, 4.0}


def test_beyond_a_needle_the_bisector_tells_the_side():
    """Turned left by more than 90 degrees, some of the outside lies left of a tangent alone."""
    needle = lines([[0, 0], [1, 0], [0, 0.1]])
    beyond = nearest(needle, [[1.1, 0.02], [1.1, -0.02], [1.0, -0.1], [1.01, 0.15], [0.5, 0.02]])
    assert np.sign(beyond.error).tolist() == [-1, -1, -1, -1, 1]
    np.testing.assert_allclose(np.abs(beyond.error[:3]), [math.hypot(0.1, 0.02)] * 2 + [0.1], atol=EXACT)


def test_where_a_path_runs_over_itself_the_command_tells_the_side():
    there_and_back = lines([[0, 0], [1, 0], [0, 0]])
    points = np.array([[0.5, 0.01], [0.4, 0.01], [0.5, -0.01], [0.4, -0.01]])
    found = there_and_back.nearest(points, np.array([0.5, 1.6, 0.51, 1.7]))
    np.testing.assert_allclose(found.error, [0.01, -0.01, -0.01, 0.01], rtol=0, atol=EXACT)
    np.testing.assert_allclose(found.s, [0.5, 1.6, 0.5, 1.6], rtol=0, atol=EXACT)


@pytest.mark.parametrize(
    ("coefficients", "domain"),
    [
        ([[0, 1], [0, 0, 1]], (-1, 1)),  # a parabola
        ([[0, 0, 1], [0, 0, 0, 1]], (-1, 1)),  # a cusp
        ([[0, -1, 0, 1], [0, 0, 1]], (-1.25, 1.25)),  # a loop that crosses itself
        ([[0, 1], [0, 0, 1], [0, 0, 0, 1]], (-1, 1)),  # a twisted cubic
    ],
)
def test_polynomial_curves_against_roots_in_many_digits(coefficients, domain):
    """Any distance: inside and beyond the evolute, where one cell may hold several minima."""
    rng = np.random.default_rng(2)
    curve = Polynomial(coefficients, domain)
    nominal = nominal_of(curve)
    u = rng.uniform(*domain, 60)
    near = curve.derivatives(u)[0] + rng.normal(size=(60, curve.dimension)) * 10.0 ** rng.uniform(-6, 0.3, (60, 1))
    on_path = Track.from_curves([curve])
    found = nominal.nearest(near, rng.uniform(0, on_path.length, 60))
    exact = [nearest_by_roots(coefficients, point, *domain) for point in near]
    np.testing.assert_allclose(np.abs(found.error), exact, rtol=0, atol=EXACT)
    place = on_path.derivatives(*on_path.locate(found.s))[0]
    np.testing.assert_allclose(np.linalg.norm(place - near, axis=1), exact, rtol=0, atol=EXACT)


def test_a_helix_against_roots_in_many_digits():
    """A spatial PH cubic makes a constant angle with an axis: a helix of polynomial radius."""
    u0, v0, p0, q0 = 0.3, 0.1, 0.05, 0.0
    u1, v1, p1, q1 = 0.1, 0.3, -0.05, 0.2
    nominal = nominal_of(PH([0, 0, 0], [[u0, v0, p0, q0], [u1, v1, p1, q1]]))
    ends = zip((u0, v0, p0, q0), (u1, v1, p1, q1), strict=True)
    u, v, p, q = ([mpmath.mpf(a), mpmath.mpf(b) - mpmath.mpf(a)] for a, b in ends)

    def integral(*terms):
        total = [mpmath.mpf(0)]
        for factor, a, b in terms:
            total = added(total, [factor * c for c in times(a, b)])
        return [mpmath.mpf(0)] + [c / (k + 1) for k, c in enumerate(total)]

    exact = [
        integral((1, u, u), (1, v, v), (-1, p, p), (-1, q, q)),
        integral((2, u, q), (2, v, p)),
        integral((2, v, q), (-2, u, p)),
    ]
    rng = np.random.default_rng(3)
    points = rng.normal(scale=0.05, size=(40, 3))
    found = nearest(nominal, points)
    reference = [nearest_by_roots(exact, point, 0, 1) for point in points]
    np.testing.assert_allclose(np.abs(found.error), reference, rtol=0, atol=EXACT)


def test_in_space_the_sign_is_that_of_the_view_along_the_third_axis():
    slope = nominal_of(Line([[0, 0, 0], [3, 0, 4]]))
    found = nearest(slope, [[1.5, 0.3, 2], [1.5, -0.3, 2], [1.5 - 0.8, 0.6, 2 + 0.6]])
    np.testing.assert_allclose(found.error, [0.3, -0.3, math.sqrt(1.36)], rtol=0, atol=EXACT)


def test_a_figure_eight_measures_to_the_nearer_branch():
    """Two circles that touch at the origin, run as an eight: commanded on one, executed by the other."""
    eight = nominal_of(Arc([0, 0], [0, 0], [0, 0.1], "ccw"), Arc([0, 0], [0, 0], [0, -0.1], "cw"), closed=True)
    rng = np.random.default_rng(4)
    points = rng.uniform(-0.25, 0.25, (1000, 2))
    found = eight.nearest(points, rng.uniform(0, eight.length, 1000))
    up, down = (0.1 - np.hypot(points[:, 0], points[:, 1] - y) for y in (0.1, -0.1))
    signed = np.where(np.abs(up) < np.abs(down), up, -down)
    np.testing.assert_allclose(np.abs(found.error), np.minimum(np.abs(up), np.abs(down)), rtol=0, atol=EXACT)
    clear = np.abs(np.abs(up) - np.abs(down)) > EXACT
    np.testing.assert_allclose(found.error[clear], signed[clear], rtol=0, atol=EXACT)


@pytest.mark.parametrize("file", PATHS, ids=lambda file: file.stem)
def test_shipped_paths_against_dense_sampling(file):
    """Lags of 3 mm and errors of up to 5 mm; the reference follows every dense minimum to the exact curve."""
    track = Track(read_path(file))
    nominal = Nominal(track)
    assert nominal.deviation <= 1.0001e-11
    rng = np.random.default_rng(5)
    s = rng.uniform(0, track.length, 25)
    places = track.derivatives(*track.locate(s))[0]
    points = places + rng.normal(size=places.shape) * 10.0 ** rng.uniform(-6, -2.5, (25, 1))
    found = nominal.nearest(points, np.clip(s + 0.003, 0, track.length))
    s = np.union1d(np.linspace(0, track.length, 20_001), track.starts)
    samples = track.derivatives(*track.locate(s))[0]
    exact = [nearest_by_sampling(track, s, samples, point) for point in points]
    np.testing.assert_allclose(np.abs(found.error), exact, rtol=0, atol=EXACT)


def nearest_by_sampling(track, s, samples, point):
    """Distance by ever finer samples on both sides of every minimum of the first, down to 1e-10 m of path."""
    sampled = np.linalg.norm(samples - point, axis=1)
    before, behind = np.minimum(sampled, np.roll(sampled, 1)), np.minimum(sampled, np.roll(sampled, -1))
    inner = np.flatnonzero((sampled <= before) & (sampled <= behind) & (s > 0.0) & (s < track.length))
    best = sampled.min()
    inner = inner[sampled[inner] < best + 2 * track.length / 20_000]
    low, high = np.concatenate([s[inner - 1], s[inner]]), np.concatenate([s[inner], s[inner + 1]])
    sides = np.arange(low.size)
    while (high - low).max(initial=0.0) > 1e-10:
        fine = np.linspace(low, high, 41)
        places = track.derivatives(*track.locate(fine.ravel()))[0]
        off = np.linalg.norm(places - point, axis=1).reshape(fine.shape)
        best = min(best, off.min())
        k = off.argmin(axis=0)
        low, high = fine[np.maximum(k - 1, 0), sides], fine[np.minimum(k + 1, 40), sides]
    return best


@pytest.mark.parametrize("file", PATHS, ids=lambda file: file.stem)
def test_a_motion_along_the_path_however_late_has_no_contour_error(file):
    track = Track(read_path(file))
    s = np.linspace(0, track.length, 4001)
    for lag in (0.0, 0.003, -0.002):
        executed = track.derivatives(*track.locate(np.clip(s - lag, 0, track.length)))[0]
        assert np.abs(Nominal(track).nearest(executed, s).error).max() < EXACT


def test_what_was_found_before_changes_nothing():
    """Rows in the order of the motion, where the search follows on, and in any other order."""
    nominal = Nominal(Track(read_path(next(file for file in PATHS if file.stem == "butterfly"))))
    rng = np.random.default_rng(6)
    steps = rng.normal(size=(20_000, 2)) * 10.0 ** rng.uniform(-6, -3.3, (20_000, 1))
    walk = np.cumsum(steps, axis=0) * 0.2
    hint = np.zeros(len(walk))
    order = rng.permutation(len(walk))
    straight, mixed = nominal.nearest(walk, hint), nominal.nearest(walk[order], hint)
    np.testing.assert_allclose(np.abs(straight.error[order]), np.abs(mixed.error), rtol=0, atol=EXACT)


def test_a_path_that_would_need_too_many_cells_says_what_accuracy_holds(monkeypatch):
    monkeypatch.setattr(cells, "MOST_CELLS", 40)
    nominal = nominal_of(Arc([0.25, 0], [0.25, 0], [0, 0], "ccw"), closed=True)
    assert nominal.cells <= 40
    assert nominal.deviation > 1e-10
    angle = np.linspace(0, 6, 1000)
    found = nearest(nominal, 0.26 * np.stack([np.cos(angle), np.sin(angle)], 1), 0.25 * angle)
    np.testing.assert_allclose(found.error, -0.01, rtol=0, atol=1.001 * nominal.deviation)


def test_a_path_of_one_cell_and_no_rows():
    found = nearest(lines([[0, 0], [1, 0]]), np.zeros((0, 2)))
    assert found.error.size == found.s.size == 0


def test_positions_must_fit_the_path():
    line = lines([[0, 0], [1, 0]])
    with pytest.raises(InputError, match="wrong shape of positions"):
        line.nearest(np.zeros((3, 3)), np.zeros(3))
    with pytest.raises(InputError, match="not finite"):
        line.nearest(np.array([[0.0, math.nan]]), np.zeros(1))


heights = st.lists(st.integers(-20, 20), min_size=4, max_size=4)


@given(heights, st.floats(0.02, 0.98), st.floats(-1e-3, 1e-3))
def test_an_offset_along_the_normal_is_the_error(values, u, offset):
    """A graph over x with radii of curvature far above the offset cannot be nearer elsewhere."""
    curve = Bezier([[x, 0.05 * y] for x, y in enumerate(values)])
    place, slope = curve.derivatives(np.array([u]), 1)[:, 0]
    tangent = slope / np.linalg.norm(slope)
    point = place + offset * np.array([-tangent[1], tangent[0]])
    found = nearest(nominal_of(curve), [point])
    assert abs(found.error[0] - offset) < EXACT
    track = Track.from_curves([curve])
    assert abs(found.s[0] - track.arc_length(np.array([0]), np.array([u]))[0]) < 1e-8


polygons = st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=3, max_size=6, unique=True).filter(
    lambda points: all(a != b for a, b in pairwise(points))
)
places = st.lists(st.tuples(st.floats(-12, 12), st.floats(-12, 12)), min_size=1, max_size=8)


@given(polygons, places)
def test_a_polygon_is_as_near_as_the_nearest_of_its_sides(corners, points):
    a, b = np.array(corners[:-1], dtype=float), np.array(corners[1:], dtype=float)
    p = np.array(points)[:, None]
    w = np.clip(((p - a) * (b - a)).sum(2) / ((b - a) ** 2).sum(1), 0, 1)
    exact = np.linalg.norm(p - a - w[..., None] * (b - a), axis=2).min(axis=1)
    np.testing.assert_allclose(np.abs(nearest(lines(corners), points).error), exact, rtol=0, atol=EXACT)


@pytest.mark.slow
@given(heights, heights, places)
def test_turning_and_moving_everything_changes_nothing(x, y, points):
    control, points = np.stack([np.arange(0, 200, 50) + x, y], 1), 10 * np.array(points)
    error = nearest(nominal_of(Bezier(control)), points).error
    turn, shift = np.array([[0, -1], [1, 0]]), np.array([3.0, -7.0])
    turned = nearest(nominal_of(Bezier(control @ turn.T + shift)), points @ turn.T + shift).error
    np.testing.assert_allclose(np.abs(turned), np.abs(error), rtol=0, atol=EXACT)


@given(heights, st.floats(0.05, 0.95), st.floats(1e-6, 1e-3))
def test_run_the_other_way_the_sides_change(values, u, offset):
    control = np.array([[x, 0.05 * y] for x, y in enumerate(values)])
    curve = Bezier(control)
    point = curve.derivatives(np.array([u]))[0] + [[0.0, offset]]
    ahead, back = nearest(nominal_of(curve), point), nearest(nominal_of(Bezier(control[::-1])), point)
    length = Track.from_curves([curve]).length
    assert ahead.error[0] > 0.0
    assert abs(ahead.error[0] + back.error[0]) < EXACT
    assert abs(ahead.s[0] + back.s[0] - length) < 1e-8


def command_of(s, feed, axes=("X", "Y"), period=0.001):
    n = len(s)
    zeros, numbers = np.zeros(n), np.zeros(n, dtype=np.int64)
    return Command(
        axes=axes,
        period=period,
        t=period * np.arange(n),
        segment=numbers,
        xi=zeros,
        s=np.array(s, dtype=float),
        position=np.zeros((n, len(axes))),
        feed=np.array(feed, dtype=float),
        window=numbers - 1,
    )


def machine_of(**servos):
    limits = Limits(velocity=1.0, acceleration=1.0, jerk=1.0)
    gap = Gap(lost_motion=0.0)
    axes = {
        name: Axis(name=name, feedback="motor", servo=Servo(b=b, c=c), gap=gap, limits=limits)
        for name, (b, c) in servos.items()
    }
    return Machine(name="bench", dialect="linuxcnc", servo_period=0.001, axes=axes)


def test_five_time_constants_of_the_slowest_axis_on_the_path():
    machine = machine_of(X=(5e-4, 5e-3), Y=(1e-4, 1e-2), Z=(1.0, 1.0), A=(0.0, 0.0))
    assert settling_time(machine, ("X", "Y")) == pytest.approx(1.0, rel=1e-15)
    assert settling_time(machine, ("Y",)) == pytest.approx(0.1, rel=1e-15)
    assert settling_time(machine, ("A",)) == 0.0


@pytest.mark.parametrize(
    ("standing", "feed", "first"),
    [(0, 0.1, 100), (1, 0.0, 100), (50, 0.0, 149)],
)
def test_the_run_counts_from_five_time_constants_of_motion_on(standing, feed, first):
    """In motion from the first row; at rest in the first row; after 50 rows of approach."""
    s = np.concatenate([np.zeros(standing), 1e-4 * np.arange(300)])
    feeds = np.concatenate([np.zeros(standing), np.full(300, 0.1)])
    command = command_of(s, feeds)
    assert first_counted(command, make_machine()) == first  # b = 1e-4, c = 0.01: 0.1 s
    ideal = machine_of(X=(0.0, 0.0), Y=(0.0, 0.0))
    assert first_counted(command, ideal) == max(standing - 1, 0)


def test_of_a_run_too_short_to_settle_no_row_counts():
    command = command_of(np.linspace(0, 1, 50), np.ones(50))
    error = np.ones(50)[first_counted(command, make_machine()) :]
    assert contour_error(error) is None
    assert contour_error(error - error) is None
    still = command_of(np.zeros(50), np.zeros(50))
    assert first_counted(still, make_machine()) == 50


def test_the_largest_and_the_root_mean_square():
    assert contour_error(np.array([3.0, -4.0])) == ContourError(max=4.0, rms=math.sqrt(12.5))
    added_by_gap = contour_error(np.array([3.0, -4.0, 1.0]) - np.array([2.0, -2.0, 1.0]))
    assert added_by_gap == ContourError(max=2.0, rms=math.sqrt(5 / 3))


def points_at(*places):
    return tuple(
        TurningPoint(index=k, kind="smooth", segment=0, xi=0.0, axis="X", sense="max", position=0.0, s=s)
        for k, s in enumerate(places)
    )


def test_every_row_belongs_to_the_nearest_turning_point():
    s = np.array([0.0, 0.4, 0.6, 1.4, 1.6, 3.0])
    error = np.array([1.0, -2.0, 3.0, -4.0, 5.0, -6.0])
    first, second, third = turning_errors(error, s, points_at(0.0, 1.0, 2.0))
    assert first == TurningError(turning_point=0, extreme=-2.0, max=2.0, rms=math.sqrt(2.5))
    assert second == TurningError(turning_point=1, extreme=-4.0, max=4.0, rms=math.sqrt(12.5))
    assert third == TurningError(turning_point=2, extreme=-6.0, max=6.0, rms=math.sqrt(30.5))


def test_over_the_seam_rows_belong_to_the_turning_point_behind_it():
    s = np.array([0.1, 0.5, 1.0, 2.1, 3.9])
    error = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    points = points_at(0.5, 2.0)
    at_rest, over = turning_errors(error, s, points), turning_errors(error, s, points, loop=4.0)
    assert [e.extreme for e in at_rest] == [3.0, 5.0]
    assert [e.extreme for e in over] == [5.0, 4.0]
    at_seam = turning_errors(error, s, points_at(0.0, 2.0), loop=4.0)
    assert [(e.extreme, e.rms) for e in at_seam] == [(5.0, math.sqrt(10.0)), (4.0, math.sqrt(12.5))]


def test_turning_points_at_one_place_share_their_rows_and_some_have_none():
    errors = turning_errors(np.array([1.0, -3.0]), np.array([0.0, 0.1]), points_at(0.0, 0.0, 5.0))
    assert errors[0] == TurningError(turning_point=0, extreme=-3.0, max=3.0, rms=math.sqrt(5.0))
    assert errors[1] == TurningError(turning_point=1, extreme=-3.0, max=3.0, rms=math.sqrt(5.0))
    assert errors[2] is None
    assert turning_errors(np.ones(2), np.zeros(2), ()) == ()
