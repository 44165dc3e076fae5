"""The lines of a program of Heidenhain's TNC, in either language: its head, and labels, repeats and jumps."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Mapping
from decimal import Decimal
from functools import cached_property
from typing import Final, Protocol

import msgspec
from msgspec.structs import replace

from ph_post.dialects.heidenhain.tnc import StaysInForce, Tnc
from ph_post.dialects.reading import XYZ_ONLY, Remark, line_error, read_translated, text_of
from ph_post.errors import InputError, printable
from ph_post.gcode.program import PartProgram, WordTable
from ph_post.gcode.words import lines_of

_ROOM: Final = 1000
_FOREIGN: Final = re.compile(rf"(?![^\W\d])[^\x00-\x7f]|\d{{{_ROOM},}}")
"""Blanks, digits and signs that no control knows, all but letters of names; numbers longer than it has room for."""

_MOST: Final = 300_000
"""Lines of subprograms that are looked at; of a program with more nothing is known behind its calls."""

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


def _within(numbers: list[int], first: int, last: int) -> list[int]:
    """Return which of some numbers, which rise, are from `first` to `last`."""
    return numbers[bisect_left(numbers, first) : bisect_right(numbers, last)]


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
        framed = tnc.framed()
        reach = {False: -1, True: -1}  # how far lines are passed through that run again, and that may not run
        for first, last, what in sorted(dict.fromkeys(self._stretches()), key=lambda one: (one[0], -one[1])):
            jumped = what not in (REPEATED, _CALLED)
            if last <= max(reach[True], -1 if jumped else reach[False]):
                continue
            reach[jumped] = last
            if jumped and len({tnc.side_in(line) for line in range(first - 1, last + 1)}) > 1:
                behind = range(last + 1, len(self.texts))
                until = next((line for line in behind if self._in_force[line].side is not None), len(self.texts))
                tnc.doubt_side(last + 1, until - 1)
            own_lines = [line for line in range(first, last + 1) if text_of(self._data, self._lines, line).strip()]
            turned = any(framed[max(first - 1, 0) : last + 1]) if jumped else framed[last]
            tnc.pass_through(own_lines, turned=turned)
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

    def left_by(self, number: int) -> StaysInForce | None:
        """Return what a line leaves in force that calls a label; None where it calls none."""
        return self._of_call(number, self._calls_leave) if number in self._called else None

    def _of_call(self, number: int, known: Mapping[tuple[int, int], StaysInForce]) -> StaysInForce:
        """Return what a call leaves in force; one with a slash may be skipped, and ends nothing."""
        found = known[self._called[number]]
        return found.if_skipped() if self.texts[number].startswith("/") else found

    @cached_property
    def _calls_leave(self) -> dict[tuple[int, int], StaysInForce]:
        """By first and last line what a call leaves in force, with what it calls itself."""
        bodies = sorted(set(self._called.values()))
        if sum(len(_within(self._telling, *body)) for body in bodies) > _MOST:
            return dict.fromkeys(bodies, StaysInForce(side="G41", turns=(("calls", True),)))
        found = dict.fromkeys(bodies, StaysInForce())
        # Behind what it calls farther on, then before: what calls in turn is known the second time.
        for body in (*reversed(bodies), *bodies):
            found[body] = self._left_by(*body, found)
        return found

    def _left_by(self, first: int, last: int, known: Mapping[tuple[int, int], StaysInForce]) -> StaysInForce:
        """Return what lines leave in force; where one jumps they end nothing."""
        jumps = bool(_within(self._jumps, first, last))
        side: str | None = None
        turns = dict[str, bool]()
        for number in _within(self._telling, first, last):
            own = self._of_call(number, known) if number in self._called else self._in_force[number]
            side = side if own.side is None or (jumps and own.side == "G40") else own.side
            turns |= {way: on for way, on in own.turns if on or not jumps}
        return StaysInForce(side=side, turns=tuple(turns.items()))

    @cached_property
    def _jumps(self) -> list[int]:
        return [number for number, text in enumerate(self.texts) if self._language.calls[JUMPED].search(text)]

    @cached_property
    def _telling(self) -> list[int]:
        """Lines that leave a side or a frame in force, and those that call."""
        numbers = range(len(self.texts))
        return [one for one in numbers if self._in_force[one].side or self._in_force[one].turns or one in self._called]

    @cached_property
    def _in_force(self) -> list[StaysInForce]:
        return [self._language.in_force(text) for text in self.texts]

    @cached_property
    def _called(self) -> dict[int, tuple[int, int]]:
        """By lines that call what comes back, its first and last line."""
        found, ends = {}, [*self._ends, len(self.texts) - 1]
        for number, text in enumerate(self.texts):
            away = None if self._set_at[number] else self._language.called.search(text)
            begin = None if away is None else self._labels.get(away[1])
            if begin is not None:
                found[number] = begin, ends[bisect_right(self._ends, begin)]
        return found

    def _stretches(self) -> Iterator[tuple[int, int, str]]:
        """Find the lines that repeats run more than once, and jumps perhaps not, or more than once."""
        for number, text in enumerate(self.texts):
            if (called := self._called.get(number)) is not None:
                yield *called, _CALLED
            known = self._set_at[number] is not None
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
            if not known and self._language.computed.search(text) and not self._language.called.search(text):
                yield 0, len(self.texts) - 1, f"label that is computed: {text}"

    def _refused(self, number: int, what: str, expected: str, got: str) -> InputError:
        return line_error(self._data, self._lines, self._name, number, what, expected, printable(got))
