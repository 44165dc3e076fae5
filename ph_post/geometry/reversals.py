"""Reversals of coordinates along a path.

The path is cut into stretches on which a coordinate rises, falls or stands still. It reverses where one that
rises and one that falls follow each other, with or without a stand-still between them.
"""

from __future__ import annotations

from itertools import groupby
from typing import Final

import msgspec
import numpy as np

from ph_post.geometry.isolate import EPS
from ph_post.geometry.stationary import STILL, Stationary
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, IntArray

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

    def take(self, which: IntArray) -> Reversals:
        """Choose some of them."""
        return Reversals(**{name: getattr(self, name)[which] for name in self.__struct_fields__})


def find_reversals(track: Track, turns: Stationary) -> Reversals:
    """Find the reversals of all coordinates, given where they turn inside the pieces."""
    ends = _end_values(track)
    inner = track.derivatives(turns.piece, turns.u)[0]
    parts = [_of_axis(track, turns, axis, inner, ends) for axis in range(track.dimension)]
    joined = Reversals(
        **{
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in Reversals.__struct_fields__
        }
    )
    joined = joined.take(np.argsort(joined.s, kind="stable"))
    # Where several coordinates reverse at one place, rounding shall not decide their order.
    place = np.cumsum(np.diff(joined.s, prepend=0.0) > SAME_PLACE * track.length)
    return joined.take(np.lexsort((joined.axis, place)))


def _end_values(track: Track) -> tuple[Array, Array]:
    """First and last points of all pieces, shape (pieces, dim) each."""
    values = np.empty((2, len(track.pieces), track.dimension))
    for group in track.groups:
        if group.kind == "arc":
            for end in (0, 1):
                values[end, group.index] = track.derivatives(
                    group.index, np.full(group.index.size, float(end))
                )[0]
            continue
        ends = group.control[:, [0, -1]].transpose(1, 0, 2)
        values[:, group.index] = ends if group.kind == "polynomial" else ends[..., :-1] / ends[..., -1:]
    return values[0], values[1]


def _of_axis(
    track: Track, turns: Stationary, axis: int, inner: Array, ends: tuple[Array, Array]
) -> Reversals:
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
