"""Modal state, F and breaks: after each block the original's; in a hunk switched only for its moves.

The motion mode is not compared here: between two motions nobody can tell it, and what a block makes of it is
compared motion by motion. So is F where it does not last: under G93, and before the program has given one.
"""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from ph_post.audit.align import expand
from ph_post.audit.case import Case
from ph_post.gcode.reader.record import Modal, PartProgram
from ph_post.types import BoolArray, IntArray

_IN_HUNK = ("motion", "absolute", "arc_absolute", "feed_mode", "path")
"""Modes that a hunk may set for its own moves, and sets back at its end."""

_INVERSE_TIME = 93


def check_states(case: Case) -> None:
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
            "state", "the F in force after the block is another one", original=_line(int(old[place])),
            compensated=int(new[place]), expected=f"F {expected[place]:g}", got=f"F {got[place]:g}",
        )  # fmt: skip
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


def _tell_state(case: Case, old: int, new: int) -> None:
    one, other = case.original.modal_after(old), case.compensated.modal_after(new)
    names = [
        name
        for name in Modal.__struct_fields__
        if name != "motion" and getattr(one, name) != getattr(other, name)
    ]
    expected, got = (", ".join(f"{name} {getattr(modal, name)}" for name in names) for modal in (one, other))
    case.findings.add(
        "state", "the modal state after the block is another one", original=_line(old), compensated=new,
        expected=expected, got=got,
    )  # fmt: skip


def _check_hunks(case: Case) -> None:
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


def check_breaks(case: Case) -> None:
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
        "break", "the program is broken up in another way",
        original=None if old is None else min(old.block, first.blocks - 1),
        compensated=None if new is None else min(new.block, second.blocks - 1),
        expected="nothing more" if old is None else old.kind, got="nothing more" if new is None else new.kind,
    )  # fmt: skip
