"""Words of a line in Siemens language, and tables of their RS274 equivalents.

The words are those of the manuals that :mod:`ph_post.dialects.siemens.dialect` names.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from decimal import Decimal
from typing import Final, Literal

import msgspec

from ph_post.dialects.reading import Remark

SAME: Final = (0, 1, 2, 3, 17, 18, 19, 40, 41, 42, 53, 54, 55, 56, 57, 64, 93, 94, 95)
"""G words that are the same in both."""

G_WORDS: Final[Mapping[str, str]] = {
    **{f"G{number}": f"G{number}" for number in SAME},
    **{f"G64{kind}": "G64" for kind in range(1, 7)},
    **dict.fromkeys(["G9", "G601", "G602", "G603", "G290", "G450", "G451", "G460", "G461", "G462"], ""),
    "G60": "G61",
    "G70": "G20",
    "G71": "G21",
    "G710": "G21",
    "G700": "G20",
    "G74": "G28",
    "G75": "G28",
    "G153": "G53",
    "G500": "G59.1",
    "G96": "G95",
    "G97": "G95",
    "G961": "G94",
    "G971": "G94",
    # Of ISO mode (G291); Siemens's own has no such words, and stops there with an alarm.
    "G43": "G43",
    "G44": "G43",
    "G49": "G49",
}
"""What G words are in RS274; those of measures (G90, G91), dwells and frames are read by themselves."""

MOTIONS: Final = frozenset(("G0", "G1", "G2", "G3"))
OTHER_MOTIONS: Final = frozenset(("ASPLINE", "BSPLINE", "CSPLINE", "CT", "INVCW", "INVCCW"))
LIMITS: Final = frozenset(("G25", "G26"))
"""Limits of speeds and working areas: their axis words are no motion."""

M_WORDS: Final = frozenset((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 30))
ENDS: Final = frozenset((17,))
LENGTHS: Final = frozenset(("G70", "G71", "G700", "G710"))
FEEDS: Final = frozenset(("G93", "G94", "G95", "G96", "G97", "G961", "G971"))
QUIET_M: Final = frozenset((40, 41, 42, 43, 44, 45, 70))
"""M words of the spindle's gears."""

_QUIET_WORDS: Final = """
COMPOF COMPON COMPCURV COMPCAD COMPSURF SOFT BRISK DRIVE SPATH FFWON FFWOF CFC CFTCP CFIN DYNNORM DYNPOS
DYNROUGH DYNSEMIFIN DYNFINISH DYNPREC NORM KONT CDOF CDON STOPRE STARTFIFO STOPFIFO FIFOCTRL WALIMON WALIMOF
RTLION RTLIOF TRAFOOF CUT2D CUT2DF SAVE DISPLOF DISPLON SBLOF SBLON CPRECON CPRECOF
"""
QUIET: Final = frozenset(_QUIET_WORDS.split())
"""Words that change how the axes follow: none of them is a motion."""

QUIET_CALLS: Final = frozenset(("MSG", "WORKPIECE", "GROUP_BEGIN", "GROUP_END", "GROUP_ADDEND", "CYCLE832", "SETMS"))
QUIET_NAMES: Final = frozenset(["ADIS", "ADISPOS", "CTOL", "OTOL", "ATOL", "SPOS", "SPOSA", "SVC", "LIMS"])
DECLARATIONS: Final = frozenset(["DEF", "PROC", "EXTERN"])
CYCLES: Final = re.compile(r"CYCLE\d+|HOLES\d|POCKET\d|SLOT\d|LONGHOLE|E_\w+")
"""Names of cycles, which leave the modes as they were; any other is that of a subprogram."""

_TURNING_WORDS: Final = """
ROT AROT ROTS AROTS CROTS SCALE ASCALE MIRROR AMIRROR TRAORI TRANSMIT TRACYL TRAANG TRAFOON CYCLE800 TOFRAME
TOFRAMEX TOFRAMEY TOFRAMEZ TOROT TOROTX TOROTY TOROTZ PAROT
"""
FRAMES: Final[Mapping[str, str]] = {
    "TRANS": "G69",
    "ATRANS": "",
    "G58": "",
    "G59": "",
    "G258": "G68",
    "G259": "G68",
    "TOROTOF": "",
    "PAROTOF": "",
    **dict.fromkeys(_TURNING_WORDS.split(), "G68"),
}
"""Words that move the frame (empty), turn it (G68), or replace what the program made by what is only moved (G69).

G258 and G259 turn it on SINUMERIK 802S and 802C (Operation and Programming, 08/2003, 6FC5598-4AA11-0BP0, "Programmable
zero offset and rotation").
"""
FRAME_VARIABLE: Final = re.compile(r"\$P_\w*FR(?:AME|MASK)?")
"""Frames as variables, without an index: $P_PFRAME is the program's own, $P_UIFR are settable ones (Programming Manual,
Job Planning, 07/2010, 6FC5398-2BP40-2BA0, "Coordinate transformation via frame variables")."""
MOVED_ONLY: Final = re.compile(r",(?:TR|FI)\]=|,(?:RT|MI)\]=0+\.?0*$|,SC\]=1\.?0*$|=(?:CTRANS|CFINE)\([^()]*\)$")
"""Settings of such a variable that turn, scale and mirror nothing."""

PROGRAMMABLE: Final = frozenset(
    ("TRANS", "ATRANS", "G58", "G59", "ROT", "AROT", "SCALE", "ASCALE", "MIRROR", "AMIRROR", "$P_PFRAME")
)
"""Words of the frame that a program makes, $P_PFRAME: the last of a chain, in which those of a swivelled plane or a
transformation stand before it (Function Manual, K2, 08/2005, 6FC5397-0BP10-0BA0, p. 1-7). TRANS, ROT, SCALE and MIRROR
replace it; one of `CLEARING` alone leaves nothing of it (SINUMERIK ONE NC Programming, 12/2019, 6FC5398-2EP40-0BA0,
2.12, where each has a block of its own, p. 309)."""

COURSES: Final[Mapping[str, bool | None]] = {"FNORM": False, "FLIN": True, "FCUB": None}
"""Words of how the feed comes to be F: at once, linearly, or on curves through all of them, which are not followed."""

CLEARING: Final = frozenset(("ROT", "SCALE", "MIRROR"))

UNREAD_MEASURE: Final = "G16"
"""A frame in which no motion is read, and which no word of a Siemens program ends."""

DIAMETERS: Final[Mapping[str, str]] = {"DIAMON": "G7", "DIAM90": UNREAD_MEASURE, "DIAMOF": "G8"}
"""DIAM90 has places in diameters and increments in radii, as no word of RS274 has it."""


class PolynomialWords(msgspec.Struct, frozen=True, kw_only=True):
    """A POLY block over [0, `length`].

    `axes` has each axis' coefficients of p², p³, …; `below` the denominator's value at the end and then those
    of its own, empty where there is none.
    """

    axes: Mapping[str, tuple[float, ...]]
    below: tuple[float, ...]
    length: float


class CircleWords(msgspec.Struct, frozen=True, kw_only=True):
    """A circle through a point: by axis in the program's units, from the start where it is not absolute."""

    point: Mapping[str, float]
    absolute: bool


class FeedProfileWords(msgspec.Struct, frozen=True, kw_only=True):
    """Feed of a block in the program's units: its end, and the coefficients of p² and p³."""

    end: float
    quad: float = 0.0
    cub: float = 0.0


class Extras(msgspec.Struct, frozen=True, kw_only=True):
    """By line, what RS274 has no words for, and what is not understood."""

    polynomials: dict[int, PolynomialWords]
    circles: dict[int, CircleWords]
    profiles: dict[int, FeedProfileWords]
    remarks: dict[int, Remark]


Kind = Literal["number", "call", "keyword", "computed", "assigned"]

_NUMBER: Final = r"[-+]?[ \t]*(?:\d+\.?\d*|\.\d+)(?:EX[-+]?\d+)?"
_SPACE: Final = re.compile(r"[\s&]+")
_BLANKS: Final = re.compile(r"[ \t]+")
_POLYNOMIAL: Final = re.compile(r"PO[ \t]*\[[ \t]*(\w*)[ \t]*\][ \t]*=[ \t]*\(([^()]*)\)", re.IGNORECASE)
_FUNCTION: Final = re.compile(r"([A-Z]\w*)[ \t]*=[ \t]*(PO|FPO|AC|IC)[ \t]*\(([^()]*)\)", re.IGNORECASE)
_VALUE: Final = re.compile(rf"([A-Z]\w*)[ \t]*=[ \t]*({_NUMBER})(?![\w.]*[ \t]*[-+*/(\[])", re.IGNORECASE)
_ADDRESS: Final = re.compile(rf"([A-Z])[ \t]*({_NUMBER})(?!\d*[ \t]*[=\[])", re.IGNORECASE)
_COMPUTED: Final = re.compile(r"([A-Z$_][\w$]*(?:\[[^\]]*\])?)[ \t]*=(?!=)[ \t]*", re.IGNORECASE)
_NAME: Final = re.compile(r"[A-Z_$][\w$]*", re.IGNORECASE)
_PLAIN: Final = re.compile(rf"{_NUMBER}\Z", re.IGNORECASE)


class Word(msgspec.Struct, frozen=True, kw_only=True):
    """One word of a line.

    `name` in capitals; `values` as decimal numbers in text: one of an address, those in parentheses of a
    `function` (PO, FPO, AC, IC; empty for others). `kind` is "number", "call" (a name with parentheses),
    "keyword", "assigned" (a string, or to what is no address) or "computed" (a value that is no plain
    number). `text` is the word, `column` where it begins, from 1.
    """

    kind: Kind
    name: str
    values: tuple[str, ...]
    text: str
    column: int
    function: str = ""


def without_comment(line: str) -> str:
    """Return what stands before the semicolon of a comment, which may stand in a string.

    Examples
    --------
    >>> without_comment('MSG("a;b") ; words')
    'MSG("a;b") '
    """
    quoted = False
    for place, letter in enumerate(line):
        quoted ^= letter == '"'
        if letter == ";" and not quoted:
            return line[:place]
    return line


def read_words(line: str) -> list[Word] | None:
    """Read the words of a line without its comment; None where it holds something that is none.

    Examples
    --------
    >>> [(word.name, word.function, word.values) for word in read_words("POLY PO[X]=(1,.5) Y=IC(2) F=FPO(9)")]
    [('POLY', '', ()), ('X', 'PO', ('1', '0.5')), ('Y', 'IC', ('2',)), ('F', 'FPO', ('9',))]
    """
    words: list[Word] = []
    place = 0
    while True:
        gap = _SPACE.match(line, place)
        place = gap.end() if gap else place
        if place == len(line):
            return words
        found = _word_at(line, place)
        if found is None:
            return None
        word, place = found
        words.append(word)


def _word_at(line: str, place: int) -> tuple[Word, int] | None:
    if found := _POLYNOMIAL.match(line, place):
        return _listed(found, found[1], "PO", found[2])
    if found := _FUNCTION.match(line, place):
        return _listed(found, found[1], found[2].upper(), found[3])
    if found := _VALUE.match(line, place) or _ADDRESS.match(line, place):
        return _made(found, "number", found[1], (plain_number(found[2]),))
    return _computed(line, place) or _named(line, place)


def _computed(line: str, place: int) -> tuple[Word, int] | None:
    """Read a word whose value is an expression: up to the next blank outside of parentheses and strings."""
    found = _COMPUTED.match(line, place)
    if found is None:
        return None
    end = _past(line, found.end(), until=" \t")
    text = line[place:end]
    word = Word(kind="computed", name=found[1].upper(), values=(), text=text, column=place + 1)
    return word, end


def _named(line: str, place: int) -> tuple[Word, int] | None:
    """Read a keyword, or a call with what stands in its parentheses."""
    found = _NAME.match(line, place)
    if found is None:
        return None
    end = found.end()
    kind: Kind = "keyword"
    behind = _BLANKS.match(line, end)
    opened = behind.end() if behind else end
    if line[opened : opened + 1] == "(":
        end, kind = _closed(line, opened), "call"
    word = Word(kind=kind, name=found[0].upper(), values=(), text=line[place:end], column=place + 1)
    return word, end


def _listed(found: re.Match[str], name: str, function: str, inside: str) -> tuple[Word, int]:
    values = [part.strip() for part in inside.split(",")]
    if not all(_PLAIN.match(value) or not value for value in values):
        return _made(found, "computed", name, ())
    numbers = tuple(plain_number(value) if value else "0" for value in values)
    return _made(found, "number", name, numbers, function)


def _made(found: re.Match[str], kind: Kind, name: str, values: tuple[str, ...], function: str = "") -> tuple[Word, int]:
    word = Word(
        kind=kind,
        name=name.upper(),
        values=values,
        text=found[0],
        column=found.start() + 1,
        function=function,
    )
    return word, found.end()


def plain_number(text: str) -> str:
    """Write a number without blanks, exponent (EX) and plus sign.

    Examples
    --------
    >>> plain_number("-.1EX-3"), plain_number("+ 5.50")
    ('-0.0001', '5.50')
    """
    number = Decimal(re.sub(r"[ \t]", "", text).upper().replace("EX", "E"))
    return format(number, "f")


def _past(line: str, place: int, until: str) -> int:
    depth, quoted = 0, False
    while place < len(line):
        letter = line[place]
        quoted ^= letter == '"'
        depth += 0 if quoted else (letter in "([") - (letter in ")]")
        if depth <= 0 and not quoted and letter in until:
            return place
        place += 1
    return place


def _closed(line: str, opened: int) -> int:
    """Return the place behind the parenthesis that closes the one at `opened`, or the end of the line."""
    depth, quoted = 0, False
    for place in range(opened, len(line)):
        letter = line[place]
        quoted ^= letter == '"'
        depth += 0 if quoted else (letter == "(") - (letter == ")")
        if depth == 0:
            return place + 1
    return len(line)
