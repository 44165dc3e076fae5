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
@pytest.mark.thinned(8)
def test_small_steps_come_to_the_same_table(rule: str, servo: tuple[float, float], side: int) -> None:
    t = PERIOD * np.arange(500)
    command = 0.004 * (1.0 - np.cos(13.0 * t)) - 1e-3 * np.sin(31.0 * t)
    numbers = {"b": 1.6e-4, "c": 0.025, "gap": 40e-6, "eta": 0.6, "beta": 2.0, "ki": servo[0], "kd": servo[1]}
    known = simulate_axis(Drive(**numbers, rule=rule), command, PERIOD, flank=side)
    body = Body(feedback="load", rule=RULES.index(rule), **numbers)
    # Events are found to a step of 10 µs, in which a motor that crosses its gap makes up to 0.3 µm.
    assert np.abs(table_of(body, command, PERIOD, side, command[0]) - known.table).max() < 2e-7


FRICTION = ((30e-6, 0.0, 0.0, 0.0), (20e-6, 15e-6, 2e-3, 12e-6), (25e-6, 0.0, 0.0, -15e-6))
"""F, S - F, v_s, and a load, each as a position error [m]; v_s in m/s."""


@pytest.mark.parametrize("dry", FRICTION)
@pytest.mark.parametrize("gap", [40e-6, 0.0])
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.thinned(8)
def test_friction_holds_and_brakes_the_same_table(rule: str, gap: float, dry: tuple[float, ...]) -> None:
    force, more, speed, load = dry
    t = PERIOD * np.arange(600)
    command = 0.004 * (1.0 - np.cos(13.0 * t)) - 1e-3 * np.sin(31.0 * t)
    numbers = {"b": 1.6e-4, "c": 0.025, "gap": gap, "eta": 0.6, "beta": 2.0}
    own = {"coulomb": (force, force), "static": more, "stribeck_speed": speed, "load": load}
    known = simulate_axis(Drive(**numbers, **own, rule=rule), command, PERIOD, flank=1)
    friction = (force, force, more, speed, 0.0, 0.0, load)
    body = Body(feedback="load", ki=0.0, kd=0.0, rule=RULES.index(rule), **numbers, friction=friction)
    assert np.abs(table_of(body, command, PERIOD, 1, command[0]) - known.table).max() < 4e-7
