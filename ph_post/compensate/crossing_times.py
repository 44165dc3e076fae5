"""Crossings of the whole gap behind a loop: how long they last at least, and when they begin where nothing stops.

Before the turning point of an axis a crossing pulls the table short of it by what the motor has covered of the gap;
behind it the table waits until the motor has come to its other side, while the path goes on. So a crossing in T is to
be later than the turning point. By how much depends on one number alone, a T²/g, where the axis turns back with the
acceleration a through the gap g.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.compensate.friction import Friction, held_change, shortest_step
from ph_post.compensate.inverse import lead_of_crossing, motor_inertia
from ph_post.compensate.lead import WIDTH
from ph_post.compensate.limit_curve import AxisLimits, axis_limits
from ph_post.compensate.offsets import DWELL, EDGE, command_of, corner_pause, smoothstep, travelled
from ph_post.compensate.violations import command_noise, usage
from ph_post.geometry.bernstein import derivative, evaluate
from ph_post.geometry.piecewise import MEETS
from ph_post.geometry.track import Track
from ph_post.types import Array, Axis, Command, Crossing, FrictionChange, Plan, TurningPoint, frozen

TRAVEL: Final = 4
"""Derivatives of a crossing's travel that vanish at its ends: the command takes two more, and three differences."""

PART: Final = 0.6
"""Part of an axis' limits that a crossing alone may take; the rest is the path's."""

MOST: Final = 0.95
"""The same where crossings are made as slow as the path needs it, see :func:`fit_crossings`."""

SLOWER: Final = tuple(np.geomspace(1.0, 1.8, 12).tolist())
"""Times that duration which are tried in turn."""

BEFORE: Final = 0.43
"""Part of a crossing before the turning point, about."""

SHORTEST: Final = 16
"""Samples that a crossing lasts at least."""

LONGER: Final = 1.02
"""Ratio of the durations that are tried."""

ANSWERS: Final = 3.0
"""Times in which a servo answers, √b, that an axis is given to be pushed out, and to be pushed back."""

SHARPNESS: Final = frozen(np.geomspace(0.1, 1e4, 61))
"""Values of a T²/g between which delays are looked up."""

DELAYS: Final = frozen(np.linspace(0.0, 0.15, 31))
"""Delays that are tried, in parts of the duration."""

AROUND_CARRIED: Final = 64
"""Rows before and behind a crossing inside the loop of a cascade, whose command dies away behind it."""

AROUND: Final = 4
"""Rows before and behind a crossing that are looked at with it."""

FINENESS: Final = 400
"""Instants of a crossing that are looked at."""

LONGEST_REST: Final = 1.0
"""Time [s] up to which it is looked how long an axis rests before it turns back."""


def shortest_crossing(axis: Axis, lead: bool, period: float, part: float = PART) -> float:
    """Shortest duration [s] in which the gap can be crossed within a part of the axis' limits.

    Behind the loop the command travels; with inverse dynamics it takes c and b times the next two derivatives
    more. Inside it the command is the motor's output, η b (m̈ + β ṁ), and of a cascade the inverse of its loops, which
    are open meanwhile.
    """
    gap, limits = axis.gap, axis.limits
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    if axis.loop.encloses_backlash and axis.servo.cascade is not None:
        return _shortest_carried(replace(axis, effects=()), period, part)
    if axis.loop.encloses_backlash:
        inertia = motor_inertia(axis)
        weights = (0.0, inertia * (gap.beta or 0.0), inertia)
    else:
        weights = (1.0, lead * axis.servo.c, lead * axis.servo.b)
    return _shortest(gap.lost_motion, weights, tuple(part * bound for bound in bounds), period)


def first_push(axis: Axis, direction: int, period: float) -> Crossing:
    """Push an axis whose gap is inside its loop out and back by the gap, from 0 s on, before a motion in a direction.

    Back on its place it is on the side of that motion, whichever side it stood on.
    """
    limits, push = axis.limits, axis.gap.lost_motion
    bounds = tuple(PART * bound for bound in (limits.velocity, limits.acceleration, limits.jerk))
    edge = max(_shortest(push, (1.0, 0.0, 0.0), bounds, period), ANSWERS * math.sqrt(axis.servo.b))
    return Crossing(
        axis=axis.name,
        start=0.0,
        duration=0.0,
        travel=0.0,
        order=TRAVEL,
        push=-direction * push,
        push_duration=edge / EDGE,
    )


@lru_cache(maxsize=64)
def _shortest(travel: float, weights: tuple[float, ...], bounds: tuple[float, ...], period: float) -> float:
    """Shortest duration in which the weighted derivatives of a travel and of its next two keep to bounds [s]."""
    rows = _derivatives()

    def fits(duration: float) -> bool:
        rates = travel * rows / duration ** np.arange(len(rows))[:, np.newaxis]
        taken = (np.abs(np.tensordot(weights, rates[order : order + 3], 1)).max() for order in range(1, 4))
        return all(one <= bound for one, bound in zip(taken, bounds, strict=True))

    duration = SHORTEST * period
    while not fits(duration):
        duration *= LONGER
    return duration


@lru_cache(maxsize=64)
def _shortest_carried(axis: Axis, period: float, part: float) -> float:
    """Shortest duration in which a cascade carries its motor through its gap within a part of the axis' limits [s]."""
    bounds = [[axis.limits.velocity], [axis.limits.acceleration], [axis.limits.jerk]]
    limits, duration = AxisLimits(values=frozen(bounds), period=period), SHORTEST * period
    while True:
        rows = round(duration / period) + 2 * AROUND_CARRIED
        t = period * np.arange(rows, dtype=np.float64)
        _, speed, acceleration = travelled(whole_crossing(axis, 1, 0.5 * rows * period, duration), t)
        command = lead_of_crossing(axis, speed, acceleration, None, period)[:, np.newaxis]
        if all(float(usage(command, limits, order, 0.0).max()) <= part for order in (1, 2, 3)):
            return duration
        duration *= LONGER


@lru_cache(maxsize=1)
def _derivatives() -> Array:
    """Return the travel of a crossing and its derivatives up to the fifth, by instants."""
    step, u = smoothstep(TRAVEL)[0], np.linspace(0.0, 1.0, FINENESS + 1)
    return frozen([evaluate(step if k == 0 else derivative(step, k), u) for k in range(6)])


def whole_crossing(axis: Axis, direction: int, middle: float, duration: float) -> Crossing:
    """Cross the whole gap once around an instant [s]."""
    return Crossing(
        axis=axis.name,
        start=middle - 0.5 * duration,
        duration=duration,
        travel=axis.gap.lost_motion * direction,
        order=TRAVEL,
    )


class Rest(NamedTuple):
    """When an axis that rests before it turns back at 0 s may be moved within its backlash: from when to when [s]."""

    begin: float = 0.0
    end: float = 0.0

    def start_of(self, duration: float) -> float | None:
        """Return when what takes a duration [s] begins, as late as may be; None where it does not fit."""
        return self.end - duration if self.begin < self.end - duration else None


NO_REST: Final = Rest()


def rest_before(track: Track, point: TurningPoint, axis: Axis, lead: bool) -> Rest:
    """Return when an axis may be moved within its backlash while it rests before it turns back.

    The rest is reckoned at the fastest feed of the path, and no further back than a rapid, whose feed is the machine's,
    and than :data:`LONGEST_REST`. Half of a pause is left at either end: a table that is not led comes late.
    """
    if point.kind != "dwell":
        return NO_REST
    path = track.path
    fastest = max(segment.feed or path.feed for segment in path.segments)
    s = np.linspace(max(point.s - LONGEST_REST * fastest, 0.0), point.s, FINENESS + 1)
    piece, u = track.locate(s)
    place = track.derivatives(piece, u)[0][:, path.axes.index(point.axis)]
    rapid = np.array([segment.rapid for segment in path.segments])[track.segment[piece]]
    moved = np.flatnonzero((np.abs(place - point.position) > MEETS) | rapid)
    if moved.size and moved[-1] == s.size - 1:
        return NO_REST
    time = float(point.s - s[moved[-1] + 1 if moved.size else 0]) / fastest
    # The window through which the path is led begins so long before it.
    pause = max(DWELL, WIDTH * math.sqrt(axis.servo.b)) if lead else 0.5 * corner_pause(axis)
    return Rest(pause - time, -pause)


def has_moved(track: Track, points: Sequence[TurningPoint], point: TurningPoint) -> bool:
    """Return whether an axis has moved before a turning point, so that its side there is known."""
    start = track.derivatives(*track.locate(np.zeros(1)))[0][0, track.path.axes.index(point.axis)]
    return abs(start - point.position) > MEETS or any(one.axis == point.axis and one.s < point.s for one in points)


def crossing_at_turn(
    axis: Axis, direction: int, duration: float, acceleration: float, rest: Rest = NO_REST
) -> Crossing:
    """Cross the whole gap once where an axis turns back at 0 s with an acceleration [m/s²], when it does least harm.

    Where it rests for long enough before that, it crosses meanwhile, which does none.
    """
    begin = rest.start_of(duration)
    if begin is not None:
        return whole_crossing(axis, direction, begin + 0.5 * duration, duration)
    sharpness = acceleration * duration**2 / axis.gap.lost_motion
    delay = float(np.interp(sharpness, SHARPNESS, _best_delays()[0]))
    return whole_crossing(axis, direction, delay * duration, duration)


class Carried(NamedTuple):
    """What carries a motor through its backlash, from 0 s on, and how long that takes in all [s]."""

    crossings: tuple[Crossing, ...]
    friction: tuple[FrictionChange, ...]
    duration: float

    def at(self, begin: float) -> tuple[list[Crossing], list[FrictionChange]]:
        """Return the crossings and the changes of friction from another instant on [s]."""
        crossings = [replace(one, start=begin + one.start) for one in self.crossings]
        return crossings, [replace(one, start=begin + one.start) for one in self.friction]


def carried(axis: Axis, way: int, friction: Friction | None, duration: float, lap: float, period: float) -> Carried:
    """Carry a motor through a backlash inside its loop.

    Friction is let go, the motor crosses in `duration` [s], 0 where there is no backlash, and friction is led the other
    way. Of the first and the last the part `lap` is done while the motor crosses.
    """
    change, before, whole = None, 0.0, duration
    if friction is not None:
        change = held_change(axis, friction, -way, way, 0.0, period)
        before = (1.0 - lap) * change.release
        whole = before + max(duration, lap * (change.release + change.take)) + (1.0 - lap) * change.take
        change = replace(change, hold=whole - change.release - change.take)
    crossings = (whole_crossing(axis, way, before + 0.5 * duration, duration),) if duration else ()
    return Carried(crossings, () if change is None else (change,), whole)


def wound(
    axis: Axis,
    way: int,
    friction: Friction | None,
    whole: float,
    period: float,
    *,
    beyond: float = 0.0,
    part: float = 1.0,
    end: float = 0.0,
) -> Carried:
    """Bring an axis whose backlash is behind its loop onto the side of a way, from either.

    From the middle it goes back until the other side is surely touched, and then forth, both as a crossing of the whole
    backlash in `whole` [s] does. Friction would keep the motor short of both. Where it is led, a `part` of it is led
    back at first, and all of it forth while the motor rests between the two, which lasts until it has to set out for
    being there at `end` [s]. One that sets out with less of it led comes late and runs past its place, which does no
    harm on the way back where there is no such time. Where friction is not led, the axis goes back `beyond` [m] as far.
    """
    gap, more = axis.gap.lost_motion, 1.0 + axis.uncertainty.backlash
    back, there, forth = 0.5 * gap * more + beyond, whole, more * whole
    leads = friction is not None and friction.turns
    if leads or beyond:
        # With the same jerk.
        there = (back / gap) ** (1.0 / 3.0) * whole
        forth = max(more, ((back + 0.5 * gap) / gap) ** (1.0 / 3.0)) * whole
    before, onto = 0.0, there
    changes: tuple[FrictionChange, ...] = ()
    if friction is not None and leads:
        release = shortest_step(axis, part * friction.size, period)
        turn = shortest_step(axis, (1.0 + part) * friction.size, period, alone=True)
        before = release if end else 0.0
        onto = max(release + turn, before + there + turn, end - forth)
        change = FrictionChange(axis=axis.name, start=0.0, release=release, before=0, after=way, held=-part)
        changes = (replace(change, hold=onto - turn - release, take=turn),)
    crossing = Crossing(axis=axis.name, start=before, duration=there, travel=-way * back, order=TRAVEL)
    crossings = (crossing, replace(crossing, start=onto, duration=forth, travel=way * (back + 0.5 * gap)))
    return Carried(crossings, changes, onto + forth)


def turning_acceleration(point: TurningPoint, feed: float) -> float:
    """Acceleration with which an axis turns back at a feed [m/s²]; 0 at corners and cusps."""
    return abs((point.curvature or 0.0) * (1.0 if point.normal is None else point.normal)) * feed**2


def turning_error(axis: Axis, duration: float, acceleration: float) -> float:
    """Largest error [m] where an axis turns back with an acceleration [m/s²] and crosses its gap meanwhile."""
    gap = axis.gap.lost_motion
    sharpness, errors = acceleration * duration**2 / gap, _best_delays()[1]
    return float(np.interp(sharpness, SHARPNESS, errors) * gap * min(sharpness / SHARPNESS[0], 1.0))


@lru_cache(maxsize=1)
def _best_delays() -> tuple[Array, Array]:
    """Return delays of the least largest error, in durations, and those errors, in gaps, by the values of a T²/g."""
    t = np.linspace(-1.0, 1.0, 2 * FINENESS + 1)[np.newaxis]
    u = np.clip(t - DELAYS[:, np.newaxis] + 0.5, 0.0, 1.0)
    offset = 0.5 - evaluate(smoothstep(TRAVEL)[0], u.ravel()).reshape(u.shape)
    found = np.empty((2, SHARPNESS.size))
    for number, sharpness in enumerate(SHARPNESS):
        path = -0.5 * sharpness * t**2
        motor = path + offset
        ahead = np.maximum.accumulate(motor, axis=1) - 0.5
        behind = np.where(np.arange(t.size) < motor.argmax(axis=1)[:, np.newaxis], np.inf, motor + 0.5)
        errors = np.abs(np.minimum(ahead, np.minimum.accumulate(behind, axis=1)) - path).max(axis=1)
        best = int(np.argmin(errors))
        found[:, number] = DELAYS[best], errors[best]
    return frozen(found[0]), frozen(found[1])


def fit_crossings(plan: Plan, track: Track) -> Plan:
    """Make crossings of a table during which the path goes on slower, until its command keeps the limits with them.

    Otherwise the lead of the path would give way, for longer than they last. Where no duration will do, the one is
    taken that breaks a limit least.
    """
    loops = {name: axis.loop.encloses_backlash for name, axis in plan.machine.axes.items()}
    whole = [one for one in plan.crossings if isinstance(one, Crossing) and one.order == TRAVEL]
    behind = [one for one in whole if not loops[one.axis]]
    if not behind:
        return plan
    rest = tuple(one for one in plan.crossings if one not in behind)
    command = command_of(replace(plan, crossings=rest), track, plan.machine.servo_period, fade=False)
    fitting = _Fitting(plan, command)
    found = [*rest, *map(fitting.fit, behind)]
    return replace(plan, crossings=tuple(sorted(found, key=lambda one: (one.start, one.axis))))


class _Fitting:
    """The command of a plan, to which crossings are added one after the other."""

    def __init__(self, plan: Plan, command: Command) -> None:
        self.plan, self.command, self.position = plan, command, command.position.copy()
        self.limits = axis_limits(command.axes, plan.machine, command.period)
        self.noise = command_noise(command, command.position)

    def fit(self, crossing: Crossing) -> Crossing:
        """Return a crossing, as slow as it has to be, and add it."""
        best, least = crossing, math.inf
        for times in SLOWER if self._goes_on(crossing) else ():
            duration = times * crossing.duration
            start = crossing.start - BEFORE * (duration - crossing.duration)
            slower = replace(crossing, start=start, duration=duration)
            rows = self._rows(slower)
            position = self.position[rows] + self._added(slower, rows)
            used = max(float(usage(position, self.limits, order, self.noise).max()) for order in (1, 2, 3))
            if used < least:
                best, least = slower, used
            if used <= 1.0:
                break
        rows = self._rows(best)
        self.position[rows] += self._added(best, rows)
        self.position[rows.stop :, self.command.axes.index(best.axis)] += best.travel
        return best

    def _goes_on(self, crossing: Crossing) -> bool:
        return bool(self.command.feed[self._rows(crossing)].all())

    def _rows(self, crossing: Crossing) -> slice:
        """Rows of a crossing, with those around it whose differences take part in it."""
        first, last = np.searchsorted(self.command.t, [crossing.start, crossing.end]).tolist()
        return slice(max(first - AROUND, 0), last + AROUND)

    def _added(self, crossing: Crossing, rows: slice) -> Array:
        """Return what a crossing adds to some rows (n, dim) [m]."""
        axis, t = self.plan.machine.axes[crossing.axis], self.command.t[rows]
        way, speed, acceleration = travelled(crossing, t)
        added = np.zeros((t.size, len(self.command.axes)))
        own = added[:, self.command.axes.index(crossing.axis)]
        own += way
        if self.plan.inverse_dynamics:
            own += lead_of_crossing(axis, speed, acceleration, None, self.command.period)
        return added
