"""Find where and how each reversal of a program may be crossed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.edit.beam_exposure import RAISED, CornerWindows, windows_burn_little
from ph_post.edit.crossing_costs import CrossingCosts
from ph_post.edit.crossing_ground import LEAST_FEED, CrossingGround, Spots
from ph_post.edit.crossing_shapes import (
    AT_SPEED,
    BALANCED,
    BEHIND,
    CHORD,
    INWARD,
    OUTER,
    OUTWARD,
    CrossingShape,
    find_windows,
    points_along,
)
from ph_post.edit.crossings import (
    BLENDED,
    COARSER,
    ERROR,
    FINE,
    FINEST,
    KINK,
    LARGE,
    MOST,
    PART,
    SETTLING,
    exaggeration,
    shortest_block,
)
from ph_post.edit.cutter_contours import QUARTER, SLANTED
from ph_post.edit.lagging_crossings import SHORT_LAG
from ph_post.edit.reversals import (
    BEYOND,
    CARRIED,
    CHAIN,
    COLUMNS,
    FIRST,
    LAST,
    MOTION,
    PASSED,
    SAME,
    SHARE,
    SHARE0,
    SHARE1,
    SIGN,
)
from ph_post.gcode.program import ARC, AXES, LINE, RAPID, plane_columns
from ph_post.simulate.controllers.moves import tolerances
from ph_post.types import Array, BoolArray, ExactPath, IntArray
from ph_post.units import MM

STEPS_ERROR: Final = 1.25e-3 * MM
"""As :data:`ERROR`, of crossings in steps: a controller that rounds joints slows down with half of the acceleration in
arcs, so that less error takes much time."""

CLEAR: Final = 1.5
"""Times the shortest block: what a crossing leaves at least between itself and a corner that is rounded."""

BLEND_ANGLE: Final = math.radians(20.0)
"""Corners duller than this reach no farther into the path than this one when they are rounded."""

LEFT_OF_HELIX: Final = 1.05
"""What a crossing leaves of a helix at both ends at least, as a multiple of what is taken for a line."""

NEARLY: Final = 0.999
"""Part of a length that is as good as all of it."""

STRAIGHT: Final = 1.0 - 1e-9
"""Part of its length that a way between two places is apart at least, if it is straight."""

NEAR: Final = 0.25
"""Part of the length of a line that a table may be beside it behind a corner: the next line is not nearer then."""

FROM_REST: Final = (2.0, 4.0, 1.0)
"""Lost motions that a path comes on behind a corner while the motor crosses one under a beam, in the order of trial.

From rest it is two, both with the acceleration of the axis. On more the motor turns off less, and brakes less for that.
"""

BESIDE: Final = 4
"""Changes before and behind a rest of which it is looked whether they use it: no more can be at its ends."""

BEAM_COARSER: Final = (2.0, 4.0, 8.0, 16.0, 23.0)
"""Multiples of the least error that a crossing with a beam on is given before it is left alone."""

DULL: Final = 0.5
"""Cosine of the sharpest corner that is passed as a curve where time is short: 60 degrees."""

SLOWER: Final = 4.0
"""From this multiple on it may be as slow as the path is in a dull corner; before it is to be as fast."""


class SpotSearch:
    """Finds the windows of crossings, and the changes that are moves of their own.

    Parameters
    ----------
    ground : CrossingGround
    costs : CrossingCosts
    """

    def __init__(self, ground: CrossingGround, costs: CrossingCosts) -> None:
        self._ground, self._costs = ground, costs

    def find(self, changes: Mapping[str, Array], coarser: float) -> Spots:
        """Gather the changes of all axes, and find how each is crossed."""
        ground = self._ground
        parts, columns, befores, firsts = [np.zeros((0, COLUMNS))], [], [], []
        for name, own in changes.items():
            found_rows = own
            if ground.contours:
                lost = float(np.ptp(ground.sides[name]))
                found_rows = ground.contours.beside_contours(own, AXES.index(name), lost)
            rows = self._needed(self._wound_up(found_rows, AXES.index(name)), AXES.index(name))
            first = np.append(True, np.diff(rows[:, CHAIN]) != 0.0)[: len(rows)]
            before = np.append(0.0, rows[:-1, SIGN])[: len(rows)]
            before[first] = 0.0
            parts.append(rows)
            columns.append(np.full(len(rows), AXES.index(name)))
            befores.append(before)
            firsts.append(first)
        rows = np.concatenate(parts)
        nothing = np.zeros(0)
        column, before, first = (np.concatenate([nothing, *found]) for found in (columns, befores, firsts))
        motion = rows[:, MOTION].astype(np.int64)
        at = ground.place(motion, rows[:, SHARE])
        order = np.lexsort((column, at))
        rows, motion, at = rows[order], motion[order], at[order]
        found = Spots(
            rows=rows,
            column=column[order].astype(np.int64),
            before=before[order].astype(np.int64),
            first=first[order].astype(np.bool_),
            at=at,
            rest=self._rests(rows, motion),
            bound=self._bounds(motion, at),
            feed=self._speed(rows, motion),
            jog=np.zeros(len(rows), dtype=np.bool_),
            calm=np.zeros(len(rows), dtype=np.bool_),
            window=np.zeros((len(rows), 5)),
            blend=np.zeros(len(rows)),
            spread=np.zeros(len(rows)),
            whole=np.zeros(len(rows), dtype=np.bool_),
        )
        if ground.contours:
            found = self._on_contours(found, motion)
            motion = found.rows[:, MOTION].astype(np.int64)
        return self._with_windows(found, motion, coarser)

    def _on_contours(self, spots: Spots, motion: IntArray) -> Spots:
        """Let changes on contours with cutter compensation lie in the midst of a line along which the axis rests."""
        ground = self._ground
        rest, bound, at, spread = (one.copy() for one in (spots.rest, spots.bound, spots.at, spots.spread))
        rows, feed = spots.rows.copy(), spots.feed.copy()
        for n in np.flatnonzero(ground.contours.number[motion] >= 0).tolist():
            rapid = ground.behind_rapid(rows[n])
            # The stretch of a rapid ends with it, and the axis rests beyond.
            own = self._rest_of(rows[n]) if rapid else spots.rest[n]
            line = ground.contours.straight_rest(rows[n], int(spots.column[n]), own, ground.along)
            if line is not None:
                rest[n] = bound[n] = ground.along[line : line + 2]
                at[n] = rest[n].mean()
                spread[n] = min(SLANTED, QUARTER * np.ptp(rest[n]))
                if rapid:
                    # Behind a rapid onto the contour there is no room for a move of its own.
                    rows[n, [MOTION, SHARE]], feed[n] = (line, 0.5), ground.feed[line]
        return _in_order(replace(spots, rows=rows, feed=feed, rest=rest, bound=bound, at=at, spread=spread))

    def _rest_of(self, row: Array) -> Array:
        """Places between which the axis of a change rests, shape (2,)."""
        along = self._ground.along
        ends = ((int(row[at]), row[share]) for at, share in ((FIRST, SHARE0), (LAST, SHARE1)))
        return np.array([along[k] + share * (along[k + 1] - along[k]) for k, share in ends])

    def _wound_up(self, rows: Array, column: int) -> Array:
        """Let the first change of a chain happen behind the rapid that brings the axis to its first place.

        A rapid away from there would leave the first place on an unknown side. Where the axis goes on with one before
        anything is cut, that rapid carries the change, but behind a tool change, where a program may be started again.
        """
        ground = self._ground
        first = np.append(True, np.diff(rows[:, CHAIN]) != 0.0)[: len(rows)]
        found, chain = rows.copy(), ground.program.motions.chain
        for n in np.flatnonzero(first & (rows[:, SIGN] != 0.0)).tolist():
            if rows[n, SHARE0] == 0.0 and rows[n, FIRST] == rows[n, MOTION] and rows[n, SHARE] == 1.0:
                # That rapid itself is the first to move the axis.
                continue
            place = rows[n, FIRST] if rows[n, SHARE0] == 1.0 else rows[n, FIRST] - 1.0
            carrier = ground.taken_up_by(int(place) + 1, column, rows[n, SIGN])
            if carrier is not None and chain[carrier] == chain[0]:
                found[n, MOTION], found[n, SHARE], found[n, CARRIED] = carrier, 1.0, 1.0
                continue
            rapid = int(np.searchsorted(ground.rapids, int(place), side="right")) - 1
            if rapid < 0 or ground.rapids[rapid] < ground.low[int(rows[n, CHAIN])]:
                continue
            if np.isfinite(ground.program.motions.end[ground.rapids[rapid], column]):
                found[n, MOTION], found[n, SHARE], found[n, CARRIED] = ground.rapids[rapid], 1.0, 0.0
        return found

    def _needed(self, rows: Array, column: int) -> Array:
        """Leave out what an axis does in the air between two cuts, there and back, where it then comes down alone."""
        keep = np.ones(len(rows), dtype=np.bool_)
        kind = self._ground.program.motions.kind
        there, back = rows[1:-1], rows[2:]
        before = rows[:-2]
        pairs = (there[:, CARRIED] == 1.0) & (back[:, CARRIED] == 0.0) & (back[:, SIGN] == before[:, SIGN])
        pairs &= (
            (there[:, BEYOND] == 0.0)
            & (back[:, BEYOND] == 0.0)
            & (back[:, SIGN] != 0.0)
            & (back[:, CHAIN] == before[:, CHAIN])
            & (back[:, SHARE] == 1.0)
        )
        for n in (1 + np.flatnonzero(pairs)).tolist():
            first, last = int(rows[n, MOTION]), int(rows[n + 1, MOTION])
            sign = rows[n + 1, SIGN]
            free = self._ground.offset(column, int(sign)) == 0.0 and self._ground.alone(last + 1, column, sign)
            if keep[n] and free and (kind[first : last + 1] == RAPID).all():
                keep[n : n + 2] = False
        return rows[keep]

    def _rests(self, rows: Array, motion: IntArray) -> Array:
        """Places between which the axis rests, in the stretch of path that a crossing may lie in, shape (n, 2)."""
        ground = self._ground
        region = ground.region_number[motion]
        ends = [
            ground.place(rows[:, at].astype(np.int64), rows[:, share])
            for at, share in ((FIRST, SHARE0), (LAST, SHARE1))
        ]
        low, high = ground.region_low[region], ground.region_high[region]
        return np.stack([np.clip(one, low, high) for one in ends], axis=1)

    def _bounds(self, motion: IntArray, at: Array) -> Array:
        """Places that crossings may not leave, (n, 2).

        Half way to their neighbours, the ends of their stretch, and on helices where too little of them would be left.
        """
        ground = self._ground
        region = ground.region_number[motion]
        middle = 0.5 * (at[1:] + at[:-1])
        low = np.maximum(ground.region_low[region], np.append(-np.inf, middle)[: at.size])
        high = np.minimum(ground.region_high[region], np.append(middle, np.inf)[: at.size])
        begin, end, flat = ground.along[motion], ground.along[motion + 1], LEFT_OF_HELIX * ground.flat[motion]
        inner = (flat > 0.0) & (at - begin > flat) & (end - at > flat)
        low, high = (
            np.where(inner, np.maximum(low, begin + flat), low),
            np.where(inner, np.minimum(high, end - flat), high),
        )
        return np.stack([low, high], axis=1)

    def _speed(self, rows: Array, motion: IntArray) -> Array:
        """Speed of the path at a place [m/s]: at a joint the lower of both feeds."""
        ground = self._ground
        behind = np.minimum(motion + 1, ground.feed.size - 1)
        joint = (rows[:, SHARE] == 1.0) & (ground.region[behind] == ground.region[motion])
        return np.asarray(np.where(joint, np.minimum(ground.feed[motion], ground.feed[behind]), ground.feed[motion]))

    def _times(self, spots: Spots) -> tuple[Array, Array, Array]:
        """Return for which tables wait, by which commands that go beyond are late, and in which offsets change [s]."""
        ground, none = self._ground, CrossingShape(first=0.0, wait=0.0)
        shapes = [ground.shapes.get(name, none) for name in AXES]
        wait = np.array([one.wait for one in shapes])[spots.column]
        crossing = np.array([one.first for one in shapes])[spots.column]
        late = np.where(np.array([one.beyond for one in shapes])[spots.column] > 0.0, ground.lag[spots.column], 0.0)
        # No block is shorter than a machine can tell.
        return np.maximum(wait, shortest_block(spots.feed) / np.maximum(spots.feed, 1e-12)), late, crossing

    def _crossable(self, spots: Spots, motion: IntArray, behind: IntArray) -> BoolArray:
        """Mask of the changes (n,) at which an axis turns back on the way, and the path neither stops nor has to."""
        ground, rows = self._ground, spots.rows
        ends = (rows[:, SHARE] == 1.0) & ((ground.region[behind] != ground.region[motion]) | (behind == motion))
        stops = (ground.region[motion] < 0) | ends | (ground.halts[motion] & (ground.rounding == 0.0))
        inner = (rows[:, SIGN] != 0.0) & (rows[:, CARRIED] == 0.0) & ~spots.first & (spots.feed > 0.0)
        carriers = rows[rows[:, CARRIED] == 1.0, MOTION].astype(np.int64)
        carriers = np.unique(carriers[ground.program.motions.kind[carriers] == LINE])
        return np.asarray(
            inner & (~stops | (spots.spread > 0.0)) & ~ground.stands(rows) & ~ground.lies_on(rows, carriers)
        )

    def _with_windows(self, spots: Spots, motion: IntArray, coarser: float) -> Spots:
        ground = self._ground
        motions, rows = ground.program.motions, spots.rows
        if not motion.size:
            return spots
        wait, late, crossing = self._times(spots)
        lag, behind = ground.lag[spots.column], np.minimum(motion + 1, motions.kind.size - 1)
        inner = self._crossable(spots, motion, behind)
        corner = (rows[:, SHARE] == 1.0) & (rows[:, PASSED] < KINK * spots.feed)
        room = np.minimum(spots.rest[:, 1], spots.bound[:, 1]) - np.maximum(spots.rest[:, 0], spots.bound[:, 0])
        blend = self._blends(spots, motion)
        calm = inner & (room >= spots.feed * (wait + SETTLING * lag) + 2.0 * blend)
        calm &= room > 2.0 * shortest_block(spots.feed)
        corrected = (ground.contours.number[motion] >= 0) | (ground.contours.number[behind] >= 0)
        calm &= ~corrected | (spots.spread > 0.0)
        calm, spots = self._between_corners(spots, wait, inner & ~calm & ~corrected & (lag < SHORT_LAG), calm)
        stepped = [name in ground.shapes and ground.shapes[name].steps > 1 for name in AXES]
        finest = np.where(np.array(stepped)[spots.column], STEPS_ERROR, ERROR)
        error, most = self._allowed(spots, coarser, finest)
        # Where there is time a stop leaves no error at all.
        may_wait = coarser > 1.0 and not ground.plain_corners
        works = ground.beam.works.on[motion]
        burns = ground.beam.is_beam & ground.beam.works.burns[motion]
        # A beam would burn a corner in which two axes turn for both, one after the other: they do so together.
        apart = np.append(np.diff(spots.at) > FINEST, True)
        burns &= apart & np.append(True, apart[:-1])
        sharp = inner & corner & ~corrected & (lag < SHORT_LAG) & (may_wait | burns)
        moves = np.append(np.flatnonzero(~ground.still), motions.kind.size - 1)
        spots, slowly = self._behind_corners(
            spots, sharp, corner, calm, moves[np.searchsorted(moves, behind)], error, burns
        )
        # Where the lines are too short for that, and a stop would burn, they are passed as the curve that they are.
        short = sharp & burns & ~slowly
        short[short] = ~self._stops_burn_little(spots, np.flatnonzero(short))
        # Where time is short a corner that is not too sharp is passed as a curve, too, if that is faster than a stop.
        dull = sharp & ~slowly & ~burns & (rows[:, PASSED] >= DULL * spots.feed) & ~(ground.beam.is_beam & works)
        dull &= isinstance(ground.planner, ExactPath) and coarser >= FINE
        turning = inner & ~calm & ~corrected & (~corner | short | dull)
        turning, window = self._turning(spots, motion, turning, (wait, late, crossing), (error, most, finest))
        if corrected.any():
            own = inner & ~calm & ~corner & corrected & (ground.lag[spots.column] == 0.0)
            self._on_chords(spots, own, wait, turning, window)
        turning &= self._touch_divisible(window)
        if dull.any():
            curved = replace(spots, window=np.where(turning[:, None], window, 0.0))
            turning &= ~dull | (self._costs.of_chords(curved) < self._costs.of_stops(spots))
        turning |= slowly
        window[slowly] = spots.window[slowly]
        spots = replace(spots, calm=calm, window=np.where(turning[:, None], window, 0.0), blend=blend)
        if coarser == COARSER[-1]:
            # Where a beam or a nozzle works nothing stops.
            turning &= (works & ground.beam.tends) | (self._costs.of_chords(spots) <= self._costs.of_stops(spots))
        jog = (rows[:, CARRIED] == 0.0) & ~calm & ~turning
        found = replace(spots, jog=jog, window=np.where(turning[:, None], window, 0.0))
        return _in_order(found) if spots.whole.any() else found

    def _turning(
        self,
        spots: Spots,
        motion: IntArray,
        turning: BoolArray,
        times: tuple[Array, Array, Array],
        errors: tuple[Array, Array, Array],
    ) -> tuple[BoolArray, Array]:
        """Return the changes (n,) that have windows near turning points, of those asked for, and all windows (n, 5).

        `times` are those for which tables wait, by which commands that go beyond are late, and in which offsets change
        [s]; `errors` the one allowed, the largest of all, and the finest [m].
        """
        ground, (wait, late, crossing), (error, most, finest) = self._ground, times, errors
        window, turning = np.zeros((spots.at.size, 5)), turning.copy()
        # A beam is not slowed down, nor does it stop where that burns: a coarser crossing has to do.
        lit = ground.beam.is_beam & ground.beam.works.on[motion]
        constant = lit & ground.beam.works.burns[motion]
        burns = turning & constant
        burns[burns] = ~self._stops_burn_little(spots, np.flatnonzero(burns))
        unfit, shortest = np.zeros(turning.size, dtype=np.bool_), shortest_block(spots.feed)
        push = np.array([ground.turning_push(name) for name in AXES])[spots.column]
        which, wanted = np.flatnonzero(turning), self._wanted(spots, motion, wait)
        wanted[ground.lag[spots.column] >= SHORT_LAG] = 0
        tied = ground.flat[motion] > 0.0
        wanted[tied & (wanted == 0)] = BALANCED
        passed = self._passed(spots) if (turning & constant).any() else spots.feed
        feed = np.where(lit, spots.feed, self._reached(spots, wait))
        for number, wider in enumerate((0.0, *BEAM_COARSER)):
            if which.size:
                window[which] = find_windows(
                    ground.view,
                    ground.along,
                    spots.column[which],
                    spots.rows[which, SIGN],
                    spots.rest[which],
                    spots.bound[which],
                    wait[which],
                    late[which],
                    feed[which],
                    np.maximum(error, wider * finest)[which],
                    most[which],
                    wanted[which],
                    push[which],
                    tied[which],
                )
            unfit = window[:, 1] - window[:, 0] < NEARLY * shortest
            unfit |= window[:, 2] * crossing < 0.25 * shortest
            slowed = turning & lit & (window[:, 2] < AT_SPEED * spots.feed)
            if wider >= SLOWER and (slowed & constant).any():
                slowed &= ~constant | ~self._as_slow(spots, window, passed)
            which = np.flatnonzero(slowed | (turning & burns & unfit))
            if number == len(BEAM_COARSER):
                turning &= ~slowed
        return turning & ~unfit, window

    def _touch_divisible(self, window: Array) -> BoolArray:
        """Mask of the windows (n, 5) that have a motion which may be divided: in others there is a stop instead."""
        ground = self._ground
        count = np.append(0, np.cumsum(ground.divisible))
        first = np.searchsorted(ground.along, window[:, 0], side="right") - 1
        end = np.searchsorted(ground.along, window[:, 1])
        return np.asarray(count[end] > count[first])

    def _passed(self, spots: Spots) -> Array:
        """Return the speeds at which the original passes corners [m/s], its feed elsewhere, (n,).

        Of a controller that rounds them nothing is said.
        """
        exact = isinstance(self._ground.planner, ExactPath)
        return np.where(exact & (spots.rows[:, SHARE] == 1.0), self._costs.at_corners(spots), spots.feed)

    def _reached(self, spots: Spots, wait: Array) -> Array:
        """Return how fast the original is about changes (n,) [m/s], where short blocks make joints slow.

        In short lines it may not come to its feed: a window for that would be too long.
        """
        if not self._ground.slow_in_short_blocks:
            return spots.feed
        passage = self._ground.passage
        way = 0.5 * wait * np.maximum(passage.at(spots.at)[1], LEAST_FEED)
        places = np.stack([spots.at - way, spots.at + way])
        since, until = passage.at(places)[0]
        reached = 2.0 * way / np.maximum(until - since, 1e-12)
        return np.asarray(np.clip(reached, np.minimum(LEAST_FEED, spots.feed), spots.feed))

    def _as_slow(self, spots: Spots, window: Array, passed: Array) -> BoolArray:
        """Return in which windows (n, 5) in corners a beam at constant power burns little more than it does anyway.

        The original has the speeds `passed` (n,) [m/s] there.
        """
        length = window[:, 1] - window[:, 0]
        deep = np.where(window[:, 4] == BALANCED, 2.0, 1.0) * window[:, 3]
        ramps = length - (spots.rest[:, 1] - spots.rest[:, 0])
        windows = CornerWindows(
            length=length,
            speed=window[:, 2],
            slope=np.minimum(2.0 * deep / np.maximum(ramps, FINEST), 1.0),
            passed=passed,
            feed=spots.feed,
            push=self._ground.push(spots.rows[:, MOTION].astype(np.int64)),
            lost=self._lost_and_push(spots.column)[0],
        )
        return windows_burn_little(windows)

    def _on_chords(self, spots: Spots, may: BoolArray, wait: Array, turning: BoolArray, window: Array) -> None:
        """Add the windows of changes on arcs of contours with cutter compensation to those near turning points."""
        ground = self._ground
        for n in np.flatnonzero(may).tolist():
            minus, plus = ground.sides[AXES[int(spots.column[n])]]
            length = ground.contours.chord(spots.rows[n], plus - minus)
            low, high = spots.at[n] - 0.5 * length, spots.at[n] + 0.5 * length
            if length > 0.0 and spots.bound[n, 0] <= low and high <= spots.bound[n, 1]:
                turning[n] = True
                window[n] = (
                    low,
                    high,
                    min(float(spots.feed[n]), length / float(wait[n])),
                    PART * (plus - minus),
                    CHORD,
                )

    def _between_corners(self, spots: Spots, wait: Array, may: BoolArray, calm: BoolArray) -> tuple[BoolArray, Spots]:
        """Let crossings take the whole of a straight rest between two corners, where that is faster than to stop.

        The path is slow in both corners, so that the motor has the time of the rest to cross.
        """
        ground = self._ground
        first, last = (spots.rows[:, at].astype(np.int64) for at in (FIRST, LAST))
        may = may & (spots.rows[:, SHARE0] == 1.0) & (spots.rows[:, SHARE1] == 1.0) & (last > first)
        may &= (last + 1 < ground.feed.size) & (ground.region[first] == ground.region[last])
        whole_lines = np.append(0, np.cumsum(ground.divisible))
        may &= whole_lines[last + 1] - whole_lines[first + 1] == last - first
        which = np.flatnonzero(may)
        if not which.size:
            return calm, spots
        rests = np.stack([ground.along[first[which] + 1], ground.along[last[which] + 1]], axis=1)
        length = rests[:, 1] - rests[:, 0]
        begin, end = (points_along(ground.view, ground.along, one) for one in rests.T.copy())
        straight = (length > 2.0 * shortest_block(spots.feed[which])) & (
            np.linalg.norm(end - begin, axis=1) >= STRAIGHT * length
        )
        straight &= np.max([ground.bends(place) for place in rests.T.copy()], axis=0) < KINK
        straight &= ~self._shared(spots, which, rests)
        which, rests = which[straight], rests[straight]
        # On a long line the middle of it will do.
        half = np.minimum(0.5 * (rests[:, 1] - rests[:, 0]), (wait * spots.feed)[which])
        rests = rests.mean(axis=1)[:, None] + half[:, None] * np.array([-1.0, 1.0])
        cost, feed = self._costs.of_rests(rests, spots.column[which])
        less = cost < self._costs.of_stops(spots)[which]
        which, rests, feed = which[less], rests[less], feed[less]
        rest, at, speed, whole = spots.rest.copy(), spots.at.copy(), spots.feed.copy(), spots.whole.copy()
        rest[which], at[which], speed[which], whole[which] = rests, rests.mean(axis=1), feed, True
        bound = spots.bound.copy()
        bound[which] = rests
        for step, side in ((-1, 1), (1, 0)):
            beside = np.clip(which + step, 0, at.size - 1)
            limit = np.clip(bound[beside, side], *((-np.inf, rests[:, 0]) if side else (rests[:, 1], np.inf)))
            bound[beside, side] = np.where(beside == which, bound[beside, side], limit)
        return calm | whole, replace(spots, rest=rest, bound=bound, at=at, feed=speed, whole=whole)

    def _behind_corners(
        self,
        spots: Spots,
        may: BoolArray,
        corner: BoolArray,
        calm: BoolArray,
        behind: IntArray,
        error: Array,
        burns: BoolArray,
    ) -> tuple[Spots, BoolArray]:
        """Find windows behind corners that the path leaves so slowly that the motor crosses meanwhile.

        The table waits, and is where it should be at the end of the window: on a straight line it is beside the path by
        the axis' way until then, as far as that is across the line. Where a beam `burns` what stands, that is better
        than a stop, the path comes out of the corner from rest, and on so little of an arc it is nearly straight.
        """
        ground = self._ground
        found = np.zeros(may.size, dtype=np.bool_)
        kind = ground.program.motions.kind[behind]
        # A beam is on so little of an arc that it is straight there.
        straight = (kind == LINE) | (burns & (kind == ARC))
        which = np.flatnonzero(may & ~calm & straight & ground.divisible[behind])
        if not which.size:
            return spots, found
        feed, column = spots.feed[which], spots.column[which]
        lost, push = self._lost_and_push(column)
        time = 2.0 * np.sqrt(lost / push)
        if not isinstance(ground.planner, ExactPath):
            waits = [ground.shapes[AXES[n]].wait for n in column.tolist()]
            time = np.maximum(waits, lost / np.sqrt(push * BLENDED))
        shortest = shortest_block(feed)
        begin, end = spots.at[which], ground.along[behind[which] + 1]
        lit = burns[which]
        # What happens in the next corner begins there.
        next_begin = np.where(spots.whole, spots.rest[:, 0], np.where(corner & ~calm, spots.at, -np.inf))
        limit = np.minimum(end, np.maximum(spots.bound[:, 1], np.append(next_begin[1:], -np.inf))[which])
        fits, finish, beside = np.zeros(which.size, dtype=np.bool_), begin.copy(), np.zeros(which.size)
        corner_point = points_along(ground.view, ground.along, begin)
        for part in FROM_REST:
            own = begin + np.maximum(np.where(lit, np.minimum(feed * time, part * lost), feed * time), shortest)
            own = np.where(lit, np.minimum(own, end), own)
            own = np.where(end - own < shortest, np.maximum(own, end), own)
            fit = (own <= limit) & (own - begin >= shortest)
            way = np.abs(points_along(ground.view, ground.along, own) - corner_point)[np.arange(which.size), column]
            across = np.sqrt(np.maximum(1.0 - (way / np.maximum(own - begin, FINEST)) ** 2, 0.0))
            off = way * across * lost / (lost + way)
            fit &= lit | ((way <= PART * lost) & (off <= np.minimum(error[which], NEAR * (end - begin))))
            fit &= off <= MOST * lost
            if lit.any():
                fit &= ~lit | self._burns_little(spots, which, own - begin, lost)
            finish, beside = np.where(fit & ~fits, own, finish), np.where(fit & ~fits, off, beside)
            fits |= fit
        which = which[fits]
        begin, finish, feed, beside = (one[fits] for one in (begin, finish, feed, beside))
        window, bound = spots.window.copy(), spots.bound.copy()
        found[which] = True
        window[which] = np.stack([begin, finish, feed, beside, np.full(which.size, BEHIND)], axis=1)
        bound[which] = window[which, :2]
        after = np.minimum(which + 1, may.size - 1)
        bound[after, 0] = np.where(after > which, np.maximum(bound[after, 0], finish), bound[after, 0])
        return replace(spots, window=window, bound=bound), found

    def _burns_little(self, spots: Spots, which: IntArray, along: Array, lost: Array) -> BoolArray:
        """Return whether a beam may stay on in windows (n,) that lead `along` the path [m] behind corners."""
        speed = spots.feed[which] * (1.0 + RAISED * lost / along)
        return self._ground.burns_little(spots.at[which], along, _ways_across(spots, which, lost), speed)

    def _stops_burn_little(self, spots: Spots, which: IntArray) -> BoolArray:
        """Return whether a beam may stay on in stops (n,) in which an axis alone crosses its backlash."""
        lost, push = self._lost_and_push(spots.column[which])
        speed = np.minimum(spots.feed[which], np.sqrt(2.0 * push * lost))
        along, way = np.zeros(which.size), _ways_across(spots, which, lost)
        return self._ground.burns_little(spots.at[which], along, way, speed)

    def _lost_and_push(self, column: IntArray) -> Array:
        """Lost motion [m] and acceleration [m/s²] of axes (n,), shape (2, n)."""
        axes = [self._ground.machine.axes[AXES[n]] for n in column.tolist()]
        return np.array([(axis.gap.lost_motion, axis.limits.acceleration) for axis in axes]).reshape(-1, 2).T

    @staticmethod
    def _shared(spots: Spots, which: IntArray, rests: Array) -> BoolArray:
        """Mask of the rests (n, 2) of changes in which another axis may cross as well."""
        found = np.zeros(which.size, dtype=np.bool_)
        for step in (*range(-BESIDE, 0), *range(1, BESIDE + 1)):
            other = np.clip(which + step, 0, spots.at.size - 1)
            length = rests[:, 1] - rests[:, 0]
            overlap = np.minimum(rests[:, 1], spots.rest[other, 1]) - np.maximum(rests[:, 0], spots.rest[other, 0])
            near = (spots.at[other] > rests[:, 0] - length) & (spots.at[other] < rests[:, 1] + length)
            found |= (other != which) & near & (overlap > SAME) & (spots.rows[other, CARRIED] == 0.0)
        return found

    def _allowed(self, spots: Spots, coarser: float, finest: Array) -> tuple[Array, Array]:
        """Return errors of crossings (n,) [m], up to a multiple of the `finest` ones (n,), and the largest of all."""
        ground, column = self._ground, spots.column
        lost = ground.lost[column]
        part = PART * max(coarser / LARGE, 1.0)
        error = np.minimum(coarser * finest, np.maximum(FINE * finest, part * lost))
        none = CrossingShape(first=0.0, wait=1.0)
        shapes = [ground.shapes.get(name, none) for name in AXES]
        beyond = np.array([one.beyond for one in shapes])[column]
        farther = np.array([exaggeration(one, float(c)) for one, c in zip(shapes, ground.lag, strict=True)])[column]
        # A motor without lag, or one that is held there, would take the table so far off the path.
        whole = np.array([max(map(abs, ground.sides.get(name, (0.0,)))) for name in AXES])[column]
        most = np.minimum(np.minimum((MOST + beyond) * lost, whole) / farther, whole - beyond * lost)
        return error, np.maximum(most, finest)

    def _blends(self, spots: Spots, motion: IntArray) -> Array:
        """Return how far from a corner the controller may round it within its tolerance P [m], shape (n,).

        An arc that passes a corner with the deflection φ within P begins P cot(φ/4) before it.
        """
        if isinstance(self._ground.planner, ExactPath):
            return np.zeros(motion.size)
        allowed = np.maximum(tolerances(self._ground.program, self._ground.planner)[motion], 0.0)
        passed = spots.rows[:, PASSED] / np.maximum(spots.feed, LEAST_FEED)
        known = spots.at == spots.rest[:, 0]
        angle = np.where(known, np.arccos(np.clip(passed, -1.0, 1.0)), BLEND_ANGLE)
        reach = allowed / np.tan(0.25 * np.maximum(angle, BLEND_ANGLE))
        # Nearer to the corner a crossing would begin in it.
        shortest = np.maximum(self._ground.least * spots.feed, shortest_block(spots.feed))
        return np.asarray(np.where(reach > 0.0, np.maximum(reach, CLEAR * shortest), 0.0))

    def _wanted(self, spots: Spots, motion: IntArray, wait: Array) -> IntArray:
        """Kinds of crossings (n,) that leave the part proud, or that a controller passes faster; 0 for none.

        LinuxCNC takes far less acceleration in an arc that ends in a rounded joint than before a tangent.
        """
        ground = self._ground
        found = np.zeros(motion.size, dtype=np.int64)
        if not (isinstance(ground.planner, ExactPath) or ground.planner.bounded):
            tangent = 0.5 * (OUTER - 1.0) * wait * spots.feed
            long = tangent >= CLEAR * np.maximum(ground.least * spots.feed, shortest_block(spots.feed))
            found[long & (ground.program.motions.kind[motion] == ARC)] = BALANCED
        if not ground.part_side:
            return found
        middle, rows, half = spots.rest.mean(axis=1), np.arange(motion.size), 0.5 * shortest_block(spots.feed)
        ahead, behind = (points_along(ground.view, ground.along, middle + d) for d in (half, -half))
        way, columns = ahead - behind, plane_columns(ground.program.motions.plane[motion])
        # How far the centre of curvature is to the left: it lies where the axis goes after its reversal.
        first, second = (way[rows, columns[:, k]] for k in (0, 1))
        left = np.where(spots.column == columns[:, 0], -second, np.where(spots.column == columns[:, 1], first, 0.0))
        left *= spots.rows[:, SIGN] * ground.part_side
        found[left > 0.0], found[left < 0.0] = OUTWARD, INWARD
        return found


def _ways_across(spots: Spots, which: IntArray, lost: Array) -> Array:
    """Ways (n, 3) [m] by which motors cross the backlash of axes."""
    way = np.zeros((which.size, len(AXES)))
    way[np.arange(which.size), spots.column[which]] = spots.rows[which, SIGN] * lost
    return way


def _in_order(spots: Spots) -> Spots:
    """Return changes in the order of travel."""
    order = np.lexsort((spots.column, spots.at))
    return Spots(**{name: getattr(spots, name)[order] for name in Spots.__struct_fields__})
