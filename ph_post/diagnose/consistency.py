"""The test that a name stands by where its model leaves more than noise: its size is the same in every regime.

A name that only resembles what is missing fits one size to slow motion and another to quick, one to the first half
and another to the second. Each effect's own contribution, as far as base values and other names cannot make it, is
scaled regime by regime to what is left: a factor far from 1 speaks against the name, however much it explains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from ph_post.diagnose.fit import FittedModel, residuals_of
from ph_post.diagnose.search import without_part
from ph_post.identify.free_run import AxisProblem, weighted_residuals, weights_of
from ph_post.types import Array, BoolArray, IntArray

MOST: Final = 0.2
"""Part by which the size of an effect may differ in a regime."""

LEAST: Final = 0.08
"""Part of what an effect does that a regime must hold to count."""

TIMES: Final = 6
"""Parts of a log's time."""

MOVES: Final = 1e-3
"""Part of the largest speed below which an axis stands."""


class Disagreement(NamedTuple):
    """The regime in which an effect's size differs most, in words, and its size there over that everywhere."""

    regime: str
    factor: float


class RegimeSizes(NamedTuple):
    """Sizes of an effect in regimes of one kind, those that hold enough of it.

    `own` is how much of it each holds, `more` by which part it asks for more.
    """

    names: tuple[str, ...]
    own: Array
    more: Array


def sizes_by_regime(problem: AxisProblem, adds: Array, left: Array, uses: Sequence[BoolArray]) -> Iterator[RegimeSizes]:
    """Scale what an effect adds, regime by regime, to what is left; both (rows,), of the samples in use by channel."""
    total = float(adds @ adds)
    if total <= 0.0:
        return
    for names, kinds in regimes(problem):
        kind = np.concatenate([kinds[use] for use in uses]) + 1
        own, fits = (
            np.asarray(np.bincount(kind, weights=adds * one, minlength=len(names) + 1)[1:], dtype=np.float64)
            for one in (adds, left)
        )
        counts = np.flatnonzero(own > LEAST * total)
        if counts.size:
            more = np.divide(fits, own, out=np.zeros_like(own), where=own > 0.0)
            yield RegimeSizes(tuple(names[k] for k in counts), own[counts], more[counts])


def spread_of(sizes: Iterator[RegimeSizes]) -> float:
    """Return by which part a size differs from regime to regime, root mean square, by the way that shows most."""
    spreads = (np.average((more - np.average(more, weights=own)) ** 2, weights=own) for _, own, more in sizes)
    return float(np.sqrt(max(spreads, default=0.0)))


def sizes_of_part(problem: AxisProblem, fitted: FittedModel, number: int) -> Iterator[RegimeSizes]:
    """Scale one part of a model, as far as base values and the other parts cannot make it, to what is left."""
    use = problem.counted
    weights = weights_of(problem, fitted.left, use)
    rows = weighted_residuals(problem, fitted.left, weights, use)
    without = residuals_of(problem, without_part(fitted.model, number, restored=True))
    adds = weighted_residuals(problem, without, weights, use) - rows
    basis = _others(fitted, number, rows.size)
    adds = adds - basis @ (basis.T @ adds)
    return sizes_by_regime(problem, adds, rows, [use & one.ok for one in problem.observed])


def disagreement(problem: AxisProblem, fitted: FittedModel, number: int) -> Disagreement:
    """Return the regime that agrees least with one part of a model on its size."""
    worst = Disagreement("", 1.0)
    for names, _, more in sizes_of_part(problem, fitted, number):
        at = int(np.argmax(np.abs(more)))
        if abs(more[at]) > abs(worst.factor - 1.0):
            worst = Disagreement(names[at], 1.0 + float(more[at]))
    return worst


def sides_factor(problem: AxisProblem, fitted: FittedModel, number: int, gap: Array | None = None) -> float | None:
    """Return how much the log shows of a part between motor and table, over what the model has of it there.

    `gap` is what a backlash that is not in the model adds to motor less table, shape (n,) [m].

    The difference of both readings knows no servo: a spring or an error of a reading that only makes up for a wrong
    servo is not in it. None where not both sides were read, or the part does not part them.
    """
    if problem.side != "table" or not (problem.has("act") and problem.has("motor")):
        return None
    table, motor = problem.channel("act"), problem.channel("motor")
    use = problem.counted & table.ok & motor.ok
    without = residuals_of(problem, without_part(fitted.model, number, restored=True))
    there, gone = ((left["act"] - left["motor"])[use] for left in (fitted.left, without))
    adds = gone - there
    adds = adds - np.mean(adds)
    if gap is not None:
        gone = gone + gap[use]
    square = float(adds @ adds)
    if square < np.hypot(table.noise, motor.noise) ** 2 * adds.size:
        return None
    return float(adds @ gone) / square


def _others(fitted: FittedModel, number: int, rows: int) -> Array:
    """Return a basis (rows, k) of what base values and the other parts can make."""
    counts = [len(part.numbers) for part in fitted.model.parts]
    first = len(fitted.model.free) + sum(counts[:number])
    columns = np.delete(fitted.jacobian[:rows], np.s_[first : first + counts[number]], axis=1)
    if not columns.size:
        return np.zeros((rows, 0))
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u[:, s > 1e-10 * s.max(initial=0.0)])


def regimes(problem: AxisProblem) -> Iterator[tuple[tuple[str, ...], IntArray]]:
    """Yield ways to sort the samples (n,): the names of the regimes, and the number of each sample's, or -1."""
    speed = np.abs(problem.speed)
    moving = problem.counted & (speed > MOVES * np.max(speed, initial=0.0))
    if not moving.any():
        return
    push = np.abs(np.gradient(problem.speed, problem.period))
    for names, values in (
        (("in slow motion", "at medium speed", "in quick motion"), speed),
        (("at constant speed", "at medium acceleration", "where it speeds up or brakes most"), push),
        (("at the low end of the travel", "in the middle of the travel", "at its high end"), problem.command),
        (tuple(f"in part {k + 1} of {TIMES} of the time" for k in range(TIMES)), problem.t),
    ):
        limits = np.quantile(values[moving], np.arange(1, len(names)) / len(names))
        yield names, np.where(moving, np.searchsorted(limits, values), -1)
    yield ("moving to minus", "moving to plus"), np.where(moving, (problem.speed > 0.0).astype(np.int64), -1)
