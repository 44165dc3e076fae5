"""What a hunk holds besides moves: the replaced lines' commands, comments and block deletes, and dwells."""

from __future__ import annotations

import re

import msgspec
import numpy as np

from ph_post.audit.align import NO_HUNK
from ph_post.audit.case import Case
from ph_post.audit.verdict import shown
from ph_post.gcode.reader.record import PartProgram, PlaceArray
from ph_post.types import Array

_GEOMETRY = np.frombuffer(b"XYZABCUVWIJKRFNPQ", dtype=np.uint8)
"""Letters that belong to moves, line numbers, and to G words whose own check reads them."""

_FREE = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.1, 61.0, 61.1, 64.0, 90.0, 91.0, 90.1, 91.1, 93.0, 94.0)
"""G words a hunk may bring: moves, dwells, and modes that are checked to be set back."""

_G = ord("G")
_COMMENT = re.compile(rb"\([^)\r\n]*\)?|;[^\r\n]*")
_ALIKE = 1e-9
"""Dwells [s] this close are the same number."""


class Dwells(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The dwells of a program: line and duration [s], NaN where that is no plain number."""

    block: PlaceArray
    duration: Array


def find_dwells(program: PartProgram) -> Dwells:
    """All G4 of a program."""
    block, duration = program.dwells()
    return Dwells(block=block, duration=duration)


def check_orders(case: Case) -> None:
    """Demand in hunks the commands and comments of the lines they replace, in the same order."""
    old = _commands(case.original, case.lines.old_hunk)
    new = _commands(case.compensated, case.lines.new_hunk)
    case.findings.count("commands in hunks", old.shape[1])
    if not np.array_equal(old, new):
        _tell_commands(case, old, new)
    for hunk in np.flatnonzero(case.lines.hunks.old_last > case.lines.hunks.old_first).tolist():
        _check_remarks(case, hunk)


def _commands(program: PartProgram, hunk: PlaceArray) -> Array:
    """Hunk, letter and value of the words that are neither geometry nor free, shape (3, n)."""
    words = program.words
    free = (words.letter == _G) & np.isin(words.value, _FREE)
    own = (hunk[words.block] != NO_HUNK) & ~np.isin(words.letter, _GEOMETRY) & ~free
    value = np.nan_to_num(words.value[own], nan=np.finfo(float).max)
    return np.array([hunk[words.block[own]], words.letter[own], value])


def _tell_commands(case: Case, old: Array, new: Array) -> None:
    hunks = case.lines.hunks
    for hunk in np.union1d(old[0], new[0]).astype(np.int64).tolist():
        one, other = _spelled(old, hunk), _spelled(new, hunk)
        if one != other:
            replaced = hunks.old_last[hunk] > hunks.old_first[hunk]
            case.findings.add(
                "command", "the commands of the hunk are not those of the lines it replaces",
                original=int(hunks.old_first[hunk]) if replaced else None,
                compensated=int(hunks.marker[hunk]),
                expected=" ".join(one) or "none", got=" ".join(other) or "none",
            )  # fmt: skip


def _spelled(commands: Array, hunk: int) -> list[str]:
    own = commands[1:, commands[0] == hunk]
    return [f"{chr(int(letter))}{value:g}" for letter, value in own.T.tolist()]


def _check_remarks(case: Case, hunk: int) -> None:
    """Comments of replaced lines stand in the hunk, in order; what was under a block delete stays so."""
    hunks = case.lines.hunks
    old = _stretch(case.original, int(hunks.old_first[hunk]), int(hunks.old_last[hunk]))
    new = _stretch(case.compensated, int(hunks.new_first[hunk]), int(hunks.new_last[hunk]))
    first, marker = int(hunks.old_first[hunk]), int(hunks.marker[hunk])
    if b"(" in old or b";" in old:
        rest = iter(_COMMENT.findall(new))
        for comment in _COMMENT.findall(old):
            if not any(comment == other for other in rest):
                case.findings.add(
                    "comment", "a comment of a replaced line is lost", original=first, compensated=marker,
                    expected=shown(comment),
                )  # fmt: skip
    if _deleted(old) != _deleted(new):
        what = "block delete is lost or added in the hunk"
        case.findings.add("comment", what, original=first, compensated=marker)


def _stretch(program: PartProgram, first: int, last: int) -> bytes:
    return program.data[program.lines[first] : program.lines[last]]


def _deleted(text: bytes) -> bool:
    return b"/" in text and any(line.lstrip().startswith(b"/") for line in text.splitlines())


def check_dwells(case: Case) -> Dwells:
    """Demand the declared time of dwells in hunks that are not the replaced lines'; return those."""
    new, hunk_of = find_dwells(case.compensated), case.lines.new_hunk
    added = hunk_of[new.block] != NO_HUNK
    for hunk, seconds in _replaced_dwells(case):
        own = added & (hunk_of[new.block] == hunk) & (np.abs(new.duration - seconds) <= _ALIKE)
        if own.any():
            added[np.argmax(own)] = False
            continue
        case.findings.add(
            "command", "a dwell of a replaced line is lost", expected=f"G4 P{seconds:g}",
            compensated=int(case.lines.hunks.marker[hunk]),
        )  # fmt: skip
    found = Dwells(block=new.block[added], duration=new.duration[added])
    _check_times(case, found)
    case.findings.count("dwells", found.block.size)
    return found


def _check_times(case: Case, dwells: Dwells) -> None:
    """Hold dwells to the declared times: one for all, or a shortest, a longest, and their sum."""
    declared = case.declared
    least = declared.dwell if declared.dwell is not None else np.nan
    most = declared.longest if declared.longest is not None else least
    fits = (dwells.duration >= least - _ALIKE) & (dwells.duration <= most + _ALIKE)
    told = f"{least:.7g} s" if most == least else f"{least:.7g} to {most:.7g} s"
    for place in np.flatnonzero(~fits).tolist():
        case.findings.add(
            "dwell", "a dwell is not as long as declared", compensated=int(dwells.block[place]),
            expected=told, got=f"{dwells.duration[place]:.7g} s",
        )  # fmt: skip
    total = float(dwells.duration.sum())
    if declared.dwelt is not None and not abs(total - declared.dwelt) <= _ALIKE * (1 + dwells.block.size):
        case.findings.add(
            "dwell", "the dwells are not as long in all as declared", compensated=declared.first,
            expected=f"{declared.dwelt:.9g} s", got=f"{total:.9g} s",
        )  # fmt: skip


def _replaced_dwells(case: Case) -> list[tuple[int, float]]:
    """Hunk and time [s] of the dwells of replaced lines."""
    old = find_dwells(case.original)
    hunk = case.lines.old_hunk[old.block]
    return list(zip(hunk[hunk != NO_HUNK].tolist(), old.duration[hunk != NO_HUNK].tolist(), strict=True))
