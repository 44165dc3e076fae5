"""One line of a program that is written out: what it does to modes and place, and what is written for it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Final

from ph_post.expand.cutter import center_by_radius
from ph_post.expand.cutter_blocks import CutterBlocks
from ph_post.expand.cycles import CYCLES, MOVING, CycleMemory, CycleWriter
from ph_post.expand.faults import ExpandError, NotExpandableError
from ph_post.expand.lines import LineWord, ProgramLine
from ph_post.expand.machine import AXES, GROUP_OF, MOTIONS, MachineState
from ph_post.expand.offsets import WorkOffsets
from ph_post.expand.roughing import TURNING
from ph_post.expand.tools import ToolShape
from ph_post.expand.turning_cycles import ProfileBlock, belongs_to_cycle, turning_cycle
from ph_post.expand.values import UNKNOWN, Store
from ph_post.expand.writing import LONGEST, number_text

_SETTING: Final = (100, 280, 281, 300, 301, 520, 920, 921, 922, 923)
"""G words that take axis words for something else than a motion in the mode in force."""

_KNOWN: Final = {*GROUP_OF, *MOTIONS, *_SETTING, 40, 53, 63, 530}
_COMPUTED: Final = re.compile(r"#\s*(?:<([^>]*)>|(\d+))|%(?:d|f|\.(\d)f)")

STOPS: Final = (2, 30)
"""M words that end a program."""

_HALTS: Final = (0, 1, 60, *STOPS)
"""M words that are obeyed behind the motion of their block."""


WordValues = list[tuple[LineWord, float]]
"""The words of a line with their values."""


class BlockRunner:
    """Runs blocks, and writes them out to `lines`.

    Parameters
    ----------
    store : Store
    machine : MachineState
    offsets : WorkOffsets
    decimals : int
    tools : mapping of int to ToolShape
        That are known.
    standing : mapping
        Why the cutter compensation that is switched on at a place (file and line) stays as it is.

    `at` is the place of the line that runs; `aside` are the blocks of a turning cycle's profile while they are run for
    the cycle to read, None otherwise.
    """

    def __init__(
        self,
        store: Store,
        machine: MachineState,
        offsets: WorkOffsets,
        decimals: int,
        tools: Mapping[int, ToolShape],
        standing: Mapping[tuple[str, int], str],
    ) -> None:
        self.store, self.machine, self.offsets, self.decimals = store, machine, offsets, decimals
        self.lines: list[str] = []
        self.at = ("", 0)
        self.aside: list[ProfileBlock] | None = None
        self.cutter = CutterBlocks(machine, self.lines, decimals, tools, standing)
        self.memory = CycleMemory()
        self.notes: dict[str, None] = {}
        self.changed = False

    def run(self, line: ProgramLine, *, keep: bool) -> bool:
        """Run a line; True where it ends the program. With `keep` a comment that is no order is kept.

        Raises
        ------
        ExpandError
            Where it cannot be worked out.
        """
        if line.fault is not None:
            raise line.fault
        values = [(word, self._value(word)) for word in line.words]
        self._set(line)
        codes = [round(10.0 * value) for word, value in values if word.letter == "g"]
        orders = [round(value) for word, value in values if word.letter == "m"]
        words = {word.letter: value for word, value in values if word.letter not in "gm"}
        if line.optional and (line.settings or set(codes) - {0, 10, 20, 30} or orders or self.machine.motion in CYCLES):
            raise NotExpandableError("a line with a slash runs or not as the machine's switch says")
        odd = [code for code in codes if code not in _KNOWN]
        same = [code for code in codes if self.machine.modes.get(GROUP_OF.get(code, "")) == code]
        self._modal(codes, orders, words)
        if self.aside is not None:
            self.aside.append(ProfileBlock(codes, orders, words))
        else:
            self.cutter.switch(codes, words, self.at, self.offsets.unit("x"))
        motion = self._motion(codes, words)
        self.cutter.check([code for code in codes if code not in same], orders, motion)
        if self.cutter.begun is not None:
            self._compensated(line, values, codes, orders, motion, words, keep=keep)
        elif motion in MOVING:
            self._cycle(line, values, motion, words)
        else:
            self._write(line, values, keep=keep)
            self._move(codes, motion, words)
        if odd:  # nobody knows what a word does that only this machine has: it may run a program
            self.machine.forget()
            self.store.forget()
        elif line.optional:
            self.machine.forget("".join(axis for axis in AXES if axis in words))
        return any(order in STOPS for order in orders)

    def _value(self, word: LineWord) -> float:
        if word.plain is not None:
            return word.plain
        value = word.value(self.store)
        self.store.require(value, word.letter.upper())
        if word.letter in "gmtn" and abs(value - round(value, 1)) < 1e-4:
            return round(value, 1)
        return value

    def _set(self, line: ProgramLine) -> None:
        found: list[tuple[int | str, float]] = []
        for one in line.settings:
            key = one.name or self.store.index_of(one.index(self.store) if one.index else UNKNOWN)
            found.append((key, one.value(self.store)))
        for key, value in found:
            self.store.put(key, value)
            if not isinstance(key, str) and key > 5160:
                self.offsets.was_set(key)
        self.changed |= bool(found)

    def _modal(self, codes: list[int], orders: list[int], words: dict[str, float]) -> None:
        """Follow the modes."""
        machine = self.machine
        for code in codes:
            group = GROUP_OF.get(code)
            if group == "units":
                machine.set_units(code)
            elif group == "system":
                self.offsets.select(code)
            elif group == "length":
                self.offsets.set_length(code, words)
            elif group == "path":
                machine.path_words = " ".join(
                    f"{letter.upper()}{number_text(words[letter], self.decimals)}" for letter in "pq" if letter in words
                )
            elif group == "feed_mode" and code != 930:
                machine.feed = 0.0  # without an F beside it
            if group is not None:
                machine.modes[group] = code
        if "f" in words and machine.modes["feed_mode"] != 930:
            machine.feed = words["f"]
        machine.speed, machine.selected = words.get("s", machine.speed), words.get("t", machine.selected)
        for order in orders:
            self._order(order, words)

    def _order(self, order: int, words: dict[str, float]) -> None:
        machine = self.machine
        if order in (3, 4, 5, 19):
            machine.spindle = order if order < 5 else 0
        elif order in (7, 8, 9):
            machine.mist = order == 7 or (machine.mist and order == 8)
            machine.flood = order == 8 or (machine.flood and order == 7)
        elif order in (48, 49):
            machine.overrides[48] = order == 48
        elif order == 6:
            machine.tool = machine.selected
            self.offsets.tool_changed()
        elif order == 61:
            machine.tool = words.get("q", UNKNOWN)
            self.offsets.tool_changed()
        elif order == 66:
            self.store.numbers[5399] = UNKNOWN

    def _motion(self, codes: list[int], words: dict[str, float]) -> int:
        """Return the motion of a block, -1 for none."""
        given = [code for code in codes if code in MOTIONS and code not in (70, 80)]
        if given:
            return given[0]
        if any(code in (*_SETTING, 431, 432) for code in codes):
            return -1
        moves = any(axis in words for axis in (*AXES, "@", "^"))
        return self.machine.motion if moves else -1

    def _cycle(self, line: ProgramLine, values: WordValues, motion: int, words: dict[str, float]) -> None:
        machine, memory = self.machine, self.memory
        if machine.motion not in CYCLES:
            memory.initial = None
        mode = machine.modes["path"]
        writer = CycleWriter(machine, memory, self.decimals, stops=mode == 0)
        if writer.is_open(words):
            self.notes["cycles stay as they are where neither G98 nor G99 was said before them"] = None
            self._write(line, values, keep=True, standing=True)
            writer.leave_standing(motion, words)
            return
        self._write_rest(line, values, _belongs, keep=True)
        made = writer.write(motion, words)
        made.insert(writer.raised, "G61" if mode not in (0, 610) else "")
        self.lines += ([] if machine.absolute else ["G90"]) + [text for text in made if text]
        back = [] if machine.absolute else ["G91"]
        if mode in (640, 611):
            back.append(f"G{mode / 10:g}" + (f" {machine.path_words}" if mode == 640 and machine.path_words else ""))
        if back:
            self.lines.append(" ".join(back))
        self.changed = True

    def turn(self, line: ProgramLine, profile: list[ProfileBlock], *, keep: bool) -> None:
        """Write a turning cycle out, whose profile are these blocks.

        Raises
        ------
        NotExpandableError
            Where it has to stay as it is; then nothing is done.
        """
        if line.fault is not None or line.settings or line.optional:
            raise NotExpandableError("the line of a turning cycle does more than to call it")
        values = [(word, self._value(word)) for word in line.words]
        block = ProfileBlock(
            [round(10.0 * value) for word, value in values if word.letter == "g"],
            [round(value) for word, value in values if word.letter == "m"],
            {word.letter: value for word, value in values if word.letter not in "gm"},
        )
        machine = self.machine
        made = turning_cycle(machine, block, profile, self.decimals)
        self._modal(block.codes, block.orders, block.words)
        self._write_rest(line, values, belongs_to_cycle, keep=keep)
        self.lines += made.lines
        machine.place.update(z=made.end.real, x=made.end.imag)
        machine.motion, self.memory.initial = made.motion, None
        self.changed = True

    def _compensated(
        self,
        line: ProgramLine,
        values: WordValues,
        codes: list[int],
        orders: list[int],
        motion: int,
        words: dict[str, float],
        *,
        keep: bool,
    ) -> None:
        """Write a block of a stretch in which the tool's centre is led."""
        moves, halts = motion != -1, [order for order in orders if order in _HALTS]
        if line.optional:
            raise NotExpandableError("a line with a slash runs or not as the machine's switch says")
        if not moves and not any(self.cutter.is_dropped("g", code, moves=False) for code in codes):
            if halts:
                self.cutter.stop()
            self._write(line, values, keep=keep)
            return

        def belongs(letter: str, value: float) -> bool:
            if letter == "m":
                return moves and round(value) in _HALTS
            return self.cutter.is_dropped(letter, round(10.0 * value), moves=moves)

        self._write_rest(line, values, belongs, keep=keep)
        if moves:
            self.cutter.move(motion, words)
            self.machine.motion, self.memory.initial = motion, None
            if halts:
                self.cutter.stop()
                self.lines.append(" ".join(f"M{order}" for order in halts))
        self.changed = True

    def _write_rest(
        self, line: ProgramLine, values: WordValues, belongs: Callable[[str, float], bool], *, keep: bool
    ) -> None:
        """Write what does not belong to the motions of a block ahead of them."""
        texts = [
            f"{word.letter.upper()}{self._text(word, value)}"
            for word, value in values
            if not belongs(word.letter, value)
        ]
        texts += self._comments(line, keep=keep)
        if texts:
            self.lines.append(" ".join(texts))

    def _comments(self, line: ProgramLine, *, keep: bool) -> list[str]:
        comments = line.comments if keep else line.active
        if self.store.numbers.get(5599) == 0.0:  # switches these messages off
            comments = tuple(text for text in comments if not re.match(r"\s*debug,", text, re.IGNORECASE))
        return [f"({self._comment(text)})" for text in comments]

    def _write(self, line: ProgramLine, values: WordValues, *, keep: bool, standing: bool = False) -> None:
        if not line.computed and not line.active:
            if line.words or keep:
                self.lines.append(line.text)
            else:
                self.changed = True
            return
        self.changed = self.changed or line.computed
        polar = not standing and any(word.letter in "@^" for word in line.words)
        texts = [
            f"{word.letter.upper()}{self._text(word, value)}"
            for word, value in values
            if standing or word.letter not in "@^"
        ]
        if polar:
            texts += self._polar(values)
        texts = self._center(line, values, texts)
        self._append(texts, self._comments(line, keep=keep), "/" if line.optional else "")

    def _append(self, texts: list[str], comments: list[str], begin: str) -> None:
        """Add a line of words and comments; these stand before it where it would be longer than LinuxCNC reads."""
        whole = begin + " ".join([*texts, *comments])
        if texts and comments and len(whole) > LONGEST:
            self.lines += [begin + " ".join(comments), begin + " ".join(texts)]
        elif texts or comments:
            self.lines.append(whole)

    def _text(self, word: LineWord, value: float) -> str:
        return number_text(value, 1 if word.letter in "gm" else self.decimals)

    def _polar(self, values: WordValues) -> list[str]:
        machine = self.machine
        words = {word.letter: value for word, value in values}
        end = machine.target(words)
        found = []
        for axis in "xy":
            value = end[axis] if machine.absolute else end[axis] - machine.place[axis]
            if math.isnan(value):
                raise NotExpandableError("polar words where the place is not known")
            found.append(f"{axis.upper()}{number_text(value * machine.factor(axis), self.decimals)}")
        return found

    def _center(self, line: ProgramLine, values: WordValues, texts: list[str]) -> list[str]:
        """Put the centre of an arc in the place of its radius, which tells a half circle's centre but roughly."""
        words = {word.letter: value for word, value in values if word.letter not in "gm"}
        codes = [round(10.0 * value) for word, value in values if word.letter == "g"]
        motion, axes = self._motion(codes, words), self.machine.axes
        if motion not in (20, 30) or "r" not in words or axes is None:
            return texts
        start, end = self.machine.place, self.machine.target(words)
        across, along = (end[axes[0]] - start[axes[0]], end[axes[1]] - start[axes[1]])
        chord = math.hypot(across, along)
        if math.isnan(chord) or chord == 0.0 or abs(words["r"]) < (0.5 - 1e-4) * chord:
            return texts
        found = center_by_radius(0j, complex(across, along), words["r"], clockwise=motion == 20)
        center = (found.real, found.imag)
        kept = [text for text, word in zip(texts, self._shown(line), strict=False) if word.letter != "r"]
        absolute = self.machine.modes["centres"] == 901
        for axis, value in zip(axes, center, strict=False):
            whole = value + start[axis] if absolute else value
            kept.append(f"{'IJK'['xyz'.index(axis)]}{number_text(whole, self.decimals)}")
        return kept + texts[len(self._shown(line)) :]

    @staticmethod
    def _shown(line: ProgramLine) -> list[LineWord]:
        return [word for word in line.words if word.letter not in "@^"]

    def _comment(self, text: str) -> str:
        """Put values in the place of parameters in a comment that the controller shows."""
        if not re.match(r"\s*(?:debug|print|log|abort),", text, re.IGNORECASE):
            return text
        style = ["%.6f"]

        def shown(found: re.Match[str]) -> str:
            """Return the value of a parameter; a format is left out and kept for the values behind it."""
            if found[0].startswith("%"):
                style[0] = {"%d": "%.0f", "%f": "%.4f"}.get(found[0], found[0])
                return ""
            try:
                name = re.sub(r"\s", "", found[1] or "").lower()
                value = self.store.named(name) if found[1] is not None else self.store.number(float(found[2]))
            except ExpandError:
                return found[0]
            if math.isnan(value):
                return found[0]
            self.changed = True
            return style[0] % (value or 0.0)

        return _COMPUTED.sub(shown, text)

    def _move(self, codes: list[int], motion: int, words: dict[str, float]) -> None:
        """Follow the place of a block that is written as it is."""
        machine = self.machine
        for code in codes:
            if code in _SETTING:
                self.offsets.apply(code, words)
            if code == 100 and round(words.get("l", 0.0)) in (1, 10, 11):
                self.cutter.set_tool(words, self.offsets.unit("x"))
        if motion == -1:
            return
        if motion not in CYCLES:
            self.memory.initial = None
        if 530 in codes:
            self.offsets.move_in_machine(words)
        elif motion in (382, 383, 384, 385):
            machine.forget("".join(axis for axis in AXES if axis in words))
            self.store.numbers.update(dict.fromkeys(range(5061, 5071), UNKNOWN))
        elif motion in (*TURNING, 760):
            machine.forget("xz")
        elif motion in CYCLES:
            across = machine.axes[2] if machine.axes is not None else "z"
            if self.memory.initial not in (None, machine.place[across]):
                raise NotExpandableError("a cycle with a turning spindle behind one that is written out")
            self.memory.initial = None
            machine.forget("xyz")
        elif motion != 800:
            machine.place = machine.target(words)
        machine.motion = motion


def _belongs(letter: str, value: float) -> bool:
    """Return whether a word is part of a cycle."""
    if letter == "g":
        return round(10.0 * value) in MOVING
    return letter in "xyzabcuvwrqpl@^"
