"""Axes beside X, Y and Z: which lines move them, from where and to where."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Final

import numpy as np

from ph_post.gcode.program import PartProgram
from ph_post.types import IntArray

ROTARY: Final = "ABC"


@lru_cache(maxsize=4)
def further_words(program: PartProgram) -> IntArray:
    """Return the numbers of the words of the axes beside X, Y and Z that a program's language has."""
    return np.flatnonzero(np.isin(program.words.letter, [ord(letter) for letter in program.language.further]))


@lru_cache(maxsize=4)
def further_lines(program: PartProgram) -> Mapping[int, str]:
    r"""Return the lines whose motion moves axes beside X, Y and Z as well, with the letters of those.

    Examples
    --------
    >>> from ph_post.gcode.read import read_program
    >>> dict(further_lines(read_program(b"G0 A90\nG1 X5 A0 F100\nM2\n", "a.ngc")))
    {1: 'A'}
    """
    words, found = program.words, further_words(program)
    own = found[np.isin(words.block[found], program.motions.block)]
    letters: dict[int, str] = {}
    for word in own.tolist():
        letters[int(words.block[word])] = letters.get(int(words.block[word]), "") + chr(words.letter[word])
    return letters
