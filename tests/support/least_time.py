"""Least time along a curve from rest to rest, under limits on each axis' speed, acceleration and jerk.

A direct transcription of its own: the square b of the speed at places along the curve is sought. With r_s, r_ss, r_sss
the derivatives by arc length the accelerations r_ss b + r_s b'/2 are linear in it, and so is the jerk over the speed,
r_sss b + 3/2 r_ss b' + 1/2 r_s b'', which may be no larger than J / √b. That is a convex function of b, so its tangent
lies below it: a linear program with the tangent keeps the limit, and the programs' solutions only become faster.

At rest b goes with s to the power 4/3, so that places as the third power of a number are as far apart in time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, vstack
from scipy.special import betainc

Floats = NDArray[np.float64]

Jet = Callable[[Floats], Floats]
"""r_s, r_ss, r_sss at arc lengths (n,), shape (3, n, dim)."""

ROUNDS = 60
STEP = 4.0
DONE = 1e-5


def least_time(
    jet: Jet,
    length: float,
    limits: Sequence[Sequence[float]],
    feed: float,
    count: int = 160,
    tight: Sequence[tuple[float, float]] = (),
) -> tuple[float, Floats, Floats]:
    """Return the least time [s], and the places and speeds of the motion.

    `limits` are the largest speeds, accelerations and jerks of the axes, SI or any other consistent units; `tight`
    stretches of the curve that need places of their own to begin with.
    """
    s = length * betainc(3.0, 3.0, np.linspace(0.0, 1.0, count + 1))
    for around in tight:
        s = np.union1d(s, np.linspace(*around, count // 4))
        s = s[np.diff(s, append=2.0 * length) > 1e-3 * (around[1] - around[0]) / count]
    found = _solved(jet, s, limits, feed)
    for _ in range(2):
        # Where it is slow there are as many places as where it is fast.
        t = np.concatenate([[0.0], np.cumsum(_cells(np.diff(found[1]), found[2][1:-1] ** 2))])
        u = np.linspace(0.0, t[-1], count + 1)
        s = np.interp(u, t, found[1])
        s[1], s[-2] = s[2] / 8.0, length - (length - s[-3]) / 8.0
        found = _solved(jet, s, limits, feed)
    return found


def _solved(jet: Jet, s: Floats, limits: Sequence[Sequence[float]], feed: float) -> tuple[float, Floats, Floats]:
    """Return the least time with the square of the speed at given places."""
    velocity, acceleration, jerk = (np.asarray(one, dtype=float) for one in limits)
    inner, length = s[1:-1], float(s[-1])
    first, second = _differences(s)
    r1, r2, r3 = jet(inner)
    highest = np.minimum(feed, (velocity / np.maximum(np.abs(r1), 1e-12)).min(axis=1)) ** 2
    # Out of rest, s = j t³ / 6.
    for end, tangent in ((0, r1[0]), (-1, r1[-1])):
        along, way = (jerk / np.maximum(np.abs(tangent), 1e-12)).min(), (s[1], s[-1] - s[-2])[end]
        highest[end] = min(highest[end], (0.5 * along * (6.0 * way / along) ** (2.0 / 3.0)) ** 2)
    rows, bounds, kind = [], [], []
    for axis in range(r1.shape[1]):
        a = _times(r2[:, axis]) + _times(0.5 * r1[:, axis]) @ first
        j = _times(r3[:, axis]) + _times(1.5 * r2[:, axis]) @ first + _times(0.5 * r1[:, axis]) @ second
        for sign in (1.0, -1.0):
            rows += [sign * a, sign * j]
            bounds += [np.full(inner.size, acceleration[axis]), np.full(inner.size, jerk[axis])]
            kind += [False, True]
    b = _slow(inner, length, highest, rows, bounds, kind)
    width = np.diff(s)
    last = _time(width, b)
    step = STEP
    for _ in range(ROUNDS):
        matrix, right = [], []
        for row, bound, has_jerk in zip(rows, bounds, kind, strict=True):
            # J / √b from below: its tangent at the speeds that are known.
            slope = 0.5 * bound / b**1.5 if has_jerk else np.zeros_like(b)
            matrix.append(row + _times(slope))
            right.append(1.5 * bound / np.sqrt(b) if has_jerk else bound)
        # Each row in its own size.
        whole, limit = vstack(matrix).tocsr(), np.concatenate(right)
        scaled = _times(1.0 / limit) @ whole @ _times(b)
        gain = _slope(width, b) * b
        found = linprog(
            gain / np.abs(gain).max(),
            A_ub=scaled,
            b_ub=np.ones(limit.size),
            bounds=np.stack([np.full(b.size, 1.0 / step), np.minimum(step, highest / b)], axis=1),
            method="highs-ds",
            options={"presolve": False},  # which crashes on some of these
        )
        if found.status != 0:
            step = 1.0 + 0.5 * (step - 1.0)
            continue
        new = b * found.x
        time = _time(width, new)
        if time < last:
            b, gained, last = new, last - time, time
            if gained < DONE * time:
                break
        else:
            step = 1.0 + 0.5 * (step - 1.0)
    return last, s, np.concatenate([[0.0], np.sqrt(b), [0.0]])


def _slow(inner: Floats, length: float, highest: Floats, rows: list, bounds: list, kind: list) -> Floats:
    """A motion that keeps every limit, slowed down until it does."""
    shape = (inner / length) ** (4.0 / 3.0) * (1.0 - inner / length) ** (4.0 / 3.0)
    b = shape * (highest.min() / shape.max())
    for _ in range(200):
        used = max(
            float((row @ b * (np.sqrt(b) if has_jerk else 1.0) / bound).max())
            for row, bound, has_jerk in zip(rows, bounds, kind, strict=True)
        )
        if used < 1.0 and (b <= highest).all():
            return b
        b = 0.7 * b
    raise AssertionError("no slow motion keeps the limits")


def _differences(s: Floats) -> tuple[csr_matrix, csr_matrix]:
    """First and second derivative at inner places of what vanishes at both ends."""
    h0, h1 = np.diff(s)[:-1], np.diff(s)[1:]
    n = h0.size
    first = np.zeros((3, n))
    first[0], first[2] = -h1 / (h0 * (h0 + h1)), h0 / (h1 * (h0 + h1))
    first[1] = -first[0] - first[2]
    second = np.stack([2.0 / (h0 * (h0 + h1)), -2.0 / (h0 * h1), 2.0 / (h1 * (h0 + h1))])
    near = s[1:-1] < 0.5 * s[-1]
    rest = np.where(near, s[1:-1], s[-1] - s[1:-1])
    neighbours = [np.where(near, part, s[-1] - part) for part in (s[:-2], s[1:-1], s[2:])]
    power = np.stack(neighbours) ** (4.0 / 3.0)
    # Exact for motions out of rest, which differences of neighbours are not in the first cells.
    first *= np.where(near, 1.0, -1.0) * (4.0 / 3.0) * rest ** (1.0 / 3.0) / (first * power).sum(axis=0)
    second *= (4.0 / 9.0) * rest ** (-2.0 / 3.0) / (second * power).sum(axis=0)
    return _banded(first), _banded(second)


def _banded(rows: Floats) -> csr_matrix:
    n = rows.shape[1]
    i = np.repeat(np.arange(n), 3)
    k = i + np.tile([-1, 0, 1], n)
    inside = (k >= 0) & (k < n)
    return csr_matrix((rows.T.ravel()[inside], (i[inside], k[inside])), shape=(n, n))


def _times(values: Floats) -> csr_matrix:
    n = values.size
    return csr_matrix((values, (np.arange(n), np.arange(n))), shape=(n, n))


def _time(width: Floats, b: Floats) -> float:
    """Time of all cells."""
    return float(_cells(width, b).sum())


def _cells(width: Floats, b: Floats) -> Floats:
    """Times of cells with the speed linear in time over each; over the first and the last it goes with s^(2/3)."""
    v = np.sqrt(b)
    return np.concatenate([3.0 * width[:1] / v[:1], 2.0 * width[1:-1] / (v[:-1] + v[1:]), 3.0 * width[-1:] / v[-1:]])


def _slope(width: Floats, b: Floats) -> Floats:
    """Derivative of the time by b."""
    v = np.sqrt(b)
    by_v = np.zeros_like(v)
    by_v[0], by_v[-1] = -3.0 * width[0] / b[0], -3.0 * width[-1] / b[-1]
    inner = -2.0 * width[1:-1] / (v[:-1] + v[1:]) ** 2
    by_v[:-1] += inner
    by_v[1:] += inner
    return by_v / (2.0 * v)
