"""The contract of a dialect: a record of its syntax and abilities, with functions that write its own words."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import msgspec

from ph_post.errors import InputError
from ph_post.gcode.numbers import PARENTHESES, Comments, comment_lines, decimal_text, significant_text
from ph_post.gcode.program import RS274, Language, PartProgram
from ph_post.types import Array, Capabilities

if TYPE_CHECKING:
    from ph_post.dialects.lines import LineWriter


_ROUNDING = 1e-6
"""A time that is longer than whole steps by no more than this part of one is rounding."""

SET_BEFORE = "assumed: work offset G54, feed override 100 percent, tool length and spindle as set before"
"""What programs of most machine tools take for granted."""

_PLANES = {"G17": ("X", "Y"), "G18": ("Z", "X"), "G19": ("Y", "Z")}
"""First and second axis of each plane, as controllers count the sense of G2 and G3."""


def switched_off(end: str) -> str:
    """Remark that a program does nothing about spindle and coolant before the word of its end."""
    return f"spindle and coolant are not touched until {end}, which switches them off"


ASSUMED = (SET_BEFORE, switched_off("M2"))
"""What a program of an RS274 dialect takes for granted."""


class DwellWords(msgspec.Struct, frozen=True, kw_only=True):
    """How a language writes a dwell.

    Parameters
    ----------
    word, letter : str
        The word that makes the axes stand, and the letter of its time.
    unit : float
        Unit of that time [s].
    decimals : int or None
        Decimals of that time where a controller counts those and not digits; then it is rounded up.
    """

    word: str = "G4"
    letter: str = "P"
    unit: float = 1.0
    decimals: int | None = None

    def number(self, seconds: float, digits: int) -> str:
        """Write a time [s] with so many significant digits.

        Examples
        --------
        >>> DwellWords().number(0.0204, 6), DwellWords(unit=1e-3, decimals=0).number(0.0204, 6)
        ('0.0204', '21')
        """
        count = seconds / self.unit
        if self.decimals is None:
            return significant_text(count, digits)
        return decimal_text(math.ceil(count * 10**self.decimals - _ROUNDING), self.decimals)

    def words(self, seconds: float, digits: int) -> list[str]:
        """Words of a dwell."""
        return [self.word, self.letter + self.number(seconds, digits)]

    def written(self, seconds: float, digits: int) -> float:
        """Return the time [s] that the controller will read."""
        return float(self.number(seconds, digits)) * self.unit


class Dialect(msgspec.Struct, frozen=True, kw_only=True):
    """A controller dialect; to add one: a file with such a record, an entry point in ``ph_post.dialects``.

    Parameters
    ----------
    name : str
        As machine files and ``--dialect`` write it.
    capabilities : Capabilities
        `decimals` are those of lengths in mm.
    feed_digits : int
        Significant digits of F words and dwells.
    terse : bool
        No blanks, no motion word and no coordinate that repeats the last one: for serial lines.
    opening : callable
        ``opening(plane) -> lines``: the modal state the program relies on; `plane` is G17, G18 or G19.
    closing : tuple of str
        Last lines of the program.
    inverse_time_arcs, inverse_time_splines : bool
        Whether G2 and G3, and G5, keep their time under G93.
    arc_planes : tuple of str
        Planes in which it can write arcs.
    path_mode : callable or None
        ``path_mode(tolerance) -> line``, or several with line feeds between them: the controller may round
        joints by `tolerance` [m], or has to reach every end point where `tolerance` is None. None where the
        dialect has no such words.
    spline_deviation : callable or None
        ``spline_deviation(control)``: how far the controller's own rendering of cubic Béziers leaves them
        [m], from shape (m, 4, 2) [m] to (m,); infinite where writing one would not be safe.
    spline_pieces : int
        Number of moves into which the controller breaks one cubic.
    stream_rate : float or None
        Bytes a second that the controller is fed with while it runs, None where it reads a file.
    stream_window : int
        Number of moves that it holds in store.
    front : callable or None
        ``front(data, name) -> program``: reads a part program of this dialect, every byte kept; None where
        :func:`ph_post.gcode.read.read_program` does.
    variants : mapping of str to callable
        What a machine may have besides, by the word behind a plus sign (``fanuc+nurbs``):
        ``variant(dialect) -> dialect`` with it.
    comments : Comments
        How a comment is written.
    dwell : DwellWords
        How a dwell is written, and the unit of its time.
    assumed : tuple of str
        Remarks for the head: what has to be set before, and what the end does.
    modal_motion : bool
        Whether a line may do without the word of its motion, and F may stand alone; if not, terse or not,
        every line names it.
    rapid_feed : bool
        Whether G0 moves at F, as G1 does, so that every rapid needs an F of its own.
    cautions : tuple of str
        What a user should know about lasting offsets on such controllers.
    guard : tuple of str
        Commands before the first line of a program that is compensated: they keep the controller from
        compensating a second time.
    language : Language
        How its programs are read.
    writer : callable or None
        ``writer(dialect, axes, tolerance)``: a :class:`LineWriter <ph_post.dialects.lines.LineWriter>` of the
        dialect's own, for a language whose moves are not RS274 words.
    finish : callable or None
        ``finish(lines, name) -> lines``: what is done with the whole program of that name at last: its frame
        (% and O number, BEGIN PGM), line numbers.
    point : bool
        Whether every length, and every feed, has to have a decimal point: without one it may be counted in
        increments.
    plus : bool
        Whether every length has its sign.
    feed_decimals : int or None
        Decimals of F, where a controller counts those and not digits; never less than the last of them.
    unspliced : str
        Why nothing is spliced into a program of that language, in words; empty where it can be.
    ending : str
        What its programs' file names end with.
    """

    name: str
    capabilities: Capabilities
    feed_digits: int
    terse: bool
    opening: Callable[[str], tuple[str, ...]]
    closing: tuple[str, ...]
    inverse_time_arcs: bool = True
    inverse_time_splines: bool = False
    arc_planes: tuple[str, ...] = ("G17", "G18", "G19")
    path_mode: Callable[[float | None], str] | None = None
    spline_deviation: Callable[[Array], Array] | None = None
    spline_pieces: int = 1
    stream_rate: float | None = None
    stream_window: int = 1
    front: Callable[[bytes, str], PartProgram] | None = None
    variants: Mapping[str, Callable[[Dialect], Dialect]] = {}
    comments: Comments = PARENTHESES
    dwell: DwellWords = DwellWords()
    assumed: tuple[str, ...] = ASSUMED
    modal_motion: bool = True
    rapid_feed: bool = False
    cautions: tuple[str, ...] = ()
    guard: tuple[str, ...] = ()
    language: Language = RS274
    writer: Callable[[Dialect, Sequence[str], float], LineWriter] | None = None
    finish: Callable[[Sequence[str], str], Sequence[str]] | None = None
    point: bool = False
    plus: bool = False
    feed_decimals: int | None = None
    unspliced: str = ""
    ending: str = ".ngc"

    def length(self, count: int, decimals: int) -> str:
        """Write a length of `count` / 10^`decimals` units."""
        sign = "+" if self.plus and count >= 0 else ""
        return sign + self._pointed(decimal_text(count, decimals))

    def feed(self, value: float) -> str:
        """Write a feed, or an inverse time."""
        if self.feed_decimals is not None:
            count = max(1, round(value * 10**self.feed_decimals))
            return self._pointed(decimal_text(count, self.feed_decimals))
        return self._pointed(significant_text(value, self.feed_digits))

    def _pointed(self, text: str) -> str:
        return f"{text}." if self.point and "." not in text else text

    def remark(self, words: str) -> list[str]:
        """Write words as comment lines."""
        return comment_lines(words, self.capabilities.max_line, self.comments)

    def finished(self, lines: Sequence[str], name: str) -> Sequence[str]:
        """Return the lines of a whole program as the controller is to have them."""
        return lines if self.finish is None else self.finish(lines, name)


def require_spliceable(dialect: Dialect, where: str) -> None:
    """See that programs of a dialect can be compensated; `where` is the program, or who asks for it.

    Raises
    ------
    InputError
        With the dialect's reason.
    """
    if dialect.unspliced:
        raise InputError(
            where,
            f"nothing is spliced into programs of {dialect.name}: {dialect.unspliced}",
            expected="a path file, or a program of another dialect",
        )


def metric_opening(plane: str) -> tuple[str, ...]:
    """Open a program in mm, absolute and per minute, nothing compensated: words that RS274 dialects share."""
    return (f"G21 {plane} G90 G91.1 G94 G40 G49 G54 G80",)


def plane_of(axes: Sequence[str]) -> tuple[str, int]:
    """Word of the plane of the first two axes, and +1 or -1 as their order is the plane's or not.

    Examples
    --------
    >>> plane_of(("X", "Y")), plane_of(("X", "Z"))
    (('G17', 1), ('G18', -1))
    """
    pair = tuple(axes[:2])
    word = next(word for word, plane in _PLANES.items() if set(pair) == set(plane))
    return word, 1 if pair == _PLANES[word] else -1
