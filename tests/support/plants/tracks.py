"""Commands in closed form, with continuous jerk: straight moves, circles and rests, one after the other."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Number = TypeVar("Number", float, Floats)


def _ramp(u: Number) -> Number:
    """Speed while speeding up, u from 0 to 1: the smoothstep with two derivatives 0 at both ends."""
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


def _ramped(u: Number) -> Number:
    """Way while speeding up, ½ at u = 1: the integral of the ramp."""
    return u * u * u * u * (2.5 + u * (u - 3.0))


def _push(u: Number) -> Number:
    """Slope of the ramp."""
    return 30.0 * u * u * (1.0 - u) ** 2


@dataclass(frozen=True)
class Stretch:
    """A piece of the command: a way from 0 to `way` at `rate`, ramped over `ramp` [s] at both ends.

    On a line the way is metres along `direction`; on a circle radians from `start` about a centre.
    """

    ramp: float
    rate: float
    way: float
    origin: tuple[float, float]
    direction: tuple[float, float] | None = None
    radius: float = 0.0
    start: float = 0.0

    @cached_property
    def duration(self) -> float:
        return self.way / self.rate + self.ramp if self.rate else self.ramp

    def gone(self, tau: float) -> float:
        """Way at tau [s] since the stretch began, alone."""
        if not self.rate:
            return 0.0
        ramp, left = self.ramp, self.duration - tau
        if tau < ramp:
            return self.rate * ramp * _ramped(tau / ramp)
        if left < ramp:
            return self.way - self.rate * ramp * _ramped(max(left / ramp, 0.0))
        return self.rate * (tau - 0.5 * ramp)

    def phase(self, tau: float) -> tuple[float, float, float]:
        """Way, its rate and its acceleration at tau [s] since the stretch began."""
        if not self.rate:
            return 0.0, 0.0, 0.0
        ramp, left = self.ramp, self.duration - tau
        if tau < ramp:
            u = tau / ramp
            return self.rate * ramp * _ramped(u), self.rate * _ramp(u), self.rate / ramp * _push(u)
        if left < ramp:
            u = max(left / ramp, 0.0)
            return (
                self.way - self.rate * ramp * _ramped(u),
                self.rate * _ramp(u),
                -self.rate / ramp * _push(u),
            )
        return self.rate * (tau - 0.5 * ramp), self.rate, 0.0

    def rows(self, axis: int, tau: Floats) -> tuple[Floats, Floats, Floats]:
        """Place, velocity and acceleration at many times tau (n,) [s]."""
        ramp, left = self.ramp, self.duration - tau
        way, rate, gain = np.zeros((3, len(tau)))
        if self.rate:
            ending = (tau >= ramp) & (left < ramp)
            u = np.clip(np.where(ending, left, tau) / ramp, 0.0, 1.0)
            way, rate, gain = self.rate * ramp * _ramped(u), self.rate * _ramp(u), self.rate / ramp * _push(u)
            way, gain = np.where(ending, self.way - way, way), np.where(ending, -gain, gain)
            steady = (tau >= ramp) & ~ending
            way[steady], rate[steady], gain[steady] = self.rate * (tau[steady] - 0.5 * ramp), self.rate, 0.0
        if self.direction is not None:
            along = self.direction[axis]
            return self.origin[axis] + along * way, along * rate, along * gain
        turned = self.start + way
        at, along = (np.sin(turned), np.cos(turned)) if axis else (np.cos(turned), -np.sin(turned))
        bend = self.radius * (along * gain - at * rate * rate)
        return self.origin[axis] + self.radius * at, self.radius * along * rate, bend

    def place(self, axis: int, tau: float) -> float:
        way = self.gone(tau)
        if self.direction is not None:
            return self.origin[axis] + self.direction[axis] * way
        turned = self.start + way
        return self.origin[axis] + self.radius * (math.sin(turned) if axis else math.cos(turned))

    def motion(self, axis: int, tau: float) -> tuple[float, float]:
        """Velocity and acceleration."""
        way, rate, gain = self.phase(tau)
        if self.direction is not None:
            return self.direction[axis] * rate, self.direction[axis] * gain
        turned = self.start + way
        along = math.cos(turned) if axis else -math.sin(turned)
        inward = -math.sin(turned) if axis else -math.cos(turned)
        return self.radius * along * rate, self.radius * (along * gain + inward * rate * rate)


@dataclass(eq=False)
class Track:
    """Stretches in time, for up to two axes; the command rests before the first and behind the last."""

    place: tuple[float, float] = (0.0, 0.0)
    stretches: list[Stretch] = field(default_factory=list)
    begins: list[float] = field(default_factory=list)
    end: float = 0.0

    def _add(self, stretch: Stretch) -> Track:
        self.stretches.append(stretch)
        self.begins.append(self.end)
        self.end += stretch.duration
        self.place = (stretch.place(0, stretch.duration), stretch.place(1, stretch.duration))
        return self

    def rest(self, duration: float) -> Track:
        return self._add(Stretch(duration, 0.0, 0.0, self.place, (0.0, 0.0)))

    def move(self, by: Sequence[float], speed: float, acceleration: float) -> Track:
        """A straight move; `acceleration` is the mean of a ramp. A short move is as fast as it can be."""
        way = math.hypot(*by)
        speed = min(speed, math.sqrt(way * acceleration))
        direction = (by[0] / way, by[1] / way)
        return self._add(Stretch(speed / acceleration, speed, way, self.place, direction))

    def circle(self, radius: float, speed: float, turns: float, ramp: float, start: float = 0.0) -> Track:
        """Round a circle, `start` [rad] the direction of here from its centre; radius < 0: clockwise."""
        r, rate = abs(radius), speed / abs(radius)
        side = -1.0 if radius < 0.0 else 1.0
        centre = (self.place[0] - r * math.cos(start), self.place[1] - side * r * math.sin(start))
        # A clockwise turn is a mirrored one: its second axis runs the other way.
        stretch = Stretch(ramp, rate, 2.0 * math.pi * turns, centre, None, r, start)
        return self._add(stretch if side > 0.0 else Mirrored(**stretch.__dict__))

    def _locate(self, t: float) -> tuple[Stretch, float]:
        index = bisect_right(self.begins, t) - 1
        if index < 0:
            return self.stretches[0], 0.0
        stretch = self.stretches[index]
        return stretch, min(t - self.begins[index], stretch.duration)

    def command(self, axis: int) -> Callable[[float], float]:
        """The command of an axis as a function of time."""
        begins, stretches, last = self.begins, self.stretches, self.end

        def at(t: float) -> float:
            if t <= 0.0:
                return stretches[0].place(axis, 0.0)
            index = bisect_right(begins, min(t, last)) - 1
            stretch = stretches[index]
            return stretch.place(axis, min(t - begins[index], stretch.duration))

        return at

    def motion(self, axis: int, t: float) -> tuple[float, float]:
        """Velocity and acceleration of the command."""
        stretch, tau = self._locate(t)
        return stretch.motion(axis, tau)

    def rows(self, axis: int, times: Floats) -> tuple[Floats, Floats, Floats]:
        """The command of an axis, its velocity and its acceleration at many times that rise."""
        found = np.empty((3, len(times)))
        cuts = [0, *np.searchsorted(times, self.begins[1:]).tolist(), len(times)]
        for stretch, begin, (low, high) in zip(self.stretches, self.begins, pairwise(cuts), strict=True):
            found[:, low:high] = stretch.rows(axis, np.clip(times[low:high] - begin, 0.0, stretch.duration))
        return found[0], found[1], found[2]

    def feed(self, t: float) -> float:
        """Speed along the path."""
        return math.hypot(self.motion(0, t)[0], self.motion(1, t)[0])


class Mirrored(Stretch):
    """A circle run clockwise."""

    def place(self, axis: int, tau: float) -> float:
        value = super().place(axis, tau)
        return 2.0 * self.origin[1] - value if axis else value

    def motion(self, axis: int, tau: float) -> tuple[float, float]:
        velocity, acceleration = super().motion(axis, tau)
        return (-velocity, -acceleration) if axis else (velocity, acceleration)

    def rows(self, axis: int, tau: Floats) -> tuple[Floats, Floats, Floats]:
        place, velocity, acceleration = super().rows(axis, tau)
        return (2.0 * self.origin[1] - place, -velocity, -acceleration) if axis else (place, velocity, acceleration)
