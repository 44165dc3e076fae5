"""Laws of fitting and of paths of programs, on random polylines of every roughness."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from support.amount import examples
from support.tape import Tape

from ph_post.analysis.turning_points import find_turning_points
from ph_post.gcode.fitting.polyline import fit_polyline
from ph_post.gcode.fitting.samples import PolylineFit
from ph_post.gcode.paths import paths_of
from ph_post.geometry.track import Track
from ph_post.types import Array

MM = 1e-3
TOLERANCE = 1e-6


@st.composite
def polylines(draw: Any) -> Array:
    """Walks whose direction changes by a smooth rate, by noise, and by leaps, with steps of any size [mm]."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.integers(2, 120))
    dimension = draw(st.sampled_from([2, 3]))
    size = 10.0 ** draw(st.floats(-2.0, 1.0))
    turn = np.cumsum(rng.normal(0.0, draw(st.sampled_from([0.0, 0.003, 0.03])), count))
    turn += draw(st.floats(-0.1, 0.1))
    leap = rng.random(count) < draw(st.sampled_from([0.0, 0.05, 0.5]))
    angle = np.cumsum(np.where(leap, rng.uniform(-np.pi, np.pi, count), turn))
    steps = size * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    steps *= np.where(rng.random(count) < draw(st.sampled_from([0.0, 0.1])), 20.0, 1.0)[:, None]
    if dimension == 3:
        steps = np.column_stack([steps, 0.3 * size * np.sin(np.cumsum(turn))])
    points = np.round(np.cumsum(steps, axis=0), draw(st.sampled_from([3, 4, 9])))
    apart = np.append(True, (np.abs(np.diff(points, axis=0)) > 1e-6).any(axis=1))
    return points[apart]


def same_pieces(a: PolylineFit, b: PolylineFit) -> bool:
    return bool(np.array_equal(a.kind, b.kind) and np.array_equal(a.first, b.first))


@settings(max_examples=examples(150), deadline=None)
@given(polylines())
def test_pieces_cover_the_vertices_in_order(points: Array) -> None:
    if len(points) < 2:
        return
    fit = fit_polyline(points * MM, TOLERANCE)
    assert (fit.first[0], fit.last[-1]) == (0, len(points) - 1)
    assert (fit.first[1:] == fit.last[:-1]).all()
    assert (fit.first < fit.last).all()
    assert ((fit.foot >= 0.0) & (fit.foot <= 1.0)).all()


@settings(max_examples=examples(150), deadline=None)
@given(polylines())
def test_every_end_of_a_move_is_within_tolerance_of_the_path(points: Array) -> None:
    shown = np.zeros((len(points), 3))
    shown[:, : points.shape[1]] = points
    paths = paths_of(Tape(shown[0]).lines(shown[1:]).program(), TOLERANCE)
    if not paths:
        return
    (path,) = paths
    track = Track(path.path)
    columns = ["XYZ".index(axis) for axis in path.path.axes]
    piece, u = track.locate(path.s)
    place = track.derivatives(piece, u)[0]
    off = np.linalg.norm(place - shown[:, columns] * MM, axis=1)
    assert off.max() <= TOLERANCE * (1.0 + 1e-6) + 1e-12
    assert (np.diff(path.s) > 0.0).all()
    polyline = np.linalg.norm(np.diff(shown, axis=0), axis=1).sum() * MM
    assert track.length >= polyline - 2.0 * TOLERANCE * len(points)
    assert track.length <= polyline * 1.2 + 2.0 * TOLERANCE * len(points)


@settings(max_examples=examples(100), deadline=None)
@given(polylines())
def test_places_go_to_motions_and_back(points: Array) -> None:
    shown = np.zeros((len(points), 3))
    shown[:, : points.shape[1]] = points
    for path in paths_of(Tape(shown[0]).lines(shown[1:]).program(), TOLERANCE):
        s = np.linspace(0.0, path.s[-1], 257)
        motion, share = path.to_motions(s)
        assert np.abs(path.to_path(motion, share) - s).max() <= 1e-9
        assert (np.diff(motion + share) >= -1e-12).all()


@settings(max_examples=examples(100), deadline=None)
@given(polylines())
def test_a_mirrored_polyline_has_mirrored_pieces(points: Array) -> None:
    if len(points) < 2:
        return
    flipped = points.copy()
    flipped[:, 1] *= -1.0
    assert same_pieces(fit_polyline(points * MM, TOLERANCE), fit_polyline(flipped * MM, TOLERANCE))


@settings(max_examples=examples(100), deadline=None)
@given(st.lists(st.tuples(*[st.integers(-20, 20)] * 3), min_size=3, max_size=40))
def test_reversals_of_a_polygon_are_those_of_its_whole_numbers(corners: list[tuple[int, int, int]]) -> None:
    # Steps of many millimetres sample nothing, so the path is the polygon, and whole numbers tell its turns.
    points = [corners[0]]
    points += [one for one, before in zip(corners[1:], corners[:-1], strict=True) if one != before]
    moves = [[b[k] - a[k] for a, b in itertools.pairwise(points)] for k in range(3)]
    signs = [[1 if way > 0 else -1 for way in axis if way != 0] for axis in moves]
    expected = sum(a != b for axis in signs for a, b in itertools.pairwise(axis))
    tape = Tape([10.0 * x for x in points[0]]).lines([[10.0 * x for x in one] for one in points[1:]])
    found = sum(len(find_turning_points(Track(path.path))) for path in paths_of(tape.program(), TOLERANCE))
    assert found == expected
