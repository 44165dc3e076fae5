"""From what was found about a path to the feed along it: the nominal plan, and the profiles on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ph_post.analysis import Analysis
from ph_post.compensate import words
from ph_post.compensate.caps import find_stops
from ph_post.compensate.course import Course
from ph_post.compensate.fit import Fitter
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.strategies.base import Task, require_loop
from ph_post.compensate.strategies.registry import find_strategy
from ph_post.errors import InputError
from ph_post.types import Phase, Plan

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
    task = Task(
        path=analysis.path, machine=machine, options=options, turning_points=analysis.turning_points,
        windows=analysis.windows, intervals=analysis.intervals, notes=analysis.notes,
    )  # fmt: skip
    proposal = strategy.profiles(task)
    moving = options.start == "moving"
    corners, infinite, rapids = find_stops(analysis.track)
    cusps = np.array([point.s for point in analysis.turning_points if point.kind == "cusp"])
    course = Course(analysis.track, machine, np.concatenate([corners, infinite, rapids, cusps]), moving)
    before = course.settle()
    fitted = Fitter(course, before, analysis.windows, proposal.wishes, options).fit()
    # From rest, nobody expects a corner to be run through; infinite curvature does not show in the drawing.
    none = np.zeros(0)
    warnings = [
        *words.stops(*((corners, cusps, infinite, rapids) if moving else (none, none, infinite, none))),
        *words.slow_stretches(course.caps),
        *words.slowed(course.caps, fitted.settled.factor),
        *proposal.warnings,
        *fitted.warnings,
    ]
    return Plan(
        path=analysis.path, machine=machine, strategy=strategy.name, turning_points=analysis.turning_points,
        windows=analysis.windows, intervals=analysis.intervals, profiles=fitted.profiles,
        nominal=before.motion.phases(), phases=fitted.settled.motion.phases(), warnings=tuple(warnings),
        inverse_dynamics=options.inverse_dynamics and not options.feed_only,
    )  # fmt: skip
