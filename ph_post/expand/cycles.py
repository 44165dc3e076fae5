"""Drilling and boring cycles as plain motions, in the order in which LinuxCNC makes them.

NIST's RS274/NGC interpreter, version 3, sections 3.5.16 and 3.8, and LinuxCNC's manual, "Canned Cycles".
"""

from __future__ import annotations

import math
from typing import Final

from ph_post.expand.faults import ExpandError, NotExpandableError
from ph_post.expand.machine import MachineState
from ph_post.expand.writing import number_text

MOVING: Final = (730, 810, 820, 830, 850, 860, 890)
"""Cycles that only move, dwell and stop the spindle; the others stay as they are."""

STANDING: Final = (740, 840, 870, 880)

CYCLES: Final = (*MOVING, *STANDING)

_CLEARANCE: Final = {210: 0.254, 200: 0.010, 0: math.nan}
"""How far a peck backs off or stops before it cuts on, by units: 0.010 inch."""


def _turned(at: tuple[float, float], words: dict[str, float]) -> tuple[float, float]:
    """Return the next place where polar words stand in increments."""
    radius = math.hypot(*at) + words.get("@", 0.0)
    angle = math.atan2(at[1], at[0]) + math.radians(words.get("^", 0.0))
    return radius * math.cos(angle), radius * math.sin(angle)


class CycleMemory:
    """Words that a cycle takes from the one before: its plane R, its bottom, P and Q, and where it began."""

    def __init__(self) -> None:
        self.plane = self.bottom = self.dwell = self.peck = math.nan
        self.initial: float | None = None


class CycleWriter:
    """Writes one cycle block.

    Parameters
    ----------
    machine : MachineState
    memory : CycleMemory
    decimals : int
    stops : bool
        Whether every move ends in a dwell of no length, which makes the path exact where its mode is not known.

    Of the `lines`, the first `raised` come before the path is exact.
    """

    def __init__(self, machine: MachineState, memory: CycleMemory, decimals: int, *, stops: bool = False) -> None:
        self._machine, self._memory, self._decimals, self._stops = machine, memory, decimals, stops
        self.lines: list[str] = []
        self.raised = 0
        axes = machine.axes
        if axes is None:
            raise NotExpandableError("a cycle in a plane of U, V or W")
        self._axes = axes

    def write(self, motion: int, words: dict[str, float]) -> list[str]:
        """Return the lines of a cycle, and leave the machine behind it.

        Raises
        ------
        ExpandError
            Where a word is missing, or the place is not known.
        """
        machine, memory, (first, second, across) = self._machine, self._memory, self._axes
        self.check(motion, words)
        begun = machine.place[across]
        if memory.initial is None:
            memory.initial = begun
        high = memory.initial
        plane, bottom = words.get("r", memory.plane), words.get(across, memory.bottom)
        memory.plane, memory.bottom = plane, bottom
        step = (0.0, 0.0)
        at = (machine.place[first], machine.place[second])
        if machine.absolute:
            end = machine.target(words)
            at = (end[first], end[second])
            level, floor = plane, bottom
        else:
            step = (words.get(first, 0.0), words.get(second, 0.0))
            level = plane + high
            floor = level + bottom
        if any(math.isnan(one) for one in (high, begun, level, floor)):
            raise NotExpandableError(f"{across.upper()} is not known where the cycle begins")
        if math.isnan(sum(at)) and not machine.absolute:
            raise NotExpandableError(f"{first.upper()} or {second.upper()} is not known where the cycle begins")
        if level < floor:
            raise ExpandError("the plane R is below the bottom of the cycle")
        if high < level:
            self.move(0, {across: level}, named=across)
            self.raised = 1
            del self.lines[1:]
            high = begun = level
        clear = level if machine.modes["retract"] == 990 else high
        dwell, peck = words.get("p", memory.dwell), words.get("q", memory.peck)
        memory.dwell, memory.peck = dwell, peck
        turned = not machine.absolute and ("@" in words or "^" in words)
        for turn in range(round(words.get("l", 1.0))):
            at = _turned(at, words) if turned else (at[0] + step[0], at[1] + step[1])
            over = begun if turn == 0 and begun > level else clear
            self.move(0, {first: at[0], second: at[1], across: over}, named=first + second)
            if over > level:
                self.move(0, {across: level}, named=across)
            self.hole(motion, level, floor, clear, dwell, peck)
        machine.motion = motion
        return self.lines

    def is_open(self, words: dict[str, float]) -> bool:
        """Return whether nobody knows to which height the cycle retracts: neither G98 nor G99 was said."""
        plane = words.get("r", self._memory.plane)
        if self._machine.modes["retract"] != 0:
            return False
        if not self._machine.absolute:
            return not plane >= 0.0
        begun = self._machine.place[self._axes[2]] if self._memory.initial is None else self._memory.initial
        return not begun <= plane

    def leave_standing(self, motion: int, words: dict[str, float]) -> None:
        """Follow a cycle that is written as it is: nothing is known of the height behind it."""
        machine, memory, (first, second, across) = self._machine, self._memory, self._axes
        self.check(motion, words)
        if memory.initial is None:
            memory.initial = machine.place[across]
        memory.plane, memory.bottom = words.get("r", memory.plane), words.get(across, memory.bottom)
        memory.dwell, memory.peck = words.get("p", memory.dwell), words.get("q", memory.peck)
        if machine.absolute and memory.plane < memory.bottom:
            raise ExpandError("the plane R is below the bottom of the cycle")
        times = round(words.get("l", 1.0)) if not machine.absolute else 1
        for _ in range(times):
            end = machine.target({letter: words[letter] for letter in (first, second, "@", "^") if letter in words})
            machine.place[first], machine.place[second] = end[first], end[second]
        machine.forget(across)
        machine.motion = motion

    def check(self, motion: int, words: dict[str, float]) -> None:
        """Refuse a cycle whose words are not whole."""
        machine, across = self._machine, self._axes[2]
        new, name = machine.motion != motion, f"G{motion / 10:g}"
        if machine.modes["feed_mode"] == 930:
            raise ExpandError(f"{name} under G93")
        if machine.modes["cutter"] != 400:
            raise ExpandError(f"{name} with cutter compensation on")
        if "r" not in words and new:
            raise ExpandError(f"{name} without R")
        if across not in words and new:
            raise ExpandError(f"{name} without {across.upper()}")
        if motion in (820, 860, 890) and "p" not in words and new:
            raise ExpandError(f"{name} without P")
        if motion in (730, 830) and words.get("q", math.nan if new else self._memory.peck) <= 0.0:
            raise ExpandError(f"{name} with a Q that is not positive")
        if motion in (730, 830) and "q" not in words and new:
            raise ExpandError(f"{name} without Q")
        if words.get("l", 1.0) < 1.0:
            raise ExpandError(f"{name} without repeats: L{words['l']:g}")
        if motion == 860 and not machine.spindle:
            raise ExpandError("G86 with the spindle at rest")

    def hole(self, motion: int, level: float, floor: float, clear: float, dwell: float, peck: float) -> None:
        """Write a hole from the plane R (`level`) to its bottom (`floor`) and back to a `clear` height."""
        across = self._axes[2]
        if motion in (730, 830):
            self.pecks(motion, level, floor, peck)
        self.move(1, {across: floor}, named=across)
        if motion in (820, 860, 890):
            self.lines.append(f"G4 P{number_text(dwell, self._decimals)}")
        if motion == 850:
            self.move(1, {across: level}, named=across)
        if motion == 860:
            self.lines.append("M5")
        self.move(1 if motion == 890 else 0, {across: clear}, named=across)
        if motion == 860:
            self.lines.append(f"M{self._machine.spindle}")

    def pecks(self, motion: int, level: float, floor: float, peck: float) -> None:
        """Write the pecks of G73 and G83 but the last."""
        across, depth = self._axes[2], level - peck
        off = self.clearance()
        if depth > floor and math.isnan(off):
            raise NotExpandableError("a pecking cycle before G20 or G21: how far it backs off is not known")
        while depth > floor:
            self.move(1, {across: depth}, named=across)
            if motion == 830:
                self.move(0, {across: level}, named=across)
            self.move(0, {across: depth + off}, named=across)
            depth -= peck

    def clearance(self) -> float:
        """Return how far a peck backs off, NaN where it is not known."""
        return _CLEARANCE[self._machine.modes["units"]]

    def move(self, motion: int, to: dict[str, float], *, named: str) -> None:
        """Write a move; `named` axes are written even where they stay."""
        place = self._machine.place
        words = []
        for axis in sorted(to):
            if math.isnan(to[axis]) or (axis not in named and to[axis] == place[axis]):
                continue
            words.append(axis)
            place[axis] = to[axis]
        self.lines.append(self.text(motion, words))
        if self._stops:
            self.lines.append("G4 P0")

    def text(self, motion: int, axes: list[str]) -> str:
        """Write a move to the place of the machine, of which some axes are named."""
        words = [f"G{motion}"]
        for axis in axes:
            value = self._machine.place[axis] * self._machine.factor(axis)
            words.append(f"{axis.upper()}{number_text(value, self._decimals)}")
        return " ".join(words)
