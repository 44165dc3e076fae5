"""The equations of one axis by mode: engaged or in the gap, table moving or at rest.

Everything is in units of the table (m = r θ_m / N) and of following error (force over k_p k_a k_t N / r).
With J_m = η J, B_m = β J_m and Eq. (9) the two bodies of section 3.3 are

    motor   η b (ẇ + β w) = u - q - T
    table   (1 - η) b v̇ + (c - η β b) v = T - g

with the controller's output u = e + (k_i/k_p) ∫e + (k_d/k_p) ė, friction and load g, cogging q, and the force
T between them; below, u is u - q. Their sum is Eq. (8); T = 0 is the gap, Eq. (16). While they touch and move
with v, T = (1 - η) u + η (c - β b) v + η g; while both are held at rest, T = u.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from .reference_drive import JUMP, TINY, Drive, Engaged, Mode, Ramp, watch

Pairs = list[tuple[Any, tuple[str, int]]]
"""Event functions, and what to do where they strike."""


class LoadAxis:
    """The loop closes over the table, the gap lies inside. States: x, v, m, w, ∫e.

    `touch` is the flank in contact; `way` is the direction in which the table moves, 0 while it is held.
    """

    def __init__(self, drive: Drive, position: float, speed: float, flank: int) -> None:
        self.drive = drive
        self.ramp = Ramp(0.0, 0.0, 0.0)
        self.limit = 0  # side on which the motor gives all it can
        self.rigid = (drive.gap == 0.0 and not drive.wider) or drive.rule == "once"
        self.touch, self.left = Engaged(flank), Engaged(flank)
        self.way = int(np.sign(speed))
        self.opening = drive.opening if drive.rule == "once" else math.inf
        motor = position + (0.0 if self.rigid else flank * self.half(position))
        self.y = np.array([position, speed, motor, speed, 0.0])

    def half(self, x: float) -> float:
        return self.drive.gap if self.drive.rule == "once" else self.drive.half(x)

    def places(self) -> tuple[float, float]:
        if self.touch and self.drive.wider:
            self.y[2] = self.y[0] + self.touch * self.half(self.y[0])
        return float(self.y[0]), float(self.y[2])

    def wanted(self, t: float, y: NDArray[np.float64]) -> float:
        """The controller's output before the motor limits it."""
        d = self.drive
        return self.ramp.at(t) - y[0] + d.ki * y[4] + d.kd * (self.ramp.slope - y[1])

    def output(self, t: float, y: NDArray[np.float64]) -> float:
        given = min(max(self.wanted(t, y), -self.drive.saturation), self.drive.saturation)
        return given - self.drive.cogging(y[2])

    def rate(self, t: float, y: NDArray[np.float64]) -> list[float]:
        x, v, _, w, _ = y.tolist()
        d = self.drive
        e, u = self.ramp.at(t) - x, self.output(t, y)
        g = self.drive.resistance(self.way, v) if self.way else 0.0
        if self.touch:
            a = (u - d.c * v - g) / d.b if self.way else 0.0
            return [v, a, v, a, e]
        a = -((d.c - d.eta * d.beta * d.b) * v + g) / ((1.0 - d.eta) * d.b) if self.way else 0.0
        return [v, a, w, u / (d.eta * d.b) - d.beta * w, e]

    def contact(self, t: float, y: NDArray[np.float64], way: int) -> float:
        """The force T that the motor would exert on the table in motion."""
        d = self.drive
        g = d.resistance(way, y[1])
        return (1.0 - d.eta) * self.output(t, y) + d.eta * ((d.c - d.beta * d.b) * y[1] + g)

    def mode(self, t: float) -> Mode:
        """Event functions of the present mode."""
        pairs: Pairs = []
        if math.isfinite(self.opening):
            pairs.append((watch(lambda t, y: t - self.opening, 1), ("by hand", 0)))
        if self.way:
            pairs.append((watch(lambda t, y: self.way * y[1] + TINY, -1), ("stops", 0)))
        if not self.touch:
            pairs += [(watch(lambda t, y, s=s: self._beyond(y, s), 1), ("meets", s)) for s in (1, -1)]
        elif self.way:
            if self._may_part():
                pull = watch(lambda t, y: self.touch * self.contact(t, y, self.way) + TINY, -1)
                pairs.append((pull, ("parts", 0)))
        else:
            pairs += self._held_events()
        pairs += self._limits(t)
        return Mode([pair[0] for pair in pairs], [pair[1] for pair in pairs])

    def _beyond(self, y: NDArray[np.float64], side: int) -> float:
        return side * (y[2] - y[0]) - self.half(y[0]) - TINY

    def _may_part(self) -> bool:
        """Whether a vanishing contact force opens the gap (else the motor's reversal does)."""
        return not self.rigid and (self.drive.rule == "contact" or self.way != self.touch)

    def _held_events(self) -> Pairs:
        pairs: Pairs = [(watch(lambda t, y, s=s: self._push(t, y, s) - TINY, 1), ("slips", s)) for s in (1, -1)]
        if not self.rigid:
            pairs.append((watch(lambda t, y: self.touch * self.output(t, y) + TINY, -1), ("leaves", 0)))
        return pairs

    def _push(self, t: float, y: NDArray[np.float64], way: int) -> float:
        """What is left to move both in a direction from rest."""
        return way * (self.output(t, y) - self.drive.load) - self.drive.held(way)

    def _limits(self, t: float) -> Pairs:
        """Kinks of the limited output, where the integration is to restart: into the limit and out of it."""
        limit, now = self.drive.saturation, self.wanted(t, self.y)
        if math.isinf(limit):
            return []
        if abs(abs(now) - limit) > JUMP:  # else the last event has said on which side of it we are
            self.limit = 0 if abs(now) < limit else int(math.copysign(1.0, now))
        if not self.limit:
            return [(watch(lambda t, y, s=s: s * self.wanted(t, y) - limit - TINY, 1), ("limit", s)) for s in (1, -1)]
        side = self.limit
        return [(watch(lambda t, y: side * self.wanted(t, y) - limit + TINY, -1), ("limit", 0))]

    def begin(self, ramp: Ramp) -> list[str]:
        """Take a new piece of the command; a jump of its slope may move what kd holds."""
        self.ramp = ramp
        if not self.touch:
            return []
        if not self.way:
            return [kind for kind in self._from_rest(ramp.t) if kind != "sticks"]
        if self._may_part() and self.touch * self.contact(ramp.t, self.y, self.way) < -TINY:
            return self._part()
        return []

    def strike(self, mode: Mode, number: int, t: float) -> list[str]:
        """Enter the mode after an event; what happened."""
        action, side = mode.actions[number]
        said: list[str] = []
        match action:
            case "stops":
                said = self._stop(t)
            case "meets":
                said = self._meet(t, side)
            case "parts":
                said = self._part()
            case "leaves":
                said = self._from_rest(t)
            case "slips":
                said = self._slip(t, side)
            case "by hand":
                said = self._open_by_hand()
            case "limit":
                self.limit = side
        return said

    def _slip(self, t: float, side: int) -> list[str]:
        """Both move off together, unless it is the motor alone that does."""
        self.way = side
        if self._may_part() and self.touch * self.contact(t, self.y, side) < 0.0:
            self.way = 0
            return self._part()
        return ["slips"] if self.drive.held(side) > 0.0 else []

    def _stop(self, t: float) -> list[str]:
        """The table comes to rest; engaged, the motor does too."""
        self.y[1], self.way = 0.0, 0
        if self.touch:
            self.y[3] = 0.0
            return self._from_rest(t)
        self.way = self._alone()
        return [] if self.way or not self.drive.held(1) else ["sticks"]

    def _alone(self) -> int:
        """Direction in which the table in the gap starts from rest: the load's, where friction lets it."""
        d = self.drive
        return next((s for s in (1, -1) if -s * d.load > d.held(s)), 0)

    def _from_rest(self, t: float) -> list[str]:
        """Both at rest on a flank: they move together, or the motor leaves, or friction holds the table.

        A motor that gives way leaves a table that is held, or that its load moves slower than the motor.
        """
        sigma = int(self.touch)
        forward = next((s for s in (1, -1) if self._push(t, self.y, s) > TINY), 0)
        follows = forward == self._alone() == -sigma and sigma * self.contact(t, self.y, forward) >= 0.0
        gives_way = sigma * self.output(t, self.y) < -0.5 * TINY
        if not self.rigid and gives_way and not follows:
            return self._part()
        self.way = forward
        if forward and self._may_part() and sigma * self.contact(t, self.y, forward) < -TINY:
            return self._part()
        return ["sticks"] if not forward and self.drive.held(1) > 0.0 else []

    def _part(self) -> list[str]:
        self.places()
        self.left, self.touch = self.touch, Engaged.NONE
        if self.y[1] == 0.0:
            self.way = self._alone()
        return ["opens"]

    def _open_by_hand(self) -> list[str]:
        """The paper's x axis at t = 0: it stands, and the motor starts from rest in the middle of 2 gaps."""
        self.touch, self.way, self.opening = Engaged.NONE, 0, math.inf
        self.y[1] = self.y[3] = 0.0
        self.y[2] = self.y[0]
        return ["opens"]

    def _meet(self, t: float, side: int) -> list[str]:
        """The motor reaches a flank."""
        d = self.drive
        x, v, _, w, _ = self.y.tolist()
        plastic = d.rule in {"momentum", "contact"}
        together = v + d.kept * d.eta * (w - v) if plastic else 0.0
        self.y[1] = self.y[3] = together
        self.y[2] = x if self.rigid else x + side * self.half(x)
        self.touch = Engaged(side)
        self.way = int(np.sign(together))
        met = ["falls back" if side == self.left and not self.rigid else "picks up"]
        if not self.way:
            return met + self._from_rest(t)
        if self._may_part() and self.touch * self.contact(t, self.y, self.way) < 0.0:
            return met + self._part()
        return met


class MotorAxis:
    """The loop closes over the motor or not at all, the gap lies outside: a play behind a rigid axis.

    The motor obeys b m̈ + c ṁ = u - g whatever the table does (friction is the motor's). The table stands
    while the motor is between the flanks, unless a load that friction does not hold keeps it on one of them.
    """

    def __init__(self, drive: Drive, position: float, speed: float, flank: int) -> None:
        self.motor = LoadAxis(replace(drive, gap=0.0, wider=None), position, speed, flank)
        self.half = drive.half
        self.open = drive.gap > 0.0 or drive.wider is not None
        # A load towards minus leaves the table on the flank that pushes towards plus.
        self.hung = next((s for s in (1, -1) if s * drive.load > drive.held(-s)), 0)
        self.touch = self.left = Engaged(self.hung or flank)
        self.x = position
        self.places()

    @property
    def y(self) -> NDArray[np.float64]:
        """m, ṁ, and ∫e; the axis' own motor is the same as m."""
        return self.motor.y

    @y.setter
    def y(self, state: NDArray[np.float64]) -> None:
        self.motor.y = state

    def places(self) -> tuple[float, float]:
        if self.touch:
            m, most = float(self.y[0]), 1.0
            self.x = brentq(lambda x: x + self.touch * self.half(x) - m, m - most, m + most, xtol=1e-16)
        return self.x, float(self.y[0])

    def rate(self, t: float, y: NDArray[np.float64]) -> list[float]:
        return self.motor.rate(t, y)

    def mode(self, t: float) -> Mode:
        mode = self.motor.mode(t)
        if not self.touch:
            for side in (1, -1):
                beyond = watch(lambda t, y, s=side: s * (y[0] - self.x) - self.half(self.x) - TINY, 1)
                mode.functions.append(beyond)
                mode.actions.append(("meets", side))
        return mode

    def begin(self, ramp: Ramp) -> list[str]:
        return self.motor.begin(ramp) + self._turned()

    def strike(self, mode: Mode, number: int, t: float) -> list[str]:
        action, side = mode.actions[number]
        if action == "meets":
            self.touch = Engaged(side)
            return ["falls back" if side == self.left else "picks up"]
        self.places()
        return self.motor.strike(mode, number, t) + self._turned()

    def _turned(self) -> list[str]:
        """Open the gap where the motor now moves away from its flank."""
        if self.hung or not self.open or not self.touch or self.motor.way != -self.touch:
            return []
        self.left, self.touch = self.touch, Engaged.NONE
        return ["opens"]
