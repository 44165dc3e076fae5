"""Write a plan as a part program: head, approach, cuts, retreat.

Every axis is approached so that it starts on the side of its backlash that the plan counts on: that of the offset
it carries, or else that of its first motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import msgspec
import numpy as np

from ph_post.compensate.offsets import APPROACH_FEED, LEAST_APPROACH, approach_distance, corner_pause, may_shift
from ph_post.dialects.base import Dialect
from ph_post.drive.axes import side_offsets, sized_machine
from ph_post.drive.cascade import response_time
from ph_post.errors import InputError
from ph_post.gcode.blocks import DWELL, JOG, Moves, TrackShape
from ph_post.gcode.program import plane_of
from ph_post.geometry.piecewise import MEETS
from ph_post.geometry.track import Track
from ph_post.post.blocks import cut_blocks
from ph_post.post.moves import check_jogs, read_jogs, round_blocks, with_jogs
from ph_post.post.options import ProgramOptions, check_options
from ph_post.post.remarks import controller_warnings, header_lines, plan_warnings
from ph_post.types import Array, BoolArray, Jog, Plan, TurningPoint, frozen


def approach_offset(shape: TrackShape, plan: Plan, s: float, end: float, carried: Array) -> Array:
    """Return the offset [m] from the start of a cut to the point from which it is approached, shape (dim,).

    An axis that the plan shifts arrives on the side of its backlash to which the offset belongs that it carries
    there. Others against their first motion, an axis that stands still at first against the first one later, 0
    where it never moves; Z upwards whatever it does, so that the tool comes down onto the start.

    Parameters
    ----------
    shape : TrackShape
    plan : Plan
        Its turning points give the first motion, its machine's lost motions how far; an axis the machine does
        not have counts as one without.
    s, end : float
        The cut, as places along the motion [m].
    carried : Array, shape (dim,)
        Offset from the path that each axis carries at the start [m].
    """
    axes, machine = plan.path.axes, plan.machine
    drives = machine.axes
    distance = np.array([approach_distance(drives[axis].gap) if axis in drives else LEAST_APPROACH for axis in axes])
    upwards = np.array([axis == "Z" for axis in axes])
    senses = first_directions(shape, plan.turning_points, axes, s, end)
    for column, axis in enumerate(axes):
        if axis in shifted_axes(plan):
            minus, plus = side_offsets(sized_machine(machine, plan.turning_points).axes[axis])
            senses[column] = 1.0 if abs(carried[column] - plus) < abs(carried[column] - minus) else -1.0
    return np.asarray(np.where(upwards, 1.0, -senses) * distance)


def shifted_axes(plan: Plan) -> tuple[str, ...]:
    """Axes behind whose loop a plan for a program shifts the path by a lasting offset."""
    drives = plan.machine.axes
    jogged = {one.axis for one in plan.crossings if isinstance(one, Jog)}
    return tuple(axis for axis in plan.path.axes if axis in jogged and not drives[axis].loop.encloses_backlash)


def first_directions(
    shape: TrackShape, points: Sequence[TurningPoint], axes: tuple[str, ...], s: float, end: float
) -> Array:
    """Return the sign of each axis' first travel after `s` [m], 0 where there is none up to `end`, shape (dim,).

    An axis rises up to a maximum and falls down to a minimum, however soon after the start that comes; where
    it does not reverse, it follows from the ends.
    """
    origin, last = shape.positions(np.array([s, end]))
    senses: Array = np.where(np.abs(last - origin) > MEETS, np.sign(last - origin), 0.0)
    for column, axis in enumerate(axes):
        for point in points:
            moved = s < point.s < end and abs(point.position - origin[column]) > MEETS
            if point.axis == axis and moved:
                senses[column] = 1.0 if point.sense == "max" else -1.0
                break
    return senses


class Program(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A part program.

    `text`, its lines ended by a newline each; `warnings` in words; `moves` the number n of moves on the path,
    `time` [s] the time planned for them; `joints` (n + 1, dim) [m] the points between which they go, as they are
    written, and `places` (n + 1,) [m] where along the path those are.
    """

    text: str
    warnings: tuple[str, ...]
    moves: int
    time: float
    joints: Array
    places: Array


def make_program(plan: Plan, track: Track, dialect: Dialect, options: ProgramOptions | None = None) -> Program:
    """Write a plan as a part program.

    Parameters
    ----------
    plan : Plan
    track : Track
        Of the plan's path.
    dialect : Dialect
        From :func:`ph_post.dialects.registry.find_dialect`.
    options : ProgramOptions, optional

    Returns
    -------
    Program
        The same input gives the same bytes.

    Raises
    ------
    InputError
        If an option has an impossible value, or the dialect cannot do what was asked for.
    """
    chosen = options or ProgramOptions()
    inverse = chosen.feed_mode == "inverse-time"
    if inverse and not dialect.abilities.inverse_time:
        what = f"the dialect {dialect.name} has no inverse time"
        raise InputError("--feed-mode", what, expected="per-minute", got=chosen.feed_mode)
    check_options(chosen, plan.path, plan.machine.servo_period)
    return _Job(plan, track, dialect, chosen).program()


class _Job:
    """One program in the making."""

    def __init__(self, plan: Plan, track: Track, dialect: Dialect, options: ProgramOptions) -> None:
        self.plan = plan
        self.dialect = dialect
        self.options = options
        self.axes = plan.path.axes
        found = read_jogs(plan)
        check_jogs(found.jogs, dialect)
        blocks, self.shape = cut_blocks(msgspec.structs.replace(plan, phases=found.phases), track, dialect, options)
        blocks, carried = with_jogs(blocks, found, self.axes)
        self.moves = round_blocks(blocks, self.shape, dialect, carried, found.phases)
        self.out = dialect.line_writer(self.axes, options.chord_tolerance)
        # rapids in which no axis is too fast; at the feed of the path where no limit is known
        fastest = min((axis.limits.velocity for axis in plan.machine.axes.values()), default=math.inf)
        self.out.rapid_speed = fastest if math.isfinite(fastest) else plan.path.feed
        self.safe = self._height(options.safe_z)
        self.depth = self._height(options.depth)

    def program(self) -> Program:
        """Write the header, the opening, the cuts each with its approach, and the end."""
        self.out.add(header_lines(self.plan, self.dialect, self.options))
        self.out.add(self.dialect.syntax.opening(plane_of(self.axes)[0]))
        own = self.plan.machine.own_correction
        self.out.add(self.dialect.notices.guard if own is not None else ())
        for first, last, rapid in _groups(self.moves):
            if rapid:
                self._rapids(first, last)
            else:
                self._cut(first, last)
        self._leave()
        sizes = np.array(self.out.sizes)
        warnings = (
            *plan_warnings(self.plan, self.options, self.moves),
            *controller_warnings(self.plan, self.dialect, self.options, self.moves, sizes),
        )
        lines = self.dialect.finished(self.out.lines, self.plan.path.name)
        text = "\n".join([*lines, ""])
        moves = self.moves
        return Program(
            text=text,
            warnings=warnings,
            moves=moves.kind.size,
            time=float(moves.duration.sum()),
            joints=frozen(moves.points * self.dialect.numbers.quantum),
            places=frozen(np.append(moves.s0, moves.s1[-1:])),
        )

    def _rapids(self, first: int, last: int) -> None:
        """Rapid segments, above the part where a safe height is known and the path has no heights itself."""
        self.out.path_mode(exact=True)
        if self.depth is not None:
            self._lift()
        if first == 0:
            self._wind_up(first, last)
        if (self.moves.kind[first:last] == JOG).any():
            self.out.feed_mode(inverse=self.options.feed_mode == "inverse-time")
        self.out.moves(self.moves, first, last)

    def _wind_up(self, first: int, last: int) -> None:
        """Go to the start of a path that begins with a rapid, each axis that carries an offset onto its side."""
        start, offset = self._point(first), self._offset(first, last)
        shifted = shifted_axes(self.plan)
        self.out.straight("G0", start | {axis: start[axis] + offset[axis] for axis in shifted})
        if shifted:
            self.out.feed_mode(inverse=False)
            feed = min(APPROACH_FEED, self.plan.path.feed)
            self.out.straight("G1", {axis: start[axis] for axis in shifted}, feed)

    def _cut(self, first: int, last: int) -> None:
        """Write the moves between rapids; only the first are approached where nothing lifts the tool."""
        self.out.path_mode(exact=True)
        if first == 0 or self.depth is not None:
            self._approach(first, last)
        self._wait()
        self.out.path_mode(exact=False)
        self.out.feed_mode(inverse=self.options.feed_mode == "inverse-time")
        self.out.moves(self.moves, first, last)

    def _approach(self, first: int, last: int) -> None:
        """Go beside the start, then slowly onto it, each axis in the sense of its first motion, then down."""
        start, offset = self._point(first), self._offset(first, last)
        across = [axis for axis in self.axes if axis != "Z"]
        self.out.feed_mode(inverse=False)
        self._lift()
        self.out.straight("G0", {axis: start[axis] + offset[axis] for axis in across})
        if "Z" in start and self.safe is None:
            self.out.straight("G0", {"Z": start["Z"] + offset["Z"]})
        feed = min(APPROACH_FEED, self.plan.path.feed)
        self.out.straight("G1", {axis: start[axis] for axis in across if offset[axis] != 0}, feed)
        depth = start.get("Z", self.depth)
        if depth is not None:
            self.out.straight("G1", {"Z": depth}, feed)

    def _wait(self) -> None:
        """Let the motors that lag behind arrive before the path leaves its start."""
        drives = [drive for axis in self.axes if (drive := self.plan.machine.axes.get(axis)) is not None]
        late = [drive for drive in drives if may_shift(drive) and response_time(drive.servo) > 0.0]
        if late:
            self.out.write_dwell(max(map(corner_pause, late)))

    def _leave(self) -> None:
        """Lift off, and take the offset back, so that the axes stand where their coordinates say."""
        self.out.feed_mode(inverse=False)
        self._lift()
        end, plain = self._point(self.moves.kind.size), self.moves.plain.tolist()
        back = {axis: place for axis, place in zip(self.axes, plain, strict=True) if end[axis] != place}
        if back:
            self.out.path_mode(exact=True)
            self.out.straight("G1", back, min(APPROACH_FEED, self.plan.path.feed))
        own = self.plan.machine.own_correction
        if own is not None and self.dialect.notices.guard:
            self.out.add([self.dialect.notices.closing(own)])
        self.out.add(self.dialect.syntax.closing)

    def _lift(self) -> None:
        if self.safe is not None:
            self.out.straight("G0", {"Z": self.safe})

    def _point(self, number: int) -> dict[str, int]:
        return dict(zip(self.axes, self.moves.points[number].tolist(), strict=True))

    def _offset(self, first: int, last: int) -> dict[str, int]:
        s, end = float(self.moves.s0[first]), float(self.moves.s1[last - 1])
        offset = approach_offset(self.shape, self.plan, s, end, self._carried(first))
        return dict(zip(self.axes, self.dialect.numbers.counts(offset).tolist(), strict=True))

    def _carried(self, number: int) -> Array:
        """Offset from the path that the axes carry at the start of a move [m], rounded."""
        plain = self.shape.positions(self.moves.s0[number : number + 1])[0]
        away = self.moves.points[number] - self.dialect.numbers.counts(plain)
        return np.asarray(away * self.dialect.numbers.quantum)

    def _height(self, z: float | None) -> int | None:
        return None if z is None else self.dialect.numbers.count(z)


def _groups(moves: Moves) -> Iterator[tuple[int, int, bool]]:
    """Neighbouring moves that are all rapid, or none: (first, last + 1, rapid).

    A rest that has nothing but rapids around it belongs to them, with what is shifted in it: nothing is cut
    there, so the tool stays up.
    """
    rapid = moves.rapid != 0
    still = np.isin(moves.kind, (DWELL, JOG))
    for first, last in _runs(rapid):
        rapid[first:last] |= still[first:last].all()
    for first, last in _runs(rapid):
        yield first, last, bool(rapid[first])


def _runs(values: BoolArray) -> list[tuple[int, int]]:
    """Stretches of equal values: (first, last + 1)."""
    changes = (np.flatnonzero(np.diff(values)) + 1).tolist()
    return list(pairwise([0, *changes, values.size]))
