"""Divide what crossings leave of an arc so that the controller cuts it into chords no coarser than the whole arc's.

Firmware cuts an arc into a whole number of chords, rounded down, so that a short rest of an arc may get chords of
nearly twice the length, four times as far off the path.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Final

import numpy as np

from ph_post.dialects.planners import planner_of
from ph_post.edit.edits import CrossingEdit
from ph_post.gcode.motion_parts import arc_lengths
from ph_post.gcode.program import ARC, PLANE_AXES, Motions
from ph_post.simulate.controllers.chords import chord_counts, chord_errors
from ph_post.types import ExactPath, Machine
from ph_post.units import MM

COARSER: Final = 0.5e-3 * MM
"""Chords whose error is larger by less [m] than those of the whole arc are left."""

SPARE: Final = 2e-3 * MM
"""Length [m] beyond a whole number of chords, as the ends of an arc are rounded and so few chords are lost to that."""

SHORTEST: Final = 0.3
"""Part of a chord below which no arc is written by itself."""


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


def _joints(motions: Motions, planner: ExactPath, motion: int, low: float, high: float) -> Iterator[float]:
    """Divide a part of an arc into one of whole chords and what is left, in one chord or two."""
    a, b, _ = PLANE_AXES[int(motions.plane[motion])]
    radius = np.hypot(*(motions.start[motion, [a, b]] - motions.center[motion]))[None]
    length = arc_lengths(motions, np.array([motion]))
    size = np.array([1.0, high - low])
    own, part = chord_errors(planner, radius, size * motions.angle[motion], size * length)
    if part <= own + COARSER:
        return
    chord = 1.0 / float(chord_counts(planner, radius, motions.angle[[motion]], length)[0])
    whole = int((high - low) / chord)
    ends = 1 if (high - low) / chord - whole >= SHORTEST else 2
    at = low + (whole + 1 - ends) * chord
    if whole >= ends:
        at += SPARE / float(length[0])
        yield at
    if ends == 2:
        yield 0.5 * (at + high)
