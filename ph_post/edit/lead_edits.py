"""Stretches of a program that are led: chords of the command of a table in place of the program's own lines."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.compiling import compiled
from ph_post.dialects.base import Dialect
from ph_post.edit import block_words
from ph_post.edit.changes import Change, ChangeWriter
from ph_post.edit.edits import no_offsets
from ph_post.edit.preconditions import word_decimals
from ph_post.edit.word_shifts import motion_offsets
from ph_post.gcode.program import AXES, CUBIC, RAPID, PartProgram
from ph_post.types import Array, BoolArray, IntArray
from ph_post.units import MINUTE, MM

LABEL: Final = "lead"
"""Word of a mark by which the checker knows a stretch that is led."""

LEAST_STEPS: Final = 2
"""Last decimals that a chord is long at least."""

SLOWEST: Final = 1.0e-3 / MINUTE
"""Least feed that is written [m/s]: where the command all but rests, its time need not be kept."""

BACK: Final = 5.0e-3
"""Speed [m/s] at which an axis gives back what it still carries at the end of a stretch."""

SAME: Final = 1e-9
"""Lengths [m] that differ by no more are the same number."""

_PLAIN_WORDS: Final = frozenset("NXYZIJKRFG")
_PLAIN_CODES: Final = (0.0, 1.0, 2.0, 3.0)
_SPLINE_WORDS: Final = _PLAIN_WORDS | {"P", "Q"}
_SPLINE_CODES: Final = (5.0, 5.1)
"""Those of a cubic; in an arc P counts turns."""
_COMMENT: Final = re.compile(r"\([^)]*\)|;.*")


class Approach(msgspec.Struct, frozen=True, kw_only=True):
    """An axis comes onto its side of the backlash in the air.

    From `beyond` its place it goes to `offset` [m] beside it, at `speed` [m/s].
    """

    axis: str
    beyond: float
    offset: float
    speed: float


class LeadStretch(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A stretch of cutting motions from rest to rest, and the command in its place.

    The motions from `first` to `last`; `t` (n,) [s] and `position` (n, dim) [m] the rows of the command in the `axes`;
    `pause` [s] how long the path rests before it, until the servos have come to its start,
    and before the motion `after_rapid` too, where other moves lead from a rapid to it. `approaches` bring axes onto
    their sides of the backlash before that motion, which the stretch begins with then: the moves from it to `first`
    carry their offsets, and the command begins with them.
    """

    first: int
    last: int
    axes: tuple[str, ...]
    t: Array
    position: Array
    pause: float = 0.0
    after_rapid: int | None = None
    approaches: tuple[Approach, ...] = ()

    @property
    def begin(self) -> int:
        """The motion with whose line it begins."""
        return self.first if self.after_rapid is None or not self.approaches else self.after_rapid

    @property
    def pauses(self) -> int:
        """Number of its rests."""
        return 0 if self.pause == 0.0 else 1 if self.after_rapid is None else 2


def why_not_led(program: PartProgram, first: int, last: int) -> str:
    r"""Return the reason why chords cannot stand in place of the lines of some motions; empty where they can.

    Examples
    --------
    >>> from ph_post.dialects.reading import read_as
    >>> program = read_as("linuxcnc", b"G1 X1 Y1 F100\nX2\nM8\nX3\nM2\n", "part")
    >>> why_not_led(program, 0, 1), why_not_led(program, 0, 2)
    ('', 'line 3 is no move')
    >>> why_not_led(read_as("linuxcnc", b"G1 X1 Y1 F100\nG91 X1\nZ-1\nM2\n", "part"), 2, 2)
    'G91 alone moves Z in line 3, and where it is under G90 is not known'
    """
    motions, words = program.motions, program.words
    begin, end = motions.block[[first, last]].tolist()
    moves = {int(block): row for row, block in enumerate(motions.block[first : last + 1].tolist(), first)}
    placed = _placed(program, first)
    for block in range(begin, end + 1):
        own = program.words_of(block)
        letters = {chr(int(words.letter[word])) for word in own}
        codes = [float(words.value[word]) for word in own if words.letter[word] == ord("G")]
        plain = letters <= _PLAIN_WORDS and all(code in _PLAIN_CODES for code in codes)
        if block in moves and motions.kind[moves[block]] == CUBIC:
            plain = letters <= _SPLINE_WORDS and all(code in _SPLINE_CODES for code in codes)
        if not plain or (block not in moves and letters - {"N", "F"}):
            return f"{program.line_words(block)} is {'no move' if block not in moves else 'more than a move'}"
        if program.text(block).lstrip().startswith(b"/"):
            return f"{program.line_words(block)} may be skipped (/)"
        modal = program.modal_after(block)
        if modal.feed_mode != 94:
            return f"{program.line_words(block)} is not in feed per minute (G94)"
        if block in moves and (why := _why_elsewhere(program, moves[block], placed)):
            return why
    if (motions.kind[first : last + 1] == RAPID).any():
        return f"{program.line_words(begin)} is a rapid"
    return ""


def _why_elsewhere(program: PartProgram, motion: int, placed: BoolArray) -> str:
    """Return why a motion leads to other places than its line says, or to places that nobody knows."""
    motions, words = program.motions, program.words
    block = int(motions.block[motion])
    modal = program.modal_after(block)
    for word in program.words_of(block):
        letter = chr(int(words.letter[word]))
        if letter not in AXES:
            continue
        if letter == "X" and program.language.diameters:
            return f"X is a diameter in {program.line_words(block)}"
        column, place = AXES.index(letter), float(words.value[word]) * modal.units
        if not (modal.absolute or placed[column]):
            return f"G91 alone moves {letter} in {program.line_words(block)}, and where it is under G90 is not known"
        if modal.absolute and not abs(place - motions.end[motion, column]) <= SAME:
            return f"the place of {letter} in {program.line_words(block)} is not the word's own"
    return ""


def _placed(program: PartProgram, motion: int) -> BoolArray:
    """Mask (3,) of the axes that a motion's chain moves to a place under G90: of the others no place can be written."""
    motions = program.motions
    modes = np.array([modal.absolute for modal in program.modal], dtype=np.bool_)[program.state[motions.block]]
    moves = (motions.start != motions.end) & ~np.isnan(motions.end)
    return np.asarray((moves & (modes & (motions.chain == motions.chain[motion]))[:, None]).any(axis=0))


@compiled
def chord_ends(position: Array, least: int, most: int, tolerance: float) -> IntArray:
    """Choose rows between which the rows are straight within a tolerance.

    Parameters
    ----------
    position : Array, shape (n, dim)
        Rows of a command [m].
    least, most : int
        Rows that a chord lasts, unless it is the last one.
    tolerance : float
        Largest distance of a row from its chord [m]; chords of the least length may be farther.

    Returns
    -------
    IntArray
        From row 0 to the last one.
    """
    count = position.shape[0]
    found = np.empty(count, dtype=np.int64)
    found[0], number, begin = 0, 1, 0
    while begin < count - 1:
        end = min(begin + least, count - 1)
        while end < min(begin + most, count - 1):
            square, worst = 0.0, 0.0
            for k in range(position.shape[1]):
                square += (position[end + 1, k] - position[begin, k]) ** 2
            for row in range(begin + 1, end + 1):
                along, own = 0.0, 0.0
                for k in range(position.shape[1]):
                    way = position[row, k] - position[begin, k]
                    along += way * (position[end + 1, k] - position[begin, k])
                    own += way * way
                share = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
                worst = max(worst, own - 2.0 * share * along + share * share * square)
            if worst > tolerance * tolerance:
                break
            end += 1
        found[number] = end
        number += 1
        begin = end
    return found[:number]


class LeadWriter(ChangeWriter):
    """Writes stretches that are led.

    Parameters
    ----------
    program : PartProgram
    dialect : Dialect
    tolerance : float
        Largest distance of a row of the command from its chord, and largest rounding of joints [m].
    least, most : float
        Durations of a chord [s].
    """

    def __init__(self, program: PartProgram, dialect: Dialect, tolerance: float, least: float, most: float) -> None:
        units = program.modal_after(int(program.motions.block[0])).units if program.motions.block.size else 1e-3
        decimals = word_decimals(dialect, units)
        carried = motion_offsets(no_offsets(program.motions.kind.size), [], 1.0)
        super().__init__(program, dialect, carried, decimals, tolerance, 0.0, lambda _: {})
        self._least, self._most = least, most

    def changes(self, stretches: Iterable[LeadStretch]) -> Iterator[Change]:
        """Write the changes of all stretches, which come in the order of travel."""
        for one in stretches:
            begin, end = self._program.motions.block[[one.begin, one.last]].tolist()
            if one.after_rapid is not None and one.pause > 0.0 and not one.approaches:
                yield from self._rest_before(one.after_rapid, one.pause)
            yield from self._move_to(begin)
            self._stretch(one, begin, end)
        yield from self._move_to(self._program.blocks + 1)

    def _rest_before(self, motion: int, pause: float) -> Iterator[Change]:
        block = int(self._program.motions.block[motion])
        yield from self._move_to(block)
        self._open(block, 0, block - 1)
        assert self._change is not None
        self._change.label.append("rest")
        self._rest(pause)

    def _stretch(self, one: LeadStretch, begin: int, end: int) -> None:
        self._open(begin, 0, begin - 1)
        change, modal = self._change, self._program.modal_after(end)
        assert change is not None
        change.label.append(LABEL)
        change.removed += end + 1 - begin
        change.lines += [text for block in range(begin, end + 1) for text in _comments(self._program, block)]
        relative = not modal.absolute
        change.lines += ["G90"] if relative else []
        self._approach(one, modal.units)
        self._rest(one.pause)
        mode = self._dialect.syntax.path_mode
        # A mode that the program does not name could not be set back.
        if mode is not None and self._path is not None and modal.path is not None:
            wanted = mode(self._tolerance * MM / modal.units)
            change.lines += [wanted] if wanted != self._path else []
            self._path = wanted
        self._chords(one, modal.units)
        change.lines += ["G91"] if relative else []

    def _approach(self, one: LeadStretch, units: float) -> None:
        """Bring axes onto their sides in the air, rest, and go on to the first chord by the program's own moves."""
        motions, step = self._program.motions, units * 10.0**-self._fine
        for way in one.approaches:
            column = AXES.index(way.axis)
            for place in (way.beyond, way.offset):
                count = round((motions.start[one.begin, column] + place) / step)
                self._straight([self._length(way.axis, count)], self._digits(way.speed / units * MINUTE))
        if one.begin < one.first:
            self._rest(one.pause)
        for motion in range(one.begin, one.first):
            end = motions.end[motion]
            moved = np.flatnonzero(~np.isnan(end) & (end != motions.start[motion])).tolist()
            body = [self._length(AXES[column], round(motions.end[motion, column] / step)) for column in moved]
            if body:
                self._straight(body, self._digits(motions.feeds.at(motion) / units * MINUTE))

    def _length(self, name: str, count: int) -> str:
        return name + self._dialect.numbers.length(count, self._fine)

    def _chords(self, one: LeadStretch, units: float) -> None:
        """Write the chords; they begin and end where the program's own motions do, and at their offsets."""
        motions = self._program.motions
        columns = [AXES.index(name) for name in one.axes]
        start, goal = motions.start[one.first, columns], motions.end[one.last, columns]
        offsets = {way.axis: way.offset for way in one.approaches}
        start = start + np.array([offsets.get(name, 0.0) for name in one.axes])
        rows = np.vstack([one.position, goal])
        away = float(np.linalg.norm(one.position[-1] - goal))
        period = float(one.t[1] - one.t[0])
        least, most = (max(round(time / period), 1) for time in (self._least, self._most))
        ends = chord_ends(np.ascontiguousarray(one.position), least, most, self._tolerance)
        times = np.append(one.t[ends], one.t[-1] + away / BACK)
        step = units * 10.0**-self._decimals
        counts = np.rint(rows[np.append(ends, len(rows) - 1)] / step).astype(np.int64)
        scale = 10 ** (self._fine - self._decimals)
        at, since = np.rint(start / step).astype(np.int64), float(one.t[0])
        kept: list[tuple[IntArray, float]] = []
        for row, time in zip(counts, times.tolist(), strict=True):
            way = float(np.linalg.norm(row - at))
            if way >= LEAST_STEPS:
                kept.append((row, way * step / (time - since) if time > since else BACK))
                at, since = row, time
        last = np.rint(goal / (units * 10.0**-self._fine)).astype(np.int64)
        ways = [(row * scale, speed) for row, speed in kept]
        if ways and np.abs(ways[-1][0] - last).max() <= LEAST_STEPS * scale:
            ways[-1] = (last, ways[-1][1])
        else:
            ways.append((last, BACK))
        before: Sequence[int] = np.rint(start / (units * 10.0**-self._fine)).astype(np.int64).tolist()
        for place, speed in ways:
            body = [
                self._length(name, int(count))
                for name, count, had in zip(one.axes, place.tolist(), before, strict=True)
                if count != had
            ]
            if not body:
                continue
            self._straight(body, self._digits(max(speed, SLOWEST) / units * MINUTE))
            before = place.tolist()

    def _straight(self, body: list[str], feed: str) -> None:
        assert self._change is not None
        word = [] if self._mode == "G1" and self._dialect.syntax.modal_motion else ["G1"]
        more = [f"F{feed}"] if feed != self._feed else []
        self._change.lines.append(self._joined(*word, *body, *more))
        self._mode, self._feed = "G1", feed


def _comments(program: PartProgram, block: int) -> list[str]:
    """Comments of a line, which stay when its words do not."""
    return _COMMENT.findall(block_words.line_text(program, block))
