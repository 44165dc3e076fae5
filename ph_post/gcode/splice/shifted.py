"""Which words of a program change by how much: lasting offsets told on its words."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from ph_post.gcode.reader.record import RAPID, PartProgram
from ph_post.gcode.splice.record import Edits, Stop
from ph_post.simulate.compiling import compiled
from ph_post.types import IntArray

AXES = "XYZ"


class Carried(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Offsets of motions in whole steps of the last decimal, shape (m, 3) each.

    `before` at the start of a motion, ahead of any stop there; `word` the one that its end word carries,
    ahead of a stop at its end.
    """

    before: IntArray
    word: IntArray


class Changed(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Words that could change: `candidate` those of X, Y, Z, I, J and K; `delta` steps to add to each."""

    candidate: IntArray
    delta: IntArray


def carried(edits: Edits, step: float) -> Carried:
    """Round offsets to steps [m] and tell what the words of every motion carry."""
    offset = np.rint(edits.offset / step).astype(np.int64)
    before = np.vstack([np.zeros((1, 3), dtype=np.int64), offset[:-1]])
    word = offset.copy()
    for stop in edits.stops:
        if stop.share >= 1.0:
            word[stop.motion] -= lasting(stop, step)
    return Carried(before=before, word=word)


def lasting(stop: Stop, step: float) -> IntArray:
    """Sum of the shifts of a stop in steps, shape (3,)."""
    total = np.zeros(3, dtype=np.int64)
    for shift in stop.shifts:
        total[AXES.index(shift.axis)] += round(shift.travel / step)
    return total


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
    # Under G91 only a rapid changes an offset by its own word.
    step = np.where((motions.kind == RAPID)[:, np.newaxis], found.word - found.before, 0)
    candidate, delta = _gather(
        (words.letter, words.block, words.decimals), owner, absolute, arc_absolute, found.word, step
    )
    return Changed(candidate=candidate, delta=delta)


@compiled
def _gather(words: Any, owner: Any, absolute: Any, arc_absolute: Any, word: Any, step: Any) -> Any:
    """Words of X, Y, Z, I, J and K, and what is added to each, where its number is plain."""
    letter, block, decimals = words
    candidate, delta, count = np.empty(letter.size, np.int64), np.zeros(letter.size, np.int64), 0
    for w in range(letter.size):
        end = 88 <= letter[w] <= 90
        if not (end or 73 <= letter[w] <= 75):
            continue
        line, motion = block[w], owner[block[w]]
        candidate[count] = w
        if motion >= 0 and decimals[w] >= 0:
            if end:
                axis = letter[w] - 88
                delta[count] = word[motion, axis] if absolute[line] else step[motion, axis]
            elif arc_absolute[line]:
                delta[count] = word[motion, letter[w] - 73]
        count += 1
    return candidate[:count], delta[:count]
