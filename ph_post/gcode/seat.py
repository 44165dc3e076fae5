"""The approach: every axis is brought onto the flank on which its first motion begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ph_post.compensate.jogs import LEAST_SEAT, seat_distance
from ph_post.gcode.shape import SNAP, Shape
from ph_post.types import Array, Plan, TurningPoint


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
    drives = machine.axes
    distance = np.array([seat_distance(drives[axis].gap) if axis in drives else LEAST_SEAT for axis in axes])
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
