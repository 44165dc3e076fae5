"""Where the coordinates of a path turn, counted and isolated in exact arithmetic only.

Everything follows from the exact data the curves were built from: by isolating roots of polynomials with
rational coefficients, and on arcs by comparing directions.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.geometry import exact
from ph_post.geometry.arc import Arc
from ph_post.geometry.stationary import ExactData, Stationary, collect
from ph_post.geometry.track import Track

DIGITS: Final = 50
"""Working digits for the angles of an arc, whose quadrant points have no rational parameter."""

ARC_WIDTH: Final = Fraction(1, 10**40)
"""Half the width given to their intervals: far more than fifty digits leave open."""

Vector = tuple[Fraction, Fraction]


class CertainRoot(msgspec.Struct, frozen=True, kw_only=True):
    """A root of a coordinate's velocity on `piece`, within [low, high] in u and nowhere else in there.

    It is a reversal where its `multiplicity` is odd. An end of the piece may be a root.
    """

    axis: int
    piece: int
    low: Fraction
    high: Fraction
    multiplicity: int


def certain_roots(track: Track) -> tuple[CertainRoot, ...]:
    """Count and isolate every root of every coordinate's velocity, piece by piece.

    Implements an exact version of :func:`ph_post.geometry.stationary.find_stationary` and shares nothing with
    it but the data.
    """
    data = ExactData(track)
    found: list[CertainRoot] = []
    for piece in range(len(track.pieces)):
        (curve,) = data.curves(np.array([piece]))
        for axis in range(track.dimension):
            roots = (
                _on_arc(curve, axis) if isinstance(curve, Arc) else exact.isolate(data.velocity(piece, axis))
            )
            found += [
                CertainRoot(
                    axis=axis, piece=piece, low=root.low, high=root.high, multiplicity=root.multiplicity
                )
                for root in roots
            ]
    return tuple(found)


def stationary(roots: tuple[CertainRoot, ...]) -> Stationary:
    """Round the odd roots, as :func:`ph_post.geometry.stationary.find_stationary` would return them."""
    odd = [root for root in roots if root.multiplicity % 2]
    part = Stationary(
        axis=np.array([root.axis for root in odd], dtype=np.int64),
        piece=np.array([root.piece for root in odd], dtype=np.int64),
        u=np.array([float((root.low + root.high) / 2) for root in odd], dtype=np.float64),
    )
    return collect([part])


def _on_arc(arc: Arc, axis: int) -> tuple[exact.ExactRoot, ...]:
    """Quadrant points of an arc at which the coordinate is extreme, its ends included."""
    if axis > 1:
        return ()
    start, end, center = arc.exact
    mirror = 1 if arc.turn == "ccw" else -1
    a = (start[0] - center[0], mirror * (start[1] - center[1]))
    b = a if arc.full else (end[0] - center[0], mirror * (end[1] - center[1]))
    unit = ((1, 0), (-1, 0)) if axis == 0 else ((0, 1), (0, -1))
    roots = []
    for x, y in unit:
        q = (Fraction(x), Fraction(y))
        if _is_between(a, q, b, full=arc.full):
            low, high = _interval(a, q, b, full=arc.full)
            roots.append(exact.ExactRoot(low=low, high=high, multiplicity=1))
            if low == 0 and arc.full:
                roots.append(exact.ExactRoot(low=Fraction(1), high=Fraction(1), multiplicity=1))
    return tuple(sorted(roots, key=lambda root: root.low))


def _is_between(a: Vector, q: Vector, b: Vector, *, full: bool) -> bool:
    """Whether q is met when a is turned counterclockwise until it points along b."""
    return full or _sector(a, q) < _sector(a, b) or (_sector(a, q) == _sector(a, b) and _cross(q, b) >= 0)


def _sector(a: Vector, v: Vector) -> int:
    """Angle from a counterclockwise to v: 0: none, 1: less than half a turn, 2: half a turn, 3: more."""
    across, along = _cross(a, v), a[0] * v[0] + a[1] * v[1]
    if across == 0:
        return 0 if along > 0 else 2
    return 1 if across > 0 else 3


def _cross(a: Vector, b: Vector) -> Fraction:
    return a[0] * b[1] - a[1] * b[0]


def _interval(a: Vector, q: Vector, b: Vector, *, full: bool) -> tuple[Fraction, Fraction]:
    """Part of the turn from a to b at which q is met; exact at the ends."""
    sector = _sector(a, q)
    if sector == 0:
        return Fraction(0), Fraction(0)
    if not full and sector == _sector(a, b) and _cross(q, b) == 0:
        return Fraction(1), Fraction(1)
    import mpmath

    with mpmath.workdps(DIGITS):
        whole = 2 * mpmath.pi if full else _angle(a, b)
        middle = Fraction(str(_angle(a, q) / whole))
    return middle - ARC_WIDTH, middle + ARC_WIDTH


def _angle(a: Vector, v: Vector) -> Any:
    """Angle from a counterclockwise to v, in (0, 2π)."""
    import mpmath

    across, along = _cross(a, v), a[0] * v[0] + a[1] * v[1]
    y, x = (mpmath.mpf(part.numerator) / part.denominator for part in (across, along))
    angle = mpmath.atan2(y, x)
    return angle if angle > 0 else angle + 2 * mpmath.pi
