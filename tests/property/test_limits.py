"""No sample of any plan breaks a limit: random paths on as many random machines, with dips and with holds."""

from __future__ import annotations

import numpy as np
import pytest
from support import amount
from support.motions import KINDS, assert_continuous, look, make_machine, make_path, random_curves, worst_use

from ph_post.compensate import profile, shapes
from ph_post.compensate.motion import cycle_time, sample
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult
from ph_post.compensate.violations import check_command, rounding
from ph_post.geometry.track import Track
from ph_post.types import Command, Machine, Path, Plan

PAIRS = 1000
PAIRS_WITH_HOLDS = 600
"""tests/long tries them all."""

EACH = 8
"""So many of each kind of path otherwise."""


def drawn(count: int) -> list[int]:
    return amount.sample([number % len(KINDS) for number in range(count)], EACH)


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


def assert_limits_are_kept(plan: Plan, machine: Machine, number: int) -> Command:
    track = Track(plan.path)
    command = sample(plan, track, machine.servo_period)
    assert check_command(command, machine) == (), number
    # The same without the library's own check, and by how little rounding may excuse.
    limits = machine.axes["X"].limits
    extent = float(np.abs(command.position).max())
    noise = rounding(extent, track.length, cycle_time(plan.phases), float(np.abs(command.feed).max()))
    allowed = noise * (2.0 / machine.servo_period) ** np.arange(1, 4)
    allowed /= [limits.velocity, limits.acceleration, limits.jerk]
    assert np.all(np.array(worst_use(command, machine)) <= 1.0 + allowed), number
    assert_continuous(plan, track.length)
    return command


def try_dip(number: int) -> int:
    """Plan a random motion with dips, or none, and check every sample; return how many dips it has."""
    rng = np.random.default_rng([2022, number])
    path, machine = random_pair(rng, KINDS[number % len(KINDS)])
    plan = make_plan(look(path, machine), random_options(rng))
    command = assert_limits_are_kept(plan, machine, number)
    left = abs(command.s[-1] - Track(path).length)
    assert left <= plan.phases[-1].speed.max() * machine.servo_period
    return sum(found is not None for found in plan.profiles)


@pytest.mark.slow
def test_no_sample_breaks_a_limit() -> None:
    assert sum(map(try_dip, drawn(PAIRS))) > 15


class RandomHolds:
    """Wants in every window another stop, or a slow stretch, its ramps and its place by chance."""

    name = "holds"
    summary = "for the test"
    feedbacks = frozenset({"load", "motor", "none"})

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def profiles(self, task: PlanningTask) -> StrategyResult:
        return StrategyResult(requests=tuple(self._request() for _ in task.windows))

    def _request(self) -> ProfileRequest:
        rng = self.rng
        down, up = rng.uniform(0.1, 1.0, 2)
        hold = rng.choice([0.0, 10.0 ** rng.uniform(-4.0, 0.0)])
        floor = 0.0 if rng.random() < 0.7 else float(rng.uniform(0.0, 0.9))
        shape = profile.plateau(down, hold, up, floor, order=int(rng.integers(1, 6)))
        middle = (down + 0.5 * hold) / (down + hold + up)
        turn = 0.5 if rng.random() < 0.3 else shapes.share_of_way(shape, middle)
        t_star, leaves = 10.0 ** rng.uniform(-2.0, 0.5), bool(rng.random() < 0.5)
        return ProfileRequest(shape=shape, t_star=t_star, turn=turn, may_leave_window=leaves)


class Entry:
    name = "holds"

    def __init__(self, strategy: RandomHolds) -> None:
        self.strategy = strategy

    def load(self) -> RandomHolds:
        return self.strategy


def try_stop(number: int, monkeypatch: pytest.MonkeyPatch) -> int:
    """Plan a random motion with stops and slow stretches, and check every sample; return how often it stands."""
    rng = np.random.default_rng([2023, number])
    path, machine = random_pair(rng, KINDS[number % len(KINDS)])
    entry = Entry(RandomHolds(rng))
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: [entry])
    strategy = "dwell" if rng.random() < 0.4 else "holds"
    start = "moving" if rng.random() < 0.5 else "rest"
    slowest = 0.1 if rng.random() < 0.3 else 1e3
    options = PlanOptions(strategy=strategy, start=start, max_slowdown=slowest)
    plan = make_plan(look(path, machine), options)
    assert_limits_are_kept(plan, machine, number)
    return sum(phase.window >= 0 and not np.any(phase.speed) for phase in plan.phases)


@pytest.mark.slow
def test_no_sample_breaks_a_limit_where_the_path_stands_still(monkeypatch: pytest.MonkeyPatch) -> None:
    assert sum(try_stop(number, monkeypatch) for number in drawn(PAIRS_WITH_HOLDS)) > 5
