"""Warnings of what a controller makes of a path: corners rounded by more than the backlash, arcs drawn in chords."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.dialects.base import Dialect
from ph_post.dialects.planners import chord_setting, planner_of, values_of, with_finer_chords
from ph_post.files.machine import PLANNER_KEYS
from ph_post.gcode.motion_parts import arc_lengths
from ph_post.gcode.program import ARC, AXES, CUBIC, NURBS, RAPID, PartProgram, number_text, plane_columns
from ph_post.simulate.controllers.chords import chord_errors
from ph_post.simulate.controllers.legs import ACROSS, Legs
from ph_post.simulate.controllers.moves import limit_table, tolerances, written_legs
from ph_post.simulate.controllers.planner import QUARTER
from ph_post.types import Array, BoolArray, ExactPath, Machine, RoundedPath
from ph_post.units import MICROMETRE, MM

WIDEST: Final = 0.01 * MM
"""Rounding [m] that is advised where the backlash is large."""

PART: Final = 0.5
"""Share of the backlash that corners may be rounded by as is advised."""

COARSE: Final = 1.001
"""Chords are coarser than a tolerance beyond this multiple of it: a setting of the same size is meant to keep it."""

FINEST_CHORD: Final = 1e-6 * MM
"""Nothing finer is advised [m]."""

_STILL: Final = 1e-9
"""Part of a direction below which an axis does not move; angles [rad] below it are none."""

_SHARPEST: Final = math.pi - 0.05
"""Angle [rad] from which a corner is a reversal, where the axes stop."""

_CONTINUOUS: Final = 64.0
_MODES: Final = (61.0, 61.1, _CONTINUOUS)


def path_mode_warnings(program: PartProgram, machine: Machine, dialect: Dialect) -> list[str]:
    """Warn of path modes that round corners of cuts by more than the smallest backlash of the axes that move there.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    dialect : Dialect
        The machine's. Of planners that follow the path exactly it is said that G64 is no word of theirs.

    Returns
    -------
    list of str
        A sentence for every path mode, with its line, the worst corner and the word that helps.
    """
    planner = planner_of(machine)
    if isinstance(planner, ExactPath) and dialect.syntax.path_mode is None:
        return _unknown_modes(program, dialect)
    gaps = np.array([machine.axes[name].gap.lost_motion if name in machine.axes else 0.0 for name in AXES])
    remedy = dialect.syntax.path_mode
    if not isinstance(planner, RoundedPath) or remedy is None or not gaps.any() or program.motions.kind.size < 2:
        return []
    rounded, moves = corner_rounding(program, machine, tolerances(program, planner))
    backlash = np.where(moves & (gaps > 0.0), gaps, math.inf).min(axis=1)
    words = program.commands
    modes = words.block[words.g_words(*_MODES)]
    mode = np.searchsorted(modes, program.motions.block[:-1], side="right")
    said = []
    for number in np.unique(mode[rounded > backlash]).tolist():
        worst = int(np.argmax(np.where(mode == number, rounded / backlash, 0.0)))
        motion = program.motions.block[worst]
        named = f"{program.line_words(modes[number - 1])}: {program.modal_after(int(motion)).path}" if number else ""
        units = program.modal_after(int(motion)).units
        advised = float(f"{min(WIDEST, PART * backlash[worst]) / units:.1g}")
        size, line = _micrometres(rounded[worst]), program.line_words(motion)
        said.append(
            f"{_mode_words(named)} rounds corners by up to {size} ({line}), more than the backlash of"
            f" {_micrometres(backlash[worst])}: {remedy(advised * MM)} keeps them within"
            f" {_micrometres(advised * units)}"
        )
    return said


def _unknown_modes(program: PartProgram, dialect: Dialect) -> list[str]:
    """Warn of the first G64: no such firmware has it, and Grbl stops there (error 20)."""
    words = program.commands
    blocks = words.block[words.g_words(_CONTINUOUS)]
    if not blocks.size:
        return []
    return [
        f"{program.line_words(blocks[0])}: G64 is no word of {dialect.name}, which follows the path exactly and may"
        " stop there with an error: take it out"
    ]


def chord_warnings(program: PartProgram, machine: Machine, dialect: Dialect, tolerance: float) -> list[str]:
    """Warn, once, where the controller itself draws arcs in chords that are coarser than the tolerance.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    dialect : Dialect
        The machine's. Nothing is said of controllers that draw arcs.
    tolerance : float
        [m].

    Returns
    -------
    list of str
        A sentence with the worst arc, and the setting that keeps them all within the tolerance; or none.
    """
    planner, motions = planner_of(machine), program.motions
    arcs = np.flatnonzero((motions.kind == ARC) & np.isfinite(motions.start).any(axis=1))
    if not isinstance(planner, ExactPath) or not dialect.notices.arc_setting or not arcs.size:
        return []
    rows = np.arange(arcs.size)[:, None]
    columns = plane_columns(motions.plane[arcs])[:, :2]
    ray = motions.start[arcs][rows, columns] - motions.center[arcs]
    sizes = np.hypot(*ray.T), motions.angle[arcs], arc_lengths(motions, arcs)
    error = chord_errors(planner, *sizes)
    worst = int(np.argmax(error))
    if not error[worst] > COARSE * tolerance:
        return []
    setting = chord_setting(planner)
    size = values_of(planner)[setting]
    while chord_errors(with_finer_chords(planner, size), *sizes).max() > tolerance and size > FINEST_CHORD:
        size = float(f"{0.9 * size:.1e}")
    line = int(motions.block[arcs[worst]]) + 1
    return [
        f"{dialect.name} draws arcs as straight chords, here up to {_micrometres(error[worst])} inside them (line"
        f" {line}), more than the {_micrometres(tolerance)} of --tolerance: {dialect.notices.arc_setting} ="
        f" {size / MM:g} keeps them within it ({PLANNER_KEYS[setting][0]} in the machine file)"
    ]


def _mode_words(named: str) -> str:
    if not named:
        return "no line sets a path mode: the controller"
    return named if "P" in named else f"{named} without P"


def _micrometres(length: float) -> str:
    return f"{number_text(float(f'{length / MICROMETRE:.2g}'))} µm"


def corner_rounding(program: PartProgram, machine: Machine, allowed: Array) -> tuple[Array, BoolArray]:
    """Return how far the corner behind each motion but the last may be rounded, and which axes move there.

    LinuxCNC puts an arc into a corner that is no wider than its speed asks for, takes at most half of the shorter
    side, and leaves the corner by at most a quarter of that.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    allowed : Array, shape (n,)
        What the path mode allows behind each motion [m]: 0 for anything, below 0 for nothing.

    Returns
    -------
    rounded : Array, shape (n - 1,)
        [m], 0 where it is not rounded.
    moves : BoolArray, shape (n - 1, 3)
        X, Y and Z.
    """
    motions = program.motions
    limits = limit_table(machine)
    legs = written_legs(program, limits)
    before, after = _tangents(legs, at_end=True)[:-1], _tangents(legs, at_end=False)[1:]
    turn = np.arccos(np.clip((before * after).sum(axis=1), -1.0, 1.0))
    shorter = np.minimum(legs.length[:-1], legs.length[1:])
    found = np.minimum(0.5 * shorter * np.tan(0.25 * turn), QUARTER * shorter)
    fast = np.maximum(legs.speed[:-1], legs.speed[1:])
    moves = (np.abs(before) + np.abs(after)) > _STILL
    push = np.where(moves, limits[:, 1], math.inf).min(axis=1)
    radius = fast * fast / push * np.maximum(1.0 / ACROSS, 2.0 / np.maximum(turn, _STILL))
    found = np.minimum(found, radius * (1.0 / np.cos(0.5 * np.minimum(turn, _SHARPEST)) - 1.0))
    for side in (allowed[:-1], allowed[1:]):
        found = np.where(side > 0.0, np.minimum(found, side), found)
    plain = ~np.isin(motions.kind, (RAPID, CUBIC, NURBS))
    through = plain[:-1] & plain[1:] & (legs.drains[1:] == 0.0) & (allowed[:-1] >= 0.0)
    return np.where(through & (turn < _SHARPEST), found, 0.0), moves


def _tangents(legs: Legs, *, at_end: bool) -> Array:
    """Return unit tangents of legs at one of their ends."""
    angle = (legs.sweep if at_end else 0.0 * legs.sweep)[:, None]
    round_about = (legs.radius * legs.sweep)[:, None] * (np.cos(angle) * legs.second - np.sin(angle) * legs.first)
    way = np.where(legs.radius[:, None] > 0.0, round_about + legs.rise, legs.first)
    size = np.sqrt((way * way).sum(axis=1))
    return np.asarray(way / np.where(size > 0.0, size, 1.0)[:, None])
