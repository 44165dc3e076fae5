"""Lay crossings of the gap and jogs into a planned motion: in profiles, at stops, and before the start.

An axis whose loop is not closed over the table carries a lasting offset by the side it moves to: half its gap
either way, or the whole gap on one side (:func:`ph_post.drive.axes.side_offsets`). So every reversal of it has to
be crossed, or the offset would be the wrong one from there on; and before the first motion it must be on the right
side, whichever side the axis stood on. A part program can shift an axis only while the path stands still, so an
axis carries a lasting offset there only where the motion stops at each of its reversals.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.crossing_times import (
    MOST,
    NO_REST,
    PART,
    Carried,
    carried,
    crossing_at_turn,
    first_push,
    has_moved,
    rest_before,
    shortest_crossing,
    turning_acceleration,
    whole_crossing,
    wound,
)
from ph_post.compensate.friction import Friction, friction_of, little_friction
from ph_post.compensate.friction_layout import lay_friction
from ph_post.compensate.motion import MotionLaw
from ph_post.compensate.offsets import APPROACH_FEED, DWELL, approach_distance, corner_pause, make_jog, whole_jog
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult
from ph_post.compensate.trial import SAME_TURN, came_from
from ph_post.drive.axes import axis_at, lasting_offset, side_offsets
from ph_post.geometry.numeric import bisect
from ph_post.geometry.piecewise import MEETS
from ph_post.geometry.track import Track
from ph_post.types import Axis, Crossing, FeedProfile, FrictionChange, Jog, Machine, Phase, TurningPoint, Window, frozen

STILL = frozen([0.0])

NOTHING: Final = Carried((), (), 0.0)
"""What an axis needs that is on its side."""

KNOWN_SIDES: Final = {"+": 1, "-": -1}
"""Sides on which axes stand at first where a machine file tells it."""


class Layout(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Phases with holds where crossings need them, crossings in the order of time, and the bias by axis.

    `dropped` are the axes whose lasting offset cannot be carried; then nothing is laid out.
    """

    phases: tuple[Phase, ...]
    crossings: tuple[Crossing | Jog, ...]
    bias: Mapping[str, float]
    dropped: tuple[str, ...] = ()
    friction: tuple[FrictionChange, ...] = ()


class Job(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The input of a layout: a motion with its profiles, and the requests.

    `written` says that the plan becomes a part program, which crosses the gap by jogs at full stops. `shifted` are
    axes with a lasting offset whether or not a request crosses their gap. Without `winds_up` a table begins as
    the path does, and axes come onto their sides under way; where it `leads_first`, against friction that is led. Where
    it `pushes_first` axes whose gap is inside their loop are on their sides when the path begins; where it `carries`,
    they cross it while they rest. `friction` is by axis what is led of that, from rest in `friction_first` [s] before
    the path begins.
    """

    track: Track
    machine: Machine
    turning_points: tuple[TurningPoint, ...]
    windows: tuple[Window, ...]
    requests: tuple[ProfileRequest, ...]
    profiles: tuple[FeedProfile | None, ...]
    phases: tuple[Phase, ...]
    moving: bool
    lead: bool
    written: bool
    shifted: tuple[str, ...] = ()
    winds_up: bool = True
    leads_first: bool = True
    pushes_first: bool = False
    carries: bool = False
    friction: Mapping[str, Friction] = {}
    friction_first: float = 0.0

    @property
    def length(self) -> float:
        """Arc length of the path [m]."""
        return self.track.length

    def whole(self, axis: Axis, direction: int) -> Crossing | Jog:
        """Cross the whole gap of an axis once, beginning at 0 s."""
        if self.written:
            return whole_jog(axis, direction, 0.0)
        duration = self.shortest(axis)
        return whole_crossing(axis, direction, 0.5 * duration, duration)

    def shortest(self, axis: Axis, part: float = PART) -> float:
        """Shortest duration of a crossing of an axis in a table within a part of its limits [s]."""
        return shortest_crossing(axis, self.lead, self.machine.servo_period, part)


class _Stops:
    """Crossings at stops of the path, and how long it rests there.

    `holds` [s] is by the phase that starts from rest; `crossings` are with that phase, counted from its hold.
    """

    def __init__(self) -> None:
        self.holds: dict[int, float] = {}
        self.crossings: list[tuple[int, Crossing | Jog]] = []

    def add(self, stop: int, one: Crossing | Jog) -> None:
        """Add what is done at a stop: crossings side by side, jogs in turn with a dwell on either side."""
        if isinstance(one, Jog):
            start = self.holds.get(stop, DWELL)
            self.holds[stop] = start + one.duration + DWELL
        else:
            start = 0.0
            self.holds[stop] = max(self.holds.get(stop, 0.0), one.duration)
        self.crossings.append((stop, _delayed(one, start)))

    def delay_at(self, phases: Sequence[Phase], t: float) -> float:
        """By how much holds delay what happens at `t` [s]."""
        return sum(duration for number, duration in self.holds.items() if phases[number].start <= t)

    def delay_before(self, number: int) -> float:
        """By how much holds before earlier phases delay that of a phase [s]."""
        return sum(duration for other, duration in self.holds.items() if other < number)


def lay_out(job: Job) -> Layout:
    """Place every crossing in time, and insert holds where the motion rests for one.

    In a part program an axis with a lasting offset begins on the flank of its first motion, onto which the
    program's approach brings it: the motion begins with that. Z comes down onto it, whatever its first motion is.

    Parameters
    ----------
    job : Job

    Returns
    -------
    Layout
        With nothing but the axes `dropped` where a part program runs through one of their reversals.
    """
    motion = MotionLaw.from_phases(job.phases)
    shifted = sorted({one.axis for one in _requested(job, *job.requests) if is_open(job, one.axis)}.union(job.shifted))
    placed = _jogs_at_windows(job, motion) if job.written else _crossings_at_windows(job, motion)
    served = {(k, one.axis) for one in placed for k in job.windows[one.window].members}
    stops = _Stops()
    dropped: set[str] = set()
    for point in job.turning_points:
        if point.axis not in shifted or (point.index, point.axis) in served or at_an_end(job, point):
            continue
        if _begins(job, point):
            continue
        stop, axis, direction = rest_at(job.phases, point.s), job.machine.axes[point.axis], -came_from(point)
        quickest = job.shortest(axis, MOST)
        idle = NO_REST if job.written else rest_before(job.track, point, axis, job.lead)
        if stop is not None and idle.start_of(quickest) is None:
            stops.add(stop, job.whole(axis, direction))
        elif job.written:
            dropped.add(point.axis)
        else:
            turn = _time_at(motion, point.s)
            bent = turning_acceleration(point, float(motion.place_and_feed(np.array([turn]))[1][0]))
            placed.append(_delayed(crossing_at_turn(axis, direction, quickest, bent, idle), turn))
    if dropped:
        return Layout(phases=job.phases, crossings=(), bias={}, dropped=tuple(sorted(dropped)))
    bias, approach, first_changes = _at_start(job, shifted, stops)
    rest = max((one.end for one in approach), default=0.0) if job.written or job.winds_up else 0.0
    if job.pushes_first:
        pushes = first_pushes(job.track, job.machine, job.turning_points, tuple(job.friction))
        rest = max(rest, *(one.end for one in pushes), 0.0)
        approach += pushes
    if rest and not job.written:
        # Whole periods, so that a row stands where the path begins.
        period = job.machine.servo_period
        stops.holds[0] = math.ceil(rest / period - WHOLE) * period
    if job.friction_first:
        stops.holds[0] = max(stops.holds.get(0, 0.0), job.friction_first)
    carried_over, changes = _carried_at_rest(job, motion, served) if job.carries else ([], [])
    placed = [_delayed(one, stops.delay_at(job.phases, one.start)) for one in (*placed, *carried_over)]
    changes = [msgspec.structs.replace(one, start=one.start + stops.delay_at(job.phases, one.start)) for one in changes]
    placed += [_delayed(one, job.phases[k].start + stops.delay_before(k)) for k, one in stops.crossings]
    phases = with_holds(job.phases, stops.holds)
    if approach and job.written:
        rest += max(corner_pause(job.machine.axes[one.axis]) for one in approach)
        placed = [_delayed(one, rest) for one in placed]
        phases = with_holds(phases, {0: rest})
    crossings = sorted(placed + approach, key=lambda one: (one.start, one.axis))
    return Layout(
        phases=phases,
        crossings=tuple(crossings),
        bias=bias,
        friction=_friction_changes(job, phases, crossings, first_changes + changes),
    )


def _friction_changes(
    job: Job, phases: Sequence[Phase], crossings: Sequence[Crossing | Jog], changes: Sequence[FrictionChange]
) -> tuple[FrictionChange, ...]:
    """Turn the friction that is led round in a motion with all its holds; some changes are made already."""
    if not job.friction:
        return ()
    motion = MotionLaw.from_phases(phases)
    asked = [*changes]
    for number, request in enumerate(job.requests):
        if not request.friction:
            continue
        middle = middle_of(motion, number)
        if middle is None and request.shape is None:
            middle = _time_at(motion, job.windows[number].s)
        if middle is not None:
            asked += [msgspec.structs.replace(one, start=middle + one.start, window=number) for one in request.friction]
    return lay_friction(job.track, job.machine, motion, job.friction, asked, job.moving, crossings)


def _carried_at_rest(
    job: Job, motion: MotionLaw, served: Collection[tuple[int, str]]
) -> tuple[list[Crossing], list[FrictionChange]]:
    """Carry motors through backlash inside their loops while their axes rest before they turn back."""
    crossings, changes = list[Crossing](), list[FrictionChange]()
    for point in job.turning_points:
        axis = job.machine.axes[point.axis]
        if is_open(job, point.axis) or (point.index, point.axis) in served or at_an_end(job, point):
            continue
        if not has_moved(job.track, job.turning_points, point):
            continue
        if axis.gap.lost_motion == 0.0:
            continue
        rest = rest_before(job.track, point, axis, job.lead)
        for lap in LAPS:
            friction, period = job.friction.get(point.axis), job.machine.servo_period
            own = carried(axis, -came_from(point), friction, job.shortest(axis), lap, period)
            begin = rest.start_of(own.duration)
            if begin is not None:
                placed = own.at(_time_at(motion, point.s) + begin)
                crossings += placed[0]
                changes += placed[1]
                break
    return crossings, changes


def is_open(job: Job, name: str) -> bool:
    """Return whether the loop of an axis is not closed over the table."""
    return not job.machine.axes[name].loop.encloses_backlash


def _requested(job: Job, *requests: ProfileRequest) -> list[Crossing | Jog]:
    """Crossings of requests that the plan can carry: jogs in a part program, and no jogs elsewhere."""
    return [one for request in requests for one in request.crossings if isinstance(one, Jog) == job.written]


def _crossings_at_windows(job: Job, motion: MotionLaw) -> list[Crossing | Jog]:
    """Crossings of the windows, each within its profile or around its turning point."""
    found: list[Crossing | Jog] = []
    for number, request in enumerate(job.requests):
        members = [job.turning_points[k] for k in job.windows[number].members]
        begins = {point.axis for point in members if _begins(job, point)}
        chosen = [one for one in _requested(job, request) if not (is_open(job, one.axis) and one.axis in begins)]
        if not chosen or request.stop:
            continue
        window, middle = job.windows[number], middle_of(motion, number)
        if at_an_end(job, job.turning_points[window.turning_point]):
            # What is behind the loop is brought to its flank before the motion begins.
            chosen = [one for one in chosen if middle is not None and not is_open(job, one.axis)]
        elif job.profiles[number] is None or middle is None:
            # Without the profile that it asked for a crossing inside the loop would do harm; a lasting offset is still
            # needed.
            chosen = [one for one in chosen if request.shape is None or is_open(job, one.axis)]
            middle = _time_at(motion, window.s)
        if not chosen or middle is None:
            continue
        early = max(0.0, -min(middle + one.start for one in chosen))
        found += [msgspec.structs.replace(one, start=early + middle + one.start, window=number) for one in chosen]
    return found


def _jogs_at_windows(job: Job, motion: MotionLaw) -> list[Crossing | Jog]:
    """Jogs of the windows that stand still for them."""
    found: list[Crossing | Jog] = []
    for number, request in enumerate(job.requests):
        middle = None if job.profiles[number] is None else middle_of(motion, number)
        if middle is None:
            continue
        own = [msgspec.structs.replace(_delayed(one, middle), window=number) for one in _requested(job, request)]
        if all(_stands_still(motion, jog) for jog in own):
            found += own
    return found


LAPS: Final = (0.0, 0.5)
"""Parts of the changes of friction that are made while a motor is carried through its backlash, tried in turn."""

WHOLE: Final = 1e-9
"""Part of a period that counts as none."""

UNDER_WAY: Final = 3.0
"""Shortest crossings that the one lasts by which an axis comes onto its side while the path begins: it takes less than
a thirtieth of the jerk, and the path may have the rest."""

NEARLY: Final = 0.99
"""Part of the least dwell that is looked for: what is left of it where a profile was fitted to the limits."""


def _stands_still(motion: MotionLaw, jog: Crossing | Jog) -> bool:
    """Return whether the path rests during a jog and the least dwells around it."""
    around = np.array([jog.start - NEARLY * DWELL, jog.end + NEARLY * DWELL])
    s, feed = motion.place_and_feed(around)
    return bool(np.all(feed == 0.0) and abs(s[1] - s[0]) <= SAME_TURN)


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
    return point.s <= SAME_TURN or point.s >= job.length - SAME_TURN


def _begins(job: Job, point: TurningPoint) -> bool:
    """Return whether an axis of a table rests from the beginning to a turning point: it is on the side behind that."""
    away = job.written or job.moving or at_an_end(job, point)
    return not (away or has_moved(job.track, job.turning_points, point))


def rest_at(phases: Sequence[Phase], s: float) -> int | None:
    """Index of the phase that starts from rest at `s`, None where the motion runs through."""
    for number, phase in enumerate(phases):
        if number and abs(phase.s - s) <= SAME_TURN and phase.speed[0] == 0.0:
            return number
    return None


def _time_at(motion: MotionLaw, s: float) -> float:
    """First instant at which the motion is at `s` [s]."""
    return bisect(lambda t: motion.place_at(t) < s, 0.0, motion.end)[1]


def _at_start(
    job: Job, shifted: Sequence[str], stops: _Stops
) -> tuple[dict[str, float], list[Crossing | Jog], list[FrictionChange]]:
    """Offsets of the first row [m], and the approach, from there to the flank that each axis' first motion needs.

    With it are the changes of the friction that it leads.
    """
    bias: dict[str, float] = {}
    approach: list[Crossing | Jog] = []
    changes: list[FrictionChange] = []
    for name in shifted:
        axis, direction = job.machine.axes[name], first_direction(job.track, job.turning_points, name)
        first = next((one for one in job.turning_points if one.axis == name), None)
        idle = 0.0
        if first is not None and _begins(job, first):
            direction, idle = -came_from(first), _time_at(MotionLaw.from_phases(job.phases), first.s)
        bias[name] = lasting_offset(axis, direction)
        if direction != 0 and not job.moving:
            if job.written:
                bias[name], jogs = _by_jog(job, axis, direction, stops)
                approach += jogs
            else:
                bias[name], own = _by_crossings(job, axis, direction, idle)
                approach += own.crossings
                changes += own.friction
    return bias, approach, changes


def first_pushes(
    track: Track, machine: Machine, points: Sequence[TurningPoint], without: Sequence[str]
) -> list[Crossing]:
    """Push axes whose gap is inside their loop onto the sides of their first motions, `without` some."""
    axes = [machine.axes[name] for name in track.path.axes if name not in without]
    inside = [one for one in axes if one.loop.encloses_backlash and one.gap.lost_motion > 0.0]
    first = {one.name: first_direction(track, points, one.name) for one in inside}
    return [
        first_push(one, first[one.name], machine.servo_period)
        for one in inside
        if first[one.name] not in (0, KNOWN_SIDES.get(one.gap.initial_flank))
    ]


def _by_crossings(job: Job, axis: Axis, direction: int, idle: float) -> tuple[float, Carried]:
    """Offset of the first row [m], and what brings an axis from its flank to the other.

    It rests for `idle` [s] while the path begins.
    """
    flank, period = KNOWN_SIDES.get(axis.gap.initial_flank, 0), job.machine.servo_period
    if flank == direction:
        return lasting_offset(axis, direction), NOTHING
    shortest = job.shortest(axis)
    duration = (1.0 if job.winds_up else UNDER_WAY) * shortest
    whole = whole_crossing(axis, direction, 0.5 * duration, duration)
    if flank:
        return lasting_offset(axis, flank), Carried((whole,), (), duration)
    friction = job.friction.get(axis.name) if job.leads_first else None
    middle = 0.5 * sum(side_offsets(axis))
    if job.winds_up:
        # The table may be moved too far: the path has not begun.
        rubs = None if job.friction else friction_of(axis)
        beyond = 0.0 if rubs is None else rubs.size
        return middle, wound(axis, direction, friction, duration, period, beyond=beyond)
    # With all of the friction led it would be moved too far where there is less. An integrator gives it, with time.
    end = idle - shortest
    own = wound(axis, direction, friction, duration, period, part=little_friction([axis]), end=end)
    if own.duration <= end + WHOLE * period:
        return middle, own
    # On the right side it comes onto the path, on the other it stays until the path has come up with it.
    travel = lasting_offset(axis, direction)
    return 0.0, Carried((msgspec.structs.replace(whole, travel=travel),), (), duration) if travel else NOTHING


def _by_jog(job: Job, axis: Axis, direction: int, stops: _Stops) -> tuple[float, list[Crossing | Jog]]:
    """Offset of the first row [m], and the jog from there onto the offset of the first motion."""
    way = approached_way(axis, direction)
    if way != direction:
        stops.add(0, job.whole(axis, direction))
    distance = approach_distance(axis.gap)
    jog = make_jog(axis, way * distance, 0.0, min(APPROACH_FEED, job.track.path.feed))
    return lasting_offset(axis, way) - way * distance, [jog]


def approached_way(axis: Axis, direction: int) -> int:
    """Direction in which a program brings an axis to its start, from which it goes on in `direction`: Z down."""
    return -1 if axis.name == "Z" else direction


def first_direction(track: Track, points: Sequence[TurningPoint], name: str) -> int:
    """Direction of the first motion of an axis; 0 where it does not move at all."""
    for point in points:
        if point.axis == name:
            return -came_from(point) if point.s <= SAME_TURN else came_from(point)
    number = track.path.axes.index(name)
    s = np.linspace(0.0, track.length, 129)
    place = track.derivatives(*track.locate(s))[0][:, number]
    return int(np.sign(place[np.argmax(np.abs(place - place[0]))] - place[0]))


def approach_sides(track: Track, points: Sequence[TurningPoint]) -> dict[str, int]:
    """Side (1, -1) on which a program's approach leaves each axis, that of its first motion before any rapid.

    An axis that rests at first comes onto the side of its first motion later, Z comes down whatever its motion is,
    and an axis that does not move is left out, as are all where the path begins with a rapid.
    """
    axes = track.path.axes
    quick = np.array([segment.rapid for segment in track.path.segments])[track.segment]
    if quick[0]:
        return {}
    end = float(track.starts[np.argmax(quick)]) if quick.any() else track.length
    origin, last = track.derivatives(*track.locate(np.array([0.0, end])))[0]
    sides = {}
    for column, name in enumerate(axes):
        own = (one for one in points if one.axis == name and 0.0 < one.s < end)
        turn = next((one for one in own if abs(one.position - origin[column]) > MEETS), None)
        way = last[column] - origin[column]
        first = came_from(turn) if turn is not None else int(np.sign(way)) * int(abs(way) > MEETS)
        sides[name] = -1 if name == "Z" else first
    return {name: side for name, side in sides.items() if side}


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


def _delayed(crossing: Crossing | Jog, delay: float) -> Crossing | Jog:
    return msgspec.structs.replace(crossing, start=crossing.start + delay)


def reversing_axes(
    machine: Machine, points: Sequence[TurningPoint], others: Sequence[str] = ()
) -> tuple[tuple[Axis, int], ...]:
    """Axes with a gap among those that turn back, each as it is there and with the direction it goes on in.

    Of `others` those without a gap are among them. The machine is one to size by, see
    :func:`ph_post.drive.axes.sized_machine`.
    """
    drives = ((axis_at(machine.axes[point.axis], point.position), -came_from(point)) for point in points)
    return tuple((axis, direction) for axis, direction in drives if axis.gap.lost_motion > 0.0 or axis.name in others)


NO_OFFSET: Final = "the motion does not stop at every reversal of its axis, as a lasting offset needs it"


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
