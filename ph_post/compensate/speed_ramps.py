"""Ramps between two speeds: S-curves of limited acceleration and jerk.

An S-curve rises with constant jerk, may hold its acceleration for a while, and ends with constant jerk the
other way; it is symmetric, so its mean speed is the mean of its ends. Speeds [m/s], distances [m],
acceleration a [m/s²] and jerk j [m/s³] are arrays that broadcast, unless a function takes single numbers.
"""

from __future__ import annotations

import math

import numpy as np

from ph_post.types import Array

_ROOT_STEPS = 60
"""Newton steps towards a peak speed; about ten are usual."""

_LEFT = 1e-9
"""Part of the distance that ramps may leave or lack; they are made slower or faster by it."""


def ramp_time(v0: Array, v1: Array, a: Array, j: Array) -> Array:
    """Shortest time [s] of a ramp from v0 to v1, up or down."""
    change = np.abs(v1 - v0)
    time: Array = np.where(change * j <= a * a, 2.0 * np.sqrt(change / j), change / a + a / j)
    return time


def ramp_distance(v0: Array, v1: Array, a: Array, j: Array) -> Array:
    """Path [m] that the shortest ramp from v0 to v1 takes."""
    distance: Array = 0.5 * (v0 + v1) * ramp_time(v0, v1, a, j)
    return distance


def reachable(v: float, distance: float, a: float, j: float) -> float:
    """Highest speed that a ramp from `v` reaches within `distance`; single numbers.

    The cubic (2 v + x) √(x / j) = distance without, the quadratic (v + x / 2) (x / a + a / j) = distance with
    a stretch of constant acceleration, x being the change of speed.

    Examples
    --------
    >>> round(reachable(0.0, 1.0, a=10.0, j=1.0), 12)
    1.0
    """
    change = a * a / j
    if (2.0 * v + change) * math.sqrt(change / j) <= distance:
        half = v + 0.5 * change
        root = math.sqrt(half * half + 2.0 * (a * distance - v * change))
        change = 2.0 * (a * distance - v * change) / (half + root)
    else:
        y = real_root(2.0 * v / j, distance / j)
        change = j * y * y
    # The last bits are given away, so that what was called reachable is within the distance.
    return v + change * (1.0 - 1e-14)


def real_root(p: float, q: float) -> float:
    """Real root y >= 0 of y³ + p y = q with p, q >= 0.

    Examples
    --------
    >>> round(real_root(1.0, 10.0), 12)
    2.0
    """
    cube = math.cbrt(q)
    # Where the linear term cannot show, the hyperbolic form would divide by nothing.
    if p <= 1e-30 * cube * cube or q == 0.0:
        return cube
    scale = math.sqrt(p / 3.0)
    return 2.0 * scale * math.sinh(math.asinh(1.5 * q / (p * scale)) / 3.0)


def peak_speed(v0: Array, v1: Array, ceiling: Array, distance: Array, a: Array, j: Array) -> Array:
    """Highest speed <= `ceiling` from which a ramp leads back to v1 within `distance`; at least max(v0, v1).

    All arrays have one shape. The path taken is a convex function of the square root of the rise, so that
    Newton's method, begun above the root, comes down to it without overshooting.
    """
    low = np.maximum(v0, v1)
    peak = np.maximum(ceiling, low)
    rows = np.flatnonzero(_both_ramps(v0, v1, peak, a, j) > distance)
    v0, v1, low, distance, a, j = (part[rows] for part in (v0, v1, low, distance, a, j))
    # Both ramps take at least the path (3 low + 2 q²) q / √j for a rise of q².
    q = np.minimum(np.sqrt(peak[rows] - low), _cubic_root(1.5 * low, 0.5 * distance * np.sqrt(j)))
    q[_both_ramps(v0, v1, low, a, j) >= distance] = 0.0
    for _ in range(_ROOT_STEPS):
        excess = _both_ramps(v0, v1, low + q * q, a, j) - distance
        rest = np.flatnonzero((excess > 0.1 * _LEFT * distance) & (q > 0.0))
        if not rest.size:
            break
        at = low[rest] + q[rest] ** 2
        slope = sum(_slope(v[rest], at, q[rest], a[rest], j[rest]) for v in (v0, v1))
        q[rest] = np.maximum(q[rest] - excess[rest] / slope, 0.0)
    peak[rows] = low + q * q
    return peak


def _slope(v: Array, peak: Array, q: Array, a: Array, j: Array) -> Array:
    """Differentiate a ramp's path with respect to q > 0, dpeak = 2 q dq."""
    # The rise is at least q², which rounding may not show beside the speed.
    rise = np.maximum(peak - v, q * q)
    # dT/dpeak is 1 / √(j rise), or 1 / a with a stretch of constant acceleration.
    rate = np.where(rise * j <= a * a, q / np.sqrt(j * rise), q / a)
    slope: Array = q * ramp_time(v, peak, a, j) + (v + peak) * rate
    return slope


def _cubic_root(p: Array, q: Array) -> Array:
    """Real root y >= 0 of y³ + p y = q with p, q >= 0."""
    cube = np.cbrt(q)
    # Where the linear term cannot show, the hyperbolic form would divide by nothing.
    plain = p <= 1e-30 * cube * cube
    p = np.where(plain, 1.0, p)
    scale = np.sqrt(p / 3.0)
    bent = 2.0 * scale * np.sinh(np.arcsinh(1.5 * q / (p * scale)) / 3.0)
    root: Array = np.where(plain, cube, bent)
    return root


def _both_ramps(v0: Array, v1: Array, peak: Array, a: Array, j: Array) -> Array:
    """Path that the ramps from v0 up to `peak` and from there down to v1 take."""
    path: Array = ramp_distance(v0, peak, a, j) + ramp_distance(v1, peak, a, j)
    return path


def state_on_ramp(v0: Array, v1: Array, x: Array, a: Array, j: Array) -> tuple[Array, Array]:
    """Speed and acceleration at the distance `x` from the lower end of a ramp between v0 <= v1.

    The two ends are cubics in time, solved in closed form; between them v² is linear in x.
    """
    change = v1 - v0
    t1 = np.minimum(a / j, np.sqrt(change / j))
    dv = 0.5 * j * t1 * t1
    length = ramp_distance(v0, v1, a, j)
    x_low = t1 * (v0 + dv / 3.0)
    x_high = length - t1 * (v1 - dv / 3.0)
    # From the lower end v t + j t³ / 6 = x.
    t_low = np.minimum(_cubic_root(6.0 * v0 / j, 6.0 * np.maximum(np.minimum(x, x_low), 0.0) / j), t1)
    t_high = np.minimum(_time_to_high(v1, length - np.maximum(x, x_high), j), t1)
    between = np.sqrt((v0 + dv) ** 2 + 2.0 * a * np.clip(x - x_low, 0.0, None))
    early, late = x <= x_low, x >= x_high
    speed = np.where(early, v0 + 0.5 * j * t_low**2, np.where(late, v1 - 0.5 * j * t_high**2, between))
    acceleration = np.where(early, j * t_low, np.where(late, j * t_high, a))
    return np.clip(speed, v0, v1), acceleration


def _time_to_high(v: Array, y: Array, j: Array) -> Array:
    """Solve v t - j t³ / 6 = y for the smaller t >= 0."""
    p, q = 6.0 * v / j, 6.0 * np.maximum(y, 0.0) / j
    scale = np.sqrt(p / 3.0)
    still = scale == 0.0
    sine = np.where(still, 0.0, 0.5 * q / np.where(still, 1.0, scale) ** 3)
    time: Array = 2.0 * scale * np.sin(np.arcsin(np.minimum(sine, 1.0)) / 3.0)
    return time


def curve_phases(v0: Array, peak: Array, v1: Array, distance: Array, a: Array, j: Array) -> tuple[Array, Array]:
    """Seven phases of constant jerk from v0 over `peak` to v1; a phase that is not needed lasts 0 s.

    Ramps that leave or lack next to nothing of the distance are stretched in time to take all of it.

    Parameters
    ----------
    v0, peak, v1, distance, a, j : Array, shape (m,)

    Returns
    -------
    durations : Array, shape (m, 7)
    speeds : Array, shape (m, 7, 3)
        Bernstein coefficients of the speed in every phase.
    """
    up_times, up_speeds = _ramp_phases(v0, peak, a, j)
    down_times, down_speeds = _ramp_phases(v1, peak, a, j)
    ramps = _both_ramps(v0, v1, peak, a, j)
    left = distance - ramps
    cruises = left > _LEFT * distance
    cruise = np.where(cruises, left, 0.0) / np.where(peak > 0.0, peak, 1.0)
    slower = np.where(cruises | (ramps == 0.0), 1.0, distance / np.where(ramps > 0.0, ramps, 1.0))[:, None]
    durations = np.concatenate([up_times * slower, cruise[:, None], down_times[:, ::-1] * slower], axis=1)
    flat = np.repeat(peak[:, None, None], 3, axis=2)
    speeds = np.concatenate([up_speeds, flat, down_speeds[:, ::-1, ::-1]], axis=1)
    return durations, speeds


def _ramp_phases(low: Array, high: Array, a: Array, j: Array) -> tuple[Array, Array]:
    """Durations (m, 3) and speed coefficients (m, 3, 3) of the ramp up from `low` to `high`."""
    change = high - low
    t1 = np.minimum(a / j, np.sqrt(change / j))
    t2 = np.maximum(change / a - a / j, 0.0)
    dv = 0.5 * j * t1 * t1
    first, last = low + dv, high - dv
    durations = np.stack([t1, t2, t1], axis=1)
    speeds = np.stack(
        [
            np.stack([low, low, first], axis=1),
            np.stack([first, 0.5 * (first + last), last], axis=1),
            np.stack([last, high, high], axis=1),
        ],
        axis=1,
    )
    return durations, speeds
