"""Choose how each reversal of a program is crossed, at which cost in time, and plan it."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.compensate.offsets import DWELL, corner_pause, make_jog
from ph_post.dialects.base import Dialect
from ph_post.dialects.planners import planner_of
from ph_post.drive.cascade import response_time
from ph_post.edit.beams import BeamGuard
from ph_post.edit.block_words import words_by_letter
from ph_post.edit.crossing_shapes import (
    AT_SPEED,
    INWARD,
    OUTWARD,
    RESIDUE,
    SHORT_LAG,
    TURNING,
    CrossingShape,
    crossing_shape,
    fastest_in_arcs,
    find_windows,
    points_along,
    shape_in_steps,
    shortest_time,
)
from ph_post.edit.crossings import (
    COARSER,
    ERROR,
    FINE,
    KINK,
    LARGE,
    MOST,
    PART,
    SETTLING,
    SHORTEST,
    CrossingPlace,
    CrossingPlanner,
    exaggeration,
)
from ph_post.edit.edits import CrossingEdit, OffsetShift, StopEdit
from ph_post.edit.positions import Restart
from ph_post.edit.preconditions import why_kept_whole
from ph_post.edit.reversals import (
    BEYOND,
    CARRIED,
    CHAIN,
    COLUMNS,
    FIRST,
    LAST,
    MOTION,
    PASSED,
    SHARE,
    SHARE0,
    SHARE1,
    SIGN,
    motion_view,
)
from ph_post.gcode.further import further_lines
from ph_post.gcode.motion_parts import places_along
from ph_post.gcode.program import ARC, AXES, CUBIC, LINE, NURBS, RAPID, PartProgram, plane_columns
from ph_post.simulate.controllers.legs import ACROSS
from ph_post.simulate.controllers.run import planned_speeds, tolerances
from ph_post.types import Array, Axis, BoolArray, ExactPath, IntArray, Machine
from ph_post.units import MM

APPROACH: Final = 2.0
"""An axis whose side of the backlash is not known approaches its place from this many lost motions before it."""

STEPS_ERROR: Final = 1.25e-3 * MM
"""As :data:`ERROR`, of crossings in steps: a controller that rounds joints slows down with half of the acceleration in
arcs, so that less error takes much time."""

CLEAR: Final = 1.5
"""Times the shortest block: what a crossing leaves at least between itself and a corner that is rounded."""

BLEND_ANGLE: Final = math.radians(20.0)
"""Corners duller than this reach no farther into the path than this one when they are rounded."""

NEARLY: Final = 0.999
"""Part of a length that is as good as all of it."""

LEAST_FEED: Final = 1e-4
"""Feeds below this [m/s] are reckoned as this."""

PERIODS: Final = 2.0
"""No block is to be shorter than so many servo periods: a controller slows down for it."""

LINE_SIZE: Final = 35.0
"""Length of a line of a crossing [bytes], for controllers that are fed over a serial line."""

SOONER: Final = 0.02
"""An axis comes from beyond its place where its motor need not be there for so much longer [s] then."""

BEAM_COARSER: Final = (2.0, 4.0, 8.0)
"""Multiples of the least error that a crossing with a beam on is given before it is left alone."""

INTERRUPTING: Final = frozenset((0, 1, 3, 4, 5, 6, 7, 8, 9, 19, 60, 62, 63, 64, 65, 66, 67, 68))
"""M words between two motions over which no crossing reaches."""


class Spots(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Changes of all axes in the order of travel, n of them, a column each.

    `rows` of :func:`~ph_post.edit.reversals.find_reversals`; `column` of the axis; `before` its sign ahead of the
    change; `first` of its chain; `at` the place along the program [m]; `rest` (n, 2) and `bound` (n, 2) [m]; `feed`
    [m/s]; `jog` where the shift is a move of its own; `window` (n, 5) of
    :func:`~ph_post.edit.crossing_shapes.find_windows`; `calm` where the axis rests long enough for a crossing at full
    speed, `blend` (n,) [m] from its corners.
    """

    rows: Array
    column: IntArray
    before: IntArray
    first: BoolArray
    at: Array
    rest: Array
    bound: Array
    feed: Array
    jog: BoolArray
    calm: BoolArray
    window: Array
    blend: Array


class CrossingSearch:
    """Finds the crossings of a program's reversals; keeps what all searches share.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    dialect : Dialect
    sides : mapping of str to tuple
        Offsets [m] of each axis while it moves to minus and to plus.
    feed : Array, shape (m,)
        Speed of the path in every motion [m/s].
    low : IntArray, shape (s,)
        First motion of every section, of which changes name the one in which they begin.
    whole : IntArray, shape (c,)
        First motion of what is shifted by itself: chains and their parts. Restarts name it.
    overshoot : mapping of str to float
        From how far beyond its place each axis comes in the air [m].
    restarts : collection of Restart
    part_side : {0, 1, -1}
        1 where the part is on the left of the path, -1 where on its right, 0 where that is not known.
    """

    def __init__(
        self,
        program: PartProgram,
        machine: Machine,
        dialect: Dialect,
        sides: Mapping[str, tuple[float, float]],
        feed: Array,
        low: IntArray,
        whole: IntArray,
        overshoot: Mapping[str, float],
        restarts: Collection[Restart] = (),
        *,
        part_side: int = 0,
    ) -> None:
        self._part_side = part_side
        self._overshoot, self._restarts = overshoot, restarts
        stream = dialect.abilities.stream
        self._least = max(PERIODS * machine.servo_period, LINE_SIZE / stream.rate if stream is not None else 0.0)
        self._program, self._machine, self._dialect, self._sides = program, machine, dialect, sides
        self._planner = planner_of(machine)
        self._along = places_along(program.motions)
        timed = program.motions.duration > 0.0
        length = np.diff(self._along)
        self._feed = np.where(timed, length / np.where(timed, program.motions.duration, 1.0), feed)
        if not isinstance(self._planner, ExactPath):
            self._feed = np.minimum(self._feed, fastest_in_arcs(program, machine))
        self._kept = self._speeds_kept()
        self._feed = np.minimum(self._feed, self._kept)
        self._view = motion_view(program.motions)
        self._way = np.nan_to_num(program.motions.end - program.motions.start)
        turning = np.zeros(self._way.shape, dtype=np.bool_)
        arcs = np.flatnonzero(program.motions.kind == ARC)
        turning[arcs[:, None], plane_columns(program.motions.plane[arcs])[:, :2]] = True
        self._moving = [np.flatnonzero(column) for column in ((self._way != 0.0) | turning).T]
        self._low = low
        self._beam = BeamGuard(program, machine)
        self._chain_of = np.searchsorted(whole, low, side="right") - 1
        self._cuts = np.flatnonzero(program.motions.kind != RAPID)
        self._rapids = np.flatnonzero(program.motions.kind == RAPID)
        self._region = _regions(program)
        begins = np.flatnonzero(np.diff(self._region, prepend=-2) != 0)
        self._region_low = self._along[begins]
        self._region_high = self._along[np.append(begins[1:], self._region.size)]
        self._region_number = np.cumsum(np.diff(self._region, prepend=-2) != 0) - 1
        self._kept_whole = program.language.bound is not None or bool(further_lines(program))
        self._divisible = np.array([self._may_divide(k) for k in range(program.motions.kind.size)], dtype=np.bool_)
        self._shapes = {name: self._shape(machine.axes[name]) for name in sides}
        axes = machine.axes
        self._lag = np.array([response_time(axes[name].servo) if name in axes else 0.0 for name in AXES])
        self._push = self._accelerations()

    def _accelerations(self) -> Array:
        """Acceleration along the path in every motion [m/s²], (m,), by the limits of the axes and their part in it.

        LinuxCNC keeps the rest of it for the curvature in arcs.
        """
        kind, axes = self._program.motions.kind, self._machine.axes
        limits = np.array([axes[name].limits.acceleration if name in axes else math.inf for name in AXES])
        part = np.abs(self._way) / np.maximum(np.diff(self._along), 1e-12)[:, None]
        arcs = np.flatnonzero(kind == ARC)
        part[arcs[:, None], plane_columns(self._program.motions.plane[arcs])[:, :2]] = 1.0
        found = np.min(limits / np.maximum(part, 1e-12), axis=1)
        if not isinstance(self._planner, ExactPath):
            found[arcs] *= math.sqrt(1.0 - ACROSS**2)
        return np.asarray(found)

    def _speeds_kept(self) -> Array:
        """Speeds of arcs not to be passed faster in parts [m/s], (m,): motors that lag would leave the path."""
        motions = self._program.motions
        nothing = np.full(motions.kind.size, math.inf)
        lags = any(response_time(self._machine.axes[name].servo) >= SHORT_LAG for name in self._sides)
        if isinstance(self._planner, ExactPath) or not lags:
            return nothing
        return np.where(motions.kind == ARC, planned_speeds(self._program, self._machine), nothing)

    def kept(self, crossings: Collection[CrossingEdit]) -> dict[int, float]:
        """Return the speed [m/s] that is kept in what crossings leave of each motion, where that is not its feed."""
        divided = {part.motion for one in crossings for part in one.parts}
        return {
            motion: float(self._kept[motion])
            for motion in sorted(divided)
            if self._kept[motion] < AT_SPEED * self._program.motions.feed[motion]
        }

    def _may_divide(self, k: int) -> bool:
        kind = self._program.motions.kind[k]
        if kind in (RAPID, NURBS) or (kind == CUBIC and self._dialect.abilities.cubic is None):
            return False
        return not (self._kept_whole and why_kept_whole(self._program, k))

    def _shape(self, axis: Axis) -> CrossingShape:
        fastest = float(np.max(self._feed[self._program.motions.kind != RAPID], initial=0.0))
        # A planner that passes no crossing at full feed passes one at less.
        for feed in (fastest, 0.5 * fastest, 0.25 * fastest):
            first, rounding = shortest_time(self._machine, axis, max(feed, LEAST_FEED))
            if math.isfinite(first):
                break
        else:
            first, rounding = 2.0 * math.sqrt(axis.gap.lost_motion / axis.limits.acceleration), 0.0
        first = max(first, axis.gap.lost_motion / axis.limits.velocity, 2.0 * self._machine.servo_period)
        shape = crossing_shape(axis, first, rounding)
        if isinstance(self._planner, ExactPath):
            return shape
        allowed = tolerances(self._program, self._planner)
        return shape_in_steps(shape, axis, self._machine.servo_period, min(allowed[allowed > 0.0], default=math.inf))

    def moves(self, column: int, low: int, high: int) -> IntArray:
        """Return which motions from `low` to before `high` move an axis."""
        moving = self._moving[column]
        return moving[np.searchsorted(moving, low) : np.searchsorted(moving, high)]

    def offset(self, column: int, sign: int) -> float:
        """Return the offset [m] of an axis that moves in a direction; 0 for none."""
        minus, plus = self._sides[AXES[column]]
        return plus if sign > 0 else minus if sign < 0 else 0.0

    def spots(self, changes: Mapping[str, Array], coarser: float) -> Spots:
        """Gather the changes of all axes, and find how each is crossed."""
        parts, columns, befores, firsts = [np.zeros((0, COLUMNS))], [], [], []
        for name, found_rows in changes.items():
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
        length = np.diff(self._along)
        at = self._along[motion] + rows[:, SHARE] * length[motion]
        order = np.lexsort((column, at))
        rows, motion, at = rows[order], motion[order], at[order]
        found = Spots(
            rows=rows,
            column=column[order].astype(np.int64),
            before=before[order].astype(np.int64),
            first=first[order].astype(np.bool_),
            at=at,
            rest=self._rests(rows, motion, length),
            bound=self._bounds(motion, at),
            feed=self._speed(rows, motion),
            jog=np.zeros(len(rows), dtype=np.bool_),
            calm=np.zeros(len(rows), dtype=np.bool_),
            window=np.zeros((len(rows), 5)),
            blend=np.zeros(len(rows)),
        )
        return self._with_windows(found, motion, coarser)

    def _wound_up(self, rows: Array, column: int) -> Array:
        """Let the first change of a chain happen behind the rapid that brings the axis to its first place.

        A rapid away from there would leave the first place on an unknown side.
        """
        first = np.append(True, np.diff(rows[:, CHAIN]) != 0.0)[: len(rows)]
        found = rows.copy()
        for n in np.flatnonzero(first & (rows[:, SIGN] != 0.0)).tolist():
            if rows[n, SHARE0] == 0.0 and rows[n, FIRST] == rows[n, MOTION] and rows[n, SHARE] == 1.0:
                # That rapid itself is the first to move the axis.
                continue
            place = rows[n, FIRST] if rows[n, SHARE0] == 1.0 else rows[n, FIRST] - 1.0
            rapid = int(np.searchsorted(self._rapids, place, side="right")) - 1
            if rapid < 0 or self._rapids[rapid] < self._low[int(rows[n, CHAIN])]:
                continue
            if np.isfinite(self._program.motions.end[self._rapids[rapid], column]):
                found[n, MOTION], found[n, SHARE], found[n, CARRIED] = self._rapids[rapid], 1.0, 0.0
        return found

    def _needed(self, rows: Array, column: int) -> Array:
        """Leave out what an axis does in the air between two cuts, there and back, where it then comes down alone."""
        keep = np.ones(len(rows), dtype=np.bool_)
        kind = self._program.motions.kind
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
            free = self.offset(column, int(sign)) == 0.0 and self._alone(last + 1, column, sign)
            if keep[n] and free and (kind[first : last + 1] == RAPID).all():
                keep[n : n + 2] = False
        return rows[keep]

    def _rests(self, rows: Array, motion: IntArray, length: Array) -> Array:
        """Places between which the axis rests, in the stretch of path that a crossing may lie in, shape (n, 2)."""
        region = self._region_number[motion]
        ends = [
            self._along[rows[:, at].astype(np.int64)] + rows[:, share] * length[rows[:, at].astype(np.int64)]
            for at, share in ((FIRST, SHARE0), (LAST, SHARE1))
        ]
        low, high = self._region_low[region], self._region_high[region]
        return np.stack([np.clip(one, low, high) for one in ends], axis=1)

    def _bounds(self, motion: IntArray, at: Array) -> Array:
        """Places that crossings may not leave: half way to their neighbours, or the ends of their stretch, (n, 2)."""
        region = self._region_number[motion]
        middle = 0.5 * (at[1:] + at[:-1])
        low = np.maximum(self._region_low[region], np.append(-np.inf, middle)[: at.size])
        high = np.minimum(self._region_high[region], np.append(middle, np.inf)[: at.size])
        return np.stack([low, high], axis=1)

    def _speed(self, rows: Array, motion: IntArray) -> Array:
        """Speed of the path at a place [m/s]: at a joint the lower of both feeds."""
        behind = np.minimum(motion + 1, self._feed.size - 1)
        joint = (rows[:, SHARE] == 1.0) & (self._region[behind] == self._region[motion])
        return np.asarray(np.where(joint, np.minimum(self._feed[motion], self._feed[behind]), self._feed[motion]))

    def _with_windows(self, spots: Spots, motion: IntArray, coarser: float) -> Spots:
        motions, rows = self._program.motions, spots.rows
        if not motion.size:
            return spots
        none = CrossingShape(first=0.0, wait=0.0)
        shapes = [self._shapes.get(name, none) for name in AXES]
        wait = np.array([one.wait for one in shapes])[spots.column]
        crossing = np.array([one.first for one in shapes])[spots.column]
        lag = self._lag[spots.column]
        late = np.where(np.array([one.beyond for one in shapes])[spots.column] > 0.0, lag, 0.0)
        # No block is shorter than a machine can tell.
        wait = np.maximum(wait, SHORTEST / np.maximum(spots.feed, 1e-12))
        behind = np.minimum(motion + 1, motions.kind.size - 1)
        ends = (rows[:, SHARE] == 1.0) & ((self._region[behind] != self._region[motion]) | (behind == motion))
        stops = (self._region[motion] < 0) | ends | (motions.exact[motion] == 1)
        corner = (rows[:, SHARE] == 1.0) & (rows[:, PASSED] < KINK * spots.feed)
        inner = (rows[:, SIGN] != 0.0) & (rows[:, CARRIED] == 0.0) & ~spots.first & ~stops & (spots.feed > 0.0)
        room = np.minimum(spots.rest[:, 1], spots.bound[:, 1]) - np.maximum(spots.rest[:, 0], spots.bound[:, 0])
        blend = self._blends(spots, motion)
        calm = inner & (room >= spots.feed * (wait + SETTLING * lag) + 2.0 * blend) & (room > 2.0 * SHORTEST)
        turning = inner & ~calm & ~corner
        window = np.zeros((len(rows), 5))
        # A beam is not slowed down: a coarser crossing has to do.
        lit = self._beam.is_beam & self._beam.works.on[motion]
        push = np.array([self._turning_push(name) for name in AXES])[spots.column]
        finest = np.where(np.isfinite(push), STEPS_ERROR, ERROR)
        error, most = self._allowed(spots.column, coarser, finest)
        which, wanted = np.flatnonzero(turning), self._wanted(spots, motion, lag)
        for number, times in enumerate((0.0, *BEAM_COARSER)):
            if which.size:
                window[which] = find_windows(
                    self._view,
                    self._along,
                    spots.column[which],
                    rows[which, SIGN],
                    spots.rest[which],
                    spots.bound[which],
                    wait[which],
                    late[which],
                    spots.feed[which],
                    np.maximum(error, times * finest)[which],
                    most[which],
                    wanted[which],
                    push[which],
                )
            slowed = turning & lit & (window[:, 2] < AT_SPEED * spots.feed)
            which = np.flatnonzero(slowed)
            if number == len(BEAM_COARSER):
                turning &= ~slowed
        if turning.any():
            short = window[:, 1] - window[:, 0] < NEARLY * SHORTEST
            slow = window[:, 2] * crossing < 0.25 * SHORTEST
            turning &= ~(short | slow)
        spots = replace(spots, calm=calm, window=np.where(turning[:, None], window, 0.0), blend=blend)
        if coarser == COARSER[-1]:
            turning &= lit | (self._cost_of_chords(spots) <= self._cost_of_stops(spots))
        jog = (rows[:, CARRIED] == 0.0) & ~calm & ~turning
        return replace(spots, jog=jog, window=np.where(turning[:, None], window, 0.0))

    def _allowed(self, column: IntArray, coarser: float, finest: Array) -> tuple[Array, Array]:
        """Return errors of crossings (n,) [m], up to a multiple of the `finest` ones (n,), and the largest of all."""
        axes = self._machine.axes
        lost = np.array([axes[n].gap.lost_motion if n in axes else 0.0 for n in AXES])[column]
        part = PART * max(coarser / LARGE, 1.0)
        error = np.minimum(coarser * finest, np.maximum(FINE * finest, part * lost))
        none = CrossingShape(first=0.0, wait=1.0)
        shapes = [self._shapes.get(name, none) for name in AXES]
        beyond = np.array([one.beyond for one in shapes])[column]
        farther = np.array([exaggeration(one, float(c)) for one, c in zip(shapes, self._lag, strict=True)])[column]
        # A motor without lag, or one that is held there, would take the table so far off the path.
        used = {AXES[n] for n in np.unique(column).tolist()}
        whole = max(max(map(abs, self._sides[name])) for name in used)
        most = np.minimum(np.minimum((MOST + beyond) * lost, whole) / farther, whole - beyond * lost)
        return error, np.maximum(most, finest)

    def _turning_push(self, name: str) -> float:
        """Acceleration [m/s²] that an axis takes across the path in a crossing in steps; infinite elsewhere."""
        stepped = name in self._shapes and self._shapes[name].steps > 1
        return TURNING * self._machine.axes[name].limits.acceleration if stepped else math.inf

    def _blends(self, spots: Spots, motion: IntArray) -> Array:
        """Return how far from a corner the controller may round it within its tolerance P [m], shape (n,).

        An arc that passes a corner with the deflection φ within P begins P cot(φ/4) before it.
        """
        if isinstance(self._planner, ExactPath):
            return np.zeros(motion.size)
        allowed = np.maximum(tolerances(self._program, self._planner)[motion], 0.0)
        passed = spots.rows[:, PASSED] / np.maximum(spots.feed, LEAST_FEED)
        known = spots.at == spots.rest[:, 0]
        angle = np.where(known, np.arccos(np.clip(passed, -1.0, 1.0)), BLEND_ANGLE)
        reach = allowed / np.tan(0.25 * np.maximum(angle, BLEND_ANGLE))
        # Nearer to the corner a crossing would begin in it.
        shortest = np.maximum(self._least * spots.feed, SHORTEST)
        return np.asarray(np.where(reach > 0.0, np.maximum(reach, CLEAR * shortest), 0.0))

    def _wanted(self, spots: Spots, motion: IntArray, lag: Array) -> IntArray:
        """Kinds of crossings (n,) that leave the part proud, 0 where its side is not known, or the motor lags."""
        found = np.zeros(motion.size, dtype=np.int64)
        if not self._part_side:
            return found
        middle, rows = spots.rest.mean(axis=1), np.arange(motion.size)
        ahead, behind = (points_along(self._view, self._along, middle + d) for d in (0.5 * SHORTEST, -0.5 * SHORTEST))
        way, columns = ahead - behind, plane_columns(self._program.motions.plane[motion])
        # How far the centre of curvature is to the left: it lies where the axis goes after its reversal.
        first, second = (way[rows, columns[:, k]] for k in (0, 1))
        left = np.where(spots.column == columns[:, 0], -second, np.where(spots.column == columns[:, 1], first, 0.0))
        left *= spots.rows[:, SIGN] * self._part_side
        found[left > 0.0], found[left < 0.0] = OUTWARD, INWARD
        found[lag >= SHORT_LAG] = 0
        return found

    def cost(self, changes: Mapping[str, Array], coarser: float = 1.0) -> float:
        """Return the time [s] that changes cost."""
        return float(self.costs(changes, coarser)[2].sum())

    def costs(self, changes: Mapping[str, Array], coarser: float) -> tuple[IntArray, IntArray, Array]:
        """Return the axis (column), the motion and the time [s] that it costs of every change, each of shape (n,)."""
        spots = self.spots(changes, coarser)
        cost, together = np.zeros(spots.column.size), np.ones(spots.column.size)
        places = spots.rows[spots.jog, MOTION] + spots.rows[spots.jog, SHARE]
        _, place, count = np.unique(places, return_inverse=True, return_counts=True)
        together[spots.jog] = count[place]
        standing = self._cost_of_stops(spots)
        for column in np.unique(spots.column).tolist():
            axis = self._machine.axes[AXES[column]]
            jogs = (spots.column == column) & spots.jog
            ahead, behind, beyond = self._waits(spots.rows[jogs], spots.first[jogs], axis, coarser)
            # Out there and back from it, in the air.
            out = 2.0 * math.sqrt(self._overshoot[axis.name] / axis.limits.acceleration)
            # Axes that come to a place together wait together.
            waits = (ahead + behind) / together[jogs]
            cost[jogs] = np.where(beyond, out, standing[jogs]) + waits
        chords = spots.window[:, 2] > 0.0
        cost[chords] = self._cost_of_chords(spots)[chords]
        return spots.column, spots.rows[:, MOTION].astype(np.int64), cost

    def _cost_of_stops(self, spots: Spots) -> Array:
        """Time [s] that a stop with a move of the axis alone takes, rests apart (n,)."""
        axes = self._machine.axes
        moves = [math.sqrt(axes[n].gap.lost_motion / axes[n].limits.acceleration) if n in axes else 0.0 for n in AXES]
        passed = np.where(spots.first | (spots.rows[:, SIGN] == 0.0), 0.0, spots.rows[:, PASSED])
        # Between its ends 2 √(g/a); a corner is passed slowly anyway, which takes about half of it.
        longer = 1.0 + np.minimum(passed / np.maximum(spots.feed, LEAST_FEED), 1.0)
        move = np.array(moves)[spots.column] * longer
        return np.asarray(move + passed / self._push[spots.rows[:, MOTION].astype(np.int64)])

    def _cost_of_chords(self, spots: Spots) -> Array:
        """Time [s] that the windows of crossings take longer than the path, with the ramps beside them (n,)."""
        feed, push = np.maximum(spots.feed, LEAST_FEED), self._push[spots.rows[:, MOTION].astype(np.int64)]
        speed = np.where(spots.window[:, 2] > 0.0, spots.window[:, 2], feed)
        way = spots.window[:, 1] - spots.window[:, 0]
        return np.asarray((feed - speed) ** 2 / (feed * push) + way / speed - way / feed)

    @staticmethod
    def _pause(axis: Axis, coarser: float) -> float:
        """Rest before and behind a jog [s]: where the motor lags, until it has arrived; none where time is short."""
        return corner_pause(axis) if response_time(axis.servo) > 0.0 and coarser == 1.0 else 0.0

    def _waits(self, rows: Array, first: BoolArray, axis: Axis, coarser: float) -> tuple[Array, Array, BoolArray]:
        """Rests before jogs and behind them (n,) [s], and which come from beyond their places, in the air.

        Behind a rapid a motor that lags has to be there before it is called back: wholly where it crosses its backlash
        and no more, and else half as far beyond as its table follows. A cut that began at once would begin with the
        lag of rapid and jog.
        """
        motion, kind = rows[:, MOTION].astype(np.int64), self._program.motions.kind
        in_air = (kind[motion] == RAPID) & (rows[:, SHARE] == 1.0)
        onto_side = in_air & (rows[:, SIGN] != 0.0)
        reserve = max(0.5 * (self._overshoot[axis.name] - axis.gap.lost_motion), RESIDUE)
        whole, part = _settled(axis, RESIDUE), _settled(axis, reserve)
        # Z could only be called back from above what the rapid says, if that says anything.
        sooner = (whole > part + SOONER) & ((axis.name != "Z") | (rows[:, SIGN] < 0.0))
        beyond = onto_side & (first | (rows[:, BEYOND] == 1.0) | sooner)
        pause = np.where(in_air, 0.0, self._pause(axis, coarser))
        cut = onto_side & (np.append(kind, RAPID)[motion + 1] != RAPID)
        ahead = np.where(beyond, part, np.where(onto_side, whole, pause))
        behind = np.where(cut, SETTLING * response_time(axis.servo), pause)
        return ahead, behind, np.asarray(beyond)

    def plan(
        self, changes: Mapping[str, Array], coarser: float
    ) -> tuple[tuple[CrossingEdit, ...], tuple[StopEdit, ...], dict[str, float], Array, tuple[int, ...]]:
        """Plan all changes.

        Returns
        -------
        crossings : tuple of CrossingEdit
        stops : tuple of StopEdit
            Shifts that are moves of their own.
        approaches : dict
            Largest way [m] from beyond which each axis comes.
        offset : Array, shape (m, 3)
            Offsets at the ends of the motions [m].
        burnt : tuple of int
            Motions at whose place a shift would have the beam burn a dot.
        """
        spots = self.spots(changes, coarser)
        planner = CrossingPlanner(self._program.motions, self._along, self._divisible, self._least)
        current = np.zeros(3)
        crossings: list[CrossingEdit] = []
        stops: list[StopEdit] = []
        approaches: dict[str, float] = {}
        offset = np.zeros((self._program.motions.kind.size, 3))
        inside: dict[int, Array] = {}
        reached = -np.inf
        burnt: list[int] = []
        for n, row in enumerate(spots.rows):
            column = int(spots.column[n])
            after = current.copy()
            after[column] = self.offset(column, int(row[SIGN]))
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
                    if self._beam.marks(row, int(spots.before[n]), behind_rapid=self._behind_rapid(row)):
                        burnt.append(last)
                    stop, beyond = self._jog(spots, n, float(after[column] - current[column]), coarser)
                    stops.append(stop)
                    if beyond > 0.0:
                        approaches[AXES[column]] = max(approaches.get(AXES[column], 0.0), beyond)
            offset[last:, column] = after[column]
            current = after
        for motion, added in inside.items():
            offset[motion] = added
        begins = self._lines_for_restarts(spots, stops)
        marked = (replace(one, restart=True) if one.approach and one.motion in begins else one for one in stops)
        return tuple(crossings), tuple(marked), approaches, offset, tuple(burnt)

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
            if here and all(column in axes for chain, column in used if chain == one.chain):
                found.add(here[0])
        return frozenset(found)

    def _comes_down(self, one: Restart) -> bool:
        """Return whether Z is on the side of its way down where the tool begins to cut, and carries nothing there."""
        ways = self._way[one.first : one.cut, 2]
        last = ways[ways != 0.0][-1:]
        lost = self._machine.axes["Z"].gap.lost_motion if "Z" in self._machine.axes else 0.0
        return bool(last.size and last[0] <= -APPROACH * lost)

    def _winds_up(self, spots: Spots, n: int) -> bool:
        """Return whether an axis whose offset stays has to come from beyond its backlash all the same.

        Only a rapid can take it there: in a stretch that begins with a cut it is left as it is.
        """
        column, row = int(spots.column[n]), spots.rows[n]
        if row[BEYOND] == 1.0:
            return True
        if not self._behind_rapid(row):
            return False
        moves = self._moving[column].size > 0 and self._moving[column][-1] > row[MOTION]
        return bool(spots.first[n] and moves and not self._alone(int(row[MOTION]) + 1, column, row[SIGN]))

    def _behind_rapid(self, row: Array) -> bool:
        return bool(self._program.motions.kind[int(row[MOTION])] == RAPID and row[SHARE] == 1.0)

    def _alone(self, motion: int, column: int, sign: float) -> bool:
        """Return whether an axis, from a motion on, first moves alone, before any cut, and by more than its backlash.

        It takes up its backlash on its own way then.
        """
        moving = self._moving[column]
        place = int(np.searchsorted(moving, motion))
        if place == moving.size:
            return False
        own = int(moving[place])
        cut = int(np.searchsorted(self._cuts, motion))
        if (cut < self._cuts.size and self._cuts[cut] < own) or self._program.motions.kind[own] not in (RAPID, LINE):
            return False
        lost = self._machine.axes[AXES[column]].gap.lost_motion
        alone = not np.delete(self._way[own], column).any()
        return bool(alone and self._way[own, column] * sign >= APPROACH * lost)

    def _end_of(self, made: CrossingEdit) -> float:
        last = made.parts[-1]
        low, high = self._along[last.motion], self._along[last.motion + 1]
        return float(low + last.high * (high - low))

    def _crossing(
        self, planner: CrossingPlanner, spots: Spots, n: int, before: Array, after: Array, reached: float
    ) -> CrossingEdit | None:
        name = AXES[int(spots.column[n])]
        feed = float(spots.feed[n])
        shape = self._shapes[name]
        shape = replace(shape, first=max(shape.first, SHORTEST / feed), wait=max(shape.wait, SHORTEST / feed))
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
            lag=response_time(self._machine.axes[name].servo),
            feed=feed,
            calm=bool(spots.calm[n]),
            blend=float(spots.blend[n]),
        )
        return planner.plan(spot, spots.window[n])

    def _jog(self, spots: Spots, n: int, travel: float, coarser: float) -> tuple[StopEdit, float]:
        """Shift an axis by a move of its own, and say from how far beyond its place it comes [m].

        One whose side is not known comes from beyond its backlash, in the air: the rapid before ends there.
        """
        row, name = spots.rows[n], AXES[int(spots.column[n])]
        motion, share, sign = int(row[MOTION]), float(row[SHARE]), float(row[SIGN])
        axis = self._machine.axes[name]
        lost = self._sides[name][1] - self._sides[name][0]
        behind_rapid = self._behind_rapid(row)
        waits = self._waits(row[None, :], spots.first[n : n + 1], axis, coarser)
        pause, arrives, far = (one.item() for one in waits)
        velocity, beyond, ways = float(spots.feed[n]), 0.0, [travel]
        if far:
            velocity, beyond = 0.0, self._overshoot[name]
            named = name in words_by_letter(self._program, int(self._program.motions.block[motion]))
            if name == "Z" and sign > 0.0:
                # A tool is never sent below the height that is programmed: from above onto a side, then through it.
                ways = [-beyond, lost]
            else:
                ways = [sign * beyond] if named else [travel - sign * beyond, sign * beyond]
        elif not behind_rapid and (sign == 0.0 or spots.before[n] == 0):
            # Behind the last cut the path rests anyway, and where no rapid led to the first place it has to once.
            pause = arrives = max(pause, DWELL)
        elif self._beam.tends and self._beam.works.stays[motion]:
            pause, arrives = 0.0, arrives if behind_rapid else 0.0
        longest = max(map(abs, ways))
        # No faster than it can be on its way: from rest to rest by half of it each.
        reached = math.sqrt(axis.limits.acceleration * min(map(abs, ways)))
        # With its power in proportion to the speed over F a beam burns no more in a move at F than along the path.
        steady = bool(self._beam.works.follows[motion]) and sign != 0.0 and not behind_rapid
        if not steady:
            velocity = min(velocity, reached) if velocity > 0.0 else make_jog(axis, longest, 0.0).velocity
        shifts = tuple(
            OffsetShift(
                axis=name,
                travel=way,
                velocity=min(velocity, math.inf if steady else reached, axis.limits.velocity),
                pause=arrives if place + 1 == len(ways) else max(pause, SETTLING * response_time(axis.servo)),
                whole=sign != 0.0 and spots.before[n] != 0 and not behind_rapid,
            )
            for place, way in enumerate(ways)
        )
        approach = bool(behind_rapid and sign != 0.0)
        rapid = approach and self._beam.tool == "laser"
        stop = StopEdit(
            motion=motion,
            share=share,
            pause=pause,
            shifts=shifts,
            approach=approach,
            rapid=rapid,
            behind=self._beam.off_behind(motion) if sign == 0.0 and share == 1.0 else None,
        )
        return stop, beyond


def _settled(axis: Axis, residue: float) -> float:
    """Return how long the motor of an axis lags behind a rapid by more than a residue [m], in s.

    It is a c² away from where the command comes to rest with the acceleration a.
    """
    lag = response_time(axis.servo)
    return lag * math.log(max(axis.limits.acceleration * lag**2 / residue, 1.0))


def _regions(program: PartProgram) -> IntArray:
    """Return the number of the stretch of every motion in which a crossing may lie; −1 where none may.

    A stretch ends where the axes stop, where modes change, and at commands of the machine.
    """
    motions, words = program.motions, program.words
    count = motions.kind.size
    keys: dict[object, int] = {}
    key = np.array(
        [keys.setdefault(replace(one, motion=None, tool=None, prepared=None), len(keys)) for one in program.modal],
        dtype=np.int64,
    )
    own = key[program.state[motions.block]] if count else np.zeros(0, dtype=np.int64)
    stop = np.zeros(count + 1, dtype=np.bool_)
    stop[1:count] |= own[1:] != own[:-1]
    stop[1:count] |= motions.chain[1:] != motions.chain[:-1]
    m_words = (words.letter == ord("M")) & np.isin(words.value, tuple(INTERRUPTING))
    dwells = (words.letter == ord("G")) & np.isin(words.value, (4.0, 9.0))
    for rows in (m_words, dwells, words.letter == ord("S"), words.letter == ord("T")):
        stop[np.searchsorted(motions.block, words.block[rows], side="left")] = True
    # S and T of a line are executed before its motion.
    for rows in (m_words, dwells):
        stop[np.searchsorted(motions.block, words.block[rows], side="right")] = True
    known = np.isfinite(motions.start).any(axis=1) & (motions.kind != RAPID) & (motions.kind != NURBS)
    known &= ~(np.isnan(motions.start) & ~np.isnan(motions.end)).any(axis=1)
    stop[1:count] |= known[1:] != known[:-1]
    stop[1:count] |= motions.exact[1:] != motions.exact[:-1]
    return np.asarray(np.where(known, np.cumsum(stop[:count]), -1))
