"""Stretches under O-words: subroutines, loops, branches and calls, which are passed through whole."""

from __future__ import annotations

import re
from typing import Final

import msgspec
import numpy as np

from ph_post.gcode.reader import codes, lexer
from ph_post.gcode.reader.words import Lexed
from ph_post.types import IntArray

_STATEMENT: Final = re.compile(rb"o(\d+|<[^>]*>|[#\[][^a-z]*)([a-z]*)")
_OPENS: Final = {
    b"sub": b"endsub",
    b"while": b"endwhile",
    b"do": b"while",
    b"if": b"endif",
    b"repeat": b"endrepeat",
}
_EVERYTHING: Final = (1 << codes.STATE) - 1


class _Statement(msgspec.Struct, frozen=True, kw_only=True):
    block: int
    label: bytes
    keyword: bytes


def find_stretches(lexed: Lexed, data: bytes) -> IntArray:
    """First and last line of each stretch under O-words, and the state it may change (a bit a column).

    A stretch goes from an O-word to the one that ends it (`sub` to `endsub`), calls stand alone. What is
    called lies in the program, so its words are those of all bodies, or may be anything.
    """
    lines = np.flatnonzero(lexed.traits & lexer.O_WORD)
    statements = [s for line in lines if (s := _statement(lexed, data, int(line))) is not None]
    spans = _spans(statements, lexed.end)
    inside = np.zeros(lexed.traits.size + 1, bool)
    for first, last in spans:
        inside[first : last + 1] = True
    known = {s.label for s in statements if s.keyword == b"sub"}
    calls = {s.label for s in statements if s.keyword == b"call"}
    mask = _EVERYTHING if calls - known else _words_set(lexed, inside)
    return np.array([(first, last, mask) for first, last in spans], np.int64).reshape(-1, 3)


def _statement(lexed: Lexed, data: bytes, block: int) -> _Statement | None:
    text = bytes(data[int(lexed.lines[block]) : int(lexed.lines[block + 1])]).lower()
    text = re.sub(rb"\s|\([^)]*\)|;.*", b"", text)
    match = _STATEMENT.search(text)
    if match is None:
        return _Statement(block=block, label=b"", keyword=b"")
    return _Statement(block=block, label=match[1], keyword=match[2])


def _spans(statements: list[_Statement], end: int) -> list[tuple[int, int]]:
    """Lines from each outermost statement to its end; one that nothing ends goes to the program's end."""
    spans: list[tuple[int, int]] = []
    number = 0
    while number < len(statements):
        first = statements[number]
        closer = _OPENS.get(first.keyword)
        last = number
        if closer is not None:
            ends = (k for k in range(number + 1, len(statements)) if _closes(statements[k], first, closer))
            last = next(ends, -1)
        if last < 0:
            return [*spans, (first.block, max(first.block, end - 1))]
        spans.append((first.block, statements[last].block))
        number = last + 1
    return spans


def _closes(statement: _Statement, first: _Statement, closer: bytes) -> bool:
    return statement.label == first.label and statement.keyword == closer


def _words_set(lexed: Lexed, inside: np.ndarray) -> int:
    """Columns of the state that the words on these lines set; everything where one of them is not plain."""
    words = lexed.words
    rows = np.flatnonzero(inside[words.block])
    letters, values = words.letter[rows], words.value[rows]
    if np.isnan(values[(letters == ord("G")) | (letters == ord("M"))]).any():
        return _EVERYTHING
    mask = 0
    for code in np.unique(np.rint(10.0 * values[letters == ord("G")])):
        group = codes.GROUP[int(code)] if 0 <= code < codes.GROUP.size else -1
        column = codes.FIELD[group] if group >= 0 else -1
        mask |= 1 << int(column) if column >= 0 else 0
    for letter, columns in _LETTER_COLUMNS.items():
        if (letters == ord(letter)).any():
            mask |= sum(1 << column for column in columns)
    return mask


_LETTER_COLUMNS: Final = {
    "F": (codes.FEED, codes.FEED_KNOWN),
    "S": (codes.SPEED,),
    "T": (codes.PREPARED,),
    "M": (codes.SPINDLE, codes.MIST, codes.FLOOD, codes.TOOL),
    "P": (codes.PATH_P,),
    "Q": (codes.PATH_Q,),
}
