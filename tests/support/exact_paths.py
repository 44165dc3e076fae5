"""The curves of path files, evaluated from their definition in 50 digits, in mm."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import mpmath

SCALE = {"mm": 1, "m": 1000}
Curve = Callable[[mpmath.mpf], list[mpmath.mpf]]


def exact_curves(file: Path) -> list[tuple[dict[str, Any], Curve, list[mpmath.mpf]]]:
    """Segments of a path file, each with its curve, and the parameters between which that is smooth."""
    path = json.loads(file.read_text(), parse_float=Fraction)
    scale = SCALE[path["units"]]
    return [(one, *_CURVES[one["type"]](one, path["axes"], scale)) for one in path["segments"]]


def _numbers(row: Sequence[Any], scale: int = 1) -> list[mpmath.mpf]:
    return [scale * _mp(one) for one in row]


def _mp(value: Any) -> mpmath.mpf:
    number = Fraction(value)
    return mpmath.mpf(number.numerator) / number.denominator


def _bezier(one: dict[str, Any], axes: list[str], scale: int) -> tuple[Curve, list[mpmath.mpf]]:
    points = [_numbers(point, scale) for point in one["points"]]

    def curve(xi: mpmath.mpf) -> list[mpmath.mpf]:
        rows = points
        while len(rows) > 1:
            rows = [[(1 - xi) * a + xi * b for a, b in zip(p, q, strict=True)]
                    for p, q in pairwise(rows)]  # fmt: skip
        return rows[0]

    return curve, [mpmath.mpf(0), mpmath.mpf(1)]


def _polynomial(one: dict[str, Any], axes: list[str], scale: int) -> tuple[Curve, list[mpmath.mpf]]:
    rows = [_numbers(one["coefficients"][axis], scale) for axis in axes]
    return (
        lambda xi: [mpmath.polyval(row[::-1], xi) for row in rows],
        _numbers(one.get("domain", [0, 1])),
    )


def _ph(one: dict[str, Any], axes: list[str], scale: int) -> tuple[Curve, list[mpmath.mpf]]:
    """Integrate the hodograph's products term by term in the power basis."""
    start = _numbers(one["start"], scale)
    parts = [_power(column) for column in zip(*[_numbers(row) for row in one["preimage"]], strict=True)]
    if len(axes) == 2:
        u, v = parts
        slopes = [_add((1, u, u), (-1, v, v)), _add((2, u, v))]
    else:
        u, v, p, q = parts
        slopes = [
            _add((1, u, u), (1, v, v), (-1, p, p), (-1, q, q)),
            _add((2, u, q), (2, v, p)),
            _add((2, v, q), (-2, u, p)),
        ]
    rows = [[0, *(scale * c / (k + 1) for k, c in enumerate(slope))] for slope in slopes]
    return (
        lambda xi: [a + mpmath.polyval(row[::-1], xi) for a, row in zip(start, rows, strict=True)],
        [mpmath.mpf(0), mpmath.mpf(1)],
    )


def _power(bernstein: Sequence[mpmath.mpf]) -> list[mpmath.mpf]:
    n = len(bernstein) - 1
    power = [mpmath.mpf(0)] * (n + 1)
    for k, value in enumerate(bernstein):
        for j in range(n - k + 1):
            power[k + j] += value * mpmath.binomial(n, k) * mpmath.binomial(n - k, j) * (-1) ** j
    return power


def _add(*terms: tuple[int, list[mpmath.mpf], list[mpmath.mpf]]) -> list[mpmath.mpf]:
    size = max(len(a) + len(b) - 1 for _, a, b in terms)
    total = [mpmath.mpf(0)] * size
    for factor, a, b in terms:
        for i, left in enumerate(a):
            for j, right in enumerate(b):
                total[i + j] += factor * left * right
    return total


def _nurbs(one: dict[str, Any], axes: list[str], scale: int) -> tuple[Curve, list[mpmath.mpf]]:
    """De Boor's rule in homogeneous coordinates."""
    degree, knots = one["degree"], _numbers(one["knots"])
    weights = _numbers(one.get("weights") or [1] * len(one["points"]))
    points = [
        [w * scale * _mp(c) for c in point] + [w] for point, w in zip(one["points"], weights, strict=True)
    ]

    def curve(xi: mpmath.mpf) -> list[mpmath.mpf]:
        span = max((k for k in range(degree, len(points)) if knots[k] <= xi), default=degree)
        while knots[span] == knots[span + 1]:
            span -= 1
        rows = [points[span - degree + j] for j in range(degree + 1)]
        for r in range(1, degree + 1):
            for j in range(degree, r - 1, -1):
                low, high = knots[span - degree + j], knots[span + 1 + j - r]
                t = (xi - low) / (high - low)
                rows[j] = [(1 - t) * a + t * b for a, b in zip(rows[j - 1], rows[j], strict=True)]
        last = rows[degree]
        return [c / last[-1] for c in last[:-1]]

    return curve, sorted(set(knots))


_CURVES = {"bezier": _bezier, "polynomial": _polynomial, "ph": _ph, "nurbs": _nurbs}
