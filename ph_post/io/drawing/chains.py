"""From runs to contours: ends that lie together are joined, contours are closed and put in order.

A contour stays on one layer. It takes its direction from the first of its runs in the drawing; a run that
lies the other way round is turned.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.io.drawing.joints import close, gap_of, meet
from ph_post.io.drawing.record import Run
from ph_post.io.drawing.shapes import Shape, backwards, headings, reach
from ph_post.types import Array

DOUBT: Final = 1e-9
"""Ways that go on as straight as the best, to this part of a full turn, are taken in the drawing's order."""


class Contour(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Shapes that meet one after the other; of a closed contour the last meets the first."""

    shapes: tuple[Shape, ...]
    layer: str
    closed: bool


class Joining(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The contours of a drawing, and what it took: gaps closed, the largest, the farthest move, forks."""

    contours: tuple[Contour, ...]
    gaps: int = 0
    largest_gap: float = 0.0
    moved: float = 0.0
    bridges: int = 0
    forks: int = 0


def join(runs: Sequence[Run], tolerance: float, same: float) -> Joining:
    """Chain runs to contours.

    Parameters
    ----------
    runs : sequence of Run
        In the drawing's order.
    tolerance, same : float
        Distance up to which ends are joined, and up to which they need not be moved.
    """
    made: list[Contour] = []
    notes = _Notes()
    by_layer: dict[str, list[Run]] = {}
    for run in runs:
        by_layer.setdefault(run.layer, []).append(run)
    for layer, those in by_layer.items():
        chains = _Chainer(those, tolerance, notes)
        made.extend(_contour(pieces, layer, tolerance, same, notes) for pieces in chains.chains())
    return Joining(
        contours=tuple(made), gaps=notes.gaps, largest_gap=notes.largest, moved=notes.moved,
        bridges=notes.bridges, forks=notes.forks,
    )  # fmt: skip


class _Notes:
    gaps = bridges = forks = 0
    largest = moved = 0.0

    def joint(self, gap: float, moved: float, bridged: bool) -> None:
        self.gaps += 1
        self.bridges += bridged
        self.largest, self.moved = max(self.largest, gap), max(self.moved, moved)


class _Chainer:
    """Follows runs from end to end on one layer."""

    def __init__(self, runs: Sequence[Run], tolerance: float, notes: _Notes) -> None:
        from scipy.spatial import cKDTree

        self._shapes = [run.shapes for run in runs]
        self._tolerance, self._notes = tolerance, notes
        self._ends = np.array([(shapes[0].start, shapes[-1].end) for shapes in self._shapes]).reshape(-1, 3)
        self._tree = cKDTree(self._ends)
        self._loop = np.array([is_loop(shapes, tolerance) for shapes in self._shapes], dtype=np.bool_)
        self._free = ~self._loop

    def chains(self) -> Iterable[list[Shape]]:
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

    def _grow(self, chain: list[Shape]) -> list[Shape]:
        """Add runs at the chain's end for as long as there are some."""
        while not is_loop(chain, self._tolerance) and (found := self._next(chain[-1])) is not None:
            number, reverse = found
            self._free[number] = False
            more = list(self._shapes[number])
            chain.extend(turned(more) if reverse else more)
        return chain

    def _next(self, last: Shape) -> tuple[int, bool] | None:
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


def is_loop(shapes: Sequence[Shape], tolerance: float) -> bool:
    """Whether a run comes back to where it began, after having been somewhere else."""
    start = shapes[0].start
    if float(np.linalg.norm(shapes[-1].end - start)) > tolerance:
        return False
    away = max(float(np.abs(shape.points - start).max()) + 0.0 for shape in shapes)
    return away > 2.0 * tolerance or np.array_equal(shapes[-1].end, start)


def turned(shapes: Sequence[Shape]) -> list[Shape]:
    """Return a run the other way round."""
    return [backwards(shape) for shape in reversed(shapes)]


def _contour(pieces: list[Shape], layer: str, tolerance: float, same: float, notes: _Notes) -> Contour:
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


def _joined(before: Shape, after: Shape, same: float, most: float, notes: _Notes) -> list[Shape]:
    gap = gap_of(before, after)
    joint = meet(before, after, same, most)
    if gap > same:
        notes.joint(gap, joint.moved, joint.between is not None)
    between = [] if joint.between is None else [joint.between]
    return [joint.before, *between, joint.after]


def without_points(runs: Iterable[Run], least: float) -> tuple[list[Run], int]:
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
