"""Figures of simulated motions, of strategies side by side, and of a motion before and after compensation."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Final

import numpy as np

from ph_post.analysis.path_analysis import Analysis
from ph_post.api.motion import Simulation
from ph_post.compensate.comparison import Contender
from ph_post.geometry.numeric import runs
from ph_post.report.figures import (
    AFTER,
    BEFORE,
    MARK,
    TWO,
    WINDOW,
    draw_moves,
    legend_above,
    magnification,
    new_figure,
    steps_of,
)
from ph_post.report.result_line import result_lines
from ph_post.report.traces import DrawnMotion, Picture
from ph_post.simulate.assess import Assessment
from ph_post.simulate.controllers.deviation import ProgramError
from ph_post.types import Array, BoolArray, IntArray, Run
from ph_post.units import MICROMETRE, MM, MM_PER_MIN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


GAP = "#1fb5c9"
COLOURS = (BEFORE, AFTER, WINDOW, MARK, "#2c8a4b", "#7b4fa3", GAP, "#5c4033", "#d96fa8")


def draw_run(found: Simulation) -> Figure:
    """Draw a run: error along time, and magnified along the path; without a path the errors of the axes."""
    run, analysis, assessment = found.run, found.analysis, found.assessment
    figure = new_figure(11.0, 4.8)
    if analysis is None or assessment is None:
        _draw_following(figure.subplots(), run)
    else:
        left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
        _draw_error(left, run, assessment)
        _draw_path(right, run, analysis, assessment)
    figure.suptitle(found.name)
    return figure


def gap_intervals(run: Run, axis: str) -> list[tuple[float, float]]:
    """Stretches of time [s] in which the gap of an axis is open."""
    found: list[tuple[float, float]] = []
    since: float | None = None
    for event in run.events:
        if event.axis != axis:
            continue
        if event.kind == "opens" and since is None:
            since = event.t
        elif event.kind in {"picks up", "falls back"} and since is not None:
            found.append((since, event.t))
            since = None
    return found if since is None else [*found, (since, float(run.t[-1]))]


def _mark_gaps(axes: Axes, run: Run) -> None:
    for number, name in enumerate(run.axes):
        colour = (GAP, WINDOW, MARK)[number]
        for begin, end in gap_intervals(run, name):
            axes.axvspan(begin, end, color=colour, alpha=0.35, linewidth=0.0, label=f"{name} taking up backlash")


def _draw_error(axes: Axes, run: Run, assessment: Assessment) -> None:
    error = assessment.nearest.error / MICROMETRE
    counted = assessment.first
    _mark_gaps(axes, run)
    axes.plot(run.t[:counted], error[:counted], ":", color=BEFORE, linewidth=1.0)
    axes.plot(run.t[counted:], error[counted:], color=AFTER, linewidth=1.0)
    axes.axhline(0.0, color=BEFORE, linewidth=0.6)
    axes.set(xlabel="t [s]", ylabel=_error_label(run))
    legend_above(axes)


def _error_label(run: Run) -> str:
    """Label the axis of an error; in space an error has no side."""
    return "contour error [µm]" + (", + left of the path" if len(run.axes) == 2 else "")


def _draw_following(axes: Axes, run: Run) -> None:
    _mark_gaps(axes, run)
    for number, name in enumerate(run.axes):
        lag = (run.executed[:, number] - run.commanded[:, number]) / MICROMETRE
        axes.plot(run.t, lag, color=(AFTER, MARK, BEFORE)[number], linewidth=1.0, label=name)
    axes.set(xlabel="t [s]", ylabel="executed - commanded [µm]")
    legend_above(axes)


def _draw_path(axes: Axes, run: Run, analysis: Analysis, assessment: Assessment) -> None:
    """Draw the path, and the executed motion with its distance from the path magnified."""
    track = analysis.track
    foot = track.derivatives(*track.locate(np.clip(assessment.nearest.s, 0.0, track.length)))[0]
    extent = float(np.ptp(foot, axis=0).max())
    counted = slice(assessment.first, None)
    largest = 0.0 if assessment.error is None else assessment.error.max
    factor = magnification(extent, largest)
    place = (foot + factor * (run.executed - foot))[counted, :2] / MM
    axes.plot(*(foot[:, :2] / MM).T, color=MARK, linewidth=0.9, label="path")
    axes.plot(*place.T, color=AFTER, linewidth=1.0, label=f"executed, error × {factor:g}")
    for rows in _gap_rows(run, assessment.first):
        axes.plot(*place[rows].T, color=GAP, linewidth=1.8, label="taking up backlash")
    axes.set(xlabel=f"{run.axes[0]} [mm]", ylabel=f"{run.axes[1]} [mm]")
    axes.set_aspect("equal", adjustable="datalim")
    legend_above(axes)


def _gap_rows(run: Run, first: int) -> list[slice]:
    """Rows after the first that counts in which a gap is open."""
    t = run.t[first:]
    found = []
    for name in run.axes:
        for begin, end in gap_intervals(run, name):
            rows = slice(*np.searchsorted(t, (begin, end)).tolist())
            found += [rows] if rows.stop > rows.start else []
    return found


def draw_comparison(name: str, contenders: Sequence[Contender]) -> Figure:
    """Draw the errors of all strategies as bars, and those that can be run along the path."""
    figure = new_figure(12.0, 5.0)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.3))
    _draw_bars(left, contenders)
    lines: dict[bytes, tuple[Array, list[str]]] = {}
    for one in contenders:
        if one.ok and one.assessment is not None:
            line = _along(one.assessment)
            lines.setdefault(line.tobytes(), (line, []))[1].append(one.name)
        if isinstance(one.assessment, Assessment):
            right.set(ylabel=_error_label(one.assessment.run))
        elif one.assessment is not None:
            right.set(ylabel="contour error [µm]")
    for (line, names), colour in zip(lines.values(), itertools.cycle(COLOURS), strict=False):
        right.plot(*line, color=colour, linewidth=1.0, label=", ".join(names))
    right.set(xlabel="along the path [mm]")
    legend_above(right, columns=4)
    figure.suptitle(name)
    return figure


def _along(assessment: Assessment | ProgramError) -> Array:
    """Places along the path [mm] and errors there [µm], in two rows."""
    if isinstance(assessment, Assessment):
        counted = slice(assessment.first, None)
        s, error = assessment.run.s[counted], assessment.nearest.error[counted]
    else:
        # Where nothing is cut there is a break in the line.
        s, error = assessment.place, np.where(assessment.counted, assessment.distance, np.nan)
    return np.stack([s / MM, error / MICROMETRE])


def _draw_bars(axes: Axes, contenders: Sequence[Contender]) -> None:
    shown = [one for one in contenders if one.assessment is not None and one.pace is not None]
    rows: Array = np.arange(len(shown), dtype=np.float64)
    for offset, colour, label, values in (
        (-0.2, AFTER, "machine file", [_size(one, worst=False) for one in shown]),
        (0.2, WINDOW, "worst case", [_size(one, worst=True) for one in shown]),
    ):
        bars = axes.barh(rows + offset, values, 0.38, color=colour, label=label)
        axes.bar_label(bars, fmt=" %.3g", fontsize="small")
    axes.set_yticks(rows, [_label(one) for one in shown])
    axes.invert_yaxis()
    sizes = [size for one in shown for size in (_size(one, worst=False), _size(one, worst=True)) if size > 0.0]
    if sizes:
        axes.set_xscale("log")
        axes.set_xlim(10.0 ** math.floor(math.log10(0.8 * min(sizes))), 3.0 * max(sizes))
        axes.xaxis.set_minor_formatter("")
    axes.set(xlabel="largest contour error [µm]")
    legend_above(axes)


def _label(one: Contender) -> str:
    time = "" if one.pace is None else f"\n{one.pace.cycle_time:.2f} s"
    return one.name + time + ("" if one.ok else ", refused")


def _size(one: Contender, *, worst: bool) -> float:
    found = one.assessment
    error = None if found is None else found.error_worst if worst else found.error
    return math.nan if error is None else error.max / MICROMETRE


DIGITS: Final = 4
"""Decimals of a drawn error in µm."""


def draw_picture(picture: Picture) -> Figure:
    """Draw what a page shows: the path with its windows on the left, error and feed along it on the right."""
    figure = new_figure(12.0, 5.6)
    panels = figure.subplot_mosaic([["path", "error"], ["path", "feed"]], width_ratios=(1.0, 1.2))
    _draw_both_paths(panels["path"], picture)
    _draw_panels(panels, picture)
    legend_above(panels["path"])
    *left, last = result_lines(picture.summary)
    figure.suptitle("\n".join([picture.name, *(wrapped for line in (*left, last) for wrapped in wrap(line, TITLE))]))
    return figure


TITLE: Final = 110
"""Longest line over a picture."""


def _draw_both_paths(axes: Axes, picture: Picture) -> None:
    s = np.unique(picture.joints)
    joints = picture.points(s)
    draw_moves(axes, _flat(joints), _steps(picture.unknown, s) == 0, _steps(picture.rapids, s) == 1, BEFORE, "path")
    for window in picture.windows if picture.windowed else ():
        span = np.linspace(*window, 64)
        span = np.mod(span, picture.length) if picture.closed else span
        line = steps_of(_flat(picture.points(span)), np.diff(span, prepend=0.0) >= 0.0)
        axes.plot(*line, color=WINDOW, linewidth=5.0, alpha=0.6, label="window")
    sizes = [0.0 if one.size is None else one.size.max for one in picture.traces]
    factor = magnification(float(np.ptp(joints, axis=0).max()), max(sizes))
    for trace, colour in zip(picture.traces, TWO, strict=False):
        places = np.where(trace.counted[:, None], trace.foot + factor * trace.away, np.nan)
        axes.plot(*_flat(places), color=colour, linewidth=1.0, label=f"{trace.name}, error × {factor:g}")
        axes.plot(*_flat(places[_holes(trace)]), "o", color=colour, markersize=3.0)
    if picture.marks:
        points = _flat(np.array([one.point for one in picture.marks]))
        axes.plot(*points, "o", color=MARK, markersize=3.5, label="reversal")
    names = (*picture.axes, "")
    axes.set(xlabel=f"{names[0]} [mm]", ylabel=f"{names[1]} [mm]" if names[1] else "")
    axes.set_aspect("equal", adjustable="datalim")
    _frame(axes, joints, _steps(picture.rapids, s) == 0)


def _frame(axes: Axes, joints: Array, cuts: BoolArray) -> None:
    """Frame a picture on what is cut: a way to it from far away would make the part a dot."""
    shown = cuts.copy()
    shown[:-1] |= cuts[1:]
    if not shown.any() or not cuts[1:].any():
        return
    drawn = [np.asarray(line.get_xydata()) for line in axes.lines if "error" in str(line.get_label())]
    places = np.concatenate([_flat(joints[shown]).T, *drawn])
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    middle, size = 0.5 * (low + high), (1.0 + ROOM) * (high - low)
    half = 0.5 * np.maximum(size, SLIMMEST * size.max())
    axes.set(xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1]))
    axes.set_aspect("equal", adjustable="box")


def _holes(trace: DrawnMotion) -> list[int]:
    """Last rows of the cuts that stay on one place of the picture."""
    foot = _flat(trace.foot)
    return [int(rows[-1]) for rows in runs(np.flatnonzero(trace.counted)) if np.ptp(foot[:, rows], axis=1).max() < HOLE]


HOLE: Final = 0.3
"""Size of a cut [mm] below which it is a hole: its nearest place on the path may lie on the rapid before it."""

ROOM: Final = 0.1
"""Room around what is cut, a part of its size."""

SLIMMEST: Final = 0.8
"""A picture is no slimmer than this part of its longer side."""


def _steps(stretches: Sequence[tuple[float, float]], s: Array) -> IntArray:
    """Return 1 for the steps from place to place along a path (n,), ascending [m], that lie in stretches, else 0."""
    middles = 0.5 * (s + np.append(s[:1], s[:-1]))
    ends = np.array(stretches).ravel()  # ascending, the begin and the end of each
    return np.asarray(np.searchsorted(ends, middles, side="right") % 2)


def _flat(points: Array) -> Array:
    """First two coordinates [mm]; of a straight axis the second is 0."""
    flat = np.zeros((2, len(points)))
    flat[: min(points.shape[1], 2)] = points[:, :2].T / MM
    return flat


def _draw_panels(panels: dict[str, Axes], picture: Picture) -> None:
    error, feed = panels["error"], panels["feed"]
    error.sharex(feed)
    for axes in (error, feed):
        for low, high in picture.windows if picture.windowed else ():
            axes.axvspan(low / MM, high / MM, color=WINDOW, alpha=0.3, linewidth=0.0)
    for trace, colour in zip(picture.traces, TWO, strict=False):
        error.plot(trace.s / MM, _counted(trace), color=colour, linewidth=1.0, label=trace.name)
        asked = np.where(picture.known(trace.s), trace.feed / MM_PER_MIN, np.nan)
        feed.plot(trace.s / MM, asked, color=colour, linewidth=1.0)
    side = "+ left of the path" if picture.kind == "path" and len(picture.axes) == 2 else ""
    error.set(ylabel="contour error [µm]")
    feed.set(xlabel="along the path [mm]", ylabel="feed [mm/min]", xlim=(0.0, picture.length / MM))
    error.set_title(side, fontsize="small", loc="left")
    legend_above(error)


def _counted(trace: DrawnMotion) -> Array:
    # Smaller differences are rounding, which would fill the picture.
    return np.where(trace.counted, np.round(trace.error / MICROMETRE, DIGITS), np.nan)
