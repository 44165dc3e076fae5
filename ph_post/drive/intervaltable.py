"""Tables of backlash intervals worked out off line, and looking an interval up in one.

A table covers, for each of its axes, a grid of swings (amplitude and peak speed: on a circle in the plane its
radius and its feed) and a grid of motors (β and C). What else decides the interval, the loop and the size of
the gap, is one and the same for the whole table and kept with it.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 5.3.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from typing import Final, Literal

import msgspec
import numpy as np

from ph_post.drive.gap import gap_constant, motor_gap
from ph_post.drive.sweep import settled_orbits
from ph_post.errors import InputError
from ph_post.types import Array, Axis, BacklashInterval, Machine, Servo, frozen
from ph_post.units import MM, MM_PER_MIN

EDGE: Final = 1e-5
"""How far beyond a table's edge, relative, still counts as on it: people round to six digits."""

SAME: Final = 1e-9
"""Relative difference up to which two constants of an axis are the same: units are converted on the way."""

NO_ORBIT: Final = "the interval table has no interval for this swing and motor"

Grid = Literal["radius", "feed", "beta", "C"]


class AxisTable(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The intervals of one axis.

    `lag` [s], `duration` [s] and `position` [m], as in BacklashInterval, have the shape (n_radius, n_feed,
    n_beta, n_C), NaN where there is no orbit. `servo` and `motor_gap` Δθ_m [rad] are what they hold for.
    """

    axis: str
    servo: Servo
    motor_gap: float
    lag: Array
    duration: Array
    position: Array


class IntervalTable(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Backlash intervals over grids, each ascending: β [1/s], C [rad/(m s²)], `radius` [m] and `feed` [m/s].

    `name` is what refusals call it; `machine` and `digest` are those of the machine it was made for.
    """

    machine: str
    digest: str
    beta: Array
    gain: Array
    radius: Array
    feed: Array
    axes: tuple[AxisTable, ...]
    name: str = "interval table"


def tabulate(
    machine: Machine, axes: Iterable[str], radius: Array, feed: Array, beta: Array, gain: Array
) -> IntervalTable:
    """Work out the intervals of some axes of a machine, all with feedback `load`.

    Implements the off-line tables of section 5.3 of [1]_ for the settled orbit of section 4.2.

    Parameters
    ----------
    machine : Machine
    axes : iterable of str
    radius, feed : ndarray
        Amplitudes [m] and peak speeds [m/s] of the swings, ascending.
    beta, gain : ndarray
        β [1/s] and C [rad/(m s²)], ascending.
    """
    return IntervalTable(
        machine=machine.name,
        digest=machine.digest,
        beta=frozen(beta),
        gain=frozen(gain),
        radius=frozen(radius),
        feed=frozen(feed),
        axes=tuple(_axis_table(machine.axes[name], radius, feed, beta, gain) for name in axes),
    )


def _axis_table(axis: Axis, radius: Array, feed: Array, beta: Array, gain: Array) -> AxisTable:
    orbits = [
        settled_orbits(axis.servo, axis.gap, a, speed / a, beta, gain)
        for a, speed in itertools.product(radius.tolist(), feed.tolist())
    ]
    shape = (radius.size, feed.size, beta.size, gain.size)
    lag, duration, position = (frozen(np.reshape(column, shape)) for column in zip(*orbits, strict=True))
    return AxisTable(
        axis=axis.name, servo=axis.servo, motor_gap=motor_gap(axis.gap),
        lag=lag, duration=duration, position=position,
    )  # fmt: skip


def look_up(
    table: IntervalTable, axis: Axis, amplitude: float, omega: float
) -> tuple[BacklashInterval | None, str]:
    """Look the interval of an axis up, as :func:`ph_post.drive.interval.backlash_interval` would solve it.

    Between the nodes ln Δt is taken as linear in ln a, ln aΩ, ln C and ln(1 + βΔt): for a small gap Δt is a
    product of powers of the first three, and of β where the motor's damping rules. The lag and x_i/a, which
    hardly change, are taken as linear in the same.

    Parameters
    ----------
    table : IntervalTable
    axis : Axis
        With feedback `load`.
    amplitude, omega : float
        a [m] and Ω [1/s], positive.

    Returns
    -------
    interval : BacklashInterval or None
        None where a node beside it has none.
    note : str
        Why there is none; empty otherwise.

    Raises
    ------
    InputError
        Where the table does not hold the axis, was made for another loop or gap, or does not reach so far.
    """
    own = _find_axis(table, axis)
    typical = own.duration[np.isfinite(own.duration)]
    delay = float(np.median(typical)) if typical.size else 0.0
    nodes = [
        _beside(table, axis, "radius", amplitude, math.log),
        _beside(table, axis, "feed", amplitude * omega, math.log),
        _beside(table, axis, "beta", axis.gap.beta or 0.0, lambda beta: math.log1p(beta * delay)),
        _beside(table, axis, "C", gap_constant(axis), math.log),
    ]
    corners = [corner for corner in itertools.product(*nodes) if math.prod(w for _, w in corner) > 0.0]
    weights = np.array([math.prod(weight for _, weight in corner) for corner in corners])
    places = tuple(np.array([[index for index, _ in corner] for corner in corners]).T)
    duration = own.duration[places]
    if np.isnan(duration).any():
        return None, NO_ORBIT
    relative = own.position[places] / table.radius[places[0]]
    return BacklashInterval(
        lag=float(weights @ own.lag[places]),
        duration=math.exp(float(weights @ np.log(duration))) if np.all(duration > 0.0) else 0.0,
        position=amplitude * float(weights @ relative),
    ), ""


def _beside(
    table: IntervalTable, axis: Axis, grid: Grid, value: float, scale: Callable[[float], float]
) -> list[tuple[int, float]]:
    """Nodes beside a value, with their weights on that scale."""
    nodes = {"radius": table.radius, "feed": table.feed, "beta": table.beta, "C": table.gain}[grid]
    if not nodes[0] * (1.0 - EDGE) <= value <= nodes[-1] * (1.0 + EDGE):
        raise _outside(table, axis, grid, nodes, value)
    if nodes.size == 1:
        return [(0, 1.0)]
    right = int(np.clip(np.searchsorted(nodes, value), 1, nodes.size - 1))
    low, high = scale(float(nodes[right - 1])), scale(float(nodes[right]))
    part = min(max((scale(value) - low) / (high - low), 0.0), 1.0) if high > low else 0.0
    return [(right - 1, 1.0 - part), (right, part)]


def _find_axis(table: IntervalTable, axis: Axis) -> AxisTable:
    """Return the axis' own table, which must have been made for the same loop and gap."""
    own = next((one for one in table.axes if one.axis == axis.name), None)
    if own is None:
        held = ", ".join(one.axis for one in table.axes)
        raise InputError(
            table.name, f"the table does not hold axis {axis.name}", expected=axis.name, got=held
        )
    pairs = (
        ("b", own.servo.b, axis.servo.b),
        ("c", own.servo.c, axis.servo.c),
        ("ki_over_kp_per_s", own.servo.ki_over_kp, axis.servo.ki_over_kp),
        ("kd_over_kp_s", own.servo.kd_over_kp, axis.servo.kd_over_kp),
        ("backlash_motor_rad", own.motor_gap, motor_gap(axis.gap)),
    )
    for key, ours, wanted in pairs:
        if not math.isclose(ours, wanted, rel_tol=SAME):
            what = f"the table was made for another machine ({table.machine}): axes.{axis.name}.{key}"
            raise InputError(table.name, what, expected=f"{wanted:.10g}", got=f"{ours:.10g}")
    return own


def _outside(table: IntervalTable, axis: Axis, grid: Grid, nodes: Array, value: float) -> InputError:
    unit, word = {"radius": (MM, "mm"), "feed": (MM_PER_MIN, "mm/min"), "beta": (1.0, "1/s"),
                  "C": (1.0, "rad/(m s²)")}[grid]  # fmt: skip
    low, high = nodes[0] / unit, nodes[-1] / unit
    span = f"{low:.9g} {word}" if nodes.size == 1 else f"{low:.9g} to {high:.9g} {word}"
    return InputError(
        table.name, f"axis {axis.name} lies outside the table's {grid}",
        expected=span, got=f"{value / unit:.9g} {word}",
    )  # fmt: skip
