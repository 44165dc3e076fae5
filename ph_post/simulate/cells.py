"""The nominal path as cubic cells in arc length, and a tree of capsules around them.

A capsule is everything within a radius of a chord. A cell's capsule holds the cell, a parent's holds its two
children's, so that the distance to a capsule bounds the distance to all the cells below it. On a smooth path
the radius falls with the square of the length, much faster than the size of a box around an oblique stretch.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, IntArray

EPS: Final = float(np.finfo(np.float64).eps)
TINY: Final = float(np.finfo(np.float64).tiny)

CHECKS: Final = (0.25, 0.5, 0.75)
"""Parts of a cell at which it is compared with the path: there the error's two leading terms are large."""

MOST_PARTS: Final = 16
"""A cell is cut into at most so many at once: far from convergence the estimate is worth little."""

NEIGHBOURS: Final = 12
"""Cells either side in the window that a search leaves behind."""

TURN: Final = 0.2
"""Turn on either side of a cell within its window [rad]: what keeps the squared distance convex there."""

SMOOTH: Final = 1e-6
"""Jump of the unit tangent below which a joint is smooth to the search.

Two minima beside a concave one differ by its square times the distance: 1e-14 m at 10 mm.
"""

MOST_CELLS: Final = 1 << 19
"""Cells beyond which no more are cut (300 bytes each); the deviation then says what accuracy holds."""


BEND, REACH, S, LENGTH, WIDE_BEND, WIDE_REACH, TANGENT = 12, 13, 14, 15, 16, 17, 18
"""Columns of :attr:`Cells.table` behind the twelve of the cubic."""


class Cells(NamedTuple):
    """Cubic cells along the path, space filled with zeros in the plane, and their tree of capsules.

    Parameters
    ----------
    table : Array, shape (m, 24)
        A row a cell: the coefficients of the cubic q(w), w = 0 … 1, x y z of the constant first [m]; a bound
        of |q''| / |q'|², the curvature [1/m], infinite where q' may vanish; a bound of |q'| [m]; arc length
        at the beginning and of the cell itself [m]; both bounds for the cell's whole window; unit tangents
        at both ends, one-sided.
    window : IntArray, shape (m, 2)
        First and last of the neighbours that join a cell smoothly, itself included.
    capsule : Array, shape (nodes, 8)
        Beginning of the chord, its vector, 1 / its square, and the radius. The cells come first, the root
        last.
    nodes : IntArray, shape (nodes, 4)
        The two nodes below, -1 where there is none, and the first and last cell that the capsule holds.
    loop : float
        Arc length after which a closed path returns [m], infinite for an open one.
    tie : float
        Difference of distances below which two places are equally near [m].
    """

    table: Array
    window: IntArray
    capsule: Array
    nodes: IntArray
    loop: float
    tie: float


class CellSpans(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Stretches of pieces between two arc lengths [m], with one-sided ends.

    `piece`, `s0`, `s1` (m,); `first`, `last` (2, m, 3) are position [m] and unit tangent.
    """

    piece: IntArray
    s0: Array
    s1: Array
    first: Array
    last: Array

    def take(self, rows: BoolArray | IntArray) -> CellSpans:
        """Return some of the pieces."""
        return CellSpans(
            piece=self.piece[rows],
            s0=self.s0[rows],
            s1=self.s1[rows],
            first=self.first[:, rows],
            last=self.last[:, rows],
        )


def cut_path(track: Track, tolerance: float) -> tuple[CellSpans, float]:
    """Cut a path so finely that the cubics in arc length follow it.

    Returns
    -------
    stretches : CellSpans
    deviation : float
        The largest distance of a cubic from the path at the points compared [m].
    """
    tangents = track.tangents()
    piece, s0, s1 = _first_cut(track)
    done: list[CellSpans] = []
    deviation, count = 0.0, 0
    while piece.size:
        cells = _measure_ends(track, tangents, piece, s0, s1)
        off = _deviations(track, cells)
        # What is shorter than its ends are known to cannot be cut.
        fine = (off <= tolerance) | (s1 - s0 <= 8.0 * EPS * s1)
        parts = np.where(fine, 1, np.clip(np.ceil((off / tolerance) ** 0.25), 2, MOST_PARTS)).astype(np.int64)
        if count + parts.sum() > max(MOST_CELLS, piece.size):
            fine[:] = True
        count += int(fine.sum())
        deviation = max(deviation, float(off.max(where=fine, initial=0.0)))
        done.append(cells.take(fine))
        piece, s0, s1 = _subdivide(piece[~fine], s0[~fine], s1[~fine], parts[~fine])
    return _in_order(done), deviation


def _first_cut(track: Track) -> tuple[IntArray, Array, Array]:
    """As many cells a piece as its degree, so that no wiggle passes between the points compared."""
    parts = np.ones(len(track.pieces), dtype=np.int64)
    for group in track.groups:
        parts[group.index] = group.degree
    return _subdivide(np.arange(parts.size), track.starts[:-1], track.starts[1:], parts)


def _subdivide(piece: IntArray, s0: Array, s1: Array, parts: IntArray) -> tuple[IntArray, Array, Array]:
    """Cut every stretch into equal parts; neighbours share their ends to the last bit."""
    row = np.repeat(np.arange(parts.size), parts)
    number = np.arange(row.size) - np.repeat(np.cumsum(parts) - parts, parts)
    count, begin, width = parts[row], s0[row], (s1 - s0)[row]
    low = begin + width * (number / count)
    high = np.where(number + 1 == count, s1[row], begin + width * ((number + 1) / count))
    return piece[row], low, high


def _measure_ends(track: Track, tangents: tuple[Array, Array], piece: IntArray, s0: Array, s1: Array) -> CellSpans:
    first, last = _points(track, piece, s0), _points(track, piece, s1)
    begins, ends = s0 <= track.starts[piece], s1 >= track.starts[piece + 1]
    dim = track.dimension
    first[1, begins, :dim] = tangents[0][piece[begins]]
    last[1, ends, :dim] = tangents[1][piece[ends]]
    return CellSpans(piece=piece, s0=s0, s1=s1, first=first, last=last)


def _points(track: Track, piece: IntArray, s: Array) -> Array:
    """Position and unit tangent (zero in a cusp) of the given pieces, shape (2, n, 3)."""
    found, u = track.locate(s)
    u = np.where(found > piece, 1.0, np.where(found < piece, 0.0, u))
    values = np.zeros((2, s.size, 3))
    values[..., : track.dimension] = track.derivatives(piece, u, 1)
    speed = np.linalg.norm(values[1], axis=1)[:, None]
    np.divide(values[1], speed, out=values[1], where=speed > 0.0)
    return values


def _deviations(track: Track, cells: CellSpans) -> Array:
    power = powers(cells)
    off = np.zeros(cells.s0.size)
    for w in CHECKS:
        cubic = power[:, 0] + w * (power[:, 1] + w * (power[:, 2] + w * power[:, 3]))
        exact = _points(track, cells.piece, cells.s0 + w * (cells.s1 - cells.s0))[0]
        np.maximum(off, np.linalg.norm(cubic - exact, axis=1), out=off)
    return off


def powers(cells: CellSpans) -> Array:
    """Coefficients of the cubic Hermite interpolants, shape (m, 4, 3) [m]."""
    length = (cells.s1 - cells.s0)[:, None]
    p, a, b = cells.first[0], length * cells.first[1], length * cells.last[1]
    chord = cells.last[0] - p
    return np.stack([p, a, 3.0 * chord - 2.0 * a - b, a + b - 2.0 * chord], axis=1)


def _in_order(parts: list[CellSpans]) -> CellSpans:
    joined = CellSpans(
        piece=np.concatenate([part.piece for part in parts]),
        s0=np.concatenate([part.s0 for part in parts]),
        s1=np.concatenate([part.s1 for part in parts]),
        first=np.concatenate([part.first for part in parts], axis=1),
        last=np.concatenate([part.last for part in parts], axis=1),
    )
    return joined.take(np.lexsort((joined.s0, joined.piece)))


def make_cells(stretches: CellSpans, loop: float, tie: float) -> Cells:
    """Gather what the search needs."""
    power = powers(stretches)
    a, b, c = (np.linalg.norm(power[:, k], axis=1) for k in (1, 2, 3))
    slowest = a - 2.0 * b - 3.0 * c
    second = np.maximum(2.0 * b, np.linalg.norm(2.0 * power[:, 2] + 6.0 * power[:, 3], axis=1))
    moving = slowest > 0.0
    bend = np.full(a.size, np.inf)
    # Divided twice: the square of a tiny length would be zero.
    bend[moving] = second[moving] / slowest[moving] / slowest[moving]
    reach = a + 2.0 * b + 3.0 * c
    window, *wide = _windows(stretches, bend, reach)
    columns = [bend, reach, stretches.s0, stretches.s1 - stretches.s0, *wide]
    parts = [power.reshape(-1, 12), np.stack(columns, axis=1), stretches.first[1], stretches.last[1]]
    capsule, nodes = _grow_tree(stretches.first[0], stretches.last[0], _leaf_radii(stretches))
    return Cells(np.concatenate(parts, axis=1), window, capsule, nodes, loop, tie)


def _windows(cells: CellSpans, bend: Array, reach: Array) -> tuple[IntArray, Array, Array]:
    """Neighbours that join each cell smoothly and turn by little: first, last, and bounds over them all."""
    joined = np.linalg.norm(cells.first[1, 1:] - cells.last[1, :-1], axis=1) <= SMOOTH
    above, widest_above, total_above = _extend(joined, bend, reach)
    below, widest_below, total_below = (v[::-1] for v in _extend(joined[::-1], bend[::-1], reach[::-1]))
    number = np.arange(bend.size)
    window = np.stack([number - below.astype(np.int64), number + above.astype(np.int64)], axis=1)
    return window, np.maximum(widest_above, widest_below), total_above + total_below - reach


def _extend(joined: BoolArray, bend: Array, reach: Array) -> tuple[Array, Array, Array]:
    """Count the cells ahead in each cell's window; return their largest bend and total reach too."""
    count, widest, total = np.zeros(bend.size), bend.copy(), reach.copy()
    for ahead in range(1, NEIGHBOURS + 1):
        rows = np.flatnonzero(joined[ahead - 1 :] & (count[:-ahead] == ahead - 1))
        both = np.maximum(widest[rows], bend[rows + ahead])
        length = total[rows] + reach[rows + ahead]
        little = both * length <= TURN
        rows = rows[little]
        count[rows], widest[rows], total[rows] = ahead, both[little], length[little]
    return count, widest, total


def _leaf_radii(cells: CellSpans) -> Array:
    """Distance of the inner Bézier points from the chord: the cubic lies in the hull of the four."""
    p, q = cells.first[0], cells.last[0]
    third = (cells.s1 - cells.s0)[:, None] / 3.0
    return np.maximum(_to_chord(p + third * cells.first[1], p, q), _to_chord(q - third * cells.last[1], p, q))


def _to_chord(point: Array, a: Array, b: Array) -> Array:
    """Distance of points from the chords a … b, all of shape (n, 3)."""
    chord = b - a
    w = np.einsum("nk,nk->n", point - a, chord) * _inverse_square(chord)
    foot = a + np.clip(w, 0.0, 1.0)[:, None] * chord
    distance: Array = np.linalg.norm(point - foot, axis=1)
    return distance


def _inverse_square(chord: Array) -> Array:
    """1 / |chord|², and 0 (every foot is the beginning) where that overflows or there is no chord."""
    square = np.einsum("nk,nk->n", chord, chord)
    inverse: Array = np.divide(1.0, square, out=np.zeros_like(square), where=square > TINY)
    return inverse


def _grow_tree(a: Array, b: Array, radius: Array) -> tuple[Array, IntArray]:
    """Join neighbours two by two up to a single root."""
    rows = [_capsules(a, b, radius)]
    number = np.arange(radius.size)
    nodes = [np.stack([0 * number - 1, 0 * number - 1, number, number], axis=1)]
    below = 0
    while radius.size > 1:
        count = radius.size
        left = np.arange(0, count, 2)
        right = np.minimum(left + 1, count - 1)
        inner = np.maximum(_to_chord(b[left], a[left], b[right]), _to_chord(a[right], a[left], b[right]))
        # Chords lie within `inner` of the parent's, by convexity, and all else near the children's.
        radius = inner + np.maximum(radius[left], radius[right])
        a, b = a[left], b[right]
        rows.append(_capsules(a, b, radius))
        second = np.where(right > left, below + right, -1)
        nodes.append(np.stack([below + left, second, nodes[-1][left, 2], nodes[-1][right, 3]], axis=1))
        below += count
    return np.concatenate(rows), np.concatenate(nodes)


def _capsules(a: Array, b: Array, radius: Array) -> Array:
    chord = b - a
    return np.concatenate([a, chord, _inverse_square(chord)[:, None], radius[:, None]], axis=1)
