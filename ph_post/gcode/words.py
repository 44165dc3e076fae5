"""Lines and words of a program, O-word stretches, and errors that show the line with a caret."""

from __future__ import annotations

import codecs
import re
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.errors import InputError, printable
from ph_post.gcode import arcs, codes, lexer
from ph_post.gcode.program import ByteArray, PlaceArray, WordTable, long_numbers
from ph_post.types import IntArray, sealed, unwritten

WIDTH = 100
"""Columns of a source line that are shown."""

BINARY, LONG_LINE, NOT_UNDERSTOOD = 60, 61, 62
"""Kinds of faults that are found in Python; the others come from the compiled code."""

_TEXTS = {
    lexer.NO_NUMBER: ("letter without a number", "a number behind the letter"),
    lexer.BAD_CHARACTER: ("unknown character", "a word, such as X10"),
    lexer.OPEN_COMMENT: ("comment that does not end", "a closing parenthesis on the same line"),
    lexer.CLOSED_COMMENT: ("closing parenthesis of no comment", "an opening one before it"),
    lexer.BRACKET: ("expression that is not whole", "every bracket closed on its line"),
    lexer.EXPONENT: ("exponent", "a decimal number without one, or a blank before the E"),
    lexer.NO_LETTER: ("number without a letter", "a letter before the number"),
    lexer.AFTER_PERCENT: ("text behind a percent sign", "nothing else on its line"),
    lexer.CHECKSUM: ("checksum that is none", "a whole number at the end of the line"),
    lexer.BYTE_ORDER: ("byte order mark", "UTF-8 without one: controllers refuse it"),
    lexer.SENDERS_WORD: ("word of a sender, which waits there", "words of the controller"),
    lexer.TEXT: ("unknown character", "a word, such as X10"),
    codes.TWICE: ("the same letter twice on a line", "each letter but G and M once"),
    codes.TWO_OF_GROUP: ("two words of one modal group on a line", "one of them"),
    codes.NEGATIVE_FEED: ("negative feed", "F > 0"),
    codes.NO_FEED: ("cut without a feed", "an F word here or before"),
    codes.ZERO_FEED: ("cut with zero feed", "F > 0"),
    codes.NO_INVERSE_FEED: ("cut under G93 without its own F", "an F word in each block that cuts"),
    codes.NO_CENTER: ("arc without centre or radius", "I, J, K of the plane, or R"),
    codes.MIXED_CENTER: ("arc with a radius and a centre", "either R or I, J, K"),
    codes.MISSING_CENTER: ("absolute centre that is not whole", "both words of the plane under G90.1"),
    codes.FOREIGN_CENTER: ("centre along an axis out of the arc's plane", "words of the active plane"),
    codes.NO_RADIUS_END: ("arc by its radius without an end", "an end word in the arc's plane"),
    codes.TURNS: ("number of turns is none", f"a whole P from 1 to {codes.MOST_TURNS}"),
    codes.NO_DWELL: ("dwell without a time", "a P word"),
    NOT_UNDERSTOOD: ("not understood", "a program that is understood throughout"),
    arcs.RADII_DIFFER: ("radii of the arc differ", "as far from the centre at its start as at its end"),
    arcs.ZERO_RADIUS: ("arc of no radius", "a centre away from both ends"),
    arcs.NO_WAY: ("arc by its radius that ends where it begins", "another end, or I, J, K for a full circle"),
    arcs.RADIUS_TOO_SMALL: ("radius too small to reach the arc's end", "at least half the way to the end"),
    arcs.RADIUS_ZERO: ("arc of no radius", "R other than 0"),
}


class ProgramFault(msgspec.Struct, frozen=True, kw_only=True):
    """A refused place, byte `place` on line `block`: the number of its kind, and the text there."""

    block: int
    place: int
    code: int
    got: str = ""


def fault_text(code: int) -> str:
    """Return what a fault is, in words."""
    return "text" if code == lexer.TEXT else _TEXTS[code][0]


def fault_error(name: str, data: bytes, lines: PlaceArray, fault: ProgramFault, end: int | None = None) -> InputError:
    """Make the error of a fault, with its line and a caret under the `end` - `place` bytes it is about.

    Parameters
    ----------
    name : str
        The program's, for the message.
    data, lines
        The program, and where its lines begin.
    fault : ProgramFault
    end : int, optional
        The place behind the word; the word is one byte long where it is not given.

    Returns
    -------
    InputError
    """
    first = int(lines[fault.block])
    column = len(data[first : fault.place].decode("utf-8", "replace")) + 1
    where = f"{name}:{fault.block + 1}:{column}"
    if fault.code == BINARY:
        expected, got = ("text as UTF-8 or ASCII", "UTF-16") if _is_wide(data) else ("text", "a zero byte")
        return InputError(where, "not a part program", expected=expected, got=got)
    if fault.code == LONG_LINE:
        return InputError(where, "line is too long", expected="a line end within 16384 bytes")
    what, expected, got = fault_words(data, fault, end)
    word = _word(data, fault, end)
    line = _plain(data[first : int(lines[fault.block + 1])].rstrip(b"\r\n"))
    return InputError(where, what, expected=expected, got=got, excerpt=excerpt(line, column, max(len(word), 1)))


def fault_words(data: bytes, fault: ProgramFault, end: int | None) -> tuple[str, str, str]:
    """Return what a fault is, what was expected, and what was found; see :func:`fault_error`."""
    what, expected = _TEXTS.get(fault.code, ("not understood", "a program that is understood throughout (--strict)"))
    found = "EF BB BF" if fault.code == lexer.BYTE_ORDER else fault.got or _word(data, fault, end)
    return what, expected, found or "the end of the line"


def _word(data: bytes, fault: ProgramFault, end: int | None) -> str:
    if end is not None:
        return _plain(data[fault.place : end])
    return _plain(data[fault.place : fault.place + 4])[:1]


def excerpt(line: str, column: int, width: int) -> str:
    """Show a source line, cut to what fits around the word, and carets under it.

    Examples
    --------
    >>> print(excerpt("G1 X1 X2", 7, 2))
        G1 X1 X2
              ^^
    """
    start = max(0, column - 1 - WIDTH // 2) if len(line) > WIDTH else 0
    shown = line[start : start + WIDTH]
    before, behind = "..." if start else "", "..." if start + WIDTH < len(line) else ""
    blanks = " " * (4 + len(before) + column - 1 - start)
    carets = "^" * max(1, min(width, WIDTH - (column - 1 - start)))
    return f"    {before}{shown}{behind}\n{blanks}{carets}"


def _plain(text: bytes) -> str:
    """Text that a terminal shows as it is, a column a character."""
    return printable(text.decode("utf-8", "replace"))


LONGEST_LINE = 16384
"""No controller takes lines of more bytes than this; slicers write settings and pictures in longer ones, behind a
semicolon, which printers skip."""

LONGEST_COMMENT = 1 << 19
"""Bytes of the longest line of that kind; whoever reads a file gives up on a line of twice as many."""


TEXT_PER_ZERO = 1000
"""Bytes of a text for each zero byte in it at least; with more it is none."""

_LARGEST = np.iinfo(np.int32).max
"""Bytes of the longest program."""


class Lexed(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A program's text as words.

    `traits` (n,) has the bits of :mod:`lexer <ph_post.gcode.lexer>` for each line; `end` is the line
    of the closing ``%``, the number of lines where there is none. `whys` (n,) has the faults of lines, with
    ``lexer.FAULT`` or ``lexer.QUIET``, and `spots` (n,) their bytes, from 1.
    """

    lines: PlaceArray
    words: WordTable
    traits: ByteArray
    end: int
    whys: ByteArray
    spots: PlaceArray


def lines_of(data: bytes, name: str, *, strict: bool = False) -> PlaceArray:
    """Return the places at which the lines of a program begin, and its end, shape (lines + 1,).

    A few zero bytes are characters of their lines like others that no controller reads, if it is not `strict`.

    Raises
    ------
    InputError
        If the program is empty, too long, or no text.
    """
    if not data.strip():
        raise InputError(name, "the file is empty")
    if len(data) > _LARGEST:
        raise InputError(name, "the file is too long", expected="less than 2 GiB", got=f"{len(data)} bytes")
    lines, fault = _find_lines(data, strict=strict)
    if fault is not None:
        raise fault_error(name, data, lines, fault)
    return lines


def _find_lines(data: bytes, *, strict: bool) -> tuple[PlaceArray, ProgramFault | None]:
    """Return the places at which lines begin, and the fault of what is no text: binary, or a line without end."""
    stop = min([place for place in (data.find(b"\n"), data.find(b"\r"), len(data)) if place >= 0])
    if _endless(data, 0, stop):
        return np.array([0, len(data)], dtype=np.int32), ProgramFault(block=0, place=0, code=LONG_LINE)
    lines = lexer.split_lines(np.frombuffer(data, np.uint8))
    nul = data.find(b"\0")
    if nul >= 0 and (strict or _is_wide(data) or data.count(b"\0") * TEXT_PER_ZERO > len(data)):
        return lines, ProgramFault(block=int(np.searchsorted(lines, nul, "right")) - 1, place=nul, code=BINARY)
    for long in np.flatnonzero(np.diff(lines) > LONGEST_LINE).tolist():
        if _endless(data, int(lines[long]), int(lines[long + 1])):
            return lines, ProgramFault(block=long, place=int(lines[long]), code=LONG_LINE)
    return lines, None


def _is_wide(data: bytes) -> bool:
    """Return whether a text is marked as UTF-16."""
    return data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))


def _endless(data: bytes, begin: int, end: int) -> bool:
    """Return whether a line is too long for any controller; what is behind a semicolon none of them keeps."""
    if end - begin > LONGEST_LINE:
        return end - begin > LONGEST_COMMENT or data.find(b";", begin, begin + LONGEST_LINE) < 0
    return False


def read_words(data: bytes, lines: PlaceArray) -> Lexed:
    """Read the words of a program up to its closing ``%``."""
    text = np.frombuffer(data, np.uint8)
    lexed = _read_words(text, lines, int(lexer.count_letters(text, False)))
    if lexed.end < 0:  # what looks like a comment is in a name
        lexed = _read_words(text, lines, int(lexer.count_letters(text, True)))
    return lexed


def _read_words(text: ByteArray, lines: PlaceArray, room: int) -> Lexed:
    blocks, starts, ends = (np.empty(room, np.int32) for _ in range(3))
    out = (blocks, np.empty(room, np.uint8), starts, ends, np.empty(room), np.empty(room, np.int16))
    traits, whys = np.zeros(lines.size - 1, np.uint8), np.zeros(lines.size - 1, np.uint8)
    spots = unwritten(lines.size - 1, np.int32)
    count, end = lexer.lex(text, lines, out, traits, whys, spots)
    block, letter, start, stop, value, decimals = (_cut(column, count) for column in out)
    long = {
        word: _digits(text[start[word] + 1 : stop[word]].tobytes(), int(decimals[word]))
        for word in long_numbers(value, decimals).tolist()
    }
    words = WordTable(block=block, letter=letter, start=start, end=stop, value=value, decimals=decimals, long=long)
    return Lexed(lines=lines, words=words, traits=traits, end=int(end), whys=whys, spots=spots)


def _digits(number: bytes, decimals: int) -> int:
    """Return the digits of a number with their sign, up to so many decimals.

    It may have blanks in it, and any number of leading zeros.
    """
    whole, _, part = re.sub(rb"[^\d.]", b"", number).partition(b".")
    digits = int((whole + part[: max(decimals, 0)]).lstrip(b"0") or b"0")
    return -digits if b"-" in number else digits


def _cut(column: Any, count: int) -> Any:
    """Take the part of a column that is used, without the room for the rest where that is much."""
    part = column[:count]
    return sealed(part if count > 0.75 * column.size else part.copy())


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
    """Return the first and last line of each stretch under O-words, and the state it may change (a bit a column).

    A stretch goes from an O-word to the one that ends it (`sub` to `endsub`), calls stand alone. What is
    called lies in the program, so its words are those of all bodies, or may be anything. A bit more says in the
    place of that of cutter compensation that subprograms alone have it on, and end it.
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
    if mask != _EVERYTHING and (mask >> codes.COMPENSATION) & 1 and _end_sides(lexed, statements, spans):
        mask = mask & ~(1 << codes.COMPENSATION) | 1 << codes.STATE
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
            later = range(number + 1, len(statements))
            closing = (first.label, closer)
            last = next((k for k in later if (statements[k].label, statements[k].keyword) == closing), -1)
        if last < 0:
            return [*spans, (first.block, max(first.block, end - 1))]
        spans.append((first.block, statements[last].block))
        number = last + 1
    return spans


def _end_sides(lexed: Lexed, statements: list[_Statement], spans: list[tuple[int, int]]) -> bool:
    """Return whether each stretch that sets a side of the cutter is a subprogram whose last word of it is a G40.

    That is to run whenever the subprogram does: on a line under no other O-word.
    """
    words = lexed.words
    sides = np.flatnonzero((words.letter == ord("G")) & (words.value >= 40.0) & (words.value < 43.0))
    for first, last in spans:
        own = sides[(words.block[sides] >= first) & (words.block[sides] <= last)]
        if not own.size:
            continue
        within = [one for one in statements if first <= one.block <= last and one.keyword != b"call"]
        line, open_ones = int(words.block[own[-1]]), list[bytes]()
        for one in within:
            if one.keyword == b"return" or (one.block == line and words.value[own[-1]] == 40.0):
                return False
            if one.block < line and open_ones and one.keyword == _OPENS[open_ones[-1]]:
                open_ones.pop()
            elif one.block < line and one.keyword in _OPENS:
                open_ones.append(one.keyword)
        if words.value[own[-1]] != 40.0 or open_ones != [b"sub"]:
            return False
    return True


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
