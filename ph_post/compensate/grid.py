"""Where along the path the limits are looked at: finely where they change."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ph_post.compensate.columns import largest, norm
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, IntArray

_CELLS = 8
"""Cells a curved piece begins with; each is looked at in its middle as well."""

_CHANGE = 0.1
"""Relative change of the speed cap across half a cell that asks for finer cells."""

_TURN = 0.1
"""Turn of the tangent [rad] across half a cell that asks for finer cells: directions are right to 1e-3."""

_ROUNDS = 14
"""Halvings of a cell: to 1 / 131072 of a piece, where a cusp rounded by 1e-5 of it shows."""

_STILL = 1e-6
"""Parametric speed, relative to the piece's largest, below which d/ds is not worth evaluating."""

_LEAST = np.finfo(np.float64).tiny


def fastest_speeds(track: Track) -> Array:
    """Largest parametric speed of every piece [m], as seen at a few points, shape (pieces,)."""
    piece, u = _first_points(track)
    fastest = np.zeros(len(track.pieces))
    np.maximum.at(fastest, piece, norm(track.derivatives(piece, u, 1)[1]))
    return fastest


def build_grid(
    track: Track, fastest: Array, cap: Callable[[IntArray, Array], Array]
) -> tuple[IntArray, Array]:
    """Choose the points at which the limits are evaluated.

    Parameters
    ----------
    track : Track
    fastest : Array
        See :func:`fastest_speeds`.
    cap : callable
        Speed cap [m/s] at ``(piece, u)``, finite; cells are halved until it is nearly the same all over them.

    Returns
    -------
    piece : IntArray, shape (n,)
    u : Array, shape (n,)
        In the order of the path, both ends of every piece among them where the path is regular there.
    """
    look = _Look(track, fastest, cap)
    points = [look.at(*_first_points(track))]
    cells = _first_cells(points[0])
    for _ in range(_ROUNDS):
        if not cells.low.piece.size:
            break
        middle = look.at(cells.low.piece, 0.5 * (cells.low.u + cells.high.u))
        points.append(middle)
        # What cannot be evaluated is NaN and compares as false: its neighbourhood is refined.
        rough = np.flatnonzero(~(_alike(cells.low, middle) & _alike(middle, cells.high)))
        low, middle, high = cells.low.take(rough), middle.take(rough), cells.high.take(rough)
        cells = _Cells(_join(low, middle), _join(middle, high))
    found = _join(*points)
    good = np.flatnonzero(np.isfinite(found.value))
    order = good[np.lexsort((found.u[good], found.piece[good]))]
    return found.piece[order], found.u[order]


class _Points(NamedTuple):
    """Points on the path: logarithm of the cap and unit tangent, NaN where the path is not regular."""

    piece: IntArray
    u: Array
    value: Array
    tangent: Array

    def take(self, which: IntArray) -> _Points:
        return _Points(self.piece[which], self.u[which], self.value[which], self.tangent[which])


class _Cells(NamedTuple):
    low: _Points
    high: _Points


class _Look:
    """Looks at the path."""

    def __init__(self, track: Track, fastest: Array, cap: Callable[[IntArray, Array], Array]) -> None:
        self.track, self.fastest, self.cap = track, fastest, cap

    def at(self, piece: IntArray, u: Array) -> _Points:
        velocity = self.track.derivatives(piece, u, 1)[1]
        speed = norm(velocity)
        value, tangent = np.full(u.size, np.nan), np.full(velocity.shape, np.nan)
        good = np.flatnonzero(speed > _STILL * self.fastest[piece])
        value[good] = np.log(np.maximum(self.cap(piece[good], u[good]), _LEAST))
        tangent[good] = velocity[good] / speed[good, None]
        return _Points(piece, u, value, tangent)


def _first_points(track: Track) -> tuple[IntArray, Array]:
    """Points a piece begins with: of a straight one its ends, which joints may hold down, and its middle."""
    straight = [piece.kind == "polynomial" and len(piece.control) == 2 for piece in track.pieces]
    counts = np.where(straight, 3, _CELLS + 1)
    piece = np.repeat(np.arange(counts.size), counts)
    first = np.cumsum(counts) - counts
    return piece, (np.arange(piece.size) - first[piece]) / (counts[piece] - 1.0)


def _first_cells(points: _Points) -> _Cells:
    inner = np.flatnonzero(points.piece[1:] == points.piece[:-1])
    return _Cells(points.take(inner), points.take(inner + 1))


def _alike(a: _Points, b: _Points) -> BoolArray:
    turn = largest(np.abs(a.tangent - b.tangent))
    alike: BoolArray = (np.abs(a.value - b.value) < _CHANGE) & (turn < _TURN)
    return alike


def _join(*points: _Points) -> _Points:
    piece, u, value, tangent = zip(*points, strict=True)
    return _Points(np.concatenate(piece), np.concatenate(u), np.concatenate(value), np.concatenate(tangent))
