"""The lines and words of a program, and why its text is not read any further where it is not."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from ph_post.gcode.reader import lexer
from ph_post.gcode.reader.faults import BINARY, LONG_LINE, Fault
from ph_post.gcode.reader.record import ByteArray, PlaceArray, Words
from ph_post.types import sealed

LONGEST_LINE = 16384
"""No controller takes lines of more bytes than this, comments included."""


class Lexed(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A program's text as words.

    `traits` (n,) has the bits of :mod:`lexer <ph_post.gcode.reader.lexer>` for each line; `end` is the line
    of the closing ``%``, the number of lines where there is none, or the line that `fault` tells of.
    """

    lines: PlaceArray
    words: Words
    traits: ByteArray
    end: int
    fault: Fault | None


def find_lines(data: bytes) -> tuple[PlaceArray, Fault | None]:
    """Places at which lines begin, and the fault of a text that is none: binary, or a line without end."""
    stop = min([place for place in (data.find(b"\n"), data.find(b"\r"), len(data)) if place >= 0])
    if stop > LONGEST_LINE:
        return np.array([0, len(data)], dtype=np.int32), Fault(block=0, place=0, code=LONG_LINE)
    lines = lexer.split_lines(np.frombuffer(data, np.uint8))
    nul = data.find(b"\0")
    if nul >= 0:
        return lines, Fault(block=int(np.searchsorted(lines, nul, "right")) - 1, place=nul, code=BINARY)
    long = np.flatnonzero(np.diff(lines) > LONGEST_LINE)
    if long.size:
        return lines, Fault(block=int(long[0]), place=int(lines[long[0]]), code=LONG_LINE)
    return lines, None


def read_words(data: bytes, lines: PlaceArray) -> Lexed:
    """Read the words of a program up to its closing ``%`` or to the first fault."""
    text = np.frombuffer(data, np.uint8)
    lexed = _read_words(text, lines, int(lexer.count_letters(text, False)))
    if lexed.fault is not None and lexed.fault.code == lexer.FULL:  # what looks like a comment is in a name
        lexed = _read_words(text, lines, int(lexer.count_letters(text, True)))
    return lexed


def _read_words(text: ByteArray, lines: PlaceArray, room: int) -> Lexed:
    blocks, starts, ends = (np.empty(room, np.int32) for _ in range(3))
    letters, digits, decimals = np.empty(room, np.uint8), np.empty(room, np.int64), np.empty(room, np.int16)
    out = (blocks, letters, starts, ends, np.empty(room), digits, decimals)
    traits = np.zeros(lines.size - 1, np.uint8)
    count, end, why, place = lexer.lex(text, lines, out, traits)
    fault = Fault(block=int(end), place=int(place), code=int(why)) if why else None
    block, letter, start, stop, value, digits, decimals = (_cut(column, count) for column in out)
    words = Words(
        block=block, letter=letter, start=start, end=stop, value=value, digits=digits, decimals=decimals
    )
    return Lexed(lines=lines, words=words, traits=traits, end=int(end), fault=fault)


def _cut(column: Any, count: int) -> Any:
    """Take the part of a column that is used, without the room for the rest where that is much."""
    part = column[:count]
    return sealed(part if count > 0.75 * column.size else part.copy())
