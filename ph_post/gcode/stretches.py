"""The motion between walls: stretches of one character, before they are cut into blocks."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np

from ph_post.compensate.motion import Motion
from ph_post.gcode.shape import Shape, between
from ph_post.gcode.timeline import Span, find_spans, time_at
from ph_post.types import Array, IntArray, Phase


class Stretch(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a span between two walls, or of the path that is run through at rapid speed."""

    span: Span
    start: float
    end: float
    s0: float
    s1: float
    rapid: bool

    @property
    def by_geometry(self) -> bool:
        """Whether blocks may be as long as the geometry allows."""
        return self.rapid or self.span.kind == "steady"


class Runs(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Parts of stretches on which blocks are of one kind, arrays of shape (n,).

    `stretch` number; `s0`, `s1` places along the motion [m]; `kind` as in :mod:`ph_post.gcode.shape`; `piece`
    one of its pieces; `base` [m] where the present round of a closed path began.
    """

    stretch: IntArray
    s0: Array
    s1: Array
    kind: IntArray
    piece: IntArray
    base: Array


def find_stretches(phases: Sequence[Phase], shape: Shape) -> list[Stretch]:
    """Cut the spans at the walls inside them, and join those that neighbour in rapid segments."""
    found: list[Stretch] = []
    motion = Motion.from_phases(phases)
    for span in find_spans(phases):
        for stretch in _between_walls(motion, shape, span):
            if found and stretch.rapid and found[-1].rapid:
                found[-1] = msgspec.structs.replace(found[-1], end=stretch.end, s1=stretch.s1)
            else:
                found.append(stretch)
    return found


def _between_walls(motion: Motion, shape: Shape, span: Span) -> list[Stretch]:
    inner = between(shape, shape.walls, span.s0, span.s1).tolist()
    s = [span.s0, *inner, span.s1]
    t = [span.start, *(time_at(motion, span, place) for place in inner), span.end]
    rapid = shape.rapid[shape.piece_at(np.array([0.5 * (a + b) for a, b in pairwise(s)]))].tolist()
    moves = span.kind != "dwell"  # a rest before a rapid is not part of it: an axis may be shifted there
    return [
        Stretch(span=span, start=t0, end=t1, s0=s0, s1=s1, rapid=bool(quick) and moves)
        for (t0, t1), (s0, s1), quick in zip(pairwise(t), pairwise(s), rapid, strict=True)
    ]


def find_runs(stretches: list[Stretch], shape: Shape) -> Runs:
    """Cut the stretches whose blocks follow from the geometry where the kind of their pieces changes."""
    rows: list[tuple[int, float, float]] = []
    for number, stretch in enumerate(stretches):
        if stretch.by_geometry:
            marks = between(shape, shape.marks, stretch.s0, stretch.s1).tolist()
            rows += [(number, a, b) for a, b in pairwise([stretch.s0, *marks, stretch.s1])]
    s0, s1 = np.array([row[1:] for row in rows], dtype=np.float64).reshape(-1, 2).T
    middle, length = 0.5 * (s0 + s1), shape.track.length
    piece = shape.piece_at(middle)
    return Runs(
        stretch=np.array([row[0] for row in rows], dtype=np.int64),
        s0=s0,
        s1=s1,
        kind=shape.kind[piece],
        piece=piece,
        base=length * np.floor(middle / length) if shape.track.closed else np.zeros(s0.size),
    )
