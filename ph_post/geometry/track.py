"""A path as one function of arc length, and its inverse."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ph_post.errors import InputError
from ph_post.geometry import frenet, joints
from ph_post.geometry.piecewise import CHUNK, Group, Piece, PieceSet, PiecewiseCurve
from ph_post.geometry.speed_panels import NODES, Panels, join_panels, measure, resolve, sort_by_speed
from ph_post.types import MACHINE_AXES, Array, Curve, IntArray, Path, Segment, frozen

EPS: Final = float(np.finfo(np.float64).eps)

FAST_STEPS: Final = 6
"""Newton steps for all rows of a chunk; those left after them are few, and next to low speeds."""

SURE: Final = 1e-12
"""Residual, relative to the panel's length, after which one more Newton step leaves only rounding."""

SLOW_STEPS: Final = 80
"""Bracketed steps for the rows that remain: bisection alone would take 53."""


class ArcLength:
    """The arc length s of a chain of pieces as a function of (piece, u), and back.

    The lengths of the pieces are known at once; s(u) inside a piece is worked out when it is first asked for.

    Parameters
    ----------
    pieces : sequence of Piece
    groups : sequence of Group
        The same pieces.
    """

    def __init__(self, pieces: Sequence[Piece], groups: Sequence[Group]) -> None:
        self._families = sort_by_speed(pieces, groups, NODES)
        count = len(pieces)
        self._panels = join_panels(())
        self._guess = _monotone_guess(self._panels)
        self._first_panel, self._last_panel = np.full(count, -1), np.full(count, -2)
        lengths, starts = np.empty(count), np.zeros(count + 1)
        for family in self._families:
            lengths[family.index] = measure(family)
        # The sum of many lengths is the one place where rounding adds up.
        starts[1:] = np.cumsum(lengths, dtype=np.longdouble)
        self.starts = frozen(starts)
        """Arc length at the pieces' ends [m], shape (pieces + 1,)."""

    def at(self, piece: IntArray, u: Array) -> Array:
        """Arc length from the chain's beginning [m]."""
        panels = self._panels_of(piece)
        s = self.starts[piece]
        for first in range(0, u.size, CHUNK):
            part = slice(first, first + CHUNK)
            panel = self._find(piece[part], u[part], panels.first)
            low, high = panels.first[panel], panels.last[panel]
            x = np.where(u[part] >= high, 1.0, 2.0 * (u[part] - low) / (high - low) - 1.0)
            value, _ = _horner([row.take(panel) for row in panels.power], x)
            s[part] += panels.start[panel] + value
        return s

    def locate(self, s: Array) -> tuple[IntArray, Array]:
        """Piece and u at arc length `s` [m], clipped to the chain; the later piece answers at a joint."""
        s = np.clip(s, 0.0, self.starts[-1])
        piece: IntArray = np.searchsorted(self.starts[1:-1], s, side="right")
        panels = self._panels_of(piece)
        u = np.empty(s.size)
        for first in range(0, s.size, CHUNK):
            part = slice(first, first + CHUNK)
            local = s[part] - self.starts[piece[part]]
            panel = self._find(piece[part], local, panels.start)
            x = self._invert(panel, local - panels.start[panel])
            low, high = panels.first[panel], panels.last[panel]
            u[part] = np.where(x >= 1.0, high, low + 0.5 * (x + 1.0) * (high - low))
        return piece, u

    def _panels_of(self, piece: IntArray) -> Panels:
        """Panels, those of the pieces named among them."""
        known = self._first_panel >= 0
        missing = np.unique(piece[~known[piece]])
        if missing.size:
            self._add(_widened(missing, known))
        return self._panels

    def _add(self, index: IntArray) -> None:
        """Work out the panels of some pieces."""
        wanted = np.zeros(self._first_panel.size, dtype=np.bool_)
        wanted[index] = True
        parts = [self._panels]
        for family in self._families:
            rows = np.flatnonzero(wanted[family.index])
            if rows.size:
                parts.append(resolve(family, rows))
        self._panels = join_panels(parts)
        self._guess = _monotone_guess(self._panels)
        piece = self._panels.piece
        self._first_panel[piece[::-1]] = np.arange(piece.size)[::-1]
        self._last_panel[piece] = np.arange(piece.size)

    def _find(self, piece: IntArray, value: Array, begin: Array) -> IntArray:
        """Last panel of each row's piece whose `begin` is not above `value`, or the first."""
        low, high = self._first_panel[piece], self._last_panel[piece]
        while np.any(low < high):
            middle = (low + high + 1) // 2
            right = value >= begin[middle]
            low, high = np.where(right, middle, low), np.where(right, high, middle - 1)
        return low

    def _invert(self, panel: IntArray, target: Array) -> Array:
        """Solve s(x) = target on each row's panel."""
        length = self._panels.length[panel]
        part = np.clip(target / length, 0.0, 1.0)
        a, b, c = (row.take(panel) for row in self._guess)
        x: Array = np.clip(part * (a + part * (b + part * c)) - 1.0, -1.0, 1.0)
        power = [row.take(panel) for row in self._panels.power]
        for _ in range(FAST_STEPS):
            residual, slope = _horner(power, x)
            residual -= target
            open_rows = np.abs(residual) > SURE * length
            np.divide(residual, slope, out=residual, where=slope > 0.0)
            x -= residual
            np.clip(x, -1.0, 1.0, out=x)
            if not open_rows.any():
                break
        else:
            rows = np.flatnonzero(open_rows)
            x[rows] = _bracketed([row[rows] for row in power], target[rows], x[rows])
        x[part <= 0.0] = -1.0
        x[part >= 1.0] = 1.0
        return x


def _widened(missing: IntArray, known: NDArray[np.bool_]) -> IntArray:
    """Add neighbours, so that there are at least as many as are known already: growth then costs little."""
    unknown = np.flatnonzero(~known)
    first = np.searchsorted(unknown, missing[0])
    ahead = np.roll(unknown, -first)[: known.size - unknown.size]
    return np.union1d(missing, ahead)


def _bracketed(power: list[Array], target: Array, x: Array) -> Array:
    """Solve s(x) = target by Newton's method, and by bisection wherever it leaves the bracket."""
    solution, rows = x.copy(), np.arange(x.size)
    low, high = np.full(x.size, -1.0), np.full(x.size, 1.0)
    for _ in range(SLOW_STEPS):
        residual, slope = _horner(power, x)
        residual -= target
        low, high = np.where(residual <= 0.0, x, low), np.where(residual >= 0.0, x, high)
        new = x - np.divide(residual, slope, out=np.zeros_like(x), where=slope > 0.0)
        inside = (new >= low) & (new <= high) & (slope > 0.0)
        new = np.where(inside, new, 0.5 * (low + high))
        solution[rows] = new
        left = np.flatnonzero(np.abs(new - x) > 2.0 * EPS)
        if left.size == 0:
            break
        rows, x, target, low, high = rows[left], new[left], target[left], low[left], high[left]
        power = [coefficient[left] for coefficient in power]
    return solution


def _horner(power: list[Array], x: Array) -> tuple[Array, Array]:
    """Value and slope of the arc length on the panel."""
    value, slope = power[-1].copy(), np.zeros_like(x)
    for coefficient in reversed(power[:-1]):
        slope *= x
        slope += value
        value *= x
        value += coefficient
    return value, slope


def _monotone_guess(panels: Panels) -> Array:
    """Monotone cubic Hermite interpolant of x + 1 over the part of a panel's length, powers 1 to 3."""
    k = np.arange(len(panels.power))[:, None]
    slopes = k * panels.power / panels.length
    last = slopes.sum(axis=0)
    first = np.where(k % 2 == 1, slopes, -slopes).sum(axis=0)
    # dx/dpart = 1 / slope; three times the chord's (2) is as steep as a monotone cubic may be.
    a, b = (1.0 / np.maximum(slope, 1.0 / 6.0) for slope in (first, last))
    return np.stack([a, 6.0 - 2.0 * a - b, a + b - 4.0])


class Track:
    """A path cut into analytic pieces, and known by arc length.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    path : Path
    dimension : int
        2 or 3.
    closed : bool
        True for a path that is run as a loop.
    length : float
        Arc length [m].
    pieces : tuple of Piece
    groups : tuple of Group
        The same pieces by kind and degree, their control points in one array each.
    starts : Array, shape (pieces + 1,)
        Arc length at the pieces' ends [m].
    segment : IntArray, shape (pieces,)
        The path's segment that each piece belongs to.
    xi0, xi1 : Array, shape (pieces,)
        Each piece's part of its segment's domain.

    Examples
    --------
    >>> from ph_post.geometry.curves import Line
    >>> track = Track.from_curves([Line([[0, 0], [3, 0]]), Line([[3, 0], [3, 1]])])
    >>> piece, u = track.locate(np.array([1.5, 3.5]))
    >>> track.derivatives(piece, u, 0).tolist()
    [[[1.5, 0.0], [3.0, 0.5]]]
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        curves = [_piecewise(segment.curve) for segment in path.segments]
        self._set = PieceSet(piece for curve in curves for piece in curve.pieces)
        counts = [len(curve.pieces) for curve in curves]
        self.segment: IntArray = np.repeat(np.arange(len(curves), dtype=np.int64), counts)
        self.xi0 = frozen([piece.xi0 for piece in self.pieces])
        self.xi1 = frozen([piece.xi1 for piece in self.pieces])
        self._arc_length = ArcLength(self.pieces, self.groups)
        self.starts = self._arc_length.starts
        self.length = float(self.starts[-1])

    @classmethod
    def from_curves(cls, curves: Iterable[Curve], closed: bool = False) -> Track:
        """Make the track of curves that stand in no path file."""
        segments = tuple(Segment(curve=curve) for curve in curves)
        axes = MACHINE_AXES[: segments[0].curve.dimension]
        return cls(Path(name="", source="", axes=axes, feed=1.0, closed=closed, segments=segments))

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The analytic pieces in the order in which they are run."""
        return self._set.pieces

    @property
    def groups(self) -> tuple[Group, ...]:
        """The pieces by kind and degree."""
        return self._set.groups

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self._set.dimension

    @property
    def closed(self) -> bool:
        """True for a path that is run as a loop."""
        return self.path.closed

    def locate(self, s: Array) -> tuple[IntArray, Array]:
        """Piece and u at arc length `s` [m], the inverse of :meth:`arc_length`.

        `s` is clipped to the path; at a joint the later piece answers.
        """
        return self._arc_length.locate(np.asarray(s, dtype=np.float64))

    def arc_length(self, piece: IntArray, u: Array) -> Array:
        """Arc length from the path's beginning [m]."""
        return self._arc_length.at(np.asarray(piece), np.asarray(u, dtype=np.float64))

    def derivatives(self, piece: IntArray, u: Array, order: int = 0) -> Array:
        """Values and derivatives with respect to u, shape (order + 1, n, dim) [m]."""
        return self._set.derivatives(np.asarray(piece), np.asarray(u, dtype=np.float64), order)

    def arc_derivatives(self, piece: IntArray, u: Array, order: int = 0) -> Array:
        """Values and derivatives with respect to arc length, shape (order + 1, n, dim), order <= 4.

        Only where the speed does not vanish.
        """
        return frenet.arc_derivatives(self.derivatives(piece, u, order))

    def to_xi(self, piece: IntArray, u: Array) -> tuple[IntArray, Array]:
        """Segment and its parameter xi."""
        width = self.xi1[piece] - self.xi0[piece]
        return self.segment[piece], np.where(u >= 1.0, self.xi1[piece], self.xi0[piece] + u * width)

    def tangents(self) -> tuple[Array, Array]:
        """One-sided unit tangents at both ends of every piece, shape (pieces, dim) each.

        Where the speed vanishes at an end, the first derivative that does not tells the direction.
        """
        return joints.tangents(self._set, 0), joints.tangents(self._set, 1)

    def end_curvatures(self) -> tuple[Array, Array]:
        """One-sided d²r/ds² [1/m] at both ends of every piece, shape (pieces, dim) each.

        Infinite at some ends where the speed vanishes.
        """
        return joints.curvatures(self._set, 0), joints.curvatures(self._set, 1)


def _piecewise(curve: Curve) -> PiecewiseCurve:
    if not isinstance(curve, PiecewiseCurve):
        raise InputError("", "a curve without pieces", expected="a curve of ph_post.geometry.curves")
    return curve
