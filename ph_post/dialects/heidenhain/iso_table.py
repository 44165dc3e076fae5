"""The words of an ISO program of Heidenhain as a word table, and new blocks, by which it is changed in place.

A centre stands in a block of its own (I, J, K), and lasts. Where a program ends its blocks in an asterisk, new ones do.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal
from typing import Final

from ph_post.dialects.heidenhain.tnc import NUMBER, number_of
from ph_post.dialects.wordrows import OTHER, WordRows, sum_of
from ph_post.gcode.program import AXES, CENTERS

PLAIN: Final = frozenset((0, 1, 2, 3, 17, 18, 19, 40, 41, 42, 90, 91))
"""G words of blocks that move, which are kept where they stand."""
ISO_WORD: Final = re.compile(rf"([A-Z])\s*({NUMBER}|[-+]?Q[LRS]?\d+|MAX)", re.IGNORECASE)
_PREFIX: Final = re.compile(r"\s*(?:N\s*\d+)?\s*", re.IGNORECASE)
_EXACT: Final = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)")
_SHORT: Final = re.compile(r"\bG([0-4])(?!\d)")
_DWELL: Final = 4


def iso_parts(line: str) -> tuple[str, str, str]:
    """Return number, words and comment of a line, without the asterisk.

    Examples
    --------
    >>> iso_parts("N20 G01 X+1 * ; fast")
    ('N20 ', 'G01 X+1', '; fast')
    """
    found = _PREFIX.match(line)
    begin = found.end() if found else 0
    words, mark, comment = line[begin:].partition(";")
    return line[:begin], words.rstrip().removesuffix("*").rstrip(), mark + comment


class IsoRows(WordRows):
    """The rows of the word table of an ISO program."""

    def add(self, block: int, base: int, line: str, feed: Decimal | None = None) -> None:
        """Add the words of a line whose first byte is at `base`; no parameter gives it a feed."""
        assert feed is None
        number, bare, _ = iso_parts(line)
        base += len(number)
        if not bare or bare.startswith("%"):
            return
        found = list(ISO_WORD.finditer(bare))
        codes = [int(one[2]) for one in found if one[1].upper() == "G" and one[2].isdecimal()]
        if codes == [_DWELL] and [one[1].upper() for one in found] == ["G", "F"]:
            self.put(block, "G", base, base + found[0].end(), Decimal(_DWELL))
            self.put(block, "P", base + found[1].start(), base + found[1].end(), number_of(found[1][2].upper()))
        elif {*codes} - PLAIN or any(one[1].upper() in "TDLN" for one in found) or ISO_WORD.sub("", bare).strip():
            self.put(block, OTHER, base, base + len(bare), sum_of(bare))
        else:
            self._words(block, base, found)

    def _words(self, block: int, base: int, found: Sequence[re.Match[str]]) -> None:
        for one in found:
            letter, text = one[1].upper(), one[2]
            start, end = base + one.start(), base + one.end()
            if letter in "GM":
                self.put(block, letter, start, end, Decimal(text) if text.isdecimal() else None)
            elif letter in (*AXES, *CENTERS.values()):
                self.put(block, letter, start, end, Decimal(text) if _EXACT.fullmatch(text) else None)
            elif letter in "RF" and _EXACT.fullmatch(text):
                self.put(block, letter, start, end, Decimal(text))


class IsoSpelling:
    """Blocks in the order of the manual, with a circle's centre in a block of its own."""

    def lines(self, mode: str, words: Sequence[str], rest: str = "", head: str = "") -> list[str]:
        """Return the blocks of a motion, with further words.

        Examples
        --------
        >>> IsoSpelling().lines("G3", ["X+1", "Y+2", "I+0", "J+2", "F500"])
        ['I+0 J+2', 'G03 X+1 Y+2 F500']
        """
        centre = [word for word in words if word[0] in "IJK"]
        places = [word for word in words if word[0] in "XYZ"]
        tail = [word for word in words if word[0] == "R" or (word[0] == "F" and mode != "G0")]
        block = " ".join(one for one in [f"G0{mode[1:]}", head, *places, *tail, rest] if one)
        return [" ".join(centre), block] if centre else [block]

    def first(self, line: str, mode: str, words: Sequence[str], later: Sequence[float]) -> list[str]:
        """Return a block with other words of its motion; M functions `later` are left out.

        Examples
        --------
        >>> IsoSpelling().first("N70 G00 G40 X+9 M8 * ; far", "G1", ["X+5", "F200"], ())
        ['N70 G01 G40 X+5 F200 M8 ; far']
        """
        number, bare, comment = iso_parts(line)
        kept = [(one[1].upper(), one[2], one[0]) for one in ISO_WORD.finditer(bare)]
        head = " ".join(text for letter, code, text in kept if letter == "G" and int(code) > 3)
        rest = [text for letter, code, text in kept if letter not in "GXYZIJKRFM"]
        rest += [text for letter, code, text in kept if letter == "M" and float(code) not in later]
        made = self.lines(mode, words, " ".join(rest), head)
        made[0] = number + made[0]
        made[-1] += f" {comment}" if comment else ""
        return made

    def centre(self, place: Sequence[str]) -> str:
        """Return the block of a circle's centre."""
        return " ".join(CENTERS[word[0]] + word[1:] for word in place)

    def ended(self, line: str, data: bytes) -> str:
        """Return a new line as a program of these bytes ends its blocks.

        Examples
        --------
        >>> IsoSpelling().ended("G1 X+5 ; far", b"%A G71 *")
        'G01 X+5 * ; far'
        """
        words, mark, comment = _SHORT.sub(r"G0\1", line).partition(";")
        if not words.strip() or b"*" not in data or line.rstrip().endswith("*"):
            return words + mark + comment
        return f"{words.rstrip()} *{' ' if mark else ''}{mark}{comment}"
