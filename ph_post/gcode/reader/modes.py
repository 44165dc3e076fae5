"""The modal state of a program, block by block: which groups a line's words set, and what it asks to be done.

One compiled pass over the words. It knows no positions: those are made by
:mod:`ph_post.gcode.reader.moves` from what is found here.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ph_post.gcode.reader import lexer
from ph_post.gcode.reader.codes import (
    ABSOLUTE,
    ALWAYS,
    ARC_ABSOLUTE,
    ARC_CCW,
    ARC_CW,
    AXES,
    CENTER,
    COMMA,
    COMPENSATED,
    COMPENSATION,
    CONTROLLER_LINE,
    CUBIC,
    CYCLE,
    DELETED,
    DWELL_AXES,
    END,
    EXPRESSION,
    FEED,
    FEED_KNOWN,
    FEED_MODE,
    FIELD,
    FLOOD,
    FOREIGN_CENTER,
    FORGET,
    FORGET_FIRST,
    FORGET_NAMED,
    FRAME,
    FRAME_CHANGE,
    FRAME_ON,
    FURTHER,
    FURTHER_AXIS,
    GROUP,
    HOME,
    LENIENT,
    LETTER_F,
    LETTER_G,
    LETTER_I,
    LETTER_J,
    LETTER_K,
    LETTER_L,
    LETTER_M,
    LETTER_O,
    LETTER_P,
    LETTER_Q,
    LETTER_R,
    LETTER_S,
    LETTER_T,
    LETTER_X,
    LETTER_Y,
    LETTER_Z,
    LINE,
    M_GROUP,
    MACHINE,
    MISSING_CENTER,
    MIST,
    MIXED_CENTER,
    MODES,
    MOTION,
    NEGATIVE_FEED,
    NO_CENTER,
    NO_DWELL,
    NO_FEED,
    NO_INVERSE_FEED,
    NO_MOTION_MODE,
    NO_RADIUS_END,
    NONE,
    NURBS_END,
    NURBS_POINT,
    O_WORD,
    OTHER_FRAME,
    PARAMETER,
    PATH_P,
    PATH_Q,
    PLANE,
    POLAR,
    PREPARED,
    PRESET,
    PROBE,
    QUADRATIC,
    RAPID,
    REST,
    SAVED_STATE,
    SPEED,
    SPINDLE,
    SPLINE_PLANE,
    STATE,
    SUBPROGRAM,
    SYSTEM,
    THREAD,
    TOOL,
    TOOL_CHANGE,
    TURNS,
    TWICE,
    TWO_OF_GROUP,
    UNITS,
    UNITS_SAID,
    UNKNOWN,
    UNKNOWN_G,
    UNKNOWN_M,
    UNSURE_MODE,
    UNUSED_WORD,
    ZERO_FEED,
)
from ph_post.simulate.compiling import compiled, inner


@inner
def _gather(letter: Any, value: Any, low: int, high: int, values: Any, where: Any, codes: Any) -> Any:
    """Collect the words of a block: letters present, number of G and M words, word that stands there twice.

    `codes` (2, 64): words of G and of M; a letter whose value is no plain number is -1 of `present`.
    """
    present, g, m, computed, twice = np.int64(0), 0, 0, np.int64(0), -1
    for word in range(low, high):
        index = np.int64(letter[word]) - 65
        if index in (LETTER_G, LETTER_M):
            row = 0 if index == LETTER_G else 1
            count = g if index == LETTER_G else m
            if count < 64:
                codes[row, count] = word
            g += index == LETTER_G
            m += index == LETTER_M
        elif (present >> index) & 1 and twice < 0:
            twice = word
        present |= 1 << index
        if np.isnan(value[word]) and index != LETTER_O:
            computed |= 1 << index
        values[index], where[index] = value[word], word
    return present, min(g, 64), min(m, 64), computed, twice


@inner
def _code_of(value: float) -> Any:
    """Ten times a G word's number, 999 (which no controller has) where it has more decimals."""
    tenfold = 10.0 * value
    code = np.int64(np.rint(tenfold)) if 0.0 <= tenfold < 999.0 else 999
    return code if abs(tenfold - code) < 1e-6 else 999


@inner
def _apply_g(value: Any, codes: Any, count: int, state: Any, given: Any) -> Any:
    """Set the groups of a block's G words (`given` by group): why not understood, refused, word."""
    why = 0
    for k in range(count):
        code = _code_of(value[codes[0, k]])
        group = GROUP[code]
        if group < 0:
            why = UNKNOWN_G
            continue
        if given[group] >= 0:
            return why, TWO_OF_GROUP, codes[0, k]
        given[group] = code
        column = FIELD[group]
        if column == FRAME:
            on = (code == FRAME_ON).any()
            if on or code != 500:
                state[FRAME] = 1.0 if on else 0.0
        elif column >= 0:
            state[column] = _setting(group, code)
    return why, 0, -1


@inner
def _setting(group: int, code: int) -> Any:
    """Content of a group's column for a G word."""
    if group == 6:
        return 0.0254 if code == 200 else 1e-3
    if group in (3, 4):
        return 1.0 if code < 910 else 0.0
    if group == 2:
        return code / 10.0 if code % 10 == 0 else UNKNOWN
    return code / 10.0 if group == 5 else np.float64(code)


@inner
def _apply_m(value: Any, codes: Any, count: int, values: Any, present: int, state: Any) -> Any:
    """Set the groups of a block's M words: why not understood, breaks, why refused, word."""
    why, mark, seen, coolant = 0, 0, 0, 0
    for k in range(count):
        word = codes[1, k]
        code = np.int64(value[word]) if 0.0 <= value[word] < 1000.0 else 999
        if code != value[word]:
            code = 999
        group = M_GROUP[code] if code < 100 else -1
        both = (code == 7 and coolant == 8) or (code == 8 and coolant == 7)
        if group >= 0 and (seen >> group) & 1 and not both:
            return why, mark, TWO_OF_GROUP, word
        if group < 0:
            why = SUBPROGRAM if code in (98, 99) else SAVED_STATE if code in (72, 73) else UNKNOWN_M
            continue
        seen |= 1 << group
        coolant = int(code) if group == 8 else coolant
        mark |= _set_m(int(code), values, present, state)
    return why, mark, 0, -1


@inner
def _set_m(code: int, values: Any, present: int, state: Any) -> Any:
    """Carry out one M word on the state: the break it is."""
    if code in (2, 30):
        return END
    if 3 <= code <= 5:
        state[SPINDLE] = code
    elif code == 7:
        state[MIST] = 1.0
    elif code == 8:
        state[FLOOD] = 1.0
    elif code == 9:
        state[MIST] = state[FLOOD] = 0.0
    elif code == 6:
        state[TOOL] = state[PREPARED]
        return TOOL_CHANGE
    elif code == 61:
        state[TOOL] = values[LETTER_Q] if (present >> LETTER_Q) & 1 else UNKNOWN
        return TOOL_CHANGE
    elif code == 60:
        return TOOL_CHANGE
    return 0


@inner
def _apply_numbers(values: Any, present: int, given: Any, was: float, mode_was: float, state: Any) -> Any:
    """Set F, S, T and the path mode; `was` and `mode_was` are units and feed mode before the block."""
    if state[FEED_MODE] != mode_was:
        state[FEED], state[FEED_KNOWN] = np.nan, 0.0 if mode_was != UNKNOWN else 2.0
    if state[UNITS] != was:
        state[FEED] *= was / state[UNITS] if was > 0.0 else np.nan
    said = state[UNITS_SAID]
    if given[6] >= 0:
        state[UNITS_SAID] = 1.0
    if (present >> LETTER_F) & 1:
        # F beside a change of units: before it for one controller, after it for another
        unsure = given[6] >= 0 and said == 1.0 and state[UNITS] != was
        state[FEED], state[FEED_KNOWN] = (np.nan, 2.0) if unsure else (values[LETTER_F], 1.0)
    if (present >> LETTER_S) & 1:
        state[SPEED] = values[LETTER_S]
    if (present >> LETTER_T) & 1:
        state[PREPARED] = values[LETTER_T]
    if given[13] >= 0:
        state[PATH_P] = values[LETTER_P] if given[13] == 640 and (present >> LETTER_P) & 1 else NONE
        state[PATH_Q] = values[LETTER_Q] if given[13] == 640 and (present >> LETTER_Q) & 1 else NONE


@inner
def _arc_fault(values: Any, present: int, where: Any, state: Any) -> Any:  # noqa: PLR0911
    """Why the centre of an arc is refused, and the word; 0 where it is told once and whole."""
    plane = state[PLANE]
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
    if not radius and state[ARC_ABSOLUTE] == 1.0 and inside != (CENTER & ~(1 << third)):
        return MISSING_CENTER, -1
    if (present >> LETTER_P) & 1 and (
        values[LETTER_P] < 1.0 or values[LETTER_P] != np.floor(values[LETTER_P])
    ):
        return TURNS, where[LETTER_P]
    return 0, -1


@inner
def _feed_fault(task: int, present: int, where: Any, state: Any) -> Any:
    """Why the feed of a cut is refused, and the word, 0 where it is known or may be."""
    if task < LINE or task > NURBS_END:
        return 0, -1
    word = where[LETTER_F] if (present >> LETTER_F) & 1 else -1
    if state[FEED_MODE] == 93.0 and not (present >> LETTER_F) & 1:
        return NO_INVERSE_FEED, -1
    if state[FEED_KNOWN] == 0.0:
        return NO_FEED, -1
    if state[FEED] == 0.0:
        return ZERO_FEED, word
    return 0, -1


@inner
def _zero_group(code: int, present: int, state: Any) -> Any:  # noqa: PLR0911
    """Tell what a word of group 0 does: task (-1: the motion's), break, why not understood, refused."""
    axes = present & (AXES | FURTHER)
    if code == 40:
        told = (present >> LETTER_P) & 1 or (present >> LETTER_S) & 1
        return REST, 0, DWELL_AXES if axes else 0, 0 if told or axes else NO_DWELL
    if code in (100, 520):
        return FORGET, FRAME_CHANGE, 0, 0
    if code in (280, 300):
        return FORGET, HOME, 0, 0
    if code in (281, 301):
        return REST, HOME, 0, 0
    if code == 920:
        return PRESET, FRAME_CHANGE, 0, 0
    if code == 53:
        ends = state[MOTION] == 52.0
        state[MOTION] = NONE
        return NURBS_END if ends else REST, 0, 0 if ends else UNKNOWN_G, 0
    if code == 530:
        named = state[ABSOLUTE] == 1.0 and not axes & FURTHER
        return (FORGET_NAMED if named else FORGET) if axes else REST, MACHINE if axes else 0, 0, 0
    return -1, 0, 0, 0


@inner
def _motion_task(explicit: bool, present: int, state: Any) -> Any:  # noqa: PLR0911
    """Tell what the motion mode makes of a block: task, break, why not understood, letters it uses."""
    axes = present & (AXES | FURTHER)
    code = state[MOTION]
    arcs = code in (20.0, 30.0)
    if not explicit and not axes and not (arcs and present & CENTER):
        return REST, 0, 0, 0
    if arcs:
        return ARC_CW if code == 20.0 else ARC_CCW, 0, 0, AXES | CENTER | (1 << LETTER_P) | (1 << LETTER_R)
    if code in (0.0, 10.0):
        return (RAPID if code == 0.0 else LINE) if axes else REST, 0, 0, AXES
    if code in (50.0, 51.0):
        state[MOTION] = UNKNOWN  # one controller stays in it, another goes back to the mode before
        used = (
            (1 << LETTER_X)
            | (1 << LETTER_Y)
            | (1 << LETTER_I)
            | (1 << LETTER_J)
            | (1 << LETTER_P)
            | (1 << LETTER_Q)
        )
        return CUBIC if code == 50.0 else QUADRATIC, 0, 0, used
    if code == 52.0:
        return NURBS_POINT, 0, 0, (1 << LETTER_X) | (1 << LETTER_Y) | (1 << LETTER_P) | (1 << LETTER_L)
    if 382.0 <= code <= 385.0:
        return FORGET, PROBE, 0, AXES | FURTHER
    if code == 800.0 and not axes:
        return REST, 0, 0, 0
    if code in (NONE, 800.0):
        return FORGET, 0, NO_MOTION_MODE, 0
    if code == UNKNOWN:
        return FORGET, 0, UNSURE_MODE, 0
    return FORGET, 0, THREAD if code in (330.0, 331.0) else CYCLE, 0


@inner
def _check_motion(task: int, used: int, values: Any, present: int, where: Any, given: Any, state: Any) -> Any:
    """Why a motion is not understood, why it is refused, and the word."""
    if state[FRAME] != 0.0:
        return OTHER_FRAME, 0, -1
    rest = present & ~(used | ALWAYS)
    if given[0] == 40 or given[7] >= 0 or given[8] >= 0 or given[13] == 640 or given[14] >= 0:
        rest &= ~LENIENT
    if rest & FURTHER:
        return FURTHER_AXIS, 0, -1
    if rest:
        return UNUSED_WORD, 0, -1
    unsure = state[UNITS] == UNKNOWN or state[ABSOLUTE] == UNKNOWN
    if task >= ARC_CW:
        unsure = unsure or state[PLANE] == UNKNOWN or state[ARC_ABSOLUTE] == UNKNOWN
    if unsure or (task >= LINE and state[FEED_MODE] == UNKNOWN):
        return UNSURE_MODE, 0, -1
    if task >= CUBIC and state[PLANE] != 17.0:
        return SPLINE_PLANE, 0, -1
    refused, word = 0, -1
    if task in (ARC_CW, ARC_CCW):
        refused, word = _arc_fault(values, present, where, state)
    if refused == 0:
        refused, word = _feed_fault(task, present, where, state)
    return 0, refused, word


@inner
def _decide(values: Any, present: int, where: Any, given: Any, mark: int, before: Any, state: Any) -> Any:
    """Tell what a block does: task, break, why not understood, why refused, the word."""
    if given[16] >= 0 or given[8] >= 0 or (given[12] >= 0 and state[SYSTEM] != before[SYSTEM]):
        mark |= FRAME_CHANGE
    first = FORGET_FIRST if mark & (FRAME_CHANGE | TOOL_CHANGE) else 0
    task, found, why, refused = _zero_group(given[0], present, state)
    used = LENIENT | AXES | FURTHER | CENTER
    if task < 0 and (given[8] == 431 or given[8] == 432):
        task = FORGET
    if task < 0:
        task, found, why, used = _motion_task(given[1] >= 0, present, state)
    word = -1
    if why == 0 and refused == 0 and RAPID <= task <= NURBS_END:
        why, refused, word = _check_motion(task, used, values, present, where, given, state)
    if state[COMPENSATION] > 400.0:
        why, refused = COMPENSATED, 0
    return task + first, mark | found, why, refused, word


@inner
def _forget_modes(state: Any, before: Any, all_of_them: bool) -> None:
    """Make unknown what differs from `before`, or all."""
    for column in range(MODES):
        if all_of_them or state[column] != before[column]:
            state[column] = UNKNOWN
    if (
        all_of_them
        or not (state[FEED] == before[FEED] or np.isnan(before[FEED]))
        or state[FEED_KNOWN] != before[FEED_KNOWN]
    ):
        state[FEED], state[FEED_KNOWN] = np.nan, 2.0


@inner
def _line_reason(trait: int, computed: int, why: int) -> Any:  # noqa: PLR0911
    """Why a line with such a trait is not understood, whatever else stands on it."""
    if trait & lexer.SYSTEM:
        return CONTROLLER_LINE
    if trait & lexer.DELETE:
        return DELETED
    if trait & lexer.O_WORD:
        return O_WORD
    if trait & lexer.PARAMETER:
        return PARAMETER
    if trait & lexer.EXPRESSION or computed:
        return EXPRESSION
    if trait & lexer.POLAR:
        return POLAR
    return COMMA if trait & lexer.OTHER else why


@inner
def _run_block(words: Any, low: int, high: int, trait: int, state: Any, before: Any, room: Any) -> Any:
    """Carry out one block on the state: task, break, why not understood, why refused, the word."""
    letter, value = words
    values, where, codes, given = room
    present, g, m, computed, twice = _gather(letter, value, low, high, values, where, codes)
    if twice >= 0:
        return FORGET, 0, 0, TWICE, twice
    given[:] = -1
    odd, refused, word = _apply_g(value, codes, g, state, given)
    if refused == 0:
        why, mark, refused, word = _apply_m(value, codes, m, values, present, state)
    if refused:
        return FORGET, 0, 0, refused, word
    why = max(why, odd)
    if (present >> LETTER_F) & 1 and values[LETTER_F] < 0.0:
        return FORGET, 0, 0, NEGATIVE_FEED, where[LETTER_F]
    _apply_numbers(values, present, given, before[UNITS], before[FEED_MODE], state)
    task, mark, found, refused, word = _decide(values, present, where, given, mark, before, state)
    why = _line_reason(trait, computed, max(why, found))
    if why == 0:
        return task, mark, 0, refused, word
    if why in (DELETED, SUBPROGRAM, SAVED_STATE, CONTROLLER_LINE) or computed & (
        (1 << LETTER_G) | (1 << LETTER_M)
    ):
        _forget_modes(state, before, why != DELETED)
    if why == DELETED:
        mark = 0
    if (computed >> LETTER_F) & 1:
        state[FEED], state[FEED_KNOWN] = np.nan, 2.0
    return FORGET, mark, why, 0, -1


@inner
def _intern(state: Any, table: Any, slots: Any, count: int) -> Any:
    """Find the row of `table` that holds the state's modes, made where there is none."""
    code = np.uint64(1469598103934665603)
    for column in range(MODES):
        code = (code ^ np.uint64(np.int64(state[column] * 1e6))) * np.uint64(1099511628211)
    slot = np.int64((code >> np.uint64(20)) % np.uint64(slots.size))
    while slots[slot] >= 0:
        row = slots[slot]
        if (table[row] == state[:MODES]).all():
            return row
        slot = (slot + 1) % slots.size
    slots[slot] = count
    table[count] = state[:MODES]
    return count


@inner
def _grown(table: Any) -> Any:
    larger = np.empty((2 * table.shape[0], MODES))
    larger[: table.shape[0]] = table
    slots = np.full(8 * table.shape[0], -1, np.int64)
    for row in range(table.shape[0]):
        state = larger[row]
        _intern(state, larger[:0], slots, row)
    return larger, slots


@compiled
def resolve(words: Any, traits: Any, stretches: Any, end: int, columns: Any) -> Any:
    """Find the modal state after each block and what each does.

    `words` are the columns block, letter and value; `stretches` (k, 3) first and last line of what lies under
    O-words and the groups that it sets, a bit a column of the state. `columns` to fill: state (n,), F (n,),
    task (n,), break (n,), why not understood (n,). Returns the block at which it ended, why that is refused
    and the word (-1: none), and the distinct states.
    """
    blocks, letter, value = words
    states, feeds, tasks, marks, whys = columns
    table, slots, count = np.empty((32, MODES)), np.full(128, -1, np.int64), 0
    state, before = np.full(STATE, NONE), np.empty(STATE)
    state[PLANE], state[UNITS], state[ABSOLUTE], state[ARC_ABSOLUTE], state[FEED_MODE] = (
        17.0,
        1e-3,
        1.0,
        0.0,
        94.0,
    )
    state[FEED], state[FEED_KNOWN], state[FRAME], state[UNITS_SAID] = np.nan, 0.0, 0.0, 0.0
    room = (np.zeros(26), np.zeros(26, np.int64), np.zeros((2, 64), np.int64), np.zeros(18, np.int64))
    count = _intern(state, table, slots, 0) + 1
    low, row, at = 0, 0, 0
    for block in range(end):
        high = low
        while high < blocks.size and blocks[high] == block:
            high += 1
        refused, word = 0, -1
        if at < stretches.shape[0] and stretches[at, 0] <= block:
            tasks[block], marks[block], whys[block] = FORGET, 0, O_WORD
            for column in range(STATE):
                if (stretches[at, 2] >> column) & 1:
                    state[column] = 2.0 if column == FEED_KNOWN else np.nan if column == FEED else UNKNOWN
            at += stretches[at, 1] == block
        elif high > low or traits[block]:
            before[:] = state
            tasks[block], marks[block], whys[block], refused, word = _run_block(
                (letter, value), low, high, traits[block], state, before, room
            )
        if (table[row] != state[:MODES]).any():
            if count == table.shape[0]:
                table, slots = _grown(table)
            row = _intern(state, table, slots, count)
            count = max(count, row + 1)
        states[block], feeds[block] = row, state[FEED]
        if refused or marks[block] & END:
            return block, refused, word, table[:count]
        low = high
    return end, 0, -1, table[:count]
