"""The step that controllers add: against what the paper circle's turning points say it must be."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.motions import look, make_machine, make_path

from ph_post.compensate.offsets import command_of
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.errors import InputError
from ph_post.geometry.curves import Arc
from ph_post.types import Gap

RADIUS, FEED, LOST, ACCELERATION = 0.02, 0.05, 40e-6, 5.0
BEGIN, END = math.radians(-60.0), math.radians(240.0)

SHIFTS = {
    3: (lambda u: u * u * (3.0 - 2.0 * u), 6.0),
    5: (lambda u: u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 10.0 / math.sqrt(3.0)),
}
"""Smooth steps by degree, and the largest size of their second derivatives."""


def arc():
    start, end = (RADIUS * np.array([math.cos(angle), math.sin(angle)]) for angle in (BEGIN, END))
    return make_path([Arc(start, end, np.zeros(2), "ccw")], FEED)


@pytest.mark.parametrize("degree", SHIFTS)
def test_an_axis_behind_its_loop_is_shifted_at_every_reversal(degree: int) -> None:
    shift, steepest = SHIFTS[degree]
    machine = make_machine(feedback="motor", gap=Gap(lost_motion=LOST), acceleration=ACCELERATION)
    analysis = look(arc(), machine)
    options = PlanOptions(strategy="step", start="moving", degree=degree)
    command = command_of(make_plan(analysis, options), analysis.track, machine.servo_period)
    duration = math.sqrt(steepest * LOST / (0.5 * ACCELERATION))
    expected = np.empty_like(command.position)
    # From -60 degrees X moves up until 0 and down until 180 degrees; Y moves up until 90.
    turns = {0: ((0.0, -1.0), (math.pi, 1.0)), 1: ((0.5 * math.pi, -1.0),)}
    for axis, reversals in turns.items():
        expected[:, axis] = 0.5 * LOST
        for angle, direction in reversals:
            since = command.t - (angle - BEGIN) * RADIUS / FEED
            expected[:, axis] += direction * LOST * shift(np.clip(since / duration, 0.0, 1.0))
    # How finely the steepest place of the step is looked for leaves a thousandth of its duration.
    np.testing.assert_allclose(command.offset, expected, rtol=0.0, atol=2e-3 * LOST)
    angle = BEGIN + command.t * FEED / RADIUS
    place = RADIUS * np.column_stack([np.cos(angle), np.sin(angle)])
    np.testing.assert_allclose(command.position - command.offset, place, rtol=0.0, atol=1e-12)


def test_a_loop_over_the_table_refuses_a_step() -> None:
    machine = make_machine(feedback="load")
    with pytest.raises(InputError, match="step does not compensate axes with these feedback loops"):
        make_plan(look(arc(), machine), PlanOptions(strategy="step"))


def test_an_axis_with_a_scale_is_left_alone_beside_one_without() -> None:
    machine = make_machine(feedback="motor", gap=Gap(lost_motion=LOST))
    scale = make_machine().axes["Y"]
    machine = type(machine)(name="mixed", dialect="linuxcnc", servo_period=1e-3, axes={**machine.axes, "Y": scale})
    analysis = look(arc(), machine)
    plan = make_plan(analysis, PlanOptions(strategy="step", start="moving"))
    command = command_of(plan, analysis.track, machine.servo_period)
    assert np.ptp(command.offset[:, 0]) == pytest.approx(LOST, rel=1e-9)
    assert not np.any(command.offset[:, 1])
