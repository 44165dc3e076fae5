"""Plan the feed along a path: the nominal plan, and the strategy's profiles fitted to path, limits and options."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from copy import copy
from typing import NamedTuple

import msgspec
import numpy as np

from ph_post.analysis.path_analysis import Analysis
from ph_post.compensate import plan_warnings
from ph_post.compensate.crossing_times import fit_crossings
from ph_post.compensate.feed_planner import FeedPlanner, ValidMotion
from ph_post.compensate.fitting import FittedProfiles, Fitter
from ph_post.compensate.friction import Friction, braked, friction_of_machine, little_friction
from ph_post.compensate.layout import Job, Layout, approach_sides, lay_out, without_axes
from ph_post.compensate.lead import lead_window
from ph_post.compensate.lead_report import with_lead_told
from ph_post.compensate.motion import FeedAlong, cycle_time
from ph_post.compensate.offsets import may_shift
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan_warnings import SAFE
from ph_post.compensate.prove import prove
from ph_post.compensate.race import race
from ph_post.compensate.room import unwinding_time
from ph_post.compensate.shapes import reported_ratio
from ph_post.compensate.standstill import check_standstill
from ph_post.compensate.strategies.base import (
    PlanningTask,
    ProfileRequest,
    StrategyResult,
    require_loop,
    traits_of,
)
from ph_post.compensate.strategies.registry import find_strategy
from ph_post.compensate.trial import flanks_before
from ph_post.errors import InputError
from ph_post.geometry.joints import find_stops
from ph_post.progress import Progress, no_progress
from ph_post.simulate.assess import RUNS_ON
from ph_post.types import Array, FeedProfile, Machine, Plan, frozen

LEAD_SHARE = 0.6
"""Part of the time allowed that room for inverse dynamics may take; the rest is for the turning points."""

TAIL_SHARE = 0.6
"""Part of the time allowed that integrators may take to unwind at the end."""

LEAST_PART = 0.1
"""Part of the inverse dynamics below which none of it is given room."""

TRIES = 4
"""Plans in search of the part of the inverse dynamics that the time allows."""

ABOVE = 0.3
"""Part of the way from the chord to what takes too long at which the next one is tried."""

STEP = 0.01
"""By how much a part that is tried is less than one that takes too long."""

ENOUGH = 0.8
"""Part of the time for it that is enough to be taken."""

SHARPER = (1.15, 1.3)
"""Times the limits of the jerk with which it is planned, before it is smoothed, where the time is short."""

NARROWER = (0.7, 0.5, 0.35)
"""Times the usual width of the window through which the lead sees the path, where the time is short."""

RELAXED = 0.5
"""Power of what a stretch is slowed by for all of the inverse dynamics with which the search for a part begins."""

__all__ = ["PlanOptions", "cycle_time", "make_plan"]


def make_plan(analysis: Analysis, options: PlanOptions, progress: Progress = no_progress) -> Plan:
    """Plan the feed along a path.

    First the plain plan: as fast as programmed, slower where an axis would break a limit, at rest in sharp
    corners, in cusps and at the ends of rapid segments. On it the profiles that the strategy wants, shortened
    and softened until they fit.

    Parameters
    ----------
    analysis : Analysis
        With a machine.
    options : PlanOptions
    progress : Progress, optional
        Called with what is being done.

    Returns
    -------
    Plan
        Its warnings say whatever is not as the path file or the options have it.

    Raises
    ------
    InputError
        Where options contradict each other, or there is no such strategy.
    LimitError
        Where no motion was found that keeps the limits.
    """
    machine = analysis.machine
    if machine is None:
        raise InputError("", "a plan needs a machine")
    strategy = find_strategy(options.strategy)
    require_loop(strategy, analysis.path.axes, machine)
    planner = Planner(analysis, machine, options, progress)
    result = strategy.profiles(planner.task)
    if traits_of(strategy).chooses:
        return with_lead_told(race(planner, strategy.name, result), analysis.track)
    plan = planner.plan(strategy.name, result)
    if result.proven:
        progress("proving the plan against the plain program")
        plan = prove(plan, result, planner)
    check_standstill(plan, analysis.track, options.max_standstill)
    return with_lead_told(plan, analysis.track)


AS_DEEP = 0.02
"""By how much V / V_c of a profile may be higher than requested before a rest is better."""

NO_STOPS = frozen([])


class BaselinePlan(NamedTuple):
    """The plan that profiles are built on: its feed planner, its motion, and its feed along the path."""

    feed_planner: FeedPlanner
    valid: ValidMotion
    feed: FeedAlong


class LedMotion(NamedTuple):
    """A motion that leaves room for a part of the inverse dynamics, and how much longer than the plain one it is [s].

    It was planned with `jerk` times the limits of the jerk before it was smoothed, for a window of `width` times the
    usual one.
    """

    part: float
    jerk: float
    width: float
    longer: float
    feed_planner: FeedPlanner
    valid: ValidMotion


class Planner:
    """The common parts of all plans of one job: the plain plan along the path, and the baseline to build on.

    Where the command is to lead the path, the baseline leaves room for that: the limits hold for the command with its
    lead, or with as much of it as the time allows.
    """

    def __init__(
        self,
        analysis: Analysis,
        machine: Machine,
        options: PlanOptions,
        progress: Progress = no_progress,
        plain: ValidMotion | None = None,
    ) -> None:
        self.analysis, self.machine, self.options = analysis, machine, options
        self.moving = options.start == "moving"
        self.lead = options.inverse_dynamics and not options.feed_only and not options.writes_program
        corners, infinite, rapids = find_stops(analysis.track)
        cusps = np.array([point.s for point in analysis.turning_points if point.kind == "cusp"])
        self._stops = np.concatenate([corners, infinite, rapids, cusps])
        self._part, self._tail, self._jerk, self._width = 0.0, 0.0, 1.0, 1.0
        feed_planner = self._feed_planner(0.0, NO_STOPS)
        settled = feed_planner.settle()
        self.before = plain or settled
        self._approached: dict[str, int] = {}
        if options.writes_program and not self.moving:
            self._approached = approach_sides(analysis.track, analysis.turning_points)
        self._plain = self.baseline = self._on(feed_planner, settled)
        self._said: list[str] = []
        self._wholes: dict[tuple[float, float], LedMotion] = {}
        if self.lead:
            self._make_room()
        # From rest, nobody expects a corner to be run through; infinite curvature does not show in a drawing.
        none = np.zeros(0)
        reported = (corners, cusps, infinite, rapids) if self.moving else (none, none, infinite, none)
        self.stops = plan_warnings.stop_warnings(*reported)
        self.progress = progress
        self.task = self._task()

    def _task(self) -> PlanningTask:
        """Make the task of strategies that are to build on the baseline."""
        end = self.baseline.valid.motion.end
        return PlanningTask(
            analysis=self.analysis,
            machine=self.machine,
            options=self.options,
            feed=self.baseline.feed,
            looped=self.baseline.feed_planner.looped,
            duration=end,
            allowed=self.longest - end,
            progress=self.progress,
        )

    def with_options(self, options: PlanOptions) -> Planner:
        """Return the planner of the same job with another time allowed, or without inverse dynamics."""
        other = copy(self)
        other.options, other.lead = options, self.lead and options.inverse_dynamics
        if self.lead and not other.lead:
            other.baseline, other._part, other._tail, other._width, other._said = self._plain, 0.0, 0.0, 1.0, []
        other.task = other._task()
        return other

    def gentler(self) -> Planner | None:
        """Return the planner of the same job on axes that brake so gently that less friction would hold their tables.

        Its time counts from the same plain motion. None where friction holds every table as it is, and for programs,
        whose accelerations are the controller's.
        """
        axes = [self.machine.axes[name] for name in self.analysis.path.axes]
        slows = {axis.name: braked(axis) for axis in axes if may_shift(axis)}
        flying = {name: SAFE * RUNS_ON[0] * slow for name, slow in slows.items() if math.isfinite(slow)}
        if not flying or self.options.writes_program or self.moving:
            return None
        slower = dict(self.machine.axes)
        for name, most in flying.items():
            limits = msgspec.structs.replace(slower[name].limits, acceleration=most)
            slower[name] = msgspec.structs.replace(slower[name], limits=limits)
        machine = msgspec.structs.replace(self.machine, axes=slower)
        analysis = msgspec.structs.replace(self.analysis, machine=machine)
        other = Planner(analysis, machine, self.options, self.progress, self.before)
        other.stops = [*self.stops, *plan_warnings.gentle_warnings(flying)]
        return other

    @property
    def longest(self) -> float:
        """Longest cycle time allowed [s]."""
        return (1.0 + self.options.max_slowdown) * self.before.motion.end

    def fuller(self, kept: float) -> Planner | None:
        """Return the planner of the same job whose turning points get no time, but for some [s] before the path begins.

        None where there is no more of the inverse dynamics for that.
        """
        if not self.lead or self._part == 1.0:
            return None
        other = copy(self)
        other.baseline, other._part, other._said = self._plain, 0.0, []
        other._make_room(kept)
        if other._part <= self._part:
            return None
        other.task = other._task()
        return other

    def _feed_planner(self, part: float, stops: Array) -> FeedPlanner:
        every = np.concatenate([self._stops, stops])
        return FeedPlanner(
            self.analysis.track, self.machine, every, self.moving, part, self._tail, self._jerk, self._width
        )

    def _on(self, feed_planner: FeedPlanner, valid: ValidMotion) -> BaselinePlan:
        period, length = feed_planner.limits.period, self.analysis.track.length
        return BaselinePlan(feed_planner, valid, FeedAlong(valid.motion, period, length, feed_planner.looped))

    def _make_room(self, kept: float | None = None) -> None:
        """Leave room for all of the inverse dynamics, or for as much as does not take too long.

        What is kept of the time allowed for all else [s] is a part of it by default.
        """
        end, axes = self.before.motion.end, self.analysis.path.axes
        window = lead_window(self.machine, axes)
        if window is None:
            return
        allowed = self.longest - end
        unwinding = unwinding_time(self.machine, self.analysis.track, self.before.motion, window)
        self._tail = min(unwinding, TAIL_SHARE * allowed)
        share = self._tail + LEAD_SHARE * (allowed - self._tail) if kept is None else allowed - kept

        whole = self._led_whole(share)
        best = whole if whole.longer <= share else None
        low, high, part = (0.0, 0.0), (1.0, whole.longer), 1.0
        for _ in range(TRIES if best is None else 0):
            # What it takes grows faster than the part of the lead, so that the chord is below what can be had.
            chord = low[0] + (high[0] - low[0]) * (share - low[1]) / (high[1] - low[1])
            part = round(min(chord + ABOVE * (high[0] - chord), high[0] - STEP), 3)
            found = self._led(part, whole.jerk, whole.width, whole.feed_planner)
            if found.longer <= share:
                low, best = (part, found.longer), found
                if found.longer >= ENOUGH * share:
                    break
            else:
                high = (part, found.longer)
        beside = (whole.longer - self._tail) / LEAD_SHARE + self._tail if kept is None else whole.longer + kept
        slowdown = beside / end
        if best is None or best.part < LEAST_PART:
            self._jerk, self._width = 1.0, 1.0
            self._said = [plan_warnings.no_room_warning(whole.longer, slowdown)]
            return
        self._part, self._jerk, self._width = best.part, best.jerk, best.width
        self.baseline = self._on(best.feed_planner, best.valid)
        if self._part < 1.0:
            self._said = [plan_warnings.lead_time_warning(self._part, whole.longer, slowdown)]

    def _led_whole(self, share: float) -> LedMotion:
        """Lead by all that servos lag; where it takes longer than a time [s], sharper and through a narrower window."""
        whole = self._led_by_all(1.0, 1.0)
        for jerk in SHARPER:
            if whole.longer <= share or (sharper := self._led_by_all(jerk, 1.0)).longer >= whole.longer:
                break
            whole = sharper
        for width in NARROWER:
            if whole.longer <= share or (narrower := self._led_by_all(whole.jerk, width)).longer >= whole.longer:
                break
            whole = narrower
        return whole

    def _led_by_all(self, jerk: float, width: float) -> LedMotion:
        """Plan a motion that leaves room for all of the inverse dynamics, once."""
        if (jerk, width) not in self._wholes:
            self._wholes[jerk, width] = self._led(1.0, jerk, width)
        return self._wholes[jerk, width]

    def _led(self, part: float, jerk: float, width: float, known: FeedPlanner | None = None) -> LedMotion:
        """Plan a motion that leaves room for a part of the inverse dynamics; another planner knows how slow, about."""
        self._jerk, self._width = jerk, width
        feed_planner = self._feed_planner(part, NO_STOPS)
        if known is not None:
            feed_planner.learn(known, RELAXED * part)
        valid = feed_planner.settle()
        return LedMotion(part, jerk, width, valid.motion.end - self.before.motion.end, feed_planner, valid)

    def _baseline_for(self, requests: Sequence[ProfileRequest]) -> BaselinePlan:
        """Return the baseline to build on, at rest where requests want the motion to stop, and slower where they do."""
        pairs = list(zip(self.analysis.windows, requests, strict=True))
        length = self.analysis.track.length
        stops = np.array([window.s for window, request in pairs if request.stop and 0.0 < window.s < length])
        slowed = [
            (window.s, request.slowed * self.baseline.feed.at(window.s))
            for window, request in pairs
            if request.slowed < 1.0
        ]
        if not (stops.size or slowed):
            return self.baseline
        feed_planner = self._feed_planner(self._part, stops)
        feed_planner.learn(self.baseline.feed_planner)
        if slowed:
            feed_planner.pass_slower(*np.array(slowed).T)
        return self._on(feed_planner, feed_planner.settle())

    def shallow(self, requests: Sequence[ProfileRequest], profiles: Sequence[FeedProfile | None]) -> set[int]:
        """Return the windows whose profile is not as deep as it was asked for, or missing."""
        return {
            number
            for number, (request, found) in enumerate(zip(requests, profiles, strict=True))
            if request.shape is not None and (found is None or found.ratio > reported_ratio(request.shape) + AS_DEEP)
        }

    def _missed(self, requests: Sequence[ProfileRequest], profiles: Sequence[FeedProfile | None]) -> set[int]:
        """Return the windows that did not get the profile that a crossing behind the loop counts on."""
        if self.options.min_feed is not None:
            return set()
        return {
            number
            for number in self.shallow(requests, profiles)
            if requests[number].crossings
            and not any(self.machine.axes[one.axis].loop.encloses_backlash for one in requests[number].crossings)
        }

    def _friction(self, result: StrategyResult) -> dict[str, Friction]:
        """Return the friction by axis that a result leads."""
        if not (self.lead and result.friction_part):
            return {}
        return friction_of_machine(self.machine, self.analysis.path.axes)

    def _led_friction_warnings(self, result: StrategyResult) -> list[str]:
        """Say where less than all of the friction is led."""
        names = self._friction(result)
        if not names:
            return []
        little = little_friction(self.machine.axes[name] for name in names)
        return plan_warnings.led_friction_warnings(result.friction_part, little)

    def plan(self, name: str, result: StrategyResult) -> Plan:
        """Fit what a strategy proposes to the path and the limits."""
        first = result.friction_first if self._friction(result) else 0.0
        # A design that was searched is of no use softened for time: others are asked for that take less.
        longest = math.inf if result.proven else self.longest - first
        feed_planner, fitted = self._fitted(result.requests, longest)
        missed = self._missed(result.requests, fitted.profiles)
        if missed:
            return self.plan(name, with_rests(result, missed) if result.rests else without_profiles(result, missed))
        layout = self._layout(result, fitted, first)
        if layout.dropped:
            return self.plan(name, without_axes(result, layout.dropped))
        analysis = self.analysis
        plan = Plan(
            path=analysis.path,
            machine=self.machine,
            strategy=name,
            turning_points=analysis.turning_points,
            windows=analysis.windows,
            intervals=analysis.intervals,
            profiles=fitted.profiles,
            nominal=self.before.motion.phases(),
            phases=layout.phases,
            crossings=layout.crossings,
            crosses_by=result.crosses_by,
            bias=layout.bias,
            inverse_dynamics=self.lead,
            friction_part=result.friction_part if self.lead else 0.0,
            friction=layout.friction,
            lead=self._part or 1.0,
            lead_width=self._width,
            flanks=flanks_before(analysis) if feed_planner.looped else self._approached,
            warnings=(
                *self._fitting_warnings(feed_planner, fitted, result),
                *plan_warnings.offset_warnings(self.machine, layout),
                *self._led_friction_warnings(result),
                *plan_warnings.doubtful_values(self.machine, analysis.path.axes),
            ),
        )
        return plan if self.options.writes_program else fit_crossings(plan, analysis.track)

    def _fitted(self, requests: tuple[ProfileRequest, ...], longest: float) -> tuple[FeedPlanner, FittedProfiles]:
        """Fit profiles to their baseline, with the feed planner that did it."""
        feed_planner, valid, feed = self._baseline_for(requests)
        # What it learns of the limits from this plan is no matter of the next one.
        feed_planner = copy(feed_planner)
        feed_planner.factor, feed_planner.ease = valid.factor.copy(), feed_planner.ease.copy()
        fitter = Fitter(feed_planner, valid, self.analysis.windows, requests, self.options, feed, longest)
        return feed_planner, fitter.fit()

    def _layout(self, result: StrategyResult, fitted: FittedProfiles, first: float) -> Layout:
        """Place what is added to the path in time; before it, where there is no time to, nothing is wound up."""
        analysis = self.analysis
        job = Job(
            track=analysis.track,
            machine=self.task.sized,
            turning_points=analysis.turning_points,
            windows=analysis.windows,
            requests=result.requests,
            profiles=fitted.profiles,
            phases=fitted.valid.motion.phases(),
            moving=self.moving,
            lead=self.lead,
            written=self.options.writes_program,
            shifted=result.shifted,
            winds_up=result.winds_up,
            pushes_first=result.pushes_first,
            carries=result.carries and self.lead,
            friction=self._friction(result),
            friction_first=first,
        )
        layout = lay_out(job)
        if job.winds_up and job.friction and cycle_time(layout.phases) > self.longest:
            layout = lay_out(msgspec.structs.replace(job, leads_first=False))
        if not result.proven and cycle_time(layout.phases) > self.longest:
            layout = lay_out(msgspec.structs.replace(job, winds_up=False, pushes_first=False))
        return layout

    def _fitting_warnings(
        self, feed_planner: FeedPlanner, fitted: FittedProfiles, result: StrategyResult
    ) -> tuple[str, ...]:
        """Say where the path stops, where its feed is lowered, and what became of the profiles."""
        lowered = plan_warnings.room_warnings if self._part else plan_warnings.lowered_feed_warnings
        return (
            *self.stops,
            *plan_warnings.slow_feed_warnings(self.baseline.feed_planner.caps),
            *plan_warnings.passing_warnings([request.slowed for request in result.requests]),
            *lowered(feed_planner.caps, fitted.valid.factor),
            *self._said,
            *result.warnings,
            *fitted.warnings,
        )


def without_profiles(result: StrategyResult, windows: Collection[int]) -> StrategyResult:
    """Leave the feed alone in some windows, where their profiles could not be had."""
    requests = tuple(
        msgspec.structs.replace(request, shape=None) if number in windows else request
        for number, request in enumerate(result.requests)
    )
    return msgspec.structs.replace(result, requests=requests)


def with_rests(result: StrategyResult, windows: Collection[int]) -> StrategyResult:
    """Let the plain motion rest in some windows, where their profiles could not be had."""
    requests = tuple(
        msgspec.structs.replace(request, shape=None, stop=True) if number in windows else request
        for number, request in enumerate(result.requests)
    )
    return msgspec.structs.replace(result, requests=requests)
