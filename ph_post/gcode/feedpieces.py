"""The feed of a ramp or a dip as cubics of the way, for controllers whose blocks can carry one.

A plan has the speed as a polynomial of time, and the way from its integral. A controller that takes the feed
over the way of a block gets a cubic of the share p of it that is done, whose ends are the planned speeds: the
blocks then meet in speed as they meet in place. No cubic of the way can start from rest, as the speed would
then never leave it: a block beside a rest keeps the feed of its other end, and its ramp is the controller's.
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.motion import Motion
from ph_post.gcode.format import significant_text
from ph_post.gcode.record import DWELL, JOG, Blocks, Feed
from ph_post.types import Array, BoolArray
from ph_post.units import MM_PER_MIN

FOLLOWS: Final = 1e-3
"""How far a written feed may be off the planned one, as a part of it."""

AIM: Final = 0.8 * FOLLOWS
"""What cutting aims at: joining short blocks and rounding take their share."""

AT_REST: Final = 1e-3
"""A speed that is no more than this part of the fastest one of the piece is none: a cubic of the way that
grows so much within a servo period is off by half of it and more."""

_MEETS: Final = 0.1 * FOLLOWS
"""A feed in force that differs from a piece's first one by no more than this part can begin it."""

_NODES: Final = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 65))
"""Shares of a piece's time at which it is looked at; the middle is one of them."""


def fit_feed(
    motion: Motion, t0: float, t1: float, start: float | None = None, end: float | None = None
) -> Feed | None:
    """Fit a feed to the speed between two instants; None where the motion rests, or the feed would.

    Parameters
    ----------
    motion : Motion
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


def constant_feed(motion: Motion, t0: float, t1: float) -> float:
    """Feed of a block that rests at an end [m/s]: that of its other end, or what its length and time make."""
    s, speed = motion.place_and_feed(np.array([t0, t1]))
    ends = np.abs(speed)
    mean = abs(float(s[1] - s[0])) / (t1 - t0)
    return float(ends.max()) if float(ends.max()) > mean else mean


class Course(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Feeds of n blocks.

    `feed` (n,) [m/s] of those that have one; by number of the block, `profiles` of those in which it changes,
    and `off` how far what is written is off the plan, as a part of the planned speed, where that changes;
    nothing for blocks beside a rest.
    """

    feed: Array
    profiles: dict[int, Feed]
    off: dict[int, float]


def feed_course(blocks: Blocks, motion: Motion, feed: Array, digits: int) -> Course:
    """Find the feeds of blocks; each that changes begins with the feed in force.

    A block beside a rest has one feed, and so has one behind a feed that is not the planned one.

    Parameters
    ----------
    blocks : Blocks
    motion : Motion
    feed : Array, shape (n,)
        Of blocks with one feed [m/s].
    digits : int
        Significant digits of a written feed in mm/min.
    """
    found = Course(feed=feed.copy(), profiles={}, off={})
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
                found.off[i] = _off(motion, t0, t1, float(found.feed[i]))
        now = written(float(found.feed[i]), digits)
    return found


def _changes(blocks: Blocks, motion: Motion) -> BoolArray:
    """Tell in which blocks the planned feed changes, steady ones that took a sliver of a ramp included."""
    middle = 0.5 * (blocks.start + blocks.end)
    times = np.concatenate([blocks.start, middle, blocks.end])
    speed = motion.place_and_feed(times)[1].reshape(3, -1)
    differs = np.ptp(speed, axis=0) > _MEETS * np.abs(speed[1])
    moves = ~np.isin(blocks.kind, (DWELL, JOG))
    return np.asarray(moves & ((blocks.timed == 1) | differs))


def _off(motion: Motion, t0: float, t1: float, feed: float) -> float:
    speed = np.abs(motion.place_and_feed(t0 + (t1 - t0) * _NODES)[1])
    return float(np.abs(feed / speed - 1.0).max())


def written(speed: float, digits: int) -> float:
    """Return the speed [m/s] that the controller reads from its digits in mm/min."""
    return float(significant_text(speed / MM_PER_MIN, digits)) * MM_PER_MIN
