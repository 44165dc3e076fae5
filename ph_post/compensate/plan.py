"""From what was found about a path to the feed along it: the nominal plan, and the profiles on it."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from ph_post.analysis import Analysis
from ph_post.compensate import words
from ph_post.compensate.caps import find_stops
from ph_post.compensate.course import Course
from ph_post.compensate.feedalong import FeedAlong
from ph_post.compensate.fit import Fitter
from ph_post.compensate.joglayout import lay_out_jogs, without_axes
from ph_post.compensate.layout import Job, lay_out
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.prove import prove
from ph_post.compensate.strategies.base import Proposal, Task, Wish, require_loop
from ph_post.compensate.strategies.registry import find_strategy
from ph_post.errors import InputError
from ph_post.types import Machine, Phase, Plan

__all__ = ["PlanOptions", "cycle_time", "make_plan"]


def cycle_time(phases: Sequence[Phase]) -> float:
    """Duration of phases that follow each other [s]."""
    return phases[-1].start + phases[-1].duration if phases else 0.0


def make_plan(analysis: Analysis, options: PlanOptions) -> Plan:
    """Plan the feed along a path.

    First the plain plan: as fast as programmed, slower where an axis would break a limit, at rest in sharp
    corners, in cusps and at the ends of rapid segments. On it the profiles that the strategy wants, shortened
    and softened until they fit.

    Parameters
    ----------
    analysis : Analysis
        With a machine.
    options : PlanOptions

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
    draft = Draft(analysis, machine, options)
    proposal = strategy.profiles(draft.task)
    plan = draft.plan(strategy.name, proposal)
    return prove(plan, proposal, draft) if proposal.proven else plan


class Draft:
    """What all plans of one job have in common: the course along the path, and the plain plan on it."""

    def __init__(self, analysis: Analysis, machine: Machine, options: PlanOptions) -> None:
        self.analysis, self.machine, self.options = analysis, machine, options
        self.moving = options.start == "moving"
        corners, infinite, rapids = find_stops(analysis.track)
        cusps = np.array([point.s for point in analysis.turning_points if point.kind == "cusp"])
        stops = np.concatenate([corners, infinite, rapids, cusps])
        self.course = Course(analysis.track, machine, stops, self.moving)
        self.before = self.course.settle()
        # From rest, nobody expects a corner to be run through; infinite curvature does not show in a drawing.
        none = np.zeros(0)
        told = (corners, cusps, infinite, rapids) if self.moving else (none, none, infinite, none)
        self.stops = words.stops(*told)
        self.feed = FeedAlong(
            self.before.motion, self.course.limits.period, analysis.track.length, self.course.looped
        )
        self.task = Task(
            analysis=analysis, machine=machine, options=options, feed=self.feed, looped=self.course.looped,
            duration=self.before.motion.end,
        )  # fmt: skip

    def plain(self) -> Plan:
        """Return the plain program, nothing added."""
        wishes = tuple(Wish(shape=None) for _ in self.analysis.windows)
        return msgspec.structs.replace(self.plan("none", Proposal(wishes=wishes)), inverse_dynamics=False)

    def plan(self, name: str, proposal: Proposal) -> Plan:
        """Fit what a strategy proposes to the path and the limits."""
        analysis, options = self.analysis, self.options
        fitted = Fitter(self.course, self.before, analysis.windows, proposal.wishes, options, self.feed).fit()
        warnings = [
            *self.stops,
            *words.slow_stretches(self.course.caps),
            *words.slowed(self.course.caps, fitted.settled.factor),
            *proposal.warnings,
            *fitted.warnings,
        ]
        written = options.carrier == "program"
        lead = options.inverse_dynamics and not options.feed_only and not written
        job = Job(
            track=analysis.track, machine=self.machine, turning_points=analysis.turning_points,
            windows=analysis.windows, wishes=proposal.wishes, profiles=fitted.profiles,
            phases=fitted.settled.motion.phases(), moving=self.moving, lead=lead,
        )  # fmt: skip
        layout = lay_out_jogs(job) if written else lay_out(job)
        if layout.dropped:
            return self.plan(name, without_axes(proposal, layout.dropped))
        return Plan(
            path=analysis.path, machine=self.machine, strategy=name, turning_points=analysis.turning_points,
            windows=analysis.windows, intervals=analysis.intervals, profiles=fitted.profiles,
            nominal=self.before.motion.phases(), phases=layout.phases, crossings=layout.crossings,
            bias=layout.bias, inverse_dynamics=lead, warnings=(*warnings, *words.lasting(layout.bias)),
        )  # fmt: skip
