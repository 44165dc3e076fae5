"""Lines of the original beside those of the compensated program, by header and marks; the case that is checked."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.gcode.program import PartProgram, PlaceArray, expand, narrowed, rows_where
from ph_post.types import BoolArray, IntArray
from ph_post.verify.declared import DeclaredChanges, comment_of
from ph_post.verify.verdict import Findings, quoted

_MARKER = re.compile(rb"\(ph-post: \+(\d+) -(\d+)( [^)]*)?\)\s*", re.IGNORECASE)
_CROSSING = re.compile(rb"crossing ([XYZ])([-+])", re.IGNORECASE)
_LEAD = re.compile(rb"\blead\b", re.IGNORECASE)
_MORE = b"and more"
"""Last words of a mark that is too long for its line."""

_BEGINS = re.compile(rb"(?:\(|; )ph-post: \+", re.IGNORECASE)
_SIGN = b": +"
_BEFORE = len("; ph-post"), len("(ph-post")
"""What a mark begins with, the last bytes of it, and how many there are before those."""

NO_CHANGE = -1
"""The change of a line outside all of them."""


class ChangedLines(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The changed stretches: lines ``[new_first, new_last)`` in place of ``[old_first, old_last)``, all (h,).

    `marker` is the comment line that announces it, the one before `new_first`. `crossings` (h,) the axes and new
    directions whose crossings it names, with an empty pair where it has no room for all; None where it names none.
    `led` (h,) is true where the stretch has the lead of the servos.
    """

    marker: IntArray
    crossings: tuple[frozenset[tuple[str, int]] | None, ...]
    led: BoolArray
    new_first: IntArray
    new_last: IntArray
    old_first: IntArray
    old_last: IntArray

    @property
    def number(self) -> int:
        """Number of changes."""
        return self.marker.size

    @property
    def crossed(self) -> BoolArray:
        """Mask (h,) of the changes that name a crossing."""
        return np.array([names is not None for names in self.crossings], dtype=bool)


class LinePairs(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Lines that belong together.

    `old_change`, `new_change` the change of each line, :data:`NO_CHANGE` outside, in the narrowest type: reckoning
    with them needs a wider one. Markers, and what else is `apart` of the new lines (the header), belong to none. `ends`
    is true where the original's last line was given a line end, so that the undo lines can follow it.
    """

    changes: ChangedLines
    old_change: NDArray[Any]
    new_change: NDArray[Any]
    apart: BoolArray
    ends: bool

    def outside(self) -> tuple[PlaceArray, PlaceArray]:
        """Return the lines outside changes, pair by pair, in order, (k,) each: as large as a fifth of a text each."""
        old = rows_where(self.old_change == NO_CHANGE)
        new = rows_where((self.new_change == NO_CHANGE) & ~self.apart)
        shared = min(old.size, new.size)
        return old[:shared], new[:shared]


def pair_lines(
    original: PartProgram, compensated: PartProgram, declared: DeclaredChanges, findings: Findings
) -> LinePairs | None:
    """Pair the lines as header and marks declare; None where the numbers of lines do not allow it."""
    markers = _markers(original, compensated, declared)
    rows: list[tuple[int, int, int, int, int]] = []
    old, new = declared.first, declared.last
    for line, added, removed, *_ in markers:
        if line < new:
            findings.add("lines", "a change begins inside another one", compensated=line)
            return None
        old += line - new
        new = line + 1 + added
        rows.append((line, line + 1, new, old, old + removed))
        old += removed
        if new > declared.tail or old > original.blocks:
            findings.add(
                "lines",
                "a change reaches over the end of the program",
                compensated=line,
                got=quoted(compensated.text(line)),
            )
            return None
    names = tuple(named for *_, named, _ in markers)
    led = np.array([one[-1] for one in markers], dtype=bool)
    found = _line_pairs(original, compensated, declared, rows, names, led)
    missing = (original.blocks - old) - (declared.tail - new) - (compensated.blocks - declared.behind)
    if missing:
        _report_count(original, compensated, found, missing, findings)
    return None if missing else found


def _markers(
    original: PartProgram, compensated: PartProgram, declared: DeclaredChanges
) -> list[tuple[int, int, int, frozenset[tuple[str, int]] | None, bool]]:
    """Lines that begin a change, with the numbers of lines added and removed, the crossings, and whether it is led.

    A line of the same bytes that the original has in that place is the original's.
    """
    found: list[tuple[int, int, int, frozenset[tuple[str, int]] | None, bool]] = []
    begins = np.array(list(_places_of_marks(compensated.data)), dtype=np.int32)
    lines = np.searchsorted(compensated.lines, begins, side="right") - 1
    behind, shift = declared.last, declared.last - declared.first
    for line in lines[compensated.lines[lines] == begins].tolist():
        match = _MARKER.fullmatch(comment_of(compensated, line)) if line >= behind else None
        if match is None:
            continue
        old = line - shift
        if 0 <= old < original.blocks and original.text(old) == compensated.text(line):
            continue
        added, removed = int(match[1]), int(match[2])
        words = match[3] or b""
        found.append((line, added, removed, _crossings(words, declared), _LEAD.search(words) is not None))
        behind, shift = line + 1 + added, shift + 1 + added - removed
    return found


def _places_of_marks(data: bytes) -> Iterator[int]:
    """Yield the places at which comments begin that may be marks, by what few lines have: a colon and a sign."""
    sign = data.find(_SIGN)
    while sign >= 0:
        for before in _BEFORE:
            if before <= sign and _BEGINS.match(data, sign - before):
                yield sign - before
        sign = data.find(_SIGN, sign + 1)


UNNAMED = ("", 0)
"""A crossing for which a mark has no room."""


def _crossings(words: bytes, declared: DeclaredChanges) -> frozenset[tuple[str, int]] | None:
    """Axes and new directions of the crossings that a mark names; None where it names none."""
    named = {(axis.decode().upper(), 1 if sign == b"+" else -1) for axis, sign in _CROSSING.findall(words)}
    if declared.crossings and words.strip().lower().endswith(_MORE):
        named.add(UNNAMED)
    return frozenset(named) if named else None


def _line_pairs(
    original: PartProgram,
    compensated: PartProgram,
    declared: DeclaredChanges,
    rows: list[tuple[int, int, int, int, int]],
    crossings: tuple[frozenset[tuple[str, int]] | None, ...],
    led: BoolArray,
) -> LinePairs:
    columns = np.array(rows, dtype=np.int64).reshape(-1, 5).T
    changes = ChangedLines(
        marker=columns[0],
        crossings=crossings,
        led=led,
        new_first=columns[1],
        new_last=columns[2],
        old_first=columns[3],
        old_last=columns[4],
    )
    old_change = _change_of_lines(original.blocks, changes.old_first, changes.old_last)
    new_change = _change_of_lines(compensated.blocks, changes.new_first, changes.new_last)
    apart = np.zeros(compensated.blocks, dtype=bool)
    apart[declared.first : declared.last] = True
    apart[declared.tail : declared.behind] = True
    apart[changes.marker] = True
    ends = declared.tail < compensated.blocks and original.blocks > 0 and not original.data.endswith((b"\n", b"\r"))
    return LinePairs(changes=changes, old_change=old_change, new_change=new_change, apart=apart, ends=ends)


def _change_of_lines(lines: int, first: IntArray, last: IntArray) -> NDArray[Any]:
    inside, number = expand(first, last)
    change = np.full(lines, NO_CHANGE, dtype=narrowed(number).dtype)
    change[inside] = number
    return change


def _report_count(
    original: PartProgram, compensated: PartProgram, found: LinePairs, missing: int, findings: Findings
) -> None:
    """Name the first pair of lines that are plainly not the same, where lines are missing or too many."""
    one, other = found.outside()
    same = np.fromiter(
        (
            _shape(original.text(old)) == _shape(compensated.text(new))
            for old, new in zip(one.tolist(), other.tolist(), strict=True)
        ),
        dtype=bool,
    )
    place = int(np.argmin(same)) if same.size and not same.all() else None
    what = f"{missing} lines of the original are missing" if missing > 0 else f"{-missing} lines too many"
    if place is None:
        findings.add("lines", f"{what} at the end")
        return
    old, new = int(one[place]), int(other[place])
    findings.add(
        "lines",
        f"{what}, here or before",
        original=old,
        compensated=new,
        expected=quoted(original.text(old)),
        got=quoted(compensated.text(new)),
    )


def _shape(line: bytes) -> bytes:
    """Return a line without its digits, which is all that an offset never changes."""
    return line.translate(None, b"0123456789.+-")


def as_mask(size: int, places: IntArray) -> BoolArray:
    """Return a mask (size,) that is true at the places."""
    mask = np.zeros(size, dtype=bool)
    mask[places] = True
    return mask


class VerifyCase(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A program, the compensated program, and what is known about both.

    `bound` [m] is the largest deviation of the path, `band` [m] the longest move of an axis that need not be
    compensated. Every check adds its failures to `findings`.
    """

    original: PartProgram
    compensated: PartProgram
    declared: DeclaredChanges
    lines: LinePairs
    bound: float
    band: float
    findings: Findings
