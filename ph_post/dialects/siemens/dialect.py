"""SINUMERIK 840D sl, 828D and ONE in Siemens language: polynomials up to degree 5, and feeds that are cubics.

Where the facts are from: SINUMERIK 840D sl / 828D Programming Manual Job Planning (07/2010,
6FC5398-2BP40-0BA0; as Work Preparation in SINUMERIK ONE NC Programming, 12/2019, 6FC5398-2EP40-0BA0):

- Polynomial interpolation (POLY, POLYPATH, PO, PL): f(p) = a0 + a1 p + … + a5 p⁵ for each axis, p from 0 to
  PL, which is 1 where it is not given. PO[X]=(xe, a2, a3) up to degree 3, X=PO(xe, a2, a3, a4, a5) up to 5,
  give the end f(PL) and the coefficients from the second; a0 is where the block before ended, and a1 follows
  from the end. The manual lists a4 and a5 with PO[axis] too, and says that the old form stays valid, but has
  it with two coefficients; the Diagnostics Manual, 03/2009, has alarm 14094 for more. So each form is written
  for what it is shown with. Zeros at the end may be left out. PO[]=(…) is a denominator that the axes share,
  a0 of which is 1; the ends of the axes are still places. The manual's example POLY PO[X]=(0,-10) PO[Y]=(10)
  PO[]=(2,1) from X10 Y0 is the quarter of a circle 10 (1 - p²) / (1 + p²), 20 p / (1 + p²). Not confirmed in
  a manual: a denominator of degree 4 or 5; that without POLYPATH all axes of the path follow their
  polynomials; how many axes and coefficients together a block may have, which is limited.
- Feedrate response (FNORM, FLIN, FCUB, FPO): F=FPO(end, quad, cub) is the feed of one block as a cubic over
  its path, from the feed in force to `end`, which stays in force; the coefficients are given as those of PO,
  over a share of the path that runs from 0 to 1: the example F=FPO(4000, 6000, -4000) behind F2000, on
  6 mm, is 2000 + 6000 p² - 4000 p³, level at both ends as it is drawn there. They are absolute values, in the
  unit of F under G94. The compressor leaves such blocks alone.
- Settable path reference (SPATH, UPATH): with SPATH that path is the arc length.
- NC block compression (COMPON, COMPOF), and the Function Manual Basic Functions, B1, Continuous-path mode:
  G60 stops at every end, G641 ADIS=d rounds joints within d of them, and none that G64 passes at full feed.
- The same Function Manual, G2: MD10200 INT_INCR_PER_MM is what programmed positions are rounded to.

And the Programming Manual Fundamentals: blocks of up to 512 characters, comments behind a semicolon, dwells
as G4 F in seconds, G71 and G710 for mm, G500 and G54 to G57, G2 and G3 with I, J and K counted from the
start, M30.
"""

from __future__ import annotations

from typing import Final

from ph_post.dialects.base import BUILT_PATH, Abilities, Dialect, DwellWords, Notices, NumberFormat, Syntax, end_remark
from ph_post.dialects.lines import LineWriter
from ph_post.dialects.siemens.reader import read_siemens
from ph_post.dialects.siemens.table import whole_word
from ph_post.gcode.blocks import Feed, Moves
from ph_post.gcode.language import Language
from ph_post.gcode.numbers import SEMICOLON, decimal_text, significant_text, to_counts
from ph_post.gcode.polynomials import DENOMINATOR_DECIMALS
from ph_post.types import IntArray
from ph_post.units import MM_PER_MIN

_DECIMALS: Final = 10
"""1e-10 mm: ends and four coefficients of a quintic together then move no point by 2e-10 mm."""

_OLD_FORM: Final = 3
"""PO[X]=(…) is documented with the end and up to two coefficients, a cubic; with more X=PO(…) is."""

_PROFILE: Final = "=FPO("


class SiemensLines(LineWriter):
    """Lines of Siemens language."""

    def write_polynomial(self, moves: Moves, i: int, feed: str) -> None:
        """Write POLY with the ends and coefficients of all axes, and of a denominator."""
        table, ends = moves.polynomials[i], moves.points[i + 1].tolist()
        rational = len(self.axes) != len(table)
        lists = [
            self._values(self._length(end), row, rational)
            for end, row in zip(ends, table[: len(self.axes)], strict=True)
        ]
        form = "{}=PO({})" if max(map(len, lists)) > _OLD_FORM else "PO[{}]=({})"
        words = [form.format(axis, ",".join(row)) for axis, row in zip(self.axes, lists, strict=True)]
        if rational:
            below = [decimal_text(count, DENOMINATOR_DECIMALS) for count in table[-1].tolist()]
            words.append(f"PO[]=({','.join(_stripped(below))})")
        self._write("POLY", [*words, "PL=1"], feed)

    def _values(self, end: str, row: IntArray, rational: bool) -> list[str]:
        counts = row.tolist()[1:] if rational else row.tolist()
        return _stripped([end, *(self._length(count) for count in counts)])

    def _feeds(self, moves: Moves, first: int, last: int) -> list[str]:
        feeds = super()._feeds(moves, first, last)
        for i, profile in moves.profiles.items():
            if first <= i < last:
                feeds[i - first] = self._profile(profile)
        return feeds

    def _profile(self, feed: Feed) -> str:
        values = (feed.end, feed.quad, feed.cub)
        words = (_signed(value / MM_PER_MIN, self.dialect.numbers.feed_digits) for value in values)
        return f"{_PROFILE}{','.join(words)})"

    def _write(self, word: str, words: list[str], feed: str, *, modal: bool = True) -> None:
        """One line; behind a feed that changed within a block its last value is in force."""
        super()._write(word, words, feed, modal=modal)
        if feed.startswith(_PROFILE):
            self._feed = feed.removeprefix(_PROFILE).split(",")[0]


def _stripped(values: list[str]) -> list[str]:
    """Leave out zeros at the end, but for the first value."""
    while len(values) > 1 and values[-1] == "0":
        values.pop()
    return values


def _signed(value: float, digits: int) -> str:
    """Write a number with so many significant digits.

    Examples
    --------
    >>> _signed(-1234.56, 3), _signed(0.0, 3)
    ('-1235', '0')
    """
    if value == 0.0:
        return "0"
    text = significant_text(abs(value), digits)
    return f"-{text}" if value < 0.0 else text


def _opening(plane: str) -> tuple[str, ...]:
    """Mm, absolute, per minute over the arc length, nothing compensated, joined or compressed."""
    return (f"G710 {plane} G90 G94 G40 G54", "COMPOF SPATH FNORM")


def _path_mode(tolerance: float | None) -> str:
    if tolerance is None:
        return "G60"
    return f"G641 ADIS={decimal_text(int(to_counts(tolerance, _DECIMALS)), _DECIMALS)}"


def _turns(number: int) -> str:
    """Word of an arc of so many turns, which counts those besides the first."""
    return f"TURN={number - 1}"


DIALECT = Dialect(
    name="siemens",
    syntax=Syntax(
        opening=_opening,
        closing=("M30",),
        max_line=512,
        comments=SEMICOLON,
        dwell=DwellWords(letter="F"),
        path_mode=_path_mode,
    ),
    abilities=Abilities(
        # G93 there is, but a feed over the path says more, and once.
        polynomial_degree=5,
        feed_degree=3,
    ),
    numbers=NumberFormat(decimals=_DECIMALS, feed_digits=8),
    language=Language(
        name="siemens",
        read=read_siemens,
        parentheses=False,
        whole=whole_word,
        path_words={"G61": "G60"},
        lone_modes=frozenset(("G0", "G1")),
        turns=_turns,
        further="",
    ),
    notices=Notices(
        assumed=(
            "assumed: work offset G54, not rotated, feed override 100 percent, tool, its length and spindle as set"
            " before",
            "assumed: polynomial interpolation is enabled, axes and coefficients fit into a block, and positions"
            " are rounded to the resolution of the control alone, MD10200",
            "the compressor is switched off by COMPOF and stays off",
            end_remark("M30"),
        ),
        units=(70, 71, 700, 710),
    ),
    planner=BUILT_PATH,
    writer=SiemensLines,
    ending=".mpf",
)
"""The SINUMERIK dialect."""
