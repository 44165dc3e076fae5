"""Which words of a program change by how much: lasting offsets told on its words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.gcode.reader.record import ARC, AXES, RAPID, PartProgram
from ph_post.gcode.splice.record import Stop
from ph_post.gcode.splice.schedule import Task
from ph_post.simulate.compiling import compiled, inner
from ph_post.types import Array, IntArray


class Carried(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Offsets of motions in whole steps of the last decimal, shape (m, 3) each.

    `after` at the end of a motion; `word` the one that its end word carries, ahead of a stop at its end.
    """

    after: NDArray[np.int32]
    word: NDArray[np.int32]

    def before(self, motion: int) -> IntArray:
        """Offset at the start of a motion, ahead of any stop there."""
        return self.after[motion - 1].astype(np.int64) if motion else np.zeros(3, dtype=np.int64)


class Changed(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Words that change, and by how many steps."""

    word: IntArray
    delta: IntArray


def carried(offset: Array, tasks: Sequence[Task], step: float) -> Carried:
    """Round offsets to steps [m] and tell what the words of every motion carry, its stops where they are."""
    after = np.rint(offset / step).astype(np.int32)
    word = after.copy()
    for task in tasks:
        if 1.0 in task.stops:
            word[task.motion] -= lasting(task.stops[1.0], step).astype(np.int32)
    return Carried(after=after, word=word)


def lasting(stop: Stop, step: float) -> IntArray:
    """Sum of the shifts of a stop in steps, shape (3,)."""
    total = np.zeros(3)
    for shift in stop.shifts:
        total[AXES.index(shift.axis)] += shift.travel
    return np.rint(total / step).astype(np.int64)


def stop_words(stop: Stop, offset: IntArray, step: float) -> list[str]:
    """Say what a stop does to the offsets (3,) in force before it, in steps: a word or two an axis."""
    if not stop.shifts:
        return ["rest"]
    after, found = offset + lasting(stop, step), []
    for axis, name in enumerate(AXES):
        if any(shift.axis == name for shift in stop.shifts):
            way = int(np.sign(after[axis]))
            found.append(f"{name} {'pulse' if after[axis] == offset[axis] else ('back', 'up', 'down')[way]}")
    return found


def changed_words(program: PartProgram, found: Carried) -> Changed:
    """Tell the change of every word.

    Words of motions only: under G90 they carry the offset, under G91 its change in their own block; centres
    under G90.1 move with the axes. Within a motion nothing but a stop changes an offset, and it has words of
    its own.
    """
    words, motions = program.words, program.motions
    owner = np.full(program.blocks, -1, dtype=np.int64)
    owner[motions.block] = np.arange(motions.block.size)
    absolute, arc_absolute = (
        np.array([getattr(modal, name) for modal in program.modal], dtype=np.bool_)[program.state]
        for name in ("absolute", "arc_absolute")
    )
    word, delta = _gather(
        (words.letter, words.block, words.decimals),
        owner, absolute, arc_absolute, motions.kind, found.after, found.word,
    )  # fmt: skip
    return Changed(word=word, delta=delta)


@inner
def _delta(letter: Any, absolute: Any, arc_absolute: Any, k: Any, kind: Any, after: Any, word: Any) -> Any:
    """Tell what is added to a word of a motion; under G91 only a rapid changes an offset by its own word.

    Of centres only those of arcs are absolute: I and J of a G5 always begin at its start.
    """
    if letter < 88:
        return int(word[k, letter - 73]) if arc_absolute and kind[k] == ARC else 0
    axis = letter - 88
    if absolute:
        return int(word[k, axis])
    if kind[k] != RAPID:
        return 0
    return int(word[k, axis]) - (int(after[k - 1, axis]) if k > 0 else 0)


@compiled
def _gather(
    words: Any, owner: Any, absolute: Any, arc_absolute: Any, kind: Any, after: Any, word: Any
) -> Any:
    """Words of X, Y, Z, I, J and K of motions that something is added to, and what; counted, then written."""
    letter, block, decimals = words
    found, delta, size = np.empty(0, np.int64), np.empty(0, np.int64), 0
    for write in range(2):
        size = 0
        for w in range(letter.size):
            c, line = np.int64(letter[w]), block[w]
            if not (88 <= c <= 90 or 73 <= c <= 75) or owner[line] < 0 or decimals[w] < 0:
                continue
            more = _delta(c, absolute[line], arc_absolute[line], owner[line], kind, after, word)
            if more != 0:
                if write:
                    found[size], delta[size] = w, more
                size += 1
        if not write:
            found, delta = np.empty(size, np.int64), np.empty(size, np.int64)
    return found, delta


@compiled
def number_codes(letter: Any, block: Any, outside: Any, word: Any, number: Any) -> Any:
    """Code of every X, Y, Z, I, J and K outside hunks: 0, or one more than the `number` of its change."""
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
