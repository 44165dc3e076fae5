"""Run a part program on a model of its controller: from its moves to the command, a row every servo period.

What the controller is like, its planner says: :class:`ph_post.types.planner.ExactPath` or
:class:`ph_post.types.planner.RoundedPath`, which is LinuxCNC's.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, TypeVar

import numpy as np
from msgspec.structs import replace

from ph_post.bounds import MOST_SAMPLES, give_memory_back
from ph_post.dialects.planners import planner_of
from ph_post.drive.cascade import response_time
from ph_post.gcode.motion_parts import places_along
from ph_post.gcode.program import AXES, Motions, PartProgram, feed_runs
from ph_post.simulate.controllers.chords import (
    StraightBlocks,
    join_blocks,
    rests_before,
    straight_blocks,
    without_places,
    without_rests,
)
from ph_post.simulate.controllers.durations import check_duration, refuse_run
from ph_post.simulate.controllers.exact_path import (
    ExactRun,
    Passage,
    corner_limits,
    count_periods,
    exact_rows,
    plan_exact,
    plan_passage,
    steps_of,
)
from ph_post.simulate.controllers.further_times import with_further_times
from ph_post.simulate.controllers.legs import DRAINS, FIRST, MOTION, ORIGIN, PAUSE, RADIUS, Legs, table_of
from ph_post.simulate.controllers.moves import bare_legs, limit_table, moves_of, own_moves, stops_before
from ph_post.simulate.controllers.planner import COLUMNS, KIND, MOST, ROUNDING, plan_legs
from ph_post.simulate.controllers.planner_cycles import run_legs
from ph_post.simulate.controllers.unknown import known_ends, with_one_zero
from ph_post.types import Array, Command, ControllerPlanner, ExactPath, IntArray, Machine, RoundedPath, sealed

DRAINED: Final = 4
"""Periods that LinuxCNC takes from the end of a motion that it waits for to the next one."""

DWELL: Final = 2
"""Periods that a dwell takes beyond its time."""

SMOOTHING: Final = np.array([1.0, 5.0, 5.0, 1.0]) / 12.0
"""Weights of the cubic interpolation that LinuxCNC's joints apply to the planner's positions, half a period on."""

ROOM: Final = 1 << 16
"""Rows that are filled at a time."""

PART: Final = 1 << 12
"""Motions of which blocks are made at a time."""


def run_program(
    program: PartProgram, machine: Machine, planner: ControllerPlanner | None = None, *, meet_turns: bool = False
) -> Command:
    """Run a program on a model of its controller.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
        Its limits and servo period are the controller's.
    planner : ExactPath or RoundedPath, optional
        In place of the machine's own.
    meet_turns : bool, optional
        Where motors follow at once, and blocks exactly, move the rows next to where an axis turns back there: tables
        are carried as far. Times are off by half a period at most.

    Returns
    -------
    Command
        X, Y and Z as far as the machine has them, a row every servo period, from rest to rest. `segment` is
        the number of the motion in the program, -1 before the first; `xi` how much of it is done (0 to 1);
        `s` the way the tool has come [m], rapids and shifts included; `feed` the speed along it.

    Raises
    ------
    TooLargeError
        Where the motion takes too many servo periods.
    """
    return PlannedRun(program, machine, planner).command(meet_turns=meet_turns)


class PlannedRun:
    """A program as a model of its controller plans it, of which rows are made where they are asked for.

    Parameters
    ----------
    program, machine, planner
        As of :func:`run_program`, which raises the same.
    longest : float, optional
        Time [s] beyond which no row is asked for: of a longer program no more is kept than its time takes.
    """

    def __init__(
        self,
        program: PartProgram,
        machine: Machine,
        planner: ControllerPlanner | None = None,
        longest: float = math.inf,
    ) -> None:
        self._machine, self._program = machine, with_further_times(with_one_zero(program), machine)
        self._planner = planner_of(machine) if planner is None else planner
        self._exact: ExactRun | None = None
        self._periods: int | None = None
        self._moves: Legs | None = None
        limits, period = limit_table(machine), machine.servo_period
        if isinstance(self._planner, RoundedPath):
            moves, least = _moves(self._program, limits, self._planner, period)
            if least > longest:
                rows = _rows(*_planned(moves, limits, period), period, self._program)
                self._periods = sum(motion.size for _, motion, _ in rows) + SMOOTHING.size - 2
            else:
                self._moves = moves
        else:
            blocks = _blocks(self._program, limits, self._planner, period, longest)
            if blocks.length.size and not blocks.start.size:
                self._periods = count_periods(blocks, self._planner, limits, period, self._program)
            else:
                self._exact = plan_exact(blocks, self._planner, limits, period, self._program)
                self._periods = self._exact.periods

    @property
    def time(self) -> float | None:
        """Time of the last row [s]; None where the rows say, which are not too many."""
        return None if self._periods is None else self._periods * self._machine.servo_period

    def command(self, *, meet_turns: bool = False) -> Command:
        """Return the rows, as :func:`run_program`."""
        machine, program, planner, period = self._machine, self._program, self._planner, self._machine.servo_period
        if self._exact is None and self._moves is None:
            return PlannedRun(program, machine, planner).command(meet_turns=meet_turns)
        if self._exact is not None:
            meet_turns = meet_turns and not any(response_time(axis.servo) for axis in machine.axes.values())
            return _command(*exact_rows(self._exact, period, meet_turns=meet_turns), machine)
        assert self._moves is not None
        moves, self._moves = _planned(self._moves, limit_table(machine), period), None
        position, motion, share = _run(*moves, period, program)
        return _command(position, *own_moves(program, motion, share), steps_of(position), machine)


def planned_passage(program: PartProgram, machine: Machine) -> Passage:
    """Return when and how fast a program passes its places, on a controller that follows the path exactly.

    Parameters
    ----------
    program : PartProgram
        However long it takes.
    machine : Machine
    """
    limits, planner = limit_table(machine), planner_of(machine)
    assert isinstance(planner, ExactPath)
    program = with_further_times(with_one_zero(program), machine)
    blocks = _blocks(program, limits, planner, machine.servo_period, longest=-math.inf)
    return plan_passage(blocks, planner, limits, places_along(program.motions))


def check_run(program: PartProgram, machine: Machine) -> None:
    """Refuse a program that takes too long to be run on a model of its controller.

    Parameters
    ----------
    program : PartProgram
    machine : Machine

    Raises
    ------
    TooLargeError
        By the lengths of its moves at the speeds asked for, and its dwells.
    """
    limits, planner = limit_table(machine), planner_of(machine)
    program = with_further_times(program, machine)
    if isinstance(planner, ExactPath):
        _blocks(program, limits, planner, machine.servo_period)
    else:
        _moves(program, limits, planner, machine.servo_period)


def planned_speeds(program: PartProgram, machine: Machine) -> Array:
    """Return the speed that LinuxCNC keeps to in each motion at any feed [m/s], (m,); infinite where it has no leg.

    In arcs half of the acceleration is left for it beside a corner that is blended: an arc that is divided is faster.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    """
    limits, period, planner = limit_table(machine), machine.servo_period, planner_of(machine)
    assert isinstance(planner, RoundedPath)
    legs, table = _planned(moves_of(program, limits, planner), limits, period)
    found = np.full(program.motions.kind.size, np.inf)
    own = table[:, KIND] != ROUNDING
    np.minimum.at(found, legs[own, MOTION].astype(np.int64), table[own, MOST])
    return found


def _planned(moves: Legs, limits: Array, period: float) -> tuple[Array, Array]:
    """Let the planner blend and plan moves: a leg each, (n, columns of legs), and its plan, (n, COLUMNS)."""
    given = table_of(moves)
    legs, table = np.zeros((2 * len(given), given.shape[1])), np.zeros((2 * len(given), COLUMNS))
    count = plan_legs(given, legs, table, limits, period)
    return legs[:count], table[:count]


def _blocks(
    program: PartProgram, limits: Array, planner: ExactPath, period: float, longest: float = math.inf
) -> StraightBlocks:
    """Return the blocks of an exact-path controller, if they are not too long to run.

    Of a program that takes longer than `longest` [s] they have what its time needs, however long that is.
    """
    parts: list[StraightBlocks] = []
    stops = stops_before(program, exact=True)
    begin, least, counted, last = np.zeros(3), float(planner.dwell(stops[0][stops[0] > 0.0]).sum()), 0, None
    program.source.let_go()
    for first in range(0, max(program.motions.kind.size, 1), PART):
        part = _part_of(program, first, first + PART)
        start, end = known_ends(part, begin)
        made = straight_blocks(part, bare_legs(part, limits, start, end), limits, planner, begin)
        parts.append(without_rests(made._replace(motion=made.motion + np.int32(first))))
        begin, least = end[-1] if end.size else begin, least + float((made.length / made.speed).sum())
        while least > longest and counted < len(parts):
            # What corners need of the blocks is as large as all else.
            parts[counted], last = _counted(parts[counted], last, limits, planner)
            counted += 1
    give_memory_back(program.blocks)
    blocks = join_blocks(parts)
    pause, joined = rests_before(*stops, blocks.motion, planner)
    blocks = blocks._replace(pause=pause, joined=joined)
    if least <= longest:
        check_duration(program, blocks.motion, blocks.length / blocks.speed + blocks.pause, period)
    return blocks


def _counted(
    blocks: StraightBlocks, before: StraightBlocks | None, limits: Array, planner: ExactPath
) -> tuple[StraightBlocks, StraightBlocks | None]:
    """Return blocks of which no row is wanted, and the last of them; `before` is the last block before them."""
    last = StraightBlocks._make(column[-1:] for column in blocks) if blocks.length.size else before
    own = blocks if before is None else join_blocks([before, blocks])
    corner = corner_limits(own._replace(joined=np.ones(own.length.size, dtype=np.bool_)), planner, limits)
    return without_places(blocks, corner[own.length.size - blocks.length.size :]), last


def _part_of(program: PartProgram, first: int, last: int) -> PartProgram:
    """Return a program with the motions from `first` to before `last` alone."""
    motions, rows = program.motions, slice(first, last)
    others = ("feeds", "control", "nurbs")
    own = {name: getattr(motions, name)[rows] for name in motions.__struct_fields__ if name not in others}
    control = {k - first: points for k, points in motions.control.items() if first <= k < last}
    nurbs = {k - first: curve for k, curve in motions.nurbs.items() if first <= k < last}
    return replace(
        program, motions=Motions(**own, feeds=feed_runs(motions.feeds.of(rows)), control=control, nurbs=nurbs)
    )


def _moves(program: PartProgram, limits: Array, planner: RoundedPath, period: float) -> tuple[Legs, float]:
    """Return the moves that LinuxCNC's planner gets, if they are not too long to run, and their least time [s]."""
    moves = moves_of(program, limits, planner)
    with np.errstate(divide="ignore"):
        took = moves.length / moves.speed + moves.pause
    check_duration(program, moves.motion, took, period)
    return moves, float(took.sum())


AnyArray = TypeVar("AnyArray", Array, IntArray)
Rows = tuple[Array, IntArray, Array]


def _rows(legs: Array, table: Array, period: float, program: PartProgram) -> Iterator[Rows]:
    """Yield position, motion and share of every period, as far as bounds go: accelerations may make a run longer."""
    count = len(legs)
    pause = legs[:, PAUSE]
    dwell = np.ceil(pause / period - 1e-6) + DWELL
    rests = np.where(pause > 0.0, dwell, legs[:, DRAINS] * DRAINED).astype(np.int64)
    state = np.array([*_beginning(legs), 0.0, -1.0])
    rests[:1] = 0
    leg, parts = 0, 1
    yield _beginning(legs)[None, :], np.array([-1]), np.zeros(1)
    while leg < count:
        part = (np.empty((ROOM, 3)), np.empty(ROOM, dtype=np.int64), np.empty(ROOM))
        leg, filled = run_legs(legs, table, count, period, rests, leg, state, *part)
        yield part[0][:filled], part[1][:filled], part[2][:filled]
        parts += 1
        if leg < count and parts * ROOM > MOST_SAMPLES:
            refuse_run(program, legs[leg, MOTION], period)


def _run(legs: Array, table: Array, period: float, program: PartProgram) -> Rows:
    """Return position, motion and share of every period, positions as the joints interpolate them."""
    parts = list(_rows(legs, table, period, program))
    position, motion, share = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    parts.clear()  # as large as all else here
    behind = SMOOTHING.size - 1
    position = _padded(position, behind, behind)
    smooth = np.stack([np.convolve(column, SMOOTHING, mode="valid") for column in position.T], axis=1)
    return smooth, _padded(motion, 1, behind - 1), _padded(share, 1, behind - 1)


def _padded(values: AnyArray, before: int, behind: int) -> AnyArray:
    """Repeat the first and the last row."""
    width = [(before, behind)] + [(0, 0)] * (values.ndim - 1)
    return np.pad(values, width, mode="edge")


def _beginning(legs: Array) -> Array:
    """Return the beginning of the first leg."""
    if not len(legs):
        return np.zeros(3)
    first: Array = legs[0]
    return np.asarray(first[ORIGIN : ORIGIN + 3] + first[RADIUS] * first[FIRST : FIRST + 3])


def _command(position: Array, motion: IntArray, share: Array, steps: Array, machine: Machine) -> Command:
    names = tuple(name for name in AXES if name in machine.axes)
    columns = [AXES.index(name) for name in names]
    period = machine.servo_period
    count = len(position)
    ways: Array = np.concatenate([[0.0], steps])
    return Command(
        axes=names,
        period=period,
        t=sealed(np.arange(count, dtype=np.float64) * period),
        segment=motion,
        xi=sealed(share),
        s=sealed(np.cumsum(ways)),
        position=sealed(position[:, columns]),
        feed=sealed(ways / period),
        window=np.broadcast_to(np.int64(-1), count),
    )
