"""Check moves that are tied to the spindle: nothing is put between them, and a run of them is shifted as a whole."""

from __future__ import annotations

from typing import Any, Final

import msgspec
import numpy as np

from ph_post.gcode.program import PartProgram
from ph_post.types import Array, BoolArray
from ph_post.units import MM
from ph_post.verify.line_pairs import VerifyCase
from ph_post.verify.pairing import format_shifts

_LEADS: Final = ord("K")
_ROUNDED: Final = 2.0
"""Ends may be off by so many units of their last decimal."""


class _Run(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A run of moves tied to the spindle: its `lines`, the places (k + 1, 3) [m] between them, and their K."""

    lines: tuple[int, ...]
    places: Array
    leads: tuple[float, ...]


def check_threads(case: VerifyCase) -> None:
    """Demand the same runs of moves tied to the spindle, each shifted as a whole, Z alike in all that go its way."""
    old, new = _runs(case.original), _runs(case.compensated)
    case.findings.count("threads", len(old))
    shapes = [[(len(run.lines), run.leads) for run in some] for some in (old, new)]
    if shapes[0] != shapes[1]:
        place = next((n for n, (one, other) in enumerate(zip(*shapes, strict=False)) if one != other), -1)
        case.findings.add(
            "thread",
            "the moves tied to the spindle are not those of the original",
            original=old[place].lines[0] if old else None,
            compensated=new[place].lines[0] if new else None,
        )
        return
    step = _ROUNDED * max((modal.units for modal in case.compensated.modal), default=MM)
    step *= 10.0 ** -(0 if case.declared.decimals is None else case.declared.decimals)
    alike: dict[float, list[tuple[int, float]]] = {}
    for n, (one, other) in enumerate(zip(old, new, strict=True)):
        moved = np.nan_to_num(other.places - one.places)
        if np.ptp(moved, axis=0).max() > step:
            _report(case, one, other, "a thread is not shifted as a whole", np.ptp(moved, axis=0))
        way = float(np.sign(np.nan_to_num(one.places[-1, 2] - one.places[0, 2])))
        alike.setdefault(way, []).append((n, float(moved[0, 2])))
    for passes in alike.values():
        for n, shift in passes:
            if abs(shift - passes[0][1]) > step:
                what = "Z is shifted otherwise than in other passes, which would not meet this one"
                _report(case, old[n], new[n], what, np.array([0.0, 0.0, shift - passes[0][1]]))
                break


def _runs(program: PartProgram) -> list[_Run]:
    """Return the runs: moves tied to the spindle with no other motion, and no break, between them."""
    motions = program.motions
    if not program.threads.any():
        return []
    words = program.words
    return [
        _Run(
            lines=tuple(motions.block[own].tolist()),
            places=np.vstack([motions.start[own[:1]], motions.end[own]]),
            leads=tuple(_lead(words, int(motions.block[k])) for k in own),
        )
        for own in _tied(program)
    ]


def _tied(program: PartProgram) -> list[list[int]]:
    """Return the motions of every run."""
    found: list[list[int]] = []
    chain = program.motions.chain
    for k in np.flatnonzero(program.threads).tolist():
        if found and found[-1][-1] == k - 1 and chain[k - 1] == chain[k]:
            found[-1].append(k)
        else:
            found.append([k])
    return found


def beside_longest(program: PartProgram) -> BoolArray:
    """Mask (m,) of the motions tied to the spindle that are not the longest of their run."""
    motions, found = program.motions, np.zeros(program.motions.kind.size, dtype=np.bool_)
    for own in _tied(program):
        length = np.linalg.norm(np.nan_to_num(motions.end[own] - motions.start[own]), axis=1)
        found[own] = True
        found[own[int(np.argmax(length))]] = False
    return found


def _lead(words: Any, line: int) -> float:
    """Return the K of a line."""
    rows = words.rows(line, line + 1)
    own = words.value[rows][words.letter[rows] == _LEADS]
    return float(own[0]) if own.size else 0.0


def _report(case: VerifyCase, old: _Run, new: _Run, what: str, shifts: Array) -> None:
    case.findings.add("thread", what, original=old.lines[0], compensated=new.lines[0], got=format_shifts(shifts))
