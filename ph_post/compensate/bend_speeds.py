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

from ph_post.compiling import compiled, inner
from ph_post.types import Array, BoolArray

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

JERK_ROW: Final = 2
"""Of every three rows of limits that of the jerk."""


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

    A row of limits is three numbers at a place, for b there and at both neighbours; the ends' b are known.
    """

    def __init__(self, limits: BendLimits, v: Array) -> None:
        self._width = np.diff(limits.s)
        self._ends = np.array([v[0] ** 2, v[-1] ** 2])
        first, second = _differences(limits.s, bool(v[0] == 0.0), bool(v[-1] == 0.0))
        (r1, r2, r3), values = limits.jet[:, 1:-1], limits.values[:, 1:-1]
        middle = np.array([0.0, 1.0, 0.0])[:, None, None]
        along, bend = first[:, :, None], second[:, :, None]
        rows = np.stack([*self._accelerations(limits.jet), middle * r3 + 1.5 * along * r2 + 0.5 * bend * r1])
        self._rows = np.ascontiguousarray(np.concatenate([rows, -rows]))
        """Shape (2 signs, accelerations before and behind the place and jerk; 3 neighbours; n, d)."""
        self.room = np.concatenate([values[[1, 1, 2]], values[[1, 1, 2]]])
        """What the rows may be, of jerk over the speed, shape (6, n, d)."""
        self._is_jerk: BoolArray = np.tile([False, False, True], 2)[:, None, None]
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
        """Evaluate what the motion takes of the limits, to be compared with them, shape (6, n, d)."""
        known = np.concatenate([self._ends[:1], b, self._ends[1:]])
        rows: Array = self._rows[:, 0] * known[:-2, None] + self._rows[:, 1] * known[1:-1, None]
        rows += self._rows[:, 2] * known[2:, None]
        return np.where(self._is_jerk, rows * np.sqrt(b)[:, None], rows)

    def descend(self, b: Array, room: Array, weight: float, steps: int) -> Array:
        """Minimise the logarithm of the time and the barrier before limits of such room by some of Newton's steps."""
        found: Array = _descend(b, self._rows, room, self.highest, self._width, self._ends, weight, steps)
        return found


@compiled
def _descend(
    b: Any,
    rows: Any,
    room: Any,
    highest: Any,
    width: Any,
    ends: Any,
    weight: float,
    steps: int,
) -> Any:
    """Minimise the logarithm of the time and the barrier before limits of such room by some of Newton's steps.

    `rows` (6, 3, n, d), `room` (6, n, d) and `highest` (n,) are those of :class:`_Problem`; `b` (n,) is not changed.
    """
    n = b.size
    here, tried = b.copy(), np.empty(n)
    slope, step, bands = np.empty(n), np.empty(n), np.empty((3, n))
    value = _value(here, rows, room, highest, width, ends, weight)
    for _ in range(steps):
        _model(here, rows, room, highest, width, ends, weight, slope, bands)
        if not _solve_banded(bands, slope, step):
            break
        gain = 0.0
        for k in range(n):
            gain += slope[k] * step[k]
        if not gain < -DONE * weight * room.size:
            break
        part, done = 1.0, False
        for _ in range(MOST_HALVINGS):
            positive = True
            for k in range(n):
                tried[k] = here[k] + part * step[k]
                positive = positive and tried[k] > 0.0
            if positive:
                new = _value(tried, rows, room, highest, width, ends, weight)
                if new <= value + 0.1 * part * gain:
                    here[:] = tried
                    value, done = new, True
                    break
            part *= 0.5
        if not done:
            break
    return here


@inner
def _used(b: Any, rows: Any, ends: Any, row: Any, k: Any, axis: Any) -> Any:
    """Return what the motion takes of a limit at the place `k`."""
    before = b[k - 1] if k > 0 else ends[0]
    behind = b[k + 1] if k < b.size - 1 else ends[1]
    found = rows[row, 0, k, axis] * before + rows[row, 1, k, axis] * b[k] + rows[row, 2, k, axis] * behind
    return found * math.sqrt(b[k]) if row % 3 == JERK_ROW else found


@inner
def _cell_time(b: Any, width: Any, ends: Any, k: Any) -> Any:
    """Return the time of a cell and the sum of the speeds at its ends.

    The speed is linear in time; beside a rest it goes with the way to the power 2/3.
    """
    first = ends[0] if k == 0 else b[k - 1]
    last = ends[1] if k == b.size else b[k]
    total = math.sqrt(first) + math.sqrt(last)
    return (3.0 if first == 0.0 or last == 0.0 else 2.0) * width[k] / total, total


@inner
def _value(b: Any, rows: Any, room: Any, highest: Any, width: Any, ends: Any, weight: Any) -> Any:
    """Evaluate the logarithm of the time and the barrier; infinite where a limit is broken."""
    time, barrier = 0.0, 0.0
    for k in range(width.size):
        time += _cell_time(b, width, ends, k)[0]
    for k in range(b.size):
        product = 1.0 - b[k] / highest[k]
        if not product > 0.0:
            return math.inf
        for row in range(rows.shape[0]):
            for axis in range(rows.shape[3]):
                slack = 1.0 - _used(b, rows, ends, row, k, axis) / room[row, k, axis]
                if not slack > 0.0:
                    return math.inf
                product *= slack
        # Of some twenty numbers below 2, the least of them some 1e-6.
        barrier += math.log(product)
    return math.log(time) - weight * barrier


@inner
def _model(
    b: Any, rows: Any, room: Any, highest: Any, width: Any, ends: Any, weight: Any, slope: Any, bands: Any
) -> None:
    """Put in the slope (n,) and the diagonals (3, n), the main one first, of a positive matrix for the curvature."""
    n, whole = b.size, 0.0
    for k in range(n + 1):
        whole += _cell_time(b, width, ends, k)[0]
    slope[:] = 0.0
    bands[:] = 0.0
    for k in range(n + 1):
        time, total = _cell_time(b, width, ends, k)
        by_v, again = -time / total / whole, 2.0 * time / total**2 / whole
        for i in (k - 1, k):
            if 0 <= i < n:
                rate = 0.5 / math.sqrt(b[i])
                slope[i] += rate * by_v
                bands[0, i] += rate**2 * again - 0.5 * rate / b[i] * by_v
        if 0 < k < n:
            bands[1, k - 1] += 0.25 / math.sqrt(b[k - 1] * b[k]) * again
    for k in range(n):
        below = highest[k] - b[k]
        slope[k] += weight / below
        bands[0, k] += weight / below**2
        for row in range(rows.shape[0]):
            jerk = row % 3 == JERK_ROW
            scale = math.sqrt(b[k]) if jerk else 1.0
            for axis in range(rows.shape[3]):
                used, size = _used(b, rows, ends, row, k, axis), room[row, k, axis]
                slack = 1.0 - used / size
                # Slopes of the slack by b at the place before, at it and behind it, over the slack.
                left = -rows[row, 0, k, axis] * scale / size / slack
                middle = (-rows[row, 1, k, axis] * scale - (0.5 * used / b[k] if jerk else 0.0)) / size / slack
                right = -rows[row, 2, k, axis] * scale / size / slack
                slope[k] -= weight * middle
                bands[0, k] += weight * middle**2
                if k > 0:
                    slope[k - 1] -= weight * left
                    bands[0, k - 1] += weight * left**2
                    bands[1, k - 1] += weight * left * middle
                if k < n - 1:
                    slope[k + 1] -= weight * right
                    bands[0, k + 1] += weight * right**2
                    bands[1, k] += weight * middle * right
                if 0 < k < n - 1:
                    bands[2, k - 1] += weight * left * right


@inner
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
