"""Threads (G33): moves that are tied to the turns of the spindle, between which nothing may be put.

A run of such moves is shifted as a whole, by one offset an axis. Where an axis turns in it, the side counts on which it
stands along the longest move: the taper on which the tool comes in and the one on which it leaves are short.
LinuxCNC's manual, G33: "all the axes … synchronized"; a run keeps the turn of the spindle with which it begins, so that
passes of one thread meet only where Z carries the same offset in all of them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from itertools import pairwise
from typing import Final

import numpy as np

from ph_post.dialects.declaration import THREADS
from ph_post.edit.edits import CrossingEdit, StopEdit
from ph_post.edit.reversals import CARRIED, CHAIN, FIRST, LAST, MOTION, SHARE, SHARE0, SHARE1, SIGN
from ph_post.gcode.motion_parts import chord_lengths
from ph_post.gcode.program import AXES, RAPID, PartProgram, chain_heads, runs
from ph_post.types import Array, BoolArray, IntArray
from ph_post.units import MM

THREAD_LEFT: Final = "thread, left as it is"
"""What the warning of a thread that cannot be shifted says."""

_SAME: Final = 1e-6 * MM
"""Offsets [m] that differ by no more are the same."""

_Z: Final = 2


class Threads:
    """The threads of a program.

    Attributes
    ----------
    mask : BoolArray, shape (m,)
        Motions that are tied to the spindle.
    spans : list of tuple
        The first motion of every run of them, and the one behind its last.
    """

    def __init__(self, program: PartProgram) -> None:
        self._program = program
        self.mask = program.threads
        motions = program.motions
        self._length, self._ways = np.zeros(0), np.zeros((0, 3))
        if self.mask.any():
            self._length, self._ways = chord_lengths(motions), np.nan_to_num(motions.end - motions.start)
        self.spans: list[tuple[int, int]] = []
        for first, end in zip(*(ends.tolist() for ends in runs(self.mask)), strict=True):
            joints = first + np.flatnonzero(chain_heads(motions.chain[first:end]))
            places = [*joints.tolist(), end]
            self.spans += pairwise(places)

    def around(self, rows: Array, axis: int, carries: BoolArray) -> Array:
        """Put the changes of an axis that lie in threads before or behind them.

        Parameters
        ----------
        rows : Array, shape (n, 11)
            Changes of an axis as of :func:`~ph_post.edit.reversals.find_reversals`.
        axis : int
        carries : BoolArray, shape (m,)
            Motions that may change the offset as they move the axis.

        Returns
        -------
        Array, shape (k, 11)
        """
        if not self.spans or not len(rows):
            return rows
        found, drop = rows.copy(), np.zeros(len(rows), dtype=np.bool_)
        leaves = (rows[:, LAST] + (rows[:, SHARE1] == 1.0)).astype(np.int64)
        chain = self._program.motions.chain
        for first, end in self.spans:
            turns = (leaves > first) & (leaves < end)
            rests = (rows[:, MOTION] >= first) & (rows[:, MOTION] < end - 1) & (rows[:, CARRIED] == 0.0)
            for n in np.flatnonzero(turns | (rests & (rows[:, SHARE] > 0.0))).tolist():
                if leaves[n] <= self._longest(first, end):
                    # It turns on the way to the longest move: it is on its side before the run.
                    goes_on = first > 0 and chain[first - 1] == chain[first]
                    self._put(found[n], min(int(rows[n, MOTION]), first - 1) if goes_on else first, float(goes_on))
                else:
                    behind = rows[n + 1, MOTION] if n + 1 < len(rows) and rows[n + 1, CHAIN] == rows[n, CHAIN] else end
                    drop[n] = behind < end or not self._behind(found[n], axis, end, carries)
        # Of several before one place the last says to which side the axis goes.
        kept = found[~drop]
        if len(kept) > 1:
            place = kept[:, [MOTION, SHARE, CHAIN, CARRIED]]
            kept = kept[~np.append((place[1:] == place[:-1]).all(axis=1), False)]
        return kept

    def _longest(self, first: int, end: int) -> int:
        """Return the longest move of a run."""
        return first + int(np.argmax(np.nan_to_num(self._length[first:end])))

    def _behind(self, row: Array, axis: int, end: int, carries: BoolArray) -> bool:
        """Let a change happen behind a run that ends before a motion; false where the rapid there undoes it.

        A rapid that takes the axis further out carries it; else it happens before anything else moves.
        """
        motions = self._program.motions
        goes_on = end < motions.kind.size and motions.chain[end] == motions.chain[end - 1]
        rapid = goes_on and motions.kind[end] == RAPID and bool(carries[end])
        travel = float(np.nan_to_num(motions.end[end, axis] - motions.start[end, axis])) * row[SIGN] if rapid else 0.0
        self._put(row, end if travel > 0.0 else end - 1, 1.0, carried=travel > 0.0)
        return travel >= 0.0

    @staticmethod
    def _put(row: Array, motion: int, share: float, *, carried: bool = False) -> None:
        row[[MOTION, FIRST, LAST]] = motion
        row[[SHARE, SHARE0, SHARE1]] = share
        row[CARRIED] = float(carried)

    def refused(
        self,
        stops: Collection[StopEdit],
        crossings: Collection[CrossingEdit],
        offset: Array,
        sides: Mapping[str, tuple[float, float]],
    ) -> dict[int, str]:
        """Judge a plan: why threads cannot have it, by number.

        Parameters
        ----------
        stops : collection of StopEdit
        crossings : collection of CrossingEdit
        offset : Array, shape (m, 3)
            Offsets at the ends of motions [m].
        sides : mapping
            Offsets of an axis that moves to minus, and to plus, by axis [m].

        Returns
        -------
        dict of int to str
        """
        why: dict[int, str] = {}
        ahead = {one.motion for one in stops if one.share == 0.0}
        inside = {one.motion for one in stops if one.share < 1.0}
        behind = {one.motion for one in stops if one.share == 1.0}
        divided = {part.motion for one in crossings for part in one.parts}
        begun: dict[float, list[float]] = {}
        for n, (first, end) in enumerate(self.spans):
            own = set(range(first, end))
            start = self._start(first, offset, ahead)
            if own & divided or (own & inside) - {first} or own & behind - {end - 1}:
                why[n] = "an axis would be shifted in it"
            elif np.ptp(np.vstack([start, offset[first : end - 1]]), axis=0).max() > _SAME:
                why[n] = "its moves would be shifted by different offsets"
            elif name := self._too_late(n, start, sides):
                why[n] = f"{name} turns in it, and would be off by more behind that than it is now"
            begun.setdefault(self._way(first, end), []).append(float(start[_Z]))
        if any(np.ptp(shifts) > _SAME for shifts in begun.values()):
            said = "its passes would not meet: Z would be shifted by different offsets"
            why = {n: why.get(n, said) for n in range(len(self.spans))}
        elif why:
            said = "one of its passes is left, which the others have to meet"
            why = {n: why.get(n, said) for n in range(len(self.spans))}
        return why

    def _turned(self, n: int, axis: int) -> IntArray:
        """Return the moves of a run on which an axis is on the other side than along the longest."""
        first, end = self.spans[n]
        longest, signs = self._longest(first, end), np.sign(self._ways[first:end, axis])
        main = signs[longest - first]
        begin = first if main else longest + 1
        return begin + np.flatnonzero((signs[begin - first :] != 0.0) & (signs[begin - first :] != main))

    def _too_late(self, n: int, start: Array, sides: Mapping[str, tuple[float, float]]) -> str:
        """Return the axis that would leave the path by more where it has turned than it does so far; empty for none.

        It is late by all of its backlash there, of which the part across the path counts. `start` (3,) are the offsets.
        """
        first, end = self.spans[n]
        longest = self._longest(first, end)
        for name, (minus, plus) in sides.items():
            axis = AXES.index(name)
            own, late = float(start[axis]), self._turned(n, axis)
            if own == 0.0 or not late.size:
                continue
            across = np.sqrt(np.maximum(1.0 - (self._ways[:, axis] / np.maximum(self._length, _SAME)) ** 2, 0.0))
            other = minus if abs(own - plus) < abs(own - minus) else plus
            before = max(abs(own) * float(across[longest]), abs(other) * float(across[late].max()))
            if (plus - minus) * float(across[late].max()) > before + _SAME:
                return name
        return ""

    def _start(self, first: int, offset: Array, ahead: Collection[int]) -> Array:
        """Return the offsets with which a run begins, shape (3,)."""
        chain = self._program.motions.chain
        if first in ahead or first == 0 or chain[first] != chain[first - 1]:
            return np.asarray(offset[first])
        return np.asarray(offset[first - 1])

    def _way(self, first: int, end: int) -> float:
        """Return the direction in which a run moves Z."""
        motions = self._program.motions
        return float(np.sign(np.nan_to_num(motions.end[end - 1, _Z] - motions.start[first, _Z])))

    def words(self, untied: Mapping[int, str], offset: Array) -> list[str]:
        """Return warnings of threads that are left, and what is done to those with an offset (m, 3)."""
        block = self._program.motions.block
        lines = [self._program.line_words(int(block[first]), int(block[end - 1])) for first, end in self.spans]
        said: dict[str, list[int]] = {}
        for n, why in untied.items():
            said.setdefault(why, []).append(n)
        found = [f"{_counted(lines, own)}: {THREAD_LEFT}: {why}" for why, own in said.items()]
        shifted = [n for n, (first, end) in enumerate(self.spans) if n not in untied and offset[first:end].any()]
        if shifted:
            where = _counted(lines, shifted)
            found.append(f"{THREADS}: each is shifted as a whole, with nothing between its moves, in {where}")
            found += self._late(shifted, offset, lines)
        return found

    def words_of_none(self, said: Collection[str]) -> list[str]:
        """Return a warning that no thread is shifted, where none of what is `said` gives a reason."""
        if not self.spans or any(THREAD_LEFT in word for word in said):
            return []
        block = self._program.motions.block
        lines = [self._program.line_words(int(block[first]), int(block[end - 1])) for first, end in self.spans]
        where = _counted(lines, list(range(len(lines))))
        return [f"{where}: {THREAD_LEFT}: no plan that shifts it makes the part better in every measure"]

    def _late(self, shifted: list[int], offset: Array, lines: list[str]) -> list[str]:
        """Say of which axes not all of a thread is right."""
        found = []
        for axis, name in enumerate(AXES):
            own = [n for n in shifted if offset[slice(*self.spans[n]), axis].any() and self._turned(n, axis).size]
            if own:
                found.append(
                    f"{name} turns in the thread in {_counted(lines, own)}: it is right along the longest move, and on"
                    " the others late by its backlash"
                )
        return found


def _counted(lines: list[str], own: list[int]) -> str:
    """Return the lines of the first of some threads, and how many others there are."""
    more = len(own) - 1
    return lines[own[0]] + (f" and {more} more {'thread' if more == 1 else 'threads'}" if more else "")
