"""Drilling and boring cycles as Fanuc runs them.

FANUC Series 30i/31i/32i-MODEL B, Operator's Manual for Machining Center System, B-64484EN-2, "Canned cycle for
drilling": the cycles, their data that stay until they are cancelled, K, G98 and G99. What a control's settings decide
stays as it is: how far G73 and G83 back off, where G76 and G87 shift to, tapping, and G88, which a person ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from ph_post.expand.cycles import CycleMemory, CycleWriter
from ph_post.expand.faults import NotExpandableError
from ph_post.expand.machine import MachineState
from ph_post.expand.macro import FanucNumbers

PECKING: Final = (730, 830)
MOVING_ONLY: Final = (810, 820, 850, 860, 890)
"""Cycles that only move, dwell and stop the spindle, whatever the control is set to."""


class FanucCycle(CycleWriter):
    """Writes a cycle as Fanuc runs it.

    Parameters
    ----------
    machine : MachineState
    memory : CycleMemory
    numbers : FanucNumbers
    coordinates : callable
        Writes the place of the machine, of which some axes are named.
    """

    def __init__(
        self,
        machine: MachineState,
        memory: CycleMemory,
        numbers: FanucNumbers,
        coordinates: Callable[[Sequence[str]], str],
    ) -> None:
        super().__init__(machine, memory, numbers.decimals)
        self._clearance, self._coordinates = numbers.clearance, coordinates

    def check(self, motion: int, words: dict[str, float]) -> None:
        """Take what stays from the block before, and refuse a cycle whose words are not whole."""
        memory, across = self._memory, self._axes[2]
        words.setdefault("r", memory.plane)
        words.setdefault(across, memory.bottom)
        if math.isnan(words["r"]) or math.isnan(words[across]):
            raise NotExpandableError(f"G{motion // 10} without R or {across.upper()}")
        if motion in PECKING and not words.get("q", memory.peck) > 0.0:
            raise NotExpandableError(f"G{motion // 10} without Q")
        if motion in PECKING and self._machine.modes["units"] == 0:
            raise NotExpandableError("a pecking cycle before G20 or G21")
        if words.get("l", 1.0) < 1.0:
            raise NotExpandableError("a cycle with K0")
        if "p" not in words and math.isnan(memory.dwell):
            words["p"] = 0.0
        high = self._machine.place[across] if memory.initial is None else memory.initial
        if self._machine.absolute and high < words["r"]:
            raise NotExpandableError("a cycle that begins below its plane R")
        if motion == 860 and self._machine.spindle != 3:
            raise NotExpandableError("G86 where the spindle is not known to turn clockwise")

    def hole(self, motion: int, level: float, floor: float, clear: float, dwell: float, peck: float) -> None:
        """Write a hole."""
        across = self._axes[2]
        if motion in PECKING:
            self.pecks(motion, level, floor, peck)
        self.move(1, {across: floor}, named=across)
        if motion in (850, 890):
            self.lines[-1] = f"G9 {self.lines[-1]}"
        if dwell and motion in (820, 890):
            self.lines.append(f"G4 P{round(dwell)}")
        if motion in (850, 890):
            self.move(1, {across: level}, named=across)
        if motion == 860:
            self.lines.append("M5")
        self.move(0, {across: clear}, named=across)
        if motion == 860:
            self.lines.append("M3")

    def clearance(self) -> float:
        """Return how far a peck backs off."""
        assert self._clearance is not None
        return self._clearance if self._machine.modes["units"] == 210 else self._clearance / 25.4

    def text(self, motion: int, axes: list[str]) -> str:
        """Write a move to the place of the machine, of which some axes are named."""
        return f"G{motion} {self._coordinates(axes)}"
