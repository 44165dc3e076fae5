"""The equations of a drive as the arrays that the engine runs; see :mod:`ph_post.drive.automaton`."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.drive.automaton import (
    NAMES,
    PLACE_NOISE,
    STATES,
    WIDTH,
    Guard,
    Key,
    Motion,
    X,
    X_dot,
    Zone,
    fed_dot,
    g,
    g_dot,
    one,
    q,
    q_dot,
    stay,
)
from ph_post.drive.automaton import fed as fed_row
from ph_post.drive.command_filters import rates_of
from ph_post.drive.loops import drive_model
from ph_post.drive.plant import TRUE_READING, GapProfile, Plant
from ph_post.types import Array, IntArray, frozen


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


def build_automaton(plant: Plant) -> Automaton:
    """Return the automaton of a plant; those that differ in no equation have the same.

    Implements section 3.3 of [1]_ for the table in the loop, and a play behind the servo otherwise.
    """
    return _built(_equations_of(plant))


_ANY_PROFILE: Final = GapProfile()


def _equations_of(plant: Plant) -> Plant:
    """Return a plant without what is in none of its equations: shapes of command, gap, forces and reading."""
    cascade = plant.cascade
    if cascade is not None:
        cascade = replace(
            cascade, dead_time=0.0, moving_average=0.0, exponential=0.0, shaper_frequency=0.0, shaper_damping=0.0
        )
    return replace(
        plant,
        cascade=cascade,
        widening=None if plant.widening is None else _ANY_PROFILE,
        stribeck_speed=0.0,
        cogging=(),
        cutting=(),
        forces=(),
        command_delay=0.0,
        reading_delay=0.0,
        reading=TRUE_READING,
        slows=math.inf,
        reference=0,
    )


@lru_cache(maxsize=512)
def _built(plant: Plant) -> Automaton:
    drive = drive_model(plant)
    band = 0.0 if plant.cascade is None else plant.cascade.deadband
    torques = (0, 1, -1) if math.isfinite(plant.saturation) else (0,)
    errors = (0, 1, -1) if band else (0,)
    modes: dict[Key, tuple[Array, list[Guard]]] = {}
    places = drive.places()
    for zone in (Zone(torque, error) for torque in torques for error in errors):
        rows = drive.rows(zone.number)
        for contact, direction in places:
            key = (contact, direction, zone.number)
            guards = drive.guards(key, rows)
            if len(torques) > 1:
                guards += _limited(plant.saturation, rows.asked, key, zone.torque, _TORQUE)
            if band:
                guards += _limited(band, rows.e, key, zone.error, _ERROR)
            modes[key] = (_rates(drive.motion(key, rows)), guards)
    return _pack(modes, drive.friction_state)


_TORQUE, _ERROR = Zone(torque=1).number, Zone(error=1).number


def _limited(size: float, row: Array, key: Key, side: int, step: int) -> list[Guard]:
    """Guards at which a row goes beyond a size, or comes back from there; `step` is the number of that zone."""
    contact, direction, zone = key
    limit = size * one

    def other(new: int) -> tuple[Key, Key, Key]:
        return ((contact, direction, zone + step * (new - side)),) * 3

    if side:
        return [Guard(side * row - limit, PLACE_NOISE, other(0), stay())]
    return [Guard(limit - s * row, PLACE_NOISE, other(s), stay()) for s in (1, -1)]


_RATE: Final = int(np.argmax(X_dot))
"""Place of the command's rate in a row."""

_HELD: Final = frozen(np.stack([X, g, q, fed_row], axis=1) @ np.stack([X_dot, g_dot, q_dot, fed_dot]))
"""Rates of what runs on by itself."""


def _rates(motion: Motion) -> Array:
    matrix = _HELD.copy()
    for name, row in motion.items():
        matrix[NAMES.index(name)] = row
    return matrix


def _pack(modes: dict[Key, tuple[Array, list[Guard]]], moving: str) -> Automaton:
    keys, places = tuple(modes), {key: k for k, key in enumerate(modes)}
    most = max(len(guards) for _, guards in modes.values())
    shape = (len(keys), most)
    rows, noise = np.zeros((*shape, WIDTH)), np.zeros(shape)
    targets, resets = np.zeros((*shape, 3), dtype=np.int64), np.zeros((*shape, STATES, WIDTH))
    for mode, (_, guards) in enumerate(modes.values()):
        for number, guard in enumerate(guards):
            rows[mode, number], noise[mode, number] = guard.row, guard.noise
            targets[mode, number] = [places[target] for target in guard.target]
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


def given_by(plant: Plant, command: Array, fed: Array, states: Array, period: float) -> Array:
    """Return what the loops of a plant give at the samples of a run, as F/K, shape (n,) [m].

    Of a single loop that is e + (k_i/k_p) ∫e + (k_d/k_p) ė, e the following error. The force that the motor gives, as
    a recorded channel has it, is then F/K = u - c_e v with v the speed of the side over which the loop closes and c_e
    the part of c that is electronic (the rest is friction, which the motor overcomes). K is the stiffness of the servo.

    Parameters
    ----------
    plant : Plant
    command : Array, shape (n,)
        As it reached the loops [m].
    fed : Array, shape (n,) or (0,)
        Acceleration that a cascade feeds forward [m/s²]; (0,) is none.
    states : Array, shape (n, STATES)
        Of the run.
    period : float
        [s].

    Examples
    --------
    >>> plant = Plant(feedback="motor", b=5e-4, c=5e-3)
    >>> given_by(plant, np.array([1.0, 2.0, 4.0, 8.0]), np.zeros(0), np.ones((4, STATES)), 1e-3)
    array([0., 1., 3., 7.])
    """
    drive = drive_model(plant)
    at, rate = drive.rows(0), _RATE
    speed = np.empty_like(command)
    speed[1:], speed[:1] = np.diff(command) / period, (command[1:2] - command[:1]) / period

    def along(row: Array) -> Array:
        found = states @ row[:STATES] + row @ X * command + row @ one
        found += row[rate] * speed
        return found + row @ fed_row * fed if fed.size else found

    given, band = along(at.u), 0.0 if plant.cascade is None else plant.cascade.deadband
    if band:
        error = along(at.e)
        for side in (1, -1):
            given = np.where(side * error > band, along(drive.rows(Zone(error=side).number).u), given)
    if at.asked[rate]:
        # The speed of the command is that of the part before a sample, and half a part late, as far as it was followed.
        given += at.asked[rate] * _followed(plant, period) * (rates_of(command, period) - speed)
    # With a part of c that is electronic this is where the torque saturates at low speed only.
    return np.clip(given, -plant.saturation, plant.saturation)


def _followed(plant: Plant, period: float) -> float:
    """Return the part of a sawtooth of a period that a current loop lets pass, where the sawtooth falls."""
    if plant.cascade is None or not plant.cascade.current_time:
        return 1.0
    half = 0.5 * period / plant.cascade.current_time
    return 1.0 / math.tanh(half) - 1.0 / half
