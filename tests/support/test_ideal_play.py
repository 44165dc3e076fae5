"""Distances from a path, beside those from all of its pieces, and a dragged table, beside it step by step."""

from __future__ import annotations

import numpy as np
import pytest

from .ideal_play import Polyline, distances, dragged


@pytest.mark.parametrize("seed", range(20))
def test_a_table_is_dragged_as_step_by_step(seed: int) -> None:
    """Ways, rests and turns, from any place."""
    rng = np.random.default_rng(seed)
    ways = np.repeat(rng.choice([-0.03, 0.0, 0.02, 0.5], 60), rng.integers(1, 9, 60))
    motor, half = np.cumsum(np.append(rng.normal(), ways * rng.uniform(0.5, 1.5, ways.size))), 0.1
    begin = at = float(motor[0] + rng.uniform(-0.3, 0.3))
    expected = []
    for place in motor.tolist():
        at = min(max(at, place - half), place + half)
        expected.append(at)
    assert dragged(motor, half, begin).tolist() == expected


def test_distances_are_those_from_the_nearest_piece() -> None:
    """A fine corner beside a long cut of few points, a hole in several passes, and a way back along a line."""
    turn = np.linspace(0.0, 0.5 * np.pi, 200)
    corner = np.column_stack([0.2 * np.sin(turn), 0.2 - 0.2 * np.cos(turn), 0.0 * turn])
    cut = np.column_stack([np.linspace(3.0, -3.0, 15), np.full(15, -0.03), np.zeros(15)])
    holes = [[0.2, 0.2, z] for z in (0.0, -1.0, -2.0, -1.0, -2.0, -3.0)]
    back = [[x, 0.2, -3.0] for x in (0.2, 0.9, 0.4, 1.1)]
    path = np.concatenate([corner, cut, holes, back])
    places = np.random.default_rng(3).uniform([-1.0, -0.5, -3.2], [1.5, 0.6, 0.2], (2000, 3))
    begin, way = path[:-1], np.diff(path, axis=0)
    share = ((places[:, None] - begin) * way).sum(axis=2) / np.maximum((way * way).sum(axis=1), 1e-30)
    from_all = np.linalg.norm(places[:, None] - begin - np.clip(share, 0.0, 1.0)[..., None] * way, axis=2)
    # Ways from one cut to another are longer than all cuts, and no part of the path.
    ways = np.linalg.norm(way, axis=1) > 2.0
    assert ways.sum() == 2
    beside = ways[from_all.argmin(axis=1)]
    assert np.allclose(distances(places, path)[~beside], from_all.min(axis=1)[~beside], atol=1e-9)
    assert beside.mean() < 0.5


def test_a_long_cut_among_short_ones_is_path_where_it_is_told() -> None:
    """A print of short moves with a long one: by their lengths alone that is a way through the air."""
    turn = np.linspace(0.0, 2.0 * np.pi, 400)
    ring = np.column_stack([np.cos(turn), np.sin(turn), 0.0 * turn])
    path = np.concatenate([ring, [[1.0, 30.0, 0.0], [9.0, 30.0, 0.0]]])
    joined = np.append(np.ones(400, dtype=bool), False)
    places = np.array([[1.0, 15.0, 0.0], [5.0, 29.0, 0.0]])
    assert Polyline(path, joined).distances(places) == pytest.approx([0.0, 4.0], abs=1e-9)
    assert Polyline(path).distances(places)[0] > 10.0
