"""The speed at a joint, without a program, against the planners' own motion and the published rules."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from ph_post.dialects.planners import planner_of
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import read_program
from ph_post.simulate.controllers.chords import straight_blocks
from ph_post.simulate.controllers.exact_path import plan_trapezoids
from ph_post.simulate.controllers.junctions import SAFE, junction_speed
from ph_post.simulate.controllers.moves import limit_table, written_legs
from ph_post.simulate.controllers.run import run_program
from ph_post.types import Machine, PlannerSettings

X, Y = np.eye(3)[:2]
ANGLES = (1.0, 3.0, 7.0, 15.0, 30.0, 60.0, 90.0, 120.0)


def machine_for(dialect: str, **stated: float) -> Machine:
    base = read_machine("stepper")
    axes = {
        name: replace(axis, limits=replace(axis.limits, velocity=0.05, acceleration=0.5))
        for name, axis in base.axes.items()
    }
    return replace(base, axes=axes, dialect=dialect, servo_period=1e-3, planner=PlannerSettings(**stated))


def turned(angle: float):
    return np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle)), 0.0])


def slowest_near_the_corner(machine: Machine, angle: float, feed: float, mode: str, length: float) -> float:
    """Speed of the model at the corner between two lines, with room to speed up and to slow down around them [m/s]."""
    way = turned(angle)
    places = [
        10.0 * X,
        (10.0 + length) * X,
        (10.0 + length) * X + length * way,
        (10.0 + length) * X + (length + 10) * way,
    ]
    lines = [f"G1 X{x:.7f} Y{y:.7f} F{feed * 60:g}" for x, y, _ in places]
    part = read_program("\n".join(["G21 G90", mode, *lines, ""]).encode(), "test")
    found = run_program(part, machine)
    at = int(np.argmin(np.linalg.norm(found.position - places[1] * 1e-3, axis=1)))
    return float(found.feed[max(at - 8, 0) : at + 9].min())


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("dialect", ["grbl", "grblhal", "marlin", "klipper"])
def test_exact_path_planners_pass_corners_at_that_speed(dialect, angle) -> None:
    machine = machine_for(dialect)
    way = turned(angle) * 10.0
    lines = ("G21", "G90", "G1 X10 F1200", f"G1 X{10 + way[0]:.9f} Y{way[1]:.9f}", "")
    part = read_program("\n".join(lines).encode(), "test", language=find_dialect(dialect).language)
    limits, planner = limit_table(machine), planner_of(machine)
    plan = plan_trapezoids(straight_blocks(part, written_legs(part, limits), limits, planner), planner, limits)
    found = float(junction_speed(machine, X, turned(angle), 0.01, 0.01, feed=0.02))
    assert found == pytest.approx(math.sqrt(plan.square[1, 0]), rel=1e-6)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize(("mode", "tolerance"), [("G64 P0.002 Q0", 2e-6), ("G64 P0.05 Q0", 5e-5), ("G64", 0.0)])
def test_linuxcnc_passes_corners_at_least_at_that_speed(mode, tolerance, angle) -> None:
    machine = machine_for("linuxcnc")
    for feed, length in ((20.0, 10.0), (10.0, 0.3), (40.0, 5.0)):
        size, asked = length * 1e-3, feed * 1e-3
        found = float(junction_speed(machine, X, turned(angle), size, size, feed=asked, tolerance=tolerance))
        real = slowest_near_the_corner(machine, angle, feed, mode, length)
        assert found <= real * 1.02
        assert found >= 0.5 * SAFE * real or real < 1e-3


def test_the_crossing_of_a_gap_is_passed_without_slowing_down() -> None:
    """0.05 mm over 0.4 mm, 7 degrees at 20 mm/s: no planner slows down for it."""
    bent = turned(math.degrees(math.atan2(0.05, 0.4)))
    for dialect in ("grbl", "grblhal", "marlin", "klipper"):
        assert float(junction_speed(machine_for(dialect), X, bent, 0.01, 4e-4, feed=0.02)) == 0.02
    assert float(junction_speed(machine_for("linuxcnc"), X, bent, 0.01, 4e-4, feed=0.02, tolerance=2e-6)) > 0.018


def test_a_square_corner_is_that_of_the_settings() -> None:
    assert float(junction_speed(machine_for("klipper"), X, Y, 0.01, 0.01)) == pytest.approx(5e-3)
    stated = machine_for("klipper", square_corner_velocity=8e-3)
    assert float(junction_speed(stated, X, Y, 0.01, 0.01)) == pytest.approx(8e-3)
    # Grbl: the velocity changes along (-1, 1), where both axes help: a = 500 √2.
    half = math.sqrt(0.5)
    expected = math.sqrt(0.5 * math.sqrt(2.0) * 1e-5 * half / (1.0 - half))
    assert float(junction_speed(machine_for("grbl"), X, Y, 0.01, 0.01)) == pytest.approx(expected)


def test_exact_stops_reversals_and_straight_lines() -> None:
    for dialect in ("grbl", "marlin", "klipper", "linuxcnc"):
        machine = machine_for(dialect)
        assert float(junction_speed(machine, X, -X, 0.01, 0.01, feed=0.02)) == 0.0
        assert float(junction_speed(machine, X, X, 0.01, 0.01, feed=0.02)) == pytest.approx(0.02)
    assert float(junction_speed(machine_for("linuxcnc"), X, Y, 0.01, 0.01, feed=0.02, tolerance=-2.0)) == 0.0


def test_many_joints_at_once_are_as_one_by_one() -> None:
    random = np.random.default_rng(5)
    units = random.normal(size=(2, 3, 40, 3))
    units /= np.linalg.norm(units, axis=-1)[..., None]
    length = random.uniform(1e-5, 1e-2, (2, 3, 40))
    for dialect in ("grbl", "marlin", "klipper", "linuxcnc"):
        machine = machine_for(dialect)
        found = junction_speed(machine, units[0], units[1], length[0], length[1], feed=0.02)
        assert found.shape == (3, 40)
        single = junction_speed(machine, units[0, 1, 7], units[1, 1, 7], length[0, 1, 7], length[1, 1, 7], feed=0.02)
        assert float(single) == found[1, 7]
