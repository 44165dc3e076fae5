"""From what was found about a path to the feed along it: the nominal plan, and the profiles on it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from ph_post.analysis import Analysis
from ph_post.compensate import words
from ph_post.compensate.broken import find_broken
from ph_post.compensate.course import Course, Settled
from ph_post.compensate.feedalong import FeedAlong
from ph_post.compensate.fit import Fitter
from ph_post.compensate.joglayout import lay_out_jogs, without_axes
from ph_post.compensate.layout import Job, lay_out
from ph_post.compensate.motion import Motion
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.prove import prove
from ph_post.compensate.ramps import reduced, smooth_ramps
from ph_post.compensate.shapes import told_ratio
from ph_post.compensate.strategies.base import Proposal, Task, Wish, require_loop, silent
from ph_post.compensate.strategies.registry import find_strategy
from ph_post.compensate.surroundings import flanks_before
from ph_post.errors import InputError
from ph_post.geometry.joints import find_stops
from ph_post.types import Array, FeedProfile, Machine, Phase, Plan, frozen

LEAD_SHARE = 0.3
"""Part of the time allowed that ramps which can be led may take."""

__all__ = ["PlanOptions", "cycle_time", "make_plan"]


def cycle_time(phases: Sequence[Phase]) -> float:
    """Duration of phases that follow each other [s]."""
    return phases[-1].start + phases[-1].duration if phases else 0.0


def make_plan(analysis: Analysis, options: PlanOptions, tell: Callable[[str], None] = silent) -> Plan:
    """Plan the feed along a path.

    First the plain plan: as fast as programmed, slower where an axis would break a limit, at rest in sharp
    corners, in cusps and at the ends of rapid segments. On it the profiles that the strategy wants, shortened
    and softened until they fit.

    Parameters
    ----------
    analysis : Analysis
        With a machine.
    options : PlanOptions
    tell : callable, optional
        Told what a long search is at.

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
    draft = Draft(analysis, machine, options, tell)
    proposal = strategy.profiles(draft.task)
    plan = draft.plan(strategy.name, proposal)
    if not proposal.proven:
        return plan
    tell("proving the plan against the plain program")
    return prove(plan, proposal, draft)


AS_DEEP = 0.02
"""By how much V / V_c of a profile may be higher than wished before a rest is better."""

NO_STOPS = frozen([])


class Ground(NamedTuple):
    """What profiles are built on: the course, the plain motion on it, and its feed along the path."""

    course: Course
    settled: Settled
    feed: FeedAlong


class Draft:
    """What all plans of one job have in common: the plain plan along the path, and the ground to build on.

    Where the command is to lead the path, the ground has ramps that can be led, if that costs little time.
    """

    def __init__(
        self,
        analysis: Analysis,
        machine: Machine,
        options: PlanOptions,
        tell: Callable[[str], None] = silent,
    ) -> None:
        self.analysis, self.machine, self.options = analysis, machine, options
        self.moving = options.start == "moving"
        self.lead = options.inverse_dynamics and not options.feed_only and options.carrier == "table"
        corners, infinite, rapids = find_stops(analysis.track)
        cusps = np.array([point.s for point in analysis.turning_points if point.kind == "cusp"])
        self._stops = np.concatenate([corners, infinite, rapids, cusps])
        course = self._course(None, NO_STOPS)
        self.before = course.settle()
        self._planned: Machine | None = None
        self.ground = self._on(course, self.before)
        if self.lead:
            self._lead_ramps()
        # From rest, nobody expects a corner to be run through; infinite curvature does not show in a drawing.
        none = np.zeros(0)
        told = (corners, cusps, infinite, rapids) if self.moving else (none, none, infinite, none)
        self.stops = words.stops(*told)
        end = self.ground.settled.motion.end
        self.task = Task(
            analysis=analysis, machine=machine, options=options, feed=self.ground.feed,
            looped=course.looped, duration=end, allowed=self.longest - end, tell=tell,
        )  # fmt: skip

    @property
    def longest(self) -> float:
        """Longest cycle time allowed [s]."""
        return (1.0 + self.options.max_slowdown) * self.before.motion.end

    def _course(self, planned: Machine | None, stops: Array) -> Course:
        every = np.concatenate([self._stops, stops])
        return Course(self.analysis.track, self.machine, every, self.moving, planned)

    def _on(self, course: Course, settled: Settled) -> Ground:
        period, length = course.limits.period, self.analysis.track.length
        return Ground(course, settled, FeedAlong(settled.motion, period, length, course.looped))

    def _lead_ramps(self) -> None:
        """Plan with the part of the limits with which ramps can be led, if that does not take too long."""
        path = self.analysis.path
        feeds = [path.feed if one.feed is None else one.feed for one in path.segments]
        slower = reduced(self.machine, max(feeds))
        if slower is None:
            return
        course = self._course(slower, NO_STOPS)
        settled = course.settle()
        spent = settled.motion.end - self.before.motion.end
        if spent <= LEAD_SHARE * (self.longest - self.before.motion.end):
            self._planned, self.ground = slower, self._on(course, settled)

    def _ground_for(self, wishes: Sequence[Wish]) -> Ground:
        """Return the ground to build on, at rest where wishes want the motion to stop."""
        pairs = zip(self.analysis.windows, wishes, strict=True)
        length = self.analysis.track.length
        stops = np.array([window.s for window, wish in pairs if wish.stop and 0.0 < window.s < length])
        if not stops.size:
            return self.ground
        course = self._course(self._planned, stops)
        return self._on(course, course.settle())

    def _breaks_limits(self, phases: tuple[Phase, ...]) -> tuple[float, ...]:
        """Return the instants at which samples of a motion on the path break a limit."""
        motion = Motion.from_phases(phases)
        broken = find_broken(self.analysis.track, self.ground.course.limits, motion)
        return tuple(broken.t0.tolist()) + tuple(broken.t1.tolist())

    def _missed(self, wishes: Sequence[Wish], profiles: Sequence[FeedProfile | None]) -> set[int]:
        """Return the windows that did not get the profile that a crossing behind the loop counts on."""
        if self.options.min_feed is not None:
            return set()
        return {
            number
            for number, (wish, found) in enumerate(zip(wishes, profiles, strict=True))
            if wish.shape is not None
            and wish.crossings
            and all(self.machine.axes[one.axis].feedback != "load" for one in wish.crossings)
            and (found is None or found.ratio > told_ratio(wish.shape) + AS_DEEP)
        }

    def plain(self, why: str = "") -> Plan:
        """Return the plain program, nothing added, and say why."""
        wishes = tuple(Wish(shape=None, note=why) for _ in self.analysis.windows)
        plan = self.plan("none", Proposal(wishes=wishes))
        return msgspec.structs.replace(plan, phases=plan.nominal, inverse_dynamics=False)

    def plan(self, name: str, proposal: Proposal) -> Plan:
        """Fit what a strategy proposes to the path and the limits."""
        analysis, options = self.analysis, self.options
        course, settled, feed = self._ground_for(proposal.wishes)
        fitted = Fitter(course, settled, analysis.windows, proposal.wishes, options, feed).fit()
        missed = self._missed(proposal.wishes, fitted.profiles)
        if missed:
            return self.plan(name, with_rests(proposal, missed))
        warnings = [
            *self.stops,
            *words.slow_stretches(course.caps),
            *words.slowed(course.caps, fitted.settled.factor),
            *proposal.warnings,
            *fitted.warnings,
        ]
        written = options.carrier == "program"
        phases = fitted.settled.motion.phases()
        if self._planned is not None:
            phases = smooth_ramps(phases, self._breaks_limits)
        job = Job(
            track=analysis.track, machine=self.task.sized, turning_points=analysis.turning_points,
            windows=analysis.windows, wishes=proposal.wishes, profiles=fitted.profiles,
            phases=phases, moving=self.moving, lead=self.lead, shifted=proposal.shifted,
        )  # fmt: skip
        layout = lay_out_jogs(job) if written else lay_out(job)
        if layout.dropped:
            return self.plan(name, without_axes(proposal, layout.dropped))
        warnings += words.lasting_offsets(self.machine, layout)
        return Plan(
            path=analysis.path, machine=self.machine, strategy=name, turning_points=analysis.turning_points,
            windows=analysis.windows, intervals=analysis.intervals, profiles=fitted.profiles,
            nominal=self.before.motion.phases(), phases=layout.phases, crossings=layout.crossings,
            bias=layout.bias, inverse_dynamics=self.lead,
            flanks=flanks_before(analysis) if course.looped else {}, warnings=tuple(warnings),
        )  # fmt: skip


def with_rests(proposal: Proposal, windows: Collection[int]) -> Proposal:
    """Let the plain motion rest in some windows, where their profiles could not be had."""
    wishes = tuple(
        msgspec.structs.replace(wish, shape=None, stop=True) if number in windows else wish
        for number, wish in enumerate(proposal.wishes)
    )
    return msgspec.structs.replace(proposal, wishes=wishes)
