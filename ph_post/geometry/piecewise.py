"""Analytic pieces and the curves that consist of them.

A piece has one local parameter u in [0, 1]. Pieces of one kind and degree are gathered in a group, whose
control points stand in one array, so that every operation acts on all of them at once. A curve is defined by
its pieces: derived classes only construct them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Final, Literal

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from ph_post.errors import InputError
from ph_post.geometry import frenet
from ph_post.types import Array, IntArray, frozen
from ph_post.units import MM

if TYPE_CHECKING:
    from ph_post.geometry.track import Track


PieceKind = Literal["polynomial", "rational", "arc"]

CHUNK: Final = 1 << 13
"""Rows evaluated at a time: what is at work stays in the processor's cache."""


class Piece(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One analytic stretch of a curve, u in [0, 1], xi = xi0 + u (xi1 - xi0).

    Parameters
    ----------
    kind : {"polynomial", "rational", "arc"}
    control : Array
        Polynomial: Bernstein control points, shape (d + 1, dim) [m]. Rational: homogeneous control points
        (w P, w), shape (d + 1, dim + 1). Arc: shape (3, dim), the centre; then radius [m] and first angle
        [rad]; then sweep [rad], positive counterclockwise; padded with zeros.
    xi0, xi1 : float
        The piece's part of the curve's domain.
    speed : Array or None
        Bernstein coefficients of ds/du [m] where it is a polynomial (line, arc, PH).
    """

    kind: PieceKind
    control: Array
    xi0: float
    xi1: float
    speed: Array | None = None


def places(piece: Piece) -> Array:
    """Return the control points of a polynomial or rational piece as places [m]."""
    return piece.control if piece.kind == "polynomial" else piece.control[:, :-1] / piece.control[:, -1:]


class ExactPiece(msgspec.Struct, frozen=True, kw_only=True):
    """A polynomial or rational piece in exact numbers, control points as in :class:`Piece`, in any unit."""

    kind: PieceKind
    control: tuple[tuple[Fraction, ...], ...]


class Group(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Pieces of one kind and degree.

    `index` (m,) are their numbers, `control` (m, d + 1, k) is as in :class:`Piece`.
    An arc counts as degree 2: it has three rows.
    """

    kind: PieceKind
    degree: int
    index: IntArray
    control: Array


def stacked(arrays: Iterable[Array]) -> Array:
    """Concatenate small arrays, flattened, to one read-only array (n,)."""
    # By way of bytes: numpy's own way takes several times as long for thousands of arrays.
    return np.frombuffer(b"".join([array.tobytes() for array in arrays]))


def group_pieces(pieces: Sequence[Piece]) -> tuple[Group, ...]:
    """Gather pieces by kind and degree, in the order in which the kinds appear."""
    members: dict[tuple[PieceKind, int], list[int]] = {}
    for number, piece in enumerate(pieces):
        members.setdefault((piece.kind, piece.control.shape[0]), []).append(number)
    groups = []
    for (kind, rows), numbers in members.items():
        control = stacked([pieces[number].control for number in numbers]).reshape(len(numbers), rows, -1)
        index = np.array(numbers, dtype=np.int64)
        groups.append(Group(kind=kind, degree=rows - 1, index=index, control=control))
    return tuple(groups)


class Evaluator:
    """Values and derivatives of the pieces of one group."""

    def __init__(self, group: Group) -> None:
        self.group = group
        self._nets: list[Array] = []

    def derivatives(self, row: IntArray, u: Array, order: int) -> Array:
        """Values and derivatives with respect to u of the group's pieces `row`, shape (order + 1, n, dim)."""
        if self.group.kind == "arc":
            return _arc_derivatives(self.group.control, row, u, order)
        values = np.stack([self._net_values(k, row, u) for k in range(order + 1)])
        return values if self.group.kind == "polynomial" else divide(values)

    def _net_values(self, order: int, row: IntArray, u: Array) -> Array:
        """Evaluate the derivative of one order of the control points."""
        k, n = self.group.control.shape[2], self.group.degree - order
        values = np.zeros((u.size, k))
        if n < 0:
            return values
        net = self._net(order)
        up, down = [np.ones_like(u)], [np.ones_like(u)]
        for _ in range(n):
            up.append(up[-1] * u)
            down.append(down[-1] * (1.0 - u))
        for j in range(n + 1):
            weight = math.comb(n, j) * up[j] * down[n - j]
            for axis in range(k):
                values[:, axis] += weight * net[j, axis].take(row)
        return values

    def _net(self, order: int) -> Array:
        """Control points of a derivative, coefficient first, so that a row is gathered column by column."""
        while len(self._nets) <= order:
            k = len(self._nets)
            scale = math.perm(self.group.degree, k)
            net = scale * np.diff(self.group.control, n=k, axis=1)
            self._nets.append(np.ascontiguousarray(net.transpose(1, 2, 0)))
        return self._nets[order]


def divide(homogeneous: Array) -> Array:
    """Compute derivatives of P / w from those of (w P, w), shape (order + 1, ..., dim + 1) (Leibniz)."""
    weight = homogeneous[..., -1:]
    quotient = np.empty_like(homogeneous[..., :-1])
    for k in range(len(homogeneous)):
        rest = homogeneous[k, ..., :-1].copy()
        for i in range(1, k + 1):
            rest -= math.comb(k, i) * weight[i] * quotient[k - i]
        quotient[k] = rest / weight[0]
    return quotient


def _arc_derivatives(control: Array, row: IntArray, u: Array, order: int) -> Array:
    center = control[:, 0].take(row, axis=0)
    radius, first, sweep = (control[:, i, k].take(row) for i, k in ((1, 0), (1, 1), (2, 0)))
    angle = first + sweep * u
    cosine, sine = np.cos(angle), np.sin(angle)
    values = np.zeros((order + 1, *center.shape))
    values[0] = center
    scale = radius
    for k in range(order + 1):
        values[k, :, 0] += scale * cosine
        values[k, :, 1] += scale * sine
        cosine, sine, scale = -sine, cosine, scale * sweep
    return values


class PieceSet:
    """Pieces in their order, and their values and derivatives.

    Parameters
    ----------
    pieces : iterable of Piece
    """

    def __init__(self, pieces: Iterable[Piece]) -> None:
        self.pieces = tuple(pieces)
        self.groups = group_pieces(self.pieces)
        self._evaluators = [Evaluator(group) for group in self.groups]
        self._group = np.zeros(len(self.pieces), dtype=np.int64)
        self._row = np.zeros(len(self.pieces), dtype=np.int64)
        for number, group in enumerate(self.groups):
            self._group[group.index] = number
            self._row[group.index] = np.arange(group.index.size)

    @property
    def dimension(self) -> int:
        """2 or 3."""
        first = self.groups[0]
        return int(first.control.shape[2]) - (first.kind == "rational")

    def derivatives(self, piece: IntArray, u: Array, order: int = 0) -> Array:
        """Values and derivatives with respect to u, shape (order + 1, n, dim) [m]."""
        values = np.empty((order + 1, u.size, self.dimension))
        for first in range(0, u.size, CHUNK):
            part = slice(first, first + CHUNK)
            self._chunk(piece[part], u[part], values[:, part])
        return values

    def _chunk(self, piece: IntArray, u: Array, values: Array) -> None:
        order = len(values) - 1
        if len(self.groups) == 1:
            values[...] = self._evaluators[0].derivatives(piece, u, order)
            return
        group, row = self._group[piece], self._row[piece]
        for number, evaluator in enumerate(self._evaluators):
            mine = np.flatnonzero(group == number)
            if mine.size:
                found = evaluator.derivatives(row[mine], u[mine], order)
                # Column by column: numpy takes several times as long for rows of two or three numbers.
                for k in range(order + 1):
                    for axis in range(self.dimension):
                        values[k, :, axis][mine] = found[k, :, axis]


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
        """True where the pieces' control points are the given numbers, none rounded."""
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
        """Starts and ends of the pieces in xi."""
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
    require(size > MEETS, "zero length", expected="points farther apart than 1e-6 mm", got=f"{size / MM:.3g} mm")


def extent(points: Array) -> float:
    """Return how far points lie from the first of them at most [m]."""
    return float(np.linalg.norm(points - points[0], axis=-1).max())


def polynomial_piece(control: Array, xi0: float, xi1: float, speed: Array | None = None) -> Piece:
    """Make a polynomial piece from control points (n, dim) [m]; a piece of degree 1 has a constant speed."""
    if speed is None and len(control) == 2:
        speed = frozen([np.linalg.norm(control[1] - control[0])])
    return Piece(kind="polynomial", control=control, xi0=float(xi0), xi1=float(xi1), speed=speed)
