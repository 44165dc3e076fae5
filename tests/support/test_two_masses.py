"""The two masses of the tests' own in small steps, against the reference simulation from event to event."""

from __future__ import annotations

import numpy as np
import pytest

from support.reference_machine import Drive, simulate_axis
from support.two_masses import Body, table_of

PERIOD = 1e-3
RULES = ("standstill", "momentum", "contact")


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("servo", [(0.0, 0.0), (3.0, 0.0), (2.0, 2e-3)])
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.thinned(4)
def test_small_steps_come_to_the_same_table(rule: str, servo: tuple[float, float], side: int) -> None:
    t = PERIOD * np.arange(500)
    command = 0.004 * (1.0 - np.cos(13.0 * t)) - 1e-3 * np.sin(31.0 * t)
    numbers = {"b": 1.6e-4, "c": 0.025, "gap": 40e-6, "eta": 0.6, "beta": 2.0, "ki": servo[0], "kd": servo[1]}
    known = simulate_axis(Drive(**numbers, rule=rule), command, PERIOD, flank=side)
    body = Body(feedback="load", rule=RULES.index(rule), **numbers)
    # Events are found to a step of 10 µs, in which a motor that crosses its gap makes up to 0.3 µm.
    assert np.abs(table_of(body, command, PERIOD, side, command[0]) - known.table).max() < 2e-7
