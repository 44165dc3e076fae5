"""Follow a program in the plane of X and Y as far as its corners need it, whatever its language."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from typing import Generic, Protocol, TypeVar

import msgspec

from ph_post.expand.corners import Corner, Element, Kind, corner_between
from ph_post.expand.faults import NotExpandableError
from ph_post.expand.progress import WrittenLines, origins_within


class CornerMove(Protocol):
    """A move beside a corner: what it is in the plane, None where that is not known, and its F, empty for none."""

    element: Element | None

    @property
    def feed(self) -> str:
        """The number of its F word."""


Move = TypeVar("Move", bound=CornerMove)


class OpenCorner(msgspec.Struct, Generic[Move], frozen=True, kw_only=True):
    """A corner whose move behind it is not read yet.

    `words` are its own, for notes; `own_feed` is that of the corner alone, empty for none; `before` is the move before
    it, which stands in row `move_row` of what is written, and it in row `row`.
    """

    words: str
    kind: Kind
    size: float
    own_feed: str
    before: Move
    move_row: int
    row: int


class CornerFollower(ABC, Generic[Move]):
    """Follows places and feed, and keeps the corner that waits for the move behind it.

    Attributes
    ----------
    notes : dict of str to int
        Corners that stay as they are, and why, with the first line of each kind, from 1.
    """

    def __init__(self) -> None:
        self.notes: dict[str, int] = {}
        self._out: list[list[str]] = []
        """Lines written so far, those of one that was read in one row."""
        self._at: dict[str, float] = {}
        self._plane, self._scaled = True, False
        self._feed = ""
        self._open: OpenCorner[Move] | None = None

    @abstractmethod
    def _write(self, opened: OpenCorner[Move], after: Move) -> None:
        """Write a corner between two known elements, and them: `NotExpandableError` where it has to stay."""

    def _place(self) -> complex | None:
        return complex(self._at["X"], self._at["Y"]) if {"X", "Y"} <= self._at.keys() else None

    def _go(self, ends: Mapping[str, float], steps: Collection[str]) -> tuple[complex, complex] | None:
        """Follow a move to `ends`, of axes in `steps` from where they are; return both ends of it in the plane.

        None where they are not known, or the move leaves the plane.
        """
        start, height = self._place(), self._at.get("Z")
        for axis, value in ends.items():
            here = self._at.pop(axis, None)
            base = here if axis in steps else 0.0
            if base is not None:
                self._at[axis] = base + value
        end = self._place()
        known = self._plane and self._at.get("Z") == height
        return (start, end) if known and start is not None and end is not None else None

    def _finish(self, after: Move) -> bool:
        """Write the corner before a move; False where there is none, or it stays."""
        opened, self._open = self._open, None
        if opened is None:
            return False
        try:
            if math.isnan(opened.size):
                raise NotExpandableError("a length without a decimal point, which the control's setting decides")
            if self._scaled:
                raise NotExpandableError("whether its size is scaled too is not said")
            if opened.before.element is None or after.element is None:
                raise NotExpandableError("one of its moves is no cut in the plane of X and Y from a known place")
            self._write(opened, after)
        except NotExpandableError as error:
            self._stays(opened.words, error.what, opened.row)
            return False
        return True

    def _cut(self, opened: OpenCorner[Move], after: Move) -> Corner:
        """Work a corner out, and end the elements beside it where it begins and ends."""
        before = opened.before
        assert before.element is not None
        assert after.element is not None
        if opened.own_feed and not (after.feed or self._feed):
            raise NotExpandableError("it has a feed, and that behind it is not known")
        found = corner_between(before.element, after.element, opened.kind, opened.size)
        before.element = msgspec.structs.replace(before.element, end=found.begin)
        after.element = msgspec.structs.replace(after.element, start=found.end)
        return found

    def _close(self, why: str) -> None:
        """Leave the corner that is open as it is."""
        if self._open is not None:
            self._stays(self._open.words, why, self._open.row)
        self._open = None

    def _stays(self, words: str, why: str, row: int) -> None:
        self.notes.setdefault(f"{words} stays as it is: {why}", self._read_in(row)[0] + 1)

    def _written(self) -> WrittenLines:
        """Return what was written, and the line, from 0, of what was read that each line comes of."""
        texts, origins = list[str](), list[int]()
        for row, lines in enumerate(self._out):
            texts += lines
            origins += origins_within(*self._read_in(row), len(lines))
        return WrittenLines(texts, origins)

    def _read_in(self, row: int) -> tuple[int, int]:
        """Return the first line, from 0, that was read for a row of what is written, and how many they were."""
        return row, 1
