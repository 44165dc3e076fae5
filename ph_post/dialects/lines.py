"""Write moves as lines of text in the words of a dialect."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ph_post.gcode.blocks import ARC, JOG, LINE, POLYNOMIAL, SPLINE, Moves
from ph_post.gcode.program import CENTERS, plane_of
from ph_post.types import IntArray
from ph_post.units import MINUTE, MM_PER_MIN

if TYPE_CHECKING:
    from ph_post.dialects.base import Dialect

_SPLINE_END_WORDS = {"X": "P", "Y": "Q"}


class LineWriter:
    """Collects lines and keeps the modal state that the controller will have.

    What is written here are RS274 words. A language that has others (see `Dialect.writer`) overrides what
    differs: :meth:`feed_mode`, :meth:`path_mode`, :meth:`write_straight`, :meth:`write_arc`,
    :meth:`write_spline`, :meth:`write_polynomial`, :meth:`write_dwell`, or :meth:`moves` as a whole. One move
    may take several lines.

    Parameters
    ----------
    dialect : Dialect
    axes : sequence of str
        Names of the coordinates of the moves, in their order.
    tolerance : float
        How far joints may be rounded [m], where the dialect can say so.

    Attributes
    ----------
    lines : list of str
    sizes : list of int
        Bytes of each move on the path.
    rapid_speed : float
        F of rapids [m/s], where the dialect needs one (`Syntax.rapid_feed`).
    """

    def __init__(self, dialect: Dialect, axes: Sequence[str], tolerance: float) -> None:
        self.lines: list[str] = []
        self.sizes: list[int] = []
        self.rapid_speed = 0.0
        self.dialect, self.syntax = dialect, dialect.syntax
        self._length, self._digits = dialect.numbers.length, dialect.numbers.feed
        self.axes = tuple(axes)
        self._tolerance = tolerance
        self._plane, self._sense = plane_of(self.axes)
        self._at: dict[str, int] = {}
        self._motion = ""
        self._feed = ""
        self._inverse = False
        self._path_mode = ""

    def add(self, lines: Iterable[str]) -> None:
        """Add lines that change nothing which is kept here."""
        self.lines += lines

    def feed_mode(self, *, inverse: bool) -> None:
        """Write G93 or G94 where the other is in force; the feed has to be given anew after it."""
        if inverse != self._inverse:
            self.lines.append("G93" if inverse else "G94")
            self._inverse, self._feed = inverse, ""

    def path_mode(self, *, exact: bool) -> None:
        """Make the controller reach every point, or let it round the joints, where the dialect can say so."""
        if self.syntax.path_mode is None:
            return
        word = self.syntax.path_mode(None if exact else self._tolerance)
        if word != self._path_mode:
            self.lines += word.split("\n")
            self._path_mode = word

    def plane(self, word: str) -> None:
        """Write G17, G18 or G19 where another plane is in force; at first it is that of the first two axes."""
        if word != self._plane:
            self.lines.append(word)
            self._plane = word

    def straight(self, word: str, target: dict[str, int], speed: float = 0.0) -> None:
        """Write a G0 or a G1 [m/s] to positions on the grid, by axis."""
        words = [
            axis + self._length(count)
            for axis, count in target.items()
            if not self.syntax.terse or self._at.get(axis) != count
        ]
        if words:
            self.write_straight(word, words, self._digits(speed / MM_PER_MIN) if speed else "")
        self._at.update(target)

    def moves(self, moves: Moves, first: int, last: int) -> None:
        """Write the moves numbered `first` to `last` - 1."""
        bodies = self._coordinates(moves, first, last)
        feeds = self._feeds(moves, first, last)
        kinds, rapid = moves.kind[first:last].tolist(), moves.rapid[first:last].tolist()
        for i, (kind, body, feed) in enumerate(zip(kinds, bodies, feeds, strict=True), first):
            before = len(self.lines)
            if kind in (LINE, JOG):
                self.write_straight("G0" if rapid[i - first] else "G1", body, feed)
            elif kind == ARC:
                self.write_arc(moves, i, body, feed)
            elif kind == SPLINE:
                self.write_spline(moves, i, body, feed)
            elif kind == POLYNOMIAL:
                self.write_polynomial(moves, i, feed)
            else:
                self.write_dwell(float(moves.duration[i]))
            self.sizes.append(sum(len(line) + 1 for line in self.lines[before:]))
        self._at.update(zip(self.axes, moves.points[last].tolist(), strict=True))

    def write_straight(self, word: str, body: list[str], feed: str) -> None:
        """Write a G0 or a G1 with its coordinate words; `feed` is its F, empty where it has none."""
        if word == "G0" and self.syntax.rapid_feed:
            feed = self._digits(self.rapid_speed / MM_PER_MIN)
        self._write(word, body, feed)
        if word == "G0" and self.syntax.rapid_feed:
            # Some firmware keeps the F of G0 apart, some does not: the next G1 says its own.
            self._feed = ""

    def write_arc(self, moves: Moves, i: int, body: list[str], feed: str) -> None:
        """Write move `i`, an arc in the plane of the first two axes; `body` are the words of its end."""
        self.arc(body, self._center(moves, i), self._left(moves, i), feed)

    def arc(self, end_words: list[str], offset_words: list[str], left: bool, feed: str) -> None:
        """Write an arc in the plane in force, a full circle where it ends at its start.

        Parameters
        ----------
        end_words : list of str
            Coordinate words of its end.
        offset_words : list of str
            Words of its centre, counted from its start.
        left : bool
            Whether it turns counterclockwise in its plane.
        feed : str
            Its F, empty where it has none; written where it changes.
        """
        self._write("G3" if left else "G2", [*end_words, *offset_words], feed)

    def write_spline(self, moves: Moves, i: int, body: list[str], feed: str) -> None:
        """Write move `i`, a planar cubic; `body` are the words of its end."""
        self._write("G5", body + self._inner(moves, i), feed)

    def write_polynomial(self, moves: Moves, i: int, feed: str) -> None:
        """Write move `i`, a polynomial of each axis: only languages that have them get any."""
        raise NotImplementedError(self.dialect.name)

    def write_dwell(self, seconds: float) -> None:
        """Let the axes stand."""
        word, *words = self.dialect.dwell_words(seconds)
        self._write(word, words, "", modal=False)

    def _coordinates(self, moves: Moves, first: int, last: int) -> list[list[str]]:
        """Coordinate words of each move; jogs have those that change, as all moves of terse dialects."""
        points, kind = moves.points[first : last + 1], moves.kind[first:last]
        needed = np.diff(points, axis=0) != 0
        needed[:, :2] |= (kind == ARC)[:, None]
        if not self.syntax.terse:
            needed |= (kind != JOG)[:, None]
        columns = [
            [axis + self._length(count) if need else "" for count, need in zip(column, needs, strict=True)]
            for axis, column, needs in zip(self.axes, points[1:].T.tolist(), needed.T.tolist(), strict=True)
        ]
        return [[word for word in words if word] for words in zip(*columns, strict=True)]

    def _feeds(self, moves: Moves, first: int, last: int) -> list[str]:
        part = slice(first, last)
        values = moves.feed[part] / MM_PER_MIN
        if self._inverse:
            # A jog takes longer than at its feed, which it hardly reaches.
            jogs = moves.kind[part] == JOG
            time = moves.duration[part].copy()
            time[jogs] = moves.length[part][jogs] / moves.feed[part][jogs]
            values = MINUTE / time
        cutting = moves.feed[first:last] > 0.0
        digits = self.dialect.numbers.inverse_time if self._inverse else self._digits
        return [digits(value) if cuts else "" for value, cuts in zip(values.tolist(), cutting.tolist(), strict=True)]

    def _left(self, moves: Moves, i: int) -> bool:
        """Return True if an arc is counterclockwise in its plane."""
        return bool(moves.turn[i] * self._sense > 0)

    def _place(self, counts: IntArray) -> list[str]:
        """Absolute words of a place, by its first coordinates."""
        return [axis + self._length(n) for axis, n in zip(self.axes, counts.tolist(), strict=False)]

    def _speed(self, feed: str) -> list[str]:
        """F only where it changes, except under G93, where every move has its own."""
        if not feed or (feed == self._feed and not self._inverse):
            return []
        self._feed = feed
        return ["F" + feed]

    def _center(self, moves: Moves, i: int) -> list[str]:
        offsets = (moves.center[i] - moves.points[i, :2]).tolist()
        return [CENTERS[axis] + self._length(n) for axis, n in zip(self.axes[:2], offsets, strict=True)]

    def _inner(self, moves: Moves, i: int) -> list[str]:
        near = (moves.inner[i, 0] - moves.points[i]).tolist()
        far = (moves.inner[i, 1] - moves.points[i + 1]).tolist()
        words = [CENTERS[axis] + self._length(n) for axis, n in zip(self.axes, near, strict=True)]
        return words + [_SPLINE_END_WORDS[axis] + self._length(n) for axis, n in zip(self.axes, far, strict=True)]

    def _write(self, word: str, words: list[str], feed: str, *, modal: bool = True) -> None:
        """One line."""
        able = self.syntax.terse and self.syntax.modal_motion
        repeats = able and modal and word == self._motion
        named = [] if repeats else [word]
        if modal:
            self._motion = word
        parts = [*named, *words, *self._speed(feed)]
        self.lines.append(("" if self.syntax.terse else " ").join(parts))
