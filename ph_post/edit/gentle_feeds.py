"""Pass tight arcs, and come to stops, so slowly that friction holds tables that would run on in their backlash.

Across an arc of radius R at the feed v an axis brakes with v²/R. Where that is more than a, by which friction brakes
its table, this leaves the side on which it was pushed before the axis turns back. So the feed is at most √(0.75 a R).
At a stop a table that comes with v runs on by v²/2a, which is to be a part of the backlash g. As the feed falls ahead
of that a table flies to the other side, g ahead along the path, and comes back in √(2 g/a): so long is the lead, and
as long as its motor lags.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from itertools import pairwise
from operator import itemgetter
from typing import Final, NamedTuple

import numpy as np

from ph_post.compensate.friction import braked
from ph_post.dialects.base import Dialect
from ph_post.drive.cascade import response_time
from ph_post.edit.cutter_contours import path_turn, tangent_of
from ph_post.edit.edits import DipEdit
from ph_post.edit.preconditions import why_indivisible, why_kept_whole
from ph_post.gcode.motion_parts import part_length
from ph_post.gcode.program import ARC, AXES, LINE, RAPID, PartProgram
from ph_post.gcode.working import working_motions
from ph_post.types import Array, Machine, RoundedPath
from ph_post.units import MM

HELD: Final = 0.75
"""Part of the deceleration by friction with which an axis brakes: it may be a fifth less than the file says."""

RUN_ON: Final = 0.2
"""Part of its backlash by which a table may run on at a stop: it is in its cut, and slower ones take long."""

BACK: Final = 1.5
"""Times for which a table needs to come back across its backlash that it is given."""

SETTLED: Final = 2.0
"""Times the lag of its motor that an axis is given at a stop, so that it does not overshoot."""

CORNER: Final = 0.3
"""Angle [rad] from which on a corner stops an axis."""

MOVES: Final = 0.1
"""Part of the way that an axis has where it comes to a stop."""

TWICE: Final = 2.0
"""Times the slow part of an arc that is passed slowly, in two pieces, where the controller rounds joints.

Rounded centres leave a joint that is hardly one. LinuxCNC blends it at the greater feed, and the first piece with it.
"""

LEFT: Final = 0.2 * MM
"""Shortest part of a motion that keeps its feed [m]."""


class GentleFeeds(NamedTuple):
    """Feed dips where tables would run on, and the time [s] that each takes.

    `feed` is that of every arc (m,) that is passed slowly as a whole [m/s], infinite for all other motions.
    """

    dips: tuple[DipEdit, ...]
    times: tuple[float, ...]
    feed: Array

    def within(self, most: float, of: Callable[[int], int | None]) -> GentleFeeds:
        """Return those in sections that together take no more than a time [s], the quickest sections first.

        Parameters
        ----------
        most : float
        of : callable
            The section of a motion, None where nothing is to be changed.
        """
        sections = [of(int(one.motion[-1])) for one in self.dips]
        costs: dict[int, float] = {}
        for section, time in zip(sections, self.times, strict=True):
            if section is not None:
                costs[section] = costs.get(section, 0.0) + time
        kept, spent = set(), 0.0
        for section, cost in sorted(costs.items(), key=itemgetter(1)):
            spent += cost
            if spent <= most:
                kept.add(section)
        rows = [number for number, section in enumerate(sections) if section in kept]
        dips = tuple(self.dips[number] for number in rows)
        if not dips:
            return GentleFeeds((), (), _no_feed(self.feed.size))
        slow = np.concatenate([[-1], *(one.motion for one in dips)])
        feed = np.where(np.isin(np.arange(self.feed.size), slow), self.feed, math.inf)
        return GentleFeeds(dips, tuple(self.times[number] for number in rows), feed)


def _no_feed(count: int) -> Array:
    """Return the feed of so many motions of which none is passed slowly, in the memory of one number."""
    return np.broadcast_to(math.inf, (count,))


def gentle_feeds(program: PartProgram, machine: Machine, dialect: Dialect, axes: Collection[str]) -> GentleFeeds:
    """Find where axes that are shifted brake harder than their friction, on arcs and at stops.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    dialect : Dialect
    axes : collection of str
        Those that are shifted.

    Returns
    -------
    GentleFeeds
        Without any where tables do not run on, and for beams and beads, which no feed may change.
    """
    return _Finder(program, machine, dialect, axes).found()


class _Finder:
    def __init__(self, program: PartProgram, machine: Machine, dialect: Dialect, axes: Collection[str]) -> None:
        self._program, self._machine, self._dialect = program, machine, dialect
        self._slows = {AXES.index(name): braked(machine.axes[name]) for name in axes if name != "Z"}
        self._slows = {column: slows for column, slows in self._slows.items() if math.isfinite(slows)}
        self._gap = max((machine.axes[AXES[column]].gap.lost_motion for column in self._slows), default=0.0)
        self._caps: dict[int, list[tuple[float, float]]] = {}
        motions = program.motions
        self._blends = isinstance(dialect.planner, RoundedPath)
        modes = np.array([modal.feed_mode == 94 for modal in program.modal], dtype=np.bool_)
        usual = (motions.feed > 0.0) & ~(motions.duration > 0.0) & (motions.exact == 0)
        self._usual = usual & modes[program.state[motions.block]] & np.isin(motions.kind, (LINE, ARC))

    def found(self) -> GentleFeeds:
        """Return all dips."""
        motions = self._program.motions
        if not self._slows or working_motions(self._program, self._machine.tool).tool != "cutter":
            return GentleFeeds((), (), _no_feed(motions.kind.size))
        feed = np.full(motions.kind.size, math.inf)
        slows = min(self._slows.values())
        back = BACK * math.sqrt(2.0 * self._gap / slows)
        late = max(response_time(self._machine.axes[AXES[column]].servo) for column in self._slows)
        # In the plane of X and Y alone: a helix is one, an arc in another plane not.
        flat = (motions.kind == ARC) & (motions.plane == 17) & self._usual
        for arc in np.flatnonzero(flat).tolist():
            speed = math.sqrt(HELD * slows * float(np.hypot(*(motions.start[arc, :2] - motions.center[arc]))))
            if speed < motions.feeds.at(arc) and not why_kept_whole(self._program, arc):
                feed[arc] = speed
        for arc in np.flatnonzero(np.isfinite(feed)).tolist():
            speed, full = float(feed[arc]), motions.feeds.at(arc)
            self._cap(arc, 0.0, speed)
            self._lead(arc - 1, arc, speed * (back + late) + self._gap * full / (full - speed), speed)
        speed = math.sqrt(2.0 * RUN_ON * self._gap * slows)
        for motion in np.flatnonzero(self._usual).tolist():
            if self._stops(motion):
                self._lead(motion, motion, self._gap + speed * (back + SETTLED * late), speed)
        return GentleFeeds(*self._dips(), feed)

    def _stops(self, motion: int) -> bool:
        """Return whether an axis comes to a stop at the end of a motion."""
        motions, behind = self._program.motions, motion + 1
        if not any(abs(tangent_of(motions, motion, last=True)[column]) > MOVES for column in self._slows):
            return False
        ends = behind == motions.kind.size or motions.kind[behind] == RAPID
        ends = ends or motions.chain[behind] != motions.chain[motion]
        return bool(ends or abs(path_turn(motions, motion, behind)) > CORNER)

    def _cap(self, motion: int, share: float, speed: float) -> None:
        self._caps.setdefault(motion, []).append((share, speed))

    def _lead(self, motion: int, last: int, need: float, speed: float) -> None:
        """Bound the speed on a way before the end of a motion, over joints as far as feeds may be changed there."""
        motions = self._program.motions
        while need > 0.0 and motion >= 0 and self._usual[motion] and motions.chain[motion] == motions.chain[last]:
            length = part_length(motions, motion, 0.0, 1.0)
            share = 1.0 - need / length if need < length - LEFT else 0.0
            share = 0.0 if share and why_indivisible(self._program, self._dialect, motion, share) else share
            if why_kept_whole(self._program, motion) or length == 0.0:
                return
            self._cap(motion, share, speed)
            before = 1.0 - TWICE * need / length
            if self._blends and motions.kind[motion] == ARC and before * length > LEFT:
                self._cap(motion, before, speed)
            need -= (1.0 - share) * length
            motion -= 1

    def _dips(self) -> tuple[tuple[DipEdit, ...], tuple[float, ...]]:
        """Return the dips, and the time that each takes [s]."""
        dips: list[list[tuple[int, float, float]]] = []
        times: list[float] = []
        for motion, low, high, speed in self._pieces():
            length = part_length(self._program.motions, motion, low, high)
            last = dips[-1][-1] if dips else (-1, 0.0, 0.0)
            if last[:2] not in ((motion, low), (motion - 1, low + 1.0)):
                dips.append([(motion, low, 0.0)])
                times.append(0.0)
            dips[-1].append((motion, high, length / speed))
            times[-1] += length * (1.0 / speed - 1.0 / self._program.motions.feeds.at(motion))
        return tuple(_dip(one) for one in dips), tuple(times)

    def _pieces(self) -> Iterator[tuple[int, float, float, float]]:
        """Yield parts of motions with their speeds [m/s]: of several the least."""
        for motion, caps in sorted(self._caps.items()):
            for low, high in pairwise(sorted({1.0, *(share for share, _ in caps)})):
                speed = min(one for share, one in caps if share <= low)
                if speed < self._program.motions.feeds.at(motion):
                    yield motion, low, high, speed


def _dip(ends: list[tuple[int, float, float]]) -> DipEdit:
    motion, share, duration = (np.array(column) for column in zip(*ends, strict=True))
    return DipEdit(motion=motion, share=share, duration=duration[1:], lasting=True)
