"""The backlash interval of an axis on a circle, solved or looked up in a table.

A table covers, for each of its axes, a grid of swings (amplitude and peak speed: on a circle in the plane its
radius and its feed) and a grid of motors (β and C). The loop and the size of the gap are the same for the
whole table and are kept with it.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, sections 4 and 5.3.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Final, Literal

import msgspec
import numpy as np

from ph_post.drive.axes import refuse_cascades
from ph_post.drive.backlash import gap_constant, motor_gap
from ph_post.drive.cascade import loop_response
from ph_post.drive.servo import harmonic_response, is_stable
from ph_post.drive.steady_state import OUT_OF_RANGE, UNDAMPED, find_orbit, is_computable, steady_intervals
from ph_post.errors import InputError
from ph_post.types import Array, Axis, BacklashInterval, Gap, Loop, Machine, Servo, frozen
from ph_post.units import MM, MM_PER_MIN

REMEMBERED: Final = 8192
"""Intervals kept: paths repeat their radii, and thousands of turning points ask for the same few."""

SMALLER_THAN_GAP: Final = "the axis swings by less than its lost motion, so that the table does not follow it at all"
NO_SWING: Final = "there is no swing to follow: amplitude and feed must be positive"
NO_INERTIA: Final = "b is zero: without inertia the motor crosses the backlash at once"


def backlash_interval(axis: Axis, amplitude: float, omega: float) -> tuple[BacklashInterval | None, str]:
    """Return the backlash interval an axis settles to at each reversal of X = a sin Ωt.

    With feedback from the table (`load`) it is that of section 4 of [1]_. With feedback from the motor, or
    none, the gap lies behind the loop: the motor side follows the command as if there were no gap, and the
    table stands from its reversal until it has come back by the lost motion (a play operator, closed form).

    Parameters
    ----------
    axis : Axis
    amplitude : float
        a [m], of the axis' swing on the osculating circle.
    omega : float
        Ω [1/s], feed times curvature.

    Returns
    -------
    interval : BacklashInterval or None
        None where no such orbit exists.
    note : str
        Why there is none, or what was left out; empty otherwise.

    Examples
    --------
    >>> from ph_post.types import Axis, Gap, Limits, Servo
    >>> stepper = Axis(name="X", feedback="none", servo=Servo(b=0.0, c=0.0), gap=Gap(lost_motion=1e-4),
    ...                limits=Limits(velocity=0.1, acceleration=1.0, jerk=100.0))
    >>> interval, note = backlash_interval(stepper, amplitude=0.02, omega=1.0)
    >>> round(interval.duration, 6)  # arccos(1 - 0.1 / 20)
    0.100042
    """
    return _interval(axis.loop, axis.servo, axis.gap, amplitude, omega)


@lru_cache(maxsize=REMEMBERED)
def _interval(
    loop: Loop, servo: Servo, gap: Gap, amplitude: float, omega: float
) -> tuple[BacklashInterval | None, str]:
    """Dispatch on the loop (an Axis itself cannot be hashed: its effects hold mappings)."""
    if not (0.0 < amplitude < math.inf and 0.0 < omega < math.inf):
        return None, NO_SWING
    if not is_computable(servo, gap, amplitude, omega):
        return None, OUT_OF_RANGE
    if not loop.encloses_backlash:
        return play_interval(servo, gap, amplitude, omega)
    if servo.cascade is not None:
        return None, CASCADE_INSIDE
    if servo.b == 0.0:
        interval, note = play_interval(servo, Gap(lost_motion=0.0), amplitude, omega)
        return interval, note or NO_INERTIA
    return find_orbit(servo, gap, amplitude, omega)


CASCADE_INSIDE: Final = "how long a cascade with its scale on the table takes is not worked out: simulate shows it"


def play_interval(servo: Servo, gap: Gap, amplitude: float, omega: float) -> tuple[BacklashInterval | None, str]:
    """Return the interval of a table that hangs on the motor side by a play of the lost motion L.

    The motor side settles to a swing G = a |x/X| behind the command (Eq. 8 of [1]_, or Eq. 7); the table
    stands while that returns from G to G - L, thus for ΩΔt = arccos(1 - L/G). `position` is the table's,
    half the lost motion short of the motor's.
    """
    if servo.cascade is not None:
        response = complex(loop_response(servo, np.array([omega]))[0])
    else:
        ideal = servo.b == 0.0 and servo.c == 0.0
        if not (ideal or is_stable(servo)):
            return None, UNDAMPED
        response, _ = harmonic_response(servo, omega)
    swing = amplitude * abs(response)
    if gap.lost_motion > 2.0 * swing:
        return None, SMALLER_THAN_GAP
    angle = 2.0 * math.asin(math.sqrt(0.5 * gap.lost_motion / swing)) if gap.lost_motion else 0.0
    lag = -cmath.phase(response) / omega
    return BacklashInterval(lag=lag, duration=angle / omega, position=swing - 0.5 * gap.lost_motion), ""


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
    names = tuple(axes)
    refuse_cascades(machine, names)
    return IntervalTable(
        machine=machine.name,
        digest=machine.digest,
        beta=frozen(beta),
        gain=frozen(gain),
        radius=frozen(radius),
        feed=frozen(feed),
        axes=tuple(_axis_table(machine.axes[name], radius, feed, beta, gain) for name in names),
    )


def _axis_table(axis: Axis, radius: Array, feed: Array, beta: Array, gain: Array) -> AxisTable:
    orbits = [
        steady_intervals(axis.servo, axis.gap, a, speed / a, beta, gain)
        for a, speed in itertools.product(radius.tolist(), feed.tolist())
    ]
    shape = (radius.size, feed.size, beta.size, gain.size)
    lag, duration, position = (frozen(np.reshape(column, shape)) for column in zip(*orbits, strict=True))
    return AxisTable(
        axis=axis.name,
        servo=axis.servo,
        motor_gap=motor_gap(axis.gap),
        lag=lag,
        duration=duration,
        position=position,
    )


def look_up(table: IntervalTable, axis: Axis, amplitude: float, omega: float) -> tuple[BacklashInterval | None, str]:
    """Look the interval of an axis up, as :func:`ph_post.drive.intervals.backlash_interval` would solve it.

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
    if axis.servo.cascade is not None:
        return None, CASCADE_INSIDE
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
        raise InputError(table.name, f"the table does not hold axis {axis.name}", expected=axis.name, got=held)
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
    unit, word = {
        "radius": (MM, "mm"),
        "feed": (MM_PER_MIN, "mm/min"),
        "beta": (1.0, "1/s"),
        "C": (1.0, "rad/(m s²)"),
    }[grid]
    low, high = nodes[0] / unit, nodes[-1] / unit
    span = f"{low:.9g} {word}" if nodes.size == 1 else f"{low:.9g} to {high:.9g} {word}"
    return InputError(
        table.name,
        f"axis {axis.name} lies outside the table's {grid}",
        expected=span,
        got=f"{value / unit:.9g} {word}",
    )
