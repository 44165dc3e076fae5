"""Assemble the segments of a path: fitted straight moves, and the curves of all other motions."""

from __future__ import annotations

from typing import Final

import numpy as np

from ph_post.bounds import in_parts
from ph_post.gcode.curves import curves_of, round_corners
from ph_post.gcode.fitting.polyline import fit_polyline
from ph_post.gcode.fitting.samples import ROUND, PolylineFit
from ph_post.gcode.program import AXES, CUBIC, LINE, RAPID, Motions, PlaceArray, in_a_row, rows_where
from ph_post.geometry.curves import Arc, Composite
from ph_post.geometry.piecewise import MEETS, Piece, PiecewiseCurve
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, Curve, IntArray, Path, Segment, sealed

FEED_ROUGH: Final = 1e-2
"""Straight moves in a row whose feeds differ by no more than this part all count with the first one's feed:
controllers follow a feed no better, and a curve would fall apart where every line has its own F."""


def assemble(
    motions: Motions, rows: PlaceArray, columns: tuple[int, ...], tolerance: float
) -> tuple[tuple[Segment, ...], Array, dict[int, PiecewiseCurve]]:
    """Make the segments of motions, and find the arc length at their beginnings and end.

    Parameters
    ----------
    motions : Motions
    rows : PlaceArray, shape (k,)
        Motions that go somewhere, one after the other, their positions known.
    columns : tuple of int
        Columns of the path's axes, two or three.
    tolerance : float
        Of the fit [m].

    Returns
    -------
    segments : tuple of Segment
    s : Array, shape (k + 1,)
        Arc length [m].
    cubics : dict
        The curves of G5 and G5.1 by row.
    """
    return _Assembly(motions, rows, columns, tolerance).result()


class _Assembly:
    """Segments in the making.

    All motions together are one polyline; those that are no straight move are a step of it that is a line
    between corners, to be replaced by what they are, or none at all where they end where they begin.
    """

    def __init__(self, motions: Motions, rows: PlaceArray, columns: tuple[int, ...], tolerance: float) -> None:
        self.motions, self.rows, self.columns = motions, rows, columns
        self.own = in_a_row(rows)
        self.is_line = motions.kind[self.own] == LINE
        self.step_motion, self.points = self._steps()
        """Row of every step of the polyline, and its vertices."""
        other = rows_where(~self.is_line)
        vertex = np.searchsorted(self.step_motion, other)
        found = vertex == self.step_motion.size
        found[~found] = self.step_motion[vertex[~found]] != other[~found]
        self.loops: dict[int, list[int]] = {}
        for row, before in zip(other[found].tolist(), vertex[found].tolist(), strict=True):
            self.loops.setdefault(before, []).append(row)
        self.feed = self._feeds()
        self.segments: list[Segment] = []
        self.smooth: list[bool] = []
        """Whether each segment may be bent at its ends: not rapids, cubics, nor what ends in stops."""
        self.cubics: dict[int, PiecewiseCurve] = {}
        self.pieces = 0
        self.first_piece = np.zeros(rows.size, dtype=np.int64)
        """Piece of the track on which every row begins."""
        self.foot = np.zeros(rows.size)
        """Parameter on that piece."""
        self.piece_starts: list[tuple[int, int, int]] = []
        """Pieces of the fit, from and to, that begin with such a piece of the track."""
        self.tolerance = tolerance

    def result(self) -> tuple[tuple[Segment, ...], Array, dict[int, PiecewiseCurve]]:
        """Return what :func:`assemble` does."""
        if len(self.points) > 1:
            self._walk(self._fit())
        self._loops_at(len(self.points) - 1)
        track = Track(self._path())
        s = np.empty(self.rows.size + 1)
        s[:-1] = track.arc_length(self.first_piece, self.foot)
        s[-1] = track.length
        rounded = round_corners(track, np.maximum.accumulate(s), np.array(self.smooth), self.tolerance)
        return rounded.segments, sealed(rounded.s), self.cubics

    def _path(self) -> Path:
        return Path(
            name="",
            source="",
            axes=AXES[: len(self.columns)],
            feed=1.0,
            closed=False,
            segments=tuple(self.segments),
        )

    def _places(self, part: slice | IntArray) -> tuple[Array, Array]:
        """Return the starts and ends of some rows in the path's axes [m]."""
        rows = in_a_row(self.rows[part])
        # An axis that never moves may be where nobody knows.
        start, end = (np.nan_to_num(place[rows][:, self.columns]) for place in (self.motions.start, self.motions.end))
        return start, end

    def _steps(self) -> tuple[PlaceArray, Array]:
        """Return the rows that lead from one vertex of the polyline to the next, and the vertices [m]."""
        rows, points = [], [self._places(slice(0, 1))[0]]
        for part in in_parts(self.rows.size):
            start, end = self._places(part)
            steps = np.flatnonzero(np.linalg.norm(end - start, axis=1) > MEETS)
            rows.append((part.start + steps).astype(np.int32))
            points.append(end[steps])
        return np.concatenate(rows), np.concatenate(points)

    def _feeds(self) -> Array:
        """Feed of every row [m/s], 0 of rapids; of inverse times what their length makes of them."""
        feed, duration = np.array(self.motions.feeds.of(self.own)), self.motions.duration[self.own]
        timed = np.flatnonzero((duration > 0.0) & (self.motions.kind[self.own] != RAPID))
        start, end = self._places(timed)
        length = np.linalg.norm(end - start, axis=1)
        for place in np.flatnonzero(~self.is_line[timed]).tolist():
            length[place] = sum(curve.length for curve in self._curves(int(timed[place])))
        feed[timed] = length / duration[timed]
        return _grouped(feed, self.is_line)

    def _fit(self) -> PolylineFit:
        """Fit all straight moves at once; whatever is beside another motion is a corner of the polyline."""
        other = ~self.is_line[self.step_motion]
        sharp = np.zeros(len(self.points), dtype=np.bool_)
        sharp[:-1] |= other
        sharp[1:] |= other
        sharp[list(self.loops)] = True
        feed = self.feed[self.step_motion]
        cuts = np.zeros(len(self.points), dtype=np.bool_)
        cuts[1:-1] = feed[1:] != feed[:-1]
        return fit_polyline(self.points, self.tolerance, cuts, sharp)

    def _walk(self, fit: PolylineFit) -> None:
        """Make segments of the pieces in their order, as few as feeds and arcs allow."""
        self.foot[self.step_motion] = np.where(self.is_line[self.step_motion], fit.foot[:-1], 0.0)
        pieces = self._pieces(fit)
        ends = self._breaks(fit)
        rows = self.step_motion[fit.first]
        first = 0
        for last, vertex, row, line, kind in zip(
            ends.tolist(),
            *(column[np.append(0, ends[:-1])].tolist() for column in (fit.first, rows, self.is_line[rows], fit.kind)),
            strict=True,
        ):
            self._loops_at(vertex)
            if not line:
                self._add(self._curves(row), row)
            else:
                self.piece_starts.append((first, last, self.pieces))
                arc = kind == ROUND
                curve = self._fitted_arc(fit, first) if arc else Composite(pieces[first:last])
                self._segment(curve, row)
            first = last
        self._mark(fit)

    def _mark(self, fit: PolylineFit) -> None:
        """Note on which piece of the track every straight move begins."""
        first, last, number = np.array(self.piece_starts, dtype=np.int64).reshape(-1, 3).T
        shift = np.zeros(fit.kind.size, dtype=np.int64)
        on = np.concatenate([np.arange(a, b) for a, b in zip(first, last, strict=True)] or [first])
        shift[on] = on + np.repeat(number - first, last - first)
        steps = np.flatnonzero(self.is_line[self.step_motion])
        piece = np.repeat(np.arange(fit.kind.size), fit.last - fit.first)
        self.first_piece[self.step_motion[steps]] = shift[piece[steps]]

    def _breaks(self, fit: PolylineFit) -> IntArray:
        """Return the numbers of the pieces behind which a segment ends."""
        single = (fit.kind == ROUND) | ~self.is_line[self.step_motion[fit.first]]
        feed = self.feed[self.step_motion[fit.first]]
        loops = np.isin(fit.first[1:], list(self.loops))
        new = single[1:] | single[:-1] | (feed[1:] != feed[:-1]) | loops
        return np.append(np.flatnonzero(new) + 1, fit.kind.size)

    def _pieces(self, fit: PolylineFit) -> list[Piece]:
        """Make records of all lines and interpolants; what is another motion gets one that is not used."""
        ends = self.points[np.stack([fit.first, fit.last], axis=1)]
        chord = ends[:, 1] - ends[:, 0]
        sizes = np.sqrt((chord * chord).sum(axis=1))
        dimension, found = len(self.columns), []
        for k, (degree, a, b) in enumerate(
            zip(fit.degree.tolist(), fit.first.tolist(), fit.last.tolist(), strict=True)
        ):
            control, speed = ends[k], sizes[k : k + 1]
            if degree > 1:
                control = np.ascontiguousarray(fit.control[k, : degree + 1, :dimension])
                speed = fit.speed[k] if degree == 5 else None
            found.append(Piece(kind="polynomial", control=control, xi0=float(a), xi1=float(b), speed=speed))
        return found

    def _fitted_arc(self, fit: PolylineFit, k: int) -> Curve:
        start, end = self.points[fit.first[k]], self.points[fit.last[k]]
        center = start.copy()
        center[:2] = fit.circle[k, :2]
        return Arc(start, end, center, "ccw" if fit.circle[k, 3] > 0.0 else "cw")

    def _curves(self, row: int) -> list[PiecewiseCurve]:
        return curves_of(self.motions, int(self.rows[row]), self.columns)

    def _loops_at(self, vertex: int) -> None:
        """Add the full turns that begin and end at a vertex."""
        for row in self.loops.pop(vertex, ()):
            self._add(self._curves(row), row)

    def _add(self, curves: list[PiecewiseCurve], row: int) -> None:
        self.first_piece[row] = self.pieces
        if self.motions.kind[self.rows[row]] == CUBIC:
            (self.cubics[row],) = curves
        for curve in curves:
            self._segment(curve, row)

    def _segment(self, curve: Curve, row: int) -> None:
        rapid = bool(self.motions.kind[self.rows[row]] == RAPID)
        self.segments.append(Segment(curve=curve, feed=None if rapid else float(self.feed[row]), rapid=rapid))
        exact = bool(self.motions.exact[self.rows[row]])
        self.smooth.append(not (rapid or exact or row in self.cubics))
        self.pieces += len(curve.pieces)  # type: ignore[attr-defined]


def _grouped(feed: Array, is_line: BoolArray) -> Array:
    """Give straight moves of nearly one feed the first one's."""
    # What repeats the move before it goes the same way.
    heads = np.flatnonzero((feed[1:] != feed[:-1]) | (is_line[1:] != is_line[:-1])) + 1
    heads = np.concatenate([[0], heads]) if feed.size else heads
    found, held = feed[heads].tolist(), -1.0
    for row, (own, line) in enumerate(zip(found, is_line[heads].tolist(), strict=True)):
        if line and held > 0.0 and abs(own - held) <= FEED_ROUGH * held:
            found[row] = held
        else:
            held = own if line else -1.0
    return np.repeat(found, np.diff(heads, append=feed.size))
