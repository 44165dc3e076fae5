"""The curves a path may consist of; each class is built from SI floats.

Every class takes the keyword `exact`: the same numbers as Fractions, as they stand in the file and in its
unit, for certification in exact arithmetic. Without it the floats themselves count as exact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from ph_post.geometry import exact_polynomials
from ph_post.geometry.exact_polynomials import FractionRows, Fractions
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.ph import PH, ph_hermite
from ph_post.geometry.piecewise import (
    MEETS,
    ExactPiece,
    Piece,
    PiecewiseCurve,
    extent,
    polynomial_piece,
    require,
    require_length,
)
from ph_post.types import frozen
from ph_post.units import MM

ROUNDING: Final = 4.0 * float(np.finfo(np.float64).eps)
"""Relative slack for the rounding of the file's numbers to metres."""


class Arc(PiecewiseCurve):
    """An arc of a circle in the first two axes, xi in [0, 1]; start = end is a full circle.

    The radius is the mean of the distances of both ends from the centre, which may disagree by 1e-6 mm; ends
    nearer than that count as equal.

    Parameters
    ----------
    start, end, center : array_like, shape (dim,)
        Points [m]; a third coordinate is the same for all.
    turn : {"ccw", "cw"}
        Sense of rotation seen from the positive third axis.
    exact : (start, end, center), optional
        The same numbers as Fractions.

    Raises
    ------
    InputError
        Radii that disagree, a radius of zero, or points at different heights.

    Examples
    --------
    >>> arc = Arc([1, 0], [0, 1], [0, 0], "ccw")
    >>> round(arc.length, 12)
    1.570796326795
    """

    kind: ClassVar[str] = "arc"

    def __init__(
        self,
        start: ArrayLike,
        end: ArrayLike,
        center: ArrayLike,
        turn: Literal["ccw", "cw"],
        *,
        exact: FractionRows | None = None,
    ) -> None:
        self.start, self.end, self.center = frozen(start), frozen(end), frozen(center)
        self.turn = turn
        self._require_plane()
        self.radius = self._mean_radius()
        self.full = bool(np.linalg.norm(self.end - self.start) <= MEETS)
        ray = self.start - self.center
        self.first_angle = math.atan2(ray[1], ray[0])
        self.sweep = self._sweep()
        self._exact = exact
        control = np.zeros((3, len(self.start)))
        control[0] = self.center
        control[1, :2] = self.radius, self.first_angle
        control[2, 0] = self.sweep
        length = frozen([self.radius * abs(self.sweep)])
        require_length(float(length[0]))
        super().__init__((Piece(kind="arc", control=frozen(control), xi0=0.0, xi1=1.0, speed=length),))

    @property
    def exact(self) -> FractionRows:
        """Start, end and centre in exact numbers."""
        return self._exact if self._exact is not None else exact_polynomials.rows([self.start, self.end, self.center])

    def exact_pieces(self) -> tuple[None]:
        """Return (None,): a circle's extremes follow from `exact` by comparison with the centre."""
        return (None,)

    def _require_plane(self) -> None:
        heights = [float(point[2]) for point in (self.start, self.end, self.center) if len(point) > 2]
        slack = MEETS + ROUNDING * max(map(abs, heights), default=0.0)
        flat = not heights or max(heights) - min(heights) <= slack
        shown = ", ".join(f"{height / MM:.9g}" for height in heights)
        require(flat, "the arc leaves its plane", expected="one third coordinate", got=f"{shown} mm")

    def _mean_radius(self) -> float:
        first = math.dist(self.start[:2], self.center[:2])
        last = math.dist(self.end[:2], self.center[:2])
        require(min(first, last) > 0.0, "radius is zero", expected="ends away from the center")
        slack = MEETS + ROUNDING * (first + float(np.abs(self.center).max()))
        got = f"{first / MM:.9g} mm and {last / MM:.9g} mm"
        what = "start and end are not at one distance from the center"
        require(abs(first - last) <= slack, what, expected="radii equal to 1e-6 mm", got=got)
        return 0.5 * (first + last)

    def _sweep(self) -> float:
        sense = 1.0 if self.turn == "ccw" else -1.0
        if self.full:
            return sense * math.tau
        a, b = (self.start - self.center)[:2], (self.end - self.center)[:2]
        between = sense * math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])
        return sense * (between if between > 0.0 else between + math.tau)


class Composite(PiecewiseCurve):
    """Polynomial pieces that meet, as one curve; their control points are the data.

    Made for what comes by the thousand, so that a piece costs no more than its record.

    Parameters
    ----------
    pieces : sequence of Piece
        In order, each beginning in xi where the one before ends.

    Raises
    ------
    InputError
        Pieces that are not polynomial, or a length of zero.

    Examples
    --------
    >>> import numpy as np
    >>> from ph_post.geometry.piecewise import polynomial_piece
    >>> ends = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    >>> curve = Composite([polynomial_piece(ends[k : k + 2], k, k + 1) for k in (0, 1)])
    >>> curve.length, curve.domain
    (3.0, (0.0, 2.0))
    """

    kind: ClassVar[str] = "composite"

    def __init__(self, pieces: Sequence[Piece]) -> None:
        kinds = {piece.kind for piece in pieces}
        require(kinds == {"polynomial"}, "wrong pieces", expected="polynomial", got=", ".join(sorted(kinds)))
        longest = next((piece for piece in pieces if extent(piece.control) > MEETS), pieces[0])
        require_length(extent(longest.control))
        super().__init__(tuple(pieces))

    @property
    def built_exactly(self) -> bool:
        """True: the control points are the given numbers."""
        return True

    def exact_pieces(self) -> tuple[ExactPiece, ...]:
        """Return the control points in exact numbers."""
        return tuple(
            ExactPiece(kind="polynomial", control=exact_polynomials.rows(piece.control)) for piece in self.pieces
        )


__all__ = ["PH", "Arc", "Bezier", "Line", "Nurbs", "PiecewiseCurve", "Polynomial", "ph_hermite"]


class Bezier(PiecewiseCurve):
    """A Bézier curve of any degree, xi in [0, 1].

    Parameters
    ----------
    points : array_like, shape (degree + 1, dim)
        Control points [m].
    exact : tuple of tuples of Fraction, optional
        The same points.

    Raises
    ------
    InputError
        Fewer than two points, or a length of zero.

    Examples
    --------
    >>> curve = Bezier([[0, 0], [1, 2], [2, 0]])
    >>> curve.derivatives(0.5).tolist()
    [[[1.0, 1.0]]]
    """

    kind: ClassVar[str] = "bezier"

    def __init__(self, points: ArrayLike, *, exact: FractionRows | None = None) -> None:
        control = frozen(points)
        require(len(control) > 1, "too few points", expected="at least 2", got=str(len(control)))
        require_length(extent(control))
        self._exact = exact
        super().__init__((polynomial_piece(control, 0.0, 1.0),))

    @property
    def built_exactly(self) -> bool:
        """True where the control points are the given numbers."""
        return self._exact is None

    def exact_pieces(self) -> tuple[ExactPiece]:
        """Return the control points in exact numbers."""
        points = self._exact if self._exact is not None else exact_polynomials.rows(self.pieces[0].control)
        return (ExactPiece(kind="polynomial", control=points),)


class Line(Bezier):
    """A straight line between two points, xi in [0, 1].

    Parameters
    ----------
    points : array_like, shape (2, dim)
        Both ends [m].
    exact : tuple of tuples of Fraction, optional
        The same points.

    Raises
    ------
    InputError
        Not two points, or a length of zero.
    """

    kind: ClassVar[str] = "line"

    def __init__(self, points: ArrayLike, *, exact: FractionRows | None = None) -> None:
        count = len(frozen(points))
        require(count == 2, "wrong number of points", expected="2", got=str(count))
        super().__init__(points, exact=exact)


class Polynomial(PiecewiseCurve):
    """A polynomial curve in the power basis, xi over `domain`.

    Parameters
    ----------
    coefficients : sequence of sequences of float
        For every axis its power coefficients in xi, lowest first [m]; shorter ones are filled with zeros.
    domain : (float, float)
        Range of xi.
    exact : (coefficients, domain), optional
        The same numbers as Fractions.

    Raises
    ------
    InputError
        An empty domain, or a length of zero.

    Examples
    --------
    >>> curve = Polynomial([[0.0, 1.0], [0.0, 0.0, 1.0]], (0.0, 2.0))
    >>> curve.derivatives(1.0, 1).tolist()
    [[[1.0, 1.0]], [[1.0, 2.0]]]
    """

    kind: ClassVar[str] = "polynomial"

    def __init__(
        self,
        coefficients: Any,
        domain: tuple[float, float] = (0.0, 1.0),
        *,
        exact: tuple[FractionRows, Fractions] | None = None,
    ) -> None:
        require(domain[0] < domain[1], "empty domain", expected="first < last", got=f"{list(domain)}")
        # Converted exactly and rounded once: far from the domain's origin the power basis cancels badly.
        control = exact_polynomials.floats(
            _bernstein(exact_polynomials.rows(coefficients), exact_polynomials.rows([domain])[0])
        )
        require_length(extent(control))
        self._exact = exact
        self._given = (coefficients, domain)
        super().__init__((polynomial_piece(control, *domain),))

    def exact_pieces(self) -> tuple[ExactPiece]:
        """Return the Bernstein control points in exact numbers."""
        coefficients, domain = self._exact if self._exact is not None else self._given
        control = _bernstein(exact_polynomials.rows(coefficients), exact_polynomials.rows([domain])[0])
        return (ExactPiece(kind="polynomial", control=control),)


def _bernstein(coefficients: FractionRows, domain: Fractions) -> FractionRows:
    """Control points of a polynomial curve, constant at least of degree 1."""
    count = max(2, *(len(axis) for axis in coefficients))
    filled = [axis + (exact_polynomials.ZERO,) * (count - len(axis)) for axis in coefficients]
    return exact_polynomials.columns([exact_polynomials.from_power(axis, (domain[0], domain[1])) for axis in filled])
