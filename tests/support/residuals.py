"""Motions, records and residuals whose place is known, from scipy's own linear systems."""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from ph_post.types import AxisLog, Log, Machine

from .engine_cases import make_axis, make_machine

Array = NDArray[np.float64]
PERIOD = 1e-3
B, C = 7e-5, 6.4e-3
MM = 1e-3
UM = 1e-6
NOISE = 0.3 * UM


class Moved(NamedTuple):
    """A record of two axes and where X really is: position, velocity and acceleration by the linear loop."""

    log: Log
    machine: Machine
    x: Array
    v: Array
    a: Array
    y: Array

    @property
    def t(self) -> Array:
        return self.log.t

    @property
    def counted(self) -> NDArray[np.bool_]:
        return np.asarray(np.arange(self.x.size) >= 300)


def servo(command: Array) -> Array:
    """The linear loop from rest at 0, each of its two modes in closed form along a command straight between rows."""
    pole = (-C + cmath.sqrt(C * C - 4.0 * B)) / (2.0 * B)
    kept = cmath.exp(pole * PERIOD)
    ahead = (kept - 1.0 - pole * PERIOD) / (pole * pole * PERIOD)
    behind = (kept - 1.0) / pole - ahead
    mode, _ = signal.lfilter([ahead, behind], [1.0, -kept], command, zi=[-ahead * command[0]])
    return np.asarray(2.0 * (mode / (2.0 * B * pole + C)).real, dtype=np.float64)


def sines(seconds: float, seed: int) -> Array:
    """A smooth motion that never comes again: sines of frequencies that go together nowhere."""
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(round(seconds / PERIOD))
    total = np.zeros(t.size)
    for frequency in rng.uniform(0.05, 0.4, 6) * math.sqrt(2.0):
        total += 8.0 * MM * np.sin(2.0 * np.pi * frequency * t + rng.uniform(0.0, 6.0))
    return total - total[0]


def sweeps(seconds: float, *feeds: float) -> Array:
    """To and fro over 40 mm at feeds [m/s], one after the other, the turns rounded over 40 ms."""
    parts = []
    for feed in feeds:
        t = PERIOD * np.arange(round(seconds / len(feeds) / PERIOD))
        parts.append(40.0 * MM / np.pi * np.arcsin(np.sin(2.0 * np.pi * t * feed / (80.0 * MM))))
    rounded = signal.lfilter(np.ones(40) / 40.0, [1.0], np.concatenate(parts))
    return np.asarray(rounded, dtype=np.float64)


def moved(command: Array, other: Array) -> Moved:
    """Record of a command of X and one of Y."""
    x, y = servo(command), servo(other)
    machine = make_machine([make_axis("motor", B, C, 0.0, name=name) for name in "XY"], PERIOD)
    axes = {"X": AxisLog(command=command, table=x), "Y": AxisLog(command=other, table=y)}
    log = Log(name="test", t=PERIOD * np.arange(command.size), period=PERIOD, axes=axes)
    v = np.gradient(x, PERIOD)
    return Moved(log, machine, x, v, np.gradient(v, PERIOD), y)


def to_and_fro(seconds: float = 60.0) -> Moved:
    return moved(sweeps(seconds, 0.02, 0.06), sines(seconds, 4))


def irregular(seconds: float = 60.0) -> Moved:
    return moved(sines(seconds, 0), sines(seconds, 4))


def circles(seconds: float = 60.0) -> Moved:
    """Full circles of 20 mm radius, two counterclockwise and two clockwise by turns, 1.5 s each."""
    t = PERIOD * np.arange(round(seconds / PERIOD))
    way = np.where((t // 3.0).astype(np.int64) % 2 == 0, 1.0, -1.0)
    angle = np.cumsum(way) * PERIOD * 2.0 * np.pi / 1.5
    return moved(20.0 * MM * np.cos(angle), 20.0 * MM * np.sin(angle))


def decaying(v: Array, time_constant: float) -> Array:
    """What jumps by 2 with each reversal and dies out."""
    return np.asarray(
        signal.lfilter([1.0, -1.0], [1.0, -math.exp(-PERIOD / time_constant)], np.sign(v)), dtype=np.float64
    )


def white(n: int, size: float, seed: int) -> Array:
    return size * np.random.default_rng(seed).standard_normal(n)


def wander(n: int, size: float, seed: int, low: float, high: float) -> Array:
    """Noise between two frequencies [Hz]."""
    b, a = signal.butter(2, [2.0 * low * PERIOD, 2.0 * high * PERIOD], "band")
    slow = signal.lfilter(b, a, np.random.default_rng(seed).standard_normal(n))
    return np.asarray(size * slow / np.std(slow), dtype=np.float64)
