"""The feed of a ramp or a dip as cubics of the way, for controllers whose blocks can carry one.

A plan has the speed as a polynomial of time, and the way from its integral. A controller that takes the feed
over the way of a block gets a cubic of the share p of it that is done, whose ends are the planned speeds: the
blocks then meet in speed as they meet in place. No cubic of the way can start from rest, as the speed would
then never leave it: a block beside a rest keeps the feed of its other end, and its ramp is the controller's.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.motion import Motion
from ph_post.gcode.format import significant_text
from ph_post.gcode.record import DWELL, JOG, Blocks
from ph_post.gcode.shape import LINE, Shape, between
from ph_post.gcode.stretches import Stretch
from ph_post.gcode.timeline import time_at
from ph_post.types import Array
from ph_post.units import MM, MM_PER_MIN

FOLLOWS: Final = 1e-3
"""How far a written feed may be off the planned one, as a part of it."""

_AIM: Final = 0.8 * FOLLOWS
"""What cutting aims at: joining short blocks and rounding take their share."""

_AT_REST: Final = 1e-6
"""A speed that is no more than this part of the fastest one of the piece is none."""

_MEETS: Final = 0.1 * FOLLOWS
"""A feed in force that differs from a piece's first one by no more than this part can begin it."""

_BESIDE_REST: Final = 4.0
"""A block beside a rest is halved down to so many servo periods: then the next one, which is as long, can be
halved once more, as a cubic does not follow a feed that grows fourfold while the time doubles."""

_SHORT: Final = 1e-4 * MM
"""A block beside a rest that is no longer than this is not halved: 0.1 µm."""

_NODES: Final = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 65))
"""Shares of a piece's time at which it is looked at; the middle is one of them."""


class Feed(msgspec.Struct, frozen=True, kw_only=True):
    """Feed over the share p of a block's way: start + (end - start - quad - cub) p + quad p² + cub p³ [m/s].

    `error` is the largest difference from the plan, as a part of the planned speed; 0 where there is none.
    """

    start: float
    end: float
    quad: float
    cub: float
    error: float = 0.0

    def at(self, p: Array) -> Array:
        """Feed [m/s] at shares of the way.

        Examples
        --------
        >>> Feed(start=2.0, end=4.0, quad=6.0, cub=-4.0).at(np.array([0.0, 0.5, 1.0])).tolist()
        [2.0, 3.0, 4.0]
        """
        linear = self.end - self.start - self.quad - self.cub
        return self.start + p * (linear + p * (self.quad + p * self.cub))


def speed_over_way(motion: Motion, t0: float, t1: float) -> tuple[Array, Array] | None:
    """Shares of the way and the speeds there [m/s] between two instants [s], without a turn between them.

    None where the motion rests at an end.
    """
    s, speed = motion.place_and_feed(t0 + (t1 - t0) * _NODES)
    speed = np.abs(speed)
    most = float(speed.max())
    if float(speed.min()) <= _AT_REST * most or s[-1] == s[0]:
        return None
    return (s - s[0]) / (s[-1] - s[0]), speed


def fit_feed(p: Array, speed: Array, first: float, last: float) -> Feed:
    """Fit a feed from `first` to `last` to planned speeds [m/s] at shares of the way."""
    line = first + (last - first) * p
    basis = np.stack([p * p - p, p**3 - p], axis=1) / speed[:, None]
    free = np.linalg.lstsq(basis, (speed - line) / speed, rcond=None)[0]
    error = float(np.abs((line - speed) / speed + basis @ free).max())
    return Feed(start=first, end=last, quad=float(free[0]), cub=float(free[1]), error=error)


def feed_blocks(stretches: Sequence[Stretch], shape: Shape, motion: Motion, period: float) -> Blocks:
    """Blocks of ramps and dips, as long as a cubic follows the speed, and of dwells.

    They end where the motion's phases do, and where the kind of the path's pieces changes. Their places are
    left at zero: they follow from the times.
    """
    rows = []
    for number, one in enumerate(stretches):
        if one.by_geometry:
            continue
        times = [one.start, one.end]
        if one.span.kind != "dwell":
            times = cut_feed(motion, _marks(one, shape, motion), period)
        kind = DWELL if one.span.kind == "dwell" else LINE
        rows += [(number, kind, t0, t1) for t0, t1 in pairwise(times)]
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


def _marks(one: Stretch, shape: Shape, motion: Motion) -> list[float]:
    """Instants at which a block of a stretch has to end, its ends included."""
    places = between(shape, shape.marks, one.s0, one.s1).tolist()
    inside = [time_at(motion, one.span, place) for place in places]
    inside += motion.start[(motion.start > one.start) & (motion.start < one.end)].tolist()
    return [one.start, *sorted({t for t in inside if one.start < t < one.end}), one.end]


def cut_feed(motion: Motion, marks: Sequence[float], least: float) -> list[float]:
    """Halve a stretch until cubics follow its speed, and what is beside a rest until it is short.

    Parameters
    ----------
    motion : Motion
    marks : sequence of float
        Instants at which a block ends in any case, the stretch's ends the first and the last [s].
    least : float
        Shortest block [s], a servo period: what is shorter than two of them is not halved any more, and what
        is beside a rest not below four.

    Returns
    -------
    list of float
        The marks and what was put between them, in order.
    """
    found = [marks[0]]
    open_ends = list(reversed(marks[1:]))
    while open_ends:
        t0, t1 = found[-1], open_ends[-1]
        if _is_done(motion, t0, t1, least):
            found.append(open_ends.pop())
        else:
            open_ends.append(0.5 * (t0 + t1))
    return found


def _is_done(motion: Motion, t0: float, t1: float, least: float) -> bool:
    planned = speed_over_way(motion, t0, t1)
    if planned is None:
        s0, s1 = motion.place_and_feed(np.array([t0, t1]))[0].tolist()
        return t1 - t0 < _BESIDE_REST * least or bool(abs(s1 - s0) <= _SHORT)
    if t1 - t0 < 2.0 * least:
        return True
    p, speed = planned
    return fit_feed(p, speed, float(speed[0]), float(speed[-1])).error <= _AIM


def constant_feed(motion: Motion, t0: float, t1: float) -> float:
    """Feed of a block that rests at an end [m/s]: that of its other end, or what its length and time make."""
    s, speed = motion.place_and_feed(np.array([t0, t1]))
    ends = np.abs(speed)
    mean = abs(float(s[1] - s[0])) / (t1 - t0)
    return float(ends.max()) if float(ends.max()) > mean else mean


def feed_profiles(blocks: Blocks, motion: Motion, feed: Array, digits: int) -> tuple[Array, dict[int, Feed]]:
    """Return the feeds of blocks, and those that change within one by its number.

    Those begin with the feed in force. A block whose feed cannot follow the plan, beside a rest or behind
    another feed, has one.

    Parameters
    ----------
    blocks : Blocks
    motion : Motion
    feed : Array, shape (n,)
        Of blocks with one feed [m/s].
    digits : int
        Significant digits of a written feed in mm/min.
    """
    feed, profiles = feed.copy(), {}
    changes = (blocks.timed == 1) & ~np.isin(blocks.kind, (DWELL, JOG))
    now = 0.0
    for i in np.flatnonzero((blocks.rapid == 0) & (blocks.kind != DWELL)).tolist():
        if changes[i]:
            t0, t1 = float(blocks.start[i]), float(blocks.end[i])
            planned = speed_over_way(motion, t0, t1)
            if planned is not None and abs(now - planned[1][0]) <= _MEETS * planned[1][0]:
                last = written(float(planned[1][-1]), digits)
                profiles[i] = fit_feed(*planned, now, last)
                now = last
                continue
            feed[i] = constant_feed(motion, t0, t1)
        now = written(float(feed[i]), digits)
    return feed, profiles


def written(speed: float, digits: int) -> float:
    """Return the speed [m/s] that the controller reads from its digits in mm/min."""
    return float(significant_text(speed / MM_PER_MIN, digits)) * MM_PER_MIN
