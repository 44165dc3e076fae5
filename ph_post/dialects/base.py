"""The contract of a dialect: records of its words, abilities and numbers, and the language that it is read in.

To add a dialect:

1. Write a module with a :class:`Dialect` record; name in its docstring the manuals that the facts are from.
2. Register the record under the entry point ``ph_post.dialects``, by the name that machine files write.
3. :class:`Syntax`: how a program begins and ends, its comments, dwells and path modes, and how long a line is.
4. :class:`Abilities`: which moves it can write and how finely, and what it does under inverse time.
5. :class:`NumberFormat`: decimals of lengths, digits of feeds, signs and points. All that is written is a whole
   number of the last decimal.
6. :class:`Language <ph_post.gcode.language.Language>`: how its programs are read. One that differs from
   RS274/NGC in a few words says so there; one of another grammar brings its own reader.
7. :class:`Notices`: what a user has to know, and what keeps the controller from compensating a second time.
8. :class:`Recording`: the log that the controller itself can make of its axes.
9. `planner`: whether the controller rounds corners, as LinuxCNC does, or follows the path exactly; with the
   defaults of its firmware.
10. `writer`: a :class:`LineWriter <ph_post.dialects.lines.LineWriter>` of its own where moves are no RS274
   words; it overrides what differs.
11. `variants`: what a machine may have besides, by the word behind a plus sign (``fanuc+nurbs``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

import msgspec

from ph_post.dialects.lines import LineWriter
from ph_post.gcode.language import RS274, Language
from ph_post.gcode.numbers import PARENTHESES, Comments, comment_lines, decimal_text, significant_text, to_counts
from ph_post.types import Array, ControllerPlanner, IntArray, Machine, RoundedPath
from ph_post.units import MM

_ROUNDING = 1e-6
"""A time that is longer than whole steps by no more than this part of one is rounding."""

PRECONDITIONS = (
    "assumed: work offset G54, not rotated, feed override 100 percent, tool length and spindle as set before"
)
"""What programs of most machine tools take for granted."""


def end_remark(end: str) -> str:
    """Return the remark that a program does nothing about spindle and coolant before the word of its end."""
    return f"spindle and coolant are not touched until {end}, which switches them off"


class DwellWords(msgspec.Struct, frozen=True, kw_only=True):
    """The words of a dwell.

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
        if count == 0.0:
            return "0"
        if self.decimals is None:
            return significant_text(count, digits)
        return decimal_text(math.ceil(count * 10**self.decimals - _ROUNDING), self.decimals)

    def words(self, seconds: float, digits: int) -> list[str]:
        """Return the words of a dwell of `seconds`."""
        return [self.word, self.letter + self.number(seconds, digits)]

    def written(self, seconds: float, digits: int) -> float:
        """Return the time [s] that the controller will read."""
        return float(self.number(seconds, digits)) * self.unit


class Syntax(msgspec.Struct, frozen=True, kw_only=True):
    """The words of a dialect around its moves.

    Parameters
    ----------
    opening : callable
        ``opening(plane) -> lines``: the modal state the program relies on; `plane` is G17, G18 or G19.
    closing : tuple of str
        Last lines of the program.
    max_line : int
        Most characters of a line.
    counts_comments : bool
        Whether those of comments count; firmware that throws them away as it reads leaves them no room.
    comments : Comments
    dwell : DwellWords
    path_mode : callable or None
        ``path_mode(tolerance) -> line``, or several with line feeds between them: the controller may round
        joints by `tolerance` [m], or has to reach every end point where `tolerance` is None. None where the
        dialect has no such words.
    modal_motion : bool
        Whether a line may do without the word of its motion, and F may stand alone; if not, terse or not,
        every line names it.
    terse : bool
        No blanks, no motion word and no coordinate that repeats the last one: for serial lines.
    rapid_feed : bool
        Whether G0 moves at F, as G1 does, so that every rapid needs an F of its own.
    stop : str or None
        What stops the program until the person lets it go on; None where nothing does so without a risk.
    finish : callable or None
        ``finish(lines, name) -> lines``: what is done with the whole program of that name at last: its frame
        (% and O number, BEGIN PGM), line numbers.
    """

    opening: Callable[[str], tuple[str, ...]]
    closing: tuple[str, ...]
    max_line: int
    counts_comments: bool = True
    comments: Comments = PARENTHESES
    dwell: DwellWords = DwellWords()
    path_mode: Callable[[float | None], str] | None = None
    modal_motion: bool = True
    terse: bool = False
    rapid_feed: bool = False
    stop: str | None = "M0"
    finish: Callable[[Sequence[str], str], Sequence[str]] | None = None


class CubicAbility(msgspec.Struct, frozen=True, kw_only=True):
    """The cubic Béziers of a dialect, in the plane X, Y.

    Parameters
    ----------
    deviation : callable
        ``deviation(control)``: how far the controller's own rendering of cubics leaves them [m], from shape
        (m, 4, 2) [m] to (m,); infinite where writing one would not be safe.
    pieces : int
        Number of moves into which the controller breaks one cubic.
    """

    deviation: Callable[[Array], Array]
    pieces: int = 1


class StreamLimit(msgspec.Struct, frozen=True, kw_only=True):
    """The line by which a controller is fed while it runs: `rate` [bytes/s], and a `window` of moves in store."""

    rate: float
    window: int


class Abilities(msgspec.Struct, frozen=True, kw_only=True):
    """The moves that a dialect can carry.

    Parameters
    ----------
    arc_planes : tuple of str
        Planes in which it can write arcs.
    full_circles : bool
        Whether an arc may end where it begins.
    cubic : CubicAbility or None
    inverse_time : frozenset of str
        Moves that keep their time under G93, of "line", "arc" and "spline"; empty where there is no G93.
    polynomial_degree : int
        Highest degree of a block that is a polynomial, or a quotient of two, of each axis; 1 where there is
        none but the straight move.
    feed_degree : int
        Highest degree of the feed of one block as a polynomial of the way; 0 where a block has one feed.
    dwells : bool
        Whether the axes stand still in a dwell, so that a short move between two of them is not blended away.
    stream : StreamLimit or None
        None where the controller reads a file.
    feed_along_all : bool
        Whether F counts along all axes, degrees as mm, and not along X, Y and Z.
    drills : bool
        Whether it has drilling cycles, which may end in the plane R where they begin.
    """

    arc_planes: tuple[str, ...] = ("G17", "G18", "G19")
    full_circles: bool = True
    cubic: CubicAbility | None = None
    inverse_time: frozenset[str] = frozenset()
    polynomial_degree: int = 1
    feed_degree: int = 0
    dwells: bool = True
    stream: StreamLimit | None = None
    feed_along_all: bool = False
    drills: bool = False

    def writes_arcs(self, plane: str, *, inverse: bool = False) -> bool:
        """Return whether arcs can be written in a plane; `inverse` under G93."""
        return plane in self.arc_planes and (not inverse or "arc" in self.inverse_time)

    def writes_splines(self, plane: str, *, inverse: bool = False) -> bool:
        """Return whether cubics can be written in a plane; `inverse` under G93."""
        return self.cubic is not None and plane == "G17" and (not inverse or "spline" in self.inverse_time)


class NumberFormat(msgspec.Struct, frozen=True, kw_only=True):
    """The numbers of a dialect.

    Parameters
    ----------
    decimals : int
        Decimals of lengths in mm.
    feed_digits : int
        Most significant digits of F words, of feeds that change within a block, and of dwells.
    feed_decimals : int or None
        Decimals of F, where a controller counts those and not digits; never less than the last of them.
    least_feed : float
        Least feed [mm/min] at which the controller moves, whatever F says; no F is less.
    point : bool
        Whether every length, and every feed, has to have a decimal point: without one it may be counted in
        increments.
    plus : bool
        Whether every length has its sign.

    Examples
    --------
    >>> fanuc = NumberFormat(decimals=3, feed_digits=6, feed_decimals=2, point=True)
    >>> fanuc.length(12000), fanuc.feed(1200.0), fanuc.counts([0.0125]).tolist(), f"{fanuc.quantum:.0e}"
    ('12.', '1200.', [12500], '1e-06')
    >>> grbl = NumberFormat(decimals=4, feed_digits=6, least_feed=1.0)
    >>> grbl.feed(0.025), grbl.inverse_time(0.025)
    ('1', '0.025')
    """

    decimals: int
    feed_digits: int
    feed_decimals: int | None = None
    least_feed: float = 0.0
    point: bool = False
    plus: bool = False

    @property
    def quantum(self) -> float:
        """Step of lengths [m]."""
        return MM * 10.0**-self.decimals

    def counts(self, lengths: Array | Sequence[float]) -> IntArray:
        """Round lengths [m] to whole numbers of the last decimal."""
        return to_counts(lengths, self.decimals)

    def count(self, length: float) -> int:
        """Round one length [m] to a whole number of the last decimal."""
        return int(to_counts(length, self.decimals))

    def length(self, count: int, decimals: int | None = None) -> str:
        """Write a length of `count` last decimals, or of `count` / 10^`decimals` units."""
        sign = "+" if self.plus and count >= 0 else ""
        return sign + self._pointed(decimal_text(count, self.decimals if decimals is None else decimals))

    def feed(self, value: float) -> str:
        """Write a feed [mm/min]."""
        return self.inverse_time(max(value, self.least_feed))

    def inverse_time(self, value: float) -> str:
        """Write the F of a block under G93 [1/min], which has no least."""
        if self.feed_decimals is not None:
            count = max(1, round(value * 10**self.feed_decimals))
            return self._pointed(decimal_text(count, self.feed_decimals))
        return self._pointed(significant_text(value, self.feed_digits))

    def _pointed(self, text: str) -> str:
        return f"{text}." if self.point and "." not in text else text


class Notices(msgspec.Struct, frozen=True, kw_only=True):
    """Notices to users of a dialect.

    Parameters
    ----------
    assumed : tuple of str or None
        Remarks for the head of a program: what has to be set before, and what the end does. None for those of
        most machine tools, with the word that ends the dialect's programs; see :attr:`Dialect.assumed`.
    cautions : tuple of str
        What a user should know about lasting offsets on such controllers.
    guard : tuple of str
        Commands before the first line of a program that is compensated, where the machine file says what the
        controller is to go back to: they keep the controller from compensating a second time.
    restored : str
        Command at its end, to which the part that the controller corrects by itself is added.
    stays_off : tuple of str
        Comments at the end of a test program, which has the guard in any case, where that part is not known.
    own_compensation : str
        The setting of the controller's own backlash compensation, which must be 0; empty where it has none
        that is not switched off by `guard`.
    own_tables : str
        The settings of all that the controller compensates by itself, for test programs; empty as above.
    arc_setting : str
        The setting by which the controller draws arcs in finer chords; empty where it draws arcs.
    units : tuple of int
        G words by which programs say their units; empty where they say so by other words, or the controller
        begins in mm whatever it was told before.
    signed_turns : str
        The setting, which must be 0, under which the sign of a rotary axis' place says which way round it turns.
    """

    assumed: tuple[str, ...] | None = None
    cautions: tuple[str, ...] = ()
    guard: tuple[str, ...] = ()
    restored: str = ""
    stays_off: tuple[str, ...] = ()
    own_compensation: str = ""
    own_tables: str = ""
    arc_setting: str = ""
    units: tuple[int, ...] = ()
    signed_turns: str = ""

    def closing(self, part: float) -> str:
        """Return the command with which the controller corrects `part` of its backlash again.

        Examples
        --------
        >>> Notices(restored="M425 F").closing(0.95)
        'M425 F0.95'
        """
        return f"{self.restored}{part:g}" if self.restored else ""

    def remarks(self, part: float | None) -> tuple[str, ...]:
        """Return what the head of a program from a path says of it; nothing where the controller has no such word."""
        if not self.guard:
            return ()
        if part is None:
            return (f"{self.own_compensation} must be 0, or the backlash is compensated twice",)
        return (f"{', '.join(self.guard)} switches {self.own_compensation} off, {self.closing(part)} on again",)


READ_WITH = "read it with "
"""Words before the options with which a log without a header is read."""


class Recording(msgspec.Struct, frozen=True, kw_only=True):
    """The log that a controller makes of its axes.

    Parameters
    ----------
    lines : callable or None
        ``lines(machine, axes, seconds, name, gauge) -> lines`` that say how the log `name` of a program of so
        many `seconds` [s] is made: sentences, and lines for a shell. `gauge` is True where the table has to be
        read by something that is no part of the loop. A line that begins with :data:`READ_WITH` has the
        options with which the log is read.
    ending : str
        What the log's file name ends with.
    has_command : bool
        Whether it holds what was commanded; if not, the program is given beside it.
    """

    lines: Callable[[Machine, Sequence[str], float, str, bool], list[str]] | None = None
    ending: str = ".csv"
    has_command: bool = False


BUILT_PATH: Final = RoundedPath(tolerance=0.01 * MM, bounded=True)
"""A control whose machine's builder sets how far it may round corners, as far as they often do.

HEIDENHAIN, Klartext Portal, "Cycle 32 Tolerance": the builder sets the default of the path deviation T. SINUMERIK
840D sl, Function Manual Basic Functions, B1: MD33100 and MD33120 limit it in G642 and G645, the overload factor in
G64. FANUC B-64484EN, AI contour control: parameters do.
"""


class Dialect(msgspec.Struct, frozen=True, kw_only=True):
    """A controller dialect; the module's docstring says how to add one.

    Parameters
    ----------
    name : str
        As machine files and ``--dialect`` write it.
    syntax : Syntax
    abilities : Abilities
    numbers : NumberFormat
    language : Language
        How its programs are read.
    notices : Notices
    recording : Recording
    planner : ExactPath or RoundedPath
        How the controller moves along the path, with the defaults of its firmware.
    writer : callable
        ``writer(dialect, axes, tolerance)``: a :class:`LineWriter <ph_post.dialects.lines.LineWriter>`.
    variants : mapping of str to callable
        ``variant(dialect) -> dialect`` with what a machine may have besides, by the word behind a plus sign.
    options : frozenset of str
        Variants that it has.
    ending : str
        What its programs' file names end with.
    """

    name: str
    syntax: Syntax
    abilities: Abilities
    numbers: NumberFormat
    language: Language = RS274
    notices: Notices = Notices()
    recording: Recording = Recording()
    planner: ControllerPlanner = RoundedPath()
    writer: Callable[[Dialect, Sequence[str], float], LineWriter] = LineWriter
    variants: Mapping[str, Callable[[Dialect], Dialect]] = {}
    options: frozenset[str] = frozenset()
    ending: str = ".ngc"

    def comment(self, text: str) -> list[str]:
        """Write a text as comment lines."""
        return comment_lines(text, self.syntax.max_line, self.syntax.comments)

    def dwell_words(self, seconds: float) -> list[str]:
        """Return the words of a dwell of `seconds`."""
        return self.syntax.dwell.words(seconds, self.numbers.feed_digits)

    def line_writer(self, axes: Sequence[str], tolerance: float) -> LineWriter:
        """Make a writer of lines for moves in `axes`, whose joints may be rounded by `tolerance` [m]."""
        return self.writer(self, axes, tolerance)

    def finished(self, lines: Sequence[str], name: str) -> Sequence[str]:
        """Return the lines of a whole program as the controller is to have them."""
        return lines if self.syntax.finish is None else self.syntax.finish(lines, name)

    @property
    def assumed(self) -> tuple[str, ...]:
        """Remarks for the head of a program: what has to be set before, and what its end does."""
        if self.notices.assumed is not None:
            return self.notices.assumed
        return (PRECONDITIONS, end_remark(self.syntax.closing[-1]))


def metric_opening(plane: str) -> tuple[str, ...]:
    """Open a program in mm, absolute and per minute, nothing compensated: words that RS274 dialects share."""
    return (f"G21 {plane} G90 G91.1 G94 G40 G49 G54 G80",)
