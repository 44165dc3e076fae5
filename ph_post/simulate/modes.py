"""The modes of a plant as the compiled engine takes them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ph_post.drive.automaton import build_automaton
from ph_post.drive.plant import Plant
from ph_post.simulate import kernel
from ph_post.types import frozen


@lru_cache(maxsize=512)
def modes_of(plant: Plant, period: float) -> kernel.Modes:
    """Return the modes of a plant for steps of a period [s]."""
    automaton = build_automaton(plant)
    return kernel.Modes(
        tables=kernel.step_tables(automaton.rates, period), counts=automaton.counts,
        guards=automaton.guards, slopes=frozen(np.matmul(automaton.guards, automaton.rates)),
        noise=automaton.noise, targets=automaton.targets, resets=automaton.resets,
        directions=automaton.directions, moving=automaton.moving,
        static=plant.static if plant.stribeck_speed else 0.0, scale=plant.stribeck_speed,
    )  # fmt: skip
