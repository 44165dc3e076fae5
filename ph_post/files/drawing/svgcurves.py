"""Make shapes of SVG basic shapes and path data, in user units, y downwards as they stand there.

References
----------
.. [1] Scalable Vector Graphics (SVG) 1.1 (Second Edition), W3C 2011: 7.6 (transform attribute),
   8.3 (path data), 9 (basic shapes).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np

from ph_post.errors import InputError
from ph_post.files.check import quoted
from ph_post.files.drawing import shapes
from ph_post.files.drawing.shapes import DrawnShape
from ph_post.files.drawing.svgtree import NUMBER, Node, RelativeLengthError, View, length, whole_of
from ph_post.types import Array

Subpaths = Iterator[Sequence[DrawnShape]]

_S: Final = r"[\s,]*+"
_N: Final = rf"(?>{NUMBER}){_S}"
_FLAG: Final = rf"[01]{_S}"


def _command(letters: str, arguments: str) -> str:
    return rf"[{letters}]{_S}(?:{arguments})++"


_DATA: Final = re.compile(
    rf"{_S}(?:{_command('Mm', _N * 2)}(?:[Zz]{_S}|"
    + "|".join(
        (
            _command("MmLlTt", _N * 2),
            _command("HhVv", _N),
            _command("Cc", _N * 6),
            _command("SsQq", _N * 4),
            _command("Aa", _N * 3 + _FLAG * 2 + _N * 2),
        )
    )
    + ")*+)?+"
)
"""Path data that is understood; svgelements stops at what it does not know, and says nothing."""

_TRANSFORM: Final = re.compile(
    rf"{_S}(?:(?:matrix\s*\({_S}(?:{_N}){{6}}|(?:translate|scale)\s*\({_S}(?:{_N}){{1,2}}"
    rf"|rotate\s*\({_S}(?:{_N})(?:(?:{_N}){{2}})?|skew[XY]\s*\({_S}{_N})\){_S})*+"
)
NUMBERS: Final = re.compile(rf"{_S}(?:{_N})*+")
ONE: Final = re.compile(NUMBER)

LARGEST: Final = 1e100
"""Numbers from here on are damage."""

HALF: Final = 1e-7
"""A sweep this near to half a turn [rad] is one: how far its centre is off the chord is lost in rounding."""


def transform_of(node: Node, file: str) -> Array:
    """Return the map of the `transform` attribute, shape (4, 4).

    Raises
    ------
    InputError
        Where it is not understood.
    """
    text = node.attributes.get("transform", "")
    matrix = np.eye(4)
    if not text.strip() or text.strip() == "none":
        return matrix
    if _TRANSFORM.fullmatch(text) is None:
        raise InputError(
            f"{file}:{node.line}",
            "transform is not understood",
            expected="matrix, translate, scale, rotate, skewX or skewY of numbers",
            got=quoted(text),
        )
    from svgelements import Matrix

    try:
        made = Matrix(text)
    except (ArithmeticError, ValueError):
        where = f"{file}:{node.line}"
        raise InputError(where, "a coordinate is not a number", expected="finite numbers") from None
    matrix[:2, :2] = [[made.a, made.c], [made.b, made.d]]
    matrix[:2, 3] = made.e, made.f
    return matrix


def path_subpaths(node: Node, _view: View, file: str) -> Subpaths:
    """Yield the subpaths of a path.

    Raises
    ------
    InputError
        Where its data is not understood to the end.
    """
    text = node.attributes.get("d", "")
    if text.strip() == "none":
        return
    match = _DATA.match(text)
    end = match.end() if match else 0
    if end < len(text):
        raise InputError(
            f"{file}:{node.line}",
            "path data is not understood",
            expected="SVG path commands with their numbers",
            got=shown(text, end),
        )
    if not all(abs(float(word)) < LARGEST for word in ONE.findall(text)):
        raise InputError(f"{file}:{node.line}", "a coordinate is not a number", expected="finite numbers")
    try:
        yield from _subpaths(text)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        raise InputError(
            f"{file}:{node.line}",
            "an arc of the path has no shape",
            expected="radii above 0",
            got=shown(text, 20),
        ) from None


def _subpaths(text: str) -> Subpaths:
    """Yield the subpaths of path data that is understood; what is closed ends there."""
    from svgelements import Path

    parsed = Path()
    parsed.parse(text)
    run: list[DrawnShape] = []
    for segment in parsed:
        kind = type(segment).__name__
        if kind != "Move" and (shape := _segment(segment)) is not None:
            run.append(shape)
        if kind in {"Move", "Close"} and run:
            yield run
            run = []
    if run:
        yield run


def shown(text: str, end: int) -> str:
    """Show the part of a text round a place."""
    return quoted(" ".join(text[max(0, end - 20) : end + 20].split()))


def _segment(segment: Any) -> DrawnShape | None:
    """Return the shape of a segment of svgelements; None where it goes nowhere."""
    kind = type(segment).__name__
    start, end = _pair(segment.start), _pair(segment.end)
    if kind in {"Line", "Close"}:
        return None if start == end else shapes.line(start, end)
    if kind == "QuadraticBezier":
        return shapes.bezier([start, _pair(segment.control), end])
    if kind == "CubicBezier":
        return shapes.bezier([start, _pair(segment.control1), _pair(segment.control2), end])
    return _elliptic(segment, start, end)


def _elliptic(segment: Any, start: tuple[float, float], end: tuple[float, float]) -> DrawnShape | None:
    """Return an elliptical arc as the arc of a circle, or as image of one."""
    if start == end:
        return None
    center = np.array(_pair(segment.center))
    u, v = np.array(_pair(segment.prx)) - center, np.array(_pair(segment.pry)) - center
    sweep = float(segment.sweep)
    if not (np.any(u) and np.any(v)):
        return shapes.line(start, end)
    if abs(abs(sweep) - math.pi) < HALF:
        center = 0.5 * (np.array(start) + np.array(end))
        sweep = math.copysign(math.pi, sweep)
    ray = np.linalg.solve(np.stack([u, v], axis=1), np.array(start) - center)
    if abs(np.linalg.norm(u) - np.linalg.norm(v)) <= shapes.ROUND * np.linalg.norm(u):
        return shapes.arc(start, end, center, "ccw" if sweep > 0.0 else "cw")
    matrix = np.eye(4)
    matrix[:2, :2], matrix[:2, 3] = np.stack([u, v], axis=1), center
    made = shapes.transformed(shapes.unit_arc(math.atan2(ray[1], ray[0]), sweep), matrix)
    return shapes.with_ends(made, np.array([*start, 0.0]), np.array([*end, 0.0]))


def _pair(point: Any) -> tuple[float, float]:
    return float(point.x), float(point.y)


def curves_of(node: Node, view: View, file: str) -> Subpaths:
    """Yield the runs of a shape or path.

    Raises
    ------
    InputError
        Where its numbers are damaged.
    RelativeLengthError
        Where a length has no size by itself.
    """
    return SHAPES[node.tag](node, view, file)


def _rect(node: Node, view: View, _file: str) -> Subpaths:
    x, y, width, height = (_size(node, key, view) for key in ("x", "y", "width", "height"))
    if width < 0.0 or height < 0.0:
        raise RelativeLengthError("a negative size")
    if width == 0.0 or height == 0.0:
        yield []
        return
    rx, ry = _corner(node, view)
    rx, ry = min(rx, 0.5 * width), min(ry, 0.5 * height)
    right, low = x + width, y + height
    if rx == 0.0 or ry == 0.0:
        yield _closed([(x, y), (right, y), (right, low), (x, low)])
        return
    run = []
    corners = (
        ((x + rx, y), (right - rx, y), (right - rx, y + ry), -0.5 * math.pi),
        ((right, y + ry), (right, low - ry), (right - rx, low - ry), 0.0),
        ((right - rx, low), (x + rx, low), (x + rx, low - ry), 0.5 * math.pi),
        ((x, low - ry), (x, y + ry), (x + rx, y + ry), math.pi),
    )
    for number, (start, end, center, angle) in enumerate(corners):
        if start != end:
            run.append(shapes.line(start, end))
        run.append(_quarter(end, corners[(number + 1) % 4][0], center, (rx, ry), angle))
    yield run


def _corner(node: Node, view: View) -> tuple[float, float]:
    """Return both radii; one that is not given is as the other."""
    given = [node.attributes.get(key, "auto").strip() for key in ("rx", "ry")]
    sizes = [None if text == "auto" else length(text, whole_of(view, k)) for k, text in enumerate(given)]
    if any(size is not None and size < 0.0 for size in sizes):
        raise RelativeLengthError("a negative radius")
    rx, ry = (
        (sizes[0] if sizes[0] is not None else sizes[1]),
        (sizes[1] if sizes[1] is not None else sizes[0]),
    )
    return rx or 0.0, ry or 0.0


def _quarter(
    start: Sequence[float],
    end: Sequence[float],
    center: Sequence[float],
    radii: Sequence[float],
    angle: float,
) -> DrawnShape:
    if radii[0] == radii[1]:
        return shapes.arc(start, end, center, "ccw")
    made = shapes.transformed(shapes.unit_arc(angle, 0.5 * math.pi), _ellipse_map(center, radii))
    return shapes.with_ends(made, np.array([*start, 0.0]), np.array([*end, 0.0]))


def _round(node: Node, view: View, _file: str) -> Subpaths:
    """Yield a circle or ellipse, from its rightmost point on."""
    center = [_size(node, key, view) for key in ("cx", "cy")]
    if node.tag == "circle":
        whole = None if view is None else math.hypot(*view) / math.sqrt(2.0)
        radii = [length(node.attributes.get("r", "0"), whole)] * 2
    else:
        radii = list(_corner(node, view))
    if min(radii) < 0.0:
        raise RelativeLengthError("a negative radius")
    if min(radii) == 0.0:
        yield []
        return
    start = (center[0] + radii[0], center[1])
    circle = shapes.arc(start, start, center, "ccw")
    yield [
        circle
        if radii[0] == radii[1]
        else shapes.transformed(shapes.unit_arc(0.0, math.tau), _ellipse_map(center, radii))
    ]


def _ellipse_map(center: Sequence[float], radii: Sequence[float]) -> Array:
    matrix = np.diag([radii[0], radii[1], 1.0, 1.0])
    matrix[:2, 3] = center
    return matrix


def _straight(node: Node, view: View, _file: str) -> Subpaths:
    ends = [(_size(node, f"x{k}", view), _size(node, f"y{k}", view)) for k in (1, 2)]
    yield [] if ends[0] == ends[1] else [shapes.line(*ends)]


def _poly(node: Node, _view: View, file: str) -> Subpaths:
    text = node.attributes.get("points", "")
    numbers = [float(word) for word in ONE.findall(text)] if NUMBERS.fullmatch(text) else []
    if len(numbers) % 2 or (not numbers and text.strip()):
        raise InputError(
            f"{file}:{node.line}",
            "points are not understood",
            expected="pairs of numbers",
            got=shown(text, min(len(text), 20)),
        )
    points = list(zip(numbers[::2], numbers[1::2], strict=True))
    if node.tag == "polygon":
        yield _closed(points)
    else:
        yield [shapes.line(a, b) for a, b in pairwise(points) if a != b]


def _closed(points: Sequence[tuple[float, float]]) -> list[DrawnShape]:
    return [shapes.line(a, b) for a, b in pairwise((*points, *points[:1])) if a != b]


def _size(node: Node, key: str, view: View) -> float:
    across = 1 if key in {"y", "height", "cy", "y1", "y2"} else 0
    text = node.attributes.get(key, "0").strip()
    return length("0" if text == "auto" else text, whole_of(view, across))


SHAPES: Final[dict[str, Callable[[Node, View, str], Subpaths]]] = {
    "path": path_subpaths,
    "rect": _rect,
    "circle": _round,
    "ellipse": _round,
    "line": _straight,
    "polyline": _poly,
    "polygon": _poly,
}
