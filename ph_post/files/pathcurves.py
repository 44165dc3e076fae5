"""Segments of a path file, key by key, and the curves they make.

Counts, ranges and units are checked; exact numbers stand beside the doubles.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.files.check import Keys, one_of, place, shown
from ph_post.geometry.curves import Arc, Bezier, Line, Polynomial
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.ph import PH, ph_hermite
from ph_post.geometry.piecewise import PiecewiseCurve
from ph_post.types import Array, AxisName, ByAxis
from ph_post.units import MM

Point = list[Fraction]


class PathTableRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of the tables of a path file: a key that is not known is refused."""


class SegmentRecord(PathTableRecord, frozen=True, kw_only=True, tag_field="type", tag=False):
    """Keys that every segment may carry."""

    feed: Fraction | None = None
    rapid: bool = False


class LineRecord(SegmentRecord, frozen=True, kw_only=True, tag="line"):
    """A straight line through two points."""

    points: list[Point]


class ArcRecord(SegmentRecord, frozen=True, kw_only=True, tag="arc"):
    """A circular arc in the first two axes; start = end is a full circle."""

    start: Point
    end: Point
    center: Point
    turn: Literal["ccw", "cw"]


class BezierRecord(SegmentRecord, frozen=True, kw_only=True, tag="bezier"):
    """A Bézier curve by its control points."""

    points: list[Point]


class PolynomialRecord(SegmentRecord, frozen=True, kw_only=True, tag="polynomial"):
    """A polynomial curve in the power basis."""

    coefficients: ByAxis[list[Fraction]]
    domain: list[Fraction] | None = None


class PHRecord(SegmentRecord, frozen=True, kw_only=True, tag="ph"):
    """A PH curve by its start and the Bernstein coefficients of its preimage."""

    start: Point
    preimage: list[Point]


class PHHermiteRecord(SegmentRecord, frozen=True, kw_only=True, tag="ph-hermite"):
    """A planar PH quintic by its end points and end derivatives."""

    points: list[Point]
    derivatives: list[Point]


class NurbsRecord(SegmentRecord, frozen=True, kw_only=True, tag="nurbs"):
    """A NURBS curve; weights are 1 where none are given."""

    degree: int
    knots: list[Fraction]
    points: list[Point]
    weights: list[Fraction] | None = None


AnySegment = LineRecord | ArcRecord | BezierRecord | PolynomialRecord | PHRecord | PHHermiteRecord | NurbsRecord


class PathRecord(PathTableRecord, frozen=True, kw_only=True):
    """The whole file."""

    format: Literal["ph-post-path"]
    version: Literal[1]
    name: str | None = None
    source: str = ""
    units: Literal["mm", "m", "inch"]
    axes: list[AxisName]
    feed: Fraction
    closed: bool = False
    segments: Annotated[list[AnySegment], msgspec.Meta(min_length=1)]


JOIN = 1e-6 * MM
"""Distance up to which two points are the same [m]; the contract's 1e-6 mm."""

MAX_DEGREE = 20
"""Highest degree of a Bézier, polynomial or NURBS segment, and of a PH preimage."""

MAX_LENGTH = 1e6
"""Largest coordinate [m]: no machine reaches as far, and no square of it leaves a double's range."""

Numbers = tuple[Fraction, ...]
Points = tuple[Numbers, ...]


class Frame(msgspec.Struct, frozen=True, kw_only=True):
    """File of a segment: its name, the axes, the length unit's name and size in metres."""

    file: str
    axes: tuple[str, ...]
    units: str
    unit: Fraction


class FilePlace(msgspec.Struct, frozen=True):
    """Place of a segment in its file, and the making of refusals there."""

    frame: Frame
    keys: Keys

    def at(self, *keys: str | int) -> FilePlace:
        """Return the place one or more keys further in."""
        return FilePlace(self.frame, (*self.keys, *keys))

    def refuse(self, what: str, expected: str = "", got: str = "") -> InputError:
        """Make a refusal that names this place."""
        return InputError(place(self.frame.file, self.keys), what, expected=expected, got=got)


def build_curve(segment: AnySegment, here: FilePlace) -> PiecewiseCurve:
    """Make the curve of a segment.

    Raises
    ------
    InputError
        Where a count, a range or the shape is wrong, or the segment has no length.
    """
    try:
        curve = _BUILDERS[type(segment)](segment, here)
    except InputError as error:
        if error.where:
            raise
        raise here.refuse(str(error)) from None  # of a constructor, which does not know its place
    except OverflowError:
        raise _too_large(here) from None
    if not np.all(np.abs(hull(curve)) <= MAX_LENGTH):
        raise _too_large(here)
    return curve


def hull(curve: PiecewiseCurve) -> Array:
    """Points between which a curve lies, shape (n, dim) [m]; the first and the last are its ends."""
    if isinstance(curve, Arc):
        return np.stack([curve.start, curve.center - curve.radius, curve.center + curve.radius, curve.end])
    rows = [piece.control for piece in curve.pieces]
    if curve.pieces[0].kind == "rational":
        rows = [row[:, :-1] / row[:, -1:] for row in rows]
    return rows[0] if len(rows) == 1 else np.concatenate(rows)


def _line(segment: LineRecord, here: FilePlace) -> Line:
    points = _points(segment.points, here.at("points"), 2, 2)
    return Line(_metres(points, here), exact=points)


def _bezier(segment: BezierRecord, here: FilePlace) -> Bezier:
    points = _points(segment.points, here.at("points"), 2, MAX_DEGREE + 1)
    return Bezier(_metres(points, here), exact=points)


def _arc(segment: ArcRecord, here: FilePlace) -> Arc:
    start, end, center = (_point(getattr(segment, key), here.at(key)) for key in ("start", "end", "center"))
    metres = _metres([start, end, center], here)
    if start != end and np.linalg.norm(metres[1] - metres[0]) <= JOIN:
        what = "the arc's ends are nearer than 1e-6 mm"
        raise here.at("end").refuse(what, "the same point for a full circle, or a longer arc", _shown(end))
    return Arc(metres[0], metres[1], metres[2], segment.turn, exact=(start, end, center))


def _polynomial(segment: PolynomialRecord, here: FilePlace) -> Polynomial:
    inside = here.at("coefficients")
    coefficients = segment.coefficients.given()
    for axis in coefficients:
        if axis not in here.frame.axes:
            raise inside.at(axis).refuse("not an axis of this path", one_of(here.frame.axes))
    exact = []
    for axis in here.frame.axes:
        given = coefficients.get(axis)
        if given is None:
            raise inside.refuse(f'key "{axis}" is missing', f"coefficients for {', '.join(here.frame.axes)}")
        _count(given, inside.at(axis), 1, MAX_DEGREE + 1, "number")
        exact.append(tuple(given))
    domain = tuple(segment.domain) if segment.domain is not None else (Fraction(0), Fraction(1))
    _count(domain, here.at("domain"), 2, 2, "number")
    metres = [_scaled(row, here.frame.unit) for row in exact]
    return Polynomial(metres, (float(domain[0]), float(domain[1])), exact=(tuple(exact), domain))


def _ph(segment: PHRecord, here: FilePlace) -> PH:
    start = _point(segment.start, here.at("start"))
    width = 2 if len(start) == 2 else 4
    _count(segment.preimage, here.at("preimage"), 1, MAX_DEGREE + 1, "coefficient")
    preimage = tuple(_row(row, here.at("preimage", number), width) for number, row in enumerate(segment.preimage))
    # x' = u² - v² is a length, so the preimage goes with the square root of the unit
    root = float(here.frame.unit) ** 0.5
    metres = np.array([[float(value) for value in row] for row in preimage]) * root
    return PH(_metres([start], here)[0], metres, exact=(start, preimage))


def _ph_hermite(segment: PHHermiteRecord, here: FilePlace) -> PH:
    if len(here.frame.axes) != 2:
        raise here.at("type").refuse("ph-hermite is planar", "a path with two axes", str(len(here.frame.axes)))
    points = _points(segment.points, here.at("points"), 2, 2)
    derivatives = _points(segment.derivatives, here.at("derivatives"), 2, 2)
    return ph_hermite(_metres(points, here), _metres(derivatives, here))


def _nurbs(segment: NurbsRecord, here: FilePlace) -> Nurbs:
    degree = segment.degree
    if not 1 <= degree <= MAX_DEGREE:
        raise here.at("degree").refuse("out of range", f"a degree of 1 to {MAX_DEGREE}", str(degree))
    points = _points(segment.points, here.at("points"), degree + 1, None)
    knots = tuple(segment.knots)
    _count(knots, here.at("knots"), len(points) + degree + 1, len(points) + degree + 1, "knot")
    for number in range(1, len(knots)):
        if knots[number] < knots[number - 1]:
            least = f">= {shown(knots[number - 1])}"
            raise here.at("knots", number).refuse("the knots fall", least, shown(knots[number]))
    weights = None if segment.weights is None else _weights(segment.weights, len(points), here.at("weights"))
    return Nurbs(
        degree,
        [float(knot) for knot in knots],
        _metres(points, here),
        None if weights is None else [float(weight) for weight in weights],
        exact=(knots, points, weights),
    )


def _weights(given: Sequence[Fraction], count: int, here: FilePlace) -> Numbers:
    _count(given, here, count, count, "weight")
    for number, weight in enumerate(given):
        if weight <= 0:
            raise here.at(number).refuse("the weight is not positive", "> 0", shown(weight))
    return tuple(given)


_BUILDERS: Final[Mapping[type[SegmentRecord], Callable[[Any, FilePlace], PiecewiseCurve]]] = {
    LineRecord: _line,
    ArcRecord: _arc,
    BezierRecord: _bezier,
    PolynomialRecord: _polynomial,
    PHRecord: _ph,
    PHHermiteRecord: _ph_hermite,
    NurbsRecord: _nurbs,
}


def _points(rows: Sequence[Sequence[Fraction]], here: FilePlace, least: int, most: int | None) -> Points:
    """Check the number of points and of each point's coordinates."""
    _count(rows, here, least, most, "point")
    width = len(here.frame.axes)
    for number, row in enumerate(rows):
        if len(row) != width:
            _point(row, here.at(number))
    return tuple(map(tuple, rows))


def _point(row: Sequence[Fraction], here: FilePlace) -> Numbers:
    return _row(row, here, len(here.frame.axes))


def _row(row: Sequence[Fraction], here: FilePlace, width: int) -> Numbers:
    if len(row) != width:
        names = f" ({', '.join(here.frame.axes)})" if width == len(here.frame.axes) else ""
        raise here.refuse("wrong count", f"{width} numbers{names}", str(len(row)))
    return tuple(row)


def _count(items: Sequence[object], here: FilePlace, least: int, most: int | None, noun: str) -> None:
    if least <= len(items) and (most is None or len(items) <= most):
        return
    many = f"{least}" if least == most else f"at least {least}" if most is None else f"{least} to {most}"
    raise here.refuse("wrong count", f"{many} {noun}s", str(len(items)))


def _metres(rows: Sequence[Numbers], here: FilePlace) -> Array:
    """Convert points to metres, each number correctly rounded."""
    metres = np.array([_scaled(row, here.frame.unit) for row in rows])
    if np.abs(metres).max() > MAX_LENGTH:
        raise _too_large(here)
    return metres


def _too_large(here: FilePlace) -> InputError:
    return here.refuse("too large", f"coordinates up to {_length(MAX_LENGTH, here)}")


def _scaled(row: Sequence[Fraction], unit: Fraction) -> list[float]:
    # true division of whole numbers rounds once, and is much faster than a product of fractions
    up, down = unit.numerator, unit.denominator
    return [(value.numerator * up) / (value.denominator * down) for value in row]


def _shown(row: Sequence[Fraction]) -> str:
    return f"[{', '.join(map(shown, row))}]"


def _length(metres: float, here: FilePlace) -> str:
    return f"{metres / float(here.frame.unit):g} {here.frame.units}"
