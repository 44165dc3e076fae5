"""Which points of two sampled stretches belong together in the order of travel.

The alignment never runs back on either path and makes the distance, summed up along both, small: what goes
astray is compared with the place where it left, and not with whatever it comes near to later. It is found on
every 2^k-th sample first, and then around what was found on twice as many, in a time that grows with the
length.

References
----------
.. [1] Salvador, Chan, Toward accurate dynamic time warping in linear time and space, Intelligent Data
   Analysis 11 (2007) 561-580.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.simulate.compiling import compiled, inner
from ph_post.types import Array, IntArray

COARSEST: Final = 128
"""Samples up to which all alignments are tried."""

RADIUS: Final = 10
"""Samples beside the coarser alignment that a finer one may go."""


@compiled
def warp(a: Array, b: Array, stretch_a: IntArray, stretch_b: IntArray) -> tuple[IntArray, IntArray]:
    """Align stretches of samples with one another.

    Parameters
    ----------
    a, b : Array, shape (n, 3), (m, 3)
        Samples in the order of travel [m].
    stretch_a, stretch_b : IntArray, shape (k + 1,)
        First samples of the stretches, and the ends of the last; none is empty.

    Returns
    -------
    tuple of IntArray, shape (n, 2), (m, 2)
        First and last sample of the other path that each sample belongs to.
    """
    of_a = np.empty((a.shape[0], 2), dtype=np.int64)
    of_b = np.empty((b.shape[0], 2), dtype=np.int64)
    for k in range(stretch_a.size - 1):
        a0, a1, b0, b1 = stretch_a[k], stretch_a[k + 1], stretch_b[k], stretch_b[k + 1]
        chain = _chain(a[a0:a1], b[b0:b1])
        of_a[a0:a1, 0], of_b[b0:b1, 0] = b1, a1
        for c in range(chain.shape[0]):
            i, j = a0 + chain[c, 0], b0 + chain[c, 1]
            of_a[i, 0], of_a[i, 1] = min(of_a[i, 0], j), j
            of_b[j, 0], of_b[j, 1] = min(of_b[j, 0], i), i
    return of_a, of_b


@inner
def _count(samples: int, level: int) -> int:
    """Return how many samples a level has: every 2^level-th, and the last."""
    step = 1 << level
    return (samples - 1 + step - 1) // step + 1


@inner
def _chain(a: Array, b: Array) -> IntArray:
    """Pairs of samples that belong together, from the first to the last."""
    level = 0
    while max(_count(a.shape[0], level), _count(b.shape[0], level)) > COARSEST:
        level += 1
    low = np.zeros(_count(a.shape[0], level), dtype=np.int64)
    high = np.full(_count(a.shape[0], level), _count(b.shape[0], level) - 1, dtype=np.int64)
    chain = _best(a, b, level, low, high)
    while level > 0:
        level -= 1
        low, high = _around(chain, _count(a.shape[0], level), _count(b.shape[0], level))
        chain = _best(a, b, level, low, high)
    return chain


@inner
def _around(chain: IntArray, n: int, m: int) -> tuple[IntArray, IntArray]:
    """Return the columns of every row that lie within the radius of a coarser alignment."""
    low, high = np.full(n, m - 1, dtype=np.int64), np.zeros(n, dtype=np.int64)
    for c in range(chain.shape[0]):
        i, j = 2 * chain[c, 0], 2 * chain[c, 1]
        for row in range(max(i - RADIUS, 0), min(i + RADIUS + 2, n)):
            low[row] = min(low[row], max(j - RADIUS, 0))
            high[row] = max(high[row], min(j + RADIUS + 1, m - 1))
    return low, high


@inner
def _distance(a: Array, b: Array, i: int, j: int) -> float:
    return math.sqrt((a[i, 0] - b[j, 0]) ** 2 + (a[i, 1] - b[j, 1]) ** 2 + (a[i, 2] - b[j, 2]) ** 2)


@inner
def _best(a: Array, b: Array, level: int, low: IntArray, high: IntArray) -> IntArray:
    """Best alignment within the columns `low` to `high` of every row: dynamic programming."""
    n, m = low.size, _count(b.shape[0], level)
    begins = np.zeros(n + 1, dtype=np.int64)
    begins[1:] = np.cumsum(high - low + 1)
    steps = np.empty(begins[n], dtype=np.uint8)
    before, here = np.full(m, np.inf), np.full(m, np.inf)
    for i in range(n):
        at = min(i << level, a.shape[0] - 1)
        along_a = _distance(a, a, at, min(max(i - 1, 0) << level, a.shape[0] - 1))
        for j in range(low[i], high[i] + 1):
            there = min(j << level, b.shape[0] - 1)
            apart = _distance(a, b, at, there)
            along_b = _distance(b, b, there, min(max(j - 1, 0) << level, b.shape[0] - 1))
            cost, step = np.inf, 0
            if i == 0 and j == 0:
                cost = 0.0
            if i > 0 and j > 0 and low[i - 1] <= j - 1 <= high[i - 1]:
                cost = before[j - 1] + apart * (along_a + along_b)
            if i > 0 and low[i - 1] <= j <= high[i - 1] and before[j] + apart * along_a < cost:
                cost, step = before[j] + apart * along_a, 1
            if j > low[i] and here[j - 1] + apart * along_b < cost:
                cost, step = here[j - 1] + apart * along_b, 2
            here[j] = cost
            steps[begins[i] + j - low[i]] = step
        before, here = here, before
    return _walk_back(steps, begins, low, n, m)


@inner
def _walk_back(steps: Array, begins: IntArray, low: IntArray, n: int, m: int) -> IntArray:
    """Return the chain of pairs that the steps tell, from its beginning."""
    chain = np.empty((n + m, 2), dtype=np.int64)
    i, j, size = n - 1, m - 1, 0
    while True:
        chain[size, 0], chain[size, 1] = i, j
        size += 1
        if i == 0 and j == 0:
            break
        step = steps[begins[i] + j - low[i]]
        if step != 2:
            i -= 1
        if step != 1:
            j -= 1
    return chain[:size][::-1]
