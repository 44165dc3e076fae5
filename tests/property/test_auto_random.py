"""On random paths and machines `auto` is never worse than `none`, keeps the limits and stays on the path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from support.amount import sample
from support.motions import look, worst_use
from support.random_jobs import KINDS, RandomJob, random_job

from ph_post.analysis.path_analysis import Analysis
from ph_post.compensate.offsets import command_of
from ph_post.compensate.plan import make_plan
from ph_post.compensate.violations import rounding
from ph_post.geometry.track import Track
from ph_post.simulate.assess import contour_errors, scenarios
from ph_post.simulate.contour import Nominal
from ph_post.types import Axis, Command, Machine, Path, Plan

SAME = 2e-9
"""Errors [m] are found to about 1e-9 m each."""

Array = NDArray[np.float64]


class Judged(NamedTuple):
    """Plan and command of a strategy, and the largest contour error [m] by pick-up rule."""

    plan: Plan
    command: Command
    worst: Mapping[str | None, float]

    @property
    def error(self) -> float:
        return max(self.worst.values())


def run(job: RandomJob, analysis: Analysis, nominal: Nominal, strategy: str) -> Judged:
    lead = job.options.inverse_dynamics and strategy != "none"
    options = replace(job.options, strategy=strategy, inverse_dynamics=lead, effort=EFFORT)
    plan = make_plan(analysis, options)
    command = command_of(plan, analysis.track, job.machine.servo_period)
    worst: dict[str | None, float] = {}
    tried = scenarios(job.machine, command.axes)
    for scenario, error in zip(tried, contour_errors(command, job.machine, nominal, tried), strict=True):
        found = 0.0 if error is None else error.max
        worst[scenario.pickup] = max(worst.get(scenario.pickup, 0.0), found)
    return Judged(plan, command, worst)


PAIRS = 200
"""tests/long tries them all."""

EFFORT = 0.05
"""Part of the usual search: what must hold may not rest on a long one."""


def assert_never_worse(none: Judged, auto: Judged) -> None:
    assert auto.error <= none.error + SAME
    for rule, error in none.worst.items():
        assert auto.worst[rule] <= error + SAME, rule


def assert_limits_are_kept(command: Command, path: Path, machine: Machine) -> None:
    """Differences of the samples, and of the rest before and after them; rounding alone is excused."""
    extent, speed = float(np.abs(command.position).max()), float(np.abs(command.feed).max())
    noise = rounding(extent, Track(path).length, float(command.t[-1]), speed)
    limits = [machine.axes[name].limits for name in command.axes]
    least = np.array([min(getattr(one, name) for one in limits) for name in ("velocity", "acceleration", "jerk")])
    excused = noise * (2.0 / machine.servo_period) ** np.arange(1, 4) / least
    assert np.all(np.array(worst_use(command, machine)) <= 1.0 + excused)


def assert_offsets_are_all_that_leaves_the_path(command: Command, path: Path, machine: Machine) -> None:
    """What is declared is what is added to the path, and no more than gap and servo explain."""
    offset = np.zeros_like(command.position) if command.offset is None else command.offset
    place = np.empty_like(command.position)
    for number, segment in enumerate(path.segments):
        rows = command.segment == number
        place[rows] = segment.curve.derivatives(command.xi[rows], 0)[0]
    np.testing.assert_allclose(command.position - offset, place, rtol=0.0, atol=1e-9)
    for number, name in enumerate(command.axes):
        allowed = largest_offset(machine.axes[name]) + largest_rounding(machine, command.axes, name)
        assert np.abs(offset[:, number]).max() <= allowed * (1.0 + 1e-9) + 1e-12, name


def largest_rounding(machine: Machine, axes: Sequence[str], name: str) -> float:
    """What a window of twice the time in which the slowest servo answers takes off the path at most.

    Within its reach r a path leaves its tangent by a r²/2, and the window's weights come to less than 5/4. An axis
    that follows at once is seen through the window of the others.
    """
    servos = [machine.axes[one].servo for one in axes]
    answer = max(max(np.sqrt(one.b), 0.5 * one.c) for one in servos)
    reach = max(2.0 * answer, 8.0 * machine.servo_period) if answer else 0.0
    return 1.25 * 0.5 * machine.axes[name].limits.acceleration * float(reach) ** 2


def largest_offset(axis: Axis) -> float:
    """Lost motion, half of it on either side and the uncertainty beyond; and b a + c v at the limits.

    Of PI and PID loops the error that gives an output u is at most 2 |u|: what the integrator has gathered
    may have to be taken back.
    """
    servo, limits = axis.servo, axis.limits
    lead = servo.b * limits.acceleration + servo.c * limits.velocity
    held = 2.0 if servo.ki_over_kp else 1.0
    return (1.0 + axis.uncertainty.backlash) * axis.gap.lost_motion + held * lead


def assert_time_is_kept(none: Judged, auto: Judged, job: RandomJob) -> None:
    """A motion ends with a whole period, either of the two."""
    longer = float(auto.command.t[-1] - none.command.t[-1])
    assert longer <= job.options.max_slowdown * none.command.t[-1] + 2.0 * job.machine.servo_period


@pytest.mark.slow
@pytest.mark.parametrize("number", sample([number % len(KINDS) for number in range(PAIRS)], 1))
@pytest.mark.thinned(4)
def test_auto_is_never_worse_than_none_and_keeps_what_it_promises(number: int) -> None:
    keeps_its_promises(number)


def keeps_its_promises(number: int) -> None:
    """Try a job: `auto` beside `none`."""
    job = random_job(number)
    analysis = look(job.path, job.machine)
    nominal = Nominal(analysis.track)
    none, auto = (run(job, analysis, nominal, strategy) for strategy in ("none", "auto"))
    try:
        assert_never_worse(none, auto)
        assert_limits_are_kept(auto.command, job.path, job.machine)
        assert_offsets_are_all_that_leaves_the_path(auto.command, job.path, job.machine)
        assert_time_is_kept(none, auto, job)
    except AssertionError as broken:
        broken.add_note(f"in job {number}, {job.kind}, {job.options}")
        raise
