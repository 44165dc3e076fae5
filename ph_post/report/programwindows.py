"""The turning points of a part program, and what was done at each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import msgspec
import numpy as np

from ph_post.analysis import Analysis, analyse
from ph_post.audit.deliver import Delivery
from ph_post.gcode.paths.build import paths_of
from ph_post.gcode.paths.record import ProgramPath
from ph_post.gcode.reader.record import AXES
from ph_post.gcode.splice.record import Edits
from ph_post.gcode.splice.windows import WindowPlan
from ph_post.report.views import (
    PASSED,
    View,
    crossing_view,
    crossings_at,
    profile_view,
    strategy_at,
    turning_point_views,
    window_number,
    windows_by_point,
)
from ph_post.types import IntArray, Machine, TurningPoint, Window

MILLION = 10**6

Place = tuple[str, int, int]


def window_views(delivery: Delivery, machine: Machine, tolerance: float) -> list[View]:
    """Return every turning point of a program as ``inspect`` has it, path by path, with what was done there.

    `line` is that of the program; `tolerance` the ε of the windows [m]. `strategy` is `takeup` where an axis
    gets another lasting offset.
    """
    return [place.view for place in turning_places(delivery, machine, tolerance)]


class TurningPlace(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A turning point of a program: the path it is on, itself, its window there, and what is told of it."""

    path: ProgramPath
    point: TurningPoint
    window: Window | None
    view: View


def turning_places(delivery: Delivery, machine: Machine, tolerance: float) -> list[TurningPlace]:
    """Return every turning point of a program, path by path; `tolerance` is the ε of the windows [m]."""
    done = _done(delivery.windows)
    found: list[TurningPlace] = []
    for path in paths_of(delivery.before):
        analysis = analyse(path.path, machine, tolerance)
        windows = windows_by_point(analysis.windows)
        views = _of_path(delivery, path, analysis, done)
        for point, view in zip(analysis.turning_points, views, strict=True):
            told = {**view, "index": len(found)}
            window = windows.get(point.index)
            found.append(TurningPlace(path=path, point=point, window=window, view=told))
    return found


def _done(plans: Sequence[WindowPlan]) -> dict[Place, View]:
    """Tell what plans do at their turning points; a path may have been planned in parts."""
    found: dict[Place, View] = {}
    for made in plans:
        plan = made.plan
        for point, place in zip(plan.turning_points, _places(made.path, plan.turning_points), strict=True):
            number = window_number(plan, point)
            found[place] = {
                "strategy": strategy_at(plan, point),
                "profile": profile_view(None if number is None else plan.profiles[number]),
                "crossings": [crossing_view(one) for one in crossings_at(plan, point)],
            }
    return found


def _places(path: ProgramPath, points: Sequence[TurningPoint]) -> list[Place]:
    """Return where points are on the program: axis, motion, and its share to a millionth."""
    motion, share = path.to_motions(np.array([point.s for point in points]))
    rows = zip(points, motion.tolist(), share.tolist(), strict=True)
    return [(point.axis, number, round(part * MILLION)) for point, number, part in rows]


def _of_path(
    delivery: Delivery, path: ProgramPath, analysis: Analysis, done: Mapping[Place, View]
) -> Iterator[View]:
    points = analysis.turning_points
    places = _places(path, points)
    motion = np.array([number for _, number, _ in places], dtype=np.int64)
    lines = delivery.before.motions.block[motion] + 1
    shifted = _shifted(delivery.edits, path, points, motion)
    rows = zip(turning_point_views(analysis), places, lines.tolist(), shifted, strict=True)
    for view, place, line, carried in rows:
        what = done.get(place, {"strategy": "none", "profile": None, "crossings": []})
        yield {**view, **what, **({"strategy": "takeup"} if carried else {}), "line": line}


def _shifted(
    edits: Edits | None, path: ProgramPath, points: tuple[TurningPoint, ...], motion: IntArray
) -> list[bool]:
    """Whether the lasting offset of the axis that turns changes at each turning point."""
    if edits is None or not edits.amplitude:
        return [False] * len(points)
    lasting = [(stop, shift.axis) for stop in edits.stops for shift in stop.shifts]
    places = path.to_path(
        np.array([stop.motion for stop, _ in lasting], dtype=np.int64),
        np.array([stop.share for stop, _ in lasting]),
    )
    at = {axis: places[[name == axis for _, name in lasting]] for axis in edits.amplitude}
    found = []
    for point, own in zip(points, motion.tolist(), strict=True):
        if point.axis not in edits.amplitude:
            found.append(False)
            continue
        after = min(own + 1, len(edits.offset) - 1)
        column = AXES.index(point.axis)
        carried = edits.offset[own, column] != edits.offset[after, column]
        found.append(bool(carried or (np.abs(at[point.axis] - point.s) < PASSED).any()))
    return found
