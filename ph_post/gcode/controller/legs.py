"""What the planner has in its queue: one row a leg, a line or an arc with the limits along it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ph_post.types import Array

STOP, TANGENT, BLEND, EXACT = range(4)
"""How a leg ends: at rest; at speed, in the direction of the next; slowing down while the next one starts; at
rest but where the next one goes on in its direction."""


class Legs(NamedTuple):
    """Legs of a program, n of them, in the order of travel. SI units.

    `origin`, `first`, `second`, `rise` (n, 3): a line is origin + s first, and an arc of `radius` > 0 is
    origin + radius (cos(a) first + sin(a) second) + rise s / length, with a = sweep s / length. `lead` is how
    much of an arc's length is a line before it. `speed` is what F asks for, `most` what the axes can, `push`
    the acceleration that they can; `rapid` is 1 for G0. `tolerance` is how far the corner at the end may be
    rounded, 0 where that is not said, -1 where the end is to be reached (G61), -2 where it stops (G61.1).
    `motion` is the program's motion it is part of, from `share0` to `share1` of it. `pause` [s] and `drains`
    (0 or 1) tell whether the planner's queue runs empty before it, and how long the axes rest then.
    """

    origin: Array
    first: Array
    second: Array
    rise: Array
    radius: Array
    sweep: Array
    length: Array
    lead: Array
    speed: Array
    most: Array
    push: Array
    rapid: Array
    tolerance: Array
    motion: Array
    share0: Array
    share1: Array
    pause: Array
    drains: Array


# Columns of a table of legs; the first four are vectors.
ORIGIN, FIRST, SECOND, RISE = range(0, 12, 3)
RADIUS, SWEEP, EXTENT, LEAD, ASKED, CAN, PUSH, RAPID, TOLERANCE, MOTION, SHARE0, SHARE1, PAUSE, DRAINS = (
    range(12, 26)
)

VECTORS = 4
"""The first so many columns are vectors."""


def make_legs(count: int) -> Legs:
    """Return so many empty rows."""
    vectors = [np.zeros((count, 3)) for _ in range(VECTORS)]
    return Legs(*vectors, *(np.zeros(count) for _ in Legs._fields[VECTORS:]))


def table_of(legs: Legs) -> Array:
    """Put legs into one table, shape (n, 26): columns in the order of the fields."""
    return np.column_stack(list(legs))
