"""The pieces of path files as quotients of polynomials in fractions, from their definition alone, in mm."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import reduce
from itertools import zip_longest
from math import comb
from pathlib import Path
from typing import Any

import msgspec

SCALE = {"mm": 1, "m": 1000}
Power = list[Fraction]
"""Coefficients of 1, u, u², …"""


class Piece(msgspec.Struct, frozen=True, kw_only=True):
    """A smooth piece for u from 0 to 1, `above` by axis, over `below`; of an arc center, radius and start."""

    above: list[Power] = []
    below: Power = msgspec.field(default_factory=lambda: [Fraction(1)])
    center: list[Fraction] | None = None
    radius: Fraction = Fraction(0)
    start: list[Fraction] = []

    @property
    def first(self) -> list[Fraction]:
        """Where the piece begins."""
        return self.start or [row[0] / self.below[0] for row in self.above]

    def part(self, low: Fraction, high: Fraction) -> Piece:
        """Return the piece from `low` to `high` for u from 0 to 1, the weight at its beginning being 1."""
        line = [low, high - low]
        above, below = [composed(row, line) for row in self.above], composed(self.below, line)
        weight = below[0]
        return Piece(above=[[c / weight for c in row] for row in above], below=[c / weight for c in below])


def exact_pieces(file: Path) -> tuple[list[str], list[Piece]]:
    """Axes of a path file, and its pieces in their order."""
    path = json.loads(file.read_text(), parse_float=Fraction)
    scale = Fraction(SCALE[path["units"]])
    axes = path["axes"]
    return axes, [piece for one in path["segments"] for piece in _SEGMENTS[one["type"]](one, axes, scale)]


def times(a: Power, b: Power) -> Power:
    """Product."""
    total = [Fraction(0)] * (len(a) + len(b) - 1)
    for i, left in enumerate(a):
        for j, right in enumerate(b):
            total[i + j] += left * right
    return total


def plus(a: Power, b: Power) -> Power:
    """Sum."""
    return [left + right for left, right in zip_longest(a, b, fillvalue=Fraction(0))]


def minus(a: Power, b: Power) -> Power:
    """Difference."""
    return plus(a, [-one for one in b])


def composed(outer: Power, inner: Power) -> Power:
    """outer(inner(u))."""
    return reduce(lambda total, c: plus(times(total, inner), [c]), reversed(outer), [Fraction(0)])


def bernstein(power: Power) -> Power:
    """Bernstein coefficients on [0, 1], between which the polynomial lies."""
    n = len(power) - 1
    return [sum((Fraction(comb(k, j), comb(n, j)) * power[j] for j in range(k + 1)), Fraction(0)) for k in range(n + 1)]


def from_bernstein(coefficients: Sequence[Fraction]) -> Power:
    """Power coefficients of what is given in Bernstein form."""
    n = len(coefficients) - 1
    power = [Fraction(0)] * (n + 1)
    for k, value in enumerate(coefficients):
        for j in range(n - k + 1):
            power[k + j] += value * comb(n, k) * comb(n - k, j) * (-1) ** j
    return power


def _numbers(row: Sequence[Any], scale: Fraction = Fraction(1)) -> list[Fraction]:
    return [scale * Fraction(one) for one in row]


def _bezier(one: dict[str, Any], axes: list[str], scale: Fraction) -> Iterator[Piece]:
    columns = zip(*(_numbers(point, scale) for point in one["points"]), strict=True)
    yield Piece(above=[from_bernstein(column) for column in columns])


def _polynomial(one: dict[str, Any], axes: list[str], scale: Fraction) -> Iterator[Piece]:
    low, high = _numbers(one.get("domain", [0, 1]))
    rows = [_numbers(one["coefficients"][axis], scale) for axis in axes]
    yield Piece(above=[composed(row, [low, high - low]) for row in rows])


def _ph(one: dict[str, Any], axes: list[str], scale: Fraction) -> Iterator[Piece]:
    """Integrate the hodograph's products term by term."""
    start = _numbers(one["start"], scale)
    parts = [from_bernstein(column) for column in zip(*map(_numbers, one["preimage"]), strict=True)]
    if len(axes) == 2:
        u, v = parts
        slopes = [_sum((1, u, u), (-1, v, v)), _sum((2, u, v))]
    else:
        u, v, p, q = parts
        slopes = [
            _sum((1, u, u), (1, v, v), (-1, p, p), (-1, q, q)),
            _sum((2, u, q), (2, v, p)),
            _sum((2, v, q), (-2, u, p)),
        ]
    yield Piece(
        above=[
            [first, *(scale * c / (k + 1) for k, c in enumerate(slope))]
            for first, slope in zip(start, slopes, strict=True)
        ]
    )


def _sum(*terms: tuple[int, Power, Power]) -> Power:
    return reduce(plus, ([factor * c for c in times(a, b)] for factor, a, b in terms))


def _nurbs(one: dict[str, Any], axes: list[str], scale: Fraction) -> Iterator[Piece]:
    """De Boor's rule in homogeneous coordinates, its parameter a polynomial of u on each span."""
    degree, knots = one["degree"], _numbers(one["knots"])
    weights = _numbers(one.get("weights") or [1] * len(one["points"]))
    points = [[w * c for c in _numbers(point, scale)] + [w] for point, w in zip(one["points"], weights, strict=True)]
    for span in range(degree, len(points)):
        if knots[span] == knots[span + 1]:
            continue
        rows = [[[c] for c in points[span - degree + j]] for j in range(degree + 1)]
        for r in range(1, degree + 1):
            for j in range(degree, r - 1, -1):
                low, high = knots[span - degree + j], knots[span + 1 + j - r]
                t = [(knots[span] - low) / (high - low), (knots[span + 1] - knots[span]) / (high - low)]
                rows[j] = [
                    plus(times(minus([Fraction(1)], t), a), times(t, b))
                    for a, b in zip(rows[j - 1], rows[j], strict=True)
                ]
        *above, below = rows[degree]
        yield Piece(above=above, below=below)


def _arc(one: dict[str, Any], axes: list[str], scale: Fraction) -> Iterator[Piece]:
    start, center = _numbers(one["start"], scale), _numbers(one["center"], scale)
    square = sum(((a - b) ** 2 for a, b in zip(start, center, strict=True)), Fraction(0))
    radius = Fraction(round(float(square) ** 0.5))
    assert radius**2 == square
    yield Piece(center=center, radius=radius, start=start)


_SEGMENTS = {
    "line": _bezier,
    "bezier": _bezier,
    "polynomial": _polynomial,
    "ph": _ph,
    "nurbs": _nurbs,
    "arc": _arc,
}
