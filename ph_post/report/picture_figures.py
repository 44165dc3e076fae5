"""The picture of a path or a program: the error magnified along it, error and feed before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from ph_post.report.figures import (
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
from ph_post.report.traces import Picture, Trace
from ph_post.types import Array, BoolArray
from ph_post.units import MICROMETRE, MM, MM_PER_MIN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DIGITS: Final = 4
"""Decimals of an error in µm."""


def draw_picture(picture: Picture) -> Figure:
    """Draw what a page shows: the path with its windows on the left, error and feed along it on the right."""
    figure = new_figure(12.0, 5.6)
    panels = figure.subplot_mosaic([["path", "error"], ["path", "feed"]], width_ratios=(1.0, 1.2))
    _draw_path(panels["path"], picture)
    _draw_along(panels, picture)
    legend_above(panels["path"])
    figure.suptitle(picture.name)
    return figure


def _draw_path(axes: Axes, picture: Picture) -> None:
    s = np.unique(picture.joints)
    joints = picture.points(s)
    draw_moves(axes, _flat(joints), np.ones(s.size, dtype=bool), _in_rapids(picture, s), BEFORE, "path")
    for window in picture.windows:
        span = np.linspace(*window, 64)
        span = np.mod(span, picture.length) if picture.closed else span
        line = steps_of(_flat(picture.points(span)), np.diff(span, prepend=0.0) >= 0.0)
        axes.plot(*line, color=WINDOW, linewidth=5.0, alpha=0.6, label="window")
    sizes = [0.0 if one.size is None else one.size.max for one in picture.traces]
    factor = magnification(float(np.ptp(joints, axis=0).max()), max(sizes))
    for trace, colour in zip(picture.traces, TWO, strict=False):
        places = np.where(trace.counted[:, None], trace.foot + factor * trace.away, np.nan)
        axes.plot(*_flat(places), color=colour, linewidth=1.0, label=f"{trace.name}, error x {factor:g}")
    if picture.marks:
        points = _flat(np.array([one.point for one in picture.marks]))
        axes.plot(*points, "o", color=MARK, markersize=3.5, label="turning point")
    names = (*picture.axes, "")
    axes.set(xlabel=f"{names[0]} [mm]", ylabel=f"{names[1]} [mm]" if names[1] else "")
    axes.set_aspect("equal", adjustable="datalim")


def _in_rapids(picture: Picture, s: Array) -> BoolArray:
    """Whether the steps from place to place along a path (n,), ascending [m], are rapid moves."""
    middles = 0.5 * (s + np.append(s[:1], s[:-1]))
    ends = np.array(picture.rapids).ravel()  # ascending, each rapid's begin and end
    return np.asarray(np.searchsorted(ends, middles, side="right") % 2 == 1)


def _flat(points: Array) -> Array:
    """First two coordinates [mm]; of a straight axis the second is 0."""
    flat = np.zeros((2, len(points)))
    flat[: min(points.shape[1], 2)] = points[:, :2].T / MM
    return flat


def _draw_along(panels: dict[str, Axes], picture: Picture) -> None:
    error, feed = panels["error"], panels["feed"]
    error.sharex(feed)
    for axes in (error, feed):
        for low, high in picture.windows:
            axes.axvspan(low / MM, high / MM, color=WINDOW, alpha=0.3, linewidth=0.0)
    for trace, colour in zip(picture.traces, TWO, strict=False):
        error.plot(trace.s / MM, _counted(trace), color=colour, linewidth=1.0, label=trace.name)
        feed.plot(trace.s / MM, trace.feed / MM_PER_MIN, color=colour, linewidth=1.0)
    side = "+ left of the path" if picture.kind == "path" and len(picture.axes) == 2 else ""
    error.set(ylabel="contour error [µm]")
    feed.set(xlabel="along the path [mm]", ylabel="feed [mm/min]", xlim=(0.0, picture.length / MM))
    error.set_title(side, fontsize="small", loc="left")
    legend_above(error)


def _counted(trace: Trace) -> Array:
    # What is smaller is the rounding of numbers, which would fill the picture.
    return np.where(trace.counted, np.round(trace.error / MICROMETRE, DIGITS), np.nan)
