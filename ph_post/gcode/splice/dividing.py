"""Which motions can be divided, so that a stop or a change of feed can stand inside them."""

from __future__ import annotations

import numpy as np

from ph_post.gcode.dialect import Dialect
from ph_post.gcode.reader.record import CUBIC, NURBS, RAPID, PartProgram
from ph_post.gcode.splice.blocktext import letters
from ph_post.gcode.splice.parts import split_cubic


def why_whole(program: PartProgram, dialect: Dialect, motion: int, share: float) -> str:
    """Tell why a motion cannot be divided at a share of it, in words; empty where it can."""
    motions = program.motions
    line, own = int(motions.block[motion]) + 1, letters(program, int(motions.block[motion]))
    if motions.kind[motion] in (RAPID, NURBS):
        return f"line {line} is a {'rapid' if motions.kind[motion] == RAPID else 'NURBS'}, and is not divided"
    unknown = np.isnan(motions.start[motion]) | np.isnan(motions.end[motion])
    for axis, name in enumerate("XYZ"):
        if unknown[axis] and name in own:
            return f"line {line} begins where {name} is not known, and cannot be divided"
    if why := why_bound(program, motion):
        return f"line {line} {why}"
    if motions.kind[motion] == CUBIC:
        return _why_whole_cubic(program, dialect, motion, share)
    return ""


def why_bound(program: PartProgram, motion: int) -> str:
    """Tell what in its language keeps a motion's line whole, in words; empty where nothing does."""
    bound = program.language.bound
    return "" if bound is None else bound(program.text(int(program.motions.block[motion])))


def _why_whole_cubic(program: PartProgram, dialect: Dialect, motion: int, share: float) -> str:
    line = int(program.motions.block[motion]) + 1
    if not dialect.capabilities.cubic_splines:
        return f"line {line} would have to be divided, and {dialect.name} has no G5"
    if dialect.spline_deviation is None:
        return ""
    parts = np.array(split_cubic(program.motions.control[motion], [0.0, share, 1.0]))[:, :, :2]
    if np.isfinite(dialect.spline_deviation(parts)).all():
        return ""
    return f"the parts of the G5 in line {line} could not be trusted to {dialect.name}"
