"""What goes on at a frequency of its own, whatever the axis does: mains, a spindle, a resonance."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from ph_post.diagnose.record import Place
from ph_post.diagnose.sentences import percent
from ph_post.types import Array, BoolArray

LEAST: Final = 0.25
"""Share of the excess from which a line of the spectrum is told."""

WIDE: Final = 3
"""Rows of the spectrum to either side that belong to a line: those of a Hann window."""


def humming(axis: str, residual: Array, counted: BoolArray, noise: float, period: float) -> Iterator[Place]:
    """Yield the strongest line of a residual's spectrum, where it holds much of the excess over the noise.

    Parameters
    ----------
    axis : str
    residual : Array, shape (n,)
        Reading minus model [m].
    counted : BoolArray, shape (n,)
    noise : float
        Root mean square of what is no excess [m].
    period : float
        Sampling period [s].
    """
    rows = np.flatnonzero(counted)
    if rows.size < 64:
        return
    values = np.where(counted, residual, 0.0)[rows[0] : rows[-1] + 1]
    values = (values - np.mean(values)) * np.hanning(values.size)
    power = np.abs(np.fft.rfft(values)) ** 2
    at = int(np.argmax(power))
    near = power[max(at - WIDE, 0) : at + WIDE + 1]
    square = float(np.mean(residual[counted] ** 2))
    excess = square - noise**2
    if at <= WIDE or excess <= 0.0 or not np.any(power > 0.0):
        return
    share = min(float(np.sum(near) / np.sum(power)) * square / excess, 1.0)
    if share < LEAST:
        return
    rows_of = np.arange(at - WIDE, at - WIDE + near.size)
    hertz = float(np.sum(rows_of * near) / np.sum(near)) / (values.size * period)
    sentence = f"{percent(share)} of the excess is at {hertz:.3g} Hz, whatever the axis does"
    yield Place(axis=axis, by="frequency", share=share, value=hertz, sentence=sentence)
