"""What stops cost in time."""

from __future__ import annotations

import numpy as np

from ph_post.compensate.jogs import DWELL, PART, corner_pause, make_jog
from ph_post.gcode.reader.record import ARC, CUBIC, RAPID, PartProgram, plane_columns
from ph_post.gcode.splice.directions import CARRIED, MOTION, PASSED, SHARE
from ph_post.types import Array, Axis, IntArray, Machine


def motion_times(program: PartProgram, machine: Machine) -> Array:
    """Time of every motion at its feed [s], shape (m,), ramps and corners left out."""
    motions = program.motions
    with np.errstate(invalid="ignore", divide="ignore"):
        way = np.nan_to_num(np.abs(motions.end - motions.start))
        length = np.sqrt((way * way).sum(axis=1))
        arcs = np.flatnonzero(motions.kind == ARC)
        length[arcs] = _arc_lengths(program, arcs)
        for k in np.flatnonzero(motions.kind == CUBIC).tolist():
            way_k = np.diff(np.nan_to_num(motions.control[k]), axis=0)
            length[k] = np.sqrt((way_k**2).sum(axis=1)).sum()
        rapid = np.zeros(length.size)
        for column, name in enumerate("XYZ"):
            if name in machine.axes:
                rapid = np.maximum(rapid, way[:, column] / machine.axes[name].limits.velocity)
        cut = np.where(motions.duration > 0.0, motions.duration, length / motions.feed)
        return np.nan_to_num(np.where(motions.kind == RAPID, rapid, cut), posinf=0.0)


def _arc_lengths(program: PartProgram, arcs: IntArray) -> Array:
    """Length of arcs and helices [m]."""
    motions = program.motions
    planes = plane_columns(motions.plane[arcs])
    start = np.take_along_axis(motions.start[arcs], planes[:, :2], axis=1) - motions.center[arcs]
    rise = np.take_along_axis(motions.end[arcs] - motions.start[arcs], planes[:, 2:], axis=1)[:, 0]
    swept = np.hypot(start[:, 0], start[:, 1]) * motions.angle[arcs]
    return np.asarray(np.hypot(swept, np.nan_to_num(rise)))


def least_acceleration(machine: Machine) -> float:
    """Acceleration [m/s²] with which the path is stopped whatever its direction."""
    return PART * min(axis.limits.acceleration for axis in machine.axes.values())


def pauses(axis: Axis, rows: Array) -> Array:
    """Rests [s] beside the jogs of one axis: longer where the path stands anyway, as in corners."""
    return np.where(rows[:, PASSED] == 0.0, corner_pause(axis), DWELL)


def stop_cost(changes: dict[str, Array], travel: dict[str, float], machine: Machine) -> float:
    """Time [s] that the changes of all axes cost.

    A stop takes the path's speed away and gives it back, each of which costs half of the time that it takes;
    it begins with a dwell, and every jog ends with one. Axes that change at the same place share the stop.
    """
    jogs, places, speeds, rests = 0.0, [], [], []
    for name, rows in changes.items():
        stopped = rows[rows[:, CARRIED] == 0.0]
        axis = machine.axes[name]
        jogs += len(stopped) * make_jog(axis, travel[name], 0.0).duration
        rests.append(pauses(axis, stopped))
        places.append(stopped[:, [MOTION, SHARE]])
        speeds.append(stopped[:, PASSED])
    if not places:
        return 0.0
    _, kept = np.unique(np.concatenate(places), axis=0, return_index=True)
    rest = np.concatenate(rests)
    braking = np.concatenate(speeds)[kept].sum() / least_acceleration(machine)
    return float(jogs + rest.sum() + rest[kept].sum() + braking)
