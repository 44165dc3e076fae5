"""Keep beams from standing on the part, and nozzles from resting between two beads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ph_post.edit.block_words import ends_program
from ph_post.edit.extrusion import filament_of
from ph_post.edit.reversals import MOTION, SHARE, SIGN
from ph_post.gcode.paths import places_words
from ph_post.gcode.program import PartProgram, chain_heads
from ph_post.gcode.working import working_motions
from ph_post.types import Array, Machine

_WHY: Final = {
    "laser": "the beam would burn a dot in a sharp corner (with M4 its power follows the speed)",
    "plasma": "the torch would stand in a sharp corner",
    "extruder": "the nozzle would rest between two beads",
}

_PEN: Final = '; tool = "pen" in the machine file says that it is a pen, which burns nothing'


class BeamGuard:
    """Says where the tool of a program works, and which moves of an axis alone would mark the part.

    `works` is the :class:`~ph_post.gcode.working.WorkingMotions`; `is_beam` where the tool is a laser or a torch,
    `tends` where it is no cutter.
    """

    def __init__(self, program: PartProgram, machine: Machine) -> None:
        self._program = program
        self.works = working_motions(program, machine.tool)
        self.tool = self.works.tool
        self._stated = machine.tool is not None
        self.is_beam, self.tends = self.tool in ("laser", "plasma"), self.tool != "cutter"

    def marks(self, row: Array, before: int, *, behind_rapid: bool) -> bool:
        """Return whether a move of an axis alone at a change, whose sign `before` it was, would mark the part.

        A beam whose power follows the speed may move on at the feed; where it is switched off behind a motion, the move
        comes after that.
        """
        motion, works = int(row[MOTION]), self.works
        rests = row[SIGN] == 0.0 or before == 0
        if not self.is_beam:
            return bool(self.tends and works.stays[motion] and row[SIGN] == 0.0 and not behind_rapid)
        if row[SHARE] == 1.0 and self.off_behind(motion) is not None:
            return False
        if row[SIGN] == 0.0:
            return bool(works.stays[motion])
        if behind_rapid and self.tool == "laser":
            # Its moves are rapids, in which a laser is off.
            return False
        return bool(works.stays[motion] if rests or behind_rapid else works.burns[motion])

    def off_behind(self, motion: int) -> int | None:
        """Return the line behind a motion, and before the next one, that switches a beam off, or pulls filament back.

        None where there is no such line, or the tool does not work at the motion.
        """
        program, motions = self._program, self._program.motions
        if not self.tends or not (self.works.stays[motion] or self.works.on[motion]):
            return None
        last = int(motions.block[motion + 1]) if motion + 1 < motions.block.size else program.blocks
        breaks = [mark.block for mark in program.breaks if mark.block > motions.block[motion]]
        for block in range(int(motions.block[motion]) + 1, min([last, *breaks])):
            if ends_program(program, block):
                return None
            modal = program.modal_after(block)
            off = modal.spindle not in ("M3", "M4") or modal.speed == 0.0
            if off if self.is_beam else block in filament_of(program):
                return block
        return None

    def runs(self) -> list[tuple[int, int]]:
        """Return first motion, and the one behind the last, of the stretches in which a beam or a nozzle works."""
        motions = self._program.motions
        if not self.tends:
            return []
        on = self.works.on.astype(np.int64)
        ends = np.flatnonzero(np.diff(on, prepend=0, append=0) != 0)
        chain = np.flatnonzero(chain_heads(motions.chain))[1:]
        inside = chain[on[chain] * on[chain - 1] == 1]
        places = np.sort(np.concatenate([ends, inside, inside]))
        return [(int(begin), int(end)) for begin, end in places.reshape(-1, 2)]

    def warn_left(self, left: Sequence[tuple[int, int]]) -> list[str]:
        """Warn of stretches that are left alone as a shift would mark the part."""
        if not left:
            return []
        block = self._program.motions.block
        where = places_words(self._program, [(int(block[begin]), int(block[end - 1])) for begin, end in left])
        hint = _PEN if self.tool == "laser" and not self._stated else ""
        return [f"not compensated in {where}: {_WHY[self.tool]}{hint}"]


def run_beside(runs: Sequence[tuple[int, int]], motion: int) -> int:
    """Return the number of the stretch that a motion belongs to, or that comes next; the last one behind all.

    Examples
    --------
    >>> [run_beside([(1, 3), (5, 7)], motion) for motion in (0, 2, 3, 9)]
    [0, 0, 1, 1]
    """
    return next((number for number, (_, end) in enumerate(runs) if motion < end), len(runs) - 1)
