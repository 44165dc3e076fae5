"""Crossings of the whole gap behind a loop: how long they last at least, and when they begin where nothing stops.

Before the turning point of an axis a crossing pulls the table short of it by what the motor has covered of the gap;
behind it the table waits until the motor has come to its other side, while the path goes on. So a crossing in T is to
be later than the turning point. By how much depends on one number alone, a T²/g, where the axis turns back with the
acceleration a through the gap g.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.compensate.inverse import lead_of_crossing, motor_inertia
from ph_post.compensate.limit_curve import axis_limits
from ph_post.compensate.offsets import EDGE, command_of, smoothstep, travelled
from ph_post.compensate.violations import command_noise, usage
from ph_post.geometry.bernstein import derivative, evaluate
from ph_post.geometry.track import Track
from ph_post.types import Array, Axis, Command, Crossing, Plan, TurningPoint, frozen

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

AROUND: Final = 4
"""Rows before and behind a crossing that are looked at with it."""

FINENESS: Final = 400
"""Instants of a crossing that are looked at."""


def shortest_crossing(axis: Axis, lead: bool, period: float, part: float = PART) -> float:
    """Shortest duration [s] in which the gap can be crossed within a part of the axis' limits.

    Behind the loop the command travels; with inverse dynamics it takes c and b times the next two derivatives
    more. Inside it the command is the motor's output, η b (m̈ + β ṁ).
    """
    gap, limits = axis.gap, axis.limits
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
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


def crossing_at_turn(axis: Axis, direction: int, duration: float, acceleration: float) -> Crossing:
    """Cross the whole gap once where an axis turns back at 0 s with an acceleration [m/s²], when it does least harm."""
    sharpness = acceleration * duration**2 / axis.gap.lost_motion
    delay = float(np.interp(sharpness, SHARPNESS, _best_delays()[0]))
    return whole_crossing(axis, direction, delay * duration, duration)


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
