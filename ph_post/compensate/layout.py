"""Lay crossings of the gap and jogs into a planned motion: in profiles, at stops, and before the start.

An axis whose loop is not closed over the table carries half its gap as a lasting offset, towards the side it
moves to. So every reversal of it has to be crossed, or the offset would be the wrong one from there on; and
before the first motion it must be on the right side, whichever side the axis stood on. A part program can
shift an axis only while the path stands still, so an axis carries a lasting offset there only where the
motion stops at each of its reversals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.families import shortest_crossing, whole_crossing
from ph_post.compensate.motion import MotionLaw
from ph_post.compensate.offsets import APPROACH_FEED, DWELL, approach_distance, make_jog, whole_jog
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult
from ph_post.compensate.trial import SAME_PLACE, came_from
from ph_post.drive.axes import axis_at
from ph_post.geometry.numeric import bisect
from ph_post.geometry.track import Track
from ph_post.types import Axis, Crossing, FeedProfile, Jog, Machine, Phase, TurningPoint, Window, frozen

STILL = frozen([0.0])


class Layout(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Phases with holds where crossings need them, crossings in the order of time, and the bias by axis.

    `dropped` are the axes whose lasting offset cannot be carried; then nothing is laid out.
    """

    phases: tuple[Phase, ...]
    crossings: tuple[Crossing | Jog, ...]
    bias: Mapping[str, float]
    dropped: tuple[str, ...] = ()


class Job(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The input of a layout: a motion with its profiles, and the requests."""

    track: Track
    machine: Machine
    turning_points: tuple[TurningPoint, ...]
    windows: tuple[Window, ...]
    requests: tuple[ProfileRequest, ...]
    profiles: tuple[FeedProfile | None, ...]
    phases: tuple[Phase, ...]
    moving: bool
    lead: bool
    shifted: tuple[str, ...] = ()

    @property
    def length(self) -> float:
        """Arc length of the path [m]."""
        return self.track.length


def lay_out(job: Job) -> Layout:
    """Place every crossing in time, and insert holds where the motion rests for one."""
    motion = MotionLaw.from_phases(job.phases)
    requested = {one.axis for request in job.requests for one in request.crossings if is_open(job, one.axis)}
    shifted = sorted(requested.union(job.shifted))
    crossings, crossed = _at_windows(job, motion)
    holds: dict[int, float] = {}
    at_stops: list[tuple[int, Crossing]] = []
    for point in job.turning_points:
        if point.axis not in shifted or point.index in crossed or at_an_end(job, point):
            continue
        axis = job.machine.axes[point.axis]
        duration = shortest_crossing(axis, job.lead, job.machine.servo_period)
        stop = rest_at(job.phases, point.s)
        if stop is None:
            middle = _time_at(motion, point.s)
            crossings.append(whole_crossing(axis, -came_from(point), middle, duration))
        else:
            holds[stop] = max(holds.get(stop, 0.0), duration)
            at_stops.append((stop, whole_crossing(axis, -came_from(point), 0.5 * duration, duration)))
    bias, approach = _beginning(job, shifted)
    if approach:
        holds[0] = max(one.end for one in approach)
    delayed = [_delayed(one, delay_at(job.phases, holds, one.start)) for one in crossings]
    delayed += [_delayed(one, job.phases[k].start + delay_before(holds, k)) for k, one in at_stops]
    delayed += approach
    return Layout(
        phases=with_holds(job.phases, holds),
        crossings=tuple(sorted(delayed, key=lambda one: (one.start, one.axis))),
        bias=bias,
    )


def is_open(job: Job, name: str) -> bool:
    """Return whether the loop of an axis is not closed over the table."""
    return not job.machine.axes[name].loop.encloses_backlash


def _at_windows(job: Job, motion: MotionLaw) -> tuple[list[Crossing], set[int]]:
    """Crossings of the windows, and the turning points that they serve."""
    found: list[Crossing] = []
    served: set[int] = set()
    for number, request in enumerate(job.requests):
        crossings = [one for one in request.crossings if isinstance(one, Crossing)]
        if not crossings or request.stop:
            continue
        window, middle = job.windows[number], middle_of(motion, number)
        chosen = crossings
        if at_an_end(job, job.turning_points[window.turning_point]):
            # What is behind the loop is brought to its flank before the motion begins.
            chosen = [one for one in chosen if middle is not None and not is_open(job, one.axis)]
        elif job.profiles[number] is None or middle is None:
            # Without its profile a crossing inside the loop would do harm; a lasting offset is still needed.
            chosen = [one for one in chosen if is_open(job, one.axis)]
            middle = _time_at(motion, window.s)
        if not chosen or middle is None:
            continue
        early = max(0.0, -min(middle + one.start for one in chosen))
        found += [msgspec.structs.replace(one, start=early + middle + one.start, window=number) for one in chosen]
        names = {one.axis for one in chosen}
        served |= {k for k in window.members if job.turning_points[k].axis in names}
    return found, served


def middle_of(motion: MotionLaw, window: int) -> float | None:
    """Middle of a window's profile in time [s], None where it has none.

    A profile on the seam of the path ends the motion with its first part and begins it with the second.
    """
    rows = np.flatnonzero(motion.window == window)
    if rows.size == 0:
        return None
    begins, whole = float(motion.start[rows[0]]), float(motion.duration[rows].sum())
    jumps = np.flatnonzero(np.diff(rows) != 1)
    if jumps.size:
        begins = -float(motion.duration[rows[jumps[0] + 1 :]].sum())
    return begins + 0.5 * whole


def at_an_end(job: Job, point: TurningPoint) -> bool:
    """Return whether the path begins or ends at a turning point."""
    return point.s <= SAME_PLACE or point.s >= job.length - SAME_PLACE


def rest_at(phases: Sequence[Phase], s: float) -> int | None:
    """Index of the phase that starts from rest at `s`, None where the motion runs through."""
    for number, phase in enumerate(phases):
        if number and abs(phase.s - s) <= SAME_PLACE and phase.speed[0] == 0.0:
            return number
    return None


def _time_at(motion: MotionLaw, s: float) -> float:
    """First instant at which the motion is at `s` [s]."""
    return bisect(lambda t: bool(motion.place_and_feed(np.array([t]))[0][0] < s), 0.0, motion.end)[1]


def _beginning(job: Job, shifted: Sequence[str]) -> tuple[dict[str, float], list[Crossing]]:
    """Offsets of the first row, and what brings the axes to the flank that their first motion needs."""
    bias: dict[str, float] = {}
    approach: list[Crossing] = []
    for name in shifted:
        axis, direction = job.machine.axes[name], first_direction(job, name)
        half = 0.5 * axis.gap.lost_motion
        bias[name] = direction * half
        flank = {"+": 1, "-": -1}.get(axis.gap.initial_flank, 0)
        if direction == 0 or job.moving or flank == direction:
            continue
        duration = shortest_crossing(axis, job.lead, job.machine.servo_period)
        if flank:
            bias[name] = flank * half
            approach.append(whole_crossing(axis, direction, 0.5 * duration, duration))
            continue
        # From either flank: back until the other is surely touched, then forth.
        bias[name] = 0.0
        back = half * (1.0 + axis.uncertainty.backlash)
        first = whole_crossing(axis, -direction, 0.5 * duration, duration)
        first = msgspec.structs.replace(first, travel=-direction * back)
        second = msgspec.structs.replace(first, start=duration, travel=direction * (back + half))
        second = msgspec.structs.replace(second, duration=duration * (1.0 + axis.uncertainty.backlash))
        approach += [first, second]
    return bias, approach


def first_direction(job: Job, name: str) -> int:
    """Direction of the first motion of an axis; 0 where it does not move at all."""
    for point in job.turning_points:
        if point.axis == name:
            return -came_from(point) if point.s <= SAME_PLACE else came_from(point)
    number = job.track.path.axes.index(name)
    s = np.linspace(0.0, job.length, 129)
    place = job.track.derivatives(*job.track.locate(s))[0][:, number]
    return int(np.sign(place[np.argmax(np.abs(place - place[0]))] - place[0]))


def with_holds(phases: Sequence[Phase], holds: Mapping[int, float]) -> tuple[Phase, ...]:
    """Insert a rest before some phases, and let the others follow."""
    found: list[Phase] = []
    delay = 0.0
    for number, phase in enumerate(phases):
        if number in holds:
            start = phase.start + delay
            found.append(Phase(start=start, duration=holds[number], s=phase.s, speed=STILL))
            delay += holds[number]
        found.append(msgspec.structs.replace(phase, start=phase.start + delay) if delay else phase)
    return tuple(found)


def delay_at(phases: Sequence[Phase], holds: Mapping[int, float], t: float) -> float:
    """By how much holds delay what happens at `t` [s]."""
    return sum(duration for number, duration in holds.items() if phases[number].start <= t)


def delay_before(holds: Mapping[int, float], number: int) -> float:
    """By how much holds before earlier phases delay that of a phase [s]."""
    return sum(duration for other, duration in holds.items() if other < number)


def _delayed(crossing: Crossing, delay: float) -> Crossing:
    return msgspec.structs.replace(crossing, start=crossing.start + delay)


def reversing_axes(machine: Machine, points: Sequence[TurningPoint]) -> tuple[tuple[Axis, int], ...]:
    """Axes with a gap among those that turn back, each as it is there and with the direction it goes on in.

    The machine is one to size by, see :func:`ph_post.drive.axes.sized_machine`.
    """
    drives = ((axis_at(machine.axes[point.axis], point.position), -came_from(point)) for point in points)
    return tuple((axis, direction) for axis, direction in drives if axis.gap.lost_motion > 0.0)


NEARLY: Final = 0.99
"""Part of the least dwell that is looked for: what is left of it where a profile was fitted to the limits."""

NO_OFFSET: Final = "the motion does not stop at every reversal of its axis, as a lasting offset needs it"


def lay_out_jogs(job: Job) -> Layout:
    """Place every jog in time, and insert holds where the motion rests for one.

    An axis with a lasting offset begins on the flank of its first motion, onto which the program's approach
    brings it: the motion begins with that. Z comes down onto it, whatever its first motion is.
    """
    motion = MotionLaw.from_phases(job.phases)
    shifted = sorted({one.axis for one in _requested_jogs(job.requests) if is_open(job, one.axis)}.union(job.shifted))
    jogs, served = _jogs_at_windows(job, motion)
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
    bias, seats = _jogs_at_start(job, shifted, holds, at_stops)
    placed = [_later(jog, delay_at(job.phases, holds, jog.start)) for jog in jogs]
    placed += [_later(jog, job.phases[k].start + delay_before(holds, k)) for k, jog in at_stops]
    phases = with_holds(job.phases, holds)
    if seats:
        seat = Phase(start=0.0, duration=max(jog.end for jog in seats) + DWELL, s=phases[0].s, speed=STILL)
        placed = seats + [_later(jog, seat.duration) for jog in placed]
        later = (msgspec.structs.replace(one, start=one.start + seat.duration) for one in phases)
        phases = (seat, *later)
    return Layout(phases=phases, crossings=tuple(sorted(placed, key=lambda one: (one.start, one.axis))), bias=bias)


def without_axes(result: StrategyResult, axes: Sequence[str], why: str = NO_OFFSET) -> StrategyResult:
    """Take the jogs of some axes out of a result, and the stops that were made for nothing else."""

    def without(request: ProfileRequest) -> ProfileRequest:
        kept = tuple(one for one in request.crossings if one.axis not in axes)
        if kept or not request.crossings:
            return msgspec.structs.replace(request, crossings=kept)
        return ProfileRequest(shape=None, note=request.note or why)

    shifted = tuple(axis for axis in result.shifted if axis not in axes)
    return msgspec.structs.replace(result, requests=tuple(map(without, result.requests)), shifted=shifted)


def lacks_stops(task: PlanningTask, result: StrategyResult) -> bool:
    """Return whether a jog of a result has no stop: neither one of its own nor one of the path."""
    pairs = zip(task.windows, result.requests, strict=True)
    return any(
        request.shape is None and request.crossings and not request.stop and task.feed.at(window.s) > 0.0
        for window, request in pairs
    )


def _requested_jogs(requests: Sequence[ProfileRequest]) -> list[Jog]:
    return [one for request in requests for one in request.crossings if isinstance(one, Jog)]


def _jogs_at_windows(job: Job, motion: MotionLaw) -> tuple[list[Jog], set[int]]:
    """Jogs of the windows that stand still for them, and the turning points that they serve."""
    found: list[Jog] = []
    served: set[int] = set()
    for number, request in enumerate(job.requests):
        middle = None if job.profiles[number] is None else middle_of(motion, number)
        if middle is None:
            continue
        own = [msgspec.structs.replace(_later(one, middle), window=number) for one in _requested_jogs([request])]
        if all(_stands_still(motion, jog) for jog in own):
            found += own
            names = {jog.axis for jog in own}
            served |= {k for k in job.windows[number].members if job.turning_points[k].axis in names}
    return found, served


def _stands_still(motion: MotionLaw, jog: Jog) -> bool:
    """Return whether the path rests during a jog and the least dwells around it."""
    around = np.array([jog.start - NEARLY * DWELL, jog.end + NEARLY * DWELL])
    s, feed = motion.place_and_feed(around)
    return bool(np.all(feed == 0.0) and abs(s[1] - s[0]) <= SAME_PLACE)


def _add_stop(holds: dict[int, float], at_stops: list[tuple[int, Jog]], stop: int, jog: Jog) -> None:
    """Add a jog to what is done at a stop, behind what is there, with a dwell on either side."""
    start = holds.get(stop, DWELL)
    at_stops.append((stop, _later(jog, start)))
    holds[stop] = start + jog.duration + DWELL


def _jogs_at_start(
    job: Job, shifted: Sequence[str], holds: dict[int, float], at_stops: list[tuple[int, Jog]]
) -> tuple[dict[str, float], list[Jog]]:
    """Offsets of the first row, and the approach, from there onto the offset of the first motion."""
    bias: dict[str, float] = {}
    seats: list[Jog] = []
    feed = min(APPROACH_FEED, job.track.path.feed)
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
        distance = approach_distance(axis.gap)
        bias[name] -= way * distance
        seats.append(make_jog(axis, way * distance, 0.0, feed))
    return bias, seats


def _later(jog: Jog, delay: float) -> Jog:
    return msgspec.structs.replace(jog, start=jog.start + delay)
