"""One turning point simulated as the paper does it: one gap, on one axis, opened once and by hand at t = 0.

Outside of that standstill both axes follow the loop without any gap, although they reverse again where the
feed is retrograde or the axis rings: check every result of this mode with the whole machine,
:mod:`ph_post.simulate.machine`.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, sections 5.2, 5.3 and 6.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.drive.backlash import modulated_interval
from ph_post.drive.servo import propagate
from ph_post.errors import InputError, SolveError
from ph_post.types import Array, Axis, Servo, frozen

STEP: Final = 1e-3
"""δt of section 6 [s]."""

EPSILON: Final = 1e-9
"""Parts of a step up to which the last sample counts as the end itself."""


class PaperRun(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Motion through a turning point at t = 0.

    `t` [s], ascending: every multiple of the step, and the ends wherever they lie. `commanded` and `executed`
    [m], shape (n, 2): x and y. `duration` is the Δt of Eq. (32) [s]; x stands from t = 0 to `pickup`, the
    first sample that is not before it.
    """

    t: Array
    commanded: Array
    executed: Array
    duration: float
    pickup: float


class RadialError(NamedTuple):
    """Maximum and root mean square of the fractional radial error |r - ρ_0|/ρ_0."""

    max: float
    rms: float


def simulate_turning_point(axis: Axis, position: Callable[[Array], Array], speed: Array, lead: float) -> PaperRun:
    """Run a commanded motion over [-lead, lead], with x turning at t = 0.

    Implements section 5.3 of [1]_: Eq. (31) for both axes; x stands from t = 0 for the Δt of Eq. (32), and
    from there, at rest, follows Eq. (31) again. Between samples the command is linear, and the motion is
    propagated exactly. That the gap has closed is seen at a sample, as it is where Eq. (32) is integrated in
    steps of δt. That lengthens the standstill by less than δt; in the paper's example the error grows by 1 %.

    Parameters
    ----------
    axis : Axis
        Both axes', with feedback `load` and a P or PD controller.
    position : callable
        X and Y [m] for times [s] of shape (n,), as an array of shape (n, 2).
    speed : ndarray, shape (2,)
        Both axes' at the start [m/s].
    lead : float
        T_star [s].

    Returns
    -------
    PaperRun

    Raises
    ------
    InputError
        Where the controller has an integrator, of which the paper's mode knows nothing.
    SolveError
        Where the motor does not cross the gap in time.
    """
    # ERRATA: section 5.3 prints x(-T_star) with the sign against Eq. (30); the axes start on the path.
    where = f"axes.{axis.name}.control"
    if axis.servo.cascade is not None:
        raise InputError(where, "the paper's mode knows no cascade", expected="a P or PD controller")
    if axis.servo.ki_over_kp:
        raise InputError(where, "the paper's mode knows no integrator", expected="a P or PD controller")
    inside = math.ceil(lead / STEP * (1.0 - EPSILON)) - 1
    grid = np.concatenate([[-lead], STEP * np.arange(-inside, inside + 1), [lead]])
    commanded = position(grid)
    executed = _follow(axis.servo, grid, commanded, np.stack([commanded[0], speed]))
    x_i = executed[grid == 0.0, 0]
    interval, why = modulated_interval(axis, lambda t: position(t)[:, 0], float(x_i[0]), lead)
    if interval is None:
        raise SolveError(why)
    pickup = float(grid[np.searchsorted(grid, interval.duration)])
    if pickup > 0.0:
        executed[(grid > 0.0) & (grid < pickup), 0] = x_i
        after = grid >= pickup
        at_rest = np.stack([x_i, np.zeros(1)])
        executed[after, :1] = _follow(axis.servo, grid[after], commanded[after, :1], at_rest)
    return PaperRun(
        t=frozen(grid),
        commanded=frozen(commanded),
        executed=frozen(executed),
        duration=interval.duration,
        pickup=pickup,
    )


def _follow(servo: Servo, t: Array, command: Array, start: Array) -> Array:
    """Propagate Eq. (31) of [1]_ under a command that is linear between the times `t`.

    Behind a command X + V t the loop settles to X - c V + V t, whatever k_d.

    Parameters
    ----------
    servo : Servo
        With k_i = 0.
    t : ndarray, shape (n,)
    command : ndarray, shape (n, m)
        For m axes.
    start : ndarray, shape (2, m)
        Places and speeds at the first time.

    Returns
    -------
    ndarray, shape (n, m)
    """
    steps = np.diff(t)
    slopes = np.diff(command, axis=0) / steps[:, np.newaxis]
    lag = servo.c * slopes
    settled = np.stack([command[:-1] - lag, slopes], axis=1)  # where each step begins, and where it ends
    settling = np.stack([command[1:] - lag, slopes], axis=1)
    over = propagate(servo, steps)
    states = np.empty((t.size, *start.shape))
    states[0] = start
    for k in range(steps.size):
        states[k + 1] = over[k] @ (states[k] - settled[k]) + settling[k]
    return states[:, 0]


def radial_deviation(positions: Array, radius: float) -> Array:
    """E = (r - ρ_0)/ρ_0 of section 6 of [1]_, r from the centre (-ρ_0, 0) of the osculating circle."""
    return np.asarray(np.hypot(positions[:, 0] + radius, positions[:, 1]) / radius - 1.0)


def radial_error(t: Array, executed: Array, radius: float, t_star: float) -> RadialError:
    """Sum up the fractional radial error over [-t_star, t_star], as Figure 11 of [1]_ shows it.

    The times `t` are equidistant there.
    """
    inside = np.abs(t) <= t_star * (1.0 + 1e-12)
    deviation = radial_deviation(executed[inside], radius)
    squares = deviation**2
    mean_square = (squares.sum() - 0.5 * (squares[0] + squares[-1])) / (squares.size - 1)
    return RadialError(max=float(np.abs(deviation).max()), rms=math.sqrt(float(mean_square)))
