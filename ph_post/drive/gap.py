"""The dead zone of an axis' gears: what the motor and the table do while they do not touch.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, sections 3.2 to 3.4.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ph_post.errors import InputError, SolveError
from ph_post.types import Array, Axis, Gap, Servo

NODES: Final = 16
"""Gauss-Legendre nodes on a panel of the quadrature of Eq. (17)."""

MAX_PANELS: Final = 4096
"""Panels after which the quadrature of Eq. (17) gives up: X(t) then jumps, or 1/β is below 1e-4 of the
time."""

QUADRATURE_TOLERANCE: Final = 1e-13
"""Relative change on halving the panels at which the quadrature counts as done."""


def gap_constant(axis: Axis) -> float:
    """C = N/(η r b) [rad/(m s²)]: the motor's acceleration in the gap for each metre of error.

    Implements the second part of the line after Eq. (16) of [1]_.

    Raises
    ------
    InputError
        Where the gap has no N, r or η (an axis with feedback `motor` or `none` needs none).
    """
    return motor_gain(axis.servo, axis.gap, axis.name)


def motor_gain(servo: Servo, gap: Gap, name: str = "") -> float:
    """C of :func:`gap_constant` for a loop and a gap; `name` is the axis named in an error."""
    fields = (gap.gear_ratio, gap.travel_per_rad, gap.inertia_fraction)
    if fields[0] is None or fields[1] is None or fields[2] is None:
        raise InputError(
            f"axes.{name}" if name else "gap",
            "a gap inside the loop needs more than its size",
            expected="gear_ratio, travel_per_rad and inertia_fraction",
        )
    return fields[0] / (fields[2] * fields[1] * servo.b)


def motor_gap(gap: Gap) -> float:
    """Δθ_m [rad], from the lost motion r Δθ_m / N where only that is given."""
    if gap.motor_angle is not None:
        return gap.motor_angle
    if gap.gear_ratio is None or gap.travel_per_rad is None:
        raise InputError(
            "gap", "the motor's angle in the gap is not known", expected="motor_angle or gear_ratio"
        )
    return gap.lost_motion * gap.gear_ratio / gap.travel_per_rad


def table_decay_rate(servo: Servo, inertia_fraction: float, beta: float) -> float:
    """α = B_a/J_a [1/s] of the freewheeling table (section 3.3 of [1]_).

    With J = J_m + J_a/N², B likewise, J_m = η J and β = B_m/J_m it is (c/b - ηβ)/(1 - η); a negative value
    would be a table that accelerates by itself (an impossible set of constants).
    """
    return (servo.c / servo.b - inertia_fraction * beta) / (1.0 - inertia_fraction)


def freewheel(speed: float, alpha: float, t: ArrayLike) -> Array:
    """Speed of the table left to itself, ω(t_i) exp(-α (t - t_i)) (section 3.3 of [1]_).

    The gap opens when the motor reverses, with speed 0: then the table stands, which is Eq. (14).
    """
    return np.asarray(speed * np.exp(-alpha * np.asarray(t, dtype=np.float64)))


def transmission(t: ArrayLike, openings: ArrayLike, durations: ArrayLike) -> Array:
    """h(t) of Eq. (10) of [1]_: 0 while one of the gaps is open (opening excluded, closing included), else 1.

    Parameters
    ----------
    t : array_like, shape (n,)
        Times [s].
    openings, durations : array_like, shape (m,)
        t_i and Δt_i [s].

    """
    # ERRATA: h multiplies ω_m in time, so that H(s) of Eq. (11) is no transfer function and Eq. (13) does not
    # follow: only the time domain is used here.
    since = np.asarray(t, dtype=np.float64)[:, np.newaxis] - np.asarray(openings, dtype=np.float64)
    inside = (since > 0.0) & (since <= np.asarray(durations, dtype=np.float64))
    return np.where(inside.any(axis=1), 0.0, 1.0)


def motor_motion(
    position: Callable[[Array], Array], x_i: float, gain: float, beta: float, t: float
) -> tuple[float, float]:
    """Speed and angle of the motor in the gap for any commanded motion, by quadrature.

    Implements Eq. (17) of [1]_ and the integral of Eq. (15), as the convolutions of C (X - x_i) with
    exp(-βt) and with (1 - exp(-βt))/β.

    Parameters
    ----------
    position : callable
        X(t) [m] for an array of times since the gap opened; smooth (P controller).
    x_i : float
        Where the table stands [m].
    gain, beta : float
        C [rad/(m s²)] and β [1/s].
    t : float
        Time since the gap opened [s].

    Returns
    -------
    speed, angle : float
        ω_m [rad/s] and ∫ω_m [rad].

    Raises
    ------
    SolveError
        Where halving the panels down to t/4096 does not settle it.
    """
    panels = 1
    previous = _convolve(position, x_i, beta, t, panels)
    while panels < MAX_PANELS:
        panels *= 2
        current = _convolve(position, x_i, beta, t, panels)
        change = np.abs(current - previous)
        if np.all(change <= QUADRATURE_TOLERANCE * np.abs(current)):
            return gain * float(current[0]), gain * float(current[1])
        previous = current
    raise SolveError(
        f"the motor's motion in the gap does not settle by quadrature (residual {gain * change.max():.3g})"
    )


def _convolve(position: Callable[[Array], Array], x_i: float, beta: float, t: float, panels: int) -> Array:
    """Both convolutions with `panels` equal panels, shape (2,)."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    half = 0.5 * t / panels
    times = (half * (2.0 * np.arange(panels)[:, np.newaxis] + 1.0 + nodes)).ravel()
    remaining = t - times
    decay = np.exp(-beta * remaining)
    rise = -np.expm1(-beta * remaining) / beta if beta else remaining
    forcing = half * np.tile(weights, panels) * (position(times) - x_i)
    return np.array([decay @ forcing, rise @ forcing])
