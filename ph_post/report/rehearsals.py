"""Text, JSON and figure of a rehearsal on LinuxCNC."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ph_post.drive.axes import backlash_uncertainties
from ph_post.files.check import counted
from ph_post.quantities import NOTHING, before_and_after, micrometres, seconds
from ph_post.rehearse.rehearse import Execution, Rehearsal
from ph_post.report.figures import AFTER, BEFORE, MARK, legend_above, new_figure
from ph_post.report.result_line import ResultSummary, declared_axes, result_lines
from ph_post.report.tables import format_table
from ph_post.report.views import View, error_view
from ph_post.simulate.contour import ContourError
from ph_post.simulate.controllers.moves import moved_axes
from ph_post.units import MICROMETRE, MM, MM_PER_MIN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def rehearsal_view(found: Rehearsal) -> dict[str, Any]:
    """Return a rehearsal as a JSON object; lengths in mm, times in s."""
    real = found.real
    before = real if found.before is None else found.before
    return {
        "speed": {"rms": found.speed, "max": found.speed_worst, "windows": found.windows},
        "path": {"max": found.path / MM, "allowed": None if found.allowed is None else found.allowed / MM},
        "time": {"plan": found.plan.time, "controller": real.time, "before": before.time},
        "error": {
            "before": _known(found, before.error.error),
            "after": _known(found, real.error.error),
            "planned": _known(found, found.plan.error.error),
            "before_worst": _known(found, before.error.error_worst),
            "after_worst": _known(found, real.error.error_worst),
            "backlash": None if found.backlash is None else _known(found, found.backlash.error.error),
        },
        "error_gap": dict(zip(("before", "after", "after_worst"), map(error_view, found.gaps), strict=True)),
        "axes": list(declared_axes(found.program)),
        "result_line": next(iter(_result_lines(found)[-1:]), None),
        "lockstep": found.lockstep,
    }


def _known(found: Rehearsal, error: ContourError | None) -> View | None:
    """Return an error, null where the nominal path is not known."""
    return error_view(error) if found.nominal else None


def rehearsal_lines(found: Rehearsal) -> list[str]:
    """Describe a rehearsal in lines: the errors of the part first, then time, speed and path beside the plan."""
    real = found.real
    part = 100.0 * (real.time / found.plan.time - 1.0)
    lines = [
        f"{found.program.name}: {_error_words(found)}{seconds(real.time)} s on LinuxCNC",
        *([_error_table(found)] if found.nominal else []),
        f"time: {part:+.2f} % compared with the plan",
        f"speed: {100.0 * found.speed:.2f} % rms off the plan in {counted(found.windows, 'window')}",
        f"path: at most {micrometres(found.path)} µm from the program's, {_allowed_words(found)}",
    ]
    if not found.lockstep:
        lines.append("run in real time: the duration of dwells depends on how busy this computer is")
    return [*lines, *_result_lines(found)]


def _result_lines(found: Rehearsal) -> list[str]:
    """Return the line of the result, where the original was run beside the program."""
    if found.before is None:
        return [] if found.nominal else ["the error is not known: the path that offsets shift is not given"]
    before, after, worst = found.gaps
    summary = ResultSummary(
        time=(found.before.time, found.real.time),
        error=(found.before.error.error, found.real.error.error),
        error_gap=(before, after),
        error_gap_worst=worst,
        uncertainty=backlash_uncertainties(found.machine, moved_axes(found.program)),
        axes=declared_axes(found.program),
    )
    return result_lines(summary)


def _error_words(found: Rehearsal) -> str:
    after = found.real.error.error
    if after is None or not found.nominal:
        return ""
    before = None if found.before is None else found.before.error.error
    if before is None:
        return f"largest error {micrometres(after.max)} µm; "
    return f"largest error {before_and_after(before.max, after.max, micrometres, 'µm')}; "


def _allowed_words(found: Rehearsal) -> str:
    if found.allowed is None:
        return "whose path mode sets no limit"
    return f"whose path mode allows {micrometres(found.allowed)} µm"


def _error_table(found: Rehearsal) -> str:
    rows = [("planned", found.plan), ("rehearsed", found.real), ("original", found.before)]
    rows.append(("original, LinuxCNC's BACKLASH", found.backlash))
    header = ("contour error", "max µm", "rms µm", "worst case µm", "time s")
    return format_table(header, [_error_row(name, one) for name, one in rows if one is not None])


def _error_row(name: str, execution: Execution) -> tuple[str, ...]:
    error, worst = execution.error.error, execution.error.error_worst
    if error is None or worst is None:
        return (name, NOTHING, NOTHING, NOTHING, seconds(execution.time))
    return (name, *map(micrometres, (error.max, error.rms, worst.max)), seconds(execution.time))


def draw_rehearsal(found: Rehearsal) -> Figure:
    """Draw contour error and speed along time, of what was rehearsed, planned, and of the original."""
    figure = new_figure(11.0, 6.0)
    above, below = figure.subplots(2, 1, sharex=True)
    shown: list[tuple[str, Execution | None, str, float]] = [
        ("original", found.before, BEFORE, 0.9),
        ("original, LinuxCNC's BACKLASH", found.backlash, MARK, 0.9),
        ("rehearsed", found.real, AFTER, 1.0),
    ]
    for label, execution, colour, width in shown:
        if execution is not None:
            _draw_error(above, execution, label, colour, width)
    command, planned = found.real.command, found.plan.command
    below.plot(planned.t, planned.feed / MM_PER_MIN, color=BEFORE, linewidth=1.8, label="planned")
    below.plot(command.t, command.feed / MM_PER_MIN, color=AFTER, linewidth=0.8, label="rehearsed")
    above.set(ylabel="contour error [µm]")
    below.set(xlabel="t [s]", ylabel="feed [mm/min]")
    for axes in (above, below):
        legend_above(axes)
    figure.suptitle(f"{found.program.name} on {found.machine.name}")
    return figure


def _draw_error(axes: Axes, execution: Execution, label: str, colour: str, width: float) -> None:
    error = np.where(execution.error.counted, execution.error.distance / MICROMETRE, np.nan)
    axes.plot(execution.command.t, error, color=colour, linewidth=width, label=label)
