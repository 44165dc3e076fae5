"""Paths with rounded corners through the public functions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

import ph_post as ph
from ph_post.api.inputs import analyse_job
from ph_post.geometry.curves import Line
from ph_post.geometry.joints import find_stops
from ph_post.geometry.track import Track
from ph_post.types import Path

MM = 1e-3


def zigzag() -> Path:
    """Three sides, of which the second goes back in X: a reversal in each corner."""
    points = MM * np.array([[0.0, 0.0], [20.0, 5.0], [2.0, 14.0], [22.0, 20.0]])
    sides = [Line(np.stack(pair)) for pair in pairwise(points)]
    return replace(Track.from_curves(sides).path, name="zigzag", feed=0.02)


def test_reversals_inside_rounded_corners_are_turning_points_with_windows() -> None:
    path = zigzag()
    sharp, _ = analyse_job(path, "mill")
    found, _ = analyse_job(path, "mill", corner_tolerance=0.05 * MM)
    assert [one.kind for one in sharp.turning_points] == ["corner", "corner"]
    assert [(one.kind, one.axis, one.sense) for one in found.turning_points] == [
        ("smooth", "X", "max"),
        ("smooth", "X", "min"),
    ]
    assert all(found.path.segments[one.segment].rounded for one in found.turning_points)
    assert len(found.windows) == 2
    assert all(0.0 < one.half_length < 1.0 * MM for one in found.windows)
    wide, _ = analyse_job(path, "mill", corner_tolerance=1.0 * MM)
    assert all(one is not None and one.duration > 0.0 for one in wide.intervals)
    assert all(stops.size == 0 for stops in find_stops(found.track)), "it is run through"
    assert found.path.remarks == ("2 corners are rounded, within 50 µm",)


def test_every_function_takes_the_tolerance_and_says_what_became_of_the_corners() -> None:
    path, how = zigzag(), {"strategy": "none", "corner_tolerance": 0.05 * MM}
    made = ph.compensate(path, "router", **how)
    assert "2 corners are rounded, within 50 µm" in made.warnings
    assert (made.reversals.compensated, made.reversals.all) == (0, 2)
    run = ph.simulate(path, "router", **how)
    assert "2 corners are rounded, within 50 µm" in run.warnings
    assert run.time < ph.simulate(path, "router", strategy="none").time - 0.02


def test_a_table_of_a_rounded_path_is_that_of_the_rounded_path(tmp_path) -> None:
    path, tolerance = zigzag(), 0.05 * MM
    file = tmp_path / "rows.csv"
    ph.compensate(path, "router", output="table", strategy="none", corner_tolerance=tolerance).write_table(file)
    run = ph.simulate(file, "router", path=path, corner_tolerance=tolerance)
    assert run.error is not None
    with pytest.raises(ph.InputError, match="another path"):
        ph.simulate(file, "router", path=path)


@pytest.mark.slow
def test_reversals_inside_rounded_corners_are_crossed_like_others() -> None:
    made = ph.compensate(zigzag(), "router", corner_tolerance=0.05 * MM, max_slowdown=0.6, effort=0.05)
    assert (made.reversals.compensated, made.reversals.all) == (2, 2)
    assert made.after.error_gap.max < 0.25 * made.before.error_gap.max
    assert made.after.error_gap.rms < 0.2 * made.before.error_gap.rms
