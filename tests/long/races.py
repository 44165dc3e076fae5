"""Random paths on random machines: is `auto` as good as the best single strategy in the same time?

All are judged by the machine of the tests' own (:mod:`support.two_masses`), with the backlash as it is and off by its
uncertainty. A strategy that takes longer than allowed, breaks a limit or is above the plain motion anywhere is none.

    python -m tests.long.races --seed 2024 --count 200 --out tests/long/races.json
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path as File
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

sys.path.insert(0, str(File(__file__).parents[1]))

from long.claims import run_table
from support.motions import look
from support.random_jobs import RandomJob, random_job

from ph_post.analysis.path_analysis import Analysis
from ph_post.compensate.offsets import command_of, plan_time
from ph_post.compensate.plan import make_plan
from ph_post.compensate.violations import check_command
from ph_post.errors import PhPostError
from ph_post.types import Machine, Plan

SINGLES = ("lead", "takeup", "fly", "dwell", "suppress", "retrograde", "linear", "step")
BASELINES = ("linear", "step", "none")

LEAD = "lead"
"""The plain motion with inverse dynamics, where the job allows it."""

SEED = 2024
JOBS = 200

EFFORT = 0.05
"""Part of the usual search: what must hold may not rest on a long one."""

AS_GOOD = 1.05
"""Ratio to the best single strategy."""

WORSE = 1.003
"""Ratio up to which an error is not larger: motions of different times are sampled at different places."""

RESOLVED = 2e-8
"""Errors [m] that the small steps of the simulation do not tell apart."""


class Raced(NamedTuple):
    """A job: errors [m] of `auto`, of the plain motion, and of the strategies that are any (largest, rms, 95 %).

    Each has a row for every size of the backlash; times in s.
    """

    number: int
    kind: str
    feedback: tuple[str, ...]
    found: NDArray[np.float64]
    plain: NDArray[np.float64]
    singles: dict[str, NDArray[np.float64]]
    chosen: str
    time: float
    plain_time: float
    allowed: float
    seconds: float

    @property
    def best(self) -> tuple[str, float]:
        """Strategy with the least of the largest errors in the worst case, and that error [m]; the plain one, too."""
        sizes = {"none": self.plain, **self.singles}
        name = min(sizes, key=lambda one: float(sizes[one][:, 0].max()))
        return name, float(sizes[name][:, 0].max())

    @property
    def beaten(self) -> bool:
        """Whether a single strategy has less error."""
        return bool(self.found[:, 0].max() > AS_GOOD * self.best[1] + RESOLVED)

    @property
    def worse(self) -> bool:
        """Whether any error is above the plain motion's."""
        return bool(np.any(self.found > WORSE * self.plain + RESOLVED))


def with_backlash(machine: Machine, factor: float) -> Machine:
    """The machine with all backlash times a factor."""
    axes = {
        name: replace(axis, gap=replace(axis.gap, lost_motion=factor * axis.gap.lost_motion))
        for name, axis in machine.axes.items()
    }
    return replace(machine, axes=axes)


def sizes(plan: Plan, analysis: Analysis) -> NDArray[np.float64]:
    """Largest error, root mean square and 95th percentile [m], a row for each size of the backlash."""
    machine = plan.machine
    command = command_of(plan, analysis.track, machine.servo_period)
    spread = max(machine.axes[name].uncertainty.backlash for name in plan.path.axes)
    factors = (1.0,) if spread == 0.0 else (1.0, 1.0 - spread, 1.0 + spread)
    return np.array([run_table(command, with_backlash(machine, one), analysis.track) for one in factors])


def planned(job: RandomJob, analysis: Analysis, strategy: str, effort: float = EFFORT) -> Plan:
    lead = job.options.inverse_dynamics and strategy not in BASELINES
    name = "none" if strategy == LEAD else strategy
    return make_plan(analysis, replace(job.options, strategy=name, inverse_dynamics=lead, effort=effort))


def singles(
    job: RandomJob, analysis: Analysis, plain: Plan, errors: NDArray[np.float64], effort: float = EFFORT
) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Errors of every strategy that keeps time and limits, and is nowhere above the plain motion."""
    longest = (1.0 + job.options.max_slowdown) * plan_time(plain) + 2.0 * job.machine.servo_period
    for strategy in SINGLES:
        allowed = {"retrograde": job.options.allow_retrograde, LEAD: job.options.inverse_dynamics}
        if not allowed.get(strategy, True):
            continue
        try:
            plan = planned(job, analysis, strategy, effort)
        except PhPostError:
            continue
        command = command_of(plan, analysis.track, job.machine.servo_period)
        if plan_time(plan) <= longest and not check_command(command, job.machine):
            found = sizes(plan, analysis)
            if np.all(found <= WORSE * errors + RESOLVED):
                yield strategy, found


def race(number: int, seed: int = SEED, effort: float = EFFORT) -> Raced:
    """Plan a job with `auto`, with every other strategy, and without any."""
    job = random_job(number, seed)
    analysis = look(job.path, job.machine)
    plain = planned(job, analysis, "none", effort)
    start = time.process_time()
    auto = planned(job, analysis, "auto", effort)
    seconds = time.process_time() - start
    errors = sizes(plain, analysis)
    return Raced(
        number=number,
        kind=job.kind,
        feedback=tuple(job.machine.axes[name].feedback for name in job.path.axes),
        found=sizes(auto, analysis),
        plain=errors,
        singles=dict(singles(job, analysis, plain, errors, effort)),
        chosen=auto.crosses_by or "none",
        time=plan_time(auto),
        plain_time=plan_time(plain),
        allowed=job.options.max_slowdown,
        seconds=seconds,
    )


def described(one: Raced) -> str:
    """Say in a line what was found."""
    found, plain = ("/".join(f"{1e6 * size:.2f}" for size in errors.max(axis=0)) for errors in (one.found, one.plain))
    name, least = one.best
    return (
        f"{one.number} {one.kind} {'+'.join(one.feedback)} {one.allowed:g} allowed: {found} by {one.chosen}, "
        f"plain {plain}, best {1e6 * least:.2f} by {name} µm; {one.plain_time:.3f} -> {one.time:.3f} s; "
        f"planned in {one.seconds:.1f} s{', BEATEN' if one.beaten else ''}{', WORSE' if one.worse else ''}"
    )


def summary(raced: Sequence[Raced]) -> dict[str, Any]:
    """Counts of what was raced, what `auto` gained, and the numbers of the jobs in which it was beaten or worse."""
    gains = np.array([one.plain[:, 0].max() / max(one.found[:, 0].max(), RESOLVED) for one in raced])
    ahead = [one for one in raced if one.found[:, 0].max() < one.best[1] / AS_GOOD - RESOLVED]
    return {
        "jobs": len(raced),
        "paths": dict(sorted(Counter(one.kind for one in raced).items())),
        "by": dict(sorted(Counter(one.chosen for one in raced).items())),
        "largest error divided by, in the worst case: quarter, half and three quarters of the jobs": [
            round(float(gain), 3) for gain in np.quantile(gains, (0.25, 0.5, 0.75))
        ],
        "better than every single strategy": len(ahead),
        "beaten by one": [one.number for one in raced if one.beaten],
        "above the plain motion": [one.number for one in raced if one.worse],
        "seconds of the processor for a plan of auto": round(float(np.mean([one.seconds for one in raced])), 2),
    }


def main() -> None:
    """Race many jobs, and write the summary."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seed", type=int, default=SEED)
    asked.add_argument("--first", type=int, default=0)
    asked.add_argument("--count", type=int, default=JOBS)
    asked.add_argument("--step", type=int, default=1)
    asked.add_argument("--effort", type=float, default=EFFORT)
    asked.add_argument("--out", type=File)
    given = asked.parse_args()
    raced: list[Raced] = []
    for number in range(given.first, given.first + given.count, given.step):
        one = race(number, given.seed, given.effort)
        raced.append(one)
        sys.stdout.write(f"{'BAD' if one.beaten or one.worse else 'ok '} {described(one)}\n")
        sys.stdout.flush()
    asked_for = {name: getattr(given, name) for name in ("seed", "first", "count", "step", "effort")}
    text = json.dumps({**asked_for, **summary(raced)}, indent=1) + "\n"
    sys.stdout.write(text)
    if given.out:
        given.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
