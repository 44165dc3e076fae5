"""Offsets added to the numbers of words where they stand, in exact decimal arithmetic."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.compiling import compiled, lean
from ph_post.edit.edits import OffsetRuns, StopEdit
from ph_post.edit.motion_edits import MotionEdit
from ph_post.gcode.program import ARC, AXES, RAPID, PartProgram, PlaceArray
from ph_post.types import IntArray

MOST_DECIMALS: Final = 15
"""Most decimals of a number that can be shifted."""

RESTART: Final = "restart here"
"""Words of a mark behind which a program may be started again, wherever the axes are."""

COMMA: Final = 1 << 12
"""In a style: the decimals stand behind a comma."""

LONGEST: Final = 48
"""Most characters of a shifted number."""


@lean
def _compose(digits: Any, style: Any, out: Any, at: Any) -> Any:
    """Write a number, digits / 10^decimals, in a style to `out` from `at` on; the place behind it."""
    decimals, width, mark = style & 31, style >> 7 & 31, 44 if style & COMMA else 46
    if digits < 0:
        out[at], at = 45, at + 1
    elif style & 64:
        out[at], at = 43, at + 1
    rest, count = np.uint64(abs(digits)), 1
    power = np.uint64(10)
    while rest >= power and count < 19:
        power, count = power * np.uint64(10), count + 1
    whole = max(count - decimals, 0)
    lead = max(whole, width) if width > 0 else whole
    size = lead + decimals
    point = 1 if decimals > 0 or style & 32 else 0
    # From the last digit to the first.
    place = at + size + point - 1
    for n in range(size):
        if n == decimals and point:
            out[place], place = mark, place - 1
        tenth = rest // np.uint64(10)
        out[place], place = np.uint64(48) + (rest - tenth * np.uint64(10)), place - 1
        rest = tenth
    if point and size == decimals:
        out[at] = mark
    return at + size + point


@lean
def _read_style(data: Any, start: Any, end: Any, digits: Any, decimals: Any) -> Any:
    """Read the style of a word's number; odd is true for blanks in it, or a minus before zero."""
    plus, point, before, leading, comma = 0, 0, 0, 0, 0
    odd = digits == 0 and data[start + 1] == 45
    for i in range(start + 1, end):
        c = data[i]
        if 48 <= c <= 57:
            if point == 0:
                leading = 1 if before == 0 and c == 48 else leading
                before += 1
        elif c in (44, 46):
            point, comma = 1, COMMA if c == 44 else 0
        elif c == 43:
            plus = 1
        elif c != 45:
            odd = True
    width = before if before > 1 and leading else min(before, 1)
    odd = odd or width > 31
    return decimals | 32 * point | 64 * plus | min(width, 31) << 7 | comma, odd


@compiled
def shift_numbers(data: Any, columns: Any, number: Any, table: Any, texts: Any, spelling: Any) -> Any:
    """Add offsets to the numbers of words.

    Parameters
    ----------
    data : uint8 array
    columns : tuple
        `start`, `end`, `digits` and `decimals` of the words that change, shape (n,).
    number : int array, shape (n,)
        Row of `table` that is added to each.
    table : int array, shape (k, 2)
        Steps, and the decimals of a step.
    texts : tuple
        `pool`, uint8 array, for the new text, and `bounds`, int array (n + 1,), for where that of each number begins,
        which has the first one.
    spelling : tuple
        `style` and `odd`, uint16 and uint8 arrays (n,), for the spelling of the numbers.
    """
    start, end, digits, decimals = columns
    (pool, bounds), (style, odd) = texts, spelling
    for n in range(number.size):
        steps, places = table[number[n], 0], table[number[n], 1]
        own = np.int64(decimals[n])
        manner, strange = _read_style(data, np.int64(start[n]), np.int64(end[n]), digits[n], own)
        style[n], odd[n] = manner, strange
        wide = max(own, places)
        value = digits[n] * _power(wide - own) + steps * _power(wide - places)
        bounds[n + 1] = _compose(value, (manner >> 5 << 5) | wide, pool, bounds[n])


@lean
def _power(places: Any) -> Any:
    power = np.int64(1)
    for _ in range(places):
        power *= 10
    return power


@compiled
def unshift_numbers(digits: Any, decimals: Any, number: Any, table: Any, style: Any) -> Any:
    """Take offsets back from numbers: their text, where that of each begins, and how many numbers do not fit."""
    count, wrong = digits.size, 0
    pool, bounds = np.empty(LONGEST * count + LONGEST, np.uint8), np.zeros(count + 1, np.int32)
    for n in range(count):
        steps, places = table[number[n], 0], table[number[n], 1]
        manner, own = np.int64(style[n]), np.int64(decimals[n])
        less = own - (manner & 31)
        if own < places or less < 0:
            wrong += 1
            continue
        value, power = digits[n] - steps * _power(own - places), _power(less)
        wrong += value % power != 0
        bounds[n + 1] = _compose(value // power, manner, pool, bounds[n])
    return pool[: bounds[-1]].copy(), bounds, wrong


@compiled
def assemble(data: Any, start: Any, end: Any, pool: Any, bounds: Any, lines: Any, text: Any) -> Any:
    """Put numbers and lines in the place of others.

    Parameters
    ----------
    data : uint8 array
    start, end : int arrays, shape (n,)
        Spans of numbers, in order; those inside a span of lines are passed over.
    pool, bounds : uint8 array, int array (n + 1,)
        Text in their place.
    lines : int array, shape (k, 4)
        Spans of lines, in order: start, end, and the start and end of what stands in their place in `text`.
    text : uint8 array

    Raises
    ------
    ValueError
        Where the spans of lines are not in order: more would be copied than there is room for.
    """
    out = np.empty(data.size + pool.size + text.size, np.uint8)
    at, done, n = 0, np.int64(0), 0
    for k in range(lines.shape[0] + 1):
        until = lines[k, 0] if k < lines.shape[0] else data.size
        if until < done:
            raise ValueError("spans of lines are not in order")
        while n < start.size and start[n] < until:
            if start[n] >= done:
                at = _copy(data, done, np.int64(start[n]), out, at)
                at = _copy(pool, bounds[n], bounds[n + 1], out, at)
                done = np.int64(end[n])
            n += 1
        at = _copy(data, done, until, out, at)
        done = until
        if k < lines.shape[0]:
            at = _copy(text, lines[k, 2], lines[k, 3], out, at)
            done = lines[k, 1]
    return out[:at]


@lean
def _copy(source: Any, low: Any, high: Any, out: Any, at: Any) -> Any:
    for i in range(low, high):
        out[at], at = source[i], at + 1
    return at


class MotionOffsets(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Offsets of motions in whole steps of the last decimal.

    `after` (r, 3) at the ends of the runs of motions that begin with `first` (r,); `word` (q, 3) the one that the end
    words of the runs carry that begin with `begins` (q,), ahead of a stop at their end.
    """

    first: IntArray
    after: NDArray[np.int32]
    begins: IntArray
    word: NDArray[np.int32]

    def word_of(self, motion: int) -> IntArray:
        """Offset that the end word of a motion carries."""
        return np.asarray(self.word[int(self.begins.searchsorted(motion, side="right")) - 1], dtype=np.int64)

    def before(self, motion: int) -> IntArray:
        """Offset at the start of a motion, ahead of any stop there."""
        run = int(self.first.searchsorted(motion, side="left")) - 1
        return self.after[run].astype(np.int64) if motion else np.zeros(3, dtype=np.int64)


class ShiftedWords(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Words that change, and by how many steps."""

    word: PlaceArray
    delta: PlaceArray


def motion_offsets(offset: OffsetRuns, tasks: Sequence[MotionEdit], step: float) -> MotionOffsets:
    """Round offsets to steps [m], at the end of every motion and in its words ahead of a stop there."""
    after = np.rint(offset.value / step).astype(np.int32)
    alone = np.array([task.motion for task in tasks], dtype=np.int64)
    begins = np.unique(np.concatenate([offset.first, alone, alone + 1]))
    begins = begins[begins < offset.count]
    word = after[np.searchsorted(offset.first, begins, side="right") - 1]
    for task, run in zip(tasks, np.searchsorted(begins, alone).tolist(), strict=True):
        if 1.0 in task.stops:
            word[run] -= net_shift(task.stops[1.0], step).astype(np.int32)
        if not task.whole:
            # Its line is written anew, with words of its own.
            word[run] = 0
    return MotionOffsets(first=offset.first, after=after, begins=begins, word=word)


def net_shift(stop: StopEdit, step: float) -> IntArray:
    """Net shift of each axis at a stop in steps, shape (3,)."""
    total = np.zeros(3)
    for shift in stop.shifts:
        total[AXES.index(shift.axis)] += shift.travel
    return np.rint(total / step).astype(np.int64)


def stop_label(stop: StopEdit, offset: IntArray, step: float) -> list[str]:
    """Describe a stop for the comment before it: by axis the side of the new offset, or a take-up move.

    `offset` (3,) is in force before the stop, in steps.
    """
    if not stop.shifts:
        return ["rest"]
    after, found = offset + net_shift(stop, step), [RESTART] if stop.restart else []
    for axis, name in enumerate(AXES):
        if not any(shift.axis == name for shift in stop.shifts):
            continue
        if stop.approach:
            found.append(f"{name} approach")
        elif after[axis] == offset[axis]:
            found.append(f"{name} take-up")
        elif after[axis] == 0 and not stop.crosses_in(name):
            found.append(f"{name} to 0")
        else:
            side = "+" if after[axis] > offset[axis] else "-"
            found.append(f"crossing {name}{side}" if stop.crosses_in(name) else f"{name}{side}")
    return found


def shifted_words(program: PartProgram, found: MotionOffsets) -> ShiftedWords:
    """Return the words that offsets change, and by how many steps.

    Words of motions only: under G90 they carry the offset, under G91 its change in their own block; centres
    under G90.1 move with the axes. Within a motion nothing but a stop changes an offset, and it has words of
    its own.
    """
    words, motions = program.words, program.motions
    owner = np.full(program.blocks, -1, dtype=np.int32)
    owner[motions.block] = np.arange(motions.block.size)
    for line, arc in program.centre_lines.items():
        owner[line] = owner[arc]
    absolute = np.array([modal.absolute for modal in program.modal], dtype=np.bool_)[program.state]
    word, delta = _gather(
        (words.letter, words.block, words.decimals),
        owner,
        absolute,
        program.absolute_centres(),
        motions.kind,
        (found.first, found.after),
        (found.begins, found.word),
    )
    if program.language.diameters:
        delta = np.where(words.letter[word] == ord("X"), 2 * delta, delta)
    return ShiftedWords(word=word, delta=delta)


@lean
def _delta(letter: Any, absolute: Any, arc_absolute: Any, k: Any, kind: Any, after: Any, word: Any, run: Any) -> Any:
    """Return the steps added to a word of a motion; under G91 only a rapid changes an offset by its own word.

    Of centres only those of arcs are absolute: I and J of a G5 always begin at its start.
    """
    if letter < 88:
        return int(word[run, letter - 73]) if arc_absolute and kind[k] == ARC else 0
    axis = letter - 88
    if absolute:
        return int(word[run, axis])
    if kind[k] != RAPID:
        return 0
    return int(word[run, axis]) - (int(after[1][_run_of(after[0], k - 1, 0), axis]) if k > 0 else 0)


@lean
def _run_of(first: Any, motion: Any, near: Any) -> Any:
    """Return the run to which a motion belongs, by their first motions: for the most part `near`, or the next one."""
    for run in range(near, min(near + 2, first.size)):
        if first[run] <= motion and (run + 1 == first.size or motion < first[run + 1]):
            return run
    low, high = 0, first.size
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if first[middle] <= motion else (low, middle)
    return low


@compiled
def _gather(words: Any, owner: Any, absolute: Any, arc_absolute: Any, kind: Any, after: Any, word: Any) -> Any:
    """Find the X, Y, Z, I, J and K words of shifted motions, and their shifts; counted first, then written."""
    letter, block, decimals = words
    found, delta, size = np.empty(0, np.int32), np.empty(0, np.int32), 0
    for write in range(2):
        size, run = 0, 0
        for w in range(letter.size):
            c, line = np.int64(letter[w]), block[w]
            if not (88 <= c <= 90 or 73 <= c <= 75) or owner[line] < 0 or decimals[w] < 0:
                continue
            run = _run_of(word[0], owner[line], run)
            more = _delta(c, absolute[line], arc_absolute[line], owner[line], kind, after, word[1], run)
            if more != 0:
                if write:
                    found[size], delta[size] = w, more
                size += 1
        if not write:
            found, delta = np.empty(size, np.int32), np.empty(size, np.int32)
    return found, delta


@compiled
def number_codes(letter: Any, block: Any, outside: Any, word: Any, number: Any) -> Any:
    """Code of every X, Y, Z, I, J and K outside changes: 0, or one more than the `number` of its change."""
    count = 0
    for write in range(2):
        if write:
            codes = np.zeros(count, np.uint8)
        count, n = 0, 0
        for w in range(letter.size):
            changes = n < word.size and word[n] == w
            if outside[block[w]] and (88 <= letter[w] <= 90 or 73 <= letter[w] <= 75):
                if write and changes:
                    codes[count] = number[n] + 1
                count += 1
            n += changes
    return codes
