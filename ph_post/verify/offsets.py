"""Check the offsets of the motions, and the feeds in changes.

Only declared amounts may be added, only where that is allowed, and they are taken back in time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ph_post.bounds import in_parts
from ph_post.compiling import compiled, read_only
from ph_post.dialects.planners import planner_of
from ph_post.gcode.program import ARC, AXES, CUBIC, NURBS, RAPID, Motions, PlaceArray, plane_columns, rows_where
from ph_post.gcode.working import travels, working_motions
from ph_post.types import Array, BoolArray, ExactPath, IntArray, Machine, unwritten
from ph_post.units import MM, MM_PER_MIN
from ph_post.verify.line_pairs import NO_CHANGE, VerifyCase
from ph_post.verify.pairing import EXACT, Pairing, declared_lengths, declared_sides, format_shifts
from ph_post.verify.states import Dwells
from ph_post.verify.stretches import Stretches, StretchSide
from ph_post.verify.verdict import FailureKind

_ROUNDING = 1e-4
"""Feeds may be above the original's by this part of themselves: their last digit."""

_TIMED = 0.01
"""The same under inverse time, where a feed is a length over a time, and lengths of arcs are rounded."""

_SLOWER = 0.02
"""A feed that is lower than the original's by this part of it is a dip, and not rounding."""

_NEAR = 1e-6
"""Shares of a stretch this close are the same place."""

_NOTHING = 1e-12
"""No length [m] is divided by that is smaller."""


def check_feeds(case: VerifyCase, found: Stretches) -> None:
    """Compare the feed of every cutting move in a change with the largest of the original's beside it."""
    run = found.new.stretch()
    mine = np.flatnonzero(np.diff(found.old.first)[run] > 0)
    bound = _feeds_beside(case, found, mine)
    feed = feeds_of(case.compensated.motions, found.new)[mine]
    spare = spare_feed(case, found.new)[mine]
    right = feed <= bound * (1.0 + spare)
    right |= np.isnan(feed) & np.isnan(bound)
    case.findings.count("feeds", mine.size)
    slower = np.flatnonzero(feed < bound * (1.0 - _SLOWER))
    if case.declared.dips == 0 and slower.size:
        block = case.compensated.motions.block[found.new.motion[mine[slower[0]]]]
        case.findings.add("count", "the feed dips, and the header declares no dip", compensated=int(block))
    for place in np.flatnonzero(~right).tolist():
        block = case.compensated.motions.block[found.new.motion[mine[place]]]
        case.findings.add(
            "feed",
            "the feed is above the original's",
            compensated=int(block),
            expected=f"<= {bound[place] / MM_PER_MIN:.6g} mm/min",
            got=f"{feed[place] / MM_PER_MIN:.6g} mm/min",
        )


def _feeds_beside(case: VerifyCase, found: Stretches, mine: IntArray) -> Array:
    """Largest feed of the original along each of the moves [m/s]."""
    run = found.new.stretch()[mine]
    low, high = (side[mine] for side in found.new.places())
    old_low, old_high = found.old.places()
    # Lengths differ by what the tolerance allows: a move does not count as beside what it only touches.
    reach = _NEAR + case.bound / np.maximum(found.new.totals()[run], case.bound)
    reach = np.minimum(reach, 0.25 * (high - low))
    begin, end = found.old.first[run], found.old.first[run + 1]
    first = np.clip(np.searchsorted(old_high, low + reach), begin, end - 1)
    last = np.clip(np.searchsorted(old_low, high - reach), first + 1, end)
    return largest_of(feeds_of(case.original.motions, found.old), first, last)


def spare_feed(case: VerifyCase, side: StretchSide) -> Array:
    """Part of itself by which the feed of each motion may be too large: rounding of its digits and its length."""
    timed = case.compensated.motions.duration[side.motion] > 0.0
    grid = 2.0 * MM * 10.0 ** -(case.declared.decimals if case.declared.decimals is not None else 0)
    return np.asarray(np.where(timed, _TIMED, _ROUNDING) + grid / np.maximum(side.length, _NOTHING))


def feeds_of(motions: Motions, side: StretchSide) -> Array:
    """Feed of each motion [m/s]; under inverse time, from its length."""
    timed = motions.duration[side.motion]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(timed > 0.0, side.length / timed, motions.feeds.of(side.motion)))


def largest_of(values: Array, first: IntArray, last: IntArray) -> Array:
    """Largest of the values in each of the ranges ``[first, last)``, none of which is empty."""
    if not first.size:
        return np.zeros(0)
    ends = np.column_stack([first, last]).ravel()
    return np.asarray(np.maximum.reduceat(np.append(values, -np.inf), ends)[::2])


def check_jogs(case: VerifyCase, alone: BoolArray, machine: Machine) -> None:
    """Check that every motion while the path rests has a feed that its axes can reach within their limits.

    With a laser whose power follows the speed (M4) it may have the feed of the cut before or behind it: at a lower one
    the same power would stay longer on the same place. With one at constant power (M3) the path need not rest at both
    ends of it: it may be as fast as its axes get from rest. Beside a cut at a feed that is not known it has that feed.
    """
    motions, jogs = case.compensated.motions, np.flatnonzero(alone)
    cuts = _cuts_beside(motions, alone, jogs)
    beside = _feeds_with_a_beam(case, cuts, jogs, machine)
    # A mill is under M3, too: its tool rests at both ends of a jog.
    burns = working_motions(case.original, machine.tool).tool == "laser"
    ways_to_speed = np.where(burns & _with_a_beam(case, "M3", jogs, machine), 2.0, 1.0)
    ways = np.nan_to_num(np.abs(motions.end[jogs] - motions.start[jogs]))
    timed = motions.duration[jogs]
    longest, total = np.argmax(ways, axis=1), np.linalg.norm(ways, axis=1)
    with np.errstate(divide="ignore"):
        along = np.where(timed > 0.0, total / timed, motions.feeds.of(jogs))
    unfed = np.isnan(along) & _unfed_beside(motions, cuts, jogs)
    for column, length in enumerate(ways.T):
        name, own = AXES[column], np.flatnonzero((longest == column) | (length > EXACT))
        if not own.size:
            continue
        feed = along * np.where(total > 0.0, length / np.where(total > 0.0, total, 1.0), 1.0)
        if name not in machine.axes:
            block = int(motions.block[jogs[own[0]]])
            case.findings.add("limits", f"the machine has no axis {name}", compensated=block)
            continue
        limits = machine.axes[name].limits
        most = np.minimum(
            limits.velocity, np.fmax(np.sqrt(ways_to_speed * limits.acceleration * length)[own], beside[own])
        )
        right = (feed[own] <= most * (1.0 + _ROUNDING)) | unfed[own]
        for place in np.flatnonzero(~right).tolist():
            case.findings.add(
                "limits",
                f"the jog of {name} is faster than the machine can be on its way",
                compensated=int(motions.block[jogs[own[place]]]),
                expected=f"<= {most[place] / MM_PER_MIN:.6g} mm/min",
                got=f"{feed[own[place]] / MM_PER_MIN:.6g} mm/min",
            )


def _cuts_beside(motions: Motions, alone: BoolArray, jogs: IntArray) -> tuple[IntArray, IntArray]:
    """Return the last cut before each of some motions that lie beside the path, and the first behind it.

    Where there is none on one side it is that on the other; nothing is returned of a program without cuts.
    """
    cuts = rows_where(~alone & (motions.kind != RAPID))
    behind = np.searchsorted(cuts, jogs.astype(np.int32))
    if not cuts.size:
        return cuts.astype(np.int64), cuts.astype(np.int64)
    before, after = cuts[np.maximum(behind - 1, 0)], cuts[np.minimum(behind, cuts.size - 1)]
    return before.astype(np.int64), after.astype(np.int64)


def _unfed_beside(motions: Motions, cuts: tuple[IntArray, IntArray], jogs: IntArray) -> BoolArray:
    """Mask of some motions (n,) beside a cut at a feed that is not known, in the same chain."""
    found = np.zeros(jogs.size, dtype=np.bool_)
    for near in cuts if cuts[0].size else ():
        unknown = np.isnan(motions.feeds.of(near)) & ~(motions.duration[near] > 0.0)
        found |= unknown & (motions.chain[near] == motions.chain[jogs])
    return found


def _feeds_with_a_beam(case: VerifyCase, cuts: tuple[IntArray, IntArray], jogs: IntArray, machine: Machine) -> Array:
    """Feed of the cut beside each of some motions (n,) [m/s], where a beam's power follows the speed; else 0."""
    if not cuts[0].size:
        return np.zeros(jogs.size)
    before, after = (np.nan_to_num(case.compensated.motions.feeds.of(near)) for near in cuts)
    return np.asarray(np.where(_with_a_beam(case, "M4", jogs, machine), np.maximum(before, after), 0.0))


def _with_a_beam(case: VerifyCase, order: str, jogs: IntArray, machine: Machine) -> BoolArray:
    """Mask of some motions (n,) with a laser on, perhaps, by M3 or M4."""
    program = case.compensated
    if machine.tool not in (None, "laser"):
        return np.zeros(jogs.size, dtype=np.bool_)
    lit = np.array([one.spindle == order and one.speed != 0.0 for one in program.modal], dtype=np.bool_)
    return np.asarray(lit[program.state[program.motions.block[jogs]]])


_ANGLE = 1e-9
"""Angles [rad] that differ by no more are the same."""

_TURN = 0.01
"""Nor do rounded places turn an arc by more [rad], however small it is."""

_RELATIVE = 1e-9
"""Feeds that differ by no more of themselves are the same."""


NumbersOf = Callable[[PlaceArray], Array]
"""Gives numbers of some motions."""


def check_pairs(case: VerifyCase, pairing: Pairing) -> None:
    """Motions that stand for each other are the same but for one shift, which only a way through the air may change."""
    one, other, (old, new) = case.original.motions, case.compensated.motions, pairing.pairs()
    places = tuple(map(read_only, (one.start, other.start, one.end, other.end)))
    changes, unknown = np.zeros(old.size, dtype=np.bool_), np.zeros(old.size, dtype=np.bool_)
    for axis in range(len(AXES)):
        shift = pairing.before(axis), read_only(pairing.after[:, axis])
        _changed_ends(places, shift, axis, old, new, (changes, unknown))
    faults: tuple[tuple[FailureKind, BoolArray, str], ...] = (
        ("path", one.kind[old] != other.kind[new], "the motion is of another kind"),
        ("path", unknown, "the position is known in one of the programs only"),
        ("path", _bent(case, pairing, old, new), "the arc is another one"),
        ("path", _bulged(case, pairing, old, new), "the spline is another one"),
        ("path", one.exact[old] != other.exact[new], "the path mode at its end is another one"),
        ("feed", _differ(one.feeds.of, other.feeds.of, old, new), "the feed of the motion is another one"),
        (
            "feed",
            _differ(one.duration.__getitem__, other.duration.__getitem__, old, new),
            "the time of the motion is another one",
        ),
        (
            "offset",
            (one.kind[old] != RAPID) & ~travels(case.original)[old] & changes,
            "the shift changes while the tool cuts",
        ),
    )
    for kind, wrong, what in faults:
        for first, second in zip(one.block[old[wrong]].tolist(), other.block[new[wrong]].tolist(), strict=True):
            case.findings.add(kind, what, original=first, compensated=second)


@compiled
def _changed_ends(places: Any, shift: Any, axis: Any, old: Any, new: Any, found: Any) -> None:
    """Mark the pairs (p,) in which the shift of an axis changes, and that have an end known in one alone."""
    old_start, new_start, old_end, new_end = places
    ((before, anew, begins), after), (changes, unknown), n = shift, found, 0
    for pair in range(old.size):
        one, other = old[pair], new[pair]
        while n < anew.size and anew[n] < other:
            n += 1
        begin = begins[n] if n < anew.size and anew[n] == other else before[other]
        changes[pair] |= abs(after[other] - begin) > EXACT
        unknown[pair] |= np.isnan(old_start[one, axis]) != np.isnan(new_start[other, axis])
        unknown[pair] |= np.isnan(old_end[one, axis]) != np.isnan(new_end[other, axis])


def _differ(one: NumbersOf, other: NumbersOf, old: PlaceArray, new: PlaceArray) -> BoolArray:
    """Mask of the pairs of motions whose numbers differ by more than rounding; two unknown ones do not."""
    found = np.empty(old.size, dtype=np.bool_)
    for part in in_parts(old.size):
        a, b = one(old[part]), other(new[part])
        found[part] = ~((np.abs(a - b) <= _RELATIVE * np.abs(a)) | (np.isnan(a) & np.isnan(b)))
    return found


def _bent(case: VerifyCase, pairing: Pairing, all_old: PlaceArray, all_new: PlaceArray) -> BoolArray:
    """Arcs of pairs (p,) whose plane, sweep or centre, less the shift, differ."""
    one, other = case.original.motions, case.compensated.motions
    both = np.flatnonzero((one.kind[all_old] == ARC) & (other.kind[all_new] == ARC))
    old, new = all_old[both], all_new[both]
    columns = plane_columns(one.plane[old])[:, :2]
    shift = np.take_along_axis(pairing.after[new], columns, axis=1)
    radius = np.linalg.norm(np.take_along_axis(one.start[old], columns, axis=1) - one.center[old], axis=1)
    # The last decimals of a place turn the end of a small arc.
    same = np.maximum(_ANGLE, EXACT / np.maximum(radius, EXACT / _TURN))
    wrong = np.zeros(all_old.size, dtype=bool)
    wrong[both] = (
        (one.plane[old] != other.plane[new])
        | (np.abs(one.angle[old] - other.angle[new]) > same)
        | np.any(np.abs(other.center[new] - shift - one.center[old]) > EXACT, axis=1)
    )
    return wrong


def _bulged(case: VerifyCase, pairing: Pairing, all_old: PlaceArray, all_new: PlaceArray) -> BoolArray:
    """Splines of pairs (p,) whose control points, less the shift, or weights differ."""
    one, other = case.original.motions, case.compensated.motions
    wrong = np.zeros(all_old.size, dtype=bool)
    curves = np.isin(one.kind[all_old], (CUBIC, NURBS))
    for place in np.flatnonzero(curves & (one.kind[all_old] == other.kind[all_new])).tolist():
        old, new, shift = int(all_old[place]), int(all_new[place]), pairing.after[all_new[place]]
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


def check_amounts(case: VerifyCase, pairing: Pairing) -> None:
    """While the tool moves every axis carries a declared offset, or none.

    A backlash take-up move lasts only while it stands, or from a rapid to the approach behind it. What is
    carried inside a crossing its own check follows.
    """
    sizes, sides = declared_lengths(case.declared), declared_sides(case.declared)
    change = pairing.new_change
    last = np.append(change[1:] != change[:-1], True)[: change.size] & (change != NO_CHANGE)
    before = _before_approach(case, pairing)
    found: list[tuple[int, int]] = []
    for axis in range(len(AXES)):
        offset, pulse = sizes.get(axis, (0.0, 0.0))
        wrong = np.zeros(change.size, dtype=np.bool_)
        for part in in_parts(change.size):
            after = pairing.after[part, axis]
            carried = np.abs(after)
            off = carried > EXACT
            for value in sides.get(axis, ()):
                off &= np.abs(after - value) > EXACT
            beyond = carried > max(offset, pulse) + EXACT
            wrong[part] = np.where(~pairing.jog[part] | last[part], off, beyond | (off & (pulse == 0.0)))
            wrong[part] &= ~(before[part, axis] & (carried <= pulse + offset + EXACT))
        wrong[pairing.crossed & ~pairing.closing] = False
        # A wrong shift lasts until it is taken back: it is reported where it begins.
        begins = wrong & ~np.append(False, wrong)[:-1]
        found += [(motion, axis) for motion in np.flatnonzero(begins).tolist()]
    for motion, axis in sorted(found):
        _report_amount(case, pairing, motion, axis)


def _before_approach(case: VerifyCase, pairing: Pairing) -> BoolArray:
    """Mask (k, 3) of the rapids and approaches at whose ends an axis waits for its own approach."""
    motions, approach = case.compensated.motions, pairing.approach
    found = unwritten(pairing.after.shape, np.bool_)
    for motion in np.flatnonzero(approach).tolist():
        axis = int(np.argmax(np.nan_to_num(np.abs(motions.end[motion] - motions.start[motion]))))
        first = motion - 1
        while first > 0 and approach[first]:
            first -= 1
        found[first:motion, axis] = True
    return found


def check_approaches(case: VerifyCase, pairing: Pairing) -> None:
    """Check that an approach takes up the whole backlash towards the side whose offset it leaves.

    Z comes from above. What is only taken back needs nothing, nor what goes onto the other side first: of several
    moves of an axis, one behind the other, the last counts.
    """
    motions, sides = case.compensated.motions, declared_sides(case.declared)
    approaches = np.flatnonzero(pairing.approach)
    ways = np.nan_to_num(motions.end[approaches] - motions.start[approaches])
    axes = np.abs(ways).argmax(axis=1)
    goes_on = np.append((np.diff(approaches) == 1) & (np.diff(axes) == 0), False)[: axes.size]
    for motion, way, axis, more in zip(approaches.tolist(), ways, axes.tolist(), goes_on.tolist(), strict=True):
        low, high = sides[axis]
        left = pairing.after[motion, axis]
        side = 1.0 if abs(left - high) <= EXACT else -1.0 if abs(left - low) <= EXACT else 0.0
        block = int(motions.block[motion])
        taken = min(abs(left - way[axis] - value) for value in (low, 0.0, high)) <= EXACT
        if abs(left) <= EXACT and taken:
            continue
        if way[axis] * side < high - low - EXACT and not more:
            case.findings.add(
                "pulse",
                f"the approach of {AXES[axis]} does not take up its backlash",
                compensated=block,
                expected=f">= {(high - low) / MM:.6g} mm towards {'+' if side > 0.0 else '-'}" if side else "an offset",
                got=f"{way[axis] / MM:.6g} mm",
            )
        if AXES[axis] == "Z" and left - way[axis] < low - EXACT:
            case.findings.add(
                "pulse",
                "the rapid before the approach of Z goes lower than the original's",
                compensated=block,
                expected=f">= {low / MM:g} mm",
                got=f"{(left - way[axis]) / MM:.6g} mm",
            )


def _carried(low: float, high: float) -> str:
    """Write the amounts that an axis may carry for a message."""
    if low == high:
        return "0"
    if low < 0.0 < high:
        return f"{low / MM:g}, 0 or {high / MM:g} mm"
    return f"0 or {(high or low) / MM:g} mm"


def _report_amount(case: VerifyCase, pairing: Pairing, motion: int, axis: int) -> None:
    line = int(case.compensated.motions.block[motion])
    got = format_shifts(pairing.after[motion])
    _, pulse = declared_lengths(case.declared).get(axis, (0.0, 0.0))
    if pulse and not pairing.crossed[motion]:
        case.findings.add(
            "pulse",
            f"the take-up move of {AXES[axis]} is not taken back",
            compensated=line,
            got=got,
            expected=f"0 when the tool moves on, at most {pulse / MM:g} mm before",
        )
        return
    case.findings.add(
        "offset",
        f"{AXES[axis]} is shifted by something other than the declared offset",
        compensated=line,
        expected=_carried(*declared_sides(case.declared).get(axis, (0.0, 0.0))),
        got=got,
    )


def check_returns(case: VerifyCase, pairing: Pairing) -> None:
    """Before each break, and at the end of the program, nothing is added."""
    for mark in case.compensated.breaks:
        shift = pairing.after[mark.motion - 1] if mark.motion else np.zeros(3)
        if np.any(np.abs(shift) > EXACT):
            case.findings.add(
                "return",
                f"an axis is still shifted at this place: {mark.kind}",
                expected="0",
                compensated=min(mark.block, case.compensated.blocks - 1),
                got=format_shifts(shift),
            )


def check_known(case: VerifyCase, pairing: Pairing) -> None:
    """In a change no axis is moved from an unknown position, but where the original does so itself."""
    number = max(case.lines.changes.number, 1)
    moved = []
    for motions, change in (
        (case.original.motions, pairing.old_change),
        (case.compensated.motions, pairing.new_change),
    ):
        motion, axis = np.nonzero(np.isnan(motions.start) & ~np.isnan(motions.end) & (change != NO_CHANGE)[:, None])
        moved.append((motion, np.bincount(3 * change[motion].astype(np.int64) + axis, minlength=3 * number)))
    (_, old), (motion, new) = moved
    for place in np.flatnonzero(new > old).tolist():
        first = motion[pairing.new_change[motion] == place // 3][0]
        case.findings.add(
            "path",
            f"{AXES[place % 3]} is moved from where its position is not known",
            compensated=int(case.compensated.motions.block[first]),
        )


def check_standstills(case: VerifyCase, dwells: Dwells, machine: Machine) -> None:
    """Check that no dwell of no length is to hold moves apart on a controller that rounds joints."""
    if isinstance(planner_of(machine), ExactPath):
        return
    for block in dwells.block[dwells.duration == 0.0].tolist():
        case.findings.add("jog", "the controller may round the moves about a dwell of no length", compensated=block)


def check_stops(case: VerifyCase, pairing: Pairing, dwells: Dwells) -> None:
    """As many stops as the header says: added dwells and approaches with nothing but jogs between them are one stop."""
    motions = case.compensated.motions
    cutting = motions.block[~pairing.jog]
    block = np.append(dwells.block, motions.block[pairing.approach])
    passed = np.searchsorted(cutting, block)
    change = case.lines.new_change[block]
    stops = len(np.unique(np.stack([change, passed]), axis=1).T)
    case.findings.count("stops", stops)
    case.findings.count("changes", case.lines.changes.number)
    if case.declared.stops is not None and stops != case.declared.stops:
        case.findings.add(
            "count",
            "the number of stops is not the declared one",
            expected=str(case.declared.stops),
            got=str(stops),
        )
