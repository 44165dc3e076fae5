"""The noise floor of a reading: the root mean square that no model of the machine can get below."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from ph_post.diagnose.repeats import Repeat, difference
from ph_post.types import Array

STANDSTILL: Final = 0.05
"""Shortest standstill of the command that counts [s]."""

FEWEST: Final = 8
"""Samples that a stretch needs at least."""

PIECE: Final = 2.0
"""A repeat is freed from drift in pieces of about this length [s]: drift is the machine's, no noise."""

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


def of_repeats(reading: Array, repeats: Iterable[Repeat], period: float) -> float | None:
    """Noise by motions that were run again, both settled [same unit]; None where there is no such stretch.

    What slowly grows from run to run (heat) is taken out as a straight line by pieces; a wander of shorter
    periods is left in, which sample to sample differences do not see.
    """
    pieces = []
    for repeat in repeats:
        apart = difference(reading, repeat)
        count = max(1, round(apart.size * period / PIECE))
        pieces += [_without_line(piece) for piece in np.array_split(apart, count)]
    return _pooled(pieces, lost=2)


def of_standstill(reading: Array, command: Array, settle: int, period: float) -> float | None:
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


def hums(reading: Array, command: Array, settle: int) -> bool:
    """Whether one oscillation is most of what a reading does in the longest standstill: that is motion."""
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


def of_differences(residual: Array) -> float | None:
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
    still = (np.diff(command) == 0.0).astype(np.int8)
    ends = np.diff(np.concatenate(([0], still, [0])))
    for start, stop in zip(np.flatnonzero(ends == 1), np.flatnonzero(ends == -1), strict=True):
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
    """Whether a stretch goes one way from fifth to fifth, and farther than its scatter allows."""
    fifths = np.array_split(values, 5)
    means = np.array([np.mean(part) for part in fifths])
    steps = np.diff(means)
    if not (np.all(steps >= 0.0) or np.all(steps <= 0.0)):
        return False
    scatter = np.sqrt(np.mean([np.var(part) for part in fifths]) / fifths[0].size)
    return bool(abs(means[-1] - means[0]) > CREEP * scatter)
