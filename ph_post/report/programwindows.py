"""The turning points of a part program, and what was done at each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ph_post.analysis import Analysis, analyse
from ph_post.audit.deliver import Delivery
from ph_post.gcode.paths.build import paths_of
from ph_post.gcode.paths.record import ProgramPath
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
)
from ph_post.types import IntArray, Machine, TurningPoint

AXES = "XYZ"


def window_views(delivery: Delivery, machine: Machine, tolerance: float) -> list[View]:
    """Return every turning point of a program as ``inspect`` has it, path by path, with what was done there.

    `line` is that of the program; `tolerance` the ε of the windows [m]. `strategy` is `takeup` where an axis
    gets another lasting offset.
    """
    planned = {one.path.chain: one for one in delivery.windows}
    views: list[View] = []
    for path in paths_of(delivery.before):
        made = planned.get(path.chain)
        analysis = made.analysis if made is not None else analyse(path.path, machine, tolerance)
        for view in _of_path(delivery, path, analysis, made):
            views.append({**view, "index": len(views)})
    return views


def _of_path(
    delivery: Delivery, path: ProgramPath, analysis: Analysis, made: WindowPlan | None
) -> Iterator[View]:
    points = analysis.turning_points
    motion, _ = path.to_motions(np.array([point.s for point in points]))
    lines = delivery.before.motions.block[motion] + 1
    shifted = _shifted(delivery.edits, path, points, motion)
    for view, point, line, carried in zip(
        turning_point_views(analysis), points, lines.tolist(), shifted, strict=True
    ):
        done: View = {"strategy": "none", "profile": None, "crossings": []}
        if made is not None:
            number = window_number(made.plan, point)
            crossings = crossings_at(made.plan, point)
            done = {
                "strategy": strategy_at(made.plan, point),
                "profile": profile_view(None if number is None else made.plan.profiles[number]),
                "crossings": [crossing_view(one) for one in crossings],
            }
        yield {**view, **done, **({"strategy": "takeup"} if carried else {}), "line": line}


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
