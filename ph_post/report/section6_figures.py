"""Figures 8 to 11 of the paper: modulated feed through a turning point, section 6."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ph_post.compensate import shapes
from ph_post.compensate.profile import coefficients_from_ratio
from ph_post.report.example import AMPLITUDE
from ph_post.report.figures import new_figure
from ph_post.report.section4_figures import COMMANDED, EXECUTED, MAGNIFICATION, magnified
from ph_post.report.section6 import error_honestly, error_in_papers_mode, run_in_papers_mode
from ph_post.simulate.paper_mode import PaperRun, RadialError
from ph_post.types import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN_PROFILES = ((4, -1.5, "blue"), (10, -2.8, "red"))
"""Degree, V_{n/2} / V_c and colour of Figure 8."""

SHOWN_RATIOS = (1.0, 0.25, -0.5)
"""V(½)/V_c of Figure 9, from left to right; the last is that of Figure 10."""

RATIOS = np.round(np.linspace(-0.6, 1.4, 41), 2)
"""V(½)/V_c of Figure 11."""

EXTENT = 0.11
"""Half the height of path shown in Figure 9 [m]."""

CLOSE_UP = 0.014
"""Half the height of path shown in Figure 10 [m]."""


def draw_figure_8() -> Figure:
    """Draw V/V_c of two profiles, and the constant feed on either side of them."""
    figure = new_figure(7.0, 4.5)
    axes = figure.subplots()
    tau = np.linspace(0.0, 1.0, 801)
    for degree, factor, colour in SHOWN_PROFILES:
        coefficients = coefficients_from_ratio(1.0, degree).copy()
        coefficients[degree // 2] = factor
        feed = shapes.value(shapes.single(coefficients), tau)
        label = f"n = {degree}, $V_{{{degree // 2}}}$ = {factor:g} $V_c$"
        axes.plot([-0.25, *tau, 1.25], [1.0, *feed, 1.0], color=colour, label=label)
    axes.set(xlabel="τ", ylabel="V / V$_c$", xlim=(-0.25, 1.25), ylim=(0.0, 1.1))
    axes.legend(frameon=False, loc="lower left")
    return figure


def draw_figure_9() -> Figure:
    """Draw commanded and executed paths for three depths of the dip, the radial error magnified."""
    figure = new_figure(9.0, 7.0)
    panels = figure.subplots(1, len(SHOWN_RATIOS), sharey=True)
    for panel, ratio in zip(panels, SHOWN_RATIOS, strict=True):
        _draw_paths(panel, run_in_papers_mode(ratio), EXTENT)
        panel.set(title=f"V(½)/V$_c$ = {ratio:g}", xlim=(-0.04, 0.03), ylim=(-EXTENT, EXTENT))
    panels[0].set(ylabel="y [m]")
    figure.legend(*panels[0].get_legend_handles_labels(), frameon=False, loc="outside upper center", ncols=2)
    return figure


def draw_figure_10() -> Figure:
    """Draw the retrograde case of Figure 9 close up."""
    figure = new_figure(4.5, 6.5)
    axes = figure.subplots()
    _draw_paths(axes, run_in_papers_mode(SHOWN_RATIOS[-1]), CLOSE_UP)
    axes.set(ylabel="y [m]", title=f"V(½)/V$_c$ = {SHOWN_RATIOS[-1]:g}")
    axes.set(xlim=(-0.5 * CLOSE_UP, 0.5 * CLOSE_UP), ylim=(-CLOSE_UP, CLOSE_UP))
    axes.locator_params(axis="x", nbins=3)
    figure.legend(frameon=False, loc="outside upper center", ncols=2)
    return figure


def _draw_paths(axes: Axes, run: PaperRun, extent: float) -> None:
    """Draw what lies within `extent` of the turning point, in coordinates that have it as origin."""
    shown = np.abs(run.commanded[:, 1]) <= 1.2 * extent
    centre = np.array([[-AMPLITUDE], [0.0]])
    executed = magnified(run.executed[shown].T - centre, AMPLITUDE) + centre
    axes.plot(*run.commanded[shown].T, color=COMMANDED, label="commanded")
    axes.plot(*executed, color=EXECUTED, label=f"executed, error x {MAGNIFICATION:.0f}")
    axes.set(xlabel="x [m]")
    axes.set_aspect("equal", adjustable="box")


def draw_figure_11() -> Figure:
    """Draw maximum and rms of the fractional radial error by V(½)/V_c: as in the paper, and honestly."""
    figure = new_figure(11.0, 4.8)
    left, right = figure.subplots(1, 2, sharey=True)
    _draw_errors(left, error_in_papers_mode)
    left.set(title="as in the paper: one gap on x, opened at t = 0", ylabel="fractional radial error")
    left.legend(frameon=False, loc="upper left")
    _draw_errors(right, error_honestly)
    right.set(title="whole machine: a gap at every reversal of x and y")
    return figure


def _draw_errors(axes: Axes, error: Callable[[float], RadialError]) -> None:
    errors: Array = np.array([error(ratio) for ratio in RATIOS.tolist()])
    axes.plot(RATIOS, errors[:, 0], "o", color="red", markersize=4.0, label="maximum")
    axes.plot(RATIOS, errors[:, 1], "o", color="blue", markersize=4.0, label="root mean square")
    axes.axvline(1.0, color="black", linestyle="--", linewidth=1.0)
    axes.set(xlabel="V(½)/V$_c$", ylim=(0.0, None))
