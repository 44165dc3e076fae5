"""Tables and sentences for a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec

from ph_post.analysis.path_analysis import Analysis, feed_at
from ph_post.api.motion import Inspection
from ph_post.compensate.comparison import chosen_at, chosen_in_order
from ph_post.compensate.motion import cycle_time
from ph_post.compensate.offsets import plan_time
from ph_post.compensate.options import PlanOutput
from ph_post.compensate.strategies.registry import PLAIN
from ph_post.files.check import counted
from ph_post.gcode.program import PlaceArray
from ph_post.quantities import NOTHING, before_and_after, millimetres, seconds
from ph_post.report.views import line_at, radius, windows_by_point
from ph_post.types import Array, Plan, TurningPoint
from ph_post.units import MM, MS


def print_json(view: dict[str, Any]) -> None:
    """Print one JSON object on standard output; what does not exist is null."""
    sys.stdout.write(msgspec.json.format(msgspec.json.encode(view), indent=1).decode() + "\n")


def format_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Align columns to the right, two spaces apart.

    Examples
    --------
    >>> print(format_table(("axis", "mm"), [("X", "0.5"), ("Y", "12")]))
    axis   mm
       X  0.5
       Y   12
    """
    table = [tuple(header), *(tuple(row) for row in rows)]
    widths = [max(len(row[column]) for row in table) for column in range(len(header))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in table]
    return "\n".join(line.rstrip() for line in lines)


def print_inspection(found: Inspection) -> None:
    """Print the reversals of a path, a line each, notes on them, and the exact count if there is one."""
    stream = sys.stdout
    analysis = found.analysis
    lines = analysis.path.lines
    place = ("segment", "xi") if lines is None else ("line",)
    where = ("#", "kind", "axis", "sense", *place, "position", "s", "radius", "window", "limited by")
    gap = ("lag ms", "duration ms", "standstill mm") if analysis.machine is not None else ()
    windows = windows_by_point(analysis.windows)
    rows = []
    for point in analysis.turning_points:
        window = windows.get(point.index)
        half, bound = (NOTHING, NOTHING) if window is None else _window_cells(window.half_length, window.limited_by)
        rows.append((*_place_cells(point, lines), half, bound, *(_gap_cells(analysis, point) if gap else ())))
    stream.write(_heading(analysis))
    if rows:
        stream.write(format_table((*where, *gap), rows) + "\n")
    for line in (*analysis_notes(analysis), *(found.certificate.words if found.certificate is not None else ())):
        stream.write(line + "\n")


def _heading(analysis: Analysis) -> str:
    count = len(analysis.turning_points)
    points = counted(count, "reversal") if count else "no reversal"
    length = f"{millimetres(analysis.track.length)} mm"
    return f"{analysis.path.name}: {points} on {length} (lengths in mm; windows for {analysis.tolerance / MM:g} mm)\n"


def _place_cells(point: TurningPoint, lines: tuple[Array, PlaceArray, PlaceArray] | None) -> tuple[str, ...]:
    circle = radius(point)
    size = NOTHING if circle is None else f"{circle / MM:.4g}"
    return (
        str(point.index),
        point.kind,
        point.axis,
        point.sense,
        *((str(point.segment), f"{point.xi:.6f}") if lines is None else (str(line_at(lines, point.s)),)),
        millimetres(point.position),
        millimetres(point.s),
        size,
    )


def _window_cells(half_length: float, limited_by: str | None) -> tuple[str, str]:
    return millimetres(half_length), limited_by or "nothing"


def _gap_cells(analysis: Analysis, point: TurningPoint) -> tuple[str, ...]:
    interval = analysis.intervals[point.index]
    if interval is None:
        return (NOTHING, NOTHING, NOTHING)
    travel = feed_at(analysis.path, point) * interval.duration
    return (f"{round(interval.lag / MS, 3) + 0.0:.3f}", f"{interval.duration / MS:.3f}", millimetres(travel))


def analysis_notes(analysis: Analysis) -> list[str]:
    """List the notes on windows and intervals, equal notes once."""
    said: dict[str, list[int]] = {}
    for point in analysis.turning_points:
        if analysis.notes[point.index]:
            said.setdefault(analysis.notes[point.index], []).append(point.index)
    for window in analysis.windows:
        for note in window.notes:
            said.setdefault(note, []).append(window.turning_point)
    return [f"{_numbers(indices)}: {note}" for note, indices in said.items()]


def _numbers(indices: Sequence[int], most: int = 8) -> str:
    shown = ", ".join(f"#{index}" for index in indices[:most])
    return shown + (f" and {len(indices) - most} more" if len(indices) > most else "")


def print_plan(plan: Plan, products: Iterable[str], what: str = "", said: str = "") -> None:
    """Print the summary of a plan on standard error, its warnings, and the files that were written.

    `what` names the plan where a job has several; `said` is a summary of the program in place of the plan's.
    """
    stream = sys.stderr
    stream.write((f"{_named(plan, what)}: {said}" if said else plan_summary(plan, what)) + "\n")
    for warning in plan.warnings:
        stream.write(f"warning: {warning}\n")
    for product in products:
        if product != "-":
            stream.write(f"wrote {product}\n")


def plan_summary(plan: Plan, what: str = "") -> str:
    """Summarize a plan in one line: what is done at reversals, and cycle time; `what` as in :func:`print_plan`."""
    chosen = chosen_at(chosen_in_order(plan))
    chosen.pop(PLAIN, None)
    done = sum(map(len, chosen.values()))
    kinds = ", ".join(f"{name} {len(indices)}" for name, indices in chosen.items())
    return (
        f"{_named(plan, what)}: {counted(done, 'reversal')} compensated{f' ({kinds})' if kinds else ''}; "
        f"cycle time {before_and_after(cycle_time(plan.nominal), plan_time(plan), seconds, 's')}"
    )


def _named(plan: Plan, what: str) -> str:
    return plan.path.name + (f", {what}" if what else "")


def print_plans(plans: Mapping[PlanOutput, Plan], products: Iterable[str], said: Mapping[PlanOutput, str]) -> None:
    """Print the plans of one job by their outputs, equal warnings once; `said` as for :func:`print_plan`."""
    known: set[str] = set()
    for number, (what, plan) in enumerate(plans.items(), start=1):
        new = tuple(warning for warning in plan.warnings if warning not in known)
        known.update(new)
        last = number == len(plans)
        shown = msgspec.structs.replace(plan, warnings=new)
        name = what if len(plans) > 1 else ""
        print_plan(shown, products if last else (), name, said=said.get(what, ""))


def chosen_words(chosen: Sequence[tuple[str, str]]) -> str:
    """List the reversals of each strategy in one line, from the axis and strategy of each.

    Such as ``takeup at #0, #2; not compensated: #1, #3``.
    """
    return "; ".join(
        f"{'not compensated:' if name == PLAIN else f'{name} at'} {_numbers(indices)}"
        for name, indices in chosen_at(chosen).items()
    )
