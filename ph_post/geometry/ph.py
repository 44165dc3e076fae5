"""Pythagorean-hodograph curves: polynomial curves whose parametric speed is a polynomial too.

References
----------
.. [1] Farouki, Pythagorean-Hodograph Curves: Algebra and Geometry Inseparable, Springer 2008.
.. [2] Farouki, Neff, Hermite interpolation by Pythagorean hodograph quintics,
   Math. Comp. 64 (1995) 1589-1609.
"""

from __future__ import annotations

import cmath
import math
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ph_post.geometry import bernstein, exact_polynomials
from ph_post.geometry.exact_polynomials import FractionRows, Fractions
from ph_post.geometry.piecewise import ExactPiece, PiecewiseCurve, polynomial_piece, require, require_length
from ph_post.types import Array, frozen

Form = tuple[tuple[int, int, int], ...]
"""A quadratic form of the preimage: terms (factor, i, j) standing for factor * p_i * p_j."""

PLANAR: tuple[Form, ...] = (((1, 0, 0), (-1, 1, 1)), ((2, 0, 1),))
SPATIAL: tuple[Form, ...] = (
    ((1, 0, 0), (1, 1, 1), (-1, 2, 2), (-1, 3, 3)),
    ((2, 0, 3), (2, 1, 2)),
    ((2, 1, 3), (-2, 0, 2)),
)
HODOGRAPHS = {2: PLANAR, 4: SPATIAL}
"""Hodograph by number of preimage components: u, v and u, v, p, q as in the path file's description."""


class PH(PiecewiseCurve):
    """A Pythagorean-hodograph curve of any degree, planar or spatial, xi in [0, 1].

    Planar: x' = u² - v², y' = 2uv, speed u² + v². Spatial: x' = u² + v² - p² - q², y' = 2(uq + vp),
    z' = 2(vq - up), speed u² + v² + p² + q².

    Parameters
    ----------
    start : array_like, shape (dim,)
        First point [m].
    preimage : array_like, shape (m + 1, 2) or (m + 1, 4)
        Bernstein coefficients [m^(1/2)] of (u, v) or (u, v, p, q); the curve has degree 2m + 1.
    exact : (start, preimage), optional
        The same numbers as Fractions, in one unit of length and its root.

    Raises
    ------
    InputError
        Wrong number of components, or a length of zero.

    Examples
    --------
    >>> curve = PH([0, 0], [[1, 0], [1, 1]])
    >>> round(curve.length, 12)
    1.333333333333
    """

    kind: ClassVar[str] = "ph"

    def __init__(
        self,
        start: ArrayLike,
        preimage: ArrayLike,
        *,
        exact: tuple[Fractions, FractionRows] | None = None,
    ) -> None:
        self.start = frozen(start)
        self.preimage = frozen(preimage)
        components = {2: 2, 3: 4}[len(self.start)]
        found = self.preimage.shape[1]
        what = "wrong number of preimage components"
        require(found == components, what, expected=str(components), got=str(found))
        self._exact = exact
        parts = self.preimage.T
        squares = [bernstein.product(part, part) for part in parts]
        control = [_integrated(first, form, parts) for first, form in zip(self.start, self._forms, strict=True)]
        speed = frozen(np.sum(squares, axis=0))
        require_length(float(speed.mean()))
        super().__init__((polynomial_piece(frozen(np.stack(control, axis=1)), 0.0, 1.0, speed),))

    @property
    def _forms(self) -> tuple[Form, ...]:
        return HODOGRAPHS[self.preimage.shape[1]]

    def exact_pieces(self) -> tuple[ExactPiece]:
        """Return the control points that follow exactly from the preimage."""
        given = self._exact or (
            exact_polynomials.rows([self.start])[0],
            exact_polynomials.rows(self.preimage),
        )
        start, parts = given[0], exact_polynomials.columns(given[1])
        axes = []
        for first, form in zip(start, self._forms, strict=True):
            terms = [(factor, exact_polynomials.product(parts[i], parts[j])) for factor, i, j in form]
            axes.append(exact_polynomials.integrate(exact_polynomials.combine(*terms), first))
        return (ExactPiece(kind="polynomial", control=exact_polynomials.columns(axes)),)


def _integrated(first: float, form: Form, parts: Array) -> Array:
    """One coordinate: the integral of its quadratic form of the preimage."""
    hodograph = sum(factor * bernstein.product(parts[i], parts[j]) for factor, i, j in form)
    return first + bernstein.integrate(hodograph)


def ph_hermite(points: ArrayLike, derivatives: ArrayLike) -> PH:
    """Interpolate two points and the derivatives there by a planar PH quintic.

    Of the four that there are [2]_, the one whose tangent turns least in all, ∫ |κ| ds.

    Parameters
    ----------
    points, derivatives : array_like, shape (2, 2)
        End points [m] and end derivatives with respect to xi [m].

    Raises
    ------
    InputError
        Equal points, or a derivative that is zero.

    Examples
    --------
    >>> curve = ph_hermite([[0, 0], [3, 0]], [[3, 0], [3, 0]])
    >>> round(curve.length, 12)
    3.0
    """
    p, d = np.asarray(points, dtype=np.float64), np.asarray(derivatives, dtype=np.float64)
    require(bool(np.any(p[0] != p[1])), "zero length", expected="points that differ")
    require(bool(np.all(np.any(d != 0.0, axis=1))), "a derivative is zero", expected="a direction at each end")
    chord = complex(*(p[1] - p[0]))
    d0, d1 = complex(*d[0]), complex(*d[1])
    w0 = cmath.sqrt(d0)
    solutions = []
    for w2 in (cmath.sqrt(d1), -cmath.sqrt(d1)):
        root = cmath.sqrt(120.0 * chord - 15.0 * (d0 + d1) + 10.0 * w0 * w2)
        solutions += [(w0, 0.25 * (-3.0 * (w0 + w2) + sign * root), w2) for sign in (1.0, -1.0)]
    best = min(solutions, key=absolute_rotation)
    return PH(p[0], [[w.real, w.imag] for w in best])


def absolute_rotation(preimage: tuple[complex, complex, complex]) -> float:
    """∫ |κ| ds [rad] of the planar PH quintic with the complex preimage w: twice the variation of arg w.

    The tangent turns one way between the roots of u v' - u' v, and over each such stretch arg w changes by
    what its linear factors contribute, each less than half a turn.

    Examples
    --------
    >>> absolute_rotation((1 + 0j, 1 + 0j, 1 + 0j))
    0.0
    """
    w0, w1, w2 = preimage
    power = np.array([w0 - 2.0 * w1 + w2, 2.0 * (w1 - w0), w0])
    zeros = np.roots(power).astype(np.complex128)
    # Im(conj(w) w') for w = a t² + b t + c
    a, b, c = power
    wedge = [(b.conjugate() * a).imag, 2.0 * (c.conjugate() * a).imag, (c.conjugate() * b).imag]
    turns = sorted(
        t.real for t in np.roots(wedge).astype(np.complex128).tolist() if t.imag == 0.0 and 0.0 < t.real < 1.0
    )
    return math.fsum(abs(_turn(zeros, *stretch)) for stretch in pairwise([0.0, *turns, 1.0]))


def _turn(zeros: NDArray[np.complex128], first: float, last: float) -> float:
    """Change of 2 arg w, w having these zeros, from t = `first` to `last`."""
    before, after = first - zeros, last - zeros
    keep = (before != 0.0) & (after != 0.0)
    ratio = after[keep] / before[keep]
    return 2.0 * math.fsum(np.angle(ratio).tolist())
