"""Smooth a planned motion in time: averages of its speed over cells, joined by quartic B-splines.

S-curves have jumps of jerk, which inverse dynamics cannot lead: b times a jump of jerk is a jump of speed. The mean
speeds of a motion over cells of equal length, as coefficients of a uniform B-spline of degree 4, are the same motion
seen through a window of six cells: it covers the same way in the same time, is never quicker than the quickest or
slower than the slowest of what it averages, and has three derivatives of speed. Where the speed was constant for two
cells at the ends of a stretch nothing changes there. So stretches between profiles, and between rests, are smoothed
each by itself.

Reference: C. de Boor, A Practical Guide to Splines, Springer 1978.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from ph_post.compensate.motion import MotionLaw
from ph_post.types import Array, IntArray, frozen

CELLS: Final = 2
"""Cells of constant speed at either end of a stretch that keep what is beside it as it is."""

_WHOLE: Final = 1e-12
"""Part of a cell that counts as none."""

LEAST: Final = 0.25
"""A stretch whose ends leave room for less than this part of the spacing is left as it is."""

_BERNSTEIN: Final = frozen(
    np.array(
        [
            [1.0, 0.0, 0.0, 0.0, 0.0],
            [11.0, 8.0, 4.0, 2.0, 1.0],
            [11.0, 14.0, 16.0, 14.0, 11.0],
            [1.0, 2.0, 4.0, 8.0, 11.0],
            [0.0, 0.0, 0.0, 0.0, 1.0],
        ]
    )
    / 24.0
)
"""Bernstein coefficients on a cell of the five quartic B-splines that reach it."""


def rest_at_stops(motion: MotionLaw, rest: float, tail: float = 0.0) -> MotionLaw:
    """Let a motion rest where it begins and ends at rest, and twice as long where it stops between two phases.

    Parameters
    ----------
    motion : MotionLaw
    rest : float
        Rest before and behind a motion from rest [s]. Within profiles nothing is inserted.
    tail : float, optional
        Longer rest behind the end [s].

    Returns
    -------
    MotionLaw
    """
    first, last = _ends(motion)
    free = motion.window < 0
    inside = np.flatnonzero(free[1:] & free[:-1] & (first[1:] == 0.0) & (last[:-1] == 0.0)) + 1
    at = np.concatenate([[0] * bool(first[0] == 0.0 and free[0]), inside]).astype(np.int64)
    ends = bool(last[-1] == 0.0 and free[-1])
    duration = np.where(at == 0, rest, 2.0 * rest)
    place = motion.s[at]
    if ends:
        at, duration = np.append(at, motion.s.size), np.append(duration, rest + tail)
        place = np.append(place, motion.place_and_feed(np.array([motion.end]))[0])
    return MotionLaw(
        np.insert(motion.duration, at, duration),
        np.insert(motion.s, at, place),
        [*motion.speeds, np.zeros((1, 1))],
        np.insert(motion.group, at, len(motion.speeds)),
        np.insert(motion.row, at, 0),
        np.insert(motion.window, at, -1),
    )


def smooth_motion(motion: MotionLaw, spacing: float) -> MotionLaw:
    """Smooth the stretches of a motion between profiles and rests.

    Parameters
    ----------
    motion : MotionLaw
    spacing : float
        Longest cells [s].

    Returns
    -------
    MotionLaw
        Over the same way in the same time; profiles are as they were.

    Examples
    --------
    A step of the speed becomes a rise over five cells, and the way stays the same.

    >>> from ph_post.types import Phase
    >>> slow = Phase(start=0.0, duration=1.0, s=0.0, speed=np.array([1.0]))
    >>> fast = Phase(start=1.0, duration=1.0, s=1.0, speed=np.array([2.0]))
    >>> smooth = smooth_motion(MotionLaw.from_phases([slow, fast]), 0.1)
    >>> s, feed = smooth.place_and_feed(np.array([0.7, 1.0, 1.3, 2.0]))
    >>> s.round(3).tolist(), feed.round(3).tolist()
    ([0.7, 1.023, 1.6, 3.0], [1.0, 1.5, 2.0, 2.0])
    """
    stretches = _Stretches(motion, spacing)
    laid = [(first, last, stretches.grids(first, last)) for first, last in stretches.free()]
    places = _places(motion, [grid for _, _, grids in laid for grid in grids])
    found = _Phases(motion)
    begin = 0
    for first, last, grids in laid:
        found.keep(begin, first)
        begin = last
        if grids:
            cells = [grid.cells(next(places)) for grid in grids]
            found.add(*(np.concatenate(parts) for parts in zip(*cells, strict=True)))
        else:
            found.keep(first, last)
    found.keep(begin, motion.s.size)
    return found.motion()


def _ends(motion: MotionLaw) -> tuple[Array, Array]:
    """Speeds at the beginning and at the end of every phase [m/s]."""
    first, last = np.empty(motion.s.size), np.empty(motion.s.size)
    for number, speed in enumerate(motion.speeds):
        mine = motion.group == number
        first[mine], last[mine] = speed[motion.row[mine], 0], speed[motion.row[mine], -1]
    return first, last


Cells = tuple[Array, Array, Array]
"""Durations [s], places [m] and speeds (n, 5) [m/s] in Bernstein form."""


class _Stretches:
    """The stretches of a motion outside profiles, cut in the middle of rests."""

    def __init__(self, motion: MotionLaw, spacing: float) -> None:
        self.motion, self.spacing = motion, spacing
        self.first, self.last = _ends(motion)
        self.end = motion.start + motion.duration
        self.constant = np.zeros(motion.s.size, dtype=np.bool_)
        for number, speed in enumerate(motion.speeds):
            mine = motion.group == number
            self.constant[mine] = np.all(speed == speed[:, :1], axis=1)[motion.row[mine]]

    def free(self) -> list[tuple[int, int]]:
        """Return the phases outside profiles, from the first to behind the last of each stretch."""
        free = np.concatenate([[False], self.motion.window < 0, [False]])
        return [(int(first), int(last)) for first, last in np.flatnonzero(np.diff(free)).reshape(-1, 2)]

    def grids(self, first: int, last: int) -> list[_Grid]:
        """Return the cells between rests of the phases of a stretch; none where it stays as it is."""
        start, end = self.motion.start[first:last], self.end[first:last]
        rests = np.flatnonzero(self.constant[first + 1 : last - 1] & (self.first[first + 1 : last - 1] == 0.0)) + 1
        edges = [float(start[0]), *(0.5 * (start[rests] + end[rests])).tolist(), float(end[-1])]
        bounds = [first, *(rests + first).tolist(), last - 1]
        found: list[_Grid] = []
        for number, (t0, t1) in enumerate(pairwise(edges)):
            one = self._grid(t0, t1, bounds[number], bounds[number + 1] + 1)
            if one is None:
                return []
            found.append(one)
        return found

    def _grid(self, t0: float, t1: float, first: int, last: int) -> _Grid | None:
        """Return cells from t0 to t1 in some phases; None where the speed changes too near to the ends."""
        motion = self.motion
        v0, v1 = float(self.first[first]), float(self.last[last - 1])
        changes = ~self.constant[first:last]
        ahead = np.flatnonzero(changes | (self.first[first:last] != v0))
        if not ahead.size:
            return _Grid(t0, t1, v0, v1, 0)
        behind = np.flatnonzero(changes | (self.last[first:last] != v1))
        calm = float(motion.start[first + ahead[0]]) - t0, t1 - float(self.end[first + behind[-1]])
        longest = min(self.spacing, calm[0] / CELLS, calm[1] / CELLS)
        if longest < LEAST * self.spacing:
            return None
        return _Grid(t0, t1, v0, v1, math.ceil((t1 - t0) / longest * (1.0 - _WHOLE)))


class _Grid(NamedTuple):
    """Cells from `t0` to `t1` [s], with speeds `v0` and `v1` [m/s] there; a constant speed has 0 `parts`."""

    t0: float
    t1: float
    v0: float
    v1: float
    parts: int

    @property
    def edges(self) -> Array:
        """Return the instants between cells [s]."""
        return np.linspace(self.t0, self.t1, self.parts + 1)

    def cells(self, s: Array) -> Cells:
        """Return the cells, by the places of their edges [m]."""
        t0, t1, v0, v1, count = self
        if not count:
            return np.array([t1 - t0]), s, np.full((1, 5), v0)
        width = (t1 - t0) / count
        inner = np.maximum(np.diff(s), 0.0)[CELLS:-CELLS] / width
        mean = np.concatenate([np.full(2 * CELLS, v0), inner, np.full(2 * CELLS, v1)])
        reach = np.lib.stride_tricks.sliding_window_view(mean, 5)
        same = np.all(reach == reach[:, :1], axis=1)
        speeds = np.where(same[:, None], reach[:, :1], reach @ _BERNSTEIN)
        places = s[0] + np.concatenate([[0.0], np.cumsum(speeds.mean(axis=1) * width)[:-1]])
        # Neighbouring cells of one constant speed are one phase.
        kept = np.flatnonzero(np.concatenate([[True], ~(same[1:] & same[:-1])]))
        return np.add.reduceat(np.full(count, width), kept), places[kept], speeds[kept]


def _places(motion: MotionLaw, grids: Sequence[_Grid]) -> Iterator[Array]:
    """Return the places of the edges of cells [m], all looked up at once."""
    edges = [grid.edges for grid in grids]
    if not edges:
        return iter(())
    ends = np.cumsum([one.size for one in edges])
    return iter(np.split(motion.place_and_feed(np.concatenate(edges))[0], ends[:-1]))


class _Phases:
    """Phases of the motion that comes out: kept ones, and new ones of degree 4 and 0."""

    def __init__(self, motion: MotionLaw) -> None:
        self.old = motion
        self.columns: list[tuple[Array, Array, IntArray, IntArray, IntArray]] = []
        self.quartics: list[Array] = []
        self.count = 0

    def keep(self, first: int, last: int) -> None:
        """Keep phases of the old motion."""
        old, part = self.old, slice(first, last)
        self.columns.append((old.duration[part], old.s[part], old.group[part], old.row[part], old.window[part]))

    def add(self, duration: Array, s: Array, speed: Array) -> None:
        """Add cells."""
        same = np.all(speed == speed[:, :1], axis=1)
        group = len(self.old.speeds) + same.astype(np.int64)
        row = self.count + np.arange(s.size)
        self.quartics.append(speed)
        self.count += s.size
        self.columns.append((duration, s, group, row, np.full(s.size, -1)))

    def motion(self) -> MotionLaw:
        """Return all of them as one motion."""
        duration, s, group, row, window = (np.concatenate(parts) for parts in zip(*self.columns, strict=True))
        speed = np.concatenate(self.quartics) if self.quartics else np.zeros((0, 5))
        return MotionLaw(duration, s, [*self.old.speeds, speed, speed[:, :1]], group, row, window)
