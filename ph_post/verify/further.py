"""Check the words of axes beside X, Y and Z."""

from __future__ import annotations

import numpy as np

from ph_post.gcode.program import PartProgram, WordTable
from ph_post.types import Array, IntArray
from ph_post.verify.line_pairs import VerifyCase


def check_further(case: VerifyCase, words: tuple[WordTable, WordTable]) -> None:
    """Demand the same words of axes beside X, Y and Z, in the same order, in the lines and in the changes.

    `words` are those of both programs that :func:`~ph_post.verify.text.check_text` returns.
    """
    (old, one), (new, other) = _words_of(case.original, words[0]), _words_of(case.compensated, words[1])
    case.findings.count("words of further axes", old.size)
    if np.array_equal(one, other):
        return
    shared = min(old.size, new.size)
    place = int(np.argmax((one[:, :shared] != other[:, :shared]).any(axis=0))) if shared else 0
    place = place if shared and (one[:, place] != other[:, place]).any() else shared
    case.findings.add(
        "command",
        "the words of axes beside X, Y and Z are not those of the original",
        original=int(words[0].block[old[place]]) if place < old.size else None,
        compensated=int(words[1].block[new[place]]) if place < new.size else None,
        expected=_text(case.original, words[0], old, place),
        got=_text(case.compensated, words[1], new, place),
    )


def _words_of(program: PartProgram, words: WordTable) -> tuple[IntArray, Array]:
    """Return the rows up to the program's end, and of each its letter, its value and the mode of its line, (3, n)."""
    rows = np.flatnonzero(np.isin(words.letter, [ord(letter) for letter in program.language.further]))
    rows = rows[words.block[rows] <= program.breaks[-1].block]
    absolute = np.array([modal.absolute for modal in program.modal])[program.state[words.block[rows]]]
    return rows, np.array([words.letter[rows], np.nan_to_num(words.value[rows], nan=np.inf), absolute])


def _text(program: PartProgram, words: WordTable, rows: IntArray, place: int) -> str:
    if place >= rows.size:
        return "nothing more"
    return program.data[words.start[rows[place]] : words.end[rows[place]]].decode("latin-1")
