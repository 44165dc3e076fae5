"""Modes of a plant for the engines, and the slow engine: one axis with forces that are Python functions.

Over a part of a sample the forces are taken as linear, from their value at its beginning to that at its end,
which a step with the forces held predicts: wrong by the square of the part. All else is exact, as in the
compiled engine, which takes these steps. A part whose two halves end elsewhere is halved, so that a force may
be steep, and may jump where the direction does.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import astuple, replace

from ph_post.drive.automaton import STATES, WIDTH
from ph_post.drive.command_filters import feeds_acceleration
from ph_post.drive.hybrid import Automaton, build_automaton
from ph_post.drive.plant import TRUE_READING, Plant, force_on
from ph_post.simulate import kernel
from ph_post.types import Array, IntArray, frozen, sealed

NO_STATES: Final = np.zeros((0, STATES))
"""In place of states that nobody asks for."""


@lru_cache(maxsize=512)
def modes_of(plant: Plant, period: float) -> kernel.ModeTables:
    """Return the modes of a plant for steps of a period [s]."""
    automaton = build_automaton(plant)
    static = plant.static if plant.stribeck_speed else 0.0
    slopes = frozen(np.matmul(automaton.guards, automaton.rates))
    tables = _step_tables(automaton, period)
    return kernel.ModeTables(
        tables=tables,
        counts=automaton.counts,
        guards=automaton.guards,
        guarded=sealed(kernel.places_of(automaton.guards)),
        slopes=slopes,
        sloped=sealed(kernel.places_of(slopes)),
        noise=automaton.noise,
        targets=automaton.targets,
        resets=automaton.resets,
        directions=automaton.directions,
        moving=automaton.moving,
        static=static,
        scale=plant.stribeck_speed,
        waves=frozen(np.reshape([(size, math.tau / wave, phase) for size, wave, phase in plant.cogging], (-1, 3))),
        gap=frozen(() if plant.widening is None else (plant.gap, *astuple(plant.widening))),
        holds=_holds(plant),
        contacts=automaton.contacts,
        used=used_columns(plant, tables),
        level=kernel.FORCED if static or plant.cogging else 0,
    )


@lru_cache(maxsize=512)
def _step_tables(automaton: Automaton, period: float) -> Array:
    return kernel.step_tables(automaton.rates, period)


def used_columns(plant: Plant, tables: Array, *, pushed: bool = False) -> IntArray:
    """Return the columns that the steps of a plant need; `pushed` if a force from outside acts.

    What is skipped is 0, so that no sum is another one without it.
    """
    active = np.ones(WIDTH, dtype=bool)
    rubs = plant.static != 0.0 and plant.stribeck_speed != 0.0
    active[[kernel.Column.G, kernel.Column.G_RATE]] = pushed or rubs
    active[[kernel.Column.Q, kernel.Column.Q_RATE]] = bool(plant.cogging)
    active[kernel.Column.HALF_GAP] = plant.widening is not None
    fed = plant.cascade is not None and feeds_acceleration(plant.cascade)
    active[[kernel.Column.FED, kernel.Column.FED_RATE]] = fed
    return sealed(kernel.used_columns(tables, active))


def level_for(plant: Plant, command: Array) -> int:
    """Into how many parts at most, as a power of 2, the samples of a command [m] are cut.

    Stribeck friction is steep near standstill, wherever the command goes. Cogging alone needs parts over
    which no wave turns by more than a part of a turn.
    """
    if plant.static and plant.stribeck_speed:
        return kernel.FORCED
    if not plant.cogging or command.size < 2:
        return 0
    shortest = min(period for _, period, _ in plant.cogging)
    turn = 2.0 * math.pi * float(np.abs(np.diff(command)).max()) / shortest
    return min(max(math.ceil(math.log2(max(turn, kernel.TURN) / kernel.TURN)), 0), kernel.FINE)


def _holds(plant: Plant) -> int:
    """Name the body that keeps motor and table a gap apart while they touch."""
    if plant.windup_frequency:
        return kernel.SPRING
    return kernel.TABLE if plant.loop.encloses_backlash else kernel.PLAY


NEGLIGIBLE: Final = 1e-9
"""Largest error of the force of a part, F/K [m]; the table is off by no more."""

DEEPEST: Final = 10
"""Halvings of a sample after which a part is taken as it is: where a force jumps none is short enough."""


class Reached(NamedTuple):
    """State and mode after a part, and the changes of mode in it: when, in samples, which, and to which."""

    z: Array
    mode: int
    changes: tuple[tuple[float, int, int], ...] = ()


class SlowAxis:
    """One axis with forces beyond those that its modes know.

    Parameters
    ----------
    plant : Plant
    command : Array, shape (n,)
        X [m], linear between samples.
    period : float
        h [s].
    begin : float
        Time of the first sample [s].
    given : Array, shape (n,) or (0,)
        Force from outside, linear between samples, F/K [m]; (0,) is none.
    fed : Array, shape (n,) or (0,)
        Acceleration that is fed forward, linear between samples [m/s²]; (0,) is none.
    """

    def __init__(self, plant: Plant, command: Array, period: float, begin: float, given: Array, fed: Array) -> None:
        self.plant, self.command, self.period, self.begin = plant, command, period, begin
        self.fed = fed
        self.given = given if given.size else np.zeros(command.size)
        linear = replace(plant, forces=(), cutting=(), reading=TRUE_READING)
        self.modes = [
            one._replace(used=used_columns(linear, one.tables, pushed=True))
            for one in (modes_of(linear, period / 2.0**level) for level in range(DEEPEST + 1))
        ]

    def run(self, z: Array, mode: int, table: Array, motor: Array, states: Array) -> tuple[Array, IntArray]:
        """Run through all samples.

        Parameters
        ----------
        z : Array, shape (STATES,)
            State at the first sample.
        mode : int
        table, motor : Array, shape (n,)
            Receive x and m [m].
        states : Array, shape (n, STATES) or (0, STATES)
            Receives the states at the samples, where it has room for them.

        Returns
        -------
        instants, log : Array
            As those of :func:`ph_post.simulate.kernel.advance`.
        """
        reached = Reached(z, mode)
        changes: list[tuple[float, int, int]] = []
        table[0], motor[0], states[:1] = z[0], z[2], z
        for k in range(1, self.command.size):
            reached = self.cross(float(k - 1), 0, reached)
            changes += reached.changes
            table[k], motor[k], states[k : k + 1] = reached.z[0], reached.z[2], reached.z
        log = np.array([modes for _, *modes in changes], dtype=np.int64).reshape(-1, 2)
        return np.array([instant for instant, _, _ in changes]), log

    def cross(self, place: float, level: int, start: Reached) -> Reached:
        """Go through the part of h/2^level that begins at a place, in samples."""
        whole = self._step(place, level, start)
        if level == DEEPEST:
            return whole
        middle = place + 0.5 ** (level + 1)
        half = self._step(place, level + 1, start)
        end = self._step(middle, level + 1, half)
        if not self._agree(whole, end, level):
            half = self.cross(place, level + 1, start)
            end = self.cross(middle, level + 1, half)
        return end._replace(changes=half.changes + end.changes)

    def _agree(self, one: Reached, other: Reached, level: int) -> bool:
        """Return whether the forces that make the difference are negligible."""
        moving = self.modes[level].moving
        gained = abs(one.z[moving] - other.z[moving])
        return one.mode == other.mode and self.plant.b * gained <= NEGLIGIBLE * self.period / 2.0**level

    def _step(self, place: float, level: int, start: Reached) -> Reached:
        """Take the part in one step."""
        held = self._force(place, start)
        guess = self._advance(place, level, start, np.array([held, held]))
        end = self._force(place + 0.5**level, guess)
        return self._advance(place, level, start, np.array([held, end]))

    def _force(self, place: float, at: Reached) -> float:
        modes = self.modes[0]
        t = self.begin + place * self.period
        position, speed = float(at.z[modes.moving - 1]), float(at.z[modes.moving])
        k = min(int(place), self.given.size - 2)
        given: float = self.given[k] + (place - k) * (self.given[k + 1] - self.given[k])
        return given + force_on(self.plant, t, position, speed, int(modes.directions[at.mode]))

    def _advance(self, place: float, level: int, start: Reached, force: Array) -> Reached:
        length = 0.5**level
        k = int(place)
        rows = np.array([place - k, place - k + length])
        command = sealed(self.command[k] + rows * (self.command[k + 1] - self.command[k]))
        fed = self.fed[k] + rows * (self.fed[k + 1] - self.fed[k]) if self.fed.size else self.fed
        z, scratch = start.z.copy(), np.empty(2)
        mode, instants, log = kernel.advance(
            command,
            self.period * length,
            z,
            start.mode,
            self.modes[level],
            sealed(force),
            sealed(fed),
            scratch,
            scratch,
            NO_STATES,
        )
        changes = zip((place + instants * length).tolist(), *log.T.tolist(), strict=True)
        return Reached(z, mode, tuple(changes))
