"""Where a planned motion breaks a limit on its samples, and how much slower it would have to be there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ph_post.compensate.caps import AxisLimits
from ph_post.compensate.columns import largest
from ph_post.compensate.limits import at_rest_before_and_after, rounding, runs, usage
from ph_post.compensate.motion import Motion, row_times
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray

_ROWS = 1 << 19
"""Rows looked at together: a long program needs no more memory than a short one."""

_REACH = 3
"""Rows that the third difference reaches beyond its first."""


class Broken(NamedTuple):
    """Stretches of samples on which a limit is broken, arrays (k,).

    [s0, s1] [m] and [t0, t1] [s] are where they lie, `factor` is the part of its speed the motion may keep.
    """

    s0: Array
    s1: Array
    t0: Array
    t1: Array
    factor: Array

    def where(self, which: BoolArray) -> Broken:
        """Return some of the stretches."""
        return Broken(*(part[which] for part in self))


def find_broken(track: Track, limits: AxisLimits, motion: Motion) -> Broken:
    """Sample a motion at the period of the limits and find where it breaks one of them."""
    t = row_times(motion, limits.period)
    parts = [
        _look(track, limits, motion, t[first : first + _ROWS + _REACH])
        for first in range(0, max(t.size - _REACH, 1), _ROWS)
    ]
    return Broken(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _look(track: Track, limits: AxisLimits, motion: Motion, t: Array) -> Broken:
    s, feed = motion.place_and_feed(t)
    position = track.derivatives(*track.locate(s), 0)[0]
    noise = rounding(float(np.abs(position).max()), track.length, motion.end, float(np.abs(feed).max()))
    before = bool(motion.begins_at_rest and t[0] == 0.0)
    after = bool(motion.ends_at_rest and t[-1] >= motion.end)
    factor = _slower_by(at_rest_before_and_after(position, before, after), limits, noise)
    stretch = runs(np.flatnonzero(factor < 1.0))
    shift = _REACH if before else 0
    edges = np.array([(run[0], run[-1] + _REACH) for run in stretch], dtype=np.int64).reshape(-1, 2)
    i, j = np.clip(edges - shift, 0, t.size - 1).T
    worst = np.array([factor[run].min() for run in stretch])
    return Broken(np.minimum(s[i], s[j]), np.maximum(s[i], s[j]), t[i], t[j], worst)


def _slower_by(position: Array, limits: AxisLimits, noise: float) -> Array:
    """Part of its speed (rows,) that the motion may keep where a difference begins, 1 where all is well."""
    factor = np.ones(len(position))
    for order in range(1, min(3, len(position) - 1) + 1):
        ratio = largest(usage(position, limits, order, noise))
        part = factor[: ratio.size]
        np.minimum(part, np.maximum(ratio, 1.0) ** (-1.0 / order), out=part)
    return factor
