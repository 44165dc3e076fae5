"""Hypotheses about backlash, servo and motor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.hypotheses.base import (
    MICRON,
    Hypothesis,
    HypothesisNumber,
    LogReason,
    Numbers,
    Residuals,
    effect_hypothesis,
    middle,
    reach,
    reversal_step,
)
from ph_post.drive.effects.registry import find_effect
from ph_post.drive.plant import Plant, base_value, with_base_value
from ph_post.identify.cascade_numbers import CASCADE_NUMBERS, FITTED
from ph_post.identify.free_run import AxisProblem, efforts
from ph_post.types import Cascade

MOST_GAP: Final = 5e-3
"""Widest gap tried [m]."""

FARTHEST: Final = math.log(8.0)
"""Most error of b and c, as a logarithm."""

FARTHEST_GAIN: Final = math.log(50.0)
"""The same of a gain that a log was fitted by beforehand."""


LIMITS: Final = (*np.linspace(0.995, 0.8, 20), *np.linspace(0.77, 0.5, 10))
"""Torque limits that are tried, in parts of the largest torque that is asked for."""


def _needs_table(problem: AxisProblem) -> str:
    return "" if problem.has("act") else LogReason("behind the motor's loop only a reading of the table shows it")


def _shows_gap(problem: AxisProblem) -> str:
    if problem.plant.loop.encloses_backlash or problem.side == "unknown":
        return ""
    return _needs_table(problem)


def _wider(plant: Plant, numbers: Numbers) -> Plant:
    return replace(plant, gap=max(plant.gap + numbers[0], 0.0))


def _gaps(problem: AxisProblem, left: Residuals) -> list[Numbers]:
    step = 2.0 * reversal_step(problem, left)
    tried = [step, MICRON, 10.0 * MICRON, 50.0 * MICRON, 200.0 * MICRON]
    if problem.plant.gap > 0.0:
        tried += [-0.3 * problem.plant.gap, -0.8 * problem.plant.gap]
    return [(more,) for more in tried if problem.plant.gap + more > 0.0]


BACKLASH = Hypothesis(
    name="backlash",
    numbers=(HypothesisNumber(name="more", low=-MOST_GAP, high=MOST_GAP, scale=MICRON),),
    apply=_wider,
    starts=_gaps,
    values=lambda problem, n: {"lost_motion": max(problem.plant.gap + n[0], 0.0)},
    bars=_shows_gap,
    replaces=("gap",),
    taken=lambda filed, fitted: [(fitted.gap - filed.gap,)],
)


def _slope_values(problem: AxisProblem, numbers: Numbers) -> dict[str, float]:
    """Slope over the travel, and the place at which the gap is that of the file."""
    slope, more = numbers
    reference = middle(problem) - more / slope if slope else 0.0
    return {"slope": slope, "reference": reference}


def _sloped(problem_middle: float) -> Hypothesis:
    def apply(plant: Plant, numbers: Numbers) -> Plant:
        slope, more = numbers
        values = {"slope": slope, "reference": problem_middle, **NO_BUMP}
        return find_effect("position_dependent_backlash").apply(_wider(plant, (more,)), values)

    return Hypothesis(
        name="position_dependent_backlash",
        variant="slope",
        numbers=(
            HypothesisNumber(name="slope", low=-0.05, high=0.05, scale=1e-5),
            HypothesisNumber(name="more", low=-MOST_GAP, high=MOST_GAP, scale=MICRON),
        ),
        apply=apply,
        starts=_slopes,
        values=_slope_values,
        bars=_shows_gap,
        within=("backlash",),
        replaces=("gap",),
    )


NO_BUMP: Final = {"bump": 0.0, "centre": 0.0, "width": 0.01}


def _slopes(problem: AxisProblem, left: Residuals) -> list[Numbers]:
    step = max(2.0 * abs(reversal_step(problem, left)), 5.0 * MICRON)
    steep = step / max(reach(problem), 1e-3)
    return [(sign * steep, more) for sign in (1.0, -1.0) for more in (0.0, step)]


def _bump(plant: Plant, numbers: Numbers) -> Plant:
    bump, centre, width = numbers
    values = {"slope": 0.0, "reference": 0.0, "bump": bump, "centre": centre, "width": math.exp(width)}
    return find_effect("position_dependent_backlash").apply(plant, values)


def _bumps(problem: AxisProblem, left: Residuals) -> list[Numbers]:
    step = max(2.0 * abs(reversal_step(problem, left)), 10.0 * MICRON)
    centre, half = middle(problem), reach(problem)
    width = math.log(max(0.3 * half, 1e-3))
    return [(step, centre + share * half, width) for share in (-0.9, -0.5, 0.0, 0.5, 0.9)]


def _bumped(half: float) -> Hypothesis:
    """Return a bump narrower than half the travel: a wider one is a gap of another size."""
    widest = math.log(max(half, 2e-3))
    return Hypothesis(
        name="position_dependent_backlash",
        variant="bump",
        numbers=(
            HypothesisNumber(name="bump", low=-MOST_GAP, high=MOST_GAP, scale=MICRON),
            HypothesisNumber(name="centre", low=-10.0, high=10.0, scale=1e-3),
            HypothesisNumber(name="width", low=math.log(5e-4), high=widest, scale=0.1, logarithm=True),
        ),
        apply=_bump,
        starts=_bumps,
        values=lambda _problem, n: {"bump": n[0], "centre": n[1], "width": math.exp(n[2])},
        bars=_shows_gap,
        within=("backlash",),
    )


def _no_servo(problem: AxisProblem) -> str:
    return "an ideal stepper has no servo" if problem.plant.b == 0.0 else ""


MISMATCH = Hypothesis(
    name="servo_mismatch",
    numbers=tuple(
        HypothesisNumber(name=name, low=-FARTHEST, high=FARTHEST, scale=0.02, linear=True) for name in ("b", "c")
    ),
    apply=lambda plant, n: replace(plant, b=plant.b * math.exp(n[0]), c=plant.c * math.exp(n[1])),
    starts=lambda _problem, _left: [(0.03, 0.03)],
    values=lambda problem, n: {
        "c": problem.plant.c * math.exp(n[1]),
        "b": problem.plant.b * math.exp(n[0]),
    },
    bars=_no_servo,
    replaces=("b", "c"),
    excludes=("viscous_friction",),
)


def _gains(problem: AxisProblem) -> tuple[str, ...]:
    """List the numbers of an axis' cascade that may be off, or missing as T_n, by name."""
    cascade = problem.plant.cascade
    assert cascade is not None
    return tuple(name for name in FITTED if name == "velocity_integral_time" or CASCADE_NUMBERS[name].of(cascade))


def _cascade_mismatch(
    cascade: Cascade, names: tuple[str, ...], variant: str = "", within: tuple[str, ...] = ()
) -> Hypothesis:
    """Return the hypothesis that numbers of a cascade are off: a part of what they are, of those in ADDED a sum."""
    fields = tuple(CASCADE_NUMBERS[name].field for name in names)
    added = {field: bounds for field, bounds in ADDED.items() if field != INTEGRAL or not cascade.integral_rate}

    def put(plant: Plant, numbers: Numbers) -> Plant:
        for field, more in zip(fields, numbers, strict=True):
            value = base_value(plant, field)
            changed = max(value + more, 0.0) if field in added else value * math.exp(more)
            plant = with_base_value(plant, field, changed)
        return plant

    def values(problem: AxisProblem, numbers: Numbers) -> dict[str, float]:
        cascade = put(problem.plant, numbers).cascade
        assert cascade is not None
        return {name: float(CASCADE_NUMBERS[name].of(cascade) or 0.0) for name in names}

    return Hypothesis(
        name="servo_mismatch",
        variant=variant,
        numbers=tuple(
            HypothesisNumber(name=field, low=low, high=high, scale=0.02 * high, linear=True)
            for field in fields
            for low, high in (added.get(field, (-FARTHEST, FARTHEST)),)
        ),
        apply=put,
        starts=lambda _problem, _left: [tuple(0.01 * added.get(field, (0.0, FARTHEST))[1] for field in fields)],
        values=values,
        within=within,
        replaces=fields,
        excludes=("viscous_friction", "servo_mismatch"),
    )


def far_servo(problem: AxisProblem) -> Hypothesis:
    """Return the hypothesis that the gains of a cascade are far from the file's."""
    cascade = problem.plant.cascade
    assert cascade is not None
    found = _cascade_mismatch(cascade, _gains(problem))
    wider = tuple(
        one if one.name in ADDED else replace(one, low=-FARTHEST_GAIN, high=FARTHEST_GAIN) for one in found.numbers
    )
    return replace(found, numbers=wider)


def numbers_to(problem: AxisProblem, plant: Plant) -> Numbers:
    """Return the numbers by which :func:`far_servo` makes the servo of an axis that of another plant."""
    made = []
    for name in _gains(problem):
        field = CASCADE_NUMBERS[name].field
        there, here = base_value(plant, field), base_value(problem.plant, field)
        summed = field in ADDED and (field != INTEGRAL or not here)
        made.append(there - here if summed else math.log(max(there, 1e-9) / here))
    return tuple(made)


INTEGRAL: Final = "integral_rate"
"""One over T_n: it is added to where the file has none."""

ADDED: Final = {"velocity_feedforward": (-1.0, 1.0), "dead_time": (-0.02, 0.02), INTEGRAL: (0.2, 500.0)}
"""Least and most that is added to numbers of a cascade which may be 0; gains are multiplied."""

LONGEST_FILTER: Final = 0.2
"""Longest filter of a command [s]."""


def _filter(name: str, tried: Sequence[float]) -> Hypothesis:
    """Return the hypothesis that the command of a cascade passes a longer filter than the file knows of."""
    number = CASCADE_NUMBERS[name]

    def put(plant: Plant, numbers: Numbers) -> Plant:
        return with_base_value(plant, number.field, base_value(plant, number.field) + numbers[0])

    return Hypothesis(
        name="command_filter",
        variant=name,
        numbers=(HypothesisNumber(name=number.field, low=0.0, high=LONGEST_FILTER, scale=1e-3),),
        apply=put,
        starts=lambda _problem, _left: [(one,) for one in tried],
        values=lambda problem, n: {name: base_value(put(problem.plant, n), number.field)},
        bars=lambda problem: "" if problem.plant.cascade is not None else "a single loop has no filters in its file",
        excludes=("command_filter",),
    )


FILTERS: Final = (
    _filter("moving_average", (0.001, 0.003, 0.008, 0.02, 0.05)),
    _filter("exponential_filter", (0.0003, 0.001, 0.003, 0.008, 0.02)),
)


def _servo_hypotheses(problem: AxisProblem) -> tuple[Hypothesis, ...]:
    """Hypotheses about the numbers of a servo: of a cascade also that its feed-forward alone is off.

    One without T_n may have other gains and none all the same: the longest that is fitted would still show.
    """
    if problem.plant.cascade is None:
        return (MISMATCH,)
    cascade, names = problem.plant.cascade, _gains(problem)
    forward = _cascade_mismatch(cascade, ("velocity_feedforward",), "feed-forward")
    whole = _cascade_mismatch(cascade, names, within=(forward.name,))
    if cascade.integral_rate:
        return forward, whole
    gains = tuple(name for name in names if name != "velocity_integral_time")
    return forward, _cascade_mismatch(cascade, gains, "gains"), whole


def _rigid(problem: AxisProblem) -> str:
    if problem.plant.windup_frequency:
        return "the file has it already"
    if problem.plant.loop.encloses_backlash:
        return _no_servo(problem) or ("" if problem.plant.eta < 0.98 else "no table behind the spring")
    return _needs_table(problem)


WINDUP = effect_hypothesis(
    "elastic_windup",
    lambda frequency, damping: {"resonance": math.exp(frequency), "damping_ratio": damping},
    numbers=(
        HypothesisNumber(name="frequency", low=math.log(6.0), high=math.log(6000.0), scale=0.02, logarithm=True),
        HypothesisNumber(name="damping", low=0.0, high=0.95, scale=0.05),
    ),
    starts=lambda _problem, _left: [
        (math.log(2.0 * math.pi * hertz), 0.05) for hertz in (6.0, 12.0, 20.0, 35.0, 60.0, 100.0, 200.0, 350.0, 600.0)
    ],
    bars=_rigid,
)


def _no_impact(problem: AxisProblem) -> str:
    plant = problem.plant
    if not plant.loop.encloses_backlash:
        return "outside of the loop nothing is picked up"
    if plant.pickup != "standstill":
        return "the file keeps momentum already"
    return "" if plant.gap > 0.0 else "there is no backlash to cross"


IMPACT = effect_hypothesis(
    "engagement_impact",
    lambda kept: {"kept": kept},
    numbers=(HypothesisNumber(name="kept", low=0.0, high=1.0, scale=0.1),),
    starts=lambda _problem, _left: [(0.97,), (0.85,), (0.7,), (0.55,), (0.4,), (0.2,)],
    bars=_no_impact,
)


def _limits(problem: AxisProblem, _left: Residuals) -> list[Numbers]:
    """Return parts of the most that the loops of the file's model ask its motor for.

    They lie close: a limit a hundredth too low is reached so much longer that nothing fits.
    """
    asked = np.abs(efforts(problem, problem.plant))[problem.counted]
    largest = max(float(np.max(asked, initial=0.0)), MICRON)
    return [(float(share * largest),) for share in LIMITS]


def _no_torque(problem: AxisProblem) -> str:
    return _no_servo(problem) if problem.plant.loop.has_controller else "an open loop is not limited by it"


SATURATION = effect_hypothesis(
    "torque_saturation",
    lambda limit: {"limit": limit},
    numbers=(HypothesisNumber(name="limit", low=1e-7, high=1.0, scale=1e-5),),
    starts=_limits,
    bars=_no_torque,
)


def drive_hypotheses(problem: AxisProblem) -> tuple[Hypothesis, ...]:
    """Hypotheses about gap, servo and motor on one axis; a slope is about the middle of its travel."""
    uneven = (_sloped(middle(problem)), _bumped(reach(problem)))
    return (BACKLASH, *uneven, *_servo_hypotheses(problem), *FILTERS, WINDUP, IMPACT, SATURATION)
