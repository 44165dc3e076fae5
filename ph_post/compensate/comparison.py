"""Compare all strategies on one path and machine: the error that each leaves, and the motion's cost.

The cost is cycle time, slowest feed, standstill, moving back, and peak acceleration.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.analysis.path_analysis import Analysis
from ph_post.compensate.motion import MotionLaw, place_and_feed, without_strategy
from ph_post.compensate.offsets import command_of, plan_time
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.strategies.registry import PLAIN, find_traits, strategy_names
from ph_post.compensate.violations import Violation, at_rest_around, check_command, differences
from ph_post.errors import PhPostError, TooLargeError
from ph_post.geometry.numeric import runs
from ph_post.geometry.track import Track
from ph_post.progress import Progress, no_progress, prefixed
from ph_post.simulate.assess import Assessment, assess, contour_errors
from ph_post.simulate.contour import ContourError, Nominal
from ph_post.simulate.controllers.deviation import ProgramError
from ph_post.types import Array, BoolArray, Command, Crossing, Jog, Phase, Plan, Scenario, TurningPoint
from ph_post.units import MM

STILL: Final = 1e-9
"""Feeds up to this part of the highest are a standstill."""

POINTS: Final = 33
"""Instants at which every phase is looked at, an odd number: the middle of a dip is one of them."""


class MotionCost(msgspec.Struct, frozen=True, kw_only=True):
    """The cost of a motion along its path.

    `min_feed` [m/s] is the lowest feed while cutting, negative while the tool moves back, None where nothing
    is cut. Rapid segments do not count, nor do standstills and the ramps from and to them, which pass every
    feed. `standstill_time` [s] is what is spent at feed zero; `peak_acceleration` [m/s²] the largest of all
    axes and samples, offsets included.
    """

    cycle_time: float
    min_feed: float | None
    standstill_time: float
    retrograde: bool
    peak_acceleration: float


def cost_of(plan: Plan, command: Command, track: Track) -> MotionCost:
    """Measure a plan, and the command that is written for it."""
    s, feed = _feed_along(plan.phases)
    still = STILL * float(np.abs(feed).max(initial=0.0))
    rapid = np.array([segment.rapid for segment in plan.path.segments])
    segment, _ = track.to_xi(*track.locate(np.clip(s, 0.0, track.length)))
    return MotionCost(
        cycle_time=plan_time(plan),
        min_feed=slowest_feed(feed, np.asarray(~rapid[segment]), still),
        standstill_time=sum((phase.duration for phase in plan.phases if np.abs(phase.speed).max() <= still), start=0.0),
        retrograde=bool((feed < -still).any()),
        peak_acceleration=peak_acceleration(command),
    )


def peak_acceleration(command: Command) -> float:
    """Largest second difference of all axes over the period's square [m/s²]."""
    position = at_rest_around(command, command.position)
    return float(np.abs(differences(position, 2, command.period)).max(initial=0.0))


def slowest_feed(feed: Array, cutting: BoolArray, still: float = 0.0) -> float | None:
    """Lowest feed while cutting, without standstills and the ramps from and to them; None if none is left.

    A ramp lasts as long as the feed goes on rising from a standstill, or falling towards one.

    Examples
    --------
    >>> slowest_feed(np.array([0.0, 1.0, 3.0, 2.0, 3.0, 0.0]), np.ones(6, dtype=np.bool_))
    2.0
    """
    lowest: list[float] = []
    for run in runs(np.flatnonzero(np.abs(feed) > still)):
        first, last = int(run[0]), int(run[-1])
        if first > 0:
            first += _ramp(feed[first : last + 1])
        if last < feed.size - 1:
            last -= _ramp(feed[first : last + 1][::-1])
        counted = feed[first : last + 1][cutting[first : last + 1]]
        lowest += [float(counted.min())] if counted.size else []
    return min(lowest, default=None)


def _ramp(feed: Array) -> int:
    """Count the samples over which the feed goes on rising from the first."""
    falls = np.flatnonzero(np.diff(feed) <= 0.0)
    return int(falls[0]) if falls.size else feed.size - 1


def _feed_along(phases: Sequence[Phase]) -> tuple[Array, Array]:
    """Arc length [m] and feed [m/s] at points of every phase, both its ends included, each instant once."""
    within = np.linspace(0.0, 1.0, POINTS)
    t = np.unique(np.concatenate([phase.start + phase.duration * within for phase in phases]))
    return MotionLaw.from_phases(phases).place_and_feed(t)


class Contender(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One strategy on the job.

    `ok` says whether what it makes can be run; `reason` why not. Where it refused the job, or no motion
    was found inside the limits, there is nothing else. `chosen` holds the axis of every turning point, in order, and
    what is done there; `error_gap` what backlash adds [m]. A program that was run on its controller has no `plan` and
    no `command`.
    """

    name: str
    ok: bool
    reason: str = ""
    plan: Plan | None = None
    command: Command | None = None
    pace: MotionCost | None = None
    assessment: Assessment | ProgramError | None = None
    error_gap: ContourError | None = None
    chosen: tuple[tuple[str, str], ...] = ()
    warnings: tuple[str, ...] = ()


def compare_strategies(
    analysis: Analysis,
    options_for: Callable[[str], PlanOptions],
    progress: Progress = no_progress,
    names: Sequence[str] = (),
) -> tuple[Contender, ...]:
    """Plan, sample and simulate every strategy.

    Parameters
    ----------
    analysis : Analysis
        With a machine.
    options_for : callable
        The options of a strategy, by its name.
    progress : Progress, optional
        Called with what is being done.
    names : sequence of str, optional
        Strategies in place of all that are registered.

    Returns
    -------
    tuple of Contender
        The plain program first.
    """
    nominal = Nominal(analysis.track)
    found = []
    for name in names or in_order(strategy_names()):
        progress(f"planning and simulating {name}")
        found.append(_contender(analysis, options_for(name), nominal, prefixed(progress, name)))
    return tuple(found)


def in_order(names: Sequence[str]) -> tuple[str, ...]:
    """Sort strategies by name, but the plain program first and what chooses among the others last.

    Examples
    --------
    >>> in_order(("auto", "dwell", "none", "step"))
    ('none', 'dwell', 'step', 'auto')
    """
    return tuple(sorted(names, key=lambda name: (name != PLAIN, find_traits(name).chooses, name)))


def _contender(analysis: Analysis, options: PlanOptions, nominal: Nominal, progress: Progress) -> Contender:
    try:
        plan = make_plan(analysis, options, progress)
        command = command_of(plan, analysis.track, plan.machine.servo_period)
        assessment = assess(command, plan.machine, nominal, analysis.turning_points)
    except TooLargeError:
        raise
    except PhPostError as refusal:
        return refused(options.strategy, refusal)
    broken = check_command(command, plan.machine)
    return Contender(
        name=options.strategy,
        ok=not broken,
        reason=describe_violation(broken[0]) if broken else "",
        plan=plan,
        command=command,
        pace=cost_of(plan, command, analysis.track),
        assessment=assessment,
        error_gap=assessment.error_gap,
        chosen=chosen_in_order(plan),
        warnings=plan.warnings,
    )


def refused(name: str, refusal: PhPostError) -> Contender:
    """Return a strategy that refuses the job, with the reason on one line."""
    return Contender(name=name, ok=False, reason=" ".join(str(refusal).split()))


def without_backlash(analysis: Analysis, contender: Contender) -> ContourError | None:
    """Contour error of a command on the machine without any backlash; None where there is none."""
    if contender.command is None or contender.plan is None:
        return None
    nominal, gapless = Nominal(analysis.track), Scenario(gap=0.0)
    return contour_errors(contender.command, contender.plan.machine, nominal, (gapless,))[0]


def before_and_after(analysis: Analysis, *plans: Plan) -> tuple[Assessment, ...]:
    """Simulate the motion without any strategy, and that of each plan of the same job."""
    nominal = Nominal(analysis.track)
    machine, period = plans[0].machine, plans[0].machine.servo_period
    return tuple(
        assess(command_of(one, analysis.track, period), machine, nominal, analysis.turning_points)
        for one in (without_strategy(plans[0]), *plans)
    )


def describe_violation(broken: Violation) -> str:
    """Describe the limit that a command breaks, and where."""
    words = {"velocity": "mm/s", "acceleration": "mm/s²", "jerk": "mm/s³", "motor acceleration": "rad/s²"}
    scale = 1.0 if broken.quantity == "motor acceleration" else MM
    return (
        f"breaks the {broken.quantity} limit of {broken.axis} at {broken.t:.3f} s: "
        f"{broken.value / scale:.6g} {words[broken.quantity]} where {broken.limit / scale:.6g} is allowed"
    )


PASSED = 1e-6
"""Places along the path less than this [m] apart are one."""


def window_number(plan: Plan, point: TurningPoint) -> int | None:
    """Return the number of a turning point's window, None where it has none."""
    rows = enumerate(plan.windows)
    return next((number for number, window in rows if point.index in window.members), None)


def crossings_at(plan: Plan, point: TurningPoint) -> tuple[Crossing | Jog, ...]:
    """Return the crossings of the gap at a turning point: of its window, and those made as it is passed.

    The latter belong to no window: there is none in a corner, and the motion may rest for them.
    """
    number = window_number(plan, point)
    own = [one for one in plan.crossings if one.axis == point.axis]
    middles = np.array([one.start + 0.5 * one.duration for one in own])
    places = place_and_feed(plan.phases, middles)[0] if own else middles
    return tuple(
        one
        for one, s in zip(own, places.tolist(), strict=True)
        if one.window == number or (one.window < 0 and s > PASSED and abs(s - point.s) < PASSED)
    )


def strategy_at(plan: Plan, point: TurningPoint) -> str:
    """Name what a plan does at a turning point: the plan's strategy, or what that chose there."""
    number = window_number(plan, point)
    profile = None if number is None else plan.profiles[number]
    if profile is not None:
        return profile.strategy or plan.strategy
    turns = any(one.window == number and one.axis == point.axis for one in plan.friction)
    return plan.crosses_by or plan.strategy if turns or crossings_at(plan, point) else PLAIN


def chosen_in_order(plan: Plan) -> tuple[tuple[str, str], ...]:
    """Return the axis of every turning point, in order, and what a plan does there."""
    return tuple((point.axis, strategy_at(plan, point)) for point in plan.turning_points)


def chosen_at(chosen: Sequence[tuple[str, str]]) -> dict[str, list[int]]:
    """Sort the numbers of turning points by what is done there; those left alone are last, under "none".

    Examples
    --------
    >>> chosen_at([("X", "none"), ("Y", "takeup"), ("X", "takeup")])
    {'takeup': [1, 2], 'none': [0]}
    """
    found: dict[str, list[int]] = {}
    for number, (_, strategy) in enumerate(chosen):
        found.setdefault(strategy, []).append(number)
    return dict(sorted(found.items(), key=lambda item: (item[0] == PLAIN, item[0])))
