"""Choosing what is missing from one axis: forward selection, a backward check, and an exchange of each part.

A hypothesis is judged by the samples that it was not fitted to. Its score is what it gains there in nats,
counted by independent samples, less a price for every number that it has.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.fit import (
    Fitted,
    Model,
    Part,
    base_model,
    fit_model,
    inflation,
    look_at,
    mean_square,
    nats,
    weighted_rows,
    weights_of,
)
from ph_post.diagnose.hypotheses import hypotheses
from ph_post.diagnose.hypotheses.base import Hypothesis, Numbers
from ph_post.diagnose.model import Problem, sided
from ph_post.diagnose.record import Channel
from ph_post.diagnose.structure import is_structured
from ph_post.types import Array, BoolArray

PRICE: Final = 3.0
"""Nats that a number must earn on samples that it was not fitted to."""

EARNS: Final = 8.0
"""Nats above that from which an effect is believed."""

SHARE: Final = 0.25
"""Part of the excess over the noise, of one channel, that an effect has to explain."""

VISIBLE: Final = 0.02
"""Part of a channel's held-out root mean square by which it must fall."""

EQUAL: Final = 5.0
"""Nats within which two hypotheses explain a record equally."""

BLUR: Final = 0.15
"""Where a model leaves more than noise: the part of a score within which two are equal."""

LOYAL: Final = 0.4
"""Where a model leaves more than noise: what a special case may lack of a score and still be taken."""

FLOOR: Final = 1.5
"""Times the noise up to which what is left counts as noise."""

ABREAST: Final = 0.6
"""Part of the best one's gain from which a hypothesis is fitted to the end."""

OUT: Final = 0.75
"""Root mean square of what is more than noise, in parts of the noise, from which it is looked into."""

MOST: Final = 4
"""Effects that are looked for on one axis."""

FIRST_LOOK: Final = 5
"""Steps of a fit from each start; only the better one goes on."""

CLOSEST: Final = 6
"""Hypotheses that are fitted in a round, besides those that promise nearly as much as the best."""

NEARLY: Final = 0.3
"""What that is, of the squares that the best one promises to explain."""


class Scored(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A hypothesis added to a model, fitted, and its score over that model [nats]."""

    hypothesis: Hypothesis
    fitted: Fitted
    score: float


class Standing(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """How a part of a model stands among the other names that could take its place.

    `rivals` explain the record as well; `confidence` is the part's weight among all that were tried, nothing
    included; `better` is the fit with another name in its place, where that is better.
    """

    rivals: tuple[str, ...]
    confidence: float
    better: Fitted | None = None


class Choice(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What was chosen for one axis.

    `stages` are the fits after nothing, one, two, … effects, the first at the file's values refitted within
    their priors; `standings` by part how it holds its place.
    """

    problem: Problem
    stages: tuple[Fitted, ...]
    scores: tuple[float, ...]
    standings: tuple[Standing, ...]

    @property
    def fitted(self) -> Fitted:
        """The last stage."""
        return self.stages[-1]


def with_part(model: Model, hypothesis: Hypothesis, numbers: Numbers) -> Model:
    """Return a model with a part more."""
    return replace(model, parts=(*model.parts, Part(hypothesis=hypothesis, numbers=numbers)))


def without_part(model: Model, number: int) -> Model:
    """Return a model with a part less."""
    return replace(model, parts=model.parts[:number] + model.parts[number + 1 :])


class Ground(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A fitted model as something to add to: weighted rows, and a basis (rows, k) of what it can absorb."""

    problem: Problem
    fitted: Fitted
    weights: Mapping[Channel, float]
    rows: Array
    basis: Array

    def beyond(self, rows: Array) -> Array:
        """Return what of the rows the model cannot absorb."""
        return np.asarray(rows - self.basis @ (self.basis.T @ rows))


def ground_of(problem: Problem, fitted: Fitted) -> Ground:
    """Make a ground of a fitted model."""
    weights = weights_of(problem, fitted.left, problem.fit)
    rows = weighted_rows(problem, fitted.model, weights, problem.fit, fitted.unknowns)
    basis = np.zeros((rows.size, 0))
    if fitted.jacobian.shape[0] == rows.size and fitted.unknowns.size:
        u, s, _ = np.linalg.svd(fitted.jacobian, full_matrices=False)
        basis = u[:, s > 1e-10 * s.max(initial=0.0)]
    return Ground(problem=problem, fitted=fitted, weights=weights, rows=rows, basis=basis)


def _shift(ground: Ground, hypothesis: Hypothesis, numbers: Numbers) -> Array:
    """By how much the rows change where a hypothesis acts, shorter by the priors that it replaces."""
    model = with_part(ground.fitted.model, hypothesis, numbers)
    unknowns = np.array([*(model.off[k] for k in model.free), *(x for p in model.parts for x in p.numbers)])
    rows = weighted_rows(ground.problem, model, ground.weights, ground.problem.fit, unknowns)
    data = ground.rows.size - len(ground.fitted.model.free)
    shift = np.zeros(ground.rows.size)
    shift[:data] = rows[:data] - ground.rows[:data]
    return shift


def _at_file(model: Model) -> Model:
    """Return a model with its base values as the file has them."""
    return replace(model, off=(0.0,) * len(model.off))


def is_linear(hypothesis: Hypothesis) -> bool:
    """Whether a straight fit finds its sizes."""
    return any(number.linear for number in hypothesis.numbers)


def seed(ground: Ground, hypothesis: Hypothesis) -> list[tuple[float, Numbers]]:
    """Return numbers to start from, best first, with the squares that they promise to explain.

    Where a straight fit does not find the size, each start is tried with the base values of the file: what
    these were bent to without the effect may hide it.
    """
    linear = [k for k, number in enumerate(hypothesis.numbers) if number.linear]
    before = ground.beyond(ground.rows)
    if not linear:
        ground = replace(ground, fitted=replace(ground.fitted, model=_at_file(ground.fitted.model)))
    found: list[tuple[float, Numbers]] = []
    for start in hypothesis.starts(ground.problem, ground.fitted.left):
        numbers = list(start)
        if linear:
            after, numbers = _scaled(ground, hypothesis, numbers, linear, before)
        else:
            after = before + ground.beyond(_shift(ground, hypothesis, tuple(numbers)))
        found.append((float(before @ before - after @ after), tuple(numbers)))
    return sorted(found, key=lambda one: -one[0])


def _scaled(
    ground: Ground, hypothesis: Hypothesis, numbers: list[float], linear: Sequence[int], before: Array
) -> tuple[Array, list[float]]:
    """Give the linear numbers the sizes of a straight fit."""
    columns = []
    for k in linear:
        alone = [0.0 if j in linear and j != k else x for j, x in enumerate(numbers)]
        columns.append(ground.beyond(_shift(ground, hypothesis, tuple(alone))))
    matrix = np.stack(columns, axis=1)
    factors = np.linalg.lstsq(matrix, -before, rcond=1e-10)[0]
    for k, factor in zip(linear, factors, strict=True):
        number = hypothesis.numbers[k]
        size = float(np.clip(factor * numbers[k], number.low, number.high))
        numbers[k] = size if size else number.scale
    return before + matrix @ factors, numbers


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
        if found and (found[0][0] > 0.0 or (not is_linear(hypothesis) and found[0][0] > -squares)):
            seeds.append((found[0][0], hypothesis, found))
    seeds.sort(key=lambda one: -one[0])
    most = seeds[0][0] if seeds else 0.0
    close = [
        (hypothesis, found)
        for place, (promise, hypothesis, found) in enumerate(seeds)
        if place < CLOSEST or promise > NEARLY * most or not is_linear(hypothesis)
    ]
    tried = _race(base, [one for one in close if not one[0].within])
    # What contains another is only worth its time where the other leaves something.
    if not any(not has_structure(problem, fitted) for _, fitted in tried):
        tried += _race(base, [one for one in close if one[0].within])
    return tried


def _race(
    base: Ground, close: Sequence[tuple[Hypothesis, Sequence[tuple[float, Numbers]]]]
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


def _look(base: Ground, hypothesis: Hypothesis, seeds: Sequence[tuple[float, Numbers]]) -> Fitted:
    """Fit one hypothesis for a few steps from its best starts."""
    problem, ground = base.problem, base.fitted
    model = ground.model if is_linear(hypothesis) else _at_file(ground.model)
    starts = seeds[:1] if hypothesis.within else seeds[:2]
    fits = []
    for _, numbers in starts:
        more = with_part(model, hypothesis, numbers)
        fits.append(look_at(problem, more, base.weights, _known_slopes(ground, more), FIRST_LOOK))
    return max(fits, key=lambda one: nats(problem, one.left, problem.fit))


def _known_slopes(ground: Fitted, more: Model) -> dict[int, Array]:
    """Slopes of a fitted model by the unknowns of one that has a part more."""
    if not ground.jacobian.shape[0]:
        return {}
    was, now = ground.model.free, more.free
    gone = len(was) - len(now)
    known = {}
    for column, prior in enumerate(was):
        if prior in now:
            slope = ground.jacobian[:, column]
            # The rows of the priors come last, one each: those that are replaced have none any more.
            rows = [slope.size - len(was) + k for k, one in enumerate(was) if one not in now]
            known[now.index(prior)] = np.delete(slope, rows) if gone else slope
    for column in range(len(was), ground.unknowns.size):
        rows = [ground.jacobian.shape[0] - len(was) + k for k, one in enumerate(was) if one not in now]
        known[column - gone] = np.delete(ground.jacobian[:, column], rows)
    return known


def _joins(model: Model, hypothesis: Hypothesis) -> bool:
    """Whether a hypothesis means something beside the parts of a model."""
    for part in model.parts:
        there = part.hypothesis
        if there.label == hypothesis.label or there.name in hypothesis.excludes:
            return False
        if hypothesis.name in there.excludes:
            return False
    return True


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


def has_structure(problem: Problem, fitted: Fitted) -> bool:
    """Whether what a model leaves of any channel is more than noise."""
    return any(
        _stands_out(fitted.left[one.channel], problem.counted & one.ok, one.noise) for one in problem.observed
    )


def _stands_out(values: Array, use: BoolArray, noise: float) -> bool:
    structured, size = is_structured(values, use, noise)
    return structured and size > OUT


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
    for one in problem.observed:
        here = problem.held & one.ok
        was, now = (mean_square(fit.left[one.channel], here) for fit in (before, after))
        excess = was - one.noise**2
        if was - now > SHARE * excess > 0.0 and np.sqrt(now) < (1.0 - VISIBLE) * np.sqrt(was):
            return True
    return False


def choose(problem: Problem, stage: Callable[[str], None]) -> Choice:
    """Find what is missing from one axis."""
    problem = sided(problem)
    base = _base(problem)
    found = _choose_from(problem, base, stage)
    if base.model.origin_free or at_floor(found.problem, found.fitted):
        return found
    # The origin was held because a load would explain its shift: that was wrong if only a free one fits.
    other = _choose_from(problem, fit_model(problem, base_model(problem), problem.fit), stage)
    return other if at_floor(other.problem, other.fitted) else found


def _choose_from(problem: Problem, base: Fitted, stage: Callable[[str], None]) -> Choice:
    """Add one effect after the other to the file's values, as long as each earns its place."""
    name = problem.axis.name
    problem = with_noise(problem, base)
    search = Search(problem)
    stages, scores = [base], [0.0]
    while len(stages) <= MOST and has_structure(problem, stages[-1]):
        stage(f"axis {name}: looking for {'a first' if len(stages) == 1 else 'another'} effect")
        worthy = [
            one
            for one in search.ranked(stages[-1])
            if one.score > EARNS
            and explains(problem, stages[-1], one.fitted)
            and not _refines(problem, stages[-1].model, one)
        ]
        if not worthy:
            break
        best = _simplest(problem, worthy)
        stages, scores = _settle(problem, [*stages, best.fitted], [*scores, best.score])
    stage(f"axis {name}: comparing names")
    stages, scores, standings = _exchange(search, stages, scores)
    return Choice(problem=problem, stages=tuple(stages), scores=tuple(scores), standings=standings)


def _margin(problem: Problem, fitted: Fitted, score: float) -> float:
    """Nats within which others are as good: more where the model leaves more than noise."""
    return EQUAL if at_floor(problem, fitted) else max(EQUAL, BLUR * score)


def _refines(problem: Problem, model: Model, one: Scored) -> bool:
    """Whether a name would refine one that is there, in a model that leaves more than noise anyway."""
    there = {part.hypothesis.name for part in model.parts}
    return bool(there & set(one.hypothesis.within)) and not at_floor(problem, one.fitted)


def _simplest(problem: Problem, worthy: Sequence[Scored]) -> Scored:
    """Return the best, or in its stead a special case of it that is as good."""
    best = worthy[0]
    margin = EQUAL if at_floor(problem, best.fitted) else max(EQUAL, LOYAL * best.score)
    special = (one for one in worthy if one.hypothesis.name in best.hypothesis.within)
    return next((one for one in special if one.score > best.score - margin), best)


def _base(problem: Problem) -> Fitted:
    """Fit the file's values within their priors, and say whether the origin of the readings is the file's.

    A load shifts the positions and the effort, an origin the positions alone: if a load explains the shift as
    well, or there is none, the origin is held from then on.
    """
    model = base_model(problem)
    free = fit_model(problem, model, problem.fit)
    load = next((one for one in hypotheses(problem) if one.name == "load_offset"), None)
    if load is None or not problem.has_effort:
        return free
    held = replace(free.model, origin_free=False)
    start = with_part(held, load, (0.0,))
    loaded = fit_model(problem, start, problem.fit)
    if gain_over(problem, free, loaded) < -EQUAL * worth_of(problem, free):
        return free
    return fit_model(problem, held, problem.fit)


def _settle(problem: Problem, stages: list[Fitted], scores: list[float]) -> tuple[list[Fitted], list[float]]:
    """Take out what is no longer needed."""
    last = stages[-1]
    for number in range(len(last.model.parts) - 1):
        less = fit_model(problem, without_part(last.model, number), problem.fit)
        needed = explains(problem, less, last) or not at_floor(problem, last)
        if score_over(problem, less, last) <= 0.0 or not needed:
            return _restage(problem, less, stages[0])
    return stages, scores


def _restage(problem: Problem, last: Fitted, base: Fitted) -> tuple[list[Fitted], list[float]]:
    """Make the stages up to a model: its parts one after the other, in their order."""
    stages, scores = [base], [0.0]
    for count in range(1, len(last.model.parts) + 1):
        model = replace(last.model, parts=last.model.parts[:count])
        fitted = last if count == len(last.model.parts) else fit_model(problem, model, problem.fit)
        scores.append(score_over(problem, stages[-1], fitted))
        stages.append(fitted)
    return stages, scores


def _exchange(
    search: Search, stages: list[Fitted], scores: list[float]
) -> tuple[list[Fitted], list[float], tuple[Standing, ...]]:
    """Try every other name in the place of each part, and keep what is better; list what is as good."""
    problem = search.problem
    standings: list[Standing] = []
    for _ in range(3):
        last = stages[-1]
        standings = [_stand(search, stages, number) for number in range(len(last.model.parts))]
        better = next((one.better for one in standings if one.better is not None), None)
        if better is None:
            break
        stages, scores = _restage(problem, better, stages[0])
        stages, scores = _settle(problem, stages, scores)
    return stages, scores, tuple(standings)


def _stand(search: Search, stages: list[Fitted], number: int) -> Standing:
    """Hold one part of the last model against every other name."""
    problem, last = search.problem, stages[-1]
    part = last.model.parts[number]
    alone = len(last.model.parts) == 1
    less = stages[0] if alone else fit_model(problem, without_part(last.model, number), problem.fit)
    others = [
        one
        for one in search.tried(less, every=alone)
        if explains(problem, less, one[1]) and not (alone and one[0].label == part.hypothesis.label)
    ]
    ranking = rank(problem, less, [(part.hypothesis, last), *others])
    mine = next(one.score for one in ranking if one.fitted is last)
    best = _simplest(problem, ranking)
    equal = _equals(problem, last, part, mine, ranking)
    scores = [
        one.score
        for one in ranking
        if one.hypothesis.label != part.hypothesis.label and part.hypothesis.name not in one.hypothesis.within
    ]
    weights = [np.exp(min(score - mine, 50.0)) for score in (mine, 0.0, *scores)]
    return Standing(
        rivals=equal, confidence=float(1.0 / np.sum(weights)),
        better=best.fitted if best.score > mine + max(PRICE, 0.5 * _margin(problem, last, mine)) else None,
    )  # fmt: skip


def _equals(
    problem: Problem, last: Fitted, part: Part, mine: float, ranking: Sequence[Scored]
) -> tuple[str, ...]:
    """Names whose score is that of a part, but for those that merely contain it."""
    name = part.hypothesis.name
    margin = _margin(problem, last, mine)
    found = (
        one.hypothesis.name
        for one in ranking
        if one.score > mine - margin and one.hypothesis.name != name and name not in one.hypothesis.within
    )
    return tuple(dict.fromkeys(found))


def at_floor(problem: Problem, fitted: Fitted) -> bool:
    """Whether a model leaves no more than noise of the positions, held out."""
    return all(
        mean_square(fitted.left[one.channel], problem.held & one.ok) < (FLOOR * one.noise) ** 2
        for one in problem.observed
        if one.channel != "force"
    )


def rows_of(problem: Problem, fitted: Fitted) -> partial[Array]:
    """Weighted rows of a fitted model as a function of its unknowns."""
    weights = weights_of(problem, fitted.left, problem.counted)
    return partial(weighted_rows, problem, fitted.model, weights, problem.counted)
