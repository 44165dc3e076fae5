"""Divide arcs behind rounded corners, so that LinuxCNC has all of its acceleration where a crossing slows down.

In a motion whose corner with the one before is rounded, LinuxCNC accelerates with half of what it may, from beginning
to end; in arcs that is a quarter of what the axes can. Behind a joint in which the direction does not change it is
twice as much, so a short part of the arc, beside the corner, is written by itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np

from ph_post.dialects.planners import planner_of
from ph_post.edit.crossing_ground import CrossingGround
from ph_post.edit.crossing_shapes import AT_SPEED, points_along
from ph_post.edit.crossings import SHORTEST
from ph_post.edit.edits import CrossingEdit, CrossingPart
from ph_post.gcode.program import ARC
from ph_post.types import ExactPath
from ph_post.units import MM

FIRST: Final = 0.2 * MM
"""Length of the part beside a corner [m]: rounding takes some micrometres of it, and it lasts many servo periods."""

ROOM: Final = 10.0
"""An arc is divided where so many of these parts have room before its crossing."""

TANGENT: Final = math.cos(math.radians(2.0))
"""In duller joints nothing is rounded."""


def corner_joints(ground: CrossingGround, crossings: Iterable[CrossingEdit]) -> dict[int, list[float]]:
    """Return the shares at which arcs that begin in a corner are divided, by motion.

    Parameters
    ----------
    ground : CrossingGround
    crossings : iterable of CrossingEdit
        Of them count those that are the first on their arc, and slow down.
    """
    motions, planner = ground.program.motions, planner_of(ground.machine)
    if isinstance(planner, ExactPath) or planner.bounded:
        return {}
    first: dict[int, CrossingPart] = {}
    slow: set[int] = set()
    for crossing in crossings:
        slow |= {
            part.motion
            for part in crossing.parts
            if part.feed is not None and part.feed < AT_SPEED * ground.feed[part.motion]
        }
        for part in crossing.parts:
            first.setdefault(part.motion, part)
    found = {}
    for motion in sorted(slow):
        low, high = ground.along[motion : motion + 2]
        if motions.kind[motion] != ARC or first[motion].low * (high - low) < ROOM * FIRST or motions.exact[motion - 1]:
            continue
        before, here, behind = points_along(ground.view, ground.along, low + SHORTEST * np.arange(-1.0, 2.0))
        into, out = here - before, behind - here
        if into @ out < TANGENT * np.linalg.norm(into) * np.linalg.norm(out):
            found[motion] = [FIRST / float(high - low)]
    return found
