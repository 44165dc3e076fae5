"""Logs of cascades stepped by the tests, and machine files that know all, or not all, of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ph_post.types import Array, Axis, AxisLog, Gap, Limits, Log, Machine, Servo
from tests.support.cascade_plant import PERIOD, Drive, motor_of, play
from tests.support.plants.axis import Plant
from tests.support.plants.courses import draw_course
from tests.support.plants.readings import Observer

NOISE = 1e-7
WAYS = ((0.02, 0.5), (0.03, 0.8), (0.004, 0.15), (0.01, 0.25), (0.002, 0.12))


def moves(ways: tuple[tuple[float, float], ...] = WAYS) -> Array:
    """Several ways there and back, of another length and duration each."""
    t, begin = PERIOD * np.arange(round(1e3 * (0.4 + sum(1.8 * one + 0.24 for _, one in ways)))), 0.3
    found = np.zeros(t.size)
    for way, lasts in ways:
        for sense, pace in ((1.0, 1.0), (-1.0, 0.8)):
            u = np.clip((t - begin) / (pace * lasts), 0.0, 1.0)
            found += sense * way * u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
            begin += pace * lasts + 0.12
    assert begin < t[-1]
    return np.asarray(found)


def averaged(command: Array, length: int) -> Array:
    """A moving average over so many samples, of what is linear in between."""
    weights = np.ones(length + 1)
    weights[0] = weights[-1] = 0.5
    before = np.concatenate([np.full(length, command[0]), command])
    return np.asarray(np.convolve(before, weights / length)[length : length + command.size])


def log_of(command: Array, read: dict[str, Array], seed: int) -> Log:
    """Return a log of what was read, with noise."""
    rng = np.random.default_rng(seed)
    noisy = {name: true + NOISE * rng.standard_normal(true.size) for name, true in read.items()}
    axis = AxisLog(command=command, table=noisy.get("act"), motor=noisy.get("motor"), side="table")
    return Log(name="cascade", t=PERIOD * np.arange(command.size), period=PERIOD, axes={"X": axis})


def record(
    drive: Drive,
    gap: float = 0.0,
    channels: str = "motor act",
    seed: int = 1,
    coulomb: float = 0.0,
    average: int = 0,
    ways: tuple[tuple[float, float], ...] = WAYS,
) -> Log:
    """Record a motor loop; friction in m/s² of the whole inertia, `average` of the command in samples."""
    command = moves(ways)
    motor = motor_of(drive, averaged(command, average) if average else command, coulomb, fine=40)
    read = {"motor": motor, "act": play(motor, gap)}
    return log_of(command, {name: read[name] for name in channels.split()}, seed)


ALIKE = ((18.9, 27.17e-3), (36.8, 52.91e-3))
"""K_v and T_n of two cascades that move alike where all of the speed is fed forward: 1/18.9 s are 52.91 ms."""


def solved(drive: Drive, gap: float) -> Log:
    """Record a motor loop that is solved from event to event, on both sides."""
    plant = Plant("motor", 1.0 / (drive.kv * drive.wv), 1.0 / drive.kv, gap, drive=drive)
    observer = Observer(draw_course(np.random.default_rng(5), False))
    readings, command = observer([plant]), observer.command([plant])[0]
    return log_of(command, {name: readings[f"X_{name}"] for name in ("motor", "act")}, 1)


def machine_of(drive: Drive, gap: float = 0.0, **more: Any) -> Machine:
    """Return a machine with a drive on X, its encoder on the motor."""
    cascade = drive.cascade(**more)
    servo = Servo(b=1.0 / (drive.kv * drive.wv), c=1.0 / drive.kv, cascade=cascade)
    limits = Limits(velocity=0.5, acceleration=5.0, jerk=100.0)
    axis = Axis(name="X", feedback="motor", servo=servo, gap=Gap(lost_motion=gap), limits=limits)
    return Machine(name="cascade", dialect="linuxcnc", servo_period=PERIOD, axes={"X": axis})
