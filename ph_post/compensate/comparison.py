"""All strategies on one path and machine: what each of them leaves of the error, and what it costs."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec

from ph_post.analysis import Analysis
from ph_post.compensate.limits import Violation, check_command
from ph_post.compensate.offsets import command_of
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.pace import Pace, pace_of
from ph_post.compensate.plan import make_plan
from ph_post.compensate.strategies.registry import strategy_names
from ph_post.errors import PhPostError
from ph_post.simulate.assess import Assessment, assess, contour_errors
from ph_post.simulate.contour import ContourError, Nominal
from ph_post.types import Command, Plan, Scenario
from ph_post.units import MM

FIRST, LAST = "none", "auto"
"""What the others are measured against, and what chooses among them."""


class Contender(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One strategy on the job.

    `ok` says whether what it makes can be run; `reason` why not. Where it refused the job, or no motion
    was found inside the limits, there is nothing else.
    """

    name: str
    ok: bool
    reason: str = ""
    plan: Plan | None = None
    command: Command | None = None
    pace: Pace | None = None
    assessment: Assessment | None = None


def compare_strategies(
    analysis: Analysis,
    options_for: Callable[[str], PlanOptions],
    stage: Callable[[str], None] = lambda _: None,
    names: Sequence[str] = (),
) -> tuple[Contender, ...]:
    """Plan, sample and simulate every strategy.

    Parameters
    ----------
    analysis : Analysis
        With a machine.
    options_for : callable
        The options of a strategy, by its name.
    stage : callable, optional
        Told what is being done.
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
        stage(f"planning and simulating {name}")
        found.append(_contender(analysis, options_for(name), nominal, _as_part_of(name, stage)))
    return tuple(found)


def in_order(names: Sequence[str]) -> tuple[str, ...]:
    """Sort strategies by name, but the plain program first and what chooses among the others last.

    Examples
    --------
    >>> in_order(("auto", "dwell", "none", "step"))
    ('none', 'dwell', 'step', 'auto')
    """
    return tuple(sorted(names, key=lambda name: (name != FIRST, name == LAST, name)))


def _as_part_of(name: str, stage: Callable[[str], None]) -> Callable[[str], None]:
    return lambda text: stage(f"{name}: {text}")


def _contender(
    analysis: Analysis, options: PlanOptions, nominal: Nominal, tell: Callable[[str], None]
) -> Contender:
    try:
        plan = make_plan(analysis, options, tell)
        command = command_of(plan, analysis.track, plan.machine.servo_period)
        assessment = assess(command, plan.machine, nominal, analysis.turning_points)
    except PhPostError as refusal:
        return Contender(name=options.strategy, ok=False, reason=" ".join(str(refusal).split()))
    broken = check_command(command, plan.machine)
    return Contender(
        name=options.strategy, ok=not broken, reason=limit_words(broken[0]) if broken else "", plan=plan,
        command=command, pace=pace_of(plan, command, analysis.track), assessment=assessment,
    )  # fmt: skip


def without_gap(analysis: Analysis, contender: Contender) -> ContourError | None:
    """Contour error of a command on the machine without any backlash; None where there is none."""
    if contender.command is None or contender.plan is None:
        return None
    nominal, gapless = Nominal(analysis.track), Scenario(gap=0.0)
    return contour_errors(contender.command, contender.plan.machine, nominal, (gapless,))[0]


def plain(plan: Plan) -> Plan:
    """Return the plan as it would be without any strategy."""
    return msgspec.structs.replace(
        plan, strategy=FIRST, profiles=(None,) * len(plan.profiles), phases=plan.nominal, crossings=(),
        bias={}, inverse_dynamics=False, warnings=(),
    )  # fmt: skip


def before_and_after(analysis: Analysis, *plans: Plan) -> tuple[Assessment, ...]:
    """Simulate the motion without any strategy, and that of each plan of the same job."""
    nominal = Nominal(analysis.track)
    machine, period = plans[0].machine, plans[0].machine.servo_period
    return tuple(
        assess(command_of(one, analysis.track, period), machine, nominal, analysis.turning_points)
        for one in (plain(plans[0]), *plans)
    )


def limit_words(broken: Violation) -> str:
    """Say which limit a command breaks, and where."""
    words = {"velocity": "mm/s", "acceleration": "mm/s²", "jerk": "mm/s³", "motor acceleration": "rad/s²"}
    scale = 1.0 if broken.quantity == "motor acceleration" else MM
    return (
        f"breaks the {broken.quantity} limit of {broken.axis} at {broken.t:.3f} s: "
        f"{broken.value / scale:.6g} {words[broken.quantity]} where {broken.limit / scale:.6g} is allowed"
    )
