"""Centre and angle of arcs from their words, and the arcs that are impossible, by LinuxCNC's rules."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ph_post.compiling import compiled, lean
from ph_post.types import Array, IntArray
from ph_post.units import INCH, MM

RADII_DIFFER, ZERO_RADIUS, NO_WAY, RADIUS_TOO_SMALL, RADIUS_ZERO = range(40, 45)
"""Why an arc is refused."""

_SAME = 1e-8 * MM
"""An arc that ends no farther from its beginning is a full circle (CART_FUZZ)."""
_SPREAD_MM, _SPREAD_INCH = 0.02 * math.sqrt(2.0) * MM, 0.002 * math.sqrt(2.0) * INCH
"""How far the radii at start and end may differ [m] unless they differ by less than a thousandth; never by
more than a hundred times this (CENTER_ARC_RADIUS_TOLERANCE)."""
_SHARE = 1e-3
_SMALLEST = 0.00005 * INCH
"""Radii below are none (RADIUS_TOLERANCE, the same in mm and inch)."""
_HALF = 1.0 - 1e-12
"""An R that is no more than this share off half the way is a half circle."""


def swept_angle(a: Array, b: Array, sense: Array | IntArray | float = 1.0) -> Array:
    """Return the angle [rad] in [0, 2π) from directions `a` to `b`, shape (..., 2); `sense` -1 is clockwise."""
    cross, dot = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], (a * b).sum(axis=-1)
    return np.asarray(np.mod(sense * np.arctan2(cross, dot), 2.0 * np.pi))


@lean
def _find_center(a0: float, a1: float, b0: float, b1: float, radius: float, turns: int) -> Any:
    """Find the centre of an arc from (a0, a1) to (b0, b1) by its R, and what is wrong with it."""
    half = math.hypot(b0 - a0, b1 - a1) / 2.0
    if half == 0.0:
        return 0.0, 0.0, NO_WAY
    if radius == 0.0:
        return 0.0, 0.0, RADIUS_ZERO
    if half - abs(radius) > _SMALLEST:
        return 0.0, 0.0, RADIUS_TOO_SMALL
    share = half / abs(radius)
    offset = 0.0 if share > _HALF else math.sqrt(radius * radius - half * half)
    side = 1.0 if (turns > 0) == (radius > 0.0) else -1.0
    scale = side * offset / (2.0 * half)
    return (a0 + b0) / 2.0 - scale * (b1 - a1), (a1 + b1) / 2.0 + scale * (b0 - a0), 0


@lean
def _radii_fault(start: float, end: float, spread: float) -> Any:
    if start < _SMALLEST or end < _SMALLEST:
        return ZERO_RADIUS
    off = abs(start - end)
    far = off > 100.0 * spread or (off > spread and off > _SHARE * max(start, end))
    return RADII_DIFFER if far else 0


@lean
def _sweep(a0: float, a1: float, b0: float, b1: float, turns: int) -> Any:
    """Angle from the direction (a0, a1) to (b0, b1), whole turns included, in the sense of `turns`."""
    sense = 1 if turns > 0 else -1
    angle = sense * math.atan2(a0 * b1 - a1 * b0, a0 * b0 + a1 * b1)
    if math.hypot(b0 - a0, b1 - a1) < _SAME:
        angle = math.tau
    elif angle <= 0.0:
        angle += math.tau
    return sense * (angle + (abs(turns) - 1) * math.tau)


@compiled
def solve_arcs(
    starts: Any, ends: Any, plane: Any, turns: Any, inches: Any, center: Any, angle: Any, faults: Any, radii: Any
) -> Any:
    """Turn the words of arcs into centres and angles, in place, and return the number of those that are none.

    `turns` 0 are no arcs; `angle` has the R word [m] or NaN and `center` the centre [m] by I, J and K; `inches`
    whether G20 was in force. `faults` (m,) gets why an arc is none, `radii` (m, 2) both radii [m] of such arcs.
    """
    count = 0
    for row in range(turns.size):
        if turns[row] == 0:
            continue
        one, two = (0, 1) if plane[row] == 17 else (2, 0) if plane[row] == 18 else (1, 2)
        a0, a1, b0, b1 = starts[row, one], starts[row, two], ends[row, one], ends[row, two]
        if not np.isnan(angle[row]):
            center[row, 0], center[row, 1], why = _find_center(a0, a1, b0, b1, angle[row], turns[row])
            if why:
                faults[row], radii[row, 0], radii[row, 1] = why, abs(angle[row]), math.hypot(b0 - a0, b1 - a1) / 2.0
                count += 1
                continue
        c0, c1 = center[row]
        first, last = math.hypot(a0 - c0, a1 - c1), math.hypot(b0 - c0, b1 - c1)
        why = _radii_fault(first, last, _SPREAD_INCH if inches[row] else _SPREAD_MM)
        if why:
            faults[row], radii[row, 0], radii[row, 1] = why, first, last
            count += 1
            continue
        angle[row] = _sweep(a0 - c0, a1 - c1, b0 - c0, b1 - c1, turns[row])
    return count
