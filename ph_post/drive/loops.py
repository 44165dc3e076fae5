"""The equations of the loops: closed over the table (rigid or elastic), and a play behind the servo.

With feedback from the table, motor and table are rigid or joined by a spring, and the gap is inside the loop.
With feedback from the motor, or none, the motor follows Eq. (8) of [1]_ (Eq. 7 with PI and PID) whatever the
table does; the table is pushed by either flank and stands in between (friction holds it there, unless a load
keeps it on one flank). Friction acts on the motor. With b = c = 0 the motor is where the command is: an ideal
stepper.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 3.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from ph_post.drive.automaton import (
    PLACE_NOISE,
    SPEED_NOISE,
    DriveModel,
    Guard,
    Key,
    Motion,
    Rows,
    X_dot,
    by_direction,
    m,
    nothing,
    reset,
    same,
    stay,
    v,
    w,
    x,
)
from ph_post.drive.plant import Plant
from ph_post.types import Array, Feedback

LEAST_TABLE: Final = 0.02
"""The table keeps at least this part of the inertia, whatever factor a scenario puts on C."""


class TableLoop(DriveModel):
    """Motor (η b, η b β) and table (the rest of b and c) of a loop closed over the table."""

    def __init__(self, plant: Plant) -> None:
        super().__init__(plant)
        self.motor_inertia = min(plant.eta, 1.0 - LEAST_TABLE) * plant.b
        self.table_inertia = plant.b - self.motor_inertia
        self.motor_damping = self.motor_inertia * plant.beta
        self.table_damping = max(plant.c - self.motor_damping, 0.0)

    def free_motor(self, rows: Rows) -> Array:
        """ẇ of the motor in the gap. Implements Eq. (16) of [1]_ in units of the table."""
        return (rows.u - self.motor_damping * w) / self.motor_inertia

    def free_table(self, direction: int) -> Motion:
        """Motion of the table in the gap, freewheeling (section 3.3 of [1]_) or at rest."""
        if not direction:
            return {"x": nothing, "v": nothing}
        resisted = self.table_damping * v + self.resistance(direction, v)
        return {"x": v, "v": -resisted / self.table_inertia}

    def hits(self, key: Key) -> list[Guard]:
        """Guards at which the motor meets one flank or the other."""
        return [Guard(self.half - flank * (m - x), PLACE_NOISE, *self.meet(flank, key[2])) for flank in (1, -1)]

    @abstractmethod
    def meet(self, flank: int, side: int) -> tuple[tuple[Key, Key, Key], Array]:
        """Targets and reset of a pick-up."""

    def in_gap(self, key: Key, rows: Rows) -> Motion:
        """Rates in the gap."""
        return {
            **self.free_table(key[1]),
            "m": w,
            "w": self.free_motor(rows),
            "integral": rows.summed,
            "current": rows.given,
        }

    def gap_guards(self, key: Key) -> list[Guard]:
        """Guards in the gap: the flanks, and the table coming to rest or breaking away."""
        _, direction, side = key
        if direction:
            stops = [Guard(direction * v, SPEED_NOISE, same((0, 0, side)), reset(v=nothing))]
        else:
            stops = self.breakaway(nothing, same((0, 1, side)), same((0, -1, side)))
        return self.hits(key) + stops


class RigidLoop(TableLoop):
    """Motor and table move as one body while a flank holds them together."""

    def motion(self, key: Key, rows: Rows) -> Motion:
        """Eq. (8) of [1]_, or Eq. (7) corrected, while engaged; Eq. (16) in the gap."""
        contact, direction, _ = key
        if not contact:
            return self.in_gap(key, rows)
        if not direction:
            return {"integral": rows.summed, "current": rows.given}
        together = self._acceleration(direction, rows)
        return {"x": v, "v": together, "m": v, "w": together, "integral": rows.summed, "current": rows.given}

    def _acceleration(self, direction: int, rows: Rows) -> Array:
        return (rows.u - self.plant.c * v - self.resistance(direction, v)) / self.plant.b

    def _transmitted(self, direction: int, rows: Rows) -> Array:
        """Force that the motor hands on to the table, F/K: what its own inertia and damping leave of u."""
        own = self.motor_inertia * self._acceleration(direction, rows) + self.motor_damping * v
        return rows.u - own

    def guards(self, key: Key, rows: Rows) -> list[Guard]:
        """Return the guards that end a mode.

        The gap opens where the motor reverses; under `contact` already where it no longer pushes, which is
        also what holds while the load pushes the axis back.
        """
        contact, direction, side = key
        if not contact:
            return self.gap_guards(key)
        if direction:
            rest = Guard(direction * v, SPEED_NOISE, same((contact, 0, side)), reset(v=nothing, w=nothing))
            if self.open and (self.plant.pickup == "contact" or direction != contact):
                pushes = contact * self._transmitted(direction, rows)
                return [rest, Guard(pushes, PLACE_NOISE, same((0, direction, side)), self._opened(contact))]
            return [rest]
        up, down = same((contact, 1, side)), same((contact, -1, side))
        leaves = Guard(contact * rows.u, PLACE_NOISE, same((0, 0, side)), self._opened(contact))
        moves = self.breakaway(rows.u, up, down)
        if not self.open:
            return moves
        # A table that its load moves by itself follows the motor back, as long as the motor gives way slower.
        back = moves[1 if contact > 0 else 0]
        return [back, leaves, *moves] if self._falls(contact) else [leaves, *moves]

    def _falls(self, contact: int) -> bool:
        """Return whether the load alone moves the table from rest against the motor on that flank."""
        plant = self.plant
        held = plant.coulomb_minus if contact > 0 else plant.coulomb_plus
        return contact * plant.load > held + plant.static

    def _opened(self, contact: int) -> Array:
        """Put the motor exactly at the flank it leaves."""
        return reset(m=x + contact * self.half)

    def meet(self, flank: int, side: int) -> tuple[tuple[Key, Key, Key], Array]:
        """Pick the table up: from rest (Eq. 14 of [1]_), or with what a plastic impact leaves."""
        place = x + flank * self.half
        if self.plant.pickup == "standstill":
            return same((flank, 0, side)), reset(v=nothing, w=nothing, m=place)
        after = v + self.plant.kept * (self.motor_inertia / self.plant.b) * (w - v)
        return by_direction(flank, side), reset(v=after, w=after, m=place)


class ElasticLoop(TableLoop):
    """A spring and a damper between motor and table, which can push but not pull over the gap."""

    def _transmitted(self, contact: int) -> Array:
        omega = self.plant.windup_frequency
        stiffness = self.table_inertia * omega * omega
        damping = 2.0 * self.plant.windup_damping * omega * self.table_inertia
        return stiffness * (m - x - contact * self._flank) + damping * (w - v)

    @property
    def _flank(self) -> Array:
        return self.half if self.open else nothing

    def motion(self, key: Key, rows: Rows) -> Motion:
        """Two masses, coupled while engaged."""
        contact, direction, _ = key
        if not contact:
            return self.in_gap(key, rows)
        force = self._transmitted(contact)
        motor = (rows.u - force - self.motor_damping * w) / self.motor_inertia
        table: Motion = {"x": nothing, "v": nothing}
        if direction:
            resisted = self.table_damping * v + self.resistance(direction, v)
            table = {"x": v, "v": (force - resisted) / self.table_inertia}
        return {**table, "m": w, "w": motor, "integral": rows.summed, "current": rows.given}

    def guards(self, key: Key, _rows: Rows) -> list[Guard]:
        """Return the guards that end a mode: the spring is slack, or the table stops or breaks away."""
        contact, direction, side = key
        if not contact:
            return self.gap_guards(key)
        slack = Guard(contact * (m - x) - self.half, PLACE_NOISE, by_direction(0, side), stay())
        if direction:
            stops = [Guard(direction * v, SPEED_NOISE, same((contact, 0, side)), reset(v=nothing))]
        else:
            up, down = same((contact, 1, side)), same((contact, -1, side))
            stops = self.breakaway(self._transmitted(contact), up, down)
        return [slack] * self.open + stops

    def meet(self, flank: int, side: int) -> tuple[tuple[Key, Key, Key], Array]:
        """Touch the flank: nothing jumps, the spring takes it up."""
        return by_direction(flank, side), stay()


class PlayBehindServo(DriveModel):
    """A play of the lost motion between the motor's side and the table."""

    friction_state = "w"

    def __init__(self, plant: Plant) -> None:
        super().__init__(plant)
        self.ideal = plant.b == 0.0
        self.speed = X_dot if self.ideal else w
        """Speed of the motor's side."""

    def feedback(self) -> tuple[Array, Array]:
        """Return position and speed of the motor, which the controller sees."""
        return m, w

    def places(self) -> list[tuple[int, int]]:
        """Return the contacts and directions that exist; a load beyond friction keeps the table on one flank."""
        held = self._held()
        contacts: tuple[int, ...] = (1, -1, 0) if self.open and not held else (held or 1,)
        return [(contact, direction) for contact in contacts for direction in (1, -1, 0)]

    def _held(self) -> int:
        """Flank on which the load keeps the table; 0 where friction holds it in the gap."""
        plant = self.plant
        if plant.load > plant.coulomb_minus + plant.static:
            return 1
        return -1 if plant.load < -plant.coulomb_plus - plant.static else 0

    def motion(self, key: Key, rows: Rows) -> Motion:
        """Move the motor by its servo, and the table with it or not at all."""
        contact, direction, _ = key
        rate = self._motor(direction, rows)
        motor = {"m": self.speed if direction else nothing, "w": rate, "integral": rows.summed, "current": rows.given}
        if self.ideal:
            motor = {"m": X_dot, "w": nothing}
        if not contact:
            return motor
        if not self.plant.windup_frequency:
            return {**motor, "x": motor["m"]}
        omega = self.plant.windup_frequency
        spring = omega * omega * (m - x - contact * self.half)
        pull = spring + 2.0 * self.plant.windup_damping * omega * (motor["m"] - v)
        return {**motor, "x": v, "v": pull}

    def _motor(self, direction: int, rows: Rows) -> Array:
        if self.ideal or not direction:
            return nothing
        return (rows.u - self.plant.c * w - self.resistance(direction, w)) / self.plant.b

    def guards(self, key: Key, rows: Rows) -> list[Guard]:
        """Return the guards that end a mode: the motor stops, breaks away, or meets a flank."""
        contact, direction, side = key
        hits = [] if contact else [self._hit(flank, direction, side) for flank in (1, -1)]
        if direction:
            rest = same((contact, 0, side))
            return [*hits, Guard(direction * self.speed, SPEED_NOISE, rest, reset(w=nothing))]
        up, down = same(self._leaving(key, 1)), same(self._leaving(key, -1))
        if self.ideal:
            starts = [(-1, up), (1, down)]
            return [Guard(sign * X_dot, SPEED_NOISE, target, self._left(key, -sign)) for sign, target in starts]
        found = self.breakaway(rows.u, up, down)
        return [found[0]._replace(reset=self._left(key, 1)), found[1]._replace(reset=self._left(key, -1))]

    def _leaving(self, key: Key, direction: int) -> Key:
        """Where the motor goes from rest: on against its flank, or off it into the gap."""
        contact, _, side = key
        stays = not self.open or self._held() or contact in (0, direction)
        return (contact if stays else 0, direction, side)

    def _left(self, key: Key, direction: int) -> Array:
        """Leaving a flank the motor is exactly there, and the table stands."""
        contact = key[0]
        if not contact or self._leaving(key, direction)[0] or self.plant.windup_frequency:
            return stay() if self._leaving(key, direction)[0] == contact else reset(v=nothing)
        return reset(x=m - contact * self.half, v=nothing)

    def _hit(self, flank: int, direction: int, side: int) -> Guard:
        row = self.half - flank * (m - x)
        after = np.array(stay()) if self.plant.windup_frequency else reset(x=m - flank * self.half)
        return Guard(row, PLACE_NOISE, same((flank, direction, side)), after)


def _closed_over_table(plant: Plant) -> DriveModel:
    return ElasticLoop(plant) if plant.windup_frequency else RigidLoop(plant)


EQUATIONS: Final[Mapping[Feedback, Callable[[Plant], DriveModel]]] = {
    "load": _closed_over_table,
    "motor": PlayBehindServo,
    "none": PlayBehindServo,
}
"""The equations of motion of each kind of loop in :data:`ph_post.types.LOOPS`."""


def drive_model(plant: Plant) -> DriveModel:
    """Return the equations that fit a plant."""
    return EQUATIONS[plant.feedback](plant)
