"""Test programs that make show what a machine file should know: circles, ladders, sweeps, stops."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from ph_post.diagnose import kitparts as parts
from ph_post.diagnose.kitdraft import APPROACH, Draft
from ph_post.diagnose.kitground import TOP_SHARE, Ground, arc_speed, settling_time, top_speed
from ph_post.diagnose.kitrecord import what_to_record
from ph_post.diagnose.record import Channel, Experiment
from ph_post.errors import InputError
from ph_post.gcode.registry import find_dialect
from ph_post.types import Machine
from ph_post.units import MINUTE, MM, MM_PER_MIN

TRAVEL: Final = 100.0 * MM
"""Room of every axis where a person names none [m], end to end."""

RADIUS_SHARE: Final = 0.3
"""Radius of the circles where a person names none, as a share of the room."""

LEAST: Final = 2.0 * MM
"""Room [m] in which nothing worth while can be seen."""

FARTHEST: Final = 100.0
"""Places [m] that no machine has."""

SLOWEST: Final = 1.0 * MM_PER_MIN
"""Feeds below it [m/s] take a day."""

WARM_UP: Final = 10.0 * MINUTE
"""How long the run takes that warms the screws [s]."""

_FEED_RATIOS: Final = (1.0 / 6.0, 0.4, 1.0)
"""Feeds of the circles where a person names none, by the greatest that is taken."""

Write = Callable[[Draft], None]


def calibration_kit(
    machine: Machine,
    *,
    axes: Sequence[str] = (),
    centre: Sequence[float] = (),
    travel: Sequence[float] = (),
    radius: float | None = None,
    feeds: Sequence[float] = (),
    warm_up: float = WARM_UP,
) -> tuple[Experiment, ...]:
    """Write the test programs of a machine, the one that holds a little of everything first. SI units.

    Parameters
    ----------
    machine : Machine
    axes : sequence of str, optional
        Axes to move; all but Z where none are named: a Z that nobody asked for could meet the table.
    centre : sequence of float, optional
        Middle of the room, by axis [m]; 0.
    travel : sequence of float, optional
        Room of the axes from end to end [m], one for all or one each; 100 mm.
    radius : float, optional
        Of the circles [m]; 0.3 of the room.
    feeds : sequence of float, optional
        Of the circles [m/s]; three up to 0.8 of what speed, acceleration and jerk allow.
    warm_up : float, optional
        How long the run takes that warms the screws [s].

    Raises
    ------
    InputError
        Where the machine lacks an axis, the circles leave the room, or a feed is beyond the machine.
    """
    ground = lay_out(machine, axes, centre, travel, radius, feeds)
    if not (math.isfinite(warm_up) and 0.0 < warm_up <= 24.0 * 60.0 * MINUTE):
        raise InputError(
            "--warm-up",
            "no time for a run",
            expected="minutes, above 0 up to 1440",
            got=f"{warm_up / MINUTE:g}",
        )
    return (
        _whole(ground),
        *(one for axis in ground.axes for one in _of_axis(ground, axis)),
        *(one for pair in ground.pairs for one in _of_pair(ground, pair)),
        _warm(ground, warm_up),
    )


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
    if not 0.0 < radius <= most:
        raise InputError(
            "--radius", "the circles leave the travel",
            expected=f"above 0 up to {most / MM:g} mm, half of the travel", got=f"{radius / MM:g} mm",
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


def experiment(
    ground: Ground, name: str, why: str, write: Write, needed: Sequence[Channel] = ("act", "motor")
) -> Experiment:
    """Write one program.

    Parameters
    ----------
    ground : Ground
    name : str
        What it and its log are called.
    why : str
        What it is for, a sentence.
    write : callable
        Adds the motions to a draft.
    needed : sequence of {"act", "motor", "force"}
        Channels without which it tells nothing.
    """
    draft = Draft(ground, find_dialect(ground.machine.dialect, "controller.dialect"))
    write(draft)
    record = what_to_record(ground.machine, ground.axes, needed, draft.seconds, name)
    return Experiment(
        name=name, why=why, record=record, program=draft.text(_remarks(ground, name, why, draft))
    )


def _remarks(ground: Ground, name: str, why: str, draft: Draft) -> list[str]:
    """Say what a person must know before starting a program."""
    room = ", ".join(
        f"{axis} from {low / MM:g} to {high / MM:g}" for axis, (low, high) in ground.spans.items()
    )
    middle = " ".join(f"{axis}{ground.centre(axis) / MM:g}" for axis in ground.axes)
    others = [axis for axis in "XYZ" if axis not in ground.axes]
    still = (
        "" if not others else f", {' and '.join(others)} not moved: the height at which the tool stands stays"
    )
    speed = min(APPROACH, 0.25 * ground.top(*ground.axes)) / MM_PER_MIN
    return [
        f"ph-post test program {name} for {ground.machine.name}, about {draft.seconds:.0f} s",
        why,
        f"THE TOOL MUST BE CLEAR of everything: moves {room} mm{still}",
        f"go to {middle} by hand first: the program begins with a straight move to there at {speed:g} mm/min,"
        " and ends there",
        "cut air, spindle off, feed override 100 percent, work offset G54, the controller's own backlash and"
        " screw compensation off",
    ]


def _whole(ground: Ground) -> Experiment:
    why = "a little of everything in one record: steps, sweeps, speeds, circles and diagonals"
    return experiment(ground, "mix", why, lambda draft: parts.mix(draft, ground.axes))


def _of_axis(ground: Ground, axis: str) -> list[Experiment]:
    """Programs that move one axis at a time."""
    small = axis.lower()
    return [
        experiment(
            ground, f"ladder_{small}", f"steps of {axis} from 0.01 to 10 mm to either side: gap and friction",
            lambda draft: _between(draft, lambda: parts.ladder(draft, axis)),
        ),
        experiment(
            ground, f"sweep_{small}",
            f"all of {axis} slowly and faster, and reversals along it: screw, scale, gap by position",
            lambda draft: _between(
                draft, lambda: parts.sweeps(draft, axis), lambda: parts.places(draft, axis, 7)
            ),
        ),
        experiment(
            ground, f"speed_{small}", f"{axis} at speeds from a crawl up, both ways: friction by speed",
            lambda draft: _between(draft, lambda: parts.speeds(draft, axis)), ("act", "motor", "force"),
        ),
        experiment(
            ground, f"fast_{small}",
            f"{axis} with all acceleration, and stops: servo, wind-up, saturation, delay",
            lambda draft: _between(draft, lambda: parts.fast(draft, axis), lambda: parts.stops(draft, axis)),
        ),
    ]  # fmt: skip


def _of_pair(ground: Ground, pair: tuple[str, str]) -> list[Experiment]:
    """Programs that move two axes at a time."""
    small, names = "".join(pair).lower(), f"{pair[0]} and {pair[1]}"
    return [
        experiment(
            ground, f"circles_{small}",
            f"circles in {names} at several feeds both ways: gap, servo mismatch, delay, pick-up",
            lambda draft: _between(
                draft, lambda: parts.circles(draft, pair, ground.feeds, ground.radius),
                lambda: parts.small_circles(draft, pair),
            ),
        ),
        experiment(
            ground, f"diagonals_{small}", f"both diagonals of {names}, to and fro: squareness beside scale",
            lambda draft: _between(draft, lambda: parts.diagonals(draft, pair)), ("act",),
        ),
    ]  # fmt: skip


def _warm(ground: Ground, seconds: float) -> Experiment:
    """Let the screws grow, and look at the same way again and again."""

    def write(draft: Draft) -> None:
        def look() -> None:
            for axis in ground.axes:
                parts.sweeps(draft, axis, (ground.slow(axis, 0.25 * parts.SLOW_SWEEP),))

        parts.standstill(draft)
        parts.warm_up(draft, ground.axes, seconds, look)

    why = "a long run from cold with the same sweeps again and again: growth by warmth, beside scale"
    return experiment(ground, "warm_up", why, write, ("act",))


def _between(draft: Draft, *motions: Callable[[], None]) -> None:
    """Stand still before, between and after, for the noise floor."""
    parts.standstill(draft)
    for motion in motions:
        motion()
        parts.standstill(draft)
