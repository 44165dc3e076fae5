"""Positions and motions, block by block, from what :mod:`ph_post.gcode.reader.modes` found blocks to do."""

from __future__ import annotations

from typing import Any

import numpy as np

from ph_post.gcode.reader.codes import (
    ABSOLUTE,
    ARC_ABSOLUTE,
    ARC_CCW,
    ARC_CW,
    ARC_FROM_NOWHERE,
    CUBIC,
    FEED_MODE,
    FORGET,
    FORGET_FIRST,
    FORGET_NAMED,
    LETTER_I,
    LETTER_P,
    LETTER_R,
    LETTER_X,
    LINE,
    NURBS_END,
    NURBS_POINT,
    PATH,
    PLANE,
    PRESET,
    QUADRATIC,
    RAPID,
    SPLINE_FROM_NOWHERE,
    UNITS,
)
from ph_post.simulate.compiling import compiled, inner


@inner
def _spread(letter: Any, value: Any, low: int, high: int, values: Any) -> Any:
    """Put a block's values in their letters' places, NaN in the others; whether X and whether Y are there."""
    values[:] = np.nan
    for word in range(low, high):
        values[np.int64(letter[word]) - 65] = value[word]


@inner
def _copy(source: Any, target: Any) -> None:
    for column in range(3):
        target[column] = source[column]


@inner
def _aim(values: Any, modes: Any, position: Any, target: Any) -> None:
    """Where a block's X, Y and Z lead from a position [m]."""
    for axis in range(3):
        told = values[LETTER_X + axis] * modes[UNITS]
        target[axis] = position[axis]
        if not np.isnan(told):
            target[axis] = told if modes[ABSOLUTE] == 1.0 else position[axis] + told


@inner
def _named(values: Any, modes: Any, position: Any, task: int) -> None:
    """Forget the named axes, or give their places the numbers that stand there (G92)."""
    for axis in range(3):
        told = values[LETTER_X + axis]
        if not np.isnan(told):
            position[axis] = told * modes[UNITS] if task == PRESET else np.nan


@inner
def _plane_axes(plane: float) -> Any:
    """First and second axis of a plane."""
    return (0, 1) if plane == 17.0 else (2, 0) if plane == 18.0 else (1, 2)


@inner
def _write_arc(values: Any, modes: Any, position: Any, row: int, task: int, out: Any) -> None:
    """Write down what an arc's words tell: offsets of the centre or the centre itself, radius, turns."""
    center, angle, turns = out
    first, second = _plane_axes(modes[PLANE])
    for column, axis in ((0, first), (1, second)):
        told = values[LETTER_I + axis] * modes[UNITS]
        if modes[ARC_ABSOLUTE] == 1.0:
            center[row, column] = told
        else:
            center[row, column] = position[axis] + (0.0 if np.isnan(told) else told)
    angle[row] = values[LETTER_R] * modes[UNITS]
    count = 1 if np.isnan(values[LETTER_P]) else int(values[LETTER_P])
    turns[row] = -count if task == ARC_CW else count


@inner
def _known(task: int, modes: Any, position: Any, target: Any) -> Any:
    """Whether the places that a curve needs are known."""
    first, second = _plane_axes(modes[PLANE]) if ARC_CW <= task <= ARC_CCW else (0, 1)
    return not np.isnan(position[first] + position[second] + target[first] + target[second])


@inner
def _kind(task: int) -> Any:
    if task in (ARC_CW, ARC_CCW):
        return 2
    if task in (CUBIC, QUADRATIC):
        return 3
    return 4 if task == NURBS_END else task - RAPID


@inner
def _write_motion(
    at: Any, values: Any, modes: Any, position: Any, target: Any, word: float, columns: Any, curves: Any
) -> None:
    """Write down one motion from `position` to `target` [m]; `word` is its F."""
    block_of, kind, starts, ends, plane, feed, duration, exact = columns
    row, block, task = at
    # Where the plane is not known no arc is read, and for the rest any will do.
    block_of[row], kind[row], plane[row] = block, _kind(task), max(np.int64(modes[PLANE]), 17)
    for axis in range(3):
        starts[row, axis], ends[row, axis] = position[axis], target[axis]
    if ARC_CW <= task <= ARC_CCW:
        _write_arc(values, modes, position, row, task, curves)
    feed[row] = 0.0
    if task != RAPID and modes[FEED_MODE] == 93.0:
        feed[row], duration[row] = np.nan, 60.0 / word
    elif task != RAPID:
        feed[row] = word * modes[UNITS] / 60.0 if modes[FEED_MODE] == 94.0 else np.nan
    exact[row] = modes[PATH] == 610.0 or modes[PATH] == 611.0


@compiled
def trace(words: Any, modal: Any, end: int, columns: Any, curves: Any) -> Any:  # noqa: C901
    """Follow the position through all blocks before `end` and write down the motions: their number.

    `words` are the columns block, letter and value; `modal` the distinct states, and for each block its
    state, F, task and why it is not understood, to which arcs and splines from unknown places are added.
    `columns` to fill: block, kind, start, end, plane, feed, duration, exact; `curves`: centre, angle and
    turns as the words have them. Durations and curves are zeros, and stay so where there is nothing to tell:
    memory that nothing is written to takes no room.
    """
    blocks, letter, value = words
    table, states, feeds, tasks, whys = modal
    values, position, target, pen = np.empty(26), np.full(3, np.nan), np.empty(3), np.full(3, np.nan)
    low, row, drawing = 0, 0, False
    for block in range(end):
        high = low
        while high < blocks.size and blocks[high] == block:
            high += 1
        first, low = low, high
        if tasks[block] == 0:
            continue
        if tasks[block] & FORGET_FIRST:
            position[:] = np.nan
        task, modes = tasks[block] & (FORGET_FIRST - 1), table[states[block]]
        if task == 0:
            continue
        _spread(letter, value, first, high, values)
        if task == FORGET:
            position[:] = np.nan
        elif task in (FORGET_NAMED, PRESET):
            _named(values, modes, position, task)
        if task >= FORGET:
            drawing = False
            continue
        _aim(values, modes, position, target)
        if task == NURBS_POINT:
            _copy(target if not np.isnan(values[LETTER_X]) else pen if drawing else position, pen)
            drawing = True
            continue
        if task == NURBS_END:
            _copy(pen, target)
        drawing = False
        if task > LINE and not _known(task, modes, position, target):
            whys[block] = ARC_FROM_NOWHERE if task <= ARC_CCW else SPLINE_FROM_NOWHERE
            position[:] = np.nan
            if modes[ABSOLUTE] == 1.0 and task != NURBS_END:
                _named(values, modes, position, PRESET)
            continue
        write_at = (row, block, task)
        _write_motion(write_at, values, modes, position, target, feeds[block], columns, curves)
        _copy(target, position)
        row += 1
    return row
