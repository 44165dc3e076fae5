"""Hypotheses about what comes again along the travel: forces of the motor, errors of a reading."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from ph_post.diagnose.hypotheses.base import MICRON, Hypothesis, Number, Numbers, Residuals
from ph_post.diagnose.model import Problem
from ph_post.drive.effects.registry import find_effect
from ph_post.drive.plant import Plant

GUESS: Final = 3.0 * MICRON
"""A size worth trying, of an error or of a force as F/K [m]."""


def wave_hypothesis(
    name: str,
    size: str,
    high: float,
    longest: float,
    periods: Callable[[Problem, Residuals], Sequence[float]],
    bars: Callable[[Problem], str],
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
        Problem and residuals to periods worth trying [m].
    bars : callable
        As of every hypothesis.
    """

    def parameters(numbers: Numbers) -> dict[str, float]:
        sine, cosine, period = numbers
        whole, phase = math.hypot(sine, cosine), math.atan2(cosine, sine)
        return {size: whole, "period": math.exp(period), "phase": phase}

    def apply(plant: Plant, numbers: Numbers) -> Plant:
        return find_effect(name).apply(plant, parameters(numbers))

    low, top = math.log(1e-4), math.log(max(longest, 2e-4))
    return Hypothesis(
        name=name,
        numbers=(
            *(Number(name=n, low=-high, high=high, scale=MICRON, linear=True) for n in ("sine", "cosine")),
            Number(name="period", low=low, high=top, scale=0.003, logarithm=True),
        ),
        apply=apply,
        starts=lambda problem, left: [(GUESS, GUESS, math.log(one)) for one in periods(problem, left)],
        values=lambda _problem, numbers: parameters(numbers),
        bars=bars,
    )
