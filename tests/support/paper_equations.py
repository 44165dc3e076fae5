"""Equations of sections 3 and 4 of the paper that only tests need: another way to what the package computes.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from ph_post.drive.harmonic import OpenGap
from ph_post.drive.servo import discriminant
from ph_post.errors import SolveError
from ph_post.types import Array, Servo

Damping = Literal["over", "critical", "under"]

NODES: Final = 16
"""Gauss-Legendre nodes on a panel of the quadrature of Eq. (17)."""

MAX_PANELS: Final = 4096
"""Panels after which the quadrature of Eq. (17) gives up: X(t) then jumps, or 1/β is below 1e-4 of the
time."""

QUADRATURE_TOLERANCE: Final = 1e-13
"""Relative change on halving the panels at which the quadrature counts as done."""


def loop_gain(k_p: float, k_a: float, k_t: float, travel_per_rad: float, gear_ratio: float) -> float:
    """K = k_p k_a k_t r / N [N m per rad of motor and m of error], as in Eq. (13) of [1]_."""
    return k_p * k_a * k_t * travel_per_rad / gear_ratio


def total_inertia(motor: float, gear: float, axis: float, gear_ratio: float) -> float:
    """J = J_m + J_g + J_a / N² as the motor feels it [kg m²]. Implements Eq. (12) of [1]_."""
    return motor + gear + axis / gear_ratio**2


def servo_from_constants(
    *, inertia: float, damping: float, gain: float, ki_over_kp: float = 0.0, kd_over_kp: float = 0.0
) -> Servo:
    """Return the loop of an axis given by its physical constants.

    Implements Eq. (9) of [1]_: b = J/K, c = B/K.

    Parameters
    ----------
    inertia, damping : float
        J [kg m²] and B [kg m²/s], everything the motor shaft feels.
    gain : float
        K of :func:`loop_gain`.
    ki_over_kp, kd_over_kp : float
        k_i/k_p [1/s] and k_d/k_p [s].

    Examples
    --------
    >>> servo = servo_from_constants(inertia=1e-3, damping=1e-2, gain=loop_gain(50, 1, 1, 1, 25))
    >>> servo.b, servo.c
    (0.0005, 0.005)
    """
    return Servo(b=inertia / gain, c=damping / gain, ki_over_kp=ki_over_kp, kd_over_kp=kd_over_kp)


def damping_case(servo: Servo) -> Damping:
    """Whether Δ > 0, Δ = 0 (missing in section 4 of [1]_) or Δ < 0."""
    delta = discriminant(servo)
    if delta == 0.0:
        return "critical"
    return "over" if delta > 0.0 else "under"


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


def open_gap(gain: float, beta: float, amplitude: float, omega: float, t_i: float, x_i: float) -> OpenGap:
    """Return the gap that opens at t_i [s] with the axis at x_i [m], P controller.

    The error is the difference of X(t_i) and x_i: it keeps as many digits as these two floats give it.
    """
    sine = math.sin(omega * t_i)
    error = amplitude * sine - x_i
    return OpenGap(
        gain=gain,
        beta=beta,
        amplitude=amplitude,
        omega=omega,
        sine=sine,
        cosine=math.cos(omega * t_i),
        error=error,
        drive=error,
    )
