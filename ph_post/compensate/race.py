"""Race whole plans of one job: what the search proposes, every strategy's own plan, and offsets that need no stop.

All have the same time and limits, and are measured on the machines that the file leaves possible. The best by its
worst case is proven against the plain program, and what others do better in single places is tried in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.compensate import plan_warnings
from ph_post.compensate.choose import SPARE, smooth_offsets
from ph_post.compensate.error_sizes import Sizes
from ph_post.compensate.feed_planner import PASSING
from ph_post.compensate.lead import lead_window
from ph_post.compensate.motion import without_strategy
from ph_post.compensate.offsets import command_of, plan_time
from ph_post.compensate.prove import (
    GIVEN_UP,
    OUT_OF_TIME,
    Checker,
    in_time,
    left_alone,
    prove_in_time,
    takes_too_long,
    without_design,
)
from ph_post.compensate.slower import Passages, spent
from ph_post.compensate.standstill import added_standing
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult, require_loop, traits_of
from ph_post.compensate.strategies.registry import PLAIN, TAKE_UP, find_strategy, strategy_names
from ph_post.compensate.violations import check_command
from ph_post.errors import InputError, PhPostError
from ph_post.simulate.assess import is_nominal
from ph_post.types import Array, Command, Plan, Scenario

if TYPE_CHECKING:
    from ph_post.compensate.plan import Planner

HEAT: Final = 4
"""Plans that are measured in more than the machine file's own values; of long jobs half as many."""

HEATS: Final = 3
"""Times that as many are tried where nothing of those before could be proven."""

LONG: Final = 50_000
"""Rows beyond which a job is long."""

LEADS: Final = 0.5
"""Ratio to which inverse dynamics alone brings the error where plans without it are not tried."""

PROOFS: Final = 3
"""Plans that are proven, where the proof takes something away from those before."""

NEAR: Final = 1.04
"""Ratio to the least largest error of all that leaves a plan in the race."""

CLOSE: Final = math.log(1.03)
"""Logarithm of the ratio within which largest errors are alike, and the other errors decide."""

ENOUGH: Final = 0.0002
"""Part of the plain error below which less is no better."""

FLOOR: Final = 1e-8
"""Errors [m] below which less is no better."""

SLOWER: Final = 0.5
"""What a plan's further time counts, as part of the plain one's, beside logarithms of errors."""

STANDING: Final = 0.5
"""What the further time that the tool stands or creeps on the contour counts, as part of the plain motion's time."""

GAINED: Final = 0.01
"""Logarithm by which an error must fall for a plan to be better than another."""

KIN: Final = 12
"""Plans at most that are looked at for what they do better in places."""

GRAFTS: Final = 3
"""Plans at most in which the winner has what others do better in places."""

LESS: Final = 0.5
"""Part of these places that are tried next where all of them take too long."""

LEAST_UNIT: Final = 0.1
"""Part of what passing turning points slower was reckoned to take, as which it counts at least."""

RAMPS: Final = 3.0
"""Times what the low feed itself takes that passing a turning point slower takes with its ramps, about."""

LONGER_TRIES: Final = 2
"""Times that longer designs are asked for where limits leave less of those that were chosen."""

SLOWER_TRIES: Final = 2
"""Plans in which turning points are passed slower, as slow as the time allows."""

NEARLY: Final = 0.5
"""Part of the time left for it that is enough to be taken."""

LEAST_GRAFT: Final = 0.05
"""Logarithm by which another plan must be better at a place."""

MORE: Final = 0.8
"""Ratio to which more time must bring an error, to be worth a word."""

WHATEVER: Final = 16.0
"""Times the time allowed with which is asked what more time would bring."""


class Runner(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A plan in the race: what it is made of, its command, and its sizes and places by scenario."""

    planner: Planner
    result: StrategyResult
    plan: Plan
    command: Command
    standing: float
    sizes: tuple[Sizes, ...] = ()
    intact: bool = False


class Place(NamedTuple):
    """Largest error [m] and its sum of squares around every window, each the worst of some scenarios."""

    max: Array
    square: Array


def race(planner: Planner, name: str, result: StrategyResult) -> Plan:
    """Plan a job in every way there is, and return the best plan.

    Parameters
    ----------
    planner : Planner
    name : str
        Of the strategy that chooses.
    result : StrategyResult
        What the search proposes, with its rivals.

    Returns
    -------
    Plan
        Nowhere worse than the plain program; that where nothing is better. Its warnings say what more time would
        bring.
    """
    return _Race(planner, name, result).run()


class _Race:
    """One race."""

    def __init__(self, planner: Planner, name: str, result: StrategyResult) -> None:
        self.planner, self.name, self.result = planner, name, result
        self.progress = planner.progress
        self.late: list[Runner] = []
        self.still: list[Runner] = []
        self.said: tuple[str, ...] = ()
        self.commands: set[int] = set()
        self.known: dict[int, dict[Scenario, Sizes]] = {}

    def run(self) -> Plan:
        """Run the heats, prove the winner, and try in it what others do better."""
        runners = list(self._start(self.planner, self._entrants()))
        planned = runners or self.late or self.still
        if not planned:
            return left_alone(self.name, self.result, self.planner, GIVEN_UP)
        before = without_strategy(planned[0].plan)
        self.checker = checker = Checker(self.planner, before)
        self.known[_looks(checker.before)] = dict(zip(checker.scenarios, checker.sizes, strict=True))
        few = few_scenarios(checker.scenarios)
        usual = (one for one in checker.scenarios if one.friction != checker.little)
        many = tuple(one for one in usual if one.beta == one.gain == 1.0)
        runners = [self._measured(one, few) for one in runners]
        long = checker.before.position.size > LONG
        if self._lead_matters() and not self._leads(runners, few) and (self._shifts() or not long):
            planner = self.planner.with_options(replace(self.planner.options, inverse_dynamics=False))
            runners += [self._measured(one, few) for one in self._start(planner, self._without_lead(planner.task))]
        runners += [self._measured(one, few) for one in self._fuller(self.planner, (self.result, *self.result.rivals))]
        for gentler in self._gentler():
            found = list(self._searched(gentler.task))
            runners += [self._measured(one, few) for one in self._start(gentler, found)]
            runners += [self._measured(one, few) for one in self._fuller(gentler, found)]
        ranked = self._ranked(runners, few)
        winner = self._heats(ranked, HEAT // 2 if long else HEAT, few, many)
        if winner is None:
            words = self._words(None, few)
            plan = left_alone(self.name, self.result, self.planner, OUT_OF_TIME if words else GIVEN_UP)
            return replace(plan, warnings=(*plan.warnings, *words))
        winner = self._slower(self._grafted(winner, ranked, many), ranked, many)
        plan = winner.plan
        return replace(plan, warnings=tuple(dict.fromkeys((*plan.warnings, *self._words(winner, few)))))

    def _entrants(self) -> Iterator[StrategyResult]:
        """Return what the search proposes, its rivals, the named strategies, and nothing but inverse dynamics."""
        yield self.result
        yield from self.result.rivals
        yield from named_results(self.planner.task)
        if self.planner.lead:
            alone = ProfileRequest(shape=None, note=GIVEN_UP)
            requests = (alone,) * len(self.result.requests)
            yield StrategyResult(requests=requests, crosses_by=PLAIN)
            if self.result.friction_part:
                part, first = self.result.friction_part, self.result.friction_first
                yield StrategyResult(requests=requests, crosses_by=PLAIN, friction_part=part, friction_first=first)
            if self.result.pushes_first:
                yield StrategyResult(requests=requests, crosses_by=PLAIN, pushes_first=True)

    def _without_lead(self, task: PlanningTask) -> Iterator[StrategyResult]:
        """Return what is tried without inverse dynamics, whose room takes time that a stop may need more."""
        if self._shifts():
            yield from self._searched(task)
        yield from named_results(task)
        yield from smooth_offsets(task, lead=False)

    def _searched(self, task: PlanningTask) -> Iterator[StrategyResult]:
        """Return what the search proposes for another task, and its rivals."""
        found = find_strategy(self.name).profiles(task)
        yield found
        yield from found.rivals

    def _gentler(self) -> Iterator[Planner]:
        """Return planners whose axes friction holds, where there are any, with inverse dynamics and without."""
        gentler = self.planner.gentler()
        if gentler is not None:
            yield gentler
            if gentler.lead:
                yield gentler.with_options(replace(gentler.options, inverse_dynamics=False))

    def _fuller(self, planner: Planner, found: Sequence[StrategyResult]) -> Iterator[Runner]:
        """Plan with all of the time for inverse dynamics where less leaves only a part of it: without any design.

        Where axes turn back while they rest, or in corners, that costs nothing.
        """
        fuller = planner.fuller(found[0].friction_first)
        if fuller is not None:
            nothing = (ProfileRequest(shape=None, note=GIVEN_UP),) * len(found[0].requests)
            bare = [one for one in found if all(own.shape is None and not own.stop for own in one.requests)]
            yield from self._start(
                fuller, (replace(found[0], requests=nothing, proven=False, shorter=None, longer_at=None), *bare)
            )

    def _shifts(self) -> bool:
        """Return whether any axis may get a lasting offset."""
        axes = [self.planner.machine.axes[name] for name in self.planner.analysis.path.axes]
        return any(not axis.loop.encloses_backlash and axis.gap.lost_motion > 0.0 for axis in axes)

    def _lead_matters(self) -> bool:
        """Return whether plans without inverse dynamics are others: whether an axis lags, or friction is led."""
        lags = lead_window(self.planner.machine, self.planner.analysis.path.axes) is not None
        return self.planner.lead and (lags or self.result.friction_part > 0.0)

    def _leads(self, runners: Sequence[Runner], tried: Sequence[Scenario]) -> bool:
        """Return whether inverse dynamics alone does so much that nothing is tried without it."""
        plain = self._plain(tried)[:, 0].max()
        return any(one.result.crosses_by == PLAIN and _largest(one)[0] < LEADS * plain for one in runners)

    def _start(self, planner: Planner, entrants: Iterable[StrategyResult]) -> Iterator[Runner]:
        """Plan all that is to be tried; what takes too long waits aside, and what breaks a limit is left out."""
        seen: list[tuple[object, ...]] = []
        waiting = [(one, 0) for one in entrants]
        for number, (proposed, tries) in enumerate(waiting):
            looks = (proposed.requests, proposed.shifted, proposed.winds_up, proposed.pushes_first, proposed.carries)
            if looks in seen:
                continue
            seen.append(looks)
            self.progress(f"racing plan {number + 1}")
            try:
                plan, result = in_time(planner.plan(self.name, proposed), proposed, planner)
                runner = self._runner(planner, result, plan)
            except PhPostError:
                continue
            softened = planner.shallow(result.requests, plan.profiles)
            if softened and result.longer_at is not None and tries < LONGER_TRIES:
                # A dip that the limits make shallow does not what was looked for: longer ones may.
                waiting.append((result.longer_at(softened), tries + 1))
            if proposed is self.result:
                self.said = tuple(one for one in result.warnings if one not in proposed.warnings)
            if self._is_known(runner.command):
                continue
            if takes_too_long(plan, planner):
                self.late.append(runner)
            elif self._stands_too_long(runner):
                self.still.append(runner)
            elif proposed.proven or not check_command(runner.command, planner.machine):
                yield runner

    def _is_known(self, command: Command) -> bool:
        """Return whether another plan has come to the same command; if not, it has by now."""
        looks = _looks(command)
        known = looks in self.commands
        self.commands.add(looks)
        return known

    def _runner(self, planner: Planner, result: StrategyResult, plan: Plan) -> Runner:
        track = planner.analysis.track
        command = command_of(plan, track, planner.machine.servo_period)
        return Runner(planner=planner, result=result, plan=plan, command=command, standing=added_standing(plan, track))

    def _stands_too_long(self, runner: Runner) -> bool:
        """Return whether the tool stands or creeps longer on the contour than it may."""
        most = self.planner.options.max_standstill
        return most is not None and runner.standing > most + 2.0 * self.planner.machine.servo_period

    def _measured(self, runner: Runner, tried: Sequence[Scenario]) -> Runner:
        """Measure a plan in some scenarios, if that was not done before."""
        known = self.known.setdefault(_looks(runner.command), {})
        left = [one for one in tried if one not in known]
        known.update(zip(left, self.checker.measure(runner.command, left) if left else (), strict=True))
        return replace(runner, sizes=tuple(known[one] for one in tried))

    def _ranked(self, runners: Sequence[Runner], tried: Sequence[Scenario]) -> list[Runner]:
        """Sort plans, the best first."""
        left, found = list(runners), []
        while left:
            found.append(left.pop(self._best(left, tried)))
        return found

    def _best(self, runners: Sequence[Runner], tried: Sequence[Scenario]) -> int:
        """Return the number of the best plan.

        It has nearly the least largest error in the worst case of the backlash. Of such plans it has the least largest
        error in the worst of all cases and on the machine as the file has it; of those in which that is alike, the
        least of the other errors.
        """
        rows = np.array([self._score(one, tried) for one in runners])
        behind = rows[:, :2] - rows[:, :2].min(axis=0)
        own = [number for number, one in enumerate(tried) if one.friction == 1.0]
        largest = np.array([max(one.sizes[number][0] for number in own) for one in runners])
        near = largest <= NEAR * max(largest.min(), self._least(tried)[0])
        worst = np.where(near, behind.max(axis=1), np.inf)
        close = np.flatnonzero(worst <= worst.min() + CLOSE)
        return int(close[np.argmin(rows[close, 2:].sum(axis=1))])

    def _score(self, runner: Runner, tried: Sequence[Scenario]) -> Array:
        """Logarithms of largest errors, worst and on the machine as the file has it; of the others; and the time."""
        own = [number for number, one in enumerate(tried) if is_nominal(one)]
        table, least = np.array([one[:3] for one in runner.sizes]), self._least(tried)
        worst, nominal = (np.log(np.maximum(rows.max(axis=0), least)) for rows in (table, table[own]))
        time = SLOWER * plan_time(runner.plan) + STANDING * runner.standing
        time /= max(self.planner.before.motion.end, self.checker.period)
        others = [worst[1], nominal[1], 0.5 * worst[2], 0.5 * nominal[2], time]
        return np.array([worst[0], nominal[0], *others])

    def _least(self, tried: Sequence[Scenario]) -> Array:
        """Sizes (3,) below which less is no better."""
        return np.asarray(np.maximum(ENOUGH * self._plain(tried).max(axis=0), FLOOR))

    def _plain(self, tried: Sequence[Scenario]) -> Array:
        """Sizes of the plain motion in some scenarios, shape (scenarios, 3)."""
        known = dict(zip(self.checker.scenarios, self.checker.sizes, strict=True))
        return np.array([known[one][:3] for one in tried])

    def _heats(
        self, ranked: Sequence[Runner], size: int, few: Sequence[Scenario], many: Sequence[Scenario]
    ) -> Runner | None:
        """Prove the best plans, and the next best where nothing of those can be proven, as long as they promise any."""
        for first in range(0, min(len(ranked), HEATS * size), size):
            if first and not self._gains(ranked[first], few):
                break
            winner = self._proven([self._measured(one, many) for one in ranked[first : first + size]], many)
            if winner is not None:
                return winner
        return None

    def _proven(self, runners: Sequence[Runner], tried: Sequence[Scenario]) -> Runner | None:
        """Prove the best plans until one needs nothing taken away, or enough were proven."""
        left, done = list(runners), list[Runner]()
        while left and len(done) < PROOFS:
            best = left.pop(self._best(left, tried))
            self.progress("proving the plan against the plain program")
            found = self._proof(best, tried)
            if found is not None:
                done.append(found)
                if found.intact or (left and self._best([found, *left], tried) == 0):
                    break
        done = [one for one in done if self._gains(one, tried)]
        return done[self._best(done, tried)] if done else None

    def _proof(self, runner: Runner, tried: Sequence[Scenario]) -> Runner | None:
        known = dict(zip(tried, runner.sizes, strict=True))
        plan, result = prove_in_time(runner.plan, runner.result, runner.planner, self.checker, known, runner.command)
        if plan is runner.plan:
            return replace(runner, intact=True)
        if result is None:
            return None
        return self._measured(self._runner(runner.planner, result, plan), tried)

    def _gains(self, runner: Runner, tried: Sequence[Scenario]) -> bool:
        """Return whether a plan has any less error than the plain one."""
        plain = np.maximum(self._plain(tried).max(axis=0), FLOOR)
        found = np.maximum(_largest(runner), FLOOR)
        return bool(np.log(plain / found).max() > GAINED)

    def _grafted(self, winner: Runner, others: Sequence[Runner], tried: Sequence[Scenario]) -> Runner:
        """Try in the winner what others of the same kind do in the places where they are better."""
        others = [one for one in others if one.result.requests is not winner.result.requests]
        kin = [one for one in others if one.planner is winner.planner and one.result.shifted == winner.result.shifted]
        kin = kin[:KIN]
        if not kin or not winner.result.requests:
            return winner
        self.progress("trying in the best plan what others do better")
        few = few_scenarios(tried)
        places = [self._places(one, few) for one in (winner, *kin)]
        least = max(ENOUGH * float(self._plain(tried)[:, 0].max()), FLOOR)
        high = np.log(np.maximum([one.max for one in places], least))
        broad = np.log(np.maximum([one.square for one in places], least**2))
        better = (high[0] - high) + 0.5 * (broad[0] - broad)
        better[high > high[0] + GAINED] = 0.0
        which, gain = np.argmax(better, axis=0), better.max(axis=0)
        wanted = np.flatnonzero((gain > LEAST_GRAFT) & (which > 0))
        # Where time is short the largest errors come first.
        wanted = wanted[np.argsort(-high[0][wanted], kind="stable")]
        # Profiles that found no room in the plan could find some in another one.
        own = [
            one if one.shape is None or profile is not None else without_design(one, self.planner.machine)
            for one, profile in zip(winner.result.requests, winner.plan.profiles, strict=True)
        ]
        best = winner
        for _ in range(GRAFTS):
            if not wanted.size:
                break
            requests = list(own)
            for number in wanted.tolist():
                requests[number] = kin[which[number] - 1].result.requests[number]
            runner = self._replanned(winner, requests)
            if runner is None or not self._may_run(runner):
                wanted = wanted[: int(LESS * wanted.size)]
                continue
            runner = self._measured(runner, tried)
            if self._beats(runner, best, tried):
                best = runner
            here = np.log(np.maximum(self._places(runner, few).max, least))
            kept = wanted[_nearby(here)[wanted] <= _nearby(high[0])[wanted]]
            if kept.size == wanted.size:
                break
            wanted = kept
        found = None if best is winner else self._proof(best, tried)
        return winner if found is None or not self._beats(found, winner, tried) else found

    def _slower(self, winner: Runner, ranked: Sequence[Runner], tried: Sequence[Scenario]) -> Runner:
        """Try the winner, or the quickest plan of its kind, with less feed where the errors are largest.

        The one is taken that promises more, if it promises less error than the winner has.
        """
        room = winner.planner.baseline.feed_planner.room
        if room is None or not winner.result.requests:
            return winner
        quickest = min((one for one in ranked if one.planner is winner.planner), key=lambda one: plan_time(one.plan))
        unit = RAMPS * PASSING * room.window.spacing
        starts = [(one, self._passages(one, tried)) for one in dict.fromkeys((winner, quickest))]
        runner, passages = min(starts, key=lambda start: start[1].promised(unit))
        if math.log(float(starts[0][1].error.max()) / passages.promised(unit)) <= CLOSE:
            return winner
        self.progress("passing turning points slower")
        few = few_scenarios(tried)
        found = self._slowed(self._measured(runner, few), passages, unit, few)
        if found is None or not self._beats(found := self._measured(found, tried), winner, tried):
            return winner
        proven = self._proof(found, tried)
        return winner if proven is None or not self._beats(proven, winner, tried) else proven

    def _passages(self, runner: Runner, tried: Sequence[Scenario]) -> Passages:
        """Return what is to be known of the turning points of a plan to pass them slower."""
        feed = runner.planner.baseline.feed
        usual = np.array([feed.at(window.s) for window in runner.planner.analysis.windows])
        pairs = zip(runner.result.requests, runner.plan.profiles, strict=True)
        free = np.array([not (one.stop or profile) for one, profile in pairs]) & (usual > 0.0)
        return Passages(
            error=self._places(runner, few_scenarios(tried)).max,
            free=free,
            slowest=np.minimum((self.planner.options.min_feed or 0.0) / np.where(free, usual, np.inf), 1.0),
            time=SPARE * (runner.planner.longest - plan_time(runner.plan)),
            least=max(ENOUGH * float(self._plain(tried)[:, 0].max()), FLOOR),
        )

    def _slowed(self, runner: Runner, passages: Passages, unit: float, tried: Sequence[Scenario]) -> Runner | None:
        """Pass turning points slower in a plan, with the time that it leaves; None where that makes it no better."""
        best, before = None, np.ones(passages.error.size)
        for _ in range(SLOWER_TRIES):
            ratios = passages.ratios(unit)
            if np.array_equal(ratios, before):
                break
            before = ratios
            requests = zip(runner.result.requests, ratios.tolist(), strict=True)
            found = self._replanned(runner, [replace(one, slowed=ratio) for one, ratio in requests])
            if found is None:
                break
            taken = plan_time(found.plan) - plan_time(runner.plan)
            unit *= max(taken / spent(ratios, unit), LEAST_UNIT)
            if not self._may_run(found):
                continue
            found = self._measured(found, tried)
            if not self._beats(found, best or runner, tried):
                break
            best = found
            if taken >= NEARLY * passages.time:
                break
        return best

    def _replanned(self, runner: Runner, requests: Sequence[ProfileRequest]) -> Runner | None:
        """Plan the same with other requests, to be proven; None where that cannot be planned."""
        result = replace(
            runner.result, requests=tuple(requests), proven=True, shorter=None, longer_at=None, rivals=(), warnings=()
        )
        try:
            return self._runner(runner.planner, result, runner.planner.plan(self.name, result))
        except PhPostError:
            return None

    def _may_run(self, runner: Runner) -> bool:
        """Return whether a plan takes no longer, and has the tool stand no longer, than it may."""
        return not (takes_too_long(runner.plan, runner.planner) or self._stands_too_long(runner))

    def _beats(self, runner: Runner, other: Runner, tried: Sequence[Scenario]) -> bool:
        return self._best([other, runner], tried) == 1

    def _places(self, runner: Runner, tried: Sequence[Scenario]) -> Place:
        """Errors around every window."""
        s = np.array([window.s for window in self.planner.analysis.windows])
        found = self.checker.around(runner.command, 0.5 * (s[:-1] + s[1:]), tried)
        return Place(*(np.max([one[k] for one in found], axis=0) for k in range(2)))

    def _words(self, winner: Runner | None, tried: Sequence[Scenario]) -> tuple[str, ...]:
        """Say what more time would bring; nothing where that is little, or worse in any case."""
        if self.said and (winner is None or not winner.result.shifted):
            # The search left axes out, and said what they would take.
            return self.said
        own = (
            self._plain(tried) if winner is None else np.array([one[:3] for one in self._measured(winner, tried).sizes])
        )
        here = own.max(axis=0)
        late = [self._measured(one, tried) for one in (*self.late, *self._with_more_time())]
        still = [self._measured(one, tried) for one in self.still]
        for one in (*self._ranked(late, tried)[:1], *self._ranked(still, tried)[:1]):
            there = _largest(one)
            gains = bool(np.any(there[:2] < MORE * here[:2]) and np.all(there[:2] <= here[:2]))
            if gains and self.checker.blame(one.plan, (), self.known[_looks(one.command)], one.command) is None:
                plain = self.planner.before.motion.end
                part = plan_time(one.plan) / plain - 1.0
                option = f"--max-slowdown {plan_warnings.round_up(part):g}"
                if not takes_too_long(one.plan, self.planner):
                    option = f"--max-standstill {plan_warnings.round_up(one.standing):g}"
                return (plan_warnings.more_time_warning(here.tolist(), there.tolist(), option),)
        return ()

    def _with_more_time(self) -> Iterator[Runner]:
        """Plan what the search found, without regard to the time."""
        if self.result.shorter is None:
            return
        options = self.planner.options
        planner = self.planner.with_options(replace(options, max_slowdown=WHATEVER * (1.0 + options.max_slowdown)))
        result = self.result.shorter(WHATEVER)
        if all(one == other for one, other in zip(result.requests, self.result.requests, strict=True)):
            return
        try:
            runner = self._runner(planner, result, planner.plan(self.name, result))
        except PhPostError:
            return
        if takes_too_long(runner.plan, self.planner):
            yield runner


def named_results(task: PlanningTask) -> Iterator[StrategyResult]:
    """Return the answers of all strategies that do not search, those that refuse the task left out."""
    for name in strategy_names():
        strategy = find_strategy(name)
        traits = traits_of(strategy)
        refused = not traits.compensates or traits.chooses or name == TAKE_UP
        if refused or (traits.moves_back and not task.options.allow_retrograde):
            continue
        try:
            require_loop(strategy, task.path.axes, task.machine)
            result = strategy.profiles(task)
        except InputError:
            continue
        requests = tuple(replace(one, strategy=one.strategy or name) for one in result.requests)
        yield replace(result, requests=requests, crosses_by=result.crosses_by or name)


def few_scenarios(every: Sequence[Scenario]) -> tuple[Scenario, ...]:
    """Choose scenarios at the file's values: every pick-up rule on the first sides, all sides with the first rule."""
    nominal = [one for one in every if is_nominal(one)]
    first = nominal[0]
    same_sides = [one for one in nominal if (one.flank, one.opposite) == (first.flank, first.opposite)]
    return tuple(dict.fromkeys([*same_sides, *(one for one in nominal if one.pickup == first.pickup)]))


def _nearby(sizes: Array) -> Array:
    """Return the largest of each entry and the two beside it."""
    wide = np.pad(sizes, 1, mode="edge")
    return np.asarray(np.maximum(np.maximum(wide[:-2], wide[2:]), sizes))


def _looks(command: Command) -> int:
    """Return what tells a command from others of its path: its places, and what of them is no path."""
    added = command.offset
    return hash((command.position.tobytes(), b"" if added is None or not added.any() else added.tobytes()))


def _largest(runner: Runner) -> Array:
    """Largest sizes of a plan in the scenarios that it was measured in, shape (3,)."""
    return np.asarray(np.array([one[:3] for one in runner.sizes]).max(axis=0))
