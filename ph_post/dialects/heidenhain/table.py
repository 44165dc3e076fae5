"""The words of a conversational program as a word table, and new blocks, by which it is changed in place.

Ends and centres have their words where they stand. An increment has no number that could be shifted, as it counts from
a place that is shifted already. ``CC`` has the centre of the circle behind it, as I, J and K.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal
from functools import lru_cache
from typing import Final

from ph_post.dialects.wordrows import OTHER, WordRows, sum_of
from ph_post.gcode.program import AXES, CENTERS

_NUMBER: Final = r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)"
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


class KlartextRows(WordRows):
    """The rows of the word table of a conversational program."""

    def add(self, block: int, base: int, line: str, feed: Decimal | None = None) -> None:
        """Add the words of a line whose first byte is at `base`; `feed` is what a parameter gives it."""
        number, words, _ = parts_of(line)
        base += len(number)
        bare = words.rstrip()
        if not bare or bare.startswith("*") or _BEGINS_DWELL.match(bare):
            return
        keyword = _KEYWORD.match(bare)
        dwell, tool = _DWELL.match(bare), _TOOL.match(bare)
        if dwell is not None:
            self.put(block, "G", base, base + len("CYCL"), Decimal(4))
            self.put(block, "P", base + dwell.start(1) - 1, base + dwell.end(1), _decimal(dwell[1]))
        elif _FUNCTIONS.fullmatch(bare):
            self._words(block, base, bare, feed, centre=False)
        elif keyword is None:
            self.put(block, OTHER, base, base + len(bare), sum_of(bare))
            if tool is not None:
                self.put(block, "F", base + tool.start(1) - 1, base + tool.end(1), _decimal(tool[1]))
        elif keyword[0].upper() == "CC":
            self._words(block, base, bare, feed, centre=True)
        else:
            mode = 1 if keyword[0].upper() == "L" else 3 if re.search(r"DR\s*\+", bare, re.IGNORECASE) else 2
            rapid = mode == 1 and re.search(r"F\s*MAX", bare, re.IGNORECASE) is not None
            self.put(block, "G", base, base + keyword.end(), Decimal(0 if rapid else mode))
            self._words(block, base, bare, feed, centre=False)

    def _words(self, block: int, base: int, bare: str, feed: Decimal | None, *, centre: bool) -> None:
        keyword = _KEYWORD.match(bare)
        for found in _TOKEN.finditer(bare, keyword.end() if keyword else 0):
            start, end = base + found.start(), base + found.end()
            if found["axis"]:
                axis = found["axis"].upper()
                letter = CENTERS[axis] if centre and axis in AXES else axis
                plain = not found["step"] and axis in AXES
                self.put(block, letter, base + found.start("axis"), end, _decimal(found["number"]) if plain else None)
            elif found["radius"]:
                self.put(block, "R", start, end, _decimal(found["length"]))
            elif found["feed"]:
                self.put(block, "F", start, end, _decimal(found["speed"]) if feed is None else feed)
            elif found["function"]:
                self.put(block, "M", start, end, Decimal(found["code"]))


def _decimal(text: str) -> Decimal | None:
    """Return a number, whose decimals may stand behind a comma; None of a parameter."""
    return Decimal(text.replace(",", ".")) if re.fullmatch(_NUMBER, text) else None


_PLACES: Final = {center: axis for axis, center in CENTERS.items()}


class KlartextSpelling:
    """Conversational blocks in the place of RS274 words."""

    def lines(self, mode: str, words: Sequence[str], rest: str = "") -> list[str]:
        """Return the blocks of a motion, with further words.

        Examples
        --------
        >>> KlartextSpelling().lines("G3", ["X+1", "Y+2", "I+0", "J+2", "F500"])
        ['CC X+0 Y+2', 'C X+1 Y+2 DR+ F500']
        >>> KlartextSpelling().lines("G2", ["X+1", "Y+2", "Z-3", "I+0", "J+2", "A-90.0000"])
        ['CC X+0 Y+2', 'CP IPA-90.0000 Z-3 DR-']
        """
        places = [word for word in words if word[0] in "XYZ"]
        turned = [word[1:] for word in words if word[0] == "A"]
        centre = [_PLACES[word[0]] + word[1:] for word in words if word[0] in _PLACES]
        radius = [word for word in words if word[0] == "R"]
        feed = ["FMAX"] if mode == "G0" else [word for word in words if word[0] == "F"]
        tail = [*([rest] if rest else []), *feed]
        if mode in ("G0", "G1"):
            return [" ".join(["L", *places, *tail])]
        sense = "DR+" if mode == "G3" else "DR-"
        if radius:
            return [" ".join(["CR", *places, *radius, sense, *tail])]
        pole = " ".join(["CC", *centre])
        if turned:
            rise = [word for word in places if word[0] not in {one[0] for one in centre}]
            return [pole, " ".join(["CP", f"IPA{turned[0]}", *rise, sense, *tail])]
        return [pole, " ".join(["C", *places, sense, *tail])]

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

    def ended(self, line: str, data: bytes) -> str:
        """Return a new line with the decimals where the program has them: behind commas, if it has none behind points.

        Examples
        --------
        >>> KlartextSpelling().ended("8 L X+5.25 R0 F79.5 ; 0.5", b"7 L X+1,500 R0 F100")
        '8 L X+5,25 R0 F79,5 ; 0.5'
        """
        if not _writes_commas(data):
            return line
        number, words, comment = parts_of(line)
        return number + _POINT.sub(",", words) + comment


_POINT: Final = re.compile(r"(?<=[A-Z+\-\d])(?<!DEF \d)(?<!DEF \d\d)\.(?=\d)")
"""A decimal point, and not that of the number of a cycle's block."""

_PLACED: Final = re.compile(rb"(?<![A-Z])[XYZ][ \t]*[-+]?\d*([.,])\d", re.IGNORECASE)


@lru_cache(maxsize=2)
def _writes_commas(data: bytes) -> bool:
    """Return whether the places of a program have their decimals behind commas, and none behind points."""
    return {found[1] for found in _PLACED.finditer(data)} == {b","}
