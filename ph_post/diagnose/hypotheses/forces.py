"""Hypotheses about forces on the axis, and about waves along its travel."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
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
    force_periods,
    longest_period,
    reversal_step,
    speeds,
)
from ph_post.drive.effects.registry import find_effect
from ph_post.drive.plant import Plant
from ph_post.identify.free_run import AxisProblem

GUESS: Final = 3.0 * MICRON
"""A size worth trying, of an error or of a force as F/K [m]."""


def wave_hypothesis(
    name: str,
    size: str,
    high: float,
    longest: float,
    periods: Callable[[AxisProblem, Residuals], Sequence[float]],
    bars: Callable[[AxisProblem], str],
) -> Hypothesis:
    """Return the hypothesis of a wave along the travel; its numbers are sine, cosine and log of the period.

    Parameters
    ----------
    name, size : str
        Of the effect, and of its leading parameter.
    high : float
        Largest sine or cosine [m].
    longest : float
        Longest period [m]: the travel must hold some.
    periods : callable
        AxisProblem and residuals to periods worth trying [m].
    bars : callable
        As of every hypothesis.
    """

    def values(sine: float, cosine: float, period: float) -> dict[str, float]:
        whole, phase = math.hypot(sine, cosine), math.atan2(cosine, sine)
        return {size: whole, "period": math.exp(period), "phase": phase}

    low, top = math.log(1e-4), math.log(max(longest, 2e-4))
    return effect_hypothesis(
        name,
        values,
        numbers=(
            *(HypothesisNumber(name=n, low=-high, high=high, scale=MICRON, linear=True) for n in ("sine", "cosine")),
            HypothesisNumber(name="period", low=low, high=top, scale=0.003, logarithm=True),
        ),
        starts=lambda problem, left: [(GUESS, GUESS, math.log(one)) for one in periods(problem, left)],
        bars=bars,
    )


MOST_FORCE: Final = 5e-3
"""Largest force tried, F/K [m]."""

MOST_LAG: Final = 0.05
"""Largest viscous coefficient tried [s]."""

MOVES: Final = 1e-3
"""Part of the largest speed above which an axis moves."""

FASTEST: Final = 0.05
"""Speed over which static friction has died out on any machine's ways [m/s]."""


def _force(name: str = "force", low: float = 0.0) -> HypothesisNumber:
    return HypothesisNumber(name=name, low=low, high=MOST_FORCE, scale=MICRON, linear=True)


def _step(problem: AxisProblem, left: Residuals) -> float:
    return max(abs(reversal_step(problem, left)), GUESS)


def _no_friction(problem: AxisProblem) -> str:
    return "an ideal stepper feels no force" if problem.plant.b == 0.0 else ""


COULOMB = effect_hypothesis(
    "coulomb_friction",
    lambda force: {"force": force},
    numbers=(_force(),),
    starts=lambda problem, left: [(_step(problem, left),)],
    bars=_no_friction,
)


def _has_stribeck(problem: AxisProblem) -> str:
    return _no_friction(problem) or ("the file has it already" if problem.plant.static else "")


STRIBECK = effect_hypothesis(
    "stribeck_friction",
    lambda force, more, speed: {
        "force": force,
        "static_force": force + more,
        "stribeck_velocity": math.exp(speed),
    },
    numbers=(
        _force(),
        _force("more"),
        HypothesisNumber(name="speed", low=math.log(1e-5), high=math.log(FASTEST), scale=0.3, logarithm=True),
    ),
    starts=lambda problem, left: [(_step(problem, left), GUESS, math.log(v)) for v in speeds(problem)],
    bars=_has_stribeck,
    within=("coulomb_friction",),
)

VISCOUS = effect_hypothesis(
    "viscous_friction",
    lambda coefficient: {"coefficient": coefficient},
    numbers=(HypothesisNumber(name="coefficient", low=0.0, high=MOST_LAG, scale=1e-5, linear=True),),
    starts=lambda _problem, _left: [(1e-4,)],
    bars=_no_friction,
    excludes=("servo_mismatch",),
)


def _asymmetry(plant: Plant, numbers: Numbers, even_at: float = 0.0) -> Plant:
    """Keep what is left of c positive, whatever is tried; of a cascade that is the part of its loops, too.

    `even_at` [m/s] is the speed at which both directions are braked alike.
    """
    least = -0.9 * (plant.c if plant.cascade is None else plant.c + 1.0 / plant.cascade.position_gain)
    plus, minus = (max(number, least) for number in numbers)
    return find_effect("friction_asymmetry").apply(plant, {"plus": plus, "minus": minus, "even_at": even_at})


def _by_direction(_problem: AxisProblem, numbers: Numbers) -> dict[str, float]:
    """Return the difference, which is what c does not hold, and both coefficients."""
    plus, minus = numbers
    return {"difference": plus - minus, "plus": plus, "minus": minus}


ASYMMETRY = Hypothesis(
    name="friction_asymmetry",
    numbers=tuple(
        HypothesisNumber(name=name, low=-MOST_LAG, high=MOST_LAG, scale=1e-5, linear=True) for name in ("plus", "minus")
    ),
    apply=_asymmetry,
    starts=lambda _problem, _left: [(1e-4, -1e-4)],
    values=_by_direction,
    bars=_no_friction,
    within=("viscous_friction", "load_offset"),
    bare=lambda n: (0.5 * (n[0] + n[1]),) * 2,
    excludes=("viscous_friction", "servo_mismatch", "friction_asymmetry"),
)


DIFFERENCE = replace(
    ASYMMETRY,
    variant="about c",
    numbers=(HypothesisNumber(name="difference", low=-MOST_LAG, high=MOST_LAG, scale=1e-5, linear=True),),
    apply=lambda plant, n: _asymmetry(plant, (0.5 * n[0], -0.5 * n[0])),
    starts=lambda _problem, _left: [(1e-4,)],
    values=lambda problem, n: _by_direction(problem, (0.5 * n[0], -0.5 * n[0])),
    bare=None,
    excludes=(),
)


def _beside_a_load(problem: AxisProblem) -> Hypothesis:
    """Return friction that differs by direction where a load is there: even at the mean speed of the log.

    A constant force is the mean of what differs. Even at rest, the difference would take the load's place; even at the
    mean speed it says how the force changes from there, and the load stays what it is.
    """
    speed = np.abs(problem.speed[problem.counted])
    moving = speed[speed > MOVES * np.max(speed, initial=0.0)]
    even_at = float(np.mean(moving)) if moving.size else 0.0
    return replace(
        DIFFERENCE,
        variant="beside a load",
        apply=lambda plant, n: _asymmetry(plant, (0.5 * n[0], -0.5 * n[0]), even_at),
        values=lambda problem, n: {**DIFFERENCE.values(problem, n), "even_at": even_at},
        within=("friction_asymmetry",),
        excludes=("friction_asymmetry",),
        beside=("load_offset",),
    )


def _needs_effort(problem: AxisProblem) -> str:
    """Say where a load shows no more than a wrong origin: it also keeps a table in the loop on a flank."""
    in_gap = problem.plant.loop.encloses_backlash and problem.plant.gap > 0.0
    shows = problem.has("force") or in_gap
    return _no_friction(problem) or ("" if shows else LogReason("needs a force or current channel"))


LOAD = effect_hypothesis(
    "load_offset",
    lambda force: {"force": force},
    numbers=(_force(low=-MOST_FORCE),),
    starts=lambda _problem, _left: [(GUESS,)],
    bars=_needs_effort,
)


def _one_axis(problem: AxisProblem) -> str:
    moving = np.ptp(problem.velocity, axis=0) > 0.0
    alone = LogReason("with one axis moving it is friction") if np.count_nonzero(moving) < 2 else ""
    return _no_friction(problem) or alone


REFERENCE_FEED: Final = 1.0 / 60.0
"""Feed to which a cutting force is referred [m/s]: 1000 mm/min."""


CUTTING = effect_hypothesis(
    "cutting_force",
    lambda force, exponent=0.0: {"force": force, "feed": REFERENCE_FEED, "exponent": exponent},
    numbers=(_force(low=-MOST_FORCE),),
    starts=lambda _problem, _left: [(GUESS,)],
    bars=_one_axis,
)

CUTTING_BY_FEED = replace(
    CUTTING,
    variant="by feed",
    excludes=("cutting_force",),
    within=("viscous_friction",),
    numbers=(*CUTTING.numbers, HypothesisNumber(name="exponent", low=0.05, high=1.1, scale=0.1, ends=True)),
    starts=lambda _problem, _left: [(GUESS, 0.7)],
)

NEARLY_BY_SPEED: Final = 0.9
"""Exponent up to which cutting forces are told from viscous friction, which is one of exponent 1: those of steel and
aluminium have 0.7 to 0.9."""

CUTTING_NEARLY_VISCOUS = effect_hypothesis(
    "cutting_force",
    lambda force: {"force": force, "feed": REFERENCE_FEED, "exponent": NEARLY_BY_SPEED},
    variant="nearly viscous",
    numbers=CUTTING.numbers,
    starts=CUTTING.starts,
    bars=_one_axis,
)


def force_hypotheses(problem: AxisProblem) -> tuple[Hypothesis, ...]:
    """Hypotheses about forces on one axis."""
    cogs = wave_hypothesis("cogging", "force", MOST_FORCE, longest_period(problem), force_periods, _no_friction)
    differs = (DIFFERENCE, ASYMMETRY, _beside_a_load(problem))
    return (COULOMB, STRIBECK, VISCOUS, *differs, LOAD, cogs, CUTTING, CUTTING_BY_FEED)
