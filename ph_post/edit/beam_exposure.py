"""How much longer a beam at constant power burns a corner in which an axis crosses its backlash.

While the motor crosses the backlash g the table stands, and a beam at constant power (M3) burns on. The corner gets
the beam anyway for as long as the path takes from g before it to g behind it: 2 g/v at a feed v that needs no braking,
and 2 √(2 g/a) where the controller comes to rest with the acceleration a. To that a crossing adds what the controller
makes of it: it brakes to the joint before the block that crosses, and goes on through the joint behind it. A move of
the axis alone between two rests takes 2 √(g/a), or less at its own speed: the part v/√(a g) of what the corner gets at
a low feed. Where a block leads into the cut's own direction the path has come on meanwhile, and what it adds to a rest
is √(2 g/a) (√2 - 1) behind the corner, a fifth.
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.edit.crossing_shapes import AT_SPEED
from ph_post.simulate.controllers.chords import limits_along
from ph_post.simulate.controllers.exact_path import block_times
from ph_post.simulate.controllers.junctions import junction_speed
from ph_post.simulate.controllers.moves import limit_table
from ph_post.types import Array, BoolArray, Machine

ADDED: Final = 0.5
"""A crossing adds no more than this part of what a corner gets in which the path stops: any sharp corner gets that."""

LONGER: Final = 2.0
"""No corner is burnt more than so many times as long."""

JOINTS: Final = 1.12
"""So many times as long as its speed says a window is counted: the joints of its blocks are passed more slowly."""

RAISED: Final = 0.9
"""Part of the way of a block beyond the path's for which its feed is raised at least."""


class CornerCrossings(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Straight blocks in which motors cross their backlash in the corners of a path, n of them.

    `into` and `out` (n, 3) are unit vectors along the path before and behind the corner, `feed` (n, 2) its speeds there
    [m/s], `room` (n,) how far it goes on before it may stop again [m], and `rests` (n,) where it stops in every joint.
    A block leads `along` (n,) the path [m], 0 for a move of axes alone, and crosses `way` (n, 3) [m]; it has a `speed`
    (n,) of its own [m/s], and `lost` (n,) is the largest lost motion that it crosses [m].
    """

    into: Array
    out: Array
    feed: Array
    room: Array
    rests: BoolArray
    along: Array
    way: Array
    speed: Array
    lost: Array


def burns_little(machine: Machine, crossings: CornerCrossings) -> BoolArray:
    """Return whether a beam may stay on in crossings (n,).

    What counts is how much longer it burns the path within one backlash of the corner: :data:`ADDED`, :data:`LONGER`.
    """
    into, out, lost = crossings.into, crossings.out, crossings.lost
    limits, (before, behind) = limit_table(machine), crossings.feed.T
    block = crossings.along[:, None] * out + crossings.way
    length = np.linalg.norm(block, axis=1)
    unit = block / np.maximum(length, 1e-12)[:, None]
    (_, brake), (fast, push), (_, gain) = (limits_along(one, limits) for one in (into, unit, out))
    speed = np.minimum(crossings.speed, fast)
    passed, first, last = (
        np.where(crossings.rests, 0.0, junction_speed(machine, one, other, size, length, feed=np.minimum(slow, quick)))
        for one, other, size, slow, quick in (
            (into, out, lost, before, behind),
            (into, unit, lost, before, speed),
            (unit, out, lost, speed, behind),
        )
    )
    # The block may have to end slowly enough for what comes next, and no faster than it comes on.
    last = np.minimum(last, np.sqrt(2.0 * gain * np.maximum(crossings.room - crossings.along, 0.0)))
    first = np.minimum(first, np.sqrt(last**2 + 2.0 * push * length))
    last = np.minimum(last, np.sqrt(first**2 + 2.0 * push * length))
    stays = _share_near(crossings) * length
    beyond = np.maximum(lost - crossings.along, 0.0)
    plain, stopped = (
        _ramp(lost, one, before, brake) + _ramp(lost, one, behind, gain) for one in (passed, 0.0 * passed)
    )
    inside = np.where(stays < length, _ramp(stays, first, speed, push), _between(length, first, last, speed, push))
    burnt = _ramp(lost, first, before, brake) + inside + _ramp(beyond, last, behind, gain)
    return np.asarray(burnt <= np.minimum(plain + ADDED * stopped, LONGER * plain))


class CornerWindows(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Windows around corners in which the axis that turns waits while the others go on, n of them.

    `length` (n,) [m] and `speed` (n,) of the path in them [m/s]; `slope` (n,) of the waiting axis beside the corner;
    `passed` and `feed` (n,) speeds of the original in the corner and beside it [m/s], `push` (n,) its acceleration
    [m/s²], and `lost` (n,) the lost motion that is crossed [m].
    """

    length: Array
    speed: Array
    slope: Array
    passed: Array
    feed: Array
    push: Array
    lost: Array


def windows_burn_little(windows: CornerWindows) -> BoolArray:
    """Return whether a beam may stay on in windows (n,) around corners that the path passes slowly anyway.

    By the same measures as of :func:`burns_little`; false where the original is at its feed.
    """
    lost, feed = windows.lost, windows.feed
    plain, stopped = (2.0 * _ramp(lost, one, feed, windows.push) for one in (windows.passed, 0.0 * windows.passed))
    others = np.sqrt(np.maximum(1.0 - windows.slope**2, 0.0))
    inside = np.minimum(windows.length, 2.0 * lost / np.maximum(others, 1e-6))
    beyond = np.maximum(2.0 * lost - windows.length * others, 0.0)
    burnt = JOINTS * (inside + beyond) / np.maximum(windows.speed, 1e-9)
    slow = windows.passed < AT_SPEED * feed
    return np.asarray(slow & (burnt <= np.minimum(plain + ADDED * stopped, LONGER * plain)))


def _share_near(crossings: CornerCrossings) -> Array:
    """Part of each block (n,) for which its table is within one backlash of the corner."""
    # The axis that crosses stands for a while, and the others go on along the path.
    path = crossings.along[:, None] * crossings.out
    rests = np.abs(crossings.way)
    passes = np.where(rests > 0.0, 0.0, np.abs(path)) ** 2
    others = np.sqrt(passes.sum(axis=1))
    own, waits = (np.where(rests > 0.0, one, 0.0).max(axis=1) for one in (np.abs(path), rests))
    lost = crossings.lost
    with np.errstate(divide="ignore"):
        alone = lost / others
    turns = own + waits
    both = 2.0 * turns * waits / (others**2 + turns**2)
    return np.asarray(np.minimum(np.where(alone * turns <= waits, alone, both), 1.0))


def _ramp(way: Array, slow: Array, fast: Array, push: Array) -> Array:
    """Time [s] of a way between a speed and up to a higher one that is kept then."""
    reached = np.minimum(np.maximum(fast, slow), np.sqrt(slow**2 + 2.0 * push * way))
    ramp = (reached**2 - slow**2) / (2.0 * push)
    return np.asarray((reached - slow) / push + (way - ramp) / np.maximum(reached, 1e-9))


def _between(way: Array, first: Array, last: Array, most: Array, push: Array) -> Array:
    """Time [s] of a way that begins and ends at two speeds, as fast as may be in between."""
    reached = np.minimum(most**2, 0.5 * (first**2 + last**2) + push * way)
    square = np.stack([first**2, np.maximum(reached, np.maximum(first, last) ** 2), last**2], axis=1)
    return np.asarray(block_times(square, way, push).sum(axis=1))
