"""What is refused in a program, and how it is told: place, words, and the line with a caret."""

from __future__ import annotations

import codecs

import msgspec

from ph_post.errors import InputError
from ph_post.gcode.reader import arcs, codes, lexer
from ph_post.gcode.reader.record import PlaceArray

WIDTH = 100
"""Columns of a source line that are shown."""

BINARY, LONG_LINE, NOT_UNDERSTOOD = 60, 61, 62
"""Kinds of faults that are found in Python; the others are told by the compiled code."""

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
}  # fmt: skip


class Fault(msgspec.Struct, frozen=True, kw_only=True):
    """What is refused on line `block` at the byte `place`: the number of its kind, and what was got."""

    block: int
    place: int
    code: int
    got: str = ""


def refuse(name: str, data: bytes, lines: PlaceArray, fault: Fault, end: int | None = None) -> InputError:
    """Make the error of a fault, with its line and a caret under the `end` - `place` bytes it is about.

    Parameters
    ----------
    name : str
        The program's, for the message.
    data, lines
        The program, and where its lines begin.
    fault : Fault
    end : int, optional
        Behind the last byte of the word; one byte where it is not given.
    """
    first = int(lines[fault.block])
    column = len(data[first : fault.place].decode("utf-8", "replace")) + 1
    where = f"{name}:{fault.block + 1}:{column}"
    word = _plain(data[fault.place : end] if end is not None else data[fault.place : fault.place + 4])
    word = word if end is not None else word[:1]
    got = fault.got or word or "the end of the line"
    if fault.code == BINARY:
        return InputError(where, "not a part program", expected="text", got="a zero byte")
    if fault.code == LONG_LINE:
        return InputError(where, "line is too long", expected="a line end within 16384 bytes")
    what, expected = _TEXTS.get(
        fault.code, ("not understood", "a program that is understood throughout (--strict)")
    )
    if fault.code == lexer.BAD_CHARACTER and data.startswith(codecs.BOM_UTF8) and fault.place == 0:
        what, expected, got = "byte order mark", "UTF-8 without one: controllers refuse it", "EF BB BF"
    line = _plain(data[first : int(lines[fault.block + 1])].rstrip(b"\r\n"))
    return InputError(
        where, what, expected=expected, got=got, excerpt=excerpt(line, column, max(len(word), 1))
    )


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
    return "".join(
        c if c.isprintable() else " " if c == "\t" else "?" for c in text.decode("utf-8", "replace")
    )
