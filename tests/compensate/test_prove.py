"""What is proven against the plain program, what is given up, and that the same job gives the same plan."""

from __future__ import annotations

import re

import numpy as np
import pytest
from msgspec.structs import replace
from support.motions import circle, look, make_machine

from ph_post.analysis.path_analysis import Analysis
from ph_post.compensate import profile, shapes, survey
from ph_post.compensate.motion import without_strategy
from ph_post.compensate.offsets import command_of, plan_time
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import Planner, make_plan
from ph_post.compensate.prove import prove
from ph_post.compensate.strategies.base import ProfileRequest, StrategyResult
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.files.storage import or_shipped
from ph_post.simulate.machine import simulate
from ph_post.types import Crossing, Gap, Machine, Phase, Plan, Scenario, Servo

RADIUS, FEED = 0.01, 0.04
LOST = 40e-6


def stepper(**limits: float) -> Machine:
    """Axes that follow at once: a crossing of the gap at rest closes it."""
    gap = Gap(lost_motion=LOST, initial_flank="+")
    return make_machine(feedback="none", servo=Servo(b=0.0, c=0.0), gap=gap, **limits)


def draft_of(machine: Machine) -> tuple[Analysis, Planner]:
    analysis = look(circle(RADIUS, FEED), machine)
    return analysis, Planner(analysis, machine, PlanOptions(strategy="takeup", max_slowdown=0.5))


def stop_and_cross(axis: str, travel: float) -> ProfileRequest:
    shape = profile.plateau(0.08, 0.06, 0.08, 0.0, order=3)
    crossing = Crossing(axis=axis, start=-0.025, duration=0.05, travel=travel)
    turn = shapes.share_of_way(shape, 0.5)
    return ProfileRequest(shape=shape, t_star=0.11, turn=turn, may_leave_window=True, crossings=(crossing,))


def good(analysis: Analysis) -> list[ProfileRequest]:
    """Stop at every turning point, and cross the gap the way the axis goes on."""
    requests = []
    for window in analysis.windows:
        point = analysis.turning_points[window.turning_point]
        requests.append(stop_and_cross(point.axis, -LOST if point.sense == "max" else LOST))
    return requests


def error(plan: Plan, analysis: Analysis, machine: Machine) -> float:
    """Largest | |x| - R | with the gap as it is."""
    command = command_of(plan, analysis.track, machine.servo_period)
    executed = simulate(command, machine, Scenario(flank="+")).executed[command.s > 0.0]
    return float(np.abs(np.hypot(*executed.T) - RADIUS).max())


def proven(planner: Planner, requests: list[ProfileRequest]) -> tuple[Plan, Plan]:
    """The plan as proposed, and what the proof leaves of it."""
    result = StrategyResult(requests=tuple(requests), proven=True)
    plan = planner.plan("takeup", result)
    return plan, prove(plan, result, planner)


def test_what_is_good_is_left_as_it_is() -> None:
    machine = stepper()
    analysis, planner = draft_of(machine)
    plan, kept = proven(planner, good(analysis))
    assert kept is plan
    assert error(kept, analysis, machine) < 0.05 * error(without_strategy(plan), analysis, machine)


def test_a_crossing_the_wrong_way_is_given_up() -> None:
    machine = stepper()
    analysis, planner = draft_of(machine)
    requests = good(analysis)
    (crossing,) = requests[2].crossings
    requests[2] = stop_and_cross(crossing.axis, -3.0 * crossing.travel)
    plan, kept = proven(planner, requests)
    plain = error(without_strategy(plan), analysis, machine)
    assert error(plan, analysis, machine) > 1.5 * plain
    assert error(kept, analysis, machine) <= plain + 1e-9


def test_a_crossing_that_breaks_a_limit_is_given_up() -> None:
    machine = stepper()
    analysis, planner = draft_of(machine)
    requests = good(analysis)
    (crossing,) = requests[1].crossings
    sudden = Crossing(axis=crossing.axis, start=-0.001, duration=0.002, travel=crossing.travel)
    requests[1] = replace(requests[1], crossings=(sudden,))
    _, kept = proven(planner, requests)
    command = command_of(kept, analysis.track, machine.servo_period)
    limits, period = machine.axes["X"].limits, machine.servo_period
    assert np.abs(np.diff(command.position, 2, axis=0)).max() <= limits.acceleration * period**2 * (1 + 1e-9)
    assert np.abs(np.diff(command.position, 3, axis=0)).max() <= limits.jerk * period**3 * (1 + 1e-6)


def test_a_jolt_to_a_loop_over_the_table_is_given_up() -> None:
    """A jolt inside the loop moves the table away."""
    machine = make_machine()
    analysis, planner = draft_of(machine)
    requests = [ProfileRequest(shape=None) for _ in analysis.windows]
    shape = profile.plateau(0.08, 0.06, 0.08, 0.0, order=3)
    jolt = Crossing(axis="X", start=0.0, duration=0.05, travel=0.0, push=5e-4, push_duration=0.1)
    requests[2] = ProfileRequest(shape=shape, t_star=0.11, may_leave_window=True, crossings=(jolt,))
    _, kept = proven(planner, requests)
    assert kept.profiles == (None,) * len(requests)
    assert not kept.crossings


def same(one: Plan, other: Plan) -> bool:
    """Whether two plans are the same to the last bit."""
    phases = all(same_phase(*pair) for pair in zip(one.phases, other.phases, strict=True))
    return phases and one.crossings == other.crossings and one.bias == other.bias


def same_phase(one: Phase, other: Phase) -> bool:
    first, second = ((phase.start, phase.duration, phase.s, phase.window) for phase in (one, other))
    return first == second and np.array_equal(one.speed, other.speed)


@pytest.mark.slow
@pytest.mark.parametrize("feedback", ["load", "motor"])
@pytest.mark.thinned(4)
def test_the_same_job_gives_the_same_plan_twice(feedback: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(survey, "MOST", 60)
    machine = make_machine(feedback=feedback)
    options = PlanOptions(strategy="auto", inverse_dynamics=True, max_slowdown=0.3)
    first, second = (make_plan(look(circle(RADIUS, FEED), machine), options) for _ in range(2))
    assert any(found is not None for found in first.profiles)
    assert same(first, second)


def sizes(plan: Plan, analysis: Analysis) -> tuple[float, float]:
    """Root mean square and 95th percentile of the distance from a circle about the origin, the sides all alike."""
    command = command_of(plan, analysis.track, plan.machine.servo_period)
    executed = simulate(command, plan.machine, Scenario(flank="+")).executed[command.s > 0.0]
    away = np.abs(np.hypot(*executed.T) - RADIUS)
    return float(np.sqrt(np.mean(away**2))), float(np.quantile(away, 0.95))


def test_a_mean_square_that_grows_is_given_up_though_the_largest_error_shrinks() -> None:
    """X alone: the lags of X and Y no longer cancel across the path."""
    machine = stepper()
    analysis, planner = draft_of(machine)
    requests = [one if one.crossings[0].axis == "X" else ProfileRequest(shape=None) for one in good(analysis)]
    plan, kept = proven(planner, requests)
    plain = without_strategy(plan)
    assert error(plan, analysis, machine) <= error(plain, analysis, machine) + 1e-9
    assert sizes(plan, analysis)[0] > 1.05 * sizes(plain, analysis)[0]
    assert all(one <= 1.01 * other for one, other in zip(sizes(kept, analysis), sizes(plain, analysis), strict=True))


@pytest.mark.slow
def test_what_is_left_for_time_says_what_would_change_it() -> None:
    """The pocket on the router: the stops of X alone would fit, but alone they make the error larger."""
    analysis = look(read_path(or_shipped("paths", "pocket")), read_machine("router"))

    def plan(max_slowdown: float) -> Plan:
        return make_plan(analysis, PlanOptions(strategy="auto", carrier="program", max_slowdown=max_slowdown))

    left = plan(0.01)
    assert not left.crossings
    [named] = [re.findall(r"--max-slowdown ([\d.]+) allows it", one) for one in left.warnings if "allows it" in one]
    assert {one.axis for one in plan(float(named[0])).crossings} == {"X", "Y"}
    assert float(named[0]) < 1.1 * (plan_time(plan(0.1)) / plan_time(left) - 1.0)
