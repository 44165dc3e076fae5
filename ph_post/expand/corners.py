"""Corners that a control rounds or chamfers itself, between two straight lines or arcs of a plane.

Places of the plane are complex numbers, lengths in the program's units.
"""

from __future__ import annotations

import cmath
import math
from typing import Final, Literal

import msgspec

from ph_post.expand.faults import NotExpandableError

Kind = Literal["radius", "legs", "length"]
"""What the number of a corner is: the radius of an arc, what a chamfer takes from both lines, or its own length."""

_TANGENT: Final = 1e-4
"""Sine of the angle between two elements that make no corner."""

_CLOSE: Final = 1e-6
_APART: Final = 2e-3
"""Difference of the distances of an arc's ends from its centre that is rounding."""


class Element(msgspec.Struct, frozen=True, kw_only=True):
    """A straight line, or an arc about `center` that turns `left` or right, of less than one turn."""

    start: complex
    end: complex
    center: complex | None = None
    left: bool = False

    @property
    def radius(self) -> float:
        """Radius of an arc, 0 of a line."""
        return 0.0 if self.center is None else abs(self.start - self.center)

    def heading(self, place: complex) -> complex:
        """Return the direction of travel at a place on the element, of length 1."""
        if self.center is None:
            way = self.end - self.start
            return way / abs(way)
        away = (place - self.center) * (1j if self.left else -1j)
        return away / abs(away)

    def way(self, begin: complex, end: complex) -> float:
        """Return the length from one place on the element to another, of a line negative where that is behind."""
        if self.center is None:
            return float(((end - begin) * self.heading(begin).conjugate()).real)
        turned = cmath.phase((end - self.center) / (begin - self.center)) * (1.0 if self.left else -1.0)
        return self.radius * (turned % math.tau)

    def holds(self, place: complex) -> bool:
        """Return whether a place is between the ends; a line may begin or end there."""
        least = -_CLOSE if self.center is None else _CLOSE
        whole, first, rest = self.way(self.start, self.end), self.way(self.start, place), self.way(place, self.end)
        return first >= least and rest >= least and abs(whole - first - rest) < _CLOSE

    def beside(self, place: complex, radius: float, *, left: bool) -> complex:
        """Return the point of the element nearest to the centre of a circle that touches it from one side."""
        if self.center is None:
            return place - self.heading(place) * radius * (1j if left else -1j)
        return self.center + (place - self.center) / abs(place - self.center) * self.radius


def arc_by_radius(start: complex, end: complex, radius: float, *, left: bool) -> Element | None:
    """Return the arc of at most half a turn between two places.

    None where there is none, or the arc takes more than half a turn (its radius is below 0): the sign of its radius
    would have to change where a corner takes a part of it.

    Examples
    --------
    >>> arc_by_radius(0j, 6 + 8j, 5.0, left=True).center
    (3+4j)
    """
    half = 0.5 * abs(end - start)
    if start == end or radius < half:
        return None
    side = 1j if left else -1j
    center = 0.5 * (start + end) + side * (end - start) / abs(end - start) * math.sqrt(radius**2 - half**2)
    return Element(start=start, end=end, center=center, left=left)


class Corner(msgspec.Struct, frozen=True, kw_only=True):
    """What stands between two elements: from `begin` to `end`, an arc of `radius` that turns `left`, or a line."""

    begin: complex
    end: complex
    radius: float = 0.0
    left: bool = False


def corner_between(before: Element, after: Element, kind: Kind, size: float) -> Corner:
    """Work a corner out.

    Parameters
    ----------
    before, after : Element
        The second begins where the first ends.
    kind : {"radius", "legs", "length"}
    size : float

    Raises
    ------
    NotExpandableError
        Where there is none, or it does not fit between the elements.

    Examples
    --------
    >>> one, other = Element(start=0j, end=10 + 0j), Element(start=10 + 0j, end=10 + 10j)
    >>> found = corner_between(one, other, "radius", 2.0)
    >>> found.begin, found.end, found.left
    ((8+0j), (10+2j), True)
    """
    if not size > 0.0:
        raise NotExpandableError("a corner without a size")
    if before.start == before.end or after.start == after.end:
        raise NotExpandableError("a corner at a move without a length")
    for element in (before, after):
        apart = 0.0 if element.center is None else abs(abs(element.end - element.center) - element.radius)
        if not apart <= _APART or (element.center is not None and not element.radius > _CLOSE):
            raise NotExpandableError("an arc whose ends are not on one circle")
    first, second = before.heading(before.end), after.heading(after.start)
    turn = (second * first.conjugate()).imag
    if abs(turn) < _TANGENT:
        raise NotExpandableError("two moves that make no corner")
    if kind == "radius":
        return _rounded(before, after, size, left=turn > 0.0)
    if before.center is not None or after.center is not None:
        raise NotExpandableError("a chamfer at an arc")
    half = 0.5 * (math.pi - abs(cmath.phase(second / first)))
    leg = size if kind == "legs" else size / (2.0 * math.sin(half))
    found = Corner(begin=before.end - leg * first, end=after.start + leg * second)
    if not (before.holds(found.begin) and after.holds(found.end)):
        raise NotExpandableError("a chamfer that is longer than its lines")
    return found


def _rounded(before: Element, after: Element, radius: float, *, left: bool) -> Corner:
    """Put an arc that touches both elements in the corner; of several that which takes the least of them."""
    found: list[tuple[float, Corner]] = []
    for center in _centers(before, after, radius, left=left):
        begin, end = (one.beside(center, radius, left=left) for one in (before, after))
        if before.holds(begin) and after.holds(end):
            taken = before.way(begin, before.end) + after.way(after.start, end)
            found.append((taken, Corner(begin=begin, end=end, radius=radius, left=left)))
    if not found:
        raise NotExpandableError("a rounding that does not fit between its moves")
    return min(found, key=lambda one: one[0])[1]


def _centers(before: Element, after: Element, radius: float, *, left: bool) -> list[complex]:
    """Return the centres of circles that touch both elements, or their prolongations, from one side."""
    side = (1j if left else -1j) * radius
    circles = []
    for element in (before, after):
        grown = element.radius + (-radius if element.left == left else radius)
        if element.center is not None and grown <= _CLOSE:
            return []
        circles.append(grown)
    if before.center is None and after.center is None:
        first, second = before.heading(before.end), after.heading(after.start)
        across = (second * first.conjugate()).imag
        gap = second * side - first * side
        return [before.end + first * side + first * (gap * second.conjugate()).imag / -across]
    if before.center is None or after.center is None:
        line, arc, grown = (before, after, circles[1]) if before.center is None else (after, before, circles[0])
        along = line.heading(line.start)
        assert arc.center is not None
        foot = line.start + along * side
        foot += along * ((arc.center - foot) * along.conjugate()).real
        half = grown**2 - abs(arc.center - foot) ** 2
        return [] if half < 0.0 else [foot + sign * along * math.sqrt(half) for sign in (1.0, -1.0)]
    apart = after.center - before.center
    if abs(apart) < _CLOSE:
        return []
    near = (abs(apart) ** 2 + circles[0] ** 2 - circles[1] ** 2) / (2.0 * abs(apart))
    half = circles[0] ** 2 - near**2
    unit = apart / abs(apart)
    if half < 0.0:
        return []
    return [before.center + unit * complex(near, sign * math.sqrt(half)) for sign in (1.0, -1.0)]
