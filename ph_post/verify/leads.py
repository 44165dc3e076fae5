"""Check stretches with the lead of the servos: chords that stay as near the original as the header declares.

That the lead is right is not for the text to show: it depends on the drives, and on the feed override. What can be
checked is that a stretch begins and ends where the original does, goes along it in its order, no farther from it than
declared, in straight moves, none of which asks more of an axis than it can do.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ph_post.gcode.program import AXES, LINE
from ph_post.types import Machine
from ph_post.units import MM, MM_PER_MIN
from ph_post.verify.line_pairs import VerifyCase
from ph_post.verify.pairing import EXACT
from ph_post.verify.polylines import first_unreached, polylines
from ph_post.verify.stretches import Stretches, StretchSide

_FINE: Final = 20.0
"""Chords stand in for arcs within this part of what is declared, and the bound is widened by as much."""

_ROUNDING: Final = 0.01
"""Part of a limit that the rounding of F and of a short chord may take."""


def check_leads(case: VerifyCase, found: Stretches, machine: Machine | None = None) -> None:
    """Hold the stretches that are led to what the header declares.

    Parameters
    ----------
    case : VerifyCase
    found : Stretches
        Of the changes whose marks name a lead.
    machine : Machine, optional
        Its limits of speed are kept.
    """
    case.findings.count("led", found.change.size)
    marked = int(case.lines.changes.led.sum())
    if marked != case.declared.led:
        case.findings.add(
            "count",
            "the stretches that are led are not as many as declared",
            compensated=case.declared.first,
            expected=str(case.declared.led),
            got=str(marked),
        )
    if not found.change.size:
        return
    _check_ends(case, found)
    _check_distance(case, found)
    if machine is not None:
        _check_speeds(case, found, machine)


def _check_ends(case: VerifyCase, found: Stretches) -> None:
    """Every stretch is straight moves, and begins and ends where the original does."""
    one, other = case.original.motions, case.compensated.motions
    for place in range(found.change.size):
        old, new = (side.motion[side.first[place] : side.first[place + 1]] for side in (found.old, found.new))
        marker = int(case.lines.changes.marker[found.change[place]])
        if not (old.size and new.size):
            case.findings.add("path", "a stretch that is led stands for no motion", compensated=marker)
            continue
        bent = np.flatnonzero(other.kind[new] != LINE)
        if bent.size:
            block = int(other.block[new[bent[0]]])
            case.findings.add("path", "a stretch that is led has more than straight moves", compensated=block)
        apart = (
            np.nan_to_num(other.start[new[0]] - one.start[old[0]]),
            np.nan_to_num(other.end[new[-1]] - one.end[old[-1]]),
        )
        for words, gap, block in (("begins", apart[0], new[0]), ("ends", apart[1], new[-1])):
            if np.abs(gap).max() > EXACT:
                case.findings.add(
                    "path",
                    f"a stretch that is led {words} elsewhere than the original",
                    compensated=int(other.block[block]),
                    expected="0",
                    got=f"{np.linalg.norm(gap) / MM:.6g} mm",
                )


def _check_distance(case: VerifyCase, found: Stretches) -> None:
    """No stretch is farther from the original, in order of travel, than declared."""
    both = (np.diff(found.old.first) > 0) & (np.diff(found.new.first) > 0)
    found = found.take(both)
    if not found.change.size:
        return
    bound = max(case.declared.lead, EXACT)
    sagitta = bound / _FINE
    sides = ((case.original.motions, found.old), (case.compensated.motions, found.new))
    traces = [polylines(motions, side.motion, sagitta) for motions, side in sides]
    firsts = [trace.first[side.first] for trace, (_, side) in zip(traces, sides, strict=True)]
    points = [np.nan_to_num(trace.points) for trace in traces]
    most = np.full(found.change.size, bound + 2.0 * sagitta)
    stuck = first_unreached(points[0], firsts[0], points[1], firsts[1], most)
    owner = np.repeat(found.new.motion, np.diff(traces[1].first))
    for place in np.flatnonzero(stuck >= 0).tolist():
        at = min(int(firsts[1][place] + stuck[place]), int(firsts[1][place + 1]) - 1)
        case.findings.add(
            "path",
            "a stretch that is led leaves the original farther than declared",
            compensated=int(case.compensated.motions.block[owner[at]]),
            expected=f"<= {case.declared.lead / MM:.6g} mm",
        )


def _check_speeds(case: VerifyCase, found: Stretches, machine: Machine) -> None:
    """No move of a stretch is faster than an axis of the machine may be."""
    side: StretchSide = found.new
    motions = case.compensated.motions
    way = np.nan_to_num(motions.end[side.motion] - motions.start[side.motion])
    length = np.linalg.norm(way, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = np.nan_to_num(np.abs(way) / length[:, None]) * motions.feeds.of(side.motion)[:, None]
    for column, name in enumerate(AXES):
        if name not in machine.axes:
            continue
        limit = machine.axes[name].limits.velocity
        for row in np.flatnonzero(speed[:, column] > limit * (1.0 + _ROUNDING)).tolist()[:1]:
            case.findings.add(
                "limits",
                f"a move of a stretch that is led is faster than {name} may be",
                compensated=int(motions.block[side.motion[row]]),
                expected=f"<= {limit / MM_PER_MIN:.6g} mm/min",
                got=f"{speed[row, column] / MM_PER_MIN:.6g} mm/min",
            )
