"""Check that the tool follows the original path through changes, and that axes with an offset move in its direction."""

from __future__ import annotations

import math
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.bounds import in_parts
from ph_post.compiling import compiled, lean
from ph_post.gcode.program import ARC, AXES, CUBIC, LINE, NURBS, Motions, PartProgram, PlaceArray, plane_columns
from ph_post.types import Array, BoolArray, IntArray, unwritten
from ph_post.units import MM
from ph_post.verify.line_pairs import NO_CHANGE, VerifyCase
from ph_post.verify.pairing import (
    EXACT,
    Pairing,
    crossing_axes,
    declared_lengths,
    declared_sides,
    dwell_beside,
    format_shifts,
    is_declared,
)
from ph_post.verify.polylines import first_unreached, polylines
from ph_post.verify.states import Dwells
from ph_post.verify.stretches import Stretches, StretchSide, unproven_stretches
from ph_post.verify.threads import beside_longest

_FINE = 20.0
"""Chords stand in for arcs within this part of the tolerance, and the bound is widened by as much."""

_HALVINGS = 32
_LONGEST = 1.0
"""Deviations are measured up to this length [m]."""

_CELLS = 10**6
"""The deviation of traces with more pairs of pieces than this takes too long to measure."""

MEASURED = 20
"""The deviation is measured on so many stretches."""


class _TracedPath(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The polylines of the stretches of one program, less what is added to the axes.

    `points` (n, 3) [m], those of stretch r from ``first[r]`` on; `owner` (n,) the motion that a point is of,
    -1 where a stretch has none.
    """

    points: Array
    first: IntArray
    owner: IntArray


def check_path(case: VerifyCase, pairing: Pairing, found: Stretches, dwells: Dwells) -> None:
    """Compare the stretches of changes without a crossing with what they replace; `dwells` are the added ones."""
    one, other = case.original.motions, case.compensated.motions
    doubts = _doubtful_jogs(case, pairing, dwells)
    failed = _check_traces(case, unproven_stretches(one, other, found, case.bound), doubts)
    gap = np.abs(_last(one, other, found))
    off = np.any(gap > 0.5 * _grid(case, found)[:, None] + EXACT, axis=1)
    for place in np.flatnonzero(off).tolist():
        if int(found.change[place]) not in failed and not _report_jogs(case, doubts, found, place):
            _report_end(case, int(found.change[place]), gap[place])


def _check_traces(case: VerifyCase, closer: Stretches, doubts: BoolArray) -> set[int]:
    """Compare the ways of the stretches that need a closer look; returns the changes that failed."""
    if not closer.change.size:
        return set()
    sagitta = case.bound / _FINE
    old, new = (
        _trace(program.motions, side, sagitta)
        for program, side in ((case.original, closer.old), (case.compensated, closer.new))
    )
    old, new = _filled(old, new), _filled(new, old)
    bound = np.full(closer.change.size, case.bound + 2.0 * sagitta)
    stuck = first_unreached(old.points, old.first, new.points, new.first, bound)
    failed = np.flatnonzero(stuck >= 0)
    for rank, place in enumerate(failed.tolist()):
        if not _report_jogs(case, doubts, closer, place):
            deviation = None
            if rank < MEASURED:
                one, other = (way.points[way.first[place] : way.first[place + 1]] for way in (old, new))
                deviation = measure_deviation(one, other)
            at = min(int(new.first[place] + stuck[place]), int(new.first[place + 1]) - 1)
            report_path(case, int(closer.change[place]), int(new.owner[at]), case.bound, deviation)
    return set(closer.change[failed].tolist())


def _trace(motions: Motions, side: StretchSide, sagitta: float) -> _TracedPath:
    lines = polylines(motions, side.motion, sagitta)
    owner = np.repeat(np.arange(side.motion.size), np.diff(lines.first))
    points = np.nan_to_num(lines.points) - side.shift[owner]
    return _TracedPath(points=points, first=lines.first[side.first], owner=side.motion[owner])


def _filled(way: _TracedPath, other: _TracedPath) -> _TracedPath:
    """Give stretches without a motion a point: the first of the other program's."""
    empty = np.flatnonzero(np.diff(way.first) == 0)
    added = np.zeros(way.first.size, dtype=np.int64)
    added[empty + 1] = 1
    return _TracedPath(
        points=np.insert(way.points, way.first[empty], other.points[other.first[empty]], axis=0),
        first=way.first + np.cumsum(added),
        owner=np.insert(way.owner, way.first[empty], -1),
    )


def _last(one: Motions, other: Motions, found: Stretches) -> Array:
    """Distance by axis between the ends of the stretches [m]; one without a motion ends where it begins."""
    ends = []
    for motions, side in ((one, found.old), (other, found.new)):
        first, last = np.zeros((found.change.size, 3)), np.zeros((found.change.size, 3))
        there = np.flatnonzero(np.diff(side.first) > 0)
        low, high = side.first[there], side.first[there + 1] - 1
        first[there] = np.nan_to_num(motions.start[side.motion[low]]) - side.shift[low]
        last[there] = np.nan_to_num(motions.end[side.motion[high]]) - side.shift[high]
        ends.append((first, last, np.diff(side.first) == 0))
    (old_first, old_last, no_old), (new_first, new_last, no_new) = ends
    old_last = np.where(no_old[:, None], new_first, old_last)
    return np.asarray(np.where(no_new[:, None], old_first, new_last) - old_last)


def _grid(case: VerifyCase, found: Stretches) -> Array:
    """Last decimal [m] that is written in each stretch."""
    program, decimals = case.compensated, case.declared.decimals
    units = np.array([modal.units for modal in program.modal])
    block = case.lines.changes.new_last[found.change] - 1
    return np.asarray(units[program.state[block]] * 10.0 ** -(0 if decimals is None else decimals))


def _doubtful_jogs(case: VerifyCase, pairing: Pairing, dwells: Dwells) -> BoolArray:
    """Find moves that count as part of the way, but look like a jog that is not as it should be."""
    motions = case.compensated.motions
    straight = np.flatnonzero((motions.kind == LINE) & ~pairing.jog & (pairing.new_change != NO_CHANGE))
    way = np.nan_to_num(np.abs(motions.end[straight] - motions.start[straight]))
    alone = (way > EXACT).sum(axis=1) == 1
    ahead, behind = dwell_beside(motions.block, pairing.new_change, dwells, case.lines)
    amount = np.zeros(way.shape[0], dtype=bool)
    for axis, (offset, pulse) in declared_lengths(case.declared).items():
        amount |= is_declared(way[:, axis], offset, 0.0) | (np.abs(way[:, axis] - pulse) <= EXACT)
    doubts = np.zeros(motions.kind.size, dtype=bool)
    doubts[straight] = alone & ((ahead & behind)[straight] | amount)
    return doubts


def _report_jogs(case: VerifyCase, doubts: BoolArray, found: Stretches, place: int) -> bool:
    """Report the doubtful jogs of a stretch; return true where there are any."""
    motions = case.compensated.motions
    own = found.new.motion[found.new.first[place] : found.new.first[place + 1]]
    for motion in own[doubts[own]].tolist():
        case.findings.add(
            "jog",
            "a move of one axis beside the path is no declared jog between two dwells",
            compensated=int(motions.block[motion]),
            got=format_shifts(np.nan_to_num(motions.end[motion] - motions.start[motion])),
        )
    return bool(doubts[own].any())


def _replaced(case: VerifyCase, change: int) -> int | None:
    """First of the lines that a change replaces, if it does."""
    changes = case.lines.changes
    return int(changes.old_first[change]) if changes.old_last[change] > changes.old_first[change] else None


def _report_end(case: VerifyCase, change: int, ends: Array) -> None:
    case.findings.add(
        "path",
        "the changed stretch does not end where the original does",
        original=_replaced(case, change),
        compensated=int(case.lines.changes.new_last[change]) - 1,
        got=format_shifts(ends),
    )


def report_path(
    case: VerifyCase,
    change: int,
    motion: int,
    bound: float,
    deviation: float | None,
    what: str = "the tool does not go where the original does",
) -> None:
    """Say on which motion (-1: none) a stretch leaves the original's way, and by how much."""
    block = case.compensated.motions.block[motion] if motion >= 0 else case.lines.changes.marker[change]
    case.findings.add(
        "path",
        what,
        original=_replaced(case, change),
        compensated=int(block),
        expected=f"within {bound / MM:.4g} mm",
        got="" if deviation is None else f"{deviation / MM:.4g} mm, in the order of travel",
    )


def measure_deviation(one: Array, other: Array) -> float | None:
    """Fréchet distance of two polylines [m], up to a metre; None where they are very long."""
    if len(one) * len(other) > _CELLS:
        return None
    ends = np.array([0, len(one)]), np.array([0, len(other)])
    low, high = 0.0, _LONGEST
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        apart = first_unreached(one, ends[0], other, ends[1], np.array([middle]))[0] >= 0
        low, high = (middle, high) if apart else (low, middle)
    return high


_SPARE = 1.01
"""Excursions may be longer than the dead band by this factor: rounding of the places where an axis turns."""

_SAGITTA = 1e-3 * MM
"""Splines are followed in chords that leave them by no more than this [m]."""

SignArray = NDArray[np.int8]

_SKIP = -1
"""The chain of a jog."""

_ANEW = -2
"""The chain of a motion that is part of a crossing of the axis: behind it the axis is followed anew."""


def check_direction(case: VerifyCase, pairing: Pairing) -> None:
    """Check that no axis moves back farther than the dead band under the offset of its other direction.

    The dead band is the tolerance, or the offset itself where that is more: moves smaller than the lost motion
    may be ignored. Of moves that are tied to the spindle the longest of each run counts: all have its offsets. Where a
    cutter comes onto an arc under compensation, and where it leaves a contour, its radius decides how the axes move.
    """
    motions = case.compensated.motions
    curves = np.isin(motions.kind, (CUBIC, NURBS))
    lines = polylines(motions, np.flatnonzero(curves), _SAGITTA)
    first = unwritten(motions.kind.size + 1, np.int32)
    if lines.first.size > 1:
        first[1:][curves] = np.diff(lines.first)
        np.cumsum(first, out=first)
    crossing = crossing_axes(case, pairing)
    contours, beside = _beside_contours(case.compensated), beside_longest(case.compensated)
    for name, amount in case.declared.offsets.items():
        axis, band = AXES.index(name), max(case.band, amount.metres)
        crossed = np.flatnonzero(pairing.crossed)
        anew = crossed[crossing[pairing.new_change[crossed], axis]]
        chain = np.where(pairing.left_out, np.int32(_SKIP), motions.chain)
        chain[contours] = chain[anew] = chain[beside] = _ANEW
        back = _ways_back(case, pairing, axis, chain, (lines.points, first), _SPARE * band)
        over = back > 0.0
        for motion in np.flatnonzero(over & ~np.append(False, over)[:-1]).tolist():
            case.findings.add(
                "direction",
                f"{name} moves back under the offset of its other direction",
                original=_original_line(case, pairing, motion),
                compensated=int(motions.block[motion]),
                expected=f"<= {band / MM:.6g} mm",
                got=f"{back[motion] / MM:.6g} mm",
            )


def _ways_back(
    case: VerifyCase,
    pairing: Pairing,
    axis: int,
    chain: PlaceArray,
    curve: tuple[Array, PlaceArray],
    most: float,
) -> Array:
    """Return the ways back [m] of an axis that are longer than `most` and that motions add to, (k,).

    `chain` as of :func:`_reverse_travel`; `curve` are points along splines, and where those of each motion begin.
    """
    motions = case.compensated.motions
    after = pairing.after[:, axis]
    # Beyond an approach an axis is on neither side, be it by as much as the offset that only its other side has.
    sign = np.zeros(motions.kind.size, dtype=np.int8)
    for part in in_parts(sign.size):
        for one, offset in zip((-1, 1), declared_sides(case.declared)[axis], strict=True):
            if offset != 0.0:
                sign[part][np.abs(after[part] - offset) <= EXACT] = one
    ends = (motions.start[:, axis], motions.end[:, axis])
    places = np.ascontiguousarray(curve[0][:, axis])
    back = unwritten(motions.kind.size)
    swings, shift = swings_of(motions, axis), (pairing.before(axis), after)
    _reverse_travel(sign, chain, ends, shift, swings, (places, curve[1]), most, back)
    return back


def _beside_contours(program: PartProgram) -> BoolArray:
    """Mask of the motions (m,) with which a cutter comes onto an arc under compensation, or leaves a contour."""
    corrected = np.array([one.compensation not in (None, "G40") for one in program.modal], dtype=np.bool_)
    own = corrected[program.state[program.motions.block]]
    before, arc = np.append(False, own)[: own.size], np.append(program.motions.kind[1:] == ARC, False)[: own.size]
    return np.asarray((own & ~before & arc) | (before & ~own))


def _original_line(case: VerifyCase, pairing: Pairing, motion: int) -> int | None:
    if not pairing.paired[1][motion]:
        return None
    return int(case.original.motions.block[pairing.pairs()[0][np.count_nonzero(pairing.paired[1][:motion])]])


def swings_of(motions: Motions, axis: int) -> tuple[PlaceArray, Array, Array, Array, Array]:
    """Motion of an axis on arcs: number of the arc of each motion, from 1, 0 of others, and how it swings on each arc.

    That is the middle [m], the radius [m], 0 where the axis does not swing, where it begins and how far it goes, in
    half turns from where the axis is farthest.
    """
    arcs = np.flatnonzero(motions.kind == ARC)
    number = unwritten(motions.kind.size, np.int32)
    number[arcs] = np.arange(1, arcs.size + 1)
    columns = plane_columns(motions.plane[arcs])
    spoke = np.take_along_axis(motions.start[arcs], columns[:, :2], axis=1) - motions.center[arcs]
    second = columns[:, 1] == axis
    middle = motions.center[arcs, second.astype(np.int64)]
    radius = np.nan_to_num(np.where(columns[:, 2] != axis, np.hypot(*spoke.T), 0.0))
    begin = np.arctan2(spoke[:, 1], spoke[:, 0]) / math.pi - 0.5 * second
    return number, middle, radius, begin, motions.angle[arcs] / math.pi


@lean
def _visit(x: float, spot: Any) -> None:
    """Follow the axis to a place: `spot` has the farthest one so far, and the longest way back from it."""
    spot[0] = max(spot[0], x)
    spot[1] = max(spot[1], spot[0] - x)


@lean
def _visit_turns(k: int, sign: int, shift: float, swings: Any, spot: Any) -> None:
    """Visit the places inside arc `k` at which the axis turns, in order."""
    _, middle, radius, begin, sweep = swings
    step = 1.0 if sweep[k] > 0.0 else -1.0
    n = math.floor(begin[k]) + 1.0 if sweep[k] > 0.0 else math.ceil(begin[k]) - 1.0
    while (n - begin[k] - sweep[k]) * step < 0.0:
        _visit(sign * (middle[k] - shift + (radius[k] if n % 2.0 == 0.0 else -radius[k])), spot)
        n += step


@compiled
def _reverse_travel(
    sign: SignArray, chain: Any, ends: Any, shift: Any, swings: Any, curve: Any, most: float, out: Array
) -> None:
    """Find the longest ways back [m] under one offset that motions add to.

    Parameters
    ----------
    sign : ndarray, shape (k,)
        Direction whose offset the axis carries at the end of each motion, 0 for none.
    chain : ndarray, shape (k,)
        Number of the chain, ``_SKIP`` for jogs, ``_ANEW`` in crossings.
    ends, shift : tuple of ndarray, shape (k,)
        Position at start and end [m], and what is added there; at starts as of :meth:`Pairing.before`.
    swings : tuple of ndarray
        Of :func:`swings_of`.
    curve : tuple
        Positions along splines [m], and where those of each motion begin (k + 1,).
    most : float
        Shorter ones are not told [m].
    out : ndarray, shape (k,)
        Zeros; the ways are put there.
    """
    spot = np.zeros(2)
    places, first = curve
    (before, anew, begins), after = shift
    latest, its_chain, n = 0, _SKIP, 0
    for k in range(sign.size):
        while n < anew.size and anew[n] < k:
            n += 1
        if chain[k] == _SKIP:
            continue
        if chain[k] == _ANEW or sign[k] == 0 or np.isnan(ends[0][k]) or np.isnan(ends[1][k]):
            latest = 0
            continue
        if sign[k] != latest or chain[k] != its_chain:
            spot[0], latest, its_chain = -math.inf, sign[k], chain[k]
        spot[1] = 0.0
        begin = begins[n] if n < anew.size and anew[n] == k else before[k]
        _visit(sign[k] * (ends[0][k] - begin), spot)
        arc = swings[0][k] - 1
        if arc >= 0 and swings[2][arc] > 0.0:
            _visit_turns(arc, sign[k], after[k], swings, spot)
        for place in range(first[k], first[k + 1]):
            _visit(sign[k] * (places[place] - after[k]), spot)
        _visit(sign[k] * (ends[1][k] - after[k]), spot)
        if spot[1] > most:
            out[k] = spot[1]
