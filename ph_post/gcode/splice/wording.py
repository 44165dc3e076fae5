"""The words of a part of a motion, and of a jog, in a program's units and modes."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Final

import numpy as np

from ph_post.errors import InputError
from ph_post.gcode.reader.record import ARC, AXES, CUBIC, PLANE_AXES, Modal, PartProgram
from ph_post.gcode.splice.blocktext import letters
from ph_post.gcode.splice.parts import place, split_cubic
from ph_post.gcode.splice.schedule import Part
from ph_post.types import Array, IntArray

_CENTERS: Final = "IJK"
_FULL: Final = 1e-9
_MOST_DECIMALS: Final = 9


def fine_decimals(program: PartProgram, decimals: int) -> int:
    """Decimals on which every position that a program names is exact, and those written too."""
    words = program.words
    placed = np.isin(words.letter, [ord(name) for name in "XYZIJK"]) & (words.decimals > decimals)
    return min(max(decimals, int(words.decimals[placed].max(initial=0))), _MOST_DECIMALS)


class Wording:
    """Writes the words of parts, with what has been written before kept in mind.

    Parameters
    ----------
    program : PartProgram
    motion : int
    modal : Modal
        Modes under which the motion's block is executed.
    decimals : int
        Of new places.
    fine : int
        Of places that the program names itself.
    length : callable
        ``length(count, decimals) -> text``: how the dialect writes lengths.
    """

    def __init__(
        self, program: PartProgram, motion: int, modal: Modal, decimals: int, fine: int,
        length: Callable[[int, int], str],
    ) -> None:  # fmt: skip
        self.program, self.motion, self.modal = program, motion, modal
        self._coarse, self._fine, self._length = decimals, fine, length
        self._last = self._at = np.zeros(3, dtype=np.int64)
        self.block = int(program.motions.block[motion])

    @cached_property
    def _own(self) -> dict[str, int]:
        return letters(self.program, self.block)

    def begin(self, offset: IntArray) -> None:
        """Tell the offset, in steps, with which the motion begins."""
        self._last = offset.copy()

    def _steps(self, length: Array, coarse: bool) -> IntArray:
        """Lengths [m] as whole steps of the finest decimal."""
        decimals = self._coarse if coarse else self._fine
        count = np.rint(np.where(np.isnan(length), 0.0, length) / self.modal.units * 10.0**decimals)
        return np.asarray(count.astype(np.int64) * 10 ** (self._fine - decimals))

    def _point(self, share: float) -> IntArray:
        point = place(self.program.motions, self.motion, share)
        return self._steps(point, coarse=0.0 < share < 1.0)

    def _text(self, count: int) -> str:
        return self._length(int(count), self._fine)

    def jog(self, axis: int, offset: IntArray, share: float) -> str:
        """Word that moves an axis to an offset, in steps of the coarse decimals, at a place of the motion."""
        offset = offset * 10 ** (self._fine - self._coarse)
        if self.modal.absolute:
            self._require(axis, place(self.program.motions, self.motion, share))
            return AXES[axis] + self._text(self._point(share)[axis] + offset[axis])
        count = offset[axis] - self._last[axis] * 10 ** (self._fine - self._coarse)
        self._last[axis] = offset[axis] // 10 ** (self._fine - self._coarse)
        return AXES[axis] + self._text(count)

    def part(self, part: Part, offset: IntArray) -> dict[str, str]:
        """Words of a part by letter while an offset is carried; empty ones are not to be written."""
        if part.low == 0.0:
            self._at = self._point(0.0)
        end = self._point(part.high)
        shift = offset * 10 ** (self._fine - self._coarse)
        kind = self.program.motions.kind[self.motion]
        for axis in self._axes(kind):
            self._require(
                axis, self.program.motions.start[self.motion], self.program.motions.end[self.motion]
            )
        words = {AXES[axis]: self._end_word(axis, end, shift) for axis in self._axes(kind)}
        if kind == ARC:
            words |= self._arc_words(part, shift)
        elif kind == CUBIC:
            words |= self._cubic_words(part, end)
        self._at = end
        return words

    def _require(self, axis: int, *points: Array) -> None:
        """Refuse to write what follows from a position that is not known."""
        if any(np.isnan(point[axis]) for point in points):
            where = f"{self.program.name}:{self.block + 1}"
            raise InputError(where, f"a place inside a motion that begins where {AXES[axis]} is not known")

    def _axes(self, kind: int) -> list[int]:
        """Axes that are written: those of the block, of curves those of the plane as well."""
        named = {axis for axis in range(3) if AXES[axis] in self._own}
        if kind in (ARC, CUBIC):
            named |= set(PLANE_AXES[int(self.program.motions.plane[self.motion])][:2])
        return sorted(named)

    def _end_word(self, axis: int, end: IntArray, shift: IntArray) -> str:
        if self.modal.absolute:
            return AXES[axis] + self._text(end[axis] + shift[axis])
        return AXES[axis] + self._text(end[axis] - self._at[axis])

    def _arc_words(self, part: Part, shift: IntArray) -> dict[str, str]:
        """Centre and turns; a radius is replaced by them, as half circles lose their digits with it."""
        motions, k = self.program.motions, self.motion
        a, b, _ = PLANE_AXES[int(motions.plane[k])]
        center = self._steps(motions.center[k], coarse=not {*_CENTERS} & self._own.keys())
        words = {}
        for axis, count in ((a, center[0]), (b, center[1])):
            base = -shift[axis] if self.modal.arc_absolute else self._at[axis]
            words[_CENTERS[axis]] = _CENTERS[axis] + self._text(count - base)
        turns = math.ceil(abs(motions.angle[k]) * (part.high - part.low) / math.tau - _FULL)
        return {**words, "P": f"P{turns}" if turns > 1 else "", "R": ""}

    def _cubic_words(self, part: Part, end: IntArray) -> dict[str, str]:
        control = split_cubic(self.program.motions.control[self.motion], [part.low, part.high])[0]
        inner = self._steps(control[1:3], coarse=True)
        return {
            "I": "I" + self._text(inner[0, 0] - self._at[0]),
            "J": "J" + self._text(inner[0, 1] - self._at[1]),
            "P": "P" + self._text(inner[1, 0] - end[0]),
            "Q": "Q" + self._text(inner[1, 1] - end[1]),
        }

    @property
    def mode(self) -> str:
        """Word of the motion mode in which parts are written."""
        kind, motions = self.program.motions.kind[self.motion], self.program.motions
        if kind == ARC:
            return "G3" if motions.angle[self.motion] > 0.0 else "G2"
        return "G5" if kind == CUBIC else "G1"
