"""Violations: stretches of sampled motion that break a velocity, acceleration or jerk limit of an axis.

Velocity, acceleration and jerk of samples are their first, second and third differences over the period's
first, second and third power. An offset that a strategy adds to an axis with a scale is a position error that
its motor has to answer; the motor's torque limit bounds it.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np

from ph_post.compensate.friction import friction_of
from ph_post.compensate.limit_curve import AxisLimits, axis_limits
from ph_post.compensate.motion import MotionLaw, row_times
from ph_post.compiling import compiled, read_only
from ph_post.drive.backlash import gap_constant
from ph_post.geometry.numeric import runs
from ph_post.geometry.track import Track
from ph_post.types import Array, Axis, BoolArray, Command, Machine

Quantity = Literal["velocity", "acceleration", "jerk", "motor acceleration"]

QUANTITIES: tuple[Quantity, ...] = ("velocity", "acceleration", "jerk")
"""By the order of the difference, less one."""


class Violation(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch of samples on which one axis breaks one limit, described by its worst place.

    `t` [s] and `s` [m] are those of the first sample of the difference; `value` and `limit` in SI units.
    """

    axis: str
    quantity: Quantity
    t: float
    s: float
    value: float
    limit: float


def rounding(extent: float, length: float, duration: float, speed: float) -> float:
    """Bound of the rounding error of a sampled position [m].

    A position of size `extent` [m] is a sum of some products, right to about four units in its last place; so
    is the arc length, up to `length` [m]; and time is counted up to `duration` [s], where half a unit in its
    last place, in the instant as in the phase's beginning, moves the tool at `speed` [m/s].
    """
    return float(np.finfo(np.float64).eps * (4.0 * (extent + length) + duration * speed))


def differences(position: Array, order: int, period: float) -> Array:
    """Difference of an order over that power of the period, shape (rows - order, dim)."""
    d: Array = np.diff(position, order, axis=0) / period**order
    return d


def usage(position: Array, limits: AxisLimits, order: int, noise: float) -> Array:
    """Ratio of what every axis does to what it may, shape (rows - order, dim); more than 1 breaks a limit.

    Rounding of the positions by `noise` [m] shows 2^order-fold in a difference and is allowed for.
    """
    ratio: Array = np.abs(differences(position, order, limits.period)) / _allowed(limits, order, noise)
    return ratio


def _allowed(limits: AxisLimits, order: int, noise: float) -> Array:
    """Return what every axis may do, rounding of the positions included, shape (dim,)."""
    return np.asarray(limits.of_order(order) + noise * (2.0 / limits.period) ** order)


def at_rest_before_and_after(position: Array, before: bool, after: bool) -> Array:
    """Add the samples of a machine that stands still before and after, three each: as many as show."""
    first = np.repeat(position[:1], 3 if before else 0, axis=0)
    last = np.repeat(position[-1:], 3 if after else 0, axis=0)
    padded: Array = np.concatenate([first, position, last])
    return padded


def at_rest_around(command: Command, position: Array) -> Array:
    """Add the rests of a command, where its feed begins or ends with zero, to positions of its rows [m]."""
    return at_rest_before_and_after(position, bool(command.feed[0] == 0.0), bool(command.feed[-1] == 0.0))


def command_noise(command: Command, position: Array) -> float:
    """Bound of the rounding error of positions (n, dim) [m] of a command's rows [m], see :func:`rounding`."""
    extent, speed = float(np.abs(position).max()), float(np.abs(command.feed).max())
    return rounding(extent, float(command.s.max()), float(command.t[-1]), speed)


def check_command(command: Command, machine: Machine) -> tuple[Violation, ...]:
    """Find every stretch on which the samples of `command` break a limit of the machine.

    Where the motion begins or ends with a feed of zero the machine stands still before or after it. The jerk
    of jogs is the controller's own, and no limit of it applies. What is added to the path of an axis with a
    scale may not ask its motor for more than `motor_acceleration` beyond what the path's motion takes.

    Returns
    -------
    tuple of Violation
        Ordered by axis, quantity and time; empty where all is well. Rounding is allowed for, nothing else.
    """
    position = at_rest_around(command, command.position)
    plain = command.position if command.jogged is None else command.position - command.jogged
    smooth = at_rest_around(command, plain)
    noise = command_noise(command, command.position)
    found: list[Violation] = []
    for number, axis in enumerate(command.axes):
        limits = axis_limits((axis,), machine, command.period)
        for order, quantity in enumerate(QUANTITIES, start=1):
            own = (position if order < len(QUANTITIES) else smooth)[:, number : number + 1]
            value = np.abs(differences(own, order, command.period))[:, 0]
            broken = usage(own, limits, order, noise)[:, 0] > 1.0
            for run in runs(np.flatnonzero(broken)):
                worst = int(run[np.argmax(value[run])])
                row = min(max(worst - 3 * (command.feed[0] == 0.0), 0), command.t.size - 1)
                found.append(_violation(command, row, axis, quantity, value[worst], limits.of_order(order)[0]))
        found += _motor_violations(command, machine.axes[axis], number)
    return tuple(found)


def asked_of_motor(command: Command, axis: Axis, number: int) -> Array:
    """Motor acceleration [rad/s²] that what is added to an axis asks for beyond the path's own motion, (n,).

    A metre of the controller's output asks for C = N / (η r b) (the line after Eq. 16 of the paper), of the motor
    alone; with a P controller that is the position error. The path's motion takes b ẍ + c ẋ
    whether the command leads it or lags.
    """
    if command.offset is None or not axis.loop.encloses_backlash:
        return np.zeros(command.t.size)
    path = command.position[:, number] - command.offset[:, number]
    speed = np.gradient(path, command.period)
    taken = axis.servo.b * np.gradient(speed, command.period) + axis.servo.c * speed
    error, servo = command.offset[:, number], axis.servo
    output = error + servo.kd_over_kp * np.gradient(error, command.period)
    if servo.ki_over_kp:
        # An integrator that moved steadily before held all of it.
        summed = np.concatenate([[0.0], np.cumsum(0.5 * (error[1:] + error[:-1]))]) * command.period
        output = output + servo.ki_over_kp * summed + taken[0]
    friction = friction_of(axis)
    if friction is not None:
        # What friction takes is no acceleration, and the plain motion takes it too.
        taken = np.abs(taken) + friction.size + abs(friction.load)
    extra = np.maximum(np.abs(output) - np.abs(taken), 0.0)
    return np.asarray(gap_constant(axis) * extra)


def _motor_violations(command: Command, axis: Axis, number: int) -> list[Violation]:
    """Stretches on which what is added to an axis asks more of its motor than it can still give."""
    limit = axis.limits.motor_acceleration
    if limit is None:
        return []
    asked = asked_of_motor(command, axis, number)
    stretches = runs(np.flatnonzero(asked > limit))
    rows = (int(stretch[np.argmax(asked[stretch])]) for stretch in stretches)
    return [_violation(command, row, axis.name, "motor acceleration", asked[row], limit) for row in rows]


def _violation(command: Command, row: int, axis: str, quantity: Quantity, value: float, limit: float) -> Violation:
    return Violation(
        axis=axis,
        quantity=quantity,
        t=float(command.t[row]),
        s=float(command.s[row]),
        value=float(value),
        limit=float(limit),
    )


_ROWS = 1 << 19
"""Rows looked at together: a long program needs no more memory than a short one."""

_REACH = 3
"""Rows that the third difference reaches beyond its first."""


class ViolationSpans(NamedTuple):
    """Stretches of samples on which a limit is broken, arrays (k,).

    [s0, s1] [m] and [t0, t1] [s] are where they lie, `factor` is the part of its speed the motion may keep.
    """

    s0: Array
    s1: Array
    t0: Array
    t1: Array
    factor: Array

    def where(self, which: BoolArray) -> ViolationSpans:
        """Return some of the stretches."""
        return ViolationSpans(*(part[which] for part in self))


def find_violations(track: Track, limits: AxisLimits, motion: MotionLaw) -> ViolationSpans:
    """Sample a motion at the period of the limits and find where it breaks one of them."""
    t = row_times(motion, limits.period)
    parts = [
        _look(track, limits, motion, t[first : first + _ROWS + _REACH])
        for first in range(0, max(t.size - _REACH, 1), _ROWS)
    ]
    return ViolationSpans(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _look(track: Track, limits: AxisLimits, motion: MotionLaw, t: Array) -> ViolationSpans:
    s, feed = motion.place_and_feed(t)
    position = track.derivatives(*track.locate(s), 0)[0]
    noise = rounding(float(np.abs(position).max()), track.length, motion.end, float(np.abs(feed).max()))
    before = bool(motion.begins_at_rest and t[0] == 0.0)
    after = bool(motion.ends_at_rest and t[-1] >= motion.end)
    factor = slower_by(at_rest_before_and_after(position, before, after), limits, noise)
    stretch = runs(np.flatnonzero(factor < 1.0))
    shift = _REACH if before else 0
    edges = np.array([(run[0], run[-1] + _REACH) for run in stretch], dtype=np.int64).reshape(-1, 2)
    i, j = np.clip(edges - shift, 0, t.size - 1).T
    worst = np.array([factor[run].min() for run in stretch])
    return ViolationSpans(np.minimum(s[i], s[j]), np.maximum(s[i], s[j]), t[i], t[j], worst)


def slower_by(position: Array, limits: AxisLimits, noise: float) -> Array:
    """Part of its speed (rows,) that the motion may keep where a difference begins, 1 where all is well."""
    factor = np.ones(len(position))
    powers = np.array([limits.period**order for order in (1, 2, 3)])
    allowed = np.stack([_allowed(limits, order, noise) for order in (1, 2, 3)])
    for order, ratio in enumerate(_ratios(read_only(position), powers, allowed), start=1):
        fast = np.flatnonzero(ratio > 1.0)
        factor[fast] = np.minimum(factor[fast], ratio[fast] ** (-1.0 / order))
    return factor


@compiled
def _ratios(position: Any, powers: Any, allowed: Any) -> Any:
    """Return what the axes do over what they may, the most of all axes, by the order of the difference (3, rows).

    `powers` (3,) are those of the period, `allowed` (3, dim) the limits; 0 where there are no samples for a difference.
    """
    rows, axes = position.shape
    found = np.zeros((3, rows))
    for axis in range(axes):
        for i in range(rows - 1):
            first = position[i + 1, axis] - position[i, axis]
            found[0, i] = max(found[0, i], abs(first / powers[0]) / allowed[0, axis])
            if i < rows - 2:
                next_first = position[i + 2, axis] - position[i + 1, axis]
                second = next_first - first
                found[1, i] = max(found[1, i], abs(second / powers[1]) / allowed[1, axis])
                if i < rows - 3:
                    third = (position[i + 3, axis] - position[i + 2, axis]) - next_first - second
                    found[2, i] = max(found[2, i], abs(third / powers[2]) / allowed[2, axis])
    return found
