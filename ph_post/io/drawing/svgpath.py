"""SVG path data and transforms, in user units, y downwards as they stand there.

References
----------
.. [1] Scalable Vector Graphics (SVG) 1.1 (Second Edition), W3C 2011: 7.6 (transform attribute),
   8.3 (path data).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from ph_post.errors import InputError
from ph_post.io.drawing import shapes
from ph_post.io.drawing.shapes import Shape
from ph_post.io.drawing.svgsize import NUMBER, View
from ph_post.io.drawing.xmltree import Node
from ph_post.io.exact import quoted
from ph_post.types import Array

Runs = Iterator[Sequence[Shape]]

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
            f"{file}:{node.line}", "transform is not understood",
            expected="matrix, translate, scale, rotate, skewX or skewY of numbers", got=quoted(text),
        )  # fmt: skip
    from svgelements import Matrix

    try:
        made = Matrix(text)
    except (ArithmeticError, ValueError):
        where = f"{file}:{node.line}"
        raise InputError(where, "a coordinate is not a number", expected="finite numbers") from None
    matrix[:2, :2] = [[made.a, made.c], [made.b, made.d]]
    matrix[:2, 3] = made.e, made.f
    return matrix


def path_runs(node: Node, _view: View, file: str) -> Runs:
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
            f"{file}:{node.line}", "path data is not understood",
            expected="SVG path commands with their numbers", got=shown(text, end),
        )  # fmt: skip
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


def _subpaths(text: str) -> Runs:
    """Yield the subpaths of path data that is understood; what is closed ends there."""
    from svgelements import Path

    parsed = Path()
    parsed.parse(text)
    run: list[Shape] = []
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


def _segment(segment: Any) -> Shape | None:
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


def _elliptic(segment: Any, start: tuple[float, float], end: tuple[float, float]) -> Shape | None:
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
