"""Closest points of lines, arcs, helices, spirals and Bézier pieces, against dense sampling."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ph_post.geometry.closest import (
    CONTROL,
    EXTENT,
    FIRST,
    GROWTH,
    NO_CONTROL,
    ORDER,
    ORIGIN,
    RADIUS,
    RISE,
    SCALE,
    SECOND,
    SWEEP,
    closest_in_order,
    closest_within,
    make_pieces,
    points_at,
)
from ph_post.types import Array

DENSE = np.linspace(0.0, 1.0, 20_001)


def line(extent: float = 1.0) -> Array:
    piece = make_pieces(1)
    chord = np.array([0.03, -0.04, 0.12])
    piece[0, ORIGIN : ORIGIN + 3] = (0.1, 0.2, -0.1)
    piece[0, FIRST : FIRST + 3], piece[0, EXTENT] = chord / extent, extent
    piece[0, SCALE] = extent**2 / (chord @ chord)
    return piece


def arc(sweep: float, rise: float = 0.0, growth: float = 0.0) -> Array:
    piece = make_pieces(1)
    piece[0, ORIGIN : ORIGIN + 3] = (0.01, 0.02, 0.0)
    piece[0, FIRST : FIRST + 3], piece[0, SECOND : SECOND + 3] = (0.6, 0.8, 0.0), (-0.8, 0.6, 0.0)
    piece[0, RISE + 2], piece[0, RADIUS], piece[0, SWEEP], piece[0, GROWTH] = rise, 0.05, sweep, growth
    return piece


PIECES = {
    "line": line(),
    "line in metres": line(0.13),
    "arc": arc(2.0),
    "clockwise arc": arc(-4.5),
    "full circle": arc(2.0 * math.pi),
    "helix": arc(3.0, rise=0.02),
    "spiral": arc(-2.5, growth=0.1),
    "widening helix": arc(5.0, rise=-0.01, growth=-0.05),
}


def around(points: Array, away: float) -> Array:
    rng = np.random.default_rng(7)
    return points[rng.integers(0, len(points), 20)] + rng.normal(0.0, away, (20, 3))


@pytest.mark.parametrize("away", [1e-6, 1e-3, 0.01])
@pytest.mark.parametrize("name", PIECES)
def test_no_sample_is_closer_than_the_closest_point(name: str, away: float) -> None:
    piece = PIECES[name]
    extent = piece[0, EXTENT]
    curve = points_at(piece, NO_CONTROL, np.zeros(DENSE.size, dtype=np.int64), DENSE * extent)
    for x in around(curve, away):
        apart = np.linalg.norm(curve - x, axis=1)
        near = np.array([DENSE[np.argmin(apart)] * extent])
        distance, s = closest_within(piece, np.array([0.0, extent]), x[None], near, np.array([extent]))
        assert distance[0] <= apart.min() + 1e-12
        there = points_at(piece, NO_CONTROL, np.zeros(1, dtype=np.int64), s)[0]
        assert np.linalg.norm(there - x) == pytest.approx(distance[0], abs=1e-15)


@pytest.mark.parametrize("away", [1e-6, 1e-3])
@pytest.mark.parametrize("name", [*PIECES, "bezier"])
@pytest.mark.thinned(4)
def test_no_sample_is_closer_in_the_order_of_travel(name: str, away: float) -> None:
    control = NO_CONTROL
    if name == "bezier":
        piece = make_pieces(1)
        piece[0, CONTROL], piece[0, ORDER] = 1, 4
        weights = np.array([1.0, 1.0, 0.5, 2.0, 1.0])
        rows = np.array([[9.0, 9.0, 9.0], [0, 0, 0], [0.01, 0.05, 0.0], [0.04, 0.05, 0.02], [0.06, 0.0, 0.0]])
        control = np.column_stack([rows * weights[:, None], weights])
    else:
        piece = PIECES[name]
    extent, zeros = piece[0, EXTENT], np.zeros(DENSE.size, dtype=np.int64)
    curve = points_at(piece, control, zeros, DENSE * extent)
    ways = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    some = slice(None, None, 200)
    count = DENSE[some].size
    points = around(curve, away)
    reach = np.tile([0, count - 1, 0, count - 1], (len(points), 1))
    found, on, at = closest_in_order(
        points, reach, piece, control, zeros[some], DENSE[some] * extent, curve[some], ways[some]
    )
    apart = np.array([np.linalg.norm(curve - x, axis=1).min() for x in points])
    assert np.all(np.linalg.norm(found - points, axis=1) <= apart + 1e-12)
    assert points_at(piece, control, on, at) == pytest.approx(found, abs=1e-15)
