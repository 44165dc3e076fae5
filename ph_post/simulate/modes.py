"""The modes of a plant as the compiled engine takes them."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
from msgspec.structs import astuple

from ph_post.drive.automaton import build_automaton
from ph_post.drive.plant import Plant
from ph_post.simulate import kernel
from ph_post.types import Array, frozen

TURN: Final = 0.1
"""Radians of a cogging wave over which its parabola is as good as the wave: wrong by 1e-5 of its size."""


@lru_cache(maxsize=512)
def modes_of(plant: Plant, period: float) -> kernel.Modes:
    """Return the modes of a plant for steps of a period [s]."""
    automaton = build_automaton(plant)
    static = plant.static if plant.stribeck_speed else 0.0
    return kernel.Modes(
        tables=kernel.step_tables(automaton.rates, period), counts=automaton.counts,
        guards=automaton.guards, slopes=frozen(np.matmul(automaton.guards, automaton.rates)),
        noise=automaton.noise, targets=automaton.targets, resets=automaton.resets,
        directions=automaton.directions, moving=automaton.moving,
        static=static, scale=plant.stribeck_speed,
        waves=frozen(np.reshape([_wave(*one) for one in plant.cogging], (-1, 3))),
        gap=frozen(() if plant.widening is None else (plant.gap, *astuple(plant.widening))),
        holds=_holds(plant), contacts=automaton.contacts,
        plain=static == 0.0 and not plant.cogging and plant.widening is None,
        level=kernel.FORCED if static or plant.cogging else 0,
    )  # fmt: skip


def level_for(plant: Plant, command: Array) -> int:
    """Into how many parts, as a power of 2, the samples of a command [m] are cut.

    Stribeck friction is steep near standstill, wherever the command goes. Cogging alone needs parts over
    which no wave turns by more than TURN.
    """
    if plant.static and plant.stribeck_speed:
        return kernel.FORCED
    if not plant.cogging or command.size < 2:
        return 0
    shortest = min(period for _, period, _ in plant.cogging)
    turn = 2.0 * math.pi * float(np.abs(np.diff(command)).max()) / shortest
    return min(max(math.ceil(math.log2(max(turn, TURN) / TURN)), 0), kernel.FINE)


def _wave(amplitude: float, period: float, phase: float) -> tuple[float, float, float]:
    return amplitude, 2.0 * math.pi / period, phase


def _holds(plant: Plant) -> int:
    """Say what keeps motor and table a gap apart while they touch."""
    if plant.windup_frequency:
        return kernel.SPRING
    return kernel.TABLE if plant.feedback == "load" else kernel.PLAY
