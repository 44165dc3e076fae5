"""A cascade's axis stepped finely: position loop, velocity loop with integrator, current loop, friction, a gap inside.

Forces are metres of following error as everywhere here: the motor gives (ω_v (n + ∫n / T_n) + a_f Ẍ) / (ω_v K_v) with
n = K_v (X - x) + k_f Ẋ - w, as in Groß, Hamann, Wiegärtner, Elektrische Vorschubantriebe (Publicis 2006), divided by
the inertia. Steps are of the second order and end where the axis sticks, slips, or meets a flank of its gap.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from tests.support.plants.axis import Forces, Plant
from tests.support.plants.stepping import Floats
from tests.support.plants.tracks import Track

STEP = 1e-4
"""[s]."""

FINE = STEP / 2.0
"""What the command is computed at [s]; in between it is taken as straight."""

REST, SLIP, CROSS = "rest", "slip", "cross"


def arrives(forces: Forces, end: float) -> tuple[Floats, Floats, Floats]:
    """The command as it reaches the loops, its speed and its acceleration, a row each FINE."""
    rows = _given(forces.track, forces.axis, forces.late, end)
    of = forces.plant.effect("command_filter")
    if of is not None:
        rows = [_averaged(_smoothed(row, of.get("exponential_filter")), of.get("moving_average")) for row in rows]
    return rows[0], rows[1], rows[2]


@lru_cache(maxsize=4)
def _given(track: Track, axis: int, late: float, end: float) -> list[Floats]:
    """The same before any filter; plants that differ in other things alone have it in common."""
    return list(track.rows(axis, np.arange(math.ceil(end / FINE) + 3) * FINE - late))


def _averaged(row: Floats, length: float) -> Floats:
    """A moving average over so many seconds; before the first row all was as it is there."""
    if not length:
        return row
    t = np.arange(len(row)) * FINE
    whole = cumulative_trapezoid(row - row[0], dx=FINE, initial=0.0)
    return np.asarray(row[0] + (whole - np.interp(t - length, t, whole)) / length)


def _smoothed(row: Floats, time: float) -> Floats:
    """A filter of the first order of what is straight between rows, all but exactly."""
    if not time:
        return row
    kept = math.exp(-FINE / time)
    middle = np.concatenate([row[:1], 0.5 * (row[1:] + row[:-1])]) - row[0]
    return np.asarray(row[0] + lfilter([1.0 - kept], [1.0, -kept], middle))


_State = tuple[float, float, float, float]
"""Place and speed of what moves, what the velocity loop has summed, and the force that the motor gives."""


def _moved(y: _State, by: _State, h: float) -> _State:
    return y[0] + h * by[0], y[1] + h * by[1], y[2] + h * by[2], y[3] + h * by[3]


class CascadeBody:
    """An axis in a cascade from rest to the end of a grid; rows are its place, its speed, the motor, the force."""

    def __init__(self, plant: Plant, forces: Forces, grid: Floats) -> None:
        assert plant.drive is not None
        self.plant, self.forces, self.grid, self.drive = plant, forces, grid, plant.drive
        self.inside = plant.feedback == "load" and (
            plant.gap > 0.0 or plant.effect("position_dependent_backlash") is not None
        )
        self.own = plant.c - 1.0 / self.drive.kv
        self.rows = np.empty((len(grid), 4))
        place, speed, bend = arrives(forces, float(grid[-1]))
        # What the loops make of the command alone: K_v X + k_f Ẋ [m/s], and the force that is fed forward.
        self.wanted: list[float] = (self.drive.kv * place + self.drive.velocity * speed).tolist()
        self.fed: list[float] = (self.drive.acceleration * plant.b * bend).tolist()
        self.events: list[tuple[float, str]] = []
        self.stuck, self.bothered = forces.held > 0.0, bool(forces.parts) or any(forces.drag)
        self.left = 0.0
        self.side, self.way, self.mode = plant.flank, 0, REST if self.stuck or self.inside else SLIP
        load = forces.rigid(0.0, 0.0, 0.0)
        held = self.drive.tn < math.inf
        self.x = 0.0 if held else -math.copysign(max(abs(load) - forces.held, 0.0), load)
        self.y = (self.x, 0.0, load * self.drive.kv * self.drive.tn if held else 0.0, load)
        if self.inside and load:
            self.side = int(math.copysign(1, load))

    def _asked(self, t: float, place: float, speed: float, total: float) -> tuple[float, float]:
        """What the velocity loop is off by [m/s], and the force that it asks for."""
        drive, wanted, fed, row = self.drive, self.wanted, self.fed, t / FINE
        i = int(row)
        k = row - i
        off = wanted[i] + k * (wanted[i + 1] - wanted[i]) - drive.kv * place - speed
        asked = (off + total / drive.tn) / drive.kv + fed[i] + k * (fed[i + 1] - fed[i])
        return off, self.forces.drive(asked)

    def _touching(self, x: float) -> float:
        return x + 0.5 * self.side * self.plant.width(x) if self.inside else x

    def _slopes(self, t: float, y: _State) -> _State:
        """What the state changes by in a second, in the mode that it is in."""
        place, speed, total, given = y
        forces, T, bend = self.forces, self.drive.current, 0.0
        x, table = (self.x, 0.0) if self.mode == CROSS else (place, speed)
        off, asked = self._asked(t, x, speed if self.plant.fast_side == "motor" else table, total)
        force = given if T else asked
        if self.mode == SLIP:
            force -= self.own * speed + self._cogged(x)
            if self.bothered:
                force -= forces.rigid(t, x, speed)
            if self.way and self.stuck:
                force -= self.way * forces.dry(abs(speed))
            bend = force / forces.inertia(t)
        elif self.mode == CROSS:
            bend = (force - forces.cogged(place)) / (self.plant.eta * self.plant.b) - self.plant.beta * speed
        return speed, bend, off, (asked - given) / T if T else 0.0

    def _cogged(self, x: float) -> float:
        return self.forces.cogged(self._touching(x)) if self.forces.teeth else 0.0

    def _stepped(self, t: float, h: float) -> _State:
        """The midpoint rule."""
        one = self._slopes(t, self.y)
        return _moved(self.y, self._slopes(t + 0.5 * h, _moved(self.y, one, 0.5 * h)), h)

    def _pushes(self, t: float) -> tuple[float, float]:
        """At rest: what the motor pushes with, and what of it is left on the table."""
        asked = self._asked(t, self.x, 0.0, self.y[2])[1]
        push = (self.y[3] if self.drive.current else asked) - self._cogged(self.x)
        return push, push - self.forces.rigid(t, self.x, 0.0)

    def _leaves(self, t: float) -> None:
        """End a rest where it ends."""
        push, net = self._pushes(t)
        if self.inside and self.side * push < 0.0:
            self.mode, self.events = CROSS, [*self.events, (t, "open")]
            self.left = self.x + 0.5 * self.side * self.plant.width(self.x)
            self.y = (self.left, 0.0, *self.y[2:])
        elif self.side * net > self.forces.held if self.inside else abs(net) > self.forces.held:
            self.mode = SLIP
            self.way = self.side if self.inside else int(math.copysign(1, net))

    def _ends(self, after: _State) -> float:
        """Which part of a step is left to do when the mode ends in it; -1: it does not."""
        if self.mode == SLIP and self.way and self.way * after[1] < 0.0:
            return after[1] / (after[1] - self.y[1])
        if self.mode == CROSS:
            gap = self.plant.width(self.x)
            across, back = -self.side * (after[0] - self.left) - gap, self.side * (after[0] - self.left)
            over = max(across, back)
            if over > 0.0:
                return min(over / max(abs(after[0] - self.y[0]), 1e-18), 1.0)
        return -1.0

    def _changes(self, t: float) -> None:
        """Go over to the mode that follows."""
        if self.mode == SLIP:
            self.mode, self.way, self.x = REST, 0, self.y[0]
            self.y = (self.x, 0.0, *self.y[2:])
            self.events.append((t, "stick"))
            return
        across = -self.side * (self.y[0] - self.left) > 0.5 * self.plant.width(self.x)
        self.side = -self.side if across else self.side
        self.events.append((t, "pickup" if across else "back"))
        speed = self.plant.kept * self.plant.eta * self.y[1]
        self.mode, self.way = (SLIP, self.side) if speed * self.side > 1e-9 else (REST, 0)
        self.y = (self.x, speed if self.mode == SLIP else 0.0, *self.y[2:])

    def run(self) -> None:
        """Fill the rows."""
        each = round(float(self.grid[1] - self.grid[0]) / STEP)
        for row in range(len(self.grid)):
            if row:
                for k in range((row - 1) * each, row * each):
                    self._advance(k * STEP, STEP)
            t = row * each * STEP
            place, moves, total, given = self.y
            x, v = (self.x, 0.0) if self.mode == CROSS else (place, moves)
            if not self.drive.current:
                given = self._asked(t, x, moves if self.plant.fast_side == "motor" else v, total)[1]
            self.rows[row] = (x, v, place if self.mode == CROSS else self._touching(x), given)

    def _advance(self, t: float, h: float) -> None:
        for _ in range(8):
            if self.mode == REST:
                self._leaves(t)
            after = self._stepped(t, h)
            left = self._ends(after)
            if left == 1.0 and self.mode == SLIP:
                # It pushed hard enough for an instant only: it rests, and its integrator and its current go on.
                self.mode, self.way = REST, 0
                after, left = self._stepped(t, h), -1.0
            if left < 0.0:
                self.y = after
                break
            done = h * (1.0 - left)
            self.y = self._stepped(t, done)
            t, h = t + done, h - done
            self._changes(t)
        if self.mode != CROSS:
            self.x = self.y[0]
