"""Pass turning points slower, where the error is largest and time is left.

Behind a reversal the table waits for its motor, which crosses the backlash while the path goes away: less far, the
slower it does. That takes little time, as the feed need be low for no longer than the servo takes to answer; and
where a path has no room for a profile the feed can be lowered all the same.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from ph_post.geometry.numeric import bisect
from ph_post.types import Array, BoolArray

SPEED_LAW: Final = 4.0 / 3.0
"""Power of the error with which the speed goes that leads to it: on led axes with backlash inside the loop the error
was seen to go with the 0.75th power of the speed, between a tenth and all of it."""

SLOWEST: Final = 0.1
"""Part of the feed below which a turning point is not passed."""


class Passages(NamedTuple):
    """Turning points of a plan that may be passed slower: `error` [m] and whether each is `free`.

    `slowest` is the least part of their feed, `time` [s] what it may take in all, and `least` [m] an error below which
    less is no better.
    """

    error: Array
    free: BoolArray
    slowest: Array
    time: float
    least: float

    def ratios(self, unit: float) -> Array:
        """Return the parts of their feed to pass them with, where a half takes the time `unit` [s]."""
        return np.maximum(passing_ratios(self.error, self.free, max(self.time, 0.0), unit, self.least), self.slowest)

    def promised(self, unit: float) -> float:
        """Return the largest error that is expected with these [m]."""
        return float(np.max(np.maximum(self.error, self.least) * self.ratios(unit) ** (1.0 / SPEED_LAW)))


def passing_ratios(error: Array, free: BoolArray, time: float, unit: float, least: float) -> Array:
    """Return the part of its feed with which to pass every turning point, so that the largest errors are alike.

    Parameters
    ----------
    error : Array
        Largest around each turning point [m].
    free : BoolArray
        Which may be passed slower; to have less error than the others brings nothing.
    time : float
        What it may take in all [s].
    unit : float
        What a half of the feed takes at one turning point [s].
    least : float
        Error [m] below which less is no better.

    Examples
    --------
    >>> free = np.array([True, True, False])
    >>> passing_ratios(np.array([4.0, 1.0, 2.0]), free, 10.0, 1.0, 0.0).round(3).tolist()
    [0.397, 1.0, 1.0]
    """
    floor = max(least, float(error[~free].max(initial=0.0)), float(error[free].max(initial=0.0)) * SLOWEST)

    def ratios(largest: float) -> Array:
        slower = np.clip((largest / np.maximum(error, floor)) ** SPEED_LAW, SLOWEST, 1.0)
        return np.where(free, slower, 1.0)

    top = max(float(error.max()), floor)
    return ratios(bisect(lambda largest: spent(ratios(largest), unit) > time, floor, top)[1])


def spent(ratios: Array, unit: float) -> float:
    """Return what it takes to pass turning points with parts of their feeds, see :func:`passing_ratios` [s]."""
    return unit * float(np.sum(1.0 / ratios - 1.0))
