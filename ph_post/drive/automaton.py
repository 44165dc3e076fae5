"""One axis as a hybrid automaton: which linear equations hold when, and what ends them.

Every mode is linear, ż = A z + B (X, Ẋ, 1, g, ġ, q, q̇, h), in the state z = (x, v, m, w, ∫e) of table, motor
and integrator; every guard is a linear function of state and inputs that is not negative while its mode
lasts; every change of mode is linear too. So the engine (:mod:`ph_post.simulate.kernel`) needs to know
nothing of drives: it takes exact steps, and finds where a guard changes sign. X is the command, linear
between samples; g and q are what forces beyond the linear ones resist, likewise, the body that feels friction
and the motor; h is half the gap where that differs from place to place.

A mode is named by its contact, the flank (1, -1; 0 in the gap) on which the motor pushes, by the direction
in which the body that feels friction moves (0 at rest), and by the side on which the motor's torque is
saturated (0 where it is not).

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, sections 3.1 to 3.4.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from functools import lru_cache
from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.drive.plant import Plant
from ph_post.types import Array, IntArray, frozen

STATES: Final = 5
"""x, v of the table, m, w of the motor [m, m/s], and the integral of the error [m s]."""

WIDTH: Final = 13
"""The states, X [m], Ẋ [m/s] and 1, and behind them g [m], ġ [m/s], q [m], q̇ [m/s] and half the gap [m]."""

NO_GAP: Final = 1e-10
"""A lost motion up to this [m] is none: crossing it takes no time worth following."""

SPEED_NOISE: Final = 1e-12
"""Speeds [m/s] up to this are rounding."""

PLACE_NOISE: Final = 1e-13
"""Lengths, and forces as F/K, up to this [m] are rounding."""

Key = tuple[int, int, int]
"""Contact, direction, saturation."""


class Guard(NamedTuple):
    """`row` @ y >= -`noise` while the mode lasts; otherwise z = `reset` @ y and the mode is `target`.

    `target` holds three: for the body that feels friction moving up, down, or at rest after the reset.
    """

    row: Array
    noise: float
    target: tuple[Key, Key, Key]
    reset: Array


class Automaton(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The modes of an axis as arrays.

    `keys` names mode k; `rates` (modes, WIDTH, WIDTH) holds A and B with the inputs' own rates; of `guards`,
    `noise`, `targets` and `resets` (modes, most guards, ...) a mode has the first `counts` (modes,).
    `moving` is the index of the state whose sign the targets ask for; `directions` (modes,) that of friction,
    `contacts` (modes,) the flank.
    """

    keys: tuple[Key, ...]
    rates: Array
    counts: IntArray
    guards: Array
    noise: Array
    targets: IntArray
    resets: Array
    moving: int
    directions: IntArray
    contacts: IntArray


def unit(index: int) -> Array:
    """Return the row that picks one of state and inputs."""
    row = np.zeros(WIDTH)
    row[index] = 1.0
    return row


x, v, m, w, integral, X, X_dot, one, g, g_dot, q, q_dot, half_gap = (unit(index) for index in range(WIDTH))
nothing = np.zeros(WIDTH)


class Rows(NamedTuple):
    """What the equations are written in: rows that give one quantity from state and inputs."""

    u: Array
    """What drives the motor: the controller's output, or what of it the motor can give, less q [m]."""
    e: Array
    """Position error [m]."""
    asked: Array
    """The controller's output [m]."""


Motion = dict[str, Array]
"""Rates of change by the name of the state."""


@lru_cache(maxsize=512)
def build_automaton(plant: Plant) -> Automaton:
    """Return the automaton of a plant.

    Implements section 3.3 of [1]_ for the table in the loop, and a play behind the servo otherwise.
    """
    drive = drive_of(plant)
    sides = (0, 1, -1) if math.isfinite(plant.saturation) else (0,)
    modes: dict[Key, tuple[Array, list[Guard]]] = {}
    for side in sides:
        for contact, direction in drive.places():
            key = (contact, direction, side)
            rows = drive.rows(side)
            guards = drive.guards(key, rows)
            if len(sides) > 1:
                guards += _saturation(plant, key, rows.asked)
            modes[key] = (_rates(drive.motion(key, rows)), guards)
    return _pack(modes, drive.friction_state)


def _saturation(plant: Plant, key: Key, u: Array) -> list[Guard]:
    """Guards at which the motor's torque reaches its limit, or comes back from it."""
    contact, direction, side = key
    limit = plant.saturation * one

    def other(new: int) -> tuple[Key, Key, Key]:
        return ((contact, direction, new),) * 3

    if side:
        return [Guard(side * u - limit, PLACE_NOISE, other(0), stay())]
    return [Guard(limit - s * u, PLACE_NOISE, other(s), stay()) for s in (1, -1)]


def stay() -> Array:
    """Reset that leaves the state as it is."""
    return np.eye(STATES, WIDTH)


def reset(**rows: Array) -> Array:
    """Reset that gives the states named another value, and leaves the others."""
    matrix = stay()
    for name, row in rows.items():
        matrix[NAMES.index(name)] = row
    return matrix


NAMES: Final = ("x", "v", "m", "w", "integral")


def _rates(motion: Motion) -> Array:
    matrix = np.zeros((WIDTH, WIDTH))
    for name, row in motion.items():
        matrix[NAMES.index(name)] = row
    matrix[5], matrix[8], matrix[10] = X_dot, g_dot, q_dot
    return matrix


def _pack(modes: dict[Key, tuple[Array, list[Guard]]], moving: str) -> Automaton:
    keys = tuple(modes)
    most = max(len(guards) for _, guards in modes.values())
    shape = (len(keys), most)
    rows, noise = np.zeros((*shape, WIDTH)), np.zeros(shape)
    targets, resets = np.zeros((*shape, 3), dtype=np.int64), np.zeros((*shape, STATES, WIDTH))
    for mode, (_, guards) in enumerate(modes.values()):
        for number, guard in enumerate(guards):
            rows[mode, number], noise[mode, number] = guard.row, guard.noise
            targets[mode, number] = [keys.index(target) for target in guard.target]
            resets[mode, number] = guard.reset
    directions = np.array([key[1] for key in keys], dtype=np.int64)
    counts = np.array([len(guards) for _, guards in modes.values()], dtype=np.int64)
    contacts = np.array([key[0] for key in keys], dtype=np.int64)
    for array in (counts, targets, directions, contacts):
        array.setflags(write=False)
    return Automaton(
        keys=keys,
        rates=frozen([rates for rates, _ in modes.values()]),
        counts=counts,
        guards=frozen(rows),
        noise=frozen(noise),
        targets=targets,
        resets=frozen(resets),
        moving=NAMES.index(moving),
        directions=directions,
        contacts=contacts,
    )


class DriveModel(ABC):
    """What all drives share: the controller, friction, and where the gap's flanks are.

    Parameters
    ----------
    plant : Plant
    """

    friction_state = "v"
    """The state whose sign is the direction of friction."""

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.half: Array = 0.5 * plant.gap * one if plant.widening is None else half_gap
        self.open = plant.gap > NO_GAP or plant.widening is not None

    def places(self) -> list[tuple[int, int]]:
        """Contacts and directions that exist."""
        contacts = (1, -1, 0) if self.open else (1,)
        return [(contact, direction) for contact in contacts for direction in (1, -1, 0)]

    def rows(self, side: int) -> Rows:
        """Return error and controller output, u = e + (k_i/k_p) ∫e + (k_d/k_p) ė, saturated on a side."""
        place, speed = self.feedback()
        e = X - place
        u = e + self.plant.ki * integral + self.plant.kd * (X_dot - speed)
        return Rows((side * self.plant.saturation * one if side else u) - q, e, u)

    def feedback(self) -> tuple[Array, Array]:
        """Position and speed that the controller sees."""
        return x, v

    def resistance(self, direction: int, speed: Array) -> Array:
        """Friction and load that resist the motion in a direction, F/K."""
        plant = self.plant
        up = direction >= 0
        viscous = plant.viscous_plus if up else plant.viscous_minus
        dry = plant.coulomb_plus if up else -plant.coulomb_minus
        return viscous * speed + dry * one + plant.load * one + g

    def breakaway(self, drive: Array, up: tuple[Key, Key, Key], down: tuple[Key, Key, Key]) -> list[Guard]:
        """Guards of rest: the drive less the load does not exceed what friction can hold."""
        plant = self.plant
        net = drive - plant.load * one - g
        hold_up, hold_down = plant.coulomb_plus + plant.static, plant.coulomb_minus + plant.static
        return [
            Guard(hold_up * one - net, PLACE_NOISE, up, stay()),
            Guard(hold_down * one + net, PLACE_NOISE, down, stay()),
        ]

    @abstractmethod
    def motion(self, key: Key, rows: Rows) -> Motion:
        """Rates of the states in a mode."""

    @abstractmethod
    def guards(self, key: Key, rows: Rows) -> list[Guard]:
        """Guards of a mode, the most urgent first."""


def same(key: Key) -> tuple[Key, Key, Key]:
    """One target whatever the direction."""
    return key, key, key


def by_direction(contact: int, side: int) -> tuple[Key, Key, Key]:
    """Targets of one contact by direction."""
    return (contact, 1, side), (contact, -1, side), (contact, 0, side)


def drive_of(plant: Plant) -> DriveModel:
    """Return the equations that fit a plant."""
    from ph_post.drive.loops import ElasticLoop, PlayBehindServo, RigidLoop

    if not plant.loop.encloses_backlash:
        return PlayBehindServo(plant)
    return ElasticLoop(plant) if plant.windup_frequency else RigidLoop(plant)
