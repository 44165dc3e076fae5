"""What the searches for crossings share of a program and its machine, and the changes that they look at."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.dialects.base import Dialect
from ph_post.dialects.planners import planner_of
from ph_post.drive.cascade import response_time
from ph_post.edit.beam_exposure import CornerCrossings, burns_little
from ph_post.edit.beams import BeamGuard
from ph_post.edit.crossing_shapes import (
    AT_SPEED,
    LINE_TIME,
    SHARPER,
    TURNING,
    CrossingShape,
    crossing_shape,
    fastest_along,
    fastest_in_arcs,
    points_along,
    shape_in_steps,
    shortest_time,
)
from ph_post.edit.cutter_contours import CutterContours
from ph_post.edit.edits import CrossingEdit, EditOptions, StopEdit
from ph_post.edit.extrusion import filament_of
from ph_post.edit.lagging_crossings import SHORT_LAG
from ph_post.edit.preconditions import program_units, why_kept_whole, word_decimals
from ph_post.edit.reversals import (
    FIRST,
    LAST,
    MOTION,
    SHARE,
    motion_view,
)
from ph_post.edit.threads import Threads
from ph_post.gcode.further import further_lines
from ph_post.gcode.motion_parts import places_along
from ph_post.gcode.program import (
    ARC,
    AXES,
    CUBIC,
    LINE,
    NURBS,
    RAPID,
    Motions,
    PartProgram,
    PlaceArray,
    chain_heads,
    plane_columns,
)
from ph_post.simulate.controllers.exact_path import Passage
from ph_post.simulate.controllers.legs import ACROSS
from ph_post.simulate.controllers.moves import linkings, tolerance_of, tolerances, waits_for_speed
from ph_post.simulate.controllers.run import planned_passage, planned_speeds
from ph_post.types import Array, Axis, BoolArray, ExactPath, IntArray, KlipperCorner, Machine, MarlinCorner
from ph_post.units import MM

APPROACH: Final = 2.0
"""An axis whose side of the backlash is not known approaches its place from this many lost motions before it."""

LEAST_FEED: Final = 1e-4
"""Feeds below this [m/s] are reckoned as this."""

ROUNDING: Final = 2e-3 * MM
"""To which the joints of a crossing are rounded within a motion at whose end the controller is to stop [m]: a crossing
in three steps needs a 72nd part of the backlash."""

PERIODS: Final = 2.0
"""No block is to be shorter than so many servo periods: a controller slows down for it."""

BESIDE: Final = 1e-4 * MM
"""So far beside a joint [m] the path has its direction."""

LINE_SIZE: Final = 35.0
"""Length of a line of a crossing [bytes], for controllers that are fed over a serial line."""

INTERRUPTING: Final = frozenset((0, 1, 3, 4, 5, 6, 7, 8, 9, 19, 60, 62, 63, 64, 65, 66, 67, 68))
"""M words between two motions over which no crossing reaches."""


class Spots(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Changes of all axes in the order of travel, n of them, a column each.

    `rows` of :func:`~ph_post.edit.reversals.find_reversals`; `column` of the axis; `before` its sign ahead of the
    change; `first` of its chain; `at` the place along the program [m]; `rest` (n, 2) and `bound` (n, 2) [m]; `feed`
    [m/s]; `jog` where the shift is a move of its own; `window` (n, 5) of
    :func:`~ph_post.edit.crossing_shapes.find_windows`; `calm` where the axis rests long enough for a crossing at full
    speed, `blend` (n,) [m] from its corners, and `spread` (n,) over how much of its line [m], 0 for little; `whole`
    where the crossing takes all of a rest between two corners.
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
    spread: Array
    whole: BoolArray


class CrossingGround:
    """What a program and its machine say of every crossing.

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
    options : EditOptions
    named : BoolArray, shape (m, 3)
        Axes that the lines of motions name, as :func:`~ph_post.edit.positions.shiftable` has them.

    Attributes
    ----------
    step : float
        To which places are written [m].
    lost : Array, shape (3,)
        Lost motion of X, Y and Z [m]; 0 for an axis that the machine lacks.
    overshoot : dict
        From how far beyond its place each axis comes in the air [m].
    flat : Array, shape (m,)
        Length [m] up to which a part of each helix is taken for a line; 0 for all other motions.
    """

    def __init__(
        self,
        program: PartProgram,
        machine: Machine,
        dialect: Dialect,
        sides: Mapping[str, tuple[float, float]],
        feed: Array,
        low: IntArray,
        options: EditOptions,
        named: BoolArray,
    ) -> None:
        self.program, self.machine, self._dialect, self.sides = program, machine, dialect, sides
        self.planner = planner_of(machine)
        self.part_side, self.plain_corners = options.part_side, options.plain_corners
        self.longer = options.longer
        units = program_units(program)[0]
        self.step = units * 10.0 ** -word_decimals(dialect, units)
        self._standing = np.array(sorted(options.standing), dtype=np.int64)
        # No less than what the numbers of the program can say of the backlash.
        self.overshoot = {
            name: APPROACH * (plus - minus) if options.overshoot is None else max(options.overshoot, plus - minus)
            for name, (minus, plus) in sides.items()
        }
        stream = dialect.abilities.stream
        self.least = max(PERIODS * machine.servo_period, LINE_SIZE / stream.rate if stream is not None else 0.0)
        # Where the path is exact no path mode counts.
        self.halts = (program.motions.exact == 1) & (not isinstance(self.planner, ExactPath))
        path_mode = dialect.syntax.path_mode if self.halts.any() else None
        self.rounding = 0.0 if path_mode is None else tolerance_of(path_mode(min(options.tolerance, ROUNDING)), MM)
        self.along = places_along(program.motions)
        self._kept = self._speeds_kept()
        self.feed = self._feeds(feed)
        self.view = motion_view(program.motions)
        self.shiftable = named
        self.moving, self.still = _movers(program.motions)
        self.low = low
        self.beam = BeamGuard(program, machine)
        self.contours = CutterContours(program)
        self.threads = Threads(program)
        self.rapids = np.flatnonzero(program.motions.kind == RAPID)
        self.region = _regions(program, self.halts, exact=isinstance(self.planner, ExactPath))
        begins, self.region_number = _stretches(self.region)
        self.region_low = self.along[begins]
        self.region_high = self.along[np.append(begins[1:], self.region.size)]
        self.divisible = self._may_divide()
        self.flat = self._flat_helices()
        self.shapes = {name: self._shape(machine.axes[name]) for name in sides}
        axes = machine.axes
        self.lost = np.array([axes[name].gap.lost_motion if name in axes else 0.0 for name in AXES])
        self.lag = np.array([response_time(axes[name].servo) if name in axes else 0.0 for name in AXES])

    def place(self, motion: IntArray, share: Array) -> Array:
        """Return the places along the program of shares of motions (n,) [m]."""
        return self.along[motion] + share * (self.along[motion + 1] - self.along[motion])

    @property
    def slow_in_short_blocks(self) -> bool:
        """Whether the controller passes a joint the more slowly the shorter the blocks beside it are."""
        return isinstance(self.planner, ExactPath) and isinstance(self.planner.corner, MarlinCorner | KlipperCorner)

    def joint_before(self, places: Array) -> Array:
        """Return the last joints of the program before places along it [m]."""
        last = np.searchsorted(self.along, places - BESIDE, side="right") - 1
        return self.along[np.maximum(last, 0)]

    def joint_behind(self, places: Array) -> Array:
        """Return the first joints of the program behind places along it [m]."""
        first = np.searchsorted(self.along, places + BESIDE)
        return self.along[np.minimum(first, self.along.size - 1)]

    @cached_property
    def passage(self) -> Passage:
        """When and how fast the program passes its places, where the controller follows the path exactly."""
        return planned_passage(self.program, self.machine)

    def way(self, motion: IntArray | slice | int) -> Array:
        """Return how far motions move each axis [m], shape (..., 3); 0 where that is not known."""
        motions = self.program.motions
        return np.nan_to_num(motions.end[motion] - motions.start[motion])

    def push(self, motion: IntArray) -> Array:
        """Return the acceleration along the path in motions (n,) [m/s²], by the limits of the axes and their parts.

        LinuxCNC keeps the rest of it for the curvature in arcs.
        """
        axes, arc = self.machine.axes, self.program.motions.kind[motion] == ARC
        limit = np.array([axes[name].limits.acceleration if name in axes else math.inf for name in AXES])
        length = np.maximum(self.along[motion + 1] - self.along[motion], 1e-12)
        part = np.abs(self.way(motion)) / length[:, None]
        turning = plane_columns(self.program.motions.plane[motion])[:, :2]
        part[arc] = np.where((turning[arc, :, None] == np.arange(len(AXES))).any(axis=1), 1.0, part[arc])
        found = (limit / np.maximum(part, 1e-12)).min(axis=1)
        if not isinstance(self.planner, ExactPath):
            found[arc] *= math.sqrt(1.0 - ACROSS**2)
        return np.asarray(found)

    def _feeds(self, feed: Array) -> Array:
        """Return the speeds of all motions (m,) [m/s] that the machine comes to, of those that are asked for."""
        motions = self.program.motions
        timed = motions.duration > 0.0
        if timed.any():
            feed = np.where(timed, np.diff(self.along) / np.where(timed, motions.duration, 1.0), feed)
            # What is asked for beyond that no machine does: a crossing would be planned as if it did.
            feed = np.minimum(feed, fastest_along(self.program, self.machine))
        if not isinstance(self.planner, ExactPath):
            feed = np.minimum(feed, fastest_in_arcs(self.program, self.machine))
        return np.minimum(feed, self._kept) if self._kept.strides != (0,) else feed

    def _speeds_kept(self) -> Array:
        """Speeds of arcs not to be passed faster in parts [m/s], (m,): motors that lag would leave the path."""
        motions = self.program.motions
        nothing = np.broadcast_to(math.inf, motions.kind.shape)
        lags = any(response_time(self.machine.axes[name].servo) >= SHORT_LAG for name in self.sides)
        if isinstance(self.planner, ExactPath) or not lags:
            return nothing
        return np.where(motions.kind == ARC, planned_speeds(self.program, self.machine), nothing)

    def kept(self, crossings: Collection[CrossingEdit]) -> dict[int, float]:
        """Return the speed [m/s] that is kept in what crossings leave of each motion, where that is not its feed."""
        divided = {part.motion for one in crossings for part in one.parts}
        return {
            motion: float(self._kept[motion])
            for motion in sorted(divided)
            if self._kept[motion] < AT_SPEED * self.program.motions.feeds.at(motion)
        }

    def rounding_of(self, crossings: Collection[CrossingEdit]) -> float:
        """Return to what [m] joints of crossings are rounded where the controller stops behind the motion, or 0."""
        divided = np.array([part.motion for one in crossings for part in one.parts], dtype=np.int64)
        return self.rounding if self.halts[divided].any() else 0.0

    def _may_divide(self) -> BoolArray:
        """Mask of the motions (m,) that a crossing may divide."""
        kind = self.program.motions.kind
        whole = (RAPID, NURBS) if self._dialect.abilities.cubic is not None else (RAPID, NURBS, CUBIC)
        found = ~np.isin(kind, whole)
        if self.threads.mask.any() or self.program.language.bound is not None or further_lines(self.program):
            found[[k for k in np.flatnonzero(found).tolist() if why_kept_whole(self.program, k)]] = False
        return found

    def _flat_helices(self) -> Array:
        """Length up to which LinuxCNC's NaiveCAM takes a part of a helix for a line, (m,) [m].

        The joint of such a line with the helix lies in no plane, so that it is not rounded: the path nearly stops.
        """
        motions, found = self.program.motions, np.zeros(self.feed.size)
        if isinstance(self.planner, ExactPath):
            return found
        rises = np.nan_to_num(motions.end[:, 2] - motions.start[:, 2]) != 0.0
        which = np.flatnonzero((motions.kind == ARC) & (motions.plane == 17) & rises)
        linking = linkings(self.program, self.planner.tolerance)[which]
        radius = np.linalg.norm(motions.start[which, :2] - motions.center[which], axis=1)
        angle = 2.0 * np.arccos(np.maximum(1.0 - linking / np.maximum(radius, linking + 1e-12), 0.0))
        length, turn = np.diff(self.along)[which], np.maximum(np.abs(motions.angle[which]), 1e-12)
        found[which] = np.nan_to_num(length * angle / turn)
        return found

    def _shape(self, axis: Axis) -> CrossingShape:
        # Along a path on which an axis turns back the others move.
        others = [one.limits.velocity for one in self.machine.axes.values() if one.name != axis.name]
        fastest = float(np.max(self.feed[self.program.motions.kind != RAPID], initial=0.0))
        fastest = min(fastest, max(others, default=math.inf))
        # A planner that passes no crossing at full feed passes one at less.
        for feed in (fastest, 0.5 * fastest, 0.25 * fastest):
            first, rounding = shortest_time(self.machine, axis, max(feed, LEAST_FEED))
            if math.isfinite(first):
                break
        else:
            first, rounding = 2.0 * math.sqrt(axis.gap.lost_motion / axis.limits.acceleration), 0.0
        turn = SHARPER * axis.gap.lost_motion / first
        first = max(first, axis.gap.lost_motion / axis.limits.velocity, 2.0 * self.machine.servo_period)
        shape = crossing_shape(axis, first, rounding)
        if isinstance(self.planner, ExactPath):
            # Where short blocks make joints slow, a joint that is divided is passed no faster.
            whole = self.slow_in_short_blocks or shape.beyond > 0.0
            return shape if whole else replace(shape, turn=turn, least=LINE_TIME)
        allowed = tolerances(self.program, self.planner)
        allowed = np.append(allowed[allowed > 0.0], self.rounding or math.inf)
        return shape_in_steps(shape, axis, self.machine.servo_period, allowed.min())

    def moves(self, column: int, low: int, high: int) -> IntArray:
        """Return which motions from `low` to before `high` move an axis."""
        moving = self.moving[column]
        first, last = np.searchsorted(moving, np.array([low, high], dtype=moving.dtype))
        return moving[first:last].astype(np.int64)

    def offset(self, column: int, sign: int) -> float:
        """Return the offset [m] of an axis that moves in a direction; 0 for none."""
        minus, plus = self.sides[AXES[column]]
        return plus if sign > 0 else minus if sign < 0 else 0.0

    def bends(self, places: Array) -> Array:
        """Cosines of the angles by which the path turns at places along the program (n,)."""
        before, here, behind = (points_along(self.view, self.along, places + BESIDE * k) for k in (-1.0, 0.0, 1.0))
        into, out = here - before, behind - here
        size = np.linalg.norm(into, axis=1) * np.linalg.norm(out, axis=1)
        return np.asarray((into * out).sum(axis=1) / np.maximum(size, BESIDE**3))

    def stops_burn_little(self, places: Array, stops: Sequence[StopEdit]) -> BoolArray:
        """Return whether a beam may stay on in stops (n,) at places along the program."""
        way, lasts = np.zeros((len(stops), 3)), np.zeros(len(stops))
        for n, stop in enumerate(stops):
            for shift in stop.shifts:
                way[n, AXES.index(shift.axis)] += shift.travel
                lasts[n] = max(lasts[n], abs(shift.travel) / shift.velocity)
        return self.burns_little(places, np.zeros(len(stops)), way, np.linalg.norm(way, axis=1) / lasts)

    def burns_little(self, places: Array, along: Array, way: Array, speed: Array) -> BoolArray:
        """Return whether a beam may stay on in crossings at places along the program.

        Parameters
        ----------
        places : Array, shape (n,)
        along, way, speed : arrays
            Of :class:`~ph_post.edit.beam_exposure.CornerCrossings`.

        Returns
        -------
        BoolArray, shape (n,)
        """
        if not places.size:
            return np.zeros(0, dtype=np.bool_)
        before, here, behind = (points_along(self.view, self.along, places + BESIDE * k) for k in (-1.0, 0.0, 1.0))
        into, out = (
            way_there / np.maximum(np.linalg.norm(way_there, axis=1), 1e-3 * BESIDE)[:, None]
            for way_there in (here - before, behind - here)
        )
        motion = np.searchsorted(self.along, np.stack([places - BESIDE, places + BESIDE], axis=1), side="right") - 1
        motion = np.clip(motion, 0, self.feed.size - 1)
        crossings = CornerCrossings(
            into=into,
            out=out,
            feed=np.maximum(self.feed[motion], LEAST_FEED),
            room=self.along[motion[:, 1] + 1] - places,
            rests=self.halts[motion[:, 0]],
            along=along,
            way=way,
            speed=speed,
            lost=np.where(way != 0.0, self.lost, 0.0).max(axis=1),
        )
        return burns_little(self.machine, crossings)

    def alone(self, motion: int, column: int, sign: float) -> bool:
        """Return whether an axis, from a motion on, first moves alone, before any cut, and by more than its backlash.

        It takes up its backlash on its own way then.
        """
        own = self._next_move(motion, column, sign)
        return own is not None and not np.delete(self.way(own), column).any()

    def taken_up_by(self, motion: int, column: int, sign: float) -> int | None:
        """Return the rapid that, from a motion on, takes up the backlash of an axis before any cut; None for none."""
        own = self._next_move(motion, column, sign)
        carries = own is not None and self.program.motions.kind[own] == RAPID and self.shiftable[own, column]
        return own if carries else None

    def _next_move(self, motion: int, column: int, sign: float) -> int | None:
        """Return the first straight motion, from one on, that moves an axis through its backlash, before any cut."""
        moving = self.moving[column]
        place = int(np.searchsorted(moving, np.int32(motion)))
        if place == moving.size:
            return None
        own = int(moving[place])
        kind = self.program.motions.kind
        if (kind[motion:own] != RAPID).any() or kind[own] not in (RAPID, LINE):
            return None
        lost = self.machine.axes[AXES[column]].gap.lost_motion
        return own if self.way(own)[column] * sign >= APPROACH * lost else None

    def stands(self, rows: Array) -> BoolArray:
        """Mask of the changes (n,) that are not to be crossed on the fly: rows of changes."""
        return self.lies_on(rows, self._standing)

    def lies_on(self, rows: Array, motions: IntArray) -> BoolArray:
        """Mask of the changes (n,) whose axis rests or turns on some of the motions (k,), in order."""
        motion = rows[:, MOTION]
        first = np.minimum(rows[:, FIRST], motion)
        last = np.maximum(rows[:, LAST], motion + (rows[:, SHARE] == 1.0))
        return np.asarray(np.searchsorted(motions, last, side="right") > np.searchsorted(motions, first))

    def behind_rapid(self, row: Array) -> bool:
        """Return whether a change, a row of changes, happens behind a rapid."""
        return bool(self.program.motions.kind[int(row[MOTION])] == RAPID and row[SHARE] == 1.0)

    def turning_push(self, name: str) -> float:
        """Acceleration [m/s²] that an axis takes across the path in a crossing in steps; infinite elsewhere."""
        stepped = name in self.shapes and self.shapes[name].steps > 1 and self.shapes[name].arcs is None
        return TURNING * self.machine.axes[name].limits.acceleration if stepped else math.inf


def _movers(motions: Motions) -> tuple[list[PlaceArray], BoolArray]:
    """Return the motions that move each axis, and a mask (m,) of the straight ones that move none."""
    moving, still = list[PlaceArray](), motions.kind == LINE
    arcs = np.flatnonzero(motions.kind == ARC)
    turning = plane_columns(motions.plane[arcs])[:, :2]
    for axis in range(len(AXES)):
        start, end = motions.start[:, axis], motions.end[:, axis]
        moves = np.nan_to_num(end - start, copy=False) != 0.0
        moves[arcs[(turning == axis).any(axis=1)]] = True
        moving.append(np.flatnonzero(moves).astype(np.int32))
        still &= (start == end) | (np.isnan(start) & np.isnan(end))
    return moving, still


def _stretches(region: PlaceArray) -> tuple[IntArray, PlaceArray]:
    """Return where stretches of motions in one region begin, and the number of each motion's stretch (m,)."""
    new = np.append(True, region[1:] != region[:-1])[: region.size]
    number = np.cumsum(new, dtype=np.int32)
    number -= np.int32(1)
    return np.flatnonzero(new), number


def _regions(program: PartProgram, halts: BoolArray, *, exact: bool) -> PlaceArray:
    """Return the number of the stretch of every motion in which a crossing may lie; −1 where none may.

    A stretch ends where the axes stop, as behind a motion that `halts`, where modes change, and at commands of the
    machine; on an `exact` path not where S says again what is in force.
    """
    motions, words = program.motions, program.commands
    count = motions.kind.size
    keys: dict[object, int] = {}
    key = np.array(
        [keys.setdefault(replace(one, motion=None, tool=None, prepared=None), len(keys)) for one in program.modal],
        dtype=np.int32,
    )
    own = key[program.state[motions.block]] if count else np.zeros(0, dtype=np.int32)
    stop = np.zeros(count + 1, dtype=np.bool_)
    stop[1:count] |= own[1:] != own[:-1]
    stop[1:count] |= chain_heads(motions.chain)[1:]
    m_words = (words.letter == ord("M")) & np.isin(words.value, tuple(INTERRUPTING))
    dwells = words.g_words(4.0, 9.0)
    for rows in (m_words, dwells, waits_for_speed(program, exact=exact), words.letter == ord("T")):
        stop[np.searchsorted(motions.block, words.block[rows], side="left")] = True
    # S and T of a line are executed before its motion.
    for rows in (m_words, dwells):
        stop[np.searchsorted(motions.block, words.block[rows], side="right")] = True
    # Filament alone is pushed or drawn back while the axes rest.
    filament = np.array(list(filament_of(program)), dtype=motions.block.dtype)
    if filament.size:
        stop[np.searchsorted(motions.block, np.setdiff1d(filament, motions.block))] = True
    known = np.isfinite(motions.start).any(axis=1) & (motions.kind != RAPID) & (motions.kind != NURBS)
    known &= ~(np.isnan(motions.start) & ~np.isnan(motions.end)).any(axis=1)
    known &= ~program.threads
    stop[1:count] |= known[1:] != known[:-1]
    stop[1:count] |= halts[:-1]
    return np.asarray(np.where(known, np.cumsum(stop[:count], dtype=np.int32), np.int32(-1)))
