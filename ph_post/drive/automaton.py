"""One axis as a hybrid automaton: which linear equations hold when, and what ends them.

Every mode is linear, ż = A z + B (X, Ẋ, 1, g, ġ, q, q̇, h, f, ḟ), in the state z = (x, v, m, w, ∫e, i) of table,
motor, integrator and current loop; every guard is a linear function of state and inputs that is not negative while
its mode lasts; every change of mode is linear too. So the engine (:mod:`ph_post.simulate.kernel`) needs to know
nothing of drives: it takes exact steps, and finds where a guard changes sign. X is the command, linear
between samples; g and q are what forces beyond the linear ones resist, likewise, the body that feels friction
and the motor; h is half the gap where that differs from place to place; f is what a cascade feeds forward.

A mode is named by its contact, the flank (1, -1; 0 in the gap) on which the motor pushes, by the direction
in which the body that feels friction moves (0 at rest), and by what the controller is at, see :class:`Zone`.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, sections 3.1 to 3.4.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Final, NamedTuple

import numpy as np

from ph_post.drive.plant import Plant
from ph_post.types import Array, frozen

STATES: Final = 6
"""x, v of the table, m, w of the motor [m, m/s], the integral of the error [m s], and what a current loop gives [m]."""

WIDTH: Final = 16
"""The states, X [m], Ẋ [m/s] and 1, behind them g [m], ġ [m/s], q [m], q̇ [m/s] and half the gap [m], and f, ḟ.

f is the acceleration that is fed forward [m/s²].
"""

NO_GAP: Final = 1e-10
"""A lost motion up to this [m] is none: crossing it takes no time worth following."""

SPEED_NOISE: Final = 1e-12
"""Speeds [m/s] up to this are rounding."""

PLACE_NOISE: Final = 1e-13
"""Lengths, and forces as F/K, up to this [m] are rounding."""

Key = tuple[int, int, int]
"""Contact, direction, and the controller's zone."""


class Zone(NamedTuple):
    """What a controller is at: the side on which its torque is saturated, 0 where it is not, and that of a deadband.

    `error` is the side (1, -1) on which the error is beyond the deadband, 0 inside it; without a deadband it is 0.
    """

    torque: int = 0
    error: int = 0

    @property
    def number(self) -> int:
        """The number that stands for it in a key."""
        return self.torque + 3 * self.error

    @classmethod
    def of(cls, number: int) -> Zone:
        """Return the zone that a number stands for.

        Examples
        --------
        >>> all(Zone.of(Zone(t, e).number) == Zone(t, e) for t in (-1, 0, 1) for e in (-1, 0, 1))
        True
        """
        error = (number + 4) // 3 - 1
        return cls(number - 3 * error, error)


class Guard(NamedTuple):
    """`row` @ y >= -`noise` while the mode lasts; otherwise z = `reset` @ y and the mode is `target`.

    `target` holds three: for the body that feels friction moving up, down, or at rest after the reset.
    """

    row: Array
    noise: float
    target: tuple[Key, Key, Key]
    reset: Array


def unit(index: int) -> Array:
    """Return the row that picks one of state and inputs."""
    row = np.zeros(WIDTH)
    row[index] = 1.0
    return row


x, v, m, w, integral, current, X, X_dot, one, g, g_dot, q, q_dot, half_gap, fed, fed_dot = (
    unit(index) for index in range(WIDTH)
)
nothing = np.zeros(WIDTH)


class Rows(NamedTuple):
    """What the equations are written in: rows that give one quantity from state and inputs."""

    u: Array
    """What drives the motor: the controller's output, or what of it the motor can give, less q [m]."""
    e: Array
    """Position error [m]."""
    asked: Array
    """The controller's output [m]."""
    summed: Array
    """What the integrator sums: the position error, or in a cascade that of the speed by its gain [m]."""
    given: Array
    """Rate of what a current loop gives [m/s]."""


Motion = dict[str, Array]
"""Rates of change by the name of the state."""


_STAY: Final = frozen(np.eye(STATES, WIDTH))


def stay() -> Array:
    """Reset that leaves the state as it is."""
    return _STAY


def reset(**rows: Array) -> Array:
    """Reset that gives the states named another value, and leaves the others."""
    matrix = stay().copy()
    for name, row in rows.items():
        matrix[NAMES.index(name)] = row
    return matrix


NAMES: Final = ("x", "v", "m", "w", "integral", "current")


class DriveModel(ABC):
    """Base of all drives: the controller, friction, and the flanks of the gap.

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
        """Return the contacts and directions that exist."""
        contacts = (1, -1, 0) if self.open else (1,)
        return [(contact, direction) for contact in contacts for direction in (1, -1, 0)]

    def rows(self, number: int) -> Rows:
        """Return error and controller output, u = e + (k_i/k_p) ∫e + (k_d/k_p) ė, in the zone of a number.

        A cascade gives u = p + ∫p / T_n + b a f with p = e + (k Ẋ + l f - w) / K_v, where k, l and a are the weights of
        what is fed forward, and a current loop comes after it by its time constant.
        """
        plant, zone = self.plant, Zone.of(number)
        place, speed = self.feedback()
        e = X - place
        cascade = plant.cascade
        if cascade is None:
            u = e + plant.ki * integral + plant.kd * (X_dot - speed)
            return Rows((zone.torque * plant.saturation * one if zone.torque else u) - q, e, u, e, nothing)
        band = cascade.deadband
        heeded = (nothing if not zone.error else e - zone.error * band * one) if band else e
        speed = w if cascade.velocity_feedback == "motor" else speed
        ahead = cascade.velocity_feedforward * X_dot + cascade.acceleration_lead * fed
        p = heeded + (ahead - speed) / cascade.position_gain
        u = p + cascade.integral_rate * integral + plant.b * cascade.acceleration_feedforward * fed
        wanted = zone.torque * plant.saturation * one if zone.torque else u
        if not cascade.current_time:
            return Rows(wanted - q, e, u, p, nothing)
        return Rows(current - q, e, u, p, (wanted - current) / cascade.current_time)

    def feedback(self) -> tuple[Array, Array]:
        """Return position and speed of the side that the controller sees."""
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
        """Return the rates of the states in a mode."""

    @abstractmethod
    def guards(self, key: Key, rows: Rows) -> list[Guard]:
        """Return the guards that end a mode, the most urgent first."""


def same(key: Key) -> tuple[Key, Key, Key]:
    """One target whatever the direction."""
    return key, key, key


def by_direction(contact: int, side: int) -> tuple[Key, Key, Key]:
    """Targets of one contact by direction."""
    return (contact, 1, side), (contact, -1, side), (contact, 0, side)
