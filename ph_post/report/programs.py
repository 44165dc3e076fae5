"""Text and JSON of a compensated part program: its reversals, what was done at each, and the result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from ph_post.api.compensated_program import CompensatedProgram
from ph_post.api.crossed_paths import CrossedPath
from ph_post.api.led_programs import CHORDS_HOLD, OverrideError
from ph_post.api.program_compensation import ProgramCompensation
from ph_post.api.reversals import ProgramReversal
from ph_post.edit.further_write import offset_words
from ph_post.files.check import counted
from ph_post.quantities import millimetres
from ph_post.report.result_line import ResultSummary, summary_view
from ph_post.report.views import View, crossing_view, profile_view, turning_point_views
from ph_post.units import MM

UNCHANGED: Final = "nothing to change"


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


def program_summary(result: ProgramCompensation) -> str:
    """Summarize the changes of a program in one line."""
    name = result.original.name
    if result.already_compensated:
        return f"{name}: already compensated for this machine with these options: unchanged"
    further = [
        f"{plan.axis.name} by {offset_words(plan)}, {counted(plan.added_moves, 'short move')} added"
        for plan in result.shifted.plans
        if plan.shifts or plan.added
    ]
    holes = result.shifted.holes
    if holes.changed:
        offsets = " and ".join(f"{plan.axis.name} by {offset_words(plan)}" for plan in holes.axes)
        cycles = counted(sum(len(one.lines) for one in holes.changes), "empty cycle")
        further.append(f"holes: {offsets}, {cycles} added")
    # A program that is written out is another one, whatever comes after that.
    first = ["written out", *further] if result.expanded else further
    said = changes_summary(result.edited)
    return f"{name}: {'; '.join([*first, *([] if first and said == UNCHANGED else [said])])}"


def changes_summary(delivery: CompensatedProgram) -> str:
    """Summarize what was changed in a program."""
    edits = delivery.edits
    if edits is None or delivery.verdict is None:
        return UNCHANGED
    declared = delivery.declaration
    signs = {axis: "+" if side > 0 else "-" for axis, side in edits.one_sided.items()}
    offsets = [
        f"{axis} by {signs.get(axis, '±')}{millimetres(size)} mm" for axis, size in sorted(edits.amplitude.items())
    ]
    take_ups = [f"{axis} by up to {millimetres(size)} mm" for axis, size in sorted(edits.pulse.items())]
    facts = [f"compensated: {', '.join(offsets)}"] if offsets else []
    facts += [f"backlash taken up: {', '.join(take_ups)}"] if take_ups else []
    added = [counted(declared.crossings, "crossing")] if declared is not None and declared.crossings else []
    stops = 0 if declared is None or declared.led else declared.stops
    added += [counted(stops, "short move")] if stops else []
    added += [counted(declared.dips, "feed dip")] if declared is not None and declared.dips else []
    facts += [f"{', '.join(added)} added"] if added else []
    if declared is not None and declared.led:
        led = counted(declared.led, "stretch", "stretches")
        alone = any(note.startswith(CHORDS_HOLD) for note in declared.notes)
        what = "chords without a lead, which cross backlash," if alone else "lead of the servos"
        facts += [f"{what} written into {led}, up to {millimetres(declared.lead)} mm from the path"]
    return "; ".join(facts)


def program_view(result: ProgramCompensation, outcome: ResultSummary) -> dict[str, Any]:
    """Return what ``convert --json`` prints of a part program; what was not simulated is null."""
    return {
        "windows": window_views(result.places),
        **summary_view(outcome),
        **_edits_view(result.edited),
        "unchanged": result.unchanged,
        "expanded": result.expanded,
        "warnings": list(result.warnings),
    }


def crossed_view(result: CrossedPath, strategy: str, outcome: ResultSummary, warnings: Sequence[str]) -> dict[str, Any]:
    """Return what ``convert --json`` prints of a path's program that crosses on the fly."""
    return {
        "windows": window_views(result.reversals),
        **summary_view(outcome),
        **_edits_view(result.edited),
        "strategy": strategy,
        "other_crossings": [],
        "bias": {},
        "inverse_dynamics": False,
        "friction_led": 0.0,
        "warnings": list(warnings),
    }


def _edits_view(found: CompensatedProgram) -> dict[str, Any]:
    edits, declared = found.edits, found.declaration
    return {
        "carrier": "program",
        "crossings": 0 if declared is None else declared.crossings,
        "stops": 0 if declared is None else declared.stops,
        "dips": 0 if declared is None else declared.dips,
        "offsets": {} if edits is None else {axis: size / MM for axis, size in edits.amplitude.items()},
        "pulses": {} if edits is None else {axis: size / MM for axis, size in edits.pulse.items()},
        "lead": [override_view(one) for one in found.overrides],
        "verified": found.verdict is not None and found.verdict.ok,
    }


def override_view(found: OverrideError) -> dict[str, Any]:
    """Return the errors [mm] of a program with the lead of the servos at a feed override."""
    sizes = {"before": found.before, "after": found.after}
    errors = {name: {"max": one.max / MM, "rms": one.rms / MM} for name, one in sizes.items()}
    return {"override": found.override, **errors}


def undone_view() -> dict[str, Any]:
    """Return what ``convert --undo --json`` prints: as :func:`program_view`, nothing added or simulated.

    What is given back is the original byte for byte, which the hash in the program's head has shown.
    """
    return {
        "windows": [],
        **summary_view(ResultSummary()),
        "carrier": "program",
        "crossings": 0,
        "stops": 0,
        "dips": 0,
        "offsets": {},
        "pulses": {},
        "lead": [],
        "verified": True,
        "unchanged": False,
        "expanded": False,
        "warnings": [],
    }
