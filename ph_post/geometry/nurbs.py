"""NURBS, cut at their knots into Bézier pieces by exact knot insertion.

References
----------
.. [1] Boehm, Inserting new knots into B-spline curves, Computer-Aided Design 12 (1980) 199-201.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter
from itertools import compress, pairwise
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from ph_post.geometry import exact_polynomials
from ph_post.geometry.exact_polynomials import FractionRows, Fractions
from ph_post.geometry.piecewise import (
    MEETS,
    ExactPiece,
    Piece,
    PieceKind,
    PiecewiseCurve,
    extent,
    places,
    polynomial_piece,
    require,
    require_length,
)
from ph_post.types import Array, frozen
from ph_post.units import MM

STANDSTILL: Final = 1e-3 * MEETS
"""A span that is no larger stands still [m]: repeated points, but for rounding."""

Span = tuple[Fractions, FractionRows]
"""A piece: both its knots, and its (homogeneous) Bézier points."""


class Nurbs(PiecewiseCurve):
    """A (rational) B-spline curve; xi over the knots, for an unclamped one over [t_p, t_n].

    Spans on which it stands still are left out.

    Parameters
    ----------
    degree : int
        p >= 1.
    knots : array_like, shape (n + p + 1,)
        Numbers that do not fall, none more than p + 1 times.
    points : array_like, shape (n, dim)
        Control points [m].
    weights : array_like, shape (n,), optional
        Positive numbers.
    exact : (knots, points, weights or None), optional
        The same numbers as Fractions.

    Raises
    ------
    InputError
        A knot vector of the wrong length or order, weights that are not positive, a curve that comes apart
        at a knot, or a length of zero.

    Examples
    --------
    >>> curve = Nurbs(1, [0, 0, 1, 2, 2], [[0, 0], [1, 0], [1, 1]])
    >>> round(curve.length, 12), len(curve.pieces)
    (2.0, 2)
    """

    kind: ClassVar[str] = "nurbs"

    def __init__(
        self,
        degree: int,
        knots: ArrayLike,
        points: ArrayLike,
        weights: ArrayLike | None = None,
        *,
        exact: tuple[Fractions, FractionRows, Fractions | None] | None = None,
    ) -> None:
        self.degree = degree
        self.knots, self.points = frozen(knots), frozen(points)
        self.weights = None if weights is None else frozen(weights)
        _require_knots(degree, self.knots, len(self.points))
        _require_weights(self.weights, len(self.points))
        self._exact = exact
        spans = self._spans(self.knots, self.points, self.weights)
        pieces = [self._piece(*span) for span in spans]
        self._moving = [extent(places(piece)) > STANDSTILL for piece in pieces]
        pieces = list(compress(pieces, self._moving))
        require_length(max((extent(places(piece)) for piece in pieces), default=0.0))
        _require_whole(pieces)
        super().__init__(tuple(pieces))

    @property
    def domain(self) -> tuple[float, float]:
        """Range of the parameter xi, stretches where the curve stands still included."""
        return float(self.knots[self.degree]), float(self.knots[len(self.points)])

    @property
    def _piece_kind(self) -> PieceKind:
        """Equal weights cancel: the curve is polynomial."""
        rational = self.weights is not None and np.any(self.weights != self.weights[0])
        return "rational" if rational else "polynomial"

    def exact_pieces(self) -> tuple[ExactPiece, ...]:
        """Return the Bézier pieces in exact numbers."""
        given = self._exact if self._exact is not None else (self.knots, self.points, self.weights)
        spans = compress(self._spans(*given), self._moving)
        return tuple(ExactPiece(kind=self._piece_kind, control=control) for _, control in spans)

    def _piece(self, ends: Fractions, control: FractionRows) -> Piece:
        t0, t1 = map(float, ends)
        rounded = exact_polynomials.floats(control)
        if self._piece_kind == "polynomial":
            return polynomial_piece(rounded, t0, t1)
        return Piece(kind="rational", control=rounded, xi0=t0, xi1=t1)

    def _spans(self, knots: Any, points: Any, weights: Any) -> list[Span]:
        """Bézier pieces in exact numbers."""
        exact_knots, exact_points = exact_polynomials.rows([knots])[0], exact_polynomials.rows(points)
        if self._piece_kind == "rational":
            factors = exact_polynomials.rows([weights])[0]
            homogeneous = zip(factors, exact_points, strict=True)
            exact_points = tuple((*(w * x for x in point), w) for w, point in homogeneous)
        return bezier_spans(self.degree, exact_knots, exact_points)


def bezier_spans(degree: int, knots: Fractions, points: FractionRows) -> list[Span]:
    """Cut a B-spline into its Bézier pieces: every knot is inserted until it stands `degree` times [1]_.

    Examples
    --------
    >>> from ph_post.geometry.exact_polynomials import rows
    >>> spans = bezier_spans(2, rows([[0, 0, 0, 1, 2, 2, 2]])[0], rows([[0], [2], [4], [6]]))
    >>> [[int(x) for (x,) in control] for _, control in spans]
    [[0, 2, 3], [3, 4, 6]]
    """
    first, last = knots[degree], knots[len(points)]
    t, q = list(knots), list(points)
    for knot, times in sorted(Counter(knots).items()):
        if first <= knot <= last:
            for _ in range(degree - times):
                _insert(degree, t, q, knot)
    ends = [k for k in range(len(t) - 1) if first <= t[k] < t[k + 1] <= last]
    return [((t[k], t[k + 1]), tuple(q[k - degree : k + 1])) for k in ends]


def _insert(degree: int, t: list[Any], q: list[Fractions], knot: Any) -> None:
    """Insert `knot` once into the knots `t` and the points `q`."""
    last = bisect_right(t, knot) - 1
    times = last + 1 - bisect_left(t, knot)
    new = []
    for i in range(last - degree + 1, last - times + 1):
        alpha = (knot - t[i]) / (t[i + degree] - t[i])
        new.append(tuple(alpha * b + (1 - alpha) * a for a, b in zip(q[i - 1], q[i], strict=True)))
    q[last - degree + 1 : last - times] = new
    t.insert(last + 1, knot)


def _require_knots(degree: int, knots: Array, count: int) -> None:
    require(degree >= 1, "degree is too low", expected="at least 1", got=str(degree))
    expected = f"at least {degree + 1}"
    require(count > degree, "too few points for the degree", expected=expected, got=str(count))
    expected = f"{count + degree + 1} (points + degree + 1)"
    require(len(knots) == count + degree + 1, "wrong number of knots", expected=expected, got=str(len(knots)))
    falls = np.flatnonzero(np.diff(knots) < 0.0)
    got = "" if falls.size == 0 else f"{knots[falls[0]]:.9g} before {knots[falls[0] + 1]:.9g}"
    require(falls.size == 0, "knots fall", expected="knots that do not fall", got=got)
    knot, times = Counter(knots.tolist()).most_common(1)[0]
    what = f"knot {knot:.9g} is repeated too often"
    require(times <= degree + 1, what, expected=f"at most {degree + 1} times", got=str(times))
    got = f"{knots[degree]:.9g} twice"
    require(knots[degree] < knots[count], "the knots span nothing", expected="t_p < t_n", got=got)


def _require_weights(weights: Array | None, count: int) -> None:
    if weights is None:
        return
    require(len(weights) == count, "wrong number of weights", expected=str(count), got=str(len(weights)))
    lowest = float(weights.min())
    require(lowest > 0.0, "a weight is not positive", expected="> 0", got=f"{lowest:.9g}")


def _require_whole(pieces: list[Piece]) -> None:
    """Refuse a curve that a knot of multiplicity degree + 1 tears."""
    for before, after in pairwise(pieces):
        gap = float(np.linalg.norm(places(before)[-1] - places(after)[0]))
        what = f"the curve comes apart at knot {after.xi0:.9g}"
        require(gap <= MEETS, what, expected="ends that meet to 1e-6 mm", got=f"a gap of {gap / MM:.3g} mm")
