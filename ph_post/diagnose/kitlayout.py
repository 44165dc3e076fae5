"""What a person asks of test programs: the room, the circles and the feeds, checked against the machine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from ph_post.diagnose.kitground import TOP_SHARE, Ground, arc_speed, settling_time, top_speed
from ph_post.errors import InputError
from ph_post.types import Machine
from ph_post.units import MM, MM_PER_MIN

TRAVEL: Final = 100.0 * MM
"""Room of every axis where a person names none [m], end to end."""

RADIUS_SHARE: Final = 0.3
"""Radius of the circles where a person names none, as a share of the room."""

LEAST: Final = 2.0 * MM
"""Room [m] in which nothing worth while can be seen."""

LEAST_RADIUS: Final = 0.5 * MM
"""Radius [m] below which a circle is a point to most controllers."""

FARTHEST: Final = 100.0
"""Places [m] that no machine has."""

SLOWEST: Final = 1.0 * MM_PER_MIN
"""Feeds below it [m/s] take a day."""

_FEED_RATIOS: Final = (1.0 / 6.0, 0.4, 1.0)
"""Feeds of the circles where a person names none, by the greatest that is taken."""


def lay_out(
    machine: Machine,
    axes: Sequence[str],
    centre: Sequence[float],
    travel: Sequence[float],
    radius: float | None,
    feeds: Sequence[float],
) -> Ground:
    """Check what a person asked for and fill in the rest; parameters as of :func:`calibration_kit`."""
    names = _axes(machine, axes)
    middles = _each(names, tuple(centre) or (0.0,) * len(names), "--centre")
    given = tuple(travel) or (TRAVEL,)
    rooms = _each(names, given * len(names) if len(given) == 1 else given, "--travel")
    for axis in names:
        _check_room(axis, middles[axis], rooms[axis])
    spans = {axis: (middles[axis] - 0.5 * rooms[axis], middles[axis] + 0.5 * rooms[axis]) for axis in names}
    size = RADIUS_SHARE * min(rooms.values()) if radius is None else radius
    _check_radius(size, rooms)
    return Ground(
        machine=machine, spans=spans, radius=size, settle=settling_time(machine, names),
        feeds=_feeds(machine, names, size, feeds),
    )  # fmt: skip


def _axes(machine: Machine, wanted: Sequence[str]) -> tuple[str, ...]:
    there = tuple(axis for axis in "XYZ" if axis in machine.axes)
    for axis in wanted:
        if axis not in there:
            raise InputError(
                "--axes", "the machine has no such axis", expected=" or ".join(there), got=repr(axis)
            )
    chosen = tuple(axis for axis in there if (axis in wanted if wanted else axis != "Z"))
    if not chosen:
        raise InputError("--axes", "the machine has no axis but Z", expected="Z, to have it moved")
    return chosen


def _each(axes: Sequence[str], values: Sequence[float], option: str) -> dict[str, float]:
    """One number an axis."""
    if len(values) != len(axes):
        names = ", ".join(axes)
        raise InputError(
            option, "not one number an axis", expected=f"{len(axes)}, for {names}", got=f"{len(values)}"
        )
    return dict(zip(axes, values, strict=True))


def _check_room(axis: str, middle: float, room: float) -> None:
    if not (math.isfinite(middle) and abs(middle) <= FARTHEST):
        raise InputError(
            "--centre", f"no place for {axis}", expected="within 100 m", got=f"{middle / MM:g} mm"
        )
    if not LEAST <= room <= FARTHEST:
        what = f"no room for {axis} to move in"
        raise InputError(
            "--travel", what, expected=f"at least {LEAST / MM:g} mm, up to 100 m", got=f"{room / MM:g} mm"
        )


def _check_radius(radius: float, rooms: Mapping[str, float]) -> None:
    most = 0.5 * min(rooms.values())
    if not LEAST_RADIUS <= radius <= most:
        raise InputError(
            "--radius", "the circles leave the travel" if radius > most else "no radius for a circle",
            expected=f"{LEAST_RADIUS / MM:g} mm up to {most / MM:g} mm, half of the travel",
            got=f"{radius / MM:g} mm",
        )  # fmt: skip


def _feeds(
    machine: Machine, axes: tuple[str, ...], radius: float, wanted: Sequence[float]
) -> tuple[float, ...]:
    """Take the feeds asked for, each once and rising, or three of our own."""
    round_circle = arc_speed(machine, axes, radius)
    if not wanted:
        return tuple(TOP_SHARE * round_circle * ratio for ratio in _FEED_RATIOS)
    top = top_speed(machine, axes)
    for feed in wanted:
        told = f"{feed / MM_PER_MIN:g} mm/min"
        if not feed >= SLOWEST:
            raise InputError("--feeds", "no feed", expected="at least 1 mm/min", got=told)
        if feed > top:
            what = "the feed is above what the machine has"
            raise InputError("--feeds", what, expected=f"up to {top / MM_PER_MIN:g} mm/min", got=told)
        if len(axes) > 1 and feed > round_circle:
            what = f"circles of {radius / MM:g} mm take more acceleration or jerk than the machine has"
            most = f"up to {math.floor(round_circle / MM_PER_MIN)} mm/min, or a larger --radius"
            raise InputError("--feeds", what, expected=most, got=told)
    return tuple(sorted(set(wanted)))
