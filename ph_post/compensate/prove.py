"""Prove a plan against the plain program, by simulation of every machine that the machine file leaves possible."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from msgspec.structs import replace

from ph_post.compensate import plan_warnings
from ph_post.compensate.layout import without_axes
from ph_post.compensate.motion import cycle_time, without_strategy
from ph_post.compensate.offsets import approach_time, command_of
from ph_post.compensate.strategies.base import ProfileRequest, StrategyResult
from ph_post.compensate.violations import check_command
from ph_post.simulate.assess import for_each_scenario, scenarios
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

TOO_LONG: Final = "the stops that a lasting offset needs take longer than --max-slowdown allows"

GIVEN_UP: Final = "nothing that was tried is better than the plain motion in every case"


def prove(plan: Plan, result: StrategyResult, planner: Planner) -> Plan:
    """Remove every change that makes an error larger than the plain program's in any scenario, or breaks a limit.

    The largest contour error of the whole run counts: for every pick-up rule with every size of the backlash,
    the largest of its scenarios. Round by round the last change before such an error is removed. A plan that
    still takes too long after quicker designs were asked for is replaced by the plain one.

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
    plan, result = _in_time(plan, result, planner)
    checker = _Checker(planner, without_strategy(plan))
    for _ in range(ROUNDS):
        if _takes_too_long(plan, planner):
            break
        blamed = checker.blame(plan)
        if blamed is None:
            return plan
        requests = tuple(
            _without(request, planner.machine) if number in blamed else request
            for number, request in enumerate(result.requests)
        )
        if all(one is other for one, other in zip(requests, result.requests, strict=True)):
            break
        result = replace(result, requests=requests)
        plan = planner.plan(plan.strategy, result)
    nothing = tuple(ProfileRequest(shape=None, note=GIVEN_UP) for _ in result.requests)
    left = planner.plan(plan.strategy, StrategyResult(requests=nothing))
    return replace(left, phases=left.nominal, inverse_dynamics=False)


def _in_time(plan: Plan, result: StrategyResult, planner: Planner) -> tuple[Plan, StrategyResult]:
    """Ask for quicker designs while the plan takes longer than it may."""
    part = 1.0
    for _ in range(SHORTENINGS):
        if result.shorter is None or not _takes_too_long(plan, planner):
            break
        end, plain = _ends(plan)
        part *= 0.97 * (planner.longest - plain) / (end - plain)
        result = result.shorter(part)
        plan = planner.plan(plan.strategy, result)
    if planner.options.writes_program and result.shifted and _takes_too_long(plan, planner):
        # What jogs take at stops of the path is no matter of designs.
        return _without_stops(plan, result, planner)
    return plan, result


def _without_stops(plan: Plan, result: StrategyResult, planner: Planner) -> tuple[Plan, StrategyResult]:
    """Leave out the axis with the least lost motion whose stops free enough time, or else all axes."""
    end, plain = _ends(plan)
    play = {name: planner.machine.axes[name].gap.lost_motion for name in result.shifted}
    one_each = [(name,) for name in sorted(play, key=lambda name: (play[name], name))]
    for left in dict.fromkeys((*one_each, tuple(result.shifted))):
        said = plan_warnings.stop_time_warning(left, end - plain, (end - plain) / plain)
        fewer = replace(without_axes(result, left, TOO_LONG), warnings=(*result.warnings, said))
        plan = planner.plan(plan.strategy, fewer)
        if not _takes_too_long(plan, planner):
            break
    return plan, fewer


def _takes_too_long(plan: Plan, planner: Planner) -> bool:
    return _ends(plan)[0] > planner.longest * (1.0 + TIMED)


def _ends(plan: Plan) -> tuple[float, float]:
    """Durations of a plan and of the plain one [s], without the approach."""
    return cycle_time(plan.phases) - approach_time(plan), cycle_time(plan.nominal)


def _without(request: ProfileRequest, machine: Machine) -> ProfileRequest:
    """Leave the feed alone; a lasting offset still has to be changed."""
    lasting = tuple(one for one in request.crossings if not machine.axes[one.axis].loop.encloses_backlash)
    if request.shape is None and not request.stop and lasting == request.crossings:
        return request
    return ProfileRequest(shape=None, crossings=lasting, note=GIVEN_UP)


def _case(scenario: Scenario) -> object:
    """Return what must not become worse by itself: every pick-up rule with every size of the backlash."""
    return scenario.pickup, scenario.gap


def _largest(error: Array) -> tuple[float, int]:
    """Largest size of an error and its row; none where no rows count."""
    if error.size == 0:
        return 0.0, 0
    row = int(np.argmax(np.abs(error)))
    return abs(float(error[row])), row


class _Checker:
    """The plain program in every scenario, and how others compare."""

    def __init__(self, planner: Planner, before: Plan) -> None:
        self.planner = planner
        self.track = planner.analysis.track
        self.period = planner.machine.servo_period
        self.nominal = Nominal(self.track)
        command = command_of(before, self.track, self.period)
        self.scenarios = scenarios(planner.machine, command.axes)
        self.plain: dict[object, float] = {}
        for scenario, (error, _) in zip(self.scenarios, self._largest(command), strict=True):
            key = _case(scenario)
            self.plain[key] = max(self.plain.get(key, 0.0), error)

    def _largest(self, command: Command) -> tuple[tuple[float, int], ...]:
        """Largest error in every scenario [m], and the row that has it, of those that count."""
        return for_each_scenario(command, self.planner.machine, self.nominal, self.scenarios, _largest)

    def blame(self, plan: Plan) -> set[int] | None:
        """Return the windows to give up; None where the plan is never worse and keeps the limits."""
        command = command_of(plan, self.track, self.period)
        instants = [violation.t for violation in check_command(command, self.planner.machine)]
        first = first_counted(command, self.planner.machine)
        for scenario, (error, row) in zip(self.scenarios, self._largest(command), strict=True):
            if error > self.plain[_case(scenario)] + SAME:
                instants.append(float(command.t[first + row]))
        if not instants:
            return None
        return {self._last_before(plan, t) for t in instants} - {-1}

    @staticmethod
    def _last_before(plan: Plan, t: float) -> int:
        """Window of what was done last before an instant, or first of all; -1 where nothing was."""
        begins = [(phase.start, phase.window) for phase in plan.phases if phase.window >= 0]
        begins += [(one.start, one.window) for one in plan.crossings if one.window >= 0]
        before = [entry for entry in begins if entry[0] <= t]
        return max(before)[1] if before else min(begins, default=(0.0, -1))[1]
