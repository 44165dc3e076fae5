"""Decide what each block does, and follow positions and motions: two compiled passes.

They work on the modal states that :mod:`ph_post.gcode.modes` resolves.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ph_post.compiling import compiled, lean
from ph_post.gcode import lexer
from ph_post.gcode.codes import (
    ABSOLUTE,
    AIMED,
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
    DELETED,
    DWELL_AXES,
    EXPLICIT,
    FAULT,
    FEED_MODE,
    FOREIGN_CENTER,
    FORGET,
    FORGET_FIRST,
    FORGET_LENGTH,
    FORGET_NAMED,
    FRAME_CHANGE,
    FRAMED,
    FURTHER,
    FURTHER_AXIS,
    FURTHER_LINEAR,
    HOME,
    KNOWN_SHIFT,
    LENGTH_CHANGE,
    LENIENT,
    LENIENT_LINE,
    LETTER_F,
    LETTER_G,
    LETTER_I,
    LETTER_J,
    LETTER_K,
    LETTER_L,
    LETTER_M,
    LETTER_P,
    LETTER_R,
    LETTER_S,
    LETTER_X,
    LETTER_Y,
    LETTER_Z,
    LINE,
    LONE_SPLINE,
    M_GROUP,
    MACHINE,
    MISSING_CENTER,
    MIXED_CENTER,
    MOST_TURNS,
    MOTION,
    NO_CENTER,
    NO_DWELL,
    NO_FEED,
    NO_INVERSE_FEED,
    NO_MOTION_MODE,
    NO_RADIUS_END,
    NONE,
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
    QUIET,
    RAPID,
    REST,
    ROTARY,
    ROTARY_PAIR,
    SKIP,
    SPEED,
    SPLINE_FROM_NOWHERE,
    SPLINE_LETTERS,
    SPLINE_PLANE,
    STAYING_G,
    STAYING_M,
    STAYS,
    SYSTEM,
    TAPPING,
    THREAD,
    THREADING,
    TOOL_CHANGE,
    TURNS,
    UNITS,
    UNKNOWN,
    UNSURE_MODE,
    UNUSED_WORD,
    USER_M,
    ZERO_FEED,
)


@lean
def _spread_values(letter: Any, value: Any, low: int, high: int, values: Any) -> Any:
    """Put a block's values in their letters' places, NaN in the others; whether X and whether Y are there."""
    values[:] = np.nan
    for word in range(low, high):
        values[np.int64(letter[word]) - 65] = value[word]


@lean
def _copy(source: Any, target: Any) -> None:
    for column in range(3):
        target[column] = source[column]


@lean
def _aim(values: Any, modes: Any, position: Any, target: Any) -> None:
    """Find the target [m] to which a block's X, Y and Z lead from a position."""
    for axis in range(3):
        value = values[LETTER_X + axis] * modes[UNITS]
        target[axis] = position[axis]
        if not np.isnan(value):
            target[axis] = value if modes[ABSOLUTE] == 1.0 else position[axis] + value


@lean
def _named(values: Any, modes: Any, position: Any) -> None:
    """Give the places of the named axes the numbers that stand there (G92)."""
    for axis in range(3):
        value = values[LETTER_X + axis]
        if not np.isnan(value):
            position[axis] = value * modes[UNITS]


@lean
def _plane_axes(plane: float) -> Any:
    """First and second axis of a plane."""
    return (0, 1) if plane == 17.0 else (2, 0) if plane == 18.0 else (1, 2)


@lean
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


@lean
def _known(task: int, modes: Any, position: Any, target: Any) -> Any:
    """Return True if the places that a curve needs are known."""
    first, second = _plane_axes(modes[PLANE]) if ARC_CW <= task <= ARC_CCW else (0, 1)
    return not np.isnan(position[first] + position[second] + target[first] + target[second])


@lean
def _kind(task: int) -> Any:
    if task in (ARC_CW, ARC_CCW):
        return 2
    if task in (CUBIC, QUADRATIC):
        return 3
    return 4 if task == NURBS_END else task - RAPID


@lean
def _is_same(one: float, two: float) -> bool:
    return one == two or (np.isnan(one) and np.isnan(two))


@lean
def _write_motion(
    at: Any, values: Any, modes: Any, position: Any, target: Any, word: float, columns: Any, curves: Any, check: bool
) -> bool:
    """Write down one motion from `position` to `target` [m]; `word` is its F, NaN where it is not known.

    To `check` the motion has to begin where the one before it ends: false where it does not.
    """
    block_of, kind, starts, ends, plane, feed, duration, exact = columns
    row, block, task = at
    # Where the plane is not known no arc is read, and for the rest any will do.
    block_of[row], kind[row], plane[row] = block, _kind(task), max(np.int64(modes[PLANE]), 17)
    for axis in range(3):
        if check and row > 0 and not _is_same(ends[row - 1, axis], position[axis]):
            return False
        starts[row, axis], ends[row, axis] = position[axis], target[axis]
    if ARC_CW <= task <= ARC_CCW:
        _write_arc(values, modes, position, row, task, curves)
    feed[row] = 0.0
    if modes[MOTION] == THREADING:
        turns = modes[SPEED] / 60.0 if modes[SPEED] > 0.0 else np.nan
        feed[row] = values[LETTER_K] * modes[UNITS] * turns
    elif task != RAPID and modes[FEED_MODE] == 93.0:
        feed[row], duration[row] = np.nan, 0.0 if np.isnan(word) else 60.0 / word
    elif task != RAPID:
        feed[row] = word * modes[UNITS] / 60.0 if modes[FEED_MODE] == 94.0 else np.nan
    if modes[PATH] == 610.0 or modes[PATH] == 611.0:
        exact[row] = 1
    return True


@lean
def _close(axis: int, block: int, since: Any, moved: Any, anchors: Any) -> None:
    """Let an axis be forgotten in a block, or found (-1): what it moved until then needs directions alone."""
    if since[axis] >= 0 and moved[axis]:
        anchors[since[axis]] |= 1 << axis
    since[axis], moved[axis] = block, False


@lean
def _use(values: Any, modes: Any, task: int, axis: int, since: Any, moved: Any) -> None:
    """Note how a motion uses an axis whose place is not known: by its increments, or by a place."""
    first, second = _plane_axes(modes[PLANE]) if ARC_CW <= task <= ARC_CCW else (0, 1)
    curved = task >= ARC_CW and axis in (first, second)
    named = not np.isnan(values[LETTER_X + axis])
    placed = named and modes[ABSOLUTE] == 1.0
    if placed or (curved and (modes[ARC_ABSOLUTE] == 1.0 or task > QUADRATIC)):
        since[axis] = -1
    elif curved or named:
        moved[axis] = True


@compiled
def find_anchors(words: Any, modal: Any, end: int, anchors: Any) -> None:
    """Find the axes that move by increments alone from where they are forgotten to where they are found or lost again.

    `words` and `modal` as in :func:`trace_motions`. `anchors` (n + 1,) gets a bit an axis at the beginning, and
    behind each block that forgets it: any place is as good as another there.
    """
    blocks, letter, value = words
    table, states, _, tasks, _ = modal
    values, since, moved = np.empty(26), np.zeros(3, np.int64), np.zeros(3, np.bool_)
    low = 0
    for block in range(end):
        high = low
        while high < blocks.size and blocks[high] == block:
            high += 1
        first, low = low, high
        task, modes = tasks[block] & (FORGET_FIRST - 1), table[states[block]]
        if tasks[block] == 0:
            continue
        _spread_values(letter, value, first, high, values)
        for axis in range(3):
            named = not np.isnan(values[LETTER_X + axis])
            if tasks[block] & FORGET_FIRST or (axis == 2 and tasks[block] & FORGET_LENGTH):
                _close(axis, block + 1, since, moved, anchors)
            if task == FORGET or (task == FORGET_NAMED and named):
                _close(axis, block + 1, since, moved, anchors)
            elif task == PRESET and named:
                _close(axis, -1, since, moved, anchors)
            elif (REST < task < FORGET or task == AIMED) and since[axis] >= 0:
                _use(values, modes, RAPID if task == AIMED else task, axis, since, moved)
    for axis in range(3):
        _close(axis, -1, since, moved, anchors)


@lean
def _lose(axis: int, anchor: Any, position: Any) -> None:
    """Forget the place of an axis; one that moves by increments alone goes on from any."""
    if not (anchor >> axis) & 1:
        position[axis] = np.nan
    elif np.isnan(position[axis]):
        position[axis] = 0.0


@lean
def _lose_ahead(flags: int, anchor: Any, position: Any) -> None:
    """Forget the places that a block forgets before what else it does."""
    for axis in range(3):
        if flags & FORGET_FIRST or (axis == 2 and flags & FORGET_LENGTH):
            _lose(axis, anchor, position)


@lean
def _displace(task: int, values: Any, modes: Any, anchor: Any, position: Any) -> None:
    """Forget the places that a block forgets, or rename them as it says."""
    if task in (FORGET, FORGET_NAMED):
        for axis in range(3):
            if task == FORGET or not np.isnan(values[LETTER_X + axis]):
                _lose(axis, anchor, position)
    elif task == PRESET:
        _named(values, modes, position)


@lean
def _lose_curve(task: int, values: Any, modes: Any, position: Any) -> Any:
    """Forget the places behind a curve from an unknown one but those that it names; return why it is not understood."""
    position[:] = np.nan
    if modes[ABSOLUTE] == 1.0 and task != NURBS_END:
        _named(values, modes, position)
    return ARC_FROM_NOWHERE if task <= ARC_CCW else SPLINE_FROM_NOWHERE


@compiled
def trace_motions(  # noqa: C901, PLR0912
    words: Any, modal: Any, end: int, anchors: Any, columns: Any, curves: Any, shared: bool
) -> Any:
    """Follow the position through all blocks before `end`, write down the motions and return their number.

    `words` are the columns block, letter and value; `modal` the distinct states, for each block its state, the F of
    runs of blocks and where each begins, nothing where each block has its own, and for each block its task and why it
    is not understood, to which arcs and splines from unknown places are added;
    `anchors` those of :func:`find_anchors`.
    `columns` to fill: block, kind, start, end, plane, feed, duration, exact; `curves`: centre, angle and
    turns as the words have them. Durations, curves and exact stops are zeros, and stay so where nothing is written:
    memory that nothing is written to takes no room. Where starts have room `shared` with the ends of the motions
    before them, -1 is returned if one begins elsewhere.
    """
    blocks, letter, value = words
    table, states, (feeds, begins), tasks, whys = modal
    values, position, target, pen = np.empty(26), np.full(3, np.nan), np.empty(3), np.full(3, np.nan)
    low, row, run, drawing = 0, 0, 0, False
    for axis in range(3):
        _lose(axis, anchors[0], position)
    for block in range(end):
        high = low
        while high < blocks.size and blocks[high] == block:
            high += 1
        first, low = low, high
        if tasks[block] == 0:
            continue
        _lose_ahead(tasks[block], anchors[block + 1], position)
        task, modes = tasks[block] & (FORGET_FIRST - 1), table[states[block]]
        if task == 0:
            continue
        _spread_values(letter, value, first, high, values)
        if FORGET <= task < AIMED:
            _displace(task, values, modes, anchors[block + 1], position)
            drawing = False
            continue
        _aim(values, modes, position, target)
        if task == AIMED:
            _copy(target, position)
            drawing = False
            continue
        if task == NURBS_POINT:
            _copy(target if not np.isnan(values[LETTER_X]) else pen if drawing else position, pen)
            drawing = True
            continue
        if task == NURBS_END:
            _copy(pen, target)
        drawing = False
        if task > LINE and not _known(task, modes, position, target):
            whys[block] = _lose_curve(task, values, modes, position)
            continue
        write_at = (row, block, task)
        while run + 1 < begins.size and begins[run + 1] <= block:
            run += 1
        word = feeds[run if begins.size else block]
        if word == 0.0 or (modes[FEED_MODE] == 93.0 and np.isnan(values[LETTER_F])):
            word = np.nan
        if not _write_motion(write_at, values, modes, position, target, word, columns, curves, shared):
            return -1
        _copy(target, position)
        row += 1
    return row


@lean
def _spread(letter: Any, value: Any, low: int, high: int, values: Any, where: Any) -> Any:
    """Put a block's words in their letters' places, and return the letters present, a bit each."""
    present = np.int64(0)
    for word in range(low, high):
        index = np.int64(letter[word]) - 65
        present |= 1 << index
        values[index], where[index] = value[word], word
    return present


@lean
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


@lean
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


@lean
def _set_data(values: Any, present: int, modes: Any) -> Any:
    """Return what a G10 does to the position, by its L."""
    axes = present & (AXES | FURTHER)
    kind = values[LETTER_L] if (present >> LETTER_L) & 1 else 0.0
    if kind == 1.0 or 10.0 <= kind <= 13.0:
        return FORGET_LENGTH  # the tool table: of use from the next G43 on, or at once
    turned = (present >> LETTER_R) & 1 and values[LETTER_R] != 0.0
    if kind not in (2.0, 20.0) or turned or not axes or present & FURTHER_LINEAR:
        return FORGET
    number = values[LETTER_P] if (present >> LETTER_P) & 1 else 0.0
    active = modes[SYSTEM]
    own = 0.0 if active < 0.0 else (active - 530.0) / 10.0 if active <= 590.0 else active - 584.0
    if 1.0 <= number <= 9.0 and own > 0.0 and number != own:
        return REST
    known = kind == 20.0 and number in (0.0, own) and modes[ABSOLUTE] == 1.0
    return PRESET if known and modes[UNITS] != UNKNOWN else FORGET_NAMED


@lean
def _zero_group(code: int, motion: int, explicit: int, present: int, modes: Any, values: Any) -> Any:
    """Return what a word of group 0 does: task (-1: the motion's), break, why not understood, refused.

    To the task `FORGET_LENGTH` may be added. Axes that are not named stay where they are.
    """
    axes = present & (AXES | FURTHER)
    # U, V and W may be increments of X, Y and Z.
    named = FORGET_NAMED if axes and not present & FURTHER_LINEAR else FORGET
    task, mark, why, refused = -1, 0, 0, 0
    if code == 40:
        timed = (present >> LETTER_P) & 1 or ((present >> LETTER_S) & 1 and not explicit)
        apart = axes and not (timed and explicit)
        why, refused = DWELL_AXES if apart else 0, 0 if timed or apart else NO_DWELL
        task = -1 if axes and explicit else REST
    elif code == 100:
        task, mark = _set_data(values, present, modes), FRAME_CHANGE
    elif code == 520:
        task, mark = named, FRAME_CHANGE
    elif code in (280, 300):
        task, mark = named, HOME
    elif code in (281, 301):
        task, mark = REST, HOME
    elif code == SKIP:
        task, mark = named, PROBE
    elif code == 920:
        known = modes[UNITS] != UNKNOWN and named == FORGET_NAMED
        task, mark = PRESET if known else named, FRAME_CHANGE
        if not axes and (present >> LETTER_S) & 1:
            task, mark = REST, 0  # the spindle's highest speed
    elif code == 53:
        task, why = NURBS_END, 0 if motion == 52 else LONE_SPLINE
    elif code == 530:
        task, mark = (named, MACHINE) if axes else (REST, 0)
    return task, mark, why, refused


@lean
def _motion_task(code: int, explicit: int, present: int, further: int, threads: bool) -> Any:
    """Return what the motion mode makes of a block: task, break, why not understood, letters it uses.

    While axes of their own (`further`) move alone, X, Y and Z rest. With `threads` they are lines.
    """
    axes = present & (AXES | FURTHER)
    arcs = code in (20, 30)
    task, mark, why, used = FORGET, 0, 0, AXES | further
    if (not explicit and not axes and not (arcs and present & CENTER)) or (code == 800 and not axes):
        task = REST
    elif arcs:
        task, used = ARC_CW if code == 20 else ARC_CCW, used | CENTER | (1 << LETTER_P) | (1 << LETTER_R)
    elif code == THREADING and threads and (present >> LETTER_K) & 1 and not axes & further:
        task, used = LINE, AXES | 1 << LETTER_K
    elif code in (0, 10):
        task = REST if not axes & ~further else RAPID if code == 0 else LINE
    elif code in (50, 51):
        task, used = CUBIC if code == 50 else QUADRATIC, SPLINE_LETTERS
    elif code == 52:
        task, used = NURBS_POINT, NURBS_LETTERS
    elif 382 <= code <= 385:
        task, mark = FORGET_NAMED, PROBE
    elif code in (-1, 800):
        why = NO_MOTION_MODE
    elif code == -2:
        why = UNSURE_MODE
    else:
        why = THREAD if code in (THREADING, TAPPING) else CYCLE
    return task, mark, why, used


@lean
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
    elif task >= LINE and present & ROTARY & (present & ROTARY) - 1:
        why = ROTARY_PAIR
    elif rest:
        why = UNUSED_WORD
    elif unsure or (task >= LINE and modes[FEED_MODE] == UNKNOWN):
        why = UNSURE_MODE
    elif task >= CUBIC and modes[PLANE] != 17.0:
        why = SPLINE_PLANE
    return why


@lean
def _is_odd(present: int, flags: int) -> Any:
    """Return True if a block without a motion has letters that none of its words uses."""
    rest = present & ~ALWAYS
    if flags & LENIENT_LINE or (present >> LETTER_M) & 1:
        rest &= ~LENIENT
    return rest != 0


@lean
def _is_aimed(task: int, why: int, present: int, flags: int, modes: Any) -> Any:
    """Return True if the end of a motion is known that is passed through for a rotary axis."""
    known = modes[UNITS] != UNKNOWN and modes[ABSOLUTE] != UNKNOWN and not flags & FRAMED
    rotary = why in (FURTHER_AXIS, ROTARY_PAIR) and not present & FURTHER_LINEAR
    return rotary and RAPID <= task <= ARC_CCW and known


@lean
def _has_sides(letter: Any, value: Any) -> Any:
    """Return True if a program brings the cutter to a side of its contour anywhere, or may by a computed G word."""
    for word in range(letter.size):
        if letter[word] == 71 and (41.0 <= value[word] < 43.0 or np.isnan(value[word])):
            return True
    return False


@lean
def _decide(block: Any, values: Any, present: int, where: Any, modes: Any, reading: Any) -> Any:
    """Return what a block does: task, break, why not understood, its fault, the word.

    `reading` says whether contours beside which a cutter is move as they say, whether threads do, and whether the
    program has such contours.
    """
    contours, threads, sided = reading
    zero, motion, flags, feed, further = block
    explicit, word = flags & EXPLICIT, -1
    task, mark, why, refused = _zero_group(zero, motion, explicit, present, modes, values)
    used = AXES | FURTHER | CENTER | LENIENT
    if task < 0 and flags & OFFSET_LINE and present & AXES:
        task = FORGET_NAMED
    elif task < 0:
        task, mark, doubt, used = _motion_task(motion, explicit, present, further, threads)
        why = max(why, doubt)
    if why == 0 and refused == 0 and RAPID <= task <= NURBS_END:
        why = _doubt(task, used, present, flags, modes)
        if why == 0 and task in (ARC_CW, ARC_CCW):
            refused, word = _arc_fault(values, present, where, modes)
        if why == 0 and refused == 0 and task >= LINE and motion != THREADING:
            refused, word = _feed_fault(present, where, modes, feed, flags >> KNOWN_SHIFT)
        if _is_aimed(task, why, present, flags, modes):
            task = AIMED
    if why == 0 and refused == 0 and task == REST and zero < 0:
        if present & further and flags & FRAMED:
            why = OTHER_FRAME  # a rotary axis may be one of the plane's
        elif _is_odd(present & ~further, flags):
            why = UNUSED_WORD
    if modes[COMPENSATION] > 400.0 and not contours:
        task, why, refused = FORGET, COMPENSATED, 0
    elif sided and modes[COMPENSATION] == UNKNOWN and (RAPID <= task <= NURBS_END or task == AIMED):
        task, why, refused = FORGET, UNSURE_MODE, 0
    return task, mark, why, refused, word


@lean
def _switched_task(words: Any, low: int, high: int, modes: Any) -> Any:  # noqa: PLR0911
    """Return what a line does that runs or not, by a switch: it leaves axes that it does not name where they were.

    `modes` are those behind it, whether it runs or not. Words that move the frame, call or change the tool may leave
    any axis elsewhere, and so may those that nobody knows.
    """
    letter, value, effects = words
    if modes[COMPENSATION] not in (NONE, 400.0):
        return FORGET
    present, moves, home = np.int64(0), False, False
    for word in range(low, high):
        index = np.int64(letter[word]) - 65
        present |= 1 << index
        if index not in (LETTER_G, LETTER_M):
            continue
        code = 10.0 * value[word] if index == LETTER_G else value[word]
        if index == LETTER_M and not 0.0 <= code < 1000.0:
            return FORGET
        if index == LETTER_M:
            number = np.int64(code)
            group = M_GROUP[number] if number < M_GROUP.size else -1
            rests = group in (7, 8, 9) or (group == 4 and number != 60) or effects[number] == STAYS
            if number != code or not rests:
                return FORGET
        elif code in (0.0, 10.0, 20.0, 30.0):
            moves = True
        elif code in (280.0, 300.0):
            home = True
        elif code not in (40.0, 170.0, 180.0, 190.0, 800.0, 900.0, 910.0, 940.0, 950.0, 980.0, 990.0):
            return FORGET
    if present & FURTHER_LINEAR:
        return FORGET  # they may be increments of X, Y and Z
    if not present & AXES:
        return FORGET if home else REST
    return FORGET_NAMED if moves or home or modes[MOTION] in (0.0, 10.0, 20.0, 30.0) else FORGET


@lean
def _standing(present: int, values: Any, modes: Any, turned: Any) -> Any:
    """Return the letters, a bit each, of rotary axes that a block names and that are there already (`turned`, ABC)."""
    found = np.int64(0)
    for axis in range(3):
        named = (present >> axis) & 1 and modes[ABSOLUTE] == 1.0
        if named and values[axis] == turned[axis]:
            found |= 1 << axis
    return found


@lean
def _turn(present: int, values: Any, modes: Any, turned: Any) -> None:
    """Note where the rotary axes (ABC) are that a block names; NaN where it turns them by a step."""
    for axis in range(3):
        if (present >> axis) & 1:
            turned[axis] = values[axis] if modes[ABSOLUTE] == 1.0 else np.nan


@compiled
def choose_tasks(  # noqa: C901, PLR0912
    words: Any, table: Any, columns: Any, traits: Any, end: int, further: int, asked: Any, tasks: Any
) -> Any:
    """Decide what each block before `end` does.

    `words` are the columns block, letter and value, and the effects of M words; `columns` those that
    :func:`resolve <ph_post.gcode.modes.resolve_modes>` fills; breaks, why a block is not
    understood and the words with faults are added to them, `tasks` (n,) is filled. `further` are the letters of axes
    of their own beside X, Y and Z, a bit each. `asked` are whether what is cut with cutter compensation moves as the
    program says, whether what is tied to the spindle does, and whether the program has such compensation beside what
    its words say: then nothing is known where nobody knows whether it is on. A lack of feed is said at the first cut
    that has none. Words of rotary axes that stand there already count as not there.
    """
    blocks, letter, value, effects = words
    states, feeds, motions, zeros, flags, marks, whys, spots = columns
    values, where = np.zeros(26), np.zeros(26, np.int64)
    low, lack = 0, 0
    turned = np.full(3, np.nan)
    reading = (asked[0], asked[1], asked[2] or _has_sides(letter, value))
    for block in range(end):
        high = low
        while high < blocks.size and blocks[high] == block:
            high += 1
        first, low = low, high
        stays = whys[block] in (STAYING_G, STAYING_M, USER_M)
        if whys[block] == DELETED and traits[block] == lexer.DELETE and not flags[block] & FRAMED:
            tasks[block] = _switched_task((letter, value, effects), first, high, table[states[block]])
            turned[:] = np.nan
        elif 0 < whys[block] < QUIET and not stays:
            tasks[block], turned[:] = FORGET, np.nan
        elif high > first or traits[block]:
            present = _spread(letter, value, first, high, values, where)
            if zeros[block] < 0:
                present &= ~_standing(present, values, table[states[block]], turned)
            more = LENIENT_LINE if stays else 0
            parts = (zeros[block], motions[block], np.int64(flags[block]) | more, feeds[block], further)
            modes = table[states[block]]
            task, mark, why, fault, word = _decide(parts, values, present, where, modes, reading)
            if fault in (NO_FEED, ZERO_FEED, NO_INVERSE_FEED):
                if fault != lack and whys[block] == 0:
                    whys[block], spots[block] = QUIET + fault, -2 - word
                fault, lack = 0, fault
            elif LINE <= task <= CUBIC:
                lack = 0
            if stays and RAPID <= task <= ARC_CCW:
                task = AIMED
            elif stays and CUBIC <= task <= NURBS_END:
                task = FORGET
            first_of_all = 0
            if marks[block] & TOOL_CHANGE or marks[block] & (FRAME_CHANGE | LENGTH_CHANGE) == FRAME_CHANGE:
                first_of_all = FORGET_FIRST
            elif marks[block] & LENGTH_CHANGE:
                first_of_all = FORGET_LENGTH if modes[PLANE] == 17.0 else FORGET_FIRST
            marks[block] |= mark
            if fault or stays or marks[block] or zeros[block] >= 0 or why not in (0, ROTARY_PAIR):
                turned[:] = np.nan
            else:
                _turn(present, values, modes, turned)
            if fault:
                tasks[block], whys[block], spots[block] = FORGET, FAULT + fault, -2 - word
            else:
                tasks[block] = FORGET if why and task != AIMED else task | first_of_all
                whys[block] = why if why else whys[block]
