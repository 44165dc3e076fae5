"""What the strategies reach on the paper's circle, and behind open loops on the shipped oval and butterfly.

The error on the circle is told here by its radius alone, and the motions that `--feed-only` has to match are
made here from Eqs. (26)-(30); the machine is the library's, which is tested for itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.interpolate import BPoly

from ph_post.analysis.path_analysis import Analysis, analyse
from ph_post.compensate.offsets import command_of
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.violations import check_command
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.simulate.assess import Assessment, assess
from ph_post.simulate.contour import Nominal
from ph_post.simulate.machine import simulate
from ph_post.types import Command, Limits, Machine, Pickup, Scenario, frozen
from ph_post.types import Path as ToolPath

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]
Flank = Literal["+", "-"]

RADIUS = 0.25
SPEED = RADIUS * np.pi / 6.0
SETTLED = 1.0
"""Five servo time constants 2b/c of the paper's drive [s]."""

RULES: tuple[Pickup, ...] = ("standstill", "momentum", "contact")
GAPS = (1.0, 0.8, 1.2)
FREE, LIMITED = 0.10, 0.15
"""More time that may be taken without limits, and with the paper machine's."""

SAME = 2e-9
"""Errors [m] are found to about 1e-9 m each."""


def paper_machine(rule: Pickup | None, limited: bool) -> Machine:
    """The machine of the worked example with a rule, or with none; without limits they are beyond reach."""
    machine = read_machine("paper")
    axes = {}
    for name, axis in machine.axes.items():
        limits = axis.limits
        if not limited:
            limits = replace(limits, velocity=1e3, acceleration=1e6, jerk=1e9, motor_acceleration=None)
        axes[name] = replace(axis, gap=replace(axis.gap, pickup=rule), limits=limits)
    return replace(machine, axes=axes)


class Result(NamedTuple):
    """Commands of `none` and another on one machine."""

    machine: Machine
    none: Command
    other: Command

    @property
    def longer(self) -> float:
        """Time that the other takes more, as a part."""
        return float(self.other.t[-1] / self.none.t[-1]) - 1.0

    def errors(self, rule: Pickup, gap: float) -> tuple[float, float]:
        """Largest radial errors [m] of both with that rule and gap."""
        none, other = (radial_error(self.machine, command, rule, gap) for command in (self.none, self.other))
        return none, other

    def gain(self, rule: Pickup, gap: float = 1.0) -> float:
        none, other = self.errors(rule, gap)
        return none / other


def radial_error(
    machine: Machine, command: Command, rule: Pickup, gap: float, flanks: Sequence[Flank] = ("+", "-")
) -> float:
    """Largest | |x| - R | after the start has settled, on the worse of initial flanks [m]."""
    begin = command.t[np.argmax(command.s > 0.0)] - command.period
    counted = command.t >= begin + SETTLED - 1e-9
    worst = 0.0
    for flank in flanks:
        run = simulate(command, machine, Scenario(pickup=rule, flank=flank, gap=gap))
        worst = max(worst, float(np.abs(np.hypot(*run.executed[counted].T) - RADIUS).max()))
    return worst


def commands(analysis: Analysis, machine: Machine, **options: Any) -> tuple[Command, Command]:
    """`none`, and `auto` with options."""
    start = options["start"]
    plain = make_plan(analysis, PlanOptions(strategy="none", start=start))
    chosen = make_plan(analysis, PlanOptions(strategy="auto", **options))
    track, period = analysis.track, machine.servo_period
    return command_of(plain, track, period), command_of(chosen, track, period)


@lru_cache(maxsize=16)
def on_circle(rule: Pickup | None, limited: bool, **options: Any) -> Result:
    machine = paper_machine(rule, limited)
    path = shipped_path("circle")
    assert path.feed == pytest.approx(SPEED, rel=1e-9)
    allowed = LIMITED if limited else FREE
    given: dict[str, Any] = {"start": "moving", "inverse_dynamics": True, "max_slowdown": allowed} | options
    result = Result(machine, *commands(analyse(path, machine, 5e-6), machine, **given))
    assert result.longer <= allowed
    assert check_command(result.other, machine) == ()
    return result


@pytest.mark.parametrize("limited", [False, True])
@pytest.mark.thinned(4)
def test_a_table_that_stops_dead_is_brought_across_the_gap(limited: bool) -> None:
    result = on_circle("standstill", limited)
    assert result.gain("standstill") >= 50.0
    assert result.gain("standstill", 0.8) >= 5.0
    assert result.gain("standstill", 1.2) >= 5.0


@pytest.mark.parametrize("limited", [False, True])
@pytest.mark.thinned(4)
def test_a_motor_that_keeps_its_momentum_is_brought_across_the_gap(limited: bool) -> None:
    result = on_circle("momentum", limited)
    assert result.gain("momentum") >= 50.0
    assert_never_worse(result, ("momentum",))


@pytest.mark.parametrize("limited", [False, True])
@pytest.mark.thinned(8)
def test_where_the_rule_is_open_none_of_them_is_made_worse(limited: bool) -> None:
    assert_never_worse(on_circle(None, limited), RULES)


@pytest.mark.parametrize("rule", ["standstill", None, "momentum"])
@pytest.mark.thinned(4)
def test_from_rest_nothing_is_made_worse(rule: Pickup | None) -> None:
    assert_never_worse(on_circle(rule, limited=True, start="rest"), (rule,) if rule else RULES)


def assert_never_worse(result: Result, rules: tuple[Pickup, ...]) -> None:
    for rule in rules:
        for gap in GAPS:
            none, other = result.errors(rule, gap)
            assert other <= none + SAME, (rule, gap)


# --- feed alone ---------------------------------------------------------------------------------------------

CANDIDATES = 600

COARSE = 4e-3
"""Servo period at which candidates are sorted [s]."""

BEST = 12
"""Candidates that are looked at closely."""


def dipped_circle(coefficients: Array, t_star: float, period: float) -> Command | None:
    """The circle with the same dip at all four turning points: Eqs. (26)-(30), from the seam once around.

    The path begins and ends in the middle (of the way) of a dip. None where dips overlap.
    """
    omega = SPEED / RADIUS
    way = omega * 2.0 * t_star * float(coefficients.mean())
    quarter = 0.5 * np.pi
    if not 0.0 < way < quarter:
        return None
    travel = BPoly(coefficients[:, None], [-t_star, t_star]).antiderivative()
    angle = _Angle(travel, omega, t_star, way, quarter)
    count = int(np.floor(angle.lap / period * 4.0 + 1e-9)) + 1
    t = period * np.arange(count)
    theta, feed = angle.at(t, coefficients)
    zero = np.zeros(count, dtype=np.int64)
    position = RADIUS * np.column_stack([np.cos(theta), np.sin(theta)])
    return Command(
        axes=("X", "Y"),
        period=period,
        t=t,
        segment=zero,
        xi=theta,
        s=RADIUS * theta,
        position=frozen(position),
        feed=feed,
        window=zero,
    )


class _Angle:
    """Angle on the circle in time; `lap` is the time from one turning point to the next."""

    def __init__(self, travel: BPoly, omega: float, t_star: float, way: float, quarter: float) -> None:
        self.travel, self.omega, self.t_star, self.way, self.quarter = travel, omega, t_star, way, quarter
        self.lap = 2.0 * t_star + (quarter - way) / omega
        # When half the way of a dip is done, the last time should it move back.
        low, high = -t_star, t_star
        for count in (2001, 101):
            fine = np.linspace(low, high, count)
            last = np.flatnonzero(omega * travel(fine) < 0.5 * way)[-1]
            low, high = fine[last], fine[min(last + 1, count - 1)]
        self.middle = float(low)

    def at(self, t: Array, coefficients: Array) -> tuple[Array, Array]:
        number, since = np.divmod(t + self.middle + self.t_star, self.lap)
        inside = np.minimum(since, 2.0 * self.t_star) - self.t_star
        beyond = np.maximum(since - 2.0 * self.t_star, 0.0)
        theta = number * self.quarter + self.omega * (self.travel(inside) + beyond) - 0.5 * self.way
        factor = BPoly(coefficients[:, None], [-self.t_star, self.t_star])(inside)
        return theta, SPEED * np.where(beyond > 0.0, 1.0, factor)


def candidates(rng: np.random.Generator, lowest: float) -> list[tuple[Array, float]]:
    """A grid of the paper's profiles over n, V(1/2)/V_c and t*, and random free coefficients."""
    found = []
    for degree in (4, 6, 8, 10):
        for ratio in np.linspace(max(lowest, -0.4), 1.4, 10):
            found += [(from_ratio(degree, ratio), t_star) for t_star in (0.1, 0.2, 0.35, 0.5, 0.7)]
    while len(found) < CANDIDATES:
        degree = int(rng.choice([4, 6, 8, 10]))
        coefficients = np.ones(degree + 1)
        coefficients[2:-2] = rng.uniform(-1.5, 2.0, degree - 3)
        if rng.random() < 0.5:
            coefficients = 0.5 * (coefficients + coefficients[::-1])
        found.append((coefficients, 10.0 ** rng.uniform(-1.2, -0.1)))
    u = np.linspace(0.0, 1.0, 201)
    return [one for one in found if BPoly(one[0][:, None], [0.0, 1.0])(u).min() >= lowest]


def from_ratio(degree: int, ratio: float) -> Array:
    """Eq. (26) with all V_k = V_c but the middle one."""
    coefficients = np.ones(degree + 1)
    coefficients[degree // 2] = 1.0 + (ratio - 1.0) * 2.0**degree / math.comb(degree, degree // 2)
    return coefficients


@pytest.mark.parametrize("retrograde", [False, True])
@pytest.mark.thinned(4)
def test_feed_alone_is_as_good_as_a_search_by_brute_force(retrograde: bool) -> None:
    result = on_circle("standstill", limited=False, feed_only=True, allow_retrograde=retrograde)
    assert result.other.offset is None
    none = [result.errors("standstill", gap)[0] for gap in GAPS]
    for command in brute_force(result, -2.0 if retrograde else 0.0):
        errors = [radial_error(result.machine, command, "standstill", gap) for gap in GAPS]
        # What has to be matched keeps to the same rules: never worse than none, the gap off or not.
        if all(one <= plain for one, plain in zip(errors, none, strict=True)):
            assert result.errors("standstill", 1.0)[1] <= errors[0] + SAME


def brute_force(result: Result, lowest: float) -> list[Command]:
    """The best candidates that take no more time than is allowed, picked at a coarse period."""
    found = []
    for coefficients, t_star in candidates(np.random.default_rng(26), lowest):
        command = dipped_circle(coefficients, t_star, COARSE)
        if command is not None and command.t[-1] <= (1.0 + FREE) * result.none.t[-1]:
            error = radial_error(result.machine, command, "standstill", 1.0, flanks=("+",))
            found.append((error, coefficients, t_star))
    assert len(found) > 100
    best = sorted(found, key=lambda one: one[0])[:BEST]
    fine = [dipped_circle(coefficients, t_star, result.none.period) for _, coefficients, t_star in best]
    return [command for command in fine if command is not None]


# --- loops that are not closed over the table --------------------------------------------------------------

EXAMPLE = Limits(velocity=0.5, acceleration=5.0, jerk=100.0)
"""The limits of the interface's example."""


def with_lost_motion(name: str, limits: Limits | None = None) -> Machine:
    """A shipped machine with 0.05 mm of lost motion on every axis, and limits in place of its own."""
    machine = read_machine(name)
    axes = {
        key: replace(axis, gap=replace(axis.gap, lost_motion=0.05e-3), limits=limits or axis.limits)
        for key, axis in machine.axes.items()
    }
    return replace(machine, axes=axes)


@pytest.mark.parametrize("name", ["router", "stepper"])
@pytest.mark.thinned(4)
def test_a_gap_behind_the_loop_is_carried_by_the_command(name: str) -> None:
    assert_twentyfold(with_lost_motion(name), shipped_path("oval"))


def test_thirty_reversals_of_a_nurbs_are_crossed_where_the_feed_leaves_time() -> None:
    # At its own feed the butterfly leaves 26 ms a reversal, less than the jerk limit asks for a crossing.
    slow = replace(shipped_path("butterfly"), feed=0.01)
    assert_twentyfold(with_lost_motion("stepper", EXAMPLE), slow)


def assert_twentyfold(machine: Machine, path: ToolPath) -> None:
    """The largest error shrinks twentyfold, within the limits and for a tenth more time."""
    analysis = analyse(path, machine, 5e-6)
    none, auto = commands(analysis, machine, start="rest", inverse_dynamics=True)
    assert auto.t[-1] <= 1.1 * none.t[-1]
    assert check_command(auto, machine) == ()
    nominal = Nominal(analysis.track)
    before, after = (assess(command, machine, nominal) for command in (none, auto))
    assert largest(after) <= largest(before) / 20.0


def largest(assessment: Assessment) -> float:
    assert assessment.error is not None
    return assessment.error.max


def shipped_path(name: str) -> ToolPath:
    return read_path(Path(__file__).parents[2] / "paths" / f"{name}.json")
