"""Places in the air at which axes come onto a side of their backlash: one-sided positioning, and restarts."""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.edit.reversals import BEYOND, CARRIED, CHAIN, COLUMNS, FIRST, LAST, MOTION, SHARE, SHARE0, SHARE1, SIGN
from ph_post.gcode.program import AXES, RAPID, Motions, PartProgram, chain_heads
from ph_post.types import Array, BoolArray, IntArray

RESTART: Final = 60.0
"""A program that cuts for so long [s] can be started again from a line in between: an approach costs 0.1 s."""

NOTHING: Final = 1e-12
"""Axes that move by no more [m] rest."""


def moves(motions: Motions) -> BoolArray:
    """Mask (m, 3) of the axes that motions move, also from where it is not known."""
    found = np.empty(motions.end.shape, dtype=np.bool_)
    turned = np.abs(np.nan_to_num(motions.angle)) > 0.0
    for axis in range(len(AXES)):  # one by one: there may be a million motions
        start, end = motions.start[:, axis], motions.end[:, axis]
        found[:, axis] = np.isfinite(end) & ~(np.abs(end - start) <= NOTHING) | turned
    return found


def resting_places(motions: Motions, column: int) -> list[tuple[int, int]]:
    """Find where a rapid brings an axis to a place at which it rests while the tool cuts, until a rapid moves it again.

    Returns
    -------
    list of tuple
        The rapid, and the next motion that moves the axis, or the first of another chain.
    """
    moving = np.flatnonzero(moves(motions)[:, column])
    cuts = np.append(0, np.cumsum(motions.kind != RAPID))
    ends = np.append(np.flatnonzero(chain_heads(motions.chain))[1:], motions.kind.size)
    found = []
    for n, first in enumerate(moving.tolist()):
        end = int(ends[np.searchsorted(ends, first, side="right")])
        last = min(int(moving[n + 1]), end) if n + 1 < moving.size else end
        free = last == end or motions.kind[last] == RAPID
        if motions.kind[first] == RAPID and free and cuts[last] > cuts[first]:
            found.append((first, last))
    return found


def position_from(
    rows: Array,
    places: list[tuple[int, int]],
    motions: Motions,
    low: IntArray,
    column: int,
    sign: int,
    overshoot: float,
) -> Array:
    """Let an axis come to its places of rest from one side.

    Parameters
    ----------
    rows : Array, shape (n, 11)
        Changes of an axis as of :func:`~ph_post.edit.reversals.find_reversals`.
    places : list of tuple
        Of :func:`resting_places`, in chains that may be shifted.
    motions : Motions
    low : IntArray, shape (c,)
        First motion of every chain.
    column, sign : int
        The axis, and the direction in which it moves last.
    overshoot : float
        Way of that last move [m], where the rapid does not go as far in that direction.
    """
    found: list[Array] = []
    n, held, chain = 0, 0.0, -1.0

    def take(until: int) -> None:
        """Keep the changes before a motion."""
        nonlocal n, held
        while n < len(rows) and rows[n, MOTION] < until:
            found.append(rows[n])
            held, n = rows[n, SIGN], n + 1

    numbers = np.searchsorted(low, np.arange(motions.kind.size), side="right") - 1
    begins = {first for first, _ in places}
    for first, last in places:
        take(first)
        if chain != numbers[first]:
            held = found[-1][SIGN] if found and found[-1][CHAIN] == numbers[first] else 0.0
            chain = float(numbers[first])
        travel = sign * (motions.end[first, column] - motions.start[first, column])
        arrives = bool(travel >= overshoot)
        found.append(_change(first, sign, chain, carried=arrives, beyond=not arrives))
        while n < len(rows) and rows[n, MOTION] < last:
            held, n = rows[n, SIGN], n + 1
        # What is done behind that rapid presumes that the rapid itself has taken the axis to the side of its way.
        here = n < len(rows) and rows[n, MOTION] == last and rows[n, CARRIED] == 1.0
        goes_on = last < numbers.size and numbers[last] == chain
        if goes_on and not here and last not in begins and held not in (0.0, sign):
            found.append(_change(last, held, chain, carried=True))
    take(motions.kind.size + 1)
    return np.array(found).reshape(-1, COLUMNS)


def _change(motion: int, sign: float, chain: float, *, carried: bool, beyond: bool = False) -> Array:
    row = np.zeros(COLUMNS)
    row[[MOTION, SHARE, SIGN, CHAIN, FIRST, SHARE0, LAST, SHARE1]] = motion, 1.0, sign, chain, motion, 1.0, motion, 1.0
    row[CARRIED], row[BEYOND] = float(carried), float(beyond)
    return row


class Restart(msgspec.Struct, frozen=True, kw_only=True):
    """Rapids from `first` to before `cut` behind which a program may be started again.

    `rapid` by column of X and Y: the one that brings the axis to its place; `late` where the approach is there for a
    restart alone. It is not `whole`, and the program is not started again there, where an axis stands at its place
    already, which another chain has brought it to: before G43, say.
    """

    first: int
    cut: int
    chain: int
    rapid: tuple[int, int]
    late: bool
    whole: bool = True


def find_restarts(
    program: PartProgram, times: Array, named: BoolArray, *, late: bool, apart: float = RESTART
) -> list[Restart]:
    """Find the rapids ahead of a plunge that bring all axes to their places, wherever they were.

    In chains without such ones those are found behind which all axes are at places that are known.

    Behind the last cut of the program there is nothing to start again for.

    Parameters
    ----------
    program : PartProgram
    times : Array, shape (m,)
        Time of every motion [s].
    named : BoolArray, shape (m, 3)
        Axes that the lines of motions name, as :func:`shiftable` has them.
    late : bool
        Not only the first of each chain, but one some time behind another as well.
    apart : float
        That time [s].
    """
    motions = program.motions
    if not motions.kind.size:
        return []
    moving, rapid = moves(motions), motions.kind == RAPID
    absolute = np.array([modal.absolute for modal in program.modal], dtype=np.bool_)[program.state[motions.block]]
    # The tool goes down alone before it cuts.
    alone = ~rapid & ~moving[:, :2].any(axis=1)
    clock = np.zeros(times.size + 1)
    np.cumsum(times, out=clock[1:])
    heads = chain_heads(motions.chain)
    numbers = np.cumsum(heads, dtype=np.int32) - np.int32(1)
    found: list[Restart] = []
    others: dict[int, Restart] = {}
    # A lathe has no Y: there X alone comes to its place.
    across = [column for column in range(2) if moving[:, column].any()]
    late = late and len(across) > 1
    # Where a mask is true next is found at once, where it is near: numbers of a million motions would take much room.
    ends, rests = (np.append(mask | heads, True) for mask in (~alone, ~rapid))
    last_cut = np.flatnonzero(~rapid).max(initial=-1)
    for first in np.flatnonzero(rapid & ~np.append(False, rapid[:-1] & ~heads[1:])).tolist():
        if first > last_cut:
            break
        fresh = not found or found[-1].chain != numbers[first]
        if not fresh and not (late and clock[first] - clock[found[-1].first] >= apart):
            continue
        run = slice(first, first + 1 + int(np.argmax(rests[first + 1 :])))
        cut = run.stop + int(np.argmax(ends[run.stop :]))
        down = moving[first:cut, 2] & (motions.end[first:cut, 2] < motions.start[first:cut, 2])
        own = [np.flatnonzero(named[run, column] & absolute[run]) for column in across]
        ready = bool(own) and bool(down.any()) and absolute[first:cut].all()
        brought = [first + int(places[-1]) if places.size else first for places in own]
        x, y = (brought[min(column, len(own) - 1)] for column in range(2)) if ready else (first, first)
        one = Restart(first=first, cut=cut, chain=int(numbers[first]), rapid=(x, y), late=not fresh)
        if ready and all(places.size for places in own):
            found.append(one)
        elif ready and heads[first] and down[1:].any() and not np.isnan(motions.end[first, across]).any():
            # Before any cut, and still above the part behind its first rapid.
            others.setdefault(one.chain, replace(one, whole=False))
    for one in found:
        others.pop(one.chain, None)
    return sorted([*found, *others.values()], key=lambda one: one.first)


def shiftable(program: PartProgram) -> BoolArray:
    """Mask (m, 3) of the axes that the lines of motions name by a number to which an offset can be added.

    In some languages an increment has none.
    """
    motions = program.motions
    owner = np.full(program.blocks, -1, dtype=np.int32)
    owner[motions.block] = np.arange(motions.block.size)
    found = np.zeros((motions.block.size, 3), dtype=np.bool_)
    for words in program.word_parts():
        for column, letter in enumerate(AXES):
            rows = owner[words.block[(words.letter == ord(letter)) & (words.decimals >= 0)]]
            found[rows[rows >= 0], column] = True
    return found


def approach_again(rows: Array, restarts: list[Restart], column: int) -> Array:
    """Let an axis come from beyond its backlash where a program may be started again.

    Parameters
    ----------
    rows : Array, shape (n, 11)
        Changes of an axis as of :func:`~ph_post.edit.reversals.find_reversals`.
    restarts : list of Restart
    column : int
        0 or 1: X or Y.
    """
    found, places, more = rows.copy(), [], []
    for one in restarts:
        motion = one.rapid[column]
        last = int(np.searchsorted(rows[:, MOTION], motion, side="right")) - 1
        if not one.late or last < 0 or rows[last, CHAIN] != one.chain or rows[last, SIGN] == 0.0:
            continue
        if rows[last, MOTION] == motion or (rows[last, MOTION] >= one.first and rows[last, CARRIED] == 0.0):
            found[last, [MOTION, CARRIED, BEYOND]] = motion, 0.0, 1.0
        else:
            places.append(last + 1)
            more.append(_change(motion, rows[last, SIGN], float(one.chain), carried=False, beyond=True))
    return np.insert(found, places, more, axis=0) if more else found


def placed_once(rows: Array, restarts: list[Restart], moving: BoolArray, column: int, sign: float) -> Array:
    """Let an axis come to a side of its backlash in chains in which a rapid brings it to its only place.

    It turns nowhere there, but the part shows where its table stands: on either side, as nobody knows where it was.

    Parameters
    ----------
    rows : Array, shape (n, 11)
        Changes of an axis as of :func:`~ph_post.edit.reversals.find_reversals`.
    restarts : list of Restart
    moving : BoolArray, shape (m,)
        Motions that move the axis, as :func:`moves` has them.
    column : int
        0 or 1: X or Y.
    sign : float
        The side, as a direction.
    """
    turning = set(rows[:, CHAIN].tolist())
    more = []
    for one in restarts:
        brought = one.first + np.flatnonzero(moving[one.first : one.rapid[column] + 1])
        if moving.any() and not one.late and one.chain not in turning:
            # It may be named where it stands already, on whichever side.
            motion = int(brought[-1]) if brought.size else one.rapid[column]
            more.append(_change(motion, sign, float(one.chain), carried=False, beyond=True))
    return _with_changes(rows, more)


def told_once(
    rows: Array, motions: Motions, tells: BoolArray, low: IntArray, column: int, sign: float, *, beyond: bool = False
) -> Array:
    """Let an axis that turns elsewhere come to a side in chains whose first words tell its only place.

    Whoever brought it there may have come from either side, as a macro that photographs each layer of a print.

    Parameters
    ----------
    rows : Array, shape (n, 11)
        Changes of an axis as of :func:`~ph_post.edit.reversals.find_reversals`.
    motions : Motions
    tells : BoolArray, shape (m,)
        Motions whose words may tell the axis its place.
    low : IntArray, shape (c,)
        First motion of every chain.
    column : int
    sign : float
        The side, as a direction.
    beyond : bool
        Whether it comes from beyond its place; else the other side has no offset, and the offset brings it over.
    """
    turning, high = set(rows[:, CHAIN].tolist()), np.append(low[1:], motions.kind.size)
    more = []
    for chain, (begin, end) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        there = begin + np.flatnonzero(np.isfinite(motions.end[begin:end, column]))
        if not there.size or chain in turning or not rows.size:
            continue
        motion = int(there[0])
        if tells[motion] and np.isnan(motions.start[motion, column]) and (motions.kind[motion:end] != RAPID).any():
            more.append(_change(motion, sign, float(chain), carried=False, beyond=beyond))
    return _with_changes(rows, more)


def _with_changes(rows: Array, more: list[Array]) -> Array:
    """Insert more changes, in order, each behind those at or before its motion."""
    places = np.searchsorted(rows[:, MOTION], [row[MOTION] for row in more], side="right")
    return np.insert(rows, places, more, axis=0) if more else rows
