"""The tool path of a program as exact curves in columns, and closest points on them."""

from __future__ import annotations

import math
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.gcode.program import CUBIC, NURBS, PLANE_AXES, Motions
from ph_post.geometry import closest, exact_polynomials
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
    `pieces` are the same for :mod:`ph_post.geometry.closest`, with parameters u from 0 to 1.
    `s` (p + 1,) [m] the way travelled up to each; `first` (m + 1,) the first piece of each motion.
    """

    motion: IntArray
    table: Array
    control: Array
    pieces: Array
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


def curve_table(motions: Motions) -> CurveTable:
    """Return the tool path of a program.

    A coordinate that is not known yet is taken to be what it is when it is first known.
    """
    start, end = _known(motions.start, motions.end)
    count = motions.kind.size
    table = np.zeros((count, COLUMNS))
    table[:, START:END], table[:, END:CENTER] = start, end
    table[:, CENTER:ANGLE], table[:, ANGLE] = motions.center, motions.angle
    axes = np.array([PLANE_AXES[plane] for plane in (17, 18, 19)], dtype=np.float64)
    table[:, AXES:FIRST] = axes[np.clip(motions.plane, 17, 19) - 17]
    motion = np.arange(count, dtype=np.int64)
    curved = np.flatnonzero((motions.kind == CUBIC) | (motions.kind == NURBS))
    table, motion, control = _with_splines(motions, table, motion, curved)
    lengths = _lengths(table, control)
    s = np.concatenate([[0.0], np.cumsum(lengths, dtype=np.longdouble).astype(np.float64)])
    first = np.searchsorted(motion, np.arange(count + 1))
    return CurveTable(motion=motion, table=table, control=control, pieces=_pieces(table), s=s, first=first)


def _pieces(table: Array) -> Array:
    """Return rows as pieces to measure from; of an arc whose radii disagree the radius changes evenly."""
    pieces = closest.make_pieces(len(table))
    start, chord = table[:, START:END], table[:, END:CENTER] - table[:, START:END]
    square = np.einsum("nk,nk->n", chord, chord)
    pieces[:, closest.ORIGIN : closest.ORIGIN + 3], pieces[:, closest.FIRST : closest.FIRST + 3] = start, chord
    pieces[:, closest.SCALE] = np.divide(1.0, square, out=np.zeros_like(square), where=square > 0.0)
    pieces[:, closest.CONTROL], pieces[:, closest.ORDER] = table[:, FIRST], table[:, ORDER]
    arcs = np.flatnonzero(table[:, ANGLE])
    axes, center = table[arcs, AXES:FIRST].astype(np.int64), table[arcs, CENTER:ANGLE]
    ray = np.take_along_axis(start[arcs], axes[:, :2], axis=1) - center
    last = np.take_along_axis(table[arcs, END:CENTER], axes[:, :2], axis=1) - center
    radius = np.linalg.norm(ray, axis=1)
    height = np.stack([start[arcs], chord[arcs]], axis=1)[np.arange(arcs.size), :, axes[:, 2]]
    vectors = np.zeros((arcs.size, 4, 3))
    across = np.stack([-ray[:, 1], ray[:, 0]], axis=1)
    for number, pair in enumerate((center, ray / radius[:, None], across / radius[:, None])):
        np.put_along_axis(vectors[:, number], axes[:, :2], pair, axis=1)
    vectors[np.arange(arcs.size)[:, None], [0, 3], axes[:, 2:]] = height
    pieces[arcs, : closest.RADIUS] = vectors.reshape(-1, closest.RADIUS)
    pieces[arcs, closest.RADIUS], pieces[arcs, closest.SWEEP] = radius, table[arcs, ANGLE]
    pieces[arcs, closest.GROWTH] = np.linalg.norm(last, axis=1) / radius - 1.0
    return pieces


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
