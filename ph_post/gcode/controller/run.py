"""Running a program on a model of its controller."""

from __future__ import annotations

from typing import Final, TypeVar

import numpy as np

from ph_post.gcode.controller.kernel import COLUMNS, plan_legs, run_legs
from ph_post.gcode.controller.legs import DRAINS, FIRST, ORIGIN, PAUSE, RADIUS, table_of
from ph_post.gcode.controller.moves import limit_table, moves_of
from ph_post.gcode.reader.record import AXES, PartProgram
from ph_post.types import Array, Command, IntArray, Machine, frozen, sealed

DRAINED: Final = 4
"""Periods that LinuxCNC takes from the end of a motion that it waits for to the next one."""

DWELL: Final = 2
"""Periods that a dwell takes beyond its time."""

SMOOTHING: Final = np.array([1.0, 5.0, 5.0, 1.0]) / 12.0
"""What LinuxCNC's joints make of the planner's positions, by period: cubic interpolation, half way on."""

ROOM: Final = 1 << 16
"""Rows that are filled at a time."""


def run_program(program: PartProgram, machine: Machine) -> Command:
    """Run a program on a model of its controller.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
        Its limits and servo period are the controller's.

    Returns
    -------
    Command
        X, Y and Z as far as the machine has them, a row every servo period, from rest to rest. `segment` is
        the number of the motion in the program, -1 before the first; `xi` how much of it is done (0 to 1);
        `s` the way the tool has come [m], rapids and shifts included; `feed` the speed along it.
    """
    limits = limit_table(machine)
    period = machine.servo_period
    moves = table_of(moves_of(program, limits))
    legs, table = np.zeros((2 * len(moves), moves.shape[1])), np.zeros((2 * len(moves), COLUMNS))
    count = plan_legs(moves, legs, table, limits, period)
    rows = _run(legs, table, count, period)
    return _command(rows, machine)


AnyArray = TypeVar("AnyArray", Array, IntArray)
Rows = tuple[Array, IntArray, Array]


def _run(legs: Array, table: Array, count: int, period: float) -> Rows:
    """Position, motion and share of every period."""
    pause = legs[:count, PAUSE]
    dwell = np.ceil(pause / period - 1e-6) + DWELL
    rests = np.where(pause > 0.0, dwell, legs[:count, DRAINS] * DRAINED).astype(np.int64)
    state = np.array([*_beginning(legs, count), 0.0, -1.0])
    rests[:1] = 0
    leg, parts = 0, [(_beginning(legs, count)[None, :], np.array([-1]), np.zeros(1))]
    while leg < count:
        part = (np.empty((ROOM, 3)), np.empty(ROOM, dtype=np.int64), np.empty(ROOM))
        leg, filled = run_legs(legs, table, count, period, rests, leg, state, *part)
        parts.append((part[0][:filled], part[1][:filled], part[2][:filled]))
    position, motion, share = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    behind = SMOOTHING.size - 1
    return _smoothed(position), _padded(motion, 1, behind - 1), _padded(share, 1, behind - 1)


def _padded(values: AnyArray, before: int, behind: int) -> AnyArray:
    """Repeat the first and the last row."""
    width = [(before, behind)] + [(0, 0)] * (values.ndim - 1)
    return np.pad(values, width, mode="edge")


def _smoothed(position: Array) -> Array:
    wide = _padded(position, SMOOTHING.size - 1, SMOOTHING.size - 1)
    return np.stack([np.convolve(column, SMOOTHING, mode="valid") for column in wide.T], axis=1)


def _beginning(legs: Array, count: int) -> Array:
    """Where the first leg begins."""
    if count == 0:
        return np.zeros(3)
    first: Array = legs[0]
    return np.asarray(first[ORIGIN : ORIGIN + 3] + first[RADIUS] * first[FIRST : FIRST + 3])


def _command(rows: Rows, machine: Machine) -> Command:
    position, motion, share = rows
    names = tuple(name for name in AXES if name in machine.axes)
    columns = [AXES.index(name) for name in names]
    period = machine.servo_period
    steps = np.sqrt((np.diff(position, axis=0) ** 2).sum(axis=1))
    count = len(position)
    return Command(
        axes=names, period=period, t=frozen(np.arange(count) * period), segment=motion, xi=sealed(share),
        s=frozen(np.concatenate([[0.0], np.cumsum(steps)])), position=frozen(position[:, columns]),
        feed=frozen(np.concatenate([[0.0], steps]) / period), window=np.full(count, -1, dtype=np.int64),
    )  # fmt: skip
