"""The one line that every command ends with: what compensation made of a motion, and first what it left out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.analysis.path_analysis import Analysis
from ph_post.api.compensated_program import CompensatedProgram
from ph_post.api.further_axes import FurtherError, ShiftedJob
from ph_post.api.led_programs import CHORDS_HOLD
from ph_post.api.outcomes import Compensation, left_words, passed_through
from ph_post.api.path_compensation import PathCompensation
from ph_post.api.program_compensation import ProgramCompensation
from ph_post.api.results import (
    AxisReversals,
    MotionResult,
    PlannedMotion,
    ProgramMotion,
    ReversalCount,
    plan_reversals,
)
from ph_post.api.reversals import ProgramReversal, coarse_words, count_program_reversals
from ph_post.bounds import LONGEST_SIMULATED
from ph_post.compensate.friction import friction_of_machine
from ph_post.compensate.options import PlanOutput
from ph_post.dialects.declaration import read_declaration
from ph_post.drive.axes import backlash_uncertainties
from ph_post.errors import InputError, PhPostError
from ph_post.files.check import counted
from ph_post.gcode.paths import places_words
from ph_post.gcode.program import AXES, PartProgram
from ph_post.quantities import rounded_micrometres, rounded_seconds
from ph_post.report.views import error_view, plan_view
from ph_post.simulate.contour import ContourError
from ph_post.simulate.controllers.moves import moved_axes
from ph_post.types import ROTARY_AXES, Command, Machine, Plan
from ph_post.units import DEGREE, MINUTE, MM

LEFT_EARLY: Final = 0.5
"""Part of the largest error before; where more is left of it, with all reversals compensated, its lines are named."""

HIDING: Final = 1.1
"""Times the backlash error that the error by all causes is before it is said beside it."""

GROWN: Final = 1.02
"""Times the largest backlash error before that it is afterwards before the error by all causes is said beside it."""

FRICTION_AND_LAG: Final = "friction and lag"


class ResultSummary(msgspec.Struct, frozen=True, kw_only=True):
    """A motion before and after compensation.

    `time` before and after [s]; `error` by all causes and `error_gap` what backlash adds, before and after;
    `error_worst` the first of the compensated motion on the worst machine that the file leaves possible;
    `error_gap_worst` that of the compensated motion if the backlash of each axis is off by its relative `uncertainty`.
    What was not simulated, or cannot be, is None. `axes` are compensated, `reversals` counts those of axes with
    backlash, None where that is not known. `left` says what is not compensated, and what would change that; `trouble`
    why nothing could be simulated. `alone` where both motions are one, and nothing is compared.
    `sides` are the largest distances to the left and to the right of the path before and after [m], and `part_side` 1
    where the part is on the left, -1 where it is on the right. `leads` names what the compensated motion leads, and
    friction even where that is left; empty where nothing: what backlash alone adds hides behind that before, and the
    error by all causes is said too.
    `further` are axes beside X, Y and Z, `holes` X and Y at the holes of drilling cycles. `early` is the line, from 1,
    up to which the largest error is left though all reversals are compensated, and what backlash adds behind it.
    `unknown` names the lines of cuts that are in no error, as the places or sides of the axes are not known there.
    """

    time: tuple[float, float] | None = None
    error: tuple[ContourError | None, ContourError | None] = (None, None)
    error_worst: ContourError | None = None
    error_gap: tuple[ContourError | None, ContourError | None] = (None, None)
    error_gap_worst: ContourError | None = None
    uncertainty: Mapping[str, float] = {}
    axes: tuple[str, ...] = ()
    reversals: ReversalCount | None = None
    left: str = ""
    trouble: str = ""
    alone: bool = False
    sides: tuple[tuple[float, float] | None, tuple[float, float] | None] = (None, None)
    part_side: int = 0
    leads: str = ""
    further: tuple[FurtherError, ...] = ()
    holes: tuple[FurtherError, ...] = ()
    early: tuple[int, ContourError] | None = None
    unknown: str = ""


def summarize(result: Compensation, output: PlanOutput | None = None, *, simulated: bool = True) -> ResultSummary:
    """Summarize the result of a compensation.

    Parameters
    ----------
    result : Compensation
    output : "program" or "table", optional
        That of a path which is meant, in place of the result's own.
    simulated : bool, optional
        Whether errors and times are found by simulation; else they are None.
    """
    path = result.longest if isinstance(result, ProgramCompensation) and result.output == "table" else result
    if isinstance(path, PathCompensation):
        output = output or path.output
        rows, warnings = path.count(output), path.reasons(output)
        found = _simulated(*path.motions(output), path.machine, path.analysis.path.axes) if simulated else None
        crossed = path.crossed_for(output)
        leads = _led(path.plan(output)) if crossed is None else _led_in_program(crossed.edited)
        leads = _with_friction(leads, path.machine, path.analysis.path.axes)
        found = msgspec.structs.replace(found or ResultSummary(), leads=leads)
        notes = path.notes
    else:
        assert isinstance(path, ProgramCompensation)
        rows, notes, warnings = path.axis_reversals, path.passed_through, path.reasons
        moved = moved_axes(path.original)
        found = _simulated(path.before, path.after, path.machine, moved) if simulated else None
        leads = _with_friction(_led_in_program(path.edited), path.machine, moved)
        side = path.options.editing.part_side
        found = msgspec.structs.replace(
            found or ResultSummary(),
            part_side=side,
            leads=leads,
            further=path.shifted.errors,
            holes=path.shifted.hole_errors,
        )
    shifted = _shifted(path.edited) if isinstance(path, ProgramCompensation) else ()
    found = _counted(found or ResultSummary(), rows, warnings, notes, shifted, path.options.chosen_strategy)
    if isinstance(path, ProgramCompensation) and isinstance(path.after, ProgramMotion):
        return _with_places(found, path.after, path.places)
    return found


def _with_places(found: ResultSummary, after: ProgramMotion, reversals: Sequence[ProgramReversal]) -> ResultSummary:
    """Add where in the program an error is not known, and up to which line a large one is left."""
    if found.error_gap[0] is None:
        return found
    unknown = places_words(after.original, after.uncounted_lines)
    return _with_early(msgspec.structs.replace(found, unknown=unknown), after, reversals)


def _with_early(found: ResultSummary, after: ProgramMotion, reversals: Sequence[ProgramReversal]) -> ResultSummary:
    """Add the line up to which a large error is left though all reversals are compensated, and what is left behind it.

    An axis comes onto a known side of its backlash at the first cut, or where it first turns back: a line at feed that
    only goes there, through the air, keeps its error.
    """
    before, now = found.error_gap
    if found.left or before is None or now is None or not found.axes or now.max <= LEFT_EARLY * before.max:
        return found
    motion = after.last_motion_off(LEFT_EARLY * now.max)
    line = int(after.original.line_numbers(np.array([motion]))[0])
    if motion < 0 or any(one.line < line for one in reversals):
        return found
    behind = after.error_gap_behind(motion)
    if behind is None or behind.max > LEFT_EARLY * now.max:
        return found
    return msgspec.structs.replace(found, early=(line, behind))


def summarize_plans(
    before: PlannedMotion, after: PlannedMotion, notes: tuple[str, ...] = (), warnings: Sequence[str] | None = None
) -> ResultSummary:
    """Summarize two planned motions along one path, or one that is given twice.

    Parameters
    ----------
    before, after : PlannedMotion
    notes : tuple of str, optional
        Parts of a part program that the path does not show.
    warnings : sequence of str, optional
        In place of those of the plan.
    """
    plan = after.plan
    found = summarize_motions(before, after, plan.machine, plan.path.axes)
    found = msgspec.structs.replace(found, alone=before is after, leads=_led(plan))
    rows = plan_reversals(after.analysis.track, plan)
    return _counted(found, rows, plan.warnings if warnings is None else warnings, notes)


def _simulated(before: MotionResult, after: MotionResult, machine: Machine, axes: Iterable[str]) -> ResultSummary:
    """Simulate two motions; where that is too large or fails, say why: the program does not depend on it."""
    try:
        return summarize_motions(before, after, machine, axes)
    except MemoryError:
        return ResultSummary(trouble="it needs more memory than there is")
    except InputError as error:
        # The line is of one file, whose name need not be said again.
        return ResultSummary(trouble=str(error).removeprefix(f"{error.where}: "))
    except PhPostError as error:
        return ResultSummary(trouble=str(error))


def summarize_program(
    found: CompensatedProgram,
    before: ProgramMotion,
    after: ProgramMotion,
    reversals: Sequence[ProgramReversal],
    shifted: ShiftedJob | None = None,
) -> ResultSummary:
    """Summarize a compensated program, of which the reversals are known; of one compensated before they are not.

    `shifted` has what was compensated before X, Y and Z.
    """
    machine = before.machine
    summary = summarize_motions(before, after, machine, moved_axes(found.before))
    if found.done:
        return msgspec.structs.replace(summary, axes=declared_axes(found.after))
    rows = count_program_reversals(reversals, machine)
    warnings = (*found.warnings, *coarse_words(reversals, found.edits))
    if shifted is not None:
        rows, warnings = shifted.with_reversals(rows), (*warnings, *shifted.warnings)
        summary = msgspec.structs.replace(summary, further=shifted.errors, holes=shifted.hole_errors)
    notes = passed_through(found.before, machine.dialect)
    summary = _counted(summary, rows, warnings, notes, _shifted(found))
    return _with_places(summary, after, reversals)


def declared_axes(program: PartProgram) -> tuple[str, ...]:
    """Name the axes that a program declares as compensated."""
    declaration = read_declaration(program.data)
    return () if declaration is None else tuple(sorted({*declaration.offset, *declaration.pulse}))


def _shifted(found: CompensatedProgram) -> tuple[str, ...]:
    """Name the axes that carry offsets in a program."""
    return () if found.declaration is None else tuple(found.declaration.offset)


def _counted(
    found: ResultSummary,
    rows: Sequence[AxisReversals],
    warnings: Sequence[str],
    notes: tuple[str, ...],
    shifted: Sequence[str] = (),
    strategy: str = "auto",
) -> ResultSummary:
    """Add to the errors and times of a summary which reversals are compensated.

    An axis that is `shifted` is compensated, also where nobody knows that it reversed before, or it never does.
    """
    axes = {*(row.axis for row in rows if row.compensated), *shifted}
    return msgspec.structs.replace(
        found,
        axes=tuple(sorted(axes, key=lambda axis: (axis not in AXES, axis))),
        reversals=ReversalCount(compensated=sum(row.compensated for row in rows), all=sum(row.all for row in rows)),
        left=left_words(rows, warnings, notes, strategy),
    )


def summarize_motions(
    before: MotionResult, after: MotionResult, machine: Machine, axes: Iterable[str]
) -> ResultSummary:
    """Summarize the errors and times of two motions of some axes of a machine."""
    return ResultSummary(
        time=(before.time, after.time),
        error=(before.error, after.error),
        error_worst=after.error_worst,
        error_gap=(before.error_gap, after.error_gap),
        error_gap_worst=after.error_gap_worst,
        sides=(before.sides, after.sides),
        uncertainty=backlash_uncertainties(machine, axes),
    )


def result_lines(found: ResultSummary) -> list[str]:
    """Return the line of the result, and before it the one of what is not compensated, if anything is.

    Examples
    --------
    >>> def size(largest, rms):
    ...     return ContourError(max=largest, rms=rms)
    >>> summary = ResultSummary(
    ...     time=(48.51, 49.22),
    ...     error_gap=(size(47e-6, 24e-6), size(2e-6, 0.3e-6)),
    ...     error_gap_worst=size(7e-6, 3e-6),
    ...     uncertainty={"X": 0.2, "Y": 0.2},
    ...     axes=("X", "Y", "Z"),
    ...     reversals=ReversalCount(42, 42),
    ... )
    >>> for line in result_lines(summary):
    ...     print(line)
    backlash error 47 → 2 µm max (7 if the backlash is 20 % off), 24 → 0.3 µm rms; 48.5 → 49.2 s; \
X, Y, Z compensated, 42 of 42 reversals
    """
    parts = [_error_words(found), *_unknown_words(found), *_early_words(found)]
    if found.time is not None:
        before, after = rounded_seconds(*found.time)
        parts += [f"into the part {_into_part(found)}"] if _into_part(found) else []
        parts.append(f"{after} s" if found.alone else f"{before} → {after} s")
    parts += [_further_words(one) for one in found.further]
    parts += [f"holes {_further_words(one)}" for one in found.holes]
    parts += [words for words in [_axis_words(found), *_whole_error_words(found)] if words]
    said = [f"NOT COMPENSATED: {found.left}"] if found.left else []
    return [*said, "; ".join(parts)]


def _unknown_words(found: ResultSummary) -> list[str]:
    """Say which cuts are in no error."""
    if not found.unknown:
        return []
    return [f"without {found.unknown}, where nobody knows where an axis is, or on which side of its backlash"]


def _early_words(found: ResultSummary) -> list[str]:
    """Say up to which line a large error is left."""
    if found.early is None:
        return []
    line, behind = found.early
    return [
        f"the largest is left up to line {line}, where nobody knows yet on which side of its backlash an axis is;"
        f" {rounded_micrometres(behind.max)} µm max behind it"
    ]


def _led(plan: Plan) -> str:
    """Name what the command of a table leads."""
    if not plan.inverse_dynamics:
        return ""
    return FRICTION_AND_LAG if plan.friction_part > 0.0 else "lag"


def _with_friction(leads: str, machine: Machine, axes: Iterable[str]) -> str:
    """Return what a motion leads, with the friction of the machine's axes, which is in the error led or not."""
    return FRICTION_AND_LAG if friction_of_machine(machine, [one for one in axes if one in machine.axes]) else leads


def _led_in_program(found: CompensatedProgram) -> str:
    """Name what a program leads."""
    declared = found.declaration or read_declaration(found.after.data)
    if declared is None or not declared.led:
        return ""
    if any(note.startswith(CHORDS_HOLD) for note in declared.notes):
        return ""
    return max((_led(one.plan) for one in found.windows), key=len, default="lag")


def _whole_error_words(found: ResultSummary) -> list[str]:
    """Say what the error by all causes is, where the command leads some and they are more than the backlash.

    Also where backlash adds more than before: a backlash may undo some of what the drive does, as an overshoot, and the
    plan was judged by all causes.
    """
    (before, after), (gap, gap_after) = found.error, found.error_gap
    if before is None or after is None:
        return []
    hidden = bool(found.leads) and (gap is None or before.max > HIDING * gap.max)
    grown = gap is not None and gap_after is not None and gap_after.max > GROWN * gap.max
    if not (hidden or grown):
        return []
    largest, broad = (
        ("" if found.alone else f"{rounded_micrometres(first)} → ") + rounded_micrometres(last)
        for first, last in ((before.max, after.max), (before.rms, after.rms))
    )
    # Where an axis with an integrator rests friction decides by less than a micrometre which way it pushes at last.
    size = found.error_worst
    worst = size is not None and size.max > HIDING * after.max
    most = f" ({rounded_micrometres(size.max)} in the worst case of the machine file)" if worst and size else ""
    causes = f"error with {found.leads}" if found.leads else "error by all causes"
    return [f"{causes} {largest} µm max{most}, {broad} µm rms"]


def _into_part(found: ResultSummary) -> str:
    """Say how far the table cuts into the part, where the part's side is known."""
    before, after = found.sides
    if not found.part_side or before is None or after is None:
        return ""
    side = 0 if found.part_side > 0 else 1
    return f"{rounded_micrometres(before[side])} → {rounded_micrometres(after[side])} µm"


def _error_words(found: ResultSummary) -> str:
    before, after = found.error_gap
    if before is None or after is None:
        if found.time is None:
            return "backlash error not simulated" + (f": {found.trouble}" if found.trouble else "")
        long = max(found.time) > LONGEST_SIMULATED
        why = (
            f"it runs longer than {LONGEST_SIMULATED / MINUTE:.0f} min"
            if long
            else "no cut is left in which it counts: too short, or passed through unchanged"
        )
        return f"backlash error not simulated, as {why}"
    high, low = (rounded_micrometres(one) for one in (after.max, after.rms))
    if not found.alone:
        high, low = f"{rounded_micrometres(before.max)} → {high}", f"{rounded_micrometres(before.rms)} → {low}"
    worst = ""
    if found.error_gap_worst is not None and (off := off_words(found.uncertainty)):
        worst = f" ({rounded_micrometres(found.error_gap_worst.max)} if the backlash is {off} off)"
    return f"backlash error {high} µm max{worst}, {low} µm rms"


def off_words(uncertainty: Mapping[str, float]) -> str:
    """Say by how much the backlash of axes may be off; empty where it is known exactly.

    Examples
    --------
    >>> off_words({"X": 0.2, "Y": 0.2}), off_words({"X": 0.05, "Y": 0.2}), off_words({"X": 0.0})
    ('20 %', 'X 5 %, Y 20 %', '')
    """
    sizes = {name: f"{100.0 * size:.2g} %" for name, size in uncertainty.items() if size > 0.0}
    if len(set(sizes.values())) == 1 and len(sizes) == len(uncertainty):
        return next(iter(sizes.values()))
    return ", ".join(f"{name} {size}" for name, size in sizes.items())


def _axis_words(found: ResultSummary) -> str:
    if found.reversals is None:
        return f"{', '.join(found.axes)} compensated" if found.axes else ""
    if not found.reversals.all:
        # What is passed through may have any.
        return "" if found.trouble or found.left else "no axis with backlash reverses"
    done = f"{', '.join(found.axes)} compensated" if found.axes else "no axis compensated"
    return f"{done}, {found.reversals.compensated} of {counted(found.reversals.all, 'reversal')}"


def _further_unit(axis: str) -> tuple[str, float]:
    return ("deg", DEGREE) if axis in ROTARY_AXES else ("mm", MM)


def _further_words(found: FurtherError) -> str:
    """Say in its own unit how far an axis beside X, Y and Z is off."""
    unit, scale = _further_unit(found.axis)
    before, after, worst = (f"{round(one.max / scale, 5):g}" for one in (found.before, found.after, found.after_worst))
    return f"{found.axis} {before} → {after} {unit} max ({worst} if its backlash is off)"


def _further_view(found: FurtherError) -> dict[str, Any]:
    unit, scale = _further_unit(found.axis)
    sizes = {"before": found.before, "after": found.after, "after_worst": found.after_worst}
    errors = {name: {"max": one.max / scale, "rms": one.rms / scale} for name, one in sizes.items()}
    return {"unit": unit, **errors, "reversals": {"compensated": found.done, "all": found.reversals}}


def summary_view(found: ResultSummary) -> dict[str, Any]:
    """Return a summary as INTERFACE has it in JSON: lengths in mm, times in s, null for what does not exist."""
    before, after = (error_view(one) for one in found.error_gap)
    times = (None, None) if found.time is None else found.time
    return {
        "cycle_time": dict(zip(("before", "after"), times, strict=True)),
        "error": dict(zip(("before", "after"), map(error_view, found.error), strict=True)),
        "error_gap": {"before": before, "after": after, "after_worst": error_view(found.error_gap_worst)},
        "error_sides": dict(zip(("before", "after"), map(_sides, found.sides), strict=True)),
        "error_early": None if found.early is None else {"line": found.early[0], "behind": error_view(found.early[1])},
        "error_unknown": found.unknown or None,
        "part_side": {1: "left", -1: "right"}.get(found.part_side),
        "reversals": None if found.reversals is None else found.reversals._asdict(),
        "axes": list(found.axes),
        "further_axes": {one.axis: _further_view(one) for one in found.further},
        "holes": {one.axis: _further_view(one) for one in found.holes},
        "not_compensated": found.left or None,
        "not_simulated": found.trouble or None,
        "result_line": result_lines(found)[-1],
    }


def plan_result_view(analysis: Analysis, plan: Plan, command: Command, found: ResultSummary) -> dict[str, Any]:
    """Return what ``convert --json`` prints of a plan and its result; the times are the plan's."""
    view = plan_view(analysis, plan, command)
    return {**view, **summary_view(found), "cycle_time": view["cycle_time"]}


def _sides(found: tuple[float, float] | None) -> dict[str, float] | None:
    return None if found is None else {"left": found[0] / MM, "right": found[1] / MM}
