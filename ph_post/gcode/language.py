"""How a controller's language differs from RS274/NGC, or which reader of its own it has."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import msgspec
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from ph_post.gcode import codes
from ph_post.gcode.numbers import LINE_START, blanked, line_fed
from ph_post.types import Array, IntArray

if TYPE_CHECKING:
    from ph_post.gcode.program import PartProgram, WordTable


_SPINDLE = re.compile(rb"\$[ \t]*(?:0+|-[ \t]*1)(?![ \t]*[\d.])")
"""The first spindle, and all of them, which M and S mean without it, too (LinuxCNC, "M3, M4, M5")."""
_SPINDLE_LINE = re.compile(
    rb"^(?:[ \t/]|[NMS][ \t]*[\d.]+|" + _SPINDLE.pattern + rb")+(?=[;(\r\n]|\Z)", re.IGNORECASE | re.MULTILINE
)


class Spelling(Protocol):
    """Writes blocks of a language whose motions are no RS274 words."""

    def lines(self, mode: str, words: Sequence[str]) -> list[str]:
        """Return the blocks of a motion, from its mode (G0 to G3) and its words in RS274."""

    def first(self, line: str, mode: str, words: Sequence[str], later: Sequence[float]) -> list[str]:
        """Return a line with other words of its motion, and without the M words `later`."""

    def centre(self, place: Sequence[str]) -> str:
        """Return the block that sets the centre of the circles behind it."""

    def ended(self, line: str, data: bytes, /) -> str:
        """Return a new line as a program of these bytes ends its blocks, and writes its numbers."""


class Language(msgspec.Struct, frozen=True, kw_only=True):
    """A language that is read as RS274/NGC but for the fields below, or by its own reader.

    Parameters
    ----------
    name : str
        Dialect that a compensated program declares for its reader; empty where RS274/NGC's reads it.
    hide : callable or None
        ``hide(data)``: the same text, every line as long as it was, with blanks in the place of what has no
        meaning for motion. What may move, and is not understood, becomes a line with a ``$`` and nothing behind
        it: after it no position is known, and no mode but `fixed`; or with ``$@``: after it the modes are what
        they were; or with ``$=``: what they are at the beginning. The words that it leaves are those of each line
        alone, on any part of a program; which mark stands in the place of others may depend on the lines behind.
    dwell : tuple of (str, float)
        Letters of the time of a G4, each with its unit [s].
    fixed : mapping of int to float
        Modes at the beginning, and wherever no line says which, by column of a state (:mod:`ph_post.gcode.codes`).
    lost : mapping of int to float
        Modes behind lines that may set any, by column, where they are others than `fixed`; infinite where such lines
        leave what the program has said.
    feed_known : bool
        Whether a cut needs an F before it; if not, it is one whose feed is not known.
    bound : callable or None
        ``bound(line)``: why the motion of a line cannot be divided, in words; empty where it can.
    lengths : callable or None
        ``lengths(words, data) -> words``: the words of a text with the numbers that the controller reads, where a
        length without a decimal point counts in increments.
    read : callable or None
        ``read(data, name) -> program``: its own reader, every byte kept, for a language of another grammar.
    parentheses : bool
        Whether parentheses enclose comments.
    whole : callable or None
        ``whole(line, start, end) -> (start, end)``: where a word begins and ends of which the word table has the
        number alone, as ``(10`` of ``I=AC(10)``; None where it has all of every word.
    lone_modes : frozenset of str
        Words of motion modes that may stand alone on a line.
    path_words : mapping of str to str
        Words of path modes that are others than RS274/NGC's, by those.
    spelling : Spelling or None
        How its blocks are written where they are no RS274 words.
    stays : callable or None
        ``stays(data)``: why no line of a program can be changed, in words; empty where some can.
    modal : bool
        Whether the motion mode lasts, so that a line may move without a word of it.
    after_motion : tuple of float
        M words that are executed behind the motion of their line.
    closing : pattern or None
        Of a last line, behind which nothing may stand.
    turns : callable
        ``turns(number) -> text``: the word of an arc of so many turns.
    further : str
        Letters of axes of their own beside X, Y and Z, which begin and end their moves together with them: A, B and
        C turn, U, V and W are linear.
    shortest : bool
        Whether an axis that turns may go to its place (G90) by the shorter way round.
    contours : bool
        Whether motions with cutter compensation are read as contours, and threads as motions, and not passed through:
        see :meth:`contoured`.
    skips : bool
        Whether G31 moves the axes that it names, and no others, up to a signal.
    threads : bool
        Whether G33 is a straight move of so much a turn of the spindle along its way as K says.
    spindles : bool
        Whether a ``$`` beside M and S alone says which spindle is meant; without it that is ``$0``.
    macros : bool
        Whether a line may begin with the name of a macro, which does what its owner wants.
    cycles_apart : bool
        Whether canned cycles are no motion modes, so that G80 leads back to the straight motion before them.
    effects : mapping of int to int
        Effects of M words, by number, that are others than :data:`~ph_post.gcode.codes.M_EFFECT` has.
    diameters : bool
        Whether the numbers of X words are diameters, twice the places of the axis, as on lathes.
    head : tuple of str
        Notes in the head of a compensated program, by which it is read as its original was.
    """

    name: str = ""
    hide: Callable[[bytes], bytes] | None = None
    dwell: tuple[tuple[str, float], ...] = (("P", 1.0),)
    fixed: Mapping[int, float] = {}
    lost: Mapping[int, float] = {}
    feed_known: bool = True
    bound: Callable[[bytes], str] | None = None
    lengths: Callable[[WordTable, bytes], WordTable] | None = None
    read: Callable[[bytes, str], PartProgram] | None = None
    parentheses: bool = True
    whole: Callable[[str, int, int], tuple[int, int]] | None = None
    lone_modes: frozenset[str] = frozenset(("G0",))
    path_words: Mapping[str, str] = {}
    spelling: Spelling | None = None
    stays: Callable[[bytes], str] | None = None
    modal: bool = True
    after_motion: tuple[float, ...] = (0.0, 1.0, 2.0, 30.0, 60.0)
    closing: re.Pattern[bytes] | None = None
    turns: Callable[[int], str] = "P{}".format
    further: str = "ABCUVW"
    shortest: bool = False
    contours: bool = False
    skips: bool = False
    threads: bool = False
    spindles: bool = False
    macros: bool = False
    cycles_apart: bool = False
    effects: Mapping[int, int] = {}
    diameters: bool = False
    head: tuple[str, ...] = ()

    @property
    def factors(self) -> IntArray:
        """How often the place of X, Y and Z is what their words say, shape (3,)."""
        return np.array([2 if self.diameters else 1, 1, 1], dtype=np.int64)

    def resting(self, words: frozenset[int], name: str, macros: frozenset[str] = frozenset()) -> Language:
        """Return the language of the dialect `name` in which M words, by their numbers, and macros move nothing."""
        effects = {**self.effects, **dict.fromkeys(sorted(words), codes.STAYS)}
        if self.hide is not None:
            return replace(self, name=name, hide=partial(_without, self.hide, _commands(words, macros)))
        read: Any = self.read
        if read is None:
            return replace(self, name=name, effects=effects)
        return replace(self, name=name if self.name else "", read=partial(read, resting=words))

    def contoured(self) -> Language:
        """Return the language in which contours with cutter compensation move as they say, and threads are motions."""
        read: Any = self.read
        return self if self.contours else replace(self, contours=True, read=read and partial(read, contours=True))

    @property
    def places_centres(self) -> bool:
        """Return whether the centres of arcs are places, whatever a line says."""
        return self.fixed.get(codes.ARC_ABSOLUTE) == 1.0

    def placing_centres(self) -> Language:
        """Return the language in which the centres of arcs are places, as under G90.1."""
        return replace(self, fixed={**self.fixed, codes.ARC_ABSOLUTE: 1.0})

    def hidden(self, data: bytes) -> bytes:
        """Return a program's text as the reader of RS274/NGC is to have it."""
        if self.spindles and b"$" in data:
            data = _SPINDLE_LINE.sub(lambda line: blanked(_SPINDLE, line[0]), data)
        return data if self.hide is None else self.hide(data)

    def m_effect(self) -> NDArray[np.int8]:
        """Return the effects of M words by number, shape (1000,)."""
        found = codes.M_EFFECT.copy()
        found[list(self.effects)] = list(self.effects.values())
        return found

    def start(self) -> Array:
        """Return the state that no line changes, NaN where lines do, with the state of F at first; shape (2, STATE).

        The second row is that behind lines that may set any mode.
        """
        state = np.full((2, codes.STATE), np.nan)
        for column, value in self.fixed.items():
            state[:, column] = value
        for column, value in self.lost.items():
            state[1, column] = value
        state[:, codes.BENEATH] = float(self.cycles_apart)
        state[:, codes.FEED_KNOWN] = 0.0 if self.feed_known else 2.0
        return state

    def dwells(self, letter: NDArray[np.uint8], value: Array) -> tuple[IntArray, Array]:
        """Return the rows of words with the time of a G4, if a G4 stands beside them, and the times [s]."""
        units = np.full(256, np.nan)
        for name, unit in self.dwell:
            units[ord(name)] = unit
        rows = np.flatnonzero(np.isfinite(units)[letter])
        seconds = value[rows] * units[letter[rows]]
        plain = np.isfinite(seconds)
        return rows[plain], seconds[plain]


def _commands(words: frozenset[int], macros: frozenset[str]) -> re.Pattern[bytes]:
    """Return the pattern of a line that has one of these M words and no other command, or one of these macros."""
    numbers, names = ("|".join(map(str, sorted(some))) for some in (words, macros))
    commands = [rf"M0*(?:{numbers})(?![\d.])(?:(?![GMT][ \t]*\d)[^;\r\n])*"] if words else []
    commands += [rf"(?:{names})(?!\w)[^;\r\n]*"] if macros else []
    line = rf"(?:{'|'.join(commands)})(?=[;\r\n]|\Z)"
    return re.compile(LINE_START + line.encode(), re.IGNORECASE)


def _without(hide: Callable[[bytes], bytes], commands: re.Pattern[bytes], data: bytes) -> bytes:
    """Return a text as `hide` has it, with blanks in the place of the lines of some commands."""
    text = blanked(commands, line_fed(data))
    return hide(text)


RS274 = Language(spindles=True)
"""RS274/NGC itself."""
