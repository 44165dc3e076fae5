"""First values of b and c without any machine: the following error by velocity and acceleration.

On either side of the loop's equation e = c ẋ + b ẍ stands the same smoothing, so that it goes on holding.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ph_post.types import Array, AxisLog, Feedback

SMOOTH: Final = 6.0
"""Standard deviation of the smoothing, samples."""

EDGE: Final = 30
"""Samples at either end that the smoothing spoils."""

CLEAR: Final = 4.0
"""Standard errors from which on a coefficient is one."""


class Lag(NamedTuple):
    """The following error's coefficients by acceleration [s²] and velocity [s], and what they leave [m].

    None where they do not stand out of what is left.
    """

    b: float | None
    c: float | None
    rms: float


def lag_of(command: Array, reading: Array, period: float) -> Lag:
    """Regress the following error on velocity and acceleration of a reading, direction and origin aside."""
    known = np.isfinite(reading)
    place = np.interp(np.arange(reading.size), np.flatnonzero(known), reading[known])
    smooth = gaussian_filter1d(place, SMOOTH)
    error = gaussian_filter1d(command - place, SMOOTH)
    speed = np.gradient(smooth, period)
    gain = np.gradient(speed, period)
    moving = np.abs(speed) > 1e-3 * np.max(np.abs(speed), initial=1e-12)
    columns = np.stack([gain, speed, np.sign(speed) * moving, np.ones(speed.size)], axis=1)
    columns, error = columns[EDGE:-EDGE], error[EDGE:-EDGE]
    size = np.sqrt(np.mean(columns**2, axis=0)) + 1e-300
    scaled = columns / size
    found = np.linalg.lstsq(scaled, error, rcond=1e-10)[0]
    left = error - scaled @ found
    rms = float(np.sqrt(np.mean(left**2)))
    spread = np.linalg.pinv(scaled.T @ scaled, rcond=1e-10)
    errors = rms * np.sqrt(4.0 * SMOOTH * np.diag(spread))
    b, c = (float(found[k] / size[k]) if found[k] > CLEAR * errors[k] else None for k in (0, 1))
    return Lag(b, c, rms)


def loop_reading(record: AxisLog, feedback: Feedback) -> Array | None:
    """Return the reading at the side that the loop closes over, else the other, None where there is none."""
    first, second = (record.table, record.motor) if feedback == "load" else (record.motor, record.table)
    return second if first is None else first


def assumed_feedback(record: AxisLog, period: float) -> tuple[Feedback, str]:
    """Return which loop the readings speak for, and why; nobody said it."""
    if record.table is None:
        return "motor", "only the motor was read"
    if record.motor is None:
        return "load", "only the table was read"
    table, motor = (lag_of(record.command, one, period).rms for one in (record.table, record.motor))
    if table < motor:
        return "load", "the table follows the command more closely than the motor"
    return "motor", "the motor follows the command more closely than the table"
