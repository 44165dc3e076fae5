"""Comments that are written for the reader of compensated programs, in the style of each language.

They are read back whatever their style: in parentheses or behind a semicolon, in small letters or, where
controllers take no others, in capitals.
"""

from __future__ import annotations

import re
from typing import Final

from ph_post.gcode.format import Comments

MARK: Final = "ph-post: "
"""Begins each of these comments."""

_STYLES: Final = ("(", "; ")


def marked(words: str, style: Comments) -> str:
    """Write a comment line that is read back; a language of capitals has it in capitals."""
    text = MARK + words
    return style.line(text.upper() if style.upper else text)


def comment_pattern(words: str, *, alone: bool = False) -> re.Pattern[bytes]:
    """Pattern of a comment of either style, whose groups :func:`said` returns.

    Parameters
    ----------
    words : str
        Pattern of what it says.
    alone : bool
        Whether it has to be all of its line, the end of which belongs to it.
    """
    either = rf"\({words}\)|; {words}(?=[ \t]*(?:[\r\n]|\Z))"
    if alone:
        either = rf"(?:\A|(?<=[\r\n]))(?:{either})[ \t]*(?:\r\n|\r|\n|\Z)"
    return re.compile(either.encode(), re.IGNORECASE)


def said(found: re.Match[bytes]) -> list[bytes]:
    """Return the groups of the pattern of words, which stands in that of a comment once a style.

    Examples
    --------
    >>> [said(comment_pattern(r"(a+)").fullmatch(text)) for text in (b"(aa)", b"; a")]
    [[b'aa'], [b'a']]
    """
    return [text for text in found.groups() if text is not None]


def find_last(data: bytes, words: str) -> int:
    """Place of the last comment that begins with these words behind the mark, -1 where there is none."""
    begins = [f"{before}{MARK}{words}" for before in _STYLES]
    return max(data.rfind(text.encode()) for one in begins for text in (one, one.upper()))


def has_marks(data: bytes) -> bool:
    """Whether a text holds such comments."""
    return find_last(data, "") >= 0
