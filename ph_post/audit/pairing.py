"""Which motion stands for which, which moves are jogs, and by what each axis is shifted along the way."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from ph_post.audit.align import NO_HUNK, Alignment
from ph_post.audit.case import Case
from ph_post.audit.declared import Amount, Declaration
from ph_post.audit.orders import Dwells
from ph_post.gcode.reader.record import AXES, LINE, RAPID, Motions, PlaceArray
from ph_post.types import Array, BoolArray
from ph_post.units import MM

EXACT = 1e-9
"""Lengths [m] that differ by no more are the same number: rounding of doubles, over many blocks of G91."""


_LEAST = 0.01
"""In a shorter dwell [s] a controller may not stand still, and blend away what is between two of them."""

_ROUNDING = 1e-4
"""Part of a dwell that its last digit may take away."""


class Pairing(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The motions of both programs, side by side.

    `old`, `new` (p,) numbers of motions that stand for each other one to one: all outside hunks, and the
    rapids inside them. `old_hunk`, `new_hunk` the hunk of every motion; `jog` (k,) which of the compensated
    motions move an axis while the path stands still; `before`, `after` (k, 3) [m] what the axes are shifted
    by at the start and at the end of each compensated motion.
    """

    old: PlaceArray
    new: PlaceArray
    old_hunk: PlaceArray
    new_hunk: PlaceArray
    jog: BoolArray
    before: Array
    after: Array


def pair_motions(case: Case, dwells: Dwells) -> Pairing | None:
    """Pair the motions, and follow what is added to them; None where one has no counterpart.

    `dwells` are those that the compensation added.
    """
    one, other = case.original.motions, case.compensated.motions
    old_hunk, new_hunk = case.lines.old_hunk[one.block], case.lines.new_hunk[other.block]
    pairs = _pairs(case, old_hunk, new_hunk)
    if pairs is None:
        return None
    old, new = pairs
    jog = _find_jogs(case, new_hunk, dwells)
    before, after = _follow_shifts(one, other, old, new, jog)
    case.findings.count("motions", other.block.size)
    case.findings.count("jogs", int(jog.sum()))
    return Pairing(
        old=old, new=new, old_hunk=old_hunk, new_hunk=new_hunk, jog=jog, before=before, after=after
    )


def _pairs(case: Case, old_hunk: PlaceArray, new_hunk: PlaceArray) -> tuple[PlaceArray, PlaceArray] | None:
    """Motions one to one: by their lines outside hunks, and the rapids of each hunk by their order."""
    one, other, lines = case.original.motions, case.compensated.motions, case.lines
    old_line = np.zeros(case.original.blocks, dtype=np.int32)
    new_line = np.zeros(case.compensated.blocks, dtype=np.int32)
    old_line[lines.old] = new_line[lines.new] = np.arange(lines.old.size)
    old = np.flatnonzero((old_hunk == NO_HUNK) | (one.kind == RAPID)).astype(np.int32)
    new = np.flatnonzero((new_hunk == NO_HUNK) | (other.kind == RAPID)).astype(np.int32)
    old_place = np.where(old_hunk[old] == NO_HUNK, old_line[one.block[old]], -1 - old_hunk[old])
    new_place = np.where(new_hunk[new] == NO_HUNK, new_line[other.block[new]], -1 - new_hunk[new])
    if np.array_equal(old_place, new_place):
        return old, new
    shared = min(old.size, new.size)
    apart = np.flatnonzero(old_place[:shared] != new_place[:shared])
    place = int(apart[0]) if apart.size else shared
    case.findings.add(
        "path", "a motion has no counterpart in the other program",
        original=int(one.block[old[place]]) if place < old.size else None,
        compensated=int(other.block[new[place]]) if place < new.size else None,
    )  # fmt: skip
    return None


def _find_jogs(case: Case, hunk: PlaceArray, dwells: Dwells) -> BoolArray:
    """Straight moves in hunks, between two added dwells, of one declared axis, by a declared amount."""
    motions = case.compensated.motions
    straight = np.flatnonzero((motions.kind == LINE) & (hunk != NO_HUNK))
    start, end = motions.start[straight], motions.end[straight]
    # What comes from where it is not known moves some way, however short the others' are.
    way = np.where(np.isnan(end), 0.0, np.where(np.isnan(start), np.inf, np.abs(end - start)))
    enough = dwells.duration >= (1.0 - _ROUNDING) * min(_LEAST, case.declared.dwell or _LEAST)
    long = Dwells(block=dwells.block[enough], duration=dwells.duration[enough])
    ahead, behind = dwell_beside(motions.block, hunk, long, case.lines)
    jog = np.zeros(hunk.size, dtype=bool)
    for axis, (offset, pulse) in declared_ways(case.declared).items():
        alone = np.all(np.delete(way, axis, axis=1) <= EXACT, axis=1)
        jog[straight] |= alone & is_declared(way[:, axis], offset, pulse)
    return np.asarray(jog & ahead & behind)


def declared_ways(declared: Declaration) -> dict[int, tuple[float, float]]:
    """By column of a declared axis: the lasting offset and the largest pulse [m], 0 where there is none."""

    def metres(amounts: Mapping[str, Amount], axis: str) -> float:
        return amounts[axis].metres if axis in amounts else 0.0

    return {
        AXES.index(axis): (metres(declared.offsets, axis), metres(declared.pulses, axis))
        for axis in (*declared.offsets, *declared.pulses)
    }


def is_declared(way: Array, offset: float, pulse: float) -> BoolArray:
    """Whether lengths are a change of the offset, or no longer than a pulse, offset included."""
    change = (offset > 0.0) & (np.minimum(np.abs(way - offset), np.abs(way - 2.0 * offset)) <= EXACT)
    return np.asarray((way > EXACT) & (change | (way <= pulse + offset + EXACT) & (pulse > 0.0)))


def dwell_beside(
    block: PlaceArray, hunk: PlaceArray, dwells: Dwells, lines: Alignment
) -> tuple[BoolArray, BoolArray]:
    """Whether one of the dwells stands between a motion and the one before it, and the one after it.

    Both in the motion's own hunk.
    """
    if not dwells.block.size or not block.size:
        nothing = np.zeros(block.size, dtype=bool)
        return nothing, nothing
    place = np.searchsorted(dwells.block, block)
    previous = np.concatenate([[-1], block[:-1]])
    following = np.concatenate([block[1:], [np.iinfo(np.int64).max]])
    last = dwells.block[np.maximum(place - 1, 0)]
    first = dwells.block[np.minimum(place, dwells.block.size - 1)]
    ahead = (place > 0) & (last > previous) & (lines.new_hunk[last] == hunk)
    behind = (place < dwells.block.size) & (first < following) & (lines.new_hunk[first] == hunk)
    return ahead, behind


def _follow_shifts(
    one: Motions, other: Motions, old: PlaceArray, new: PlaceArray, jog: BoolArray
) -> tuple[Array, Array]:
    """Shifts at the start and end of each motion: at pairs their difference, between them the jogs."""
    number = jog.size
    latest = np.zeros(number + 1, dtype=np.int32)
    latest[new + 1] = new + 1
    latest = np.maximum.accumulate(latest)
    before, after = np.empty((number, 3)), np.empty((number, 3))
    for axis in range(3):  # one by one, each in a call of its own: there may be a million motions
        shift = _shift_of(one.end[:, axis], other.start[:, axis], other.end[:, axis], (old, new, latest), jog)
        before[:, axis], after[:, axis] = shift[:-1], shift[1:]
        del shift
        before[new, axis] = np.nan_to_num(other.start[new, axis] - one.start[old, axis])
    return before, after


def _shift_of(
    old_end: Array, start: Array, end: Array, pairs: tuple[PlaceArray, PlaceArray, PlaceArray], jog: BoolArray
) -> Array:
    """Shift of an axis before the first motion and after each, (k + 1,): the latest pair's, and jogs."""
    old, new, latest = pairs
    total = np.zeros(jog.size + 1)
    np.cumsum(np.where(jog, np.nan_to_num(end - start), 0.0), out=total[1:])
    shift = np.zeros(jog.size + 1)
    shift[new + 1] = np.nan_to_num(end[new] - old_end[old])
    shift = shift[latest]
    shift += total
    shift -= total[latest]
    return shift


def millimetres(shift: Array) -> str:
    """Show the shifts of the axes that have one, in a message."""
    parts = [
        f"{name} {value / MM:.6g} mm" for name, value in zip(AXES, shift, strict=True) if abs(value) > EXACT
    ]
    return ", ".join(parts) or "0"
