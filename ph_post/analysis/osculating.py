"""Osculating circles and windows: how far the circle of a turning point follows the path.

A circle has two sides: the path before the point of contact and the path after it. Where the curvature jumps,
each side has a circle of its own. Eq. (6) of [1]_ estimates the arc length over which the deviation (4) stays
within a tolerance; it is only a starting value here. The window itself is found on the path: outward on both
sides, until the deviation crosses the tolerance or something else ends the window first.

References
----------
.. [1] Real-time compensation of backlash positional errors in CNC machines by localized feedrate modulation,
   Int J Adv Manuf Technol 119 (2022), doi:10.1007/s00170-021-08515-z
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import msgspec
import numpy as np

from ph_post.geometry.first_crossings import first_crossings
from ph_post.geometry.joints import SHARP_CORNER_RAD, joint_angles
from ph_post.geometry.reversals import STILL
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, IntArray, TurningPoint, Window, WindowLimit, take


class Circles(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Osculating circles by arc length: `point` r, `tangent` dr/ds, `bend` d²r/ds² [1/m], shape (n, dim)."""

    point: Array
    tangent: Array
    bend: Array

    def at(self, s: Array) -> Array:
        """Points at arc lengths `s` [m], shape (n, k), from where they touch; shape (n, k, dim) [m]."""
        half = 0.5 * np.sqrt(np.einsum("nd,nd->n", self.bend, self.bend))[:, None] * s
        # r + t sin(κs)/κ + n (1 - cos(κs))/κ, in a form that holds for κ = 0.
        chord = s * np.divide(np.sin(half), half, out=np.ones_like(half), where=half != 0.0)
        along, across = chord * np.cos(half), 0.5 * chord**2
        points = np.empty((*s.shape, self.point.shape[1]))
        for axis in range(points.shape[2]):
            points[..., axis] = along * self.tangent[:, axis, None] + across * self.bend[:, axis, None]
            points[..., axis] += self.point[:, axis, None]
        return points


def touching_circles(track: Track, s: Array, xi: Array) -> Circles:
    """Osculating circles of the path before all places, and then those of the path after them.

    A side on which the parametric speed vanishes borrows the other's.

    Parameters
    ----------
    track : Track
    s, xi : Array, shape (n,)
        Places, by arc length [m] and, exactly, by their segments' parameter.
    """
    count = len(track.pieces)
    piece = np.clip(np.searchsorted(track.starts, s, side="right") - 1, 0, count - 1)
    joint = np.flatnonzero(track.starts[piece] == s)
    u = np.clip((xi - track.xi0[piece]) / (track.xi1[piece] - track.xi0[piece]), 0.0, 1.0)
    u[joint] = 0.0
    after, regular = _circles(track, piece, u)
    both = take(after, np.tile(np.arange(s.size), 2))
    if joint.size:
        before, fine = _circles(track, (piece[joint] - 1) % count, np.ones(joint.size))
        _assign(both, joint[fine], take(before, fine))
        lost = np.flatnonzero(~regular[joint])
        _assign(both, s.size + joint[lost], take(before, lost))
    return both


def _circles(track: Track, piece: IntArray, u: Array) -> tuple[Circles, BoolArray]:
    """Osculating circles, and where there is one: where the parametric speed does not vanish."""
    point, d1, d2 = track.derivatives(piece, u, 2)
    square = np.einsum("nd,nd->n", d1, d1)
    regular: BoolArray = square > STILL * np.sqrt(np.einsum("nd,nd->n", d2, d2))
    square = np.where(regular, square, 1.0)[:, None]
    tangent = d1 / np.sqrt(square)
    bend = (d2 - np.einsum("nd,nd->n", d2, tangent)[:, None] * tangent) / square
    return Circles(point=point, tangent=tangent, bend=bend), regular


def _assign(circles: Circles, where: IntArray, values: Circles) -> None:
    for name in Circles.__struct_fields__:
        getattr(circles, name)[where] = getattr(values, name)


class CircleSides(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Both sides of n places, first all sides before, then all after: circles, `s` [m], directions (±1)."""

    track: Track
    circles: Circles
    s: Array
    direction: Array

    def deviation(self, side: IntArray, distance: Array) -> Array:
        """|r(s) - c(s)| [m] at distances (n, k) outward on the given sides (n,), shape (n, k)."""
        offset = self.direction[side, None] * distance
        s = self.s[side, None] + offset
        if self.track.closed:
            s = s % self.track.length
        piece, u = self.track.locate(s.ravel())
        places = self.track.derivatives(piece, u)[0]
        gap = places.reshape(*s.shape, places.shape[1])  # of no sides as well
        gap -= take(self.circles, side).at(offset)
        deviation: Array = np.sqrt(np.einsum("nkd,nkd->nk", gap, gap))
        return deviation

    def deviation_at(self, number: IntArray, piece: IntArray, u: Array) -> tuple[Array, Array]:
        """Distances (n,) from the places numbered `number` and |r(s) - c(s)| there [m].

        Pieces of a closed path are counted on beyond its ends, as by :func:`unrolled_piece`.
        """
        track = self.track
        turn, piece = np.divmod(piece, len(track.pieces))
        offset = track.arc_length(piece, u) + turn * track.length - self.s[number]
        side = number + np.where(offset > 0.0, self.s.size // 2, 0)
        gap = track.derivatives(piece, u)[0] - take(self.circles, side).at(offset[:, None])[:, 0]
        return offset, np.sqrt(np.einsum("nd,nd->n", gap, gap))


def sides_of(track: Track, s: Array, xi: Array) -> CircleSides:
    """Return the osculating circles on both sides of places xi (n,) at arc lengths s (n,) [m]."""
    circles = touching_circles(track, s, xi)
    return CircleSides(track=track, circles=circles, s=np.tile(s, 2), direction=np.repeat([-1.0, 1.0], s.size))


def unrolled_piece(track: Track, s: Array) -> IntArray:
    """Piece at arc length `s` [m]; on a closed path counted on beyond its ends, elsewhere clipped."""
    turn = np.floor(s / track.length).astype(np.int64) if track.closed else np.zeros(s.size, dtype=np.int64)
    piece: IntArray = np.searchsorted(track.starts[1:-1], s - turn * track.length, side="right")
    return piece + turn * len(track.pieces)


JUMP: Final = 1e-6
"""Part of the curvature by which both sides of a joint may differ and still share one circle."""

TOGETHER: Final = 1e-9
"""Turning points no further apart than this share a window [m]: as near as segments have to meet, so that
every one of them has the same circle. Any others have windows of their own, each true to its own circle."""

FEW: Final = 15
"""Pieces of a window times their degree up to which it is not searched piece by piece: three quintics."""

INNER: Final = 0.9
"""A deviation above this part of the tolerance on this inner part of a window is suspect: a cube has 0.73."""

LIMITS: Final[tuple[WindowLimit, ...]] = ("neighbour", "corner", "end", "deviation")
"""Limits that end a window, in order of precedence at one place."""

NOTES: Final = (
    ("shortened to half the way to the neighbouring turning point",),
    ("shortened: it reaches a corner",),
    ("shortened: it reaches the end of the path",),
    (),
)
"""Words for each of LIMITS."""


class _Centers(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Turning points as arrays: place, and the sizes of the derivatives in Eq. (6).

    `cubic` is √(κ̇² + κ²τ²) [1/m²], `quartic` |κ̈| [1/m³]; `worse` is 1 where the two terms of Eq. (4) add up
    behind the turning point, and 0 where they do so before it.
    """

    s: Array
    xi: Array
    cubic: Array
    quartic: Array
    worse: IntArray


def _centers(points: Sequence[TurningPoint]) -> _Centers:
    kappa = np.array([point.curvature for point in points], dtype=np.float64)
    kappa_dot = np.array([point.curvature_dot for point in points], dtype=np.float64)
    kappa_ddot = np.array([point.curvature_ddot for point in points], dtype=np.float64)
    tau = np.array([point.torsion for point in points], dtype=np.float64)
    return _Centers(
        s=np.array([point.s for point in points]),
        xi=np.array([point.xi for point in points]),
        cubic=np.hypot(kappa_dot, kappa * tau),
        quartic=np.abs(kappa_ddot),
        worse=(kappa_dot * kappa_ddot > 0.0).astype(np.int64),
    )


def circles_at(track: Track, points: Sequence[TurningPoint]) -> tuple[Circles, Circles]:
    """Osculating circles of turning points that have one: of the path before each, and after it.

    They differ where the curvature jumps.
    """
    centers = _centers(points)
    both = touching_circles(track, centers.s, centers.xi)
    before, after = np.arange(2 * len(points)).reshape(2, -1)
    return take(both, before), take(both, after)


def deviation(track: Track, point: TurningPoint, s: Array) -> Array:
    """Deviation |r(s) - c(s)| [m] of the path from the osculating circle of one turning point.

    Implements the left side of Eq. (4) of [1]_ without expanding it.

    Parameters
    ----------
    track : Track
    point : TurningPoint
        One that has a circle.
    s : Array
        Arc lengths from the turning point [m], negative before it.
    """
    center = _centers([point])
    side = np.where(s < 0.0, 0, 1)
    return sides_of(track, center.s, center.xi).deviation(side, np.abs(s)[:, None])[:, 0]


def find_windows(track: Track, points: Sequence[TurningPoint], tolerance: float) -> tuple[Window, ...]:
    """Find the window of every turning point that has an osculating circle.

    The largest [s - h, s + h] on which the path leaves the circle by no more than `tolerance`, up to half the
    way to the next turning point, a corner or cusp, or the end of an open path. Turning points at one place,
    where several axes reverse together, share one window.

    Parameters
    ----------
    track : Track
    points : sequence of TurningPoint
        All of the path's, ordered by s.
    tolerance : float
        ε [m].
    """
    turning = [point for point in points if point.curvature is not None]
    if not turning:
        return ()
    clusters = _clusters(turning)
    chosen = [turning[members[0]] for members in clusters]
    centers = _centers(chosen)
    sides = sides_of(track, centers.s, centers.xi)
    stops = _stops(track, centers.s, [point.s for point in points if point.kind == "cusp"])
    limit = stops.argmin(axis=0)
    estimate, order = _estimates(centers, tolerance)
    half_length, crossed = _extents(sides, centers, stops.min(axis=0), tolerance)
    limit[crossed] = LIMITS.index("deviation")
    windows = [
        Window(
            turning_point=center.index,
            s=center.s,
            half_length=half,
            limited_by=LIMITS[which],
            estimate=guess,
            contact_order=contact,
            members=members,
            notes=notes,
        )
        for center, half, which, guess, contact, members, notes in zip(
            chosen,
            half_length.tolist(),
            limit.tolist(),
            estimate.tolist(),
            order.tolist(),
            _members(turning, clusters),
            _notes(limit, sides, clusters),
            strict=True,
        )
    ]
    return tuple(windows)


def estimate_half_length(point: TurningPoint, tolerance: float) -> float:
    """Half length of a window by Eq. (6) [m], infinite on a circle.

    Implements Eq. (6) of [1]_, in space with √(κ̇² + κ²τ²) in place of |κ̇|. It is an estimate: where both
    terms act the true deviation can be twice the tolerance.
    """
    return float(_estimates(_centers([point]), tolerance)[0][0])


def _estimates(centers: _Centers, tolerance: float) -> tuple[Array, IntArray]:
    """Half lengths by Eq. (6), and orders of contact."""
    with np.errstate(divide="ignore"):
        third, fourth = 6.0 * tolerance / centers.cubic, 24.0 * tolerance / centers.quartic
    order = np.select([centers.cubic > 0.0, centers.quartic > 0.0], [2, 3], 4)
    return np.minimum(np.cbrt(third), np.sqrt(np.sqrt(fourth))), order


def _extents(sides: CircleSides, centers: _Centers, reach: Array, tolerance: float) -> tuple[Array, BoolArray]:
    """Half lengths [m] up to `reach`, and whether the deviation ends them.

    The side on which the terms of Eq. (4) add up is likely to end the window; the other one then has to be
    looked at only as far.
    """
    rows = np.arange(reach.size)
    order = rows + rows.size * np.stack([centers.worse, 1 - centers.worse])
    half, crossed = reach, np.zeros(rows.size, dtype=bool)
    guess = _guess(centers, tolerance)
    for side in order:
        half, ends = _one_sided(sides, side, half, guess, tolerance)
        crossed, guess = crossed | ends, half
    suspects, places = _suspects(sides, half, tolerance)
    for side in order[:, suspects] if suspects.size else ():
        half[suspects], ends = _one_sided(sides, side, half[suspects], half[suspects], tolerance, places)
        crossed[suspects] |= ends
    return half, crossed


def _one_sided(
    sides: CircleSides, side: IntArray, reach: Array, guess: Array, tolerance: float, places: int = 0
) -> tuple[Array, BoolArray]:
    """Extents on one side of each window."""

    def function(number: IntArray, distance: Array) -> Array:
        return sides.deviation(side[number], distance)

    return first_crossings(function, reach, guess, tolerance, places=places)


def _suspects(sides: CircleSides, half: Array, tolerance: float) -> tuple[IntArray, int]:
    """Windows whose deviation may wind past the tolerance inside, and how many places show that it does.

    A piece bends only as often as its degree allows. Windows on few pieces of low degree have been looked at
    enough; on all others every piece is looked at.
    """
    track = sides.track
    s = sides.s[: half.size]
    first, last = unrolled_piece(track, s - half), unrolled_piece(track, s + half)
    nodes = max(4, *(group.degree for group in track.groups))
    wide = np.flatnonzero((last - first + 1) * nodes > FEW)
    spans = (last - first + 1)[wide]
    window = np.repeat(wide, spans)
    piece = np.repeat(first[wide] - np.cumsum(spans) + spans, spans) + np.arange(window.size)
    u = np.tile((np.arange(nodes) + 0.5) / nodes, window.size)
    window, piece = np.repeat(window, nodes), np.repeat(piece, nodes)
    offset, gap = sides.deviation_at(window, piece, u)
    inside = np.abs(offset) < half[window]
    near = np.abs(offset) < INNER * half[window]
    suspect = (inside & (gap > tolerance)) | (near & (gap > INNER * tolerance))
    found = np.unique(window[suspect])
    return found, 4 * nodes * int((last - first + 1)[found].max(initial=0))


def _guess(centers: _Centers, tolerance: float) -> Array:
    """Solve √(κ̇² + κ²τ²) t³/6 + |κ̈| t⁴/24 = tolerance by two Newton steps from Eq. (6)."""
    guess, _ = _estimates(centers, tolerance)
    bound = np.isfinite(guess)
    t = guess[bound]
    for _ in range(2):
        third, fourth = centers.cubic[bound] * t**3 / 6.0, centers.quartic[bound] * (t * t) ** 2 / 24.0
        total = third + fourth
        t *= (tolerance / total) ** (total / (3.0 * third + 4.0 * fourth))
    guess[bound] = t
    return guess


def _clusters(points: Sequence[TurningPoint]) -> list[list[int]]:
    """Numbers of the turning points that share a window, in order."""
    s = np.array([point.s for point in points])
    cuts = np.flatnonzero(np.diff(s) > TOGETHER) + 1
    if cuts.size == s.size - 1:
        return [[k] for k in range(s.size)]
    return [list(range(first, last)) for first, last in pairwise([0, *cuts.tolist(), s.size])]


def _members(points: Sequence[TurningPoint], clusters: list[list[int]]) -> list[tuple[int, ...]]:
    if len(clusters) == len(points):
        return [(point.index,) for point in points]
    return [tuple(points[k].index for k in members) for members in clusters]


def _stops(track: Track, s: Array, cusps: Sequence[float]) -> Array:
    """Half the way to the neighbours, and the ways to a corner and to the ends; shape (3, n) [m]."""
    angle = joint_angles(track)
    corners = np.sort(np.append(track.starts[1 + np.flatnonzero(angle > SHARP_CORNER_RAD)], cusps))
    length = track.length
    if track.closed:
        half = 0.5 * np.diff(s, prepend=s[-1] - length, append=s[0] + length)
        end = np.full(s.size, np.inf)
        corners = np.concatenate([corners - length, corners, corners + length])
    else:
        half = 0.5 * np.diff(s, prepend=-np.inf, append=np.inf)
        end = np.minimum(s, length - s)
    return np.stack([np.minimum(half[:-1], half[1:]), _nearest(s, corners), end])


def _nearest(s: Array, places: Array) -> Array:
    """Distances to the nearest of some sorted places, infinite where there is none."""
    padded = np.concatenate([[-np.inf], places, [np.inf]])
    after = np.searchsorted(places, s)
    nearest: Array = np.minimum(s - padded[after], padded[after + 1] - s)
    return nearest


def _notes(limit: IntArray, sides: CircleSides, clusters: list[list[int]]) -> list[tuple[str, ...]]:
    """Say in words what shaped each window."""
    notes: list[tuple[str, ...]] = [NOTES[which] for which in limit.tolist()]
    bend = sides.circles.bend.reshape(2, len(clusters), -1)
    largest = np.sqrt(np.einsum("snd,snd->sn", bend, bend)).max(axis=0)
    jump = np.linalg.norm(bend[1] - bend[0], axis=1) > JUMP * largest
    for k in np.flatnonzero(jump).tolist():
        notes[k] += ("the curvature jumps here: each side has its own circle",)
    size = np.fromiter(map(len, clusters), dtype=np.int64, count=len(clusters))
    for k in np.flatnonzero(size > 1).tolist():
        notes[k] += (f"shared by {len(clusters[k])} turning points at one place",)
    return notes
