"""Figures 1, 2 and 5 to 11 of the paper.

Figures 1 and 2 are drawn on the shipped quintic, 5 to 7 show an axis in the steady state of section 4.2, 8 to 11
a modulated feed through a turning point, section 6.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

import numpy as np

from ph_post.analysis.osculating import circles_at, deviation
from ph_post.analysis.path_analysis import Analysis
from ph_post.compensate import shapes
from ph_post.compensate.profile import coefficients_from_ratio
from ph_post.drive.harmonic import motion_after_pickup, steady_motion
from ph_post.drive.machinefile import read_machine
from ph_post.drive.steady_state import steady_interval
from ph_post.errors import SolveError
from ph_post.geometry.frenet import curvature
from ph_post.progress import Progress
from ph_post.report.figures import new_figure, write_figure
from ph_post.report.paper import (
    AMPLITUDE,
    BETWEEN_REVERSALS,
    error_in_papers_mode,
    error_on_whole_machine,
    figure_1_analysis,
    figure_1_windows,
    run_in_papers_mode,
)
from ph_post.simulate.paper_mode import PaperRun, RadialError
from ph_post.types import Array, Axis, BacklashInterval, BoolArray, TurningPoint, Window

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


COMMANDED, EXECUTED, STANDING = "red", "blue", "cyan"
"""Colours of the paper."""

MAGNIFICATION: Final = 25.0
"""By which the paper enlarges radial errors."""

NEAR, FAR = (-0.2, 0.6), (-0.4, 1.1)
"""Time shown of Figures 5 and 6, from the reversal of the command [s]."""

PERIODS = np.geomspace(1.5, 30.0, 120)
"""T of Figure 7 [s]."""


class Orbit:
    """The settled motion of an axis under X = a sin Ωt, from its pick-up before t = 0 to that after T/2.

    Parameters
    ----------
    axis : Axis
    period : float
        T, the time between reversals [s].
    """

    def __init__(self, axis: Axis, period: float) -> None:
        self.axis, self.period, self.omega = axis, period, math.pi / period
        self.interval = _interval(axis, self.omega)
        self.opens = 0.5 * period + self.interval.lag
        self.closes = self.opens + self.interval.duration

    def standing(self, t: Array) -> BoolArray:
        """Return whether the axis stands, for times about T/2."""
        inside: BoolArray = (t >= self.opens) & (t <= self.closes)
        return inside

    def position(self, t: Array) -> Array:
        """X [m] at times between the pick-up before and the reversal after T/2."""
        place = self.interval.position
        before = self._after_pickup(self.closes - self.period, -place, t)
        after = self._after_pickup(self.closes, place, np.maximum(t, self.closes))
        return np.where(t < self.opens, before, np.where(t <= self.closes, place, after))

    def _after_pickup(self, pickup: float, place: float, t: Array) -> Array:
        motion = motion_after_pickup(self.axis.servo, AMPLITUDE, self.omega, pickup, place, t)
        return np.asarray(motion[0])


def _interval(axis: Axis, omega: float) -> BacklashInterval:
    found = steady_interval(axis.servo, axis.gap, AMPLITUDE, omega)
    if found is None:
        raise SolveError("the paper's example has no settled orbit")
    return found


def draw_figure_5() -> Figure:
    """Draw x(t) near a reversal: commanded red, executed blue, cyan while the axis stands."""
    orbit = Orbit(read_machine("paper").axes["X"], BETWEEN_REVERSALS)
    t = _times(orbit, *NEAR)
    figure = new_figure(7.0, 4.5)
    axes = figure.subplots()
    axes.plot(t, AMPLITUDE * np.sin(orbit.omega * t), color=COMMANDED, label="commanded")
    _plot_phases(axes, np.stack([t, orbit.position(t)]), orbit.standing(t))
    axes.set(xlabel="t [s]", ylabel="x [m]", xlim=(t[0], t[-1]))
    axes.legend(frameon=False)
    return figure


def draw_figure_6() -> Figure:
    """Draw the path about the turning point of x on the circle, its radial error magnified.

    The y axis, of the same drive, is a quarter period ahead: y(t) = x(t + T/2), far from its own reversals.
    """
    orbit = Orbit(read_machine("paper").axes["X"], BETWEEN_REVERSALS)
    t = _times(orbit, *FAR)
    quarter = 0.5 * orbit.period
    executed = np.stack([orbit.position(t), -orbit.position(t - quarter)])  # x(t + T/2) = -x(t - T/2)
    angle = orbit.omega * t
    figure = new_figure(4.5, 6.5)
    axes = figure.subplots()
    axes.plot(AMPLITUDE * np.sin(angle), AMPLITUDE * np.cos(angle), color=COMMANDED, label="commanded")
    _plot_phases(axes, magnified(executed, AMPLITUDE), orbit.standing(t))
    axes.set(xlabel="x [m]", ylabel="y [m]", title=f"radial error x {MAGNIFICATION:.0f}")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(frameon=False, loc="upper left")
    return figure


def magnified(positions: Array, radius: float) -> Array:
    """Positions about the origin, shape (2, n), whose radial distance from the circle is magnified."""
    r = np.hypot(*positions)
    return np.asarray(positions * ((radius + MAGNIFICATION * (r - radius)) / r))


def draw_figure_7() -> Figure:
    """Draw how far the y axis travels while the x axis stands, by the time T between reversals."""
    axis = read_machine("paper").axes["X"]
    travel = [_standstill_travel(axis, period) for period in PERIODS.tolist()]
    figure = new_figure(7.0, 4.5)
    axes = figure.subplots()
    axes.plot(PERIODS, travel, color=EXECUTED)
    axes.set(xlabel="T [s]", ylabel="distance travelled [m]", xlim=(0.0, PERIODS[-1]), ylim=(0.0, None))
    return figure


def _standstill_travel(axis: Axis, period: float) -> float:
    """Way of the orthogonal axis, a cos Ωt behind its servo, during Δt."""
    omega = math.pi / period
    interval = _interval(axis, omega)
    ends = 0.5 * period + interval.lag + np.array([0.0, interval.duration])
    y = steady_motion(axis.servo, AMPLITUDE, omega, ends + 0.5 * period)[0]
    return float(abs(y[1] - y[0]))


def _times(orbit: Orbit, before: float, after: float) -> Array:
    """Lay times about T/2, the ends of the standstill among them, so that the colours meet."""
    t = 0.5 * orbit.period + np.linspace(before, after, 1501)
    return np.union1d(t, [orbit.opens, orbit.closes])


def _plot_phases(axes: Axes, motion: Array, standing: BoolArray) -> None:
    """Draw the executed motion in the colours of its phases."""
    first, last = np.flatnonzero(standing)[[0, -1]]
    for part, colour, label in (
        (slice(None, first + 1), EXECUTED, "executed"),
        (slice(last, None), EXECUTED, None),
        (slice(first, last + 1), STANDING, "backlash"),
    ):
        axes.plot(*motion[:, part], color=colour, label=label)


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
    _draw_errors(right, error_on_whole_machine)
    right.set(title="whole machine: a gap at every reversal of x and y")
    return figure


def _draw_errors(axes: Axes, error: Callable[[float], RadialError]) -> None:
    errors: Array = np.array([error(ratio) for ratio in RATIOS.tolist()])
    axes.plot(RATIOS, errors[:, 0], "o", color="red", markersize=4.0, label="maximum")
    axes.plot(RATIOS, errors[:, 1], "o", color="blue", markersize=4.0, label="root mean square")
    axes.axvline(1.0, color="black", linestyle="--", linewidth=1.0)
    axes.set(xlabel="V(½)/V$_c$", ylim=(0.0, None))


CURVE, CIRCLE = "#c0392b", "#0b62a4"
SAMPLES = 801


def paper_pictures(progress: Progress) -> dict[str, bytes]:
    """Draw Figures 1, 2 and 5 to 11 (3 and 4 are schemes): pictures by the names of their files."""
    analysis = figure_1_analysis()
    drawings: dict[int, Callable[[], Figure]] = {
        1: lambda: draw_figure_1(analysis),
        2: lambda: draw_figure_2(analysis, figure_1_windows()),
        5: draw_figure_5,
        6: draw_figure_6,
        7: draw_figure_7,
        8: draw_figure_8,
        9: draw_figure_9,
        10: draw_figure_10,
        11: draw_figure_11,
    }
    pictures = {}
    for number, draw in drawings.items():
        progress(f"drawing Figure {number}")
        pictures[f"figure{number}.png"] = write_figure(draw(), f"figure{number}.png")
    return pictures


def draw_figure_1(analysis: Analysis) -> Figure:
    """Draw the curve with the osculating circles at its turning points, and its curvature."""
    figure = new_figure()
    left, right = figure.subplots(1, 2)
    s = np.linspace(0.0, analysis.track.length, SAMPLES)
    place = analysis.track.locate(s)
    left.plot(*analysis.track.derivatives(*place, 0)[0].T, color=CURVE, label="path", zorder=3)
    for number, point in enumerate(analysis.turning_points):
        left.plot(*_circle(analysis, point).T, color=CIRCLE, label="osculating circle" if number == 0 else None)
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
