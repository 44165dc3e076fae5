"""Results of simulations and comparisons as plain objects for JSON and as tables for a terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import msgspec

from ph_post.api.comparison import StrategyComparison
from ph_post.api.motion import Simulation
from ph_post.api.results import PlannedMotion
from ph_post.compensate.comparison import Contender
from ph_post.compensate.motion import without_strategy
from ph_post.compensate.strategies.registry import PLAIN, find_traits
from ph_post.quantities import NOTHING, micrometres, millimetres, seconds
from ph_post.report.result_line import ResultSummary, result_lines, summarize, summarize_plans, summary_view
from ph_post.report.tables import chosen_words, format_table
from ph_post.report.views import View, error_view
from ph_post.simulate.assess import Assessment, scenario_words
from ph_post.simulate.contour import ContourError, TurningError
from ph_post.types import Event, EventKind, Scenario, TurningPoint
from ph_post.units import MM, MM_PER_MIN

COLUMN_NOTES = (
    "error, rms: for the values of the machine file; worst: the worst case within its uncertainties",
    "slowest: lowest feed while cutting, standstills and their ramps excluded",
)
"""Meaning of the columns of the comparison."""


REMEDY: Final = "--strategy auto, or `convert`, compensates them"
"""What would change that a plain program is not compensated."""


def scenario_view(scenario: Scenario) -> View:
    """Return a scenario; null is what the machine file says."""
    return msgspec.structs.asdict(scenario) | {"opposite": list(scenario.opposite)}


def simulation_view(found: Simulation) -> View:
    """Return what ``simulate --json`` prints; errors are null where no path is known."""
    run, assessment, points = found.run, found.assessment, found.turning_points
    view: View = {
        "cycle_time": float(run.t[-1]),
        "error": None,
        "error_gap": None,
        "error_worst": None,
        "per_turning_point": None,
        "events": [{"t": event.t, "axis": event.axis, "kind": event.kind} for event in run.events],
        "scenario": scenario_view(run.scenario),
        "scenarios": [],
    }
    if assessment is not None:
        tried = zip(assessment.scenarios, assessment.errors, strict=True)
        view |= {
            "error": error_view(assessment.error),
            "error_gap": error_view(assessment.error_gap),
            "error_worst": error_view(assessment.error_worst),
            "per_turning_point": [_turning_view(assessment, number, p) for number, p in enumerate(points)],
            "scenarios": [{**scenario_view(one), "error": error_view(error)} for one, error in tried],
        }
    result = summary_view(simulation_result(found))
    own = {name: result[name] for name in ("reversals", "axes", "not_compensated", "result_line")}
    return {**view, **own, "warnings": list(found.caveats)}


def simulation_lines(found: Simulation) -> Iterator[str]:
    """Describe a simulated motion in lines: its largest error first, then tables and events."""
    run, assessment = found.run, found.assessment
    size = ""
    if assessment is not None and assessment.error is not None:
        size = f"largest error {micrometres(assessment.error.max)} µm"
        if assessment.error_gap is not None:
            size += f", {micrometres(assessment.error_gap.max)} µm caused by backlash"
        size += "; "
    yield f"{found.name} on {found.machine.name}: {size}cycle time {seconds(float(run.t[-1]))} s, {run.t.size} samples"
    if assessment is not None:
        yield error_table(assessment)
        if found.turning_points:
            side = " (+ is left of the direction of travel)" if len(run.axes) == 2 else ""
            yield f"around the reversals{side}:"
            yield turning_table(assessment, found.turning_points)
    yield from event_words(run.events)
    yield from result_lines(simulation_result(found))


def simulation_result(found: Simulation) -> ResultSummary:
    """Summarize a simulated motion: of a strategy beside the plain program, of a table by itself."""
    if found.motion is None:
        if found.assessment is None:
            return ResultSummary(trouble="the path is not known, which --path gives")
        time, assessment = found.time, found.assessment
        errors = (assessment.error, assessment.error), (assessment.error_gap, assessment.error_gap)
        return ResultSummary(time=(time, time), error=errors[0], error_gap=errors[1], alone=True)
    after = found.motion
    if after.plan.strategy == PLAIN:
        return summarize_plans(after, after, found.notes, [f"not compensated: {REMEDY}"])
    return summarize_plans(PlannedMotion(after.analysis, without_strategy(after.plan)), after, found.notes)


def _turning_view(assessment: Assessment, number: int, point: TurningPoint) -> View:
    """Return the error around a turning point; `extreme` is the largest, in a plane positive to the left."""
    error, gap = assessment.turning[number], assessment.turning_gap[number]
    return {
        "index": point.index,
        "axis": point.axis,
        "sense": point.sense,
        "s": point.s / MM,
        "extreme": None if error is None else error.extreme / MM,
        "error": error_view(error),
        "error_gap": error_view(gap),
    }


def table_would_reach(program: ContourError | None, table: ContourError | None) -> list[str]:
    """Return a sentence on an interpolator table where it would have a smaller error."""
    if program is None or table is None or table.max >= program.max:
        return []
    return [
        f"the largest error of this program is {micrometres(program.max)} µm; "
        f"an interpolator table would reach {micrometres(table.max)} µm"
    ]


def comparison_view(found: StrategyComparison) -> View:
    """Return what ``compare --json`` prints."""
    result = comparison_result(found)
    return {
        "strategies": [_contender_view(one) for one in found.strategies],
        "error_without_gap": error_view(found.error_without_gap),
        "result": None if result is None else {"strategy": result[0], **summary_view(result[1])},
        "warnings": list(found.caveats),
    }


def comparison_lines(found: StrategyComparison) -> Iterator[str]:
    """List the strategies with their errors and costs, and the reasons for refusals."""
    yield comparison_table(found.strategies)
    if found.error_without_gap is not None:
        size = micrometres(found.error_without_gap.max)
        why = "servo lag" if found.written is None else "servo lag and the controller's own path"
        yield f"without backlash the error of the plain program would be {size} µm: {why}"
    yield from COLUMN_NOTES
    yield from (f"refused {one.name}: {one.reason}" for one in found.strategies if not one.ok)
    yield from choices(found.strategies)
    result = comparison_result(found)
    if result is not None:
        yield from (f"{result[0]}: {line}" for line in result_lines(result[1]))


def comparison_result(found: StrategyComparison) -> tuple[str, ResultSummary] | None:
    """Return the strategy that chooses, and the result from the plain program to what it makes of it."""
    if found.written is not None:
        return found.written.options.chosen_strategy, summarize(found.written, "program")
    if found.analysis is None:
        return None
    plain = found.strategies[0].plan
    chosen = next((one.plan for one in found.strategies if one.ok and find_traits(one.name).chooses), None)
    machine = found.analysis.machine
    if plain is None or chosen is None or machine is None:
        return None
    before, after = (PlannedMotion(found.analysis, plan) for plan in (plain, chosen))
    return chosen.strategy, summarize_plans(before, after, found.notes)


def _contender_view(one: Contender) -> View:
    pace, found = one.pace, one.assessment
    slowest = None if pace is None or pace.min_feed is None else pace.min_feed / MM_PER_MIN
    return {
        "name": one.name,
        "error": None if found is None else error_view(found.error),
        "error_worst": None if found is None else error_view(found.error_worst),
        "error_gap": error_view(one.error_gap),
        "cycle_time": None if pace is None else pace.cycle_time,
        "min_feed": slowest,
        "standstill_time": None if pace is None else pace.standstill_time,
        "retrograde": None if pace is None else pace.retrograde,
        "peak_acceleration": None if pace is None else pace.peak_acceleration / MM,
        "ok": one.ok,
        "reason": one.reason or None,
        "chosen": [
            {"index": number, "axis": axis, "strategy": strategy} for number, (axis, strategy) in enumerate(one.chosen)
        ],
        "warnings": list(one.warnings),
    }


def error_table(assessment: Assessment) -> str:
    """Table of the contour error: for the values of the file, caused by backlash, and in the worst case."""
    cases = len(assessment.scenarios)
    rows = [
        ("contour error", assessment.error, scenario_words(assessment.run.scenario)),
        ("caused by backlash", assessment.error_gap, "compared with the same run without backlash"),
        (f"worst of {cases} cases", assessment.error_worst, scenario_words(assessment.worst)),
    ]
    cells = [(name, *_error_cells(error), words) for name, error, words in rows]
    return format_table(("", "max µm", "rms µm", "for"), cells)


def turning_table(assessment: Assessment, points: Sequence[TurningPoint]) -> str:
    """Table of the contour error around every turning point."""
    header = ("#", "axis", "sense", "s mm", "error µm", "rms µm", "backlash µm")
    rows = []
    for point, error, gap in zip(points, assessment.turning, assessment.turning_gap, strict=True):
        place = (str(point.index), point.axis, point.sense, millimetres(point.s))
        rows.append((*place, _signed(error), _error_cells(error)[1], _signed(gap)))
    return format_table(header, rows)


EVENTS: Final[Mapping[EventKind, str]] = {
    "opens": "the backlash opens",
    "picks up": "the motor picks up the table",
    "falls back": "the motor falls back",
    "sticks": "the table sticks",
    "slips": "the table slips",
    "saturates": "the torque saturates",
    "recovers": "the torque recovers",
    "chatters": "the table chatters",
}
"""What happens inside an axis, in words."""


def event_words(events: Sequence[Event]) -> list[str]:
    """Count the events of each axis, a line for each."""
    counts = Counter((event.axis, event.kind) for event in events)
    axes = sorted({axis for axis, _ in counts})
    return [
        f"{axis}: " + ", ".join(f"{EVENTS[kind]} {n} ×" for (name, kind), n in counts.items() if name == axis)
        for axis in axes
    ]


def comparison_table(contenders: Sequence[Contender]) -> str:
    """Table of all strategies; a gain is the largest error of the first strategy over that of this one."""
    header = (
        "strategy",
        "error µm",
        "rms µm",
        "worst µm",
        "gain",
        "worst gain",
        "time s",
        "longer",
        "slowest mm/min",
        "standstill s",
        "peak mm/s²",
        "moves back",
        "",
    )
    return format_table(header, [_contender_cells(one, contenders[0]) for one in contenders])


def choices(contenders: Sequence[Contender]) -> list[str]:
    """List the choices of a strategy that chooses among others."""
    return [f"{one.name} chose {chosen_words(one.chosen)}" for one in _choosing(contenders) if one.chosen]


def warnings_of_choice(contenders: Sequence[Contender]) -> list[str]:
    """Return the warnings of the strategy that chooses among others."""
    return [f"{one.name}: {text}" for one in _choosing(contenders) for text in one.warnings]


def _choosing(contenders: Sequence[Contender]) -> list[Contender]:
    return [one for one in contenders if find_traits(one.name).chooses]


def _contender_cells(one: Contender, first: Contender) -> tuple[str, ...]:
    pace, found = one.pace, one.assessment
    if pace is None or found is None:
        return (one.name, *(NOTHING,) * 11, "refused")
    base = first.assessment
    longer = NOTHING
    if first.pace is not None:
        longer = f"{100.0 * (pace.cycle_time / first.pace.cycle_time - 1.0):+.1f} %"
    return (
        one.name,
        *_error_cells(found.error),
        _error_cells(found.error_worst)[0],
        _gain(None if base is None else base.error, found.error),
        _gain(None if base is None else base.error_worst, found.error_worst),
        seconds(pace.cycle_time),
        longer,
        NOTHING if pace.min_feed is None else f"{pace.min_feed / MM_PER_MIN:.0f}",
        seconds(pace.standstill_time),
        f"{pace.peak_acceleration / MM:.0f}",
        "yes" if pace.retrograde else "no",
        "" if one.ok else "refused",
    )


def _gain(base: ContourError | None, error: ContourError | None) -> str:
    if base is None or error is None or error.max == 0.0:
        return NOTHING
    return f"{base.max / error.max:.3g} ×"


def _error_cells(error: ContourError | TurningError | None) -> tuple[str, str]:
    return (NOTHING, NOTHING) if error is None else (micrometres(error.max), micrometres(error.rms))


def _signed(error: TurningError | None) -> str:
    return NOTHING if error is None else micrometres(error.extreme, "+")
