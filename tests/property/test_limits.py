"""No sample of any plan breaks a limit: a thousand random paths on as many random machines."""

from __future__ import annotations

import numpy as np
import pytest
from support.motions import KINDS, assert_continuous, look, make_machine, make_path, random_curves, worst_use

from ph_post.compensate.limits import check_command, rounding
from ph_post.compensate.plan import PlanOptions, cycle_time, make_plan
from ph_post.compensate.sample import sample
from ph_post.types import Machine, Path

PAIRS = 1000
BATCHES = 10


def random_pair(rng: np.random.Generator, kind: str) -> tuple[Path, Machine]:
    """A path of that kind and a machine whose limits range from crawling to violent."""
    curves = random_curves(rng, kind)
    acceleration = 10.0 ** rng.uniform(-1.0, 1.5)
    machine = make_machine(
        velocity=10.0 ** rng.uniform(-1.5, 0.5),
        acceleration=acceleration,
        jerk=acceleration * 10.0 ** rng.uniform(0.5, 2.5),
        period=float(rng.choice([5e-4, 1e-3, 2e-3, 4e-3])),
        feedback=str(rng.choice(["load", "motor"])),
    )
    rapid = [0] if len(curves) > 1 and rng.random() < 0.2 else []
    return make_path(curves, feed=10.0 ** rng.uniform(-2.0, -0.3), rapid=rapid), machine


def random_options(rng: np.random.Generator) -> PlanOptions:
    return PlanOptions(
        strategy="none" if rng.random() < 0.2 else "suppress",
        start="moving" if rng.random() < 0.5 else "rest",
        degree=int(rng.choice([4, 6, 10, 14])),
        ratio=None if rng.random() < 0.3 else float(rng.uniform(-0.6, 1.2)),
        t_star=None if rng.random() < 0.8 else 10.0 ** rng.uniform(-2.0, -0.5),
        allow_retrograde=True,
    )


@pytest.mark.slow
@pytest.mark.parametrize("batch", range(BATCHES))
def test_no_sample_breaks_a_limit(batch: int) -> None:
    profiles = 0
    for number in range(batch, PAIRS, BATCHES):
        rng = np.random.default_rng([2022, number])
        path, machine = random_pair(rng, KINDS[number // BATCHES % len(KINDS)])
        analysis = look(path, machine)
        plan = make_plan(analysis, random_options(rng))
        command = sample(plan, analysis.track, machine.servo_period)
        assert check_command(command, machine) == (), number
        # The same without the library's own check, and by how little rounding may excuse.
        limits = machine.axes["X"].limits
        extent = float(np.abs(command.position).max())
        noise = rounding(
            extent, analysis.track.length, cycle_time(plan.phases), float(np.abs(command.feed).max())
        )
        allowed = noise * (2.0 / machine.servo_period) ** np.arange(1, 4)
        allowed /= [limits.velocity, limits.acceleration, limits.jerk]
        assert np.all(np.array(worst_use(command, machine)) <= 1.0 + allowed), number
        assert (
            abs(command.s[-1] - analysis.track.length) <= plan.phases[-1].speed.max() * machine.servo_period
        )
        assert_continuous(plan, analysis.track.length)
        profiles += sum(profile is not None for profile in plan.profiles)
    assert profiles > 30
