"""Feeds of ramps and dips as cubics of the way, for controllers whose blocks can carry one.

A plan has the speed as a polynomial of time, and the way from its integral. A controller that takes the feed
over the way of a block gets a cubic of the share p of it that is done, whose ends are the planned speeds: the
blocks then meet in speed as they meet in place. No cubic of the way can start from rest, as the speed would
never leave it: a block beside a rest keeps the feed of its other end, and its ramp is the controller's.
A block ends where the kind of the path's pieces changes, and is never shorter than the controller can play.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence, Set
from itertools import groupby, pairwise
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.motion import MotionLaw
from ph_post.gcode.blocks import DWELL, JOG, LINE, Blocks, Feed, TrackShape, between
from ph_post.gcode.numbers import significant_text
from ph_post.geometry.piecewise import MEETS
from ph_post.post.timeline import MotionStretch, Span, time_at
from ph_post.types import Array, BoolArray
from ph_post.units import MM, MM_PER_MIN

FOLLOWS: Final = 1e-3
"""Largest relative difference of a written feed from the planned one."""

AIM: Final = 0.8 * FOLLOWS
"""The same that cutting into blocks aims at; joining short blocks and rounding take the rest."""

AT_REST: Final = 1e-3
"""A speed that is no more than this part of the fastest one of the piece is none: a cubic of the way that
grows so much within a servo period is off by half of it and more."""

_MEETS: Final = 0.1 * FOLLOWS
"""A feed in force that differs from a piece's first one by no more than this part can begin it."""

_NODES: Final = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 65))
"""Shares of a piece's time at which it is looked at; the middle is one of them."""


def fit_feed(
    motion: MotionLaw, t0: float, t1: float, start: float | None = None, end: float | None = None
) -> Feed | None:
    """Fit a feed to the speed between two instants; None where the motion rests, or the feed would.

    Parameters
    ----------
    motion : MotionLaw
    t0, t1 : float
        The piece [s]; the motion does not turn back in it.
    start, end : float, optional
        The feeds with which the piece has to begin and to end [m/s]; absent: the planned ones.
    """
    s, speed = motion.place_and_feed(t0 + (t1 - t0) * _NODES)
    speed = np.abs(speed)
    most = float(speed.max())
    if float(speed.min()) <= AT_REST * most or s[-1] == s[0]:
        return None
    p = (s - s[0]) / (s[-1] - s[0])
    first = float(speed[0]) if start is None else start
    last = float(speed[-1]) if end is None else end
    line = first + (last - first) * p
    basis = np.stack([p * p - p, p**3 - p], axis=1) / speed[:, None]
    free = np.linalg.lstsq(basis, (speed - line) / speed, rcond=None)[0]
    off = (line - speed) / speed + basis @ free
    if float(off.min()) <= -1.0:
        return None
    error = float(np.abs(off).max())
    return Feed(start=first, end=last, quad=float(free[0]), cub=float(free[1]), error=error)


def constant_feed(motion: MotionLaw, t0: float, t1: float) -> float:
    """Return the feed [m/s] of a block that rests at one end: of its other end, or its length over its time."""
    s, speed = motion.place_and_feed(np.array([t0, t1]))
    ends = np.abs(speed)
    mean = abs(float(s[1] - s[0])) / (t1 - t0)
    return float(ends.max()) if float(ends.max()) > mean else mean


class FeedSchedule(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Feeds of n blocks.

    `feed` (n,) [m/s] of those that have one; by number of the block, `profiles` of those in which it changes,
    and `off` how far what is written is off the plan, as a part of the planned speed, where that changes;
    nothing for blocks beside a rest.
    """

    feed: Array
    profiles: dict[int, Feed]
    off: dict[int, float]


def schedule_feeds(blocks: Blocks, motion: MotionLaw, feed: Array, digits: int) -> FeedSchedule:
    """Find the feeds of blocks; each that changes begins with the feed in force.

    A block beside a rest has one feed, and so has one behind a feed that is not the planned one.

    Parameters
    ----------
    blocks : Blocks
    motion : MotionLaw
    feed : Array, shape (n,)
        Of blocks with one feed [m/s].
    digits : int
        Significant digits of a written feed in mm/min.

    Returns
    -------
    FeedSchedule
    """
    found = FeedSchedule(feed=feed.copy(), profiles={}, off={})
    changes = _changes(blocks, motion)
    now = 0.0
    for i in np.flatnonzero((blocks.rapid == 0) & (blocks.kind != DWELL)).tolist():
        if changes[i]:
            t0, t1 = float(blocks.start[i]), float(blocks.end[i])
            planned = fit_feed(motion, t0, t1)
            if planned is not None and abs(now - planned.start) <= _MEETS * planned.start:
                last = written(planned.end, digits)
                profile = fit_feed(motion, t0, t1, now, last) or planned
                found.profiles[i], found.off[i] = profile, profile.error
                now = last
                continue
            found.feed[i] = constant_feed(motion, t0, t1)
            if planned is not None:
                speed = np.abs(motion.place_and_feed(t0 + (t1 - t0) * _NODES)[1])
                found.off[i] = float(np.abs(float(found.feed[i]) / speed - 1.0).max())
        now = written(float(found.feed[i]), digits)
    return found


def _changes(blocks: Blocks, motion: MotionLaw) -> BoolArray:
    """Find the blocks in which the planned feed changes, also steady ones that took a short block of a ramp."""
    middle = 0.5 * (blocks.start + blocks.end)
    times = np.concatenate([blocks.start, middle, blocks.end])
    speed = motion.place_and_feed(times)[1].reshape(3, -1)
    differs = np.ptp(speed, axis=0) > _MEETS * np.abs(speed[1])
    moves = ~np.isin(blocks.kind, (DWELL, JOG))
    return np.asarray(moves & ((blocks.timed == 1) | differs))


def written(speed: float, digits: int) -> float:
    """Return the speed [m/s] that the controller reads from its digits in mm/min."""
    return float(significant_text(speed / MM_PER_MIN, digits)) * MM_PER_MIN


_BESIDE_REST: Final = 8.0
"""A block beside a rest that lasts less than so many servo periods is not halved where no cubics would follow
the feed in its outer half: one that grows as the square of the time is followed in a half and two quarters of
it, one that grows as its third power in eighths."""

_SHORT: Final = 1e-4 * MM
"""A block beside a rest that is no longer than this is not halved: 0.1 µm."""

_LOW: Final = 0.1
"""A phase whose speed falls to this part of its largest one, and grows again, is cut where it is least: no
cubic over a servo period follows both sides of a dip that nearly stops."""

_CUT_NODES: Final = 65
_ZOOMS: Final = 6
"""Instants at which a phase is looked at for its least speed, and how often again between the neighbours."""

_ROUNDING: Final = 1e-6
"""Blocks that are shorter than a servo period by this part of it last one."""


class FeedCut(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch, and the instants [s] at which blocks end in it, its ends included; none by geometry."""

    stretch: MotionStretch
    times: tuple[float, ...] = ()


def cut_stretches(
    stretches: Sequence[MotionStretch], shape: TrackShape, motion: MotionLaw, period: float
) -> list[FeedCut]:
    """Cut the ramps and dips among stretches so that cubics follow their feed.

    Parameters
    ----------
    stretches : sequence of MotionStretch
    shape : TrackShape
    motion : MotionLaw
    period : float
        Servo period [s].

    Returns
    -------
    list of FeedCut
        Ramps that follow one another without a rest or a stop are one; steady motion between them is part of
        it where it is too short, or where the end of a ramp has been moved into it.
    """
    found: list[FeedCut] = []
    for group in _groups(stretches, shape, motion):
        if all(one.by_geometry for one in group):
            found += [FeedCut(stretch=one) for one in group]
        elif group[0].span.kind == "dwell":
            found += [FeedCut(stretch=one, times=(one.start, one.end)) for one in group]
        else:
            found += _cut_group(group, shape, motion, period)
    return found


def feed_blocks(cuts: Sequence[FeedCut]) -> Blocks:
    """Return the blocks of ramps, dips and dwells; their places are zero, as they follow from the times."""
    rows = [
        (number, DWELL if one.stretch.span.kind == "dwell" else LINE, t0, t1)
        for number, one in enumerate(cuts)
        for t0, t1 in pairwise(one.times)
    ]
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    zeros = np.zeros(len(rows))
    return Blocks(
        kind=table[:, 1].astype(np.int64),
        start=table[:, 2],
        end=table[:, 3],
        s0=zeros,
        s1=zeros,
        rapid=zeros.astype(np.int64),
        stretch=table[:, 0].astype(np.int64),
        timed=np.ones(len(rows), dtype=np.int64),
    )


def _groups(stretches: Sequence[MotionStretch], shape: TrackShape, motion: MotionLaw) -> Iterator[list[MotionStretch]]:
    """Stretches that follow one another without a rest or a stop between them."""
    group: list[MotionStretch] = []
    for one in stretches:
        if group and not _joined(group[-1], one, shape, motion):
            yield group
            group = []
        group.append(one)
    if group:
        yield group


def _joined(before: MotionStretch, after: MotionStretch, shape: TrackShape, motion: MotionLaw) -> bool:
    if before.rapid or after.rapid or "dwell" in (before.span.kind, after.span.kind):
        return False
    place = float(shape.wrap(np.array([after.s0]))[0])
    near = np.searchsorted(shape.stops, [place - MEETS, place + MEETS])
    speed = abs(float(motion.place_and_feed(np.array([after.start]))[1][0]))
    moves = speed > AT_REST * max(abs(before.span.speed), abs(after.span.speed))
    return bool(near[0] == near[1]) and moves and (before.s1 > before.s0) == (after.s1 > after.s0)


def _cut_group(
    group: Sequence[MotionStretch], shape: TrackShape, motion: MotionLaw, period: float
) -> Iterator[FeedCut]:
    """Cut stretches that follow one another; what is left of a steady one stays as the geometry has it."""
    start, end = group[0].start, group[-1].end
    joints = [t for one in group for t in _joints(one, shape, motion)] + _lows(motion, start, end)
    knots = [one.start for one in group[1:]]
    knots += motion.start[(motion.start > start) & (motion.start < end)].tolist()
    ends = thinned(motion, [start, *joints, end], knots, period)
    pieces = [(_steady(group, t0, t1, period), t0, t1) for t0, t1 in pairwise(ends)]
    for steady, run in groupby(pieces, key=lambda piece: piece[0]):
        spans = list(run)
        marks = [spans[0][1], *(t1 for _, _, t1 in spans)]
        if steady >= 0:
            yield FeedCut(stretch=_part(group[steady], marks[0], marks[-1]))
        else:
            times = cut_feed(motion, marks, period)
            yield FeedCut(stretch=_ramp(motion, times[0], times[-1]), times=tuple(times))


def _joints(one: MotionStretch, shape: TrackShape, motion: MotionLaw) -> list[float]:
    """Instants in a stretch at which the kind of the path's pieces changes, its beginning included."""
    places = between(shape, shape.kind_changes, one.s0, one.s1).tolist()
    times = (time_at(motion, one.span, place) for place in places)
    begins = between(shape, shape.kind_changes, one.s0 - 2.0 * MEETS, one.s0 + 2.0 * MEETS).size
    return [*([one.start] if begins else []), *(t for t in times if one.start < t < one.end)]


def _lows(motion: MotionLaw, start: float, end: float) -> list[float]:
    """Return the instants inside at which the motion nearly stands: a rest, where it does, ends blocks."""
    found = []
    for t0, duration in zip(motion.start.tolist(), motion.duration.tolist(), strict=True):
        if t0 < end and t0 + duration > start:
            low, speeds = _lowest(motion, t0, t0 + duration)
            if t0 < low < t0 + duration and speeds[0] <= _LOW * speeds[1]:
                found.append(low)
    return [t for t in found if start < t < end]


def _lowest(motion: MotionLaw, low: float, high: float) -> tuple[float, tuple[float, float]]:
    """Return when a phase is slowest, to a billionth of it, and its least and largest speed."""
    most = 0.0
    for _ in range(_ZOOMS):
        t = np.linspace(low, high, _CUT_NODES)
        speed = np.abs(motion.place_and_feed(t)[1])
        k, most = int(speed.argmin()), max(most, float(speed.max()))
        low, high = float(t[max(k - 1, 0)]), float(t[min(k + 1, _CUT_NODES - 1)])
    return float(t[k]), (float(speed[k]), most)


def _steady(group: Sequence[MotionStretch], t0: float, t1: float, period: float) -> int:
    """Return the number of the steady stretch that holds a piece of time, -1 where none does."""
    slack = _ROUNDING * period
    holds = (one.by_geometry and one.start - slack <= t0 and t1 <= one.end + slack for one in group)
    return next((number for number, found in enumerate(holds) if found), -1)


def _part(one: MotionStretch, start: float, end: float) -> MotionStretch:
    """Part of a steady stretch."""
    s0 = one.s0 + (start - one.start) * one.span.speed
    s1 = one.s1 - (one.end - end) * one.span.speed
    return msgspec.structs.replace(one, start=start, end=end, s0=s0, s1=s1)


def _ramp(motion: MotionLaw, start: float, end: float) -> MotionStretch:
    s0, s1 = motion.place_and_feed(np.array([start, end]))[0].tolist()
    span = Span(kind="ramp", start=start, end=end, s0=s0, s1=s1, window=-1, rests=False)
    return MotionStretch(span=span, start=start, end=end, s0=s0, s1=s1, rapid=False)


def thinned(motion: MotionLaw, fixed: Sequence[float], free: Sequence[float], least: float) -> list[float]:
    """Put instants in order, and keep the free ones at least `least` [s] away from their neighbours.

    A free instant that is too close to a fixed one is moved to twice that distance where there is room and no
    rest, and dropped otherwise; of two free ones the one is dropped without which a cubic follows the feed
    better.
    """
    loose = set(free) - set(fixed)
    marks = sorted(loose | set(fixed))
    while (i := _closest(marks, loose, least)) >= 0:
        out, moved = _spare(motion, marks, loose, i, least)
        loose.discard(marks.pop(out))
        loose.update(moved)
        marks = sorted([*marks, *moved])
    return marks


def _closest(marks: Sequence[float], loose: Set[float], least: float) -> int:
    """Return the first of the two closest marks, of which one is free, -1 where none are too close."""
    gaps = [
        (t1 - t0, number)
        for number, (t0, t1) in enumerate(pairwise(marks))
        if t1 - t0 < least * (1.0 - _ROUNDING) and (t0 in loose or t1 in loose)
    ]
    return min(gaps, default=(0.0, -1))[1]


def _spare(
    motion: MotionLaw, marks: Sequence[float], loose: Set[float], i: int, least: float
) -> tuple[int, list[float]]:
    """Choose which of the marks `i` and `i` + 1 to take out, and where to put it instead."""
    if marks[i] in loose and marks[i + 1] in loose:
        without = [_error(motion, marks[k - 1], marks[k + 1]) for k in (i, i + 1)]
        return (i if without[0] <= without[1] else i + 1), []
    out, side = (i, -1) if marks[i] in loose else (i + 1, 1)
    beside, beyond = marks[out - side], marks[out + side]
    place = beside + 2.0 * side * least
    apart = abs(marks[out] - beside) > _ROUNDING * least
    moves = apart and (beyond - place) * side >= least and _error(motion, *sorted((beside, place))) < math.inf
    return out, [place] if moves else []


def _error(motion: MotionLaw, t0: float, t1: float) -> float:
    fit = fit_feed(motion, t0, t1)
    return math.inf if fit is None else fit.error


def cut_feed(motion: MotionLaw, marks: Sequence[float], least: float) -> list[float]:
    """Halve a stretch until cubics follow its speed, and what is beside a rest as long as they do.

    Parameters
    ----------
    motion : MotionLaw
    marks : sequence of float
        Instants at which a block ends in any case, the stretch's ends the first and the last [s].
    least : float
        Shortest block [s], a servo period: what is shorter than two of them is not halved any more.

    Returns
    -------
    list of float
        The marks and what was put between them, in order.
    """
    found = [marks[0]]
    for t0, t1 in pairwise(marks):
        found += _halved(motion, t0, t1, least)
    return found


def _halved(motion: MotionLaw, t0: float, t1: float, least: float) -> list[float]:
    """Return the ends of the blocks between two instants, without the first one."""
    middle = 0.5 * (t0 + t1)
    fit = fit_feed(motion, t0, t1)
    if t1 - t0 < 2.0 * least or (fit is not None and fit.error <= AIM):
        return [t1]
    if fit is None and abs(float(np.diff(motion.place_and_feed(np.array([t0, t1]))[0])[0])) <= _SHORT:
        return [t1]
    halves = [*_halved(motion, t0, middle, least), *_halved(motion, middle, t1, least)]
    if fit is None and t1 - t0 < _BESIDE_REST * least and not _followed(motion, [t0, *halves]):
        return [t1]
    return halves


def _followed(motion: MotionLaw, times: Sequence[float]) -> bool:
    """Return whether cubics follow the feed between these instants, but for what is beside a rest."""
    fits = (fit_feed(motion, t0, t1) for t0, t1 in pairwise(times))
    return all(fit is None or fit.error <= AIM for fit in fits)
