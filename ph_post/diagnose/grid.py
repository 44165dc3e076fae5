"""The grid of a reading: the step between its values, where it has one."""

from __future__ import annotations

from typing import Final

import numpy as np

from ph_post.types import Array

ON_GRID: Final = 0.97
"""Part of the steps between neighbouring values that must be whole numbers of the quantum."""

OFF: Final = 0.08
"""By how much of a quantum a step may miss a whole number and still count as one."""

VISIBLE: Final = 0.1
"""Quantum against noise below which a grid adds nothing: a hundredth of q²/12 of the noise's square."""

FEW: Final = 4
"""Different values fewer than this tell no grid."""


def find_quantum(reading: Array, rounding: float) -> float:
    """Find the quantum of a reading.

    A file with so many decimals lays a grid of its own over that of the encoder, which need not be a multiple
    of it: values closer than the rounding are taken as one before the finer search is made.

    Parameters
    ----------
    reading : Array, shape (n,)
        NaN where a sample is missing.
    rounding : float
        Last decimal of the file, at a guess; in the unit of the reading.

    Returns
    -------
    float
        0 where there is no grid.
    """
    values = np.unique(reading[np.isfinite(reading)])
    if values.size < 2:
        return 0.0
    coarse = _spacing(_merged(values, 1.2 * rounding), 1.2 * rounding)
    if coarse > 6.0 * rounding:
        return coarse
    scale = float(np.max(np.abs(values)))
    return _spacing(_merged(values, 8.0 * np.finfo(np.float64).eps * scale), 0.0)


def visible_quantum(quantum: float, noise: float) -> float:
    """Quantum as far as it shows against the noise, else 0."""
    return quantum if quantum > VISIBLE * noise else 0.0


def _merged(values: Array, closer: float) -> Array:
    """Mean of each cluster of sorted values that lie closer together than that; none if a cluster is wide."""
    starts = np.flatnonzero(np.concatenate(([True], np.diff(values) > closer)))
    ends = np.concatenate((starts[1:], [values.size])) - 1
    if np.any(values[ends] - values[starts] > 2.0 * closer):
        return np.empty(0)
    counts = ends - starts + 1
    return np.asarray(np.add.reduceat(values, starts) / counts, dtype=np.float64)


def _spacing(values: Array, blur: float) -> float:
    """Greatest common step of sorted values, each off by up to `blur`; 0 where they have none."""
    steps = np.diff(values)
    if steps.size == 0:
        return 0.0
    smallest = float(np.min(steps))
    quantum = float(np.mean(steps[steps <= 1.5 * smallest + blur]))
    if steps.size + 1 < FEW:
        return quantum if np.ptp(steps) <= 0.02 * quantum else 0.0
    for longest in (5.0, 20.0, 80.0, np.inf):  # the better it is known the longer a step may be
        tried = steps[steps <= longest * smallest]
        whole = np.round(tried / quantum)
        on = np.abs(tried - whole * quantum) <= OFF * quantum + blur
        if np.mean(on) < ON_GRID:
            return 0.0
        quantum = float(np.sum(tried[on]) / np.sum(whole[on]))
    return quantum
