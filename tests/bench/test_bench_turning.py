"""Turning points and windows of a path of 10,000 quintics, against numpy.roots called for every segment."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from ph_post.analysis.osculating import find_windows
from ph_post.analysis.turning_points import find_turning_points
from ph_post.geometry.curves import Bezier
from ph_post.geometry.track import Track
from ph_post.types import Array

SEGMENTS = 10_000
TOLERANCE = 5e-6
AIM = 20
SAMPLE = 500


def loops(count: int) -> Array:
    """Control points of C2 quintics along a trochoid, as in milling a slot, that wanders over a table."""
    t = np.linspace(0.0, 1.0, SEGMENTS + 1)
    waves = (
        (2 * np.pi * count, (0.005, 0.004), (0.0, -np.pi / 2)),
        (2 * np.pi * 0.37 * count, (0.0005, 0.0005), (1.0, 2.0)),
        (2 * np.pi * 3, (0.08, 0.06), (0.0, 1.0)),
    )

    def derivative(order: int) -> Array:
        total = np.zeros((SEGMENTS + 1, 2))
        for rate, sizes, phases in waves:
            for axis in (0, 1):
                angle = rate * t + phases[axis] + order * np.pi / 2
                total[:, axis] += sizes[axis] * (rate / SEGMENTS) ** order * np.cos(angle)
        return total

    p, v, a = (derivative(order) for order in range(3))
    rows = [
        p[:-1],
        p[:-1] + v[:-1] / 5,
        p[:-1] + 2 * v[:-1] / 5 + a[:-1] / 20,
        p[1:] - 2 * v[1:] / 5 + a[1:] / 20,
        p[1:] - v[1:] / 5,
        p[1:],
    ]
    return np.stack(rows, axis=1)


def best(work: Callable[[], Any], times: int = 7) -> tuple[float, Any]:
    """Least time of several runs, and the result."""
    least, result = np.inf, None
    for _ in range(times):
        start = time.perf_counter()
        result = work()
        least = min(least, time.perf_counter() - start)
    return least, result


def loop_of_roots(velocities: Array) -> int:
    return sum(np.roots(row).size for segment in velocities for row in segment)


@pytest.mark.parametrize("count", [50, 500, 750])
def test_turning_points_and_windows_against_numpy_roots(count: int) -> None:
    control = loops(count)
    curves = [Bezier(points) for points in control]
    build, track = best(lambda: Track.from_curves(curves), 3)
    track.locate(np.linspace(0.0, track.length, 2 * SEGMENTS))
    turning, points = best(lambda: find_turning_points(track))
    windows, found = best(lambda: find_windows(track, points, TOLERANCE))
    assert len(points) >= len(found) > 3 * count
    velocities = np.diff(control, axis=1).transpose(0, 2, 1)[:SAMPLE]
    roots = best(lambda: loop_of_roots(velocities), 5)[0] * SEGMENTS / SAMPLE
    ratio, whole = roots / (turning + windows), roots / (build + turning + windows)
    sys.stdout.write(
        f"\n{len(points)} turning points: path {build * 1e3:.0f} ms, turning points {turning * 1e3:.0f} ms, "
        f"windows {windows * 1e3:.0f} ms, numpy.roots {roots * 1e3:.0f} ms: {ratio:.1f} times, "
        f"{whole:.1f} times with building the path\n"
    )
    assert ratio >= AIM
