"""The approach: every axis is brought onto the flank on which its first motion begins."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ph_post.gcode.shape import SNAP, Shape
from ph_post.types import Array, Machine
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

_SAMPLES = 64
"""Places a piece at which the first motion is looked for."""


def find_seat(shape: Shape, axes: tuple[str, ...], machine: Machine, s: float, end: float) -> Array:
    """Offset [m] from the start of a cut to the point from which it is approached, shape (dim,).

    Each axis against its first motion, an axis that stands still at first against the first one later, 0
    where it never moves; Z upwards whatever it does, so that the tool comes down onto the start.

    Parameters
    ----------
    shape : Shape
    axes : tuple of str
        The path's.
    machine : Machine
        Its lost motions decide how far; an axis it does not have counts as one without.
    s, end : float
        The cut, as places along the motion [m].
    """
    lost = np.array([machine.axes[axis].gap.lost_motion if axis in machine.axes else 0.0 for axis in axes])
    distance = np.maximum(LOST_MOTIONS * lost, LEAST_OFFSET)
    upwards = np.array([axis == "Z" for axis in axes])
    return np.where(upwards, distance, -first_senses(shape, s, end) * distance)


def first_senses(shape: Shape, s: float, end: float) -> Array:
    """Sign of each axis' first travel after `s`, 0 where there is none up to `end`.

    Piece by piece, so that a long path is not searched for what its beginning tells.
    """
    origin = shape.positions(np.array([s]))[0]
    sense = np.zeros(origin.size)
    starts = shape.track.starts
    inner = starts[(starts > s) & (starts < end)]
    for low, high in pairwise([s, *inner.tolist(), end]):
        travel = shape.positions(np.linspace(low, high, _SAMPLES + 1)) - origin
        moved = np.abs(travel) > SNAP
        first = travel[np.argmax(moved, axis=0), np.arange(origin.size)]
        sense = np.where((sense == 0.0) & moved.any(axis=0), np.sign(first), sense)
        if (sense != 0.0).all():
            break
    return sense
