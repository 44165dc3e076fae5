"""Lay jogs into a planned motion: at the stops of profiles, at stops of the path, and before the start.

A part program can shift an axis only while the path stands still. So an axis carries a lasting offset only
where the motion stops at each of its reversals.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.jogs import DWELL, SEAT_FEED, make_jog, seat_distance, whole_jog
from ph_post.compensate.layout import (
    STILL,
    Job,
    Layout,
    at_an_end,
    delay_at,
    delay_before,
    first_direction,
    is_open,
    middle_of,
    rest_at,
    with_holds,
)
from ph_post.compensate.motion import Motion
from ph_post.compensate.strategies.base import Proposal, Task, Wish
from ph_post.compensate.surroundings import SAME_PLACE, came_from
from ph_post.types import Jog, Phase

NEARLY: Final = 0.99
"""Part of the least dwell that is looked for: what is left of it where a profile was fitted to the limits."""

NO_OFFSET: Final = "the motion does not stop at every reversal of its axis, as a lasting offset needs it"


def lay_out_jogs(job: Job) -> Layout:
    """Place every jog in time, and insert holds where the motion rests for one.

    An axis with a lasting offset begins on the flank of its first motion, onto which the program's approach
    brings it: the motion begins with that. Z comes down onto it, whatever its first motion is.
    """
    motion = Motion.from_phases(job.phases)
    shifted = sorted({one.axis for one in _wished(job.wishes) if is_open(job, one.axis)}.union(job.shifted))
    jogs, served = _at_windows(job, motion)
    holds: dict[int, float] = {}
    at_stops: list[tuple[int, Jog]] = []
    dropped: set[str] = set()
    for point in job.turning_points:
        if point.axis not in shifted or point.index in served or at_an_end(job, point):
            continue
        stop = rest_at(job.phases, point.s)
        if stop is None:
            dropped.add(point.axis)
        else:
            _add_stop(holds, at_stops, stop, whole_jog(job.machine.axes[point.axis], -came_from(point), 0.0))
    if dropped:
        return Layout(phases=job.phases, crossings=(), bias={}, dropped=tuple(sorted(dropped)))
    bias, seats = _beginning(job, shifted, holds, at_stops)
    placed = [_later(jog, delay_at(job.phases, holds, jog.start)) for jog in jogs]
    placed += [_later(jog, job.phases[k].start + delay_before(holds, k)) for k, jog in at_stops]
    phases = with_holds(job.phases, holds)
    if seats:
        seat = Phase(start=0.0, duration=max(jog.end for jog in seats) + DWELL, s=phases[0].s, speed=STILL)
        placed = seats + [_later(jog, seat.duration) for jog in placed]
        later = (msgspec.structs.replace(one, start=one.start + seat.duration) for one in phases)
        phases = (seat, *later)
    return Layout(
        phases=phases, crossings=tuple(sorted(placed, key=lambda one: (one.start, one.axis))), bias=bias
    )


def without_axes(proposal: Proposal, axes: Sequence[str], why: str = NO_OFFSET) -> Proposal:
    """Take the jogs of some axes out of a proposal, and the stops that were made for nothing else."""

    def without(wish: Wish) -> Wish:
        kept = tuple(one for one in wish.crossings if one.axis not in axes)
        if kept or not wish.crossings:
            return msgspec.structs.replace(wish, crossings=kept)
        return Wish(shape=None, note=wish.note or why)

    shifted = tuple(axis for axis in proposal.shifted if axis not in axes)
    return msgspec.structs.replace(proposal, wishes=tuple(map(without, proposal.wishes)), shifted=shifted)


def lacks_stops(task: Task, proposal: Proposal) -> bool:
    """Whether a jog of a proposal has no stop: neither one of its own nor one of the path."""
    pairs = zip(task.windows, proposal.wishes, strict=True)
    return any(
        wish.shape is None and wish.crossings and not wish.stop and task.feed.at(window.s) > 0.0
        for window, wish in pairs
    )


def _wished(wishes: Sequence[Wish]) -> list[Jog]:
    return [one for wish in wishes for one in wish.crossings if isinstance(one, Jog)]


def _at_windows(job: Job, motion: Motion) -> tuple[list[Jog], set[int]]:
    """Jogs of the windows that stand still for them, and the turning points that they serve."""
    found: list[Jog] = []
    served: set[int] = set()
    for number, wish in enumerate(job.wishes):
        middle = None if job.profiles[number] is None else middle_of(motion, number)
        if middle is None:
            continue
        own = [msgspec.structs.replace(_later(one, middle), window=number) for one in _wished([wish])]
        if all(_stands_still(motion, jog) for jog in own):
            found += own
            names = {jog.axis for jog in own}
            served |= {k for k in job.windows[number].members if job.turning_points[k].axis in names}
    return found, served


def _stands_still(motion: Motion, jog: Jog) -> bool:
    """Whether the path rests during a jog and the least dwells around it."""
    around = np.array([jog.start - NEARLY * DWELL, jog.end + NEARLY * DWELL])
    s, feed = motion.place_and_feed(around)
    return bool(np.all(feed == 0.0) and abs(s[1] - s[0]) <= SAME_PLACE)


def _add_stop(holds: dict[int, float], at_stops: list[tuple[int, Jog]], stop: int, jog: Jog) -> None:
    """Add a jog to what is done at a stop, behind what is there, with a dwell on either side."""
    start = holds.get(stop, DWELL)
    at_stops.append((stop, _later(jog, start)))
    holds[stop] = start + jog.duration + DWELL


def _beginning(
    job: Job, shifted: Sequence[str], holds: dict[int, float], at_stops: list[tuple[int, Jog]]
) -> tuple[dict[str, float], list[Jog]]:
    """Offsets of the first row, and the approach, from there onto the offset of the first motion."""
    bias: dict[str, float] = {}
    seats: list[Jog] = []
    feed = min(SEAT_FEED, job.track.path.feed)
    for name in shifted:
        axis, direction = job.machine.axes[name], first_direction(job, name)
        half = 0.5 * axis.gap.lost_motion
        bias[name] = direction * half
        if direction == 0 or job.moving:
            continue
        way = -1 if name == "Z" else direction
        if way != direction:
            bias[name] = way * half
            _add_stop(holds, at_stops, 0, whole_jog(axis, direction, 0.0))
        distance = seat_distance(axis.gap)
        bias[name] -= way * distance
        seats.append(make_jog(axis, way * distance, 0.0, feed))
    return bias, seats


def _later(jog: Jog, delay: float) -> Jog:
    return msgspec.structs.replace(jog, start=jog.start + delay)
