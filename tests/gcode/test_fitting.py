"""Curves through the straight moves that sample them, against the curves that were sampled."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from support.tape import Tape

from ph_post.analysis.turning_points import find_turning_points
from ph_post.gcode.fitting.arcs import MEETS_AT
from ph_post.gcode.fitting.polyline import fit_polyline
from ph_post.gcode.fitting.samples import ROUND, SMOOTH, STRAIGHT, PolylineFit
from ph_post.geometry.joints import joint_angles
from ph_post.geometry.ph import PH
from ph_post.geometry.track import Track
from ph_post.types import Array

MM = 1e-3
TOLERANCE = 1e-6


def circle(count: int, radius: float = 20.0, turns: float = 1.0) -> Array:
    angle = np.linspace(0.0, 2.0 * np.pi * turns, count)
    return radius * MM * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def slot(count: int, radius: float = 5.0, length: float = 20.0) -> Array:
    """Two lines of one step each, and two half circles of `count` vertices."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, count)
    x, y = 0.5 * length + radius * np.cos(angle), radius * np.sin(angle)
    half = np.stack([x, y], axis=1)
    return MM * np.concatenate([[[-0.5 * length, -radius]], half, -half])


def track_of(points: Array, tolerance: float = TOLERANCE) -> Track:
    """The path of a program of nothing but these moves."""
    from ph_post.gcode.paths import paths_of

    shown = np.zeros((len(points), 3))
    shown[:, : points.shape[1]] = points / MM
    (path,) = paths_of(Tape(shown[0]).lines(shown[1:]).program(), tolerance)
    return Track(path.path)


def distance_to_polyline(points: Array, place: Array) -> Array:
    """Distance of places (m, dim) from a polyline, straight from its definition."""
    best = np.full(len(place), np.inf)
    for a, b in pairwise(points):
        way = b - a
        share = np.clip((place - a) @ way / (way @ way), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(place - a - share[:, None] * way, axis=1))
    return best


def samples(track: Track, count: int = 4001) -> Array:
    piece, u = track.locate(np.linspace(0.0, track.length, count))
    return np.asarray(track.derivatives(piece, u)[0])


def kinds(fit: PolylineFit) -> list[int]:
    return [int(kind) for kind in fit.kind]


@pytest.mark.parametrize("count", [9, 61, 361, 20001])
def test_a_circle_is_arcs_of_its_radius(count: int) -> None:
    # 8 steps turn by 45 degrees each, more than who samples a curve takes: a polygon
    fit = fit_polyline(circle(count), TOLERANCE)
    if count == 9:
        assert kinds(fit) == [STRAIGHT] * 8
        return
    assert set(kinds(fit)) == {ROUND}
    assert fit.circle[:, :2] == pytest.approx(0.0, abs=1e-12)
    assert fit.circle[:, 2] == pytest.approx(20.0 * MM, abs=1e-12)
    assert (fit.circle[:, 3] == 1.0).all()


def test_a_clockwise_circle_turns_the_other_way() -> None:
    fit = fit_polyline(circle(361)[::-1], TOLERANCE)
    assert set(kinds(fit)) == {ROUND}
    assert (fit.circle[:, 3] == -1.0).all()


def test_a_circle_rounded_to_three_decimals_is_arcs_within_the_rounding() -> None:
    points = np.round(circle(361) / MM, 3) * MM
    track = track_of(points)
    assert len(track.pieces) <= 4
    radius = np.linalg.norm(samples(track), axis=1)
    assert np.abs(radius - 20.0 * MM).max() < 1e-6


def test_a_slot_is_two_lines_and_two_arcs() -> None:
    fit = fit_polyline(slot(41), TOLERANCE)
    assert kinds(fit) == [STRAIGHT, ROUND, STRAIGHT, ROUND]
    assert fit.first.tolist() == [0, 1, 41, 42]


def test_lines_between_corners_stay_lines() -> None:
    square = MM * np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0], [0.0, 0.0]])
    assert kinds(fit_polyline(square, TOLERANCE)) == [STRAIGHT] * 4


def test_a_chamfer_stays_a_chamfer() -> None:
    points = MM * np.array([[0.0, 0.0], [10.0, 0.0], [11.0, 1.0], [11.0, 9.0]])
    assert kinds(fit_polyline(points, TOLERANCE)) == [STRAIGHT] * 3


WALL = [(20, 99.2), (29, 99.27), (33.6, 99.276), (46.2, 99.277), (50.8, 99.277), (90, 99.277), (90.3, 99.249)]
"""Steps that grow towards a long one, behind which the wall bends."""

DOWN = [(3.671, -0.78), (3.664, -0.869), (3.644, -0.956), (3.612, -1.039), (3.568, -1.115), (3.514, -1.183)]
LEVEL = [(3.45, -1.241), (3.378, -1.288), (3.301, -1.322), (3.219, -1.343), (3.135, -1.35)]
RAMP = [(x, -0.36 * x, z) for x, z in [*DOWN, *LEVEL]]
"""A helix that flattens out, from where steps that are all but straight, and much longer, lead to a corner."""


@pytest.mark.parametrize(
    "points",
    [
        [*WALL, (90.9, 99.1), (91.8, 98.45), (92.5, 97.6), (93, 96.5)],
        [*RAMP, (0.975, -0.342, -1.35), (-14.84, 5.35, -1.35), (-28.665, 10.33, -1.35), (-30.5, 5.35, -1.35)],
    ],
)
def test_a_curve_is_no_farther_from_long_steps_than_a_chord_may_be(points: list[list[float]]) -> None:
    vertices = MM * np.array(points)
    assert distance_to_polyline(vertices, samples(track_of(vertices))).max() < 5e-5 + TOLERANCE


def test_a_line_of_many_steps_is_one_exact_line() -> None:
    # along X, then a quarter circle: Y must not stir on the line
    x = np.linspace(0.0, 30.0, 61)
    angle = np.linspace(0.0, np.pi / 2, 31)[1:]
    line = np.stack([x, 0.0 * x], axis=1)
    arc = np.stack([30.0 + 8.0 * np.sin(angle), 8.0 - 8.0 * np.cos(angle)], axis=1)
    points = MM * np.concatenate([line, arc])
    track = track_of(points)
    place = samples(track)
    assert (place[place[:, 0] < 30.0 * MM - 1e-9, 1] == 0.0).all()
    assert [point.axis for point in find_turning_points(track)] == []


def test_an_oblique_line_rounded_to_three_decimals_is_one_line() -> None:
    share = np.linspace(0.0, 1.0, 201)[:, None]
    points = np.round(share * np.array([[37.0, 11.0]]), 3) * MM
    assert kinds(fit_polyline(points, TOLERANCE)) == [STRAIGHT]


@pytest.mark.parametrize("angle", [30.0, 60.0, 90.0, 150.0])
def test_a_corner_between_curves_stays_a_corner(angle: float) -> None:
    arc = circle(101, turns=0.25)
    turn = np.radians(angle)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    steps = np.diff(arc, axis=0)
    second = arc[-1] + np.cumsum(steps @ np.array([[0.0, 1.0], [-1.0, 0.0]]) @ rotation.T, axis=0)
    points = np.concatenate([arc, second])
    fit = fit_polyline(points, TOLERANCE)
    assert 100 in fit.first.tolist()
    track = track_of(points)
    # the sampled arcs start and end half a step's turn from their chords
    assert joint_angles(track).max() == pytest.approx(turn, abs=1e-3)


CURVES = {
    "ellipse": lambda t: np.stack([30.0 * np.cos(2 * np.pi * t), 12.0 * np.sin(2 * np.pi * t)], axis=1),
    "sine": lambda t: np.stack([60.0 * t, 5.0 * np.sin(6.0 * np.pi * t)], axis=1),
    "quintic": lambda t: PH([0.0, 0.0], [[4.0, 1.0], [3.0, 4.0], [-4.0, 3.0]]).derivatives(t)[0],
    "space": lambda t: np.stack([20.0 * np.cos(5.0 * t), 20.0 * np.sin(5.0 * t), 8.0 * t + np.sin(7.0 * t)], axis=1),
}


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("decimals", [3, 4, 12])
@pytest.mark.parametrize("count", [401])
@pytest.mark.thinned(8)
def test_both_ways_within_tolerance(name: str, decimals: int, count: int) -> None:
    points = np.round(CURVES[name](np.linspace(0.0, 1.0, count)), decimals) * MM
    track = track_of(points)
    curve = samples(track, 4001)
    # vertices from the curve, told by its samples: half a sample's distance spoils that by its square
    step = track.length / 4000.0
    assert distance_to_polyline(curve, points).max() <= TOLERANCE + step**2 / (8.0 * 1.0 * MM)
    steps = np.diff(points, axis=0)
    length = np.linalg.norm(steps, axis=1)
    cosine = (steps[1:] * steps[:-1]).sum(axis=1) / (length[1:] * length[:-1])
    sagitta = length.max() * np.arccos(np.clip(cosine, -1.0, 1.0)).max() / 8.0
    assert distance_to_polyline(points, curve).max() <= TOLERANCE + 2.0 * sagitta


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("decimals", [3, 12])
def test_pieces_meet_with_one_tangent(name: str, decimals: int) -> None:
    points = np.round(CURVES[name](np.linspace(0.0, 1.0, 801)), decimals) * MM
    track = track_of(points)
    assert joint_angles(track).max() <= MEETS_AT
    ends = [piece.control[[0, -1]] for piece in track.pieces if piece.kind == "polynomial"]
    assert len(ends) > 0


@pytest.mark.parametrize("name", ["ellipse", "sine", "quintic", "space"])
def test_a_smooth_curve_takes_few_pieces(name: str) -> None:
    points = CURVES[name](np.linspace(0.0, 1.0, 3001)) * MM
    fit = fit_polyline(points, TOLERANCE)
    assert STRAIGHT not in kinds(fit)
    assert fit.kind.size < 150


def test_planar_interpolants_are_pythagorean() -> None:
    fit = fit_polyline(CURVES["quintic"](np.linspace(0.0, 1.0, 201)) * MM, TOLERANCE)
    smooth = fit.kind == SMOOTH
    assert smooth.any()
    assert (fit.degree[smooth] == 5).all()
    hodograph = 5.0 * np.diff(fit.control[smooth], axis=1)
    t = np.linspace(0.0, 1.0, 7)
    basis = np.stack([c * t**k * (1 - t) ** (4 - k) for k, c in enumerate((1, 4, 6, 4, 1))], axis=1)
    size = np.linalg.norm(np.einsum("tk,pkd->ptd", basis, hodograph), axis=2)
    assert size == pytest.approx(fit.speed[smooth] @ basis.T, rel=1e-12)


def observed_order(errors: list[float], steps: list[float]) -> float:
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def reversal_errors(name: str, axis: str, exact: Array, count: int) -> float:
    """Largest distance of the reversals of one axis from where they are, the sampling as fine as `count`.

    An odd share moves the samples off the reversals, where they would be found by luck.
    """
    t = (np.arange(-3, count + 4) + 0.317) / count
    track = track_of(CURVES[name](t) * MM, 1e-15)
    found = [point for point in find_turning_points(track) if point.axis == axis]
    place = np.array([track.path.segments[p.segment].curve.derivatives(np.array([p.xi]))[0, 0] for p in found])
    return max(float(np.linalg.norm(place[:, :2] - one * MM, axis=1).min()) for one in exact)


@pytest.mark.parametrize(
    ("name", "axis", "exact"),
    [
        ("ellipse", "Y", [[0.0, 12.0], [0.0, -12.0]]),
        ("ellipse", "X", [[-30.0, 0.0]]),
        ("sine", "Y", [[10.0 * (k + 0.5), 5.0 * (-1) ** k] for k in range(6)]),
    ],
)
def test_reversals_converge(name: str, axis: str, exact: list[list[float]]) -> None:
    # Interpolants of places and tangents err by the fourth power of their length, and their slopes, on which
    # the place of a reversal depends, by the third.
    counts = [100, 200, 400]
    errors = [reversal_errors(name, axis, np.array(exact), count) for count in counts]
    assert errors[-1] < 3e-8
    assert observed_order(errors, [1.0 / n for n in counts]) > 2.8


def test_curvature_converges() -> None:
    # Cubic-like interpolation of places and tangents: second order for the curvature.
    counts, errors = [80, 160, 320], []
    for count in counts:
        track = track_of(CURVES["sine"](np.linspace(0.0, 1.0, count + 1)) * MM, 1e-15)
        piece, u = track.locate(np.linspace(0.2, 0.8, 997) * track.length)
        place, d1, d2 = track.derivatives(piece, u, 2)
        kappa = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / np.linalg.norm(d1, axis=1) ** 3
        w = 6.0 * np.pi / (60.0 * MM)
        slope, bend = 5.0 * MM * w * np.cos(w * place[:, 0]), -5.0 * MM * w**2 * np.sin(w * place[:, 0])
        errors.append(float(np.abs(kappa - bend / (1.0 + slope**2) ** 1.5).max()))
    assert observed_order(errors, [1.0 / n for n in counts]) > 1.8


def test_pieces_end_where_they_are_cut() -> None:
    points = circle(101, turns=0.5)
    cuts = np.zeros(101, dtype=np.bool_)
    cuts[[33, 34, 80]] = True
    fit = fit_polyline(points, TOLERANCE, cuts)
    assert {33, 34, 80} <= set(fit.first.tolist())
    assert STRAIGHT not in kinds(fit)


def test_feet_are_in_order_and_near_their_vertices() -> None:
    points = CURVES["ellipse"](np.linspace(0.0, 1.0, 501)) * MM
    fit = fit_polyline(points, TOLERANCE)
    for k in np.flatnonzero(fit.kind == SMOOTH).tolist():
        a, b = int(fit.first[k]), int(fit.last[k])
        foot = fit.foot[a:b]
        assert (np.diff(foot) > 0.0).all()
        basis = [1, 5, 10, 10, 5, 1]
        value = sum(
            c * foot[:, None] ** j * (1 - foot[:, None]) ** (5 - j) * fit.control[k, j, :2] for j, c in enumerate(basis)
        )
        assert np.linalg.norm(value - points[a:b], axis=1).max() <= TOLERANCE


@pytest.mark.parametrize("count", [8, 12, 17, 40])
@pytest.mark.parametrize("radius", [0.004, 0.009, 0.02])
def test_small_closed_curves_behind_a_corner_are_followed(count: int, radius: float) -> None:
    """As round a pad of a board: with all but both ends too near, and those in one place, there was no tangent."""
    points = np.vstack([[-0.3 * MM, 0.0], circle(count + 1, radius)])
    track = track_of(points)
    drawn = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    assert drawn <= track.length * (1.0 + 1e-9) <= 1.1 * drawn
    assert distance_to_polyline(points, samples(track)[:, :2]).max() < 0.1 * radius * MM
