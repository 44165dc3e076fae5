"""The plan as a function of time: when the motion holds its speed, changes it, rests or turns back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Literal

import msgspec
import numpy as np

from ph_post.compensate.motion import Motion
from ph_post.geometry.bernstein import evaluate
from ph_post.types import Array, Phase

SpanKind = Literal["steady", "ramp", "dwell"]

SAME_SPEED = 1e-9
"""Speeds that differ by no more than this part of the larger one are one: rounding of the plan's sums."""

_SCAN = np.linspace(0.0, 1.0, 257)
"""Where a profile is looked at for changes of sign. What dips below zero between two of these alone lasts
less than 1/256 of the phase, and does not matter."""


class Span(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch of time on which the speed has one character, and one sign.

    `start`, `end` [s]; `s0`, `s1` [m]. `window` is the index of the window it modulates, -1 elsewhere;
    `rests` says that the speed is zero at its end.
    """

    kind: SpanKind
    start: float
    end: float
    s0: float
    s1: float
    window: int
    rests: bool

    @property
    def speed(self) -> float:
        """Mean speed [m/s], negative backwards."""
        return (self.s1 - self.s0) / (self.end - self.start)


def find_spans(phases: Sequence[Phase]) -> list[Span]:
    """Cut phases where the speed changes sign, and join neighbours of one character.

    Ramps outside windows are joined up to the next rest, so that blocks of equal time can be cut from all of
    them together, however many phases a planner made of them.

    Examples
    --------
    >>> from ph_post.types import frozen
    >>> up = Phase(start=0.0, duration=2.0, s=0.0, speed=frozen([0.0, 1.0]))
    >>> on = Phase(start=2.0, duration=3.0, s=1.0, speed=frozen([1.0]))
    >>> [(span.kind, span.end, span.s1) for span in find_spans([up, on])]
    [('ramp', 2.0, 1.0), ('steady', 5.0, 4.0)]
    """
    motion = Motion.from_phases(phases)
    found: list[Span] = []
    for phase in phases:
        for span in _of_one_sign(phase, motion):
            if found and _joins(found[-1], span):
                found[-1] = msgspec.structs.replace(found[-1], end=span.end, s1=span.s1, rests=span.rests)
            else:
                found.append(span)
    return found


def _of_one_sign(phase: Phase, motion: Motion) -> Iterator[Span]:
    kind = span_kind(phase.speed)
    ends = [phase.start, phase.start + phase.duration]
    s = [phase.s, phase.s + phase.duration * float(phase.speed.mean())]
    if flips := sign_changes(phase.speed):
        turns = phase.start + phase.duration * np.array(flips)
        ends[1:1] = turns.tolist()
        s[1:1] = motion.place_and_feed(turns)[0].tolist()
    still = abs(float(phase.speed[-1])) <= SAME_SPEED * float(np.abs(phase.speed).max())
    for (t0, t1), (s0, s1) in zip(pairwise(ends), pairwise(s), strict=True):
        if t1 > t0:
            rests = kind == "ramp" and (t1 < ends[-1] or still)
            yield Span(kind=kind, start=t0, end=t1, s0=s0, s1=s1, window=phase.window, rests=rests)


def _joins(before: Span, after: Span) -> bool:
    if before.kind != after.kind:
        return False
    if before.kind == "ramp":
        outside = before.window < 0 and after.window < 0
        return outside and not before.rests and (before.speed > 0.0) == (after.speed > 0.0)
    return abs(before.speed - after.speed) <= SAME_SPEED * abs(before.speed)


def time_at(motion: Motion, span: Span, s: float) -> float:
    """When a span passes a place inside it [s]: bisection to the last bit, as s(t) is monotone there."""
    if span.kind == "steady":
        return span.start + (s - span.s0) / span.speed
    low, high = span.start, span.end
    while low < (middle := 0.5 * (low + high)) < high:
        if (motion.place_and_feed(np.array([middle]))[0][0] < s) == (span.s1 > span.s0):
            low = middle
        else:
            high = middle
    return high


def span_kind(speed: Array) -> SpanKind:
    """Tell whether a speed in Bernstein form is constant, zero, or neither.

    Examples
    --------
    >>> import numpy as np
    >>> span_kind(np.array([2.0, 2.0])), span_kind(np.array([0.0])), span_kind(np.array([0.0, 1.0]))
    ('steady', 'dwell', 'ramp')
    """
    size = float(np.abs(speed).max())
    if size == 0.0:
        return "dwell"
    return "steady" if float(np.ptp(speed)) <= SAME_SPEED * size else "ramp"


def sign_changes(speed: Array) -> list[float]:
    """Find where on (0, 1) a speed in Bernstein form changes sign.

    Examples
    --------
    >>> import numpy as np
    >>> [round(u, 12) for u in sign_changes(np.array([3.0, -1.0]))], sign_changes(np.array([1.0, 0.0, 1.0]))
    ([0.75], [])
    """
    noise = SAME_SPEED * float(np.abs(speed).max())
    if (speed >= -noise).all() or (speed <= noise).all():
        return []  # the curve lies within the hull of its coefficients
    value = evaluate(speed, _SCAN)
    solid = np.flatnonzero(np.abs(value) > noise)
    flips = np.flatnonzero(np.diff(np.sign(value[solid])) != 0)
    return [_bisect(speed, float(_SCAN[solid[i]]), float(_SCAN[solid[i + 1]])) for i in flips]


def _bisect(speed: Array, low: float, high: float) -> float:
    rises = float(evaluate(speed, low)) < 0.0
    while low < (middle := 0.5 * (low + high)) < high:
        if (float(evaluate(speed, middle)) < 0.0) == rises:
            low = middle
        else:
            high = middle
    return high
