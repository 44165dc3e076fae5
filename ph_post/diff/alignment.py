"""Pair the items of two long sequences in order, and the points of two sampled stretches in the order of travel."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.types import Array, IntArray

SMALL: Final = 1 << 16
"""A gap of no more cells (items by items) is solved exactly."""

WINDOWS: Final = (1, 2, 4, 8, 16)
"""Lengths of the runs that are tried as anchors: repeated items are distinguished by their neighbours."""

_MIX: Final = np.uint64(0x9E3779B97F4A7C15)


def hash_columns(*columns: IntArray | Array) -> IntArray:
    """Hash rows of several columns (n,) into one number each; rows that are equal have equal ones.

    Examples
    --------
    >>> keys = hash_columns(np.array([1, 1, 2]), np.array([0.5, 0.5, 0.5]))
    >>> bool(keys[0] == keys[1]), bool(keys[0] == keys[2])
    (True, False)
    """
    total = np.zeros(columns[0].shape, dtype=np.uint64)
    for column in columns:
        # Adding zero makes one number of both zeros.
        bits = (np.ascontiguousarray(column) + 0).view(np.uint64)
        total = _scramble(total * _MIX + bits)
    return total.view(np.int64)


def _scramble(bits: np.typing.NDArray[np.uint64]) -> np.typing.NDArray[np.uint64]:
    """Spread every bit over all (the finalizer of splitmix64)."""
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


def align(a: IntArray, b: IntArray) -> IntArray:
    """Return for every item of `a` the number of its counterpart in `b`, -1 where it has none.

    Counterparts are equal and rise. The time is about proportional to the length, whatever differs; where
    long stretches without an anchor differ, not all that is equal in them is found.

    Examples
    --------
    >>> align(np.array([1, 2, 3, 4]), np.array([1, 9, 3, 4, 5])).tolist()
    [0, -1, 2, 3]
    """
    found = np.full(a.size, -1, dtype=np.int64)
    gaps = [(0, a.size, 0, b.size)]
    small: list[tuple[int, int, int, int]] = []
    while gaps:
        gap = _trim(a, b, found, *gaps.pop())
        if gap[0] == gap[1] or gap[2] == gap[3]:
            continue
        if (gap[1] - gap[0]) * (gap[3] - gap[2]) <= SMALL:
            small.append(gap)
        else:
            gaps += _split(a, b, found, gap)
    _solve(a, b, found, np.array(small, dtype=np.int64).reshape(-1, 4))
    return found


def gaps_of(found: IntArray, size: int) -> IntArray:
    """Stretches without counterparts, rows of (first, end) in both sequences; `size` is the second's length.

    Examples
    --------
    >>> gaps_of(np.array([0, -1, 2, 3]), 5).tolist()
    [[1, 2, 1, 2], [4, 4, 4, 5]]
    """
    here = np.flatnonzero(found >= 0)
    left = np.stack([np.append(-1, here) + 1, np.append(here, found.size)], axis=1)
    right = np.stack([np.append(-1, found[here]) + 1, np.append(found[here], size)], axis=1)
    both = np.concatenate([left, right], axis=1)
    kept: IntArray = both[(both[:, 1] > both[:, 0]) | (both[:, 3] > both[:, 2])]
    return kept


def _trim(a: IntArray, b: IntArray, found: IntArray, a0: int, a1: int, b0: int, b1: int) -> tuple[int, int, int, int]:
    """Match what both gaps begin and end with."""
    size = min(a1 - a0, b1 - b0)
    same = a[a0 : a0 + size] == b[b0 : b0 + size]
    head = size if same.all() else int(np.argmin(same))
    found[a0 : a0 + head] = np.arange(b0, b0 + head)
    size -= head
    same = a[a1 - size : a1][::-1] == b[b1 - size : b1][::-1]
    tail = size if same.all() else int(np.argmin(same))
    found[a1 - tail : a1] = np.arange(b1 - tail, b1)
    return a0 + head, a1 - tail, b0 + head, b1 - tail


def _split(
    a: IntArray, b: IntArray, found: IntArray, gap: tuple[int, int, int, int]
) -> list[tuple[int, int, int, int]]:
    """Cut a gap at its anchors; none where there are no anchors, and its items stay without counterparts."""
    a0, a1, b0, b1 = gap
    for window in WINDOWS:
        i, j = _anchors(_runs(a[a0:a1], window), _runs(b[b0:b1], window))
        if i.size:
            break
    else:
        return []
    found[a0 + i] = b0 + j
    edges_a = np.concatenate([[a0 - 1], a0 + i, [a1]])
    edges_b = np.concatenate([[b0 - 1], b0 + j, [b1]])
    wide = (np.diff(edges_a) > 1) & (np.diff(edges_b) > 1)
    rows = [edges_a[:-1] + 1, edges_a[1:], edges_b[:-1] + 1, edges_b[1:]]
    return [tuple(row) for row in np.stack(rows, axis=1)[wide].tolist()]


def _runs(keys: IntArray, window: int) -> IntArray:
    """Hash every run of `window` items."""
    if keys.size < window:
        return np.zeros(0, dtype=np.int64)
    count = keys.size - window + 1
    return hash_columns(*(keys[k : k + count] for k in range(window)))


def _anchors(a: IntArray, b: IntArray) -> tuple[IntArray, IntArray]:
    """Items that occur once in both, as many of them as stand in one order."""
    once_a, first_a, count_a = np.unique(a, return_index=True, return_counts=True)
    once_b, first_b, count_b = np.unique(b, return_index=True, return_counts=True)
    alone_a, alone_b = once_a[count_a == 1], once_b[count_b == 1]
    _, left, right = np.intersect1d(alone_a, alone_b, assume_unique=True, return_indices=True)
    i, j = first_a[count_a == 1][left], first_b[count_b == 1][right]
    order = np.argsort(i)
    i, j = i[order], j[order]
    kept = _longest_rise(j.astype(np.int64))
    return i[kept], j[kept]


@compiled
def _longest_rise(values: IntArray) -> IntArray:
    """Return the indices of the longest rising subsequence, by patience sorting."""
    n = values.size
    top = np.empty(n, dtype=np.int64)
    before = np.full(n, -1, dtype=np.int64)
    piles = 0
    for k in range(n):
        low, high = 0, piles
        while low < high:
            middle = (low + high) // 2
            if values[top[middle]] < values[k]:
                low = middle + 1
            else:
                high = middle
        if low > 0:
            before[k] = top[low - 1]
        top[low] = k
        piles = max(piles, low + 1)
    chain = np.empty(piles, dtype=np.int64)
    k = top[piles - 1] if piles else -1
    for place in range(piles - 1, -1, -1):
        chain[place] = k
        k = before[k]
    return chain


@compiled
def _solve(a: IntArray, b: IntArray, found: IntArray, gaps: IntArray) -> None:
    """Longest common subsequence of each small gap."""
    for row in range(gaps.shape[0]):
        a0, a1, b0, b1 = gaps[row]
        n, m = a1 - a0, b1 - b0
        length = np.zeros((n + 1, m + 1), dtype=np.int32)
        for i in range(n - 1, -1, -1):
            for j in range(m - 1, -1, -1):
                if a[a0 + i] == b[b0 + j]:
                    length[i, j] = length[i + 1, j + 1] + 1
                else:
                    length[i, j] = max(length[i + 1, j], length[i, j + 1])
        i, j = 0, 0
        while i < n and j < m:
            if a[a0 + i] == b[b0 + j]:
                found[a0 + i] = b0 + j
                i += 1
                j += 1
            elif length[i + 1, j] >= length[i, j + 1]:
                i += 1
            else:
                j += 1


COARSEST: Final = 128
"""Samples up to which all alignments are tried."""

RADIUS: Final = 10
"""Samples beside the coarser alignment that a finer one may go."""


@compiled
def align_samples(a: Array, b: Array, stretch_a: IntArray, stretch_b: IntArray) -> tuple[IntArray, IntArray]:
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


@lean
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


@lean
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
    """Return the chain of pairs that the steps describe, from its beginning."""
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
