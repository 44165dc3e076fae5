"""Warnings of machine files whose numbers look like another unit."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from ph_post.compensate.plan_warnings import doubtful_values, side_warnings
from ph_post.drive.machinefile import read_machine
from ph_post.types import EffectSetting, Machine
from ph_post.units import MM


def changed(lost: float | None = None, velocity: float | None = None) -> Machine:
    """The shipped stepper with another X."""
    machine = read_machine("stepper")
    axis = machine.axes["X"]
    if lost is not None:
        axis = replace(axis, gap=replace(axis.gap, lost_motion=lost))
    if velocity is not None:
        axis = replace(axis, limits=replace(axis.limits, velocity=velocity))
    return replace(machine, axes={**machine.axes, "X": axis})


@pytest.mark.parametrize(
    ("machine", "said"),
    [
        (changed(), []),
        (changed(lost=0.3 * MM, velocity=2.0), []),
        (changed(lost=6.0 * MM), ["axis X: a lost motion of 6 mm is unusual; is the machine file right?"]),
        (changed(velocity=3.0), ["axis X: max_velocity_mm_s = 3000 is 180 m/min; are these mm/min?"]),
        (changed(lost=0.0), ["the machine file states no lost motion of X: nothing is compensated there"]),
    ],
)
def test_numbers_that_look_like_another_unit_are_doubted(machine: Machine, said: list[str]) -> None:
    assert doubtful_values(machine, ["X"]) == said


@pytest.mark.parametrize(("part", "warned"), [(0.4, True), (2.0, False)])
def test_a_table_that_friction_does_not_hold_is_warned_of(part: float, warned: bool) -> None:
    """A force that stops the whole axis at part of what its motor brakes with, as an error: m = b K, F / K = b a."""
    axis = read_machine("router").axes["X"]
    brakes = part * axis.limits.acceleration
    error = {"following_error_mm": axis.servo.b * brakes / MM}
    found = side_warnings([replace(axis, effects=(EffectSetting(name="coulomb_friction", parameters=error),))])
    assert len(found) == warned
    if warned:
        assert f"brakes harder than its friction, {brakes / MM:g} mm/s²" in found[0]
        assert f"max_acceleration_mm_s2 = {0.9 * brakes / MM:g} or less" in found[0]
