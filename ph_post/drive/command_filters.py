"""What dead time and filters make of a command on its way to the loop of a cascade.

References
----------
.. [1] N. C. Singer, W. P. Seering: Preshaping command inputs to reduce system vibration, J. Dyn. Syst. Meas. Control
   112 (1990): the zero-vibration shaper.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ph_post.compiling import compiled, read_only
from ph_post.types import Array, Cascade, frozen

ComplexArray = NDArray[np.complexfloating[Any, Any]]


def feeds_acceleration(cascade: Cascade) -> bool:
    """Return whether the acceleration of the command is fed forward."""
    return cascade.acceleration_feedforward != 0.0 or cascade.acceleration_lead != 0.0


def filters_of(cascade: Cascade) -> tuple[float | bool, ...]:
    """Return all that :func:`arriving` goes by: cascades that are alike in it get a command alike."""
    lags = (cascade.dead_time, cascade.moving_average, cascade.exponential)
    return (*lags, cascade.shaper_frequency, cascade.shaper_damping, feeds_acceleration(cascade))


class Arriving(NamedTuple):
    """What reaches a loop: the command (n,) [m], and its acceleration [m/s²], (0,) where that is not fed forward."""

    position: Array
    acceleration: Array


def arriving(cascade: Cascade, command: Array, slope: float, period: float) -> Arriving:
    """Return a command as it reaches the loop: late by the dead time, and filtered.

    Parameters
    ----------
    cascade : Cascade
    command : Array, shape (n,)
        As it was sent, linear between samples [m].
    slope : float
        Its speed before the first sample [m/s].
    period : float
        [s].

    Returns
    -------
    Arriving
        Exact at the samples. The acceleration is the second difference around them.

    Examples
    --------
    >>> late = Cascade(position_gain=50.0, velocity_gain=300.0, dead_time=1e-3)
    >>> arriving(late, np.array([0.0, 0.0, 1.0, 2.0]), 0.0, 1e-3).position
    array([0., 0., 0., 1.])
    """
    ramp = command[0] + slope * period * np.arange(command.size)
    off = _late(command - ramp, cascade.dead_time / period)
    off = _averaged(off, cascade.moving_average / period)
    off = _smoothed(off, cascade.exponential / period)
    if cascade.shaper_frequency:
        weight, delay = _impulses(cascade)
        off = weight * off + (1.0 - weight) * _late(off, delay / period)
    position = ramp - slope * mean_delay(cascade) + off
    if not feeds_acceleration(cascade):
        return Arriving(position, np.zeros(0))
    before, behind = position[0] - slope * period, 2.0 * position[-1] - position[-min(2, position.size)]
    return Arriving(position, np.diff(np.concatenate([[before], position, [behind]]), 2) / period**2)


def rates_of(place: Array, period: float) -> Array:
    """Return the speeds of places, shape (n,), of fourth order; beside a kink of the speed from the side without one.

    Examples
    --------
    >>> rates_of(np.array([0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0]), 1.0)
    array([1., 1., 1., 0., 0., 0., 0.])
    """
    if place.size < 5:
        return np.asarray(np.gradient(place, period))
    return _rates(read_only(place), period)


@compiled
def _rates(place: Array, period: float) -> Array:
    last = place.size - 1
    found, kinked = np.empty(place.size), np.zeros(place.size, dtype=np.bool_)
    steps, bends = np.empty(last), np.empty(place.size)  # of a bend the number is that of its place
    for k in range(last):
        steps[k] = (place[k + 1] - place[k]) / period
    found[0], found[last] = steps[0], steps[last - 1]
    for k in range(1, last):
        bends[k] = steps[k] - steps[k - 1]
        found[k] = (place[k + 1] - place[k - 1]) / (2.0 * period)
    for k in range(2, last - 1):
        before, behind = steps[k - 1] + 0.5 * bends[k - 1], steps[k] - 0.5 * bends[k + 1]
        kinked[k] = abs(before - behind) > 0.5 * abs(bends[k])
        if kinked[k]:
            found[k] = before if abs(bends[k - 1]) < abs(bends[k + 1]) else behind
    for k in range(2, last - 1):
        if not (kinked[k - 1] or kinked[k] or kinked[k + 1]):
            found[k] -= (bends[k + 1] - bends[k - 1]) / 12.0
    return found


def _late(off: Array, samples: float) -> Array:
    """Delay what was 0 before the first sample."""
    if samples == 0.0:
        return off
    rows = np.arange(off.size, dtype=np.float64)
    return np.interp(rows - samples, rows, off, left=0.0)


def _averaged(off: Array, samples: float) -> Array:
    """Average over the samples before, of what is linear in between and was 0 before the first."""
    if samples == 0.0:
        return off
    whole = np.concatenate([[0.0], np.cumsum(0.5 * (off[1:] + off[:-1]))])
    begin = np.arange(off.size) - samples
    row = np.clip(np.floor(begin).astype(np.int64), 0, max(off.size - 2, 0))
    part = begin - row
    after = off[np.minimum(row + 1, off.size - 1)]
    until = whole[row] + part * (off[row] + 0.5 * part * (after - off[row]))
    return np.asarray((whole - np.where(begin > 0.0, until, 0.0)) / samples)


def _smoothed(off: Array, samples: float) -> Array:
    """Pass what is linear between samples, and was 0 before the first, through a lag of the first order."""
    if samples == 0.0:
        return off
    from scipy.signal import lfilter

    b, a = _lag(samples)
    return np.asarray(lfilter(b, a, off))


@lru_cache(maxsize=64)
def _lag(samples: float) -> tuple[Array, Array]:
    """Numerator and denominator of 1 / (1 + T s) for signals that are linear between samples."""
    kept = math.exp(-1.0 / samples)
    rest = -math.expm1(-1.0 / samples)
    return frozen([1.0 - samples * rest, samples * rest - kept]), frozen([1.0, -kept])


def _impulses(cascade: Cascade) -> tuple[float, float]:
    """Return the first impulse of a zero-vibration shaper, and by how much the second one is later [s]."""
    root = math.sqrt(1.0 - cascade.shaper_damping**2)
    overshoot = math.exp(-math.pi * cascade.shaper_damping / root)
    return 1.0 / (1.0 + overshoot), math.pi / (cascade.shaper_frequency * root)


def mean_delay(cascade: Cascade) -> float:
    """Time by which dead time and filters make a steady motion late [s].

    Examples
    --------
    >>> mean_delay(Cascade(position_gain=50.0, velocity_gain=300.0, dead_time=1e-3, moving_average=8e-3))
    0.005
    """
    late = cascade.dead_time + 0.5 * cascade.moving_average + cascade.exponential
    if cascade.shaper_frequency:
        weight, delay = _impulses(cascade)
        late += (1.0 - weight) * delay
    return late


def memory(cascade: Cascade) -> float:
    """Time that dead time and filters reach back [s]."""
    shaper = _impulses(cascade)[1] if cascade.shaper_frequency else 0.0
    return cascade.dead_time + cascade.moving_average + 5.0 * cascade.exponential + shaper


def filter_response(cascade: Cascade, omega: Array) -> ComplexArray:
    """Return what dead time and filters make of a harmonic command, complex, shape (n,); ω in rad/s.

    Examples
    --------
    >>> one = Cascade(position_gain=50.0, velocity_gain=300.0, exponential=1e-2)
    >>> complex(filter_response(one, np.array([100.0]))[0])
    (0.5-0.5j)
    """
    s = 1j * np.asarray(omega, dtype=np.float64)
    response = np.exp(-s * (cascade.dead_time + 0.5 * cascade.moving_average))
    response = response * np.sinc(0.5 * cascade.moving_average * omega / np.pi) / (1.0 + cascade.exponential * s)
    if cascade.shaper_frequency:
        weight, delay = _impulses(cascade)
        response = response * (weight + (1.0 - weight) * np.exp(-s * delay))
    return np.asarray(response)
