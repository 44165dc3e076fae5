"""The servo's stiffness K from a recorded force or current: effort = K (e - c_e v), a P loop's own equation.

It holds whatever the table does, so that friction that nobody knows of is in none of its terms. All of them
are smoothed alike, which leaves the equation as it is. A drive knows its speed a little late, nobody says how
much: either the record tells that too, or up to a sample of it counts as uncertainty.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ph_post.types import Array, AxisLog, BoolArray, Feedback

SMOOTH: Final = 4.0
"""Standard deviation of the smoothing, samples."""

REACH: Final = 16
"""Samples on either side that a smoothed one is made of."""

WINDOW: Final = 256
"""Samples over which what is left is averaged to see how far it is from white noise."""

TELLS: Final = 0.25
"""Relative standard error up to which K is known at all."""


def effort_gain(
    record: AxisLog, feedback: Feedback, period: float, use: BoolArray
) -> tuple[float, float] | None:
    """Return K and its standard error [unit of the effort / m].

    Parameters
    ----------
    record : AxisLog
    feedback : {"load", "motor", "none"}
    period : float
        [s].
    use : BoolArray, shape (n,)
        Samples that count.

    Returns
    -------
    tuple of float or None
        None where the loop's own side or its effort was not read, or the record does not tell K.
    """
    reading = record.table if feedback == "load" else record.motor
    if reading is None or record.effort is None or feedback == "none":
        return None
    use = use & _whole(np.isfinite(reading) & np.isfinite(record.effort))
    if np.count_nonzero(use) < 2 * WINDOW:
        return None
    place = gaussian_filter1d(np.nan_to_num(reading), SMOOTH)
    error = gaussian_filter1d(record.command, SMOOTH) - place
    effort = gaussian_filter1d(np.nan_to_num(record.effort), SMOOTH)[use]
    speed = np.gradient(place, period)
    late = speed - period * np.gradient(speed, period)
    plain, later, free = (
        _regressed(effort, np.stack(columns, axis=1)[use])
        for columns in ((error, speed), (error, late), (error, speed, late))
    )
    bounded = (plain[0], math.hypot(plain[1], later[0] - plain[0]))
    K, stderr = min(bounded, free, key=lambda one: one[1])
    return (K, stderr) if stderr <= TELLS * K else None


def _regressed(effort: Array, columns: Array) -> tuple[float, float]:
    """Return the coefficient of the first column, an origin aside, and its standard error."""
    columns = columns - np.mean(columns, axis=0)
    effort = effort - np.mean(effort)
    size = np.sqrt(np.mean(columns**2, axis=0)) + 1e-300
    frame = columns / size
    found = np.linalg.lstsq(frame, effort, rcond=1e-12)[0]
    left = effort - frame @ found
    variance = float(np.mean(left**2)) * _worth(left) * np.linalg.pinv(frame.T @ frame, rcond=1e-12)[0, 0]
    return float(found[0] / size[0]), math.sqrt(variance) / float(size[0])


def _whole(known: BoolArray) -> BoolArray:
    """Return which samples are, smoothed, made of known ones only."""
    holes = np.convolve(~known, np.ones(2 * REACH + 1), mode="same")
    return np.asarray(holes < 0.5)


def _worth(left: Array) -> float:
    """How many samples count as one; smoothed ones always do so several times."""
    least = 2.0 * math.sqrt(math.pi) * SMOOTH
    whole = left[: left.size // WINDOW * WINDOW].reshape(-1, WINDOW)
    spread = max(float(np.mean(left**2)), 1e-300)
    return max(least, float(WINDOW * np.mean(whole.mean(axis=1) ** 2)) / spread)
