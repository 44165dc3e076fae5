"""The path as one function of arc length."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ph_post.errors import InputError
from ph_post.geometry import ends, frenet
from ph_post.geometry.arclength import ArcLength
from ph_post.geometry.base import PiecewiseCurve
from ph_post.geometry.piece import Group, Piece, PieceSet
from ph_post.types import Array, Curve, IntArray, Path, Segment, frozen


class Track:
    """A path cut into analytic pieces, and known by arc length.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    path : Path
    dimension : int
        2 or 3.
    closed : bool
        Whether the path is run as a loop.
    length : float
        Arc length [m].
    pieces : tuple of Piece
    groups : tuple of Group
        The same pieces by kind and degree, their control points in one array each.
    starts : Array, shape (pieces + 1,)
        Arc length at the pieces' ends [m].
    segment : IntArray, shape (pieces,)
        The path's segment that each piece belongs to.
    xi0, xi1 : Array, shape (pieces,)
        Each piece's part of its segment's domain.

    Examples
    --------
    >>> from ph_post.geometry.curves import Line
    >>> track = Track.from_curves([Line([[0, 0], [3, 0]]), Line([[3, 0], [3, 1]])])
    >>> piece, u = track.locate(np.array([1.5, 3.5]))
    >>> track.derivatives(piece, u, 0).tolist()
    [[[1.5, 0.0], [3.0, 0.5]]]
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        curves = [_piecewise(segment.curve) for segment in path.segments]
        self._set = PieceSet(piece for curve in curves for piece in curve.pieces)
        counts = [len(curve.pieces) for curve in curves]
        self.segment: IntArray = np.repeat(np.arange(len(curves), dtype=np.int64), counts)
        self.xi0 = frozen([piece.xi0 for piece in self.pieces])
        self.xi1 = frozen([piece.xi1 for piece in self.pieces])
        self._arc_length = ArcLength(self.pieces, self.groups)
        self.starts = self._arc_length.starts
        self.length = float(self.starts[-1])

    @classmethod
    def from_curves(cls, curves: Iterable[Curve], closed: bool = False) -> Track:
        """Make the track of curves that stand in no path file."""
        segments = tuple(Segment(curve=curve) for curve in curves)
        axes = ("X", "Y", "Z")[: segments[0].curve.dimension]
        return cls(Path(name="", source="", axes=axes, feed=1.0, closed=closed, segments=segments))

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The analytic pieces in the order in which they are run."""
        return self._set.pieces

    @property
    def groups(self) -> tuple[Group, ...]:
        """The pieces by kind and degree."""
        return self._set.groups

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self._set.dimension

    @property
    def closed(self) -> bool:
        """Whether the path is run as a loop."""
        return self.path.closed

    def locate(self, s: Array) -> tuple[IntArray, Array]:
        """Piece and u at arc length `s` [m], the inverse of :meth:`arc_length`.

        `s` is clipped to the path; at a joint the later piece answers.
        """
        return self._arc_length.locate(np.asarray(s, dtype=np.float64))

    def arc_length(self, piece: IntArray, u: Array) -> Array:
        """Arc length from the path's beginning [m]."""
        return self._arc_length.at(np.asarray(piece), np.asarray(u, dtype=np.float64))

    def derivatives(self, piece: IntArray, u: Array, order: int = 0) -> Array:
        """Values and derivatives with respect to u, shape (order + 1, n, dim) [m]."""
        return self._set.derivatives(np.asarray(piece), np.asarray(u, dtype=np.float64), order)

    def arc_derivatives(self, piece: IntArray, u: Array, order: int = 0) -> Array:
        """Values and derivatives with respect to arc length, shape (order + 1, n, dim), order <= 4.

        Only where the speed does not vanish.
        """
        return frenet.arc_derivatives(self.derivatives(piece, u, order))

    def to_xi(self, piece: IntArray, u: Array) -> tuple[IntArray, Array]:
        """Segment and its parameter xi."""
        width = self.xi1[piece] - self.xi0[piece]
        return self.segment[piece], np.where(u >= 1.0, self.xi1[piece], self.xi0[piece] + u * width)

    def tangents(self) -> tuple[Array, Array]:
        """One-sided unit tangents at both ends of every piece, shape (pieces, dim) each.

        Where the speed vanishes at an end, the first derivative that does not tells the direction.
        """
        return ends.tangents(self._set, 0), ends.tangents(self._set, 1)

    def end_curvatures(self) -> tuple[Array, Array]:
        """One-sided d²r/ds² [1/m] at both ends of every piece, shape (pieces, dim) each.

        Infinite at some ends where the speed vanishes.
        """
        return ends.curvatures(self._set, 0), ends.curvatures(self._set, 1)


def _piecewise(curve: Curve) -> PiecewiseCurve:
    if not isinstance(curve, PiecewiseCurve):
        raise InputError("", "a curve without pieces", expected="a curve of ph_post.geometry.curves")
    return curve
