"""Speeds around tight bends in nearly the least time.

Let b be the square of the speed at places along the path. With r_s, r_ss, r_sss the derivatives of the path by arc
length, an axis' acceleration is r_ss b + r_s b'/2, and its jerk over the speed r_sss b + 3/2 r_ss b' + 1/2 r_s b''.
Both are linear in b [1]_; the jerk may be J, so that the second may be J / √b. The time is minimised with a logarithmic
barrier before each limit [2]_. J / √b is convex in b, so that its tangent keeps the limit: Newton's matrix leaves its
curvature out, and is positive.

References
----------
.. [1] Verscheure, Demeulenaere, Swevers, De Schutter, Diehl, Time-optimal path tracking for robots: a convex
optimization
   approach, IEEE Trans. Autom. Control 54 (2009) 2318-2327.
.. [2] Boyd, Vandenberghe, Convex Optimization, Cambridge University Press 2004, chapter 11.
"""

from __future__ import annotations

import math
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.compiling import compiled, lean
from ph_post.types import Array

FIRST: Final = 1e-2
"""Weight of the barrier to begin with, over the time's."""

LAST: Final = 1e-6
"""Weight of the barrier at last: some thousand limits are then kept for 1e-4 of the time."""

LESS: Final = 0.1
"""Factor to the weight from one stage to the next."""

STEPS: Final = 12
"""Newton steps of a stage at most; three or four are usual."""

INTO: Final = 25
"""Stages at most until all limits are kept."""

ROOM: Final = 1.2
"""How much a limit is widened beyond what the first speeds take of it, where they break it."""

BELOW: Final = 1e-4
"""Part of the highest speed's square by which the first speeds stay below it."""

DONE: Final = 1e-3
"""Part of the weight, over all limits, by which one more step would lower the function."""


MOST_HALVINGS: Final = 40
"""Halvings of a step until it lowers the function."""

JERK: Final = 2
"""Of the three rows of limits of an axis that of the jerk."""

_ORDERS: Final = [1, 1, 2]
"""Of which derivative of the way by time they are, less one."""


class BendLimits(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What bounds the motion at places along a stretch, its ends included: n places, d axes.

    `s` (n,) [m] rise; `jet` (3, n, d) are r_s, r_ss, r_sss; `feed` (n,) [m/s] the highest speed along the path;
    `values` (3, n, d) the limits of speed, acceleration and jerk.
    """

    s: Array
    jet: Array
    feed: Array
    values: Array


def least_time_speeds(limits: BendLimits, v: Array) -> Array | None:
    """Return the speeds of nearly the least time between the first and the last place, with no acceleration at these.

    Parameters
    ----------
    limits : BendLimits
    v : Array, shape (n,)
        Speeds [m/s] to begin with, not zero between the ends; the first and the last are kept.

    Returns
    -------
    Array, shape (n,), or None
        Speeds [m/s]; None where none were found that keep the limits.
    """
    problem = _Problem(limits, v)
    b = np.minimum(v[1:-1] ** 2, (1.0 - BELOW) * problem.highest)
    wide = np.maximum(problem.room, ROOM * problem.used(b))
    for _ in range(INTO):
        if np.all(wide <= problem.room):
            break
        b = problem.descend(b, wide, FIRST, 2)
        # The limits close in as far as the motion lets them.
        wide = np.maximum(problem.room, 0.5 * (wide + problem.used(b)))
    else:
        return None
    weight = FIRST
    while weight > LAST:
        b = problem.descend(b, wide, weight, STEPS)
        weight *= LESS
    return np.concatenate([v[:1], np.sqrt(b), v[-1:]])


class _Problem:
    """Time and limits as functions of b at the inner places.

    A row of limits is three numbers at a place, for b there and at both neighbours; the ends' b are known. What they
    come to is limited in both senses.
    """

    def __init__(self, limits: BendLimits, v: Array) -> None:
        self._width = np.diff(limits.s)
        self._ends = np.array([v[0] ** 2, v[-1] ** 2])
        first, second = _differences(limits.s, bool(v[0] == 0.0), bool(v[-1] == 0.0))
        (r1, r2, r3), values = limits.jet[:, 1:-1], limits.values[:, 1:-1]
        middle = np.array([0.0, 1.0, 0.0])[:, None, None]
        along, bend = first[:, :, None], second[:, :, None]
        rows = [*self._accelerations(limits.jet), middle * r3 + 1.5 * along * r2 + 0.5 * bend * r1]
        self._rows = np.ascontiguousarray(np.stack(rows).transpose(2, 3, 0, 1))
        """Shape (n, d, 3 of accelerations before and behind the place and of jerk, 3 neighbours)."""
        self.room = np.ascontiguousarray(
            np.broadcast_to(values[_ORDERS].transpose(1, 2, 0), (2, *self._rows.shape[:3]))
        )
        """What the rows may be in either sense, of jerk over the speed, shape (2, n, d, 3)."""
        highest = (
            np.minimum(limits.feed, (limits.values[0] / np.maximum(np.abs(limits.jet[0]), _LEAST)).min(axis=1)) ** 2
        )
        self.highest = highest[1:-1]
        self._limit_first_cells(limits, v)

    def _accelerations(self, jet: Array) -> tuple[Array, Array]:
        """Rows of the accelerations in the middle of the cells before and behind every place, shape (3, n, d) each.

        At the places themselves differences of the neighbours would let every second b be higher.
        """
        r1, r2 = 0.5 * (jet[:2, :-1] + jet[:2, 1:])
        slope = 0.5 * r1 / self._width[:, None]
        left, right = 0.5 * r2 - slope, 0.5 * r2 + slope
        none = np.zeros_like(left[1:])
        return np.stack([left[:-1], right[:-1], none]), np.stack([none, left[1:], right[1:]])

    def _limit_first_cells(self, limits: BendLimits, v: Array) -> None:
        """Bound b beside an end by what the jerk along the path allows from there."""
        for end, way in ((0, self._width[0]), (-1, self._width[-1])):
            along = float((limits.values[2, end] / np.maximum(np.abs(limits.jet[0, end]), _LEAST)).min())
            if v[end] == 0.0:
                most = 0.5 * along * (6.0 * way / along) ** (2.0 / 3.0)
            else:
                most = v[end] + 0.5 * along * (way / v[end]) ** 2
            self.highest[end] = min(self.highest[end], most**2)

    def used(self, b: Array) -> Array:
        """Evaluate what the motion takes of the limits, to be compared with them, shape (2, n, d, 3)."""
        known = np.concatenate([self._ends[:1], b, self._ends[1:]])
        used = np.einsum("karj,kj->kar", self._rows, np.stack([known[:-2], b, known[2:]], axis=1))
        used[..., JERK] *= np.sqrt(b)[:, None]
        return np.stack([used, -used])

    def descend(self, b: Array, room: Array, weight: float, steps: int) -> Array:
        """Minimise the logarithm of the time and the barrier before limits of such room by some of Newton's steps."""
        known = np.concatenate([self._ends[:1], b, self._ends[1:]])
        found: Array = _descend(known, self._rows, 1.0 / room, self.highest, self._width, weight, steps)
        return found[1:-1]


@compiled
def _descend(known: Any, rows: Any, scale: Any, highest: Any, width: Any, weight: float, steps: int) -> Any:
    """Minimise the logarithm of the time and the barrier before limits of such room by some of Newton's steps.

    `known` (n + 2,) is b, of which the first and the last stay; `rows` (n, d, 3, 3) and `highest` (n,) are those of
    :class:`_Problem`, `scale` (2, n, d, 3) is one over the room.
    """
    here, tried = known.copy(), known.copy()
    n = highest.size
    slope, step, bands = np.empty(n + 2), np.empty(n), np.empty((3, n + 2))
    value = _value(here, rows, scale, highest, width, weight)
    for _ in range(steps):
        slope[:] = 0.0
        bands[:] = 0.0
        _add_time(here, width, slope, bands)
        _add_barrier(here, rows, scale, highest, weight, slope, bands)
        if not _solve_banded(bands[:, 1:-1], slope[1:-1], step):
            break
        gain = 0.0
        for k in range(n):
            gain += slope[k + 1] * step[k]
        if not gain < -DONE * weight * scale.size:
            break
        part, done = 1.0, False
        for _ in range(MOST_HALVINGS):
            positive = True
            for k in range(n):
                tried[k + 1] = here[k + 1] + part * step[k]
                positive = positive and tried[k + 1] > 0.0
            if positive:
                new = _value(tried, rows, scale, highest, width, weight)
                if new <= value + 0.1 * part * gain:
                    here[:] = tried
                    value, done = new, True
                    break
            part *= 0.5
        if not done:
            break
    return here


@lean
def _cell_time(first: Any, last: Any, width: Any) -> Any:
    """Return the time of a cell by b at its ends, and the sum of the speeds there.

    The speed is linear in time; beside a rest it goes with the way to the power 2/3.
    """
    total = math.sqrt(first) + math.sqrt(last)
    return (3.0 if first == 0.0 or last == 0.0 else 2.0) * width / total, total


@lean
def _value(b: Any, rows: Any, scale: Any, highest: Any, width: Any, weight: Any) -> Any:
    """Evaluate the logarithm of the time and the barrier; infinite where a limit is broken."""
    time, barrier = 0.0, 0.0
    for k in range(width.size):
        time += _cell_time(b[k], b[k + 1], width[k])[0]
    for k in range(highest.size):
        product = 1.0 - b[k + 1] / highest[k]
        if not product > 0.0:
            return math.inf
        root = math.sqrt(b[k + 1])
        for axis in range(rows.shape[1]):
            for row in range(3):
                own = rows[k, axis, row]
                used = own[0] * b[k] + own[1] * b[k + 1] + own[2] * b[k + 2]
                if row == JERK:
                    used *= root
                up, down = 1.0 - used * scale[0, k, axis, row], 1.0 + used * scale[1, k, axis, row]
                if not (up > 0.0 and down > 0.0):
                    return math.inf
                product *= up * down
        # Of some twenty numbers below 2, the least of them some 1e-6.
        barrier += math.log(product)
    return math.log(time) - weight * barrier


@lean
def _add_time(b: Any, width: Any, slope: Any, bands: Any) -> None:
    """Add the time's logarithm to its slope (n + 2,) and to the diagonals of a positive matrix for its curvature.

    These are (3, n + 2), the main one first. At the ends, which are known, they mean nothing.
    """
    whole = 0.0
    for k in range(width.size):
        whole += _cell_time(b[k], b[k + 1], width[k])[0]
    for k in range(width.size):
        time, total = _cell_time(b[k], b[k + 1], width[k])
        by_v, again = -time / total / whole, 2.0 * time / total**2 / whole
        for i in (k, k + 1):
            if b[i] > 0.0:
                rate = 0.5 / math.sqrt(b[i])
                slope[i] += rate * by_v
                bands[0, i] += rate**2 * again - 0.5 * rate / b[i] * by_v
        if b[k] > 0.0 and b[k + 1] > 0.0:
            bands[1, k] += 0.25 / math.sqrt(b[k] * b[k + 1]) * again


@lean
def _add_barrier(b: Any, rows: Any, scale: Any, highest: Any, weight: Any, slope: Any, bands: Any) -> None:
    """Add the barrier to the slope and the diagonals of :func:`_add_time`."""
    for k in range(highest.size):
        root, below = math.sqrt(b[k + 1]), highest[k] - b[k + 1]
        first, here, last = 0.0, 1.0 / below, 0.0
        before, itself, behind, by_before, by_behind, across = 0.0, 1.0 / below**2, 0.0, 0.0, 0.0, 0.0
        for axis in range(rows.shape[1]):
            for row in range(3):
                # What is used, its slopes by b at the place before, at it and behind it, and the barrier's by it.
                own = rows[k, axis, row]
                left, middle, right = own[0], own[1], own[2]
                used = left * b[k] + middle * b[k + 1] + right * b[k + 2]
                if row == JERK:
                    left, right, middle = left * root, right * root, middle * root + 0.5 * used / root
                    used *= root
                up, down = scale[0, k, axis, row], scale[1, k, axis, row]
                up, down = up / (1.0 - used * up), down / (1.0 + used * down)
                rise, bend = up - down, up * up + down * down
                first, here, last = first + rise * left, here + rise * middle, last + rise * right
                before, itself, behind = (
                    before + bend * left * left,
                    itself + bend * middle * middle,
                    behind + bend * right * right,
                )
                by_before, by_behind = by_before + bend * left * middle, by_behind + bend * middle * right
                across += bend * left * right
        slope[k] += weight * first
        slope[k + 1] += weight * here
        slope[k + 2] += weight * last
        bands[0, k] += weight * before
        bands[0, k + 1] += weight * itself
        bands[0, k + 2] += weight * behind
        bands[1, k] += weight * by_before
        bands[1, k + 1] += weight * by_behind
        bands[2, k] += weight * across


@lean
def _solve_banded(bands: Any, slope: Any, step: Any) -> Any:
    """Put in the step, matrix · step = -slope, by L D Lᵀ in place of the matrix; false where that is not positive."""
    n = slope.size
    for k in range(n):
        if not bands[0, k] > 0.0:
            return False
        first = bands[1, k] / bands[0, k]
        second = bands[2, k] / bands[0, k]
        if k + 1 < n:
            bands[0, k + 1] -= first * bands[1, k]
            bands[1, k + 1] -= first * bands[2, k]
        if k + 2 < n:
            bands[0, k + 2] -= second * bands[2, k]
        bands[1, k], bands[2, k] = first, second
    for k in range(n):
        step[k] = -slope[k]
        if k > 0:
            step[k] -= bands[1, k - 1] * step[k - 1]
        if k > 1:
            step[k] -= bands[2, k - 2] * step[k - 2]
    for k in range(n - 1, -1, -1):
        step[k] /= bands[0, k]
        if k + 1 < n:
            step[k] -= bands[1, k] * step[k + 1]
        if k + 2 < n:
            step[k] -= bands[2, k] * step[k + 2]
    return True


_LEAST: Final = 1e-12
"""Kept in denominators that may vanish."""


def _differences(s: Array, from_rest: bool, to_rest: bool) -> tuple[Array, Array]:
    """First and second derivative at the inner places as factors of b before, there and behind, shape (3, n - 2).

    Beside a rest b goes with the way to the power 4/3: there they are scaled so that they are exact for that.
    """
    h0, h1 = np.diff(s)[:-1], np.diff(s)[1:]
    first = np.stack([-h1 / (h0 * (h0 + h1)), (h1 - h0) / (h0 * h1), h0 / (h1 * (h0 + h1))])
    second = np.stack([2.0 / (h0 * (h0 + h1)), -2.0 / (h0 * h1), 2.0 / (h1 * (h0 + h1))])
    near = s[1:-1] - s[0] < s[-1] - s[1:-1]
    for on, way, sign in ((near & from_rest, s - s[0], 1.0), (~near & to_rest, s[-1] - s, -1.0)):
        if on.any():
            power = np.stack([way[:-2], way[1:-1], way[2:]]) ** (4.0 / 3.0)
            rest = np.where(on, way[1:-1], 1.0)
            first = np.where(on, first * sign * 4.0 / 3.0 * rest ** (1.0 / 3.0) / (first * power).sum(axis=0), first)
            second = np.where(on, second * 4.0 / 9.0 * rest ** (-2.0 / 3.0) / (second * power).sum(axis=0), second)
    return first, second


def phases_between(s: Array, v: Array) -> tuple[Array, Array]:
    """Return durations (n - 1,) and cubic speeds (n - 1, 4) in Bernstein form of a motion with speeds at places.

    Speed and acceleration are continuous, the latter is zero at both ends.
    """
    first, _ = _differences(s, bool(v[0] == 0.0), bool(v[-1] == 0.0))
    b = v**2
    a = np.concatenate([[0.0], 0.5 * (first[0] * b[:-2] + first[1] * b[1:-1] + first[2] * b[2:]), [0.0]])
    v0, v1, a0, a1, way = v[:-1], v[1:], a[:-1], a[1:], np.diff(s)
    # way = h (v0 + v1) / 2 + h² (a0 - a1) / 12, the root that is finite where a0 = a1
    half, bend = 0.25 * (v0 + v1), (a0 - a1) / 12.0
    root = np.sqrt(np.maximum(half * half + bend * way, 0.0))
    h = way / (half + root)
    return h, np.stack([v0, v0 + a0 * h / 3.0, v1 - a1 * h / 3.0, v1], axis=1)
