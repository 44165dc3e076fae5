"""The stretches inside hunks, in both programs: which motions they are, and the way they go."""

from __future__ import annotations

import msgspec
import numpy as np

from ph_post.audit.align import NO_HUNK
from ph_post.audit.outline import outline
from ph_post.audit.pairing import Pairing
from ph_post.gcode.reader.record import RAPID, Motions
from ph_post.types import Array, BoolArray, IntArray

_RANK = 1 << 32
"""More than there are rapids in a hunk."""


class Side(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The stretches of one program: `motion` (k,) all of them, those of stretch r from ``first[r]`` on.

    `length` (k,) [m] of each motion. `points` (n, 3) [m], those of stretch r from ``point_first[r]`` on, less
    what is added to the axes; `owner` (n,) the place in `motion` that a point belongs to.
    """

    motion: IntArray
    first: IntArray
    length: Array
    points: Array
    point_first: IntArray
    owner: IntArray


class Stretches(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Stretches of cutting moves, r of them, in hunks, cut at the rapids; `hunk` (r,) of each.

    Jogs are left out. Where a stretch has no motion in one program it has a point there: where it begins in
    the other one.
    """

    hunk: IntArray
    old: Side
    new: Side


def find_stretches(original: Motions, compensated: Motions, pairing: Pairing, sagitta: float) -> Stretches:
    """Find all stretches, and lay polylines through them that leave the motions by at most `sagitta` [m]."""
    nothing = np.zeros((original.kind.size, 3))
    old_key, old = _keys(original.kind, pairing.old_hunk, np.zeros(original.kind.size, dtype=bool))
    new_key, new = _keys(compensated.kind, pairing.new_hunk, pairing.jog)
    keys = np.union1d(old_key, new_key)
    old_first, new_first = (np.append(np.searchsorted(own, keys), own.size) for own in (old_key, new_key))
    one = _side(original, nothing, old, old_first, sagitta)
    other = _side(compensated, pairing.after, new, new_first, sagitta)
    return Stretches(hunk=keys // _RANK, old=_filled(one, other), new=_filled(other, one))


def _keys(kind: IntArray, hunk: IntArray, without: BoolArray) -> tuple[IntArray, IntArray]:
    """Hunk and number of rapids before it there, as one number, of the motions that cut in hunks."""
    rapids = np.cumsum(kind == RAPID)
    which = np.flatnonzero((hunk != NO_HUNK) & (kind != RAPID) & ~without)
    begins = np.append(True, hunk[1:] != hunk[:-1])
    start = np.maximum.accumulate(np.where(begins, np.arange(hunk.size), 0))[which]
    return np.asarray(hunk[which] * _RANK + rapids[which] - np.append(0, rapids)[start]), which


def _side(motions: Motions, shift: Array, which: IntArray, first: IntArray, sagitta: float) -> Side:
    lines = outline(motions, which, sagitta)
    owner = np.repeat(np.arange(which.size), np.diff(lines.first))
    steps = np.linalg.norm(np.diff(np.nan_to_num(lines.points), axis=0), axis=1)
    steps[lines.first[1:-1] - 1] = 0.0
    length = np.add.reduceat(np.append(steps, 0.0), lines.first[:-1]) if which.size else np.zeros(0)
    return Side(
        motion=which, first=first, length=length, points=np.nan_to_num(lines.points) - shift[which][owner],
        point_first=lines.first[first], owner=owner,
    )  # fmt: skip


def _filled(side: Side, other: Side) -> Side:
    """Give stretches without a motion a point: the first of the other program's."""
    empty = np.flatnonzero(np.diff(side.first) == 0)
    if not empty.size:
        return side
    places = side.point_first[empty]
    added = np.zeros(side.point_first.size, dtype=np.int64)
    added[empty + 1] = 1
    return msgspec.structs.replace(
        side,
        points=np.insert(side.points, places, other.points[other.point_first[empty]], axis=0),
        point_first=side.point_first + np.cumsum(added),
        owner=np.insert(side.owner, places, -1),
    )
