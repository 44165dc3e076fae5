"""Feeds in hunks: never above the original's at that place, and jogs no faster than the machine."""

from __future__ import annotations

import numpy as np

from ph_post.audit.case import Case
from ph_post.audit.pairing import AXES, Pairing
from ph_post.audit.stretches import Side, Stretches
from ph_post.gcode.reader.record import Motions
from ph_post.types import Array, IntArray, Machine
from ph_post.units import MM, MM_PER_MIN

_ROUNDING = 1e-4
"""Feeds may be above the original's by this part of themselves: their last digit."""

_SLOWER = 0.02
"""A feed that is lower than the original's by this part of it is a dip, and not rounding."""

_NEAR = 1e-6
"""Shares of a stretch this close are the same place."""

_NOTHING = 1e-12
"""No length [m] is divided by that is smaller."""


def check_feeds(case: Case, found: Stretches) -> None:
    """Compare the feed of every cutting move in a hunk with the largest of the original's beside it."""
    run = _stretch_of(found.new)
    mine = np.flatnonzero(np.diff(found.old.first)[run] > 0)
    bound = _feeds_beside(case, found, mine)
    feed = _feeds(case.compensated.motions, found.new)[mine]
    grid = 2.0 * MM * 10.0 ** -(case.declared.decimals if case.declared.decimals is not None else 0)
    right = feed <= bound * (1.0 + _ROUNDING + grid / np.maximum(found.new.length[mine], _NOTHING))
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
    low, high = (side[mine] for side in _places(found.new))
    old_low, old_high = _places(found.old)
    total = np.maximum(_totals(found.new)[_stretch_of(found.new)[mine]], case.bound)
    # Lengths differ by what the tolerance allows: a move does not count as beside what it only touches.
    reach = np.minimum(_NEAR + case.bound / total, 0.25 * (high - low))
    first = np.searchsorted(old_high, low + reach)
    last = np.searchsorted(old_low, high - reach)
    feeds = _feeds(case.original.motions, found.old)
    return _largest(feeds, np.minimum(first, feeds.size - 1), last)


def _stretch_of(side: Side) -> IntArray:
    """Return the number of the stretch of each motion."""
    return np.repeat(np.arange(side.first.size - 1), np.diff(side.first))


def _totals(side: Side) -> Array:
    """Length of each stretch [m]."""
    return np.asarray(
        np.bincount(_stretch_of(side), weights=side.length, minlength=side.first.size - 1), dtype=np.float64
    )


def _places(side: Side) -> tuple[Array, Array]:
    """Where each motion begins and ends: number of its stretch and share of that stretch's length."""
    run = _stretch_of(side)
    if not run.size:
        return np.zeros(0), np.zeros(0)
    total = np.maximum(_totals(side), _NOTHING)[run]
    sums = np.cumsum(side.length)
    begins = np.append(0.0, sums)[side.first[:-1]][run]
    high = (sums - begins) / total
    return run + np.clip(high - side.length / total, 0.0, 1.0), run + np.clip(high, 0.0, 1.0)


def _feeds(motions: Motions, side: Side) -> Array:
    """Feed of each motion [m/s]; under inverse time, from its length."""
    timed = motions.duration[side.motion]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(timed > 0.0, side.length / timed, motions.feed[side.motion]))


def _largest(values: Array, first: IntArray, last: IntArray) -> Array:
    """Largest of the values in each of the ranges ``[first, last)``, of one value at least."""
    if not first.size:
        return np.zeros(0)
    last = np.maximum(last, first + 1)
    ends = np.column_stack([first, last]).ravel()
    return np.asarray(np.maximum.reduceat(np.append(values, -np.inf), ends)[::2])


def check_jogs(case: Case, pairing: Pairing, machine: Machine) -> None:
    """Demand of every jog a feed that its axis can reach on its way, inside its limits."""
    motions = case.compensated.motions
    for motion in np.flatnonzero(pairing.jog).tolist():
        way = np.nan_to_num(np.abs(motions.end[motion] - motions.start[motion]))
        name, block = AXES[int(np.argmax(way))], int(motions.block[motion])
        if name not in machine.axes:
            case.findings.add("limits", f"the machine has no axis {name}", compensated=block)
            continue
        limits, length, timed = machine.axes[name].limits, float(way.max()), motions.duration[motion]
        feed = length / timed if timed > 0.0 else motions.feed[motion]
        most = min(limits.velocity, float(np.sqrt(limits.acceleration * length)))
        if not feed <= most * (1.0 + _ROUNDING):
            case.findings.add(
                "limits", f"the jog of {name} is faster than the machine can be on its way",
                compensated=block, expected=f"<= {most / MM_PER_MIN:.6g} mm/min",
                got=f"{feed / MM_PER_MIN:.6g} mm/min",
            )  # fmt: skip
