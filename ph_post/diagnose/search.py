"""Search for the hypothesis that best extends a fitted model: starting models, a race of fits, and scores.

Most hypotheses drop out after a few steps. A fit is scored by its gain on held-out samples.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.fit import (
    REACH,
    FittedModel,
    Model,
    ModelPart,
    fit_briefly,
    fit_model,
    log_likelihood,
    pack,
    plant_at,
    residuals_of,
    weighted_rows,
)
from ph_post.diagnose.hypotheses import hypotheses
from ph_post.diagnose.hypotheses.base import Hypothesis, Numbers
from ph_post.diagnose.residual_features import is_structured
from ph_post.identify.free_run import AxisProblem, correlation_inflation, mean_square, weights_of
from ph_post.types import Array, BoolArray
from ph_post.types.diagnosis import Channel

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


class ScoredHypothesis(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A hypothesis added to a model, fitted, and its score over that model [nats]."""

    hypothesis: Hypothesis
    fitted: FittedModel
    score: float


def gain_over(problem: AxisProblem, ground: FittedModel, fitted: FittedModel) -> float:
    """Return what a fit gains over another on the samples held out [nats], as if they were independent."""
    return log_likelihood(problem, fitted.left, problem.held) - log_likelihood(problem, ground.left, problem.held)


def score_over(problem: AxisProblem, ground: FittedModel, fitted: FittedModel, worth: float | None = None) -> float:
    """Return the score of a fit over one with fewer parts [nats]; `worth` where several are compared."""
    more = len(fitted.unknowns) - len(ground.unknowns)
    worth = correlation_inflation(problem, fitted.left, problem.held) if worth is None else worth
    return gain_over(problem, ground, fitted) / worth - PRICE * max(more, 1)


def rank(
    problem: AxisProblem, ground: FittedModel, fits: Sequence[tuple[Hypothesis, FittedModel]]
) -> list[ScoredHypothesis]:
    """Score fits of one number of samples, that of the fit that gains most, best first."""
    if not fits:
        return []
    _, most = max(fits, key=lambda one: gain_over(problem, ground, one[1]))
    worth = correlation_inflation(problem, most.left, problem.held)
    scored = [
        ScoredHypothesis(hypothesis=hypothesis, fitted=fitted, score=score_over(problem, ground, fitted, worth))
        for hypothesis, fitted in fits
    ]
    return sorted(scored, key=lambda one: -one.score)


def has_structure(problem: AxisProblem, fitted: FittedModel, size: float = OUT) -> bool:
    """Return whether a model leaves more than noise of any channel, by at least `size` of the noise."""
    return any(
        _stands_out(fitted.left[one.channel], problem.counted & one.ok, one.noise, size) for one in problem.observed
    )


def _stands_out(values: Array, use: BoolArray, noise: float, least: float) -> bool:
    structured, size = is_structured(values, use, noise)
    return structured and size > least


def with_noise(problem: AxisProblem, fitted: FittedModel) -> AxisProblem:
    """Lower the noise of a channel to what a model leaves of it: nothing leaves less than the noise."""
    observed = tuple(
        one._replace(
            noise=min(one.noise, float(np.sqrt(mean_square(fitted.left[one.channel], problem.counted & one.ok))))
        )
        for one in problem.observed
    )
    return replace(problem, observed=observed)


def explains(problem: AxisProblem, before: FittedModel, after: FittedModel) -> bool:
    """Return whether a fit lowers the held-out residual of some channel by enough to be worth a name."""
    return shows(problem, before, after, MOST_SHARE if before.model.parts and not at_floor(problem, after) else SHARE)


def shows(problem: AxisProblem, before: FittedModel, after: FittedModel, share: float = SHARE) -> bool:
    """Return whether a fit lowers the held-out residual of some channel visibly, and by that share of its excess."""
    visible = MORE_VISIBLE if before.model.parts else VISIBLE
    for one in problem.observed:
        here = problem.held & one.ok
        was, now = (mean_square(fit.left[one.channel], here) for fit in (before, after))
        excess = was - one.noise**2
        if was - now > share * excess > 0.0 and np.sqrt(now) < (1.0 - visible) * np.sqrt(was):
            return True
    return False


def does_enough(problem: AxisProblem, fitted: FittedModel) -> bool:
    """Return whether the last part of a model changes a reading by more than noise.

    Base values stay as they are, and those that the part replaced are the file's.
    """
    last = len(fitted.model.parts) - 1
    without = residuals_of(problem, without_part(fitted.model, last, restored=True))
    return any(
        mean_square(fitted.left[one.channel] - without[one.channel], problem.counted & one.ok) > (OWN * one.noise) ** 2
        for one in problem.observed
    )


def at_floor(problem: AxisProblem, fitted: FittedModel) -> bool:
    """Return whether a model leaves no more than noise of the held-out positions."""
    return all(
        mean_square(fitted.left[one.channel], problem.held & one.ok) < (FLOOR * one.noise) ** 2
        for one in problem.positions
    )


BENT: Final = 2.0
"""Standard errors from which a base value is taken to be bent by what is missing."""

AT_END: Final = 0.999
"""Share of its reach at which a base value has come to the end of it."""


def with_part(model: Model, hypothesis: Hypothesis, numbers: Numbers) -> Model:
    """Return a model with a part more."""
    return replace(model, parts=(*model.parts, ModelPart(hypothesis=hypothesis, numbers=numbers)))


def without_part(model: Model, number: int, *, restored: bool = False) -> Model:
    """Return a model with a part less; `restored` gives base values that it replaced the file's numbers again."""
    gone = model.parts[number].hypothesis.replaces if restored else ()
    off = tuple(0.0 if prior.field in gone else x for prior, x in zip(model.priors, model.off, strict=True))
    return replace(model, parts=model.parts[:number] + model.parts[number + 1 :], off=off)


class StartingModel(msgspec.Struct, frozen=True, kw_only=True):
    """A model to start a fit from, and the squares that it promises to explain."""

    promise: float
    model: Model


class Linearization(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A fitted model as something to add to: weighted rows, and a basis (rows, k) of what it can absorb."""

    problem: AxisProblem
    fitted: FittedModel
    weights: Mapping[Channel, float]
    rows: Array
    basis: Array

    def beyond(self, rows: Array) -> Array:
        """Return what of the rows the model cannot absorb."""
        return np.asarray(rows - self.basis @ (self.basis.T @ rows))


def linearize(problem: AxisProblem, fitted: FittedModel) -> Linearization:
    """Make a ground of a fitted model."""
    weights = weights_of(problem, fitted.left, problem.fit)
    rows = weighted_rows(problem, fitted.model, weights, problem.fit, fitted.unknowns)
    basis = np.zeros((rows.size, 0))
    if fitted.jacobian.shape[0] == rows.size and fitted.unknowns.size:
        # A base value at the end of its reach has nothing left to give.
        gives = np.ones(fitted.unknowns.size, dtype=bool)
        gives[: len(fitted.model.free)] = np.abs(fitted.unknowns[: len(fitted.model.free)]) < AT_END * REACH
        u, s, _ = np.linalg.svd(fitted.jacobian[:, gives], full_matrices=False)
        basis = u[:, s > 1e-10 * s.max(initial=0.0)]
    return Linearization(problem=problem, fitted=fitted, weights=weights, rows=rows, basis=basis)


def _rows(ground: Linearization, model: Model) -> Array:
    """Return the rows of a model on the samples; those of the priors stay as the ground has them."""
    rows = weighted_rows(ground.problem, model, ground.weights, ground.problem.fit, pack(model))
    data = ground.rows.size - len(ground.fitted.model.free)
    return np.concatenate([rows[:data], ground.rows[data:]])


def at_file(model: Model) -> Model:
    """Return a model with its base values as the file has them."""
    return replace(model, off=(0.0,) * len(model.off))


def is_linear(hypothesis: Hypothesis) -> bool:
    """Return whether a straight fit finds its sizes."""
    return any(number.linear for number in hypothesis.numbers)


def starting_models(ground: Linearization, hypothesis: Hypothesis) -> list[StartingModel]:
    """Return models to start from, one or two a start of the hypothesis, best first.

    Where a straight fit does not find the size, each start is tried with the base values as they were fitted
    and as the file has them: what these were bent to without the effect may hide it.
    """
    linear = [k for k, number in enumerate(hypothesis.numbers) if number.linear]
    before = ground.beyond(ground.rows)
    fitted = ground.fitted.model
    bases = [(fitted, ground.rows)]
    if linear and max(map(abs, fitted.off), default=0.0) > BENT:
        bases.append((at_file(fitted), _rows(ground, at_file(fitted))))
    starts = list(hypothesis.starts(ground.problem, ground.fitted.left))
    if any(
        prior.field in hypothesis.replaces and abs(x) > BENT for prior, x in zip(fitted.priors, fitted.off, strict=True)
    ):
        starts += hypothesis.taken(ground.problem.plant, plant_at(ground.problem, fitted))
    starts = list(dict.fromkeys(starts))
    if linear:
        made = [
            _scaled(ground, with_part(base, hypothesis, start), linear, rows)
            for start in starts
            for base, rows in bases
        ]
    else:
        made = _better_based(ground, [with_part(fitted, hypothesis, start) for start in starts])
    squares = float(before @ before)
    found = [StartingModel(promise=squares - float(left @ left), model=model) for left, model in made]
    return sorted(found, key=lambda one: -one.promise)


def _better_based(ground: Linearization, models: Sequence[Model]) -> list[tuple[Array, Model]]:
    """Start from the fitted base values or the file's, whichever leave less that the model cannot absorb.

    Where these are nearly the same, the file's are tried of the starts alone that leave least: two are gone on from.
    """

    def left_by(model: Model) -> tuple[Array, Model]:
        return ground.beyond(_rows(ground, model)), model

    def squares(one: tuple[Array, Model]) -> float:
        return float(one[0] @ one[0])

    found = sorted(map(left_by, models), key=squares)
    near = max(map(abs, ground.fitted.model.off), default=0.0) <= BENT
    tried = found[: FEW_STARTS if near else None]
    return [min(one, left_by(at_file(one[1])), key=squares) for one in tried] + found[len(tried) :]


def _scaled(ground: Linearization, model: Model, linear: Sequence[int], here: Array) -> tuple[Array, Model]:
    """Give the linear numbers of a model's last part the sizes of a straight fit; `here` are rows without."""
    part = model.parts[-1]
    columns = []
    for k in linear:
        alone = tuple(0.0 if j in linear and j != k else x for j, x in enumerate(part.numbers))
        columns.append(ground.beyond(_rows(ground, _with_numbers(model, alone)) - here))
    matrix, before = np.stack(columns, axis=1), ground.beyond(here)
    factors = np.linalg.lstsq(matrix, -before, rcond=1e-10)[0]
    numbers = list(part.numbers)
    for k, factor in zip(linear, factors, strict=True):
        number = part.hypothesis.numbers[k]
        size = float(np.clip(factor * numbers[k], number.low, number.high))
        numbers[k] = size if size else number.scale
    return before + matrix @ factors, _with_numbers(model, tuple(numbers))


def _with_numbers(model: Model, numbers: Numbers) -> Model:
    """Return a model with other numbers of its last part."""
    return replace(model, parts=(*model.parts[:-1], replace(model.parts[-1], numbers=numbers)))


FEW_STARTS: Final = 6
"""Starts that are tried with the file's base values, too, where the fitted ones are nearly these."""

ABREAST: Final = 0.6
"""Part of the best one's gain from which a hypothesis is fitted to the end."""

FIRST_LOOK: Final = 5
"""Steps of a fit from each start; only the better one goes on."""

CLOSEST: Final = 6
"""Hypotheses that are fitted in a round, besides those that promise nearly as much as the best."""

NEARLY: Final = 0.3
"""Part of the squares that the best one promises to explain from which another promises nearly as much."""


class HypothesisSearch:
    """The hypotheses that were tried on top of fitted models of one axis, each once.

    `plausible` are labels of those that come near the best.
    """

    def __init__(self, problem: AxisProblem, plausible: set[str] | None = None) -> None:
        self.problem = problem
        self.known: dict[FittedModel, list[tuple[Hypothesis, FittedModel]]] = {}
        self.plausible: set[str] = set() if plausible is None else plausible
        self._less: dict[tuple[FittedModel, int], FittedModel] = {}

    def without(self, fitted: FittedModel, number: int) -> FittedModel:
        """Fit a model with a part less, once."""
        key = fitted, number
        if key not in self._less:
            self._less[key] = fit_model(self.problem, without_part(fitted.model, number), self.problem.fit)
        return self._less[key]

    def tried(self, ground: FittedModel, every: bool = True) -> list[tuple[Hypothesis, FittedModel]]:
        """Fit every hypothesis that promises something on top of a model, or only the plausible ones."""
        if ground not in self.known:
            self.known[ground] = _try_all(self.problem, ground, None if every else self.plausible)
        return self.known[ground]

    def ranked(self, ground: FittedModel) -> list[ScoredHypothesis]:
        """Return those, best first; what comes near the best is plausible from then on."""
        found = rank(self.problem, ground, self.tried(ground))
        most = found[0].score if found else 0.0
        self.plausible |= {one.hypothesis.label for one in found if one.score > NEARLY * most}
        return found


def _try_all(problem: AxisProblem, ground: FittedModel, only: set[str] | None) -> list[tuple[Hypothesis, FittedModel]]:
    base = linearize(problem, ground)
    squares = float(base.rows @ base.rows)
    seeds = []
    for hypothesis in _joining(problem, ground.model):
        if only is not None and hypothesis.label not in only:
            continue
        found = starting_models(base, hypothesis)
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
    tried += _race(base, [one for one in close if one[0].within and enough.isdisjoint(one[0].within)])
    return [one for one in tried if _means_its_name(problem, one[1])]


def _means_its_name(problem: AxisProblem, fitted: FittedModel) -> bool:
    """Return whether what the name of the last part says is worth its price on held-out samples."""
    part = fitted.model.parts[-1]
    if part.hypothesis.bare is None:
        return True
    bare = residuals_of(problem, _with_numbers(fitted.model, part.hypothesis.bare(part.numbers)))
    gain = log_likelihood(problem, fitted.left, problem.held) - log_likelihood(problem, bare, problem.held)
    return gain > PRICE * correlation_inflation(problem, fitted.left, problem.held)


def _race(
    base: Linearization, close: Sequence[tuple[Hypothesis, Sequence[StartingModel]]]
) -> list[tuple[Hypothesis, FittedModel]]:
    """Look at every hypothesis, and fit those to the end that gain nearly as much as the best."""
    problem = base.problem
    looked = [(hypothesis, _look(base, hypothesis, seeds)) for hypothesis, seeds in close]
    start = log_likelihood(problem, base.fitted.left, problem.fit)
    gains = [log_likelihood(problem, fitted.left, problem.fit) - start for _, fitted in looked]
    most = max(gains, default=0.0)
    return [
        (hypothesis, fit_model(problem, fitted.model, problem.fit) if gain > ABREAST * most else fitted)
        for (hypothesis, fitted), gain in zip(looked, gains, strict=True)
    ]


def _look(base: Linearization, hypothesis: Hypothesis, seeds: Sequence[StartingModel]) -> FittedModel:
    """Fit one hypothesis for a few steps from its best starts."""
    problem, ground = base.problem, base.fitted
    fits = [
        fit_briefly(problem, one.model, base.weights, _known_slopes(ground, one.model), FIRST_LOOK)
        for one in (seeds[:1] if hypothesis.within else seeds[:2])
    ]
    return max(fits, key=lambda one: log_likelihood(problem, one.left, problem.fit))


def _known_slopes(ground: FittedModel, more: Model) -> dict[int, Array]:
    """Slopes of a fitted model by the unknowns of one that has a part more."""
    if not ground.jacobian.shape[0]:
        return {}
    was = ground.model.free
    gone = [k for k, prior in enumerate(was) if prior not in more.free]
    # The rows of the priors come last, one each: those that are replaced have none any more, nor a column.
    data = ground.jacobian.shape[0] - len(was)
    slopes = np.delete(np.delete(ground.jacobian, gone, axis=1), [data + k for k in gone], axis=0)
    return dict(enumerate(slopes.T))


def _joining(problem: AxisProblem, model: Model) -> list[Hypothesis]:
    """Return the hypotheses that mean something beside the parts of a model."""
    found = [one for one in hypotheses(problem) if _joins(model, one)]
    own = {one.name for one in found if one.beside}
    return [one for one in found if one.beside or one.name not in own]


def _joins(model: Model, hypothesis: Hypothesis) -> bool:
    """Return whether a hypothesis means something beside each of the parts of a model."""
    if hypothesis.beside and all(part.hypothesis.name not in hypothesis.beside for part in model.parts):
        return False
    for part in model.parts:
        there = part.hypothesis
        if there.label == hypothesis.label or there.name in hypothesis.excludes:
            return False
        if hypothesis.name in there.excludes:
            return False
    return True
