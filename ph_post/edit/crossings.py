"""Plan crossings of the backlash on the fly: the blocks by which a program crosses at each reversal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, overload

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.edit.crossing_shapes import (
    BALANCED,
    BEHIND,
    CHORD,
    OUTER,
    OUTWARD,
    SHARP,
    STEPS,
    CrossingShape,
    fastest_stair,
    points_along,
    stair,
)
from ph_post.edit.edits import CrossingEdit, CrossingPart
from ph_post.edit.lagging_crossings import CrossingArcs, bent_line, lead_time
from ph_post.edit.reversals import motion_view
from ph_post.edit.table_motion import follow_table
from ph_post.gcode.program import ARC, AXES, CUBIC, LINE, Motions, plane_columns
from ph_post.geometry.numeric import polyline_distances
from ph_post.types import Array, BoolArray
from ph_post.units import MM

ERROR: Final = 1.1e-3 * MM
"""Largest error [m] that a crossing is given where the time allows it: what rounding to micrometres leaves, twice."""

COARSER: Final = (2.0, 4.0, 8.0, 16.0, 23.0)
"""Multiples of :data:`ERROR` that are tried where the time allowed is too short."""

FINE: Final = 4.0
"""Up to this multiple a crossing may be as coarse, whatever the backlash is."""

PART: Final = 0.2
"""Part of the backlash that coarser crossings leave: more of them is better than fewer exact ones."""

LARGE: Final = 16.0
"""Above this multiple they leave as much more of it."""

MOST: Final = 0.48
"""No crossing is meant to leave a larger part of it, where the motor does not lag."""

HALF: Final = 0.5
"""One that leaves a larger part is not made: the plain program leaves as much."""

THROUGH: Final = 0.9
"""Part of the backlash that a motor has gone through where its axis counts as having crossed it."""

NEARLY: Final = 0.98
"""Part of the largest offset of its axis that a crossing leaves at most: what is declared is rounded."""

SHORTEST: Final = 0.02 * MM
"""Blocks of crossings are no shorter [m]; one that would be is moved to the end of the motion beside it."""

SHORTEST_TIME: Final = 0.01
"""Nor do they need to last longer than this [s], where the path is slow."""

FINEST: Final = 1e-3 * MM
"""None is shorter than this [m], however slow the path is."""

STRAIGHT: Final = 0.3
"""Part of :data:`ERROR` by which the joints of straight motions may leave the line on which they lie together."""

LOOSER: Final = 1.3
"""A crossing may have so many times its error where that spares a block too short for the controller."""

ROUNDER: Final = 1.6
"""The same where it spares two sharp joints in place of the many of a crossing in steps."""

ROUNDED: Final = 1.2
"""Length of all rounded joints of a crossing in steps, beside that of its blocks."""

WORTH: Final = 5e-3
"""Time [s] that a crossing in fewer steps has to save: its error is a tenth of a micrometre larger."""

NEARBY: Final = 1.5
"""A crossing whose blocks have to be short begins and ends on a joint of the program that is no more than so many
times the length of its shortest block away."""

KINK: Final = math.cos(math.radians(20.0))
"""In a corner sharper than this the shift is a move of its own, as the path is slow there anyway."""

BLENDED: Final = 4e-3 * MM
"""Radius [m] with which a controller that rounds joints rounds those of a motor faster than a slow path: so near to
them the cut is as fast."""

LEAD: Final = 0.5 * (OUTER - 1.0)
"""Straight blocks before and behind a crossing with lag last this part of it."""

SETTLING: Final = 4.0
"""So many time constants c behind a corner the motor has arrived, within 2 % of its way."""

SPREAD: Final = 1.1
"""Behind a lag an error without it is up to so many times what it is where the path is straight."""

FASTER: Final = 2e-3
"""Feeds that differ by less than this part are the same."""

CAUTIOUS: Final = 0.9
"""Part of the way that a motor has more than the path by which the feed is raised: lengths are approximate."""

FREELY: Final = 1.1
"""Feed of the blocks of a crossing in steps beside its mean speed: their joints are what slows the path down."""

HELD: Final = 0.8
"""Part of the least time of blocks in steps that is left where they were moved to the ends of motions."""

BLOCKS: Final = 0.85
"""Part of the window that the blocks of a crossing in steps take at most."""

FEWEST: Final = 3
"""Joints that a line bent in arcs has at least: its way, its end, and what the lag leaves ask for as many."""

LONE: Final = 0.75
"""Part of the wait that the motor's block lasts where there is room for no more than one."""

TURNED: Final = 48
"""Steps of the written places by which an end of a crossing on a helix is moved at most so that its block touches it:
where the helix rises by a degree, a step in height is 57 steps along the block."""

BESIDE: Final = 12
"""The same for the joint at the other end of that block."""

AS_NEAR: Final = 0.01
"""Part of a step of the written places by which the error may grow then: half a step is rounded off each place."""

ASTRAY: Final = 2.0
"""Where a table is so many times the backlash ahead of its path, or behind it, it is looked at how far the path is."""

SAMPLES: Final = 97
"""Places of a crossing at which its error is read off."""

NOTHING: Final = 1e-12
"""Places along the program that differ by no more [m] are the same."""

SAME_SHARE: Final = 1e-9
"""Shares of a motion that differ by no more are the same."""


@overload
def shortest_block(feed: float) -> float: ...
@overload
def shortest_block(feed: Array) -> Array: ...
def shortest_block(feed: float | Array) -> float | Array:
    """Return the least length [m] of the blocks of a crossing where the path has a feed [m/s]."""
    if isinstance(feed, float):  # of each crossing several times
        return min(max(SHORTEST_TIME * feed, FINEST), SHORTEST)
    return np.clip(SHORTEST_TIME * feed, FINEST, SHORTEST)


def exaggeration(shape: CrossingShape, lag: float) -> float:
    """Return how many times its error a table behind a motor without lag leaves the path in a crossing, beyond apart.

    The bulge before and behind it follows the tangent for longer than the table does, or begins sooner.
    """
    if shape.beyond > 0.0:
        time = LEAD * shape.wait
        return SPREAD * (lead_time(time, lag) / time) ** 2
    blocks = shape.span(shape.steps) if shape.steps > 1 else max(shape.first, LONE * shape.wait)
    ahead = 0.5 * max(shape.wait - min(blocks, shape.wait), 0.0)
    return (1.0 + ahead / (LEAD * shape.wait)) ** 2


def _stretch(way: Array, passed: Array, points: Array) -> float:
    """Return how much longer the motor's way is than the path's, where it is least on the parts of a block.

    The path's is what the motor or its table passes of it, the longer of both.
    """
    ways = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.maximum(np.diff(way), np.diff(passed))
    # A part of no length is none by which the motor's way is longer.
    return 1.0 + CAUTIOUS * max(float((ways / np.where(ways > 0.0, along, 1.0)).min()) - 1.0, 0.0)


def _long_stair(steps: int, slopes: Sequence[float], least: float) -> tuple[list[float], list[float]]:
    """Return the corners of a :func:`stair` of up to so many steps, of which no piece is shorter than `least`."""
    before, slope, after = slopes
    up = down = steps
    share, travelled = stair(up, down, slope, before, after)
    while min(up, down) > 0 and max(up, down) > 1 and min(b - a for a, b in pairwise(share)) < least:
        if down > 1 and (up == 1 or share[1] > share[-1] - share[-2]):
            down -= 1
        else:
            up -= 1
        share, travelled = stair(up, down, slope, before, after)
    return share, travelled


def _with_motions_of_no_length(parts: Sequence[CrossingPart]) -> list[CrossingPart]:
    """Add the motions between two parts, which are of no length, as of a line that is there twice."""
    found = list(parts[:1])
    for before, part in pairwise(parts):
        between = range(before.motion + 1, part.motion)
        found += [replace(before, motion=motion, low=0.0, high=1.0, line=True) for motion in between]
        found.append(part)
    return found


class CrossingPlace(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A reversal to be crossed: where it is along the program [m], and what happens there.

    `column` the axis and `sign` its new direction; `rest` the places between which it rests, `chosen` the best place in
    it; `bound` the places that the crossing may not leave; `before` and `after` the offsets [m] of all axes, shape
    (3,); `shape` of the crossing; `lag` [s]; `feed` the speed of the path [m/s]; `calm` where the axis rests long
    enough, with `blend` [m] at either end of the rest where the controller may round its corners; `spread` [m] over how
    much of that line the offset changes, 0 over as little as may be; `whole` where that is all of the rest.
    """

    column: int
    sign: int
    rest: tuple[float, float]
    chosen: float
    bound: tuple[float, float]
    before: Array
    after: Array
    shape: CrossingShape
    lag: float
    feed: float
    calm: bool
    blend: float = 0.0
    spread: float = 0.0
    whole: bool = False


class _Knots(msgspec.Struct, kw_only=True, eq=False):
    """Places of a crossing in order, what is added to the path there, and how each part is passed.

    `line` says of the part that ends at a knot whether it is a straight block; `speed` [m/s] the path's there.
    On the parts that end at the knots `crosses` the motor crosses the backlash; `exact` where the table is on the path
    at every knot, `aside` where it lies beside the place at which the axis turns.
    """

    s: list[float]
    added: list[Array]
    line: list[bool]
    speed: list[float]
    crosses: range = range(0)
    exact: bool = False
    aside: bool = False


class CrossingPlanner:
    """Plans the crossings of a program.

    Parameters
    ----------
    motions : Motions
    along : Array, shape (m + 1,)
        Of :func:`~ph_post.gcode.motion_parts.places_along`.
    divisible : BoolArray, shape (m,)
        Motions that may be divided: crossings lie on them alone.
    least : float
        Blocks last at least this long [s] at the feed of the path, where that does not cost too much.
    step : float
        To which places are written [m]; 0 where they are written as they are.
    """

    def __init__(self, motions: Motions, along: Array, divisible: BoolArray, least: float, step: float = 0.0) -> None:
        self._motions, self._along, self._divisible, self._least = motions, along, divisible, least
        self._step = step
        self._view = motion_view(motions)

    def plan(self, spot: CrossingPlace, window: Array) -> CrossingEdit | None:
        """Return the crossing at a reversal; None where it does not fit.

        Parameters
        ----------
        spot : CrossingPlace
        window : Array, shape (5,)
            Of :func:`find_windows`.
        """
        long, shortest = spot.feed * self._least, shortest_block(spot.feed)
        if self._bent(spot, window):
            found = self._planned(spot, window, shortest, STEPS)
            if found is not None:
                return found
        found = self._planned(spot, window, long, spot.shape.steps)
        if long <= shortest or (found is not None and found.error <= ERROR):
            return found
        # A block that the controller has to slow down for costs less than a crossing in the wrong place.
        outside = min(long, NEARBY * shortest) if found is None and spot.shape.steps > 1 else 0.0
        finer = self._planned(spot, window, shortest, 1, outside)
        if finer is None or found is None:
            return found if finer is None else finer
        enough = ROUNDER if len(found.parts) > len(finer.parts) else LOOSER
        return found if found.error <= enough * finer.error else finer

    def _bent(self, spot: CrossingPlace, window: Array) -> bool:
        """Return whether an exact path bends so much in a window that a joint of one block would be too sharp."""
        if spot.calm or window[2] == 0.0 or int(window[4]) in (BEHIND, CHORD) or not math.isfinite(spot.shape.turn):
            return False
        knots = self._around(spot, window, 1, 0.0)
        if knots is None:
            return False
        _, _, slopes = self._motor_at(knots, spot)
        return float(np.abs(np.diff(slopes)).max()) * spot.feed > SHARP * spot.shape.turn

    def _planned(
        self, spot: CrossingPlace, window: Array, least: float, most: int, outside: float = 0.0
    ) -> CrossingEdit | None:
        """Plan a crossing in `most` steps or in one; blocks no shorter than `least` [m], `outside` [m] at its ends."""
        if spot.calm:
            return self._made(self._in_rest(spot), spot, least, least)
        if window[2] == 0.0:
            return None
        for steps in dict.fromkeys((most, 1)):
            made = self._made(self._around(spot, window, steps, least), spot, least, max(least, outside))
            if made is not None:
                return made
        return None

    def _made(self, knots: _Knots | None, spot: CrossingPlace, least: float, outside: float) -> CrossingEdit | None:
        shortest = shortest_block(spot.feed)
        if knots is None or not self._snap(knots, spot, max(least, shortest), max(outside, shortest)):
            return None
        if len(knots.crosses) > 1 and (np.diff(knots.s) / knots.speed[1:]).min() < HELD * spot.shape.least:
            return None
        points, error, places = self._executed(knots, spot)
        touching = self._touching(knots, spot)
        if touching is not None:
            other = self._executed(touching, spot)
            if other[1] <= error + AS_NEAR * self._step:
                knots, (points, error, places) = touching, other
        # What goes beyond shows to a motor without lag alone.
        own = spot.shape.beyond if not spot.calm else 0.0
        before, after = float(spot.before[spot.column]), float(spot.after[spot.column])
        gap = abs(after - before)
        # The check wants none farther from the path than an offset is.
        most = min((HALF + own) * gap, NEARLY * max(abs(before), abs(after)), FINE * ERROR if knots.aside else math.inf)
        if error > most or not self._goes_through(knots, points, spot, gap):
            return None
        parts = self._parts(knots, points, places, coarse=error > FINE * ERROR + own * gap and not knots.exact)
        if not all(self._divisible[part.motion] for part in parts):
            return None
        return CrossingEdit(
            axis=AXES[spot.column],
            sign=spot.sign,
            parts=parts,
            length=float(places[1, -1] - places[1, 0]),
            error=error,
            late=spot.lag > 0.0,
            behind=knots.exact and not spot.calm,
        )

    def _goes_through(self, knots: _Knots, points: Array, spot: CrossingPlace, gap: float) -> bool:
        """Return whether the motor goes through its backlash before the next crossing may begin, on the same motion.

        It does not where its axis turns back a little and then goes on as it went: the check would see no crossing.
        """
        motion_end = self._along[min(int(self._along.searchsorted(knots.s[-1])), self._along.size - 1)]
        last = max(min(float(motion_end), spot.bound[1]), knots.s[-1])
        end = points_along(self._view, self._along, np.array([last]))[0] + spot.after
        way = spot.sign * np.append(points[:, spot.column], end[spot.column])
        return bool((way[-2:] - way.min() >= THROUGH * gap + self._step).any())

    def _executed(self, knots: _Knots, spot: CrossingPlace) -> tuple[Array, float, Array]:
        """Return the points at the knots (n, 3) [m], and what :meth:`_followed` says of the table."""
        points = points_along(self._view, self._along, np.array(knots.s)) + np.array(knots.added)
        return points, *self._followed(knots, points, spot)

    def _touching(self, knots: _Knots, spot: CrossingPlace) -> _Knots | None:
        """Move the ends of a crossing on a helix so that its first and last block, as written, touch the helix there.

        Rounded to the program's decimals a block of a tenth of a millimetre is off its tangent by some milliradians,
        mostly along the helix' axis. LinuxCNC rounds no joint of a helix by an arc: it is nearly at rest in each. None
        where nothing is moved.
        """
        last = len(knots.s) - 1
        if self._step == 0.0 or 1 in knots.crosses or last in knots.crosses or not knots.crosses:
            return None
        moved = replace(knots, s=list(knots.s))
        self._touch(moved, 0, 1, 2, spot)
        self._touch(moved, last, last - 1, last - 2, spot)
        return moved if moved.s != knots.s else None

    def _touch(self, knots: _Knots, end: int, joint: int, beyond: int, spot: CrossingPlace) -> None:
        """Move an end of a crossing and the joint next to it, where both are inside of a helix; not the one beyond."""
        motions, step, s = self._motions, self._step, np.array(knots.s)
        k = self._locate(min(s[end], s[joint]) + NOTHING)[0]
        if motions.kind[k] != ARC:
            return
        across = plane_columns(motions.plane[k : k + 1])[0, 2]
        if not abs(motions.end[k, across] - motions.start[k, across]) > step:
            return
        outer = s[end] + np.arange(-TURNED, TURNED + 1) * step
        inner = s[joint] + np.arange(-BESIDE, BESIDE + 1) * step
        low, high = max(spot.bound[0], self._along[k]), min(spot.bound[1], self._along[k + 1])
        outer = outer[(outer - 2.0 * step > low) & (outer + 2.0 * step < high)]
        length = abs(s[beyond] - s[joint])
        inner = inner[(inner > low) & (inner < high) & (np.abs(inner - s[beyond]) >= HELD * length)]
        if s[end] not in outer or s[joint] not in inner:
            return
        # A block may be shorter than the ways by which its ends may move: they stay in their order, and apart.
        forward = math.copysign(1.0, s[joint] - s[end])
        one, other = np.nonzero(forward * (inner - outer[:, None]) > 0.5 * shortest_block(spot.feed))
        way = self._written(inner, knots.added[joint])[other] - self._written(outer, knots.added[end])[one]
        tangent = np.subtract(*(points_along(self._view, self._along, outer + side) for side in (step, -step)))
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        least = np.argmin(np.linalg.norm(np.cross(way, tangent[one]), axis=1) / np.linalg.norm(way, axis=1))
        knots.s[end], knots.s[joint] = float(outer[one[least]]), float(inner[other[least]])

    def _written(self, s: Array, added: Array) -> Array:
        """Return the places (n, 3) [m] that are written for places along the program: shifts are rounded apart."""
        step = self._step
        return np.asarray(step * (np.rint(points_along(self._view, self._along, s) / step) + np.rint(added / step)))

    def _followed(self, knots: _Knots, points: Array, spot: CrossingPlace) -> tuple[float, Array]:
        """Follow a table that waits while its motor is in the backlash.

        Returns
        -------
        error : float
            Its largest distance from the path [m].
        places : Array, shape (3, n)
            Places along the program, the way of the path up to them, and up to where the table is nearest to it then
            [m].
        """
        s, path, table, error, ahead = follow_table(
            self._view,
            self._along,
            np.array(knots.s),
            np.array(knots.added),
            np.array(knots.line),
            points,
            spot.column,
            spot.before,
            float(spot.after[spot.column]),
            SAMPLES,
        )
        # Beside a joint, and in tight bends, the nearest place of the path is not across from it; and where the path
        # turns back on itself a block may leave out its end.
        if error > ERROR or float(np.abs(ahead).max()) > ASTRAY * np.ptp(
            [spot.before[spot.column], spot.after[spot.column]]
        ):
            error = float(max(polyline_distances(*both).max() for both in ((table, path), (path, table))))
        way = s
        cubics = self._motions.control  # the kinds of motions are looked up where there are any
        if cubics and (self._motions.kind[self._motion_at(s[0]) : self._locate(s[-1])[0] + 1] == CUBIC).any():
            # Places on a cubic go by its parameter.
            way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
        return error, np.stack([s, way, way + ahead])

    def _in_rest(self, spot: CrossingPlace) -> _Knots | None:
        """Cross while the axis rests anyway: on a straight stretch of the rest, and no slower."""
        if spot.whole:
            return self._straight(*spot.rest, spot)
        run = spot.feed * spot.shape.first
        settle, tail = SETTLING * spot.lag * spot.feed, spot.feed * (spot.shape.wait - spot.shape.first)
        low = max(spot.rest[0] + max(settle, spot.blend), spot.bound[0])
        high = min(spot.rest[1] - max(tail, spot.blend), spot.bound[1])
        begin = min(max(spot.chosen - 0.5 * spot.spread, low), high - max(run, spot.spread))
        if begin < low - 1e-12:
            return None
        finish = min(begin + (spot.spread or 2.0 * run), high)
        begin, finish = self._on_line(begin, finish, high, run)
        return self._straight(begin, finish, spot) if finish > begin else None

    @staticmethod
    def _straight(begin: float, finish: float, spot: CrossingPlace) -> _Knots:
        return _Knots(
            s=[begin, finish],
            added=[spot.before, spot.after],
            line=[False, True],
            speed=[spot.feed, spot.feed],
            crosses=range(1, 2),
            exact=True,
        )

    def _on_line(self, begin: float, finish: float, high: float, run: float) -> tuple[float, float]:
        """Move a stretch of a rest on to the first straight motions with room for it; an empty one where none have."""
        k = self._motion_at(begin)
        while k < self._motions.kind.size and self._along[k] < high:
            low = max(begin, float(self._along[k]))
            end = min(high, self._straight_until(k, low + max(run, finish - begin)))
            if end - low >= run - NOTHING:
                return low, min(low + (finish - begin), end)
            k += 1
        return 0.0, 0.0

    def _straight_until(self, first: int, enough: float) -> float:
        """Return where the straight motions from `first` on end that lie on one line, or a place beyond `enough`."""
        motions, last = self._motions, first - 1
        begin = np.nan_to_num(motions.start[first])
        while last + 1 < motions.kind.size and motions.kind[last + 1] == LINE and self._along[last + 1] < enough:
            ways = np.nan_to_num(motions.end[first : last + 2]) - begin
            chord = ways[-1] / max(float(np.linalg.norm(ways[-1])), NOTHING)
            ahead = ways @ chord
            if (
                np.abs(ways - ahead[:, None] * chord).max() > STRAIGHT * ERROR
                or np.diff(ahead, prepend=0.0).min() < 0.0
            ):
                break
            last += 1
        return float(self._along[last + 1])

    def _around(self, spot: CrossingPlace, window: Array, steps: int, least: float) -> _Knots | None:
        """Cross while the path is near the turning point, slower where need be."""
        if spot.shape.beyond > 0.0:
            return self._from_beyond(spot, window, steps, least)
        begin, finish, speed, error, kind = window.tolist()
        if kind in (BEHIND, CHORD):
            knots = self._straight(begin, finish, spot)
            knots.speed[-1], knots.exact = speed, kind == BEHIND
            return knots
        # The table waits longer than the motor's blocks last where the controller rounds their ends.
        lasts = max(spot.shape.first, LONE * spot.shape.wait) * speed
        if 1 < steps <= spot.shape.steps:
            lasts = min(spot.shape.span(steps) * speed, BLOCKS * (finish - begin))
            # Beyond five rounded joints in a row LinuxCNC looks no further ahead, and keeps to the speed from which it
            # could stop halfway along the block behind them.
            way = 0.25 * (OUTER * (finish - begin) - lasts) + ROUNDED * lasts
            kept = min(math.sqrt(spot.shape.push * way), speed)
            lost = ((spot.feed - kept) ** 2 - (spot.feed - speed) ** 2) / (0.5 * spot.shape.push * spot.feed)
            if kind == BALANCED and lost > WORTH:
                steps = min(steps, spot.shape.fewest)
                lasts = min(spot.shape.span(steps) * speed, BLOCKS * (finish - begin))
        ahead = max(0.5 * (finish - begin - max(lasts, shortest_block(spot.feed))), 0.0)
        first, last = begin + ahead, finish - ahead
        knots = _Knots(s=[first, last], added=[spot.before, spot.after], line=[False, True], speed=[spot.feed, speed])
        longer = OUTER - 1.0 if kind == BALANCED else 1.0
        out = longer * 0.5 * max(finish - begin - (spot.rest[1] - spot.rest[0]), 0.0)
        # A window that is the rest alone needs no way out: nothing moves along the axis there.
        if kind in (BALANCED, OUTWARD) and out > 0.0:
            bulge = np.zeros(3)
            # The tangent goes on to the block's end.
            bulge[spot.column] = -spot.sign * error * ((out + ahead) / out) ** 2
            knots = _Knots(
                s=[begin - out, first, last, finish + out],
                added=[spot.before, spot.before + bulge, spot.after + bulge, spot.after],
                line=[False, True, True, True],
                speed=[spot.feed, spot.feed, speed, spot.feed],
            )
        return self._in_steps(knots, spot, steps)

    def _from_beyond(self, spot: CrossingPlace, window: Array, steps: int, least: float) -> _Knots | None:
        """Cross where the motor lags: with an offset that goes beyond its new value and comes back, or in arcs."""
        begin, finish, speed, error, kind = window.tolist()
        first = begin + spot.lag * speed
        half = first + spot.shape.first * speed
        peak = spot.after + spot.shape.beyond * (spot.after - spot.before)
        # On tangents, as controllers pass a joint of two straight blocks faster than one with an arc.
        lead = LEAD * (finish - begin)
        bulge = np.zeros(3)
        bulge[spot.column] = -spot.sign * (2.0 if kind == BALANCED else 1.0) * error * (2.0 * LEAD) ** 2
        longer = lead_time(lead / speed, spot.lag) * speed / lead
        if spot.shape.arcs is not None and steps > 1:
            last = first + spot.shape.wait * speed
            tangents = _Knots(
                s=[first - longer * lead, first, last, last + lead],
                added=[spot.before, spot.before + longer**2 * bulge, spot.after + bulge, spot.after],
                line=[False, True, True, True],
                speed=[spot.feed, speed, speed, spot.feed],
            )
            return self._in_arcs(tangents, spot, spot.shape.arcs, least)
        return _Knots(
            s=[
                first - longer * lead,
                first,
                half,
                half + spot.shape.first * speed,
                half + spot.shape.first * speed + lead,
            ],
            added=[spot.before, spot.before + longer**2 * bulge, peak, spot.after + bulge, spot.after],
            line=[False, True, True, True, True],
            speed=[spot.feed, speed, speed, speed, spot.feed],
            crosses=range(2, 4),
        )

    def _in_arcs(self, knots: _Knots, spot: CrossingPlace, arcs: CrossingArcs, least: float) -> _Knots | None:
        """Put a line that is bent in arcs between two tangents, its joints where motions may be divided if they may."""
        column, speed, s = spot.column, knots.speed[1], np.array(knots.s)
        between = max(spot.shape.least, shortest_block(spot.feed) / speed)
        places: list[float] = []
        for place in (s[1] + speed * arcs.joints(between)[0]).tolist():
            low, high = (self._snapped(place, down, least) for down in (True, False))
            near = low if place - low < high - place else high
            if near - (places[-1] if places else knots.s[0]) >= HELD * between * speed:
                places.append(near)
        if len(places) < FEWEST:
            return None
        motor = points_along(self._view, self._along, s)[:, column] + np.array(knots.added)[:, column]
        line = bent_line(arcs, s, motor, spot.lag, np.array(places), between)
        line -= points_along(self._view, self._along, np.array(places))[:, column]
        added = [np.where(np.arange(len(AXES)) == column, x, spot.before) for x in line.tolist()]
        return _Knots(
            s=[knots.s[0], *places, knots.s[-1]],
            added=[knots.added[0], *added, knots.added[-1]],
            line=[False, *[True] * (len(places) + 1)],
            speed=[spot.feed, *[speed] * len(places), spot.feed],
            crosses=range(2, len(places) + 1),
        )

    def _in_steps(self, knots: _Knots, spot: CrossingPlace, steps: int) -> _Knots:
        """Put a broken line, as of :func:`stair`, in place of the block in the middle of a crossing."""
        middle = len(knots.s) // 2
        knots.crosses = range(middle, middle + 1)
        if steps == 1:
            return knots
        s, motor, slopes = self._motor_at(knots, spot)
        column, turn = spot.column, float(spot.sign)
        first, last = s[1:3].tolist()
        shortest = shortest_block(spot.feed)
        if math.isfinite(spot.shape.turn):
            share, travelled, speed = fastest_stair(slopes, last - first, spot.shape.turn, spot.shape.least, shortest)
            speed = max(speed, knots.speed[middle])
        else:
            least = max(spot.shape.least * knots.speed[middle], shortest) / (last - first)
            share, travelled = _long_stair(steps, slopes, least)
            speed = FREELY * knots.speed[middle]
        places = first + np.array(share[1:-1]) * (last - first)
        way = (
            motor[1]
            + turn * np.array(travelled[1:-1]) * (last - first)
            - points_along(self._view, self._along, places)[:, column]
        )
        between = [np.where(np.arange(len(AXES)) == column, x, knots.added[middle]) for x in way.tolist()]
        knots.s[middle:middle] = places.tolist()
        knots.added[middle:middle] = between
        knots.line[middle:middle] = [True] * len(between)
        knots.speed[middle : middle + 1] = [min(speed, knots.speed[0])] * (len(between) + 1)
        knots.crosses = range(middle, middle + len(share) - 1)
        return knots

    def _motor_at(self, knots: _Knots, spot: CrossingPlace) -> tuple[Array, Array, list[float]]:
        """Return the places before and at the ends of the block in the middle, and behind it, and the motor's there.

        Returns
        -------
        places, motor : Array, shape (4,)
            [m].
        slopes : list of float
            Of the motor's way in its new direction between them.
        """
        middle, column = len(knots.s) // 2, spot.column
        first, last = knots.s[middle - 1], knots.s[middle]
        shortest = shortest_block(spot.feed)
        outer = [first - shortest, last + shortest] if middle == 1 else [knots.s[0], knots.s[-1]]
        added = np.array([knots.added[0], knots.added[middle - 1], knots.added[middle], knots.added[-1]])[:, column]
        s = np.array([outer[0], first, last, outer[1]])
        motor = points_along(self._view, self._along, s)[:, column] + added
        return s, motor, (float(spot.sign) * np.diff(motor) / np.diff(s)).tolist()

    def _motion_at(self, s: float) -> int:
        k = int(self._along.searchsorted(s, side="right")) - 1
        return min(max(k, 0), self._motions.kind.size - 1)

    def _locate(self, s: float) -> tuple[int, float]:
        """Return motion and share of a place; at a joint the end of the one before it."""
        k = int(self._along.searchsorted(s)) - 1
        k = min(max(k, 0), self._motions.kind.size - 1)
        low, high = float(self._along[k]), float(self._along[k + 1])
        return k, (s - low) / (high - low) if high > low else 1.0

    def _snapped(self, s: float, down: bool, least: float) -> float:
        """Move a place to an end of its motion where a part would be too short, or where it may not be divided."""
        k, share = self._locate(s)
        low, high = float(self._along[k]), float(self._along[k + 1])
        if not self._divisible[k] and 0.0 < share < 1.0:
            return low if down else high
        if s - low < min(least, 0.5 * (high - low)):
            return low
        return high if high - s < least else s

    def _snap(self, knots: _Knots, spot: CrossingPlace, least: float, outside: float) -> bool:
        """Move knots where motions may be divided; return whether the crossing still fits."""
        count, (first, *_, last) = len(knots.s), knots.s
        room = [outside if n in (0, count - 1) else least for n in range(count)]
        knots.s = [self._snapped(one, 2 * n < count, room[n]) for n, one in enumerate(knots.s)]
        joint = knots.s[0]
        if count == len((first, last)) and knots.s[-1] == joint:
            # Too short on either side of a joint, it lies behind it, or before, where more of it was.
            length = max(last - first, outside)
            ends = (joint, joint + length) if last - joint >= joint - first else (joint - length, joint)
            knots.s = [self._snapped(one, n == 0, outside) for n, one in enumerate(ends)]
            knots.aside = True
        inside = knots.s[0] > spot.bound[0] - outside and knots.s[-1] < spot.bound[1] + outside
        return inside and bool(np.all(np.diff(knots.s) > 0.5 * shortest_block(spot.feed)))

    def _parts(self, knots: _Knots, points: Array, places: Array, *, coarse: bool) -> tuple[CrossingPart, ...]:
        """Cut a crossing at the ends of motions; their ends are shifted onto its blocks.

        For which part of the path a block of a `coarse` one stands is not known so exactly: its feed is not raised.
        """
        s = knots.s
        parts: list[CrossingPart] = []
        for n in range(1, len(s)):
            first, last = np.searchsorted(self._along, (s[n - 1] + NOTHING, s[n] - NOTHING)).tolist()
            ends = np.array(sorted({*self._along[first:last].tolist(), s[n]}))
            path = points_along(self._view, self._along, ends)
            if knots.line[n]:
                share = (ends - s[n - 1]) / (s[n] - s[n - 1])
                added = points[n - 1] + share[:, None] * (points[n] - points[n - 1]) - path
            else:
                added = np.tile(knots.added[n], (ends.size, 1))
            raised = n in knots.crosses and not coarse
            stretched = 1.0
            if raised:
                own = np.append(s[n - 1], ends)
                way, passed = (np.interp(own, places[0], row) for row in places[1:])
                stretched = _stretch(way, passed, np.concatenate([points[n - 1 : n], path + added]))
            low = s[n - 1]
            for end, extra in zip(ends.tolist(), added, strict=True):
                parts.append(self._part(low, end, extra, knots.speed[n], stretched, line=knots.line[n]))
                low = end
        return tuple(_with_motions_of_no_length(parts))

    def _part(
        self, low: float, high: float, added: Array, speed: float, stretched: float, *, line: bool
    ) -> CrossingPart:
        k, end = self._locate(high)
        begin = (low - float(self._along[k])) / (float(self._along[k + 1]) - float(self._along[k]))
        timed = float(self._motions.duration[k])
        own = (self._along[k + 1] - self._along[k]) / timed if timed > 0.0 else self._motions.feeds.at(k)
        # The table is never faster than the motion's own feed, also where the crossing begins on a slower one.
        speed = min(speed, own) * stretched if own > 0.0 else speed * stretched
        return CrossingPart(
            motion=k,
            low=0.0 if begin < SAME_SHARE else begin,
            high=1.0 if end > 1.0 - SAME_SHARE else end,
            line=line,
            added=added,
            feed=speed if line or abs(speed - own) > FASTER * own else None,
        )
