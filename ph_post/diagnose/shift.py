"""By how much a reading is late, beyond what its drive explains."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.response import linear_response
from ph_post.types import Array, Log, Machine, Servo

PRIOR: Final = 0.02
"""Relative standard error of b and c where the machine file gives none."""

CLEAR: Final = 3.0
"""Standard errors by which a shift must differ from zero to be one."""

ROUNDS: Final = 4
"""Steps of Newton: a shift of a few samples is not small against the curvature of a motion."""

SIZES: Final = 1e-3
"""Relative step of the numerical derivatives by b and c."""


def find_shift(log: Log, machine: Machine, name: str, reading: Array, first: int) -> float | None:
    """Find the delay of a reading by least squares against the linear drive [s].

    Beside the delay the drive's b and c may be off by what the file leaves open, and there may be an offset,
    a scale and a force that changes sign with the velocity: a delay is what they do not explain.

    Returns
    -------
    float or None
        0 where a shift of a sample would be seen and is not there; None where the record does not tell.
    """
    drive = machine.axes.get(name)
    if drive is None or np.ptp(log.axes[name].command) == 0.0:
        return None
    columns, model = _columns(log, name, drive.servo)
    known = np.isfinite(reading)
    known[:first] = False
    if np.count_nonzero(known) < 10 * columns.shape[1]:
        return None
    shift = error = 0.0
    rows = np.arange(reading.size, dtype=np.float64)
    for _ in range(ROUNDS):
        late = rows - shift / log.period
        expected = np.interp(late, rows, model)
        moved = np.column_stack([np.interp(late, rows, column) for column in columns.T])
        more, error = _least_squares(moved[known], (reading - expected)[known])
        shift += more
    if error > 0.5 * log.period:
        return None if abs(shift) < CLEAR * error else shift
    return shift if abs(shift) > CLEAR * error else 0.0


def _columns(log: Log, name: str, servo: Servo) -> tuple[Array, Array]:
    """Differentiate the model by shift, offset, scale, friction, ln c and ln b, (n, 6); and the model."""
    command, period = log.axes[name].command, log.period
    model = linear_response(command, servo, period)
    speed = np.gradient(model, period)
    more_b, more_c = replace(servo, b=servo.b * (1.0 + SIZES)), replace(servo, c=servo.c * (1.0 + SIZES))
    by_b = (linear_response(command, more_b, period) - model) / SIZES
    by_c = (linear_response(command, more_c, period) - model) / SIZES
    ones = np.ones_like(model)
    return np.column_stack((-speed, ones, model - model.mean(), -np.sign(speed), by_c, by_b)), model


def _least_squares(columns: Array, residual: Array) -> tuple[float, float]:
    """First coefficient and its standard error; neighbouring residuals may go together."""
    prior = np.array([0.0, 0.0, 0.0, 0.0, 1.0 / PRIOR, 1.0 / PRIOR])
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scale[scale == 0.0] = 1.0
    q = columns / scale
    spread = float(np.std(residual)) or 1.0
    for _ in range(2):
        weight = (spread * prior / scale) ** 2
        inverse = np.linalg.pinv(q.T @ q + np.diag(weight))
        found = inverse @ (q.T @ residual)
        left = residual - q @ found
        spread = math.sqrt(float(np.mean(left**2)) * _together(left)) or 1e-300
    return float(found[0] / scale[0]), float(spread * math.sqrt(inverse[0, 0]) / scale[0])


def _together(residual: Array) -> float:
    """Count the samples that say one thing: 1 + 2 Σ of the autocorrelation, to where it is below 0.05."""
    size = 1 << (2 * residual.size - 1).bit_length()
    power = np.abs(np.fft.rfft(residual - residual.mean(), size)) ** 2
    correlation = np.fft.irfft(power, size)[: residual.size]
    if correlation[0] <= 0.0:
        return 1.0
    correlation = correlation / correlation[0]
    end = int(np.argmax(correlation < 0.05)) or correlation.size
    return max(1.0, 1.0 + 2.0 * float(np.sum(correlation[1:end])))
