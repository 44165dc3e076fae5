"""On random paths and machines `auto` is as good as the best single strategy in the same time, and never above `none`.

All are judged by the machine of the tests' own (:mod:`support.two_masses`), with the backlash as it is and off by its
uncertainty. A strategy that takes longer than allowed, breaks a limit or is above the plain motion anywhere is none.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from long.claims import run_table
from msgspec.structs import replace
from support.amount import sample
from support.motions import look
from support.random_jobs import KINDS, RandomJob, random_job

from ph_post.analysis.path_analysis import Analysis
from ph_post.compensate.offsets import command_of, plan_time
from ph_post.compensate.plan import make_plan
from ph_post.compensate.violations import check_command
from ph_post.errors import PhPostError
from ph_post.types import Machine, Plan

SINGLES = ("takeup", "fly", "dwell", "suppress", "retrograde", "linear", "step")
BASELINES = ("linear", "step", "none")

PAIRS = 200
"""tests/long tries them all."""

EFFORT = 0.05
"""Part of the usual search: what must hold may not rest on a long one."""

AS_GOOD = 1.05
"""Ratio to the best single strategy."""

WORSE = 1.003
"""Ratio up to which an error is not larger: motions of different times are sampled at different places."""

RESOLVED = 2e-8
"""Errors [m] that the small steps of the simulation do not tell apart."""


def with_backlash(machine: Machine, factor: float) -> Machine:
    """The machine with all backlash times a factor."""
    axes = {
        name: replace(axis, gap=replace(axis.gap, lost_motion=factor * axis.gap.lost_motion))
        for name, axis in machine.axes.items()
    }
    return replace(machine, axes=axes)


def sizes(plan: Plan, analysis: Analysis) -> np.ndarray:
    """Largest error, root mean square and 95th percentile [m], a row for each size of the backlash."""
    machine = plan.machine
    command = command_of(plan, analysis.track, machine.servo_period)
    spread = max(machine.axes[name].uncertainty.backlash for name in plan.path.axes)
    factors = (1.0,) if spread == 0.0 else (1.0, 1.0 - spread, 1.0 + spread)
    return np.array([run_table(command, with_backlash(machine, one), analysis.track) for one in factors])


def planned(job: RandomJob, analysis: Analysis, strategy: str) -> Plan:
    lead = job.options.inverse_dynamics and strategy not in BASELINES
    return make_plan(analysis, replace(job.options, strategy=strategy, inverse_dynamics=lead, effort=EFFORT))


def singles(job: RandomJob, analysis: Analysis, plain: Plan, errors: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Errors of every strategy that keeps time and limits, and is nowhere above the plain motion."""
    longest = (1.0 + job.options.max_slowdown) * plan_time(plain) + 2.0 * job.machine.servo_period
    for strategy in SINGLES:
        if strategy == "retrograde" and not job.options.allow_retrograde:
            continue
        try:
            plan = planned(job, analysis, strategy)
        except PhPostError:
            continue
        command = command_of(plan, analysis.track, job.machine.servo_period)
        if plan_time(plan) <= longest and not check_command(command, job.machine):
            found = sizes(plan, analysis)
            if np.all(found <= WORSE * errors + RESOLVED):
                yield strategy, found


@pytest.mark.slow
@pytest.mark.parametrize("number", sample([number % len(KINDS) for number in range(PAIRS)], 1))
def test_auto_is_as_good_as_the_best_single_strategy(number: int) -> None:
    is_not_beaten(number)


def is_not_beaten(number: int) -> None:
    """Try a job: `auto` beside all others, by the worst case."""
    job = random_job(number)
    analysis = look(job.path, job.machine)
    plain, auto = (planned(job, analysis, strategy) for strategy in ("none", "auto"))
    errors, found = sizes(plain, analysis), sizes(auto, analysis)
    assert np.all(found <= WORSE * errors + RESOLVED), (number, found, errors)
    for strategy, others in singles(job, analysis, plain, errors):
        worst, best = found[:, 0].max(), others[:, 0].max()
        assert worst <= AS_GOOD * best + RESOLVED, (number, strategy, worst, best)
