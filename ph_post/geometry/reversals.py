"""Stationary points and reversals of the coordinates along a path.

Stationary points are the odd roots of a coordinate's derivative inside the pieces. Three steps find them:
control points with a bound on their rounding exclude pieces without a root; the sharpest floating-point form
of the velocity gives the roots and bounds on their errors; exact arithmetic settles the rest.

The path is then cut into stretches on which a coordinate rises, falls or stands still. A coordinate reverses
where a rising and a falling stretch follow each other, with or without a standstill between them.
"""

from __future__ import annotations

from itertools import groupby
from typing import Final, cast

import msgspec
import numpy as np

from ph_post.geometry import bernstein, exact_polynomials
from ph_post.geometry.ph import HODOGRAPHS, PH
from ph_post.geometry.piecewise import ExactPiece, Group, PiecewiseCurve
from ph_post.geometry.root_isolation import EPS, find_roots
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, IntArray, join_rows, take
from ph_post.units import MM

STILL: Final = 1e-9 * MM
"""An axis that travels less than this on a piece stands still there [m]: a hundredth of an atom."""

SNAP: Final = 1e-14
"""A root this near to a piece's end (in its parameter) is at the end: there the neighbour has it too."""

ROOT_ERROR: Final = 1e-14
"""A root that floating point knows no better than this is polished in exact numbers."""

BUILD_ERROR: Final = 16.0 * EPS
"""Bound on what building a piece in floating point did to its control points, relative to the largest."""


PRODUCT_ERROR: Final = 6.0 * EPS
"""Rounding of a PH hodograph (preimage, products and sums) relative to the sum of its terms' sizes."""


class StationaryPoints(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Places where a coordinate turns: `axis`, `piece` and `u` in (SNAP, 1 - SNAP), sorted in this order."""

    axis: IntArray
    piece: IntArray
    u: Array


def find_stationary_points(track: Track) -> StationaryPoints:
    """Find where the coordinates turn inside the pieces of `track`; their ends are left to the caller."""
    return collect([_of_group(track, group) for group in track.groups])


def collect(parts: list[StationaryPoints]) -> StationaryPoints:
    """Join, leave out what is at the ends of pieces, and sort."""
    axis = np.concatenate([part.axis for part in parts])
    piece = np.concatenate([part.piece for part in parts])
    u = np.concatenate([part.u for part in parts])
    keep = np.flatnonzero((u > SNAP) & (u < 1.0 - SNAP))
    order = keep[np.lexsort((u[keep], piece[keep], axis[keep]))]
    return StationaryPoints(axis=axis[order], piece=piece[order], u=u[order])


def _of_group(track: Track, group: Group) -> StationaryPoints:
    if group.kind == "arc":
        return arc_extremes(group)
    axis, row = _may_turn(group)
    piece = group.index[row]
    found_row, u = _roots(track, group, piece, axis, row)
    return StationaryPoints(axis=axis[found_row], piece=piece[found_row], u=u)


def arc_extremes(group: Group) -> StationaryPoints:
    """Quadrant points: the first coordinate turns at multiples of π, the second half-way between."""
    first, sweep = group.control[:, 1, 1], group.control[:, 2, 0]
    low, high = np.minimum(first, first + sweep), np.maximum(first, first + sweep)
    parts = []
    for axis in (0, 1):
        before = np.floor(low / np.pi - 0.5 * axis)
        # Once round at most: two extremes inside, or one at each end and one inside.
        for k in range(4):
            angle = (before + k + 0.5 * axis) * np.pi
            on = np.flatnonzero((angle > low) & (angle < high))
            u = (angle[on] - first[on]) / sweep[on]
            parts.append(StationaryPoints(axis=np.full(on.size, axis), piece=group.index[on], u=u))
    return collect(parts)


def _may_turn(group: Group) -> tuple[IntArray, IntArray]:
    """Axis and number in the group of every coordinate whose velocity may change its sign.

    A velocity all of whose coefficients have one sign, and by more than the rounding of the control points,
    cannot.
    """
    x = group.control if group.kind == "polynomial" else group.control[..., :-1] / group.control[..., -1:]
    x = np.ascontiguousarray(x.transpose(2, 1, 0))  # the pieces' number last: contiguous comparisons
    steps = np.diff(x, axis=1)
    error = 2.0 * BUILD_ERROR * np.abs(x).max(axis=1)
    one_way = (steps.min(axis=1) > error) | (steps.max(axis=1) < -error)
    moving = np.abs(steps).sum(axis=1) >= STILL
    axis, row = np.nonzero(moving & ~one_way)
    return axis, row


def _roots(track: Track, group: Group, piece: IntArray, axis: IntArray, row: IntArray) -> tuple[IntArray, Array]:
    """Odd roots of the velocities named by `piece` and `axis`: for each the velocity's number, and u."""
    data = ExactData(track)
    if group.kind == "rational":
        c = _rounded_forms(data, piece, axis, np.arange(piece.size), 2 * group.degree - 1)
        error = EPS * np.abs(c)
    else:
        c, error = _sharp_forms(data, group, piece, axis, row)
    found = find_roots(c, error)
    loose = np.union1d(found.undecided, found.row[found.error > ROOT_ERROR])
    tight = ~np.isin(found.row, loose)
    rest = [
        (number, u)
        for number in loose.tolist()
        for u in _settled(data.velocity(piece[number], axis[number]), found.u[found.row == number])
    ]
    numbers = np.array([number for number, _ in rest], dtype=np.int64)
    places = np.array([u for _, u in rest], dtype=np.float64)
    return np.concatenate([found.row[tight], numbers]), np.concatenate([found.u[tight], places])


def _settled(velocity: exact_polynomials.Rational, rough: Array) -> list[float]:
    """Odd roots in exact arithmetic: by polishing those that are known, or from nothing."""
    polished = [exact_polynomials.sharpen(velocity, u) for u in rough.tolist()]
    sharp = [u for u in polished if u is not None]
    if polished and len(sharp) == len(polished):
        return sharp
    return [root.middle for root in exact_polynomials.isolate(velocity) if root.multiplicity % 2]


def _sharp_forms(data: ExactData, group: Group, piece: IntArray, axis: IntArray, row: IntArray) -> tuple[Array, Array]:
    """Velocities in Bernstein form up to a factor, with componentwise bounds on their errors.

    Where control points are data, their differences are right to rounding. Elsewhere the velocity comes from
    what the control points were made of: the preimage of a PH curve, or the exact data, rounded once.
    """
    c = np.diff(group.control[row, :, axis], axis=1)
    rest = [(k, curve) for k, curve in enumerate(data.curves(piece)) if not curve.built_exactly]
    ph = np.array([k for k, curve in rest if isinstance(curve, PH)], dtype=np.int64)
    others = np.array([k for k, curve in rest if not isinstance(curve, PH)], dtype=np.int64)
    c[others] = _rounded_forms(data, piece, axis, others, group.degree)
    error = EPS * np.abs(c)
    if ph.size:
        preimages = np.stack([curve.preimage for _, curve in rest if isinstance(curve, PH)])
        c[ph], error[ph] = _hodographs(preimages, axis[ph])
    return c, error


def _rounded_forms(data: ExactData, piece: IntArray, axis: IntArray, numbers: IntArray, count: int) -> Array:
    """Velocities from the exact data, every coefficient rounded once."""
    forms = [
        exact_polynomials.rounded_derivative(one.control, number, rational=one.kind == "rational")
        for one, number in zip(data.pieces(piece[numbers]), axis[numbers].tolist(), strict=True)
        if one is not None
    ]
    return np.array(forms, dtype=np.float64).reshape(numbers.size, count)


def _hodographs(preimages: Array, axis: IntArray) -> tuple[Array, Array]:
    """One coordinate of each PH curve's hodograph and its errors, from preimages (k, m + 1, components)."""
    parts = preimages.transpose(2, 0, 1)
    count = 2 * parts.shape[2] - 1
    c, size = np.zeros((axis.size, count)), np.zeros((axis.size, count))
    for number, form in enumerate(HODOGRAPHS[len(parts)]):
        on = np.flatnonzero(axis == number)
        for factor, i, j in form:
            c[on] += factor * bernstein.product(parts[i, on], parts[j, on])
            size[on] += abs(factor) * bernstein.product(np.abs(parts[i, on]), np.abs(parts[j, on]))
    return c, PRODUCT_ERROR * size


class ExactData:
    """The exact data of a track's curves, each converted once."""

    def __init__(self, track: Track) -> None:
        self._segments = track.path.segments
        self._segment = track.segment
        self._pieces: dict[int, tuple[ExactPiece | None, ...]] = {}

    def curves(self, piece: IntArray) -> list[PiecewiseCurve]:
        """Return the curves that pieces belong to."""
        found = [self._segments[number].curve for number in self._segment[piece].tolist()]
        return cast("list[PiecewiseCurve]", found)

    def pieces(self, piece: IntArray) -> list[ExactPiece | None]:
        """Return the control points of pieces in exact numbers; None for arcs."""
        segments = self._segment[piece]
        local = (piece - np.searchsorted(self._segment, segments)).tolist()
        for segment, curve in zip(segments.tolist(), self.curves(piece), strict=True):
            if segment not in self._pieces:
                self._pieces[segment] = curve.exact_pieces()
        return [self._pieces[segment][k] for segment, k in zip(segments.tolist(), local, strict=True)]

    def velocity(self, piece: int, axis: int) -> exact_polynomials.Rational:
        """Bernstein form of one coordinate's velocity, up to a positive factor; empty for an arc."""
        (one,) = self.pieces(np.array([piece]))
        return () if one is None else exact_polynomials.derivative(one.control, axis, rational=one.kind == "rational")


RESOLUTION: Final = 4.0 * EPS
"""Travel next to a joint that is less than this part of the coordinate may be the rounding of the joint."""

SAME_PLACE: Final = 1e-13
"""Reversals nearer than this part of the path's length are at one place."""


class Reversals(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Reversals in the order of the path, by the place where the coordinate begins to move the other way.

    `u` = 0 is the joint before `piece`, or the seam before the first one. `rising` tells the new direction,
    `dwell` whether the coordinate stood still in between; `position` [m] is its value, `s` [m] the place.
    """

    axis: IntArray
    piece: IntArray
    u: Array
    rising: BoolArray
    dwell: BoolArray
    position: Array
    s: Array


def find_reversals(track: Track, turns: StationaryPoints) -> Reversals:
    """Find the reversals of all coordinates, given where they turn inside the pieces."""
    ends = _end_values(track)
    inner = track.derivatives(turns.piece, turns.u)[0]
    parts = [_of_axis(track, turns, axis, inner, ends) for axis in range(track.dimension)]
    joined = join_rows(parts)
    joined = take(joined, np.argsort(joined.s, kind="stable"))
    # Where several coordinates reverse at one place, rounding shall not decide their order.
    place = np.cumsum(np.diff(joined.s, prepend=0.0) > SAME_PLACE * track.length)
    return take(joined, np.lexsort((joined.axis, place)))


def _end_values(track: Track) -> tuple[Array, Array]:
    """First and last points of all pieces, shape (pieces, dim) each."""
    values = np.empty((2, len(track.pieces), track.dimension))
    for group in track.groups:
        if group.kind == "arc":
            for end in (0, 1):
                values[end, group.index] = track.derivatives(group.index, np.full(group.index.size, float(end)))[0]
            continue
        ends = group.control[:, [0, -1]].transpose(1, 0, 2)
        values[:, group.index] = ends if group.kind == "polynomial" else ends[..., :-1] / ends[..., -1:]
    return values[0], values[1]


def _of_axis(track: Track, turns: StationaryPoints, axis: int, inner: Array, ends: tuple[Array, Array]) -> Reversals:
    """Reversals of one axis: rising after falling or falling after rising, still stretches left out."""
    mine = np.flatnonzero(turns.axis == axis)
    cut = turns.piece[mine]
    count = len(track.pieces)
    first = np.arange(count) + np.searchsorted(cut, np.arange(count))
    after = np.arange(cut.size) + cut + 1
    piece = np.empty(count + cut.size, dtype=np.int64)
    u, x, end = np.zeros(piece.size), np.empty(piece.size), np.empty(piece.size)
    piece[first], piece[after], u[after] = np.arange(count), cut, turns.u[mine]
    x[first], x[after] = ends[0][:, axis], inner[mine, axis]
    end[:-1], end[np.append(first[1:], piece.size) - 1] = x[1:], ends[1][:, axis]
    sign, still = _directions(end - x, piece, first)
    sign = _without_noise(sign, np.abs(end - x) <= RESOLUTION * np.abs(x), piece, closed=track.closed)
    kept = np.flatnonzero(sign)
    before = np.roll(kept, 1)
    turned = sign[kept] != sign[before]
    if kept.size and not track.closed:
        turned[0] = False
    later, before = kept[turned], before[turned]
    stood = np.cumsum(still)
    rest = (stood[later] - stood[before] + np.where(later <= before, stood[-1], 0)) > 0
    place, on = piece[later], u[later]
    s = np.where(on > 0.0, track.arc_length(place, on), track.starts[place])
    return Reversals(
        axis=np.full(later.size, axis),
        piece=place,
        u=on,
        rising=sign[later] > 0,
        dwell=rest,
        position=x[later],
        s=s,
    )


def _directions(travel: Array, piece: IntArray, first: IntArray) -> tuple[IntArray, BoolArray]:
    """Sign of every stretch's travel, 0 on pieces where the axis stands still, and whether it does.

    The direction alternates within a piece, so that all its stretches decide together: the tiny travel
    between nearly equal roots has no sign of its own in floating point.
    """
    parity = 1 - 2 * ((np.arange(piece.size) - first[piece]) % 2)
    total = np.add.reduceat(travel * parity, first)
    still = (np.abs(total) < STILL)[piece]
    sign = np.where(still, 0, np.sign(total).astype(np.int64)[piece] * parity)
    return sign, still


def _without_noise(sign: IntArray, tiny: BoolArray, piece: IntArray, *, closed: bool) -> IntArray:
    """Leave out stretches next to joints that are too short to be told from rounding and make reversals.

    Rounding can make a coordinate turn twice within an ulp of a joint that it passes, or three times where it
    turns once. A tiny stretch on which no reversal depends but its own stays as it is.
    """
    inside = np.zeros(piece.size, dtype=bool)
    inside[1:-1] = (piece[1:-1] == piece[:-2]) & (piece[1:-1] == piece[2:])
    alone = np.ones(piece.size, dtype=bool)
    alone[1:] &= piece[1:] != piece[:-1]
    alone[:-1] &= piece[:-1] != piece[1:]
    suspects = np.flatnonzero(tiny & ~inside & ~alone & (sign != 0))
    if suspects.size == 0:
        return sign
    sign = sign.copy()
    kept = np.flatnonzero(sign)
    ranks = np.searchsorted(kept, suspects).tolist()
    for _, group in groupby(enumerate(ranks), key=lambda pair: pair[1] - pair[0]):
        run = [rank for _, rank in group]
        around = np.arange(run[0] - 1, run[-1] + 2)
        if not closed and (around[0] < 0 or around[-1] >= kept.size):
            continue
        signs = sign[kept[around % kept.size]]
        if np.count_nonzero(np.diff(signs)) > int(signs[0] != signs[-1]):
            sign[kept[run]] = 0
    return sign
