"""The words of a Siemens program as a word table, by which it is changed in place.

A word of which the number alone may change in its place, as the centre ``I=AC(10)``, has its number there and the
character before it; of any other word all is there, so that ``X=IC(5)`` can become ``X15.0125``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Final

from ph_post.dialects.siemens import words as tables
from ph_post.dialects.siemens.words import Word
from ph_post.dialects.wordrows import OTHER, WordRows, sum_of

OWN_MODE: Final = 5.0
"""In the place of the G of a motion that has a word of its own: CIP, POLY, splines."""

_LETTERS: Final[Mapping[str, str]] = {"CR": "R", "I1": "I", "J1": "J", "K1": "K", "TURN": "P"}

_MOVING: Final = frozenset("XYZABCUVWIJKRF")
_POINTS: Final = frozenset(("I1", "J1", "K1"))
_NUMBER: Final = re.compile(r"[-+]?[ \t]*(?:\d+\.?\d*|\.\d+)(?:EX[-+]?\d+)?[ \t]*\)?[ \t]*\Z", re.IGNORECASE)
_NAMED: Final = re.compile(r"[A-Z]\w*[ \t]*=[ \t]*((?:AC|IC)[ \t]*\([ \t]*)?\Z", re.IGNORECASE)
_CLOSED: Final = re.compile(r"[ \t]*\)")


class SiemensRows(WordRows):
    """The rows of a word table in the making; `centred` are lines whose arc has a place as its centre."""

    def __init__(self) -> None:
        super().__init__()
        self.centred: list[int] = []

    def add(self, block: int, base: int, words: Sequence[Word], *, dwell: bool, absolute: bool) -> None:
        """Add the words of a line.

        Parameters
        ----------
        block, base : int
            The line, and the place of its first byte.
        words : sequence of Word
            Their values as the control has them in force.
        dwell : bool
            Whether a G4 stands among them: F is a time then, and S a number of turns.
        absolute : bool
            Whether ends without AC or IC are places.
        """
        for word in words:
            letter, value = _letter_and_value(word, dwell=dwell)
            begin, end = word.column - 1, word.column - 1 + len(word.text.rstrip())
            if letter in "IJK" and value is not None and _is_place(word, absolute):
                number = _NUMBER.search(word.text)
                if number is not None:
                    begin += number.start() - 1
                    end = begin + 1 + len(number[0].rstrip(" \t)"))
                    self.centred.append(block)
            self.put(block, letter, base + begin, base + end, value)


def whole_word(line: str, start: int, end: int) -> tuple[int, int]:
    """Return where a word begins and ends of which the table has the number, or all.

    Examples
    --------
    >>> line = "G2 X1 Y2 I=AC(10) J1=4"
    >>> [line[slice(*whole_word(line, *span))] for span in ((3, 5), (13, 16), (20, 22))]
    ['X1', 'I=AC(10)', 'J1=4']
    """
    if line[start].isalpha():
        return start, end
    named = _NAMED.search(line, 0, start + 1)
    if named is None:
        return start, end
    closed = _CLOSED.match(line, end) if named[1] else None
    return named.start(), closed.end() if closed else end


def _letter_and_value(word: Word, *, dwell: bool) -> tuple[str, Decimal | None]:
    if word.kind == "keyword" and (word.name in ("CIP", "POLY") or word.name in tables.OTHER_MOTIONS):
        return "G", Decimal(str(OWN_MODE))
    name = _LETTERS.get(word.name, word.name)
    plain = word.kind == "number" and word.function in ("", "AC", "IC", "FPO", "PO")
    if word.kind in ("computed", "assigned") and name in _MOVING:
        return name, None
    if not plain or len(name) != 1 or not name.isalpha() or name == "N" or (dwell and name == "S"):
        return OTHER, sum_of(word.text.strip())
    value = Decimal(word.values[0])
    if dwell and name == "F":
        return "P", value
    return name, value + 1 if word.name == "TURN" else value


def _is_place(word: Word, absolute: bool) -> bool:
    """Return True if a centre, or a point on a circle, is given as a place."""
    if word.name in _POINTS:
        return word.function == "AC" or (absolute and not word.function)
    return word.function == "AC"
