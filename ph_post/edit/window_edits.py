"""Turn the stops and dips of one plan into edits at the motions of its program."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import msgspec
import numpy as np

from ph_post.compensate.motion import MotionLaw
from ph_post.edit.edits import DipEdit, OffsetShift, StopEdit
from ph_post.gcode.paths import ProgramPath
from ph_post.gcode.program import AXES, LINE, NURBS, RAPID, Motions
from ph_post.post.moves import read_jogs
from ph_post.post.timeline import Span, find_spans, sign_changes
from ph_post.types import Array, Jog, Plan

BISECTIONS = 60
"""Halvings of a stretch of time, down to the precision of a double."""


class UnchangedWindow(msgspec.Struct, frozen=True, kw_only=True):
    """A window that stays unchanged: its number, its motion, and the reason."""

    window: int
    motion: int
    why: str


class PlacedEdits(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Stops and dips in order of travel, and windows that stay unchanged."""

    stops: tuple[StopEdit, ...]
    dips: tuple[DipEdit, ...]
    left: tuple[UnchangedWindow, ...]


def place_plan(
    motions: Motions, path: ProgramPath, plan: Plan, block_time: float, bound: Callable[[int], str]
) -> PlacedEdits:
    """Turn the windows of a plan into stops and dips on the motions of the program.

    Parameters
    ----------
    motions : Motions
    path : ProgramPath
        The path that was planned.
    plan : Plan
        Made for a program, without offsets.
    block_time : float
        Longest block of a dip [s].
    bound : callable
        ``bound(motion)``: the reason why the line of a motion is not divided, empty where it is.
    """
    return _PlanPlacer(motions, path, plan, block_time, bound).found()


class _PlanPlacer:
    """Places the windows of one plan on the motions of its program."""

    def __init__(
        self, motions: Motions, path: ProgramPath, plan: Plan, block_time: float, bound: Callable[[int], str]
    ) -> None:
        self.bound = bound
        self.motions, self.path, self.plan, self.block_time = motions, path, plan, block_time
        read = read_jogs(plan)
        self.jogs, self.phases = read.jogs, read.phases
        self.motion = MotionLaw.from_phases(read.phases)
        self.stops: list[StopEdit] = []
        self.dips: list[DipEdit] = []
        self.left: list[UnchangedWindow] = []

    def found(self) -> PlacedEdits:
        """Go through the rests of the plan, and then through the windows that have none."""
        rested = set()
        for span in find_spans(self.phases):
            own = [jog for jog in self.jogs if span.start <= jog.start and jog.end <= span.end]
            if span.kind == "dwell" and (own or span.window >= 0):
                windows = {jog.window for jog in own if jog.window >= 0} or {span.window}
                rested |= windows
                self._stop(span, own, min(windows))
        for number in sorted({phase.window for phase in self.phases} - rested - {-1}):
            self._dip(number)
        return PlacedEdits(stops=tuple(self.stops), dips=tuple(self.dips), left=tuple(self.left))

    def _leave(self, window: int, motion: int, why: str) -> None:
        self.left.append(UnchangedWindow(window=window, motion=motion, why=why))

    def _stop(self, span: Span, jogs: Sequence[Jog], window: int) -> None:
        """Add a stop at a place, with the axes shifted by the plan's jogs."""
        motion, share = self._place(span.s0, window)
        inside = 0.0 < share < 1.0
        if inside and (why := self.bound(motion)):
            self._leave(window, motion, f"it would stop inside a line that {why}")
            return
        if inside and self.motions.kind[motion] in (RAPID, NURBS):
            what = "a rapid" if self.motions.kind[motion] == RAPID else "a NURBS, which cannot be divided"
            self._leave(window, motion, f"it would stop inside {what}")
            return
        times = [*(jog.start for jog in jogs), span.end]
        shifts = tuple(
            OffsetShift(axis=jog.axis, travel=jog.travel, velocity=jog.velocity, pause=after - jog.end)
            for jog, after in zip(jogs, times[1:], strict=True)
        )
        self.stops.append(StopEdit(motion=motion, share=share, pause=times[0] - span.start, shifts=shifts))

    def _place(self, s: float, window: int) -> tuple[int, float]:
        """Return the motion and the share at which to stop.

        On moves that were fitted, the turning point of the curve lies between two ends of moves; the programmed
        axis turns at the farther of the two.
        """
        motions, shares = self.path.to_motions(np.array([s]))
        motion, share = int(motions[0]), float(shares[0])
        if self.motions.kind[motion] != LINE or share == 1.0 or window < 0:
            return motion, share
        point = self.plan.turning_points[self.plan.windows[window].turning_point]
        axis = AXES.index(point.axis)
        first, last = self.motions.start[motion, axis], self.motions.end[motion, axis]
        higher = last > first if first != last else share >= 0.5
        if higher == (point.sense == "max") or motion == self.path.motion[0]:
            return motion, 1.0
        return int(self.path.motion[np.searchsorted(self.path.motion, motion) - 1]), 1.0

    def _dip(self, window: int) -> None:
        """Cut the motions of a window into blocks of the times that the plan has for them."""
        rows = np.flatnonzero(self.motion.window == window)
        first, last = int(rows[0]), int(rows[-1])
        start, end = (
            float(self.motion.start[first]),
            float(self.motion.start[last] + self.motion.duration[last]),
        )
        if any(sign_changes(phase.speed) for phase in self.phases[first : last + 1]):
            where, _ = self._place(float(self.motion.s[first]), -1)
            self._leave(window, where, "the tool would move back on its path, which a feed dip cannot do")
            return
        times, s = self._cut(start, end)
        motion, share = self.path.to_motions(s)
        if times.size < 2:
            self._leave(window, int(motion[0]), "the dip would be shorter than a block")
            return
        touched = self.motions.kind[motion[0] : motion[-1] + 1]
        for kind, what in ((RAPID, "a rapid"), (NURBS, "a NURBS, which cannot be divided")):
            if (touched == kind).any():
                self._leave(window, int(motion[0]), f"it would change the feed of {what}")
                return
        for one in range(int(motion[0]), int(motion[-1]) + 1):
            if why := self.bound(one):
                self._leave(window, one, f"it would change the feed of a line that {why}")
                return
        self.dips.append(DipEdit(motion=motion, share=share, duration=np.diff(times)))

    def _cut(self, start: float, end: float) -> tuple[Array, Array]:
        """Return times and places [m] of the ends of blocks: ends of motions, and equal times between them.

        The ends of a dip and its middle, which ends a block as well, go to an end of a motion that is passed
        within half a block of them: so neither a dip nor the rest of a motion begins with a very short block.
        Where both ends go to the same place, that alone is returned.
        """
        slack = 0.5 * self.block_time
        low, high = max(start - slack, 0.0), min(end + slack, self.motion.end)
        near = self.motion.place_and_feed(np.array([low, high]))[0]
        inside = self.path.s[(self.path.s > near[0]) & (self.path.s < near[1])]
        joints = self._times(inside, low, high)
        ends = [_nearest(joints, one, slack) for one in (start, end)]
        between = joints[(joints > ends[0]) & (joints < ends[1])]
        knots = np.concatenate([ends[:1], between, ends[1:]])
        middle = _nearest(knots, 0.5 * (start + end), slack)
        knots = np.unique(np.append(knots, middle))
        counts = [max(1, int(np.ceil((b - a) / self.block_time * (1.0 - 1e-9)))) for a, b in pairwise(knots)]
        parts = [
            np.linspace(a, b, count, endpoint=False) for (a, b), count in zip(pairwise(knots), counts, strict=True)
        ]
        times = np.concatenate([*parts, knots[-1:]])
        s = self.motion.place_and_feed(times)[0]
        # an end of a motion that was found by its time is that end
        kept = np.isin(joints, times)
        s[np.searchsorted(times, joints[kept])] = inside[kept]
        return times, s

    def _times(self, s: Array, low: float, high: float) -> Array:
        """Return the times at which places [m] are passed between two times [s], by bisection."""
        before, after = np.full(s.size, low), np.full(s.size, high)
        for _ in range(BISECTIONS):
            middle = 0.5 * (before + after)
            early = self.motion.place_and_feed(middle)[0] < s
            before, after = np.where(early, middle, before), np.where(early, after, middle)
        return np.asarray(after)


def _nearest(knots: Array, t: float, within: float) -> float:
    """Return the time nearest to `t`, or `t` itself where none is near enough."""
    if not knots.size:
        return t
    best = float(knots[np.argmin(np.abs(knots - t))])
    return best if abs(best - t) <= within else t
