"""The calibration kit: the test programs of a machine, its checked options, and the recording plan."""

from __future__ import annotations

import math
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec.structs import replace

from ph_post.dialects.base import READ_WITH
from ph_post.dialects.registry import find_dialect
from ph_post.errors import InputError
from ph_post.gcode.program import AXES
from ph_post.testprograms import motions as parts
from ph_post.testprograms.builder import (
    RADIUS_SHARE,
    SLOWEST,
    TOP_SHARE,
    ProgramBuilder,
    TestVolume,
    arc_speed,
    settling_time,
    top_speed,
)
from ph_post.testprograms.program import build_experiment
from ph_post.types import Machine
from ph_post.types.diagnosis import Experiment
from ph_post.units import MINUTE, MM, MM_PER_MIN

TRAVEL: Final = 100.0 * MM
"""Room of every axis where a person names none [m], end to end."""

LEAST: Final = 2.0 * MM
"""Room [m] in which nothing worth while can be seen."""

LEAST_RADIUS: Final = 0.5 * MM
"""Radius [m] below which a circle is a point to most controllers."""

FARTHEST: Final = 100.0
"""Places [m] that no machine has."""

_FEED_RATIOS: Final = (1.0 / 6.0, 0.4, 1.0)
"""Feeds of the circles where a person names none, by the greatest that is taken."""


def choose_volume(
    machine: Machine,
    axes: Sequence[str],
    centre: Sequence[float],
    travel: Sequence[float],
    radius: float | None,
    feeds: Sequence[float],
) -> TestVolume:
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
    return TestVolume(
        machine=machine,
        spans=spans,
        radius=size,
        settle=settling_time(machine, names),
        feeds=_feeds(machine, names, size, feeds),
    )


def _axes(machine: Machine, wanted: Sequence[str]) -> tuple[str, ...]:
    there = tuple(axis for axis in AXES if axis in machine.axes)
    for axis in wanted:
        if axis not in there:
            raise InputError("--axes", "the machine has no such axis", expected=" or ".join(there), got=repr(axis))
    chosen = tuple(axis for axis in there if (axis in wanted if wanted else axis != "Z"))
    if not chosen:
        raise InputError("--axes", "the machine has no axis but Z", expected="Z, to have it moved")
    return chosen


def _each(axes: Sequence[str], values: Sequence[float], option: str) -> dict[str, float]:
    """One number an axis."""
    if len(values) != len(axes):
        names = ", ".join(axes)
        raise InputError(option, "not one number an axis", expected=f"{len(axes)}, for {names}", got=f"{len(values)}")
    return dict(zip(axes, values, strict=True))


def _check_room(axis: str, middle: float, room: float) -> None:
    if not (math.isfinite(middle) and abs(middle) <= FARTHEST):
        raise InputError(
            "--centre", f"the centre of {axis} is out of range", expected="within 100 m", got=f"{middle / MM:g} mm"
        )
    if not LEAST <= room <= FARTHEST:
        what = f"the travel of {axis} is out of range"
        raise InputError("--travel", what, expected=f"at least {LEAST / MM:g} mm, up to 100 m", got=f"{room / MM:g} mm")


def _check_radius(radius: float, rooms: Mapping[str, float]) -> None:
    most = 0.5 * min(rooms.values())
    if not LEAST_RADIUS <= radius <= most:
        raise InputError(
            "--radius",
            "the circles leave the travel" if radius > most else "the radius is out of range",
            expected=f"{LEAST_RADIUS / MM:g} mm up to {most / MM:g} mm, half of the travel",
            got=f"{radius / MM:g} mm",
        )


def _feeds(machine: Machine, axes: tuple[str, ...], radius: float, wanted: Sequence[float]) -> tuple[float, ...]:
    """Take the feeds asked for, each once and rising, or three of our own."""
    round_circle = arc_speed(machine, axes, radius)
    if not wanted:
        return tuple(TOP_SHARE * round_circle * ratio for ratio in _FEED_RATIOS)
    top = top_speed(machine, axes)
    for feed in wanted:
        got = f"{feed / MM_PER_MIN:g} mm/min"
        if not feed >= SLOWEST:
            raise InputError("--feeds", "the feed is too slow", expected="at least 1 mm/min", got=got)
        if feed > top:
            what = "the feed exceeds the machine's limit"
            raise InputError("--feeds", what, expected=f"up to {top / MM_PER_MIN:g} mm/min", got=got)
        if len(axes) > 1 and feed > round_circle:
            what = f"circles of {radius / MM:g} mm exceed the machine's limits of acceleration or jerk"
            most = f"up to {math.floor(round_circle / MM_PER_MIN)} mm/min, or a larger --radius"
            raise InputError("--feeds", what, expected=most, got=got)
    return tuple(sorted(set(wanted)))


WARM_UP: Final = 10.0 * MINUTE
"""Time of the run that warms the screws [s]."""


LONGEST: Final = 120.0 * MINUTE
"""Longest of such runs [s]."""


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
        Time of the run that warms the screws [s].

    Raises
    ------
    InputError
        Where the machine lacks an axis, the circles leave the room, or a feed is beyond the machine.
    """
    volume = choose_volume(machine, axes, centre, travel, radius, feeds)
    if not (math.isfinite(warm_up) and 0.0 < warm_up <= LONGEST):
        raise InputError(
            "--warm-up",
            "the warm-up time is out of range",
            expected="minutes, above 0 up to 120",
            got=f"{warm_up / MINUTE:g}",
        )
    why = "a little of everything in one log: steps, sweeps, speeds, circles and diagonals"
    return (
        build_experiment(volume, "mix", why, lambda builder: parts.mix(builder, volume.axes)),
        *(one for axis in volume.axes for one in _of_axis(volume, axis)),
        *(one for pair in volume.pairs for one in _of_pair(volume, pair)),
        _warm(volume, warm_up),
    )


def _of_axis(volume: TestVolume, axis: str) -> list[Experiment]:
    """Programs that move one axis, and no other."""
    small = axis.lower()
    volume = replace(volume, spans={axis: volume.spans[axis]})
    return [
        build_experiment(
            volume,
            f"ladder_{small}",
            f"steps of {axis} from 0.01 to 10 mm to either side: backlash and friction",
            lambda builder: _between(builder, lambda: parts.ladder(builder, axis)),
        ),
        build_experiment(
            volume,
            f"sweep_{small}",
            f"all of {axis} slowly and faster, and reversals along it: screw, scale, backlash by position",
            lambda builder: _between(
                builder, lambda: parts.sweeps(builder, axis), lambda: parts.places(builder, axis, 7)
            ),
        ),
        build_experiment(
            volume,
            f"speed_{small}",
            f"{axis} at speeds from a crawl up, both ways: friction by speed",
            lambda builder: _between(builder, lambda: parts.speeds(builder, axis)),
            ("act", "force"),
        ),
        build_experiment(
            volume,
            f"fast_{small}",
            f"{axis} with all acceleration, and stops: servo, wind-up, saturation, delay",
            lambda builder: _between(builder, lambda: parts.fast(builder, axis), lambda: parts.stops(builder, axis)),
        ),
    ]


def _of_pair(volume: TestVolume, pair: tuple[str, str]) -> list[Experiment]:
    """Programs that move two axes at a time."""
    volume = replace(volume, spans={axis: volume.spans[axis] for axis in pair})
    small, names = "".join(pair).lower(), f"{pair[0]} and {pair[1]}"
    return [
        build_experiment(
            volume,
            f"circles_{small}",
            f"circles in {names} at several feeds both ways: backlash, servo mismatch, delay, pick-up",
            lambda builder: _between(
                builder,
                lambda: parts.circles(builder, pair, volume.feeds, volume.radius),
                lambda: parts.small_circles(builder, pair),
            ),
        ),
        build_experiment(
            volume,
            f"diagonals_{small}",
            f"both diagonals of {names}, to and fro: squareness beside scale",
            lambda builder: _between(builder, lambda: parts.diagonals(builder, pair)),
            gauge=True,
        ),
    ]


def _warm(volume: TestVolume, seconds: float) -> Experiment:
    """Let the screws grow, and look at the same way again and again."""

    def write(builder: ProgramBuilder) -> None:
        def look() -> None:
            for axis in volume.axes:
                parts.sweeps(builder, axis, (volume.slow(axis, 0.25 * parts.SLOW_SWEEP),))

        parts.standstill(builder)
        parts.warm_up(builder, volume.axes, seconds, look)

    why = "a long run from cold with the same sweeps again and again: growth by warmth, beside scale"
    return build_experiment(volume, "warm_up", why, write, gauge=True)


def _between(builder: ProgramBuilder, *motions: Callable[[], None]) -> None:
    """Stand still before, between and after, for the noise floor."""
    parts.standstill(builder)
    for motion in motions:
        motion()
        parts.standstill(builder)


def program_file(machine: Machine, one: Experiment) -> str:
    """Name of the file that a program goes to, with the ending that the machine's controller expects."""
    return one.name + find_dialect(machine.dialect).ending


def recording_plan(machine: Machine, source: str, folder: str, kit: Sequence[Experiment]) -> str:
    """Write the plan as Markdown.

    Parameters
    ----------
    machine : Machine
    source : str
        What the person called the machine: a file, or the name of a shipped one.
    folder : str
        Where the programs are, and the logs are wanted.
    kit : sequence of Experiment
    """
    lines = (*_before(machine, kit), *_runs(machine, source, folder, kit), *_by_hand(machine))
    return "\n".join(lines) + "\n"


def _before(machine: Machine, kit: Sequence[Experiment]) -> Iterator[str]:
    yield f"# Test programs for {machine.name}"
    yield ""
    yield f"`{program_file(machine, kit[0])}` alone is a good beginning; the others look at one thing each."
    yield ""
    yield "## Before"
    yield ""
    yield "- Read the head of each program: it says where it moves. The tool must be clear of all there."
    yield "- The programs cut air. Spindle off, feed override at 100 percent, work offset G54."
    tables = find_dialect(machine.dialect).notices.own_tables
    where = f" ({tables})" if tables else ""
    yield f"- Switch off what the controller compensates{where}: it would hide the backlash."
    cold = program_file(machine, kit[-1])
    yield f"- `{cold}` wants a machine that was off for the night; the others a warm one."
    closed = [name for name, axis in machine.axes.items() if axis.loop.encloses_backlash]
    if closed:
        yield (
            f"- The loops of {', '.join(closed)} follow a scale, and cannot show what is wrong with it:"
            " scale, cyclic error, growth and squareness want a gauge outside of the loop, such as a laser."
        )
    yield "- A log is a CSV file with a column t [s] and those named below, at a constant period."


def _runs(machine: Machine, source: str, folder: str, kit: Sequence[Experiment]) -> Iterator[str]:
    yield ""
    yield "## Run, record, diagnose"
    for one in kit:
        yield ""
        yield f"### {program_file(machine, one)}"
        yield ""
        yield f"{one.why[:1].upper()}{one.why[1:]}."
        yield ""
        yield from (f"- {_code(line, folder)}" for line in one.record if not line.startswith(READ_WITH))
        yield ""
        yield "```"
        yield _command(machine, source, folder, one)
        yield "```"


def _code(line: str, folder: str) -> str:
    """Set what is typed as code; a log is written where the line that judges it looks for it."""
    if line.startswith("halsampler "):
        line, _, file = line.rpartition(" ")
        line = f"{line} {shlex.quote(str(Path(folder, file)))}"
    return f"`{line}`" if line.startswith(("halcmd ", "halsampler ")) else line.replace("_", "\\_")


def _command(machine: Machine, source: str, folder: str, one: Experiment) -> str:
    """Line that judges a log; the log has the columns that were recorded, and the place of the program."""
    recording = find_dialect(machine.dialect).recording
    words = ["ph-post", "diagnose", str(Path(folder, one.name + recording.ending)), "-m", source]
    if not recording.has_command:
        words += ["--program", str(Path(folder, program_file(machine, one)))]
    for line in one.record:
        if line.startswith(READ_WITH):
            words += line.removeprefix(READ_WITH).split()
    return shlex.join([*words, "-o", str(Path(folder, f"better_{one.name}.toml"))])


def _by_hand(machine: Machine) -> Iterator[str]:
    """Say what no program can do."""
    closed = [name for name, axis in machine.axes.items() if axis.loop.encloses_backlash]
    yield ""
    yield "## By hand"
    yield ""
    yield "- Repeat one program without touching anything: what differs between two runs is noise."
    if closed:
        yield (
            f"- Coast-down ({', '.join(closed)}): a program can only stop under control. For the motor's own"
            " time constant uncouple it from the screw, run it at a steady speed, take away the drive's power"
            " (never with an axis that can fall), and record the motor's encoder until it stands."
        )
