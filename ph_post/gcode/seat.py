"""The approach: every axis is brought onto the flank on which its first motion begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ph_post.gcode.shape import SNAP, Shape
from ph_post.types import Array, Plan, TurningPoint
from ph_post.units import MM, MM_PER_MIN

LEAST_OFFSET = 0.1 * MM
"""An axis is approached over at least this far [m]: the play of a worn router, so that a machine file that
knows of no lost motion does not leave the flank to chance."""

LOST_MOTIONS = 2.0
"""The approach covers the lost motion so many times: the gap is taken up wherever in it the axis stood, with
as much again for what the machine file does not know."""

SEAT_FEED = 300.0 * MM_PER_MIN
"""Feed of the approach [m/s], or the path's where that is less: the shortest offset then lasts 20 ms, several
times a servo's response, and no drive lags by more than a part of it."""


def find_seat(shape: Shape, plan: Plan, s: float, end: float) -> Array:
    """Offset [m] from the start of a cut to the point from which it is approached, shape (dim,).

    Each axis against its first motion, an axis that stands still at first against the first one later, 0
    where it never moves; Z upwards whatever it does, so that the tool comes down onto the start.

    Parameters
    ----------
    shape : Shape
    plan : Plan
        Its turning points tell the first motion, its machine's lost motions how far; an axis the machine does
        not have counts as one without.
    s, end : float
        The cut, as places along the motion [m].
    """
    axes, machine = plan.path.axes, plan.machine
    lost = np.array([machine.axes[axis].gap.lost_motion if axis in machine.axes else 0.0 for axis in axes])
    distance = np.maximum(LOST_MOTIONS * lost, LEAST_OFFSET)
    upwards = np.array([axis == "Z" for axis in axes])
    return np.where(upwards, distance, -first_senses(shape, plan.turning_points, axes, s, end) * distance)


def first_senses(
    shape: Shape, points: Sequence[TurningPoint], axes: tuple[str, ...], s: float, end: float
) -> Array:
    """Sign of each axis' first travel after `s`, 0 where there is none up to `end`.

    An axis rises up to a maximum and falls down to a minimum, however soon after the start that comes; where
    it does not reverse, the ends tell.
    """
    origin, last = shape.positions(np.array([s, end]))
    senses: Array = np.where(np.abs(last - origin) > SNAP, np.sign(last - origin), 0.0)
    for column, axis in enumerate(axes):
        for point in points:
            moved = s < point.s < end and abs(point.position - origin[column]) > SNAP
            if point.axis == axis and moved:
                senses[column] = 1.0 if point.sense == "max" else -1.0
                break
    return senses
