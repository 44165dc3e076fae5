"""The lines of a program for Heidenhain's TNC: its head, and what repeats and jumps run more than once."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Final

from ph_post.errors import InputError
from ph_post.gcode.fronts.tnc import Tnc
from ph_post.gcode.fronts.translated import (
    NOT_UNDERSTOOD,
    Remark,
    lines_of,
    read_translated,
    refuse_line,
    text_of,
)
from ph_post.gcode.reader.record import PartProgram

REPEATED: Final = "repeated part"
JUMPED: Final = "part that is jumped over or back to"


class Source:
    """The lines of a program.

    Parameters
    ----------
    data, name
        As for :func:`ph_post.gcode.reader.read.read_program`.
    plain : callable
        ``plain(line)``: what a line in capitals says, without its number, comment and end.

    Attributes
    ----------
    texts : list of str
        What each line says.

    Raises
    ------
    InputError
        Where the text is empty, or no text.
    """

    def __init__(self, data: bytes, name: str, plain: Callable[[str], str]) -> None:
        self._data, self._name, self._lines = data, name, lines_of(data, name)
        whole = (text_of(data, self._lines, number) for number in range(self._lines.size - 1))
        self.texts = [plain(line.decode("utf-8", "replace").upper()) for line in whole]

    def head(self, pattern: re.Pattern[str], what: str, expected: str) -> tuple[int, re.Match[str]]:
        """Return the number of the first line that says anything, and what it matches.

        Raises
        ------
        InputError
            Where it does not match, or nothing is said at all.
        """
        first = next((number for number, text in enumerate(self.texts) if text), None)
        if first is None:
            raise InputError(self._name, what, expected=expected, got="comments alone")
        head = pattern.match(self.texts[first])
        if head is None:
            raise self._refused(first, what, expected, self.texts[first][:40])
        return first, head

    def program(
        self, tnc: Tnc, label: re.Pattern[str], calls: Mapping[str, re.Pattern[str]], expected: str
    ) -> PartProgram:
        """Read the translation; what is repeated or jumped over is passed through.

        Parameters
        ----------
        tnc : Tnc
            That has followed all lines.
        label : pattern
            Of a label, its name the group.
        calls : mapping of str to pattern
            By what becomes of the lines between, what repeats or jumps: the label as it stands there is the
            first group, its name the last.
        expected : str
            How a label is set.

        Raises
        ------
        InputError
            Where a label is not in the program, or computed.
        """
        for first, last, what in self._stretches(label, calls, expected):
            for number in range(first, last + 1):
                if text_of(self._data, self._lines, number).strip():
                    tnc.texts[number] = NOT_UNDERSTOOD
                    tnc.remarks[number] = Remark(what=what)
        texts = [text.encode() for text in tnc.said()]
        return read_translated(self._data, self._lines, self._name, texts, tnc.remarks, in_place=False)

    def _stretches(
        self, label: re.Pattern[str], calls: Mapping[str, re.Pattern[str]], expected: str
    ) -> Iterator[tuple[int, int, str]]:
        """Find the lines that repeats run more than once, and jumps perhaps not, or more than once."""
        set_at = [label.search(text) for text in self.texts]
        labels = {found[1]: number for number, found in enumerate(set_at) if found}
        for number, text in enumerate(self.texts):
            for what, pattern in calls.items():
                call = None if set_at[number] else pattern.search(text)
                if call is None:
                    continue
                place = labels.get(call.groups()[-1])
                if place is None:
                    raise self._refused(
                        number, "label that is not known", f"{expected} in the program", call[1]
                    )
                yield min(place, number), max(place, number), what

    def _refused(self, number: int, what: str, expected: str, got: str) -> InputError:
        return refuse_line(self._data, self._lines, self._name, number, what, expected, got)
