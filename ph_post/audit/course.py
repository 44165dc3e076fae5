"""The way through the hunks: less what was added, the tool goes where the original does, in order."""

from __future__ import annotations

import numpy as np

from ph_post.audit.case import Case
from ph_post.audit.frechet import follow
from ph_post.audit.orders import Dwells
from ph_post.audit.pairing import EXACT, Pairing, declared_ways, dwell_beside, is_declared, millimetres
from ph_post.audit.stretches import Side, Stretches, find_stretches
from ph_post.gcode.reader.record import LINE
from ph_post.types import Array, BoolArray, IntArray
from ph_post.units import MM

_FINE = 20.0
"""Chords stand in for arcs within this part of the tolerance, and the bound is widened by as much."""

_HALVINGS = 20
_LONGEST = 1.0
"""Deviations are told up to this length [m]."""

_TOLD = 20
"""Of so many stretches the deviation is worked out."""


def check_course(case: Case, pairing: Pairing, dwells: Dwells) -> Stretches:
    """Compare the stretches of all hunks with what they replace; `dwells` are the added ones."""
    sagitta = case.bound / _FINE
    found = find_stretches(case.original.motions, case.compensated.motions, pairing, sagitta)
    case.findings.count("stretches", found.hunk.size)
    stuck = _follow(found, np.full(found.hunk.size, case.bound + 2.0 * sagitta))
    ends = np.abs(_last(found.old) - _last(found.new))
    off = np.any(ends > 0.5 * _grid(case, found)[:, None] + EXACT, axis=1)
    doubts = _doubtful_jogs(case, pairing, dwells)
    for rank, place in enumerate(np.flatnonzero((stuck >= 0) | off).tolist()):
        if _tell_jogs(case, doubts, found, place):
            continue
        if stuck[place] >= 0:
            deviation = _deviation(found, place) if rank < _TOLD else None
            _tell_way(case, found, place, int(stuck[place]), deviation)
        else:
            _tell_end(case, int(found.hunk[place]), ends[place])
    return found


def _follow(found: Stretches, bound: Array) -> IntArray:
    return follow(found.old.points, found.old.point_first, found.new.points, found.new.point_first, bound)


def _last(side: Side) -> Array:
    """Last points of all stretches."""
    return np.asarray(side.points[side.point_first[1:] - 1])


def _grid(case: Case, found: Stretches) -> Array:
    """Last decimal [m] that is written in each stretch."""
    program, decimals = case.compensated, case.declared.decimals
    units = np.array([modal.units for modal in program.modal])
    block = case.lines.hunks.new_last[found.hunk] - 1
    return np.asarray(units[program.state[block]] * 10.0 ** -(0 if decimals is None else decimals))


def _doubtful_jogs(case: Case, pairing: Pairing, dwells: Dwells) -> BoolArray:
    """Find moves that count as part of the way, but look like a jog that is not as it should be."""
    motions = case.compensated.motions
    way = np.nan_to_num(np.abs(motions.end - motions.start))
    alone = (way > EXACT).sum(axis=1) == 1
    ahead, behind = dwell_beside(motions.block, pairing.new_hunk, dwells, case.lines)
    amount = np.zeros(way.shape[0], dtype=bool)
    for axis, (offset, pulse) in declared_ways(case.declared).items():
        amount |= is_declared(way[:, axis], offset, 0.0) | (np.abs(way[:, axis] - pulse) <= EXACT)
    straight = (motions.kind == LINE) & ~pairing.jog
    return np.asarray(straight & alone & ((ahead & behind) | amount))


def _tell_jogs(case: Case, doubts: BoolArray, found: Stretches, place: int) -> bool:
    """Tell the doubtful jogs of a stretch; whether there are any."""
    motions = case.compensated.motions
    own = found.new.motion[found.new.first[place] : found.new.first[place + 1]]
    for motion in own[doubts[own]].tolist():
        case.findings.add(
            "jog", "a move of one axis beside the path is no declared jog between two dwells",
            compensated=int(motions.block[motion]),
            got=millimetres(np.nan_to_num(motions.end[motion] - motions.start[motion])),
        )  # fmt: skip
    return bool(doubts[own].any())


def _replaced(case: Case, hunk: int) -> int | None:
    """First of the lines that a hunk replaces, if it does."""
    hunks = case.lines.hunks
    return int(hunks.old_first[hunk]) if hunks.old_last[hunk] > hunks.old_first[hunk] else None


def _tell_end(case: Case, hunk: int, ends: Array) -> None:
    case.findings.add(
        "path", "the changed stretch does not end where the original does", original=_replaced(case, hunk),
        compensated=int(case.lines.hunks.new_last[hunk]) - 1, got=millimetres(ends),
    )  # fmt: skip


def _tell_way(case: Case, found: Stretches, place: int, stuck: int, deviation: float | None) -> None:
    """Say where a stretch leaves the original's way, and by how much."""
    hunk, new = int(found.hunk[place]), found.new
    owner = new.owner[min(new.point_first[place] + stuck, new.point_first[place + 1] - 1)]
    block = case.compensated.motions.block[new.motion[owner]] if owner >= 0 else case.lines.hunks.marker[hunk]
    case.findings.add(
        "path", "the tool does not go where the original does", original=_replaced(case, hunk),
        compensated=int(block), expected=f"within {case.bound / MM:.4g} mm",
        got="" if deviation is None else f"{deviation / MM:.4g} mm, in the order of travel",
    )  # fmt: skip


def _deviation(found: Stretches, place: int) -> float:
    """How far the ways of a stretch are apart, in order [m]; no more than a metre."""
    one, other = (
        side.points[side.point_first[place] : side.point_first[place + 1]] for side in (found.old, found.new)
    )
    low, high = 0.0, _LONGEST
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        ends = np.array([0, len(one)]), np.array([0, len(other)])
        apart = follow(one, ends[0], other, ends[1], np.array([middle]))[0] >= 0
        low, high = (middle, high) if apart else (low, middle)
    return high
