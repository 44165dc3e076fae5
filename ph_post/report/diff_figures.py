"""The picture of two programs: their tool paths, how far they are apart, and their feeds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ph_post.audit.diff.record import Comparison
from ph_post.report.diffpage import feed_steps, path_points, places_off
from ph_post.report.diffs import Programs, summary
from ph_post.report.figures import TWO, draw_moves, legend_above, magnification, new_figure, steps_of
from ph_post.types import BoolArray
from ph_post.units import MM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def draw_comparison(found: Comparison, programs: Programs) -> Figure:
    """Draw the tool path of A with B's deviations magnified, and deviation and feeds along A."""
    figure = new_figure(12.0, 5.6)
    panels = figure.subplot_mosaic([["path", "off"], ["path", "feed"]], width_ratios=(1.0, 1.2))
    path = path_points(found.travel.outlines[0], programs[0])
    off = [] if found.travel.sides is None else [places_off(found.travel, programs, k) for k in (0, 1)]
    _draw_path(panels["path"], path, off, found.max_deviation or 0.0)
    panels["off"].sharex(panels["feed"])
    for one, colour in zip(off, TWO, strict=False):
        away = np.linalg.norm(np.array([one["dx"], one["dy"], one["dz"]]), axis=0)
        line = steps_of(np.array([one["s"], away]), _on_the_way(one["stretch"]))
        panels["off"].plot(*line, color=colour, linewidth=1.0)
    for k, (name, colour) in enumerate(zip("AB", TWO, strict=True)):
        steps = feed_steps(found.travel, programs, k)
        values = np.array([np.nan if one is None else one for one in steps["feed"]], dtype=np.float64)
        if values.size:
            panels["feed"].stairs(values, steps["s"], color=colour, baseline=None, label=name)
    panels["off"].set(ylabel="deviation [mm]")
    panels["feed"].set(xlabel="along A [mm]", ylabel="programmed feed [mm/min]")
    legend_above(panels["feed"])
    figure.suptitle("\n".join(summary(found, programs)), fontsize="medium", wrap=True)
    return figure


def _draw_path(axes: Axes, path: dict[str, Any], off: list[dict[str, Any]], most: float) -> None:
    places = np.array([path["x"], path["y"]], dtype=np.float64)
    rapid = np.array(path["rapid"], dtype=bool)
    draw_moves(axes, places, np.ones(rapid.size, dtype=bool), rapid, TWO[0], "A")
    extent = float(np.ptp(places, axis=1).max()) if places.size else 0.0
    factor = magnification(extent * MM, most)
    for one, colour in zip(off[1:], TWO[1:], strict=False):
        moved = np.array([one["x"], one["y"]]) + factor * np.array([one["dx"], one["dy"]])
        rapid = np.array(one["rapid"], dtype=bool)
        steps = _on_the_way(one["stretch"])
        draw_moves(axes, moved, steps, rapid, colour, f"B, deviation x {factor:g}")
    axes.set(xlabel="X [mm]", ylabel="Y [mm]")
    axes.set_aspect("equal", adjustable="datalim")
    legend_above(axes)


def _on_the_way(stretch: list[int]) -> BoolArray:
    """Whether the steps of a line stay in one stretch."""
    return np.asarray(np.diff(stretch, prepend=-1) == 0)
