"""Columns of a program's motions as compiled functions take them."""

from __future__ import annotations

from typing import Any

import numpy as np

from ph_post.gcode.reader.record import Motions, plane_columns
from ph_post.types import IntArray


def motion_view(motions: Motions) -> tuple[Any, ...]:
    """Return `kind`, `start`, `end`, `plane` (m, 3), `center`, `angle`, `row` and `control` (c, 4, 3)."""
    row = np.full(motions.kind.size, -1, dtype=np.int32)
    cubics = sorted(motions.control)
    row[cubics] = np.arange(len(cubics))
    control = np.array([motions.control[k] for k in cubics]).reshape(-1, 4, 3)
    plane = plane_columns(motions.plane)
    return motions.kind, motions.start, motions.end, plane, motions.center, motions.angle, row, control


def chain_spans(motions: Motions) -> tuple[IntArray, IntArray]:
    """First motion of every chain that has any, and the one behind its last."""
    if motions.chain.size == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    low = np.append(0, np.flatnonzero(np.diff(motions.chain)) + 1)
    return low, np.append(low[1:], motions.chain.size)
