"""A cascade as a manual has it, in m/s² and 1/s, stepped finely; its gains as the package has them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numba
import numpy as np

from ph_post.drive.plant import Plant
from ph_post.types import Array, Cascade, Pickup

from .ideal_play import dragged

PERIOD = 1e-3
ROWS = 700
FINE = 100
"""Steps of the reference in a sample."""


@dataclass(frozen=True)
class Drive:
    """A drive in a manual's words."""

    kv: float = 40.0
    wv: float = 250.0
    tn: float = math.inf
    velocity: float = 0.0
    acceleration: float = 0.0
    lead: float = 0.0
    current: float = 0.0
    deadband: float = 0.0
    limit: float = math.inf

    def cascade(self, **more: Any) -> Cascade:
        return Cascade(
            position_gain=self.kv,
            velocity_gain=self.wv,
            integral_rate=0.0 if math.isinf(self.tn) else 1.0 / self.tn,
            velocity_feedforward=self.velocity,
            acceleration_feedforward=self.acceleration,
            acceleration_lead=self.lead,
            current_time=self.current,
            deadband=self.deadband,
            **more,
        )

    def plant(self, feedback: Any = "motor", side: Any = "motor", **more: Any) -> Plant:
        return Plant(
            feedback=feedback,
            b=1.0 / (self.kv * self.wv),
            c=more.pop("damping", 0.0),
            cascade=self.cascade(velocity_feedback=side),
            saturation=self.limit / (self.kv * self.wv),
            **more,
        )


def to_and_fro(amplitude: float = 4e-3) -> Array:
    """Begin at rest, and turn back several times."""
    t = PERIOD * np.arange(ROWS)
    return np.asarray(amplitude * np.sin(11.0 * t) ** 2 * np.where(t < 0.2, (t / 0.2) ** 2 * (3.0 - t / 0.1), 1.0))


def accelerations(command: Array) -> Array:
    around = np.concatenate([command[:1], command, [2.0 * command[-1] - command[-2]]])
    return np.asarray(around[2:] - 2.0 * around[1:-1] + around[:-2]) / PERIOD**2


class Gains(NamedTuple):
    """The numbers of a drive."""

    kv: float
    wv: float
    tn: float
    velocity: float
    acceleration: float
    lead: float
    current: float
    deadband: float
    limit: float


def gains(drive: Drive) -> Gains:
    return Gains(*(float(getattr(drive, name)) for name in Gains._fields))


def motor_of(
    drive: Drive, command: Array, coulomb: float = 0.0, fine: int = FINE, against: Array | None = None
) -> Array:
    """Step a motor that its own encoder closes both loops over; friction in m/s² of the whole inertia."""
    against = np.zeros(command.size) if against is None else against
    found: Array = _motor_of(gains(drive), command, float(coulomb), fine, against, accelerations(command))
    return found


@numba.njit(cache=True)
def _motor_of(drive, command, coulomb, fine, against, bends):  # type: ignore[no-untyped-def]
    place = speed = total = given = 0.0
    h = PERIOD / fine
    found = np.zeros(command.size)
    for k in range(command.size - 1):
        rate = (command[k + 1] - command[k]) / PERIOD
        for j in range(fine):
            at = (j + 0.5) / fine
            wanted = command[k] + at * (command[k + 1] - command[k])
            bend = bends[k] + at * (bends[k + 1] - bends[k])
            error = wanted - place
            error -= min(max(error, -drive.deadband), drive.deadband)
            off = drive.kv * error + drive.velocity * rate + drive.lead * bend - speed
            total += h * off
            asked = drive.wv * (off + total / drive.tn) + drive.acceleration * bend
            asked = min(max(asked, -drive.limit), drive.limit)
            given = given + h / drive.current * (asked - given) if drive.current else asked
            pulls = given - against[k] - at * (against[k + 1] - against[k])
            if speed == 0.0 and abs(pulls) <= coulomb:
                continue
            after = speed + h * (pulls - coulomb * math.copysign(1.0, speed if speed else pulls))
            speed = 0.0 if coulomb and speed * after < 0.0 else after
            place += h * speed
        found[k + 1] = place
    return found


def play(motor: Array, gap: float, flank: int = 1) -> Array:
    return dragged(motor, gap / 2.0, motor[0] - flank * gap / 2.0)


def pushed(motor: Array, gap: float, friction: float) -> Array:
    """A table of unit mass between stiff, damped stops, with dry friction [m/s²], in 25 steps a sample."""
    fine = 25
    driver = np.interp(np.arange(motor.size * fine) / fine, np.arange(motor.size), motor)
    found: Array = _pushed(driver, np.gradient(driver, PERIOD / fine), fine, float(gap), float(friction))
    return found


@numba.njit(cache=True)
def _pushed(driver, rates, fine, gap, friction):  # type: ignore[no-untyped-def]
    stiff, damped, step = (2.0 * math.pi * 200.0) ** 2, 0.8 * 2.0 * math.pi * 200.0, PERIOD / fine
    at, speed, found = driver[0], 0.0, np.empty(driver.size // fine)
    for k in range(driver.size):
        if k % fine == 0:
            found[k // fine] = at
        apart = driver[k] - at
        push = 0.0
        if apart > 0.5 * gap:
            push = max(stiff * (apart - 0.5 * gap) + damped * (rates[k] - speed), 0.0)
        elif apart < -0.5 * gap:
            push = min(stiff * (apart + 0.5 * gap) + damped * (rates[k] - speed), 0.0)
        free = speed + step * push
        speed = max(free - step * friction, 0.0) if free > 0.0 else min(free + step * friction, 0.0)
        at += step * speed
    return found


def two_bodies(
    drive: Drive, command: Array, gap: float, eta: float, beta: float, damping: float, rule: Pickup, side: str
) -> Array:
    """Step a motor and a table a gap apart, the position loop closed over the table; damping in 1/s of the whole."""
    keeps, at_motor, kept = rule == "contact", side == "motor", 0.0 if rule == "standstill" else 1.0
    found: Array = _two_bodies(gains(drive), command, gap, eta, beta, damping, keeps, kept, at_motor, FINE)
    return found


@numba.njit(cache=True)
def _two_bodies(drive, command, gap, eta, beta, damping, keeps, kept, at_motor, fine):  # type: ignore[no-untyped-def]
    x = v = w = total = given = 0.0
    m, contact = gap / 2.0, 1
    h, found = PERIOD / fine, np.zeros(command.size)
    own, rest = eta * beta, damping - eta * beta
    for k in range(command.size - 1):
        rate = (command[k + 1] - command[k]) / PERIOD
        for j in range(fine):
            wanted = command[k] + (j + 0.5) / fine * (command[k + 1] - command[k])
            off = drive.kv * (wanted - x) + drive.velocity * rate - (w if at_motor else v)
            total += h * off
            asked = drive.wv * (off + total / drive.tn)
            given = given + h / drive.current * (asked - given) if drive.current else asked
            if contact:
                after = v + h * (given - damping * v)
                # It opens where the motor turns back, or under `contact` where it no longer pushes.
                pushes = given - eta * (given - damping * v) - own * v
                opens = v * contact > 0.0 >= after * contact or (v == 0.0 and given * contact < 0.0)
                if keeps:
                    opens = pushes * contact < 0.0
                if opens:
                    m = x + contact * gap / 2.0
                    contact = 0
                    w = v if keeps else 0.0
                    v = w
                else:
                    v = w = after
                    x, m = x + h * v, m + h * v
                    continue
            w += h * (given - own * w) / eta
            v += -h * rest * v / (1.0 - eta)
            m, x = m + h * w, x + h * v
            for flank in (1, -1):
                if flank * (m - x) >= gap / 2.0 and flank * (w - v) > 0.0:
                    v = w = kept * (v + eta * (w - v))
                    m, contact = x + flank * gap / 2.0, flank
        found[k + 1] = x
    return found


DRIVES = {
    "P, P": Drive(),
    "P, PI": Drive(tn=12e-3),
    "70 %": Drive(tn=12e-3, velocity=0.7),
    "95 %": Drive(tn=12e-3, velocity=0.95, current=5e-4),
    "100 %": Drive(tn=12e-3, velocity=1.0, acceleration=1.0, current=5e-4),
    "of LinuxCNC": Drive(velocity=1.0, lead=2e-3, deadband=2e-6),
    "limited": Drive(velocity=1.0, limit=0.9),
}
