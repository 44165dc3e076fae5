"""What each block does: a motion, an arc, a change of the frame, nothing; and what is refused there.

One compiled pass over what :mod:`ph_post.gcode.reader.modes` found. It knows no positions: those are made by
:mod:`ph_post.gcode.reader.moves`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ph_post.gcode.reader.codes import (
    ABSOLUTE,
    ALWAYS,
    ARC_ABSOLUTE,
    ARC_CCW,
    ARC_CW,
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
    PLANE,
    PRESET,
    PROBE,
    QUADRATIC,
    RAPID,
    REST,
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
from ph_post.simulate.compiling import compiled, inner


@inner
def _spread(letter: Any, value: Any, low: int, high: int, values: Any, where: Any) -> Any:
    """Put a block's words in their letters' places: the letters present, a bit each."""
    present = np.int64(0)
    for word in range(low, high):
        index = np.int64(letter[word]) - 65
        present |= 1 << index
        values[index], where[index] = value[word], word
    return present


@inner
def _arc_fault(values: Any, present: int, where: Any, modes: Any) -> Any:  # noqa: PLR0911
    """Why the centre of an arc is refused, and the word; 0 where it is told once and whole."""
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
    """Why the feed of a cut is refused, and the word, 0 where it is known or may be."""
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
    """Tell what a word of group 0 does: task (-1: the motion's), break, why not understood, refused."""
    axes = present & (AXES | FURTHER)
    task, mark, why, refused = -1, 0, 0, 0
    if code == 40:
        told = (present >> LETTER_P) & 1 or ((present >> LETTER_S) & 1 and not explicit)
        apart = axes and not (told and explicit)
        why, refused = DWELL_AXES if apart else 0, 0 if told or apart else NO_DWELL
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
    """Tell what the motion mode makes of a block: task, break, why not understood, letters it uses."""
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
    """Why a motion is not understood, 0 where it is."""
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
    """Whether a block without a motion has letters that none of its words uses."""
    rest = present & ~ALWAYS
    if flags & LENIENT_LINE or (present >> LETTER_M) & 1:
        rest &= ~LENIENT
    return rest != 0


@inner
def _decide(block: Any, values: Any, present: int, where: Any, modes: Any) -> Any:
    """Tell what a block does: task, break, why not understood, why refused, the word."""
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
def choose(words: Any, table: Any, columns: Any, traits: Any, end: int, tasks: Any) -> Any:
    """Decide what each block before `end` does: the block at which that ends, why it is refused, the word.

    `columns` are those that :func:`resolve <ph_post.gcode.reader.modes.resolve>` fills; breaks and why a
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
