"""Evidence of what comes again with the position: its period, and its size slow and fast."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy import optimize

from ph_post.diagnose.evidence.exhibit import FEWEST, Exhibit, against, alike, correlation, slopes
from ph_post.diagnose.sentences import length, percent, velocity
from ph_post.diagnose.signature import SAME_FEED, best_period
from ph_post.types import Array, BoolArray
from ph_post.units import MM

NEAR: Final = (0.97, 1.03)
"""Parts of a period within which it is refined."""


def wave_words(exhibit: Exhibit, physics: str, same: bool = False) -> Iterator[str]:
    """Yield the period that stands out, what turn it belongs to, and its size slow and fast.

    Parameters
    ----------
    exhibit : Exhibit
    physics : str
        What is predicted.
    same : bool
        Whether its size is predicted to be the same at all speeds.
    """
    residual, use, x = exhibit.before[exhibit.channel], exhibit.use(), exhibit.motion.position
    found = best_period(residual, x, use)
    if found is None:
        return
    period = _refined(residual, x, found.period, use)
    numbers = (
        f"{length(amplitude(residual, x, period, use))} every {period / MM:.3g} mm ({turns(exhibit)}), "
        f"{percent(found.share)} of the residual"
    )
    sizes = _sizes(exhibit, residual, use, period)
    agrees = True
    if sizes is not None:
        (slow, small), (fast, large) = sizes
        numbers += f"; {length(small)} at {velocity(slow)}, {length(large)} at {velocity(fast)}"
        agrees = not same or alike(small, large)
    yield against(physics, numbers, agrees)


def turns(exhibit: Exhibit) -> str:
    """Lay a period beside the travel of a turn of screw and motor, where the file tells them."""
    gap = exhibit.problem.axis.gap
    if gap.travel_per_rad is None:
        return "the file tells no screw lead"
    lead = 2.0 * math.pi * gap.travel_per_rad
    words = f"the screw's lead is {lead / MM:.4g} mm"
    if gap.gear_ratio is not None and gap.gear_ratio != 1.0:
        words += f" and a turn of the motor {lead / gap.gear_ratio / MM:.4g} mm"
    return words


def _refined(residual: Array, position: Array, period: float, use: BoolArray) -> float:
    """Find the period near one that explains most beside a constant and a line, fitted together [m]."""

    def missed(share: float) -> float:
        angle = 2.0 * math.pi * position / (period * share)
        return -correlation(residual, use, np.sin(angle), np.cos(angle), position)

    found = optimize.minimize_scalar(missed, bounds=NEAR, method="bounded", options={"xatol": 1e-4})
    return period * float(found.x)


def amplitude(residual: Array, position: Array, period: float, use: BoolArray) -> float:
    """Amplitude of a sine of this period, beside a constant and a line."""
    angle = 2.0 * math.pi * position / period
    sine, cosine, *_ = slopes(residual, use, np.sin(angle), np.cos(angle), position)
    return math.hypot(sine, cosine)


def _sizes(
    exhibit: Exhibit, residual: Array, use: BoolArray, period: float
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Mean speed and amplitude of the slower and of the faster half; None where the speed is one."""
    speed = np.abs(exhibit.motion.velocity)
    moving = use & (speed > 1e-3 * float(np.max(speed)))
    if np.count_nonzero(moving) < 2 * FEWEST:
        return None
    middle = float(np.median(speed[moving]))
    found = []
    for inside in (moving & (speed <= middle), moving & (speed > middle)):
        x = exhibit.motion.position[inside]
        if x.size < FEWEST or np.ptp(x) < period:
            return None
        size = amplitude(residual, exhibit.motion.position, period, inside)
        found.append((float(np.mean(speed[inside])), size))
    return (found[0], found[1]) if found[1][0] > SAME_FEED * found[0][0] else None
