"""Run a Fanuc program, and write out what it does: M98 and M99, G65, and the statements of custom macro B."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from typing import Final

import msgspec
import numpy as np

from ph_post.expand.fanuc_blocks import FanucBlocks, MacroWord
from ph_post.expand.faults import MOST_CALLS, ExpandError, NotExpandableError
from ph_post.expand.lines import Source
from ph_post.expand.macro import (
    ARGUMENTS,
    COMMENT,
    FanucNumbers,
    MacroLine,
    MacroStore,
    argument,
    plain_value,
    read_macro_line,
    word_text,
)
from ph_post.expand.progress import Progress, WrittenLines, check_turn
from ph_post.expand.run import Find
from ph_post.expand.turning import has_increments_by_words, shapes_of
from ph_post.expand.turning_blocks import TurningBlocks
from ph_post.expand.values import ParameterFrame
from ph_post.gcode.codes import CALLS, M_EFFECT
from ph_post.gcode.numbers import masked

_LETTERS: Final = re.compile(r"([a-z,]*[a-z])(.*)")
_MODAL_CALL: Final = ("66", "66.1")
_OTHER_CALLS: Final = frozenset(np.flatnonzero(M_EFFECT == CALLS).tolist())
"""M words that run other lines, which may read and set variables: interrupts, and subprograms of another kind."""
_INTERRUPT: Final = 96
"""The M word behind which a signal may call a macro at any place."""


class MacroCall(msgspec.Struct, kw_only=True):
    """A program that runs: its file, its first line and the one behind its last, and the line that is next."""

    source: Source
    first: int
    last: int
    at: int
    again: int = 0
    heads: dict[int, object] = {}


class FanucRunner:
    """Runs a Fanuc program.

    Parameters
    ----------
    source : Source
        The main program, with its subprograms behind it.
    find : callable
        Finds files of subprograms.
    numbers : FanucNumbers
    standing : mapping
        As of :class:`FanucBlocks`.
    """

    def __init__(
        self, source: Source, find: Find, numbers: FanucNumbers, standing: Mapping[tuple[str, int], str]
    ) -> None:
        self.store = MacroStore()
        bare = masked("\n".join([*source.texts, ""]).encode("latin-1")) if numbers.lathe else b""
        self._turned: TurningBlocks | None = None
        if numbers.lathe and has_increments_by_words(bare):
            self._turned = TurningBlocks(numbers, standing)
        self.blocks: FanucBlocks = self._turned or FanucBlocks(numbers, standing)
        self._shapes = shapes_of(bare) if numbers.lathe else []
        self._standing = standing
        self._find, self._main = find, source
        self._read: dict[tuple[str, int], MacroLine] = {}
        self._computes = False
        first = next((k for k in range(len(source.texts)) if self._line(source, k).program >= 0), 0)
        self.calls = [MacroCall(source=source, first=first, last=self._end(source, first), at=0)]

    @property
    def begun(self) -> tuple[str, int] | None:
        """The place of the cycle or the turned coordinates that are being written out."""
        return self.blocks.begun

    def _line(self, source: Source, index: int) -> MacroLine:
        key = (source.name, index)
        if key not in self._read:
            self._read[key] = read_macro_line(source.texts[index])
        return self._read[key]

    def _end(self, source: Source, first: int) -> int:
        """Return the line behind the last of a program."""
        for index in range(first + 1, len(source.texts)):
            if self._line(source, index).program >= 0:
                return index
        return len(source.texts)

    def run(self) -> WrittenLines:
        """Return the lines that the program comes to.

        Raises
        ------
        ExpandError
            Where it cannot be written out, with its file and line.
        """
        progress = Progress(self._main)
        while True:
            call = self.calls[-1]
            if call.at >= call.last:
                if len(self.calls) > 1:
                    raise ExpandError("a subprogram without M99").at(call.source.name, call.last)
                return progress.written(self.blocks.lines, call.last)
            if progress.step(partial(self._step, call), call.source.name, call.at + 1, len(self.blocks.lines)):
                return progress.written(self.blocks.lines, self.calls[0].at)

    def _step(self, call: MacroCall) -> bool:  # noqa: PLR0911
        line = self._line(call.source, call.at)
        call.at += 1
        self.blocks.at = (call.source.name, call.at)
        if call.source is self._main and any(first <= call.at - 1 <= last for first, last in self._shapes):
            self._keep_shape(line)
            return False
        if line.fault is not None:
            raise line.fault
        if line.program >= 0:
            if len(self.calls) == 1:
                self.blocks.lines.append(line.text)
            return False
        orders = {round(float(number)) for letter, number in line.plain if letter == "m" and number}
        codes = {number.lstrip("0") for letter, number in line.plain if letter == "g"}
        if codes & set(_MODAL_CALL):
            raise NotExpandableError("a macro that is called by every motion: G66")
        if orders & _OTHER_CALLS:
            self._keep_call(line, NotExpandableError(f"a call that is not followed: M{min(orders & _OTHER_CALLS)}"))
            return False
        if line.optional and (line.order or orders & {98, 99} or "65" in codes):
            self._run_optional(line, orders)
            return False
        self._computes = self._computes or line.computed
        if line.order:
            self.blocks.changed = True
            self._obey(call, line)
            return False
        if 99 in orders and len(self.calls) == 1 and all(letter != "p" for letter, _ in line.plain):
            # A subprogram by itself, or a program that begins anew, where nothing is known.
            self._check_values(line, ExpandError("M99 in the main program: it never ends"))
            self._write(line)
            return True
        if orders & {98, 99} or "65" in codes:
            self._call(call, line, orders)
            return False
        if self._turned is not None and "70" in codes:
            self._finish(self._turned, line)
            return False
        self._write(line)
        return bool(orders & {2, 30})

    # ------------------------------------------------------------------ shapes of turning cycles

    def _keep_shape(self, line: MacroLine) -> None:
        """Keep a line of a shape that cycles take."""
        if line.computed or line.order or line.fault is not None:
            raise NotExpandableError("the shape of a turning cycle that is computed")
        if self._turned is not None:
            self._turned.keep_shape(line.text)
        else:
            self.blocks.lines.append(line.text)
            self.blocks.machine.forget()

    def _finish(self, blocks: TurningBlocks, line: MacroLine) -> None:
        """Write the blocks of a shape out in the place of a G70."""
        at = blocks.at
        if at in self._standing:
            blocks.notes[f"{at[0]}:{at[1]}: cycle stays as it is: {self._standing[at]}"] = None
            self._write(line)
            return
        start = blocks.begin_finish(self._words(line), COMMENT.findall(line.text))
        first, last = self._shape(line)
        for index in range(first, last + 1):
            one = self._line(self._main, index)
            if one.fault is not None or one.order or one.optional or one.program >= 0:
                raise NotExpandableError("a block of the shape that does more than to move")
            words = self._words(one)
            blocks.check_shape(words)
            blocks.run(one.text, words, COMMENT.findall(one.text), optional=False, same=False)
        blocks.end_finish(start)

    def _shape(self, line: MacroLine) -> tuple[int, int]:
        """Return the first and the last line of the shape that a cycle takes."""
        asked = {letter: int(number) for letter, number in line.plain if letter in "pq" and number.isdecimal()}
        if line.computed or len(asked) < len("pq"):
            raise NotExpandableError("a cycle without P and Q")
        labels = [self._line(self._main, index).label for index in range(len(self._main.texts))]
        if any(labels.count(number) != 1 for number in asked.values()):
            raise NotExpandableError("the sequence numbers of the shape are not there, or not there once")
        first, last = (labels.index(asked[letter]) for letter in "pq")
        if (first, last) not in self._shapes:
            raise NotExpandableError("the shape of the cycle begins behind its end")
        return first, last

    def _write(self, line: MacroLine, without: str = "") -> None:
        """Write a block, `without` the words of a call."""
        words = self._words(line, without)
        if not line.parts and COMMENT.sub("", line.text).strip(" \t%;/"):
            self.blocks.machine.forget()  # a line that nobody reads here
        same = not line.computed and not without
        self.blocks.run(line.text, words, COMMENT.findall(line.text), optional=line.optional, same=same)

    def _words(self, line: MacroLine, without: str = "") -> list[MacroWord]:
        """Return the words of a block, `without` those of a call."""
        blocks, numbers = self.blocks, self.blocks.numbers
        for part in line.parts:
            if part in ("g20", "g21"):
                blocks.machine.set_units(200 if part == "g20" else 210)
        words = []
        for part in line.parts:
            if isinstance(part, str):
                letters, digits = _LETTERS.findall(part)[0]
                if letters[-1] not in without or (letters[-1] in "gm" and not _is_call(part)):
                    value = plain_value(letters, digits, numbers, blocks.machine.modes["units"])
                    words.append(MacroWord(letters, value, part.upper()))
                continue
            letters, expression = part
            if letters[-1] in without:
                continue
            number = self.store.require(expression(self.store), letters.upper())
            if letters[-1] == "m" and round(number) in {2, 30, 98, 99, *_OTHER_CALLS}:
                raise NotExpandableError(f"an order of the program's flow that is computed: M{number:g}")
            text = word_text(letters, number, numbers.decimals + blocks.more)
            if text:
                words.append(MacroWord(letters, number, text))
        return words

    # ------------------------------------------------------------------ statements

    def _obey(self, call: MacroCall, line: MacroLine) -> None:
        if line.order == "end":
            call.at = self._begin(call, call.at - 1, line.number)
            return
        holds = True
        if line.condition is not None:
            holds = self.store.holds(line.condition(self.store))
        if line.order == "while":
            check_turn(call.heads, call.at - 1, self.store.version)
            if not holds:
                call.heads.pop(call.at - 1, None)
                call.at = self._behind(call, call.at, line.number)
        elif not holds:
            return
        elif line.order == "goto":
            assert line.value is not None
            target = self.store.require(line.value(self.store), "the target of GOTO")
            self._jump(call, round(target))
        else:
            assert line.value is not None
            assert line.index is not None
            key = self.store.index_of(line.index(self.store))
            self.store.put(key, line.value(self.store))

    def _begin(self, call: MacroCall, at: int, number: int) -> int:
        """Return the line of the WHILE to an END."""
        for index in range(at - 1, call.first - 1, -1):
            line = self._line(call.source, index)
            if line.order in ("while", "end") and line.number == number:
                if line.order == "while":
                    return index
                break
        raise ExpandError(f"END{number} without its WHILE")

    def _behind(self, call: MacroCall, at: int, number: int) -> int:
        for index in range(at, call.last):
            line = self._line(call.source, index)
            if line.order == "end" and line.number == number:
                return index + 1
        raise ExpandError(f"WHILE without its END{number}")

    def _jump(self, call: MacroCall, label: int) -> None:
        """Go on at a sequence number, searched forwards and then from the program's beginning."""
        check_turn(call.heads, call.at - 1, self.store.version)
        order = [*range(call.at, call.last), *range(call.first, call.at)]
        found = next((index for index in order if self._line(call.source, index).label == label), None)
        if found is None:
            raise ExpandError("there is no such sequence number", got=f"N{label}")
        call.at = found

    # ------------------------------------------------------------------ calls

    def _run_optional(self, line: MacroLine, orders: set[int]) -> None:
        """Keep a line with a slash that calls or returns, which runs or not as the control's switch says."""
        why = NotExpandableError("a line with a slash runs or not as the control's switch says")
        if line.order or (99 in orders and (len(self.calls) > 1 or any(letter == "p" for letter, _ in line.plain))):
            raise why
        if 99 in orders:
            self._check_values(line, why)
            self._write(line)
        else:
            self._keep_call(line, why)

    def _check_values(self, line: MacroLine, why: ExpandError) -> None:
        """Refuse what other programs may read or set where a program uses variables: what sets them is not written."""
        if line.computed or self._computes or self.store.frame.numbers:
            raise why

    def _keep_call(self, line: MacroLine, why: ExpandError) -> None:
        """Keep a call that is not followed: behind it neither a mode nor a place nor a variable is known."""
        if any(letter == "m" and number and round(float(number)) == _INTERRUPT for letter, number in line.plain):
            raise why
        self._check_values(line, why)
        self.blocks.lose(why)
        self.blocks.lines.append(line.text)
        self.blocks.notes[f"{self.blocks.at[0]}:{self.blocks.at[1]}: the call stays as it is: {why.what}"] = None
        self.store.forget()

    def _call(self, call: MacroCall, line: MacroLine, orders: set[int]) -> None:
        if 99 in orders:
            self._return(call, line)
            return
        words = {letter: number for letter, number in line.plain if number}
        computed = {part[0][-1]: part[1] for part in line.parts if not isinstance(part, str)}
        values = {letter: self.store.require(value(self.store), letter.upper()) for letter, value in computed.items()}
        macro = 98 not in orders
        label, times = self._number(words, values)
        try:
            source, first = self._target(label)
        except ExpandError as error:
            self._keep_call(line, error)
            return
        self.blocks.changed = True
        if not macro:
            self._write(line, without="mpl")
        frame = None
        if macro:
            if times > 1:
                raise NotExpandableError("G65 with repeats: the values of the second turn are not told")
            arguments = {ARGUMENTS[key]: argument(key, text) for key, text in words.items() if key in ARGUMENTS}
            arguments |= {ARGUMENTS[key]: value for key, value in values.items() if key in ARGUMENTS}
            arguments.pop(ARGUMENTS["m"], None) if "m" not in words else None
            letters = [letter for letter, _ in line.plain if letter in "ijk"]
            if len(set(letters)) < len(letters):
                raise NotExpandableError("G65 with I, J or K twice")
            frame = ParameterFrame(arguments)
        if times < 1:
            return
        if len(self.calls) > MOST_CALLS:
            raise ExpandError(f"subprograms call each other more than {MOST_CALLS} deep")
        made = MacroCall(source=source, first=first, last=self._end(source, first), at=first + 1, again=times - 1)
        self.calls.append(made)
        self.store.frames.append(self.store.frame if frame is None else frame)
        self.store.version += 1

    def _number(self, words: dict[str, str], values: dict[str, float]) -> tuple[int, int]:
        """Return the number of a subprogram, and how often it runs."""
        if "p" not in words and "p" not in values:
            raise ExpandError("a call without P")
        whole = round(float(words["p"])) if "p" in words else round(values["p"])
        times = round(float(words["l"])) if "l" in words else round(values.get("l", 1.0))
        if len(words.get("p", "")) > 4 and "l" not in words:  # the four digits behind are the program
            times, whole = whole // 10000, whole % 10000
        return whole, times

    def _target(self, label: int) -> tuple[Source, int]:
        for index in range(len(self._main.texts)):
            if self._line(self._main, index).program == label:
                return self._main, index
        for name in (f"O{label:04d}", f"o{label:04d}", f"{label:04d}", str(label)):
            source = self._find(name)
            if source is not None:
                found = (k for k in range(len(source.texts)) if self._line(source, k).program == label)
                return source, next(found, -1)
        expected = f"O{label:04d} in the program or in a file of that name"
        raise ExpandError("the subprogram is not there", expected=expected)

    def _return(self, call: MacroCall, line: MacroLine) -> None:
        self.blocks.changed = True
        if len(self.calls) == 1:
            raise ExpandError("M99 in the main program: it never ends")
        target = next((number for letter, number in line.plain if letter == "p" and number), "")
        self._write(line, without="mp")
        if call.again > 0:
            call.again -= 1
            call.at = max(call.first + 1, 0)
            call.heads.clear()
            return
        self.calls.pop()
        self.store.frames.pop()
        self.store.version += 1
        if target:
            self._jump(self.calls[-1], round(float(target)))


def _is_call(part: str) -> bool:
    return re.fullmatch(r"m0*9[89]|g0*65", part) is not None
