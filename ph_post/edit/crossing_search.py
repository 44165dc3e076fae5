"""Choose how each reversal of a program is crossed, at which cost in time, and plan it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.compensate.friction import gentlest_approach
from ph_post.compensate.offsets import make_jog
from ph_post.drive.cascade import response_time
from ph_post.edit.crossing_costs import CrossingCosts
from ph_post.edit.crossing_ground import APPROACH, CrossingGround, Spots
from ph_post.edit.crossing_spots import SpotSearch
from ph_post.edit.crossings import CrossingPlace, CrossingPlanner, shortest_block
from ph_post.edit.edits import CrossingEdit, OffsetShift, StopEdit, join_stops
from ph_post.edit.positions import Restart
from ph_post.edit.reversals import (
    BEYOND,
    CARRIED,
    CHAIN,
    MOTION,
    SAME,
    SHARE,
    SIGN,
)
from ph_post.gcode.program import AXES
from ph_post.types import Array, Axis, ExactPath, IntArray, unwritten


class PlannedChanges(NamedTuple):
    """How all changes of a program are made: `stops` are shifts that are moves of their own.

    `approaches` are the largest ways [m] from beyond which axes come; `offset` those at the ends of the motions, (m, 3)
    [m]; `burnt` the motions at whose place a shift would have the beam burn a dot.
    """

    crossings: tuple[CrossingEdit, ...]
    stops: tuple[StopEdit, ...]
    approaches: dict[str, float]
    offset: Array
    burnt: tuple[int, ...]


class _Moves(NamedTuple):
    """Moves of an axis alone: their `ways` [m], and the times [s] `ahead`, `between` two of them, and `behind`."""

    ways: list[float]
    ahead: float
    between: float
    behind: float


class CrossingSearch:
    """Finds the crossings of a program's reversals; keeps what all searches share.

    Parameters
    ----------
    ground : CrossingGround
    whole : IntArray, shape (c,)
        First motion of what is shifted by itself: chains and their parts. Restarts name it.
    restarts : collection of Restart
    """

    def __init__(self, ground: CrossingGround, whole: IntArray, restarts: Collection[Restart] = ()) -> None:
        self.ground = ground
        self._costs = CrossingCosts(ground)
        self._spots = SpotSearch(ground, self._costs)
        self._restarts, self._whole = restarts, whole
        self._chain_of = np.searchsorted(whole, ground.low, side="right") - 1

    def divided(self, low: IntArray) -> CrossingSearch:
        """Return the search for other sections, by their first motions."""
        self.ground.low = low
        return CrossingSearch(self.ground, self._whole, self._restarts)

    def cost(self, changes: Mapping[str, Array], coarser: float = 1.0) -> float:
        """Return the time [s] that changes cost."""
        return float(self.costs(changes, coarser)[1].sum())

    def costs(self, changes: Mapping[str, Array], coarser: float) -> tuple[Spots, Array]:
        """Return the changes of all axes in the order of travel, and the time [s] that each costs (n,)."""
        spots = self._spots.find(changes, coarser)
        times = self._costs.of(spots, coarser)
        times[self._changes_nothing(spots)] = 0.0
        return spots, times

    def _changes_nothing(self, spots: Spots) -> IntArray:
        """Return the changes in which an axis keeps its offset and need not be wound up, as Z does on its way down."""
        offsets = np.zeros((len(AXES), 3))
        for column in np.unique(spots.column).tolist():
            offsets[column] = [self.ground.offset(column, sign) for sign in (-1, 0, 1)]
        signs = spots.rows[:, SIGN].astype(np.int64)
        same = offsets[spots.column, signs + 1] == offsets[spots.column, spots.before + 1]
        kept = np.flatnonzero(same & (spots.rows[:, CARRIED] == 0.0)).tolist()
        return np.array([n for n in kept if not self._winds_up(spots, n)], dtype=np.int64)

    def plan(self, changes: Mapping[str, Array], coarser: float) -> PlannedChanges:
        """Plan all changes."""
        spots = self._spots.find(changes, coarser)
        ground = self.ground
        planner = CrossingPlanner(ground.program.motions, ground.along, ground.divisible, ground.least, ground.step)
        current = np.zeros(3)
        crossings: list[CrossingEdit] = []
        stops: list[StopEdit] = []
        approaches: dict[str, float] = {}
        lasting: list[tuple[int, int, float]] = []
        inside: dict[int, Array] = {}
        reached = -np.inf
        burnt: list[int] = []
        marking: dict[tuple[int, float], list[int]] = {}
        for n, row in enumerate(spots.rows):
            column = int(spots.column[n])
            after = current.copy()
            after[column] = self.ground.offset(column, int(row[SIGN]))
            last = int(row[MOTION])
            if row[CARRIED] == 0.0 and (after[column] != current[column] or self._winds_up(spots, n)):
                made = None if spots.jog[n] else self._crossing(planner, spots, n, current, after, reached)
                if made is not None:
                    crossings.append(made)
                    reached, last = self._end_of(made), made.parts[-1].motion
                    for part in made.parts:
                        if part.high == 1.0 and part is not made.parts[-1]:
                            inside[part.motion] = part.added
                else:
                    there = self._at_rest(row, int(spots.before[n]))
                    last = int(there[MOTION])
                    if ground.beam.marks(there, int(spots.before[n]), behind_rapid=ground.behind_rapid(there)):
                        marking.setdefault((last, float(there[SHARE])), []).append(n)
                    stop, beyond = self._jog(spots, n, there, float(after[column] - current[column]), coarser)
                    stops.append(stop)
                    if beyond > 0.0:
                        approaches[AXES[column]] = max(approaches.get(AXES[column], 0.0), beyond)
            lasting.append((last, column, float(after[column])))
            current = after
        burnt += self._burnt(spots, marking, stops)
        offset = _lasting_offsets(lasting, ground.program.motions.kind.size)
        for motion, added in inside.items():
            offset[motion] = added
        begins = self._lines_for_restarts(spots, stops)
        marked = (replace(one, restart=True) if one.approach and one.motion in begins else one for one in stops)
        return PlannedChanges(tuple(crossings), tuple(marked), approaches, offset, tuple(burnt))

    def _burnt(
        self, spots: Spots, marking: Mapping[tuple[int, float], list[int]], stops: Sequence[StopEdit]
    ) -> list[int]:
        """Return the motions at which a beam or a nozzle would mark the part, of the stops in which it stands.

        At constant power a laser may cross its backlash in a corner where that burns little.
        """
        ground = self.ground
        joined = {
            place: join_stops(list(found))
            for place, found in groupby(stops, lambda one: (one.motion, one.share))
            if place in marking
        }
        short = [place for place, one in joined.items() if ground.beam.tool == "laser" and one.crosses]
        at = spots.at[[marking[place][0] for place in short]]
        allowed = ground.stops_burn_little(at, [joined[place] for place in short])
        harmless = {place for place, may in zip(short, allowed.tolist(), strict=True) if may}
        return [place[0] for place in joined if place not in harmless]

    def _lines_for_restarts(self, spots: Spots, stops: list[StopEdit]) -> frozenset[int]:
        """Return the rapids from which a program may be started again: all axes come to their sides behind them."""
        chains = self._chain_of[spots.rows[:, CHAIN].astype(np.int64)]
        used = set(zip(chains.tolist(), spots.column.tolist(), strict=True))
        approached: dict[int, set[int]] = {}
        for stop in stops:
            if stop.approach:
                approached.setdefault(stop.motion, set()).update(AXES.index(one.axis) for one in stop.shifts)
        found = set()
        for one in self._restarts:
            here = sorted(motion for motion in range(one.first, one.cut) if motion in approached)
            axes = set().union(*(approached[motion] for motion in here))
            axes |= {2} if self._comes_down(one) else set()
            named = here and here[0] <= min(one.rapid)
            if named and one.whole and all(column in axes for chain, column in used if chain == one.chain):
                found.add(here[0])
        return frozenset(found)

    def _comes_down(self, one: Restart) -> bool:
        """Return whether Z is on the side of its way down where the tool begins to cut, and carries nothing there."""
        ways = self.ground.way(slice(one.first, one.cut))[:, 2]
        last = ways[ways != 0.0][-1:]
        return bool(last.size and last[0] <= -APPROACH * self.ground.lost[2])

    def _winds_up(self, spots: Spots, n: int) -> bool:
        """Return whether an axis whose offset stays has to come from beyond its backlash all the same.

        A rapid takes it there. Where none leads to its first place it goes there and back while the path rests.
        """
        column, row = int(spots.column[n]), spots.rows[n]
        if row[BEYOND] == 1.0:
            return True
        if not self.ground.behind_rapid(row):
            place, before = spots.column[n : n + 1], spots.before[n : n + 1]
            return bool(spots.first[n] and self._costs.in_place(row[None, :], place, before)[0])
        moves = self.ground.moving[column].size > 0 and self.ground.moving[column][-1] > row[MOTION]
        return bool(spots.first[n] and moves and not self.ground.alone(int(row[MOTION]) + 1, column, row[SIGN]))

    def _end_of(self, made: CrossingEdit) -> float:
        last = made.parts[-1]
        low, high = self.ground.along[last.motion], self.ground.along[last.motion + 1]
        return float(low + last.high * (high - low))

    def _crossing(
        self, planner: CrossingPlanner, spots: Spots, n: int, before: Array, after: Array, reached: float
    ) -> CrossingEdit | None:
        name = AXES[int(spots.column[n])]
        feed = float(spots.feed[n])
        shape = self.ground.shapes[name]
        least = shortest_block(feed) / feed
        shape = replace(shape, first=max(shape.first, least), wait=max(shape.wait, least))
        low, high = spots.bound[n].tolist()
        spot = CrossingPlace(
            column=int(spots.column[n]),
            sign=int(spots.rows[n, SIGN]),
            rest=(float(spots.rest[n, 0]), float(spots.rest[n, 1])),
            chosen=float(spots.at[n]),
            bound=(max(low, reached), high),
            before=before,
            after=after,
            shape=shape,
            lag=response_time(self.ground.machine.axes[name].servo),
            feed=feed,
            calm=bool(spots.calm[n]),
            blend=float(spots.blend[n]),
            spread=float(spots.spread[n]),
            whole=bool(spots.whole[n]),
        )
        made = planner.plan(spot, spots.window[n])
        if made is None or not self.ground.beam.works.burns[int(spots.rows[n, MOTION])]:
            return made
        # Where a beam burns what stands there is no stop in its place.
        return replace(made, behind=False)

    def _at_rest(self, row: Array, before: int) -> Array:
        """Return a change with a beam behind the first of the motions to one place where it is off, or the last.

        `before` is the sign before it.
        """
        if not self.ground.beam.is_beam or row[SHARE] != 1.0 or self.ground.behind_rapid(row):
            return row
        found, still = row.copy(), self.ground.still
        while self.ground.beam.marks(found, before, behind_rapid=False):
            if found[MOTION] + 1 >= still.size or not still[int(found[MOTION]) + 1]:
                break
            found[MOTION] += 1
        return found

    def _jog(self, spots: Spots, n: int, row: Array, travel: float, coarser: float) -> tuple[StopEdit, float]:
        """Shift an axis by a move of its own at a change, and say from how far beyond its place it comes [m].

        One whose side is not known comes from beyond its backlash, in the air: the rapid before ends there.
        """
        name = AXES[int(spots.column[n])]
        motion, share, sign = int(row[MOTION]), float(row[SHARE]), float(row[SIGN])
        axis, ground = self.ground.machine.axes[name], self.ground
        behind_rapid = ground.behind_rapid(row)
        pause, arrives, far = (
            one.item() for one in self._costs.waits(row[None, :], spots.first[n : n + 1], axis, coarser)
        )
        moves = (
            self._moves_beyond(name, row, travel, pause, arrives)
            if far
            else self._moves_to(spots, n, row, travel, pause, arrives)
        )
        off = share == 1.0 and (sign == 0.0 or ground.beam.is_beam)
        behind = ground.beam.off_behind(motion) if off else None
        # With its power in proportion to the speed over F a beam burns no more in a move at F than along the path.
        steady = bool(ground.beam.works.follows[motion]) and sign != 0.0 and not behind_rapid and behind is None
        whole = sign != 0.0 and spots.before[n] != 0 and not behind_rapid
        # No faster than it can be on its way: from rest to rest by half of it each, from rest and on by all of it.
        gains = 2.0 if whole and behind is None and ground.beam.works.burns[motion] else 1.0
        reached = [math.sqrt(gains * axis.limits.acceleration * abs(way)) for way in moves.ways]
        velocity = 0.0 if far else float(spots.feed[n])
        if not steady:
            velocity = self._jog_velocity(axis, moves.ways, velocity, min(reached))
        approach = bool(behind_rapid and sign != 0.0)
        last = len(moves.ways) - 1
        shifts = tuple(
            OffsetShift(
                axis=name,
                travel=way,
                velocity=min(
                    # In the air what only leads to where the last move begins may be as fast as it gets.
                    math.inf if far and place < last else velocity,
                    gentlest_approach(axis) if approach and place == last else math.inf,
                    math.inf if steady else reached[place],
                    axis.limits.velocity,
                ),
                pause=moves.behind if place == last else moves.between,
                whole=whole,
            )
            for place, way in enumerate(moves.ways)
        )
        stop = StopEdit(
            motion=motion,
            share=share,
            pause=moves.ahead,
            shifts=shifts,
            approach=approach,
            rapid=approach and ground.beam.tool == "laser",
            behind=behind,
        )
        return stop, ground.overshoot[name] if far else 0.0

    def _moves_beyond(self, name: str, row: Array, travel: float, pause: float, arrives: float) -> _Moves:
        """Return the moves of an axis whose side is not known, which comes from beyond its backlash."""
        motion, sign = int(row[MOTION]), float(row[SIGN])
        lost, beyond = self._lost_motion(name), self.ground.overshoot[name]
        # A tool is never sent below the height that is programmed: from above onto a side, then through it.
        ways = [-beyond, lost] if name == "Z" and sign > 0.0 else [sign * beyond]
        if self.ground.shiftable[motion, AXES.index(name)]:
            return _Moves(ways, ahead=pause, between=pause, behind=arrives)
        # The rapid does not go beyond: the first of these moves does.
        return _Moves([travel - sum(ways), *ways], ahead=0.0, between=pause, behind=arrives)

    def _moves_to(self, spots: Spots, n: int, row: Array, travel: float, pause: float, arrives: float) -> _Moves:
        """Return the moves of an axis whose side is known."""
        name, sign = AXES[int(spots.column[n])], float(row[SIGN])
        behind_rapid, beam = self.ground.behind_rapid(row), self.ground.beam
        ways, ahead = [travel], pause
        if not behind_rapid and (sign == 0.0 or spots.before[n] == 0):
            # Behind the last cut the path rests anyway, and where no rapid led to the first place it has to once.
            ahead = arrives = pause = max(pause, self._costs.least_rest(self.ground.machine.axes[name]))
            if self._costs.in_place(row[None, :], spots.column[n : n + 1], spots.before[n : n + 1])[0]:
                # From one side of its backlash to the other the table comes to its place from wherever it was.
                through = sign * self._lost_motion(name)
                away = travel - through
                ways = [away, through] if abs(away) > SAME else [through]
        elif beam.tends and beam.works.stays[int(row[MOTION])]:
            ahead, arrives = 0.0, arrives if behind_rapid else 0.0
        return _Moves(ways, ahead=ahead, between=pause, behind=arrives)

    def _lost_motion(self, name: str) -> float:
        minus, plus = self.ground.sides[name]
        return plus - minus

    def _jog_velocity(self, axis: Axis, ways: Sequence[float], feed: float, reached: float) -> float:
        """Return the speed [m/s] of moves of an axis alone beside a cut at a feed, 0 where none is near."""
        if not feed > 0.0:
            if isinstance(self.ground.planner, ExactPath) and response_time(axis.servo) == 0.0:
                # The path rests at both of its ends: what is slower than its ramps only takes longer.
                return reached
            return make_jog(axis, max(map(abs, ways)), 0.0).velocity
        # Where joints are rounded, the cut beside a faster one is made faster, too.
        beside = math.inf if isinstance(self.ground.planner, ExactPath) else self._costs.beside_cut(axis)
        return min(max(feed, beside), reached)


def _lasting_offsets(changes: Sequence[tuple[int, int, float]], count: int) -> Array:
    """Return the offsets (m, 3) [m] at the ends of motions, by what each axis has from a motion on, in order."""
    # Column by column, so that an axis without an offset takes no memory.
    offset = unwritten((len(AXES), count)).T
    until = [count] * len(AXES)
    # From the last one back, so that each motion is written once.
    for first, column, value in reversed(changes):
        if first < until[column]:
            if value:
                offset[first : until[column], column] = value
            until[column] = first
    return offset
