"""Blocks between G41 or G42 and G40: their moves are written as those of the tool's centre."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from ph_post.expand.cutter import CutterMove, CutterPath, center_by_radius
from ph_post.expand.faults import NotExpandableError
from ph_post.expand.machine import AXES, MachineState
from ph_post.expand.tools import ToolShape
from ph_post.expand.writing import number_text

SIDES: Final = {410: 1, 411: 1, 420: -1, 421: -1}
"""G words that switch the compensation on: 1 for the left of the contour, -1 for the right."""

PLAIN: Final = (0, 10, 20, 30)
"""Motions that are compensated."""

_CODES: Final = {*PLAIN, *SIDES, 400, 40, 900, 910, 901, 911, 940, 950, 960, 970, 980, 990}
_PLANES: Final = {170, 180, 190}
_ORDERS: Final = {0, 1, 2, 3, 4, 5, 7, 8, 9, 30, 60}
_DROPPED: Final = {*PLAIN, *SIDES, 900, 910}
_SHIFTS: Final = {"x": ((2, 6, 1), (3, 8, 4)), "z": ((2, 7, 3), (1, 5, 4))}
"""Orientations of lathe tools whose origin lies a radius below and above the centre, by axis."""


class CutterBlocks:
    """Follows G41, G42 and G40.

    `begun` is the place (file and line) of the G41 or G42 in force; those at the places in `standing` stay as they are,
    and `notes` say why.

    Parameters
    ----------
    machine : MachineState
    lines : list of str
        Of the program that is written.
    decimals : int
    tools : mapping of int to ToolShape
        That are known.
    standing : mapping
        Reasons, by place.
    """

    def __init__(
        self,
        machine: MachineState,
        lines: list[str],
        decimals: int,
        tools: Mapping[int, ToolShape],
        standing: Mapping[tuple[str, int], str],
    ) -> None:
        self._machine, self._lines, self._decimals = machine, lines, decimals
        self.tools, self._standing = dict(tools), standing
        self.begun: tuple[str, int] | None = None
        self.notes: dict[str, None] = {}
        self._path: CutterPath | None = None
        self._axes = ("x", "y", "z")
        self._shift, self._shifted = dict.fromkeys(_SHIFTS, 0.0), False

    # ------------------------------------------------------------------ on and off

    def switch(self, codes: list[int], words: dict[str, float], place: tuple[str, int], unit: float) -> None:
        """Follow the G words of a block; `unit` is the machine's unit in those of the program."""
        if self.begun is not None and (400 in codes) and self._path is not None:
            if self._path.entered:
                self._path.finish()
                self._path = None
            else:
                self.leave()
        code = next((one for one in codes if one in SIDES), None)
        if code is None:
            return
        if self.begun is not None:
            raise NotExpandableError("G41 or G42 where the compensation is on")
        try:
            if place in self._standing:
                raise NotExpandableError(self._standing[place])
            radius, orientation = self._tool(code, words, unit)
            if radius != 0.0:
                self._begin(SIDES[code] * (1 if radius > 0.0 else -1), abs(radius), orientation)
                self.begun = place
        except NotExpandableError as error:
            self.notes[f"{place[0]}:{place[1]}: cutter compensation stays as it is: {error.what}"] = None

    def _tool(self, code: int, words: dict[str, float], unit: float) -> tuple[float, int]:
        if code in (411, 421):
            if "d" not in words:
                raise NotExpandableError("G41.1 and G42.1 need a D word")
            return 0.5 * words["d"], round(words.get("l", 0.0))
        number = words.get("d", self._machine.tool)
        if math.isnan(number):
            raise NotExpandableError("which tool is in the spindle is not known")
        shape = self.tools.get(round(number), ToolShape() if number == 0 else None)
        if shape is None or math.isnan(shape.diameter):
            raise NotExpandableError(f"the radius of tool {number:g} is not known")
        if math.isnan(unit):
            raise NotExpandableError("the radius of a tool before G20 or G21")
        return 0.5 * shape.diameter * unit, shape.orientation

    def set_tool(self, words: dict[str, float], unit: float) -> None:
        """Follow G10 L1, L10 or L11, which may give a tool its radius."""
        number = round(words.get("p", 0.0))
        if "r" in words or "q" in words:
            had = self.tools.get(number, ToolShape(diameter=math.nan))
            diameter = 2.0 * words["r"] / unit if "r" in words else had.diameter
            orientation = round(words.get("q", had.orientation))
            self.tools[number] = ToolShape(diameter=diameter, orientation=orientation)

    def _begin(self, side: int, radius: float, orientation: int) -> None:
        machine, axes = self._machine, self._machine.axes
        if axes is None or axes[0] == "y" or (axes[0] == "x" and orientation not in (0, 9)):
            raise NotExpandableError("the plane of the compensation, or a lathe's tool in G17")
        if machine.modes["feed_mode"] == 930:
            raise NotExpandableError("cutter compensation under G93")
        start = complex(machine.place[axes[0]], machine.place[axes[1]])
        if math.isnan(start.real + start.imag):
            raise NotExpandableError("the place where the compensation begins is not known")
        self._axes = axes
        for axis, (below, above) in _SHIFTS.items():
            self._shift[axis] = -radius if orientation in below else radius if orientation in above else 0.0
        self._shifted = orientation not in (0, 9)
        self._path = CutterPath(self._lines, self._text, start, side, radius)
        if not machine.absolute:
            self._lines.append("G90")

    def leave(self) -> None:
        """End a stretch."""
        self.begun = self._path = None
        if not self._machine.absolute:
            self._lines.append("G91")

    def stop(self) -> None:
        """Write what waits."""
        if self._path is not None:
            self._path.stop()

    # ------------------------------------------------------------------ blocks

    def check(self, codes: list[int], orders: list[int], motion: int) -> None:
        """Refuse what LinuxCNC refuses in a compensated stretch, and what cannot be followed there."""
        if self.begun is None:
            return
        if self._path is None and {6, 61} & set(orders):
            self.leave()
            return
        # The move behind G40 is straight: it may lie in another plane.
        known = _CODES | _PLANES if self._path is None else _CODES
        odd = [f"G{code / 10:g}" for code in codes if code not in known]
        odd += [f"M{order}" for order in orders if order not in _ORDERS and order < 100]
        if motion != -1 and (motion not in PLAIN or 40 in codes):
            odd.append(f"G{motion / 10:g}" if 40 not in codes else "G4 and a motion in one block")
        if odd:
            raise NotExpandableError(f"{odd[0]} with cutter compensation on")

    @staticmethod
    def is_dropped(letter: str, code: int, *, moves: bool) -> bool:
        """Return whether a word is written by the moves, or stands for the compensation; `code` is that of a G word."""
        if letter == "g":
            return code in _DROPPED
        return letter in "dl" or (moves and letter in "xyzabcuvwijkrp@^")

    def move(self, motion: int, words: dict[str, float]) -> None:
        """Write the move of a block.

        Raises
        ------
        NotExpandableError
            Where it cannot be compensated.
        """
        machine = self._machine
        first, second, across = self._axes
        end = machine.target(words)
        to = complex(end[first], end[second])
        level, further = self._further(end, across), self._further(end, AXES[3:])
        both = f"{level} {further}".strip()
        if self._path is None:  # the move behind G40 goes from the tool's place to the programmed one
            if motion not in (0, 10):
                raise NotExpandableError("an arc straight behind G40")
            move = CutterMove(motion=motion // 10, end=to, words=both)
            self._lines.append(self._text(move, to))
            machine.place = end
            self.leave()
            return
        if motion in (0, 10):
            self._path.straight(motion // 10, to, both, further)
        else:
            if not self._path.entered and self._shifted:
                raise NotExpandableError("an arc of a lathe's tool onto the contour")
            center = self._center(motion, complex(machine.place[first], machine.place[second]), to, words)
            turns = round(words.get("p", 1.0)) * (-1 if motion == 20 else 1)
            self._path.arc(motion // 10, to, center, turns, both, further)
        machine.place = end

    def _further(self, end: dict[str, float], axes: str) -> str:
        place = self._machine.place
        found = [axis for axis in axes if not math.isnan(end[axis]) and end[axis] != place[axis]]
        return " ".join(f"{axis.upper()}{number_text(end[axis], self._decimals)}" for axis in found)

    def _center(self, motion: int, start: complex, to: complex, words: dict[str, float]) -> complex:
        if "r" in words:
            radius = words["r"]
            if to == start or abs(radius) < (0.5 - 1e-4) * abs(to - start):
                raise NotExpandableError("an arc whose radius does not reach its end")
            return center_by_radius(start, to, radius, clockwise=motion == 20)
        letters = ["ijk"["xyz".index(axis)] for axis in self._axes[:2]]
        given = [words.get(letter, math.nan) for letter in letters]
        if all(math.isnan(one) for one in given):
            raise NotExpandableError("an arc without a centre")
        if self._machine.modes["centres"] == 901:
            return complex(*given)
        return start + complex(*(0.0 if math.isnan(one) else one for one in given))

    def _text(self, move: CutterMove, start: complex) -> str:
        texts = [f"G{move.motion}"]
        absolute = self._machine.modes["centres"] == 901
        center = move.center if absolute else move.center - start
        ends = zip(self._axes, (move.end.real, move.end.imag), (center.real, center.imag), strict=False)
        centers = []
        for axis, end, middle in ends:
            shift = 0.0 if self._path is None else self._shift.get(axis, 0.0)
            value = (end + shift) * self._machine.factor(axis)
            texts.append(f"{axis.upper()}{number_text(value, self._decimals)}")
            whole = middle + shift if absolute else middle
            centers.append(f"{'IJK'['xyz'.index(axis)]}{number_text(whole, self._decimals)}")
        if move.words:
            texts.append(move.words)
        if move.turns:
            texts += centers
        if abs(move.turns) > 1:
            texts.append(f"P{abs(move.turns)}")
        return " ".join(texts)
