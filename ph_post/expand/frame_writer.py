"""Write turned and mirrored coordinates out, frame by frame: one that has to stay is told, the others are written."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Final

from ph_post.expand.progress import WrittenLines, origins_within

_MOST_STANDING: Final = 20
"""Frames of one program that are tried in vain."""


class FrameStandsError(Exception):
    """A frame, by the row of its definition, that has to stay as it is, and why; all of them where it is None."""

    def __init__(self, row: int | None, why: str) -> None:
        super().__init__(why)
        self.row, self.why = row, why


class FrameWriter(ABC):
    """Writes out what moves in turned or mirrored coordinates, whatever the language.

    Attributes
    ----------
    notes : dict of str to int
        Frames that stay as they are, and why, with the first line of each kind, from 1.
    """

    def __init__(self) -> None:
        self.notes: dict[str, int] = {}

    def written(self) -> WrittenLines:
        """Return the lines, and which of those that were read each comes of."""
        rows = self._read()
        standing = set[int]()
        while self._first is not None and len(standing) < _MOST_STANDING:
            try:
                made = self._made(standing)
            except FrameStandsError as error:
                row = self._first if error.row is None else error.row
                self.notes.setdefault(f"{self._words(row)} stays as it is: {error.why}", rows[row][0] + 1)
                if error.row is None:
                    break
                standing.add(error.row)
                continue
            return _together(rows, made)
        return _together(rows, [lines for _, lines in rows])

    @property
    @abstractmethod
    def _first(self) -> int | None:
        """The row of the first definition of a frame, None where there is none."""

    @abstractmethod
    def _read(self) -> list[tuple[int, list[str]]]:
        """Return of each row of the program its first line, from 0, and its lines."""

    @abstractmethod
    def _words(self, row: int) -> str:
        """Return the words of a row, for messages."""

    @abstractmethod
    def _made(self, standing: set[int]) -> list[list[str]]:
        """Return the lines that each row becomes, with frames that are defined in `standing` rows left as they are.

        Raises
        ------
        FrameStandsError
            Where another one has to stay, too.
        """


def _together(rows: list[tuple[int, list[str]]], made: list[list[str]]) -> WrittenLines:
    texts, origins = list[str](), list[int]()
    for (first, had), lines in zip(rows, made, strict=True):
        texts += lines
        origins += origins_within(first, len(had), len(lines))
    return WrittenLines(texts, origins)
