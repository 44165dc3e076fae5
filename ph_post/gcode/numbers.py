"""Format numbers and comments as controllers read them.

One number formatter for everything that is written.
"""

from __future__ import annotations

import math
import re
import textwrap
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.types import IntArray
from ph_post.units import MM

ALLOWED = frozenset("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789 .,:=+-*/_'")
"""What a comment may hold: no parentheses (they end it), no `%` and `;`, and none of `!`, `?`, `~` and bytes
above 127, which Grbl obeys even inside a comment (feed hold, status, cycle start, overrides)."""

COMMENT_WIDTH = 100
"""A comment line is no longer than this for the reader's sake, even where the dialect takes more."""

LINE_START: Final = rb"(?m:^)[ \t]*(?:[Nn]\d+[ \t]*)?"
"""Beginning of a line, with its number, in a text of :func:`line_fed`."""

_LONE: Final = re.compile(rb"\r(?!\n)")

COMMENT: Final = re.compile(rb"\([^)\r\n]*\)?|;[^\r\n]*")
"""A comment in parentheses, also one that does not end, or behind a semicolon."""


def blanked(pattern: re.Pattern[bytes], data: bytes) -> bytes:
    """Return a text of the same length, with blanks in the place of all that a pattern finds.

    Examples
    --------
    >>> blanked(COMMENT, b"G1 (fast) X1.")
    b'G1        X1.'
    """
    return pattern.sub(lambda found: b" " * len(found[0]), data)


def line_fed(data: bytes) -> bytes:
    r"""Return a text of the same length in which a line feed ends each line, also where a carriage return alone does.

    Examples
    --------
    >>> line_fed(b"G90\rG91\r\n")
    b'G90\nG91\r\n'
    """
    return _LONE.sub(b"\n", data) if _LONE.search(data) else data


def masked(data: bytes) -> bytes:
    """Return a text in capitals, with blanks in the place of its comments.

    Examples
    --------
    >>> masked(b"g1 (fast) x1. ; so")
    b'G1        X1.     '
    """
    return blanked(COMMENT, data).upper()


class Comments(msgspec.Struct, frozen=True, kw_only=True):
    """Form of a comment on a line of its own.

    Parameters
    ----------
    before, after : str
        What stands before and behind the words.
    allowed : frozenset of str
        Characters that it may hold; each other one becomes an underscore.
    upper : bool
        Whether controllers of that language take no small letters.
    """

    before: str = "("
    after: str = ")"
    allowed: frozenset[str] = ALLOWED
    upper: bool = False

    def text(self, text: str) -> str:
        """Replace everything a controller could stumble over by an underscore.

        Examples
        --------
        >>> Comments().text("plate (2nd) – 50%!")
        'plate _2nd_ _ 50__'
        """
        text = text.upper() if self.upper else text
        return "".join(letter if letter in self.allowed else "_" for letter in text)

    def line(self, text: str) -> str:
        """Write a comment of a text that may stand in one."""
        return f"{self.before}{text}{self.after}"

    @property
    def extra(self) -> int:
        """Number of characters of a line besides its text."""
        return len(self.before) + len(self.after)


PARENTHESES = Comments()
"""Comments of RS274/NGC."""

SEMICOLON = Comments(before="; ", after="")
"""Comments to the end of the line."""


def to_counts(values: Any, decimals: int) -> IntArray:
    """Turn lengths [m] into whole numbers of the last decimal of a mm, the nearest ones.

    Everything written is on this grid, so that equality of positions is exact and a length or a radius
    can be computed from what the controller will read.

    Examples
    --------
    >>> to_counts([0.0123456, -0.001], 3)
    array([12346, -1000])
    """
    return np.rint(np.asarray(values, dtype=np.float64) / MM * 10.0**decimals).astype(np.int64)


def decimal_text(count: int, decimals: int) -> str:
    """Write `count` / 10^`decimals` with no trailing zero, no exponent and no negative zero.

    Examples
    --------
    >>> decimal_text(-1500, 3), decimal_text(0, 3), decimal_text(7, 3)
    ('-1.5', '0', '0.007')
    """
    digits = str(abs(count)).rjust(decimals + 1, "0")
    whole, fraction = digits[: len(digits) - decimals], digits[len(digits) - decimals :].rstrip("0")
    text = f"{whole}.{fraction}" if fraction else whole
    return f"-{text}" if count < 0 else text


def significant_text(value: float, digits: int) -> str:
    """Write a positive number with so many significant digits and no exponent, which G-code does not have.

    Examples
    --------
    >>> significant_text(1200.0000001, 7), significant_text(0.0123456, 3), significant_text(123456.7, 4)
    ('1200', '0.0123', '123457')
    """
    decimals = max(0, digits - 1 - math.floor(math.log10(value)))
    text = f"{value:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def comment_lines(words: str, max_line: int, style: Comments = PARENTHESES) -> list[str]:
    """Write a remark as comment lines of at most `max_line` characters, broken between words.

    Examples
    --------
    >>> comment_lines("one two three", 12)
    ['(one two)', '(  three)']
    >>> comment_lines("one two three", 12, SEMICOLON)
    ['; one two', ';   three']
    """
    width = min(max_line, COMMENT_WIDTH) - style.extra
    return [style.line(line) for line in textwrap.wrap(style.text(words), width, subsequent_indent="  ")]
