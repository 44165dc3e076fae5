"""The noise floor of a reading, from repeated motions, standstills or third differences.

It is the root mean square that no model of the machine can get below.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

import numpy as np
from scipy import signal

from ph_post.gcode.program import runs
from ph_post.types import Array

SHORTEST: Final = 0.5
"""Shortest stretch that counts as a repeat [s]."""

CANDIDATES: Final = 24
"""Lags that are looked at closely."""

ROUNDING: Final = 3e-9
"""Most difference of equal commands that were written with six decimals of a millimetre [m]."""

SAME: Final = 1e-8
"""Grid on which places of a command are compared at first [m]."""

TAPS: Final = 16
"""Samples on each side from which a value between samples is taken."""


class Repeat(NamedTuple):
    """The motion from `start` to `stop` (samples) was commanded `lag` samples earlier too, whole or not."""

    start: int
    stop: int
    lag: float


def find_repeats(commands: Array, period: float, tolerance: float) -> tuple[Repeat, ...]:
    """Find what was commanded twice, on all axes at once.

    Parameters
    ----------
    commands : Array, shape (axes, n)
        [m].
    period : float
        [s].
    tolerance : float
        By how much the two may differ [m], beyond the rounding of the file.

    Returns
    -------
    tuple of Repeat
        All of one lag: the one with the most samples.
    """
    least = max(int(np.ceil(SHORTEST / period)), 8)
    if commands.shape[1] < 2 * least:
        return ()
    best: tuple[Repeat, ...] = ()
    for rough in _candidates(commands, least):
        lag = _refined(commands, rough)
        found = _stretches(commands, lag, least, max(tolerance, ROUNDING))
        if _length(found) > _length(best):
            best = found
    return best


def difference(reading: Array, repeat: Repeat) -> Array:
    """Subtract the reading of the first run from that of the second, scaled to the noise of one reading.

    Between samples white noise is averaged a little; the factor takes that into account.
    """
    whole, weights = _between(repeat.lag)
    first = _delayed(reading, whole, weights)
    scale = np.sqrt(1.0 + float(weights @ weights))
    return np.asarray((reading - first)[repeat.start : repeat.stop] / scale, dtype=np.float64)


def _length(repeats: tuple[Repeat, ...]) -> int:
    """Count the samples in repeats."""
    return sum(repeat.stop - repeat.start for repeat in repeats)


def _candidates(commands: Array, least: int) -> list[float]:
    """Lags at which a command may repeat itself: parts of it by whole samples, and all of it."""
    apart = _mean_square(commands)
    inside = apart[least:-least]
    found = _recurrences(commands, least)
    if inside.size >= 3:
        at = signal.argrelmin(inside, mode="clip")[0] + least
        at = at[np.argsort(apart[at], kind="stable")][:CANDIDATES]
        found += [_vertex(apart, int(k)) for k in at]
    return found


def _recurrences(commands: Array, least: int) -> list[float]:
    """Lags, the most frequent first, at which three places `least` samples from first to last come again."""
    n = commands.shape[1] - least
    places = np.vstack([commands[:, k : k + n] for k in (0, least // 2, least)])
    keys = np.round(places / SAME).astype(np.int64)
    moves = np.any(np.ptp(keys.reshape(3, -1, n), axis=0) > 0, axis=0)
    rows = np.flatnonzero(moves)
    order = rows[np.lexsort(keys[:, rows])]
    again = np.all(np.diff(keys[:, order], axis=1) == 0, axis=0)
    lags = np.diff(order)[again]
    values, counts = np.unique(lags[lags >= least], return_counts=True)
    return [float(lag) for lag in values[np.argsort(-counts, kind="stable")][:CANDIDATES]]


def _mean_square(values: Array) -> Array:
    """Mean square of values minus themselves k samples earlier, by k, all axes together."""
    n = values.shape[1]
    squares = np.concatenate(([0.0], np.cumsum(np.sum((values - values[:, :1]) ** 2, axis=0))))
    product = np.zeros(n)
    for row in values - values[:, :1]:
        product += signal.fftconvolve(row, row[::-1])[n - 1 :]
    k = np.arange(n)
    both = squares[n] - squares[k] + squares[n - k] - 2.0 * product
    return np.asarray(np.maximum(both, 0.0) / (n - k), dtype=np.float64)


def _vertex(values: Array, k: int) -> float:
    """Return the vertex of the parabola through a minimum and its neighbours, whole where it nearly is."""
    left, middle, right = values[k - 1 : k + 2]
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend > 0.0 else 0.0
    return float(k) if abs(shift) < 0.01 else k + float(shift)


def _refined(commands: Array, lag: float) -> float:
    """Lag between samples, by least squares over what differs by less than a sample's travel."""
    rough = lag
    if lag == round(lag):
        return lag
    for _ in range(2):
        whole, weights = _between(lag)
        above = below = 0.0
        for row in commands:
            speed = np.gradient(row)
            apart = np.nan_to_num(row - _delayed(row, whole, weights), nan=np.inf)
            near = np.abs(apart) <= np.max(np.abs(speed))
            above += float(apart[near] @ speed[near])
            below += float(speed[near] @ speed[near])
        # A minimum between samples is no farther from the rough one: beyond nothing repeats itself.
        lag -= above / below if below else np.inf
        if not abs(lag - rough) <= 1.0:
            return rough
    return lag


def _stretches(commands: Array, lag: float, least: int, tolerance: float) -> tuple[Repeat, ...]:
    """Stretches of at least so many samples in which all axes repeat themselves and one of them moves."""
    whole, weights = _between(lag)
    same = np.ones(commands.shape[1], dtype=np.bool_)
    moves = np.zeros(commands.shape[1], dtype=np.bool_)
    for row in commands:
        same &= np.nan_to_num(np.abs(row - _delayed(row, whole, weights)), nan=np.inf) <= tolerance
        moves |= np.abs(np.gradient(row)) > 0.0
    return tuple(
        Repeat(int(start), int(stop), lag)
        for start, stop in zip(*runs(same), strict=True)
        if stop - start >= least and np.mean(moves[start:stop]) > 0.5
    )


def _between(lag: float) -> tuple[int, Array]:
    """Whole samples of a lag and the weights of their neighbours that make up the rest: a windowed sinc."""
    whole = round(lag)
    rest = lag - whole
    if rest == 0.0:
        return whole, np.ones(1)
    at = np.arange(-TAPS, TAPS + 1) - rest
    weights = np.sinc(at) * np.cos(0.5 * np.pi * at / (TAPS + 1.0)) ** 2
    return whole, np.asarray(weights / np.sum(weights), dtype=np.float64)


def _delayed(values: Array, whole: int, weights: Array) -> Array:
    """Values of so many samples earlier; NaN where there are none."""
    half = weights.size // 2
    earlier = np.full(values.size, np.nan)
    blended = values if half == 0 else np.convolve(values, weights, mode="valid")
    # blended[i] belongs to sample i + half; as the kernel is reversed by convolve, `rest` > 0 looks back
    lo, hi = whole + half, min(values.size, whole + values.size - half)
    if lo < hi:
        earlier[lo:hi] = blended[: hi - lo]
    return earlier


STANDSTILL: Final = 0.05
"""Shortest standstill of the command that counts [s]."""

FEWEST: Final = 8
"""Samples that a stretch needs at least."""

PIECE: Final = 2.0
"""A repeat is freed from drift in pieces of about this length [s]: drift is the machine's, no noise."""

OUTLYING: Final = 4.0
"""Times the median of the pieces' mean squares from which on a piece of a repeat is left out."""

BLOCKS: Final = 41
"""Blocks over which the median of the differences is taken: reversals are in a few of them only."""

THIRD: Final = math.sqrt(20.0)
"""Root of the sum of the squares of 1, 3, 3, 1."""

LEAST_TURNS: Final = 1.25
"""Oscillations that a standstill must hold to show one."""

MOST_TURNS: Final = 40.0
"""Oscillations of a standstill up to which one is looked for."""

LINE: Final = 0.75
"""Part of the power of a standstill that one oscillation must hold."""

CREEP: Final = 4.0
"""Standard errors by which a creeping stretch has moved from its first part to its last."""


def noise_of_repeats(reading: Array, repeats: Iterable[Repeat], period: float) -> float | None:
    """Noise by motions that were run again, both settled [same unit]; None where there is no such stretch.

    What slowly grows from run to run (heat) is taken out as a straight line by pieces; a wander of shorter
    periods is left in, which sample to sample differences do not see. The few pieces in which something did not
    repeat (a stop, a step lost) do not count: no more than so many times the median is taken of any.
    """
    pieces = []
    for repeat in repeats:
        apart = difference(reading, repeat)
        count = max(1, round(apart.size * period / PIECE))
        pieces += [_without_line(piece) for piece in np.array_split(apart, count)]
    sizes = [float(np.nanmean(piece**2)) for piece in pieces if np.count_nonzero(np.isfinite(piece)) >= FEWEST]
    most = OUTLYING * float(np.median(sizes)) if sizes else 0.0
    return _pooled([piece for piece in pieces if piece.size and np.nanmean(piece**2) <= most], lost=2)


def noise_of_standstill(reading: Array, command: Array, settle: int, period: float) -> float | None:
    """Noise while the command stands still and the axis has come to rest; None where it never does.

    An axis that creeps on, held up by friction, is moving: such a stretch does not count.
    """
    least = max(round(STANDSTILL / period), FEWEST)
    pieces = []
    for start, stop in still_stretches(command):
        piece = reading[start + settle : stop]
        piece = piece[np.isfinite(piece)]
        if stop - start - settle >= least and piece.size >= FEWEST and not _creeps(piece):
            pieces.append(piece - np.mean(piece))
    return _pooled(pieces, lost=1)


def oscillates(reading: Array, command: Array, settle: int) -> bool:
    """Return whether one frequency dominates the longest standstill: such a reading moves."""
    still = max(still_stretches(command), key=lambda one: one[1] - one[0], default=(0, 0))
    piece = reading[still[0] + settle : still[1]]
    piece = piece[np.isfinite(piece)]
    if piece.size < FEWEST * FEWEST:
        return False
    piece = piece - np.mean(piece)
    turns = np.arange(piece.size)[:, None] / piece.size
    best = 0.0
    for count in np.arange(LEAST_TURNS, min(MOST_TURNS, piece.size / 8.0), 0.25):
        angle = 2.0 * np.pi * count * turns
        wave = np.hstack([np.sin(angle), np.cos(angle), np.ones_like(turns)])
        sizes = np.linalg.lstsq(wave, piece, rcond=None)[0]
        best = max(best, float(np.sum((wave @ sizes) ** 2)))
    return best > LINE * float(piece @ piece)


def noise_of_differences(residual: Array) -> float | None:
    """Noise by third differences, which smooth motion hardly has; the median over blocks.

    It sees what changes from sample to sample only: a slow wander of the reading is missed.
    """
    third = np.diff(residual, 3)
    size = max(third.size // BLOCKS, 2 * FEWEST)
    count = third.size // size
    if count == 0:
        return None
    square = third[: count * size].reshape(count, size) ** 2
    known = np.isfinite(square)
    enough = known.sum(axis=1) >= FEWEST
    if not np.any(enough):
        return None
    mean = np.where(known, square, 0.0).sum(axis=1)[enough] / known.sum(axis=1)[enough]
    return math.sqrt(float(np.median(mean))) / THIRD


def still_stretches(command: Array) -> Iterator[tuple[int, int]]:
    """Yield first and one past the last sample of each stretch of a constant command."""
    for start, stop in zip(*runs(np.diff(command) == 0.0), strict=True):
        yield int(start), int(stop) + 1


def _pooled(pieces: list[Array], lost: int) -> float | None:
    """Root mean square of pieces from which `lost` numbers each were fitted."""
    kept = [piece[np.isfinite(piece)] for piece in pieces]
    kept = [piece for piece in kept if piece.size >= FEWEST]
    freedom = sum(piece.size - lost for piece in kept)
    if freedom <= 0:
        return None
    return math.sqrt(math.fsum(float(piece @ piece) for piece in kept) / freedom)


def _without_line(values: Array) -> Array:
    """Values minus their straight line; NaN stays."""
    known = np.isfinite(values)
    if np.count_nonzero(known) < FEWEST:
        return np.empty(0)
    at = np.linspace(-1.0, 1.0, values.size)
    slope, level = np.polyfit(at[known], values[known], 1)
    return np.asarray(values - (level + slope * at), dtype=np.float64)


def _creeps(values: Array) -> bool:
    """Return whether a stretch goes one way from fifth to fifth, and farther than its scatter allows."""
    fifths = np.array_split(values, 5)
    means = np.array([np.mean(part) for part in fifths])
    steps = np.diff(means)
    if not (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
        return False
    scatter = np.sqrt(np.mean([np.var(part) for part in fifths]) / fifths[0].size)
    return bool(abs(means[-1] - means[0]) > CREEP * scatter)
