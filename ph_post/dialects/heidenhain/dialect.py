"""Heidenhain TNC, mills (TNC 320 to 640, iTNC 530, TNC 426): its conversational language and its ISO one.

Where the facts are from. HEIDENHAIN, TNC 320 User's Manual for Conversational Programming, 3/2014, 3.2: BEGIN
PGM, a name and MM in the first block, END PGM in the last, blocks numbered in rising order. iTNC 530 User's
Manual (340 49x), Conversational, 6.4 Path contours, Cartesian coordinates: L, CC, C with DR+ and DR-, CR with
the sign of R for the size of the arc, CT, FMAX for one block, R0, RL, RR. iTNC 530 User's Manual (340
49x-02), ISO programming, 6.4: G00 to G06, the circle's centre I, J, absolute, in a block of its own, in force
until the next; G29. TNC 320 ISO Programming User's Manual, 10/2017, 3.2: % with a name and G71 in the first
block, N99999999 in the last, an asterisk at the end of each; 17 Technical information: lengths with 4
decimals, feeds with 3, a dwell up to 3600 s with 3; F is the time of G04 and T the tolerance of G62. User's
Manual for Cycle Programming: cycle 9 DWELL TIME and cycle 32 TOLERANCE, in two lines each.

Looked up a second time: the input ranges, in the TNC 430 User's Manual, 13.3 (lengths 5.4, feeds 5.3, dwells
up to 3600.000 s); G62 as cycle 32, in the TNC 620 User's Manual for Cycle Programming (340 56x-03), 12.5;
both lines of cycles 9 and 32, in posts of CAM systems. Not confirmed by another manual: F as the time of G04
and T as the tolerance of G62.

Circles are written in the plane X, Y only, as those of other planes hang on the tool's axis in TOOL CALL,
which is not touched. There is no inverse time; SPL, the cubic polynomials of the iTNC 530 alone, an option,
is neither written nor read. The option ``tolerance``, behind a plus sign, sets cycle 32 (G62) to the chord
tolerance while the tool cuts; without it the machine's own tolerance is in force.

Programs are changed in place; new blocks have no number, as the control numbers the blocks itself in ascending order
(TNC 620 User's Manual, Conversational Programming, 10/2017, 4.2). Not confirmed by a manual: that it reads a file in
which some blocks have no number.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from msgspec.structs import replace

from ph_post.dialects.base import BUILT_PATH, Abilities, Dialect, DwellWords, Notices, NumberFormat, Syntax, end_remark
from ph_post.dialects.heidenhain.iso import read_tnc_iso, why_iso_stays
from ph_post.dialects.heidenhain.iso_table import IsoSpelling
from ph_post.dialects.heidenhain.klartext import read_klartext
from ph_post.dialects.heidenhain.table import KlartextSpelling
from ph_post.dialects.lines import LineWriter
from ph_post.gcode.blocks import Moves
from ph_post.gcode.language import Language
from ph_post.gcode.numbers import SEMICOLON, decimal_text, to_counts

_DECIMALS: Final = 4
_FEED_DECIMALS: Final = 3
_TIME_DECIMALS: Final = 3
_MAX_LINE: Final = 100
_NAME: Final = 16
"""Letters of a program's name: every TNC takes so many."""
_STEP: Final = 10
"""Between the numbers of ISO blocks."""
_LAST: Final = "N99999999"

_ASSUMED: Final = (
    "assumed: datum set, not rotated, feed override 100 percent, tool called with axis Z and spindle on as set before",
    end_remark("M30"),
)


class CycleDwell(DwellWords, frozen=True, kw_only=True):
    """A dwell as cycle 9, in two blocks."""

    def words(self, seconds: float, digits: int) -> list[str]:
        """Return both blocks, with a line feed between them."""
        return [f"CYCL DEF 9.0 DWELL TIME\nCYCL DEF 9.1 DWELL {self.number(seconds, digits)}"]


_LAST_BLOCK: Final = re.compile(rb"^[ \t]*(?:\d+[ \t]+)?END[ \t]+PGM\b[^\r\n]*\s*\Z", re.IGNORECASE | re.MULTILINE)

_CONVERSATIONAL: Final = Language(
    name="heidenhain",
    read=read_klartext,
    parentheses=False,
    lone_modes=frozenset(),
    spelling=KlartextSpelling(),
    modal=False,
    after_motion=(0.0, 1.0, 2.0, 5.0, 9.0, 30.0),
    closing=_LAST_BLOCK,
    further="",
)


_ISO: Final = replace(
    _CONVERSATIONAL,
    name="heidenhain-iso",
    read=read_tnc_iso,
    spelling=IsoSpelling(),
    modal=True,
    stays=why_iso_stays,
    closing=re.compile(rb"^[ \t]*N9999\d*[ \t]*%[^\r\n]*\s*\Z", re.IGNORECASE | re.MULTILINE),
)


class KlartextLines(LineWriter):
    """Writes conversational blocks."""

    def write_straight(self, word: str, body: list[str], feed: str) -> None:
        """Write a straight move; rapid traverse holds for its block alone."""
        tail = ["R0", "FMAX"] if word == "G0" else ["R0", *self._speed(feed)]
        self.lines.append(" ".join(["L", *body, *tail]))

    def write_arc(self, moves: Moves, i: int, body: list[str], feed: str) -> None:
        """Write the pole, and the arc about it."""
        self.lines.append(" ".join(["CC", *self._place(moves.center[i])]))
        sense = "DR+" if self._left(moves, i) else "DR-"
        self.lines.append(" ".join(["C", *body[:2], sense, *self._speed(feed)]))

    def write_dwell(self, seconds: float) -> None:
        """Write cycle 9."""
        time = self.syntax.dwell.number(seconds, self.dialect.numbers.feed_digits)
        self.lines += ["CYCL DEF 9.0 DWELL TIME", f"CYCL DEF 9.1 DWELL {time}"]


class IsoLines(LineWriter):
    """Writes ISO blocks."""

    def write_straight(self, word: str, body: list[str], feed: str) -> None:
        """Write a straight move."""
        tail = [] if word == "G0" else self._speed(feed)
        self.lines.append(" ".join(["G00" if word == "G0" else "G01", *body, *tail]))

    def write_arc(self, moves: Moves, i: int, body: list[str], feed: str) -> None:
        """Write the centre, and the arc about it."""
        centre = zip("IJ", moves.center[i].tolist(), strict=True)
        self.lines.append(" ".join(letter + self._length(count) for letter, count in centre))
        word = "G03" if self._left(moves, i) else "G02"
        self.lines.append(" ".join([word, *body[:2], *self._speed(feed)]))


def program_name(name: str) -> str:
    """Name of a program in the letters that a TNC takes.

    Examples
    --------
    >>> program_name("outline of a pocket")
    'OUTLINE_OF_A_POC'
    """
    return re.sub(r"[^A-Z0-9]+", "_", name.upper()).strip("_")[:_NAME] or "PROGRAM"


def finish_klartext(lines: Sequence[str], name: str) -> Sequence[str]:
    """Put a program into its frame, and number its blocks.

    Examples
    --------
    >>> finish_klartext(["M30"], "a")
    ['0 BEGIN PGM A MM', '1 M30', '2 END PGM A MM']
    """
    called = program_name(name)
    blocks = [f"BEGIN PGM {called} MM", *lines, f"END PGM {called} MM"]
    return [f"{number} {block}" for number, block in enumerate(blocks)]


def finish_iso(lines: Sequence[str], name: str) -> Sequence[str]:
    """Put a program into its frame, number its blocks and end each.

    Examples
    --------
    >>> finish_iso(["G90"], "a")
    ['%A G71 *', 'N10 G90 *', 'N99999999 %A G71 *']
    """
    called = program_name(name)
    blocks = [
        f"N{_STEP * number} {line}" + ("" if line.startswith(";") else " *") for number, line in enumerate(lines, 1)
    ]
    return [f"%{called} G71 *", *blocks, f"{_LAST} %{called} G71 *"]


def _tolerance(length: float) -> str:
    return decimal_text(max(1, int(to_counts(length, _DECIMALS))), _DECIMALS)


def _cycle_32(tolerance: float | None) -> str:
    """Cycle 32, and without a tolerance the machine's own again."""
    value = "" if tolerance is None else f" T{_tolerance(tolerance)}"
    return f"CYCL DEF 32.0 TOLERANCE\nCYCL DEF 32.1{value}"


def _g62(tolerance: float | None) -> str:
    return "G62" if tolerance is None else f"G62 T{_tolerance(tolerance)}"


def _with_path_mode(dialect: Dialect, path_mode: Callable[[float | None], str]) -> Dialect:
    return replace(dialect, syntax=replace(dialect.syntax, path_mode=path_mode))


DIALECT = Dialect(
    name="heidenhain",
    syntax=Syntax(
        opening=lambda _plane: (),
        closing=("M30",),
        max_line=_MAX_LINE,
        comments=SEMICOLON,
        dwell=CycleDwell(decimals=_TIME_DECIMALS),
        modal_motion=False,
        finish=finish_klartext,
    ),
    abilities=Abilities(arc_planes=("G17",), full_circles=False),
    numbers=NumberFormat(decimals=_DECIMALS, feed_digits=8, feed_decimals=_FEED_DECIMALS, plus=True),
    language=_CONVERSATIONAL,
    notices=Notices(assumed=_ASSUMED),
    planner=BUILT_PATH,
    writer=KlartextLines,
    ending=".h",
    variants={"tolerance": partial(_with_path_mode, path_mode=_cycle_32)},
)
"""Conversational programs."""

ISO_DIALECT = replace(
    DIALECT,
    name="heidenhain-iso",
    syntax=replace(
        DIALECT.syntax,
        opening=lambda _plane: ("G90 G40",),
        dwell=DwellWords(word="G04", letter="F", decimals=_TIME_DECIMALS),
        finish=finish_iso,
    ),
    language=_ISO,
    writer=IsoLines,
    ending=".i",
    variants={"tolerance": partial(_with_path_mode, path_mode=_g62)},
)
"""ISO programs."""
