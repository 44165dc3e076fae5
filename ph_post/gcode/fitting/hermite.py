"""Hermite interpolants through vertices that no line or arc explains: PH quintics in a plane, cubics in space."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.gcode.fitting.samples import ROUND, SMOOTH, STRAIGHT, is_flat
from ph_post.types import Array, BoolArray, IntArray

AHEAD: Final = 0.3
"""Least cosine between an end tangent and the chord of an interpolant: beyond that it bulges or loops."""

SAGITTAS: Final = 2.0
"""How many times its own sagitta, as the turns at its ends have it, a curve may leave a chord: on a curve
whose curvature changes the turns at both ends are not the one in between."""


@inner
def _ph_quintic(points: Array, i: int, j: int, d0: Array, d1: Array, control: Array, speed: Array) -> None:
    """PH quintic of the plane with these end derivatives [1]; of the four the one that is near the cubic [2].

    That is the one whose preimage w(t) turns least: all of w_0, w_1 and w_2 lie on one side.
    """
    chord = complex(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1])
    a, b = complex(d0[0], d0[1]), complex(d1[0], d1[1])
    w0, w2 = np.sqrt(a), np.sqrt(b)
    if (w0.conjugate() * w2).real < 0.0:
        w2 = -w2
    root = np.sqrt(120.0 * chord - 15.0 * (a + b) + 10.0 * w0 * w2)
    w1 = 0.25 * (-3.0 * (w0 + w2) + root)
    if ((w0 + w2).conjugate() * root).real < 0.0:
        w1 = 0.25 * (-3.0 * (w0 + w2) - root)
    steps = (w0 * w0, w0 * w1, (2.0 * w1 * w1 + w0 * w2) / 3.0, w1 * w2, w2 * w2)
    for axis in range(3):
        control[0, axis], control[5, axis] = points[i, axis], points[j, axis]
    for k in range(4):
        control[k + 1, 0] = control[k, 0] + 0.2 * steps[k].real
        control[k + 1, 1] = control[k, 1] + 0.2 * steps[k].imag
        control[k + 1, 2] = points[i, 2]
    speed[0], speed[4] = abs(w0) ** 2, abs(w2) ** 2
    speed[1], speed[3] = (w0.conjugate() * w1).real, (w1.conjugate() * w2).real
    speed[2] = (2.0 * abs(w1) ** 2 + (w0.conjugate() * w2).real) / 3.0


@lean
def _cubic(points: Array, i: int, j: int, d0: Array, d1: Array, control: Array) -> None:
    for axis in range(3):
        control[0, axis], control[3, axis] = points[i, axis], points[j, axis]
        control[1, axis] = points[i, axis] + d0[axis] / 3.0
        control[2, axis] = points[j, axis] - d1[axis] / 3.0


@inner
def _interpolate(
    points: Array, along: Array, tangent: Array, i: int, j: int, flat: bool, control: Array, speed: Array
) -> int:
    """Write the interpolant from vertex i to j; its degree, 0 where its ends do not look ahead."""
    size = along[j] - along[i]
    ahead0, ahead1, chord = 0.0, 0.0, 0.0
    for axis in range(3):
        step = points[j, axis] - points[i, axis]
        chord += step * step
        ahead0 += step * tangent[i, 1, axis]
        ahead1 += step * tangent[j, 0, axis]
    if min(ahead0, ahead1) < AHEAD * math.sqrt(chord) or chord == 0.0:
        return 0
    d0, d1 = np.empty(3), np.empty(3)
    for axis in range(3):
        d0[axis], d1[axis] = size * tangent[i, 1, axis], size * tangent[j, 0, axis]
    if flat and tangent[i, 1, 2] == 0.0 and tangent[j, 0, 2] == 0.0:
        _ph_quintic(points, i, j, d0, d1, control, speed)
        return 5
    _cubic(points, i, j, d0, d1, control)
    return 3


@lean
def _evaluate(control: Array, degree: int, u: float, value: Array, slope: Array) -> None:
    """Point and derivative by de Casteljau."""
    for axis in range(3):
        c0, c1, c2 = control[0, axis], control[1, axis], control[2, axis]
        c3 = control[3, axis]
        v = 1.0 - u
        if degree == 5:
            c4, c5 = control[4, axis], control[5, axis]
            c0, c1, c2 = v * c0 + u * c1, v * c1 + u * c2, v * c2 + u * c3
            c3, c4 = v * c3 + u * c4, v * c4 + u * c5
            c0, c1, c2, c3 = v * c0 + u * c1, v * c1 + u * c2, v * c2 + u * c3, v * c3 + u * c4
        c0, c1, c2 = v * c0 + u * c1, v * c1 + u * c2, v * c2 + u * c3
        c0, c1 = v * c0 + u * c1, v * c1 + u * c2
        value[axis], slope[axis] = v * c0 + u * c1, degree * (c1 - c0)


@lean
def _foot(points: Array, k: int, control: Array, degree: int, u: float, value: Array, slope: Array) -> float:
    """Parameter at which a curve is nearest to vertex k, from nearby; `value` is the point there."""
    for _ in range(3):
        _evaluate(control, degree, u, value, slope)
        top, square = 0.0, 0.0
        for axis in range(3):
            top += (points[k, axis] - value[axis]) * slope[axis]
            square += slope[axis] * slope[axis]
        if square == 0.0:
            break
        u = min(max(u + top / square, 0.0), 1.0)
    _evaluate(control, degree, u, value, slope)
    return u


@lean
def _from_chord(points: Array, k: int, value: Array) -> tuple[float, float]:
    """Distance of a point from the chord between vertices k and k + 1."""
    along, square, size = 0.0, 0.0, 0.0
    for axis in range(3):
        step, way = points[k + 1, axis] - points[k, axis], value[axis] - points[k, axis]
        along += step * way
        square += step * step
        size += way * way
    share = min(max(along / square, 0.0), 1.0)
    return math.sqrt(max(size - share * (2.0 * along - share * square), 0.0)), math.sqrt(square)


@inner
def _fits(
    points: Array,
    along: Array,
    turn: Array,
    i: int,
    j: int,
    control: Array,
    degree: int,
    tolerance: float,
    foot: Array,
) -> bool:
    """Return True if all vertices are near the curve, in order, and the curve between them near the chords."""
    value, slope = np.empty(3), np.empty(3)
    before, size = 0.0, along[j] - along[i]
    for k in range(i + 1, j + 1):
        u = 1.0
        if k < j:
            u = _foot(points, k, control, degree, (along[k] - along[i]) / size, value, slope)
            off = 0.0
            for axis in range(3):
                off += (points[k, axis] - value[axis]) ** 2
            if u <= before or off > tolerance * tolerance:
                return False
            foot[k] = u
        _evaluate(control, degree, 0.5 * (before + u), value, slope)
        off, chord = _from_chord(points, k - 1, value)
        if off > tolerance + SAGITTAS * chord * (turn[k - 1] + turn[k]) / 16.0:
            return False
        before = u
    return True


@lean
def _longest(
    points: Array,
    along: Array,
    turn: Array,
    tangent: Array,
    i: int,
    last: int,
    flat: bool,
    tolerance: float,
    control: Array,
    speed: Array,
    foot: Array,
) -> int:
    """Farthest vertex up to which one interpolant from i fits, found by doubling and bisection; i if none."""
    good, step, bad = i, 1, last + 1
    while good < last:
        j = min(i + step, last)
        degree = _interpolate(points, along, tangent, i, j, flat, control, speed)
        if degree == 0 or not _fits(points, along, turn, i, j, control, degree, tolerance, foot):
            bad = j
            break
        good, step = j, 2 * step
    while bad - good > 1 and good > i:
        middle = (good + bad) // 2
        degree = _interpolate(points, along, tangent, i, middle, flat, control, speed)
        if degree > 0 and _fits(points, along, turn, i, middle, control, degree, tolerance, foot):
            good = middle
        else:
            bad = middle
    return good


@compiled
def _fill(
    points: Array,
    along: Array,
    turn: Array,
    tangent: Array,
    lines: BoolArray,
    stops: BoolArray,
    taken: IntArray,
    tolerance: float,
    kinds: IntArray,
    firsts: IntArray,
    lasts: IntArray,
    foot: Array,
) -> int:
    n, count, i = len(points), 0, 0
    last, level = 0, 0
    control, speed = np.zeros((6, 3)), np.zeros(5)
    while i < n - 1:
        if taken[i] > 0:
            j, kind = taken[i], ROUND
        elif lines[i]:
            j, kind = i + 1, STRAIGHT
            while j < n - 1 and lines[j] and not stops[j]:
                j += 1
        else:
            if last <= i:  # once for all pieces of a stretch, which may be the whole program
                last = i + 1
                while last < n - 1 and not lines[last] and not stops[last] and taken[last] == 0:
                    last += 1
                level = last
                while level > i and points[level - 1, 2] == points[last, 2]:
                    level -= 1
            flat, kind = level <= i, SMOOTH
            j = _longest(points, along, turn, tangent, i, last, flat, tolerance, control, speed, foot)
            if j == i:
                j, kind = i + 1, STRAIGHT
        kinds[count], firsts[count], lasts[count] = kind, i, j
        count += 1
        i = j
    return count


@compiled
def _write(
    points: Array,
    along: Array,
    turn: Array,
    tangent: Array,
    firsts: IntArray,
    lasts: IntArray,
    tolerance: float,
    control: Array,
    speed: Array,
    degree: IntArray,
    foot: Array,
) -> None:
    for number in range(len(firsts)):
        i, j = firsts[number], lasts[number]
        flat = is_flat(points, i, j)
        degree[number] = _interpolate(points, along, tangent, i, j, flat, control[number], speed[number])
        _fits(points, along, turn, i, j, control[number], degree[number], tolerance, foot)


def fill_pieces(
    points: Array,
    along: Array,
    turn: Array,
    tangent: Array,
    lines: BoolArray,
    stops: BoolArray,
    taken: IntArray,
    tolerance: float,
) -> tuple[IntArray, IntArray, IntArray, Array]:
    """Go from piece to piece, each interpolant as long as it fits.

    Parameters
    ----------
    points, along, turn, tangent, lines
        See :func:`ph_post.gcode.fitting.polyline.find_tangents`.
    stops : BoolArray, shape (n,)
        Vertices that no piece may run across.
    taken : IntArray, shape (n,)
        Where an arc or a line begins that is known already, the vertex at its end; 0 elsewhere.
    tolerance : float
        How far vertices may be off the curve, and the curve off its chords but for their sagittas [m].

    Returns
    -------
    kind, first, last : IntArray, shape (p,)
        Kinds as in :mod:`ph_post.gcode.fitting.samples`; what is taken counts as ROUND.
    foot : Array, shape (n,)
        Parameters nearest to the vertices inside interpolants.
    """
    n = len(points)
    kinds, firsts, lasts = (np.zeros(n, dtype=np.int64) for _ in range(3))
    foot = np.zeros(n)
    count = _fill(points, along, turn, tangent, lines, stops, taken, tolerance, kinds, firsts, lasts, foot)
    return kinds[:count], firsts[:count], lasts[:count], foot


def write_interpolants(
    points: Array,
    along: Array,
    turn: Array,
    tangent: Array,
    first: IntArray,
    last: IntArray,
    tolerance: float,
    foot: Array,
) -> tuple[Array, Array, IntArray]:
    """Return control points (p, 6, 3), speeds (p, 5) and degrees (p,); `foot` gets the vertices inside."""
    control, speed = np.zeros((first.size, 6, 3)), np.zeros((first.size, 5))
    degree = np.zeros(first.size, dtype=np.int64)
    _write(points, along, turn, tangent, first, last, tolerance, control, speed, degree, foot)
    return control, speed, degree
