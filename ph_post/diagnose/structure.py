"""Whether what a model leaves over is more than noise."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy import stats

from ph_post.types import Array, BoolArray

CHANCE: Final = 1e-3
"""How often white noise may be taken for structure, at most."""

LARGER: Final = 0.05
"""By how much the mean square of a coloured residual must be above noise²: it is known that well."""

MUCH_LARGER: Final = 1.0
"""By how much that of any residual must be, white or not: impulses are white."""

FEWEST: Final = 32
"""Samples below which nothing is said."""


def is_structured(residual: Array, counted: BoolArray, noise: float) -> tuple[bool, float]:
    """Tell whether a residual is more than noise of that size.

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
    """Tell whether values are anything but white noise, by Fisher's test for a line and by octaves.

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
        2.0 * float(np.sum(octave)) / level > stats.chi2.isf(CHANCE / tests, 2 * octave.size)
        for octave in octaves
    )
    return bool(line or offset or band)


def _starts(size: int) -> list[int]:
    """First row of each octave of so many rows: 0, 1, 3, 7, ..."""
    return [2**k - 1 for k in range(size.bit_length()) if 2**k - 1 < size]
