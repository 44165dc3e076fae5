"""Text and JSON of a compensated part program: its reversals, what was done at each, and the result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ph_post.api.compensation import ProgramCompensation
from ph_post.api.programs import CompensatedProgram
from ph_post.api.reversals import ProgramReversal
from ph_post.files.check import counted
from ph_post.quantities import before_and_after, micrometres, millimetres, seconds
from ph_post.report.simulations import error_view
from ph_post.report.views import View, crossing_view, profile_view, turning_point_views
from ph_post.units import MM


def window_views(reversals: Sequence[ProgramReversal]) -> list[View]:
    """Return the reversals of a program as ``inspect`` has turning points, with what was done at each.

    `line` is the program's. `strategy` is `takeup` where an axis gets another lasting offset.
    """
    views: dict[int, list[View]] = {}
    for one in reversals:
        if id(one.analysis) not in views:
            views[id(one.analysis)] = turning_point_views(one.analysis)
    return [
        {
            **views[id(one.analysis)][one.point.index],
            "strategy": one.strategy,
            "profile": profile_view(one.profile),
            "crossings": [crossing_view(crossing) for crossing in one.crossings],
            "line": one.line,
            "index": number,
        }
        for number, one in enumerate(reversals)
    ]


def program_summary(result: ProgramCompensation, *, timed: bool, simulated: bool = False) -> str:
    """Summarize in one line the errors of the part if `simulated`, the changes, and the times if `timed`."""
    name = result.original.name
    if result.already_compensated:
        return f"{name}: already compensated for this machine with these options: unchanged"
    parts = [_changes(result.edited)]
    if simulated and result.before.error is not None and result.after.error is not None:
        sizes = before_and_after(result.before.error.max, result.after.error.max, micrometres, "µm")
        parts.insert(0, f"largest error {sizes}")
    if timed:
        apart = ", without the stretches passed through" if result.original.notes else ""
        parts.append(f"cycle time {before_and_after(result.before.time, result.after.time, seconds, 's')}{apart}")
    return f"{name}: {'; '.join(parts)}"


def _changes(delivery: CompensatedProgram) -> str:
    edits = delivery.edits
    if edits is None or delivery.verdict is None:
        return "nothing to change"
    declared = delivery.declaration
    offsets = [f"{axis} by ±{millimetres(size)} mm" for axis, size in sorted(edits.amplitude.items())]
    take_ups = [f"{axis} by up to {millimetres(size)} mm" for axis, size in sorted(edits.pulse.items())]
    facts = [f"compensated: {', '.join(offsets)}"] if offsets else []
    facts += [f"backlash taken up: {', '.join(take_ups)}"] if take_ups else []
    added = [counted(declared.stops, "stop")] if declared is not None and declared.stops else []
    added += [counted(declared.dips, "feed dip")] if declared is not None and declared.dips else []
    facts += [f"{' and '.join(added)} added"] if added else []
    return "; ".join(facts)


def program_view(result: ProgramCompensation, simulated: bool) -> dict[str, Any]:
    """Return what ``convert --json`` prints of a part program; what was not `simulated` is null."""
    edits, told = result.edited.edits, result.edited.declaration
    sides = {"before": result.before, "after": result.after} if simulated else dict.fromkeys(("before", "after"))
    return {
        "windows": window_views(result.places),
        "cycle_time": {side: None if one is None else one.time for side, one in sides.items()},
        "error": {side: None if one is None else error_view(one.error) for side, one in sides.items()},
        "carrier": "program",
        "stops": 0 if told is None else told.stops,
        "dips": 0 if told is None else told.dips,
        "offsets": {} if edits is None else {axis: size / MM for axis, size in edits.amplitude.items()},
        "pulses": {} if edits is None else {axis: size / MM for axis, size in edits.pulse.items()},
        "verified": result.verdict is not None and result.verdict.ok,
        "unchanged": result.unchanged,
        "warnings": list(result.warnings),
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
