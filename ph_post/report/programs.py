"""Text and JSON of a compensated part program: its reversals, what was done at each, and the result."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from ph_post.analysis.path_analysis import Analysis, analyse
from ph_post.api.programs import CompensatedProgram, Performance, ProgramOutcome
from ph_post.compensate.strategies.registry import PLAIN, TAKE_UP
from ph_post.edit.edits import Edits
from ph_post.edit.window_plans import WindowPlan
from ph_post.files.check import counted
from ph_post.gcode.paths import ProgramPath, paths_of
from ph_post.gcode.program import AXES, Motions, PartProgram
from ph_post.report.simulations import error_view
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
from ph_post.types import Array, BoolArray, IntArray, Machine, TurningPoint, Window
from ph_post.units import MM

MILLION = 10**6

STILL = 1e-9
"""What differs by no more [m] is the same: a place of an axis, or an offset."""

Place = tuple[str, int, int]


def window_views(delivery: CompensatedProgram, machine: Machine, tolerance: float) -> list[View]:
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


def turning_places(delivery: CompensatedProgram, machine: Machine, tolerance: float) -> list[TurningPlace]:
    """Return every turning point of a program, path by path; `tolerance` is the ε of the windows [m]."""
    done, edits = _done(delivery.windows), delivery.edits
    changes = None if edits is None or not edits.amplitude else _changes_of(edits)
    found: list[TurningPlace] = []
    for path in paths_of(delivery.before):
        analysis = analyse(path.path, machine, tolerance)
        windows = windows_by_point(analysis.windows)
        views = _of_path(delivery, path, analysis, done, changes)
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


class _Changes(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Where the lasting offsets of a program change.

    `motion`, `share` and `column` (n,) of the stops that do it, one a shift, in order of travel; `carried`
    (m, 3) whether a motion, a rapid, does it on its way.
    """

    axes: tuple[str, ...]
    motion: IntArray
    share: Array
    column: IntArray
    carried: BoolArray


def _changes_of(edits: Edits) -> _Changes:
    rows = np.array(
        [
            (stop.motion, stop.share, AXES.index(shift.axis), shift.travel)
            for stop in edits.stops
            for shift in stop.shifts
        ]
    )
    motion, share, column, travel = rows.reshape(-1, 4).T
    at = motion.astype(np.int64), column.astype(np.int64)
    steps = np.diff(edits.offset, axis=0, prepend=0.0)
    np.subtract.at(steps, at, travel)
    return _Changes(axes=tuple(edits.amplitude), motion=at[0], share=share, column=at[1], carried=np.abs(steps) > STILL)


def _of_path(
    delivery: CompensatedProgram,
    path: ProgramPath,
    analysis: Analysis,
    done: Mapping[Place, View],
    changes: _Changes | None,
) -> Iterator[View]:
    places = _places(path, analysis.turning_points)
    motion = np.array([number for _, number, _ in places], dtype=np.int64)
    lines = delivery.before.motions.block[motion] + 1
    shifted = _shifted(changes, delivery.before.motions, path, analysis.turning_points, places)
    rows = zip(turning_point_views(analysis), places, lines.tolist(), shifted, strict=True)
    for view, place, line, carried in rows:
        what = done.get(place, {"strategy": PLAIN, "profile": None, "crossings": []})
        yield {**view, **what, **({"strategy": TAKE_UP} if carried else {}), "line": line}


def _shifted(
    changes: _Changes | None,
    motions: Motions,
    path: ProgramPath,
    points: tuple[TurningPoint, ...],
    places: Sequence[Place],
) -> list[bool]:
    """Whether the lasting offset of the axis that turns changes at each turning point.

    Of one at which the axis rested that may be anywhere in the rest, at whose end it is listed.
    """
    if changes is None or not points:
        return [False] * len(points)
    own = slice(*np.searchsorted(changes.motion, (path.motion[0], path.motion[-1] + 1)).tolist())
    at, column = path.to_path(changes.motion[own], changes.share[own]), changes.column[own]
    left_off = {name: _left_off(motions, path, AXES.index(name)) for name in changes.axes}
    found = []
    for point, (name, motion, share) in zip(points, places, strict=True):
        if name not in changes.axes:
            found.append(False)
            continue
        begin, low = motion, point.s
        if point.kind == "dwell":
            begin = left_off[name][motion]
            low = float(path.to_path(np.array([begin]), np.ones(1))[0])
        stops = (column == AXES.index(name)) & (at > low - PASSED) & (at < point.s + PASSED)
        leaves = motion + 2 if share == MILLION else begin + 1
        found.append(bool(stops.any() or changes.carried[begin + 1 : leaves, AXES.index(name)].any()))
    return found


def _left_off(motions: Motions, path: ProgramPath, column: int) -> dict[int, int]:
    """Tell of the motions of a path which was the last up to there that moved an axis; maybe itself."""
    moves = np.abs(motions.end[path.motion, column] - motions.start[path.motion, column]) > STILL
    last = np.maximum.accumulate(np.where(moves, np.arange(moves.size), 0))
    return dict(zip(path.motion.tolist(), path.motion[last].tolist(), strict=True))


def program_lines(
    delivery: CompensatedProgram, outcome: ProgramOutcome | None, products: Iterable[str]
) -> Iterator[str]:
    """Say what was changed, what was left alone, and what was written where, a line each."""
    yield program_summary(delivery, outcome)
    for warning in warnings_of(delivery):
        yield f"warning: {warning}"
    yield from files_written_lines(products)


def program_summary(delivery: CompensatedProgram, outcome: ProgramOutcome | None) -> str:
    """Say in one line what was changed."""
    name = delivery.before.name
    if delivery.done:
        return f"{name}: compensated already for this machine, with these options: kept as it is"
    return f"{name}: {_changes(delivery)}{_times(delivery, outcome)}"


def files_written_lines(products: Iterable[str]) -> Iterator[str]:
    """Name the files that were written."""
    return (f"wrote {product}" for product in products if product != "-")


def warnings_of(delivery: CompensatedProgram) -> tuple[str, ...]:
    """All that was left alone or has to be known, stretches that are passed through first."""
    edits = () if delivery.edits is None else delivery.edits.warnings
    return (*(note_words(delivery.before)), *edits)


def note_words(program: PartProgram) -> Iterator[str]:
    """Name the stretches of a program that are passed through as they are."""
    for note in program.notes:
        lines = f"{note.first + 1}" if note.first == note.last else f"{note.first + 1} to {note.last + 1}"
        yield f"{program.name}:{lines}: {note.what}: passed through unchanged"


def _changes(delivery: CompensatedProgram) -> str:
    edits = delivery.edits
    if edits is None or delivery.verdict is None:
        return "nothing to change"
    told = delivery.declaration
    facts = [counted(told.stops, "stop")] if told is not None and told.stops else []
    facts += [counted(told.dips, "feed dip")] if told is not None and told.dips else []
    facts += [f"{axis} carries {size / MM:.4g} mm" for axis, size in sorted(edits.amplitude.items())]
    facts += [f"{axis} goes out and back by up to {size / MM:.4g} mm" for axis, size in sorted(edits.pulse.items())]
    return ", ".join(facts)


def _times(delivery: CompensatedProgram, outcome: ProgramOutcome | None) -> str:
    if outcome is None:
        return ""
    apart = ", not counting what is passed through" if delivery.before.notes else ""
    return f"; cycle time {outcome.before.time:.3f} s before, {outcome.after.time:.3f} s after{apart}"


def program_view(
    delivery: CompensatedProgram, machine: Machine, tolerance: float, outcome: ProgramOutcome | None
) -> dict[str, Any]:
    """Return what ``convert --json`` prints of a part program; what was not simulated is null."""
    edits, told = delivery.edits, delivery.declaration
    sides: dict[str, Performance | None] = {"before": None, "after": None}
    if outcome is not None:
        sides = {"before": outcome.before, "after": outcome.after}
    return {
        "windows": window_views(delivery, machine, tolerance),
        "cycle_time": {side: None if one is None else one.time for side, one in sides.items()},
        "error": {side: None if one is None else error_view(one.error) for side, one in sides.items()},
        "carrier": "program",
        "stops": 0 if told is None else told.stops,
        "dips": 0 if told is None else told.dips,
        "offsets": {} if edits is None else {axis: size / MM for axis, size in edits.amplitude.items()},
        "pulses": {} if edits is None else {axis: size / MM for axis, size in edits.pulse.items()},
        "verified": delivery.verdict is not None and delivery.verdict.ok,
        "unchanged": delivery.after.data == delivery.before.data,
        "warnings": list(warnings_of(delivery)),
    }


def undone_view() -> dict[str, Any]:
    """Return what ``convert --undo --json`` prints: as :func:`program_view`, nothing added or simulated.

    What is given back is the original byte for byte, which the hash in the program's head has shown.
    """
    return {
        "windows": [],
        "cycle_time": {"before": None, "after": None},
        "error": {"before": None, "after": None},
        "carrier": "program",
        "stops": 0,
        "dips": 0,
        "offsets": {},
        "pulses": {},
        "verified": True,
        "unchanged": False,
        "warnings": [],
    }
