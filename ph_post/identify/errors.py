"""Standard errors of a fit whose residuals go together: the covariance that blocks of time show.

Residuals of a log are no independent samples: what the model lacks goes on for a while, and says the same
thing many times. Blocks of time that are longer than that are independent: how far a fit moves as each is left out
gives the covariance of its numbers, for each number as much as its own sensitivity goes with the residuals [1]_ [2]_.

References
----------
.. [1] H. R. Künsch: The jackknife and the bootstrap for general stationary observations, Annals of Statistics 17
   (1989).
.. [2] R. M. Bell and D. F. McCaffrey: Bias reduction in standard errors for linear regression with multi-stage
   samples, Survey Methodology 28 (2002).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from ph_post.identify.free_run import (
    AxisProblem,
    ObservedChannel,
    correlation_inflation,
    mean_square,
    weighted_residuals,
    weights_of,
)
from ph_post.types import Array, BoolArray, IntArray
from ph_post.types.diagnosis import Channel

BLOCKS: Final = 32
"""Blocks that a log is cut into: long beside what residuals remember, and many enough to show their spread."""


COMPLETE: Final = 1.5
"""Times the noise up to which what is left of a position is noise."""

RESTS: Final = 1e-9
"""Commanded speed up to which an axis is to rest [m/s]."""


def blocks_of(problem: AxisProblem, use: BoolArray) -> IntArray:
    """Return the number of the block of every weighted residual (rows,), one channel after the other."""
    number = np.cumsum(use) - 1
    block = number * BLOCKS // max(int(number[-1]) + 1, 1)
    return np.concatenate([block[use & one.ok] for one in problem.observed])


def samples_as_one(problem: AxisProblem, left: Mapping[Channel, Array], use: BoolArray) -> float:
    """Return the least number of samples that count as one: 1 where a model leaves noise of the positions.

    What a model lacks bends its numbers in all blocks alike. No spread shows that; how long the residuals go
    together is a measure of it.
    """
    noise = all(mean_square(left[one.channel], use & one.ok) < (COMPLETE * one.noise) ** 2 for one in problem.positions)
    return 1.0 if noise else correlation_inflation(problem, left, use)


class Rounding(NamedTuple):
    """What rounds the rows of a fit: `size` (rows,), root mean square, and the `draw` (rows,) that it was one of."""

    size: Array
    draw: IntArray


def rounding_of(channel: ObservedChannel, speed: Array, use: BoolArray) -> Rounding:
    """Return what counting does to the samples of a channel that are in use.

    While a reading stays on a count its rounding is one draw; an axis that rests where it rested before is rounded as
    it was there.

    Parameters
    ----------
    channel : ObservedChannel
    speed : Array, shape (n,)
        Commanded [m/s].
    use : BoolArray, shape (n,)
    """
    values, resting = channel.values[use], np.abs(speed[use]) < RESTS
    size = np.full(values.size, channel.step / math.sqrt(12.0))
    if not channel.step:
        return Rounding(size, np.zeros(values.size, dtype=np.int64))
    number = np.round((values - values[0]) / channel.step).astype(np.int64)
    run = np.cumsum(np.diff(number, prepend=number[:1]) != 0)
    return Rounding(size, np.where(resting, number - number.max() - 1, run))


def fit_covariance(
    problem: AxisProblem, left: Mapping[Channel, Array], jacobian: Array, prior: Array, use: BoolArray
) -> Array:
    """Return the covariance of numbers (k, k) that were fitted to the samples in use.

    Parameters
    ----------
    problem : AxisProblem
    left : mapping
        What the fit leaves of each channel (n,).
    jacobian : Array, shape (rows, k)
        Of the weighted residuals.
    prior : Array, shape (p, k)
    use : BoolArray, shape (n,)
    """
    weights, sizes, draws, past = weights_of(problem, left, use), [], [], 0
    for one in problem.observed:
        size, draw = rounding_of(one, problem.speed, use & one.ok)
        sizes.append(size * weights[one.channel])
        draws.append(draw - draw.min(initial=0) + past)
        past = int(draws[-1].max(initial=past)) + 1
    return block_covariance(
        jacobian,
        weighted_residuals(problem, left, weights, use),
        blocks_of(problem, use),
        prior,
        samples_as_one(problem, left, use),
        (Rounding(np.concatenate(sizes), np.concatenate(draws)),),
    )


def block_covariance(
    jacobian: Array,
    left: Array,
    blocks: IntArray,
    prior: Array | None = None,
    as_one: float = 1.0,
    rounded: Sequence[Rounding] = (),
) -> Array:
    """Return the covariance of fitted numbers (k, k), from residuals that go together within blocks.

    Parameters
    ----------
    jacobian : Array, shape (rows, k)
        Of the weighted residuals by the numbers.
    left : Array, shape (rows,)
        Weighted residuals, of unit size.
    blocks : IntArray, shape (rows,)
        Number of the block of each row.
    prior : Array, shape (p, k), optional
        Rows of prior knowledge, each of unit size.
    as_one : float
        See :func:`samples_as_one`.
    rounded : sequence of Rounding
        What rounds the rows, independently of each other, in units of the residuals.

    Notes
    -----
    No variance is less than that of residuals of which so many count as one, nor than that of rounding. A number
    in whose direction nothing shows has a variance of 1e18.
    """
    numbers = jacobian.shape[1]
    if numbers == 0:
        return np.zeros((0, 0))
    rows = np.zeros((0, numbers)) if prior is None else prior
    _, values, directions = np.linalg.svd(np.vstack([jacobian, rows]), full_matrices=False)
    inverse = np.divide(1.0, values, out=np.full_like(values, 1e9), where=values > 1e-9)
    # In numbers of unit variance: white is the identity.
    scale = directions.T * inverse
    found = rows @ scale
    found = found.T @ found  # what is not from the log
    parts = [jacobian[blocks == number] @ scale for number in range(int(blocks.max(initial=-1)) + 1)]
    moved = []
    for number, part in enumerate(parts):
        score = part.T @ left[blocks == number]
        # How the fit moves without this block, which held part of its own residuals down.
        rest = np.eye(numbers) - part.T @ part
        moved.append(np.linalg.lstsq(rest, score, rcond=1e-3)[0])
    count = max(len(moved), 2)
    found += np.asarray(moved).T @ np.asarray(moved) * ((count - 1) / count) if moved else 0.0
    covariance, white = scale @ found @ scale.T, scale @ scale.T
    own, least = np.diag(covariance), _least(jacobian, rows, as_one, np.diag(white))
    if rounded:
        least = np.maximum(least, sum(_variance_of(jacobian, one, white) for one in rounded))
    stretch = np.sqrt(np.maximum(own, least) / np.maximum(own, 1e-6 * least + 1e-300))
    covariance = covariance * np.outer(stretch, stretch)
    np.fill_diagonal(covariance, np.maximum(np.diag(covariance), least))
    return np.asarray(covariance)


def _variance_of(jacobian: Array, rounded: Rounding, white: Array) -> Array:
    """Return the variance of each number (k,) that rounding makes."""
    draws = np.unique(rounded.draw, return_inverse=True)[1]
    sums = np.zeros((int(draws.max(initial=-1)) + 1, jacobian.shape[1]))
    np.add.at(sums, draws, jacobian * rounded.size[:, None])
    return np.asarray(np.sum((sums @ white) ** 2, axis=0))


def _least(jacobian: Array, prior: Array, as_one: float, white: Array) -> Array:
    """Return the least variance of each number (k,)."""
    if as_one == 1.0:
        return white
    _, values, directions = np.linalg.svd(np.vstack([jacobian / np.sqrt(as_one), prior]), full_matrices=False)
    inverse = np.divide(1.0, values, out=np.full_like(values, 1e9), where=values > 1e-9)
    return np.asarray(np.sum((directions.T * inverse) ** 2, axis=1))
