"""Warnings of machine files whose numbers look like another unit."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from ph_post.compensate.plan_warnings import doubtful_values
from ph_post.drive.machinefile import read_machine
from ph_post.types import Machine
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
        (changed(lost=0.0), ["machine stepper router states no lost motion of X"]),
    ],
)
def test_numbers_that_look_like_another_unit_are_doubted(machine: Machine, said: list[str]) -> None:
    assert doubtful_values(machine, ["X"]) == said
