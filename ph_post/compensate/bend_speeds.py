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

from typing import Final

import msgspec
import numpy as np
from scipy.linalg import LinAlgError, solveh_banded

from ph_post.types import Array, BoolArray

FIRST: Final = 1e-2
"""Weight of the barrier to begin with, over the time's."""

LAST: Final = 1e-7
"""Weight of the barrier at last: some thousand limits are then kept for 1e-4 of the time."""

LESS: Final = 0.2
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
        self._ends = v[0] ** 2, v[-1] ** 2
        first, second = _differences(limits.s, bool(v[0] == 0.0), bool(v[-1] == 0.0))
        (r1, r2, r3), values = limits.jet[:, 1:-1], limits.values[:, 1:-1]
        middle = np.array([0.0, 1.0, 0.0])[:, None, None]
        along, bend = first[:, :, None], second[:, :, None]
        rows = np.stack([*self._accelerations(limits.jet), middle * r3 + 1.5 * along * r2 + 0.5 * bend * r1])
        self._rows = np.concatenate([rows, -rows])
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
        known = np.concatenate([[self._ends[0]], b, [self._ends[1]]])
        rows: Array = self._rows[:, 0] * known[:-2, None] + self._rows[:, 1] * known[1:-1, None]
        rows += self._rows[:, 2] * known[2:, None]
        return np.where(self._is_jerk, rows * np.sqrt(b)[:, None], rows)

    def descend(self, b: Array, room: Array, weight: float, steps: int) -> Array:
        """Minimise the logarithm of the time and the barrier before limits of such room by some of Newton's steps."""
        value = self._value(b, room, weight)
        for _ in range(steps):
            slope, matrix = self._model(b, room, weight)
            try:
                step = solveh_banded(matrix, -slope)
            except LinAlgError:
                break
            gain = float(slope @ step)
            if not gain < -DONE * weight * room.size:
                break
            part = 1.0
            for _ in range(40):
                tried = b + part * step
                new = self._value(tried, room, weight) if tried.min() > 0.0 else np.inf
                if new <= value + 0.1 * part * gain:
                    b, value = tried, new
                    break
                part *= 0.5
            else:
                break
        return b

    def _slack(self, b: Array, room: Array) -> Array:
        return 1.0 - self.used(b) / room

    def _value(self, b: Array, room: Array, weight: float) -> float:
        slack, below = self._slack(b, room), 1.0 - b / self.highest
        if slack.min() <= 0.0 or below.min() <= 0.0:
            return np.inf
        barrier = np.log(slack).sum() + np.log(below).sum()
        return float(np.log(self._times(b).sum()) - weight * barrier)

    def _times(self, b: Array) -> Array:
        """Return times of cells with speeds linear in time; beside a rest they go with the way to the power 2/3."""
        v = np.sqrt(np.concatenate([[self._ends[0]], b, [self._ends[1]]]))
        share = np.where((v[:-1] == 0.0) | (v[1:] == 0.0), 3.0, 2.0)
        times: Array = share * self._width / (v[:-1] + v[1:])
        return times

    def _model(self, b: Array, room: Array, weight: float) -> tuple[Array, Array]:
        """Slope (n,) and upper bands (3, n) of a positive matrix in place of the curvature."""
        v = np.sqrt(np.concatenate([[self._ends[0]], b, [self._ends[1]]]))
        times, total = self._times(b), v[:-1] + v[1:]
        whole = times.sum()
        rate = 0.5 / np.sqrt(b)
        by_v = -times / total / whole
        slope = rate * (by_v[:-1] + by_v[1:])
        bands = np.zeros((3, b.size))
        again = 2.0 * times / total**2 / whole
        bands[2] = rate**2 * (again[:-1] + again[1:]) - 0.5 * rate / b * (by_v[:-1] + by_v[1:])
        bands[1, 1:] = rate[:-1] * rate[1:] * again[1:-1]
        slack = self._slack(b, room)
        # Slopes of the slack by b at the place before, at it and behind it.
        scale = np.where(self._is_jerk, np.sqrt(b)[:, None], 1.0) / room
        d = -self._rows * scale[:, None]
        d[:, 1] -= np.where(self._is_jerk, 0.5 * self.used(b) / b[:, None] / room, 0.0)
        d = d / slack[:, None]
        d = np.moveaxis(d, 1, 0).transpose(0, 2, 1, 3).reshape(3, b.size, -1)
        sums = -weight * d.sum(axis=2)
        slope += sums[1]
        slope[:-1] += sums[0, 1:]
        slope[1:] += sums[2, :-1]
        bands[2] += weight * (d[1] ** 2).sum(axis=1)
        bands[2, :-1] += weight * (d[0, 1:] ** 2).sum(axis=1)
        bands[2, 1:] += weight * (d[2, :-1] ** 2).sum(axis=1)
        bands[1, 1:] += weight * ((d[0, 1:] * d[1, 1:]).sum(axis=1) + (d[1, :-1] * d[2, :-1]).sum(axis=1))
        bands[0, 2:] += weight * (d[0, 1:-1] * d[2, 1:-1]).sum(axis=1)
        below = self.highest - b
        slope += weight / below
        bands[2] += weight / below**2
        return slope, bands


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
