"""The words of a conversational program as a word table, and new blocks, by which it is changed in place.

Ends and centres have their words where they stand. An increment has no number that could be shifted, as it counts from
a place that is shifted already. ``CC`` has the centre of the circle behind it, as I, J and K.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Sequence
from decimal import Decimal
from typing import Final

import numpy as np

from ph_post.gcode.program import AXES, CENTERS, WordTable
from ph_post.types import sealed

_NUMBER: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)"
_PREFIX: Final = re.compile(r"\s*(?:\d+(?=\s|$))?\s*")
_KEYWORD: Final = re.compile(r"(?:CC|CR|CP|C|L)(?![A-Z])", re.IGNORECASE)
_TOKEN: Final = re.compile(
    rf"(?P<angle>I?PA\s*[-+]?(?:[\d.,]+|Q[LRS]?\d+))|(?P<place>(?P<step>I?)(?P<axis>[XYZABCUVW])\s*(?P<number>{_NUMBER}(?![\d.,])|[-+]?Q[LRS]?\d+|[-+]?[\d.,]+))"
    rf"|(?P<sense>DR\s*[-+])|(?P<side>R[0LR](?![\d.]))|(?P<radius>R\s*(?P<length>{_NUMBER}))"
    rf"|(?P<rapid>F\s*MAX)|(?P<feed>F\s*(?P<speed>{_NUMBER}|Q[LRS]?\d+))|(?P<function>M\s*(?P<code>\d+))",
    re.IGNORECASE,
)
_DWELL: Final = re.compile(rf"CYCL\s+DEF\s+9\.1\b.*?({_NUMBER})\s*$", re.IGNORECASE)
_BEGINS_DWELL: Final = re.compile(r"CYCL\s+DEF\s+9\.0\b", re.IGNORECASE)
_TOOL: Final = re.compile(rf"TOOL\s+CALL\b.*?(?<![A-Z])F\s*({_NUMBER})", re.IGNORECASE)
_FUNCTIONS: Final = re.compile(r"(?:M\s*\d+\s*)+", re.IGNORECASE)
_OTHER: Final = "O"
_MOST: Final = 18


def parts_of(line: str) -> tuple[str, str, str]:
    """Return number, words and comment of a line.

    Examples
    --------
    >>> parts_of("12 L X+1 F200 ; fast")
    ('12 ', 'L X+1 F200 ', '; fast')
    """
    found = _PREFIX.match(line)
    begin = found.end() if found else 0
    at = line.find(";", begin)
    end = len(line) if at < 0 else at
    return line[:begin], line[begin:end], line[end:]


class WordRows:
    """The rows of a word table in the making."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, int, int, int, int, int]] = []
        self._feed = ""

    def add(self, block: int, base: int, line: str, feed: Decimal | None = None) -> None:
        """Add the words of a line whose first byte is at `base`; `feed` is what a parameter gives it."""
        self._feed = "" if feed is None else str(feed)
        number, words, _ = parts_of(line)
        base += len(number)
        bare = words.rstrip()
        if not bare or bare.startswith("*") or _BEGINS_DWELL.match(bare):
            return
        keyword = _KEYWORD.match(bare)
        dwell, tool = _DWELL.match(bare), _TOOL.match(bare)
        if dwell is not None:
            self._row(block, "G", base, base + len("CYCL"), "4")
            self._row(block, "P", base + dwell.start(1) - 1, base + dwell.end(1), dwell[1])
        elif _FUNCTIONS.fullmatch(bare):
            self._words(block, base, bare, centre=False)
        elif keyword is None:
            self._row(block, _OTHER, base, base + len(bare), str(zlib.crc32(bare.upper().encode()) % 10**6))
            if tool is not None:
                self._row(block, "F", base + tool.start(1) - 1, base + tool.end(1), tool[1])
        elif keyword[0].upper() == "CC":
            self._words(block, base, bare, centre=True)
        else:
            mode = "1" if keyword[0].upper() == "L" else "3" if re.search(r"DR\s*\+", bare, re.IGNORECASE) else "2"
            rapid = mode == "1" and re.search(r"F\s*MAX", bare, re.IGNORECASE) is not None
            self._row(block, "G", base, base + keyword.end(), "0" if rapid else mode)
            self._words(block, base, bare, centre=False)

    def _words(self, block: int, base: int, bare: str, *, centre: bool) -> None:
        keyword = _KEYWORD.match(bare)
        for found in _TOKEN.finditer(bare, keyword.end() if keyword else 0):
            if found["axis"]:
                axis = found["axis"].upper()
                letter = CENTERS[axis] if centre and axis in AXES else axis
                plain = not found["step"] and axis in AXES and re.fullmatch(_NUMBER, found["number"])
                self._row(
                    block, letter, base + found.start("axis"), base + found.end(), found["number"] if plain else ""
                )
            elif found["radius"]:
                self._row(block, "R", base + found.start(), base + found.end(), found["length"])
            elif found["feed"]:
                self._row(block, "F", base + found.start(), base + found.end(), self._feed or found["speed"])
            elif found["function"]:
                self._row(block, "M", base + found.start(), base + found.end(), found["code"])

    def _row(self, block: int, letter: str, start: int, end: int, number: str) -> None:
        digits, decimals = 0, -1
        if number and number[0].upper() != "Q":
            sign, figures, exponent = Decimal(number).as_tuple()
            if isinstance(exponent, int) and len(figures) <= _MOST and -exponent <= _MOST:
                digits, decimals = int("".join(map(str, figures))) * (-1 if sign else 1), max(-exponent, 0)
        self._rows.append((block, ord(letter), start, end, digits, decimals))

    def table(self) -> WordTable:
        """Return the table."""
        block, letter, start, end, digits, decimals = np.array(self._rows, dtype=np.int64).reshape(-1, 6).T
        value = np.where(decimals >= 0, digits / 10.0 ** np.maximum(decimals, 0), np.nan)
        return WordTable(
            block=sealed(block.astype(np.int32)),
            letter=sealed(letter.astype(np.uint8)),
            start=sealed(start.astype(np.int32)),
            end=sealed(end.astype(np.int32)),
            value=sealed(value),
            digits=sealed(digits),
            decimals=sealed(decimals.astype(np.int16)),
        )


_PLACES: Final = {center: axis for axis, center in CENTERS.items()}


class KlartextSpelling:
    """Conversational blocks in the place of RS274 words."""

    def lines(self, mode: str, words: Sequence[str], rest: str = "") -> list[str]:
        """Return the blocks of a motion, with further words.

        Examples
        --------
        >>> KlartextSpelling().lines("G3", ["X+1", "Y+2", "I+0", "J+2", "F500"])
        ['CC X+0 Y+2', 'C X+1 Y+2 DR+ F500']
        """
        places = [word for word in words if word[0] in "XYZ"]
        centre = [_PLACES[word[0]] + word[1:] for word in words if word[0] in _PLACES]
        radius = [word for word in words if word[0] == "R"]
        feed = ["FMAX"] if mode == "G0" else [word for word in words if word[0] == "F"]
        tail = [*([rest] if rest else []), *feed]
        if mode in ("G0", "G1"):
            return [" ".join(["L", *places, *tail])]
        sense = "DR+" if mode == "G3" else "DR-"
        if radius:
            return [" ".join(["CR", *places, *radius, sense, *tail])]
        return [" ".join(["CC", *centre]), " ".join(["C", *places, sense, *tail])]

    def first(self, line: str, mode: str, words: Sequence[str], later: Sequence[float]) -> list[str]:
        """Return a block with other words of its motion; M functions `later` are left out.

        Examples
        --------
        >>> KlartextSpelling().first("7 L X+9 R0 FMAX M8 ; far", "G1", ["X+5", "F200"], ())
        ['7 L X+5 R0 M8 F200 ; far']
        """
        number, bare, comment = parts_of(line)
        keyword = _KEYWORD.match(bare)
        kept = _TOKEN.sub(
            lambda found: found[0] if found["side"] or (found["code"] and float(found["code"]) not in later) else "",
            bare[keyword.end() if keyword else 0 :],
        )
        made = self.lines(mode, words, " ".join(kept.split()))
        made[0] = number + made[0]
        made[-1] += f" {comment}" if comment else ""
        return made

    def centre(self, place: Sequence[str]) -> str:
        """Return the block of a circle's centre."""
        return " ".join(["CC", *place])
