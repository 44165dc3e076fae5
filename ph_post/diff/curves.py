"""The tool path of a program as exact curves in columns, and closest points on them."""

from __future__ import annotations

import math
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.compiling import compiled, inner
from ph_post.gcode.program import CUBIC, NURBS, PLANE_AXES, Motions
from ph_post.geometry import exact_polynomials
from ph_post.geometry.nurbs import bezier_spans
from ph_post.types import Array, IntArray

START, END, CENTER, ANGLE, AXES, FIRST, ORDER = 0, 3, 6, 8, 9, 12, 13
"""Columns of a piece: start and end (3 each), centre (2), angle, the plane's axes (3), control points."""

COLUMNS: Final = 14

_NODES: Final = np.polynomial.legendre.leggauss(16)


class CurveTable(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The motions of a program as p pieces, one a motion but for NURBS.

    `motion` (p,) their motions; `table` (p, COLUMNS) what each is, SI units: an angle that is not zero makes
    an arc, an order that is not zero a Bézier piece with so many of the homogeneous `control` points (k, 4).
    `s` (p + 1,) [m] the way travelled up to each; `first` (m + 1,) the first piece of each motion.
    """

    motion: IntArray
    table: Array
    control: Array
    s: Array
    first: IntArray

    @property
    def length(self) -> float:
        """Way travelled, rapid moves included [m]."""
        return float(self.s[-1])

    def way(self, motion: IntArray | int) -> Array:
        """Way travelled before a motion [m]."""
        before: Array = np.asarray(self.s[self.first[motion]])
        return before

    def lengths(self) -> Array:
        """Length of every motion (m,) [m]."""
        return np.diff(self.s[self.first])


def curve_table(motions: Motions, shift: Array | None = None) -> CurveTable:
    """Return the tool path of a program.

    A coordinate that is not known yet is taken to be what it is when it is first known. `shift` (m, 3) [m],
    where given, is taken off the end of each motion, and off the start of the next.
    """
    start, end = _known(motions.start, motions.end)
    center = motions.center
    if shift is not None:
        start, end, center = _without(shift, start, end, motions)
    count = motions.kind.size
    table = np.zeros((count, COLUMNS))
    table[:, START:END], table[:, END:CENTER] = start, end
    table[:, CENTER:ANGLE], table[:, ANGLE] = center, motions.angle
    axes = np.array([PLANE_AXES[plane] for plane in (17, 18, 19)], dtype=np.float64)
    table[:, AXES:FIRST] = axes[np.clip(motions.plane, 17, 19) - 17]
    motion = np.arange(count, dtype=np.int64)
    curved = np.flatnonzero((motions.kind == CUBIC) | (motions.kind == NURBS))
    table, motion, control = _with_splines(motions, table, motion, curved)
    lengths = _lengths(table, control)
    s = np.concatenate([[0.0], np.cumsum(lengths, dtype=np.longdouble).astype(np.float64)])
    first = np.searchsorted(motion, np.arange(count + 1))
    return CurveTable(motion=motion, table=table, control=control, s=s, first=first)


def _known(start: Array, end: Array) -> tuple[Array, Array]:
    """Fill unknown coordinates: they become the next known of their axis."""
    if np.isfinite(start).all() and np.isfinite(end).all():
        return start, end
    both = np.stack([start, end], axis=1).reshape(-1, 3).copy()
    for values in both.T:
        known = np.flatnonzero(np.isfinite(values))
        if known.size == 0:
            values[:] = 0.0
            continue
        nearest = known[np.minimum(np.searchsorted(known, np.arange(values.size)), known.size - 1)]
        values[:] = np.where(np.isfinite(values), values, values[nearest])
    return both[0::2], both[1::2]


def _without(shift: Array, start: Array, end: Array, motions: Motions) -> tuple[Array, Array, Array]:
    """Take a shift off starts, ends and centres."""
    before = np.zeros_like(shift)
    before[1:] = shift[:-1]
    pairs = np.array([PLANE_AXES[plane][:2] for plane in (17, 18, 19)])
    pair = pairs[np.clip(motions.plane, 17, 19) - 17]
    return start - before, end - shift, motions.center - np.take_along_axis(shift, pair, axis=1)


def _with_splines(motions: Motions, table: Array, motion: IntArray, curved: IntArray) -> tuple[Array, IntArray, Array]:
    """Put Bézier pieces in place of the rows of splines."""
    rows: list[Array] = []
    owners: list[int] = []
    points: list[Array] = [np.zeros((0, 4))]
    count = 0
    for k in curved.tolist():
        for piece in _bezier_pieces(motions, k, table[k, START:END]):
            row = table[k].copy()
            row[START:END], row[END:CENTER] = piece[0, :3] / piece[0, 3], piece[-1, :3] / piece[-1, 3]
            row[ANGLE], row[FIRST], row[ORDER] = 0.0, count, len(piece)
            count += len(piece)
            rows.append(row)
            owners.append(k)
            points.append(piece)
    if not rows:
        return table, motion, points[0]
    plain = np.ones(len(table), dtype=bool)
    plain[owners] = False
    owner = np.concatenate([motion[plain], owners])
    order = np.argsort(owner, kind="stable")
    return np.concatenate([table[plain], rows])[order], owner[order], np.concatenate(points)


def _bezier_pieces(motions: Motions, k: int, start: Array) -> list[Array]:
    """Homogeneous control points of the pieces of a spline, which begins at `start`."""
    if k in motions.control:
        control = _filled(np.asarray(motions.control[k]), start)
        return [np.column_stack([control, np.ones(len(control))])]
    order, points, weights = motions.nurbs[k]
    knots = clamped_knots(order, len(points))
    homogeneous = np.column_stack([_filled(points, start) * weights[:, None], weights])
    spans = bezier_spans(order - 1, exact_polynomials.rows([knots])[0], exact_polynomials.rows(homogeneous))
    return [np.array(exact_polynomials.floats(control)) for _, control in spans]


def _filled(points: Array, start: Array) -> Array:
    """Put an axis that is not known yet where the outline has it."""
    return np.where(np.isnan(points), start, points)


def clamped_knots(order: int, points: int) -> list[int]:
    """Knots of the curve of G5.2: equal steps, the ends repeated `order` times.

    Examples
    --------
    >>> clamped_knots(3, 4)
    [0, 0, 0, 1, 2, 2, 2]
    """
    inside = points - order
    return [0] * order + list(range(1, inside + 1)) + [inside + 1] * order


def _lengths(table: Array, control: Array) -> Array:
    """Length of every piece [m]."""
    start, end = table[:, START:END], table[:, END:CENTER]
    chord = end - start
    length = np.linalg.norm(chord, axis=1)
    turned = np.flatnonzero(table[:, ANGLE])
    if turned.size:
        axes = table[turned, AXES:FIRST].astype(np.int64)
        ray = np.take_along_axis(start[turned], axes[:, :2], axis=1) - table[turned, CENTER:ANGLE]
        rise = np.take_along_axis(chord[turned], axes[:, 2:], axis=1)[:, 0]
        length[turned] = np.hypot(np.linalg.norm(ray, axis=1) * table[turned, ANGLE], rise)
    for k in np.flatnonzero(table[:, ORDER]).tolist():
        length[k] = _spline_length(control[int(table[k, FIRST]) :][: int(table[k, ORDER])])
    return np.asarray(length)


def _spline_length(control: Array) -> float:
    """Length of a rational Bézier piece by Gauss-Legendre quadrature on eighths [m]."""
    nodes, weights = _NODES
    u = ((np.arange(8)[:, None] + 0.5 * (nodes + 1.0)) / 8.0).ravel()
    n = len(control) - 1
    basis: Any = [math.comb(n, i) * u**i * (1.0 - u) ** (n - i) for i in range(n + 1)]
    lower: Any = [n * math.comb(n - 1, i) * u**i * (1.0 - u) ** (n - 1 - i) for i in range(n)]
    value, rate = np.array(basis).T @ control, np.array(lower).T @ np.diff(control, axis=0)
    w = value[:, 3:]
    speed = np.linalg.norm((rate[:, :3] - value[:, :3] / w * rate[:, 3:]) / w, axis=1)
    return float(np.tile(weights, 8) @ speed / 16.0)


STEPS: Final = 48
"""Golden sections of a stretch of a curve: 1e-10 of it is left."""

GOLDEN: Final = 0.5 * (math.sqrt(5.0) - 1.0)

SLACK: Final = 0.4
"""Distance along the other path within which a nearer place is sought, relative to the distance between them.

The alignment that makes the sum of all distances small is slack by about that much beside a corner. What goes
astray by d is still found to be off, by 0.6 d where it runs along the path itself.
"""

PROBES: Final = 256
"""Samples of a long reach that are looked at first."""


@compiled
def places(table: Array, control: Array, piece: IntArray, u: Array) -> Array:
    """Points (n, 3) [m] of the pieces `piece` (n,) at `u` (n,)."""
    points = np.empty((piece.size, 3))
    for k in range(piece.size):
        points[k, 0], points[k, 1], points[k, 2] = place(table[piece[k]], control, u[k])
    return points


@compiled
def closest_points(
    points: Array,
    reach: IntArray,
    table: Array,
    control: Array,
    piece: IntArray,
    u: Array,
    samples: Array,
    ways: Array,
) -> tuple[Array, IntArray, Array]:
    """Nearest points of a path to other points, in the order of travel.

    Parameters
    ----------
    points : Array, shape (n, 3)
        [m].
    reach : IntArray, shape (n, 4)
        First and last sample of the path that each point belongs to, and those of their whole stretch.
    table, control
        The path's outline.
    piece, u, samples, ways
        The path's samples: where they are on it, the points (m, 3) [m] and the way up to them (m,) [m].

    Returns
    -------
    tuple of Array (n, 3), IntArray (n,), Array (n,)
        The nearest points [m], their pieces and u.
    """
    found = np.empty_like(points)
    on, at = np.empty(points.shape[0], dtype=np.int64), np.empty(points.shape[0])
    for k in range(points.shape[0]):
        nearest = _nearest(points[k], reach[k, 0], reach[k, 1], samples)
        least = _square(points[k], samples[nearest, 0], samples[nearest, 1], samples[nearest, 2])
        slack = SLACK * math.sqrt(least)
        first, last = reach[k, 0], reach[k, 1]
        while first > reach[k, 2] and ways[reach[k, 0]] - ways[first - 1] <= slack:
            first -= 1
        while last < reach[k, 3] and ways[last + 1] - ways[reach[k, 1]] <= slack:
            last += 1
        nearest = _nearest(points[k], first, last, samples)
        least = _square(points[k], samples[nearest, 0], samples[nearest, 1], samples[nearest, 2])
        found[k], on[k], at[k] = samples[nearest], piece[nearest], u[nearest]
        if last - first > PROBES:
            first, last = max(first, nearest - PROBES // 2), min(last, nearest + PROBES // 2)
        # A sample stands between two parts, and at a joint there are two samples: so two more on either side.
        for j in range(max(first - 1, 1), min(last + 3, piece.size)):
            if piece[j - 1] == piece[j] and u[j - 1] < u[j]:
                near = math.sqrt(_square(points[k], samples[j, 0], samples[j, 1], samples[j, 2]))
                if near - (ways[j] - ways[j - 1]) >= math.sqrt(least):
                    continue
                v = _foot(points[k], table[piece[j]], control, u[j - 1], u[j])
                x, y, z = place(table[piece[j]], control, v)
                distance = _square(points[k], x, y, z)
                if distance < least:
                    least, on[k], at[k] = distance, piece[j], v
                    found[k, 0], found[k, 1], found[k, 2] = x, y, z
    return found, on, at


@inner
def _nearest(point: Array, first: int, last: int, samples: Array) -> int:
    """Nearest of the samples `first` to `last`; of very many, the nearest around the nearest probe."""
    step = max((last - first) // PROBES, 1)
    nearest = _nearest_by(point, first, last, step, samples)
    if step > 1:
        nearest = _nearest_by(point, max(nearest - step, first), min(nearest + step, last), 1, samples)
    return nearest


@inner
def _nearest_by(point: Array, first: int, last: int, step: int, samples: Array) -> int:
    nearest, least = first, np.inf
    for j in range(first, last + 1, step):
        distance = _square(point, samples[j, 0], samples[j, 1], samples[j, 2])
        if distance < least:
            nearest, least = j, distance
    return nearest


@inner
def _square(point: Array, x: float, y: float, z: float) -> float:
    square: float = (point[0] - x) ** 2 + (point[1] - y) ** 2 + (point[2] - z) ** 2
    return square


@inner
def _foot(point: Array, row: Array, control: Array, low: float, high: float) -> float:
    """Parameter of the closest point between two parameters: of a line at once, of a curve by golden sections."""
    if row[ANGLE] == 0.0 and row[ORDER] == 0.0:
        dx, dy, dz = row[END] - row[START], row[END + 1] - row[START + 1], row[END + 2] - row[START + 2]
        ahead = (point[0] - row[START]) * dx + (point[1] - row[START + 1]) * dy + (point[2] - row[START + 2]) * dz
        square = dx * dx + dy * dy + dz * dz
        at = ahead / square if square > 0.0 else low
        return min(max(at, low), high)
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    x, y, z = place(row, control, left)
    at_left = _square(point, x, y, z)
    x, y, z = place(row, control, right)
    at_right = _square(point, x, y, z)
    for _ in range(STEPS):
        if at_left <= at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            x, y, z = place(row, control, left)
            at_left = _square(point, x, y, z)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            x, y, z = place(row, control, right)
            at_right = _square(point, x, y, z)
    return 0.5 * (low + high)


@inner
def place(row: Array, control: Array, u: float) -> tuple[float, float, float]:
    """Point of a piece at u in [0, 1] [m]; of an arc whose radii disagree the radius changes evenly."""
    if row[ORDER] > 0.0:
        return _on_spline(control[int(row[FIRST]) : int(row[FIRST] + row[ORDER])], u)
    x = row[START] + u * (row[END] - row[START])
    y = row[START + 1] + u * (row[END + 1] - row[START + 1])
    z = row[START + 2] + u * (row[END + 2] - row[START + 2])
    if row[ANGLE] == 0.0 or u * (1.0 - u) == 0.0:
        return x, y, z
    at = np.array([x, y, z])
    a, b = int(row[AXES]), int(row[AXES + 1])
    ray_a, ray_b = row[START + a] - row[CENTER], row[START + b] - row[CENTER + 1]
    radius = math.hypot(ray_a, ray_b)
    last = math.hypot(row[END + a] - row[CENTER], row[END + b] - row[CENTER + 1])
    scale = 1.0 + u * (last / radius - 1.0)
    cos, sin = math.cos(u * row[ANGLE]) * scale, math.sin(u * row[ANGLE]) * scale
    at[a] = row[CENTER] + cos * ray_a - sin * ray_b
    at[b] = row[CENTER + 1] + sin * ray_a + cos * ray_b
    return at[0], at[1], at[2]


@inner
def _on_spline(control: Array, u: float) -> tuple[float, float, float]:
    """Point of a rational Bézier piece, by de Casteljau's steps."""
    points = control.copy()
    for level in range(control.shape[0] - 1, 0, -1):
        for i in range(level):
            for k in range(4):
                points[i, k] = (1.0 - u) * points[i, k] + u * points[i + 1, k]
    return points[0, 0] / points[0, 3], points[0, 1] / points[0, 3], points[0, 2] / points[0, 3]
