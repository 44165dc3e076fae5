"""Speeds at the corners of planners that follow the path exactly: the rules of the firmwares.

These are Grbl's and Marlin's junction deviation, Marlin's classic jerk (`planner.cpp`), and Klipper's square corner
velocity (`klippy/toolhead.py`).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.compiling import compiled, lean
from ph_post.types import Array, BoolArray, ExactPath, GrblCorner, JerkCorner, KlipperCorner

GRBL, MARLIN, JERK, KLIPPER = range(4)
"""Rules of corners."""

STRAIGHT: Final = 0.999999
"""Cosine of the angle between two directions from which on they are one."""

SHORT_BLOCK: Final = 1e-3
"""Blocks below this [m] are pieces of arcs to Marlin."""

BLUNT: Final = math.sqrt(0.5)
"""Cosine of the angle of a corner up to which they are."""

UNLIMITED: Final = 1e18
"""Squared speed [m²/s²] of a corner that is none."""

COAST: Final = 0.99
"""Share of the speed of a corner above which both blocks' own safe speeds are taken in Marlin's classic jerk."""


def corner_rule(planner: ExactPath, acceleration: float) -> tuple[int, Array]:
    """Return the number of a planner's corner rule, and its numbers.

    Parameters
    ----------
    planner : ExactPath
    acceleration : float
        Of X and Y, where these have one limit [m/s²].
    """
    corner = planner.corner
    if isinstance(corner, JerkCorner):
        return JERK, np.array(corner.jerk)
    if isinstance(corner, KlipperCorner):
        return KLIPPER, np.array([corner.velocity**2 * (math.sqrt(2.0) - 1.0) / acceleration])
    return (GRBL if isinstance(corner, GrblCorner) else MARLIN), np.array([corner.deviation])


@lean
def _cosine(one: Array, two: Array) -> float:
    found: float = one[0] * two[0] + one[1] * two[1] + one[2] * two[2]
    return found


@lean
def _turning_acceleration(one: Array, two: Array, most: Array, along: float) -> float:
    """Acceleration that the axes can in the direction in which the velocity changes, at most `along`."""
    size = 0.0
    for k in range(3):
        size += (two[k] - one[k]) ** 2
    size = math.sqrt(size)
    found = along
    for k in range(3):
        part = abs(two[k] - one[k])
        if part > 0.0:
            found = min(found, most[k] * size / part)
    return found


@lean
def _by_deviation(one: Array, two: Array, most: Array, deviation: float) -> float:
    """Squared speed of a corner in Grbl."""
    cosine = _cosine(one, two)
    if cosine < -STRAIGHT:
        return 0.0
    if cosine > STRAIGHT:
        return UNLIMITED
    half = math.sqrt(0.5 * (1.0 + cosine))
    return _turning_acceleration(one, two, most, math.inf) * deviation * half / (1.0 - half)


@lean
def _by_marlin(one: Array, two: Array, most: Array, along: float, length: float, deviation: float) -> float:
    """Squared speed of a corner in Marlin; `length` and acceleration `along` are those of the block behind it."""
    cosine = _cosine(one, two)
    if cosine < -STRAIGHT:
        return 0.0
    turned = min(cosine, STRAIGHT)
    half = math.sqrt(0.5 * (1.0 + turned))
    push = _turning_acceleration(one, two, most, along)
    found = push * deviation * half / (1.0 - half)
    if length < SHORT_BLOCK and turned > BLUNT:
        found = min(found, length * push / math.acos(turned))
    return found


@lean
def _safe_speed(unit: Array, speed: float, jerk: Array) -> float:
    """Speed from which a block may stop at once."""
    safe = speed
    for k in range(3):
        if abs(unit[k]) * speed > jerk[k]:
            safe = min(safe, jerk[k] / abs(unit[k]))
    return safe


@lean
def _by_jerk(one: Array, two: Array, before: float, after: float, jerk: Array) -> float:
    """Speed of a corner in Marlin's classic jerk, between blocks of these speeds."""
    speed = min(before, after)
    factor = 1.0
    for k in range(3):
        leaving, entering = factor * speed * one[k], factor * after * two[k]
        change = abs(leaving - entering) if leaving * entering > 0.0 else max(abs(leaving), abs(entering))
        if change > jerk[k]:
            factor *= jerk[k] / change
    found = speed * factor
    first, second = _safe_speed(one, before, jerk), _safe_speed(two, after, jerk)
    return second if min(first, second) > COAST * found else found


@lean
def _by_square(one: Array, two: Array, push: Array, length: Array, deviation: float) -> float:
    """Squared speed of a corner in Klipper; `push` and `length` of both blocks."""
    cosine = _cosine(one, two)
    sine2, cosine2 = math.sqrt(max(0.5 * (1.0 + cosine), 0.0)), math.sqrt(max(0.5 * (1.0 - cosine), 0.0))
    if sine2 >= 1.0 or cosine2 <= 0.0:
        return UNLIMITED
    found = math.inf
    for k in range(2):
        bend = min(sine2 / (1.0 - sine2) * deviation, 0.5 * length[k] * sine2 / cosine2)
        found = min(found, push[k] * bend)
    return found


@compiled
def corner_speeds(
    rule: int,
    numbers: Array,
    unit: Array,
    length: Array,
    speed: Array,
    push: Array,
    most: Array,
    joined: BoolArray,
) -> Array:
    """Return the largest squared speeds at the beginnings of blocks.

    Parameters
    ----------
    rule, numbers
        Of :func:`corner_rule`.
    unit : Array, shape (n, 3)
        Directions of the blocks.
    length, speed, push : Array, shape (n,)
        Length [m], speed [m/s] and acceleration [m/s²] of the blocks.
    most : Array, shape (3,)
        Accelerations of the axes [m/s²].
    joined : BoolArray, shape (n,)
        False where a block begins at rest.

    Returns
    -------
    Array, shape (n,)
        [m²/s²]
    """
    found = np.zeros(length.size)
    for k in range(1, length.size):
        if not joined[k]:
            continue
        one, two, bound = unit[k - 1], unit[k], min(speed[k - 1], speed[k])
        if rule == GRBL:
            square = _by_deviation(one, two, most, numbers[0])
        elif rule == MARLIN:
            square = _by_marlin(one, two, most, push[k], length[k], numbers[0])
        elif rule == JERK:
            square = _by_jerk(one, two, speed[k - 1], speed[k], numbers) ** 2
        else:
            square = _by_square(one, two, push[k - 1 : k + 1], length[k - 1 : k + 1], numbers[0])
        found[k] = min(square, bound * bound)
    return found
