"""How an axis moves by its linear drive: what a residual is laid against."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from ph_post.diagnose.response import linear_response
from ph_post.types import Array, BoolArray, IntArray, Log, Machine

RESTING: Final = 1e-3
"""Speeds below this part of the largest one are rest: they have no direction of their own."""


class Motion(NamedTuple):
    """The motion of one axis, all of shape (n,).

    `t` [s], `position` [m], `velocity` [m/s] and `acceleration` [m/s²] are those of the linear drive.
    `direction` is the last one it moved in (0 before it first moves); `since` [s] and `travel` [m] are what
    went by since it last reversed, `until` [s] and `left` [m] are what is left to the next reversal, infinite
    where there is none; `stroke` counts reversals. `others` are the positions of the other axes [m] by name,
    `path_speed` [m/s] that of all axes together. `turn` is 1 counterclockwise in the plane of this axis and
    the other that moves most, -1 clockwise, 0 where the path does not bend.
    """

    t: Array
    position: Array
    velocity: Array
    acceleration: Array
    direction: IntArray
    since: Array
    travel: Array
    until: Array
    left: Array
    stroke: IntArray
    others: dict[str, Array]
    path_speed: Array
    turn: IntArray


def motion_of(log: Log, machine: Machine, name: str) -> Motion:
    """Lay out the motion of an axis and what goes with it."""
    position = {axis: _position(log, machine, axis) for axis in log.axes}
    velocity = {axis: np.gradient(values, log.period) for axis, values in position.items()}
    acceleration = np.gradient(velocity[name], log.period)
    direction = directions(velocity[name])
    since, travel, until, left, stroke = _strokes(position[name], direction, log.period)
    square = np.zeros(log.t.size)
    for values in velocity.values():
        square += values**2
    return Motion(
        t=log.t, position=position[name], velocity=velocity[name], acceleration=acceleration,
        direction=direction, since=since, travel=travel, until=until, left=left, stroke=stroke,
        others={axis: values for axis, values in position.items() if axis != name},
        path_speed=np.sqrt(square), turn=_turn(velocity, name, log.period),
    )  # fmt: skip


def directions(velocity: Array) -> IntArray:
    """Direction of motion, 1 or -1; at rest the last one, 0 before the first motion; shape (n,)."""
    largest = float(np.max(np.abs(velocity)))
    sign = np.where(np.abs(velocity) > RESTING * largest, np.sign(velocity), 0.0).astype(np.int64)
    last = np.maximum.accumulate(np.where(sign != 0, np.arange(sign.size), -1))
    return np.where(last >= 0, sign[last], 0)


def _position(log: Log, machine: Machine, name: str) -> Array:
    """Return where the linear drive of an axis is [m], (n,)."""
    command, drive = log.axes[name].command, machine.axes.get(name)
    return command if drive is None else linear_response(command, drive.servo, log.period)


def _strokes(
    position: Array, direction: IntArray, period: float
) -> tuple[Array, Array, Array, Array, IntArray]:
    """Time and travel since the last reversal, both to the next, number of reversals before; each (n,)."""
    rows = np.arange(position.size)
    turned = np.concatenate(([False], (np.diff(direction) != 0) & (direction[:-1] != 0)))
    stroke = np.cumsum(turned)
    at = np.flatnonzero(turned)
    begin = np.concatenate(([0], at))[stroke]
    end = np.concatenate((at, [position.size]))[stroke]
    since = np.where(stroke > 0, (rows - begin) * period, np.inf)
    travel = np.where(stroke > 0, np.abs(position - position[begin]), np.inf)
    until = np.where(end < position.size, (end - rows) * period, np.inf)
    left = np.where(end < position.size, np.abs(position[end - 1] - position), np.inf)
    return since, travel, until, left, stroke


def _turn(velocity: dict[str, Array], name: str, period: float) -> IntArray:
    """Tell which way the path bends in the plane of this axis and the other that moves most, by name."""
    others = {axis: float(np.ptp(values)) for axis, values in velocity.items() if axis != name}
    still = np.zeros(velocity[name].size, dtype=np.int64)
    if not others or max(others.values()) == 0.0:
        return still
    other = max(others, key=lambda axis: others[axis])
    first, second = sorted((name, other))
    u, v = velocity[first], velocity[second]
    bend = u * np.gradient(v, period) - v * np.gradient(u, period)
    speed = np.hypot(u, v)
    bent = np.abs(bend) > 1e-3 * float(np.max(np.abs(bend)))
    return np.where(bent & (speed > RESTING * np.max(speed)), np.sign(bend), 0.0).astype(np.int64)


def halves(motion: Motion) -> BoolArray:
    """Split a record into two halves that both see all of the motion: strokes by pairs, or pieces of time."""
    if motion.stroke[-1] >= 7:
        return np.asarray(motion.stroke // 2 % 2 == 0)
    return np.asarray(np.arange(motion.t.size) * 24 // motion.t.size % 2 == 0)
