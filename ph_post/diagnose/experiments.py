"""The next experiment: what separates the effects that a record cannot tell apart."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final

import msgspec
import numpy as np

from ph_post.diagnose.experimenttable import READINGS, SHOWN, Separation, separation
from ph_post.diagnose.kitdraft import Draft
from ph_post.diagnose.kitground import CRAWL, TOP_SHARE, Ground, arc_speed, settling_time
from ph_post.diagnose.kitparts import PARTS, standstill
from ph_post.diagnose.kitprogram import experiment
from ph_post.diagnose.kitrecord import EVERY
from ph_post.diagnose.record import Channel, Experiment
from ph_post.types import Array, AxisLog, Log, Machine
from ph_post.units import MM, MS

MOVED: Final = 0.1 * MM
"""An axis that was commanded over less than this [m] was not moved."""

GRAIN: Final = 0.001 * MM
"""To so much the room is rounded inwards [m]."""

RADIUS_SHARE: Final = 0.3
"""Radius of the circles as a share of the smallest room."""

OTHER_FEEDS: Final = (0.2, 1.0, 5.0)
"""Feeds of the circles by that of the record."""

SPEED_SPAN: Final = 20.0 * MS
"""Time over which the speed of a record is measured [s]: commands come in steps."""

ROOM: Final = (
    "the room is that of the positions in the record, with which G54 must agree: joints as LinuxCNC samples"
    " them are in machine coordinates, so that G54 must have no offset then"
)
"""What a program says about where it moves."""

FULL_MIX: Final = Separation(
    parts=("mix",), record=EVERY,
    why="everything that can be excited in one record: steps, places, sweeps, speeds, circles, diagonals",
)  # fmt: skip
"""For a verdict that no pair of names stands behind."""


def next_experiment(names: Sequence[str], axis: str, log: Log, machine: Machine) -> Experiment | None:
    """Write the program that separates effects which a record cannot tell apart.

    Parameters
    ----------
    names : sequence of str
        Effects, "effect:axis" where the axis is another. With fewer than two of the catalogue it is the full
        mix of motions that is written.
    axis : str
        Axis that they would be on.
    log : Log
        The record: the program stays within the positions that it commanded, and uses other feeds.
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
    ground = _ground(involved, log, machine)
    if ground is None or axis not in ground.spans:
        return None
    found = _combined(names)
    where = [name for name in involved if name in ground.spans]

    def write(draft: Draft) -> None:
        standstill(draft)
        for part in found.parts:
            for name in where if part != "mix" else where[:1]:
                PARTS[part](draft, name)
            standstill(draft)

    one = experiment(
        ground, _name(names, found, axis), _told(names, found), write, found.record, (ROOM,),
        gauge=any(name.partition(":")[0] in READINGS for name in names),
    )  # fmt: skip
    return msgspec.structs.replace(one, record=(*_news(where, found, log), *one.record))


def _combined(names: Sequence[str]) -> Separation:
    """Put together what separates every two of the names."""
    bases = [name.partition(":")[0] for name in names]
    known = [base for base in dict.fromkeys(bases) if base in SHOWN]
    if len(known) < 2:
        # One name on two axes is told apart by moving one of them at a time.
        return SHOWN[known[0]] if known and len(set(names)) > 1 and len(set(bases)) == 1 else FULL_MIX
    pairs = [separation(one, other) for one, other in combinations(known, 2)]
    parts = dict.fromkeys(part for pair in pairs for part in pair.parts)
    needed = {channel for pair in pairs for channel in pair.record}
    return Separation(
        # It wants a cold machine, which the others would warm.
        parts=tuple(sorted(parts, key=lambda part: part != "warm-up")),
        record=tuple(channel for channel in EVERY if channel in needed),
        why="; ".join(dict.fromkeys(pair.why for pair in pairs)),
    )


def _name(names: Sequence[str], found: Separation, axis: str) -> str:
    """Call the program by the names, as long as that can be read."""
    if found is FULL_MIX:
        return f"mix_{axis.lower()}"
    bases = list(dict.fromkeys(name.partition(":")[0] for name in names))
    return f"{'_or_'.join(bases) if len(bases) <= 2 else 'separate'}_{axis.lower()}"


def _told(names: Sequence[str], found: Separation) -> str:
    return found.why if found is FULL_MIX else f"to separate {', '.join(names)}: {found.why}"


def _news(axes: Sequence[str], found: Separation, log: Log) -> list[str]:
    """Channels that are needed and that the record lacks, and a side that nobody told."""
    lacking = [
        f"{axis}_{_COLUMN[channel]}"
        for axis in axes
        for channel in found.record
        if getattr(log.axes[axis], _FIELD[channel]) is None
    ]
    lines = [f"new beside the last record: {', '.join(lacking)}"] if lacking else []
    unknown = [axis for axis in axes if log.axes[axis].side == "unknown"]
    return lines + [
        f"say where {axis}_act is read: at the table, or at the motor, where it is {axis}_motor"
        for axis in unknown
    ]


_FIELD: Final[Mapping[Channel, str]] = {"act": "table", "motor": "motor", "force": "effort"}
_COLUMN: Final[Mapping[Channel, str]] = {"act": "act", "motor": "motor", "force": "force"}


def _ground(involved: Sequence[str], log: Log, machine: Machine) -> Ground | None:
    """Room and feeds: where the record went, and feeds around its own."""
    moved = {
        axis: _span(record)
        for axis, record in log.axes.items()
        if axis in machine.axes and np.ptp(record.command) > MOVED
    }
    wanted = [axis for axis in moved if axis in involved]
    if len(wanted) == 1:
        # One partner for circles and diagonals; Z is nobody's.
        wanted += [axis for axis in moved if axis not in (*involved, "Z") and wanted != ["Z"]][:1]
    axes = tuple(axis for axis in "XYZ" if axis in wanted)
    if not axes:
        return None
    spans = {axis: moved[axis] for axis in axes}
    radius = RADIUS_SHARE * min(high - low for low, high in spans.values())
    top = TOP_SHARE * arc_speed(machine, axes, radius)
    return Ground(
        machine=machine, spans=spans, radius=radius, settle=settling_time(machine, axes),
        feeds=_feeds(_cruise(log, axes), top),
    )  # fmt: skip


def _span(record: AxisLog) -> tuple[float, float]:
    """Commanded range [m], rounded inwards."""
    low, high = float(record.command.min()), float(record.command.max())
    return math.ceil(low / GRAIN) * GRAIN, math.floor(high / GRAIN) * GRAIN


def _cruise(log: Log, axes: Sequence[str]) -> float:
    """Speed that the record holds for long where it moves [m/s]: the median of the faster half."""
    lag = max(1, round(SPEED_SPAN / log.period))
    steps = [log.axes[axis].command[lag:] - log.axes[axis].command[:-lag] for axis in axes]
    speed: Array = np.sqrt(sum(step * step for step in steps)) / (lag * log.period)
    moving = speed[speed > 0.0]
    return float(np.percentile(moving, 75.0)) if moving.size else CRAWL


def _feeds(cruise: float, top: float) -> tuple[float, ...]:
    """Choose feeds around that of the record, within what circles allow: at least one is another."""
    low = min(CRAWL, 0.2 * top)
    found = sorted({min(max(share * cruise, low), top) for share in OTHER_FEEDS})
    return tuple(found) if len(found) > 1 else (0.2 * found[0], found[0])
