"""Which motions of its original those of a program stand for, in the air and at work."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from ph_post.dialects.declaration import line_origins
from ph_post.gcode.program import AXES, LINE, RAPID, PartProgram
from ph_post.types import BoolArray, IntArray

APPROACH: Final = 3.0
"""A move of one axis behind a rapid by at most so many of its gaps only brings it onto its side of the backlash."""


class Counterparts(NamedTuple):
    """What each motion (m,) of a `program` stands for.

    Those of the original from `first` to before `end`; none where that is not behind `first`, as of what was only added
    there. Motions that stand for the same ones are one `stretch`, of which each has the number. `changed` are those in
    lines that a mark names.
    """

    program: PartProgram
    first: IntArray
    end: IntArray
    stretch: IntArray
    changed: BoolArray


def counterparts(program: PartProgram, original: PartProgram, gaps: Mapping[str, float]) -> Counterparts | None:
    """Return which motions of its original those of a program stand for.

    Parameters
    ----------
    program, original : PartProgram
    gaps : mapping of str to float
        Backlash of each axis [m].

    Returns
    -------
    Counterparts or None
        None where the program does not declare this original, or goes through lines in another order.
    """
    if program.data == original.data:
        every = np.arange(program.motions.kind.size)
        return Counterparts(program, every, every + 1, every, np.zeros(every.size, dtype=np.bool_))
    origins = line_origins(program, original)
    blocks, theirs = program.motions.block, original.motions.block
    if origins is None or not blocks.size or (np.diff(blocks) < 0).any() or (np.diff(theirs) < 0).any():
        return None
    turn, turns = (_turns_in_air(one, gaps) for one in (program, original))
    if turn[-1] != turns[-1]:
        turn, turns = np.zeros_like(turn), np.zeros_like(turns)
    # Motions that stand for the same lines, in the air or not, are one stretch, and so is what is added between two.
    known = np.stack([origins.first[blocks], origins.end[blocks], turn], axis=1)
    return Counterparts(
        program=program,
        first=np.maximum(np.searchsorted(theirs, known[:, 0]), np.searchsorted(turns, turn)),
        end=np.minimum(np.searchsorted(theirs, known[:, 1]), np.searchsorted(turns, turn, side="right")),
        stretch=np.cumsum((np.diff(known, axis=0, prepend=-1) != 0).any(axis=1)) - 1,
        changed=origins.changed[blocks],
    )


def _turns_in_air(program: PartProgram, gaps: Mapping[str, float]) -> IntArray:
    """Count for each motion (m,) of a program how often the tool came into the air or left it before."""
    air = (program.motions.kind == RAPID) | approaches(program, gaps)
    # What goes nowhere belongs to what comes before.
    still = (program.motions.start == program.motions.end).all(axis=1) & (program.motions.kind <= LINE)
    before = np.maximum.accumulate(np.where(still, 0, np.arange(still.size)))
    return np.asarray(np.cumsum(np.diff(air[before], prepend=True) != 0))


def approaches(program: PartProgram, gaps: Mapping[str, float]) -> BoolArray:
    """Mask of the motions (m,) that bring an axis onto its side of the backlash behind a rapid.

    They are in the air: straight moves of one axis alone, by little more than its gap [m], at most twice an axis.
    """
    motions = program.motions
    unknown = np.isnan(motions.start) & np.isnan(motions.end)
    way = np.where(unknown, 0.0, np.nan_to_num(np.abs(motions.end - motions.start), nan=np.inf))
    width = APPROACH * np.array([gaps.get(name, 0.0) for name in AXES])
    short = (motions.kind == LINE) & (np.count_nonzero(way, axis=1) == 1) & (way <= width).all(axis=1)
    found = np.zeros(motions.kind.size, dtype=np.bool_)
    for rapid in np.flatnonzero(motions.kind == RAPID).tolist():
        moved = [0] * len(AXES)
        for k in range(rapid + 1, motions.kind.size):
            axis = int(way[k].argmax())
            if not short[k] or moved[axis] == 2:
                break
            found[k], moved[axis] = True, moved[axis] + 1
    return found
