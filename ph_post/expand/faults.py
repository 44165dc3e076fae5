"""Why a program cannot be written out, and where."""

from __future__ import annotations

from typing import Final

MOST_CALLS: Final = 10
"""Subprograms that may call each other: LinuxCNC's own bound, and that of programs for Fanuc here."""


class ExpandError(Exception):
    """A program cannot be written out: what is wrong, what was expected, and the line (from 1) of a file.

    Parameters
    ----------
    what : str
    expected, got : str, optional
    """

    def __init__(self, what: str, *, expected: str = "", got: str = "") -> None:
        super().__init__(what)
        self.what, self.expected, self.got = what, expected, got
        self.file, self.line = "", 0

    def at(self, file: str, line: int) -> ExpandError:
        """Name the place, unless it has one that is nearer."""
        if not self.line:
            self.file, self.line = file, line
        return self


class NotExpandableError(ExpandError):
    """The machine decides: a probe, an input, or a place that is not known."""
