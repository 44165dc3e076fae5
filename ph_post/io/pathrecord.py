"""What a path file holds, key by key, numbers exact; see :mod:`ph_post.io.pathfile` for the rules."""

from __future__ import annotations

from fractions import Fraction
from typing import Annotated, Literal

import msgspec

Point = list[Fraction]


class Record(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of the tables of a path file: a key that is not known is refused."""


class SegmentRecord(Record, frozen=True, kw_only=True, tag_field="type", tag=False):
    """What every segment may carry."""

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


class CoefficientsRecord(Record, frozen=True, kw_only=True):
    """Power-basis coefficients by axis, lowest first."""

    X: list[Fraction] | None = None
    Y: list[Fraction] | None = None
    Z: list[Fraction] | None = None


class PolynomialRecord(SegmentRecord, frozen=True, kw_only=True, tag="polynomial"):
    """A polynomial curve in the power basis."""

    coefficients: CoefficientsRecord
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


AnySegment = (
    LineRecord | ArcRecord | BezierRecord | PolynomialRecord | PHRecord | PHHermiteRecord | NurbsRecord
)


class PathRecord(Record, frozen=True, kw_only=True):
    """The whole file."""

    format: Literal["ph-post-path"]
    version: Literal[1]
    name: str | None = None
    source: str = ""
    units: Literal["mm", "m", "inch"]
    axes: list[Literal["X", "Y", "Z"]]
    feed: Fraction
    closed: bool = False
    segments: Annotated[list[AnySegment], msgspec.Meta(min_length=1)]
