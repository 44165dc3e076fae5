"""What all curves share: everything but their construction follows from their pieces."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from ph_post.errors import InputError
from ph_post.geometry import frenet
from ph_post.geometry.piece import ExactPiece, Piece, PieceSet
from ph_post.types import Array, IntArray, frozen
from ph_post.units import MM

if TYPE_CHECKING:
    from ph_post.geometry.track import Track


MEETS: Final = 1e-6 * MM
"""Two points nearer than this are one, as the path file's contract has it [m]."""


class PiecewiseCurve:
    """A curve made of analytic pieces, as function of the parameter xi that the path file has.

    Derived classes build the pieces; all lengths are in metres.

    Parameters
    ----------
    pieces : tuple of Piece
        In order; each begins in xi where the one before ends.
    """

    kind: ClassVar[str]

    def __init__(self, pieces: tuple[Piece, ...]) -> None:
        self.pieces = pieces

    @property
    def dimension(self) -> int:
        """2 or 3."""
        first = self.pieces[0]
        return int(first.control.shape[1]) - (first.kind == "rational")

    @property
    def domain(self) -> tuple[float, float]:
        """Range of the parameter xi."""
        return self.pieces[0].xi0, self.pieces[-1].xi1

    @property
    def built_exactly(self) -> bool:
        """Whether the pieces' control points are the given numbers themselves, nothing rounded."""
        return False

    def exact_pieces(self) -> tuple[ExactPiece | None, ...]:
        """Return the pieces in exact numbers, None for an arc."""
        raise NotImplementedError

    def derivatives(self, xi: ArrayLike, order: int = 0) -> Array:
        """Values and derivatives with respect to xi, shape (order + 1, n, dimension) [m].

        At a knot where pieces meet, the later piece answers.
        """
        piece, u = self._to_piece(np.atleast_1d(np.asarray(xi, dtype=np.float64)))
        values = self._set.derivatives(piece, u, order)
        first, last = self._breaks
        width = (last - first)[piece]
        for k in range(1, order + 1):
            values[k] /= width[:, None] ** k
        return values

    def speed(self, xi: ArrayLike, order: int = 0) -> Array:
        """Parametric speed ds/dxi and its derivatives, shape (order + 1, n), order <= 3."""
        return frenet.speed(self.derivatives(xi, order + 1))

    def curvature(self, xi: ArrayLike) -> Array:
        """Curvature [1/m]: signed in the plane (Eq. 2), not negative in space."""
        return frenet.curvature(self.derivatives(xi, 2))

    @property
    def length(self) -> float:
        """Arc length of the whole curve [m]."""
        return self.track.length

    def arc_length(self, xi: ArrayLike) -> Array:
        """Arc length [m] from the curve's beginning to `xi`."""
        piece, u = self._to_piece(np.atleast_1d(np.asarray(xi, dtype=np.float64)))
        return self.track.arc_length(piece, u)

    def parameter(self, s: ArrayLike) -> Array:
        """Parameter xi at arc length `s` [m], the inverse of :meth:`arc_length`."""
        piece, u = self.track.locate(np.atleast_1d(np.asarray(s, dtype=np.float64)))
        return self.track.to_xi(piece, u)[1]

    @cached_property
    def track(self) -> Track:
        """The curve as a function of arc length."""
        from ph_post.geometry.track import Track

        return Track.from_curves([self])

    @cached_property
    def _set(self) -> PieceSet:
        return PieceSet(self.pieces)

    @cached_property
    def _breaks(self) -> tuple[Array, Array]:
        """Where the pieces begin and end in xi."""
        return frozen([piece.xi0 for piece in self.pieces]), frozen([piece.xi1 for piece in self.pieces])

    def _to_piece(self, xi: Array) -> tuple[IntArray, Array]:
        first, last = self._breaks
        number = np.clip(np.searchsorted(first, xi, side="right") - 1, 0, first.size - 1)
        u = (xi - first[number]) / (last[number] - first[number])
        return number, np.clip(u, 0.0, 1.0)


def require(holds: bool, what: str, *, expected: str = "", got: str = "") -> None:
    """Refuse impossible data; the reader says where it stands.

    Raises
    ------
    InputError
        Unless `holds`.
    """
    if not holds:
        raise InputError("", what, expected=expected, got=got)


def require_length(size: float) -> None:
    """Refuse a curve that goes nowhere: `size` [m] is its extent or its length."""
    require(
        size > MEETS, "zero length", expected="points farther apart than 1e-6 mm", got=f"{size / MM:.3g} mm"
    )


def extent(points: Array) -> float:
    """Return how far points lie from the first of them, along any axis [m]."""
    return float(np.abs(points - points[0]).max())


def polynomial_piece(control: Array, xi0: float, xi1: float, speed: Array | None = None) -> Piece:
    """Make a polynomial piece; one of degree 1 has a constant speed."""
    if speed is None and len(control) == 2:
        speed = frozen([np.linalg.norm(control[1] - control[0])])
    return Piece(kind="polynomial", control=control, xi0=float(xi0), xi1=float(xi1), speed=speed)
