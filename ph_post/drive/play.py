"""Feedback from the motor, or none: the gap lies behind the servo, as a play between motor and table.

The motor follows Eq. (8) of [1]_ (Eq. 7 with PI and PID) whatever the table does; the table is pushed by
either flank and stands in between (friction holds it there, unless a load keeps it on one flank). Friction
acts on the motor. With b = c = 0 the motor is where the command is: an ideal stepper.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 3.
"""

from __future__ import annotations

import numpy as np

from ph_post.drive.automaton import (
    PLACE_NOISE,
    SPEED_NOISE,
    Drive,
    Guard,
    Key,
    Motion,
    Rows,
    X_dot,
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
from ph_post.types import Array


class PlayBehindServo(Drive):
    """A play of the lost motion between the motor's side and the table."""

    friction_state = "w"

    def __init__(self, plant: Plant) -> None:
        super().__init__(plant)
        self.ideal = plant.b == 0.0
        self.speed = X_dot if self.ideal else w
        """Speed of the motor's side."""

    def feedback(self) -> tuple[Array, Array]:
        """Return the motor's, which the controller sees."""
        return m, w

    def places(self) -> list[tuple[int, int]]:
        """Contacts and directions that exist; a load beyond friction keeps the table on one flank."""
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
        motor = {"m": self.speed if direction else nothing, "w": rate, "integral": rows.e}
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
        """Say what ends a mode: the motor stops, breaks away, or meets a flank."""
        contact, direction, side = key
        hits = [] if contact else [self._hit(flank, direction, side) for flank in (1, -1)]
        if direction:
            rest = same((contact, 0, side))
            return [*hits, Guard(direction * self.speed, SPEED_NOISE, rest, reset(w=nothing))]
        up, down = same(self._leaving(key, 1)), same(self._leaving(key, -1))
        if self.ideal:
            starts = [(-1, up), (1, down)]
            return [
                Guard(sign * X_dot, SPEED_NOISE, target, self._left(key, -sign)) for sign, target in starts
            ]
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
