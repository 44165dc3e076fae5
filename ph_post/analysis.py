"""From a path and a machine to what would happen at every reversal: turning points, windows, intervals."""

from __future__ import annotations

import msgspec

from ph_post.drive.interval import backlash_interval
from ph_post.geometry.track import Track
from ph_post.osculating import find_windows
from ph_post.turning import find_turning_points
from ph_post.types import BacklashInterval, Machine, Path, TurningPoint, Window


class Analysis(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What :func:`analyse` found.

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


def feed_at(path: Path, point: TurningPoint) -> float:
    """Programmed feed at a turning point [m/s]: the segment's own, or else the path's."""
    own = path.segments[point.segment].feed
    return path.feed if own is None else own


def analyse(path: Path, machine: Machine | None, tolerance: float) -> Analysis:
    """Locate every reversal of `path`, its window and its backlash interval.

    Parameters
    ----------
    path : Path
    machine : Machine or None
        Without a machine there are turning points and windows, but no intervals.
    tolerance : float
        ε of the windows [m].
    """
    track = Track(path)
    points = find_turning_points(track)
    found = [_interval(path, machine, point) for point in points]
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


def _interval(
    path: Path, machine: Machine | None, point: TurningPoint
) -> tuple[BacklashInterval | None, str]:
    """Settled backlash interval on the osculating circle, whose axis swings with |normal / curvature|."""
    if machine is None or point.curvature is None or point.normal is None:
        return None, ""
    swing = abs(point.normal)
    curvature = abs(point.curvature)
    if swing * curvature == 0.0:
        return None, "no osculating circle: the curvature vanishes here"
    omega = feed_at(path, point) * curvature
    return backlash_interval(machine.axes[point.axis], swing / curvature, omega)
