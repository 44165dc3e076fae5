"""Measure how far two tool paths are apart, each from the other, in the order of travel."""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.diff.alignment import align, align_samples, gaps_of, hash_columns
from ph_post.diff.curves import ANGLE, FIRST, ORDER, CurveTable
from ph_post.geometry.closest import closest_in_order, points_at
from ph_post.types import Array, IntArray

GRID: Final = 1e-9
"""Motions whose numbers are equal to a nanometre are the same motion [m]."""

SAMPLES: Final = 4000
"""Samples that a stretch is cut into at least, as long as all stretches together stay below `BUDGET`."""

BUDGET: Final = 400_000

CURVED: Final = 32
"""Samples of an arc's half turn, and of a spline."""

SLIGHT: Final = 0.1
"""Runs of same motions belong together where the lag differs by less than this part of their lengths."""

FINER: Final = 32
"""Points that are tried around the sample that is farthest off."""


Span = tuple[int, int]
"""First and last block; the last is before the first where there is none: it would stand before the first."""


class Samples(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Samples of a path in some stretches of it, n of them, in the order of travel.

    `piece`, `u` (n,) say where on the outline, `points` (n, 3) [m] and `ways` (n,) [m] how far along it.
    `stretch` (k + 1,) are the first samples of the stretches, and the end of the last.
    """

    outline: CurveTable
    piece: IntArray
    u: Array
    points: Array
    ways: Array
    stretch: IntArray


class PathSamples(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One path where it is not the other one's.

    `closest_points` (n, 3) [m] are the places of the other path that the samples belong to, `closest_ways` (n,) [m] how
    far along it they are, `deviation` (n,) [m] what is between. `other` (n, 4): first and last sample of the
    other path that each and its neighbours belong to, and those of the whole stretch.
    """

    samples: Samples
    closest_points: Array
    closest_ways: Array
    deviation: Array
    other: IntArray

    def motion(self, rows: IntArray | int | slice = slice(None)) -> IntArray:
        """Motions of samples, of all by default."""
        return np.asarray(self.samples.outline.motion[self.samples.piece[rows]])


class ComparedPaths(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Two paths compared.

    `found` (m,): for every motion of the first path the motion of the second one that is the same, or -1;
    `gaps` (k, 4) the motions between, first and end in either path; `sides` what lies in the gaps, None where
    one of the paths has no motion at all.
    """

    outlines: tuple[CurveTable, CurveTable]
    found: IntArray
    gaps: IntArray
    sides: tuple[PathSamples, PathSamples] | None


def compare_paths(a: CurveTable, b: CurveTable) -> ComparedPaths:
    """Compare two paths: what is the same motion needs no look, the rest is aligned and measured."""
    found = _without_strays(align(_keys(a, 1), _keys(b, 2)), a, b)
    gaps = gaps_of(found, b.first.size - 1)
    if not (len(a.table) and len(b.table)):
        return ComparedPaths(outlines=(a, b), found=found, gaps=gaps, sides=None)
    step = max(float((_travelled(a, gaps[:, :2]) + _travelled(b, gaps[:, 2:])).sum()) / BUDGET, GRID)
    mine, theirs = _sample(a, gaps[:, :2], step), _sample(b, gaps[:, 2:], step)
    pairs = align_samples(mine.points, theirs.points, mine.stretch, theirs.stretch)
    sides = (_measure(mine, theirs, pairs[0]), _measure(theirs, mine, pairs[1]))
    return ComparedPaths(outlines=(a, b), found=found, gaps=gaps, sides=sides)


def _without_strays(found: IntArray, a: CurveTable, b: CurveTable) -> IntArray:
    """Give up runs of same motions that lead astray.

    A program that repeats itself has the same motion at many places. Where the paths have to run apart to
    meet in such a motion, and back again behind it, and both ways are longer than what is the same there, it
    is not the same place. The alignment of all samples finds the right one.
    """
    here = np.flatnonzero(found >= 0)
    if here.size == 0:
        return found
    lag = a.s[a.first[here]] - b.s[b.first[found[here]]]
    heads = np.flatnonzero(np.diff(here, prepend=-2) + np.diff(found[here], prepend=-2) > 2)
    lengths = np.add.reduceat(a.lengths()[here], heads)
    ends = np.append(heads[1:], here.size)
    kept = found.copy()
    for row in _strays(lag[heads].tolist(), lengths.tolist(), a.length - b.length):
        kept[here[heads[row] : ends[row]]] = -1
    return kept


def _strays(lags: list[float], lengths: list[float], last: float) -> list[int]:
    """Return the runs of same motions to which the lag of a path behind the other goes and comes back."""
    groups: list[tuple[float, float, list[int]]] = []
    strays: list[int] = []
    for row, lag in enumerate([*lags, last]):
        new = (lag, lengths[row], [row]) if row < len(lags) else (lag, 0.0, [])
        while groups:
            before = groups[-2][0] if len(groups) > 1 else 0.0
            out, back = groups[-1][0] - before, lag - groups[-1][0]
            if out * back >= 0.0 or 2.0 * min(abs(out), abs(back)) <= groups[-1][1]:
                break
            strays += groups.pop()[2]
        if groups and abs(lag - groups[-1][0]) <= SLIGHT * min(new[1], groups[-1][1]):
            known = groups.pop()
            new = (known[0], known[1] + new[1], known[2] + new[2])
        groups.append(new)
    return strays


def _keys(outline: CurveTable, own: int) -> IntArray:
    """Hash the geometry of every motion; those without a length are unlike all others, as they have no place."""
    table = outline.table.copy()
    table[:, :ANGLE] = np.rint(table[:, :ANGLE] / GRID)
    table[:, ANGLE] = np.rint(table[:, ANGLE] / GRID)
    table[:, FIRST] = 0.0
    for k in np.flatnonzero(table[:, ORDER]).tolist():
        row = outline.table[k]
        control = outline.control[int(row[FIRST]) : int(row[FIRST] + row[ORDER])]
        table[k, FIRST] = float(hash(np.rint(control / GRID).tobytes()) % (1 << 52))
    keys = hash_columns(*table.T)
    if len(keys) != outline.first.size - 1:
        piece = np.arange(keys.size) - np.repeat(outline.first[:-1], np.diff(outline.first))
        keys = np.add.reduceat(hash_columns(keys, piece), outline.first[:-1])
    number = np.arange(keys.size)
    return np.where(outline.lengths() > 0.0, keys, hash_columns(number, np.full_like(number, own)))


def _travelled(outline: CurveTable, gaps: IntArray) -> Array:
    """Way travelled in every gap [m]."""
    ways = outline.s[outline.first[gaps]]
    return np.asarray(ways[:, 1] - ways[:, 0])


def _sample(outline: CurveTable, gaps: IntArray, step: float) -> Samples:
    """Sample all gaps.

    A gap begins with the end of the motion before it and ends with the beginning of the one after it, so that
    none is without a sample.
    """
    rows = outline.first[gaps]
    count = rows[:, 1] - rows[:, 0]
    gap = np.repeat(np.arange(len(rows)), count)
    starts = np.concatenate([[0], np.cumsum(count)])
    own = np.arange(starts[-1]) - starts[gap] + rows[gap, 0]
    steps = np.maximum(_travelled(outline, gaps) / SAMPLES, step)
    parts = _parts(outline, own, steps[gap])
    which = np.repeat(np.arange(own.size), parts + 1)
    begins = np.concatenate([[0], np.cumsum(parts + 1)])
    u = (np.arange(begins[-1]) - begins[which]) / parts[which]
    bounds = begins[starts]
    piece, u = _with_neighbours(own[which], u, bounds, rows, len(outline.table) - 1)
    points = points_at(outline.pieces, outline.control, piece, u)
    stretch = bounds + 2 * np.arange(bounds.size)
    return Samples(outline=outline, piece=piece, u=u, points=points, ways=_way(outline, piece, u), stretch=stretch)


def _parts(outline: CurveTable, piece: IntArray, step: Array) -> IntArray:
    """Into how many parts each piece is cut."""
    table = outline.table[piece]
    parts = np.ceil(np.diff(outline.s)[piece] / step)
    parts = np.maximum(parts, np.ceil(np.abs(table[:, ANGLE]) / np.pi * CURVED))
    return np.asarray(np.maximum(parts, np.where(table[:, ORDER] > 0.0, CURVED, 1)), dtype=np.int64)


def _with_neighbours(piece: IntArray, u: Array, bounds: IntArray, rows: IntArray, last: int) -> tuple[IntArray, Array]:
    """Put one sample before and one behind each gap; the path's own ends where nothing is there."""
    places_at = np.stack([bounds[:-1], bounds[1:]], axis=1).ravel()
    beside = np.stack([np.maximum(rows[:, 0] - 1, 0), np.minimum(rows[:, 1], last)], axis=1).ravel()
    at = np.stack([rows[:, 0] > 0, rows[:, 1] > last], axis=1).ravel()
    return np.insert(piece, places_at, beside), np.insert(u, places_at, at.astype(np.float64))


def _measure(mine: Samples, theirs: Samples, pairs: IntArray) -> PathSamples:
    """Measure how far the samples of one path are from the other."""
    reach = _reach(pairs, mine.stretch, theirs.stretch)
    found, ways = _closest_places(mine.points, reach, theirs)
    deviation = np.linalg.norm(mine.points - found, axis=1)
    return PathSamples(samples=mine, closest_points=found, closest_ways=ways, deviation=deviation, other=reach)


def _closest_places(points: Array, reach: IntArray, path: Samples) -> tuple[Array, Array]:
    """Places of a path that points belong to [m], and how far along it they are [m]."""
    outline = path.outline
    found, piece, u = closest_in_order(
        points, reach, outline.pieces, outline.control, path.piece, path.u, path.points, path.ways
    )
    return found, _way(outline, piece, u)


def _reach(pairs: IntArray, mine: IntArray, theirs: IntArray) -> IntArray:
    """Return the samples of the other path that a sample's neighbours belong to, and those of its stretch."""
    reach = np.empty((len(pairs), 4), dtype=np.int64)
    reach[:, :2] = pairs
    reach[1:, 0], reach[:-1, 1] = pairs[:-1, 0], pairs[1:, 1]
    begins, ends = mine[:-1], mine[1:] - 1
    reach[begins, 0], reach[ends, 1] = pairs[begins, 0], pairs[ends, 1]
    stretch = np.repeat(np.arange(begins.size), np.diff(mine))
    reach[:, 2], reach[:, 3] = theirs[:-1][stretch], theirs[1:][stretch] - 1
    return reach


def _way(outline: CurveTable, piece: IntArray, u: Array) -> Array:
    """Way travelled at u of a piece; in a spline as if the speed were even [m]."""
    return np.asarray(outline.s[piece] + u * np.diff(outline.s)[piece])


def largest_deviation(travel: ComparedPaths) -> float | None:
    """Return how far the samples of either path are from the other at most [m]; None without a path."""
    if travel.sides is None:
        return None if len(travel.gaps) else 0.0
    return max(float(side.deviation.max(initial=0.0)) for side in travel.sides)


def refine_deviations(travel: ComparedPaths, number: int, rows: IntArray) -> tuple[Array, Array]:
    """Look closer around samples of one path for what is farthest off.

    Returns
    -------
    deviation : Array, shape (rows,)
        Largest distance found between the neighbours of each sample [m].
    places : Array, shape (rows, 3)
        Where that is [m].
    """
    assert travel.sides is not None
    side, there = travel.sides[number], travel.sides[1 - number].samples
    mine = side.samples
    low, high = (_beside(mine, rows, step) for step in (-1, 1))
    u = (low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, FINER + 1)).ravel()
    piece = np.repeat(mine.piece[rows], FINER + 1)
    points = points_at(mine.outline.pieces, mine.outline.control, piece, u)
    found, _ = _closest_places(points, np.repeat(side.other[rows], FINER + 1, axis=0), there)
    apart = np.linalg.norm(points - found, axis=1).reshape(rows.size, -1)
    index, best = np.arange(rows.size), np.argmax(apart, axis=1)
    farther = apart[index, best] > side.deviation[rows]
    chosen = points.reshape(rows.size, -1, 3)[index, best]
    deviation = np.where(farther, apart[index, best], side.deviation[rows])
    return deviation, np.where(farther[:, None], chosen, mine.points[rows])


def _beside(samples: Samples, rows: IntArray, step: int) -> Array:
    """Return u of the samples before or behind others, on the same piece."""
    near = np.clip(rows + step, 0, samples.u.size - 1)
    same = samples.piece[near] == samples.piece[rows]
    return np.where(same, samples.u[near], samples.u[rows])
