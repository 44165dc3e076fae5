"""Divide what crossings leave of an arc so that the controller cuts it into chords no coarser than the whole arc's.

Firmware cuts an arc into a whole number of chords, rounded down, so that a short rest of an arc may get chords of
nearly twice the length, four times as far off the path. Where those of the whole arc are coarse, the rest gets finer
ones: other chords as coarse would be where the original has its joints, as far off it as the original is off the arc.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Final

import numpy as np

from ph_post.dialects.planners import planner_of
from ph_post.edit.edits import CrossingEdit
from ph_post.gcode.motion_parts import arc_lengths
from ph_post.gcode.program import ARC, PLANE_AXES, Motions
from ph_post.simulate.controllers.chords import chord_errors
from ph_post.types import ExactPath, Machine
from ph_post.units import MM

SAME: Final = 0.5e-3 * MM
"""Errors [m] of chords that differ by no more are as good."""

COARSE, FINE = 10e-3 * MM, 5e-3 * MM
"""Where chords of the whole arc are off by more than the first [m], what is left gets chords off by the second."""

SPARE: Final = 2e-3 * MM
"""Length [m] that a part of an arc may lack, as its ends are rounded."""

MOST: Final = 1000
"""Parts into which what is left of an arc is divided at most."""


def chord_joints(motions: Motions, machine: Machine, crossings: Iterable[CrossingEdit]) -> dict[int, list[float]]:
    """Return the shares at which arcs are divided beside their crossings, by motion.

    Parameters
    ----------
    motions : Motions
    machine : Machine
        Of which the controller counts: one that does not cut arcs into chords needs no joints.
    crossings : iterable of CrossingEdit
    """
    planner = planner_of(machine)
    if not isinstance(planner, ExactPath):
        return {}
    covered: dict[int, list[tuple[float, float]]] = {}
    for crossing in crossings:
        for part in crossing.parts:
            if motions.kind[part.motion] == ARC:
                covered.setdefault(part.motion, []).append((part.low, part.high))
    found = {}
    for motion, spans in covered.items():
        edges = [(0.0, 0.0), *sorted(spans), (1.0, 1.0)]
        left = [(before[1], after[0]) for before, after in pairwise(edges) if after[0] > before[1]]
        joints = [share for low, high in left for share in _joints(motions, planner, motion, low, high)]
        if joints:
            found[motion] = joints
    return found


def _joints(motions: Motions, planner: ExactPath, motion: int, low: float, high: float) -> list[float]:
    """Divide a part of an arc into the fewest equal ones whose chords are no coarser than they may be."""
    a, b, _ = PLANE_AXES[int(motions.plane[motion])]
    radius = np.hypot(*(motions.start[motion, [a, b]] - motions.center[motion]))[None]
    angle, length = motions.angle[[motion]], arc_lengths(motions, np.array([motion]))
    own = float(chord_errors(planner, radius, angle, length)[0])
    may = SAME + (own if own <= COARSE else FINE)
    parts = (high - low) / np.arange(1.0, MOST + 1.0)
    error = np.maximum(*(chord_errors(planner, radius, parts * angle, parts * length + off) for off in (-SPARE, SPARE)))
    fine = np.flatnonzero(error <= may)
    count = int(fine[0]) + 1 if fine.size else MOST
    return [float(share) for share in np.linspace(low, high, count + 1)[1:-1]]
