"""The time that axes beside X, Y and Z take in a program, as its controller reckons it."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from ph_post.dialects.registry import find_dialect, is_dialect
from ph_post.gcode.further import further_moves, unit_of
from ph_post.gcode.motion_parts import places_along
from ph_post.gcode.program import AXES, RAPID, PartProgram, feed_runs
from ph_post.types import Array, Limits, Machine, sealed
from ph_post.units import MINUTE

_INVERSE = 93


def with_further_times(program: PartProgram, machine: Machine) -> PartProgram:
    """Return a program in which X, Y and Z wait for axes beside them: with lower feeds, longer times, and rests.

    All axes of a line begin and end together. F counts along X, Y and Z, and along others only where those rest
    (LinuxCNC, "Feed Rate" in its G-code overview; Marlin, `planner.cpp`), or along all of them, degrees as mm (Grbl,
    `plan_buffer_line`; FANUC B-64484EN, "Cutting feedrate control"). An axis that the machine file has not is as quick
    as it is asked to be.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    """
    moved = further_moves(program)
    if not moved:
        return program
    motions = program.motions
    # By line: the longest time of an axis at its own speed, and the squares of all ways, in the program's units.
    least, squares = np.zeros(program.blocks), np.zeros(program.blocks)
    for letter, moves in moved.items():
        way = np.nan_to_num(np.abs(moves.end - moves.start))
        units = np.array([unit_of(letter, program.modal[n].units) for n in program.state[moves.block].tolist()])
        np.add.at(squares, moves.block, (way / units) ** 2)
        if letter in machine.further:
            limits = machine.further[letter].limits
            time = np.where(moves.rapid, _rest_to_rest(way, limits), way / limits.velocity)
            np.maximum.at(least, moves.block, time)
    rests = {block: _alone(program, block, least[block], squares[block]) for block in np.flatnonzero(squares).tolist()}
    row = np.flatnonzero(squares[motions.block])
    feed, duration = np.array(motions.feed), motions.duration.copy()
    length = np.diff(places_along(motions))
    whole = is_dialect(machine.dialect) and find_dialect(machine.dialect).abilities.feed_along_all
    for k in row.tolist():
        block = int(motions.block[k])
        if motions.kind[k] == RAPID:
            rests[block] = max(float(least[block]) - _rapid_time(motions.end[k] - motions.start[k], machine), 0.0)
        elif length[k] > 0.0:
            del rests[block]
            units = program.modal[program.state[block]].units
            way = np.hypot(length[k] / units, np.sqrt(squares[block]) if whole else 0.0) * units
            if duration[k] > 0.0:
                duration[k] = max(duration[k], least[block])
            elif feed[k] > 0.0:
                feed[k] = length[k] / max(way / feed[k], least[block])
    slower = replace(motions, feeds=feed_runs(feed), duration=sealed(duration))
    return replace(program, motions=slower, rests={block: time for block, time in rests.items() if time > 0.0})


def _rest_to_rest(way: float | Array, limits: Limits) -> Array:
    """Return the times of moves from rest to rest."""
    v, a = limits.velocity, limits.acceleration
    return np.where(way < v * v / a, 2.0 * np.sqrt(way / a), way / v + v / a)


def _alone(program: PartProgram, block: int, least: float, square: float) -> float:
    """Return the time of a line on which X, Y and Z rest."""
    modal, feed = program.modal[program.state[block]], program.feed_after(block)
    if modal.motion == "G0" or not feed > 0.0:
        return least
    return max(least, MINUTE / feed if modal.feed_mode == _INVERSE else float(np.sqrt(square)) / feed * MINUTE)


def _rapid_time(way: Array, machine: Machine) -> float:
    """Return the time of a rapid of X, Y and Z from rest to rest."""
    ways = {name: abs(float(one)) for name, one in zip(AXES, way, strict=True) if np.isfinite(one)}
    known = machine.axes.items()
    return max((float(_rest_to_rest(ways[name], axis.limits)) for name, axis in known if name in ways), default=0.0)
