"""Prove a plan against the plain program, by simulation of every machine that the machine file leaves possible."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.compensate import plan_warnings
from ph_post.compensate.error_sizes import Sizes, sizes_of
from ph_post.compensate.friction import friction_of_machine, little_friction
from ph_post.compensate.layout import without_axes
from ph_post.compensate.motion import cycle_time, without_strategy
from ph_post.compensate.offsets import command_of, plan_time
from ph_post.compensate.plan_warnings import run_on_warnings
from ph_post.compensate.strategies.base import ProfileRequest, StrategyResult
from ph_post.compensate.violations import check_command
from ph_post.simulate.assess import for_each_scenario, is_nominal, scenarios
from ph_post.simulate.contour import Nominal, first_counted
from ph_post.types import Array, Command, Machine, Plan, Scenario

if TYPE_CHECKING:
    from ph_post.compensate.plan import Planner

ROUNDS: Final = 12
"""Rounds in which changes are removed one by one, before all of them are."""

SHORTENINGS: Final = 4
"""Times that quicker designs are asked for."""

TIMED: Final = 1e-4
"""Part by which a plan may take longer than it may: profiles are laid at the lowest feed around them."""

SAME: Final = 1e-9
"""Errors [m] that differ by less are the same."""

NO_WORSE: Final = 1.002
"""Ratio by which root mean square and percentile of the error may be larger: a motion that takes longer is sampled
at other places. The largest error may not be."""

LEAST_FRICTION: Final = 0.05
"""By how much more than what may be left of the friction is led at least, or else none of it."""

TOO_LONG: Final = "the stops that a lasting offset needs take longer than --max-slowdown allows"

OUT_OF_TIME: Final = "what was tried takes longer than --max-slowdown allows"

GIVEN_UP: Final = "nothing that was tried is better than the plain motion in every case"


class Proven(NamedTuple):
    """A plan that is nowhere worse than the plain program, and what it is made of; None for the plain one."""

    plan: Plan
    result: StrategyResult | None


def prove(plan: Plan, result: StrategyResult, planner: Planner) -> Plan:
    """Remove every change that makes an error larger than the plain program's in any scenario, or breaks a limit.

    The largest contour error of the whole run counts, its root mean square and its 95th percentile: for every pick-up
    rule with every size of the backlash, the largest of its scenarios. Round by round a change is removed: the last
    one before a largest error, and the one around which most of the mean square, or of what lies above the percentile,
    came to be. Where friction is led and little of it would do harm, less of it is led. A plan that still takes too
    long after quicker designs were asked for is replaced by the plain one.

    Parameters
    ----------
    plan : Plan
        Of `result`.
    result : StrategyResult
    planner : Planner

    Returns
    -------
    Plan
        Nowhere worse than the plain program.
    """
    plan, result = in_time(plan, result, planner)
    return prove_in_time(plan, result, planner, Checker(planner, without_strategy(plan))).plan


def prove_in_time(
    plan: Plan,
    result: StrategyResult,
    planner: Planner,
    checker: Checker,
    known: Mapping[Scenario, Sizes] = {},
    command: Command | None = None,
) -> Proven:
    """Prove a plan for which quicker designs were asked for already, by :func:`in_time`.

    Parameters
    ----------
    plan, result, planner
        As of :func:`prove`.
    checker : Checker
        Of the plain program.
    known : mapping, optional
        Sizes of the plan's error in some scenarios.
    command : Command, optional
        Of the plan.
    """
    for _ in range(ROUNDS):
        if takes_too_long(plan, planner):
            break
        removable = [k for k, one in enumerate(result.requests) if without_design(one, planner.machine) is not one]
        blamed = checker.blame(plan, removable, known, command)
        if blamed is None:
            return Proven(plan, result)
        if checker.too_much_friction > 0.0 and plan.friction_part:
            less = _less_friction(plan.friction_part, checker.too_much_friction, checker.little)
            result = replace(result, friction_part=less)
            plan, known, command = planner.plan(plan.strategy, result), {}, None
            continue
        requests = tuple(
            without_design(request, planner.machine) if number in blamed else request
            for number, request in enumerate(result.requests)
        )
        if all(one is other for one, other in zip(requests, result.requests, strict=True)):
            break
        result = replace(result, requests=requests)
        plan, known, command = planner.plan(plan.strategy, result), {}, None
    why = OUT_OF_TIME if takes_too_long(plan, planner) else GIVEN_UP
    return Proven(left_alone(plan.strategy, result, planner, why), None)


def left_alone(name: str, result: StrategyResult, planner: Planner, why: str) -> Plan:
    """Return the plain plan, in which every turning point is left alone for a reason."""
    nothing = tuple(ProfileRequest(shape=None, note=why) for _ in result.requests)
    left = planner.plan(name, StrategyResult(requests=nothing, warnings=result.warnings))
    axes = (planner.machine.axes[name] for name in left.path.axes)
    said = (*left.warnings, *(one for one in run_on_warnings(axes) if one not in left.warnings))
    return replace(left, phases=left.nominal, inverse_dynamics=False, warnings=said)


def _less_friction(part: float, ratio: float, little: float) -> float:
    """Return the part to lead where errors are larger by a ratio on a machine with little friction.

    Of what is led too much there, they are a multiple.
    """
    less = little + 0.97 * (part - little) / ratio
    return less if less > little + LEAST_FRICTION else 0.0


def in_time(plan: Plan, result: StrategyResult, planner: Planner) -> tuple[Plan, StrategyResult]:
    """Ask for quicker designs while the plan takes longer than it may."""
    part, plain = 1.0, planner.baseline.valid.motion.end
    for _ in range(SHORTENINGS):
        # Where axes are braked more gently the motion by itself may take too long.
        if result.shorter is None or plain >= planner.longest or not takes_too_long(plan, planner):
            break
        part *= 0.97 * (planner.longest - plain) / (plan_time(plan) - plain)
        result = result.shorter(part)
        plan = planner.plan(plan.strategy, result)
    if planner.options.writes_program and result.shifted and takes_too_long(plan, planner):
        # What jogs take at stops of the path is no matter of designs.
        return _without_stops(plan, result, planner)
    return plan, result


def _without_stops(plan: Plan, result: StrategyResult, planner: Planner) -> tuple[Plan, StrategyResult]:
    """Leave out the axis with the least lost motion whose stops free enough time, or else all axes."""
    end, plain = plan_time(plan), cycle_time(plan.nominal)
    play = {name: planner.machine.axes[name].gap.lost_motion for name in result.shifted}
    one_each = [(name,) for name in sorted(play, key=lambda name: (play[name], name))]
    for left in dict.fromkeys((*one_each, tuple(result.shifted))):
        said = plan_warnings.stop_time_warning(left, end - plain, (end - plain) / plain)
        fewer = replace(without_axes(result, left, TOO_LONG), warnings=(*result.warnings, said))
        plan = planner.plan(plan.strategy, fewer)
        if not takes_too_long(plan, planner):
            break
    return plan, fewer


def takes_too_long(plan: Plan, planner: Planner) -> bool:
    """Return whether a plan takes longer than --max-slowdown allows."""
    return plan_time(plan) > planner.longest * (1.0 + TIMED)


def without_design(request: ProfileRequest, machine: Machine) -> ProfileRequest:
    """Leave the feed alone; a lasting offset still has to be changed."""
    lasting = tuple(one for one in request.crossings if not machine.axes[one.axis].loop.encloses_backlash)
    changed = request.stop or request.friction or request.slowed < 1.0
    if request.shape is None and not changed and lasting == request.crossings:
        return request
    return ProfileRequest(shape=None, crossings=lasting, note=GIVEN_UP)


def _case(scenario: Scenario) -> object:
    """Return what must not become worse by itself: a pick-up rule, a backlash, a friction, tables that run on."""
    return scenario.pickup, scenario.gap, scenario.spread, scenario.friction, scenario.runs_on


class Checker:
    """The plain program in every scenario, and how others compare.

    Parameters
    ----------
    planner : Planner
    before : Plan
        The plain one.
    """

    def __init__(self, planner: Planner, before: Plan) -> None:
        self.planner = planner
        self.track = planner.analysis.track
        self.period = planner.machine.servo_period
        self.nominal = Nominal(self.track)
        self.before = command_of(before, self.track, self.period)
        self.scenarios = scenarios(planner.machine, self.before.axes)
        rubbing = friction_of_machine(planner.machine, self.before.axes) if planner.lead else ()
        # Where no friction is led no scenario has so little: NaN is equal to none.
        self.little = little_friction(planner.machine.axes[name] for name in rubbing) if rubbing else math.nan
        if rubbing:
            rules = {one.pickup: one for one in reversed(self.scenarios) if is_nominal(one)}
            self.scenarios += tuple(replace(one, friction=self.little) for one in rules.values())
        self.too_much_friction = 0.0
        self.sizes = self.measure(self.before, self.scenarios)
        self.plain: dict[object, Sizes] = {}
        for scenario, found in zip(self.scenarios, self.sizes, strict=True):
            known = self.plain.get(_case(scenario), found)
            largest, rms, most = (max(pair) for pair in zip(known[:3], found[:3], strict=True))
            self.plain[_case(scenario)] = Sizes(largest, rms, most, found.row)

    def measure(self, command: Command, tried: Sequence[Scenario]) -> tuple[Sizes, ...]:
        """Sizes of the error in some scenarios, of the rows that count."""
        return for_each_scenario(command, self.planner.machine, self.nominal, tried, sizes_of)

    def around(self, command: Command, middles: Array, tried: Sequence[Scenario]) -> tuple[tuple[Array, Array], ...]:
        """Largest size of the error [m], and its mean square's parts, around windows by the middles between them."""
        first = first_counted(command, self.planner.machine)
        owner = np.searchsorted(middles, command.s[first:])

        def take(error: Array) -> tuple[Array, Array]:
            largest = np.zeros(middles.size + 1)
            np.maximum.at(largest, owner, np.abs(error))
            return largest, np.bincount(owner, error * error, middles.size + 1) / max(error.size, 1)

        return for_each_scenario(command, self.planner.machine, self.nominal, tried, take)

    def blame(
        self,
        plan: Plan,
        removable: Sequence[int],
        known: Mapping[Scenario, Sizes] = {},
        command: Command | None = None,
    ) -> set[int] | None:
        """Return the windows to give up; None where the plan is never worse and keeps the limits.

        `removable` are the windows in which something can still be given up; `known` is what was measured
        already, `command` that of the plan, if there is one.
        """
        command = command_of(plan, self.track, self.period) if command is None else command
        instants = [violation.t for violation in check_command(command, self.planner.machine)]
        first = first_counted(command, self.planner.machine)
        broader: set[int] = set()
        worse, self.too_much_friction = False, 0.0
        left = [one for one in self.scenarios if one not in known]
        sizes = {**known, **dict(zip(left, self.measure(command, left) if left else (), strict=True))}
        for scenario in self.scenarios:
            found = sizes[scenario]
            plain = self.plain[_case(scenario)]
            broader_error = found.rms > NO_WORSE * plain.rms + SAME
            if found.max > plain.max + SAME:
                instants.append(float(command.t[first + found.row]))
            elif broader_error or found.most > NO_WORSE * plain.most + SAME:
                worse = True
                broader |= self._around(command, scenario, 0.0 if broader_error else plain.most, removable)
            else:
                continue
            if scenario.friction == self.little:
                ratios = (own / (other + SAME) for own, other in zip(found[:3], plain[:3], strict=True))
                self.too_much_friction = max(self.too_much_friction, *ratios)
        if not instants and not worse:
            return None
        return {self._last_before(plan, t) for t in instants} - {-1} | broader

    def _around(self, command: Command, scenario: Scenario, limit: float, removable: Sequence[int]) -> set[int]:
        """Return the window around which more of the mean square beyond a limit is than in the plain program."""
        if not removable:
            return set()
        places = np.array([self.planner.analysis.windows[k].s for k in removable])

        def shares(one: Command) -> Array:
            first = first_counted(one, self.planner.machine)
            (error,) = for_each_scenario(one, self.planner.machine, self.nominal, (scenario,), np.abs)
            owner = np.searchsorted(0.5 * (places[:-1] + places[1:]), one.s[first:])
            weight = np.where(error > limit, error * error, 0.0)
            return np.asarray(np.bincount(owner, weight, places.size) / max(error.size, 1))

        return {removable[int(np.argmax(shares(command) - shares(self.before)))]}

    @staticmethod
    def _last_before(plan: Plan, t: float) -> int:
        """Window of what was done last before an instant, or first of all; -1 where nothing was."""
        begins = [(phase.start, phase.window) for phase in plan.phases if phase.window >= 0]
        begins += [(one.start, one.window) for one in plan.crossings if one.window >= 0]
        before = [entry for entry in begins if entry[0] <= t]
        return max(before)[1] if before else min(begins, default=(0.0, -1))[1]
