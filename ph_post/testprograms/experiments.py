"""The next experiment: the test program that separates effects which a log cannot separate.

The table gives motions, channels and the physical reason for every pair of effects.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations, product
from typing import Final

import msgspec
import numpy as np

from ph_post.gcode.program import AXES
from ph_post.testprograms.builder import (
    CRAWL,
    RADIUS_SHARE,
    TOP_SHARE,
    ProgramBuilder,
    TestVolume,
    arc_speed,
    settling_time,
)
from ph_post.testprograms.motions import PARTS, standstill
from ph_post.testprograms.program import EVERY, build_experiment
from ph_post.types import Array, AxisLog, Log, Machine
from ph_post.types.diagnosis import Channel, Experiment, recorded_channels
from ph_post.units import MM, MS


class Separation(msgspec.Struct, frozen=True, kw_only=True):
    """Motions and channels that separate two effects, or show one of them.

    `parts` are motions of :data:`ph_post.testprograms.motions.PARTS`, `record` the channels without which they
    show nothing, `why` the physics in a sentence.
    """

    parts: tuple[str, ...]
    record: tuple[Channel, ...]
    why: str


def _see(parts: str, record: str, why: str) -> Separation:
    return Separation(parts=tuple(parts.split(", ")), record=_channels(record.split()), why=why)


def _channels(needed: Collection[str]) -> tuple[Channel, ...]:
    """Put channels into their order."""
    return tuple(channel for channel in EVERY if channel in needed)


SHOWN: Final[Mapping[str, Separation]] = {
    "backlash": _see("ladder", "act motor", "backlash is the travel that the table lacks behind the motor"),
    "coulomb_friction": _see("ladder, speeds", "force", "dry friction is a force of one size by direction"),
    "stribeck_friction": _see("speeds", "act force", "friction that falls with speed shows in a crawl"),
    "viscous_friction": _see("speeds", "force", "viscous friction is a force in proportion to speed"),
    "friction_asymmetry": _see("speeds", "force", "asymmetric friction has another slope in the other direction"),
    "load_offset": _see("ladder, speeds", "force", "a load is a force that stays when the direction changes"),
    "elastic_windup": _see("fast, small circles", "act motor", "a spring gives way with acceleration"),
    "engagement_impact": _see(
        "ladder, circles", "act motor", "the table starts with a jump where the motor picks it up at speed"
    ),
    "position_dependent_backlash": _see("places, sweeps", "act motor", "the backlash differs along the axis"),
    "cyclic_error": _see("sweeps", "act", "an error of the screw repeats with its lead at any feed"),
    "scale_error": _see("sweeps", "act", "a wrong scale grows with the way, at any time"),
    "thermal_growth": _see("warm-up", "act", "warmth shifts the reading as time goes by"),
    "squareness": _see("diagonals", "act", "an angle makes one diagonal longer and the other shorter"),
    "servo_mismatch": _see("small circles, stops", "act", "b acts with acceleration, c with speed"),
    "command_filter": _see("small circles, stops", "act", "a filter rounds where a motion begins and ends"),
    "transport_delay": _see("small circles, stops", "act", "a delay shifts everything by one time"),
    "torque_saturation": _see("fast, small circles", "force", "a limit shows above one acceleration only"),
    "cogging": _see("sweeps", "motor force", "a cogging force is filtered by the loop: its trace goes by feed"),
    "cutting_force": _see("circles, sweeps", "force", "in air there is no cutting force"),
}
"""Motions and channels that show each effect of the catalogue best."""

READINGS: Final = frozenset(("cyclic_error", "scale_error", "thermal_growth", "squareness"))
"""Effects on what is read outside of the loop: the scale that the loop itself follows cannot show them."""

_FRICTION = ("coulomb_friction", "stribeck_friction")
_GAP = ("backlash", "position_dependent_backlash")
_FORCES = (*_FRICTION, "viscous_friction", "friction_asymmetry")
_LOOP = ("servo_mismatch", "command_filter", "transport_delay")
_AIR = "sweeps, circles"

_TABLE: Final = (
    (
        _FRICTION,
        (*_GAP, "engagement_impact"),
        _see(
            "ladder, circles",
            "act motor force",
            "backlash is a difference between motor and table and takes no force, friction is a force and leaves"
            " motor and table together; steps below and above the backlash, and other feeds",
        ),
    ),
    (
        ("viscous_friction", "friction_asymmetry"),
        _LOOP,
        _see(
            "small circles, speeds, stops",
            "act force",
            "viscous friction takes force at constant speed, a wrong c and a delay take none; what b does grows"
            " with acceleration, a delay with every frequency alike: small fast circles, steady speeds, stops",
        ),
    ),
    (
        ("servo_mismatch",),
        ("transport_delay",),
        _see(
            "small circles, stops, speeds",
            "act",
            "at one speed a delay and a wrong c are the same lag: high accelerations tell them apart, as a delay"
            " turns the phase of a circle and leaves its radius, b and c change both",
        ),
    ),
    (
        ("scale_error",),
        ("thermal_growth",),
        _see(
            "warm-up",
            "act",
            "the same sweep cold and warm: a wrong scale is there from the beginning, growth comes with time",
        ),
    ),
    (
        ("cyclic_error",),
        ("cogging",),
        _see(
            "sweeps",
            "act motor",
            "at two very different feeds an error of the screw stays and leaves the motor's side alone, a cogging"
            " force moves the motor, and less the faster it goes by",
        ),
    ),
    (
        ("load_offset",),
        (*_FORCES, *_GAP, *_LOOP, "scale_error", "thermal_growth"),
        _see(
            "ladder, speeds",
            "force",
            "in positions a load is a shifted origin: only force or current shows it, alike in both directions",
        ),
    ),
    (
        ("squareness",),
        ("scale_error", "thermal_growth", "cyclic_error"),
        _see(
            "diagonals, sweeps",
            "act",
            "an angle lengthens one diagonal and shortens the other, a wrong scale lengthens both alike",
        ),
    ),
    (
        ("elastic_windup",),
        _LOOP,
        _see(
            "fast, small circles, stops",
            "act motor",
            "with high acceleration a spring opens a difference between motor and table that swings after a stop,"
            " a wrong servo and a delay leave them together",
        ),
    ),
    (
        ("elastic_windup",),
        (*_FRICTION, *_GAP),
        _see(
            "ladder, fast, small circles",
            "act motor force",
            "a spring gives way with force and comes back, backlash stays open at rest, friction stays a force",
        ),
    ),
    (
        ("friction_asymmetry",),
        (*_FRICTION, "viscous_friction"),
        _see(
            "speeds",
            "act force",
            "both directions at many speeds: whose force has another slope in plus than in minus",
        ),
    ),
    (
        ("viscous_friction",),
        _FRICTION,
        _see(
            "speeds",
            "act force",
            "many speeds: viscous friction grows with speed, dry friction does not",
        ),
    ),
    (
        ("engagement_impact",),
        _GAP,
        _see(
            "ladder, circles, small circles",
            "act motor",
            "the size of the backlash shows at standstill after small steps, what the pick-up keeps of the motor's"
            " momentum grows with the speed across it: several feeds and accelerations",
        ),
    ),
    (
        ("cutting_force",),
        (*_FORCES, *_LOOP, "load_offset", "torque_saturation"),
        _see(
            _AIR,
            "act force",
            "in air there is no cutting force, and everything else is as before; run the program of this log"
            " once more in air, too",
        ),
    ),
    (
        ("position_dependent_backlash",),
        ("backlash",),
        _see(
            "places",
            "act motor",
            "reversals at several places: the same backlash everywhere, or another at each",
        ),
    ),
    (
        ("position_dependent_backlash",),
        ("cyclic_error", "scale_error"),
        _see(
            "places, sweeps",
            "act motor",
            "an error of the screw is the same in both directions, backlash is what differs between them",
        ),
    ),
    (
        ("stribeck_friction",),
        ("coulomb_friction",),
        _see(
            "speeds",
            "act force",
            "very slow strokes: only there does more friction at rest than in motion show",
        ),
    ),
    (
        ("torque_saturation",),
        ("elastic_windup", *_LOOP),
        _see(
            "small circles, fast",
            "act motor force",
            "a ladder of accelerations: saturation begins at one of them and flattens the force, the others grow"
            " in proportion",
        ),
    ),
    (
        ("cyclic_error",),
        ("scale_error", "thermal_growth"),
        _see(
            "sweeps, warm-up",
            "act",
            "over all of the way one repeats with the lead of the screw, one grows with the way, one with time",
        ),
    ),
)

BETWEEN: Final[Mapping[frozenset[str], Separation]] = {
    frozenset(pair): separation for one, other, separation in _TABLE for pair in product(one, other)
}
"""Separations of two effects."""


def separation(one: str, other: str) -> Separation:
    """Return the separation of two effects of the catalogue: of the table, or what shows each of them.

    Examples
    --------
    >>> separation("thermal_growth", "scale_error").parts
    ('warm-up',)
    >>> separation("squareness", "torque_saturation").parts
    ('diagonals', 'fast', 'small circles')
    """
    found = BETWEEN.get(frozenset((one, other)))
    if found is not None:
        return found
    first, second = SHOWN[one], SHOWN[other]
    whys = dict.fromkeys((first.why, second.why))
    return Separation(
        parts=tuple(dict.fromkeys((*first.parts, *second.parts))),
        record=_channels((*first.record, *second.record)),
        why="; ".join(whys),
    )


MOVED: Final = 0.1 * MM
"""An axis that was commanded over less than this [m] was not moved."""

GRAIN: Final = 0.001 * MM
"""To so much the room is rounded inwards [m]."""

OTHER_FEEDS: Final = (0.2, 1.0, 5.0)
"""Feeds of the circles, as multiples of the feed of the log."""

SPEED_SPAN: Final = 20.0 * MS
"""Time over which the speed of a log is measured [s]: commands come in steps."""

ROOM: Final = (
    "it moves within the positions of the log, with which G54 must agree: joints as LinuxCNC samples them are"
    " in machine coordinates, so that G54 must have no offset then"
)
"""Remark of a program on where it moves."""

FULL_MIX: Final = Separation(
    parts=("mix",),
    record=EVERY,
    why="everything that can be excited in one log: steps, places, sweeps, speeds, circles, diagonals",
)
"""Separation for a verdict without two names."""


def next_experiment(names: Sequence[str], axis: str, log: Log, machine: Machine) -> Experiment | None:
    """Write the program that separates effects which a log cannot separate.

    Parameters
    ----------
    names : sequence of str
        Effects, "effect:axis" where the axis is another. With fewer than two of the catalogue it is the full
        mix of motions that is written.
    axis : str
        Axis that they would be on.
    log : Log
        The program stays within the positions that it commanded, and uses other feeds.
    machine : Machine
        Its limits and its dialect.

    Returns
    -------
    Experiment or None
        None where the axis did not move, or is none of the machine's: nobody knows where it may go. Z moves
        only where it is the axis, or one of the names'.
    """
    others = [name.partition(":")[2] for name in names]
    involved = list(dict.fromkeys([axis, *(other for other in others if other)]))
    volume = _test_volume(involved, log, machine)
    if volume is None or axis not in volume.spans:
        return None
    found = _combined(names)
    where = [name for name in involved if name in volume.spans]

    def write(builder: ProgramBuilder) -> None:
        standstill(builder)
        for part in found.parts:
            for name in where if part != "mix" else where[:1]:
                PARTS[part](builder, name)
            standstill(builder)

    one = build_experiment(
        volume,
        _name(names, found, axis),
        _why(names, found),
        write,
        found.record,
        (ROOM,),
        gauge=any(name.partition(":")[0] in READINGS for name in names),
    )
    return msgspec.structs.replace(one, record=(*_missing_channels(where, found, log), *one.record))


def _combined(names: Sequence[str]) -> Separation:
    """Put together what separates every two of the names."""
    bases = [name.partition(":")[0] for name in names]
    known = [base for base in dict.fromkeys(bases) if base in SHOWN]
    if len(known) < 2:
        # One name on two axes is separated by moving one of them at a time.
        return SHOWN[known[0]] if known and len(set(names)) > 1 and len(set(bases)) == 1 else FULL_MIX
    pairs = [separation(one, other) for one, other in combinations(known, 2)]
    parts = dict.fromkeys(part for pair in pairs for part in pair.parts)
    needed = {channel for pair in pairs for channel in pair.record}
    return Separation(
        # It wants a cold machine, which the others would warm.
        parts=tuple(sorted(parts, key=lambda part: part != "warm-up")),
        record=_channels(needed),
        why="; ".join(dict.fromkeys(pair.why for pair in pairs)),
    )


def _name(names: Sequence[str], found: Separation, axis: str) -> str:
    """Call the program by the names, as long as that can be read."""
    if found is FULL_MIX:
        return f"mix_{axis.lower()}"
    bases = list(dict.fromkeys(name.partition(":")[0] for name in names))
    return f"{'_or_'.join(bases) if len(bases) <= 2 else 'separate'}_{axis.lower()}"


def _why(names: Sequence[str], found: Separation) -> str:
    return found.why if found is FULL_MIX else f"to separate {', '.join(names)}: {found.why}"


def _missing_channels(axes: Sequence[str], found: Separation, log: Log) -> list[str]:
    """Say which channels the log lacks, and of which readings the side is unknown."""
    lacking = [
        f"{axis}_{channel}"
        for axis in axes
        for channel in found.record
        if channel not in recorded_channels(log.axes[axis])
    ]
    lines = [f"also record: {', '.join(lacking)}"] if lacking else []
    unknown = [axis for axis in axes if log.axes[axis].side == "unknown"]
    return lines + [
        f"say where {axis}_act is read: at the table, or at the motor, where it is {axis}_motor" for axis in unknown
    ]


def _test_volume(involved: Sequence[str], log: Log, machine: Machine) -> TestVolume | None:
    """Room and feeds: where the log went, and feeds around its own."""
    moved = {
        axis: _span(axis_log)
        for axis, axis_log in log.axes.items()
        if axis in machine.axes and np.ptp(axis_log.command) > MOVED
    }
    wanted = [axis for axis in moved if axis in involved]
    if len(wanted) == 1:
        # One partner for circles and diagonals; Z is nobody's.
        wanted += [axis for axis in moved if axis not in (*involved, "Z") and wanted != ["Z"]][:1]
    axes = tuple(axis for axis in AXES if axis in wanted)
    if not axes:
        return None
    spans = {axis: moved[axis] for axis in axes}
    radius = RADIUS_SHARE * min(high - low for low, high in spans.values())
    top = TOP_SHARE * arc_speed(machine, axes, radius)
    return TestVolume(
        machine=machine,
        spans=spans,
        radius=radius,
        settle=settling_time(machine, axes),
        feeds=_feeds(_cruise(log, axes), top),
    )


def _span(axis_log: AxisLog) -> tuple[float, float]:
    """Commanded range [m], rounded inwards."""
    low, high = float(axis_log.command.min()), float(axis_log.command.max())
    return math.ceil(low / GRAIN) * GRAIN, math.floor(high / GRAIN) * GRAIN


def _cruise(log: Log, axes: Sequence[str]) -> float:
    """Speed that the log holds for long where it moves [m/s]: the median of the faster half."""
    lag = max(1, round(SPEED_SPAN / log.period))
    steps = [log.axes[axis].command[lag:] - log.axes[axis].command[:-lag] for axis in axes]
    speed: Array = np.sqrt(sum(step * step for step in steps)) / (lag * log.period)
    moving = speed[speed > 0.0]
    return float(np.percentile(moving, 75.0)) if moving.size else CRAWL


def _feeds(cruise: float, top: float) -> tuple[float, ...]:
    """Choose feeds around the log's, within what circles allow: at least one is another."""
    low = min(CRAWL, 0.2 * top)
    found = sorted({min(max(share * cruise, low), top) for share in OTHER_FEEDS})
    return tuple(found) if len(found) > 1 else (0.2 * found[0], found[0])
