"""Which line of a compensated program stands for which of the original, as the hunks say."""

from __future__ import annotations

import re

import msgspec
import numpy as np

from ph_post.audit.declared import Declaration, comment_of
from ph_post.audit.verdict import Findings, shown
from ph_post.gcode.reader.record import PartProgram, PlaceArray
from ph_post.types import BoolArray, IntArray

_MARKER = re.compile(rb"\(ph-post: \+(\d+) -(\d+)( [^)]*)?\)\s*", re.IGNORECASE)
_BEGINS = re.compile(rb"(?:\(|; )ph-post: \+", re.IGNORECASE)

NO_HUNK = -1
"""The hunk of a line outside all of them."""


class Hunks(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The changed stretches: lines ``[new_first, new_last)`` in place of ``[old_first, old_last)``, all (h,).

    `marker` is the comment line that tells it, the one before `new_first`.
    """

    marker: IntArray
    new_first: IntArray
    new_last: IntArray
    old_first: IntArray
    old_last: IntArray

    @property
    def number(self) -> int:
        """How many there are."""
        return self.marker.size


class Alignment(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Lines that belong together.

    `old`, `new` (k,) the lines outside hunks, pair by pair, in order. `old_hunk`, `new_hunk` the hunk of each
    line, :data:`NO_HUNK` outside (markers and the header belong to none). `ends` whether the original's last
    line has got a line end, so that the undo lines can follow it.
    """

    hunks: Hunks
    old: PlaceArray
    new: PlaceArray
    old_hunk: PlaceArray
    new_hunk: PlaceArray
    ends: bool


def align(
    original: PartProgram, compensated: PartProgram, declared: Declaration, findings: Findings
) -> Alignment | None:
    """Pair the lines as header and hunks tell; None where the numbers of lines do not allow it."""
    markers = _markers(original, compensated, declared)
    rows: list[tuple[int, int, int, int, int]] = []
    old, new = declared.first, declared.last
    for line, added, removed in markers:
        if line < new:
            findings.add("lines", "a hunk begins inside another one", compensated=line)
            return None
        old += line - new
        new = line + 1 + added
        rows.append((line, line + 1, new, old, old + removed))
        old += removed
        if new > declared.tail or old > original.blocks:
            findings.add(
                "lines", "a hunk reaches over the end of the program", compensated=line,
                got=shown(compensated.text(line)),
            )  # fmt: skip
            return None
    found = _alignment(original, compensated, declared, rows)
    missing = (original.blocks - old) - (declared.tail - new)
    if missing:
        _tell_count(original, compensated, found, missing, findings)
    return None if missing else found


def _markers(
    original: PartProgram, compensated: PartProgram, declared: Declaration
) -> list[tuple[int, int, int]]:
    """Lines that begin a hunk, with the numbers of lines added and removed.

    A line of the same bytes that the original has in that place is the original's.
    """
    found: list[tuple[int, int, int]] = []
    begins = np.array([match.start() for match in _BEGINS.finditer(compensated.data)], dtype=np.int32)
    lines = np.searchsorted(compensated.lines, begins, side="right") - 1
    behind, shift = declared.last, declared.last - declared.first
    for line in lines[compensated.lines[lines] == begins].tolist():
        match = _MARKER.fullmatch(comment_of(compensated, line)) if line >= behind else None
        if match is None or _has(original, line - shift, compensated.text(line)):
            continue
        added, removed = int(match[1]), int(match[2])
        found.append((line, added, removed))
        behind, shift = line + 1 + added, shift + 1 + added - removed
    return found


def _has(original: PartProgram, line: int, text: bytes) -> bool:
    return 0 <= line < original.blocks and original.text(line) == text


def _alignment(
    original: PartProgram,
    compensated: PartProgram,
    declared: Declaration,
    rows: list[tuple[int, int, int, int, int]],
) -> Alignment:
    columns = np.array(rows, dtype=np.int64).reshape(-1, 5).T
    hunks = Hunks(
        marker=columns[0],
        new_first=columns[1],
        new_last=columns[2],
        old_first=columns[3],
        old_last=columns[4],
    )
    old_hunk = _hunk_of_lines(original.blocks, hunks.old_first, hunks.old_last)
    new_hunk = _hunk_of_lines(compensated.blocks, hunks.new_first, hunks.new_last)
    apart = np.zeros(compensated.blocks, dtype=bool)
    apart[declared.first : declared.last] = True
    apart[declared.tail :] = True
    apart[hunks.marker] = True
    old, new = (
        np.flatnonzero(outside).astype(np.int32)
        for outside in (old_hunk == NO_HUNK, (new_hunk == NO_HUNK) & ~apart)
    )
    shared = min(old.size, new.size)
    ends = declared.tail < compensated.blocks and not _has_end(original)
    return Alignment(
        hunks=hunks, old=old[:shared], new=new[:shared], old_hunk=old_hunk, new_hunk=new_hunk, ends=ends
    )


def _hunk_of_lines(lines: int, first: IntArray, last: IntArray) -> PlaceArray:
    hunk = np.full(lines, NO_HUNK, dtype=np.int32)
    inside, number = expand(first, last)
    hunk[inside] = number
    return hunk


def expand(first: IntArray, last: IntArray) -> tuple[IntArray, IntArray]:
    """All numbers of ranges ``[first, last)`` one after the other, and which range each is of.

    Examples
    --------
    >>> expand(np.array([3, 7]), np.array([5, 8]))
    (array([3, 4, 7]), array([0, 0, 1]))
    """
    size = last - first
    number = np.repeat(np.arange(first.size), size)
    begins = np.cumsum(size) - size
    return np.arange(number.size) - begins[number] + first[number], number


def _has_end(program: PartProgram) -> bool:
    return program.blocks == 0 or program.data.endswith((b"\n", b"\r"))


def _tell_count(
    original: PartProgram, compensated: PartProgram, found: Alignment, missing: int, findings: Findings
) -> None:
    """Name the first pair of lines that are plainly not the same, where lines are missing or too many."""
    same = np.fromiter(
        (
            _shape(original.text(old)) == _shape(compensated.text(new))
            for old, new in zip(found.old.tolist(), found.new.tolist(), strict=True)
        ),
        dtype=bool,
    )
    place = int(np.argmin(same)) if same.size and not same.all() else None
    what = f"{missing} lines of the original are missing" if missing > 0 else f"{-missing} lines too many"
    if place is None:
        findings.add("lines", f"{what} at the end")
        return
    old, new = int(found.old[place]), int(found.new[place])
    findings.add(
        "lines", f"{what}, here or before", original=old, compensated=new,
        expected=shown(original.text(old)), got=shown(compensated.text(new)),
    )  # fmt: skip


def _shape(line: bytes) -> bytes:
    """Return a line without its digits: what an offset never changes."""
    return line.translate(None, b"0123456789.+-")


def as_mask(size: int, places: IntArray) -> BoolArray:
    """Return a mask that is true at the places."""
    mask = np.zeros(size, dtype=bool)
    mask[places] = True
    return mask
