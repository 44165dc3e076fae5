"""Parameters read from a log without a free-run fit: decay rate, servo stiffness, first b and c.

- β from a coast-down: ω = ω(0) e^(-βt), section 3.3 of [1]_; the position A + B e^(-βt) is fitted.
- K from a recorded force or current: effort = K (e - c_e v), the equation of a P loop,
  whatever the table does.
  A drive measures its speed a little late by an unknown time: the change that one sample makes counts as
  uncertainty.
- b and c from the following error, e = c ẋ + b ẍ.

Both sides of an equation are smoothed alike, which leaves it valid.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares

from ph_post.identify.free_run import samples_per_independent
from ph_post.identify.noise import still_stretches
from ph_post.types import Array, AxisLog, BoolArray, Feedback, Loop

SHORTEST_DECAY: Final = 0.2
"""Shortest stretch that is looked at [s]."""

LARGE: Final = 50.0
"""Times the noise that a decay must span."""

CLEAN: Final = 0.01
"""Part of what it spans by which a decay may miss the exponential."""

SLOW: Final = 5.0
"""Servo time constants below which a decay is the servo's."""

COUPLED: Final = 0.1
"""Part of the motor's travel from which on the table goes along."""

SPEED_SMOOTHING: Final = 5.0
"""Standard deviation of the smoothing before speeds are compared, samples."""

DECAY_WINDOW: Final = 64
"""Samples over which what is left is averaged to see how far it is from white noise."""


class CoastDown(NamedTuple):
    """A free decay: the stretch without drive, its rate and error [1/s], and whether the table went along."""

    start: int
    stop: int
    rate: float
    error: float
    coupled: bool


def find_coast_downs(
    axis_log: AxisLog, period: float, noise: float, effort_noise: float, memory: float
) -> list[CoastDown]:
    """Find the stretches in which an axis decays freely.

    Parameters
    ----------
    axis_log : AxisLog
    period : float
        [s].
    noise, effort_noise : float
        Of the position that is read, motor before table [m], and of the effort.
    memory : float
        Slowest time constant of the servo [s]; a decay as fast as that is no free one.
    """
    reading = axis_log.table if axis_log.motor is None else axis_log.motor
    if reading is None:
        return []
    found = []
    for start, stop in _undriven(axis_log, effort_noise):
        if (stop - start) * period < SHORTEST_DECAY:
            continue
        onset = start + _fastest(reading[start:stop])
        decay = _decay(reading[onset:stop], period, noise)
        if decay is not None and 1.0 / decay[0] > SLOW * memory:
            coupled = _goes_along(axis_log, reading, start, stop)
            found.append(CoastDown(start, stop, *decay, coupled))
    return found


def _undriven(axis_log: AxisLog, effort_noise: float) -> Iterator[tuple[int, int]]:
    """Yield the stretches of a constant command, and those without effort."""
    yield from still_stretches(axis_log.command)
    if axis_log.effort is not None and effort_noise > 0.0:
        idle = np.abs(np.nan_to_num(axis_log.effort, nan=np.inf)) <= 4.0 * effort_noise
        driven = np.cumsum(~idle).astype(np.float64)  # constant exactly where nothing drives
        for start, stop in still_stretches(driven):
            if np.ptp(axis_log.command[start:stop]) > 0.0:
                yield start + 1, stop


def _fastest(reading: Array) -> int:
    """Sample of the largest speed: a decay begins there, or a little later."""
    known = np.isfinite(reading)
    if np.count_nonzero(known) < 4 * DECAY_WINDOW:
        return 0
    place = np.interp(np.arange(reading.size), np.flatnonzero(known), reading[known])
    return int(np.argmax(np.abs(np.gradient(gaussian_filter1d(place, SPEED_SMOOTHING))))) + round(2.0 * SPEED_SMOOTHING)


def _decay(reading: Array, period: float, noise: float) -> tuple[float, float] | None:
    """Rate of A + B e^(-βt) and its standard error [1/s]; None where the reading is none."""
    known = np.isfinite(reading)
    t, y = np.arange(reading.size)[known] * period, reading[known]
    if y.size < 4 * DECAY_WINDOW or np.ptp(y) < LARGE * max(noise, 1e-9):
        return None
    span = float(t[-1])

    def columns(rate: float) -> Array:
        return np.stack([np.ones_like(t), np.exp(-rate * t)], axis=1)

    def left(unknown: Array) -> Array:
        shapes = columns(math.exp(unknown[0]))
        return np.asarray(y - shapes @ np.linalg.lstsq(shapes, y, rcond=None)[0]) / np.ptp(y)

    start = min(
        (math.log(k / span) for k in (0.3, 1.0, 3.0, 10.0, 30.0)),
        key=lambda one: float(np.sum(left(np.array([one])) ** 2)),
    )
    found = least_squares(left, [start], bounds=([math.log(0.02 / span)], [math.log(300.0 / span)]))
    rate, rest = math.exp(found.x[0]), left(found.x)
    size = float(np.sqrt(np.mean(rest**2)))
    if size > max(CLEAN, 2.0 * noise / float(np.ptp(y))):
        return None
    return rate, rate * size * math.sqrt(samples_per_independent(rest, DECAY_WINDOW)) / max(
        float(np.linalg.norm(np.asarray(found.jac))), 1e-300
    )


def _goes_along(axis_log: AxisLog, reading: Array, start: int, stop: int) -> bool:
    """Return whether the table moves with the motor, or is all that was read."""
    if axis_log.motor is None or axis_log.table is None:
        return axis_log.motor is None
    table = axis_log.table[start:stop]
    return bool(np.nanmax(table) - np.nanmin(table) > COUPLED * np.ptp(reading[start:stop]))


def pooled_rate(found: list[CoastDown]) -> tuple[float, float]:
    """Mean rate of several decays and its standard error [1/s]."""
    weights = np.array([1.0 / max(one.error, 1e-12) ** 2 for one in found])
    rates = np.array([one.rate for one in found])
    return float(np.sum(weights * rates) / np.sum(weights)), float(np.sum(weights) ** -0.5)


EFFORT_SMOOTHING: Final = 4.0
"""Standard deviation of the smoothing, samples."""

EFFORT_REACH: Final = 16
"""Samples on either side that a smoothed one is made of."""

EFFORT_WINDOW: Final = 256
"""Samples over which what is left is averaged to see how far it is from white noise."""

MOST_STIFFNESS_ERROR: Final = 0.25
"""Relative standard error up to which K is known at all."""


def effort_gain(axis_log: AxisLog, loop: Loop, period: float, use: BoolArray) -> tuple[float, float] | None:
    """Return K and its standard error [unit of the effort / m].

    Parameters
    ----------
    axis_log : AxisLog
    loop : Loop
    period : float
        [s].
    use : BoolArray, shape (n,)
        Samples that count.

    Returns
    -------
    tuple of float or None
        None where the loop's own side or its effort was not read, or the log does not show K.
    """
    reading = loop.closed_over(axis_log.table, axis_log.motor)
    if reading is None or axis_log.effort is None or not loop.has_controller:
        return None
    use = use & _fully_known(np.isfinite(reading) & np.isfinite(axis_log.effort))
    if np.count_nonzero(use) < 2 * EFFORT_WINDOW:
        return None
    place = gaussian_filter1d(np.nan_to_num(reading), EFFORT_SMOOTHING)
    error = gaussian_filter1d(axis_log.command, EFFORT_SMOOTHING) - place
    effort = gaussian_filter1d(np.nan_to_num(axis_log.effort), EFFORT_SMOOTHING)[use]
    speed = np.gradient(place, period)
    late = speed - period * np.gradient(speed, period)
    plain, later = (_regressed(effort, np.stack([error, v], axis=1)[use]) for v in (speed, late))
    K, stderr = plain[0], math.hypot(plain[1], later[0] - plain[0])
    return (K, stderr) if stderr <= MOST_STIFFNESS_ERROR * K else None


def _regressed(effort: Array, columns: Array) -> tuple[float, float]:
    """Return the coefficient of the first column, an origin aside, and its standard error."""
    columns = columns - np.mean(columns, axis=0)
    effort = effort - np.mean(effort)
    size = np.sqrt(np.mean(columns**2, axis=0)) + 1e-300
    frame = columns / size
    found = np.linalg.lstsq(frame, effort, rcond=1e-12)[0]
    left = effort - frame @ found
    # Smoothing alone makes as many samples one.
    worth = max(2.0 * math.sqrt(math.pi) * EFFORT_SMOOTHING, samples_per_independent(left, EFFORT_WINDOW))
    variance = float(np.mean(left**2)) * worth * np.linalg.pinv(frame.T @ frame, rcond=1e-12)[0, 0]
    return float(found[0] / size[0]), math.sqrt(variance) / float(size[0])


def _fully_known(known: BoolArray) -> BoolArray:
    """Return which samples are, smoothed, made of known ones only."""
    holes = np.convolve(~known, np.ones(2 * EFFORT_REACH + 1), mode="same")
    return np.asarray(holes < 0.5)


LAG_SMOOTHING: Final = 6.0
"""Standard deviation of the smoothing, samples."""

LAG_EDGE: Final = 30
"""Samples at either end that the smoothing spoils."""

LEAST_LAG_SIGNIFICANCE: Final = 4.0
"""Standard errors from which on a coefficient is one."""


class FollowingLag(NamedTuple):
    """The following error's coefficients by acceleration [s²] and velocity [s], and what they leave [m].

    None where they do not stand out of what is left.
    """

    b: float | None
    c: float | None
    rms: float


def lag_of(command: Array, reading: Array, period: float) -> FollowingLag:
    """Regress the following error on velocity and acceleration of a reading, direction and origin aside."""
    known = np.isfinite(reading)
    place = np.interp(np.arange(reading.size), np.flatnonzero(known), reading[known])
    smooth = gaussian_filter1d(place, LAG_SMOOTHING)
    error = gaussian_filter1d(command - place, LAG_SMOOTHING)
    speed = np.gradient(smooth, period)
    gain = np.gradient(speed, period)
    moving = np.abs(speed) > 1e-3 * np.max(np.abs(speed), initial=1e-12)
    columns = np.stack([gain, speed, np.sign(speed) * moving, np.ones(speed.size)], axis=1)
    asked = np.abs(np.gradient(gaussian_filter1d(command, LAG_SMOOTHING), period))
    use = asked > 1e-3 * np.max(asked)  # where the command stands the drive may be off
    use[:LAG_EDGE] = use[-LAG_EDGE:] = False
    use &= np.convolve(~known, np.ones(2 * LAG_EDGE + 1), mode="same") < LAG_EDGE  # not where much is missing
    columns, error = columns[use], error[use]
    size = np.sqrt(np.mean(columns**2, axis=0)) + 1e-300
    scaled = columns / size
    found = np.linalg.lstsq(scaled, error, rcond=1e-10)[0]
    left = error - scaled @ found
    rms = float(np.sqrt(np.mean(left**2)))
    spread = np.linalg.pinv(scaled.T @ scaled, rcond=1e-10)
    errors = rms * np.sqrt(4.0 * LAG_SMOOTHING * np.diag(spread))
    b, c = (float(found[k] / size[k]) if found[k] > LEAST_LAG_SIGNIFICANCE * errors[k] else None for k in (0, 1))
    return FollowingLag(b, c, rms)


def loop_reading(axis_log: AxisLog, loop: Loop) -> Array | None:
    """Return the reading at the side that the loop closes over, else the other, None where there is none."""
    own = loop.closed_over(axis_log.table, axis_log.motor)
    return loop.closed_over(axis_log.motor, axis_log.table) if own is None else own


def assumed_feedback(axis_log: AxisLog, period: float) -> tuple[Feedback, str]:
    """Return which loop the readings speak for, and why; nobody said it."""
    if axis_log.table is None:
        return "motor", "only the motor was read"
    if axis_log.motor is None:
        return "load", "only the table was read"
    table, motor = (lag_of(axis_log.command, one, period).rms for one in (axis_log.table, axis_log.motor))
    if table < motor:
        return "load", "the table follows the command more closely than the motor"
    return "motor", "the motor follows the command more closely than the table"
