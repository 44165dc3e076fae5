"""Signatures of a residual: small numbers that tell one cause from another.

A residual is reading minus model, (n,), `counted` the samples that count.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from scipy import optimize

from ph_post.diagnose.motion import Motion
from ph_post.types import Array, BoolArray

BINS: Final = 4096
"""Bins over position for the search of a period."""

FINER: Final = 4
"""Lines of the spectrum over position between those of independent periods."""

SHORTEST: Final = 8.0
"""Shortest period that is looked for, in bins."""

CYCLES: Final = 2.0
"""Periods that must fit into the range of a motion."""

SAME_FEED: Final = 1.15
"""Feeds within this factor are one."""


class Scaling(NamedTuple):
    """Feeds [m/s], the residual's size behind reversals at each, and the power of the feed it goes with.

    The exponent is None where there is one feed only, or where nothing is left at some.
    """

    feeds: tuple[float, ...]
    sizes: tuple[float, ...]
    exponent: float | None


class Periodic(NamedTuple):
    """A period over position [m], amplitude and phase [rad] of sin(2π x/p + φ), its share of the square."""

    period: float
    amplitude: float
    phase: float
    share: float


class Drift(NamedTuple):
    """Change from beginning to end, the part of the mean square it makes up, and when half was done [s]."""

    change: float
    share: float
    half: float


def reversal_sizes(
    residual: Array, motion: Motion, window: float, counted: BoolArray
) -> tuple[Array, Array, Array, Array]:
    """Size of the residual behind each reversal: its root mean square within `window` [s].

    Returns
    -------
    size, direction, position, feed : Array, shape (reversals,)
        Direction that it reversed to, where [m], and the speed along the path in that stroke [m/s]: a mean in
        which the fast parts count most.
    """
    near = counted & (motion.since < window)
    _, begin, stroke = np.unique(motion.stroke, return_index=True, return_inverse=True)
    count = np.bincount(stroke[near], minlength=begin.size)
    square = np.bincount(stroke[near], residual[near] ** 2, minlength=begin.size)
    speed = motion.path_speed
    cube, low = (np.bincount(stroke, speed**power, minlength=begin.size) for power in (3, 2))
    feed = np.divide(cube, low, out=np.zeros(begin.size), where=low > 0.0)
    known = count >= 3
    size = np.sqrt(square[known] / count[known])
    begin = begin[known]
    return size, motion.direction[begin].astype(np.float64), motion.position[begin], feed[known]


def by_speed(residual: Array, motion: Motion, window: float, counted: BoolArray) -> Scaling:
    """Size of the residual behind reversals, by the feed of the stroke that follows."""
    size, _, _, feed = reversal_sizes(residual, motion, window, counted)
    size, feed = size[feed > 0.0], feed[feed > 0.0]
    order = np.argsort(feed, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(np.log(feed[order])) > math.log(SAME_FEED)) + 1)
    if size.size == 0:
        return Scaling((), (), None)
    feeds = np.array([np.mean(feed[group]) for group in groups])
    sizes = np.array([np.sqrt(np.mean(size[group] ** 2)) for group in groups])
    exponent = None
    if feeds.size > 1 and np.all(sizes > 0.0):
        weights = np.sqrt([group.size for group in groups])
        exponent = float(np.polyfit(np.log(feeds), np.log(sizes), 1, w=weights)[0])
    return Scaling(tuple(feeds.tolist()), tuple(sizes.tolist()), exponent)


def by_direction(
    residual: Array, motion: Motion, window: float, counted: BoolArray
) -> tuple[float, float] | None:
    """Size of the residual behind reversals to plus and to minus; None where one of them is missing."""
    size, direction, _, _ = reversal_sizes(residual, motion, window, counted)
    if not (np.any(direction > 0.0) and np.any(direction < 0.0)):
        return None
    plus, minus = (float(np.sqrt(np.mean(size[direction * way > 0.0] ** 2))) for way in (1.0, -1.0))
    return plus, minus


def by_rotation(residual: Array, motion: Motion, counted: BoolArray) -> tuple[float, float] | None:
    """Root mean square clockwise and counterclockwise; None where the path does not bend both ways."""
    sides = [residual[counted & (motion.turn == way)] for way in (-1, 1)]
    if min(side.size for side in sides) < 0.02 * np.count_nonzero(counted):
        return None
    clockwise, counter = (float(np.sqrt(np.mean(side**2))) for side in sides)
    return clockwise, counter


def best_period(residual: Array, position: Array, counted: BoolArray) -> Periodic | None:
    """Find the period over position that explains most: least squares of a sine, a mean and a line.

    None where the axis stands still or the residual is a mean and a line already.
    """
    x, r = position[counted], residual[counted]
    span = float(np.ptp(x)) if x.size else 0.0
    if span <= 0.0:
        return None
    r = _without(r, np.column_stack((np.ones_like(x), x)))
    total = float(r @ r)
    if total <= 0.0:
        return None
    bins = np.minimum(((x - x.min()) / span * BINS).astype(np.int64), BINS - 1)
    count = np.bincount(bins, minlength=BINS).astype(np.float64)
    sums = np.bincount(bins, r, minlength=BINS).astype(np.float64)
    frequency, gain = _spectrum(count, sums)
    rough, middle = float(frequency[int(np.argmax(gain))]), (np.arange(BINS) + 0.5) / BINS
    fine = optimize.minimize_scalar(
        lambda f: -_sine(middle, count, sums, f)[0] / total,
        bounds=(rough - 1.0 / FINER, rough + 1.0 / FINER), method="bounded", options={"xatol": 1e-4},
    )  # fmt: skip
    f = float(fine.x) / span
    explained, sine, cosine = _sine(x, np.ones_like(x), r, f)
    return Periodic(1.0 / f, math.hypot(sine, cosine), math.atan2(cosine, sine), explained / total)


def drift(residual: Array, t: Array, counted: BoolArray) -> Drift:
    """Find what changes slowly over the record: a polynomial of third degree in time."""
    at, r = t[counted], residual[counted]
    span = float(np.ptp(at)) if at.size else 0.0
    if span <= 0.0:
        return Drift(0.0, 0.0, 0.0)
    u = 2.0 * (at - at[0]) / span - 1.0
    fit = np.polynomial.Polynomial.fit(u, r, 3, domain=[-1.0, 1.0])
    course = fit(np.linspace(-1.0, 1.0, 201))
    change = float(course[-1] - course[0])
    square = float(np.mean(r**2))
    share = float(np.var(fit(u))) / square if square > 0.0 else 0.0
    done = int(np.argmax((course - course[0]) * np.sign(change) >= 0.5 * abs(change)))
    return Drift(change, share, done / 200.0 * span)


def _spectrum(count: Array, total: Array) -> tuple[Array, Array]:
    """Frequencies per range of the bins, and the square that a sine and a mean explain at each."""
    size = BINS * FINER
    ones, sums = np.fft.fft(count, size), np.fft.fft(total, size)
    k = np.arange(math.ceil(CYCLES * FINER), int(size / SHORTEST))
    n, mean = ones[0].real, sums[0].real / ones[0].real
    about = sums[k] - mean * ones[k]
    c, s, double = ones[k] / n, about, ones[2 * k]
    cc = 0.5 * (n + double.real) - n * c.real**2
    ss = 0.5 * (n - double.real) - n * c.imag**2
    cs = -0.5 * double.imag + n * c.real * c.imag
    p, q = s.real, -s.imag
    below = cc * ss - cs**2
    gain = np.where(below > 1e-6 * n**2, (ss * p**2 - 2.0 * cs * p * q + cc * q**2) / below, 0.0)
    return k / FINER, gain


def _sine(x: Array, count: Array, sums: Array, frequency: float) -> tuple[float, float, float]:
    """Square that a sine of so many cycles a unit of x explains beside a mean, its sine and cosine part."""
    angle = 2.0 * math.pi * frequency * x
    columns = np.column_stack((np.sin(angle), np.cos(angle), np.ones_like(x)))
    normal, right = columns.T @ (count[:, None] * columns), columns.T @ sums
    found = np.linalg.lstsq(normal, right, rcond=1e-10)[0]
    explained = float(found @ right) - float(np.sum(sums)) ** 2 / float(np.sum(count))
    return explained, float(found[0]), float(found[1])


def _without(values: Array, columns: Array) -> Array:
    """Values minus their least-squares fit."""
    found = np.linalg.lstsq(columns.T @ columns, columns.T @ values, rcond=1e-14)[0]
    return np.asarray(values - columns @ found, dtype=np.float64)
