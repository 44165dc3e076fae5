"""Distance from the band between two ways, against least squares with bounds."""

from __future__ import annotations

import time

import numpy as np
import pytest
from scipy.optimize import nnls

from ph_post.geometry.bands import Band
from ph_post.types import Array

ONE = 1e3
"""Weight of the equation that the weights of corners are one in all."""


def ways(seed: int, apart: float) -> tuple[Array, Array]:
    """Two ways (40, 3) side by side that wind through space."""
    rng = np.random.default_rng(seed)
    one = np.cumsum(rng.normal(size=(40, 3)) * 0.01 + [0.02, 0.0, 0.0], axis=0)
    return one, one + apart * np.cumsum(rng.normal(size=(40, 3)), axis=0)


def least_distance(point: Array, one: Array, other: Array) -> float:
    """Distance from all triangles, each by least squares with weights of its corners that are not negative."""
    found = []
    for a, b, c, d in zip(one, other, one[1:], other[1:], strict=False):
        for corners in ((a, b, d), (a, d, c)):
            matrix = np.vstack([np.stack(corners, axis=1), np.full(3, ONE)])
            weights = nnls(matrix, np.append(point, ONE))[0]
            found.append(float(np.linalg.norm(np.stack(corners, axis=1) @ (weights / weights.sum()) - point)))
    return min(found)


@pytest.mark.parametrize("seed", range(20))
def test_the_distance_is_that_from_the_nearest_triangle(seed: int) -> None:
    one, other = ways(seed, 0.005)
    rng = np.random.default_rng(100 + seed)
    rows = rng.integers(0, 40, 6)
    points = 0.5 * (one + other)[rows] + rng.normal(size=(6, 3)) * 0.03
    found = Band(one, other).distances(points, rows, 10.0)
    assert found == pytest.approx([least_distance(point, one, other) for point in points], abs=1e-9)


def test_long_steps_pass_over_nothing_that_is_nearer() -> None:
    """A spiral of 30,000 rows: the nearest turn is found from any row of it."""
    angle = np.linspace(0.0, 60.0 * np.pi, 30_001)
    radius = 0.01 + 1e-4 * angle
    way = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros_like(angle)], axis=1)
    rng = np.random.default_rng(5)
    points = np.append(rng.uniform(-0.03, 0.03, (50, 2)), rng.choice([0.0, 1e-6, 1e-3], (50, 1)), axis=1)
    found = Band(way, way).distances(points, rng.integers(0, angle.size, 50), 10.0)
    nearest = [np.linalg.norm(way - point, axis=1).min() for point in points]
    assert np.all(found <= nearest)
    assert found == pytest.approx(nearest, abs=np.linalg.norm(np.diff(way, axis=0), axis=1).max())


def test_inside_the_band_there_is_no_distance() -> None:
    one, other = ways(7, 0.005)
    middle = 0.3 * one + 0.7 * other
    assert Band(one, other).distances(middle, np.arange(40), 0.1) == pytest.approx(np.zeros(40), abs=1e-12)


def test_a_band_without_width_is_a_line_and_rests_are_one_place() -> None:
    line = np.zeros((3001, 3))
    line[:, 0] = np.concatenate([np.linspace(0.0, 1.0, 1001), np.ones(1000), np.linspace(1.0, 2.0, 1000)])
    points = np.array([[0.5003, 0.2, 0.0], [1.0, -0.1, 0.1], [2.3, 0.0, 0.4]])
    found = Band(line, line).distances(points, np.array([400, 1500, 2999]), 0.5)
    assert found == pytest.approx([0.2, 0.02**0.5, 0.5], rel=1e-12)


def test_what_is_farther_along_than_the_reach_is_another_pass() -> None:
    there = np.zeros((2001, 3))
    there[:, 0] = np.abs(np.linspace(-1.0, 1.0, 2001))
    there[1000:, 1] = 1e-3
    point = np.array([[0.5, 1e-3, 0.0]])
    near, far = (Band(there, there).distances(point, np.array([500]), reach)[0] for reach in (0.1, 2.0))
    assert near == pytest.approx(1e-3)
    assert far == pytest.approx(0.0, abs=1e-9)


def test_what_it_takes_is_not_up_to_how_slow_a_way_is() -> None:
    """Two millimetres around a corner in steps of 10 nm, and tables that lag by 25 micrometres: 5 s once."""
    s = np.linspace(0.0, 2e-3, 200_001)
    way = np.stack([np.minimum(s, 1e-3), np.maximum(s - 1e-3, 0.0), np.zeros_like(s)], axis=1)
    rows = np.arange(0, s.size, 5)
    band = Band(way, way)
    band.distances(way[:1], rows[:1], 1e-3)
    begun = time.process_time()
    found = band.distances(way[rows] - [2.5e-5, 0.0, 0.0], rows, 1e-3)
    assert time.process_time() - begun < 2.0
    x, y = (way[rows] - [2.5e-5, 0.0, 0.0])[:, :2].T
    nearest = np.where(y > 0.0, np.minimum(1e-3 - x, y), np.maximum(-x, 0.0))
    assert found == pytest.approx(nearest, abs=1e-9)


def test_what_it_takes_is_not_up_to_how_far_away_points_are() -> None:
    """Half a millimetre that winds in steps of 30 nm, and points half a metre beside it: 23 s once."""
    rng = np.random.default_rng(3)
    steps = np.column_stack([np.full(20_000, 3e-8), rng.normal(size=(20_000, 2)) * 2e-8])
    way = np.cumsum(steps, axis=0)
    band = Band(way, way)
    rows = rng.integers(0, len(way), 20_000)
    points = way[rows] + rng.choice([-0.5, 0.5], (20_000, 3)) * rng.uniform(size=(20_000, 3))
    band.distances(points[:1], rows[:1], 1e-3)
    begun = time.process_time()
    found = band.distances(points, rows, 1e-3)
    assert time.process_time() - begun < 1.5
    for point, distance in zip(points[::500], found[::500], strict=True):
        nearest = np.linalg.norm(way - point, axis=1).min()
        assert nearest - 1e-7 <= distance <= nearest + 1e-12
