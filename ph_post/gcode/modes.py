"""Resolve the modal state of a program, block by block: one compiled pass over the words.

The motions of the blocks are decided in :mod:`ph_post.gcode.motions`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.gcode import lexer
from ph_post.gcode.codes import (
    ABSOLUTE,
    ARC_ABSOLUTE,
    AXES,
    BENEATH,
    CALLS,
    COMMA,
    COMPENSATION,
    CONTROLLER_LINE,
    DELETED,
    END,
    EXPLICIT,
    EXPRESSION,
    FAULT,
    FEED,
    FEED_KNOWN,
    FEED_MODE,
    FIELD,
    FLOOD,
    FORGETTING,
    FRAME,
    FRAME_CHANGE,
    FRAMED,
    FRAMES,
    G_EFFECT,
    GROUP,
    KNOWN_SHIFT,
    LENGTH,
    LENGTH_CHANGE,
    LENIENT_LINE,
    LETTER_F,
    LETTER_G,
    LETTER_M,
    LETTER_O,
    LETTER_P,
    LETTER_Q,
    LETTER_S,
    LETTER_T,
    M_GROUP,
    MIST,
    MODES,
    MOTION,
    NEGATIVE_FEED,
    NONE,
    O_WORD,
    OFFSET_LINE,
    PARAMETER,
    PATH_P,
    PATH_Q,
    PLANE,
    POLAR,
    PREPARED,
    QUIET,
    RUNS,
    SAVED_STATE,
    SPEED,
    SPINDLE,
    STATE,
    STAYING_G,
    STAYING_M,
    STAYS,
    SUBPROGRAM,
    SWITCHES,
    SYSTEM,
    TOOL,
    TOOL_CHANGE,
    TWICE,
    TWO_OF_GROUP,
    UNITS,
    UNITS_SAID,
    UNKNOWN,
    UNKNOWN_G,
    UNKNOWN_M,
    USER_M,
)


@lean
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


@lean
def _code_of(value: float) -> Any:
    """Ten times a G word's number, 999 (which no controller has) where it has more decimals."""
    tenfold = 10.0 * value
    code = np.int64(np.rint(tenfold)) if 0.0 <= tenfold < 999.0 else 999
    return code if abs(tenfold - code) < 1e-6 else 999


@lean
def _apply_g(value: Any, codes: Any, count: int, state: Any, given: Any) -> Any:
    """Set the groups of a block's G words (`given` by group): why not understood, its fault, word.

    What two words of a group leave may be either. A word that nobody knows may be a cycle that lasts, beside which no
    other motion stands, or another work offset.
    """
    why, fault, place, unknown = 0, 0, -1, False
    for k in range(count):
        code = _code_of(value[codes[0, k]])
        group = GROUP[code]
        if group < 0:
            effect = G_EFFECT[code]
            found = STAYING_G if effect == STAYS else SUBPROGRAM if effect == CALLS else UNKNOWN_G
            why = found if why in (0, STAYING_G) or found == SUBPROGRAM else why
            unknown = unknown or (found == UNKNOWN_G and value[codes[0, k]] != FORGETTING)
            continue
        if given[group] >= 0 and (group != 1 or given[1] == code or (given[1] != 800 and code != 800)):
            fault, place = (fault, place) if fault else (TWO_OF_GROUP, codes[0, k])
            if FIELD[group] >= 0 and group not in (15, 17):
                state[FIELD[group]] = UNKNOWN
            continue
        if group == 1 and code == 800 and given[1] >= 0:
            continue  # the other motion is the one that lasts
        given[group] = code
        if group in (8, 15, 17):
            state[FRAME] = _framed(int(state[FRAME]), code)
        if group not in (15, 17) and FIELD[group] >= 0:
            state[FIELD[group]] = _setting(group, code)
    if unknown:
        state[SYSTEM] = UNKNOWN
        state[MOTION] = state[MOTION] if given[1] >= 0 else UNKNOWN
    return why, fault, place


@lean
def _framed(frame: int, code: int) -> Any:
    """Ways in which the frame is not the machine's, a bit each, after a G word."""
    for bit in range(FRAMES.shape[0]):
        if code == FRAMES[bit, 0]:
            frame |= 1 << bit
        elif code == FRAMES[bit, 1]:
            frame &= ~(1 << bit)
    return float(frame)


@lean
def _setting(group: int, code: int) -> Any:
    """Content of a group's column for a G word."""
    if group == 6:
        return 0.0254 if code == 200 else 1e-3
    if group in (3, 4):
        return 1.0 if code < 910 else 0.0
    if group == 2:
        return code / 10.0 if code % 10 == 0 else UNKNOWN
    return code / 10.0 if group == 5 else np.float64(code)


@lean
def _apply_m(value: Any, effects: Any, codes: Any, count: int, values: Any, present: int, state: Any) -> Any:
    """Set the groups of a block's M words: why it is not understood, its breaks, its fault, and the word.

    `effects` (1000,) are those of M words that are not of RS274/NGC.
    """
    why, mark, seen, coolant, fault, place = 0, 0, 0, 0, 0, -1
    for k in range(count):
        word = codes[1, k]
        code = np.int64(value[word]) if 0.0 <= value[word] < 1000.0 else 999
        if code != value[word]:
            code = 999
        group = M_GROUP[code] if code < 100 else -1
        both = (code == 7 and coolant == 8) or (code == 8 and coolant == 7)
        if group >= 0 and (seen >> group) & 1 and not both:
            fault, place = (fault, place) if fault else (TWO_OF_GROUP, word)
            _unset_m(group, state)
            continue
        if group < 0:
            effect = effects[code]
            found = STAYING_M if effect == STAYS else SUBPROGRAM if effect == CALLS or code in (98, 99) else UNKNOWN_M
            found = SAVED_STATE if code in (72, 73) else USER_M if effect == RUNS else found
            if effect == SWITCHES:  # no word is known to bring the machine's own axes back
                state[FRAME] = float(int(state[FRAME]) | 1 << FRAMES.shape[0])
            milder = why in (0, STAYING_M) or (why == USER_M and found != STAYING_M)
            why = found if milder or found == SUBPROGRAM else why
            continue
        seen |= 1 << group
        coolant = int(code) if group == 8 else coolant
        mark |= _set_m(int(code), values, present, state)
    return why, mark, fault, place


@lean
def _unset_m(group: int, state: Any) -> None:
    """Forget what two M words of a group may set."""
    if group == 7:
        state[SPINDLE] = UNKNOWN
    elif group == 8:
        state[MIST] = state[FLOOD] = UNKNOWN
    elif group == 6:
        state[TOOL] = UNKNOWN


@lean
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
        state[TOOL] = _plain(values[LETTER_T]) if (present >> LETTER_T) & 1 else state[PREPARED]
    elif code == 61:
        state[TOOL] = _plain(values[LETTER_Q]) if (present >> LETTER_Q) & 1 else UNKNOWN
    return TOOL_CHANGE if code in (6, 60, 61) else 0


@lean
def _plain(value: float) -> Any:
    """Return a word's value, or that it may be any: a NaN would be another state on every line."""
    return UNKNOWN if np.isnan(value) else value


@lean
def _apply_numbers(values: Any, present: int, given: Any, was: float, mode_was: float, state: Any) -> Any:
    """Set F, S, T and the path mode; `was` and `mode_was` are units and feed mode before the block."""
    if state[FEED_MODE] != mode_was:
        unsure = mode_was == UNKNOWN or state[FEED_KNOWN] == 2.0
        state[FEED], state[FEED_KNOWN] = np.nan, 2.0 if unsure else 0.0
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
        state[SPEED] = _plain(values[LETTER_S])
    if (present >> LETTER_T) & 1:
        state[PREPARED] = _plain(values[LETTER_T])
    if given[13] >= 0:
        own = present if given[13] == 640 else 0
        state[PATH_P] = _plain(values[LETTER_P]) if (own >> LETTER_P) & 1 else NONE
        state[PATH_Q] = _plain(values[LETTER_Q]) if (own >> LETTER_Q) & 1 else NONE


@lean
def _worst(one: int, other: int) -> Any:
    """Return that of two reasons which leaves less known."""
    calls = one in (SUBPROGRAM, SAVED_STATE)
    return one if calls or (other in (0, STAYING_G) and one != 0) else other


@lean
def _apply_words(words: Any, low: int, high: int, state: Any, before: Any, room: Any) -> Any:
    """Carry out a block's words on the state.

    Returns its breaks, why it is not understood, the letters whose values are computed, its fault and the word.
    """
    letter, value, effects = words
    values, where, codes, given = room
    present, g, m, computed, twice = _gather(letter, value, low, high, values, where, codes)
    for group in range(given.size):
        given[group] = -1
    odd, fault, word = _apply_g(value, codes, g, state, given)
    why, mark, other, place = _apply_m(value, effects, codes, m, values, present, state)
    fault, word = (fault, word) if fault else (other, place)
    if twice >= 0:
        fault, word = TWICE, twice
    if not fault and (present >> LETTER_F) & 1 and values[LETTER_F] < 0.0:
        fault, word = NEGATIVE_FEED, where[LETTER_F]
    ended = given[17] == 501 or (given[17] >= 0 and given[0] < 0 and state[FRAME] == before[FRAME])
    if ended and present & AXES:
        odd = UNKNOWN_G  # G50 X Z is no end of a scaling, and the axes of G50.1 are those it mirrors no longer
    speed = state[SPEED]
    _apply_numbers(values, present, given, before[UNITS], before[FEED_MODE], state)
    if why == STAYING_M:
        state[SPEED] = speed  # S is a fan's or a temperature
    moved = given[16] >= 0 or (given[12] >= 0 and state[SYSTEM] != before[SYSTEM])
    if moved:
        mark |= FRAME_CHANGE
    elif given[8] >= 0 and (given[8] != 490 or before[LENGTH] != 490.0):
        mark |= FRAME_CHANGE | LENGTH_CHANGE
    return mark, _worst(why, odd), computed, fault, word


@lean
def _forget_modes(state: Any, before: Any, all_of_them: bool, fixed: Any) -> None:
    """Make unknown what differs from `before`, or all; what is `fixed` in the language stays that.

    Of what is infinite there all lines leave what the program has said.
    """
    for column in range(MODES):
        if all_of_them and np.isinf(fixed[column]) and (column != UNITS or state[UNITS_SAID] == 1.0):
            continue
        if all_of_them or state[column] != before[column]:
            state[column] = fixed[column] if np.isfinite(fixed[column]) else UNKNOWN
    state[FRAME] = float(int(state[FRAME]) | int(before[FRAME]))
    if (
        all_of_them
        or not (state[FEED] == before[FEED] or np.isnan(before[FEED]))
        or state[FEED_KNOWN] != before[FEED_KNOWN]
    ):
        state[FEED], state[FEED_KNOWN] = np.nan, 2.0


@lean
def _line_reason(trait: int, computed: int, why: int) -> Any:  # noqa: PLR0911
    """Return why a line with a trait is not understood, whatever else stands on it."""
    if trait & lexer.SYSTEM:
        return CONTROLLER_LINE
    if trait & lexer.DELETE:
        return DELETED
    if trait & lexer.O_WORD:
        return O_WORD
    if trait & lexer.PARAMETER:
        return PARAMETER
    if trait & lexer.OTHER:
        return COMMA
    if trait & lexer.EXPRESSION or computed:
        return EXPRESSION
    return POLAR if trait & lexer.POLAR else why


@lean
def _run_block(
    words: Any, low: int, high: int, trait: int, state: Any, before: Any, room: Any, fixed: Any, first: Any, fault: int
) -> Any:
    """Carry out one block on the state: breaks, why not understood, its fault, the word.

    A block with a fault may be carried out or not; `fault` is one of its text. A line for the controller itself keeps
    the modes, sets or resets them to what they were at first, does what nobody knows, or carries out its words or not.
    """
    mark, odd, computed, found, word = _apply_words(words, low, high, state, before, room)
    fault = fault or found
    why = _line_reason(trait, computed, odd)
    if why == DELETED and odd in (SUBPROGRAM, SAVED_STATE):
        _forget_modes(state, before, True, fixed[1])
    if why == DELETED or fault or trait & (lexer.SYSTEM | lexer.DELETE) == lexer.SYSTEM | lexer.DELETE:
        _forget_modes(state, before, False, fixed[0])
        mark = 0
        if not fault or not computed & ((1 << LETTER_G) | (1 << LETTER_M)):
            return mark, why, fault, word
    codes = computed & ((1 << LETTER_G) | (1 << LETTER_M))
    if why == CONTROLLER_LINE and trait & lexer.KEEPS and trait & lexer.OTHER:
        for column in range(MODES):
            state[column] = first[column]
        state[FEED], state[FEED_KNOWN] = np.nan, 2.0
    elif codes or odd in (SUBPROGRAM, SAVED_STATE) or (why == CONTROLLER_LINE and trait & lexer.OTHER):
        _forget_modes(state, before, True, fixed[0] if codes else fixed[1])
    elif why == CONTROLLER_LINE and not trait & lexer.KEEPS:
        _forget_modes(state, first, False, fixed[0])
    if (computed >> LETTER_F) & 1:
        state[FEED], state[FEED_KNOWN] = np.nan, 2.0
    return mark, why, fault, word


@lean
def _after(state: Any, given: Any, before: Any, fixed: Any) -> Any:
    """Leave the motions that do not last: the motion of this block, ten times its number.

    Where cycles are a group of their own G80 leads back to the straight motion before them.
    """
    motion = state[MOTION]
    if fixed[0, BENEATH] == 1.0:
        if motion == 800.0:
            state[MOTION] = state[BENEATH] if state[BENEATH] in (0.0, 10.0, UNKNOWN) else motion
        elif motion < 700.0:
            state[BENEATH] = motion
    if given[1] in (50, 51):
        state[MOTION] = UNKNOWN  # one controller stays in it, another goes back to the mode before
    if given[0] == 53:
        motion = before[MOTION]
        state[MOTION] = NONE
    return np.int64(motion)


@lean
def _flags(given: Any, state: Any) -> Any:
    """Return what else a block has, in bits."""
    lenient = given[7] >= 0 or given[8] >= 0 or given[13] == 640 or given[14] >= 0 or given[0] in (40, 100)
    flags = (EXPLICIT if given[1] >= 0 else 0) | (LENIENT_LINE if lenient else 0)
    flags |= (OFFSET_LINE if given[8] in (431, 432) else 0) | (FRAMED if state[FRAME] != 0.0 else 0)
    return flags | (np.int64(state[FEED_KNOWN]) << KNOWN_SHIFT)


@lean
def _is_row(table: Any, row: int, state: Any) -> Any:
    """Return True if a row of `table` holds the state's modes; a loop, as whole arrays take long to compile."""
    for column in range(MODES):  # noqa: SIM110 - compiled
        if table[row, column] != state[column]:
            return False
    return True


@lean
def _intern(state: Any, table: Any, slots: Any, count: int) -> Any:
    """Find the row of `table` that holds the state's modes, made where there is none."""
    code = np.uint64(1469598103934665603)
    for column in range(MODES):
        code = (code ^ np.uint64(np.int64(state[column] * 1e6))) * np.uint64(1099511628211)
    slot = np.int64((code >> np.uint64(20)) % np.uint64(slots.size))
    while slots[slot] >= 0:
        row = slots[slot]
        if _is_row(table, row, state):
            return row
        slot = (slot + 1) % slots.size
    slots[slot] = count
    for column in range(MODES):
        table[count, column] = state[column]
    return count


@inner
def _grown(table: Any) -> Any:
    larger = np.empty((2 * table.shape[0], MODES))
    slots = np.full(8 * table.shape[0], -1, np.int64)
    for row in range(table.shape[0]):
        _intern(table[row], larger, slots, row)
    return larger, slots


@inner
def _begin(fixed: Any) -> Any:
    """Room for the states, and the state in which a program begins."""
    state = np.full(STATE, NONE)
    state[PLANE], state[UNITS], state[ABSOLUTE], state[ARC_ABSOLUTE] = 17.0, 1e-3, 1.0, 0.0
    state[FEED_MODE], state[FEED], state[FEED_KNOWN], state[FRAME], state[UNITS_SAID] = (
        94.0,
        np.nan,
        0.0,
        0.0,
        0.0,
    )
    for column in range(MODES):
        if not np.isnan(fixed[column]):
            state[column] = fixed[column]
    table, slots = np.empty((32, MODES)), np.full(128, -1, np.int64)
    _intern(state, table, slots, 0)
    return state, table, slots


@lean
def _forget_columns(state: Any, mask: int) -> None:
    """Make unknown what a stretch under O-words may have set, a bit a column; of one more see `find_stretches`."""
    if (mask >> STATE) & 1 and state[COMPENSATION] > 400.0:
        state[COMPENSATION] = UNKNOWN
    for column in range(STATE):
        if (mask >> column) & 1:
            state[column] = 2.0 if column == FEED_KNOWN else np.nan if column == FEED else UNKNOWN
    state[FRAME] = max(state[FRAME], 0.0)


_SETTING = (1 << LETTER_M) | (1 << LETTER_O) | (1 << LETTER_S) | (1 << LETTER_T)
"""Letters of words that set more than a motion and F, or do."""


@lean
def _read_move(letter: Any, value: Any, low: int, high: int, state: Any, given: Any) -> Any:
    """Carry out a block that goes on in the motion in force, and sets nothing but F; False of every other.

    Most blocks are of this kind.
    """
    present, feed = np.int64(0), -1
    given[1] = NONE
    for word in range(low, high):
        index = np.int64(letter[word]) - 65
        if ((present | _SETTING) >> index) & 1 or np.isnan(value[word]):
            return False
        if index == LETTER_G:
            if not (10.0 * value[word] == state[MOTION] and 0.0 <= state[MOTION] <= 30.0):
                return False
            given[1] = np.int64(state[MOTION])
        elif index == LETTER_F:
            if value[word] < 0.0:
                return False
            feed = word
        present |= 1 << index
    for group in range(given.size):
        if group != 1:
            given[group] = NONE
    if feed >= 0:
        state[FEED], state[FEED_KNOWN] = value[feed], 1.0
    return True


@compiled
def resolve_modes(  # noqa: C901
    words: Any, traits: Any, stretches: Any, end: int, columns: Any, fixed: Any
) -> Any:
    """Find the modal state after each block, and of each what decides on what it does.

    `words` are the columns block, letter and value, and the effects of M words; `stretches` (k, 3) first and last line
    of what lies under O-words and the groups that it sets, a bit a column of the state; `fixed` (2, STATE) the state
    that no line of the language changes, NaN where it does, and whether F is known at first, and the one behind lines
    that may set any mode. `columns` to fill, each (n,): state, F, the motion in force, word of group 0, flags, breaks,
    why not understood, and the word with a fault of its
    own, as -2 - number (-1: none); the faults of the text stand there before. Returns the block at which it ended,
    and the distinct states.
    """
    blocks, letter, value, effects = words
    states, feeds, motions, zeros, flags, marks, whys, spots = columns
    state, table, slots = _begin(fixed[0])
    state[FEED_KNOWN] = fixed[0, FEED_KNOWN]
    if fixed[0, ARC_ABSOLUTE] == 1.0:
        state[ARC_ABSOLUTE] = 1.0
    first = state.copy()
    before, count, low, row, at = state.copy(), 1, 0, 0, 0
    room = (np.zeros(26), np.zeros(26, np.int64), np.zeros((2, 64), np.int64), np.zeros(18, np.int64))
    for block in range(end):
        high, was = low, np.int64(whys[block])
        while high < blocks.size and blocks[high] == block:
            high += 1
        zeros[block], plain = -1, block > 0 and high > low and traits[block] == 0 and was == 0
        if at < stretches.shape[0] and stretches[at, 0] <= block:
            whys[block] = was if FAULT < was < QUIET else O_WORD
            _forget_columns(state, stretches[at, 2])
            at += stretches[at, 1] == block
        elif plain and _read_move(letter, value, low, high, state, room[3]):
            zeros[block], motions[block] = room[3][0], np.int64(state[MOTION])
            flags[block] = _flags(room[3], state)
            states[block], feeds[block], low = row, state[FEED], high
            continue
        elif high > low or traits[block]:
            for column in range(STATE):
                before[column] = state[column]
            parts = (letter, value, effects)
            own = int(was) if FAULT < was < QUIET else 0
            marks[block], why, fault, word = _run_block(
                parts, low, high, traits[block], state, before, room, fixed, first, own
            )
            if own == 0 and fault:
                whys[block], spots[block] = FAULT + fault, -2 - word
            elif own == 0 and (why or was == 0):
                whys[block] = why
            zeros[block] = room[3][0]
            motions[block] = _after(state, room[3], before, fixed)
            flags[block] = _flags(room[3], state)
        if not _is_row(table, row, state):
            if count == table.shape[0]:
                table, slots = _grown(table)
            row = _intern(state, table, slots, count)
            count = max(count, row + 1)
        states[block], feeds[block] = row, state[FEED]
        if marks[block] & END:
            return block, table[:count]
        low = high
    return end, table[:count]
