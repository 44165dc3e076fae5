"""Contours as the text of a path file, every number as it is."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ph_post.io.drawing.chains import Contour
from ph_post.io.drawing.joints import SAME
from ph_post.io.drawing.record import UNITS
from ph_post.io.drawing.shapes import Shape
from ph_post.types import Array


def path_text(
    contours: Sequence[Contour], unit: str, feed: Fraction, axes: str, names: tuple[str, str]
) -> str:
    """Return the text of a path file, a line to a segment; rapids lead from contour to contour.

    Parameters
    ----------
    contours : sequence of Contour
        In the order in which they are cut.
    unit : str
        Their unit, one that a path file has.
    feed : Fraction
        In this unit per minute.
    axes : {"XY", "XYZ"}
    names : (str, str)
        The path's, and the drawing's.
    """
    width = len(axes)
    segments: list[dict[str, Any]] = []
    last: Array | None = None
    for contour in contours:
        first = contour.shapes[0].start
        if last is not None and float(np.linalg.norm(first - last)) > 2.0 * SAME / float(UNITS[unit]):
            segments.append({"type": "line", "points": _rows([last, first], width), "rapid": True})
        segments.extend(_segment(shape, width) for shape in contour.shapes)
        last = contour.shapes[-1].end
    head = {
        "format": "ph-post-path", "version": 1,
        "name": _printable(names[0]), "source": f"drawing {_printable(names[1])}",
        "units": unit, "axes": list(axes), "feed": _exact(feed),
        "closed": len(contours) == 1 and contours[0].closed,
    }  # fmt: skip
    lines = ",\n  ".join(json.dumps(segment) for segment in segments)
    return f'{json.dumps(head)[:-1]},\n "segments": [\n  {lines}\n ]}}\n'


def _segment(shape: Shape, width: int) -> dict[str, Any]:
    """Return a shape as a segment of a path file, its numbers as they are."""
    rows = _rows(shape.points, width)
    if shape.kind == "arc":
        return {"type": "arc", "start": rows[0], "end": rows[1], "center": rows[2], "turn": shape.turn}
    if shape.knots is None:
        return {"type": shape.kind, "points": rows}
    made = {"type": "nurbs", "degree": len(shape.knots) - len(rows) - 1, "knots": _numbers(shape.knots)}
    weights = {} if shape.weights is None else {"weights": _numbers(shape.weights)}
    return {**made, "points": rows, **weights}


def _rows(points: Sequence[Array] | Array, width: int) -> list[list[float | int]]:
    return [_numbers(point[:width]) for point in points]


def _numbers(values: Array) -> list[float | int]:
    """Return numbers as JSON writes them shortest; what is whole is written whole."""
    return [int(x) if x == math.floor(x) and abs(x) < 1e15 else float(x) for x in values.tolist()]


def _exact(value: Fraction) -> float | int | str:
    """Return a number, or where a double cannot hold it, an exact rational string."""
    if value.denominator == 1:
        return value.numerator
    return float(value) if Fraction(float(value)) == value else f"{value.numerator}/{value.denominator}"


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else " " for letter in text)
