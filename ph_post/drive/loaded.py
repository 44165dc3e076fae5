"""Feedback from the table: motor and table, rigid or with a spring between them, and the gap inside the loop.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 3.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Final

from ph_post.drive.automaton import (
    PLACE_NOISE,
    SPEED_NOISE,
    Drive,
    Guard,
    Key,
    Motion,
    Rows,
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
from ph_post.types import Array

LEAST_TABLE: Final = 0.02
"""The table keeps at least this part of the inertia, whatever factor a scenario puts on C."""


class TableLoop(Drive):
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
        return [
            Guard(self.half - flank * (m - x), PLACE_NOISE, *self.meet(flank, key[2])) for flank in (1, -1)
        ]

    @abstractmethod
    def meet(self, flank: int, side: int) -> tuple[tuple[Key, Key, Key], Array]:
        """Targets and reset of a pick-up."""

    def in_gap(self, key: Key, rows: Rows) -> Motion:
        """Rates in the gap."""
        return {**self.free_table(key[1]), "m": w, "w": self.free_motor(rows), "integral": rows.e}

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
            return {"integral": rows.e}
        together = self._acceleration(direction, rows)
        return {"x": v, "v": together, "m": v, "w": together, "integral": rows.e}

    def _acceleration(self, direction: int, rows: Rows) -> Array:
        return (rows.u - self.plant.c * v - self.resistance(direction, v)) / self.plant.b

    def _transmitted(self, direction: int, rows: Rows) -> Array:
        """Force that the motor hands on to the table, F/K: what its own inertia and damping leave of u."""
        own = self.motor_inertia * self._acceleration(direction, rows) + self.motor_damping * v
        return rows.u - own

    def guards(self, key: Key, rows: Rows) -> list[Guard]:
        """Say what ends a mode.

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
        """Whether the load alone moves the table from rest against the motor on that flank."""
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
        return {**table, "m": w, "w": motor, "integral": rows.e}

    def guards(self, key: Key, _rows: Rows) -> list[Guard]:
        """Say what ends a mode: the spring is slack, or the table stops or breaks away."""
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
