"""Make shapes of DXF entities, in the entity's own coordinates, with the map out of them.

References
----------
.. [1] AutoCAD 2012 DXF Reference, Autodesk 2011: ENTITIES, and "Object Coordinate Systems".
"""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np

from ph_post.files.drawing import shapes
from ph_post.files.drawing.shapes import Collector, DrawnShape
from ph_post.files.pathcurves import MAX_DEGREE
from ph_post.types import Array

_CURVE_FRAME = 16  # vertex flag: a control point of a fitted polyline, which is not on it

Shapes = tuple[Sequence[DrawnShape], Array]
"""Shapes and the map, shape (4, 4), that takes them to world coordinates."""


class EntityError(Exception):
    """Why an entity does not become part of the path; empty where its kind is reason enough."""


@contextlib.contextmanager
def entity_errors() -> Iterator[None]:
    """Turn what ezdxf and arithmetic raise over missing, impossible and endless values into a fault."""
    from ezdxf.lldxf.const import DXFError

    try:
        yield
    except (DXFError, ArithmeticError, AttributeError, TypeError, ValueError) as error:
        raise EntityError(f"which cannot be read ({' '.join(str(error).split())[:80]})") from None


def value_of(entity: Any, name: str, default: Any) -> Any:
    """Return an attribute of an entity, which need not have one of this name."""
    return entity.dxf.get(name, default) if entity.dxf.is_supported(name) else default


def shapes_of(entity: Any, found: Collector) -> Shapes:
    """Return the shapes of an entity, and the map from its coordinates to the world's.

    Raises
    ------
    EntityError
        Where it is not understood.
    """
    build = _BUILDERS.get(entity.dxftype())
    if build is None:
        raise EntityError
    with entity_errors():
        made = build(entity, found)
    if value_of(entity, "thickness", 0.0):
        found.leave_out(f"thickness of a {entity.dxftype()}")
    return made


def _line(entity: Any, _found: Collector) -> Shapes:
    return [shapes.line(entity.dxf.start.xyz, entity.dxf.end.xyz)], np.eye(4)


def _arc(entity: Any, _found: Collector) -> Shapes:
    first, last = entity.dxf.start_angle, entity.dxf.end_angle
    span = (last - first) % 360.0 if math.isfinite(last - first) else math.nan
    if span == 0.0:
        return _round(entity, first)
    center, radius = np.array(entity.dxf.center.xyz), _radius(entity)
    start, end = (center + radius * _direction(angle) for angle in (first, last))
    return [shapes.arc(start, end, center, "ccw")], _world(entity)


def _circle(entity: Any, _found: Collector) -> Shapes:
    return _round(entity, 0.0)


def _round(entity: Any, first: float) -> Shapes:
    """Return the full circle, from the angle `first` [degrees] on."""
    center = np.array(entity.dxf.center.xyz)
    start = center + _radius(entity) * _direction(first)
    return [shapes.arc(start, start, center, "ccw")], _world(entity)


def _radius(entity: Any) -> float:
    radius = float(entity.dxf.radius)
    if radius <= 0.0:
        raise EntityError("whose radius is not positive")
    return radius


def _direction(degrees: float) -> Array:
    """Return the unit vector of an angle; quarter turns are exact."""
    quarter = degrees / 90.0
    if quarter == round(quarter):
        x, y = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarter) % 4]
        return np.array([x, y, 0.0])
    angle = math.radians(degrees)
    return np.array([math.cos(angle), math.sin(angle), 0.0])


def _ellipse(entity: Any, _found: Collector) -> Shapes:
    major, normal = np.array(entity.dxf.major_axis.xyz), np.array(entity.dxf.extrusion.xyz)
    size = float(np.linalg.norm(normal))
    ratio = float(entity.dxf.ratio)
    if size == 0.0 or ratio == 0.0 or not np.any(major):
        raise EntityError("which is flat")
    normal = normal / size
    world = np.eye(4)
    world[:3, :4] = np.stack([major, ratio * np.cross(normal, major), normal, np.array(entity.dxf.center.xyz)], axis=1)
    first, last = float(entity.dxf.start_param), float(entity.dxf.end_param)
    sweep = (last - first) % math.tau if abs(last - first) < math.tau * (1.0 - shapes.ROUND) else math.tau
    return [shapes.unit_arc(first, sweep or math.tau)], world


def _spline(entity: Any, found: Collector) -> Shapes:
    control = np.array([tuple(row) for row in entity.control_points], dtype=np.float64).reshape(-1, 3)
    if len(control) == 0:
        return [_fitted(entity, found)], np.eye(4)
    degree, knots = int(entity.dxf.degree), np.array(entity.knots, dtype=np.float64)
    weights = np.array(entity.weights, dtype=np.float64) if len(entity.weights) else None
    numbers = [control, knots, *(() if weights is None else (weights,))]
    if all(np.all(np.isfinite(row)) for row in numbers):  # what is not finite is refused with the drawing
        _require_spline(degree, knots, control, weights)
        return [shapes.nurbs(knots, control, weights)], np.eye(4)
    return [DrawnShape(kind="nurbs", points=control, knots=knots, weights=weights)], np.eye(4)


def _require_spline(degree: int, knots: Array, control: Array, weights: Array | None) -> None:
    if not 1 <= degree <= MAX_DEGREE:
        raise EntityError(f"whose degree is {degree}")
    if len(control) <= degree:
        raise EntityError(f"which has {len(control)} points for degree {degree}")
    if len(knots) != len(control) + degree + 1:
        raise EntityError(f"which has {len(knots)} knots for {len(control)} points of degree {degree}")
    if np.any(np.diff(knots) < 0.0):
        raise EntityError("whose knots fall")
    if not knots[degree] < knots[len(control)]:
        raise EntityError("whose knots span nothing")
    inner = [knot for knot in knots.tolist() if knots[degree] < knot < knots[len(control)]]
    most = max(Counter(inner).values(), default=0), max(Counter(knots.tolist()).values())
    if most[0] > degree or most[1] > degree + 1:
        raise EntityError("which a repeated knot tears")
    if weights is not None and (len(weights) != len(control) or np.any(weights <= 0.0)):
        raise EntityError("whose weights are not one positive number a point")


def _fitted(entity: Any, found: Collector) -> DrawnShape:
    """Cubic through the fit points, knots by chord length, as CAD systems draw it."""
    points = np.array([tuple(row) for row in entity.fit_points], dtype=np.float64).reshape(-1, 3)
    apart = np.append(True, np.any(np.diff(points, axis=0) != 0.0, axis=1))[: len(points)]
    points = points[apart]
    if len(points) < 2:
        raise EntityError("without points")
    if not np.all(np.isfinite(points)):
        return shapes.bezier(points)  # refused with the drawing
    found.note("splines that give fit points only are drawn as a cubic through them, knots by chord length")
    if entity.closed:
        return _periodic(points)
    from ezdxf.math import fit_points_to_cad_cv

    tangents = [entity.dxf.get(key) for key in ("start_tangent", "end_tangent")]
    known = tangents if all(tangent is not None and tangent.magnitude > 0.0 for tangent in tangents) else None
    curve = fit_points_to_cad_cv([tuple(row) for row in points], tangents=known)
    return shapes.nurbs(curve.knots(), [point.xyz for point in curve.control_points])


def _periodic(points: Array) -> DrawnShape:
    from scipy.interpolate import make_interp_spline

    loop = points if np.array_equal(points[0], points[-1]) else np.vstack([points, points[:1]])
    if len(loop) < 4:
        raise EntityError("closed through less than three points")
    chords = np.linalg.norm(np.diff(loop, axis=0), axis=1)
    curve = make_interp_spline(np.append(0.0, np.cumsum(chords)), loop, k=3, bc_type="periodic")
    shape = shapes.nurbs(curve.t, curve.c)
    return shapes.with_ends(shape, loop[0], loop[0])


def _lwpolyline(entity: Any, found: Collector) -> Shapes:
    rows = np.array(entity.get_points("xyseb"), dtype=np.float64).reshape(-1, 5)
    if entity.dxf.get("const_width", 0.0) or np.any(rows[:, 2:4]):
        found.leave_out("width of a LWPOLYLINE")
    height = np.full(len(rows), float(entity.dxf.elevation))
    points = np.column_stack([rows[:, :2], height])
    return _bulged(points, rows[:, 4], bool(entity.closed)), _world(entity)


def _polyline(entity: Any, found: Collector) -> Shapes:
    mode = entity.get_mode()
    if mode not in {"AcDb2dPolyline", "AcDb3dPolyline"}:
        raise EntityError("a mesh")
    vertices = [vertex for vertex in entity.vertices if not vertex.dxf.flags & _CURVE_FRAME]
    if len(vertices) < len(entity.vertices):
        found.note("fitted polylines are taken by the chords that their vertices give")
    points = np.array([vertex.dxf.location.xyz for vertex in vertices], dtype=np.float64).reshape(-1, 3)
    if mode == "AcDb3dPolyline":
        return _bulged(points, np.zeros(len(points)), bool(entity.is_closed)), np.eye(4)
    if any(vertex.dxf.get("start_width", 0.0) or vertex.dxf.get("end_width", 0.0) for vertex in vertices):
        found.leave_out("width of a POLYLINE")
    if len(points):
        points[:, 2] = entity.dxf.elevation.z if entity.dxf.hasattr("elevation") else points[:, 2]
    bulges = np.array([vertex.dxf.get("bulge", 0.0) for vertex in vertices], dtype=np.float64)
    return _bulged(points, bulges, bool(entity.is_closed)), _world(entity)


def _bulged(points: Array, bulges: Array, closed: bool) -> list[DrawnShape]:
    """Join vertices by lines and arcs; a vertex that stands on the one before adds nothing."""
    if len(points) < 2:
        raise EntityError("with less than two vertices")
    ends = list(pairwise(range(len(points)))) + ([(len(points) - 1, 0)] if closed else [])
    made = []
    for a, b in ends:
        if np.array_equal(points[a], points[b]):
            continue
        made.append(shapes.bulged(points[a], points[b], float(bulges[a])))
    return made


def _world(entity: Any) -> Array:
    """Map from the entity's coordinates to the world's, by the arbitrary axis algorithm of [1]_."""
    matrix = np.eye(4)
    ocs = entity.ocs()
    if ocs.transform:
        matrix[:3, :3] = np.stack([ocs.ux.xyz, ocs.uy.xyz, ocs.uz.xyz], axis=1)
    return matrix


_BUILDERS: Final[dict[str, Callable[[Any, Collector], Shapes]]] = {
    "LINE": _line,
    "ARC": _arc,
    "CIRCLE": _circle,
    "ELLIPSE": _ellipse,
    "SPLINE": _spline,
    "HELIX": _spline,
    "LWPOLYLINE": _lwpolyline,
    "POLYLINE": _polyline,
}
