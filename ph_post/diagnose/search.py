"""Trying hypotheses on top of a fitted model: a race in which most drop out after a few steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ph_post.diagnose.fit import Fitted, Model, fit_model, look_at, nats
from ph_post.diagnose.hypotheses import hypotheses
from ph_post.diagnose.hypotheses.base import Hypothesis
from ph_post.diagnose.model import Problem
from ph_post.diagnose.score import Scored, has_structure, rank
from ph_post.diagnose.seeds import Ground, Seed, ground_of, is_linear, seed
from ph_post.types import Array

ABREAST: Final = 0.6
"""Part of the best one's gain from which a hypothesis is fitted to the end."""

FIRST_LOOK: Final = 5
"""Steps of a fit from each start; only the better one goes on."""

CLOSEST: Final = 6
"""Hypotheses that are fitted in a round, besides those that promise nearly as much as the best."""

NEARLY: Final = 0.3
"""What that is, of the squares that the best one promises to explain."""


class Search:
    """The hypotheses that were tried on top of fitted models of one axis, each once."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.known: dict[int, tuple[Fitted, list[tuple[Hypothesis, Fitted]]]] = {}
        self.plausible: set[str] = set()

    def tried(self, ground: Fitted, every: bool = True) -> list[tuple[Hypothesis, Fitted]]:
        """Fit every hypothesis that promises something on top of a model, or only the plausible ones."""
        if id(ground) not in self.known:
            only = None if every else self.plausible
            self.known[id(ground)] = (ground, _try_all(self.problem, ground, only))
        return self.known[id(ground)][1]

    def ranked(self, ground: Fitted) -> list[Scored]:
        """Return those, best first; what comes near the best is plausible from then on."""
        found = rank(self.problem, ground, self.tried(ground))
        most = found[0].score if found else 0.0
        self.plausible |= {one.hypothesis.label for one in found if one.score > NEARLY * most}
        return found


def _try_all(problem: Problem, ground: Fitted, only: set[str] | None) -> list[tuple[Hypothesis, Fitted]]:
    base = ground_of(problem, ground)
    squares = float(base.rows @ base.rows)
    seeds = []
    for hypothesis in hypotheses(problem):
        if not _joins(ground.model, hypothesis) or (only is not None and hypothesis.label not in only):
            continue
        found = seed(base, hypothesis)
        # A start that makes things much worse is on the wrong side of what can be reached from it.
        if found and (found[0].promise > 0.0 or (not is_linear(hypothesis) and found[0].promise > -squares)):
            seeds.append((found[0].promise, hypothesis, found))
    seeds.sort(key=lambda one: -one[0])
    most = seeds[0][0] if seeds else 0.0
    close = [
        (hypothesis, found)
        for place, (promise, hypothesis, found) in enumerate(seeds)
        if place < CLOSEST or promise > NEARLY * most or not is_linear(hypothesis)
    ]
    tried = _race(base, [one for one in close if not one[0].within])
    # What contains another is only worth its time where the other leaves something.
    enough = {hypothesis.name for hypothesis, fitted in tried if not has_structure(problem, fitted)}
    return tried + _race(base, [one for one in close if one[0].within and enough.isdisjoint(one[0].within)])


def _race(
    base: Ground, close: Sequence[tuple[Hypothesis, Sequence[Seed]]]
) -> list[tuple[Hypothesis, Fitted]]:
    """Look at every hypothesis, and fit those to the end that gain nearly as much as the best."""
    problem = base.problem
    looked = [(hypothesis, _look(base, hypothesis, seeds)) for hypothesis, seeds in close]
    start = nats(problem, base.fitted.left, problem.fit)
    gains = [nats(problem, fitted.left, problem.fit) - start for _, fitted in looked]
    most = max(gains, default=0.0)
    return [
        (hypothesis, fit_model(problem, fitted.model, problem.fit) if gain > ABREAST * most else fitted)
        for (hypothesis, fitted), gain in zip(looked, gains, strict=True)
    ]


def _look(base: Ground, hypothesis: Hypothesis, seeds: Sequence[Seed]) -> Fitted:
    """Fit one hypothesis for a few steps from its best starts."""
    problem, ground = base.problem, base.fitted
    fits = [
        look_at(problem, one.model, base.weights, _known_slopes(ground, one.model), FIRST_LOOK)
        for one in (seeds[:1] if hypothesis.within else seeds[:2])
    ]
    return max(fits, key=lambda one: nats(problem, one.left, problem.fit))


def _known_slopes(ground: Fitted, more: Model) -> dict[int, Array]:
    """Slopes of a fitted model by the unknowns of one that has a part more."""
    if not ground.jacobian.shape[0]:
        return {}
    was = ground.model.free
    gone = [k for k, prior in enumerate(was) if prior not in more.free]
    # The rows of the priors come last, one each: those that are replaced have none any more, nor a column.
    data = ground.jacobian.shape[0] - len(was)
    slopes = np.delete(np.delete(ground.jacobian, gone, axis=1), [data + k for k in gone], axis=0)
    return dict(enumerate(slopes.T))


def _joins(model: Model, hypothesis: Hypothesis) -> bool:
    """Whether a hypothesis means something beside the parts of a model."""
    for part in model.parts:
        there = part.hypothesis
        if there.label == hypothesis.label or there.name in hypothesis.excludes:
            return False
        if hypothesis.name in there.excludes:
            return False
    return True
