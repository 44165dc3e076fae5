"""Decide what each block does, and follow positions and motions: two compiled passes.

They work on the modal states that :mod:`ph_post.gcode.modes` resolves.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ph_post.compiling import compiled, inner
from ph_post.gcode.codes import (
    ABSOLUTE,
    ALWAYS,
    ARC_ABSOLUTE,
    ARC_CCW,
    ARC_CW,
    ARC_FROM_NOWHERE,
    AXES,
    CENTER,
    COMPENSATED,
    COMPENSATION,
    CUBIC,
    CYCLE,
    DWELL_AXES,
    EXPLICIT,
    FEED_MODE,
    FOREIGN_CENTER,
    FORGET,
    FORGET_FIRST,
    FORGET_NAMED,
    FRAME_CHANGE,
    FRAMED,
    FURTHER,
    FURTHER_AXIS,
    HOME,
    KNOWN_SHIFT,
    LENIENT,
    LENIENT_LINE,
    LETTER_F,
    LETTER_I,
    LETTER_J,
    LETTER_K,
    LETTER_M,
    LETTER_P,
    LETTER_R,
    LETTER_S,
    LETTER_X,
    LETTER_Y,
    LETTER_Z,
    LINE,
    LONE_SPLINE,
    MACHINE,
    MISSING_CENTER,
    MIXED_CENTER,
    MOST_TURNS,
    NO_CENTER,
    NO_DWELL,
    NO_FEED,
    NO_INVERSE_FEED,
    NO_MOTION_MODE,
    NO_RADIUS_END,
    NURBS_END,
    NURBS_LETTERS,
    NURBS_POINT,
    OFFSET_LINE,
    OTHER_FRAME,
    PATH,
    PLANE,
    PRESET,
    PROBE,
    QUADRATIC,
    RAPID,
    REST,
    SPLINE_FROM_NOWHERE,
    SPLINE_LETTERS,
    SPLINE_PLANE,
    THREAD,
    TOOL_CHANGE,
    TURNS,
    UNITS,
    UNKNOWN,
    UNSURE_MODE,
    UNUSED_WORD,
    ZERO_FEED,
)


@inner
def _spread_values(letter: Any, value: Any, low: int, high: int, values: Any) -> Any:
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
    """Find the target [m] to which a block's X, Y and Z lead from a position."""
    for axis in range(3):
        value = values[LETTER_X + axis] * modes[UNITS]
        target[axis] = position[axis]
        if not np.isnan(value):
            target[axis] = value if modes[ABSOLUTE] == 1.0 else position[axis] + value


@inner
def _named(values: Any, modes: Any, position: Any, task: int) -> None:
    """Forget the named axes, or give their places the numbers that stand there (G92)."""
    for axis in range(3):
        value = values[LETTER_X + axis]
        if not np.isnan(value):
            position[axis] = value * modes[UNITS] if task == PRESET else np.nan


@inner
def _plane_axes(plane: float) -> Any:
    """First and second axis of a plane."""
    return (0, 1) if plane == 17.0 else (2, 0) if plane == 18.0 else (1, 2)


@inner
def _write_arc(values: Any, modes: Any, position: Any, row: int, task: int, out: Any) -> None:
    """Write down the words of an arc: offsets of the centre or the centre itself, radius, turns."""
    center, angle, turns = out
    first, second = _plane_axes(modes[PLANE])
    for column, axis in ((0, first), (1, second)):
        value = values[LETTER_I + axis] * modes[UNITS]
        if modes[ARC_ABSOLUTE] == 1.0:
            center[row, column] = value
        else:
            center[row, column] = position[axis] + (0.0 if np.isnan(value) else value)
    angle[row] = values[LETTER_R] * modes[UNITS]
    count = 1 if np.isnan(values[LETTER_P]) else int(values[LETTER_P])
    turns[row] = -count if task == ARC_CW else count


@inner
def _known(task: int, modes: Any, position: Any, target: Any) -> Any:
    """Return True if the places that a curve needs are known."""
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
def trace_motions(words: Any, modal: Any, end: int, columns: Any, curves: Any) -> Any:  # noqa: C901
    """Follow the position through all blocks before `end`, write down the motions and return their number.

    `words` are the columns block, letter and value; `modal` the distinct states, and for each block its
    state, F, task and why it is not understood, to which arcs and splines from unknown places are added.
    `columns` to fill: block, kind, start, end, plane, feed, duration, exact; `curves`: centre, angle and
    turns as the words have them. Durations and curves are zeros, and stay so where nothing is written:
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
        _spread_values(letter, value, first, high, values)
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


@inner
def _spread(letter: Any, value: Any, low: int, high: int, values: Any, where: Any) -> Any:
    """Put a block's words in their letters' places, and return the letters present, a bit each."""
    present = np.int64(0)
    for word in range(low, high):
        index = np.int64(letter[word]) - 65
        present |= 1 << index
        values[index], where[index] = value[word], word
    return present


@inner
def _arc_fault(values: Any, present: int, where: Any, modes: Any) -> Any:  # noqa: PLR0911
    """Return why the centre of an arc is refused, and the word; 0 where it is given once and whole."""
    plane = modes[PLANE]
    third = LETTER_K if plane == 17.0 else LETTER_J if plane == 18.0 else LETTER_I
    inside = present & CENTER & ~(1 << third)
    radius = (present >> LETTER_R) & 1
    if radius and present & CENTER:
        return MIXED_CENTER, where[LETTER_R]
    if not radius and not inside:
        return NO_CENTER, -1
    if (present >> third) & 1 and values[third] != 0.0:
        return FOREIGN_CENTER, where[third]
    if radius and not present & (
        AXES & ~(1 << (LETTER_Z if third == LETTER_K else LETTER_Y if third == LETTER_J else LETTER_X))
    ):
        return NO_RADIUS_END, where[LETTER_R]
    if not radius and modes[ARC_ABSOLUTE] == 1.0 and inside != (CENTER & ~(1 << third)):
        return MISSING_CENTER, -1
    turns = values[LETTER_P] if (present >> LETTER_P) & 1 else 1.0
    if not 1.0 <= turns <= MOST_TURNS or turns != np.floor(turns):
        return TURNS, where[LETTER_P]
    return 0, -1


@inner
def _feed_fault(present: int, where: Any, modes: Any, feed: float, known: int) -> Any:
    """Return why the feed of a cut is refused, and the word; 0 where it is known or may be."""
    word = where[LETTER_F] if (present >> LETTER_F) & 1 else -1
    if modes[FEED_MODE] == 93.0 and not (present >> LETTER_F) & 1:
        return NO_INVERSE_FEED, -1
    if known == 0:
        return NO_FEED, -1
    if feed == 0.0:
        return ZERO_FEED, word
    return 0, -1


@inner
def _zero_group(code: int, motion: int, explicit: int, present: int, modes: Any) -> Any:
    """Return what a word of group 0 does: task (-1: the motion's), break, why not understood, refused."""
    axes = present & (AXES | FURTHER)
    task, mark, why, refused = -1, 0, 0, 0
    if code == 40:
        timed = (present >> LETTER_P) & 1 or ((present >> LETTER_S) & 1 and not explicit)
        apart = axes and not (timed and explicit)
        why, refused = DWELL_AXES if apart else 0, 0 if timed or apart else NO_DWELL
        task = -1 if axes and explicit else REST
    elif code in (100, 520):
        task, mark = FORGET, FRAME_CHANGE
    elif code in (280, 300):
        task, mark = FORGET, HOME
    elif code in (281, 301):
        task, mark = REST, HOME
    elif code == 920:
        task, mark = PRESET if axes else FORGET, FRAME_CHANGE
    elif code == 53:
        task, why = NURBS_END, 0 if motion == 52 else LONE_SPLINE
    elif code == 530:
        named = modes[ABSOLUTE] == 1.0 and not axes & FURTHER
        task, mark = REST, 0
        if axes:
            task, mark = FORGET_NAMED if named else FORGET, MACHINE
    return task, mark, why, refused


@inner
def _motion_task(code: int, explicit: int, present: int) -> Any:
    """Return what the motion mode makes of a block: task, break, why not understood, letters it uses."""
    axes = present & (AXES | FURTHER)
    arcs = code in (20, 30)
    task, mark, why, used = FORGET, 0, 0, AXES
    if (not explicit and not axes and not (arcs and present & CENTER)) or (code == 800 and not axes):
        task = REST
    elif arcs:
        task, used = ARC_CW if code == 20 else ARC_CCW, AXES | CENTER | (1 << LETTER_P) | (1 << LETTER_R)
    elif code in (0, 10):
        task = REST if not axes else RAPID if code == 0 else LINE
    elif code in (50, 51):
        task, used = CUBIC if code == 50 else QUADRATIC, SPLINE_LETTERS
    elif code == 52:
        task, used = NURBS_POINT, NURBS_LETTERS
    elif 382 <= code <= 385:
        mark = PROBE
    elif code in (-1, 800):
        why = NO_MOTION_MODE
    elif code == -2:
        why = UNSURE_MODE
    else:
        why = THREAD if code in (330, 331) else CYCLE
    return task, mark, why, used


@inner
def _doubt(task: int, used: int, present: int, flags: int, modes: Any) -> Any:
    """Return why a motion is not understood, 0 where it is."""
    rest = present & ~(used | ALWAYS)
    if flags & LENIENT_LINE:
        rest &= ~LENIENT
    unsure = modes[UNITS] == UNKNOWN or modes[ABSOLUTE] == UNKNOWN
    unsure = unsure or (task >= ARC_CW and (modes[PLANE] == UNKNOWN or modes[ARC_ABSOLUTE] == UNKNOWN))
    why = 0
    if flags & FRAMED:
        why = OTHER_FRAME
    elif rest & FURTHER:
        why = FURTHER_AXIS
    elif rest:
        why = UNUSED_WORD
    elif unsure or (task >= LINE and modes[FEED_MODE] == UNKNOWN):
        why = UNSURE_MODE
    elif task >= CUBIC and modes[PLANE] != 17.0:
        why = SPLINE_PLANE
    return why


@inner
def _is_odd(present: int, flags: int) -> Any:
    """Return True if a block without a motion has letters that none of its words uses."""
    rest = present & ~ALWAYS
    if flags & LENIENT_LINE or (present >> LETTER_M) & 1:
        rest &= ~LENIENT
    return rest != 0


@inner
def _decide(block: Any, values: Any, present: int, where: Any, modes: Any) -> Any:
    """Return what a block does: task, break, why not understood, why refused, the word."""
    zero, motion, flags, feed = block
    explicit, word = flags & EXPLICIT, -1
    task, mark, why, refused = _zero_group(zero, motion, explicit, present, modes)
    used = AXES | FURTHER | CENTER | LENIENT
    if task < 0 and flags & OFFSET_LINE and present & AXES:
        task = FORGET
    elif task < 0:
        task, mark, doubt, used = _motion_task(motion, explicit, present)
        why = max(why, doubt)
    if why == 0 and refused == 0 and RAPID <= task <= NURBS_END:
        why = _doubt(task, used, present, flags, modes)
        if why == 0 and task in (ARC_CW, ARC_CCW):
            refused, word = _arc_fault(values, present, where, modes)
        if why == 0 and refused == 0 and task >= LINE:
            refused, word = _feed_fault(present, where, modes, feed, flags >> KNOWN_SHIFT)
    if why == 0 and refused == 0 and task == REST and zero < 0 and _is_odd(present, flags):
        why = UNUSED_WORD
    if modes[COMPENSATION] > 400.0:
        why, refused = COMPENSATED, 0
    return task, mark, why, refused, word


@compiled
def choose_tasks(words: Any, table: Any, columns: Any, traits: Any, end: int, tasks: Any) -> Any:
    """Decide what each block before `end` does; return the block at which that ends, why it is refused, the word.

    `columns` are those that :func:`resolve <ph_post.gcode.modes.resolve_modes>` fills; breaks and why a
    block is not understood are added to them, `tasks` (n,) is filled.
    """
    blocks, letter, value = words
    states, feeds, motions, zeros, flags, marks, whys = columns
    values, where = np.zeros(26), np.zeros(26, np.int64)
    low = 0
    for block in range(end):
        high = low
        while high < blocks.size and blocks[high] == block:
            high += 1
        first, low = low, high
        if whys[block]:
            tasks[block] = FORGET
        elif high > first or traits[block]:
            present = _spread(letter, value, first, high, values, where)
            parts = (zeros[block], motions[block], np.int64(flags[block]), feeds[block])
            task, mark, why, refused, word = _decide(parts, values, present, where, table[states[block]])
            if refused:
                return block, refused, word
            forget = marks[block] & (FRAME_CHANGE | TOOL_CHANGE)
            tasks[block] = FORGET if why else task | (FORGET_FIRST if forget else 0)
            marks[block] |= mark
            whys[block] = why
    return end, 0, -1
