"""The room that test programs may use, and how fast a machine may go there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations
from typing import Final

import msgspec

from ph_post.types import Machine
from ph_post.units import MM

ARC_SHARE: Final = 0.5
"""Share of an axis' acceleration that v²/r may take: controllers keep part of it for the ends of an arc."""

TOP_SHARE: Final = 0.8
"""Share of the greatest speed that programs use where a person names no feeds: drives need some in hand."""

CRAWL: Final = 0.2 * MM
"""Slowest feed [m/s] of the programs, where friction falls with speed if it does so anywhere."""


class Ground(msgspec.Struct, frozen=True, kw_only=True):
    """Where test programs move, and how fast. SI units.

    `spans` is the room of each axis [m], in the order X, Y, Z; nothing else is moved. `radius` [m] is that of
    the circles, `feeds` [m/s] rise. `settle` [s] is how long an axis is given to come to rest.
    """

    machine: Machine
    spans: Mapping[str, tuple[float, float]]
    radius: float
    feeds: tuple[float, ...]
    settle: float

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that are moved."""
        return tuple(self.spans)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Every two of them."""
        return tuple(combinations(self.axes, 2))

    def centre(self, axis: str) -> float:
        """Middle of an axis' room [m]."""
        low, high = self.spans[axis]
        return 0.5 * (low + high)

    def half(self, axis: str) -> float:
        """How far an axis may go to either side of it [m]."""
        low, high = self.spans[axis]
        return 0.5 * (high - low)

    def top(self, *axes: str) -> float:
        """Greatest speed of the slowest of these axes [m/s]."""
        return top_speed(self.machine, axes)

    def slow(self, axis: str, seconds: float) -> float:
        """Feed [m/s] that takes so long from end to end of an axis, within its limits."""
        return min(2.0 * self.half(axis) / seconds, TOP_SHARE * self.top(axis))


def top_speed(machine: Machine, axes: tuple[str, ...]) -> float:
    """Greatest speed [m/s] that each of these axes has."""
    return min(machine.axes[axis].limits.velocity for axis in axes)


def arc_speed(machine: Machine, axes: tuple[str, ...], radius: float, share: float = ARC_SHARE) -> float:
    """Greatest speed [m/s] around a circle of `radius` [m], within speed, acceleration and jerk of its axes.

    The acceleration is v²/r and the jerk v³/r² on either axis, of which `share` of the limits is used.
    """
    limits = [machine.axes[axis].limits for axis in axes]
    acceleration = share * min(one.acceleration for one in limits)
    jerk = share * min(one.jerk for one in limits)
    return min(top_speed(machine, axes), math.sqrt(acceleration * radius), math.cbrt(jerk * radius * radius))


def settling_time(machine: Machine, axes: tuple[str, ...]) -> float:
    """How long axes are given to come to rest [s]: ten times c, their time constant, at least 0.3."""
    return max(0.3, *(10.0 * machine.axes[axis].servo.c for axis in axes))
