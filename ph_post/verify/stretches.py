"""The stretches of both programs that need a closer look: cutting moves of changes between rapids, side by side."""

from __future__ import annotations

import msgspec
import numpy as np

from ph_post.gcode.program import ARC, LINE, Motions, expand, plane_columns
from ph_post.types import Array, BoolArray, IntArray
from ph_post.verify.pairing import RANK, Pairing, run_begins, stretch_keys
from ph_post.verify.polylines import motion_lengths, places_on, radii

_NOTHING = 1e-12
"""No length [m] is divided by that is smaller."""


class StretchSide(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The stretches of one program: `motion` (k,) all of them, those of stretch r from ``first[r]`` on.

    `length` (k,) [m] of each motion, `shift` (k, 3) [m] what is added to it.
    """

    motion: IntArray
    first: IntArray
    length: Array
    shift: Array

    def stretch(self) -> IntArray:
        """Return the number of the stretch of each motion."""
        return np.repeat(np.arange(self.first.size - 1), np.diff(self.first))

    def totals(self) -> Array:
        """Return the length of each stretch [m]."""
        sums = np.append(0.0, np.cumsum(self.length))[self.first]
        return np.asarray(np.diff(sums))

    def places(self) -> tuple[Array, Array]:
        """Return the start and end of each motion: number of its stretch plus share of that stretch's length."""
        run = self.stretch()
        total = np.maximum(self.totals(), _NOTHING)[run]
        sums = np.append(0.0, np.cumsum(self.length))
        begins = sums[self.first[:-1]][run]
        low, high = (np.clip((ends - begins) / total, 0.0, 1.0) for ends in (sums[:-1], sums[1:]))
        return run + low, run + high


class Stretches(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Stretches of cutting moves, r of them, in changes, cut at the rapids; `change` (r,) of each.

    Jogs are left out. A stretch may be without a motion in one of the programs.
    """

    change: IntArray
    old: StretchSide
    new: StretchSide

    def take(self, which: BoolArray) -> Stretches:
        """Return some of the stretches."""
        rows = np.flatnonzero(which)
        old, new = (_part(side, side.first[rows], side.first[rows + 1]) for side in (self.old, self.new))
        return Stretches(change=self.change[rows], old=old, new=new)


def find_stretches(original: Motions, compensated: Motions, pairing: Pairing) -> Stretches:
    """Find all stretches."""
    nothing = np.zeros((original.kind.size, 3))
    old_key, old = stretch_keys(original.kind, pairing.old_change, np.zeros(original.kind.size, dtype=bool))
    new_key, new = stretch_keys(compensated.kind, pairing.new_change, pairing.left_out, pairing.approach)
    keys = np.union1d(old_key, new_key)
    return Stretches(
        change=keys // RANK,
        old=_side(original, old, np.append(np.searchsorted(old_key, keys), old.size), nothing),
        new=_side(compensated, new, np.append(np.searchsorted(new_key, keys), new.size), pairing.after),
    )


def _side(motions: Motions, which: IntArray, first: IntArray, shift: Array) -> StretchSide:
    return StretchSide(motion=which, first=first, length=motion_lengths(motions, which), shift=shift[which])


def unproven_stretches(original: Motions, compensated: Motions, found: Stretches, bound: float) -> Stretches:
    """Return the stretches without motions that were only divided, each part on its motion within `bound` [m].

    Parts of a line are lines and parts of an arc are arcs about its centre; both are measured against the
    point of their motion that lies at the same share of it. What remains are stretches of neighbours.
    """
    owner = _owners(found)
    fine = _divided(original, compensated, found, owner, bound)
    run = found.old.stretch()
    bad = np.flatnonzero(~fine)
    begins = np.append(True, (np.diff(bad) > 1) | (np.diff(run[bad]) > 0))[: bad.size]
    low, high = bad[begins], bad[np.append(begins[1:], True)[: bad.size]] + 1
    new_low, new_high = (
        np.searchsorted(owner, 2 * low + 1),
        np.searchsorted(owner, 2 * high - 1, side="right"),
    )
    alone = np.flatnonzero((np.diff(found.old.first) == 0) & (np.diff(found.new.first) > 0))
    spans = np.concatenate(
        [
            [run[low], low, high, new_low, new_high],
            [alone, *2 * [found.old.first[alone]], found.new.first[alone], found.new.first[alone + 1]],
        ],
        axis=1,
    )
    spans = spans[:, np.argsort(spans[0], kind="stable")]
    return Stretches(
        change=found.change[spans[0]],
        old=_part(found.old, spans[1], spans[2]),
        new=_part(found.new, spans[3], spans[4]),
    )


def _owners(found: Stretches) -> IntArray:
    """Place of the original's motion that each new one is a part of, twice and one.

    Twice the place of the next one for stretches that have none: the numbers never fall.
    """
    run = found.new.stretch()
    low, high = found.new.places()
    _, old_high = found.old.places()
    first, last = found.old.first[run], found.old.first[run + 1]
    owner = np.clip(np.searchsorted(old_high, 0.5 * (low + high)), first, np.maximum(last - 1, first))
    return np.asarray(np.where(first < last, 2 * np.maximum.accumulate(owner) + 1, 2 * first))


def _divided(original: Motions, compensated: Motions, found: Stretches, owner: IntArray, bound: float) -> BoolArray:
    """Mask of the original's motions that are there part by part and nothing else."""
    part = np.flatnonzero(owner % 2 == 1)
    place, new = owner[part] // 2, found.new.motion[part]
    old = found.old.motion[place]
    arc = original.kind[old] == ARC
    amount = np.where(arc, np.abs(compensated.angle[new]), found.new.length[part])
    whole = np.bincount(place, weights=amount, minlength=found.old.motion.size)
    sums = np.append(0.0, np.cumsum(amount))
    start = sums[:-1][run_begins(place)]
    scale = np.maximum(whole[place], _NOTHING)
    shift = found.new.shift[part]
    off = np.zeros(place.size)
    for ends, reached in ((compensated.start, sums[:-1]), (compensated.end, sums[1:])):
        there = places_on(original, old, np.clip((reached - start) / scale, 0.0, 1.0))
        gap = np.nan_to_num(ends[new]) - shift - np.nan_to_num(there)
        off = np.maximum(off, np.linalg.norm(gap, axis=1))
    off[arc] += _bends(original, compensated, old[arc], new[arc], shift[arc], whole[place[arc]])
    alike = (original.kind[old] == compensated.kind[new]) & (arc | (original.kind[old] == LINE))
    many = np.bincount(place, minlength=found.old.motion.size)
    good = np.bincount(place, weights=alike & (off <= bound), minlength=found.old.motion.size)
    return np.asarray((many == good) & ((many > 0) | (found.old.length <= _NOTHING)))


def _bends(original: Motions, compensated: Motions, old: IntArray, new: IntArray, shift: Array, swept: Array) -> Array:
    """Bound of the deviation of a part of an arc between its ends: by centre, radius and sweep [m]."""
    arcs = compensated.kind[new] == ARC
    columns = plane_columns(original.plane[old])[:, :2]
    centre = compensated.center[new] - np.take_along_axis(shift, columns, axis=1) - original.center[old]
    one, other = radii(original, old), radii(compensated, new)
    radius = np.abs(other[0] - one[0]) + np.abs(one[1] - one[0]) + np.abs(other[1] - other[0])
    sweep = np.maximum(one[0], one[1]) * np.abs(swept - np.abs(original.angle[old]))
    same = (original.plane[old] == compensated.plane[new]) & (
        np.sign(original.angle[old]) == np.sign(compensated.angle[new])
    )
    return np.asarray(np.where(arcs & same, 2.0 * (np.hypot(*centre.T) + radius) + sweep, np.inf), dtype=np.float64)


def _part(side: StretchSide, low: IntArray, high: IntArray) -> StretchSide:
    """Take stretches out of a side."""
    which, _ = expand(low, high)
    return StretchSide(
        motion=side.motion[which],
        first=np.append(0, np.cumsum(high - low)),
        length=side.length[which],
        shift=side.shift[which],
    )
