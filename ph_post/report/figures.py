"""Figures of paths, plans and backlash intervals, and the helpers that all figures share.

Figures are drawn with matplotlib and returned as bytes, so that they are written like every other product.
"""

from __future__ import annotations

import io
import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Final

import numpy as np

from ph_post.analysis.path_analysis import Analysis
from ph_post.compensate.motion import place_and_feed
from ph_post.drive.intervals import AxisTable, IntervalTable
from ph_post.errors import InputError
from ph_post.types import Array, BoolArray, Phase, Plan, TurningPoint
from ph_post.units import MM, MM_PER_MIN, MS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


FORMATS = (".png", ".svg", ".pdf")
"""Picture formats that can be asked for, by the file's name."""

POINTS_A_PIECE = 64
"""Points a piece is drawn with."""

BEFORE, AFTER, WINDOW, MARK = "#8c96a0", "#0b62a4", "#f2a33a", "#c0392b"

TWO = ("#c2570c", AFTER)
"""Colours of two compared motions, as on the pages."""

ERROR_SHARE = 0.05
"""The largest error is drawn as large as this part of the path's extent."""

LARGEST_MAGNIFICATION = 1e4
"""Errors are magnified by no more than this: what is smaller is rounding."""


def new_figure(width: float = 10.0, height: float = 4.5) -> Figure:
    """Return an empty figure [inch] that needs no screen."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def picture_format(target: str) -> str:
    """Return the format a file's name asks for.

    Raises
    ------
    InputError
        If it is none of :data:`FORMATS`.
    """
    suffix = FilePath(target).suffix.lower()
    if suffix not in FORMATS:
        raise InputError(target, "pictures come in other formats", expected=", ".join(FORMATS), got=repr(suffix))
    return suffix[1:]


def write_figure(figure: Figure, target: str) -> bytes:
    """Return a figure as the content of the file `target`, in the format that its name asks for.

    The bytes are the same for the same figure: no dates, fixed identifiers.

    Raises
    ------
    InputError
        If the format is none of :data:`FORMATS`.
    """
    import matplotlib as mpl

    picture = picture_format(target)
    stream = io.BytesIO()
    dates = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with mpl.rc_context({"svg.hashsalt": "ph_post"}):
        figure.savefig(stream, format=picture, dpi=120, metadata=dates[picture])
    return stream.getvalue()


def legend_above(axes: Axes, columns: int = 3) -> None:
    """Put the legend above the picture, where it hides nothing, equal names once."""
    handles, names = axes.get_legend_handles_labels()
    once = dict(zip(names, handles, strict=True))
    if once:
        axes.legend(
            once.values(),
            once.keys(),
            frameon=False,
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            ncols=columns,
            fontsize="small",
        )


def steps_of(points: Array, steps: BoolArray) -> Array:
    """Return points (m, n) as a line to be plotted that has some of its steps alone, with NaN between them.

    Parameters
    ----------
    points : Array, shape (m, n)
    steps : BoolArray, shape (n,)
        Whether the step that ends in a point is drawn; the first point ends none.

    Examples
    --------
    >>> steps_of(np.arange(4.0)[None], np.array([False, True, False, True])).tolist()
    [[0.0, 1.0, nan, 2.0, 3.0]]
    """
    steps = np.append(False, steps[1:])[: steps.size]
    ends = steps | np.append(steps[1:], False)[: steps.size]
    gaps = np.flatnonzero(ends[:-1] & ends[1:] & ~steps[1:]) + 1
    line: Array = np.insert(np.where(ends, points, np.nan), gaps, np.nan, axis=1)
    return line


def draw_moves(axes: Axes, line: Array, steps: BoolArray, rapid: BoolArray, colour: str, name: str) -> None:
    """Draw the steps of a path, rapid ones dotted.

    Parameters
    ----------
    axes : Axes
    line : Array, shape (2, n)
        Its points.
    steps, rapid : BoolArray, shape (n,)
        Whether the step that ends in a point is drawn, and whether it is a rapid move.
    colour, name : str
        Of the line, and in the legend; what is rapid has one name there, whichever line it is part of.
    """
    for shown, style, label in ((steps & ~rapid, "-", name), (steps & rapid, ":", "rapid")):
        if shown[1:].any():
            axes.plot(*steps_of(line, shown), style, color=colour, linewidth=1.0, label=label)


def magnification(extent: float, error: float) -> float:
    """Round factor 1, 2, 5, 10, … that shows an error on a path of that extent.

    Examples
    --------
    >>> magnification(0.5, 0.00055)
    20.0
    """
    if error <= 0.0:
        return 1.0
    wanted = ERROR_SHARE * extent / error
    power = 10.0 ** math.floor(math.log10(wanted))
    rounded = power * max(step for step in (1.0, 2.0, 5.0) if step * power <= wanted)
    return min(max(rounded, 1.0), LARGEST_MAGNIFICATION)


def draw_plan(analysis: Analysis, plan: Plan) -> Figure:
    """Draw the path with its windows on the left, the feed along it before and after on the right."""
    figure = new_figure()
    left, right = figure.subplots(1, 2)
    _draw_path(left, analysis)
    _draw_feed(right, plan)
    figure.suptitle(f"{analysis.path.name}, strategy {plan.strategy}")
    return figure


def draw_analysis(analysis: Analysis) -> Figure:
    """Draw the path with its windows, and beside it, with a machine, the standstill of every reversal."""
    known = [one for one in analysis.intervals if one is not None]
    figure = new_figure(10.0 if known else 5.5)
    if not known:
        _draw_path(figure.subplots(), analysis)
    else:
        left, right = figure.subplots(1, 2)
        _draw_path(left, analysis)
        _draw_intervals(right, analysis)
    figure.suptitle(analysis.path.name)
    return figure


def _draw_intervals(axes: Axes, analysis: Analysis) -> None:
    """Draw the backlash interval of every turning point that has one as a bar, its lag before it."""
    from matplotlib.ticker import MaxNLocator

    for point, interval in zip(analysis.turning_points, analysis.intervals, strict=True):
        if interval is not None:
            lag, duration = interval.lag / MS, interval.duration / MS
            axes.barh(point.index, lag, color=BEFORE, height=0.7, label="lag of the reversal")
            axes.barh(point.index, duration, left=lag, color=AFTER, height=0.7, label="standstill")
    axes.invert_yaxis()
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="after the commanded reversal [ms]", ylabel="reversal")
    legend_above(axes)


def _draw_path(axes: Axes, analysis: Analysis) -> None:
    track = analysis.track
    line = _positions(analysis, np.linspace(0.0, track.length, POINTS_A_PIECE * len(track.pieces) + 1))
    axes.plot(*line, color=BEFORE, linewidth=1.0, label="path")
    for window in analysis.windows:
        span = np.linspace(window.s - window.half_length, window.s + window.half_length, POINTS_A_PIECE)
        axes.plot(*_positions(analysis, span), color=WINDOW, linewidth=4.0, alpha=0.7, label="window")
    _draw_turning_points(axes, analysis)
    axes.set(xlabel=f"{analysis.path.axes[0]} [mm]", ylabel=f"{analysis.path.axes[1]} [mm]")
    axes.set_aspect("equal", adjustable="datalim")
    legend_above(axes)


def _draw_turning_points(axes: Axes, analysis: Analysis) -> None:
    points: tuple[TurningPoint, ...] = analysis.turning_points
    if points:
        places = _positions(analysis, np.array([point.s for point in points]))
        axes.plot(*places, "o", color=MARK, markersize=4.0, label="reversal")


def _positions(analysis: Analysis, s: Array) -> Array:
    """First two coordinates [mm] at arc length s, wrapped on a closed path."""
    track = analysis.track
    wrapped = np.mod(s, track.length) if track.closed else np.clip(s, 0.0, track.length)
    wrapped = np.where(track.closed & (s == track.length), track.length, wrapped)
    positions = track.derivatives(*track.locate(wrapped), 0)[0]
    return np.ascontiguousarray(positions[:, :2].T / MM)


def _draw_feed(axes: Axes, plan: Plan) -> None:
    for phases, colour, style, label in (
        (plan.phases, AFTER, "-", "after"),
        (plan.nominal, BEFORE, "--", "before"),
    ):
        s, feed = _feed_along(phases)
        axes.plot(s / MM, feed / MM_PER_MIN, style, color=colour, linewidth=1.4, label=label)
    axes.set(xlabel="along the path [mm]", ylabel="feed [mm/min]")
    legend_above(axes)


def _feed_along(phases: tuple[Phase, ...]) -> tuple[Array, Array]:
    within = np.linspace(0.0, 1.0, POINTS_A_PIECE)
    return place_and_feed(phases, np.concatenate([phase.start + phase.duration * within for phase in phases]))


LINES: Final = 6
"""Values of the coarser grid that are drawn as a line."""


def draw_intervals(table: IntervalTable) -> Figure:
    """Draw Δt of every axis on the first circle: along the finer grid, a line a value of the other."""
    figure = new_figure(4.0 + 4.0 * len(table.axes), 4.2)
    panels = figure.subplots(1, len(table.axes), squeeze=False, sharey=True)[0]
    for axes, one in zip(panels, table.axes, strict=True):
        _draw_axis(axes, table, one)
    panels[0].set(ylabel="standstill [ms]")
    circle = f"radius {table.radius[0] / MM:g} mm at {table.feed[0] / MM_PER_MIN:g} mm/min"
    figure.suptitle(f"{table.machine}: {circle}")
    return figure


def _draw_axis(axes: Axes, table: IntervalTable, one: AxisTable) -> None:
    duration = one.duration[0, 0] / MS
    names, grids = ("β [1/s]", "C [rad/(m s²)]"), (table.beta, table.gain)
    fine = int(table.gain.size >= table.beta.size)
    rows = duration if fine else duration.T
    kept = np.unique(np.linspace(0, len(rows) - 1, min(LINES, len(rows))).astype(np.int64))
    for k in kept.tolist():
        label = f"{names[1 - fine].split()[0]} = {grids[1 - fine][k]:g}"
        axes.plot(grids[fine], rows[k], marker=".", linewidth=1.2, label=label)
    axes.set(xlabel=names[fine], title=one.axis)
    axes.legend(frameon=False, fontsize="small")
