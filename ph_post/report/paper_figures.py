"""The figures of the paper: 1 and 2, drawn on the shipped quintic, here; the others by their sections."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ph_post.analysis import Analysis
from ph_post.geometry.frenet import curvature
from ph_post.osculating import circles_at, deviation
from ph_post.report import section4_figures, section6_figures
from ph_post.report.figures import new_figure, render
from ph_post.report.paper import figure_1_analysis, figure_1_windows
from ph_post.types import Array, TurningPoint, Window

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CURVE, CIRCLE = "#c0392b", "#0b62a4"
SAMPLES = 801


def paper_pictures(stage: Callable[[str], None]) -> dict[str, bytes]:
    """Draw Figures 1, 2 and 5 to 11 (3 and 4 are schemes): pictures by the names of their files."""
    analysis = figure_1_analysis()
    drawings: dict[int, Callable[[], Figure]] = {
        1: lambda: draw_figure_1(analysis),
        2: lambda: draw_figure_2(analysis, figure_1_windows()),
        5: section4_figures.draw_figure_5,
        6: section4_figures.draw_figure_6,
        7: section4_figures.draw_figure_7,
        8: section6_figures.draw_figure_8,
        9: section6_figures.draw_figure_9,
        10: section6_figures.draw_figure_10,
        11: section6_figures.draw_figure_11,
    }
    pictures = {}
    for number, draw in drawings.items():
        stage(f"drawing Figure {number}")
        pictures[f"figure{number}.png"] = render(draw(), "png")
    return pictures


def draw_figure_1(analysis: Analysis) -> Figure:
    """Draw the curve with the osculating circles at its turning points, and its curvature."""
    figure = new_figure()
    left, right = figure.subplots(1, 2)
    s = np.linspace(0.0, analysis.track.length, SAMPLES)
    place = analysis.track.locate(s)
    left.plot(*analysis.track.derivatives(*place, 0)[0].T, color=CURVE, label="path", zorder=3)
    for number, point in enumerate(analysis.turning_points):
        left.plot(
            *_circle(analysis, point).T, color=CIRCLE, label="osculating circle" if number == 0 else None
        )
    left.set(xlabel="x [m]", ylabel="y [m]")
    left.set_aspect("equal")
    left.legend(frameon=False)
    right.plot(s, curvature(analysis.track.derivatives(*place, 2)), color=CURVE)
    for point in analysis.turning_points:
        right.axvline(point.s, color=CIRCLE, linestyle=":", linewidth=1.0)
    right.set(xlabel="arc length s [m]", ylabel="curvature κ [1/m]")
    return figure


def draw_figure_2(analysis: Analysis, windows: tuple[Window, ...]) -> Figure:
    """Draw |r(s) - c(s)| about each turning point; dashed lines show the extent of Eq. (6)."""
    figure = new_figure()
    panels = np.atleast_1d(figure.subplots(1, len(windows)))
    for panel, window in zip(panels, windows, strict=True):
        point = analysis.turning_points[window.turning_point]
        offsets = np.linspace(-1.25, 1.25, SAMPLES) * window.estimate
        offsets = offsets[(point.s + offsets >= 0.0) & (point.s + offsets <= analysis.track.length)]
        panel.plot(offsets, deviation(analysis.track, point, offsets), color=CURVE)
        for side in (-window.estimate, window.estimate):
            panel.axvline(side, color="black", linestyle="--", linewidth=1.0)
        axis = "vertical" if point.axis == analysis.path.axes[0] else "horizontal"
        panel.set(xlabel="s [m]", ylabel="|r(s) - c(s)| [m]", title=f"{axis} turning point")
    return figure


def _circle(analysis: Analysis, point: TurningPoint) -> Array:
    _, after = circles_at(analysis.track, [point])
    once_round = 2.0 * np.pi / abs(point.curvature or np.inf)
    circle: Array = after.at(np.linspace(0.0, once_round, SAMPLES)[None, :])[0]
    return circle
