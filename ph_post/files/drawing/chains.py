"""Join subpaths to contours, order them, and write them as the text of a path file.

Ends that lie together are joined; no point moves by more than a tolerance, and points are moved only where
they are farther apart than the path file's 1e-6 mm, and then meet exactly. A contour stays on one layer. It
takes its direction from the first of its subpaths in the drawing; a subpath that lies the other way round is
turned.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.files.drawing.shapes import (
    UNITS,
    DrawnShape,
    Subpath,
    angles,
    backwards,
    headings,
    line,
    radius_of,
    reach,
    transformed,
    with_ends,
)
from ph_post.types import Array

SAME: Final = 0.5e-6
"""Ends that are no farther apart are left as they are [mm]: half of what a path file allows."""


class Joint(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Two shapes that meet, what had to be put between them, and how far a point was moved at most."""

    before: DrawnShape
    between: DrawnShape | None
    after: DrawnShape
    moved: float


def gap_of(before: DrawnShape, after: DrawnShape) -> float:
    """Return the distance from the end of one shape to the start of the other."""
    return float(np.linalg.norm(after.start - before.end))


def meet(before: DrawnShape, after: DrawnShape, same: float, most: float) -> Joint:
    """Close the gap between two shapes.

    Both go half the way; but an arc stays as it is where the other shape is none. Two arcs are moved with
    their angles kept where that moves none of their points too far; else, and where a shape is hardly longer
    than the gap, a line bridges it.

    Parameters
    ----------
    before, after : DrawnShape
        In this order.
    same : float
        Distance up to which nothing need be done, in the shapes' unit.
    most : float
        How far a point may go, both ends' moves together.
    """
    gap = gap_of(before, after)
    if gap <= same:
        return Joint(before=before, between=None, after=after, moved=0.0)
    middle = 0.5 * (before.end + after.start)
    if before.kind == "arc" and after.kind != "arc":
        middle = before.end
    elif after.kind == "arc" and before.kind != "arc":
        middle = after.start
    left = _moved(before, before.start, middle, gap, most)
    right = _moved(after, middle, after.end, gap, most)
    if left is None or right is None:
        return Joint(before=before, between=line(before.end, after.start), after=after, moved=0.0)
    return Joint(before=left[0], between=None, after=right[0], moved=max(left[1], right[1]))


def close(shape: DrawnShape, same: float) -> list[DrawnShape]:
    """Close the gap between the end and the start of one shape; see :func:`meet`."""
    if gap_of(shape, shape) <= same:
        return [shape]
    if shape.kind in {"line", "arc"} or reach(shape) <= 4.0 * gap_of(shape, shape):
        return [shape, line(shape.end, shape.start)]
    middle = 0.5 * (shape.start + shape.end)
    return [with_ends(shape, middle, middle)]


def _moved(shape: DrawnShape, start: Array, end: Array, gap: float, most: float) -> tuple[DrawnShape, float] | None:
    """Move a shape's ends; None where a point would go too far, or the shape is too short for it."""
    moves = max(float(np.linalg.norm(start - shape.start)), float(np.linalg.norm(end - shape.end)))
    if moves == 0.0:
        return shape, 0.0
    if reach(shape) <= 4.0 * gap:
        return None
    if shape.kind != "arc":
        return with_ends(shape, start, end), moves
    # an arc moves as a whole, and once for each of its ends
    return _moved_arc(shape, start, end, 0.5 * most)


def _moved_arc(shape: DrawnShape, start: Array, end: Array, most: float) -> tuple[DrawnShape, float] | None:
    """Turn and scale an arc so that its ends go where they should, in the plane: z -> p z + q."""
    a, b = (complex(*point[:2]) for point in shape.points[:2])
    u, v = complex(*start[:2]), complex(*end[:2])
    if a == b or start[2] != shape.start[2] or end[2] != shape.end[2]:
        return None
    p = (v - u) / (b - a)
    q = u - p * a
    # |(p - 1) z + q| over the arc is at most what it is at the centre, and at a radius from there
    center = complex(*shape.points[2, :2])
    furthest = abs((p - 1.0) * center + q) + abs(p - 1.0) * radius_of(shape)
    if furthest > most:
        return None
    matrix = np.eye(4)
    matrix[:2, :2] = [[p.real, -p.imag], [p.imag, p.real]]
    matrix[:2, 3] = q.real, q.imag
    made = transformed(shape, matrix)
    exact = np.array(made.points)
    exact[0], exact[1] = start, end
    made = msgspec.structs.replace(made, points=exact)
    return (made, furthest) if abs(angles(made)[1] - angles(shape)[1]) < 1e-6 else None


DOUBT: Final = 1e-9
"""Ways that go on as straight as the best, to this part of a full turn, are taken in the drawing's order."""


class Contour(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Shapes that meet one after the other; of a closed contour the last meets the first."""

    shapes: tuple[DrawnShape, ...]
    layer: str
    closed: bool


class JoinedContours(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The contours of a drawing, and what it took: gaps closed, the largest, the farthest move, forks."""

    contours: tuple[Contour, ...]
    gaps: int = 0
    largest_gap: float = 0.0
    moved: float = 0.0
    bridges: int = 0
    forks: int = 0


def join(runs: Sequence[Subpath], tolerance: float, same: float) -> JoinedContours:
    """Chain runs to contours.

    Parameters
    ----------
    runs : sequence of Subpath
        In the drawing's order.
    tolerance, same : float
        Distance up to which ends are joined, and up to which they need not be moved.
    """
    made: list[Contour] = []
    notes = _JoinCounts()
    by_layer: dict[str, list[Subpath]] = {}
    for run in runs:
        by_layer.setdefault(run.layer, []).append(run)
    for layer, those in by_layer.items():
        chains = _Chainer(those, tolerance, notes)
        made.extend(_contour(pieces, layer, tolerance, same, notes) for pieces in chains.chains())
    return JoinedContours(
        contours=tuple(made),
        gaps=notes.gaps,
        largest_gap=notes.largest,
        moved=notes.moved,
        bridges=notes.bridges,
        forks=notes.forks,
    )


class _JoinCounts:
    gaps = bridges = forks = 0
    largest = moved = 0.0

    def joint(self, gap: float, moved: float, bridged: bool) -> None:
        self.gaps += 1
        self.bridges += bridged
        self.largest, self.moved = max(self.largest, gap), max(self.moved, moved)


class _Chainer:
    """Follows runs from end to end on one layer."""

    def __init__(self, runs: Sequence[Subpath], tolerance: float, notes: _JoinCounts) -> None:
        from scipy.spatial import cKDTree

        self._shapes = [run.shapes for run in runs]
        self._tolerance, self._notes = tolerance, notes
        self._ends = np.array([(shapes[0].start, shapes[-1].end) for shapes in self._shapes]).reshape(-1, 3)
        self._tree = cKDTree(self._ends)
        self._loop = np.array([is_loop(shapes, tolerance) for shapes in self._shapes], dtype=np.bool_)
        self._free = ~self._loop

    def chains(self) -> Iterable[list[DrawnShape]]:
        """Yield the chains, in the order of their first runs."""
        for number, shapes in enumerate(self._shapes):
            if self._loop[number]:
                yield list(shapes)
            elif self._free[number]:
                self._free[number] = False
                chain = self._grow(list(shapes))
                if not is_loop(chain, self._tolerance):
                    before = self._grow(turned(chain))[len(chain) :]
                    chain = [*turned(before), *chain]
                yield chain

    def _grow(self, chain: list[DrawnShape]) -> list[DrawnShape]:
        """Add runs at the chain's end for as long as there are some."""
        while not is_loop(chain, self._tolerance) and (found := self._next(chain[-1])) is not None:
            number, reverse = found
            self._free[number] = False
            more = list(self._shapes[number])
            chain.extend(turned(more) if reverse else more)
        return chain

    def _next(self, last: DrawnShape) -> tuple[int, bool] | None:
        """Return the run that goes on from a shape's end, and whether it must be turned round.

        Of several the straightest is taken, of those the nearest.
        """
        near = sorted(self._tree.query_ball_point(last.end, self._tolerance))
        ends = [end for end in near if self._free[end // 2]]
        if not ends:
            return None
        if len({end // 2 for end in ends}) > 1:
            self._notes.forks += 1
        heading = headings(last)[1]

        def cost(end: int) -> tuple[float, float, int]:
            turn = 1.0 - float(heading @ self._leaving(end))
            return round(turn / DOUBT), float(np.linalg.norm(self._ends[end] - last.end)), end

        best = min(ends, key=cost)
        return best // 2, best % 2 == 1

    def _leaving(self, end: int) -> Array:
        """Direction in which a run leaves its start, or its end where that is asked for."""
        shapes = self._shapes[end // 2]
        return -headings(shapes[-1])[1] if end % 2 else headings(shapes[0])[0]


def is_loop(shapes: Sequence[DrawnShape], tolerance: float) -> bool:
    """Return whether a run comes back to where it began, after having been somewhere else."""
    start = shapes[0].start
    if float(np.linalg.norm(shapes[-1].end - start)) > tolerance:
        return False
    away = max(float(np.abs(shape.points - start).max()) + 0.0 for shape in shapes)
    return away > 2.0 * tolerance or np.array_equal(shapes[-1].end, start)


def turned(shapes: Sequence[DrawnShape]) -> list[DrawnShape]:
    """Return a run the other way round."""
    return [backwards(shape) for shape in reversed(shapes)]


def _contour(pieces: list[DrawnShape], layer: str, tolerance: float, same: float, notes: _JoinCounts) -> Contour:
    """Make the shapes of a chain meet, and its ends where it is closed."""
    closed = is_loop(pieces, tolerance)
    done = [pieces[0]]
    for piece in pieces[1:]:
        done.extend(_joined(done.pop(), piece, same, tolerance, notes))
    if closed and len(done) > 1:
        *rest, first = (*_joined(done[-1], done[0], same, tolerance, notes),)
        done = [first, *done[1:-1], *rest]
    elif closed and gap_of(done[0], done[0]) > same:
        notes.joint(gap := gap_of(done[0], done[0]), 0.5 * gap, False)
        done = close(done[0], same)
    return Contour(shapes=tuple(done), layer=layer, closed=closed)


def _joined(before: DrawnShape, after: DrawnShape, same: float, most: float, notes: _JoinCounts) -> list[DrawnShape]:
    gap = gap_of(before, after)
    joint = meet(before, after, same, most)
    if gap > same:
        notes.joint(gap, joint.moved, joint.between is not None)
    between = [] if joint.between is None else [joint.between]
    return [joint.before, *between, joint.after]


def without_points(runs: Iterable[Subpath], least: float) -> tuple[list[Subpath], int]:
    """Leave out shapes that go nowhere, and count the runs of which nothing is left."""
    kept, lost = [], 0
    for run in runs:
        shapes = tuple(shape for shape in run.shapes if reach(shape) > least)
        if shapes:
            kept.append(msgspec.structs.replace(run, shapes=shapes))
        else:
            lost += 1
    return kept, lost


def in_order(contours: Sequence[Contour], layers: Sequence[str], nearest: bool) -> list[Contour]:
    """Put contours in the order of their layers, and inside a layer from each to the nearest start.

    Parameters
    ----------
    contours : sequence of Contour
        In the drawing's order.
    layers : sequence of str
        Layers that come first, in this order; the others follow in the drawing's order.
    nearest : bool
        Else the drawing's order is kept inside a layer.
    """
    by_layer: dict[str, list[Contour]] = {layer: [] for layer in layers}
    for contour in contours:
        by_layer.setdefault(contour.layer, []).append(contour)
    ordered: list[Contour] = []
    place = np.zeros(3)
    for group in by_layer.values():
        ordered.extend((group[number] for number in _nearest_next(group, place)) if nearest else group)
        place = ordered[-1].shapes[-1].end if ordered else place
    return ordered


def _nearest_next(group: Sequence[Contour], place: Array) -> Iterator[int]:
    """Yield the numbers of contours, each the one whose start is nearest to where the last one ends."""
    from scipy.spatial import cKDTree

    left = np.arange(len(group))
    starts = np.array([contour.shapes[0].start for contour in group])
    free = np.ones(len(group), dtype=np.bool_)
    while left.size:
        tree = cKDTree(starts[left])
        for _ in range((left.size + 1) // 2):  # then the tree is half empty, and planted anew
            count, found = 4, left[:0]
            while not found.size:
                near = np.atleast_1d(tree.query(place, min(count, left.size))[1])
                found = left[near][free[left[near]]]
                count *= 4
            number = int(found[0])
            free[number] = False
            yield number
            place = group[number].shapes[-1].end
        left = left[free[left]]


def path_text(contours: Sequence[Contour], unit: str, feed: Fraction, axes: str, names: tuple[str, str]) -> str:
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
        "format": "ph-post-path",
        "version": 1,
        "name": _printable(names[0]),
        "source": f"drawing {_printable(names[1])}",
        "units": unit,
        "axes": list(axes),
        "feed": _exact(feed),
        "closed": len(contours) == 1 and contours[0].closed,
    }
    lines = ",\n  ".join(json.dumps(segment) for segment in segments)
    return f'{json.dumps(head)[:-1]},\n "segments": [\n  {lines}\n ]}}\n'


def _segment(shape: DrawnShape, width: int) -> dict[str, Any]:
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
