"""Lasting offsets of axes behind their loop: which way each axis was moved last, and where that changes.

An axis with feedback at the motor, or with none, carries half its lost motion ahead of the path in the
direction in which it moves. Where it turns back the path stands still and the axis is moved through the gap;
a rapid that takes it away carries the change itself. What a rapid moves is told by its direction as well: so
holes are drilled where they belong, and the tool goes down where it is to cut.

Where an axis rests between the two directions (a line parallel to the other axis), the change is made at a
place of the rest where the path stands or is slowest anyway, the first one of equals: so behind a rapid it is
made before the tool goes down, and a slot's corners serve twice. Nothing else tells the places of a rest
apart: until the axis moves again only friction holds the table, on whichever flank the motor stands.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.compensate.jogs import carries_offset, make_jog
from ph_post.compensate.words import friction_words, varying_words
from ph_post.gcode.controller.moves import moved_axes
from ph_post.gcode.dialect import Dialect
from ph_post.gcode.reader.record import AXES, RAPID, PartProgram
from ph_post.gcode.splice.cost import pauses
from ph_post.gcode.splice.directions import CARRIED, CHAIN, MOTION, SHARE, SIGN
from ph_post.gcode.splice.grid import half_gap
from ph_post.gcode.splice.merge import merge
from ph_post.gcode.splice.options import SpliceOptions
from ph_post.gcode.splice.record import Edits, Shift, Stop
from ph_post.gcode.splice.search import Search, affordable
from ph_post.gcode.splice.standing import (
    blocked_chains,
    double_compensation,
    program_troubles,
    program_units,
    tell_blocked,
    tell_unknown,
)
from ph_post.gcode.splice.view import chain_spans
from ph_post.types import Array, Axis, BoolArray, Machine, frozen, sealed

SEAT: Final = 3.0
"""How far before its place an axis comes onto its flank where the flank it stands on is not known, in halves
of the lost motion: with the half that is added this is twice the lost motion, as a program's approach has."""


def plan_offsets(program: PartProgram, machine: Machine, dialect: Dialect, options: SpliceOptions) -> Edits:
    """Plan the lasting offsets of all axes that carry one.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    dialect : Dialect
        Whose decimals the offsets are rounded to.
    options : SpliceOptions

    Returns
    -------
    Edits
        With stops, but no dips; `warnings` name what is left alone.

    Raises
    ------
    InputError
        Where the dialect's decimals are too few for an axis.
    """
    said = tuple(varying_words(machine.axes[name] for name in moved_axes(program)))
    nothing = Edits(offset=frozen(np.zeros((program.motions.kind.size, 3))), warnings=said)
    axes = [
        machine.axes[name] for name in AXES if name in machine.axes and carries_offset(machine.axes[name])
    ]
    if not axes or program.motions.kind.size == 0:
        return nothing
    troubles = program_troubles(program)
    if troubles:
        said += tuple(f"the program carries no lasting offset: {trouble}" for trouble in troubles)
        return Edits(offset=nothing.offset, warnings=said)
    units = program_units(program)[0]
    amplitude = {axis.name: half_gap(axis, dialect, units) for axis in axes}
    blocked = blocked_chains(program)
    search = Search(program, machine, dialect, amplitude, _open_chains(program, blocked))
    changes, said_of_time = affordable(search, options)
    offset, edits = np.zeros(nothing.offset.shape), nothing
    for name, rows in changes.items():
        column = offset[:, AXES.index(name)]
        _fill(column, rows, amplitude[name])
        if column.any():
            found = _edits_of(program, machine.axes[name], amplitude[name], rows, nothing.offset)
            edits = merge(edits, found)
    edits = replace(edits, offset=sealed(offset))
    told = [*said, *tell_blocked(program, blocked), *tell_unknown(program, amplitude), *said_of_time]
    return _with_warnings(edits, program, dialect, told)


def _open_chains(program: PartProgram, blocked: dict[str, BoolArray]) -> BoolArray:
    """Chains that cut, and that nothing keeps from being shifted."""
    low, _ = chain_spans(program.motions)
    cuts = np.logical_or.reduceat(program.motions.kind != RAPID, low)
    for marks in blocked.values():
        cuts &= ~marks
    return np.asarray(cuts)


def _fill(offset: Array, rows: Array, amplitude: float) -> None:
    """Write the offset of one axis at the end of every motion; each change lasts until the next."""
    starts = np.append(rows[:, MOTION], offset.size).astype(np.int64).tolist()
    for (low, high), sign in zip(pairwise(starts), rows[:, SIGN].tolist(), strict=True):
        offset[low:high] = sign * amplitude


def _edits_of(program: PartProgram, axis: Axis, amplitude: float, rows: Array, nothing: Array) -> Edits:
    """Turn the changes of one axis into stops; the last change of every chain is to none."""
    stops, seated = _stops(program, axis, amplitude, rows)
    return Edits(
        offset=nothing, stops=stops, amplitude={axis.name: amplitude},
        pulse={axis.name: SEAT * amplitude} if seated else {},
    )  # fmt: skip


def _stops(program: PartProgram, axis: Axis, amplitude: float, rows: Array) -> tuple[tuple[Stop, ...], bool]:
    """Make stops of changes, and say whether any of them seats the axis.

    The first change of a chain finds the axis on either flank. Behind a rapid, so in the air, it comes from
    beyond the gap.
    """
    before = np.append(0.0, rows[:-1, SIGN])
    first = np.append(True, np.diff(rows[:, CHAIN]) != 0.0)
    before[first] = 0.0
    steps = rows[:, SIGN] - before
    rapid = (program.motions.kind[rows[:, MOTION].astype(np.int64)] == RAPID) & (rows[:, SHARE] == 1.0)
    seats = first & rapid
    made = np.flatnonzero((rows[:, CARRIED] == 0.0) & (steps != 0.0))
    velocity = {size: make_jog(axis, size * amplitude, 0.0).velocity for size in (1.0, 2.0, SEAT, SEAT + 1.0)}
    stops = []
    for n, rest in zip(made.tolist(), pauses(axis, rows[made]), strict=True):
        ways = (-SEAT * steps[n], (SEAT + 1.0) * steps[n]) if seats[n] else (steps[n],)
        shifts = tuple(
            Shift(
                axis=axis.name,
                travel=float(way) * amplitude,
                velocity=velocity[abs(float(way))],
                pause=float(rest),
            )
            for way in ways
        )
        stops.append(
            Stop(motion=int(rows[n, MOTION]), share=float(rows[n, SHARE]), pause=float(rest), shifts=shifts)
        )
    return tuple(stops), bool(seats[made].any())


def _with_warnings(edits: Edits, program: PartProgram, dialect: Dialect, said: list[str]) -> Edits:
    if edits.amplitude:
        own = double_compensation(program, dialect.name)
        said = [*said, *friction_words(edits.amplitude), *own, *dialect.cautions]
    return replace(edits, warnings=tuple(said))
