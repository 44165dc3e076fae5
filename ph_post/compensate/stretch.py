"""How much of the limits profiles use, looked at more finely than the samples do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ph_post.compensate.caps import AxisLimits
from ph_post.compensate.columns import largest
from ph_post.compensate.motion import Motion
from ph_post.compensate.sites import Stretch
from ph_post.geometry.track import Track
from ph_post.types import Array, IntArray, Phase

_PHASES = 4
"""Sampling phases looked at: which one the samples will have is not known before the whole plan is."""

_LEAST_SAMPLES = 12
"""Periods on a stretch; where the servo period is too long for that many, shorter differences stand in."""


def stretch_usage(track: Track, limits: AxisLimits, parts: Sequence[Stretch]) -> Array:
    """Largest ratio of what the axes do to what they may, on each stretch, shape (stretches,)."""
    if not parts:
        return np.zeros(0)
    motion, first_phase = _one_after_the_other(parts)
    start, duration = motion.start[first_phase], np.add.reduceat(motion.duration, first_phase)
    step = np.minimum(limits.period, duration / _LEAST_SAMPLES) / _PHASES
    counts = np.floor(duration / step * (1.0 - 1e-6)).astype(np.int64) + 1
    number = np.repeat(np.arange(len(parts)), counts)
    within = np.arange(number.size) - np.repeat(np.cumsum(counts) - counts, counts)
    s, _ = motion.place_and_feed(start[number] + within * step[number])
    position = track.derivatives(*track.locate(s), 0)[0]
    worst = np.zeros(len(parts))
    difference = position
    for order in (1, 2, 3):
        difference = difference[_PHASES:] - difference[:-_PHASES]
        first, last = number[: len(difference)], number[order * _PHASES :]
        period = _PHASES * step[first]
        ratio = largest(np.abs(difference) / limits.of_order(order)) / period**order
        whole = first == last
        np.maximum.at(worst, first[whole], ratio[whole])
    return worst


def _one_after_the_other(parts: Sequence[Stretch]) -> tuple[Motion, IntArray]:
    """Make one motion of the stretches, which jumps from each to the next; also where each of them begins."""
    phases: list[Phase] = []
    first = np.zeros(len(parts), dtype=np.int64)
    for number, part in enumerate(parts):
        first[number] = len(phases)
        phases += part.phases(part.cruise)
    return Motion.from_phases(phases), first
