"""Turning points of random paths against 50-digit mpmath, from the exact data on."""

from __future__ import annotations

import math
import random
from fractions import Fraction
from itertools import pairwise
from typing import Any

import mpmath
import numpy as np

from ph_post.analysis.turning_points import find_turning_points
from ph_post.geometry.curves import Polynomial
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.ph import PH
from ph_post.geometry.piecewise import PiecewiseCurve
from ph_post.geometry.track import Track

PATHS = 60
"""Of a thousand that tests/long tries."""

MM = Fraction(1, 1000)
Poly = list[Fraction]  # power coefficients, lowest first
Piece = tuple[Fraction, Fraction, list[Poly], Poly]  # xi from, to; numerators and the denominator in xi


def add(a: Poly, b: Poly, factor: int = 1) -> Poly:
    n = max(len(a), len(b))
    return [(a[k] if k < len(a) else Fraction(0)) + factor * (b[k] if k < len(b) else Fraction(0)) for k in range(n)]


def multiply(a: Poly, b: Poly) -> Poly:
    total = [Fraction(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            total[i + j] += x * y
    return total


def differentiate(a: Poly) -> Poly:
    return [k * x for k, x in enumerate(a)][1:] or [Fraction(0)]


def value(a: Poly, x: Fraction) -> Fraction:
    total = Fraction(0)
    for coefficient in reversed(a):
        total = total * x + coefficient
    return total


def on_unit_interval(a: Poly, first: Fraction, last: Fraction) -> Poly:
    """The same polynomial in u, x = first + u (last - first)."""
    total: Poly = [Fraction(0)]
    for coefficient in reversed(a):
        total = add(multiply(total, [first, last - first]), [coefficient])
    return total


def number(rng: random.Random, size: int, exact: bool) -> Fraction:
    """A random coordinate: of two decimals, or a double."""
    if exact:
        return Fraction(rng.randint(-100 * size, 100 * size), 100)
    return Fraction(rng.uniform(-size, size))


def nearest(x: Fraction, exact: bool) -> Fraction:
    return x if exact else Fraction(float(x))


def points(rng: random.Random, count: int, width: int, size: int, exact: bool) -> list[list[Fraction]]:
    return [[number(rng, size, exact) for _ in range(width)] for _ in range(count)]


def floats(values: Any, exact: bool) -> Any:
    """Exact numbers count millimetres, as in a file; doubles are metres as they are."""
    if isinstance(values, Fraction):
        return float(values * MM) if exact else float(values)
    return [floats(entry, exact) for entry in values]


def frozen(rows: list[list[Fraction]]) -> tuple[tuple[Fraction, ...], ...]:
    return tuple(tuple(row) for row in rows)


def polynomial(rng: random.Random, start: list[Fraction], exact: bool) -> tuple[PiecewiseCurve, list[Piece]]:
    first, last = sorted(rng.sample(range(-3, 4), 2))
    rows = points(rng, len(start), rng.randint(3, 7), 10, exact)
    domain = (Fraction(first), Fraction(last))
    for row, place in zip(rows, start, strict=True):
        row[0] = nearest(row[0] + place - value(row, domain[0]), exact)
    data = (frozen(rows), domain) if exact else None
    curve = Polynomial(floats(rows, exact), (first, last), exact=data)
    return curve, [(*domain, rows, [Fraction(1)])]


def bernstein(coefficients: list[Fraction]) -> Poly:
    """Power coefficients of a polynomial in Bernstein form."""
    n = len(coefficients) - 1
    total: Poly = [Fraction(0)]
    for k, coefficient in enumerate(coefficients):
        term: Poly = [coefficient * math.comb(n, k)]
        for factor in [[Fraction(0), Fraction(1)]] * k + [[Fraction(1), Fraction(-1)]] * (n - k):
            term = multiply(term, factor)
        total = add(total, term)
    return total


def ph(rng: random.Random, start: list[Fraction], exact: bool) -> tuple[PiecewiseCurve, list[Piece]]:
    preimage = points(rng, rng.randint(2, 4), 2 * len(start) - 2, 4, exact)
    parts = [bernstein(list(column)) for column in zip(*preimage, strict=True)]
    square = [multiply(part, part) for part in parts]
    if len(start) == 2:
        u, v = parts
        velocities = [add(square[0], square[1], -1), [2 * x for x in multiply(u, v)]]
    else:
        u, v, p, q = parts
        velocities = [
            add(add(square[0], square[1]), add(square[2], square[3]), -1),
            [2 * x for x in add(multiply(u, q), multiply(v, p))],
            [2 * x for x in add(multiply(v, q), multiply(u, p), -1)],
        ]
    rows = [
        [place, *(x / (k + 1) for k, x in enumerate(velocity))]
        for place, velocity in zip(start, velocities, strict=True)
    ]
    data = (tuple(start), frozen(preimage)) if exact else None
    scaled = np.array([[float(x) for x in row] for row in preimage]) * (math.sqrt(MM) if exact else 1.0)
    curve = PH(floats(start, exact), scaled, exact=data)
    return curve, [(Fraction(0), Fraction(1), rows, [Fraction(1)])]


def basis(i: int, p: int, t: list[Fraction], span: int) -> Poly:
    """Cox and de Boor's recursion for N_ip on one knot span, as a polynomial."""
    if p == 0:
        return [Fraction(int(i == span))]
    total: Poly = [Fraction(0)]
    if t[i + p] > t[i]:
        width = t[i + p] - t[i]
        total = add(total, multiply([-t[i] / width, 1 / width], basis(i, p - 1, t, span)))
    if t[i + p + 1] > t[i + 1]:
        width = t[i + p + 1] - t[i + 1]
        total = add(total, multiply([t[i + p + 1] / width, -1 / width], basis(i + 1, p - 1, t, span)))
    return total


def nurbs(rng: random.Random, start: list[Fraction], exact: bool) -> tuple[PiecewiseCurve, list[Piece]]:
    degree = rng.randint(2, 4)
    inner = sorted(Fraction(rng.randint(1, 15), 4) for _ in range(rng.randint(0, 2)))
    if len(set(inner)) < len(inner):
        inner = inner[:1]
    t = [Fraction(0)] * (degree + 1) + inner + [Fraction(4)] * (degree + 1)
    control = points(rng, len(t) - degree - 1, len(start), 20, exact)
    control[0] = start
    rational = degree < 4 and rng.random() < 0.5
    weights = [Fraction(rng.randint(1, 12), 4) if rational else Fraction(1) for _ in control]
    data = (tuple(t), frozen(control), tuple(weights) if rational else None) if exact else None
    plain = [float(w) for w in weights] if rational else None
    curve = Nurbs(degree, [float(x) for x in t], floats(control, exact), plain, exact=data)
    pieces: list[Piece] = []
    for span in range(degree, len(t) - degree - 1):
        if t[span] == t[span + 1]:
            continue
        active = [(basis(i, degree, t, span), i) for i in range(span - degree, span + 1)]
        rows: list[Poly] = [[Fraction(0)] for _ in start]
        bottom: Poly = [Fraction(0)]
        for function, i in active:
            bottom = add(bottom, [weights[i] * x for x in function])
            rows = [
                add(row, [weights[i] * place * x for x in function])
                for row, place in zip(rows, control[i], strict=True)
            ]
        pieces.append((t[span], t[span + 1], rows, bottom))
    return curve, pieces


def real_roots(a: Poly) -> list[Any]:
    """Roots in (0, 1), ascending, to 50 digits."""
    while len(a) > 1 and a[-1] == 0:
        a = a[:-1]
    if len(a) == 1:
        return []
    rough = np.roots([float(x) for x in reversed(a)])
    coefficients = [mpmath.mpf(x.numerator) / x.denominator for x in reversed(a)]
    guess = [mpmath.mpc(complex(z)) for z in rough]
    roots = mpmath.polyroots(coefficients, maxsteps=100, extraprec=20, roots_init=guess)
    real = [mpmath.re(z) for z in roots if abs(mpmath.im(z)) < mpmath.mpf("1e-30")]
    return sorted(root for root in real if 0 < root < 1)


def reference(segments: list[list[Piece]]) -> list[tuple[int, int, str, Any]]:
    """Segment, axis, sense and xi of every reversal, from the signs of the velocities between all roots."""
    found = []
    for axis in range(len(segments[0][0][2])):
        before: tuple[bool, int, Any] | None = None  # rising, segment and xi where the stretch ends
        for number_, pieces in enumerate(segments):
            for first, last, rows, bottom in pieces:
                top = rows[axis]
                velocity = add(multiply(differentiate(top), bottom), multiply(top, differentiate(bottom)), -1)
                local = on_unit_interval(velocity, first, last)
                places = [mpmath.mpf(0), *real_roots(local), mpmath.mpf(1)]
                for low, high in pairwise(places):
                    middle = Fraction(float((low + high) / 2))
                    rising = value(local, middle) > 0
                    if before is not None and before[0] != rising:
                        found.append((before[1], axis, "max" if before[0] else "min", before[2]))
                    xi = mpmath.mpf(first.numerator) / first.denominator
                    width = mpmath.mpf((last - first).numerator) / (last - first).denominator
                    before = (rising, number_, xi + high * width)
    return sorted(found, key=lambda entry: (entry[0], entry[3], entry[1]))


def random_path(rng: random.Random) -> tuple[Track, list[list[Piece]]]:
    dimension = rng.choice([2, 2, 3])
    exact = rng.random() < 0.6
    start = [number(rng, 10, exact) for _ in range(dimension)]
    curves, segments = [], []
    for _ in range(rng.choice([1, 1, 2])):
        curve, pieces = rng.choice([polynomial, ph, nurbs])(rng, start, exact)
        curves.append(curve)
        segments.append(pieces)
        _, last, rows, bottom = pieces[-1]
        start = [nearest(value(row, last) / value(bottom, last), exact) for row in rows]
    return Track.from_curves(curves), segments


def are_as_computed_exactly(paths: int) -> None:
    """Same count, axes and senses; places within 1e-13 of the domain's length."""
    rng = random.Random(20240229)
    total, worst = 0, 0.0
    with mpmath.workdps(50):
        for _ in range(paths):
            track, segments = random_path(rng)
            points_ = find_turning_points(track)
            expected = reference(segments)
            assert [(p.segment, "XYZ".index(p.axis), p.sense) for p in points_] == [e[:3] for e in expected]
            for point, (segment, _, _, xi) in zip(points_, expected, strict=True):
                low, high = track.path.segments[segment].curve.domain
                worst = max(worst, float(abs(point.xi - xi)) / (high - low))
            total += len(points_)
    assert total > 3 * paths
    assert worst < 1e-13


def test_random_paths() -> None:
    are_as_computed_exactly(PATHS)
