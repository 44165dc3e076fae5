"""Warnings of a plan, in words and figures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np

from ph_post.compensate.friction import braked
from ph_post.compensate.layout import Layout
from ph_post.compensate.limit_curve import UNBOUNDED, LimitCurve
from ph_post.compensate.offsets import lead_in, may_shift
from ph_post.drive.axes import backlash_varies
from ph_post.geometry.numeric import runs
from ph_post.quantities import millimetres
from ph_post.types import Array, Axis, Machine, Tool
from ph_post.units import MICROMETRE, MM, MM_PER_MIN

_MOST = 12
"""Warnings of one kind that are listed one by one."""

_NUMBERS = 8
"""Numbers listed in one warning."""

_ROOM = 0.05
"""Relative margin of a slowdown that a warning suggests."""


SAFE: Final = 0.9
"""Part of the acceleration at which a table runs on that is advised."""

PASSED_SLOWER: Final = "passed with less feed for their error"
"""Stands in the warning of turning points whose error less feed makes smaller."""


def stop_warnings(corners: Array, cusps: Array, infinite: Array, rapids: Array) -> list[str]:
    """Warn of places where a motion that was to keep its feed stops."""
    kinds = (
        (corners, "a sharp corner", "sharp corners"),
        (cusps, "a cusp", "cusps"),
        (infinite, "a place of infinite curvature", "places of infinite curvature"),
        (rapids, "an end of a rapid segment", "ends of rapid segments"),
    )
    return [
        f"the motion stops at {one if s.size == 1 else f'{s.size} {many}'} "
        f"({_listed([f'{place / MM:.6g} mm' for place in s.tolist()])})"
        for s, one, many in kinds
        if s.size
    ]


def slow_feed_warnings(caps: LimitCurve) -> list[str]:
    """Warn of stretches where the axes' limits keep the feed below the programmed one."""
    slow = (caps.soft < caps.programmed * (1.0 - 1e-9)) & (caps.programmed < UNBOUNDED)
    found = runs(np.flatnonzero(slow))
    if not found:
        return []
    length = sum(float(caps.s[run[-1]] - caps.s[run[0]]) for run in found)
    share = f", {millimetres(length)} mm of {millimetres(float(caps.s[-1]))} mm in all" if length > 0.0 else ""
    lowest = int(np.argmin(np.where(slow, caps.soft, np.inf)))
    places = "one place" if len(found) == 1 else f"{len(found)} places"
    return [
        f"the limits of the axes keep the feed below the programmed one at {places}{share}: down to "
        f"{caps.soft[lowest] / MM_PER_MIN:.0f} mm/min at {millimetres(float(caps.s[lowest]))} mm along the path"
    ]


def lowered_feed_warnings(caps: LimitCurve, factor: Array) -> list[str]:
    """Warn of stretches where the feed was lowered because samples broke a limit."""
    found = runs(np.flatnonzero(factor < 1.0))
    lines = [
        f"feed lowered by up to {100.0 * (1.0 - factor[run].min()):.2g} % from {caps.s[run[0]] / MM:.6g} mm "
        f"to {caps.s[run[-1]] / MM:.6g} mm along the path, where samples broke a limit"
        for run in found[:_MOST]
    ]
    return lines if len(found) <= _MOST else [*lines, f"{len(found) - _MOST} more stretches with lowered feed"]


def room_warnings(caps: LimitCurve, factor: Array) -> list[str]:
    """Warn of stretches where the feed is lowered so that the command can lead the path."""
    found = runs(np.flatnonzero(factor < 1.0))
    if not found:
        return []
    length = sum(float(caps.s[run[-1]] - caps.s[run[0]]) for run in found)
    places = "one place" if len(found) == 1 else f"{len(found)} places"
    return [
        f"feed lowered by up to {100.0 * (1.0 - factor.min()):.2g} % at {places}, {length / MM:.4g} mm of "
        f"{caps.s[-1] / MM:.6g} mm in all, so that the command with its inverse dynamics keeps the limits"
    ]


def passing_warnings(ratios: Sequence[float]) -> list[str]:
    """Say with which parts of their feed turning points are passed.

    Examples
    --------
    >>> passing_warnings([1.0, 0.8, 0.553])
    ['2 turning points are passed with less feed for their error, down to 55 % of it']
    """
    slow = [one for one in ratios if one < 1.0]
    if not slow:
        return []
    who = "one turning point is" if len(slow) == 1 else f"{len(slow)} turning points are"
    return [f"{who} {PASSED_SLOWER}, down to {100.0 * min(slow):.2g} % of it"]


def lead_time_warning(part: float, time: float, slowdown: float) -> str:
    """Warn of inverse dynamics that is a part of what it should be, as all of it would add some time [s].

    Examples
    --------
    >>> lead_time_warning(0.5, 1.25, 0.2)
    'inverse dynamics leads by 50 % of what the servo lags: all of it would add 1.25 s; --max-slowdown 0.21 allows it'
    """
    return (
        f"inverse dynamics leads by {100.0 * part:.2g} % of what the servo lags: all of it would add {time:.3g} s; "
        f"--max-slowdown {round_up(slowdown):g} allows it"
    )


def no_room_warning(time: float, slowdown: float) -> str:
    """Warn of a motion that is as quick as without inverse dynamics, as room for that would add some time [s].

    Examples
    --------
    >>> no_room_warning(0.18, 0.06)
    'the time allowed leaves no room for inverse dynamics: that would add 0.18 s; --max-slowdown 0.063 allows it'
    """
    return (
        f"the time allowed leaves no room for inverse dynamics: that would add {time:.3g} s; "
        f"--max-slowdown {round_up(slowdown):g} allows it"
    )


def lost_lead_warning(lost: float, places: int, worst: float) -> str:
    """Warn of places where the command has no room for its inverse dynamics: how much is missing [m], and where [m].

    Examples
    --------
    >>> lost_lead_warning(3.21e-6, 2, 0.01)
    'inverse dynamics is reduced at 2 places for the limits of the axes, by up to 3.2 µm at 10 mm along the path'
    """
    count = "one place" if places == 1 else f"{places} places"
    return (
        f"inverse dynamics is reduced at {count} for the limits of the axes, by up to {lost / MICROMETRE:.2g} µm "
        f"at {worst / MM:.6g} mm along the path"
    )


def offset_warnings(machine: Machine, layout: Layout) -> list[str]:
    """Warn of axes with a lasting offset: friction has to hold the table on its side, and backlash may vary."""
    shifted = {name for name, offset in layout.bias.items() if offset}
    shifted |= {one.axis for one in layout.crossings if not machine.axes[one.axis].loop.encloses_backlash}
    begin = lead_in(layout.phases, layout.crossings)
    return [
        *lead_in_warnings(begin, [one.axis for one in layout.crossings if one.start == 0.0]),
        *friction_warnings(shifted, machine.tool or "cutter"),
        *side_warnings(machine.axes[name] for name in sorted(shifted)),
    ]


WIDE: Final = 1.0 * MM
"""Lost motion [m] beyond which a machine file is doubted."""

SWIFT: Final = 2.5
"""Velocity [m/s] beyond which it is: machines with linear motors reach 2 m/s."""


def doubtful_values(machine: Machine, axes: Iterable[str]) -> list[str]:
    """Warn of numbers of a machine file that look like another unit, and of a file without any backlash.

    Parameters
    ----------
    machine : Machine
    axes : iterable of str
        Axes that move.
    """
    drives = [machine.axes[name] for name in axes if name in machine.axes]
    said = [
        f"axis {one.name}: a lost motion of {one.gap.lost_motion / MM:.4g} mm is unusual; is the machine file right?"
        for one in drives
        if one.gap.lost_motion > WIDE
    ]
    said += [
        f"axis {one.name}: max_velocity_mm_s = {one.limits.velocity / MM:g} is {60.0 * one.limits.velocity:.4g} m/min;"
        " are these mm/min?"
        for one in drives
        if SWIFT < one.limits.velocity < math.inf
    ]
    if drives and not any(one.gap.lost_motion > 0.0 for one in drives):
        names = ", ".join(one.name for one in drives)
        said.append(f"the machine file states no lost motion of {names}: nothing is compensated there")
    return said


def lead_in_warnings(time: float, axes: Iterable[str]) -> list[str]:
    """Warn of the rows of a table before the path begins, in which axes come onto their sides.

    Examples
    --------
    >>> print(lead_in_warnings(0.248, ["X", "X"])[0][:79])
    the table begins 0.248 s before the path, at negative times, and brings X onto
    """
    if time == 0.0:
        return []
    names = sorted(set(axes))
    whose = "its side" if len(names) == 1 else "their sides"
    return [
        f"the table begins {time:.3g} s before the path, at negative times, and brings {', '.join(names)} onto {whose} "
        "of the backlash: the tool must be off the part until t = 0"
    ]


def stop_time_warning(axes: Sequence[str], time: float, part: float) -> str:
    """Warn of axes that are not compensated, with the time that their stops would add [s], and its part of all.

    Examples
    --------
    >>> stop_time_warning(["X"], 0.605, 0.156)
    'axis X is not compensated: stopping at every reversal would add 0.605 s; --max-slowdown 0.16 allows it'
    """
    who = f"axis {axes[0]} is" if len(axes) == 1 else f"axes {', '.join(axes)} are"
    return (
        f"{who} not compensated: stopping at every reversal would add {time:.3g} s; "
        f"--max-slowdown {round_up(part):g} allows it"
    )


def more_time_warning(here: Sequence[float], there: Sequence[float], option: str) -> str:
    """Say what a plan would bring that takes, or stands still, longer than it may.

    Parameters
    ----------
    here, there : sequence of float
        Largest error and root mean square [m] of the plan that was made, and with more time.
    option : str
        What allows it.

    Examples
    --------
    >>> more_time_warning([84e-6, 32e-6], [12e-6, 2.3e-6], "--max-slowdown 0.21")
    'more time would help: --max-slowdown 0.21 allows a plan with 12/2.3 µm (largest/rms error) in place of 84/32 µm'
    """
    sizes = [f"{one[0] / MICROMETRE:.3g}/{one[1] / MICROMETRE:.3g} µm" for one in (there, here)]
    return f"more time would help: {option} allows a plan with {sizes[0]} (largest/rms error) in place of {sizes[1]}"


def round_up(fraction: float) -> float:
    """Round a fraction up to two digits, with some room.

    Examples
    --------
    >>> round_up(0.156)
    0.16
    """
    return float(f"{fraction * (1.0 + _ROOM):.1e}")


def friction_warnings(shifted: Iterable[str], tool: Tool = "cutter", *, climbs: bool = True) -> list[str]:
    """Warn that only friction holds the table on its side on axes with a lasting offset.

    Without `climbs` nothing is said of climb milling: a program's own comments may say more. Where no cutter pulls at
    it nothing but the table's own inertia, and what hangs on it, is left to do that.

    Examples
    --------
    >>> friction_warnings(["X"], "laser")
    ['axis X counts on friction to hold the table on its side of the backlash']
    """
    names = sorted(shifted)
    if not names:
        return []
    who = f"axis {names[0]} counts" if len(names) == 1 else f"axes {', '.join(names)} count"
    said = f"{who} on friction to hold the table on its side of the backlash"
    cut = ": a cutter that pulls the table along, as in climb milling, can pull it across"
    return [said + cut if tool == "cutter" and climbs else said]


def side_warnings(axes: Iterable[Axis]) -> list[str]:
    """Warn of axes whose lasting offset does not hold all along.

    Their backlash changes along the travel, or their friction is too small to hold the table where the motor brakes.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> side_warnings([read_machine("router").axes["X"]])
    []
    """
    given = list(axes)
    varies = [
        f"the backlash of axis {axis.name} changes along its travel, but its lasting offset does not"
        for axis in given
        if not axis.loop.encloses_backlash and backlash_varies(axis)
    ]
    return [*varies, *run_on_warnings(given)]


def run_on_warnings(axes: Iterable[Axis]) -> list[str]:
    """Warn of axes whose friction is too small to hold the table in its backlash where the motor brakes."""
    brakes = [(axis, braked(axis)) for axis in axes if may_shift(axis)]
    return [_run_on_warning(axis, slows) for axis, slows in brakes if math.isfinite(slows)]


def gentle_warnings(most: Mapping[str, float]) -> list[str]:
    """Say with which accelerations [m/s²] axes are run so that friction holds their tables.

    Examples
    --------
    >>> gentle_warnings({"X": 0.45})
    ['axis X is run with at most 450 mm/s², so that friction holds its table on its side of the backlash']
    """
    return [
        f"axis {name} is run with at most {float(f'{value / MM:.2g}'):g} mm/s², so that friction holds its table on "
        "its side of the backlash"
        for name, value in most.items()
    ]


def _run_on_warning(axis: Axis, brakes: float) -> str:
    slows, safe = (float(f"{part * brakes / MM:.2g}") for part in (1.0, SAFE))
    return (
        f"the table of axis {axis.name} may run on through its backlash where the motor brakes harder than its "
        f"friction, {slows:g} mm/s²: what would make the part worse then is left as it is; "
        f"max_acceleration_mm_s2 = {safe:g} or less, in the controller too, holds the table"
    )


def point_warnings(said: Iterable[tuple[Sequence[int], str]]) -> list[str]:
    """Gather equal warnings about turning points; beyond the first dozen they are counted.

    Examples
    --------
    >>> point_warnings([([0], "too short"), ([2, 3], "too short"), ([1], "left alone")])
    ['turning points #0, #2, #3: too short', 'turning point #1: left alone']
    """
    gathered: dict[str, list[int]] = {}
    for indices, text in said:
        gathered.setdefault(text, []).extend(indices)
    lines = [
        f"turning point{'s' * (len(who) > 1)} {_listed([f'#{index}' for index in who])}: {text}"
        for text, who in gathered.items()
    ]
    left = len(lines) - _MOST
    return lines if left <= 0 else [*lines[:_MOST], f"{left} more warnings about turning points like these"]


def _listed(words: Sequence[str]) -> str:
    """Join words by commas; beyond the first eight they are counted."""
    left = len(words) - _NUMBERS
    return ", ".join(words[:_NUMBERS]) + (f" and {left} more" if left > 0 else "")


def led_friction_warnings(part: float, little: float) -> list[str]:
    """Warn where less than all of the friction is led, as a machine with only a `little` part of it would be worse."""
    if part in (0.0, 1.0):
        return []
    return [
        f"{100.0 * part:.0f} % of the friction is led: with all of it the table would be farther off than the plain "
        f"program's on a machine with {100.0 * little:.0f} % of that friction"
    ]
