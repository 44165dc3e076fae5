"""What crossings and stops cost in time."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Final

import numpy as np

from ph_post.compensate.offsets import DWELL, corner_pause
from ph_post.drive.cascade import response_time
from ph_post.edit.crossing_ground import LEAST_FEED, CrossingGround, Spots
from ph_post.edit.crossing_shapes import (
    BALANCED,
    BEHIND,
    CHORD,
    LONG,
    OUTER,
    OUTWARD,
    CrossingShape,
    points_along,
)
from ph_post.edit.crossings import BLENDED, KINK, LONE, SETTLING, shortest_block
from ph_post.edit.edits import SYNCHRONISED, dwell_time
from ph_post.edit.lagging_crossings import RESIDUE
from ph_post.edit.reversals import (
    BEYOND,
    MOTION,
    PASSED,
    SHARE,
    SIGN,
)
from ph_post.gcode.program import AXES, LINE, RAPID, PlaceArray
from ph_post.simulate.controllers.exact_path import smooth_acceleration
from ph_post.simulate.controllers.junctions import junction_speed
from ph_post.simulate.controllers.moves import limit_table
from ph_post.types import Array, Axis, BoolArray, ExactPath, IntArray, KlipperCorner
from ph_post.units import MM

SOONER: Final = 0.02
"""An axis comes from beyond its place where its motor need not be there for so much longer [s] then."""

BESIDE_WINDOW: Final = 1e-3 * MM
"""Way [m] beside a window of which the direction is that of the path there."""

STEEP: Final = 0.1
"""An axis that has this part in a straight move takes up its backlash on a short way of it."""


class CrossingCosts:
    """The time that the changes of a program take.

    Parameters
    ----------
    ground : CrossingGround
    """

    def __init__(self, ground: CrossingGround) -> None:
        self._ground = ground

    def of(self, spots: Spots, coarser: float) -> Array:
        """Return the time [s] of every change (n,), with errors of crossings up to a multiple of the least."""
        cost, together = np.zeros(spots.column.size), np.ones(spots.column.size)
        places = spots.rows[spots.jog, MOTION] + spots.rows[spots.jog, SHARE]
        _, place, count = np.unique(places, return_inverse=True, return_counts=True)
        together[spots.jog] = count[place]
        standing, motions = self.of_stops(spots), self._ground.program.motions
        in_place = self.in_place(spots.rows, spots.column, spots.before)
        for column in np.unique(spots.column).tolist():
            axis = self._ground.machine.axes[AXES[column]]
            jogs = (spots.column == column) & spots.jog
            ahead, behind, beyond = self.waits(spots.rows[jogs], spots.first[jogs], axis, coarser)
            # Out there and back from it, in the air; a rapid that moves the axis goes there itself.
            motion, sign = spots.rows[jogs, MOTION].astype(np.int64), spots.rows[jogs, SIGN]
            begin, end = (one[motion, column] for one in (motions.start, motions.end))
            carried = (begin != end) & np.isfinite(end) & ((axis.name != "Z") | (sign < 0.0))
            move = 2.0 * math.sqrt(self._ground.overshoot[axis.name] / axis.limits.acceleration)
            ahead, behind = self._ground.planner.dwell(ahead), self._ground.planner.dwell(behind)
            # Axes that come to a place together wait together.
            alone = beyond & ~carried
            moves = np.where(beyond, move * (1.0 + alone), standing[jogs])
            cost[jogs] = moves + np.where(alone, ahead, ahead / together[jogs]) + behind / together[jogs]
            rest = np.maximum(ahead, self._ground.planner.dwell(np.array(dwell_time(self.least_rest(axis)))))
            cost[jogs] += np.where(in_place[jogs], standing[jogs] + rest, 0.0)
        # Axes that cross at a place without a rest do so in one move, and so are they taken back behind a cut.
        number, longest = np.zeros(cost.size, dtype=np.int64), np.zeros(count.size)
        number[spots.jog] = place
        moved = spots.jog & (cost == standing) & (spots.before != 0)
        moved &= (spots.rows[:, SIGN] != 0.0) | ~self._in_air(spots.rows)
        np.maximum.at(longest, number[moved], cost[moved])
        cost[moved] = (longest / np.maximum(np.bincount(number[moved], minlength=count.size), 1))[number[moved]]
        chords = spots.window[:, 2] > 0.0
        cost[chords] = self.of_chords(spots)[chords]
        if spots.whole.any():
            cost[spots.whole] = self.of_rests(spots.rest[spots.whole], spots.column[spots.whole])[0]
        return cost

    def of_stops(self, spots: Spots) -> Array:
        """Time [s] that a stop with a move of the axis alone takes, rests apart (n,)."""
        axes = self._ground.machine.axes
        pushes = [axes[n].limits.acceleration * self._smooth if n in axes else 1.0 for n in AXES]
        moves = np.sqrt(self._ground.lost / pushes)
        passed = self.at_corners(spots)
        # Between its ends 2 √(g/a); a corner is passed slowly anyway, which takes about half of it.
        longer = 1.0 + np.minimum(passed / np.maximum(spots.feed, LEAST_FEED), 1.0)
        move = moves[spots.column] * longer
        if not isinstance(self._ground.planner, ExactPath):
            # Where joints are rounded it is not much faster than the path.
            fastest = np.maximum(spots.feed, np.array([self.beside_cut(axes.get(n)) for n in AXES])[spots.column])
            lost = self._ground.lost[spots.column]
            move = np.where(spots.rows[:, SIGN] == 0.0, move, np.maximum(move, lost / fastest))
        found = move + passed / self._push(spots)
        which = np.flatnonzero(passed > 0.0)
        if which.size and self._ground.slow_in_short_blocks:
            found[which] = self._between_joints(spots, which)
        return np.asarray(found)

    def _between_joints(self, spots: Spots, which: IntArray) -> Array:
        """Time [s] that stops (n,) take where the controller is not at rest in their joints."""
        ground, column, at = self._ground, spots.column[which], spots.at[which]
        own = self._smooth * np.array([ground.machine.axes[AXES[n]].limits.acceleration for n in column.tolist()])
        lost = ground.lost[column]
        points = [points_along(ground.view, ground.along, at + side) for side in (-BESIDE_WINDOW, 0.0, BESIDE_WINDOW)]
        into, out = _blocks_between(np.array(points))[0]
        across = np.zeros(into.shape)
        across[np.arange(at.size), column] = spots.rows[which, SIGN]
        bound = junction_speed(
            ground.machine,
            np.stack([into, across]),
            np.stack([across, out]),
            np.stack([at - ground.joint_before(at), lost]),
            np.stack([lost, ground.joint_behind(at) - at]),
            feed=np.maximum(spots.feed[which], LEAST_FEED),
        ).min(axis=0)
        beside = ground.passage.at(at)[1]
        # Its move is as fast as it would be halfway from rest to rest, where a motor that lags is waited for.
        fastest = np.sqrt(own * lost)
        bound = np.where(ground.lag[column] > 0.0, 0.0, np.minimum(np.minimum(bound, beside), fastest))
        move = 2.0 * (fastest - bound) / own + bound**2 / (own * fastest)
        ramps = self._ramps(
            np.stack([at, at]), np.stack([bound, bound]), np.stack([beside, beside]), self._push(spots)[which]
        )
        return np.asarray(move + ramps)

    def _push(self, spots: Spots) -> Array:
        """Acceleration along the path at every change (n,) [m/s²], as far as short lines use it."""
        return self._smooth * self._ground.push(spots.rows[:, MOTION].astype(np.int64))

    @cached_property
    def _smooth(self) -> float:
        """Part of its acceleration that a controller uses where it soon slows down again.

        Lines of prints are shorter than their ramps, and Klipper keeps them to what a lower acceleration would reach.
        """
        planner, push = self._ground.planner, float(limit_table(self._ground.machine)[:2, 1].min())
        if isinstance(planner, ExactPath) and isinstance(planner.corner, KlipperCorner):
            return smooth_acceleration(planner.corner, push) / push
        return 1.0

    def at_corners(self, spots: Spots) -> Array:
        """Speed at which the path passes the place of every change (n,) [m/s]: 0 where it is no reversal in a cut.

        An exact path passes the corner of two lines no faster than the rule of its controller lets it.
        """
        ground, rows = self._ground, spots.rows
        passed = np.where(spots.first | (rows[:, SIGN] == 0.0), 0.0, rows[:, PASSED])
        if not isinstance(ground.planner, ExactPath):
            return passed
        line, motion = ground.program.motions.kind == LINE, rows[:, MOTION].astype(np.int64)
        behind = np.minimum(motion + 1, line.size - 1)
        corner = (passed > 0.0) & (rows[:, SHARE] == 1.0) & line[motion] & line[behind]
        both = np.stack([motion[corner], behind[corner]])
        length = ground.along[both + 1] - ground.along[both]
        units = ground.way(both) / np.maximum(length, 1e-12)[..., None]
        bound = junction_speed(ground.machine, *units, *length, feed=ground.feed[both].min(axis=0))
        passed[corner] = np.minimum(passed[corner], bound)
        return passed

    def of_chords(self, spots: Spots) -> Array:
        """Time [s] that the windows of crossings take longer than the path, with the ramps beside them (n,).

        About a corner an exact path is no faster than its controller lets it, into the window and out of it; where
        short blocks make joints slow that is so in all of them on straight moves.
        """
        feed, push = np.maximum(spots.feed, LEAST_FEED), self._push(spots)
        speed = np.where(spots.window[:, 2] > 0.0, spots.window[:, 2], feed)
        if isinstance(self._ground.planner, ExactPath):
            feed, speed = self._let_through(spots, feed, speed)
        way = spots.window[:, 1] - spots.window[:, 0]
        found = (feed - speed) ** 2 / (feed * push) + way / speed - way / feed + self._ground.longer
        which = np.flatnonzero((spots.window[:, 2] > 0.0) & (self._ground.lag[spots.column] == 0.0))
        if which.size and self._ground.slow_in_short_blocks:
            places, added = self._knots(spots, which)
            straight = self._on_lines(places[0], places[-1])
            which, places, added = which[straight], places[:, straight], added[:, straight]
            found[which] = self._through_joints(spots, which, places, added)
        return np.asarray(found)

    def _on_lines(self, begin: Array, end: Array) -> BoolArray:
        """Mask of the stretches (n,) between two places without an arc or a curve, in whose chords joints are too."""
        ground = self._ground
        curved = np.concatenate([[0], np.cumsum(ground.program.motions.kind != LINE)])
        first = np.searchsorted(ground.along, begin, side="right") - 1
        last = np.searchsorted(ground.along, end, side="left")
        return np.asarray(curved[last] == curved[first])

    def _let_through(self, spots: Spots, feed: Array, speed: Array) -> tuple[Array, Array]:
        """Lower the speeds of the path beside windows about corners, and in them (n,) [m/s], to those of joints."""
        ground, passed = self._ground, spots.rows[:, PASSED]
        corner = (spots.rows[:, SHARE] == 1.0) & (passed < KINK * spots.feed)
        which = np.flatnonzero(corner & (spots.window[:, 2] > 0.0))
        if not which.size:
            return feed, speed
        begin, finish = spots.window[which, :2].T.copy()
        lost = ground.lost[spots.column[which]]
        edges = [begin - BESIDE_WINDOW, begin, finish, finish + BESIDE_WINDOW]
        points = np.array([points_along(ground.view, ground.along, one) for one in edges])
        points[2:, np.arange(which.size), spots.column[which]] += spots.rows[which, SIGN] * lost
        units, length = _blocks_between(points)
        length[[0, 2]] = LONG
        bound = junction_speed(ground.machine, units[:-1], units[1:], length[:-1], length[1:], feed=feed[which])
        feed, speed = feed.copy(), speed.copy()
        speed[which] = np.maximum(np.minimum(speed[which], bound.min(axis=0)), LEAST_FEED)
        feed[which] = np.clip(self.at_corners(spots)[which], speed[which], feed[which])
        return feed, speed

    @staticmethod
    def _ramps(ends: Array, speed: Array, beside: Array, push: Array) -> Array:
        """Time [s] of ramps to changes between two places (2, n) [m] and from them, to speeds there (2, n) [m/s].

        They lead from the speeds that the path has `beside` (2, n) [m/s], and reach halfway to the next of these.
        """
        room = np.full(ends.shape, math.inf)
        order = np.argsort(ends[0], kind="stable")
        half = 0.5 * np.maximum(ends[0, order[1:]] - ends[1, order[:-1]], 0.0)
        room[0, order[1:]] = room[1, order[:-1]] = half
        beside = np.maximum(beside, LEAST_FEED)
        speed = np.minimum(speed, beside)
        way = np.minimum(room, (beside**2 - speed**2) / (2.0 * push))
        return np.asarray(((np.sqrt(speed**2 + 2.0 * push * way) - speed) / push - way / beside).sum(axis=0))

    def _knots(self, spots: Spots, which: IntArray) -> tuple[Array, Array]:
        """Return places of joints in windows and beside them, and what is added to their axes there, (6, n) [m] each.

        As :class:`~ph_post.edit.crossings.CrossingPlanner` makes them: a block between two tangents, or between two
        parts of the path. The first and the last are the program's own, whose blocks become shorter.
        """
        ground, shortest = self._ground, shortest_block(spots.feed[which])
        begin, finish, speed, error, kind = spots.window[which].T
        none = CrossingShape(first=0.0, wait=1.0)
        shapes = [ground.shapes.get(name, none) for name in AXES]
        lasts = np.array([max(one.first, LONE * one.wait) for one in shapes])[spots.column[which]] * speed
        whole = (kind == BEHIND) | (kind == CHORD)
        ahead = np.where(whole, 0.0, np.maximum(0.5 * (finish - begin - np.maximum(lasts, shortest)), 0.0))
        half = 0.5 * np.maximum(finish - begin - (spots.rest[which, 1] - spots.rest[which, 0]), 0.0)
        out = np.where(kind == BALANCED, OUTER - 1.0, 1.0) * half
        tangents = ((kind == BALANCED) | (kind == OUTWARD)) & (out > 0.0)
        sign, lost = spots.rows[which, SIGN], ground.lost[spots.column[which]]
        bulge = np.where(tangents, -sign * error * ((out + ahead) / np.maximum(out, 1e-12)) ** 2, 0.0)
        first, last = begin + ahead, finish - ahead
        beside = np.stack([ground.joint_before(first), ground.joint_behind(last)])
        ends = np.where(tangents, np.stack([begin - out, finish + out]), beside)
        # An end that would be close to a joint of the program is moved there.
        near, inner = np.maximum(shortest, ground.least * spots.feed[which]), np.stack([first, last])
        for joints in (ground.joint_before(ends), ground.joint_behind(ends)):
            close = (np.abs(ends - joints) < near) & (np.abs(inner - joints) > near)
            ends = np.where(tangents & close, joints, ends)
        zero, through = np.zeros(first.size), sign * lost
        places = [ground.joint_before(ends[0]), ends[0], first, last, ends[1], ground.joint_behind(ends[1])]
        return np.stack(places), np.stack([zero, zero, bulge, through + bulge, through, through])

    def _through_joints(self, spots: Spots, which: IntArray, places: Array, added: Array) -> Array:
        """Time [s] that windows (n,) take longer than the path, by the speeds at which their joints are passed.

        `places` and `added` (6, n) [m] of :meth:`_knots`, on straight moves alone.
        """
        ground, push = self._ground, self._push(spots)[which]
        feed, column = np.maximum(spots.feed[which], LEAST_FEED), spots.column[which]
        edges = np.stack([places[0] - BESIDE_WINDOW, *places, places[-1] + BESIDE_WINDOW])
        points = np.array([points_along(ground.view, ground.along, one) for one in edges])
        points[:, np.arange(which.size), column] += np.stack([added[0], *added, added[-1]])
        units, length = _blocks_between(points)
        # Blocks end at the program's own joints, too.
        beyond = np.full((1, which.size), math.inf)
        apart = np.concatenate([beyond, np.diff(places, axis=0), beyond])
        before = np.minimum(places - ground.joint_before(places), apart[:-1])
        after = np.minimum(ground.joint_behind(places) - places, apart[1:])
        before, after = (np.maximum(one, shortest_block(feed)) for one in (before, after))
        bound = junction_speed(ground.machine, units[:-1], units[1:], before, after, feed=feed)
        since, beside = ground.passage.at(places[[0, -1]])
        bound[[0, -1]] = np.minimum(bound[[0, -1]], beside)
        own = push / self._smooth
        gain = 2.0 * own * length[1:-1]
        square = bound**2
        for k in range(len(gain)):
            square[k + 1] = np.minimum(square[k + 1], square[k] + gain[k])
        for k in reversed(range(len(gain))):
            square[k] = np.minimum(square[k], square[k + 1] + gain[k])
        most = np.stack([feed, feed, np.clip(spots.window[which, 2], LEAST_FEED, feed), feed, feed]) ** 2
        square = np.maximum(square, LEAST_FEED**2)
        fastest = np.minimum(most, 0.5 * (square[:-1] + square[1:] + self._smooth * gain))
        fastest = np.maximum(fastest, np.maximum(square[:-1], square[1:]))
        peak, speed = np.sqrt(fastest), np.sqrt(square)
        steady = np.maximum(gain - (2.0 * fastest - square[:-1] - square[1:]), 0.0) / (2.0 * own * peak)
        time = ((2.0 * peak - speed[:-1] - speed[1:]) / own + steady).sum(axis=0)
        inside = np.maximum(time - (since[1] - since[0]), 0.0)
        ramps = self._ramps(places[[0, -1]], speed[[0, -1]], beside, push)
        return np.asarray(inside + ramps + ground.longer)

    def of_rests(self, rests: Array, column: IntArray) -> tuple[Array, Array]:
        """Return the time [s] of crossings that take rests (n, 2) between corners, and their feeds [m/s], (n,)."""
        ground = self._ground
        axes = [ground.machine.axes[AXES[n]] for n in column.tolist()]
        lost = np.array([axis.gap.lost_motion for axis in axes])
        push, most = np.array([(axis.limits.acceleration, axis.limits.velocity) for axis in axes]).reshape(-1, 2).T
        length = rests[:, 1] - rests[:, 0]
        line = np.searchsorted(ground.along, rests.mean(axis=1), side="right") - 1
        feed = np.maximum(ground.feed[line], LEAST_FEED)
        longer = _between_stops(lost, push, most) - _between_stops(length, ground.push(line), feed)
        return np.maximum(longer, 0.0), np.minimum(feed, most * length / lost)

    @staticmethod
    def beside_cut(axis: Axis | None) -> float:
        """Return the speed [m/s] of an axis that is let be faster than a cut with which its joint is rounded."""
        return LEAST_FEED if axis is None else math.sqrt(axis.limits.acceleration * BLENDED)

    @staticmethod
    def _pause(axis: Axis, coarser: float) -> float:
        """Rest before and behind a jog [s]: where the motor lags, until it has arrived; none where time is short."""
        return corner_pause(axis) if response_time(axis.servo) > 0.0 and coarser == 1.0 else 0.0

    def least_rest(self, axis: Axis) -> float:
        """Return the least rest [s] beside the moves of an axis alone that begin and end a cut.

        Where no joint is rounded and the motor follows at once, all has arrived when the moves are done.
        """
        follows = response_time(axis.servo) == 0.0 and isinstance(self._ground.planner, ExactPath)
        return SYNCHRONISED if follows else DWELL

    def in_place(self, rows: Array, column: IntArray, before: IntArray) -> BoolArray:
        """Mask of the changes (n,) for which an axis goes from one side of its backlash to the other, and rests.

        No rapid leads to its first place, and the path does not take it up there within a short way.
        """
        ground = self._ground
        after = np.minimum(rows[:, MOTION].astype(np.int64) + (rows[:, SHARE] == 1.0), ground.feed.size - 1)
        way = ground.way(after)[np.arange(after.size), column] * rows[:, SIGN]
        lost = np.array(
            [ground.sides[name][1] - ground.sides[name][0] if name in ground.sides else 0.0 for name in AXES]
        )
        taken = (ground.program.motions.kind[after] == LINE) & (way >= lost[column])
        taken &= way >= STEEP * (ground.along[after + 1] - ground.along[after])
        return np.asarray((before == 0) & (rows[:, SIGN] != 0.0) & ~self._in_air(rows) & ~taken)

    def _in_air(self, rows: Array) -> BoolArray:
        """Mask of the changes (n,) that are made behind a rapid."""
        kind = self._ground.program.motions.kind[rows[:, MOTION].astype(np.int64)]
        return np.asarray((kind == RAPID) & (rows[:, SHARE] == 1.0))

    @cached_property
    def _seen(self) -> PlaceArray:
        """The motions but rapids to the same place, with room for one more, which is none."""
        motions = self._ground.program.motions
        seen = motions.kind != RAPID
        for axis in range(3):  # one by one: there may be a million motions
            seen |= motions.start[:, axis] != motions.end[:, axis]
        return np.append(np.flatnonzero(seen), seen.size).astype(np.int32)

    def _before_cut(self, rows: Array) -> BoolArray:
        """Mask of the changes (n,) behind whose motion a cut comes next, rapids to the same place apart."""
        kind = self._ground.program.motions.kind
        behind = self._seen[np.searchsorted(self._seen, (rows[:, MOTION] + 1.0).astype(np.int32))]
        return np.asarray((behind < kind.size) & (kind[np.minimum(behind, kind.size - 1)] != RAPID))

    def waits(self, rows: Array, first: BoolArray, axis: Axis, coarser: float) -> tuple[Array, Array, BoolArray]:
        """Rests before jogs and behind them (n,) [s], and which come from beyond their places, in the air.

        Behind a rapid a motor that lags has to be there before it is called back: wholly where it crosses its backlash
        and no more, and else half as far beyond as its table follows. A cut that began at once would begin with the
        lag of rapid and jog.
        """
        in_air = self._in_air(rows)
        onto_side = in_air & (rows[:, SIGN] != 0.0)
        reserve = max(0.5 * (self._ground.overshoot[axis.name] - axis.gap.lost_motion), RESIDUE)
        whole, part = _settled(axis, RESIDUE), _settled(axis, reserve)
        beyond = onto_side & (first | (rows[:, BEYOND] == 1.0) | (whole > part + SOONER))
        pause = np.where(in_air, 0.0, self._pause(axis, coarser))
        cut = onto_side & self._before_cut(rows)
        ahead = np.where(beyond, part, np.where(onto_side, whole, pause))
        behind = np.where(cut, SETTLING * response_time(axis.servo), pause)
        return ahead, behind, np.asarray(beyond)


def _blocks_between(points: Array) -> tuple[Array, Array]:
    """Return directions (m - 1, n, 3) and lengths (m - 1, n) [m] of straight blocks between points (m, n, 3)."""
    ways = np.diff(points, axis=0)
    length = np.maximum(np.linalg.norm(ways, axis=2), 1e-12)
    return ways / length[..., None], length


def _between_stops(way: Array, push: Array, most: Array) -> Array:
    """Time of ways [m] from rest to rest, by acceleration [m/s²] and largest speed [m/s], in s."""
    return np.asarray(np.where(way < most**2 / push, 2.0 * np.sqrt(way / push), way / most + most / push))


def _settled(axis: Axis, residue: float) -> float:
    """Return how long the motor of an axis lags behind a rapid by more than a residue [m], in s.

    It is a c² away from where the command comes to rest with the acceleration a.
    """
    lag = response_time(axis.servo)
    return lag * math.log(max(axis.limits.acceleration * lag**2 / residue, 1.0))
