"""Which blocks of two programs differ: by what they say, not by how they are written."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Final

import numpy as np

from ph_post.audit.diff.align import align, gaps_of, hash_columns
from ph_post.audit.diff.record import BlockChange, BlockKind
from ph_post.gcode.reader.record import PartProgram
from ph_post.types import BoolArray, IntArray

_N: Final = ord("N")

_WRITING: Final = re.compile(rb"\([^)]*\)|;.*|[ \t\r\n]+|^N\d+", re.IGNORECASE | re.MULTILINE)
"""What does not matter in a block that is compared as text."""

_ODD: Final = re.compile(rb"[/#\[\]%<>]|^[ \t]*(?:N\d+)?[ \t]*O", re.IGNORECASE | re.MULTILINE)
"""Blocks with these are compared as text: block delete, parameters, expressions, control flow, `%`."""


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
    """Hash what every block says: its words but for N, in any order, as numbers; 0 where it says nothing."""
    words = program.words
    kept = words.letter != _N
    mixed = hash_columns(words.letter[kept].astype(np.int64), words.value[kept])
    keys = np.zeros(program.blocks, dtype=np.uint64)
    np.add.at(keys, words.block[kept], mixed.view(np.uint64))
    found = keys.view(np.int64)
    for block in np.flatnonzero(_as_text(program)).tolist():
        found[block] = hash(said(program, block))
    return found


def said(program: PartProgram, block: int) -> str:
    """Return what a block says, without comments, blanks and its number."""
    return _WRITING.sub(b"", program.text(block).strip()).decode("ascii", "replace").upper()


def _as_text(program: PartProgram) -> BoolArray:
    """Blocks that their words do not tell fully."""
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
    """Pair blocks that differ only in numbers of axes, and tell what was added and removed between them."""
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
    """Hash what every block does: its letters, with the numbers of G, M and T words; never below zero."""
    words = program.words
    kept = words.letter != _N
    told = np.isin(words.letter, list(b"GMT"))
    mixed = hash_columns(words.letter[kept].astype(np.int64), np.where(told, words.value, 0.0)[kept])
    keys = np.zeros(program.blocks, dtype=np.uint64)
    np.add.at(keys, words.block[kept], mixed.view(np.uint64))
    return (keys >> np.uint64(1)).view(np.int64)


def _change(says: tuple[IntArray, IntArray], row: list[int]) -> BlockChange:
    """Tell what a gap of the alignment is."""
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
    return [
        program.text(block).rstrip(b"\r\n").decode("utf-8", "replace")
        for block in range(span[0], span[1] + 1)
    ]
