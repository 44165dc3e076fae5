"""What the loops give: by the balance of forces, which the simulation does not look at."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from ph_post.drive import hybrid
from ph_post.drive.hybrid import build_automaton
from ph_post.drive.plant import GapProfile, Plant, TableReading
from ph_post.simulate.machine import AxisCommand, run_plant
from ph_post.types import Array, Cascade, Feedback

PERIOD = 1e-3
T = PERIOD * np.arange(1001)
X = 0.02 * (1.0 - np.cos(7.0 * T)) + 0.004 * (1.0 - np.cos(23.0 * T))
PLANT = Plant(feedback="load", b=4e-4, c=0.02, eta=0.4, beta=4.0)


def run(plant: Plant, way: Array = X, speed: float = 0.0) -> tuple[Array, Array]:
    """What its loops give, and the motor."""
    given = np.empty(way.size)
    motor = run_plant(AxisCommand(way, 0.0, speed), plant, 1, PERIOD, given)[1]
    return given, motor


@pytest.mark.parametrize("feedback", ["load", "motor", "none"])
@pytest.mark.parametrize(("delay", "ki", "kd"), [(0.0, 0.0, 0.0), (4e-3, 0.0, 0.0), (0.0, 3.0, 2e-3)])
def test_the_motor_pays_for_inertia_damping_and_load(feedback: Feedback, delay: float, ki: float, kd: float) -> None:
    """b v + c (m - m_0) + load t is the impulse ∫u of all the time before (Eq. 8, integrated once)."""
    plant = replace(PLANT, feedback=feedback, gap=3e-4 * (feedback != "load"), load=1e-4, command_delay=delay)
    plant = replace(plant, ki=ki, kd=kd)
    e, motor = run(plant)
    speed = np.gradient(motor, PERIOD)
    spent = plant.b * speed + plant.c * (motor - motor[0]) + plant.load * T
    impulse = np.concatenate([[0.0], np.cumsum(0.5 * PERIOD * (e[1:] + e[:-1]))])
    assert impulse[1:-1] == pytest.approx(spent[1:-1], abs=2e-8)
    assert np.abs(impulse).max() > 5e-4


def test_a_late_reading_is_none_of_theirs() -> None:
    late, plain = run(replace(PLANT, reading_delay=5e-3))[0], run(PLANT)[0]
    assert np.array_equal(late, plain)


@pytest.mark.parametrize("feedback", ["load", "motor"])
def test_in_steady_motion_it_is_c_times_the_speed_and_the_load(feedback: Feedback) -> None:
    way = 0.03 * T
    plant = replace(PLANT, feedback=feedback, load=-2e-5)
    e, _ = run(plant, way, 0.03)
    assert e[-1] == pytest.approx(0.02 * 0.03 - 2e-5, abs=1e-3 * math.exp(-25.0))


def test_the_motors_side_of_a_gap_is_its_own() -> None:
    """Behind a gap outside the loop the table has no part in it."""
    wide, _ = run(replace(PLANT, feedback="motor", gap=1e-3))
    none, _ = run(replace(PLANT, feedback="motor"))
    assert wide == pytest.approx(none, abs=1e-15)


@pytest.mark.parametrize("feedback", ["load", "motor"])
def test_plants_that_differ_in_no_equation_share_theirs_and_others_do_not(feedback: Feedback) -> None:
    cascade = Cascade(position_gain=50.0, velocity_gain=200.0, integral_rate=20.0, velocity_feedforward=0.9)
    plant = replace(PLANT, feedback=feedback, gap=3e-5, coulomb_plus=2e-6, static=1e-6, cascade=cascade)
    late = replace(cascade, dead_time=1e-3, moving_average=4e-3, exponential=1e-3, shaper_frequency=90.0)
    cogs, slow = ((1e-6, 5e-3, 0.3),), TableReading(scale=1e-3)
    alike = replace(plant, cascade=late, cogging=cogs, stribeck_speed=2e-3, reading=slow, command_delay=1e-3)
    assert build_automaton(alike) is build_automaton(plant)
    worn = replace(plant, widening=GapProfile(slope=1e-3))
    assert build_automaton(replace(worn, widening=GapProfile(bump=2e-5))) is build_automaton(worn)
    changed = [replace(plant, cascade=replace(cascade, **{name: 0.7})) for name in ("integral_rate", "current_time")]
    further = {"gap": 2e-5, "coulomb_minus": 3e-6, "static": 2e-6, "load": 1e-6, "saturation": 1e-3, "eta": 0.3}
    changed += [worn, *(replace(plant, **{name: value}) for name, value in further.items())]
    assert len({id(build_automaton(one)) for one in (plant, *changed)}) == 1 + len(changed)
    # What is left out is in none of the equations: they are the same where all of it is kept.
    whole, shared = hybrid._built.__wrapped__(alike), build_automaton(plant)
    for name in ("rates", "guards", "noise", "targets", "resets"):
        assert np.array_equal(getattr(whole, name), getattr(shared, name))
