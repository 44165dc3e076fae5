"""Compare the blocks of two programs, and their commands other than motions."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any, Final, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.diff.alignment import align, gaps_of, hash_columns
from ph_post.diff.paths import ComparedPaths, Span
from ph_post.gcode.program import Modal, PartProgram
from ph_post.types import Array, BoolArray, IntArray

_N: Final = ord("N")

_WRITING: Final = re.compile(rb"\([^)]*\)|;.*|[ \t\r\n]+|^N\d+", re.IGNORECASE | re.MULTILINE)
"""Text that is ignored where a block is compared as text."""

_ODD: Final = re.compile(rb"[/#\[\]%<>]|^[ \t]*(?:N\d+)?[ \t]*O", re.IGNORECASE | re.MULTILINE)
"""Blocks with these are compared as text: block delete, parameters, expressions, control flow, `%`."""


BlockKind = Literal["changed", "added", "removed", "writing"]


class BlockChange(msgspec.Struct, frozen=True, kw_only=True):
    """Neighbouring blocks that differ; `writing` where only comments, blanks, N words or spelling do."""

    kind: BlockKind
    a: Span
    b: Span


class CommandChange(msgspec.Struct, frozen=True, kw_only=True):
    """A command other than a motion that only one program has, or both at different places.

    `what` in words; `a` and `b` the block in either program, None where it is not there.
    """

    what: str
    a: int | None
    b: int | None


def compare_blocks(a: PartProgram, b: PartProgram) -> tuple[BlockChange, ...]:
    """Return the blocks that differ, neighbours together, in the order of the first program."""
    written = [_hashes(program) for program in (a, b)]
    says = (block_keys(a), block_keys(b))
    found = align(says[0], says[1])
    changes = _changes((a, b), (says[0], says[1]), found)
    here = np.flatnonzero(found >= 0)
    respelt = here[written[0][here] != written[1][found[here]]]
    changes += [
        BlockChange(kind="writing", a=(first, last), b=(int(found[first]), int(found[last])))
        for first, last in _runs(respelt, found)
    ]
    return tuple(sorted(changes, key=lambda change: (change.a[0], change.b[0])))


def block_keys(program: PartProgram) -> IntArray:
    """Hash the words of every block but N, in any order, as numbers (b,); 0 for a block without words."""
    found = _hash_words(program, program.words.value).view(np.int64)
    for block in np.flatnonzero(_as_text(program)).tolist():
        found[block] = hash(block_meaning(program, block))
    return found


def block_meaning(program: PartProgram, block: int) -> str:
    """Return the text of a block without comments, blanks and its number."""
    return _WRITING.sub(b"", program.text(block).strip()).decode("ascii", "replace").upper()


def _as_text(program: PartProgram) -> BoolArray:
    """Mask of blocks that are not fully described by their words."""
    odd = np.zeros(program.blocks, dtype=bool)
    odd[program.words.block[np.isnan(program.words.value)]] = True
    found = np.array([match.start() for match in _ODD.finditer(program.data)], dtype=np.int64)
    odd[np.searchsorted(program.lines, found, side="right") - 1] = True
    for note in program.notes:
        odd[note.first : note.last + 1] = True
    return odd


def _hashes(program: PartProgram) -> IntArray:
    """Hash every line, without its line end."""
    data = program.data
    bounds = pairwise(program.lines.tolist())
    return np.array([hash(data[first:end].rstrip(b"\r\n")) for first, end in bounds], dtype=np.int64)


def _changes(
    programs: tuple[PartProgram, PartProgram], says: tuple[IntArray, IntArray], found: IntArray
) -> list[BlockChange]:
    """Pair blocks that differ only in numbers of axes, and list what was added and removed between them."""
    here = np.flatnonzero(found >= 0)
    shapes = [_shapes(program) for program in programs]
    for shape, rows in ((shapes[0], here), (shapes[1], found[here])):
        shape[rows] = -1 - np.arange(here.size)
    pairs = align(shapes[0], shapes[1])
    changes = [_change(says, row) for row in gaps_of(pairs, shapes[1].size).tolist()]
    changed = np.flatnonzero((pairs >= 0) & (found < 0))
    return changes + [
        _change(says, [first, last + 1, int(pairs[first]), int(pairs[last]) + 1])
        for first, last in _runs(changed, pairs)
    ]


def _shapes(program: PartProgram) -> IntArray:
    """Hash the letters of every block, with the numbers of G, M and T words; never below zero."""
    words = program.words
    values = np.where(np.isin(words.letter, list(b"GMT")), words.value, 0.0)
    return (_hash_words(program, values) >> np.uint64(1)).view(np.int64)


def _hash_words(program: PartProgram, values: Array) -> NDArray[np.uint64]:
    """Hash the words of every block but N, with these values, in any order."""
    words = program.words
    kept = words.letter != _N
    mixed = hash_columns(words.letter[kept].astype(np.int64), values[kept])
    keys = np.zeros(program.blocks, dtype=np.uint64)
    np.add.at(keys, words.block[kept], mixed.view(np.uint64))
    return keys


def _change(says: tuple[IntArray, IntArray], row: list[int]) -> BlockChange:
    """Return the change that a gap of the alignment is."""
    a0, a1, b0, b1 = row
    kind: BlockKind = "added" if a0 == a1 else "removed" if b0 == b1 else "changed"
    if not (says[0][a0:a1].any() or says[1][b0:b1].any()):
        kind = "writing"
    return BlockChange(kind=kind, a=(a0, a1 - 1), b=(b0, b1 - 1))


def _runs(blocks: IntArray, found: IntArray) -> list[tuple[int, int]]:
    """First and last of blocks that follow one another in both programs."""
    if blocks.size == 0:
        return []
    breaks = np.flatnonzero((np.diff(blocks) != 1) | (np.diff(found[blocks]) != 1))
    firsts = np.append(0, breaks + 1)
    lasts = np.append(breaks, blocks.size - 1)
    return list(zip(blocks[firsts].tolist(), blocks[lasts].tolist(), strict=True))


def lines_of(program: PartProgram, span: tuple[int, int]) -> list[str]:
    """Return the blocks `first` to `last`, without their line ends."""
    return [program.text(block).rstrip(b"\r\n").decode("utf-8", "replace") for block in range(span[0], span[1] + 1)]


_STATES: Final = {
    "spindle": "spindle",
    "speed": "spindle speed",
    "mist": "mist",
    "flood": "flood",
    "tool": "tool",
    "prepared": "prepared tool",
    "system": "work offset",
    "length": "tool length offset",
    "compensation": "cutter compensation",
    "path": "path mode",
    "retract": "retract of cycles",
}
"""Modes whose changes count as they are; all others show in motions and feeds, and are compared there."""

_MODES: Final = (
    *(*range(6), 5.1, 5.2, 5.3, *range(17, 22), *range(40, 44), 49, *range(54, 60), 59.1, 59.2, 59.3),
    *(61, 61.1, 64, 80, 90, 90.1, 91, 91.1, 93, 94, 95, 98, 99),
)
"""G words that say no more than what they do to motions, to the modes above, and to the time (G4)."""

_SWITCHES: Final = (3, 4, 5, 7, 8, 9)
"""M words that say no more than what they do to the modes above."""


class ProgramCommand(msgspec.Struct, frozen=True, kw_only=True):
    """A command other than a motion: in words, its block, and the motion before which it is."""

    what: str
    block: int
    motion: int


def program_commands(program: PartProgram) -> list[ProgramCommand]:
    """List the commands of a program other than motions, in its order."""
    found = [*_changes_of_state(program), *_one_shot_commands(program), *_not_understood(program)]
    found.sort(key=lambda one: one[0])
    motion = np.searchsorted(program.motions.block, [block for block, _ in found], side="left")
    return [
        ProgramCommand(what=what, block=block, motion=int(k)) for (block, what), k in zip(found, motion, strict=True)
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


def _one_shot_commands(program: PartProgram) -> list[tuple[int, str]]:
    """Blocks whose G or M word does something once."""
    words = program.words
    known = np.isfinite(words.value)
    single = (words.letter == ord("G")) & ~np.isin(words.value, _MODES)
    single |= (words.letter == ord("M")) & ~np.isin(words.value, _SWITCHES)
    noted = {block for note in program.notes for block in range(note.first, note.last + 1)}
    blocks = np.unique(words.block[single & known]).tolist()
    return [(block, block_meaning(program, block)) for block in blocks if block not in noted]


def _not_understood(program: PartProgram) -> list[tuple[int, str]]:
    """Blocks that were not understood, by their text."""
    return [
        (block, f"not understood: {text}")
        for note in program.notes
        for block in range(note.first, note.last + 1)
        if (text := block_meaning(program, block))
    ]


def compare_commands(a: PartProgram, b: PartProgram, travel: ComparedPaths, apart: float) -> tuple[CommandChange, ...]:
    """Return the commands of only one program, and those of both at places more than `apart` [m] apart."""
    left, right = program_commands(a), program_commands(b)
    found = align(_keys(left), _keys(right))
    changes = [
        CommandChange(what=one.what, a=one.block, b=None)
        for one, other in zip(left, found.tolist(), strict=True)
        if other < 0
    ]
    taken = set(found.tolist())
    changes += [
        CommandChange(what=one.what, a=None, b=one.block) for number, one in enumerate(right) if number not in taken
    ]
    nearby = _counterparts(travel)
    for number in np.flatnonzero(found >= 0).tolist():
        one, other = left[number], right[int(found[number])]
        between = nearby[0][one.motion] <= other.motion <= nearby[1][one.motion]
        way = np.linalg.norm(_before(travel, 0, one.motion) - _before(travel, 1, other.motion))
        if not (between and way <= apart):
            changes.append(CommandChange(what=f"{one.what}, at another place", a=one.block, b=other.block))
    return tuple(sorted(changes, key=lambda one: (one.b if one.a is None else one.a, one.a is None)))


def _keys(all_done: list[ProgramCommand]) -> IntArray:
    return np.array([hash(one.what) for one in all_done], dtype=np.int64)


def _counterparts(travel: ComparedPaths) -> tuple[IntArray, IntArray]:
    """Motions of the second path, from and to, that may come next where each of the first does."""
    found, count = travel.found, travel.outlines[1].first.size - 1
    low = np.append(0, np.maximum.accumulate(found) + 1) if found.size else np.zeros(1, dtype=np.int64)
    ahead = np.append(np.where(found >= 0, found, count), count)
    return low, np.minimum.accumulate(ahead[::-1])[::-1]


def _before(travel: ComparedPaths, number: int, motion: int) -> Array:
    """Position of the tool before a motion [m]."""
    outline = travel.outlines[number]
    if len(outline.table) == 0:
        return np.zeros(3)
    piece = int(outline.first[motion])
    return np.asarray(outline.table[piece, 0:3] if piece < len(outline.table) else outline.table[-1, 3:6])
