"""What an axis does: its equations of motion, mode by mode, from event to event.

Sources: Eqs. (8), (14) to (16) of the paper for the loop that is closed over the table; for dry friction the
textbook's stick and slip; for a gap behind the loop the play operator; for windup two masses on a spring, or
a mass on a spring whose foot is moved.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import brentq

from tests.support.ideal_play import dragged
from tests.support.linear_response import response
from tests.support.plants.axis import Forces, Plant
from tests.support.plants.compiled import CROSS, SLIP, Axis, CascadeBody, Mode, numbers, run_leg
from tests.support.plants.stepping import Floats, solve
from tests.support.plants.tracks import Track

PERIOD = 1e-3
FINER = 5
"""Samples a period where a play follows: the turning points of its foot are met to a v dt / 8, some 15 nm."""

EDGE = 1e-12
"""[m of following error] by which a threshold must be passed: what rests exactly on one stays."""

MANY = 20000
"""Events in a record; more is a mistake."""


@dataclass(frozen=True)
class Motion:
    """What an axis did, a row a millisecond: places [m], velocity at the loop's side, the force F/K [m].

    `events` are (time, kind) with kind "open", "pickup", "back", "stick" and "slip".
    """

    t: Floats
    command: Floats
    table: Floats
    motor: Floats
    velocity: Floats
    drive: Floats
    events: tuple[tuple[float, str], ...] = ()

    def times(self, kind: str) -> list[float]:
        return [t for t, name in self.events if name == kind]


def follow(plant: Plant, track: Track, axis: int = 0) -> Motion:
    """Let an axis follow its command from rest to the end of the track."""
    n = round(track.end / PERIOD)
    forces = Forces(plant, track, axis)
    windup = plant.effect("elastic_windup")
    if plant.feedback != "load":
        return _behind(plant, forces, n, windup)
    if windup is not None:
        return _two_masses(plant, forces, n, windup["resonance"], windup["damping_ratio"])
    body = _body(plant, forces, np.arange(n + 1) * PERIOD)
    body.run()
    return body.motion(body.rows)


def _body(plant: Plant, forces: Forces, grid: Floats) -> _Body | _InCascade:
    return _Body(plant, forces, grid) if plant.drive is None else _InCascade(plant, forces, grid)


class _Body:
    """An axis that is one body while engaged: rest, slip and, with a gap inside the loop, its crossing."""

    def __init__(self, plant: Plant, forces: Forces, grid: Floats) -> None:
        self.plant, self.forces, self.grid, self.end = plant, forces, grid, float(grid[-1])
        self.inside = plant.feedback == "load" and (
            plant.gap > 0.0 or plant.effect("position_dependent_backlash") is not None
        )
        self.rows = np.empty((len(grid), 3))  # table or loop's side, velocity, motor
        self.t, self.x, self.v, self.w, self.side = 0.0, 0.0, 0.0, 0.0, plant.flank
        self._settle()
        self.events: list[tuple[float, str]] = []

    def _settle(self) -> None:
        """Begin where constant forces let the axis rest; inside a gap on the flank that they push it to."""
        for _ in range(60):
            force = self.forces.rigid(0.0, self.x, 0.0) + self.forces.cogged(self._touching(self.x))
            self.x = -math.copysign(max(abs(force) - self.forces.held, 0.0), force)
        if self.inside and self.x:
            self.side = -int(math.copysign(1, self.x))

    def _touching(self, x: float) -> float:
        return x + 0.5 * self.side * self.plant.width(x) if self.inside else x

    def motion(self, rows: Floats, every: int = 1) -> Motion:
        """Rows at the loop's side, of so many one, as a motion whose table is that side."""
        rows, grid = rows[::every], self.grid[::every]
        X = np.array([self.forces.command(t) for t in grid.tolist()])
        drive = np.clip(X - rows[:, 0], -self.forces.limit, self.forces.limit)
        drive -= self.plant.electronic * rows[:, 1]
        if self.forces.late:
            X = np.array([self.forces.asked(t) for t in grid.tolist()])
        return Motion(grid, X, rows[:, 0], rows[:, 2], rows[:, 1], drive, tuple(self.events))

    def run(self) -> None:
        if not self.inside and not self.forces.held:
            self._slip(0)
            return
        mode: Callable[[], Callable[[], Any] | None] = self._rest
        for _ in range(MANY):
            following = mode()
            if following is None:
                return
            mode = following
        raise RuntimeError(f"more than {MANY} events by {self.t} s")

    def _span(self, until: float) -> slice:
        low = int(np.searchsorted(self.grid, self.t - 1e-12))
        return slice(low, int(np.searchsorted(self.grid, until, side="right")))

    def _pushes(self, t: float) -> tuple[float, float]:
        """At rest: what the motor pushes with, and what is left of it on the table."""
        push = self.forces.drive(self.forces.command(t) - self.x) - self.forces.cogged(self._touching(self.x))
        return push, push - self.forces.rigid(t, self.x, 0.0)

    def _leaves(self, t: float) -> float:
        """Positive where rest ends; which way it ends is found afterwards."""
        push, net = self._pushes(t)
        if not self.inside:
            return abs(net) - self.forces.held - EDGE
        return max(-self.side * push - EDGE, self.side * net - self.forces.held - EDGE)

    def _rest(self) -> Any:
        begin, step = self.t, 2e-4
        t = begin
        while self._leaves(t) <= 0.0:
            if t >= self.end:
                self.rows[self._span(self.end)] = (self.x, 0.0, self._touching(self.x))
                return None
            ahead = min(t + step, self.end)
            if self._leaves(ahead) > 0.0:
                ahead = brentq(self._leaves, t, ahead, xtol=1e-13)
                while self._leaves(ahead) <= 0.0:
                    ahead += 1e-12
            t = ahead
        self.rows[self._span(t)] = (self.x, 0.0, self._touching(self.x))
        self.t, self.v = t, 0.0
        push, net = self._pushes(t)
        if self.inside and self.side * push < 0.0:
            self.events.append((t, "open"))
            return self._cross
        self.events.append((t, "slip"))
        way = self.side if self.inside else int(math.copysign(1, net))
        return lambda: self._slip(way)

    def _slip(self, way: int) -> Any:
        rows, until, y, which = self._advance(Mode(SLIP, self.side, way, self.x, 0.0), (self.x, self.v))
        span = self._filled
        self.rows[span, 0], self.rows[span, 1] = rows[:, 0], rows[:, 1]
        self.rows[span, 2] = [self._touching(x) for x in rows[:, 0].tolist()]
        self.t, self.x, self.v = until, y[0], y[1]
        if which < 0:
            return None
        self.v = 0.0
        self.events.append((until, "stick"))
        return self._rest

    def _advance(self, mode: Mode, y: tuple[float, float]) -> Any:
        span = self._span(self.end)
        grid = np.maximum(self.grid[span], self.t)
        rows = np.empty((len(grid), 2))
        count, until, state, which = run_leg(self._numbers, mode, self.t, y, grid, rows)
        self._filled = slice(span.start, span.start + count)
        return rows[:count], until, state, which

    @cached_property
    def _numbers(self) -> Axis:
        return numbers(self.plant, self.forces, self.end)

    def _cross(self) -> Any:
        """The motor alone, Eq. (16): η b (m̈ + β ṁ) = X - x, until it meets a flank.

        The state is its way from the flank that it leaves, whose beginning would be lost beside its place.
        """
        plant, x, side, gap = self.plant, self.x, self.side, self.plant.width(self.x)
        left = x + 0.5 * side * gap
        rows, until, y, which = self._advance(Mode(CROSS, side, 0, x, left), (0.0, 0.0))
        span = self._filled
        self.rows[span, 0], self.rows[span, 1], self.rows[span, 2] = x, 0.0, left + rows[:, 0]
        self.t, self.w = until, y[1]
        if which < 0:
            return None
        self.side = -side if which == 0 else side
        self.events.append((until, "pickup" if which == 0 else "back"))
        self.v = plant.kept * plant.eta * self.w
        way = self.side
        if self.v * way > 1e-9:
            return lambda: self._slip(way)
        self.v = 0.0
        return self._rest


class _InCascade(CascadeBody):
    """The same of an axis in a cascade."""

    def motion(self, rows: Floats, every: int = 1) -> Motion:
        rows, grid = rows[::every], self.grid[::every]
        X = self.forces.track.rows(self.forces.axis, grid)[0]
        return Motion(grid, X, rows[:, 0], rows[:, 2], rows[:, 1], rows[:, 3], tuple(self.events))


def _behind(plant: Plant, forces: Forces, n: int, windup: Any) -> Motion:
    """The loop over the motor, or none: the gap and the spring follow behind."""
    grid = np.arange(n * FINER + 1) * (PERIOD / FINER)
    body = _body(plant, forces, grid)
    if plant.b > 0.0:
        body.run()
    else:
        body.rows[:, 0] = [forces.command(t) for t in grid.tolist()]
        body.rows[:, 1] = np.gradient(body.rows[:, 0], grid)
    motor = body.rows[:, 0]
    table = _play(plant, motor)
    if windup is not None:
        table = _swing(grid, table, windup["resonance"], windup["damping_ratio"])
    whole = body.motion(body.rows, FINER)
    return replace(whole, table=table[::FINER], motor=motor[::FINER])


def _play(plant: Plant, motor: Floats) -> Floats:
    """The play operator: the table stands where it was last pushed to."""
    x = float(motor[0]) - 0.5 * plant.flank * plant.width(0.0)
    if plant.effect("position_dependent_backlash") is None:
        return dragged(motor, 0.5 * plant.gap, x) if plant.gap else motor
    table = np.empty_like(motor)
    for i, m in enumerate(motor.tolist()):
        half = 0.5 * plant.width(x)
        x = min(max(x, m - half), m + half)
        table[i] = x
    return table


def _swing(t: Floats, foot: Floats, resonance: float, damping: float) -> Floats:
    """A mass on a spring and damper whose foot is moved: ẍ + 2ζω (ẋ - ṗ) + ω² (x - p) = 0, ω in rad/s.

    The foot is taken as straight between samples: its acceleration times dt²/12, some 3 nm, is left out.
    """
    system = ([2.0 * damping * resonance, resonance**2], [1.0, 2.0 * damping * resonance, resonance**2])
    return response(system, foot - foot[0], t) + foot[0]


def _two_masses(plant: Plant, forces: Forces, n: int, resonance: float, damping: float) -> Motion:
    """Motor and table on a spring, the loop over the table, no gap; ω [rad/s] against the locked motor."""
    if plant.gap > 0.0 or forces.held:
        raise NotImplementedError("two masses with a gap or dry friction")
    light, heavy = plant.eta * plant.b, (1.0 - plant.eta) * plant.b
    own, other = light * plant.beta, plant.c - light * plant.beta
    spring, damper = heavy * resonance**2, heavy * 2.0 * damping * resonance

    def rhs(t: float, y: Floats) -> tuple[float, ...]:
        m, w, x, v = y.tolist()
        link = spring * (m - x) + damper * (w - v)
        push = forces.drive(forces.command(t) - x) - own * w - link - forces.cogged(m)
        return w, push / light, v, (link - other * v - forces.rigid(t, x, v)) / heavy

    grid = np.arange(n + 1) * PERIOD
    body = _Body(plant, forces, grid)
    load = forces.rigid(0.0, body.x, 0.0)
    rows = solve(rhs, (body.x + load / spring, 0.0, body.x, 0.0), grid)
    return body.motion(np.column_stack([rows[:, 2], rows[:, 3], rows[:, 0]]))
