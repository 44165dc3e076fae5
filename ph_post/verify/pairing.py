"""Pair the motions of both programs, and find the added jogs and approaches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.compiling import compiled, read_only
from ph_post.gcode.program import AXES, LINE, RAPID, CodeArray, Motions, PlaceArray, rows_where
from ph_post.types import Array, BoolArray, IntArray, unwritten
from ph_post.units import MM
from ph_post.verify.declared import DeclaredChanges, DeclaredLength
from ph_post.verify.line_pairs import NO_CHANGE, LinePairs, VerifyCase
from ph_post.verify.states import Dwells

EXACT = 1e-9
"""Lengths [m] that differ by no more are the same number: rounding of doubles, over many blocks of G91."""


_LEAST = 0.01
"""Shortest dwell [s] in which a controller stands still; it may blend the moves between two shorter dwells."""

_ROUNDING = 1e-4
"""Relative rounding of a dwell by its last digit."""


class Pairing(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The motions of both programs, side by side.

    `paired` are masks of the motions of both, (m,) and (k,), that stand for each other one to one: all outside changes,
    and the rapids inside them. `old_change`, `new_change` the change of every motion; `jog` (k,) is true for
    compensated motions that move an axis while the path stands still, `approach` (k,) for those of them that follow a
    rapid without a dwell; `crossed` (k,) for the motions of changes that name a crossing, but rapids and approaches,
    `closing` (k,) for the last of them in their stretch; `after` (k, 3) [m] are the shifts of the axes at the end of
    each compensated motion; inside a crossing they are not known. Each begins with the shift with which the one before
    it ends, but those of `anew`: by axis the motions, and the shifts [m] with which they begin.
    """

    paired: tuple[BoolArray, BoolArray]
    old_change: NDArray[Any]
    new_change: NDArray[Any]
    jog: BoolArray
    approach: BoolArray
    crossed: BoolArray
    closing: BoolArray
    shifts: Array
    anew: Mapping[int, tuple[PlaceArray, Array]]

    def pairs(self) -> tuple[PlaceArray, PlaceArray]:
        """Return the numbers of the motions of both that stand for each other one to one, (p,) each."""
        old, new = map(rows_where, self.paired)
        return old, new

    @property
    def after(self) -> Array:
        """Shifts at the ends of all motions, shape (k, 3) [m]."""
        return self.shifts[:, 1:].T

    def before(self, axis: int) -> tuple[Array, PlaceArray, Array]:
        """Return the shifts of an axis with which the motions before all motions end, shape (k,) [m], and `anew`."""
        motions, begins = self.anew.get(axis, (np.zeros(0, dtype=np.int32), np.zeros(0)))
        return read_only(self.shifts[axis, :-1]), read_only(motions), read_only(begins)

    def before_of(self, motions: IntArray) -> Array:
        """Return the shifts at the starts of some motions, shape (n, 3) [m]."""
        found = self.shifts[:, motions].T.copy()
        for axis, (anew, begins) in self.anew.items():
            place = np.minimum(np.searchsorted(anew, motions.astype(anew.dtype)), anew.size - 1)
            found[:, axis] = np.where(anew[place] == motions, begins[place], found[:, axis])
        return found

    @property
    def left_out(self) -> BoolArray:
        """Mask (k,) of the motions that are no part of the path: jogs, but those between crossings."""
        return np.asarray(self.jog & ~self.crossed)


def pair_motions(case: VerifyCase, dwells: Dwells) -> Pairing | None:
    """Pair the motions, and follow what is added to them; None where one has no counterpart.

    `dwells` are those that the compensation added.
    """
    one, other = case.original.motions, case.compensated.motions
    old_change, new_change = case.lines.old_change[one.block], case.lines.new_change[other.block]
    added = _rapid_approaches(case, old_change, new_change)
    pairs = _pairs(case, old_change, new_change, added)
    if pairs is None:
        return None
    old, new = map(rows_where, pairs)
    jog = _find_jogs(case, new_change, dwells)
    approach = _find_approaches(case, old, new, new_change, added)
    jog |= approach
    named = np.append(case.lines.changes.crossed, False)
    crossed = named[new_change] & (other.kind != RAPID) & ~approach & ~_first_of_all(other, new_change, jog)
    last_old, last_new, alone, closing = _crossed_ends(one, other, old_change, new_change, crossed, approach)
    ends = last_old.astype(old.dtype), last_new.astype(new.dtype)
    shifts, anew = _follow_shifts(one, other, (old, new), ends, (jog & ~crossed) | alone)
    case.findings.count("motions", other.block.size)
    case.findings.count("jogs", int(jog.sum()))
    return Pairing(
        paired=pairs,
        old_change=old_change,
        new_change=new_change,
        jog=jog,
        approach=approach,
        crossed=crossed,
        closing=closing,
        shifts=shifts,
        anew=anew,
    )


def _rapid_approaches(case: VerifyCase, old_change: NDArray[Any], new_change: NDArray[Any]) -> BoolArray:
    """Mask (k,) of the rapids in changes that only bring a declared axis onto its side, right behind another rapid.

    They are as many as the change has more rapids than the original.
    """
    one, other = case.original.motions, case.compensated.motions
    found = np.zeros(other.kind.size, dtype=bool)
    inside = np.flatnonzero((other.kind == RAPID) & (new_change != NO_CHANGE))
    had = dict(zip(*np.unique(old_change[one.kind == RAPID], return_counts=True), strict=True))
    for change in np.unique(new_change[inside]).tolist():
        own = inside[new_change[inside] == change]
        own_found = [
            motion
            for motion in own.tolist()
            if motion > 0
            and other.kind[motion - 1] == RAPID
            and new_change[motion - 1] in (change, NO_CHANGE)
            and _takes_up(case, other.start[motion], other.end[motion])
        ]
        if len(own_found) == own.size - int(had.get(change, 0)):
            found[own_found] = True
    return found


def _takes_up(case: VerifyCase, start: Array, end: Array) -> bool:
    """Return whether a move (3,) [m] is that of one declared axis, by no more than an approach takes."""
    # What is not known, and stays so, does not move.
    way = np.where(np.isnan(end), 0.0, np.nan_to_num(np.abs(end - start), nan=np.inf))
    axis = int(np.argmax(way))
    offset, pulse = declared_lengths(case.declared).get(axis, (0.0, 0.0))
    return bool(np.count_nonzero(way > EXACT) == 1 and way[axis] <= 2.0 * offset + pulse + EXACT)


def _pairs(
    case: VerifyCase, old_change: NDArray[Any], new_change: NDArray[Any], added: BoolArray
) -> tuple[BoolArray, BoolArray] | None:
    """Masks of the motions of both one to one: by their lines outside changes, and the rapids of each by their order.

    Those that are `added` have no counterpart.
    """
    one, other, lines = case.original.motions, case.compensated.motions, case.lines
    old_line = np.zeros(case.original.blocks, dtype=np.int32)
    new_line = np.zeros(case.compensated.blocks, dtype=np.int32)
    outside = lines.outside()
    old_line[outside[0]] = new_line[outside[1]] = np.arange(outside[0].size)
    del outside
    masks = (
        (old_change == NO_CHANGE) | (one.kind == RAPID),
        ((new_change == NO_CHANGE) | (other.kind == RAPID)) & ~added,
    )
    old, new = map(rows_where, masks)
    old_place = np.where(old_change[old] == NO_CHANGE, old_line[one.block[old]], -1 - old_change[old])
    new_place = np.where(new_change[new] == NO_CHANGE, new_line[other.block[new]], -1 - new_change[new])
    if np.array_equal(old_place, new_place):
        return masks
    shared = min(old.size, new.size)
    apart = np.flatnonzero(old_place[:shared] != new_place[:shared])
    place = int(apart[0]) if apart.size else shared
    case.findings.add(
        "path",
        "a motion has no counterpart in the other program",
        original=int(one.block[old[place]]) if place < old.size else None,
        compensated=int(other.block[new[place]]) if place < new.size else None,
    )
    return None


def _find_jogs(case: VerifyCase, change: NDArray[Any], dwells: Dwells) -> BoolArray:
    """Straight moves in changes, between two added dwells, of declared axes, each by a declared amount.

    A take-up move is one of a single axis; with a change of the offset others may be changed as well.
    """
    motions = case.compensated.motions
    straight = np.flatnonzero((motions.kind == LINE) & (change != NO_CHANGE))
    start, end = motions.start[straight], motions.end[straight]
    # What comes from where it is not known moves some way, however short the others' are.
    way = np.where(np.isnan(end), 0.0, np.where(np.isnan(start), np.inf, np.abs(end - start)))
    least = _LEAST if case.declared.dwell is None else case.declared.dwell
    enough = dwells.duration >= (1.0 - _ROUNDING) * min(_LEAST, least)
    long = Dwells(block=dwells.block[enough], duration=dwells.duration[enough])
    ahead, behind = dwell_beside(motions.block, change, long, case.lines)
    jog, still, fitting = np.zeros(change.size, dtype=bool), way <= EXACT, np.zeros(way.shape, dtype=bool)
    for axis, (offset, pulse) in declared_lengths(case.declared).items():
        alone = np.all(np.delete(way, axis, axis=1) <= EXACT, axis=1)
        jog[straight] |= alone & is_declared(way[:, axis], offset, pulse)
        fitting[:, axis] = is_declared(way[:, axis], offset, 0.0)
    jog[straight] |= np.all(still | fitting, axis=1) & fitting.any(axis=1)
    return np.asarray(jog & ahead & behind)


def _find_approaches(
    case: VerifyCase, old: PlaceArray, new: PlaceArray, change: NDArray[Any], added: BoolArray
) -> BoolArray:
    """Straight moves in changes right behind a rapid, of one declared axis, to its place with a declared offset.

    They may be `added` rapids themselves.

    Where several axes have one, their moves follow one another. An axis that the rapid does not name goes beyond its
    place first, by a move of its own.
    """
    motions, found = case.compensated.motions, np.zeros(change.size, dtype=bool)
    partner = np.full(change.size, -1, dtype=np.int64)
    partner[new] = old
    rapid = np.flatnonzero((motions.kind == RAPID) & (partner >= 0))
    behind = rapid
    # Z may come down onto one side first, and then go up through its backlash.
    for _ in range(2 * len(AXES)):
        inside = behind + 1 < change.size
        rapid, behind = rapid[inside], behind[inside] + 1
        straight = ((motions.kind[behind] == LINE) | added[behind]) & (change[behind] != NO_CHANGE)
        straight &= motions.chain[behind] == motions.chain[rapid]
        rapid, behind = rapid[straight], behind[straight]
        right = _approaching(case, behind, partner[rapid])
        back = np.minimum(behind + 1, change.size - 1)
        goes_on = (back > behind) & ((motions.kind[back] == LINE) | added[back]) & (change[back] == change[behind])
        out = _approaching(case, behind, partner[rapid], anywhere=True)
        right |= np.where(goes_on[:, None], out & _approaching(case, back, partner[rapid]), False)
        kept = right.any(axis=1)
        rapid, behind = rapid[kept], behind[kept]
        found[behind] = True
    return found


def _first_of_all(motions: Motions, change: NDArray[Any], jog: BoolArray) -> BoolArray:
    """Mask (k,) of the jogs that begin their changes, of axes that have not moved from a known place in their chains.

    On which side such an axis begins nobody knows; on the wrong one the original is no nearer to the path.
    """
    found = np.zeros(jog.size, dtype=bool)
    jogs = np.flatnonzero(jog)
    if not jogs.size:
        return found
    head = run_begins(change)[jogs]
    leading = jogs - head == np.arange(jogs.size) - np.searchsorted(jogs, head)  # none but jogs before it there
    jogs, head = jogs[leading], head[leading]
    begins = run_begins(motions.chain)[jogs]
    for axis in range(len(AXES)):
        way = np.abs(motions.end[:, axis] - motions.start[:, axis]) > EXACT
        moved = np.append(np.int32(0), np.cumsum(way, dtype=np.int32))
        found[jogs] |= way[jogs] & (moved[head] == moved[begins])
    return found


def run_begins(number: NDArray[Any]) -> PlaceArray:
    """Return the first of the equal numbers in a row among which each is, (k,)."""
    return np.asarray(_run_begins(read_only(number.astype(np.int32, copy=False))))


@compiled
def _run_begins(number: Any) -> Any:
    found, first = np.empty(number.size, np.int32), 0
    for k in range(number.size):
        first = first if number[k] == number[first] else k
        found[k] = first
    return found


def _approaching(case: VerifyCase, behind: IntArray, rapid: IntArray, *, anywhere: bool = False) -> BoolArray:
    """Mask (n, 3) of motions that move an axis alone, not too far, to where the original's `rapid` ends.

    There it has one of the declared offsets; `anywhere` lets it end elsewhere.
    """
    motions = case.compensated.motions
    way = np.abs(motions.end[behind] - motions.start[behind])
    beside = motions.end[behind] - case.original.motions.end[rapid]
    right = np.zeros((behind.size, len(AXES)), dtype=bool)
    for axis, sides in declared_sides(case.declared).items():
        offset, pulse = declared_lengths(case.declared)[axis]
        alone = np.all(np.nan_to_num(np.delete(way, axis, axis=1)) <= EXACT, axis=1)
        there = np.min([np.abs(beside[:, axis] - value) for value in (0.0, *sides)], axis=0) <= EXACT
        long = (way[:, axis] > EXACT) & (way[:, axis] <= max(sides[1] - sides[0], pulse + offset) + EXACT)
        right[:, axis] = alone & (there | anywhere) & long
    return right


def declared_sides(declared: DeclaredChanges) -> dict[int, tuple[float, float]]:
    """By column of an axis with an offset: what it carries while it moves to minus, and to plus [m]."""
    return {
        AXES.index(axis): (0.0 if one.side > 0 else -one.metres, 0.0 if one.side < 0 else one.metres)
        for axis, one in declared.offsets.items()
    }


def _crossed_ends(
    one: Motions,
    other: Motions,
    old_change: NDArray[Any],
    new_change: NDArray[Any],
    crossed: BoolArray,
    approach: BoolArray,
) -> tuple[IntArray, IntArray, BoolArray, BoolArray]:
    """Last motions of the stretches in changes with crossings, in pairs.

    Returns masks as well of the motions that replace none, and of all last motions.
    """
    old_key, old = stretch_keys(one.kind, old_change, np.zeros(old_change.size, dtype=bool))
    new_key, new = stretch_keys(other.kind, new_change, ~crossed, approach)
    old_last, new_last = (np.append(key[1:] != key[:-1], True)[: key.size] for key in (old_key, new_key))
    _, left, right = np.intersect1d(old_key[old_last], new_key[new_last], return_indices=True)
    alone, closing = np.zeros(new_change.size, dtype=bool), np.zeros(new_change.size, dtype=bool)
    alone[new[~np.isin(new_key, old_key)]] = True
    closing[new[new_last]] = True
    return old[old_last][left], new[new_last][right], alone, closing


def declared_lengths(declared: DeclaredChanges) -> dict[int, tuple[float, float]]:
    """By column of a declared axis: the offset and the largest take-up move [m], 0 where there is none."""

    def metres(amounts: Mapping[str, DeclaredLength], axis: str) -> float:
        return amounts[axis].metres if axis in amounts else 0.0

    return {
        AXES.index(axis): (metres(declared.offsets, axis), metres(declared.pulses, axis))
        for axis in (*declared.offsets, *declared.pulses)
    }


def is_declared(way: Array, offset: float, pulse: float) -> BoolArray:
    """Mask of lengths [m] that are a change of the offset, or no longer than a take-up move with the offset."""
    change = (offset > 0.0) & (np.minimum(np.abs(way - offset), np.abs(way - 2.0 * offset)) <= EXACT)
    return np.asarray((way > EXACT) & (change | (way <= pulse + offset + EXACT) & (pulse > 0.0)))


def dwell_beside(
    block: PlaceArray, change: NDArray[Any], dwells: Dwells, lines: LinePairs
) -> tuple[BoolArray, BoolArray]:
    """Return masks (k,) of the motions with a dwell before them, and after them, in their own change."""
    if not dwells.block.size or not block.size:
        nothing = np.zeros(block.size, dtype=bool)
        return nothing, nothing
    inside = np.flatnonzero(change != NO_CHANGE)
    place = np.searchsorted(dwells.block, block[inside])
    previous = np.where(inside > 0, block[inside - 1], -1)
    following = np.where(inside + 1 < block.size, block[np.minimum(inside + 1, block.size - 1)], np.iinfo(np.int32).max)
    last = dwells.block[np.maximum(place - 1, 0)]
    first = dwells.block[np.minimum(place, dwells.block.size - 1)]
    own = change[inside]
    ahead, behind = np.zeros(block.size, dtype=bool), np.zeros(block.size, dtype=bool)
    ahead[inside] = (place > 0) & (last > previous) & (lines.new_change[last] == own)
    behind[inside] = (place < dwells.block.size) & (first < following) & (lines.new_change[first] == own)
    return ahead, behind


def _follow_shifts(
    one: Motions,
    other: Motions,
    pairs: tuple[PlaceArray, PlaceArray],
    ends: tuple[PlaceArray, PlaceArray],
    jog: BoolArray,
) -> tuple[Array, dict[int, tuple[PlaceArray, Array]]]:
    """Shifts at the end of each motion: where ends stand for each other their difference, else the jogs.

    `pairs` are the motions that stand for each other from start to end, `ends` those that do so at their ends alone.
    Returns `shifts` and `anew` of :class:`Pairing`, the former of each axis (3, k + 1), those before the first motion
    as well.
    """
    # An axis that is never shifted takes no memory.
    shifts, (partner, paired) = unwritten((len(AXES), jog.size + 1)), pairs
    _shifts(read_only(one.end), read_only(other.start), read_only(other.end), (pairs, ends), jog, shifts)
    anew = {}
    for axis in range(len(AXES)):
        apart = _starts_apart(read_only(one.start), read_only(other.start), partner, paired, shifts[axis], axis)
        if apart.size:
            begins = other.start[paired[apart], axis] - one.start[partner[apart], axis]
            anew[axis] = paired[apart], np.nan_to_num(begins)
    return shifts, anew


@compiled
def _shifts(old_end: Any, start: Any, end: Any, alike: Any, jog: Any, shifts: Any) -> None:
    """Fill shifts of the axes before the first motion and after each, (3, k + 1): the latest pair's, and jogs."""
    paired = np.zeros(jog.size, np.bool_)
    for _, new in alike:
        paired[new] = True
    for axis in range(3):
        own = shifts[axis, 1:]
        for old, new in alike:
            for pair in range(new.size):
                way = end[new[pair], axis] - old_end[old[pair], axis]
                way = 0.0 if np.isnan(way) else way
                if way != own[new[pair]]:
                    own[new[pair]] = way
        latest = total = before = 0.0
        for k in range(jog.size):
            way = end[k, axis] - start[k, axis] if jog[k] else 0.0
            total += 0.0 if np.isnan(way) else way
            if paired[k]:
                latest, before = own[k], total
            shift = latest + total - before
            if shift != own[k]:
                own[k] = shift


@compiled
def _starts_apart(old_start: Any, start: Any, old: Any, paired: Any, shift: Any, axis: Any) -> Any:
    """Numbers of the paired motions that begin with another shift of an axis than the motion before them ends with."""
    found, count = np.empty(paired.size, np.int32), 0
    for pair in range(paired.size):
        way = start[paired[pair], axis] - old_start[old[pair], axis]
        if shift[paired[pair]] != (0.0 if np.isnan(way) else way):
            found[count] = pair
            count += 1
    return found[:count].copy()


def crossing_axes(case: VerifyCase, pairing: Pairing) -> BoolArray:
    """Mask (h + 1, 3) of the axes that cross their backlash in each change; the last row is for no change.

    They are those that the change names, those whose shift it changes, and those of its jogs, which may well leave the
    shift at the end as it was at the beginning. Where its mark has no room for all names, every axis with an offset
    may.
    """
    found = np.zeros((case.lines.changes.number + 1, 3), dtype=bool)
    declared = list(declared_sides(case.declared))
    for change, names in enumerate(case.lines.changes.crossings):
        for axis, _ in names or ():
            found[change, [AXES.index(axis)] if axis else declared] = True
    motions = case.compensated.motions
    crossed = np.flatnonzero(pairing.crossed)
    moved = np.abs(pairing.after[crossed] - pairing.before_of(crossed)) > EXACT
    way = np.nan_to_num(np.abs(motions.end[crossed] - motions.start[crossed]))
    moved |= (way > EXACT) & pairing.jog[crossed, None]
    row, column = np.nonzero(moved)
    found[pairing.new_change[crossed[row]], column] = True
    found[:, [n for n in range(len(AXES)) if n not in declared]] = False
    return found


def format_shifts(shift: Array) -> str:
    """Format the shifts [m] of the axes that have one for a message."""
    parts = [f"{name} {value / MM:.6g} mm" for name, value in zip(AXES, shift, strict=True) if abs(value) > EXACT]
    return ", ".join(parts) or "0"


RANK = 1 << 32
"""More than there are rapids in a change."""


def stretch_keys(
    kind: CodeArray, change: NDArray[Any], without: BoolArray, approach: BoolArray | None = None
) -> tuple[IntArray, IntArray]:
    """Change and number of rapids before it there, as one number, of the motions that cut in changes.

    Rapids that only `approach` do not count.
    """
    rapids = np.zeros(kind.size + 1, dtype=np.int32)
    np.cumsum((kind == RAPID) if approach is None else (kind == RAPID) & ~approach, out=rapids[1:])
    which = np.flatnonzero((change != NO_CHANGE) & (kind != RAPID) & ~without)
    ranks = rapids[which + 1] - rapids[run_begins(change)[which]]
    return np.asarray(change[which].astype(np.int64) * RANK + ranks), which
