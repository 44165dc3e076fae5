"""By how much a reading is late, beyond what its drive explains."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.response import linear_response
from ph_post.types import Array, Log, Machine, Servo

PRIOR: Final = 0.02
"""Relative standard error of b and c where the machine file gives none."""

PRIORS: Final = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0 / PRIOR, 1.0 / PRIOR])
"""One over the standard error of each coefficient, 0 where nothing is known of it."""

PLAIN: Final = 0.7
"""Mean square that a shift must leave at most, as a part of what is left without one."""

CLEAR: Final = 3.0
"""Standard errors by which a shift must differ from zero to be one."""

ROUNDS: Final = 4
"""Steps of Newton: a shift of a few samples is not small against the curvature of a motion."""

INDISTINCT: Final = 1e-9
"""Part of a column's square below which it is made of the others."""

SIZES: Final = 1e-3
"""Relative step of the numerical derivatives by b and c."""


def find_shift(log: Log, machine: Machine, name: str, reading: Array, first: int) -> float | None:
    """Find the delay of a reading by least squares against the linear drive [s].

    Beside the delay the drive's b and c may be off by what the file leaves open, and there may be an offset,
    a scale and a force that changes sign with the velocity: a delay is what they do not explain.

    Returns
    -------
    float or None
        0 where a shift of a sample would be seen and is not there; None where the record does not tell: an
        error that large would be, or what else may be off explains the record about as well.
    """
    drive = machine.axes.get(name)
    if drive is None or np.ptp(log.axes[name].command) == 0.0:
        return None
    columns, model = _columns(log, name, drive.servo)
    known = np.isfinite(reading)
    known[:first] = False
    if np.count_nonzero(known) < 10 * columns.shape[1]:
        return None
    residual = (reading - model)[known]
    without = _least_squares(columns[known, 1:], residual, PRIORS[1:])
    shift, found = 0.0, without
    rows = np.arange(reading.size, dtype=np.float64)
    for _ in range(ROUNDS):
        late = rows - shift / log.period
        expected = np.interp(late, rows, model)
        moved = np.column_stack([np.interp(late, rows, column) for column in columns.T])
        found = _least_squares(moved[known], (reading - expected)[known], PRIORS)
        shift += found.value
    if abs(shift) <= CLEAR * found.error:
        return 0.0 if found.error < 0.5 * log.period else None
    return shift if found.square < PLAIN * without.square else None


def _columns(log: Log, name: str, servo: Servo) -> tuple[Array, Array]:
    """Differentiate the model by shift, offset, scale, play, friction, ln c and ln b; and the model."""
    command, period = log.axes[name].command, log.period
    model = linear_response(command, servo, period)
    speed = np.gradient(model, period)
    more_b, more_c = replace(servo, b=servo.b * (1.0 + SIZES)), replace(servo, c=servo.c * (1.0 + SIZES))
    by_b = (linear_response(command, more_b, period) - model) / SIZES
    by_c = (linear_response(command, more_c, period) - model) / SIZES
    ones = np.ones_like(model)
    way = -np.sign(speed)
    friction = linear_response(way, servo, period)
    return np.column_stack((-speed, ones, model - model.mean(), way, friction, by_c, by_b)), model


class Fit(NamedTuple):
    """First coefficient, its standard error, and the mean square that is left."""

    value: float
    error: float
    square: float


def _least_squares(columns: Array, residual: Array, prior: Array) -> Fit:
    """Fit columns whose coefficients are 0 with a weight; neighbouring residuals may go together."""
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
    others = np.linalg.lstsq(q[:, 1:], q[:, 0], rcond=None)[0]
    own = float(np.mean((q[:, 0] - q[:, 1:] @ others) ** 2))
    told = own > INDISTINCT and inverse[0, 0] > 0.0
    error = float(spread * math.sqrt(inverse[0, 0]) / scale[0]) if told else math.inf
    return Fit(float(found[0] / scale[0]), error, float(np.mean(left**2)))


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
