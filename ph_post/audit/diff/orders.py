"""What programs do beside moving: spindle, coolant, tools, offsets, stops; what only one of two does."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.audit.diff.align import align
from ph_post.audit.diff.record import Order
from ph_post.audit.diff.text import said
from ph_post.audit.diff.travel import Travel
from ph_post.gcode.reader.record import Modal, PartProgram
from ph_post.types import Array, IntArray

_STATES: Final = {
    "spindle": "spindle", "speed": "spindle speed", "mist": "mist", "flood": "flood", "tool": "tool",
    "prepared": "prepared tool", "system": "work offset", "length": "tool length offset",
    "compensation": "cutter compensation", "path": "path mode", "retract": "retract of cycles",
}  # fmt: skip
"""Modes whose changes count as they are; all others tell in motions and feeds, and are compared there."""

_MODES: Final = (
    *(
        0.0,
        1.0,
        2.0,
        3.0,
        4.0,
        5.0,
        5.1,
        5.2,
        5.3,
        17.0,
        18.0,
        19.0,
        20.0,
        21.0,
        40.0,
        41.0,
        42.0,
        43.0,
        49.0,
    ),
    *(54.0, 55.0, 56.0, 57.0, 58.0, 59.0, 59.1, 59.2, 59.3, 61.0, 61.1, 64.0, 80.0, 90.0, 90.1, 91.0, 91.1),
    *(93.0, 94.0, 95.0, 98.0, 99.0),
)
"""G words that say no more than what they do to motions, to the modes above, and to the time (G4)."""

_SWITCHES: Final = (3.0, 4.0, 5.0, 7.0, 8.0, 9.0)
"""M words that say no more than what they do to the modes above."""


class Doing(msgspec.Struct, frozen=True, kw_only=True):
    """Something that is done: in words, in which block, before which motion."""

    what: str
    block: int
    motion: int


def doings(program: PartProgram) -> list[Doing]:
    """List what a program does beside moving, in its order."""
    found = [*_changes_of_state(program), *_single_orders(program), *_not_understood(program)]
    found.sort(key=lambda one: one[0])
    motion = np.searchsorted(program.motions.block, [block for block, _ in found], side="left")
    return [
        Doing(what=what, block=block, motion=int(k)) for (block, what), k in zip(found, motion, strict=True)
    ]


def _changes_of_state(program: PartProgram) -> list[tuple[int, str]]:
    """Blocks after which a mode is another one than before."""
    numbers = np.flatnonzero(np.diff(program.state, prepend=-1)).tolist()
    states = [Modal(), *(program.modal_after(block) for block in numbers)]
    return [
        (block, f"{words} {_value(getattr(after, name))}")
        for block, (before, after) in zip(numbers, pairwise(states), strict=True)
        for name, words in _STATES.items()
        if getattr(before, name) != getattr(after, name)
    ]


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _single_orders(program: PartProgram) -> list[tuple[int, str]]:
    """Blocks whose G or M word does something once."""
    words = program.words
    known = np.isfinite(words.value)
    single = (words.letter == ord("G")) & ~np.isin(words.value, _MODES)
    single |= (words.letter == ord("M")) & ~np.isin(words.value, _SWITCHES)
    noted = {block for note in program.notes for block in range(note.first, note.last + 1)}
    blocks = np.unique(words.block[single & known]).tolist()
    return [(block, said(program, block)) for block in blocks if block not in noted]


def _not_understood(program: PartProgram) -> list[tuple[int, str]]:
    """Blocks that were not understood, by their text."""
    return [
        (block, f"not understood: {text}")
        for note in program.notes
        for block in range(note.first, note.last + 1)
        if (text := said(program, block))
    ]


def compare_orders(a: PartProgram, b: PartProgram, travel: Travel, apart: float) -> tuple[Order, ...]:
    """Return what only one of the programs does, and what both do at places more than `apart` [m] apart."""
    left, right = doings(a), doings(b)
    found = align(_keys(left), _keys(right))
    changes = [
        Order(what=one.what, a=one.block, b=None)
        for one, other in zip(left, found.tolist(), strict=True)
        if other < 0
    ]
    taken = set(found.tolist())
    changes += [
        Order(what=one.what, a=None, b=one.block) for number, one in enumerate(right) if number not in taken
    ]
    nearby = _counterparts(travel)
    for number in np.flatnonzero(found >= 0).tolist():
        one, other = left[number], right[int(found[number])]
        between = nearby[0][one.motion] <= other.motion <= nearby[1][one.motion]
        way = np.linalg.norm(_before(travel, 0, one.motion) - _before(travel, 1, other.motion))
        if not (between and way <= apart):
            changes.append(Order(what=f"{one.what}, at another place", a=one.block, b=other.block))
    return tuple(sorted(changes, key=lambda one: (one.b if one.a is None else one.a, one.a is None)))


def _keys(all_done: list[Doing]) -> IntArray:
    return np.array([hash(one.what) for one in all_done], dtype=np.int64)


def _counterparts(travel: Travel) -> tuple[IntArray, IntArray]:
    """Motions of the second path, from and to, that may come next where each of the first does."""
    found, count = travel.found, travel.outlines[1].first.size - 1
    low = np.append(0, np.maximum.accumulate(found) + 1) if found.size else np.zeros(1, dtype=np.int64)
    ahead = np.append(np.where(found >= 0, found, count), count)
    return low, np.minimum.accumulate(ahead[::-1])[::-1]


def _before(travel: Travel, number: int, motion: int) -> Array:
    """Where the tool is before a motion [m]."""
    outline = travel.outlines[number]
    if len(outline.table) == 0:
        return np.zeros(3)
    piece = int(outline.first[motion])
    return np.asarray(outline.table[piece, 0:3] if piece < len(outline.table) else outline.table[-1, 3:6])
