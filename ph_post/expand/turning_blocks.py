"""Blocks of programs of Fanuc's lathes, in G code system A: increments by U and W, and cycles as plain motions.

FANUC Series 30i/31i/32i-MODEL B, Operator's Manual for Lathe System, B-64484EN-1, "Canned cycle (G90, G92, G94)" and
"Multiple repetitive cycle (G70-G76)": G90 goes to the diameter in rapid, cuts, comes back in X at the feed and in Z in
rapid, and G94 the same with X and Z exchanged; both last until another word of their group. G70 runs the blocks of a
shape and goes back to where it began in rapid. What a control's settings decide stays as it is: how G71 to G75 back
off, and how G76 and G92 leave a thread.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from ph_post.expand.fanuc_blocks import FanucBlocks, MacroWord
from ph_post.expand.faults import NotExpandableError
from ph_post.expand.macro import FanucNumbers, word_text

_TURNING, _THREADS, _FACING = 900, 920, 940
_SINGLE: Final = (_TURNING, _THREADS, _FACING)
_MOTIONS: Final = {0, 10, 20, 30}
_OTHER_MOTIONS: Final = {320, 340, 21, 31, 22, 32}
_FEEDS: Final = {980, 990}
_MULTIPLE: Final = range(700, 761, 10)
_TAPPING: Final = 950
"""A cycle of Haas's live tools; in the G code systems B and C feeds a turn."""
_UNKNOWN: Final = 9990
"""A code behind which neither the place nor the motion in force is known."""

_PLACED: Final = frozenset("xzuw")
_INCREMENTS: Final = {"u": "x", "w": "z"}
_BESIDE: Final = frozenset("fsgn")
_SHAPE_CODES: Final = _MOTIONS | {400, 410, 420, 960, 970}
_SHAPE_LETTERS: Final = frozenset("gxzuwrikfsn")
_BESIDE_MOTIONS: Final = {*_MOTIONS, *_FEEDS, 170, 180, 190, 200, 210, 400, 410, 420, 800, 960, 970}


class SingleCycle(msgspec.Struct, kw_only=True):
    """A cycle of G90, G92 or G94 in force: where it begins, and its words; `why` it stays as it is."""

    code: int
    start: dict[str, float]
    words: dict[str, float] = {}
    why: str = ""


class TurningBlocks(FanucBlocks):
    """Follows the blocks of a lathe's program; X is given in diameters. Else as :class:`FanucBlocks`."""

    def __init__(self, numbers: FanucNumbers, standing: Mapping[tuple[str, int], str]) -> None:
        super().__init__(numbers, standing)
        self.machine.modes.update(plane=180, distance=900)
        self._single: SingleCycle | None = None
        self._finishes = self._finished = False
        """Whether a shape is being written out, and whether the motion in force is the last one of such a shape."""

    @property
    def is_open(self) -> bool:
        """Whether something is being written out that a later block may end."""
        return self._single is not None or self._finishes or self._finished or super().is_open

    def codes_of(self, words: Sequence[MacroWord]) -> list[int]:
        """Return ten times the G words, as the parent's rules are to have them."""
        placed = any(word.letters in _PLACED for word in words)
        found = []
        codes = super().codes_of(words)
        cycles = {*_MULTIPLE, *_SINGLE} | ({_TAPPING} if placed and not _MOTIONS & set(codes) else set())
        for code in codes:
            if code == 500 and placed:
                found.append(920)
            elif code in cycles:
                found.append(_UNKNOWN)
            elif code not in _FEEDS and code != 500:
                found.append(code)
        return found

    def run(
        self, text: str, words: Sequence[MacroWord], comments: Sequence[str], *, optional: bool, same: bool
    ) -> None:
        """Run a block."""
        if any(len(word.letters) > 1 or (word.letters in "gm" and math.isnan(word.value)) for word in words):
            # A letter without its number may be any.
            self._single = None
            super().run(text, words, comments, optional=optional, same=same)
            self.machine.forget()
            return
        own = set(super().codes_of(words))
        if any(word.letters == "t" for word in words):
            # With another offset the tool is somewhere else.
            self.machine.forget("xz")
        if own & (_MOTIONS | _OTHER_MOTIONS | set(_MULTIPLE)) or optional:
            self._single, self._finished = None, False
        values = {word.letters: word.value for word in words if word.letters not in "gmno"}
        code = next((code for code in own if code in _SINGLE), None)
        placed = bool(_PLACED & set(values)) and not own - _BESIDE_MOTIONS - set(_SINGLE)
        if code is not None and not optional:
            self._begin(code)
        if self._single is not None:
            if not self._single.why:
                if not placed:
                    raise NotExpandableError("a block without a place, at which the control repeats the cycle")
                self._write_single(words, values, comments)
                return
            self._keep(text, words, comments, slash="", same=same)
            self.machine.forget()
            return
        if self._finished and placed:
            raise NotExpandableError("a move behind the cycle without a word of its motion")
        if own & set(_MULTIPLE):
            # All of them go back to where they began.
            place = dict(self.machine.place)
            super().run(text, words, comments, optional=optional, same=same)
            self.machine.place.update({axis: math.nan if optional else place[axis] for axis in "xz"})
            return
        plain = words if optional or not placed else self._absolute(words, values)
        if placed and {"u", "w"} & {word.letters for word in plain}:
            # From a place that is not known.
            self._keep(text, words, comments, slash="/" * optional, same=same)
            self._follow_modes(self.codes_of(words), [])
            self.machine.forget()
            return
        super().run(text, plain, comments, optional=optional, same=same and plain is words)
        if not placed and {"u", "w"} & values.keys() and 40 not in own:
            # G28 and others name X and Z by their increments.
            self.machine.forget("xz")

    # ------------------------------------------------------------------ increments

    def _absolute(self, words: Sequence[MacroWord], values: Mapping[str, float]) -> Sequence[MacroWord]:
        """Return words with X and Z in the place of U and W; the same where an axis is not known."""
        place = self.machine.place
        given = {letter: axis for letter, axis in _INCREMENTS.items() if letter in values}
        if not given or any(axis in values or math.isnan(place[axis] + values[u]) for u, axis in given.items()):
            return words
        found = []
        for word in words:
            axis = given.get(word.letters)
            value = word.value if axis is None else place[axis] + word.value
            text = word.text if axis is None else word_text(axis, value, self.numbers.decimals + self.more)
            found.append(MacroWord(axis or word.letters, value, text))
        return found

    # ------------------------------------------------------------------ G90 and G94

    def _begin(self, code: int) -> None:
        """Begin a cycle of G90, G92 or G94."""
        place = {axis: self.machine.place[axis] for axis in "xz"}
        why = self._standing.get(self.at, "")
        if code == _THREADS:
            why = "how it leaves the thread is a setting of the control"
        if why:
            self.notes[f"{self.at[0]}:{self.at[1]}: cycle stays as it is: {why}"] = None
        else:
            self.begun = self.at
        self._single = SingleCycle(code=code, start=place, why=why)
        self.machine.modes["motion"] = _UNKNOWN

    def _write_single(self, words: Sequence[MacroWord], values: Mapping[str, float], comments: Sequence[str]) -> None:
        cycle = self._single
        assert cycle is not None
        known = _PLACED | _BESIDE | {"r"}
        if any(word.letters not in known for word in words) or any(map(math.isnan, values.values())):
            raise NotExpandableError("a word in the block of a cycle that does not belong to it")
        if self.machine.modes["cutter"] != 400 or math.isnan(sum(cycle.start.values())):
            raise NotExpandableError("the place where the cycle begins, or the tool's own, is not known")
        for letter, axis in _INCREMENTS.items():
            if letter in values:
                cycle.words[axis] = cycle.start[axis] + values[letter]
            if axis in values:
                cycle.words[axis] = values[axis]
        if "r" in values:
            cycle.words["r"] = values["r"]
        if not {"x", "z"} <= cycle.words.keys():
            raise NotExpandableError("a cycle without X or Z")
        x, z, taper = cycle.words["x"], cycle.words["z"], cycle.words.get("r", 0.0)
        self._put([*(word.text for word in words if word.letters in "fs"), *comments])
        if cycle.code == _TURNING:
            moves = [(0, {"x": x + 2.0 * taper}), (1, {"x": x, "z": z} if taper else {"z": z})]
            moves += [(1, {"x": cycle.start["x"]}), (0, {"z": cycle.start["z"]})]
        else:
            moves = [(0, {"z": z + taper}), (1, {"x": x, "z": z} if taper else {"x": x})]
            moves += [(1, {"z": cycle.start["z"]}), (0, {"x": cycle.start["x"]})]
        for motion, to in moves:
            self._move(motion, to)

    def _move(self, motion: int, to: Mapping[str, float]) -> None:
        """Write a move."""
        self.machine.place.update(to)
        self._put([f"G{motion}", self.coordinates([*to])])
        self._moves_by = 10 * motion

    # ------------------------------------------------------------------ G70

    def begin_finish(self, words: Sequence[MacroWord], comments: Sequence[str]) -> dict[str, float]:
        """Begin a G70, and return where it does.

        Raises
        ------
        NotExpandableError
            Where that is not known, or a word is not understood.
        """
        self.begun = self.at
        start = {axis: self.machine.place[axis] for axis in "xz"}
        if math.isnan(sum(start.values())) or self.machine.modes["cutter"] != 400:
            raise NotExpandableError("the place where the cycle begins, or the tool's own, is not known")
        said = " ".join(word.text for word in words)
        if any(word.letters not in "gpqfs" for word in words):
            raise NotExpandableError("a word in the block of a cycle that does not belong to it")
        # What is written out still says that the program is one of a lathe.
        self._put([f"({said})", *comments])
        self._put([word.text for word in words if word.letters in "fs"])
        # A move of no length, from which the place is known behind cycles that stay as they are.
        self._put(["G0", self.coordinates("xz")])
        self._moves_by = 0
        self._single, self._finishes, self._finished = None, True, False
        self.machine.modes["motion"] = _UNKNOWN
        return start

    def check_shape(self, words: Sequence[MacroWord]) -> None:
        """Refuse a block of a shape that does more than to move."""
        codes = set(super().codes_of(words))
        if codes - _SHAPE_CODES or any(word.letters not in _SHAPE_LETTERS for word in words):
            raise NotExpandableError("a block of the shape that does more than to move")

    def end_finish(self, start: Mapping[str, float]) -> None:
        """Go back to where a G70 began."""
        if self.machine.modes["cutter"] != 400:
            raise NotExpandableError("a shape that leaves the compensation of the tool's nose on")
        self._move(0, start)
        self.machine.modes["motion"] = _UNKNOWN
        self._finishes, self._finished = False, True

    def keep_shape(self, text: str) -> None:
        """Keep a line that cycles take as data."""
        self.lines.append(text)
        self.machine.modes["motion"] = _UNKNOWN
