"""Turned, scaled and mirrored coordinates: of Fanuc G68, G51 and G51.1, of other controls those of a plane.

FANUC Series 30i/31i/32i-MODEL B, Operator's Manual for Machining Center System, B-64484EN-2, and Series 0i-F,
B-64604EN-2: "Coordinate system rotation", "Scaling", "Programmable mirror image".
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping

import msgspec

from ph_post.expand.faults import NotExpandableError

Place = dict[str, float]
"""Coordinates by axis."""


class TurnedFrame(msgspec.Struct, frozen=True, kw_only=True):
    """What becomes of coordinates: first multiplied by `factors` about `center`, then turned in the plane of `axes`.

    `turn` [rad] is about the same centre; axes without a factor stay. `ends` is ten times the G word that ends it.
    """

    ends: int
    axes: tuple[str, str, str]
    center: Mapping[str, float] = {}
    factors: Mapping[str, float] = {}
    turn: float = 0.0

    @property
    def moved(self) -> frozenset[str]:
        """Axes whose coordinates change."""
        return frozenset(self.factors) | frozenset(self.axes[:2] if self.turn else ())

    @property
    def mirrors(self) -> bool:
        """Whether left is right in the plane."""
        return self._factor(self.axes[0]) * self._factor(self.axes[1]) < 0.0

    def _factor(self, axis: str) -> float:
        return self.factors.get(axis, 1.0)

    def apply(self, place: Place) -> Place:
        """Return the coordinates without the frame, of those in it."""
        moved = {axis: self.center.get(axis, 0.0) for axis in "xyz"}
        vector = self.vector({axis: place[axis] - moved[axis] for axis in "xyz"})
        return {**place, **{axis: moved[axis] + vector[axis] for axis in self.moved}}

    def vector(self, along: Place) -> Place:
        """Return a difference of coordinates without the frame, of one in it."""
        first, second, _ = self.axes
        found = {axis: value * self._factor(axis) for axis, value in along.items()}
        if self.turn:
            turned = complex(found[first], found[second]) * cmath.rect(1.0, self.turn)
            found[first], found[second] = turned.real, turned.imag
        return found

    def radius(self) -> float:
        """Return by what the radius of a circle in the plane is multiplied.

        Raises
        ------
        NotExpandableError
            Where it becomes no circle.
        """
        first, second = (abs(self._factor(axis)) for axis in self.axes[:2])
        if not math.isclose(first, second):
            raise NotExpandableError("a circle whose axes are scaled differently")
        return first


class PlaneFrame(msgspec.Struct, frozen=True, kw_only=True):
    """What becomes of places of a plane, complex numbers: mirrored where it `flips`, turned by `turn`, then shifted."""

    turn: complex = 1.0 + 0.0j
    flips: bool = False
    shift: complex = 0.0 + 0.0j

    def apply(self, place: complex) -> complex:
        """Return a place without the frame, of one in it.

        Examples
        --------
        >>> PlaneFrame(turn=1j, shift=2.0).apply(3 + 1j), mirrored_in("X").apply(3 + 1j)
        ((1+3j), (-3+1j))
        """
        return self.way(place) + self.shift

    def way(self, way: complex) -> complex:
        """Return a difference of places without the frame, of one in it."""
        return self.turn * (way.conjugate() if self.flips else way)

    def within(self, other: PlaneFrame) -> PlaneFrame:
        """Return the frame that another one makes in this one.

        Examples
        --------
        >>> turned = PlaneFrame(turn=1j, shift=2.0)
        >>> turned.within(mirrored_in("X")).apply(3 + 1j) == turned.apply(-3 + 1j)
        True
        """
        turn = other.turn.conjugate() if self.flips else other.turn
        return PlaneFrame(turn=self.turn * turn, flips=self.flips != other.flips, shift=self.apply(other.shift))


def turned_by(angle: float) -> PlaneFrame:
    """Return the frame that is turned by an angle [deg]."""
    return PlaneFrame(turn=cmath.rect(1.0, math.radians(angle)))


def mirrored_in(axes: str) -> PlaneFrame:
    """Return the frame in which coordinates of some of X and Y change their sign."""
    both = {"X", "Y"} <= set(axes)
    return PlaneFrame(turn=-1.0 + 0.0j if "X" in axes else 1.0 + 0.0j, flips=bool(axes) and not both)
