"""How programs of lathes are told from those of mills, and which lines of Fanuc's a cycle takes as data.

FANUC Series 30i/31i/32i-MODEL B, Operator's Manual for Lathe System, B-64484EN-1: G50 with S alone is the spindle's
highest speed (G code system A), G70 to G73 with P and Q are multiple repetitive cycles, and the blocks from the
sequence number P to Q are the finished shape, which is cut by the cycles alone.
"""

from __future__ import annotations

import re
from typing import Final

_CYCLE: Final = re.compile(rb"G7[0-3](?![\d.])[^\n\r;]*")
_SHAPE: Final = {letter: re.compile(rb"%s\s*0*(\d+)" % letter.encode()) for letter in "PQ"}
_OTHERS: Final = re.compile(rb"[XYZR]\s*[-+.\d]")
_FASTEST: Final = re.compile(rb"G50\s*S\s*\d")
_SURFACE: Final = re.compile(rb"G96(?![\d.])")

_FEED: Final = re.compile(rb"G[ \t]*0*4(?![.\d])[^\r\n]*|(?<![A-Z_])F[ \t]*(?:=[ \t]*)?(\d+\.?\d*|\.\d+)")
"""A feed; beside G4 of Siemens F is a time."""

SLOWEST: Final = 2.0
"""Feeds [mm/min or inch/min] up to which all of a program are more likely feeds a turn [mm or inch]."""

TURNED_NOTE: Final = "holds for a lathe, where X is a diameter"
"""Note in the head of compensated programs of lathes, by which they are known as such whatever feeds were added."""

_GROUP_1: Final = re.compile(rb"G0*(?:[0123]|32|34)(?![\d.])")
_PLACES: Final = re.compile(rb"[XZUW]\s*[-+.\d]")
_DISTANCE: Final = re.compile(rb"G9([01])(?![\d.])")
_LABEL: Final = re.compile(rb"[ \t/]*N[ \t]*0*(\d+)")
_LINE: Final = re.compile(rb"\r\n|\r|\n")
_OFFSET: Final = re.compile(rb"T\d{4}(?!\d)")
"""A tool and its offset, as lathes call them."""

_OWN: Final = re.compile(rb"G0*28(?!\d)[^\n\r]*U|G0*96(?!\d)")


def is_turned(data: bytes, bare: bytes) -> bool:
    r"""Return whether a program of Fanuc's is one of a lathe: it has words that no mill has.

    Those that `--expand` wrote out stand in comments, and are found there, and so is the note in the head of a
    compensated program. It is one of a lathe, too, that moves X and Z alone, at feeds that are none a minute, or with
    tools called as T0101 and G28 U or G96.

    Parameters
    ----------
    data, bare : bytes
        The program, and the same in capitals without its comments.

    Examples
    --------
    >>> turned = lambda text: is_turned(text, text)
    >>> turned(b"G50 S2500\nG96 S200 M3\n"), turned(b"G71 P10 Q20 U0.4 W0.1 F0.2\n")
    (True, True)
    >>> turned(b"G0 X20. Z1.\nG1 Z-5. F0.1\n"), turned(b"G0 X20. Z1.\nG1 Z-5. F100.\n")
    (True, False)
    >>> turned(b"G28 U0 W0\nT0101\nG0 X80. Z2.\n"), turned(b"G28 U0\nT0101\nG0 X80. Y2.\n")
    (True, False)
    >>> turned(b"G50\nG0 X1. S2500\n"), turned(b"G73 X1. Z-5. R1. Q2. P100\n")
    (False, False)
    """
    text = data.upper()
    if TURNED_NOTE.upper().encode() in text:
        return True
    if b"G50" in text and _FASTEST.search(text) and _SURFACE.search(text):
        return True
    if b"G7" in text and any(_shape_of(found[0]) is not None for found in _CYCLE.finditer(text)):
        return True
    if b"X" not in bare or b"Z" not in bare or b"Y" in bare:
        return False
    return (_OFFSET.search(text) is not None and _OWN.search(text) is not None) or has_feeds_per_turn(bare)


def has_feeds_per_turn(bare: bytes) -> bool:
    """Return whether all feeds of a program are too slow for any a minute.

    Parameters
    ----------
    bare : bytes
        The program in capitals, without comments.

    Examples
    --------
    >>> [has_feeds_per_turn(text) for text in (b"G1 X1 F.2", b"F0.2 G1 X1 F100", b"G1 X1", b"G4 F0.01")]
    [True, False, False, False]
    """
    feeds = [float(found[1]) for found in _FEED.finditer(bare) if found[1]]
    return bool(feeds) and max(feeds) <= SLOWEST


def _shape_of(line: bytes) -> tuple[bytes, bytes] | None:
    """Return the digits, without zeros ahead, of a shape's sequence numbers; None of a line that is no such cycle."""
    if _OTHERS.search(line):
        return None
    first, last = (pattern.search(line) for pattern in (_SHAPE["P"], _SHAPE["Q"]))
    return None if first is None or last is None else (first[1].lstrip(b"0"), last[1].lstrip(b"0"))


def has_increments_by_words(bare: bytes) -> bool:
    r"""Return whether a lathe's program is of G code system A, in which U and W are increments and G90 is a cycle.

    In the systems B and C G90 and G91 say what X and Z are: they stand beside another motion, or without places.
    `bare` is the program in capitals, without comments.

    Examples
    --------
    >>> has_increments_by_words(b"G99 G0 X5. W-2.\nG90 X40. Z-20. F0.2\n")
    True
    >>> has_increments_by_words(b"G90 G0 X5. Z1.\n"), has_increments_by_words(b"G21 G90 G95\n")
    (False, False)
    """
    for line in bare.splitlines():
        for found in _DISTANCE.finditer(line):
            if found[1] == b"1" or _GROUP_1.search(line) or not _PLACES.search(line):
                return False
    return True


def shapes_of(bare: bytes) -> list[tuple[int, int]]:
    r"""Return the first and last lines of the shapes that cycles take, from 0.

    Where sequence numbers stand more than once, all stretches that they may mean. `bare` is the program in capitals,
    without comments.

    Examples
    --------
    >>> shapes_of(b"G71 P1 Q2 U.4 W.1\nN1 G0 X1.\nN2 G1 Z-1.\nG70 P1 Q2\n")
    [(1, 2)]
    """
    asked = {shape for found in _CYCLE.finditer(bare) if (shape := _shape_of(found[0])) is not None}
    if not asked:
        return []
    labels: dict[bytes, list[int]] = {}
    for number, line in enumerate(_LINE.split(bare)):
        label = _LABEL.match(line)
        if label is not None:
            labels.setdefault(label[1].lstrip(b"0"), []).append(number)
    found = set()
    for first, last in asked:
        for begin in labels.get(first, []):
            end = next((line for line in labels.get(last, []) if line >= begin), None)
            if end is not None:
                found.add((begin, end))
    return sorted(found)
