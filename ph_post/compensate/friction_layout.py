"""Lay the changes of the friction that is led into a planned motion: those of its windows, and all others."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.compensate.friction import (
    HELD,
    STILL,
    Friction,
    direct_change,
    held_change,
    shortest_step,
)
from ph_post.compensate.motion import MotionLaw, row_times
from ph_post.geometry.track import Track
from ph_post.types import Array, Axis, Crossing, FrictionChange, Jog, Machine

UNDER_WAY: Final = 3.0
"""Shortest steps that one lasts by which friction is led while the path begins already: it takes less than a thirtieth
of the jerk, and the path may have the rest."""


APART: Final = 4
"""Rows between that step and the beginning of the path: no third difference reaches from one into the other."""


class Turn(NamedTuple):
    """A reversal in time: directions before and after it (0 before the first motion), and when the axis rests [s]."""

    before: int
    after: int
    begin: float
    end: float


def find_turns(t: Array, place: Array, moving: bool) -> list[Turn]:
    """Find the reversals of an axis in its motion.

    Ways back that are shorter than :data:`STILL` are none. An axis counts as at rest as long as it is within that of
    where it turns.

    Parameters
    ----------
    t : Array, shape (n,)
        [s].
    place : Array, shape (n,)
        Of the axis [m].
    moving : bool
        Whether the motion goes on from one before it: the first direction is no turn then.

    Returns
    -------
    list of Turn

    Examples
    --------
    >>> t = np.arange(6.0)
    >>> find_turns(t, np.array([0.0, 0.0, 1.0, 1.0, 0.5, 0.0]), moving=False)
    [Turn(before=0, after=1, begin=0.0, end=1.0), Turn(before=1, after=-1, begin=2.0, end=3.0)]
    """
    steps = np.sign(np.diff(place))
    goes = np.flatnonzero(steps)
    if goes.size == 0:
        return []
    bends = goes[1:][steps[goes[1:]] != steps[goes[:-1]]]
    turns: list[Turn] = []
    direction, extreme, last = 0, 0, 0
    for row in [*bends.tolist(), place.size - 1]:
        way = float(place[row] - place[extreme])
        if direction * way >= 0.0 and direction:
            extreme = row
        elif abs(way) > STILL:
            after = 1 if way > 0.0 else -1
            near = np.abs(place[last : row + 1] - place[extreme]) <= STILL
            at = extreme - last
            left = at - int(np.argmin(near[at::-1])) + 1 if not near[: at + 1].all() else 0
            right = at + int(np.argmin(near[at:])) - 1
            if direction or not moving:
                turns.append(Turn(direction, after, float(t[last + left]), float(t[last + right])))
            direction, last, extreme = after, extreme, row
    return turns


def lay_friction(
    track: Track,
    machine: Machine,
    motion: MotionLaw,
    friction: Mapping[str, Friction],
    asked: Sequence[FrictionChange],
    moving: bool,
    crossings: Sequence[Crossing | Jog] = (),
) -> tuple[FrictionChange, ...]:
    """Turn the friction of every axis round at each of its reversals in time.

    What is asked for at a reversal is done; at the others the direction is changed while the axis rests, with the
    motor carried through its backlash where there is time for that, and else as quickly as may be. Where the axis
    crosses its backlash while it rests, the direction is changed before that.

    Parameters
    ----------
    track : Track
    machine : Machine
    motion : MotionLaw
        In which every hold is.
    friction : mapping of str to Friction
    asked : sequence of FrictionChange
        In the time of the motion.
    moving : bool
        Whether it goes on from a motion before it.
    crossings : sequence of Crossing or Jog, optional
        In the time of the motion.

    Returns
    -------
    tuple of FrictionChange
        In the order of time.
    """
    names = [name for name, one in friction.items() if one.turns]
    if not names:
        return ()
    period = machine.servo_period
    t = row_times(motion, period)
    s = motion.place_and_feed(t)[0]
    rest = float(t[max(int(np.argmax(s > 0.0)) - 1 - APART, 0)])
    place = track.derivatives(*track.locate(s), 0)[0]
    found: list[FrictionChange] = []
    for name in names:
        axis, own = machine.axes[name], [one for one in asked if one.axis == name]
        for turn in find_turns(t, place[:, track.path.axes.index(name)], moving):
            done = next((one for one in own if _serves(one, turn)), None)
            if done is not None:
                own.remove(done)
            begins = (one.start for one in crossings if one.axis == name and turn.begin <= one.start <= turn.end)
            found.append(done or _usual(axis, friction[name], turn, period, rest, next(begins, None)))
    return tuple(sorted(found, key=lambda one: (one.start, one.axis)))


def first_step(machine: Machine, friction: Mapping[str, Friction]) -> float:
    """Time [s] that it takes to lead friction before the first motion: that of the slowest axis, in whole periods."""
    period = machine.servo_period
    times = (shortest_step(machine.axes[name], one.size, period) for name, one in friction.items() if one.turns)
    longest = max(times, default=0.0)
    return (math.ceil(longest / period) + APART) * period if longest else 0.0


def _serves(change: FrictionChange, turn: Turn) -> bool:
    """Return whether a change is that of a reversal: it overlaps its rest, and more besides."""
    more = change.duration
    same = (change.before, change.after) == (turn.before, turn.after)
    return same and change.start - more <= turn.end and change.end + more >= turn.begin


def _usual(
    axis: Axis, friction: Friction, turn: Turn, period: float, rest: float, crosses: float | None
) -> FrictionChange:
    """Return the change of a reversal for which nothing was asked, where a crossing may begin while the axis rests."""
    middle = 0.5 * (turn.begin + turn.end)
    if crosses is not None and turn.before:
        change = direct_change(axis, friction, turn.before, turn.after, crosses, period)
        early = crosses - change.duration
        return msgspec.structs.replace(change, start=early) if early >= turn.begin else change
    change = held_change(axis, friction, turn.before, turn.after, HELD, period)
    if change.duration > turn.end - turn.begin:
        change = direct_change(axis, friction, turn.before, turn.after, middle, period)
    start = middle - 0.5 * change.duration
    if not turn.before:
        # Before the first motion all of it is led when that begins; where there is no rest before it, soon after.
        if turn.end < change.duration:
            change = msgspec.structs.replace(change, release=UNDER_WAY * change.release)
        start = max(rest - change.duration, 0.0) if turn.begin < rest else max(turn.end - change.duration, 0.0)
    return msgspec.structs.replace(change, start=start)
