"""Run a program of LinuxCNC's language, and write out what it does: O words, subprograms and M98."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import msgspec

from ph_post.expand.blocks import BlockRunner
from ph_post.expand.faults import MOST_CALLS, ExpandError, NotExpandableError
from ph_post.expand.lines import PROGRAM, Flow, ProgramLine, Source
from ph_post.expand.machine import MachineState, Version
from ph_post.expand.named_parameters import NamedValues
from ph_post.expand.offsets import WorkOffsets
from ph_post.expand.progress import MOST_SILENT, Progress, WrittenLines, check_turn
from ph_post.expand.roughing import TURNING
from ph_post.expand.saved_states import SavedStates
from ph_post.expand.tools import ToolShape
from ph_post.expand.turning_cycles import ProfileBlock
from ph_post.expand.values import LOCAL, ParameterFrame, Store

Find = Callable[[str], Source | None]
"""Finds the file of a subprogram by its name."""

_BLOCK: Final = ("while", "repeat", "do")

_WAITS: Final = re.compile(r"\s*%wait\b", re.IGNORECASE)
"""A word of the sender bCNC, which waits there until the machine rests."""


class Call(msgspec.Struct, kw_only=True):
    """A program that runs: its file, the line that is next, its label, and where its repeats are.

    `plain` is a call by M98, which shares the caller's parameters; `again` counts the calls that are left.
    """

    source: Source
    at: int
    label: str = ""
    plain: bool = False
    again: int = 0
    start: int = 0
    counts: dict[int, int] = {}
    heads: dict[int, object] = {}


class ProgramRunner:
    """Runs a program.

    Parameters
    ----------
    source : Source
        The main program.
    find : callable
        Finds files of subprograms.
    decimals : int
        Of lengths that are written.
    parameters : mapping or None
        The controller's own file of parameters.
    tools, standing : mapping
        As of :class:`BlockRunner`.
    inches : bool
        Whether the machine's units are inches.
    version : tuple of int, optional
        Of LinuxCNC.
    """

    def __init__(
        self,
        source: Source,
        find: Find,
        decimals: int,
        parameters: Mapping[int, float] | None,
        tools: Mapping[int, ToolShape],
        standing: Mapping[tuple[str, int], str],
        *,
        inches: bool = False,
        version: Version | None = None,
    ) -> None:
        self.machine = MachineState()
        self.machine.version = version
        self._named = NamedValues(self.machine)
        self.store = Store(self._named.look_up, self._named.place, parameters)
        offsets = WorkOffsets(self.store, self.machine, inches=inches)
        self._named.offsets = offsets
        self.blocks = BlockRunner(self.store, self.machine, offsets, decimals, tools, standing)
        self._find = find
        self._states = SavedStates(self.blocks)
        self._subs: dict[str, tuple[Source, int]] = {}
        self._contours: dict[str, list[str]] = {}
        self.calls = [Call(source=source, at=0)]
        self._main, self._percents, self._broken = source, 0, False

    @property
    def begun(self) -> tuple[str, int] | None:
        """The place of the cutter compensation that is being written out."""
        return self.blocks.cutter.begun

    @property
    def notes(self) -> list[str]:
        """What has to be known of the program."""
        return [*self.blocks.notes, *self.blocks.cutter.notes]

    @property
    def call(self) -> Call:
        """The program that runs."""
        return self.calls[-1]

    def run(self) -> WrittenLines:
        """Return the lines that the program comes to.

        Raises
        ------
        ExpandError
            Where it cannot be written out, with its file and line.
        """
        progress = Progress(self._main)
        lines = self.blocks.lines
        while True:
            call = self.call
            if call.at >= len(call.source.texts):
                if len(self.calls) > 1:
                    raise ExpandError("the file of a subprogram ends within it").at(call.source.name, call.at)
                break
            if progress.step(partial(self._step, call), call.source.name, call.at + 1, len(lines)):
                break
        return progress.written(lines, len(self._main.texts))

    def _step(self, call: Call) -> bool:
        """Run the next line; True at the end of the program."""
        line = call.source.line(call.at)
        self._named.line = call.at + 1
        self.blocks.at = (call.source.name, call.at + 1)
        call.at += 1
        if line.percent:
            return self._percent(call, line)
        if line.flow is not None:
            if line.optional:
                raise NotExpandableError("a line with a slash runs or not as the machine's switch says")
            self.blocks.changed = True
            if line.words or line.settings:
                raise ExpandError("an O word stands on a line with other words")
            return self._flow(call, call.at - 1, line.flow)
        orders = {round(word.plain or 0.0) for word in line.words if word.letter == "m" and word.plain is not None}
        if orders & {98, 99}:
            self.blocks.changed = True
            return self._fanuc(call, line, orders)
        if orders & {70, 71, 72, 73}:
            self.blocks.changed = True
            for order in orders & {70, 71, 72, 73}:
                self._states.order(order, len(self.calls))
            if len(line.words) > 1:
                raise NotExpandableError("M70 to M73 on a line with other words")
            return False
        keep = len(self.calls) == 1 and not call.heads
        if any(word.letter == "g" and round(10.0 * (word.plain or 0.0)) in TURNING for word in line.words):
            label, lines, profile = self._contour(line)
            try:
                self.blocks.turn(line, profile, keep=keep)
            except NotExpandableError as error:
                name, number = self.blocks.at
                self.blocks.notes[f"{name}:{number}: the turning cycle stays as it is: {error.what}"] = None
                line = self._with_contour(line, label, lines)
            else:
                return False
        return self.blocks.run(line, keep=keep)

    def _percent(self, call: Call, line: ProgramLine) -> bool:
        if _WAITS.match(line.text):
            self.blocks.lines.append(line.text)
            return False
        if call.source is not self._main:
            return False
        behind = line.text.partition("%")[2].strip()
        if self._percents and behind:
            raise ExpandError("text behind a percent sign", got=behind[:20])
        self._percents += 1
        self.blocks.lines.append(line.text)
        return self._percents > 1

    def _label(self, flow: Flow) -> str:
        if flow.index is None:
            return flow.label
        return str(round(self.store.require(flow.index(self.store), "the label of an O word")))

    def _flow(self, call: Call, at: int, flow: Flow) -> bool:
        label = self._label(flow)
        word = flow.keyword
        if word in ("if", "elseif", "else", "endif"):
            self._choose(call, at, flow, label)
        elif word in ("while", "endwhile", "do", "repeat", "endrepeat"):
            self._loop(call, at, flow, label)
        elif word in ("break", "continue"):
            self._leave(call, at, word, label)
        elif word == "sub":
            self._define(call, at, label)
        elif word == "call":
            self._call(call, flow, label)
        elif word in ("endsub", "return"):
            self._return(flow, label)
        return False

    def _with_contour(self, line: ProgramLine, label: str, lines: list[str]) -> ProgramLine:
        """Write the subprogram ahead that a turning cycle takes its contour from, and return the line that calls it."""
        while label in self._contours and self._contours[label] != lines:
            label = str(int(label) + 1000)
        if label not in self._contours:
            self._contours[label] = lines
            self.blocks.lines += [f"o{label} sub", *lines, f"o{label} endsub"]
        self.blocks.changed = True
        number = float(label)
        words = [
            msgspec.structs.replace(word, plain=number, value=lambda _: number) if word.letter == "q" else word
            for word in line.words
        ]
        return msgspec.structs.replace(line, words=tuple(words), computed=True)

    def _contour(self, line: ProgramLine) -> tuple[str, list[str], list[ProfileBlock]]:
        """Run the subprogram that a turning cycle calls for its lines alone; return its label, lines and blocks."""
        if self.blocks.cutter.begun is not None:
            raise NotExpandableError("a turning cycle with cutter compensation on")
        words = {word.letter: word.value(self.store) for word in line.words}
        label = str(round(self.store.require(words.get("q", 0.0), "Q")))
        source, at = self._target(self.call, label, ("sub",))
        machine, lines, depth = copy.deepcopy(self.machine.__dict__), self.blocks.lines, len(self.calls)
        aside: list[ProfileBlock] = []
        here, self.blocks.aside, self.blocks.lines = self.blocks.at, aside, []
        self.machine.motion = 0  # the cycle goes to where it begins before
        self.machine.place = self.machine.target({axis: words[axis] for axis in "xz" if axis in words})
        if not self.machine.absolute:
            self.machine.forget("xz")
        self._enter(Call(source=source, at=at + 1, label=label, start=at + 1), ParameterFrame())
        progress = Progress(self._main)
        while len(self.calls) > depth:
            call = self.call
            if call.at >= len(call.source.texts) or len(self.blocks.lines) > MOST_SILENT:
                raise ExpandError(f"the contour of a turning cycle does not end: o{label}")
            progress.step(partial(self._step, call), call.source.name, call.at + 1, len(self.blocks.lines))
        self.machine.__dict__.update(machine)
        found, self.blocks.lines = self.blocks.lines, lines
        self.blocks.at, self.blocks.aside = here, None
        return label, found, aside

    # ------------------------------------------------------------------ choices and loops

    def _choose(self, call: Call, at: int, flow: Flow, label: str) -> None:
        if flow.keyword == "endif":
            return
        if flow.keyword != "if":  # what stands before it has run
            call.at = self._ahead(call, label, ("endif",), at) + 1
            return
        while True:
            if flow.keyword == "else" or self.store.holds(flow.values[0](self.store)):
                return
            at = self._ahead(call, label, ("elseif", "else", "endif"), at)
            call.at = at + 1
            found = call.source.line(at).flow
            assert found is not None
            if found.keyword == "endif":
                return
            flow = found

    def _ahead(self, call: Call, label: str, words: tuple[str, ...], at: int) -> int:
        return self._ahead_in(call.source, label, words, at)

    @staticmethod
    def _ahead_in(source: Source, label: str, words: tuple[str, ...], at: int) -> int:
        found = source.find(label, words, at + 1)
        if found < 0:
            raise ExpandError("the O word has no end", expected=f"o{label} {words[-1]}")
        return found

    def _opening(self, call: Call, label: str, at: int) -> tuple[int, str]:
        """Return the line that begins the loop of a label, and its word."""
        found = call.source.find(label, ("while", "repeat", "do", "endwhile", "endrepeat"), at - 1, step=-1)
        flow = call.source.line(found).flow if found >= 0 else None
        if flow is None or flow.keyword not in _BLOCK:
            return -1, ""
        return found, flow.keyword

    def _loop(self, call: Call, at: int, flow: Flow, label: str) -> None:
        word = flow.keyword
        if word == "do":
            return
        if word == "repeat":
            left = call.counts.get(at)
            if left is None:
                left = round(self.store.require(flow.values[0](self.store), "a number of repeats"))
            if left > 0:
                call.counts[at] = left - 1
            else:
                call.counts.pop(at, None)
                call.at = self._ahead(call, label, ("endrepeat",), at) + 1
            return
        if word == "while":
            first, opened = self._opening(call, label, at)
            ends_do = opened == "do"
            check_turn(call.heads, at, (self.store.version, self.machine.snapshot()))
            holds = self.store.holds(flow.values[0](self.store))
            if ends_do and holds and not self._broken:
                call.at = first + 1
                return
            if ends_do:
                self._broken = False
                call.heads.pop(at, None)
            elif not holds:
                call.heads.pop(at, None)
                call.at = self._ahead(call, label, ("endwhile",), at) + 1
            return
        first, opened = self._opening(call, label, at)
        if opened != {"endwhile": "while", "endrepeat": "repeat"}[word]:
            raise ExpandError(f"{word} without its beginning", got=f"o{label}")
        call.at = first

    def _leave(self, call: Call, at: int, word: str, label: str) -> None:
        first, opened = self._opening(call, label, at)
        if opened not in ("while", "do"):
            raise ExpandError(f"{word} outside of a loop", got=f"o{label}")
        end = self._ahead(call, label, ("endwhile",) if opened == "while" else ("while",), at)
        if word == "break":
            # LinuxCNC forgets a break at the next end of a do loop alone, which it then leaves.
            self._broken = opened == "while"
            call.heads.pop(first if opened == "while" else end, None)
        call.at = end if word == "continue" else end + 1

    # ------------------------------------------------------------------ subprograms

    def _define(self, call: Call, at: int, label: str) -> None:
        if len(self.calls) > 1:
            raise ExpandError("a subprogram within a subprogram", got=f"o{label} sub")
        self._subs[label] = (call.source, at)
        call.at = self._ahead(call, label, ("endsub",), at) + 1

    def _target(self, call: Call, label: str, words: tuple[str, ...]) -> tuple[Source, int]:
        if label in self._subs:
            return self._subs[label]
        source = self._find(label)
        at = -1 if source is None else source.find(label, words, 0)
        if source is None or at < 0:
            source, at = call.source, call.source.find(label, words, 0)
        if at < 0:
            raise ExpandError("the subprogram is not there", expected=f"o{label} in the program, or {label}.ngc")
        self._subs[label] = (source, at)
        return source, at

    def _enter(self, made: Call, frame: ParameterFrame | None) -> None:
        if len(self.calls) > MOST_CALLS:
            raise ExpandError(f"subprograms call each other more than {MOST_CALLS} deep")
        self.calls.append(made)
        self.store.frames.append(self.store.frame if frame is None else frame)

    def _call(self, call: Call, flow: Flow, label: str) -> None:
        if len(flow.values) > LOCAL:
            raise ExpandError(f"more than {LOCAL} values for a subprogram")
        values = [value(self.store) for value in flow.values]
        source, at = self._target(call, label, ("sub",))
        frame = ParameterFrame(dict.fromkeys(range(1, LOCAL + 1), 0.0))
        frame.numbers.update(dict(enumerate(values, 1)))
        self._enter(Call(source=source, at=at + 1, label=label, start=at + 1), frame)

    def _return(self, flow: Flow, label: str) -> None:
        if len(self.calls) == 1 or self.call.plain or (flow.keyword == "endsub" and self.call.label != label):
            raise ExpandError(f"{flow.keyword} outside of its subprogram", got=f"o{label}")
        value = flow.values[0](self.store) if flow.values else 0.0
        self._named.value, self._named.returned = value, bool(flow.values)
        self._states.leave(len(self.calls))
        self.calls.pop()
        self.store.frames.pop()
        self.store.version += 1

    def _fanuc(self, call: Call, line: ProgramLine, orders: set[int]) -> bool:
        """Run M98 and M99 as Fanuc has them."""
        if 99 in orders:
            if len(self.calls) == 1:
                raise ExpandError("M99 in the main program: it never ends")
            if not call.plain:
                raise ExpandError("M99 in a subprogram that ends with endsub")
            if call.again > 0:
                call.again -= 1
                call.at = call.start
                return False
            self._states.leave(len(self.calls))
            self.calls.pop()
            self.store.frames.pop()
            return False
        words = {word.letter: word.value(self.store) for word in line.words}
        if "p" not in words:
            raise ExpandError("M98 without P")
        label = str(round(self.store.require(words["p"], "P")))
        times = round(self.store.require(words.get("l", 1.0), "L"))
        if times < 1:
            return False
        source, at = self._target(call, label, (PROGRAM,))
        self._enter(Call(source=source, at=at + 1, label=label, plain=True, again=times - 1, start=at + 1), None)
        return False
