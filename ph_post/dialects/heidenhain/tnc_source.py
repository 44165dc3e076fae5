"""The lines of a program of Heidenhain's TNC, in either language: its head, and labels, repeats and jumps."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from decimal import Decimal
from functools import cached_property
from typing import Final, Protocol

import msgspec
from msgspec.structs import replace

from ph_post.dialects.heidenhain.tnc import CallLeaves, StaysInForce, Tnc
from ph_post.dialects.reading import XYZ_ONLY, Remark, line_error, read_translated, text_of
from ph_post.errors import InputError, printable
from ph_post.gcode.program import PartProgram, WordTable
from ph_post.gcode.words import lines_of

_ROOM: Final = 1000
_FOREIGN: Final = re.compile(rf"(?![^\W\d])[^\x00-\x7f]|\d{{{_ROOM},}}")
"""Blanks, digits and signs that no control knows, all but letters of names; numbers longer than it has room for."""

_NESTED: Final = 20
"""Calls within calls that no control follows any more."""

REPEATED: Final = "repeated part"
JUMPED: Final = "part that is jumped over or back to"
_CALLED: Final = "part that is called from elsewhere"


class TncRows(Protocol):
    """Makes the word table of a program, line by line."""

    def add(self, block: int, base: int, line: str, feed: Decimal | None = None) -> None:
        """Add the words of a line whose first byte is at `base`; `feed` is what a parameter gives it."""

    def table(self) -> WordTable:
        """Return the table."""


class TncLanguage(msgspec.Struct, frozen=True, kw_only=True):
    """Frame, labels and jumps of one of the two languages.

    Parameters
    ----------
    plain : callable
        ``plain(line)``: a line in capitals without its number, comment and end.
    head : pattern
        Of the first line.
    refusal, expected_head : str
        What a program is called whose first line does not match, and what is expected there.
    label : pattern
        Of a label, its name the group.
    calls : mapping of str to pattern
        By what becomes of the lines between, what repeats or jumps: the label as it stands there is the
        first group, its name the last.
    called, computed, ends : pattern
        Of a call that comes back, its label as of `calls`; of one of a label that none of these is; and of the label
        that ends what is called.
    in_force : callable
        ``in_force(line)``: what a line leaves in force.
    rows : callable
        Makes the rows of a word table.
    """

    plain: Callable[[str], str]
    head: re.Pattern[str]
    refusal: str
    expected_head: str
    label: re.Pattern[str]
    calls: Mapping[str, re.Pattern[str]]
    called: re.Pattern[str]
    computed: re.Pattern[str]
    ends: re.Pattern[str]
    in_force: Callable[[str], StaysInForce]
    rows: Callable[[], TncRows]


def _own(text: str) -> str:
    """Put a sign that nothing understands in the place of all that is foreign to a control."""
    if text.isascii() and len(text) < _ROOM:
        return text
    return _FOREIGN.sub(lambda found: "\ufffd" * len(found[0]), text)


class TncSource:
    """The lines of a program.

    Parameters
    ----------
    data, name
        As for :func:`ph_post.gcode.read.read_program`.
    language : TncLanguage

    Attributes
    ----------
    texts : list of str
        The plain text of each line.

    Raises
    ------
    InputError
        Where the text is empty, or no text.
    """

    def __init__(self, data: bytes, name: str, language: TncLanguage) -> None:
        self._data, self._name, self._lines, self._language = data, name, lines_of(data, name), language
        whole = (text_of(data, self._lines, number) for number in range(self._lines.size - 1))
        self.texts = [language.plain(_own(line.upper().decode("utf-8", "replace"))) for line in whole]
        self._calls_leave: dict[int, CallLeaves] = {}
        self._set_at = [language.label.search(text) for text in self.texts]
        self._labels = {found[1]: number for number, found in enumerate(self._set_at) if found}
        self._ends = [number for number, text in enumerate(self.texts) if language.ends.search(text)]

    def head(self) -> tuple[int, re.Match[str]]:
        """Return the number of the line with which the program begins, and its match as a head.

        Raises
        ------
        InputError
            If no line matches.
        """
        what, expected = self._language.refusal, self._language.expected_head
        for number, text in enumerate(self.texts):
            head = self._language.head.match(text)
            if head is not None:
                return number, head
        first = next((number for number, text in enumerate(self.texts) if text), None)
        if first is None:
            raise InputError(self._name, what, expected=expected, got="comments alone")
        raise self._refused(first, what, expected, self.texts[first][:40])

    def program(self, tnc: Tnc, *, contours: bool = False) -> PartProgram:
        """Read the translation by `tnc`, which has followed all lines; pass repeats and jumps through."""
        for first, last, what in list(self._stretches()):
            own = {tnc.side_in(first - 1), *(one.side for one in self._in_force[first : last + 1])} - {None}
            if what not in (REPEATED, _CALLED) and len(own) > 1:
                behind = range(last + 1, len(self.texts))
                until = next((line for line in behind if self._in_force[line].side is not None), len(self.texts))
                tnc.doubt_side(last + 1, until - 1)
            own_lines = [line for line in range(first, last + 1) if text_of(self._data, self._lines, line).strip()]
            tnc.pass_through(own_lines, jumped=what not in (REPEATED, _CALLED))
            tnc.remarks |= dict.fromkeys(own_lines, Remark(what=what))
        texts = [text.encode() for text in tnc.with_modes()]
        found = self._language.rows()
        for number in range(self._lines.size - 1):
            line = _own(text_of(self._data, self._lines, number).decode("latin-1"))
            found.add(number, int(self._lines[number]), line, feed=tnc.feeds.get(number))
        program = read_translated(
            self._data,
            self._lines,
            self._name,
            texts,
            tnc.remarks,
            in_place=False,
            language=replace(XYZ_ONLY, contours=contours),
            words=found.table(),
        )
        moves = set(program.motions.block.tolist())
        return replace(
            program,
            # The plane of a circle is that of its own centre, and no mode.
            modal=tuple(replace(one, plane=17) for one in program.modal),
            poles=tnc.poles,
            centre_users={
                **{line: (pole, line in moves) for line, pole in tnc.arcs.items()},
                **{line: (pole, False) for line, pole in tnc.users.items()},
            },
        )

    def left_by(self, number: int) -> CallLeaves | None:
        """Return what a line leaves in force that calls a label; None where it calls none."""
        called = self._called_by(number)
        return None if called is None else self._left_by(*called, deep=0)

    def _left_by(self, first: int, last: int, deep: int) -> CallLeaves:
        """Return what lines leave in force, with what they call; where one jumps they end nothing."""
        if first in self._calls_leave or deep == _NESTED:
            return self._calls_leave.get(first, CallLeaves())
        jumps = any(self._language.calls[JUMPED].search(text) for text in self.texts[first : last + 1])
        side: str | None = None
        turns = dict[str, bool]()
        for number in range(first, last + 1):
            called = self._called_by(number)
            own = self._in_force[number] if called is None else self._left_by(*called, deep=deep + 1)
            side = side if own.side is None or (jumps and own.side == "G40") else own.side
            turns |= {way: on for way, on in own.turns if on or not jumps}
        found = self._calls_leave[first] = CallLeaves(side, tuple(turns.items()))
        return found

    @cached_property
    def _in_force(self) -> list[StaysInForce]:
        return [self._language.in_force(text) for text in self.texts]

    def _called_by(self, number: int) -> tuple[int, int] | None:
        """Return the first and the last line of what a line calls that comes back; None where it calls nothing."""
        away = None if self._set_at[number] else self._language.called.search(self.texts[number])
        begin = None if away is None else self._labels.get(away[1])
        if begin is None:
            return None
        return begin, [*self._ends, len(self.texts) - 1][bisect_right(self._ends, begin)]

    def _stretches(self) -> Iterator[tuple[int, int, str]]:
        """Find the lines that repeats run more than once, and jumps perhaps not, or more than once."""
        for number, text in enumerate(self.texts):
            if (called := self._called_by(number)) is not None:
                yield *called, _CALLED
            known = self._set_at[number] is not None or self._language.called.search(text) is not None
            for what, pattern in self._language.calls.items():
                call = None if self._set_at[number] else pattern.search(text)
                if call is None:
                    continue
                known = True
                place = self._labels.get(call.groups()[-1])
                if place is None and "Q" in call.groups()[-1]:
                    known = False
                elif place is None:
                    # The control stops here.
                    yield number, len(self.texts) - 1, f"label that is not known: {call[1]}"
                else:
                    yield min(place, number), max(place, number), what
            if not known and self._language.computed.search(text):
                yield 0, len(self.texts) - 1, f"label that is computed: {text}"

    def _refused(self, number: int, what: str, expected: str, got: str) -> InputError:
        return line_error(self._data, self._lines, self._name, number, what, expected, printable(got))
