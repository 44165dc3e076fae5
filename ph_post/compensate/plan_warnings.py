"""Warnings of a plan, in words and figures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ph_post.compensate.layout import Layout
from ph_post.compensate.limit_curve import UNBOUNDED, LimitCurve
from ph_post.compensate.violations import runs
from ph_post.drive.axes import backlash_varies
from ph_post.types import Array, Axis, Machine
from ph_post.units import MM, MM_PER_MIN

_MOST = 12
"""Warnings of one sort that are told one by one."""

_NUMBERS = 8
"""Numbers listed in one warning."""

_ROOM = 0.05
"""Part by which a slowdown that is named is more than what was counted."""


def stops(corners: Array, cusps: Array, infinite: Array, rapids: Array) -> list[str]:
    """Where a motion that was to keep its feed stops all the same."""
    kinds = (
        (corners, "a sharp corner", "sharp corners"),
        (cusps, "a cusp", "cusps"),
        (infinite, "a place of infinite curvature", "places of infinite curvature"),
        (rapids, "an end of a rapid segment", "ends of rapid segments"),
    )
    return [
        f"the motion stops at {one if s.size == 1 else f'{s.size} {many}'} ({_places(s)})"
        for s, one, many in kinds
        if s.size
    ]


def slow_stretches(caps: LimitCurve) -> list[str]:
    """Where the axes' limits keep the feed below the programmed one."""
    slow = (caps.soft < caps.programmed * (1.0 - 1e-9)) & (caps.programmed < UNBOUNDED)
    found = runs(np.flatnonzero(slow))
    if not found:
        return []
    length = sum(float(caps.s[run[-1]] - caps.s[run[0]]) for run in found)
    lowest = int(np.argmin(np.where(slow, caps.soft, np.inf)))
    places = "one place" if len(found) == 1 else f"{len(found)} places"
    return [
        f"the limits of the axes keep the feed below the programmed one at {places}, {length / MM:.6g} mm of "
        f"{caps.s[-1] / MM:.6g} mm in all: down to {caps.soft[lowest] / MM_PER_MIN:.6g} mm/min at "
        f"{caps.s[lowest] / MM:.6g} mm along the path"
    ]


def slowed(caps: LimitCurve, factor: Array) -> list[str]:
    """Where the feed had to be lowered because samples broke a limit."""
    found = runs(np.flatnonzero(factor < 1.0))
    lines = [
        f"feed lowered by up to {100.0 * (1.0 - factor[run].min()):.2g} % from {caps.s[run[0]] / MM:.6g} mm "
        f"to {caps.s[run[-1]] / MM:.6g} mm along the path, where samples broke a limit"
        for run in found[:_MOST]
    ]
    return lines if len(found) <= _MOST else [*lines, f"{len(found) - _MOST} more stretches with lowered feed"]


def lasting_offsets(machine: Machine, layout: Layout) -> list[str]:
    """Whether the table has to stay on a flank by itself, which only friction sees to."""
    shifted = {name for name, offset in layout.bias.items() if offset}
    shifted |= {one.axis for one in layout.crossings if not machine.axes[one.axis].loop.encloses_backlash}
    return [*friction_words(shifted), *varying_words(machine.axes[name] for name in sorted(shifted))]


def stops_cost(axes: Sequence[str], time: float, part: float) -> str:
    """Say of axes that carry no lasting offset what all stops would cost [s], and as a part of the time.

    Examples
    --------
    >>> stops_cost(["X"], 0.605, 0.156)
    'axis X carries no lasting offset: all stops would cost 0.605 s; --max-slowdown 0.16 would allow them'
    """
    who = f"axis {axes[0]} carries" if len(axes) == 1 else f"axes {', '.join(axes)} carry"
    return (
        f"{who} no lasting offset: all stops would cost {time:.3g} s; --max-slowdown {round_up(part):g} would"
        " allow them"
    )


def round_up(fraction: float) -> float:
    """Round a fraction up to two digits, with some room.

    Examples
    --------
    >>> round_up(0.156)
    0.16
    """
    return float(f"{fraction * (1.0 + _ROOM):.1e}")


def friction_words(shifted: Iterable[str]) -> list[str]:
    """Say of axes with a lasting offset that only friction holds the table on its flank."""
    names = sorted(shifted)
    if not names:
        return []
    who = f"axis {names[0]} counts" if len(names) == 1 else f"axes {', '.join(names)} count"
    return [
        f"{who} on friction for the lasting offset, to hold the table on its flank: a cutter that pulls the "
        "table along, as in climb milling, can pull it across the gap"
    ]


def varying_words(axes: Iterable[Axis]) -> list[str]:
    """Say of axes with their gap behind the loop that it changes on the way, and the offset does not."""
    return [
        f"the gap of axis {axis.name} changes along its travel, and its lasting offset does not"
        for axis in axes
        if not axis.loop.encloses_backlash and backlash_varies(axis)
    ]


def about_points(said: Iterable[tuple[Sequence[int], str]]) -> list[str]:
    """Gather equal words about turning points; what is left of very many is counted.

    Examples
    --------
    >>> about_points([([0], "too short"), ([2, 3], "too short"), ([1], "left alone")])
    ['turning points #0, #2, #3: too short', 'turning point #1: left alone']
    """
    gathered: dict[str, list[int]] = {}
    for indices, text in said:
        gathered.setdefault(text, []).extend(indices)
    lines = [f"turning point{'s' * (len(who) > 1)} {_numbers(who)}: {text}" for text, who in gathered.items()]
    left = len(lines) - _MOST
    return lines if left <= 0 else [*lines[:_MOST], f"{left} more warnings about turning points like these"]


def _numbers(indices: Sequence[int]) -> str:
    shown = ", ".join(f"#{index}" for index in indices[:_NUMBERS])
    return shown + (f" and {len(indices) - _NUMBERS} more" if len(indices) > _NUMBERS else "")


def _places(s: Array) -> str:
    shown = ", ".join(f"{value / MM:.6g} mm" for value in s[:_NUMBERS].tolist())
    return shown + (f" and {s.size - _NUMBERS} more" if s.size > _NUMBERS else "")
