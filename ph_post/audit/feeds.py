"""Feeds in hunks: never above the original's at that place, and jogs no faster than the machine."""

from __future__ import annotations

import numpy as np

from ph_post.audit.case import Case
from ph_post.audit.pairing import Pairing
from ph_post.audit.stretches import Side, Stretches
from ph_post.gcode.reader.record import AXES, Motions
from ph_post.types import Array, IntArray, Machine
from ph_post.units import MM, MM_PER_MIN

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


def check_feeds(case: Case, found: Stretches) -> None:
    """Compare the feed of every cutting move in a hunk with the largest of the original's beside it."""
    run = found.new.stretch()
    mine = np.flatnonzero(np.diff(found.old.first)[run] > 0)
    bound = _feeds_beside(case, found, mine)
    feed = _feeds(case.compensated.motions, found.new)[mine]
    grid = 2.0 * MM * 10.0 ** -(case.declared.decimals if case.declared.decimals is not None else 0)
    timed = case.compensated.motions.duration[found.new.motion[mine]] > 0.0
    spare = np.where(timed, _TIMED, _ROUNDING) + grid / np.maximum(found.new.length[mine], _NOTHING)
    right = feed <= bound * (1.0 + spare)
    right |= np.isnan(feed) & np.isnan(bound)
    case.findings.count("feeds", mine.size)
    slower = np.flatnonzero(feed < bound * (1.0 - _SLOWER))
    if case.declared.dips == 0 and slower.size:
        block = case.compensated.motions.block[found.new.motion[mine[slower[0]]]]
        case.findings.add("count", "the feed dips, and the header tells of no dip", compensated=int(block))
    for place in np.flatnonzero(~right).tolist():
        block = case.compensated.motions.block[found.new.motion[mine[place]]]
        case.findings.add(
            "feed", "the feed is above the original's", compensated=int(block),
            expected=f"<= {bound[place] / MM_PER_MIN:.6g} mm/min",
            got=f"{feed[place] / MM_PER_MIN:.6g} mm/min",
        )  # fmt: skip


def _feeds_beside(case: Case, found: Stretches, mine: IntArray) -> Array:
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
    return _largest(_feeds(case.original.motions, found.old), first, last)


def _feeds(motions: Motions, side: Side) -> Array:
    """Feed of each motion [m/s]; under inverse time, from its length."""
    timed = motions.duration[side.motion]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(timed > 0.0, side.length / timed, motions.feed[side.motion]))


def _largest(values: Array, first: IntArray, last: IntArray) -> Array:
    """Largest of the values in each of the ranges ``[first, last)``, none of which is empty."""
    if not first.size:
        return np.zeros(0)
    ends = np.column_stack([first, last]).ravel()
    return np.asarray(np.maximum.reduceat(np.append(values, -np.inf), ends)[::2])


def check_jogs(case: Case, pairing: Pairing, machine: Machine) -> None:
    """Demand of every jog a feed that its axis can reach on its way, inside its limits."""
    motions, jogs = case.compensated.motions, np.flatnonzero(pairing.jog)
    ways = np.nan_to_num(np.abs(motions.end[jogs] - motions.start[jogs]))
    timed = motions.duration[jogs]
    axis, length = np.argmax(ways, axis=1), np.max(ways, axis=1, initial=0.0)
    with np.errstate(divide="ignore"):
        feed = np.where(timed > 0.0, length / timed, motions.feed[jogs])
    for column in np.unique(axis).tolist():
        name, own = AXES[column], np.flatnonzero(axis == column)
        if name not in machine.axes:
            block = int(motions.block[jogs[own[0]]])
            case.findings.add("limits", f"the machine has no axis {name}", compensated=block)
            continue
        limits = machine.axes[name].limits
        most = np.minimum(limits.velocity, np.sqrt(limits.acceleration * length[own]))
        for place in np.flatnonzero(~(feed[own] <= most * (1.0 + _ROUNDING))).tolist():
            case.findings.add(
                "limits", f"the jog of {name} is faster than the machine can be on its way",
                compensated=int(motions.block[jogs[own[place]]]),
                expected=f"<= {most[place] / MM_PER_MIN:.6g} mm/min",
                got=f"{feed[own[place]] / MM_PER_MIN:.6g} mm/min",
            )  # fmt: skip
