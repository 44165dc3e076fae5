"""The motor's own decay rate β from a stretch in which nothing drives it.

ω = ω(0) e^(-βt), section 3.3 of [1]_; its place is then A + B e^(-βt), which is fitted.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ph_post.diagnose.noise import still_stretches
from ph_post.types import Array, AxisLog

SHORTEST: Final = 0.2
"""Shortest stretch that is looked at [s]."""

LARGE: Final = 50.0
"""Times the noise that a decay must span."""

CLEAN: Final = 0.01
"""Part of what it spans by which a decay may miss the exponential."""

SLOW: Final = 5.0
"""Servo time constants below which a decay is the servo's."""

COUPLED: Final = 0.1
"""Part of the motor's travel from which on the table goes along."""

WINDOW: Final = 64
"""Samples over which what is left is averaged to see how far it is from white noise."""


class CoastDown(NamedTuple):
    """A free decay: its samples, its rate and standard error [1/s], and whether the table went along."""

    start: int
    stop: int
    rate: float
    error: float
    coupled: bool


def find_coast_downs(
    record: AxisLog, period: float, noise: float, effort_noise: float, memory: float
) -> list[CoastDown]:
    """Find the stretches in which an axis decays freely.

    Parameters
    ----------
    record : AxisLog
    period : float
        [s].
    noise, effort_noise : float
        Of the position that is read, motor before table [m], and of the effort.
    memory : float
        Slowest time constant of the servo [s]; a decay as fast as that is no free one.
    """
    reading = record.table if record.motor is None else record.motor
    if reading is None:
        return []
    found = []
    for start, stop in _undriven(record, effort_noise):
        if (stop - start) * period < SHORTEST:
            continue
        decay = _decay(reading[start:stop], period, noise)
        if decay is not None and 1.0 / decay[0] > SLOW * memory:
            coupled = _goes_along(record, reading, start, stop)
            found.append(CoastDown(start, stop, *decay, coupled))
    return found


def _undriven(record: AxisLog, effort_noise: float) -> Iterator[tuple[int, int]]:
    """Yield the stretches of a constant command, and those without effort."""
    yield from still_stretches(record.command)
    if record.effort is not None and effort_noise > 0.0:
        idle = np.abs(np.nan_to_num(record.effort, nan=np.inf)) <= 4.0 * effort_noise
        driven = np.cumsum(~idle).astype(np.float64)  # constant exactly where nothing drives
        for start, stop in still_stretches(driven):
            if np.ptp(record.command[start:stop]) > 0.0:
                yield start + 1, stop


def _decay(reading: Array, period: float, noise: float) -> tuple[float, float] | None:
    """Rate of A + B e^(-βt) and its standard error [1/s]; None where the reading is none."""
    known = np.isfinite(reading)
    t, y = np.arange(reading.size)[known] * period, reading[known]
    if y.size < 4 * WINDOW or np.ptp(y) < LARGE * max(noise, 1e-9):
        return None
    span = float(t[-1])

    def columns(rate: float) -> Array:
        return np.stack([np.ones_like(t), np.exp(-rate * t)], axis=1)

    def left(unknown: Array) -> Array:
        shapes = columns(math.exp(unknown[0]))
        return np.asarray(y - shapes @ np.linalg.lstsq(shapes, y, rcond=None)[0]) / np.ptp(y)

    start = min((math.log(k / span) for k in (0.3, 1.0, 3.0, 10.0, 30.0)),
                key=lambda one: float(np.sum(left(np.array([one])) ** 2)))  # fmt: skip
    found = least_squares(left, [start], bounds=([math.log(0.02 / span)], [math.log(300.0 / span)]))
    rate, rest = math.exp(found.x[0]), left(found.x)
    size = float(np.sqrt(np.mean(rest**2)))
    if size > max(CLEAN, 2.0 * noise / float(np.ptp(y))):
        return None
    return rate, rate * size * math.sqrt(_worth(rest)) / max(
        float(np.linalg.norm(np.asarray(found.jac))), 1e-300
    )


def _worth(rest: Array) -> float:
    """How many samples count as one."""
    whole = rest[: rest.size // WINDOW * WINDOW].reshape(-1, WINDOW)
    return max(1.0, float(WINDOW * np.mean(whole.mean(axis=1) ** 2) / np.mean(rest**2)))


def _goes_along(record: AxisLog, reading: Array, start: int, stop: int) -> bool:
    """Whether the table moves with the motor, or is all that was read."""
    if record.motor is None or record.table is None:
        return record.motor is None
    table = record.table[start:stop]
    return bool(np.nanmax(table) - np.nanmin(table) > COUPLED * np.ptp(reading[start:stop]))


def pooled(found: list[CoastDown]) -> tuple[float, float]:
    """Mean rate of several decays and its standard error [1/s]."""
    weights = np.array([1.0 / max(one.error, 1e-12) ** 2 for one in found])
    rates = np.array([one.rate for one in found])
    return float(np.sum(weights * rates) / np.sum(weights)), float(np.sum(weights) ** -0.5)
