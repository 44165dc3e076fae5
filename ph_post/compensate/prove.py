"""Prove a plan against the plain program, by simulation of every machine that the machine file leaves possible."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from msgspec.structs import replace

from ph_post.compensate import plan_warnings
from ph_post.compensate.layout import without_axes
from ph_post.compensate.offsets import approach_time, command_of
from ph_post.compensate.strategies.base import ProfileRequest, StrategyResult
from ph_post.compensate.violations import check_command
from ph_post.simulate.assess import for_each_scenario, scenarios
from ph_post.simulate.contour import Nominal, first_counted
from ph_post.types import Array, Command, Machine, Plan, Scenario

if TYPE_CHECKING:
    from ph_post.compensate.plan import Planner

ROUNDS: Final = 12
"""Times that something is given up before everything is."""

SHORTENINGS: Final = 4
"""Times that quicker designs are asked for."""

TIMED: Final = 1e-4
"""Part by which a plan may take longer than it may: profiles are laid at the lowest feed around them."""

SAME: Final = 1e-9
"""Errors [m] that differ by less are the same."""

TOO_LONG: Final = "the stops that a lasting offset needs take longer than --max-slowdown allows"

GIVEN_UP: Final = "nothing that was tried is better than the plain motion in every case"


def prove(plan: Plan, proposal: StrategyResult, draft: Planner) -> Plan:
    """Give up whatever makes an error larger than the plain program's, in any scenario, or breaks a limit.

    What still takes too long when it was asked to be quicker is given up as a whole.

    The largest error of the whole run counts; for every pick-up rule with every size of the gap that is the
    largest of its scenarios. What was done last before it is given up, in the end perhaps everything.

    Parameters
    ----------
    plan : Plan
        Of `proposal`.
    proposal : StrategyResult
    draft : Planner

    Returns
    -------
    Plan
        Proven, and perhaps poorer.
    """
    plan, proposal = _in_time(plan, proposal, draft)
    judge = _Checker(draft)
    for _ in range(ROUNDS):
        if _takes_too_long(plan, draft):
            break
        blamed = judge.blame(plan)
        if blamed is None:
            return plan
        wishes = tuple(
            _without(wish, draft.machine) if number in blamed else wish for number, wish in enumerate(proposal.wishes)
        )
        if all(one is other for one, other in zip(wishes, proposal.wishes, strict=True)):
            break
        proposal = replace(proposal, wishes=wishes)
        plan = draft.plan(plan.strategy, proposal)
    return replace(draft.plain(GIVEN_UP), strategy=plan.strategy)


def _in_time(plan: Plan, proposal: StrategyResult, draft: Planner) -> tuple[Plan, StrategyResult]:
    """Ask for quicker designs while the plan takes longer than it may."""
    part = 1.0
    for _ in range(SHORTENINGS):
        if proposal.shorter is None or not _takes_too_long(plan, draft):
            break
        end, plain = _ends(plan)
        part *= 0.97 * (draft.longest - plain) / (end - plain)
        proposal = proposal.shorter(part)
        plan = draft.plan(plan.strategy, proposal)
    if draft.options.carrier == "program" and proposal.shifted and _takes_too_long(plan, draft):
        # What jogs take at stops of the path is no matter of designs.
        return _without_stops(plan, proposal, draft)
    return plan, proposal


def _without_stops(plan: Plan, proposal: StrategyResult, draft: Planner) -> tuple[Plan, StrategyResult]:
    """Leave one axis without a lasting offset, that with the least lost motion that will do, or else all."""
    end, plain = _ends(plan)
    play = {name: draft.machine.axes[name].gap.lost_motion for name in proposal.shifted}
    one_each = [(name,) for name in sorted(play, key=lambda name: (play[name], name))]
    for left in dict.fromkeys((*one_each, tuple(proposal.shifted))):
        said = plan_warnings.stops_cost(left, end - plain, (end - plain) / plain)
        fewer = replace(without_axes(proposal, left, TOO_LONG), warnings=(*proposal.warnings, said))
        plan = draft.plan(plan.strategy, fewer)
        if not _takes_too_long(plan, draft):
            break
    return plan, fewer


def _takes_too_long(plan: Plan, draft: Planner) -> bool:
    return _ends(plan)[0] > draft.longest * (1.0 + TIMED)


def _ends(plan: Plan) -> tuple[float, float]:
    """Durations of a plan and of the plain one [s], without the approach."""
    end, plain = (phases[-1].start + phases[-1].duration for phases in (plan.phases, plan.nominal))
    return end - approach_time(plan), plain


def _without(wish: ProfileRequest, machine: Machine) -> ProfileRequest:
    """Leave the feed alone; a lasting offset still has to be changed."""
    lasting = tuple(one for one in wish.crossings if not machine.axes[one.axis].loop.encloses_backlash)
    if wish.shape is None and not wish.stop and lasting == wish.crossings:
        return wish
    return ProfileRequest(shape=None, crossings=lasting, note=GIVEN_UP)


def _case(scenario: Scenario) -> object:
    """Tell what must not become worse by itself: every pick-up rule with every size of the gap."""
    return scenario.pickup, scenario.gap


def _largest(error: Array) -> tuple[float, int]:
    """Largest size of an error and its row; none where no rows count."""
    if error.size == 0:
        return 0.0, 0
    row = int(np.argmax(np.abs(error)))
    return abs(float(error[row])), row


class _Checker:
    """The plain program in every scenario, and how others compare."""

    def __init__(self, draft: Planner) -> None:
        self.draft = draft
        self.track = draft.analysis.track
        self.period = draft.machine.servo_period
        self.nominal = Nominal(self.track)
        plain = command_of(draft.plain(), self.track, self.period)
        self.scenarios = scenarios(draft.machine, plain.axes)
        self.plain: dict[object, float] = {}
        for scenario, (error, _) in zip(self.scenarios, self._largest(plain), strict=True):
            key = _case(scenario)
            self.plain[key] = max(self.plain.get(key, 0.0), error)

    def _largest(self, command: Command) -> tuple[tuple[float, int], ...]:
        """Largest error in every scenario [m], and the row that has it, of those that count."""
        return for_each_scenario(command, self.draft.machine, self.nominal, self.scenarios, _largest)

    def blame(self, plan: Plan) -> set[int] | None:
        """Return the windows to give up; None where the plan is never worse and keeps the limits."""
        command = command_of(plan, self.track, self.period)
        instants = [violation.t for violation in check_command(command, self.draft.machine)]
        first = first_counted(command, self.draft.machine)
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
