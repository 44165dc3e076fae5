"""The paper's drive, its printed formulas in mpmath, its equations in scipy: references of their own."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import mpmath as mp
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ph_post.types import Axis, Feedback, Gap, Limits, Servo

PAPER_SERVO = Servo(b=0.0005, c=0.005)
PAPER_GAP = Gap(
    lost_motion=0.125664 / 25.0,
    motor_angle=0.125664,
    gear_ratio=25.0,
    travel_per_rad=1.0,
    inertia_fraction=0.35,
    beta=1.0,
    pickup="standstill",
)
AMPLITUDE = 0.25
PERIOD = 6.0
"""T, the time between reversals of the command [s]."""
OMEGA = math.pi / PERIOD


def axis(servo: Servo = PAPER_SERVO, gap: Gap = PAPER_GAP, feedback: Feedback = "load") -> Axis:
    """Return an axis with that drive; its limits play no part here."""
    limits = Limits(velocity=0.5, acceleration=5.0, jerk=100.0)
    return Axis(name="X", feedback=feedback, servo=servo, gap=gap, limits=limits)


def gap_of(gain: float, beta: float, motor_angle: float, b: float) -> Gap:
    """Return a gap with C = `gain` on a loop with `b`: N = 1, η = 1/2."""
    return Gap(
        lost_motion=motor_angle * 2.0 / (gain * b),
        motor_angle=motor_angle,
        gear_ratio=1.0,
        travel_per_rad=2.0 / (gain * b),
        inertia_fraction=0.5,
        beta=beta,
    )


class Printed:
    """Eqs. (19)-(22) of the paper as printed (ẏ, ÿ read as ẋ, ẍ), to whatever digits mpmath is set."""

    def __init__(self, b: float, c: float, gain: float, beta: float, amplitude: float, omega: float) -> None:
        self.b, self.c, self.C, self.beta, self.a, self.W = map(mp.mpf, (b, c, gain, beta, amplitude, omega))
        self.delta = self.c**2 - 4 * self.b
        self.gamma = self.c / (2 * self.b)
        self.lam = mp.sqrt(abs(self.delta)) / (2 * self.b)
        below = (self.b * self.W**2 - 1) ** 2 + (self.c * self.W) ** 2
        self.p, self.q = (self.b * self.W**2 - 1) / below, self.c * self.W / below
        self.phi = mp.atan2(self.beta, self.W)

    def g(self, t: mp.mpf) -> mp.mpf:
        return self.a * (self.p * mp.sin(self.W * t) + self.q * mp.cos(self.W * t))

    def g_dot(self, t: mp.mpf) -> mp.mpf:
        return self.a * self.W * (self.p * mp.cos(self.W * t) - self.q * mp.sin(self.W * t))

    def g_ddot(self, t: mp.mpf) -> mp.mpf:
        return -self.a * self.W**2 * (self.p * mp.sin(self.W * t) + self.q * mp.cos(self.W * t))

    def motion(self, t_s: mp.mpf, x_i: mp.mpf, t: mp.mpf) -> tuple[mp.mpf, mp.mpf, mp.mpf]:
        """x, ẋ, ẍ after the pick-up at t_s."""
        gamma, lam, since = self.gamma, self.lam, t - t_s
        start, start_dot = x_i + self.g(t_s), self.g_dot(t_s)
        if self.delta > 0:
            c1 = ((lam + gamma) * start + start_dot) / (2 * lam)
            c2 = ((lam - gamma) * start - start_dot) / (2 * lam)
            grow, fall = mp.exp(lam * since), mp.exp(-lam * since)
            free = (
                c1 * grow + c2 * fall,
                (lam - gamma) * c1 * grow - (lam + gamma) * c2 * fall,
                (lam - gamma) ** 2 * c1 * grow + (lam + gamma) ** 2 * c2 * fall,
            )
        else:
            c1, c2 = (gamma * start + start_dot) / lam, start
            sine, cosine = mp.sin(lam * since), mp.cos(lam * since)
            curve = gamma**2 - lam**2
            free = (
                c1 * sine + c2 * cosine,
                (lam * c1 - gamma * c2) * cosine - (gamma * c1 + lam * c2) * sine,
                (curve * c2 - 2 * lam * gamma * c1) * cosine + (curve * c1 + 2 * lam * gamma * c2) * sine,
            )
        decay = mp.exp(-gamma * since)
        steady = (self.g(t), self.g_dot(t), self.g_ddot(t))
        return tuple(decay * part - whole for part, whole in zip(free, steady, strict=True))

    def f(self, t_i: mp.mpf, x_i: mp.mpf, dt: mp.mpf) -> mp.mpf:
        """Eq. (22)."""
        root = mp.sqrt(self.beta**2 + self.W**2)
        return self.C * (
            self.a * mp.cos(self.W * t_i + self.phi) * mp.exp(-self.beta * dt) / (self.beta * root)
            + self.a * mp.sin(self.W * (t_i + dt) + self.phi) / (self.W * root)
            + x_i / self.beta * (t_i + dt)
            + x_i / self.beta**2 * mp.exp(-self.beta * dt)
        )

    def angle(self, t_i: mp.mpf, x_i: mp.mpf, dt: mp.mpf) -> mp.mpf:
        """f(0) - f(Δt) of Eq. (21)."""
        return self.f(t_i, x_i, mp.mpf(0)) - self.f(t_i, x_i, dt)

    def speed(self, t_i: mp.mpf, x_i: mp.mpf, dt: mp.mpf) -> mp.mpf:
        """ω_m(t_i + Δt) of section 4.1."""
        root, fall = mp.sqrt(self.beta**2 + self.W**2), mp.exp(-self.beta * dt)
        return self.C * (
            self.a * mp.cos(self.W * t_i + self.phi) * fall / root
            - self.a * mp.cos(self.W * (t_i + dt) + self.phi) / root
            - x_i / self.beta * (1 - fall)
        )

    def settled(self, motor_angle: float, start: tuple[float, float, float]) -> tuple[mp.mpf, mp.mpf, mp.mpf]:
        """t_i, x_i, Δt of the orbit that repeats with the opposite sign after T, from a `start`."""
        half = mp.pi / self.W

        def conditions(t_i: mp.mpf, x_i: mp.mpf, dt: mp.mpf) -> tuple[mp.mpf, mp.mpf, mp.mpf]:
            x, x_dot, _ = self.motion(t_i + dt, x_i, t_i + half)
            return x + x_i, x_dot / self.W, (self.angle(t_i, x_i, dt) / mp.mpf(motor_angle) + 1) * self.a

        return tuple(mp.findroot(conditions, tuple(map(mp.mpf, start)), tol=mp.mpf(10) ** (30 - 2 * mp.mp.dps)))


class Observed(NamedTuple):
    """A reversal seen in an integrated run."""

    lag: float
    position: float
    duration: float


def run_drive(
    servo: Servo, gain: float, beta: float, motor_angle: float, amplitude: float, omega: float, count: int
) -> list[Observed]:
    """Integrate section 3.3 from x = 0, ẋ = aΩ through `count` reversals (P, PI, PID), with scipy's DOP853.

    The states are position, speed and ∫e while the gap is closed; the motor's speed, angle and ∫e while open.
    """
    ki, kd = servo.ki_over_kp, servo.kd_over_kp

    def closed(t: float, state: NDArray[np.float64]) -> list[float]:
        x, v, integral = state
        error, rate = amplitude * math.sin(omega * t) - x, amplitude * omega * math.cos(omega * t) - v
        return [v, (error + ki * integral + kd * rate - servo.c * v) / servo.b, error]

    def opened(t: float, state: NDArray[np.float64], x: float) -> list[float]:
        speed, _, integral = state
        error, rate = amplitude * math.sin(omega * t) - x, amplitude * omega * math.cos(omega * t)
        return [gain * (error + ki * integral + kd * rate) - beta * speed, speed, error]

    t, state, sense = 0.0, np.array([0.0, amplitude * omega, 0.0]), 1
    found = []
    for number in range(count):
        stop = _Event(1, 0.0, -sense)
        run = _run(closed, t, t + 1.5 * math.pi / omega, state, stop)
        t_i, (x_i, _, integral) = run
        cross = _Event(1, -sense * motor_angle, -sense)
        t, opening = _run(lambda t, y, x=x_i: opened(t, y, x), t_i, t_i + math.pi / omega, [0.0, 0.0, integral], cross)
        found.append(Observed(t_i - (number + 0.5) * math.pi / omega, abs(x_i), t - t_i))
        state, sense = np.array([x_i, 0.0, opening[2]]), -sense
    return found


class _Event:
    """Component `index` passes `value` in `direction`."""

    terminal = True

    def __init__(self, index: int, value: float, direction: int) -> None:
        self.index, self.value, self.direction = index, value, direction

    def __call__(self, t: float, state: NDArray[np.float64]) -> float:
        return float(state[self.index] - self.value)


def _run(rate: Any, start: float, end: float, state: Any, event: _Event) -> tuple[float, NDArray[np.float64]]:
    """Integrate until the event."""
    run = solve_ivp(rate, (start, end), state, method="DOP853", rtol=1e-11, atol=1e-14, events=event, max_step=0.2)
    assert run.t_events[0].size == 1
    return float(run.t_events[0][0]), run.y_events[0][0]
