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

from collections.abc import Mapping
from typing import Final

import numpy as np

from ph_post.identify.free_run import AxisProblem, correlation_inflation, mean_square
from ph_post.types import Array, BoolArray, IntArray
from ph_post.types.diagnosis import Channel

BLOCKS: Final = 32
"""Blocks that a log is cut into: long beside what residuals remember, and many enough to show their spread."""


COMPLETE: Final = 1.5
"""Times the noise up to which what is left of a position is noise."""


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


def block_covariance(
    jacobian: Array, left: Array, blocks: IntArray, prior: Array | None = None, as_one: float = 1.0
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

    Notes
    -----
    No variance is less than that of residuals of which so many count as one. A number in whose direction nothing
    shows has a variance of 1e18.
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
    stretch = np.sqrt(np.maximum(own, least) / np.maximum(own, 1e-6 * least + 1e-300))
    covariance = covariance * np.outer(stretch, stretch)
    np.fill_diagonal(covariance, np.maximum(np.diag(covariance), least))
    return np.asarray(covariance)


def _least(jacobian: Array, prior: Array, as_one: float, white: Array) -> Array:
    """Return the least variance of each number (k,)."""
    if as_one == 1.0:
        return white
    _, values, directions = np.linalg.svd(np.vstack([jacobian / np.sqrt(as_one), prior]), full_matrices=False)
    inverse = np.divide(1.0, values, out=np.full_like(values, 1e9), where=values > 1e-9)
    return np.asarray(np.sum((directions.T * inverse) ** 2, axis=1))
