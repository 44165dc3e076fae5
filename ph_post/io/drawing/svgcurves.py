"""The shapes of an SVG drawing as ours, in user units, y downwards as they stand there.

References
----------
.. [1] Scalable Vector Graphics (SVG) 1.1 (Second Edition), W3C 2011: 9 (basic shapes).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from ph_post.errors import InputError
from ph_post.io.drawing import shapes
from ph_post.io.drawing.shapes import Shape
from ph_post.io.drawing.svgpath import NUMBERS, ONE, Runs, path_runs, shown
from ph_post.io.drawing.svgsize import UnclearError, View, length, whole_of
from ph_post.io.drawing.xmltree import Node
from ph_post.types import Array


def curves_of(node: Node, view: View, file: str) -> Runs:
    """Yield the runs of a shape or path.

    Raises
    ------
    InputError
        Where its numbers are damaged.
    UnclearError
        Where a length has no size by itself.
    """
    return SHAPES[node.tag](node, view, file)


def _rect(node: Node, view: View, _file: str) -> Runs:
    x, y, width, height = (_size(node, key, view) for key in ("x", "y", "width", "height"))
    if width < 0.0 or height < 0.0:
        raise UnclearError("a negative size")
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
        raise UnclearError("a negative radius")
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
) -> Shape:
    if radii[0] == radii[1]:
        return shapes.arc(start, end, center, "ccw")
    made = shapes.transformed(shapes.unit_arc(angle, 0.5 * math.pi), _ellipse_map(center, radii))
    return shapes.with_ends(made, np.array([*start, 0.0]), np.array([*end, 0.0]))


def _round(node: Node, view: View, _file: str) -> Runs:
    """Yield a circle or ellipse, from its rightmost point on."""
    center = [_size(node, key, view) for key in ("cx", "cy")]
    if node.tag == "circle":
        whole = None if view is None else math.hypot(*view) / math.sqrt(2.0)
        radii = [length(node.attributes.get("r", "0"), whole)] * 2
    else:
        radii = list(_corner(node, view))
    if min(radii) < 0.0:
        raise UnclearError("a negative radius")
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


def _straight(node: Node, view: View, _file: str) -> Runs:
    ends = [(_size(node, f"x{k}", view), _size(node, f"y{k}", view)) for k in (1, 2)]
    yield [] if ends[0] == ends[1] else [shapes.line(*ends)]


def _poly(node: Node, _view: View, file: str) -> Runs:
    text = node.attributes.get("points", "")
    numbers = [float(word) for word in ONE.findall(text)] if NUMBERS.fullmatch(text) else []
    if len(numbers) % 2 or (not numbers and text.strip()):
        raise InputError(
            f"{file}:{node.line}", "points are not understood", expected="pairs of numbers",
            got=shown(text, min(len(text), 20)),
        )  # fmt: skip
    points = list(zip(numbers[::2], numbers[1::2], strict=True))
    if node.tag == "polygon":
        yield _closed(points)
    else:
        yield [shapes.line(a, b) for a, b in pairwise(points) if a != b]


def _closed(points: Sequence[tuple[float, float]]) -> list[Shape]:
    return [shapes.line(a, b) for a, b in pairwise((*points, *points[:1])) if a != b]


def _size(node: Node, key: str, view: View) -> float:
    across = 1 if key in {"y", "height", "cy", "y1", "y2"} else 0
    text = node.attributes.get(key, "0").strip()
    return length("0" if text == "auto" else text, whole_of(view, across))


SHAPES: Final[dict[str, Callable[[Node, View, str], Runs]]] = {
    "path": path_runs,
    "rect": _rect,
    "circle": _round,
    "ellipse": _round,
    "line": _straight,
    "polyline": _poly,
    "polygon": _poly,
}
