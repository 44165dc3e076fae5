"""Lines, arcs, Bézier curves and NURBS of a drawing, and the drawing they make up.

Shapes stay analytic under every affine map. Points have three coordinates, in the drawing's unit until
:mod:`ph_post.files.drawing.convert` makes them the path's. A map is a matrix of shape (4, 4) for column
vectors: ``p' = M @ [x, y, z, 1]``. A drawing is subpaths of shapes by layer, its unit, and what was ignored.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Final, Literal

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from ph_post.errors import InputError
from ph_post.geometry import exact_polynomials
from ph_post.geometry.nurbs import bezier_spans
from ph_post.types import Array, frozen
from ph_post.units import LENGTHS

Kind = Literal["line", "arc", "bezier", "nurbs"]
Turn = Literal["ccw", "cw"]

ROUND: Final = 1e-12
"""A circle whose map is a similarity to this part of its radius stays a circle: rotations round worse."""

SLIGHT: Final = 1e-5
"""An arc of a smaller bulge is a rational curve: its centre lies so far away that digits are lost."""

_OTHER: Final[dict[Turn, Turn]] = {"ccw": "cw", "cw": "ccw"}


class DrawnShape(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One analytic curve.

    `points`, shape (n, 3): both ends of a line; start, end and centre of an arc, which lies level and is a
    full circle where start = end; control points of a Bézier curve or a clamped NURBS. `knots` and `weights`
    (None where all are 1) are a NURBS' own, whose degree is ``len(knots) - len(points) - 1``.
    """

    kind: Kind
    points: Array
    turn: Turn = "ccw"
    knots: Array | None = None
    weights: Array | None = None

    @property
    def start(self) -> Array:
        """Point at which it begins, shape (3,)."""
        first: Array = self.points[0]
        return first

    @property
    def end(self) -> Array:
        """Point at which it ends, shape (3,)."""
        last: Array = self.points[1 if self.kind == "arc" else -1]
        return last


def line(start: ArrayLike, end: ArrayLike) -> DrawnShape:
    """Straight from `start` to `end`."""
    return DrawnShape(kind="line", points=_rows(start, end))


def arc(start: ArrayLike, end: ArrayLike, center: ArrayLike, turn: Turn) -> DrawnShape:
    """Round `center`, level; start = end is a full circle."""
    return DrawnShape(kind="arc", points=_rows(start, end, center), turn=turn)


def bezier(points: ArrayLike) -> DrawnShape:
    """Curve of these control points."""
    return DrawnShape(kind="bezier", points=_spatial(points))


def nurbs(knots: ArrayLike, points: ArrayLike, weights: ArrayLike | None = None) -> DrawnShape:
    """(Rational) B-spline; one that is not clamped is cut to where it runs, by exact knot insertion."""
    shape = DrawnShape(
        kind="nurbs",
        points=_spatial(points),
        knots=frozen(knots),
        weights=None if weights is None or np.ptp(np.asarray(weights)) == 0.0 else frozen(weights),
    )
    return _clamped(shape)


def unit_arc(first: float, sweep: float) -> DrawnShape:
    """Part of the circle of radius 1 round the origin, from the angle `first` over `sweep` [rad].

    From a full turn on it is the full circle.
    """
    start = (math.cos(first), math.sin(first))
    last = first if abs(sweep) >= math.tau * (1.0 - ROUND) else first + sweep
    end = (math.cos(last), math.sin(last))
    return arc(start, end, (0.0, 0.0), "ccw" if sweep > 0.0 else "cw")


def bulged(start: ArrayLike, end: ArrayLike, bulge: float) -> DrawnShape:
    """Line or arc from `start` to `end`; `bulge` is the tangent of a quarter of the arc's angle, ccw > 0.

    Examples
    --------
    >>> bulged((2, 0), (0, 0), 1.0).points[2].tolist()
    [1.0, 0.0, 0.0]
    """
    a, b = _rows(start, end)
    if bulge == 0.0:
        return line(a, b)
    chord, middle, square = b - a, 0.5 * (a + b), bulge * bulge
    aside = np.array([-chord[1], chord[0], 0.0])
    if abs(bulge) < SLIGHT:
        peak = middle - bulge / (1.0 - square) * aside
        return nurbs([0, 0, 0, 1, 1, 1], [a, peak, b], [1.0, (1.0 - square) / (1.0 + square), 1.0])
    center = middle + (1.0 - square) / (4.0 * bulge) * aside
    return arc(a, b, center, "ccw" if bulge > 0.0 else "cw")


def transformed(shape: DrawnShape, matrix: Array) -> DrawnShape:
    """Map a shape: exact but for rounding, a circle that becomes an ellipse is a rational curve."""
    if shape.kind == "arc":
        keeps = _keeps_circles(matrix)
        if keeps is None:
            return transformed(as_nurbs(shape), matrix)
        turn = shape.turn if keeps else _OTHER[shape.turn]
        return msgspec.structs.replace(shape, points=_mapped(shape.points, matrix), turn=turn)
    return msgspec.structs.replace(shape, points=_mapped(shape.points, matrix))


def backwards(shape: DrawnShape) -> DrawnShape:
    """Return the same curve, run the other way."""
    if shape.kind == "arc":
        points = frozen(shape.points[[1, 0, 2]])
        return msgspec.structs.replace(shape, points=points, turn=_OTHER[shape.turn])
    points = frozen(shape.points[::-1])
    if shape.knots is None:
        return msgspec.structs.replace(shape, points=points)
    knots = frozen((shape.knots[0] + shape.knots[-1]) - shape.knots[::-1])
    weights = None if shape.weights is None else frozen(shape.weights[::-1])
    return msgspec.structs.replace(shape, points=points, knots=knots, weights=weights)


def as_nurbs(shape: DrawnShape) -> DrawnShape:
    """Return an arc as rational curve of degree 2, a quarter turn at most to a span, its ends the same."""
    first, sweep = angles(shape)
    center = shape.points[2]
    count = max(1, math.ceil(abs(sweep) / (0.5 * math.pi) - ROUND))
    turns = first + sweep / count * np.arange(count + 1)
    rays = radius_of(shape) * np.stack([np.cos(turns), np.sin(turns), np.zeros(count + 1)], axis=1)
    rays[0], rays[-1] = shape.start - center, shape.end - center
    points = np.empty((2 * count + 1, 3))
    points[::2] = center + rays
    points[1::2] = center + (rays[:-1] + rays[1:]) / (1.0 + math.cos(sweep / count))
    points[0], points[-1] = shape.start, shape.end
    weights = np.where(np.arange(2 * count + 1) % 2 == 1, math.cos(0.5 * sweep / count), 1.0)
    knots = np.repeat(np.arange(count + 1) / count, 2)
    return nurbs(np.concatenate([[0.0], knots, [1.0]]), points, weights)


def angles(shape: DrawnShape) -> tuple[float, float]:
    """First angle and signed sweep of an arc [rad]."""
    a, b = (shape.points[:2] - shape.points[2])[:, :2]
    first = math.atan2(a[1], a[0])
    sense = 1.0 if shape.turn == "ccw" else -1.0
    if np.array_equal(a, b):
        return first, sense * math.tau
    between = sense * math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])
    return first, sense * (between if between > 0.0 else between + math.tau)


def radius_of(shape: DrawnShape) -> float:
    """Radius of an arc: the mean of its ends' distances from the centre."""
    rays = shape.points[:2] - shape.points[2]
    return 0.5 * float(np.linalg.norm(rays[0]) + np.linalg.norm(rays[1]))


def reach(shape: DrawnShape) -> float:
    """Return how far a shape can come away from its start, at most and along any axis."""
    if shape.kind == "arc":
        _, sweep = angles(shape)
        return min(2.0, abs(sweep)) * radius_of(shape)
    return float(np.abs(shape.points - shape.points[0]).max())


def headings(shape: DrawnShape) -> tuple[Array, Array]:
    """Directions in which a shape leaves its start and reaches its end, shape (3,) each; zero for a point."""
    if shape.kind == "arc":
        rays = shape.points[:2] - shape.points[2]
        around = rays[:, [1, 0, 2]] * ((-1.0, 1.0, 0.0) if shape.turn == "ccw" else (1.0, -1.0, 0.0))
        return _unit(around[0]), _unit(around[1])
    return _heading(shape.points), -_heading(shape.points[::-1])


def with_ends(shape: DrawnShape, start: Array, end: Array) -> DrawnShape:
    """Return a line, Bézier curve or NURBS with its end points moved, the others as they were."""
    points = np.array(shape.points)
    points[0], points[-1] = start, end
    return msgspec.structs.replace(shape, points=frozen(points))


def is_finite(shape: DrawnShape) -> bool:
    """Return whether all its numbers are finite."""
    rows = (shape.points, shape.knots, shape.weights)
    return all(row is None or bool(np.all(np.isfinite(row))) for row in rows)


def _keeps_circles(matrix: Array) -> bool | None:
    """Return whether level circles stay level circles (None: no), and keep their sense of rotation."""
    u, v = matrix[:3, 0], matrix[:3, 1]
    size = float(np.linalg.norm(u))
    slack = ROUND * size
    alike = abs(float(np.linalg.norm(v)) - size) <= slack and abs(float(u @ v)) <= slack * size
    level = abs(u[2]) <= slack and abs(v[2]) <= slack
    if not (alike and level and size > 0.0):
        return None
    return bool(u[0] * v[1] - u[1] * v[0] > 0.0)


def _clamped(shape: DrawnShape) -> DrawnShape:
    knots, points = shape.knots, shape.points
    assert knots is not None
    degree = len(knots) - len(points) - 1
    if knots[0] == knots[degree] and knots[-1] == knots[-degree - 1]:
        return shape
    exact = exact_polynomials.rows(points)
    if shape.weights is not None:
        factors = exact_polynomials.rows([shape.weights])[0]
        exact = tuple((*(w * x for x in row), w) for w, row in zip(factors, exact, strict=True))
    spans = bezier_spans(degree, exact_polynomials.rows([knots])[0], exact)
    joined = exact_polynomials.floats((spans[0][1][0], *(row for _, control in spans for row in control[1:])))
    ends = [float(spans[0][0][0]), *(float(knots[1]) for knots, _ in spans)]
    full = np.concatenate([[ends[0]], np.repeat(ends, degree), [ends[-1]]])
    if shape.weights is None:
        return DrawnShape(kind="nurbs", points=frozen(joined), knots=frozen(full))
    return DrawnShape(
        kind="nurbs",
        points=frozen(joined[:, :-1] / joined[:, -1:]),
        knots=frozen(full),
        weights=frozen(joined[:, -1]),
    )


def _mapped(points: Array, matrix: Array) -> Array:
    return frozen(points @ matrix[:3, :3].T + matrix[:3, 3])


def _rows(*points: ArrayLike) -> Array:
    return _spatial(np.stack([np.asarray(point, dtype=np.float64) for point in points]))


def _spatial(points: ArrayLike) -> Array:
    rows: Array = np.asarray(points, dtype=np.float64)
    if rows.shape[1] == 3:
        return frozen(rows)
    return frozen(np.column_stack([rows, np.zeros(len(rows))]))


def _heading(points: Array) -> Array:
    """Direction from the first point to the first that lies elsewhere."""
    away = points - points[0]
    there = np.flatnonzero(np.abs(away).max(axis=1) > ROUND * max(1e-300, float(np.abs(away).max())))
    return _unit(away[there[0]]) if there.size else np.zeros(3)


def _unit(vector: Array) -> Array:
    size = float(np.linalg.norm(vector))
    return vector / size if size > 0.0 else np.zeros(3)


MAX_BYTES: Final = 64 * 2**20
"""Largest drawing that is read; one takes some thirty times as much memory."""

MAX_ENTITIES: Final = 100_000
"""Most entities, blocks taken apart: what refers to itself tenfold in ten steps must end somewhere."""

MAX_DEPTH: Final = 64
"""Deepest nesting of blocks or groups."""

UNITS: Final = {name: size / LENGTHS["mm"] for name, size in LENGTHS.items()}
"""Length units by the names of --units [mm]."""


class Subpath(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Shapes that the drawing itself joins end to start: one entity, or one subpath.

    `name` names it in messages: ``LINE 2F``, ``path at line 12``.
    """

    shapes: tuple[DrawnShape, ...]
    layer: str
    name: str


class Drawing(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A drawing as read, y upwards.

    `unit` is the length unit's name, None where the drawing states none; `found` counts entities by layer
    and kind, `left_out` what is not in the runs, by its name; `notes` are for the user.
    """

    kind: Literal["DXF", "SVG"]
    runs: tuple[Subpath, ...]
    unit: str | None
    found: dict[str, dict[str, int]]
    left_out: dict[str, int]
    notes: tuple[str, ...]


class Collector:
    """Gathers what a reader finds, and keeps count.

    Parameters
    ----------
    file : str
        The drawing's name for messages.
    layers : sequence of str
        Layers that are wanted; all where there are none.
    """

    def __init__(self, file: str, layers: Sequence[str] = ()) -> None:
        self.file = file
        self.layers = frozenset(layers)
        self.runs: list[Subpath] = []
        self.found: dict[str, Counter[str]] = {}
        self.left_out: Counter[str] = Counter()
        self.notes: dict[str, None] = {}
        self._count = 0

    def wants(self, layer: str) -> bool:
        """Return whether a layer was asked for."""
        return not self.layers or layer in self.layers

    def count(self, layer: str, kind: str) -> None:
        """Count one entity, whether it is understood or not.

        Raises
        ------
        InputError
            Where there are too many.
        """
        self.found.setdefault(layer, Counter())[kind] += 1
        self.spend(1)

    def spend(self, number: int) -> None:
        """Count towards the limit.

        Raises
        ------
        InputError
            Where it is passed.
        """
        self._count += number
        if self._count > MAX_ENTITIES:
            raise InputError(
                self.file,
                "the drawing is too large",
                expected=f"at most {MAX_ENTITIES} entities, blocks taken apart",
                got="more",
            )

    def leave_out(self, what: str, times: int = 1) -> None:
        """Name something that does not become part of the path; of nothing there is nothing to say."""
        if times:
            self.left_out[what] += times

    def note(self, text: str) -> None:
        """Say something once."""
        self.notes[text] = None

    def add(self, shapes: Sequence[DrawnShape], matrix: Array, layer: str, name: str) -> None:
        """Add a run, mapped.

        Raises
        ------
        InputError
            Where a coordinate is not a number.
        """
        mapped = tuple(transformed(shape, matrix) for shape in shapes if is_finite(shape))
        if len(mapped) < len(shapes) or not all(map(is_finite, mapped)):
            raise InputError(f"{self.file}: {name}", "a coordinate is not a number", expected="finite numbers")
        if mapped:
            self.runs.append(Subpath(shapes=mapped, layer=layer, name=name))
        else:
            self.leave_out(f"{name.split(maxsplit=1)[0]} without length")

    def drawing(self, kind: Literal["DXF", "SVG"], unit: str | None) -> Drawing:
        """Return what was gathered."""
        return Drawing(
            kind=kind,
            runs=tuple(self.runs),
            unit=unit,
            found={layer: dict(counts) for layer, counts in self.found.items()},
            left_out=dict(self.left_out),
            notes=tuple(self.notes),
        )
