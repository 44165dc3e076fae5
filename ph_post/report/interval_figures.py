"""The picture of an interval table: how long backlash holds an axis, over β and C."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from ph_post.drive.intervaltable import AxisTable, IntervalTable
from ph_post.report.figures import new_figure
from ph_post.units import MM, MM_PER_MIN, MS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LINES: Final = 6
"""Values of the coarser grid that get a line."""


def draw_intervals(table: IntervalTable) -> Figure:
    """Draw Δt of every axis on the first circle: along the finer grid, a line a value of the other."""
    figure = new_figure(4.0 + 4.0 * len(table.axes), 4.2)
    panels = figure.subplots(1, len(table.axes), squeeze=False, sharey=True)[0]
    for axes, one in zip(panels, table.axes, strict=True):
        _draw_axis(axes, table, one)
    panels[0].set(ylabel="held in its gap [ms]")
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
