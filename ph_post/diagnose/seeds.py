"""What a hypothesis promises on top of a fitted model, and the numbers to start it from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.fit import REACH, Fitted, Model, Part, pack, weighted_rows, weights_of
from ph_post.diagnose.hypotheses.base import Hypothesis, Numbers
from ph_post.diagnose.model import Problem
from ph_post.diagnose.record import Channel
from ph_post.types import Array

BENT: Final = 2.0
"""Standard errors from which a base value is taken to be bent by what is missing."""

AT_END: Final = 0.999
"""Part of its reach at which a base value has come to the end of it."""


def with_part(model: Model, hypothesis: Hypothesis, numbers: Numbers) -> Model:
    """Return a model with a part more."""
    return replace(model, parts=(*model.parts, Part(hypothesis=hypothesis, numbers=numbers)))


def without_part(model: Model, number: int) -> Model:
    """Return a model with a part less."""
    return replace(model, parts=model.parts[:number] + model.parts[number + 1 :])


class Seed(msgspec.Struct, frozen=True, kw_only=True):
    """A model to start a fit from, and the squares that it promises to explain."""

    promise: float
    model: Model


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
        # A base value at the end of its reach has nothing left to give.
        gives = np.ones(fitted.unknowns.size, dtype=bool)
        gives[: len(fitted.model.free)] = np.abs(fitted.unknowns[: len(fitted.model.free)]) < AT_END * REACH
        u, s, _ = np.linalg.svd(fitted.jacobian[:, gives], full_matrices=False)
        basis = u[:, s > 1e-10 * s.max(initial=0.0)]
    return Ground(problem=problem, fitted=fitted, weights=weights, rows=rows, basis=basis)


def _rows(ground: Ground, model: Model) -> Array:
    """Return the rows of a model on the samples; those of the priors stay as the ground has them."""
    rows = weighted_rows(ground.problem, model, ground.weights, ground.problem.fit, pack(model))
    data = ground.rows.size - len(ground.fitted.model.free)
    return np.concatenate([rows[:data], ground.rows[data:]])


def at_file(model: Model) -> Model:
    """Return a model with its base values as the file has them."""
    return replace(model, off=(0.0,) * len(model.off))


def is_linear(hypothesis: Hypothesis) -> bool:
    """Whether a straight fit finds its sizes."""
    return any(number.linear for number in hypothesis.numbers)


def seed(ground: Ground, hypothesis: Hypothesis) -> list[Seed]:
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
    found: list[Seed] = []
    for start in hypothesis.starts(ground.problem, ground.fitted.left):
        if linear:
            made = [_scaled(ground, with_part(base, hypothesis, start), linear, rows) for base, rows in bases]
        else:
            made = [_better_based(ground, hypothesis, start)]
        found += [Seed(promise=float(before @ before - left @ left), model=model) for left, model in made]
    return sorted(found, key=lambda one: -one.promise)


def _better_based(ground: Ground, hypothesis: Hypothesis, numbers: Numbers) -> tuple[Array, Model]:
    """Start from the fitted base values or the file's, whichever leave less that the model cannot absorb."""
    fitted = ground.fitted.model
    tried = [with_part(model, hypothesis, numbers) for model in (fitted, at_file(fitted))]
    left = [(ground.beyond(_rows(ground, model)), model) for model in tried]
    return min(left, key=lambda one: float(one[0] @ one[0]))


def _scaled(ground: Ground, model: Model, linear: Sequence[int], here: Array) -> tuple[Array, Model]:
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
