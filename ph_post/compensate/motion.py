"""The motion law s(t) of a plan: phases as one function of time, the feed along the path, and exact samples.

Sampling is the exact interpolator: positions on the path at the servo period, from the plan's polynomials.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import Any

import msgspec
import numpy as np

from ph_post.compensate.strategies.registry import PLAIN
from ph_post.compiling import compiled, inner, lean, read_only
from ph_post.geometry.bernstein import integrate
from ph_post.geometry.track import Track
from ph_post.types import Array, Command, IntArray, Phase, Plan, frozen

_WHOLE = 1e-9
"""A duration this part of a period short of a whole number of periods counts as whole."""


STEADY = 0.95
"""Part of the feed at a place down to which the feed around it counts as the same."""


class MotionLaw:
    """Arc length and speed as functions of time.

    Parameters
    ----------
    duration, s : Array, shape (m,)
        Duration [s] of the phases, one after the other, and arc length [m] at their beginning.
    speeds : sequence of Array
        Groups of phases of one degree n: Bernstein coefficients of the speed [m/s], shape (k, n + 1).
    group, row : IntArray, shape (m,)
        Group of every phase, and its row there.
    window : IntArray, shape (m,)
        Index of the window that a phase modulates, -1 elsewhere.
    """

    def __init__(
        self,
        duration: Array,
        s: Array,
        speeds: Sequence[Array],
        group: IntArray,
        row: IntArray,
        window: IntArray,
    ) -> None:
        self.duration, self.s, self.window = duration, s, window
        ends = np.cumsum(duration)
        self.start = np.concatenate([[0.0], ends[:-1]])
        self.end = float(ends[-1])
        self.speeds = tuple(speeds)
        self.group, self.row = group, row
        self._ways = [integrate(one) for one in speeds]
        degree = np.array([one.shape[1] - 1 for one in speeds])
        self._choose, self._degree = _binomials(int(degree.max()) + 1), degree[group]
        self._tables = _flattened(speeds, group, row), _flattened(self._ways, group, row)
        self._columns = read_only(self.start), read_only(duration), read_only(s)

    @classmethod
    def from_phases(cls, phases: Sequence[Phase]) -> MotionLaw:
        """Gather phases by degree."""
        sizes = np.array([phase.speed.size for phase in phases])
        kinds, group = np.unique(sizes, return_inverse=True)
        row = np.zeros(sizes.size, dtype=np.int64)
        speeds = []
        for number in range(kinds.size):
            members = np.flatnonzero(group == number)
            row[members] = np.arange(members.size)
            speeds.append(np.array([phases[k].speed for k in members.tolist()]))
        duration, s = np.array([(phase.duration, phase.s) for phase in phases]).T
        return cls(duration, s, speeds, group, row, np.array([phase.window for phase in phases]))

    def phases(self) -> tuple[Phase, ...]:
        """Return the phases as records."""
        tables = [frozen(one) for one in self.speeds]
        columns = (self.start, self.duration, self.s, self.group, self.row, self.window)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return tuple(
            Phase(start=start, duration=duration, s=s, speed=tables[group][row], window=window)
            for start, duration, s, group, row, window in rows
        )

    @property
    def ends_at_rest(self) -> bool:
        """Return whether the speed is zero at the end."""
        return float(self.speeds[self.group[-1]][self.row[-1], -1]) == 0.0

    @property
    def begins_at_rest(self) -> bool:
        """Return whether the speed is zero at the beginning."""
        return float(self.speeds[self.group[0]][self.row[0], 0]) == 0.0

    def phase_at(self, t: Array) -> IntArray:
        """Return the number of the phase at every instant: at a boundary the later one, at last the last."""
        return np.clip(np.searchsorted(self.start, t, side="right") - 1, 0, self.start.size - 1)

    def place_and_feed(self, t: Array) -> tuple[Array, Array]:
        """Arc length [m] and speed [m/s] at `t` [s]; before the start and after the end what holds there."""
        speed, way = self._tables
        s, feed = np.empty(np.size(t)), np.empty(np.size(t))
        _place_and_feed(read_only(t), *self._columns, self._choose, self._degree, *speed, *way, s, feed)
        return s, feed

    def place_at(self, t: float) -> float:
        """Arc length [m] at one instant [s], as :meth:`place_and_feed` has it, for searches that ask many times."""
        phase = max(bisect_right(self._starts, t) - 1, 0)
        duration, s, way = self._places[phase]
        tau = min(max((t - self._starts[phase]) / duration, 0.0), 1.0)
        return _evaluate_one(way, tau) * duration + s

    @cached_property
    def _starts(self) -> list[float]:
        starts: list[float] = self.start.tolist()
        return starts

    @cached_property
    def _places(self) -> list[tuple[float, float, list[float]]]:
        """Duration, arc length at the beginning, and coefficients of the way, of every phase."""
        ways = [one.tolist() for one in self._ways]
        columns = (self.duration, self.s, self.group, self.row)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return [(duration, s, ways[group][row]) for duration, s, group, row in rows]

    def acceleration(self, t: Array) -> Array:
        """Rate of change of the speed [m/s²] at `t` [s]; at a boundary the later phase's."""
        rate = np.empty(np.size(t))
        _acceleration(read_only(t), *self._columns[:2], self._choose, self._degree, *self._tables[0], rate)
        return rate


def row_times(motion: MotionLaw, period: float) -> Array:
    """Instants of samples [s]: multiples of the period up to the end, or just beyond an end at rest."""
    periods = motion.end / period
    rows = math.ceil(periods - _WHOLE) if motion.ends_at_rest else math.floor(periods + _WHOLE)
    times: Array = np.arange(max(rows, 0) + 1, dtype=np.float64) * period
    return times


def _flattened(tables: Sequence[Array], group: IntArray, row: IntArray) -> tuple[IntArray, Array]:
    """Where the coefficients of every phase begin, and the coefficients one after the other."""
    begin = np.cumsum([0, *(one.size for one in tables)])
    width = np.array([one.shape[1] for one in tables])
    return begin[group] + width[group] * row, read_only(np.concatenate([one.ravel() for one in tables]))


@lru_cache(maxsize=64)
def _binomials(n: int) -> Array:
    """Binomial coefficients (n + 1, n + 1)."""
    return frozen([[math.comb(row, k) for k in range(n + 1)] for row in range(n + 1)])


@inner
def _phase_at(start: Any, t: Any, near: Any) -> Any:
    """Return the number of the phase at an instant: at a boundary the later one. It may be near, or one further."""
    for phase in range(near, min(near + 2, start.size)):
        if start[phase] <= t and (phase + 1 == start.size or t < start[phase + 1]):
            return phase
    return max(np.searchsorted(start, t, side="right") - 1, 0)


@lean
def _within(t: Any, start: Any, duration: Any) -> Any:
    """Return the part of a phase at an instant, from 0 to 1."""
    tau = (t - start) / duration
    return 0.0 if tau < 0.0 else (1.0 if tau > 1.0 else tau)


@lean
def _fill(powers: Any, tau: Any, most: Any) -> None:
    """Put in the powers of τ and of 1 - τ, from 0 to the highest that is wanted."""
    powers[:, 0] = 1.0
    for k in range(most):
        powers[0, k + 1] = powers[0, k] * tau
        powers[1, k + 1] = powers[1, k] * (1.0 - tau)


@lean
def _bernstein(n: Any, coefficients: Any, first: Any, powers: Any, choose: Any) -> Any:
    """Return a Bernstein polynomial of degree n by its coefficients, which begin at `first`."""
    value = 0.0
    for k in range(n + 1):
        value += choose[n, k] * powers[0, k] * powers[1, n - k] * coefficients[first + k]
    return value


@compiled
def _place_and_feed(
    t: Any,
    start: Any,
    duration: Any,
    begin: Any,
    choose: Any,
    degree: Any,
    speed_at: Any,
    speed: Any,
    way_at: Any,
    way: Any,
    s: Any,
    feed: Any,
) -> None:
    """Put in arc lengths `s` (n,) and speeds `feed` (n,) at instants `t` (n,), see :class:`MotionLaw`."""
    powers, phase = np.empty(choose.shape), 0
    for i in range(t.size):
        phase = _phase_at(start, t[i], phase)
        n = degree[phase]
        _fill(powers, _within(t[i], start[phase], duration[phase]), n + 1)
        feed[i] = _bernstein(n, speed, speed_at[phase], powers, choose)
        s[i] = _bernstein(n + 1, way, way_at[phase], powers, choose) * duration[phase] + begin[phase]


@compiled
def _acceleration(
    t: Any, start: Any, duration: Any, choose: Any, degree: Any, speed_at: Any, speed: Any, rate: Any
) -> None:
    """Put in the rates of change of the speed (n,) at instants `t` (n,), see :class:`MotionLaw`."""
    powers, slopes, phase = np.empty(choose.shape), np.empty(len(choose)), 0
    for i in range(t.size):
        phase = _phase_at(start, t[i], phase)
        n, first = degree[phase], speed_at[phase]
        for k in range(n):
            slopes[k] = n * (speed[first + k + 1] - speed[first + k])
        _fill(powers, _within(t[i], start[phase], duration[phase]), n)
        rate[i] = _bernstein(n - 1, slopes, 0, powers, choose) / duration[phase]


def _evaluate_one(coefficients: Sequence[float], tau: float) -> float:
    """One Bernstein polynomial at one place, rounded as by :func:`_bernstein`."""
    n = len(coefficients) - 1
    up, down = [1.0], [1.0]
    for _ in range(n):
        up.append(up[-1] * tau)
        down.append(down[-1] * (1.0 - tau))
    value = 0.0
    for k, coefficient in enumerate(coefficients):
        value += math.comb(n, k) * up[k] * down[n - k] * coefficient
    return value


class FeedAlong:
    """Feed of the plain plan as function of arc length, read off samples of its motion.

    Parameters
    ----------
    motion : MotionLaw
    period : float
        Sampling period [s].
    length : float
        Length of the path [m].
    looped : bool
        Whether the motion runs through the seam of a closed path, so that the feed repeats.
    """

    def __init__(self, motion: MotionLaw, period: float, length: float, looped: bool) -> None:
        edges = np.concatenate([motion.start, [motion.end]])
        t = np.unique(np.concatenate([np.arange(0.0, motion.end, period), edges]))
        s, feed = motion.place_and_feed(t)
        if looped:
            s, feed = np.concatenate([s - length, s, s + length]), np.tile(feed, 3)
        self.s, self.feed = np.maximum.accumulate(s), feed
        self.first, self.last = float(self.s[0]), float(self.s[-1])

    def at(self, s: float) -> float:
        """Feed at `s` [m/s]."""
        return float(np.interp(s, self.s, self.feed))

    def lowest(self, s: float, half: float) -> float:
        """Lowest feed on [s - half, s + half] [m/s]."""
        i, j = np.searchsorted(self.s, [s - half, s + half])
        inside = self.feed[i:j]
        ends = min(self.at(s - half), self.at(s + half))
        return min(ends, float(inside.min())) if inside.size else ends

    def steady_sides(self, s: float, reach: float, least: float) -> tuple[float, float]:
        """Distances before and behind `s`, up to `reach`, on which the feed is at least `least` [m]."""
        i, centre, j = np.searchsorted(self.s, [s - reach, s, s + reach])
        before = np.flatnonzero(self.feed[i:centre] < least)
        after = np.flatnonzero(self.feed[centre:j] < least)
        ahead = s - float(self.s[i + before[-1] + 1]) if before.size else reach
        behind = float(self.s[centre + after[0] - 1]) - s if after.size else reach
        return max(min(ahead, s - self.first), 0.0), max(min(behind, self.last - s), 0.0)

    def steady_half(self, s: float, half: float, least: float) -> float:
        """Largest part of `half` for which the feed is at least `least` on [s - half, s + half]."""
        return min(self.steady_sides(s, half, least))


def sample(plan: Plan, track: Track, period: float) -> Command:
    """Sample a plan, one row a servo period from t = 0.

    Arc length and feed come from the plan's polynomials and the position from the path at that arc length, so
    that no error adds up from row to row. A plan that ends at rest gets as many rows as bring it to its end:
    what is left of the last period is spent at rest there. One that ends moving ends with its last whole
    period, so that every row is a place the tool runs through at its feed.

    Parameters
    ----------
    plan : Plan
    track : Track
        Of the plan's path.
    period : float
        Servo period [s].

    Returns
    -------
    Command
    """
    motion = MotionLaw.from_phases(plan.phases)
    t = row_times(motion, period)
    s, feed = motion.place_and_feed(t)
    window = motion.window[motion.phase_at(t)]
    if motion.ends_at_rest:
        s[-1] = track.length
        window[-1] = -1
    piece, u = track.locate(s)
    segment, xi = track.to_xi(piece, u)
    return Command(
        axes=plan.path.axes,
        period=period,
        t=t,
        segment=segment,
        xi=xi,
        s=s,
        position=track.derivatives(piece, u, 0)[0],
        feed=feed,
        window=window,
        flanks=plan.flanks,
    )


def place_and_feed(phases: Sequence[Phase], t: Array) -> tuple[Array, Array]:
    """Arc length [m] and feed [m/s] of a plan's phases at any instants `t` [s]."""
    return MotionLaw.from_phases(phases).place_and_feed(t)


def cycle_time(phases: Sequence[Phase]) -> float:
    """Duration of phases that follow each other [s]."""
    return phases[-1].start + phases[-1].duration if phases else 0.0


def without_strategy(plan: Plan) -> Plan:
    """Return the plan as it would be without any strategy."""
    return msgspec.structs.replace(
        plan,
        strategy=PLAIN,
        profiles=(None,) * len(plan.profiles),
        phases=plan.nominal,
        crossings=(),
        bias={},
        inverse_dynamics=False,
        friction_part=0.0,
        friction=(),
        warnings=(),
    )
