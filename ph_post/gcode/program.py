"""The record of a part program: every byte, its words, modal states, motions, breaks and notes.

Everything is columnar, as programs of a million blocks are common: a row a word, a row a motion.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, Literal

import msgspec
import numpy as np
from msgspec.structs import force_setattr
from numpy.typing import NDArray

from ph_post.bounds import MANY_LINES, give_memory_back, in_parts
from ph_post.errors import printable
from ph_post.gcode import codes
from ph_post.gcode.language import RS274, Language
from ph_post.types import Array, BoolArray, IntArray, sealed

_BEGINS: Final = re.compile(rb"^[ \t\xef\xbb\xbf]*(?:\d+\s+)?BEGIN\s+PGM\b", re.IGNORECASE | re.MULTILINE)

RAPID, LINE, ARC, CUBIC, NURBS = range(5)
"""Kind of a motion: G0; G1; G2 and G3; G5 and G5.1 (raised to a cubic); G5.2 to G5.3."""

AXES: Final[tuple[str, ...]] = ("X", "Y", "Z")
"""The axes of a position, by column."""

CENTERS: Final[Mapping[str, str]] = {"X": "I", "Y": "J", "Z": "K"}
"""Letter of an arc's centre along each axis."""

PLANE_AXES: Final[Mapping[int, tuple[int, int, int]]] = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
"""First, second and third axis of a plane, as columns of a position; arcs turn from first to second."""

ByteArray = NDArray[np.uint8]

PlaceArray = NDArray[np.int32]
"""Places in a program, lines, numbers of chains: programs have less than 2 GiB, and half the room counts."""

CodeArray = NDArray[np.int8]
"""Small numbers."""


def in_a_row(rows: PlaceArray) -> PlaceArray | slice:
    """Return numbers that rise as a slice where none is left out, which makes no copy of what it is taken from.

    Examples
    --------
    >>> in_a_row(np.array([3, 4, 5], dtype=np.int32)), in_a_row(np.array([3, 5], dtype=np.int32)).tolist()
    (slice(3, 6, None), [3, 5])
    """
    return slice(int(rows[0]), int(rows[-1]) + 1) if rows.size and rows[-1] - rows[0] == rows.size - 1 else rows


def rows_where(mask: BoolArray) -> PlaceArray:
    """Return the numbers of the rows in which a mask is true: there may be a million, and numpy's have twice the room.

    Examples
    --------
    >>> rows_where(np.array([True, False, True])).tolist()
    [0, 2]
    """
    found, count = np.empty(np.count_nonzero(mask), dtype=np.int32), 0
    for part in in_parts(mask.size):
        own = np.flatnonzero(mask[part])
        found[count : count + own.size] = part.start + own
        count += own.size
    return found


def plane_columns(plane: CodeArray) -> CodeArray:
    """Return the first, second and third axis of planes 17 to 19, shape (n, 3).

    Examples
    --------
    >>> plane_columns(np.array([17, 18])).tolist()
    [[0, 1, 2], [2, 0, 1]]
    """
    table = np.array([PLANE_AXES[number] for number in sorted(PLANE_AXES)], dtype=np.int8)
    return np.asarray(table[plane - min(PLANE_AXES)])


def plane_of(axes: Sequence[str]) -> tuple[str, int]:
    """Return the word of the plane of the first two axes, and +1 or -1 as their order is the plane's or not.

    Examples
    --------
    >>> plane_of(("X", "Y")), plane_of(("X", "Z"))
    (('G17', 1), ('G18', -1))
    """
    pair = tuple(AXES.index(axis) for axis in axes[:2])
    number = next(number for number, columns in PLANE_AXES.items() if set(pair) == set(columns[:2]))
    return f"G{number}", 1 if pair == PLANE_AXES[number][:2] else -1


_NOWHERE: Final = np.zeros(0, dtype=np.int32)

NurbsData = tuple[int, Array, Array]
"""Order, control points (k, 3) [m] and weights (k,) of a NURBS."""

BreakKind = Literal[
    "beginning", "end", "tool change", "probe", "home", "machine coordinates", "frame", "units", "not understood"
]
"""What separates two chains. `frame`: work offset, G92, tool length, units of the offset tables (G10); `units`: motions
in mm and in inches, whose numbers have other steps."""


class WordTable(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The words of a program outside comments, w of them, in the order of the text.

    `block` the line a word stands on (from 0); `letter` its letter, upper case, as a byte; `start`, `end` its
    bytes in the program, letter included; `value` its number, and `decimals` how many it has: with `digits` the
    number is exactly digits / 10^decimals. Words whose value is no plain number (`#5`, `[1+2]`) have a NaN and
    `decimals` -1. `long` has the digits of the words of which `value` does not have all.
    """

    block: PlaceArray
    letter: ByteArray
    start: PlaceArray
    end: PlaceArray
    value: Array
    decimals: NDArray[np.int16]
    long: Mapping[int, int] = {}

    @property
    def digits(self) -> IntArray:
        """Digits of all words, 0 of what is no plain number, shape (w,)."""
        return self.digits_of(slice(None))

    def digits_of(self, rows: slice | IntArray | PlaceArray) -> IntArray:
        """Return the digits of some words, shape (k,)."""
        found = whole_numbers(self.value[rows], self.decimals[rows])
        if self.long:
            numbers = np.arange(self.block.size)[rows]
            for place in np.flatnonzero(np.isin(numbers, list(self.long))).tolist():
                found[place] = self.long[int(numbers[place])]
        return found

    def g_words(self, *codes: float) -> BoolArray:
        """Return true for each G word of one of these numbers, shape (w,)."""
        found = self.letter == ord("G")
        found[found] = np.isin(self.value[found], codes)
        return np.asarray(found)

    def take(self, rows: IntArray) -> WordTable:
        """Return the table of some of the words."""
        columns = {name: getattr(self, name)[rows] for name in self.__struct_fields__ if name != "long"}
        found = np.flatnonzero(np.isin(rows, list(self.long))).tolist() if self.long else []
        return WordTable(**columns, long={place: self.long[int(rows[place])] for place in found})

    def sealed(self) -> WordTable:
        """Return the table with columns that nobody can write to."""
        columns = {name: sealed(getattr(self, name)) for name in self.__struct_fields__ if name != "long"}
        return msgspec.structs.replace(self, **columns)

    def joined(self, other: WordTable) -> WordTable:
        """Return the table with the words of another behind its own."""
        if not other.block.size:
            return self
        names = [name for name in self.__struct_fields__ if name != "long"]
        columns = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in names}
        more = {self.block.size + row: digits for row, digits in other.long.items()}
        return WordTable(**columns, long={**self.long, **more})

    def rows(self, first: int, last: int) -> slice:
        """Return the rows of the words of the lines from `first` to before `last`."""
        low, high = self.block.searchsorted(np.array([first, last], dtype=self.block.dtype))
        return slice(int(low), int(high))


_PLAIN: Final = np.isin(np.arange(256), np.frombuffer(b"XYZIJKRFN", np.uint8))
"""Letters of words that place and feed motions, or number lines."""

_MOTION_MODES: Final = (0.0, 1.0, 2.0, 3.0)


def _commands(words: WordTable) -> WordTable:
    """Return the words of :attr:`WordSource.commands`."""
    switched = np.zeros(int(words.block[-1]) + 1 if words.block.size else 0, dtype=np.bool_)
    found = []
    for part in in_parts(words.block.size):
        letter, code = words.letter[part], words.letter[part] == ord("G")
        own = np.flatnonzero(~_PLAIN[letter] & ~code)
        others = np.flatnonzero(code)
        others = others[~np.isin(words.value[part][others], _MOTION_MODES)]
        found += [part.start + own, part.start + others]
        switched[words.block[part][others]] = True
        switched[words.block[part][own[letter[own] == ord("M")]]] = True
    rows = np.flatnonzero(switched[words.block]) if switched.any() else _NOWHERE
    return words.take(np.union1d(np.concatenate([*found, _NOWHERE]), rows))


class WordSource:
    """The words of a program, which may be let go where its text gives them again.

    They are as large as three copies of the text, and most of what is done with a program needs none.

    Parameters
    ----------
    words : WordTable
    read : callable or None
        ``read(first, last)``: the same words once more, those of the lines from `first` to before `last`, or to the end
        where that is None; None where they are kept as long as the program.
    """

    def __init__(self, words: WordTable, read: Callable[[int, int | None], WordTable] | None = None) -> None:
        self._words: WordTable | None = words
        self._read = read
        self._lines = int(words.block[-1]) + 1 if words.block.size else 0
        self._last = -1, range(0)
        self.commands = _commands(words)
        """All words but X, Y, Z, I, J, K, R, F, N and G0 to G3, and of lines with another G word or an M word all
        words. They are kept: of most programs they are few."""

    def get(self) -> WordTable:
        """Return the words, read again where they were let go."""
        if self._words is None:
            assert self._read is not None
            self._words = self._read(0, None)
        return self._words

    def rows_of(self, block: int) -> range:
        """Return the numbers of the words on a line; those of the same line again take no time."""
        if self._last[0] != block:
            self._last = block, range(*span_of(self.get().block, block))
        return self._last[1]

    def part(self, first: int, last: int) -> WordTable:
        """Return the words of the lines from `first` to before `last`, which are not kept for another time."""
        if self._words is None:
            assert self._read is not None
            return self._read(first, last)
        rows = self._words.rows(first, last)
        return self._words.take(np.arange(rows.start, rows.stop))

    def let_go(self) -> None:
        """Keep the words of a long program no longer, if they can be read again, and give back what work has left."""
        if self._read is not None and self._lines >= MANY_LINES:
            self._words = None
            give_memory_back(self._lines)


class FeedRuns(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Feeds of lines or of motions, NaN where they are not known.

    `value` (r,) of runs of rows that begin at the rows `first` (r,); of all `count` rows where that is None, as the
    feed changes on many of them.
    """

    value: Array
    first: PlaceArray | None
    count: int

    def of(self, rows: IntArray | PlaceArray | slice) -> Array:
        """Return the feeds of some rows, shape (k,)."""
        if self.first is None:
            return np.asarray(self.value[rows])
        if isinstance(rows, slice):
            low, high, _ = rows.indices(self.count)
            high = max(low, high)
            return np.repeat(self.value, np.diff(self.first.clip(low, high), append=high))
        return np.asarray(self.value[self.first.searchsorted(rows.astype(np.int32, copy=False), side="right") - 1])

    def at(self, row: int) -> float:
        """Return the feed of a row."""
        place = row if self.first is None else int(self.first.searchsorted(np.int32(row), side="right")) - 1
        return float(self.value[place])


_RUN: Final = 2
"""Rows that a run has at least on the average where feeds are kept by runs."""


def feed_runs(feed: Array) -> FeedRuns:
    """Keep the feeds of rows (n,).

    Examples
    --------
    >>> feeds = feed_runs(np.array([np.nan, 100.0, 100.0, 100.0, 100.0]))
    >>> feeds.first.tolist(), feeds.of(np.array([0, 3])).tolist(), feeds.of(slice(2)).tolist(), feeds.at(4)
    ([0, 1], [nan, 100.0], [nan, 100.0], 100.0)
    """
    new = np.ones(feed.size, dtype=np.bool_)
    new[1:] = (feed[1:] != feed[:-1]) & ~(np.isnan(feed[1:]) & np.isnan(feed[:-1]))
    if _RUN * np.count_nonzero(new) > feed.size:
        return FeedRuns(value=sealed(feed), first=None, count=feed.size)
    first = np.flatnonzero(new).astype(np.int32)
    return FeedRuns(value=sealed(feed[first]), first=sealed(first), count=feed.size)


class Motions(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The motions of a program that are understood, m of them, in order. SI units.

    `block` the line of each; `kind`; `chain` its number: what lies between two motions of one chain is seen
    through (comments, F, S, M0 to M9 but M2 and M6, G4, modes), what lies between two chains is a
    :class:`Break`: chain k lies between breaks k and k + 1 of the program. `start`, `end` (m, 3) [m]: X, Y
    and Z in the coordinates of the active work system, NaN where not known. `plane` 17, 18 or 19. Of arcs:
    `center` (m, 2) [m] of the plane's first and second axis, `angle` [rad] swept, positive from the first
    axis to the second, whole turns included; zeros for others.
    `control` the four control points (4, 3) [m] of cubics by motion, `nurbs` the NURBS. `feeds` [m/s], 0 of
    rapids, NaN where the program does not have it (G95, no F); `duration` [s] of motions under G93, 0 of
    others. `exact` 1 where the controller stops at the end (G61, G61.1), 0 under G64 and where no path mode
    was given.
    """

    block: PlaceArray
    kind: CodeArray
    chain: NDArray[Any]
    start: Array
    end: Array
    plane: CodeArray
    center: Array
    angle: Array
    feeds: FeedRuns
    duration: Array
    exact: CodeArray
    control: Mapping[int, Array]
    nurbs: Mapping[int, NurbsData]

    @property
    def feed(self) -> Array:
        """Feeds of all motions [m/s], shape (m,): where they are few of some length, made anew each time."""
        return self.feeds.of(slice(None))


class Break(msgspec.Struct, frozen=True, kw_only=True):
    """End of a chain: nothing that was added to the motion may last into the block of a break.

    `block` is the first line that must see the axes where the program has them; `motion` the number of the
    first motion after it (m at the end of the program).
    """

    block: int
    motion: int
    kind: BreakKind


class Note(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch that is passed through as it is: blocks `first` to `last`, what was met, in which column.

    `refusal` is what was met, what was expected and what was found, where controllers refuse it; `why` the reason of
    :mod:`ph_post.gcode.codes`, 0 of what a reader of its own says.
    """

    first: int
    last: int
    column: int
    what: str
    refusal: tuple[str, str, str] | None = None
    why: int = 0

    def __post_init__(self) -> None:
        if not self.what.isprintable():
            force_setattr(self, "what", printable(self.what))


class Modal(msgspec.Struct, frozen=True, kw_only=True):
    """Modal state after a block, as RS274/NGC groups it; None where the program has not said.

    `motion` "G1", "G81", …; `plane` 17 to 19; `units` [m] of one program unit; `absolute` G90;
    `arc_absolute` G90.1; `feed_mode` 93, 94, 95, or 0 where it may be any; `compensation` "G40", "G41", …;
    `length` "G43", "G49", …; `system` "G54" to "G59.3"; `path` the whole path mode as written, "G64 P0.01 Q0";
    `retract` "G98", "G99"; `spindle` "M3", "M4", "M5"; `mist`, `flood` on or off; `tool` in the spindle and `prepared`;
    `speed` S.
    """

    motion: str | None = None
    plane: int = 17
    units: float = 1e-3
    absolute: bool = True
    arc_absolute: bool = False
    feed_mode: int = 94
    compensation: str | None = None
    length: str | None = None
    system: str | None = None
    path: str | None = None
    retract: str | None = None
    spindle: str | None = None
    mist: bool | None = None
    flood: bool | None = None
    tool: float | None = None
    prepared: float | None = None
    speed: float | None = None


def narrowed(numbers: NDArray[Any]) -> NDArray[Any]:
    """Return numbers from 0 on in the narrowest type that has them all."""
    most = int(numbers.max(initial=0))
    kinds = (np.int8, np.int16, np.int32)
    return numbers.astype(next(kind for kind in kinds if most <= np.iinfo(kind).max), copy=False)


class PartProgram(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A part program.

    `lines` (n + 1,): the byte at which each line begins, and after the last the end of `data`; a line ends
    with its line end (LF, CR LF or CR), the last one perhaps without. `modal` the distinct modal states,
    `state` (n,) the number of the one after each block, `feeds` the F in force after each. `breaks` in order, the
    first at the beginning, the last at the end. `notes` name what was passed through. `language` is the one it was
    read in, and the one for all that is made of it. `centred` lines give the centre of an arc as a place, whatever
    the mode of centres.
    `poles` are the centres (X, Y, Z) [units] that lines of their own set, None where not known or not set;
    `centre_users` by the line of what turns about one the line that sets it, and whether that is an arc that is
    understood. `rests` [s] are times for which X, Y and Z rest on lines that move other axes, where a model of the
    controller has worked them out. `source` has the words. `origins` are the lines, from 0, by which people know those
    of a program that was made of theirs, shape (n,), None where it is theirs.
    """

    name: str
    data: bytes
    digest: str
    lines: PlaceArray
    source: WordSource
    motions: Motions
    modal: tuple[Modal, ...]
    state: NDArray[Any]
    feeds: FeedRuns
    breaks: tuple[Break, ...]
    notes: tuple[Note, ...]
    language: Language = RS274
    centred: PlaceArray = _NOWHERE
    poles: Mapping[int, tuple[float | None, ...]] = {}
    centre_users: Mapping[int, tuple[int, bool]] = {}
    rests: Mapping[int, float] = {}
    origins: IntArray | None = None

    @property
    def words(self) -> WordTable:
        """The words outside comments."""
        return self.source.get()

    @property
    def commands(self) -> WordTable:
        """The words that do more than move; see :attr:`WordSource.commands`."""
        return self.source.commands

    def word_parts(self) -> Iterator[WordTable]:
        """Yield all words, those of some lines at a time, and keep none."""
        for low in range(0, self.blocks, MANY_LINES):
            yield self.source.part(low, min(low + MANY_LINES, self.blocks))

    @property
    def blocks(self) -> int:
        """Number of lines."""
        return self.lines.size - 1

    def line_number(self, block: int) -> int:
        """Return the number, from 1, of the line of the person's own program for which a line (from 0) stands."""
        return int(block if self.origins is None else self.origins[block]) + 1

    def line_numbers(self, motions: IntArray) -> IntArray:
        """Return the numbers, from 1, of the lines of the person's own program on which motions are (k,)."""
        blocks = self.motions.block[motions].astype(np.int64)
        return (blocks if self.origins is None else self.origins[blocks]) + 1

    def line_range(self, first: int, last: int) -> tuple[int, int]:
        """Return the numbers of the first and the last line of the person's own program for which lines stand."""
        if self.origins is None:
            return int(first) + 1, int(last) + 1
        own = self.origins[first : last + 1]
        return int(own.min()) + 1, int(own.max()) + 1

    def line_words(self, first: int, last: int | None = None) -> str:
        r"""Name a line, or those up to `last`, counted from 0, as people count those of their own program.

        Examples
        --------
        >>> from ph_post.gcode.read import read_program
        >>> program = read_program(b"G21 G90\nG1 F60\nX1\nX2\nM2\n", "a.ngc")
        >>> program.line_words(2), program.line_words(0, 4)
        ('line 3', 'lines 1 to 5')
        """
        low, high = self.line_range(first, first if last is None else last)
        return f"line {low}" if low == high else f"lines {low} to {high}"

    @property
    def begin_line(self) -> int | None:
        """The line BEGIN PGM, of a language with its own reader; None where there is none before the first motion."""
        found = None if self.language.read is None else _BEGINS.search(self.data)
        line = self.blocks if found is None else int(np.searchsorted(self.lines, found.end(), side="right")) - 1
        first = int(self.motions.block[0]) if self.motions.block.size else self.blocks
        return line if line < first else None

    @property
    def threads(self) -> BoolArray:
        """Mask (m,) of the motions that are tied to the spindle (G33), where they are read as motions."""
        tied = self.tied
        if not tied.any():
            return np.zeros(self.motions.kind.size, dtype=np.bool_)
        return np.asarray(tied[self.state[self.motions.block]], dtype=np.bool_)

    @property
    def tied(self) -> BoolArray:
        """Mask of the modal states in which motions are tied to the spindle (G33)."""
        return np.array([modal.motion == "G33" for modal in self.modal], dtype=np.bool_)

    @property
    def feed_word(self) -> Array:
        """The F in force after each line, as the program has it, NaN before the first, shape (n,)."""
        return self.feeds.of(slice(None))

    def feed_after(self, block: int) -> float:
        """Return the F in force after a line, as the program has it, NaN before the first."""
        return self.feeds.at(block)

    def text(self, block: int) -> bytes:
        """Return the bytes of a line, its line end included."""
        return self.data[self.lines[block] : self.lines[block + 1]]

    def modal_after(self, block: int) -> Modal:
        """Return the modal state after a line; -1 is before the first."""
        return self.modal[self.state[block]] if block >= 0 else Modal()

    def dwells(
        self, first: int = 0, last: int | None = None, words: WordTable | None = None
    ) -> tuple[PlaceArray, Array]:
        """Return the lines of all G4 from `first` to before `last`, and their times [s], NaN where no plain number.

        `words` may stand for all words where they have those of these lines.
        """
        last = self.blocks if last is None else last
        words = self.commands if words is None else words
        rows = words.rows(first, last)
        block, letter, value = words.block[rows], words.letter[rows], words.value[rows]
        seconds = np.full(last - first, np.nan)
        timed, times = self.language.dwells(letter, value)
        seconds[block[timed] - first] = times
        lines = block[(letter == ord("G")) & (value == 4.0)]
        return lines, seconds[lines - first]

    def absolute_centres(self) -> BoolArray:
        """Return true for each line on which the centre of an arc is a place, shape (n,)."""
        absolute = np.array([modal.arc_absolute for modal in self.modal], dtype=np.bool_)
        found = np.asarray(absolute[self.state], dtype=np.bool_)
        found[self.centred] = True
        found[list(self.centre_lines)] = True
        return found

    @property
    def centre_lines(self) -> dict[int, int]:
        """By a line that sets a centre the first one with an arc about it, if it has no other user before."""
        first: dict[int, tuple[int, bool]] = {}
        for line in sorted(self.centre_users):
            pole, arc = self.centre_users[line]
            first.setdefault(pole, (line, arc))
        return {pole: line for pole, (line, arc) in first.items() if arc}

    def words_of(self, block: int) -> range:
        """Return the numbers of the words on a line."""
        return self.source.rows_of(block)


_TENS: Final = 10.0 ** np.arange(-1, 23)
"""Powers of ten from that of -1 decimals, which stands for no number, up to the last that is exact."""

_EXACT: Final = 2.0**50
"""Whole numbers below this come back from a number with decimals."""


def whole_numbers(value: Array, decimals: NDArray[np.int16]) -> IntArray:
    """Return numbers without their decimal points, 0 in the place of those that doubles do not have exactly.

    Examples
    --------
    >>> whole_numbers(np.array([1.005, -2.0, 12345678901234567.0]), np.array([3, 1, 0])).tolist()
    [1005, -20, 0]
    """
    found = np.empty(value.shape, dtype=np.int64)
    with np.errstate(all="ignore"):
        for part in in_parts(value.size):
            whole = np.rint(value[part] * _powers(decimals[part]))
            found[part] = np.where(np.abs(whole) < _EXACT, whole, 0.0)
    return found


def long_numbers(value: Array, decimals: NDArray[np.int16] | IntArray) -> IntArray:
    """Return the rows of plain numbers (decimals of 0 and more) of which doubles do not have all digits."""
    found = [np.zeros(0, dtype=np.int64)]
    with np.errstate(all="ignore"):
        for part in in_parts(value.size):
            number, places = value[part], decimals[part]
            largest = np.fmax(np.fmax.reduce(number), -np.fmin.reduce(number))
            if not largest * 10.0 ** places.max() < _EXACT:
                found.append(part.start + np.flatnonzero((places >= 0) & ~(np.abs(number * _powers(places)) < _EXACT)))
    return np.concatenate(found)


def _powers(decimals: NDArray[np.int16] | IntArray) -> Array:
    """Return ten to the power of numbers of decimals; of most from a table, as powers take long."""
    if decimals.size and int(decimals.min()) >= -1 and int(decimals.max()) + 1 < _TENS.size:
        return np.asarray(_TENS[decimals + 1])
    return np.asarray(10.0**decimals)


def span_of(blocks: PlaceArray, block: int) -> tuple[int, int]:
    """Return the first row of a block in a column of rising blocks, and the row behind its last."""
    # Of the same type: what is looked for in another would be a copy of the whole column.
    low, high = blocks.searchsorted(np.array([block, block + 1], dtype=blocks.dtype))
    return int(low), int(high)


def chain_heads(chain: NDArray[Any]) -> BoolArray:
    """Return whether each motion is the first of its chain (m,), by the numbers of the chains (m,)."""
    return np.append(True, chain[1:] != chain[:-1])[: chain.size]


def runs(mask: BoolArray) -> tuple[IntArray, IntArray]:
    """Return the first places of the true runs of a mask (n,), and the places behind their ends; (k,) each.

    Examples
    --------
    >>> runs(np.array([True, True, False, True]))
    (array([0, 3]), array([2, 4]))
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return edges[::2], edges[1::2]


def expand(first: IntArray, last: IntArray) -> tuple[IntArray, IntArray]:
    """Return all numbers of ranges ``[first, last)`` in order, and the number of the range of each.

    Examples
    --------
    >>> expand(np.array([3, 7]), np.array([5, 8]))
    (array([3, 4, 7]), array([0, 0, 1]))
    """
    size = last - first
    number = np.repeat(np.arange(first.size), size)
    begins = np.cumsum(size) - size
    return np.arange(number.size) - begins[number] + first[number], number


def number_text(value: float) -> str:
    """Write a word's number as short as it is exact.

    Examples
    --------
    >>> number_text(640.0 / 10), number_text(0.01)
    ('64', '0.01')
    """
    text = f"{value:.12f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def make_modal(row: Array) -> Modal:
    """Make the record of a row of the distinct states; what may be anything counts as not set."""
    plane, units, absolute, arc_absolute, feed_mode = (float(row[c]) for c in range(codes.PLANE, codes.FEED_MODE + 1))
    return Modal(
        motion=_word(row[codes.MOTION]),
        plane=int(plane) if plane > 0 else 17,
        units=units if units > 0 else 1e-3,
        absolute=absolute != 0.0,
        arc_absolute=arc_absolute == 1.0,
        feed_mode=int(feed_mode) if feed_mode > 0 else 0 if feed_mode == codes.UNKNOWN else 94,
        compensation=_word(row[codes.COMPENSATION]),
        length=_word(row[codes.LENGTH]),
        system=_word(row[codes.SYSTEM]),
        path=_path(row),
        retract=_word(row[codes.RETRACT]),
        spindle=f"M{row[codes.SPINDLE]:.0f}" if row[codes.SPINDLE] >= 0 else None,
        mist=_switch(row[codes.MIST]),
        flood=_switch(row[codes.FLOOD]),
        tool=_number(row[codes.TOOL]),
        prepared=_number(row[codes.PREPARED]),
        speed=_number(row[codes.SPEED]),
    )


def _word(code: float) -> str | None:
    return f"G{number_text(code / 10.0)}" if code >= 0 else None


def _number(value: float) -> float | None:
    return float(value) if value >= 0 else None


def _switch(value: float) -> bool | None:
    return bool(value) if value >= 0 else None


def _path(row: Array) -> str | None:
    word = _word(row[codes.PATH])
    if word is None:
        return None
    columns = (("P", codes.PATH_P), ("Q", codes.PATH_Q))
    extra = [f"{letter}{number_text(row[c])}" for letter, c in columns if row[c] >= 0]
    return " ".join((word, *extra))
