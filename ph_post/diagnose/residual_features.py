"""Features of a residual: structure beyond noise, shares of its excess, signatures of causes.

A residual is reading minus model, (n,); `counted` are the samples that count. A place or rule is judged on
data that did not choose it.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from scipy import optimize, stats

from ph_post.identify.linear_drive import AxisMotion
from ph_post.types import Array, BoolArray, IntArray

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
    residual: Array, motion: AxisMotion, window: float, counted: BoolArray
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


def by_speed(residual: Array, motion: AxisMotion, window: float, counted: BoolArray) -> Scaling:
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


def by_direction(residual: Array, motion: AxisMotion, window: float, counted: BoolArray) -> tuple[float, float] | None:
    """Size of the residual behind reversals to plus and to minus; None where one of them is missing."""
    size, direction, _, _ = reversal_sizes(residual, motion, window, counted)
    if not (np.any(direction > 0.0) and np.any(direction < 0.0)):
        return None
    plus, minus = (float(np.sqrt(np.mean(size[direction * way > 0.0] ** 2))) for way in (1.0, -1.0))
    return plus, minus


def by_rotation(residual: Array, motion: AxisMotion, counted: BoolArray) -> tuple[float, float] | None:
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
        bounds=(rough - 1.0 / FINER, rough + 1.0 / FINER),
        method="bounded",
        options={"xatol": 1e-4},
    )
    f = float(fine.x) / span
    explained, sine, cosine = _sine(x, np.ones_like(x), r, f)
    return Periodic(1.0 / f, math.hypot(sine, cosine), math.atan2(cosine, sine), explained / total)


def drift(residual: Array, t: Array, counted: BoolArray) -> Drift:
    """Find what changes slowly over the log: a polynomial of third degree in time."""
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


TINY: Final = 1e-12
"""Relative size below which a column says nothing new."""


class Excess(NamedTuple):
    """Counted samples of a residual, (n,) [m], the half each is in, and the excess over the noise [m²].

    `energy` is each sample's part of the excess: r² - noise².
    """

    residual: Array
    half: BoolArray
    energy: Array
    total: float


class ExcessWindow(NamedTuple):
    """A stretch of a quantity: its share of the excess, and what chance gives it, its share of samples."""

    low: float
    high: float
    share: float
    chance: float


def excess_of(residual: Array, half: BoolArray, noise: float) -> Excess:
    """Lay out what a residual has more than noise."""
    energy = residual**2 - noise**2
    return Excess(residual, half, energy, float(np.sum(energy)))


def follows(excess: Excess, columns: Array, constant: bool = True) -> float:
    """Share of the excess that follows columns, beyond a constant: fitted on one half, counted on the other.

    Parameters
    ----------
    excess : Excess
    columns : Array, shape (n, k)
    constant : bool, optional
        Whether a constant is fitted beside them (and does not count).

    Returns
    -------
    float
        At most 1; nothing or less where they do not help to predict the other half.
    """
    gain = 0.0
    ones = np.ones((columns.shape[0], 1))
    full = np.hstack((ones, columns)) if constant else columns
    for fitted in (excess.half, ~excess.half):
        r, other = excess.residual[fitted], excess.residual[~fitted]
        if r.size == 0 or other.size == 0:
            return 0.0
        left = other - full[~fitted] @ solve(full[fitted], r)
        before = other - np.mean(r) if constant else other
        gain += float(before @ before - left @ left)
    return min(gain / excess.total, 1.0)


def solve(columns: Array, values: Array) -> Array:
    """Least squares by the normal equations of scaled columns."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scale[scale == 0.0] = 1.0
    scaled = columns / scale
    found = np.linalg.lstsq(scaled.T @ scaled, scaled.T @ values, rcond=TINY)[0]
    return np.asarray(found / scale, dtype=np.float64)


def window_from_zero(excess: Excess, quantity: Array) -> ExcessWindow:
    """Find up to which value of a quantity the excess is denser than on average; infinite is beyond."""
    order = np.argsort(quantity, kind="stable")
    grown = np.cumsum(excess.energy[order]) / excess.total
    chance = np.arange(1, order.size + 1) / order.size
    lift = np.where(np.isfinite(quantity[order]), grown - chance, -np.inf)
    at = int(np.argmax(lift))
    return ExcessWindow(0.0, float(quantity[order[at]]), min(float(grown[at]), 1.0), float(chance[at]))


def window_within(excess: Excess, number: IntArray, edges: Array, across: bool = True) -> ExcessWindow:
    """Find the stretch of bins in which the excess is densest.

    Parameters
    ----------
    excess : Excess
    number : IntArray, shape (n,)
        Bin of each sample.
    edges : Array, shape (bins + 1,)
    across : bool, optional
        Whether the stretch is chosen on one half and counted on the other; else on all of the log, for a
        quantity that the halves do not share.
    """
    size = edges.size - 1
    if not across:
        start, stop = _densest(excess.energy, number, size)
        return _window(excess, number, edges, start, stop)
    found = []
    for chosen in (excess.half, ~excess.half):
        start, stop = _densest(excess.energy[chosen], number[chosen], size)
        inside = (number >= start) & (number < stop) & ~chosen
        found.append((float(np.sum(excess.energy[inside])), int(np.count_nonzero(inside))))
    start, stop = _densest(excess.energy, number, size)
    share = sum(part[0] for part in found) / excess.total
    chance = sum(part[1] for part in found) / excess.energy.size
    return ExcessWindow(float(edges[start]), float(edges[stop]), min(share, 1.0), chance)


def share_of(excess: Excess, inside: BoolArray) -> float:
    """Share of the excess in samples."""
    return float(np.sum(excess.energy[inside])) / excess.total


def bins_of(quantity: Array, count: int) -> tuple[IntArray, Array]:
    """Bins of equal width over the range of a quantity: number of each sample, and the edges."""
    edges = np.linspace(float(np.min(quantity)), float(np.max(quantity)), count + 1)
    width = edges[1] - edges[0]
    if width <= 0.0:
        return np.zeros(quantity.size, dtype=np.int64), edges
    number = np.minimum(((quantity - edges[0]) / width).astype(np.int64), count - 1)
    return number, edges


def _window(excess: Excess, number: IntArray, edges: Array, start: int, stop: int) -> ExcessWindow:
    """Count a stretch of bins on all of the log."""
    inside = (number >= start) & (number < stop)
    share = min(share_of(excess, inside), 1.0)
    return ExcessWindow(float(edges[start]), float(edges[stop]), share, float(np.mean(inside)))


def _densest(energy: Array, number: IntArray, size: int) -> tuple[int, int]:
    """First and one past the last bin of the stretch with most energy beyond its share of samples."""
    total = float(np.sum(energy))
    if total <= 0.0:
        return 0, 0
    density = np.bincount(number, energy, size) / total - np.bincount(number, minlength=size) / energy.size
    grown = np.concatenate(([0.0], np.cumsum(density)))
    lowest = np.minimum.accumulate(grown)
    stop = int(np.argmax(grown - lowest))
    return int(np.argmin(grown[: stop + 1])), stop


CHANCE: Final = 1e-3
"""Probability at most with which white noise is taken for structure."""

LARGER: Final = 0.05
"""Part of noise² by which the mean square of a coloured residual must exceed it: it is known that well."""

MUCH_LARGER: Final = 1.0
"""The same of any residual, white or not: impulses are white."""

FEWEST: Final = 32
"""Samples below which nothing is said."""


def is_structured(residual: Array, counted: BoolArray, noise: float) -> tuple[bool, float]:
    """Return whether a residual is more than noise of that size.

    It is where its mean square is above that of the noise and its spectrum is not white: one line of the
    periodogram, or the mean of an octave, stands out. Both are compared with the residual's own mean, so that
    white noise which is a little larger than it was thought to be is no structure.

    Parameters
    ----------
    residual : Array, shape (n,)
    counted : BoolArray, shape (n,)
    noise : float
        Root mean square of the noise, in the unit of the residual.

    Returns
    -------
    structured : bool
    size : float
        Root mean square of what is more than noise, as a multiple of the noise; infinite where noise is 0.
    """
    values = residual[counted & np.isfinite(residual)]
    if values.size < FEWEST:
        return False, 0.0
    square = float(np.mean(values**2))
    excess = square - noise**2
    if excess <= 0.0:
        return False, 0.0
    if noise == 0.0:
        return True, math.inf
    relative = excess / noise**2
    sure = max(LARGER, 4.0 * math.sqrt(2.0 / values.size))
    structured = relative > MUCH_LARGER or (relative > sure and coloured(values))
    return structured, math.sqrt(relative)


def coloured(values: Array) -> bool:
    """Return whether values are anything but white noise, by Fisher's test for a line and by octaves.

    The mean is left in: an offset is no noise either.
    """
    power = np.abs(np.fft.rfft(values)) ** 2 / values.size
    constant, power = power[0], power[1 : (values.size + 1) // 2]
    level = float(np.mean(power))
    if level <= 0.0:
        return bool(constant > 0.0)
    octaves = [power[start : min(2 * start + 1, power.size)] for start in _starts(power.size)]
    tests = len(octaves) + 2
    line = float(np.max(power)) / level > -math.log(CHANCE / tests / power.size)
    offset = constant / level > stats.chi2.isf(CHANCE / tests, 1)
    band = any(
        2.0 * float(np.sum(octave)) / level > stats.chi2.isf(CHANCE / tests, 2 * octave.size) for octave in octaves
    )
    return bool(line or offset or band)


def _starts(size: int) -> list[int]:
    """First row of each octave of so many rows: 0, 1, 3, 7, ..."""
    return [2**k - 1 for k in range(size.bit_length()) if 2**k - 1 < size]
