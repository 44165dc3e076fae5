"""Check modal states, feeds, and what else stands in a change: commands, comments, block deletes and dwells."""

from __future__ import annotations

import re
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.bounds import in_parts
from ph_post.gcode.codes import takes_axes
from ph_post.gcode.numbers import COMMENT
from ph_post.gcode.program import Modal, PartProgram, PlaceArray, WordTable, expand, runs
from ph_post.types import Array, BoolArray, IntArray
from ph_post.verify.line_pairs import NO_CHANGE, VerifyCase
from ph_post.verify.verdict import quoted

_GEOMETRY = np.frombuffer(b"XYZABCUVWIJKRFNPQ", dtype=np.uint8)
"""Letters that belong to moves, line numbers, and to G words whose own check reads them."""

_FREE = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.1, 61.0, 61.1, 64.0, 90.0, 91.0, 90.1, 91.1, 93.0, 94.0)
"""G words a change may bring: moves, dwells, and modes that are checked to be set back."""

_MOTIONS = (0.0, 1.0, 2.0, 3.0, 5.0, 5.1)

_G = ord("G")
_BEHIND = re.compile(rb";[^\r\n]*")
_ALIKE = 1e-9
"""Dwells [s] this close are the same number."""


class Dwells(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The dwells of a program: line and duration [s], NaN where that is no plain number."""

    block: PlaceArray
    duration: Array


def check_commands(case: VerifyCase, words: tuple[WordTable, WordTable]) -> None:
    """Check that changes keep the commands and comments of the lines they replace, in the same order.

    `words` are those of both programs that :func:`~ph_post.verify.text.check_text` returns.
    """
    old, new = _commands(words[0], case.lines.old_change), _commands(words[1], case.lines.new_change)
    case.findings.count("commands in changes", old.shape[1])
    if not np.array_equal(old, new):
        _report_commands(case, old, new)
    _check_motion_words(case, words)
    for change in np.flatnonzero(case.lines.changes.old_last > case.lines.changes.old_first).tolist():
        _check_remarks(case, change)


def _check_motion_words(case: VerifyCase, words: tuple[WordTable, WordTable]) -> None:
    """Demand that no change puts a motion word beside a word that takes the axis words of its line for itself.

    On such a line as ``G68 X0 Y0 R30`` the axis words would then be a motion.
    """
    changes = case.lines.changes
    found = _axis_takers(words[1], expand(changes.new_first, changes.new_last)[0])
    known = _axis_takers(words[0], expand(changes.old_first, changes.old_last)[0]).values() if found else ()
    for line, own in found.items():
        if any(value in _MOTIONS for value in own) and own not in known:
            text = quoted(case.compensated.text(line).strip())
            what = "a motion word stands beside a word that takes the axis words"
            case.findings.add("command", what, compensated=line, got=text)


def _axis_takers(words: WordTable, lines: IntArray) -> dict[int, list[float]]:
    """Return the G words of those of some lines that have one which takes the axis words, by line."""
    codes = words.letter == _G
    takes = {value: takes_axes(value) for value in np.unique(words.value[codes]).tolist()}
    which = np.flatnonzero(codes & np.isin(words.value, [value for value, own in takes.items() if own]))
    blocks = np.intersect1d(words.block[which], lines).tolist()
    rows = {block: words.rows(block, block + 1) for block in blocks}
    return {block: sorted(words.value[own][words.letter[own] == _G].tolist()) for block, own in rows.items()}


def _commands(words: WordTable, change: NDArray[Any]) -> Array:
    """Change, letter and value of the words that are neither geometry nor free, shape (3, n)."""
    free = (words.letter == _G) & np.isin(words.value, _FREE)
    own = (change[words.block] != NO_CHANGE) & ~np.isin(words.letter, _GEOMETRY) & ~free
    value = np.nan_to_num(words.value[own], nan=np.finfo(float).max)
    return np.array([change[words.block[own]], words.letter[own], value])


def _report_commands(case: VerifyCase, old: Array, new: Array) -> None:
    changes = case.lines.changes
    for change in np.union1d(old[0], new[0]).astype(np.int64).tolist():
        one, other = _spelled(old, change), _spelled(new, change)
        if one != other:
            replaced = changes.old_last[change] > changes.old_first[change]
            case.findings.add(
                "command",
                "the commands of the change are not those of the lines it replaces",
                original=int(changes.old_first[change]) if replaced else None,
                compensated=int(changes.marker[change]),
                expected=" ".join(one) or "none",
                got=" ".join(other) or "none",
            )


def _spelled(commands: Array, change: int) -> list[str]:
    own = commands[1:, commands[0] == change]
    return [f"{chr(int(letter))}{value:g}" for letter, value in own.T.tolist()]


def _check_remarks(case: VerifyCase, change: int) -> None:
    """Comments of replaced lines stand in the change, in order; what was under a block delete stays so."""
    changes = case.lines.changes
    old = _stretch(case.original, int(changes.old_first[change]), int(changes.old_last[change]))
    new = _stretch(case.compensated, int(changes.new_first[change]), int(changes.new_last[change]))
    first, marker = int(changes.old_first[change]), int(changes.marker[change])
    if b"(" in old or b";" in old:
        pattern = COMMENT if case.original.language.parentheses else _BEHIND
        rest = iter(pattern.findall(new))
        for comment in pattern.findall(old):
            if not any(comment == other for other in rest):
                case.findings.add(
                    "comment",
                    "a comment of a replaced line is lost",
                    original=first,
                    compensated=marker,
                    expected=quoted(comment),
                )
    if _deleted(old) != _deleted(new):
        what = "block delete is lost or added in the change"
        case.findings.add("comment", what, original=first, compensated=marker)


def _stretch(program: PartProgram, first: int, last: int) -> bytes:
    return program.data[program.lines[first] : program.lines[last]]


def _deleted(text: bytes) -> bool:
    return b"/" in text and any(line.lstrip().startswith(b"/") for line in text.splitlines())


def check_dwells(case: VerifyCase, words: tuple[WordTable, WordTable]) -> Dwells:
    """Demand the declared time of dwells in changes that are not the replaced lines'; return those.

    `words` are those of both programs that :func:`~ph_post.verify.text.check_text` returns.
    """
    sides = zip((case.original, case.compensated), words, strict=True)
    (before, times), (block, duration) = (program.dwells(words=own) for program, own in sides)
    old, new = Dwells(block=before, duration=times), Dwells(block=block, duration=duration)
    change_of = case.lines.new_change
    added = change_of[new.block] != NO_CHANGE
    for change, seconds in _replaced_dwells(case, old):
        own = added & (change_of[new.block] == change) & (np.abs(new.duration - seconds) <= _ALIKE)
        if own.any():
            added[np.argmax(own)] = False
            continue
        case.findings.add(
            "command",
            "a dwell of a replaced line is lost",
            expected=f"G4 P{seconds:g}",
            compensated=int(case.lines.changes.marker[change]),
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
    times = f"{least:.7g} s" if most == least else f"{least:.7g} to {most:.7g} s"
    for place in np.flatnonzero(~fits).tolist():
        case.findings.add(
            "dwell",
            "a dwell is not as long as declared",
            compensated=int(dwells.block[place]),
            expected=times,
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


def _replaced_dwells(case: VerifyCase, old: Dwells) -> list[tuple[int, float]]:
    """Change and time [s] of the dwells of replaced lines, of all in the original."""
    change = case.lines.old_change[old.block]
    return list(zip(change[change != NO_CHANGE].tolist(), old.duration[change != NO_CHANGE].tolist(), strict=True))


_IN_CHANGE = ("motion", "absolute", "arc_absolute", "feed_mode", "path")
"""Modes that a change may set for its own moves, and sets back at its end."""

INVERSE_TIME = 93


_CONVERTED = 1e-12
"""Part by which an F may differ that is written in other units than its word was."""


def check_states(case: VerifyCase) -> None:
    """Compare the state after each line outside changes and after each change, and what changes hold meanwhile."""
    original, compensated, changes = case.original, case.compensated, case.lines.changes
    ends = changes.old_last, changes.new_last
    old, new = (
        np.concatenate([outside, (last - 1).astype(np.int32)])
        for outside, last in zip(case.lines.outside(), ends, strict=True)
    )
    known = StateNumbering(("motion",))
    unlike = (
        _after(known.number(original)[original.state], old, known.of(Modal()))
        != (known.number(compensated)[compensated.state][new])
    )
    for place in _first_ones(unlike, new):
        _report_state(case, int(old[place]), int(new[place]))
    timed = np.array([modal.feed_mode == INVERSE_TIME for modal in compensated.modal])
    for part in in_parts(old.size):
        expected, got = _feeds(case, old[part], new[part])
        unlike[part] = ~(
            (expected == got)
            | np.isclose(expected, got, rtol=_CONVERTED, atol=0.0)
            | np.isnan(expected)
            | timed[compensated.state[new[part]]]
        )
    for place in _first_ones(unlike, new):
        before, after = _feeds(case, old[[place]], new[[place]])
        case.findings.add(
            "state",
            "the F in force after the block is another one",
            original=_line(int(old[place])),
            compensated=int(new[place]),
            expected=f"F {before[0]:g}",
            got=f"F {after[0]:g}",
        )
    case.findings.count("states", old.size)
    _check_changes(case)


def _feeds(case: VerifyCase, old: PlaceArray, new: PlaceArray) -> tuple[Array, Array]:
    """Return the F in force after lines of the original, NaN after none (-1), and of the compensated program."""
    expected = np.where(old < 0, np.nan, case.original.feeds.of(np.maximum(old, 0)))
    return expected, case.compensated.feeds.of(new)


def _first_ones(mask: BoolArray, lines: PlaceArray) -> list[int]:
    """Return the places of a mask that are true where those of the line before are not, in the order of the lines."""
    if not mask.any():
        return []
    order = np.argsort(lines, kind="stable")
    return [int(place) for place in order[runs(mask[order])[0]]]


class StateNumbering:
    """Numbers of modal states, the same in both programs."""

    def __init__(self, without: tuple[str, ...] = ()) -> None:
        self._known: dict[Modal, int] = {}
        self._blank: dict[str, Any] = {name: getattr(Modal(), name) for name in without}

    def of(self, modal: Modal) -> int:
        """Return the number of one state."""
        return self._known.setdefault(msgspec.structs.replace(modal, **self._blank), len(self._known))

    def number(self, program: PartProgram) -> PlaceArray:
        """Return the numbers of a program's states."""
        return np.array([self.of(modal) for modal in program.modal], dtype=np.int32)


def _after(values: Any, lines: IntArray | PlaceArray, start: float) -> Any:
    """Values after each of the lines, and `start` before the first one (-1)."""
    found = values[lines]
    found[lines < 0] = start
    return found


def _line(line: int) -> int | None:
    return line if line >= 0 else None


def _report_state(case: VerifyCase, old: int, new: int) -> None:
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


def _check_changes(case: VerifyCase) -> None:
    """Inside a change nothing is switched but what its moves need, and what the replaced lines switched."""
    known = StateNumbering(_IN_CHANGE)
    changes = case.lines.changes
    old_state = known.number(case.original)[case.original.state]
    new_state = known.number(case.compensated)[case.compensated.state]
    inside, change = expand(changes.new_first, changes.new_last)
    start = _after(old_state, changes.old_first - 1, known.of(Modal()))
    for place in np.flatnonzero(new_state[inside] != start[change]).tolist():
        number, line = int(change[place]), int(inside[place])
        if new_state[line] not in old_state[changes.old_first[number] : changes.old_last[number]]:
            case.findings.add("state", "the change switches what it must not touch", compensated=line)


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
