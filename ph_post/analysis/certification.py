"""Certification of turning points in exact arithmetic.

The certificate follows from the exact data the curves were built from: by isolating roots of polynomials with
rational coefficients, and on arcs by comparing directions.
"""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.analysis.turning_points import turning_points
from ph_post.files.check import counted
from ph_post.geometry import exact_polynomials
from ph_post.geometry.curves import Arc
from ph_post.geometry.reversals import ExactData, StationaryPoints, collect, find_stationary_points
from ph_post.geometry.track import Track
from ph_post.types import TurningPoint

DIGITS: Final = 50
"""Working digits for the angles of an arc, whose quadrant points have no rational parameter."""

ARC_WIDTH: Final = Fraction(1, 10**40)
"""Half the width given to their intervals: far more than fifty digits leave open."""

PLACE: Final = 1e-13
"""A place found in floating point differs from the exact one by less than this part of the domain."""

Vector = tuple[Fraction, Fraction]


class CertifiedRoot(msgspec.Struct, frozen=True, kw_only=True):
    """A root of a coordinate's velocity on `piece`, within [low, high] in u and nowhere else in there.

    It is a reversal where its `multiplicity` is odd. An end of the piece may be a root.
    """

    axis: int
    piece: int
    low: Fraction
    high: Fraction
    multiplicity: int


def certified_roots(track: Track) -> tuple[CertifiedRoot, ...]:
    """Count and isolate every root of every coordinate's velocity, piece by piece.

    Implements an exact version of :func:`ph_post.geometry.reversals.find_stationary_points` and shares nothing with
    it but the data.
    """
    data = ExactData(track)
    found: list[CertifiedRoot] = []
    for piece in range(len(track.pieces)):
        (curve,) = data.curves(np.array([piece]))
        for axis in range(track.dimension):
            roots = (
                _on_arc(curve, axis)
                if isinstance(curve, Arc)
                else exact_polynomials.isolate(data.velocity(piece, axis))
            )
            found += [
                CertifiedRoot(axis=axis, piece=piece, low=root.low, high=root.high, multiplicity=root.multiplicity)
                for root in roots
            ]
    return tuple(found)


def round_roots(roots: tuple[CertifiedRoot, ...]) -> StationaryPoints:
    """Round the odd roots, as :func:`ph_post.geometry.reversals.find_stationary_points` would return them."""
    odd = [root for root in roots if root.multiplicity % 2]
    part = StationaryPoints(
        axis=np.array([root.axis for root in odd], dtype=np.int64),
        piece=np.array([root.piece for root in odd], dtype=np.int64),
        u=np.array([float((root.low + root.high) / 2) for root in odd], dtype=np.float64),
    )
    return collect([part])


def _on_arc(arc: Arc, axis: int) -> tuple[exact_polynomials.ExactRoot, ...]:
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
            low, high = _arc_interval(a, q, b, full=arc.full)
            roots.append(exact_polynomials.ExactRoot(low=low, high=high, multiplicity=1))
            if low == 0 and arc.full:
                roots.append(exact_polynomials.ExactRoot(low=Fraction(1), high=Fraction(1), multiplicity=1))
    return tuple(sorted(roots, key=lambda root: root.low))


def _is_between(a: Vector, q: Vector, b: Vector, *, full: bool) -> bool:
    """Return true where a, turned counterclockwise until it points along b, meets q."""
    return full or _sector(a, q) < _sector(a, b) or (_sector(a, q) == _sector(a, b) and _cross(q, b) >= 0)


def _sector(a: Vector, v: Vector) -> int:
    """Angle from a counterclockwise to v: 0: none, 1: less than half a turn, 2: half a turn, 3: more."""
    across, along = _cross(a, v), a[0] * v[0] + a[1] * v[1]
    if across == 0:
        return 0 if along > 0 else 2
    return 1 if across > 0 else 3


def _cross(a: Vector, b: Vector) -> Fraction:
    return a[0] * b[1] - a[1] * b[0]


def _arc_interval(a: Vector, q: Vector, b: Vector, *, full: bool) -> tuple[Fraction, Fraction]:
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


class CertifiedAxis(msgspec.Struct, frozen=True, kw_only=True):
    """Roots of the velocity of one axis on one segment, by exact arithmetic.

    Each of the `intervals` in xi holds one root of the axis' velocity, and there are no others; low = high
    where the root is rational and was met. Where its entry in `multiplicities` is even, the axis does not
    reverse. `reversals` is the number of odd roots inside the pieces, `found` what floating point has.
    """

    segment: int
    axis: str
    intervals: tuple[tuple[Fraction, Fraction], ...]
    multiplicities: tuple[int, ...]
    reversals: int
    found: int


class Certificate(msgspec.Struct, frozen=True, kw_only=True):
    """Turning points counted exactly, beside those found in floating point.

    `ok` where both agree in number, place, axis and sense; `exact` and `found` are the numbers of turning
    points, `entries` holds every segment and axis, `words` say it all, a line each.
    """

    ok: bool
    exact: int
    found: int
    entries: tuple[CertifiedAxis, ...]
    words: tuple[str, ...]


def certify(track: Track) -> Certificate:
    """Count and isolate the turning points in exact arithmetic, and compare.

    Every root of every coordinate's velocity is isolated by a rational interval, from the very numbers of the
    path file. Read in the same way, they give the turning points that floating point must have found.

    Parameters
    ----------
    track : Track

    Returns
    -------
    Certificate

    Examples
    --------
    >>> from ph_post.geometry.curves import Bezier
    >>> result = certify(Track.from_curves([Bezier([[0.0, 0.0], [0.01, 0.02], [0.02, 0.0]])]))
    >>> result.ok, result.words[0]
    (True, '1 turning point, counted exactly: found, nothing missing, nothing invented.')
    """
    roots, rough = certified_roots(track), find_stationary_points(track)
    sharp = round_roots(roots)
    exact, found = turning_points(track, sharp), turning_points(track, rough)
    entries = _entries(track, roots, sharp, rough)
    faults = _differences(track, exact, found)
    if faults:
        faults += [
            f"segment {one.segment}, {one.axis}: {one.found} reversals found instead of {one.reversals}"
            for one in entries
            if one.reversals != one.found
        ]
    verdict = "found, nothing missing, nothing invented" if not faults else f"{len(found)} found"
    even = sum(root.multiplicity % 2 == 0 for root in roots)
    words = (
        f"{counted(len(exact), 'turning point')}, counted exactly: {verdict}.",
        f"{counted(len(roots), 'root')} of the axes' velocities isolated, {even} of them even: no reversal there.",
        *faults,
    )
    return Certificate(ok=not faults, exact=len(exact), found=len(found), entries=entries, words=words)


def _entries(
    track: Track, roots: tuple[CertifiedRoot, ...], sharp: StationaryPoints, rough: StationaryPoints
) -> tuple[CertifiedAxis, ...]:
    """Sort roots by segment and axis."""
    sorted_roots: dict[tuple[int, int], list[CertifiedRoot]] = {}
    for root in roots:
        sorted_roots.setdefault((int(track.segment[root.piece]), root.axis), []).append(root)
    inside, found = (
        Counter(zip(track.segment[turns.piece].tolist(), turns.axis.tolist(), strict=True)) for turns in (sharp, rough)
    )
    return tuple(
        CertifiedAxis(
            segment=segment,
            axis=name,
            intervals=tuple(_interval(track, root) for root in sorted_roots.get((segment, axis), ())),
            multiplicities=tuple(root.multiplicity for root in sorted_roots.get((segment, axis), ())),
            reversals=inside[segment, axis],
            found=found[segment, axis],
        )
        for segment in range(len(track.path.segments))
        for axis, name in enumerate(track.path.axes)
    )


def _interval(track: Track, root: CertifiedRoot) -> tuple[Fraction, Fraction]:
    """Isolating interval in xi."""
    first, last = Fraction(float(track.xi0[root.piece])), Fraction(float(track.xi1[root.piece]))
    return first + root.low * (last - first), first + root.high * (last - first)


def _differences(track: Track, exact: tuple[TurningPoint, ...], found: tuple[TurningPoint, ...]) -> list[str]:
    """Say which turning points are not the same."""
    if len(exact) != len(found):
        return [f"{len(found)} turning points found instead of {len(exact)}"]
    faults = []
    for one, other in zip(exact, found, strict=True):
        low, high = track.path.segments[one.segment].curve.domain
        near = abs(one.xi - other.xi) <= PLACE * (high - low)
        if not near or _label(one) != _label(other):
            faults.append(
                f"turning point {one.index}: {_label(other)} at xi {other.xi!r}"
                f" instead of {_label(one)} at xi {one.xi!r}"
            )
    return faults


def _label(point: TurningPoint) -> str:
    return f"segment {point.segment}, {point.axis} {point.sense}, {point.kind}"
