"""Circular arcs in the plane of the first two axes."""

from __future__ import annotations

import math
from typing import ClassVar, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from ph_post.geometry import fractional
from ph_post.geometry.base import MEETS, PiecewiseCurve, require, require_length
from ph_post.geometry.fractional import FractionRows
from ph_post.geometry.piece import Piece
from ph_post.types import Array, frozen
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
        self.first_angle = _angle(self.start - self.center)
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
        return (
            self._exact if self._exact is not None else fractional.rows([self.start, self.end, self.center])
        )

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


def _angle(ray: Array) -> float:
    return math.atan2(ray[1], ray[0])
