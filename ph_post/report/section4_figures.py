"""Figures 5 to 7 of the paper: an axis with backlash on the settled orbit of section 4.2."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from ph_post.drive.harmonic import motion_after_pickup, steady_motion
from ph_post.drive.settled import settled_orbit
from ph_post.errors import SolveError
from ph_post.io.machinefile import read_machine
from ph_post.report.example import AMPLITUDE, BETWEEN_REVERSALS
from ph_post.report.figures import new_figure
from ph_post.types import Array, Axis, BacklashInterval, BoolArray

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
        """Whether the axis stands, for times about T/2."""
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
    found = settled_orbit(axis.servo, axis.gap, AMPLITUDE, omega)
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
