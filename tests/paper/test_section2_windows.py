"""Figures 1 and 2: the extents of the windows on a quintic like the paper's.

The paper does not print its curve; the shipped one has the printed extents: 0.2411 of a vertical turning
point of extremal curvature at ε = 1e-6, and 0.2033 of a horizontal one that is not extremal at ε = 1e-5.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ph_post.analysis.certification import certify
from ph_post.analysis.osculating import deviation, find_windows
from ph_post.analysis.turning_points import find_turning_points
from ph_post.files.path import read_path
from ph_post.geometry.track import Track
from ph_post.types import TurningPoint

FIGURE = Path(__file__).parents[2] / "paths" / "figure1.json"


@pytest.fixture(scope="module")
def track() -> Track:
    return Track(read_path(FIGURE))


def point_on(track: Track, axis: str) -> TurningPoint:
    (point,) = (point for point in find_turning_points(track) if point.axis == axis)
    return point


@pytest.mark.parametrize(("axis", "tolerance", "printed", "order"), [("X", 1e-6, 0.2411, 3), ("Y", 1e-5, 0.2033, 2)])
def test_extents_of_figure_2(track: Track, axis: str, tolerance: float, printed: float, order: int) -> None:
    """Eq. (6) gives the printed extent 2|s|, and the true one differs by a few per cent."""
    point = point_on(track, axis)
    (window,) = (
        one for one in find_windows(track, find_turning_points(track), tolerance) if one.turning_point == point.index
    )
    assert 2.0 * window.estimate == pytest.approx(printed, abs=5e-5)
    assert window.contact_order == order
    assert window.limited_by == "deviation"
    assert window.half_length == pytest.approx(window.estimate, rel=0.04)
    s = np.linspace(-window.half_length, window.half_length, 2001)
    inside = deviation(track, point, s)
    assert inside.max() <= tolerance
    assert max(inside[0], inside[-1]) >= 0.99 * tolerance


def test_printed_extents_imply_the_derivatives_of_the_curvature(track: Track) -> None:
    """κ̈ of the vertical turning point, κ̇ of the horizontal one; of the former κ̇ vanishes."""
    vertical, horizontal = point_on(track, "X"), point_on(track, "Y")
    assert vertical.curvature_dot == pytest.approx(0.0, abs=1e-6)
    assert abs(vertical.curvature_ddot or 0.0) == pytest.approx(0.1136, abs=1e-4)
    assert abs(horizontal.curvature_dot or 0.0) == pytest.approx(0.0571, abs=1e-4)


def test_the_turning_points_of_figure_1_are_certified(track: Track) -> None:
    certificate = certify(track)
    assert certificate.ok
    assert certificate.exact == 2
