"""Check modal states, feeds, and what else stands in a change: commands, comments, block deletes and dwells."""

from __future__ import annotations

import re
from typing import Any

import msgspec
import numpy as np

from ph_post.gcode.program import Modal, PartProgram, PlaceArray
from ph_post.types import Array, BoolArray, IntArray
from ph_post.verify.declared import NO_HUNK, VerifyCase, expand
from ph_post.verify.verdict import shown

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


def check_orders(case: VerifyCase) -> None:
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


def _tell_commands(case: VerifyCase, old: Array, new: Array) -> None:
    hunks = case.lines.hunks
    for hunk in np.union1d(old[0], new[0]).astype(np.int64).tolist():
        one, other = _spelled(old, hunk), _spelled(new, hunk)
        if one != other:
            replaced = hunks.old_last[hunk] > hunks.old_first[hunk]
            case.findings.add(
                "command",
                "the commands of the hunk are not those of the lines it replaces",
                original=int(hunks.old_first[hunk]) if replaced else None,
                compensated=int(hunks.marker[hunk]),
                expected=" ".join(one) or "none",
                got=" ".join(other) or "none",
            )


def _spelled(commands: Array, hunk: int) -> list[str]:
    own = commands[1:, commands[0] == hunk]
    return [f"{chr(int(letter))}{value:g}" for letter, value in own.T.tolist()]


def _check_remarks(case: VerifyCase, hunk: int) -> None:
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
                    "comment",
                    "a comment of a replaced line is lost",
                    original=first,
                    compensated=marker,
                    expected=shown(comment),
                )
    if _deleted(old) != _deleted(new):
        what = "block delete is lost or added in the hunk"
        case.findings.add("comment", what, original=first, compensated=marker)


def _stretch(program: PartProgram, first: int, last: int) -> bytes:
    return program.data[program.lines[first] : program.lines[last]]


def _deleted(text: bytes) -> bool:
    return b"/" in text and any(line.lstrip().startswith(b"/") for line in text.splitlines())


def check_dwells(case: VerifyCase) -> Dwells:
    """Demand the declared time of dwells in hunks that are not the replaced lines'; return those."""
    new, hunk_of = find_dwells(case.compensated), case.lines.new_hunk
    added = hunk_of[new.block] != NO_HUNK
    for hunk, seconds in _replaced_dwells(case):
        own = added & (hunk_of[new.block] == hunk) & (np.abs(new.duration - seconds) <= _ALIKE)
        if own.any():
            added[np.argmax(own)] = False
            continue
        case.findings.add(
            "command",
            "a dwell of a replaced line is lost",
            expected=f"G4 P{seconds:g}",
            compensated=int(case.lines.hunks.marker[hunk]),
        )
    found = Dwells(block=new.block[added], duration=new.duration[added])
    _check_times(case, found)
    case.findings.count("dwells", found.block.size)
    return found


def _check_times(case: VerifyCase, dwells: Dwells) -> None:
    """Hold dwells to the declared times: one for all, or a shortest, a longest, and their sum."""
    declared = case.declared
    least = declared.dwell if declared.dwell is not None else np.nan
    most = declared.longest if declared.longest is not None else least
    fits = (dwells.duration >= least - _ALIKE) & (dwells.duration <= most + _ALIKE)
    told = f"{least:.7g} s" if most == least else f"{least:.7g} to {most:.7g} s"
    for place in np.flatnonzero(~fits).tolist():
        case.findings.add(
            "dwell",
            "a dwell is not as long as declared",
            compensated=int(dwells.block[place]),
            expected=told,
            got=f"{dwells.duration[place]:.7g} s",
        )
    total = float(dwells.duration.sum())
    if declared.dwelt is not None and not abs(total - declared.dwelt) <= _ALIKE * (1 + dwells.block.size):
        case.findings.add(
            "dwell",
            "the dwells are not as long in all as declared",
            compensated=declared.first,
            expected=f"{declared.dwelt:.9g} s",
            got=f"{total:.9g} s",
        )


def _replaced_dwells(case: VerifyCase) -> list[tuple[int, float]]:
    """Hunk and time [s] of the dwells of replaced lines."""
    old = find_dwells(case.original)
    hunk = case.lines.old_hunk[old.block]
    return list(zip(hunk[hunk != NO_HUNK].tolist(), old.duration[hunk != NO_HUNK].tolist(), strict=True))


_IN_HUNK = ("motion", "absolute", "arc_absolute", "feed_mode", "path")
"""Modes that a hunk may set for its own moves, and sets back at its end."""

_INVERSE_TIME = 93


def check_states(case: VerifyCase) -> None:
    """Compare the state after each line outside hunks and after each hunk, and what hunks hold meanwhile."""
    original, compensated, hunks = case.original, case.compensated, case.lines.hunks
    old = np.concatenate([case.lines.old, hunks.old_last - 1])
    new = np.concatenate([case.lines.new, hunks.new_last - 1])
    order = np.argsort(new, kind="stable")
    old, new = old[order], new[order]
    known = _Numbering(("motion",))
    unlike = (
        _after(known.number(original)[original.state], old, known.of(Modal()))
        != (known.number(compensated)[compensated.state][new])
    )
    for place in _onsets(unlike).tolist():
        _tell_state(case, int(old[place]), int(new[place]))
    expected, got = _after(original.feed_word, old, np.nan), compensated.feed_word[new]
    timed = np.array([modal.feed_mode == _INVERSE_TIME for modal in compensated.modal])
    unlike = ~((expected == got) | np.isnan(expected) | timed[compensated.state[new]])
    for place in _onsets(unlike).tolist():
        case.findings.add(
            "state",
            "the F in force after the block is another one",
            original=_line(int(old[place])),
            compensated=int(new[place]),
            expected=f"F {expected[place]:g}",
            got=f"F {got[place]:g}",
        )
    case.findings.count("states", old.size)
    _check_hunks(case)


class _Numbering:
    """Numbers of modal states, the same in both programs."""

    def __init__(self, without: tuple[str, ...] = ()) -> None:
        self._known: dict[Modal, int] = {}
        self._blank: dict[str, Any] = {name: getattr(Modal(), name) for name in without}

    def of(self, modal: Modal) -> int:
        """Return the number of one state."""
        return self._known.setdefault(msgspec.structs.replace(modal, **self._blank), len(self._known))

    def number(self, program: PartProgram) -> IntArray:
        """Return the numbers of a program's states."""
        return np.array([self.of(modal) for modal in program.modal], dtype=np.int64)


def _after(values: Any, lines: IntArray, start: float) -> Any:
    """Values after each of the lines, and `start` before the first one (-1)."""
    return np.append(values, start)[lines]


def _onsets(wrong: BoolArray) -> IntArray:
    """Where something begins to be wrong."""
    return np.flatnonzero(wrong & ~np.append(False, wrong)[:-1])


def _line(line: int) -> int | None:
    return line if line >= 0 else None


def _tell_state(case: VerifyCase, old: int, new: int) -> None:
    one, other = case.original.modal_after(old), case.compensated.modal_after(new)
    names = [
        name for name in Modal.__struct_fields__ if name != "motion" and getattr(one, name) != getattr(other, name)
    ]
    expected, got = (", ".join(f"{name} {getattr(modal, name)}" for name in names) for modal in (one, other))
    case.findings.add(
        "state",
        "the modal state after the block is another one",
        original=_line(old),
        compensated=new,
        expected=expected,
        got=got,
    )


def _check_hunks(case: VerifyCase) -> None:
    """Inside a hunk nothing is switched but what its moves need, and what the replaced lines switched."""
    known = _Numbering(_IN_HUNK)
    hunks = case.lines.hunks
    old_state = known.number(case.original)[case.original.state]
    new_state = known.number(case.compensated)[case.compensated.state]
    inside, hunk = expand(hunks.new_first, hunks.new_last)
    start = _after(old_state, hunks.old_first - 1, known.of(Modal()))
    for place in np.flatnonzero(new_state[inside] != start[hunk]).tolist():
        number, line = int(hunk[place]), int(inside[place])
        if new_state[line] not in old_state[hunks.old_first[number] : hunks.old_last[number]]:
            case.findings.add("state", "the hunk switches what it must not touch", compensated=line)


def check_breaks(case: VerifyCase) -> None:
    """Demand the same breaks (tool changes, homing, probing, …) in the same order."""
    first, second = case.original, case.compensated
    one, other = ([mark.kind for mark in program.breaks] for program in (first, second))
    case.findings.count("breaks", len(one))
    if one == other:
        return
    shared = min(len(one), len(other))
    place = next((k for k in range(shared) if one[k] != other[k]), shared)
    old = first.breaks[place] if place < len(one) else None
    new = second.breaks[place] if place < len(other) else None
    case.findings.add(
        "break",
        "the program is broken up in another way",
        original=None if old is None else min(old.block, first.blocks - 1),
        compensated=None if new is None else min(new.block, second.blocks - 1),
        expected="nothing more" if old is None else old.kind,
        got="nothing more" if new is None else new.kind,
    )
