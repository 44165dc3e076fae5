"""What is added to the motions: only declared amounts, only where it may change, and taken back in time."""

from __future__ import annotations

import numpy as np

from ph_post.audit.align import NO_HUNK
from ph_post.audit.case import Case
from ph_post.audit.orders import Dwells
from ph_post.audit.pairing import EXACT, Pairing, declared_ways, millimetres
from ph_post.audit.verdict import FailureKind
from ph_post.gcode.reader.record import ARC, AXES, CUBIC, NURBS, RAPID, plane_columns
from ph_post.types import Array, BoolArray
from ph_post.units import MM

_ANGLE = 1e-9
"""Angles [rad] that differ by no more are the same."""

_RELATIVE = 1e-9
"""Feeds that differ by no more of themselves are the same."""


def check_pairs(case: Case, pairing: Pairing) -> None:
    """Motions that stand for each other are the same but for one shift, which only a rapid may change."""
    one, other, old, new = case.original.motions, case.compensated.motions, pairing.old, pairing.new
    changes, unknown = np.zeros(old.size, dtype=bool), np.zeros(old.size, dtype=bool)
    for axis in range(3):  # one by one, as there may be a million motions
        changes |= np.abs(pairing.after[new, axis] - pairing.before[new, axis]) > EXACT
        unknown |= np.isnan(one.start[old, axis]) != np.isnan(other.start[new, axis])
        unknown |= np.isnan(one.end[old, axis]) != np.isnan(other.end[new, axis])
    faults: tuple[tuple[FailureKind, BoolArray, str], ...] = (
        ("path", one.kind[old] != other.kind[new], "the motion is of another kind"),
        ("path", unknown, "the position is known in one of the programs only"),
        ("path", _bent(case, pairing), "the arc is another one"),
        ("path", _bulged(case, pairing), "the spline is another one"),
        ("path", one.exact[old] != other.exact[new], "the path mode at its end is another one"),
        ("feed", _differ(one.feed[old], other.feed[new]), "the feed of the motion is another one"),
        ("feed", _differ(one.duration[old], other.duration[new]), "the time of the motion is another one"),
        (
            "offset", (one.kind[old] != RAPID) & changes,
            "the shift changes while the tool cuts",
        ),
    )  # fmt: skip
    for kind, wrong, what in faults:
        for first, second in zip(
            one.block[old[wrong]].tolist(), other.block[new[wrong]].tolist(), strict=True
        ):
            case.findings.add(kind, what, original=first, compensated=second)


def _differ(one: Array, other: Array) -> BoolArray:
    """Which numbers are not the same but for rounding; two unknown ones are."""
    return ~((np.abs(one - other) <= _RELATIVE * np.abs(one)) | (np.isnan(one) & np.isnan(other)))


def _bent(case: Case, pairing: Pairing) -> BoolArray:
    """Arcs whose plane, sweep or centre, less the shift, differ."""
    one, other = case.original.motions, case.compensated.motions
    both = np.flatnonzero((one.kind[pairing.old] == ARC) & (other.kind[pairing.new] == ARC))
    old, new = pairing.old[both], pairing.new[both]
    shift = np.take_along_axis(pairing.after[new], plane_columns(one.plane[old])[:, :2], axis=1)
    wrong = np.zeros(pairing.old.size, dtype=bool)
    wrong[both] = (
        (one.plane[old] != other.plane[new])
        | (np.abs(one.angle[old] - other.angle[new]) > _ANGLE)
        | np.any(np.abs(other.center[new] - shift - one.center[old]) > EXACT, axis=1)
    )
    return wrong


def _bulged(case: Case, pairing: Pairing) -> BoolArray:
    """Splines whose control points, less the shift, or weights differ."""
    one, other = case.original.motions, case.compensated.motions
    wrong = np.zeros(pairing.old.size, dtype=bool)
    curves = np.isin(one.kind[pairing.old], (CUBIC, NURBS))
    for place in np.flatnonzero(curves & (one.kind[pairing.old] == other.kind[pairing.new])).tolist():
        old, new, shift = int(pairing.old[place]), int(pairing.new[place]), pairing.after[pairing.new[place]]
        if one.kind[old] == CUBIC:
            wrong[place] = not _same_points(one.control[old], other.control[new], shift)
            continue
        (order, points, weights), (order2, points2, weights2) = one.nurbs[old], other.nurbs[new]
        alike = order == order2 and np.array_equal(weights, weights2)
        wrong[place] = not (alike and _same_points(points, points2, shift))
    return wrong


def _same_points(one: Array, other: Array, shift: Array) -> bool:
    if one.shape != other.shape:
        return False
    unknown = np.isnan(one) & np.isnan(other)
    return bool(np.all((np.abs(other - shift - one) <= EXACT) | unknown))


def check_amounts(case: Case, pairing: Pairing) -> None:
    """While the tool moves every axis carries -offset, 0 or offset; a pulse lasts only while it stands."""
    ways = declared_ways(case.declared)
    allowed = np.array([ways.get(axis, (0.0, 0.0)) for axis in range(3)])
    hunk = pairing.new_hunk
    last = np.append(hunk[1:] != hunk[:-1], True)[: hunk.size] & (hunk != NO_HUNK)
    wrong = np.zeros(pairing.after.shape, dtype=bool)
    for axis, (offset, pulse) in enumerate(allowed.tolist()):
        size = np.abs(pairing.after[:, axis])
        beyond, off = size > max(offset, pulse) + EXACT, np.minimum(size, np.abs(size - offset)) > EXACT
        wrong[:, axis] = np.where(~pairing.jog | last, off, beyond | (off & (pulse == 0.0)))
    # A wrong shift lasts until it is taken back: it is told where it begins.
    begins = wrong & ~np.vstack([np.zeros((1, 3), dtype=bool), wrong])[:-1]
    for motion, axis in np.argwhere(begins).tolist():
        _tell_amount(case, pairing, motion, axis, *allowed[axis].tolist())


def _tell_amount(case: Case, pairing: Pairing, motion: int, axis: int, offset: float, pulse: float) -> None:
    line = int(case.compensated.motions.block[motion])
    got = millimetres(pairing.after[motion])
    if pulse:
        case.findings.add(
            "pulse", f"what {AXES[axis]} was moved by has not come back", compensated=line, got=got,
            expected=f"0 when the tool moves on, at most {pulse / MM:g} mm before",
        )  # fmt: skip
        return
    case.findings.add(
        "offset", f"{AXES[axis]} is shifted by something else than the declared offset", compensated=line,
        expected=f"-{offset / MM:g}, 0 or {offset / MM:g} mm" if offset else "0", got=got,
    )  # fmt: skip


def check_returns(case: Case, pairing: Pairing) -> None:
    """Before each break, and at the end of the program, nothing is added."""
    for mark in case.compensated.breaks:
        shift = pairing.after[mark.motion - 1] if mark.motion else np.zeros(3)
        if np.any(np.abs(shift) > EXACT):
            case.findings.add(
                "return", f"an axis is still shifted at this place: {mark.kind}", expected="0",
                compensated=min(mark.block, case.compensated.blocks - 1),
                got=millimetres(shift),
            )  # fmt: skip


def check_known(case: Case, pairing: Pairing) -> None:
    """In a hunk no axis is moved from an unknown position, but where the original does so itself."""
    number = max(case.lines.hunks.number, 1)
    moved = []
    for motions, hunk in (
        (case.original.motions, pairing.old_hunk),
        (case.compensated.motions, pairing.new_hunk),
    ):
        motion, axis = np.nonzero(
            np.isnan(motions.start) & ~np.isnan(motions.end) & (hunk != NO_HUNK)[:, None]
        )
        moved.append((motion, np.bincount(3 * hunk[motion] + axis, minlength=3 * number)))
    (_, old), (motion, new) = moved
    for place in np.flatnonzero(new > old).tolist():
        first = motion[pairing.new_hunk[motion] == place // 3][0]
        case.findings.add(
            "path", f"{AXES[place % 3]} is moved from where its position is not known",
            compensated=int(case.compensated.motions.block[first]),
        )  # fmt: skip


def check_stops(case: Case, pairing: Pairing, dwells: Dwells) -> None:
    """As many stops as the header says: added dwells with nothing but jogs between them are one stop."""
    motions = case.compensated.motions
    cutting = motions.block[~pairing.jog]
    passed = np.searchsorted(cutting, dwells.block)
    hunk = case.lines.new_hunk[dwells.block]
    stops = len(np.unique(np.stack([hunk, passed]), axis=1).T)
    case.findings.count("stops", stops)
    case.findings.count("hunks", case.lines.hunks.number)
    if case.declared.stops is not None and stops != case.declared.stops:
        case.findings.add(
            "count", "there are not as many stops as the header says",
            expected=str(case.declared.stops), got=str(stops),
        )  # fmt: skip
