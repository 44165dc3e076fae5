"""Scaling, reversing or turning a path by 90° does the same to its turning points."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.amount import examples

from ph_post.analysis.certification import certify
from ph_post.analysis.osculating import find_windows
from ph_post.analysis.turning_points import find_turning_points
from ph_post.geometry.curves import Bezier
from ph_post.geometry.track import Track
from ph_post.types import Array, TurningPoint

GRID = 2.0**-10
"""Control points are multiples of this [m], so that every map below is exact in floating point."""

Place = tuple[str, str, str, float]  # kind, axis, sense, s

LAW = settings(max_examples=examples(60), deadline=None)

POINT = st.tuples(st.integers(-20, 20), st.integers(-20, 20))


@st.composite
def chains(draw: st.DrawFn) -> tuple[list[Array], bool]:
    """Control points of Bézier segments that meet, and whether they are run as a loop."""
    counts = draw(st.lists(st.integers(1, 4), min_size=1, max_size=3))
    closed = len(counts) > 1 and draw(st.booleans())
    first = last = draw(POINT)
    segments = []
    for number, count in enumerate(counts):
        inner = draw(st.lists(POINT, min_size=count, max_size=count))
        if closed and number == len(counts) - 1:
            inner[-1] = first
        points = np.array([last, *inner], dtype=float)
        if np.all(points == points[0]):
            points = points[0] + np.array([[0.0, 0.0], [3.0, 5.0], [0.0, 0.0]])
        last = tuple(points[-1])
        segments.append(points * GRID)
    return segments, closed


def track_of(segments: list[Array], closed: bool) -> Track:
    return Track.from_curves([Bezier(points) for points in segments], closed=closed)


def places(points: tuple[TurningPoint, ...]) -> list[Place]:
    return [(p.kind, p.axis, p.sense, p.s) for p in points]


def same(found: list[Place], expected: list[Place], length: float) -> None:
    """Equal as sets of places on a path, that may be a loop; s to rounding."""
    assert len(found) == len(expected)
    rest = list(expected)
    for kind, axis, sense, s in found:
        gaps = [min(abs(s - e[3]), length - abs(s - e[3])) if e[:3] == (kind, axis, sense) else np.inf for e in rest]
        nearest = int(np.argmin(gaps))
        assert gaps[nearest] <= 1e-12 * length
        del rest[nearest]


@LAW
@given(chains(), st.integers(2, 1000))
def test_scaling(chain: tuple[list[Array], bool], factor: int) -> None:
    segments, closed = chain
    track = track_of(segments, closed)
    points = in_order(find_turning_points(track))
    larger = in_order(find_turning_points(track_of([factor * one for one in segments], closed)))
    assert [(p.kind, p.segment, p.axis, p.sense) for p in larger] == [
        (p.kind, p.segment, p.axis, p.sense) for p in points
    ]
    for point, big in zip(points, larger, strict=True):
        assert big.xi == pytest.approx(point.xi, abs=1e-14)
        assert big.position == pytest.approx(factor * point.position, abs=1e-14 * factor)
        assert big.s == pytest.approx(factor * point.s, rel=1e-12)
        for name, power in (("curvature", 1), ("curvature_dot", 2), ("curvature_ddot", 3)):
            check_scaled(getattr(point, name), getattr(big, name), float(factor) ** power, point, power)


def in_order(points: tuple[TurningPoint, ...]) -> list[TurningPoint]:
    """By place, and by axis where several reverse at one place."""
    return sorted(points, key=lambda p: (p.segment, round(p.xi, 9), p.axis))


def check_scaled(small: Any, big: Any, factor: float, point: TurningPoint, power: int) -> None:
    if small is None:
        assert big is None
        return
    size = max(abs(point.curvature or 0.0), 1.0) ** power
    assert big * factor == pytest.approx(small, rel=1e-6, abs=1e-6 * size)


@LAW
@given(chains())
def test_reversal(chain: tuple[list[Array], bool]) -> None:
    """Run backwards, a dwell moves to the other end of its stand-still; all else keeps its place."""
    segments, closed = chain
    track = track_of(segments, closed)
    points = find_turning_points(track)
    backward = find_turning_points(track_of([one[::-1] for one in segments[::-1]], closed))
    expected = [(kind, axis, sense, track.length - s) for kind, axis, sense, s in places(points)]
    same(
        [place for place in places(backward) if place[0] != "dwell"],
        [place for place in expected if place[0] != "dwell"],
        track.length,
    )
    dwells = [sorted((p.axis, p.sense) for p in found if p.kind == "dwell") for found in (points, backward)]
    assert dwells[0] == dwells[1]


@LAW
@given(chains())
def test_rotation_by_a_right_angle(chain: tuple[list[Array], bool]) -> None:
    """(x, y) becomes (-y, x): a maximum of Y is a minimum of X, a maximum of X one of Y."""
    segments, closed = chain
    track = track_of(segments, closed)
    turned = track_of([np.stack([-one[:, 1], one[:, 0]], axis=1) for one in segments], closed)
    mapped = {
        ("X", "max"): ("Y", "max"),
        ("X", "min"): ("Y", "min"),
        ("Y", "max"): ("X", "min"),
        ("Y", "min"): ("X", "max"),
    }
    expected = [(kind, *mapped[axis, sense], s) for kind, axis, sense, s in places(find_turning_points(track))]
    same(places(find_turning_points(turned)), expected, track.length)


@LAW
@given(chains(), st.integers(1, 10).map(lambda power: 2**power))
def test_windows_scale_with_the_path_and_the_tolerance(chain: tuple[list[Array], bool], factor: int) -> None:
    """By powers of two, which round nothing: windows that just meet may be one or two by the last digit."""
    segments, closed = chain
    small, big = track_of(segments, closed), track_of([factor * one for one in segments], closed)
    tolerance = 1e-5
    first = find_windows(small, find_turning_points(small), tolerance)
    second = find_windows(big, find_turning_points(big), factor * tolerance)
    assert [(w.members, w.limited_by) for w in first] == [(w.members, w.limited_by) for w in second]
    for window, wide in zip(first, second, strict=True):
        assert wide.half_length == pytest.approx(factor * window.half_length, rel=1e-3)


@LAW
@given(chains())
def test_exact_arithmetic_agrees(chain: tuple[list[Array], bool]) -> None:
    """Small integers make double roots, cusps and stand-stills, on which both must agree."""
    certificate = certify(track_of(*chain))
    assert certificate.ok, certificate.words
