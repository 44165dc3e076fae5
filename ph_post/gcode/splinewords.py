"""Control points of splines from their words: G5 and G5.1 as cubics, G5.2 to G5.3 as NURBS.

They are rare, so this is plain Python.
"""

from __future__ import annotations

import msgspec
import numpy as np

from ph_post.gcode import codes
from ph_post.gcode.program import ByteArray, NurbsData, PlaceArray, span_of
from ph_post.gcode.words import Lexed
from ph_post.types import Array, frozen


class SplineBlocks(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Columns of the blocks that splines need: the task of each, and its modes."""

    tasks: ByteArray
    table: Array
    states: PlaceArray


def letters_of(lexed: Lexed, block: int) -> dict[str, float]:
    """Return the values of a block's words by letter."""
    low, high = span_of(lexed.words.block, block)
    return {chr(lexed.words.letter[k]): float(lexed.words.value[k]) for k in range(low, high)}


def cubic(words: dict[str, float], units: float, start: Array, end: Array, before: Array | None) -> Array | None:
    """Return the control points (4, 3) [m] of a G5, None where I and J or P and Q are missing.

    Without I and J it goes on in the direction of the G5 `before` it, whose P and Q it mirrors.
    """
    if not {"P", "Q"} <= words.keys():
        return None
    if {"I", "J"} <= words.keys():
        lead = np.array([words["I"] * units, words["J"] * units, 0.0])
    elif before is not None and not {"I", "J"} & words.keys():
        lead = before[3] - before[2]
    else:
        return None
    return frozen([start, start + lead, end + np.array([words["P"] * units, words["Q"] * units, 0.0]), end])


def quadratic(words: dict[str, float], units: float, start: Array, end: Array) -> Array | None:
    """Return the control points (4, 3) [m] of a G5.1 raised to a cubic, None where I or J is missing."""
    if not {"I", "J"} <= words.keys():
        return None
    middle = start + np.array([words["I"] * units, words["J"] * units, 0.0])
    return frozen([start, (start + 2.0 * middle) / 3.0, (end + 2.0 * middle) / 3.0, end])


def nurbs(lexed: Lexed, blocks: SplineBlocks, last: int, start: Array) -> NurbsData | None:
    """Return order, control points (k, 3) [m] and weights of the NURBS that ends with G5.3 on line `last`, or None.

    The first control point is where it begins; its weight is the P of a first block without X and Y.
    """
    points, weights, order = [start], [1.0], 3
    for block in _points_before(blocks.tasks, last):
        words = letters_of(lexed, block)
        modes = blocks.table[blocks.states[block]]
        order = max(order, int(words.get("L", 3.0)))
        weight = words.get("P", 0.0)
        if {"X", "Y"} <= words.keys():
            place = np.array([words["X"], words["Y"]]) * modes[codes.UNITS]
            if modes[codes.ABSOLUTE] != 1.0:
                place = place + start[:2]
            points.append(np.array([*place, start[2]]))
            weights.append(weight)
        elif len(points) == 1 and not {"X", "Y"} & words.keys():
            weights[0] = weight if weight > 0.0 else 1.0
        else:
            return None
    if len(points) < order or min(weights) <= 0.0:
        return None
    return order, frozen(points), frozen(weights)


def _points_before(tasks: ByteArray, last: int) -> list[int]:
    """Lines of the control points before `last`, back to the last motion of another kind."""
    found = []
    for block in range(last - 1, -1, -1):
        task = int(tasks[block]) & (codes.FORGET_FIRST - 1)
        if task == codes.NURBS_POINT:
            found.append(block)
        elif task != codes.REST:
            break
    return found[::-1]
