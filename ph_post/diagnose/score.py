"""How a fit is judged: what it gains on samples held out, what it explains, and whether anything is left."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.fit import Fitted, inflation, left_of, mean_square, nats
from ph_post.diagnose.hypotheses.base import Hypothesis
from ph_post.diagnose.model import Problem
from ph_post.diagnose.structure import is_structured
from ph_post.types import Array, BoolArray

PRICE: Final = 3.0
"""Nats that a number must earn on samples that it was not fitted to."""

SHARE: Final = 0.25
"""Part of the excess over the noise, of one channel, that an effect has to explain."""

MOST_SHARE: Final = 0.5
"""The same where there is a name already, and more than noise is left behind the next one too."""

VISIBLE: Final = 0.02
"""Part of a channel's held-out root mean square by which it must fall."""

MORE_VISIBLE: Final = 0.04
"""The same where there is a name already."""

OWN: Final = 1.5
"""Times the noise that an effect by itself must do to some reading: less than the noise is worth no name."""

FLOOR: Final = 1.5
"""Times the noise up to which what is left counts as noise."""

OUT: Final = 0.75
"""Root mean square of what is more than noise, in parts of the noise, from which it needs a name."""


class Scored(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A hypothesis added to a model, fitted, and its score over that model [nats]."""

    hypothesis: Hypothesis
    fitted: Fitted
    score: float


def gain_over(problem: Problem, ground: Fitted, fitted: Fitted) -> float:
    """Return what a fit gains over another on the samples held out [nats], as if they were independent."""
    return nats(problem, fitted.left, problem.held) - nats(problem, ground.left, problem.held)


def worth_of(problem: Problem, fitted: Fitted) -> float:
    """How many samples it takes to know as much as from one that is independent of the others."""
    return inflation(problem, fitted.left, problem.held)


def score_over(problem: Problem, ground: Fitted, fitted: Fitted, worth: float | None = None) -> float:
    """Score of a fit over another with fewer parts; `worth` where several are compared."""
    more = len(fitted.unknowns) - len(ground.unknowns)
    worth = worth_of(problem, fitted) if worth is None else worth
    return gain_over(problem, ground, fitted) / worth - PRICE * max(more, 1)


def rank(problem: Problem, ground: Fitted, fits: Sequence[tuple[Hypothesis, Fitted]]) -> list[Scored]:
    """Score fits of one number of samples, that of the fit that gains most, best first."""
    if not fits:
        return []
    _, most = max(fits, key=lambda one: gain_over(problem, ground, one[1]))
    worth = worth_of(problem, most)
    scored = [
        Scored(hypothesis=hypothesis, fitted=fitted, score=score_over(problem, ground, fitted, worth))
        for hypothesis, fitted in fits
    ]
    return sorted(scored, key=lambda one: -one.score)


def has_structure(problem: Problem, fitted: Fitted, size: float = OUT) -> bool:
    """Whether what a model leaves of any channel is more than noise, by at least that part of the noise."""
    return any(
        _stands_out(fitted.left[one.channel], problem.counted & one.ok, one.noise, size)
        for one in problem.observed
    )


def _stands_out(values: Array, use: BoolArray, noise: float, least: float) -> bool:
    structured, size = is_structured(values, use, noise)
    return structured and size > least


def with_noise(problem: Problem, fitted: Fitted) -> Problem:
    """Lower the noise of a channel to what a model leaves of it: nothing leaves less than the noise."""
    observed = tuple(
        one._replace(
            noise=min(
                one.noise, float(np.sqrt(mean_square(fitted.left[one.channel], problem.counted & one.ok)))
            )
        )
        for one in problem.observed
    )
    return replace(problem, observed=observed)


def explains(problem: Problem, before: Fitted, after: Fitted) -> bool:
    """Whether a fit lowers what is left of some channel, held out, by enough to be worth a name."""
    visible = MORE_VISIBLE if before.model.parts else VISIBLE
    share = MOST_SHARE if before.model.parts and not at_floor(problem, after) else SHARE
    for one in problem.observed:
        here = problem.held & one.ok
        was, now = (mean_square(fit.left[one.channel], here) for fit in (before, after))
        excess = was - one.noise**2
        if was - now > share * excess > 0.0 and np.sqrt(now) < (1.0 - visible) * np.sqrt(was):
            return True
    return False


def does_enough(problem: Problem, fitted: Fitted) -> bool:
    """Whether the last part of a model, base values as they are, does more than noise to some reading."""
    without = left_of(problem, replace(fitted.model, parts=fitted.model.parts[:-1]))
    return any(
        mean_square(fitted.left[one.channel] - without[one.channel], problem.counted & one.ok)
        > (OWN * one.noise) ** 2
        for one in problem.observed
    )


def at_floor(problem: Problem, fitted: Fitted) -> bool:
    """Whether a model leaves no more than noise of the positions, held out."""
    return all(
        mean_square(fitted.left[one.channel], problem.held & one.ok) < (FLOOR * one.noise) ** 2
        for one in problem.observed
        if one.channel != "force"
    )
