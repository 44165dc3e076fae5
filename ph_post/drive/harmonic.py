"""An axis commanded along a circle, X(t) = a sin Ωt, with the gap closed and open, in closed form.

The printed Eqs. (21), (22) of [1]_ subtract terms near 1e4 from each other and lose seven digits and more
in the paper's own example; here every term is formed as a difference from the moment the gap opens.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 4.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from ph_post.drive.free_motor import ANGLE, SPEED, free_motor_response
from ph_post.drive.roots import close_bracket
from ph_post.drive.servo import effective_damping, free_response, harmonic_response
from ph_post.types import Array, Servo

STEPS_PER_PERIOD: Final = 64
"""Longest step of a growing bracket, as a fraction of the command's period."""

GROWTH: Final = 1.5
"""Factor by which a bracket grows while its steps are shorter than that."""


class Constants(NamedTuple):
    """p, q and φ [rad] of section 4 of [1]_."""

    p: float
    q: float
    phi: float


def phase_constants(servo: Servo, beta: float, omega: float) -> Constants:
    """Return p, q after Eq. (20) of [1]_ and φ with (sin φ, cos φ) = (β, Ω)/√(β² + Ω²)."""
    response, _ = harmonic_response(servo, omega)
    return Constants(-response.real, -response.imag, math.atan2(beta, omega))


def steady_motion(servo: Servo, amplitude: float, omega: float, t: ArrayLike) -> Array:
    """Motion the loop settles to without any gap: -g of Eq. (20) of [1]_ with its first two derivatives.

    Returns
    -------
    ndarray, shape (3, ...)
        -g [m], -ġ [m/s], -g̈ [m/s²] at the times `t` [s].
    """
    response, _ = harmonic_response(servo, omega)
    angle = omega * np.asarray(t, dtype=np.float64)
    sine, cosine = np.sin(angle), np.cos(angle)
    along = amplitude * (response.real * sine + response.imag * cosine)
    across = amplitude * (response.real * cosine - response.imag * sine)
    return np.stack([along, omega * across, -(omega**2) * along])


def motion_after_pickup(servo: Servo, amplitude: float, omega: float, t_s: float, x_i: float, t: ArrayLike) -> Array:
    """Axis motion once the gap has closed at t_s, the axis standing at x_i (Eq. 14).

    Implements Eq. (19) of [1]_ and the two lines after it, for Δ > 0, Δ = 0, Δ < 0 and anything between; P
    or PD.

    Parameters
    ----------
    servo : Servo
        With k_i = 0.
    amplitude, omega : float
        a [m] and Ω [1/s] of X = a sin Ωt.
    t_s, x_i : float
        Pick-up [s] and the axis' place then [m].
    t : array_like, shape (...,)
        Times [s], not before t_s.

    Returns
    -------
    ndarray, shape (3, ...)
        x [m], ẋ [m/s], ẍ [m/s²].
    """
    # ERRATA: the second lines of ẋ and ẍ are printed as ẏ, ÿ: they are the Δ < 0 cases of x. Δ = 0 is
    # missing.
    t = np.asarray(t, dtype=np.float64)
    start = steady_motion(servo, amplitude, omega, t_s)
    deviation = free_response(servo, t - t_s) @ np.array([x_i - start[0], -start[1]])
    place, speed = deviation[..., 0], deviation[..., 1]
    acceleration = -(place + effective_damping(servo) * speed) / servo.b
    motion: Array = steady_motion(servo, amplitude, omega, t) + np.stack([place, speed, acceleration])
    return motion


class OpenGap(msgspec.Struct, frozen=True, kw_only=True):
    """A gap that has opened under the command X = a sin Ωt; s is the time since then.

    Implements Eqs. (15)-(17), (21), (22) of [1]_, extended to PI and PID controllers: the motor is driven by
    e + (k_i/k_p) ∫e + (k_d/k_p) ė, the integrator running on while the axis stands.

    Parameters
    ----------
    gain, beta : float
        C [rad/(m s²)] and β [1/s] of Eq. (16).
    amplitude, omega : float
        a [m] and Ω [1/s].
    sine, cosine : float
        sin Ωt_i and cos Ωt_i.
    error : float
        X(t_i) - x_i [m]. It is small against both where the loop is good, so whoever can form it without
        subtracting them should.
    drive : float
        e + (k_i/k_p) ∫e + (k_d/k_p) ė at t_i [m]; the same as `error` for a P controller.
    ki_over_kp, kd_over_kp : float
        As in Servo.
    """

    gain: float
    beta: float
    amplitude: float
    omega: float
    sine: float
    cosine: float
    error: float
    drive: float
    ki_over_kp: float = 0.0
    kd_over_kp: float = 0.0

    @property
    def sense(self) -> int:
        """σ of Eq. (15): the sign of the motor's first movement."""
        return 1 if self.drive > 0.0 else -1

    def motor_speed(self, duration: float) -> float:
        """ω_m [rad/s], `duration` [s] after the opening: Eq. (17) in its closed form of §4.1 of [1]_."""
        return self.gain * self._respond(SPEED, duration)

    def motor_angle(self, duration: float) -> float:
        """∫ω_m [rad] since the opening: f(0) - f(Δt) of Eqs. (21), (22) of [1]_, without cancellation."""
        return self.gain * self._respond(ANGLE, duration)

    def Q(self, duration: float, motor_gap: float) -> float:
        """Q(Δt) of Eq. (21) of [1]_ [rad] for a gap of Δθ_m = `motor_gap`; Q' is :meth:`motor_speed`."""
        return self.motor_angle(duration) - self.sense * motor_gap

    def starting_estimate(self, motor_gap: float) -> float:
        """Δt from the first term of Q's power series [s]: the scale of a bracket, and no more.

        In the paper's own example it is about 1.9 times the root, and Q'(0) = 0.
        """
        # ERRATA: Q''(0) = C (a sin Ωt_i - x_i); the factor a is missing where Q''(0) is printed.
        return math.sqrt(2.0 * motor_gap / (self.gain * abs(self.drive)))

    def duration(self, motor_gap: float) -> float | None:
        """Δt of Eq. (21) of [1]_ [s], bracketed and then polished.

        None where the motor comes back to the flank it has left (Eq. (15) returns to zero and does not hold),
        and where it needs more than a whole period of the command.

        Examples
        --------
        >>> own = {"gain": 1.0, "beta": 0.0, "amplitude": 0.0, "omega": 1.0, "sine": 0.0, "cosine": 1.0}
        >>> gap = OpenGap(**own, error=2.0, drive=2.0)
        >>> gap.duration(4.0)  # a constant error of 2: θ = t²
        2.0
        """
        if self.drive == 0.0:
            return None
        limit = 2.0 * math.pi / self.omega
        low, high = 0.0, min(self.starting_estimate(motor_gap) / 8.0, limit / STEPS_PER_PERIOD)
        while (turned := self.sense * self.motor_angle(high)) < motor_gap:
            if high >= limit or turned < 0.0:
                return None
            low, high = high, min(GROWTH * high, high + limit / STEPS_PER_PERIOD, limit)
        return close_bracket(lambda duration: self.Q(duration, motor_gap), low, high)

    def _respond(self, order: int, duration: float) -> float:
        """Respond to the drive, split into its value at the opening and what each controller adds since."""
        unit = free_motor_response(order, self.beta, self.omega, duration)
        moved = self.cosine * unit.sine - self.sine * unit.versine
        total = self.drive * unit.step + self.amplitude * moved
        if self.ki_over_kp:
            swept = self.cosine * unit.versine / self.omega - self.sine * unit.lagging
            total += self.ki_over_kp * (self.error * unit.ramp + self.amplitude * swept)
        if self.kd_over_kp:
            turned = self.sine * unit.sine + self.cosine * unit.versine
            total -= self.kd_over_kp * self.amplitude * self.omega * turned
        return total
