"""LinuxCNC's NaiveCAM: lines of one feed that are within a tolerance of one line become that line.

It takes flat arcs in the XY plane for lines, too. A feed on every line, or ``Q0``, keeps it from linking.
"""

from __future__ import annotations

import numpy as np

from ph_post.simulate.compiling import compiled, inner
from ph_post.types import Array, IntArray

MOST_LINKED = 101
"""Lines that become one at most."""


@compiled
def linked_ends(starts: Array, ends: Array, linking: Array, feed: Array, flat: IntArray) -> IntArray:
    """Find the moves at whose end a line ends that the planner gets.

    Parameters
    ----------
    starts, ends : Array, shape (n, 3)
        Of the moves of the program [m].
    linking : Array, shape (n,)
        How far each may leave the line it becomes part of [m]; 0 where nothing is linked.
    feed : Array, shape (n,)
        What F says [m/s]; only equal ones are linked.
    flat : IntArray, shape (n,)
        1 for the lines, and the arcs that are taken for lines; 2 for those behind a stop.

    Returns
    -------
    IntArray, shape (n,)
        1 where the planner gets a move, 0 where it only gets it together with the next.
    """
    count = linking.size
    kept = np.ones(count, dtype=np.int64)
    first = 0
    for row in range(1, count):
        joins = flat[row] == 1 and flat[row - 1] > 0 and row - first < MOST_LINKED
        joins = (
            joins and linking[row] > 0.0 and linking[row] == linking[row - 1] and feed[row] == feed[row - 1]
        )
        if joins and _is_near(starts[first], ends, first, row, linking[row]):
            kept[row - 1] = 0
        else:
            first = row
    return kept


@inner
def _is_near(start: Array, ends: Array, first: int, last: int, tolerance: float) -> bool:
    """Whether the ends of moves are within a tolerance of the line from `start` to the end of the last."""
    square = 0.0
    for k in range(3):
        square += (ends[last, k] - start[k]) ** 2
    if square == 0.0:
        return False
    for row in range(first, last):
        part, off = 0.0, 0.0
        for k in range(3):
            part += (ends[last, k] - start[k]) * (ends[row, k] - start[k]) / square
        part = min(max(part, 0.0), 1.0)
        for k in range(3):
            off += (ends[row, k] - start[k] - part * (ends[last, k] - start[k])) ** 2
        if off > tolerance * tolerance:
            return False
    return True
