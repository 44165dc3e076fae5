"""The picture of a path or a program: the error magnified along it, error and feed before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from ph_post.report.figures import MARK, WINDOW, new_figure
from ph_post.report.motion_figures import magnification
from ph_post.report.traces import Picture, Trace
from ph_post.types import Array
from ph_post.units import MICROMETRE, MM, MM_PER_MIN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#c2570c", "#0b62a4")
"""As it is, and compensated."""

MOST: Final = 1e4
"""Errors are magnified by no more than this."""

DIGITS: Final = 4
"""Decimals of an error in µm."""


def draw_picture(picture: Picture) -> Figure:
    """Draw what a page shows: the path with its windows on the left, error and feed along it on the right."""
    figure = new_figure(12.0, 5.6)
    panels = figure.subplot_mosaic([["path", "error"], ["path", "feed"]], width_ratios=(1.0, 1.2))
    _draw_path(panels["path"], picture)
    _draw_along(panels, picture)
    panels["path"].legend(
        frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize="small"
    )
    figure.suptitle(picture.name)
    return figure


def _draw_path(axes: Axes, picture: Picture) -> None:
    joints = picture.points(np.unique(picture.joints))
    flat = _flat(joints)
    axes.plot(*flat, color="#8c96a0", linewidth=0.8, label="path")
    for number, mark in enumerate(one for one in picture.marks if one.window is not None):
        assert mark.window is not None
        span = np.linspace(*mark.window, 64)
        span = np.mod(span, picture.length) if picture.closed else span
        label = "window" if number == 0 else None
        axes.plot(*_flat(_broken(picture, span)), color=WINDOW, linewidth=5.0, alpha=0.6, label=label)
    sizes = [0.0 if one.size is None else one.size.max for one in picture.traces]
    factor = min(magnification(float(np.ptp(joints, axis=0).max()), max(sizes)), MOST)
    for trace, colour in zip(picture.traces, COLOURS, strict=False):
        places = np.where(trace.counted[:, None], trace.foot + factor * trace.away, np.nan)
        axes.plot(*_flat(places), color=colour, linewidth=1.0, label=f"{trace.name}, error x {factor:g}")
    if picture.marks:
        axes.plot(*_flat(np.array([one.point for one in picture.marks])), "o", color=MARK, markersize=3.5)
    names = (*picture.axes, "")
    axes.set(xlabel=f"{names[0]} [mm]", ylabel=f"{names[1]} [mm]" if names[1] else "")
    axes.set_aspect("equal", adjustable="datalim")


def _broken(picture: Picture, span: Array) -> Array:
    """Points of a span that may run through the seam of a closed path, with a break there."""
    points = np.array(picture.points(span))
    points[np.flatnonzero(np.diff(span) < 0.0) + 1] = np.nan
    return points


def _flat(points: Array) -> Array:
    """First two coordinates [mm]; of a straight axis the second is 0."""
    flat = np.zeros((2, len(points)))
    flat[: min(points.shape[1], 2)] = points[:, :2].T / MM
    return flat


def _draw_along(panels: dict[str, Axes], picture: Picture) -> None:
    error, feed = panels["error"], panels["feed"]
    error.sharex(feed)
    for axes in (error, feed):
        for mark in picture.marks:
            if mark.window is not None:
                axes.axvspan(mark.window[0] / MM, mark.window[1] / MM, color=WINDOW, alpha=0.3, linewidth=0.0)
    for trace, colour in zip(picture.traces, COLOURS, strict=False):
        error.plot(trace.s / MM, _counted(trace), color=colour, linewidth=1.0, label=trace.name)
        feed.plot(trace.s / MM, trace.feed / MM_PER_MIN, color=colour, linewidth=1.0)
    side = "+ left of the path" if picture.kind == "path" and len(picture.axes) == 2 else ""
    error.set(ylabel="contour error [µm]")
    feed.set(xlabel="along the path [mm]", ylabel="feed [mm/min]", xlim=(0.0, picture.length / MM))
    error.set_title(side, fontsize="small", loc="left")
    error.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize="small")


def _counted(trace: Trace) -> Array:
    # What is smaller is the rounding of numbers, which would fill the picture.
    return np.where(trace.counted, np.round(trace.error / MICROMETRE, DIGITS), np.nan)
