"""The curves a path may be made of; each class is built from SI floats.

Every class takes the keyword `exact`: the same numbers as Fractions, as they stand in the file and in its
unit, for certification in exact arithmetic. Without it the floats themselves count as exact.
"""

from __future__ import annotations

from typing import Any, ClassVar

from numpy.typing import ArrayLike

from ph_post.geometry import fractional
from ph_post.geometry.arc import Arc
from ph_post.geometry.base import PiecewiseCurve, extent, polynomial_piece, require, require_length
from ph_post.geometry.fractional import FractionRows, Fractions
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.ph import PH, ph_hermite
from ph_post.geometry.piece import ExactPiece
from ph_post.types import frozen

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
        """Whether the control points are the given numbers themselves."""
        return self._exact is None

    def exact_pieces(self) -> tuple[ExactPiece]:
        """Return the control points in exact numbers."""
        points = self._exact if self._exact is not None else fractional.rows(self.pieces[0].control)
        return (ExactPiece(kind="polynomial", control=points),)


class Line(PiecewiseCurve):
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
        control = frozen(points)
        require(len(control) == 2, "wrong number of points", expected="2", got=str(len(control)))
        require_length(extent(control))
        self._exact = exact
        super().__init__((polynomial_piece(control, 0.0, 1.0),))

    @property
    def built_exactly(self) -> bool:
        """Whether the control points are the given numbers themselves."""
        return self._exact is None

    def exact_pieces(self) -> tuple[ExactPiece]:
        """Return both ends in exact numbers."""
        points = self._exact if self._exact is not None else fractional.rows(self.pieces[0].control)
        return (ExactPiece(kind="polynomial", control=points),)


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
        control = fractional.floats(_bernstein(fractional.rows(coefficients), fractional.rows([domain])[0]))
        require_length(extent(control))
        self._exact = exact
        self._given = (coefficients, domain)
        super().__init__((polynomial_piece(control, *domain),))

    def exact_pieces(self) -> tuple[ExactPiece]:
        """Return the Bernstein control points in exact numbers."""
        coefficients, domain = self._exact if self._exact is not None else self._given
        control = _bernstein(fractional.rows(coefficients), fractional.rows([domain])[0])
        return (ExactPiece(kind="polynomial", control=control),)


def _bernstein(coefficients: FractionRows, domain: Fractions) -> FractionRows:
    """Control points of a polynomial curve, constant at least of degree 1."""
    count = max(2, *(len(axis) for axis in coefficients))
    filled = [axis + (fractional.ZERO,) * (count - len(axis)) for axis in coefficients]
    return fractional.columns([fractional.from_power(axis, (domain[0], domain[1])) for axis in filled])
