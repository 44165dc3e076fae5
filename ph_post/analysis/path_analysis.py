"""The analysis of a path on a machine: turning points, windows and backlash intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import msgspec

from ph_post.analysis.osculating import find_windows
from ph_post.analysis.turning_points import find_turning_points
from ph_post.drive.axes import axis_at
from ph_post.drive.intervals import backlash_interval
from ph_post.geometry.track import Track
from ph_post.types import Axis, BacklashInterval, Machine, Path, TurningPoint, Window

IntervalSource = Callable[[Axis, float, float], tuple[BacklashInterval | None, str]]
"""Function from an axis and its swing X = a sin Ωt, a [m] and Ω [1/s], to the interval, or a reason why none."""


class Analysis(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Result of :func:`analyse`: turning points, windows and backlash intervals.

    `intervals` and `notes` hold one entry a turning point: the backlash interval at the programmed feed on
    the local osculating circle (None where there is none) and a word about it (empty where all is plain).
    """

    path: Path
    machine: Machine | None
    tolerance: float
    track: Track
    turning_points: tuple[TurningPoint, ...]
    windows: tuple[Window, ...]
    intervals: tuple[BacklashInterval | None, ...]
    notes: tuple[str, ...]


class AnalysedPath:
    """What has the `analysis` of a path, and so its reversals."""

    __slots__ = ()

    analysis: Analysis

    @property
    def turning_points(self) -> tuple[TurningPoint, ...]:
        """Every place where an axis reverses, in order along the path."""
        return self.analysis.turning_points

    @property
    def windows(self) -> tuple[Window, ...]:
        """Osculating windows, in order along the path; one may hold several turning points."""
        return self.analysis.windows

    @property
    def intervals(self) -> tuple[BacklashInterval | None, ...]:
        """Backlash interval of each turning point at the programmed feed; None where there is none, or no machine."""
        return self.analysis.intervals


def feed_at(path: Path, point: TurningPoint) -> float:
    """Programmed feed at a turning point [m/s]: the segment's own, or else the path's."""
    own = path.segments[point.segment].feed
    return path.feed if own is None else own


def analyse(
    path: Path, machine: Machine | None, tolerance: float, solve: IntervalSource = backlash_interval
) -> Analysis:
    """Locate every reversal of `path`, its window and its backlash interval.

    Parameters
    ----------
    path : Path
    machine : Machine or None
        Without a machine there are turning points and windows, but no intervals.
    tolerance : float
        ε of the windows [m].
    solve : callable
        Function that returns the interval of an axis on a circle: the solution, or a look-up in a table.
    """
    track = Track(path)
    points = find_turning_points(track)
    found = [_interval(path, machine, point, solve) for point in points]
    return Analysis(
        path=path,
        machine=machine,
        tolerance=tolerance,
        track=track,
        turning_points=points,
        windows=find_windows(track, points, tolerance),
        intervals=tuple(interval for interval, _ in found),
        notes=tuple(note for _, note in found),
    )


def swings(path: Path, points: Iterable[TurningPoint]) -> list[tuple[float, float]]:
    """Amplitude [m] and angular frequency [1/s] of the axis' swing at each smooth turning point."""
    found = (_swing(path, point) for point in points)
    return [swing for swing in found if swing is not None and min(swing) > 0.0]


def _swing(path: Path, point: TurningPoint) -> tuple[float, float] | None:
    """Swing on the osculating circle, of amplitude |normal / curvature|; Ω is 0 where that is a line."""
    if point.curvature is None or point.normal is None:
        return None
    swing, curvature = abs(point.normal), abs(point.curvature)
    if swing * curvature == 0.0:
        return math.inf, 0.0
    return swing / curvature, feed_at(path, point) * curvature


def _interval(
    path: Path, machine: Machine | None, point: TurningPoint, solve: IntervalSource
) -> tuple[BacklashInterval | None, str]:
    """Backlash interval on the osculating circle."""
    swing = _swing(path, point)
    if machine is None or swing is None:
        return None, ""
    if swing[1] == 0.0:
        return None, "no osculating circle: the curvature vanishes here"
    return solve(axis_at(machine.axes[point.axis], point.position), *swing)
