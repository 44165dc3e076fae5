"""The plan as a function of time: spans of steady speed, ramps and dwells, cut at stops of the path."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Literal

import msgspec
import numpy as np

from ph_post.compensate.motion import MotionLaw
from ph_post.gcode.blocks import TrackShape, between
from ph_post.geometry.bernstein import evaluate
from ph_post.types import Array, IntArray, Phase

SpanKind = Literal["steady", "ramp", "dwell"]

SAME_SPEED = 1e-9
"""Speeds that differ by no more than this part of the larger one are one: rounding of the plan's sums."""

_SCAN = np.linspace(0.0, 1.0, 257)
"""Places at which a profile is sampled for changes of sign. A dip below zero between two of them lasts less
than 1/256 of the phase, and does not matter."""


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
    motion = MotionLaw.from_phases(phases)
    found: list[Span] = []
    for phase in phases:
        for span in _of_one_sign(phase, motion):
            if found and _joins(found[-1], span):
                found[-1] = msgspec.structs.replace(found[-1], end=span.end, s1=span.s1, rests=span.rests)
            else:
                found.append(span)
    return found


def _of_one_sign(phase: Phase, motion: MotionLaw) -> Iterator[Span]:
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


def time_at(motion: MotionLaw, span: Span, s: float) -> float:
    """Return the instant [s] at which a span passes the place `s` [m] inside it, where s(t) is monotone."""
    if span.kind == "steady":
        return span.start + (s - span.s0) / span.speed
    rises = span.s1 > span.s0
    return _bisect(lambda t: (motion.place_at(t) < s) == rises, span.start, span.end)


def span_kind(speed: Array) -> SpanKind:
    """Return the kind of a speed in Bernstein form: constant, zero, or neither.

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
    """Return the places on (0, 1) at which a speed in Bernstein form changes sign.

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
    return [_sign_change(speed, float(_SCAN[solid[i]]), float(_SCAN[solid[i + 1]])) for i in flips]


def _sign_change(speed: Array, low: float, high: float) -> float:
    rises = float(evaluate(speed, low)) < 0.0
    return _bisect(lambda u: (float(evaluate(speed, u)) < 0.0) == rises, low, high)


def _bisect(is_before: Callable[[float], bool], low: float, high: float) -> float:
    """Bisect to the last bit: return the first number for which `is_before` no longer holds."""
    while low < (middle := 0.5 * (low + high)) < high:
        if is_before(middle):
            low = middle
        else:
            high = middle
    return high


class MotionStretch(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a span between two stops, or of the path that is run through at rapid speed."""

    span: Span
    start: float
    end: float
    s0: float
    s1: float
    rapid: bool

    @property
    def by_geometry(self) -> bool:
        """True where only the geometry bounds the length of blocks."""
        return self.rapid or self.span.kind == "steady"


class BlockRuns(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Parts of stretches on which blocks are of one kind, arrays of shape (n,).

    `stretch` number; `s0`, `s1` places along the motion [m]; `kind` as in :mod:`ph_post.gcode.blocks`; `piece`
    one of its pieces; `base` [m] where the present round of a closed path began.
    """

    stretch: IntArray
    s0: Array
    s1: Array
    kind: IntArray
    piece: IntArray
    base: Array


def find_stretches(phases: Sequence[Phase], shape: TrackShape) -> list[MotionStretch]:
    """Cut the spans at the stops inside them, and join those that neighbour in rapid segments."""
    found: list[MotionStretch] = []
    motion = MotionLaw.from_phases(phases)
    for span in find_spans(phases):
        for stretch in _between_stops(motion, shape, span):
            if found and stretch.rapid and found[-1].rapid:
                found[-1] = msgspec.structs.replace(found[-1], end=stretch.end, s1=stretch.s1)
            else:
                found.append(stretch)
    return found


def _between_stops(motion: MotionLaw, shape: TrackShape, span: Span) -> list[MotionStretch]:
    inner = between(shape, shape.stops, span.s0, span.s1).tolist()
    s = [span.s0, *inner, span.s1]
    t = [span.start, *(time_at(motion, span, place) for place in inner), span.end]
    rapid = shape.rapid[shape.piece_at(np.array([0.5 * (a + b) for a, b in pairwise(s)]))].tolist()
    moves = span.kind != "dwell"  # a rest before a rapid is not part of it: an axis may be shifted there
    return [
        MotionStretch(span=span, start=t0, end=t1, s0=s0, s1=s1, rapid=bool(quick) and moves)
        for (t0, t1), (s0, s1), quick in zip(pairwise(t), pairwise(s), rapid, strict=True)
    ]


def find_runs(stretches: list[MotionStretch], shape: TrackShape) -> BlockRuns:
    """Cut the stretches whose blocks follow from the geometry where the kind of their pieces changes."""
    rows: list[tuple[int, float, float]] = []
    for number, stretch in enumerate(stretches):
        if stretch.by_geometry:
            marks = between(shape, shape.kind_changes, stretch.s0, stretch.s1).tolist()
            rows += [(number, a, b) for a, b in pairwise([stretch.s0, *marks, stretch.s1])]
    s0, s1 = np.array([row[1:] for row in rows], dtype=np.float64).reshape(-1, 2).T
    middle, length = 0.5 * (s0 + s1), shape.track.length
    piece = shape.piece_at(middle)
    return BlockRuns(
        stretch=np.array([row[0] for row in rows], dtype=np.int64),
        s0=s0,
        s1=s1,
        kind=shape.kind[piece],
        piece=piece,
        base=length * np.floor(middle / length) if shape.track.closed else np.zeros(s0.size),
    )
