"""Analyses, plans and machines as plain objects for JSON.

Keys and units are those of the interface; null stands for what does not exist.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np

from ph_post.analysis.certification import Certificate
from ph_post.analysis.path_analysis import Analysis, feed_at
from ph_post.api.motion import Inspection
from ph_post.compensate.comparison import crossings_at, strategy_at, window_number
from ph_post.compensate.motion import cycle_time, without_strategy
from ph_post.compensate.offsets import plan_time
from ph_post.compensate.standstill import standing_time, standstills
from ph_post.gcode.program import PlaceArray
from ph_post.geometry.piecewise import MEETS
from ph_post.geometry.track import Track
from ph_post.quantities import millimetres
from ph_post.simulate.contour import ContourError, TurningError
from ph_post.types import (
    Array,
    Axis,
    Command,
    Crossing,
    FeedProfile,
    Jog,
    Machine,
    Plan,
    TurningPoint,
    Window,
)
from ph_post.units import MM, MM_PER_MIN, MS


def error_view(error: ContourError | TurningError | None) -> View | None:
    """Return an error as INTERFACE §5 has it [mm]."""
    return None if error is None else {"max": error.max / MM, "rms": error.rms / MM}


def machine_view(machine: Machine) -> dict[str, Any]:
    """Return the properties of a machine in mm, mm/min, mm/s², ms and s.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> machine_view(read_machine("stepper"))["axes"]["Z"]["lost_motion"]
    0.03
    """
    return {
        "title": machine.name,
        "dialect": machine.dialect,
        "servo_period": _short(machine.servo_period / MS),
        "axes": {
            name: {
                "feedback": axis.feedback,
                "lost_motion": _short(axis.gap.lost_motion / MM),
                "b": axis.servo.b,
                "c": axis.servo.c,
                "max_velocity": _short(axis.limits.velocity / MM_PER_MIN),
                "max_acceleration": _short(axis.limits.acceleration / MM),
                "effects": [effect.name for effect in axis.effects],
            }
            for name, axis in machine.axes.items()
        },
    }


def machine_cells(name: str, machine: Machine) -> tuple[str, ...]:
    """Return a line of the list of machines: name, loops, dialect, lost motion by axis [mm], title."""
    loops = dict.fromkeys(axis.feedback for axis in machine.axes.values())
    gaps = " ".join(f"{axis} {millimetres(one.gap.lost_motion)}" for axis, one in machine.axes.items())
    return name, "/".join(loops), machine.dialect, gaps, machine.name


def machine_table(machine: Machine, axes: Sequence[str]) -> dict[str, Any]:
    """Return a machine for a page: rows with a word for each of the axes, and its effects."""
    drives = [machine.axes[name] for name in axes]
    return {
        "name": machine.name,
        "dialect": machine.dialect,
        "period": _short(machine.servo_period / MS),
        "axes": list(axes),
        "rows": [[name, *map(cell, drives)] for name, cell in _CELLS.items()],
        "effects": [
            {"axis": axis.name, "name": one.name, "parameters": dict(one.parameters)}
            for axis in drives
            for one in axis.effects
        ],
    }


def _pickup(axis: Axis) -> str:
    return axis.gap.pickup or ("all are tried" if axis.loop.encloses_backlash else "-")


def _flank(axis: Axis) -> str:
    known = axis.gap.initial_flank
    return "both are tried" if known == "unknown" else known


def _zero(axis: Axis) -> str:
    if axis.gravity_side is not None:
        return "held by gravity"
    if axis.loop.encloses_backlash:
        return "the scale's"
    return {0: "both ways", 1: "moving to plus", -1: "moving to minus"}[axis.reference_side]


_CELLS: Final[dict[str, Callable[[Axis], str]]] = {
    "loop": lambda axis: axis.loop.label,
    "lost motion [mm]": lambda axis: millimetres(axis.gap.lost_motion),
    "lost motion known to": lambda axis: f"± {100.0 * axis.uncertainty.backlash:g} %",
    "b [s²]": lambda axis: f"{axis.servo.b:.4g}",
    "c [s]": lambda axis: f"{axis.servo.c:.4g}",
    "pick-up": _pickup,
    "starts on side": _flank,
    "zero taken": _zero,
    "highest velocity [mm/s]": lambda axis: f"{axis.limits.velocity / MM:.6g}",
    "highest acceleration [mm/s²]": lambda axis: f"{axis.limits.acceleration / MM:.6g}",
    "highest jerk [mm/s³]": lambda axis: f"{axis.limits.jerk / MM:.6g}",
}


def _short(value: float) -> float:
    """Drop the digits that a conversion of units adds."""
    return float(f"{value:.12g}")


View = dict[str, Any]


def window_view(window: Window | None) -> View | None:
    """Return a window as INTERFACE §5 lists it; `estimate` is null on a circle."""
    if window is None:
        return None
    return {
        "half_length": window.half_length / MM,
        "limited_by": window.limited_by,
        "estimate": _finite(window.estimate, MM),
        "contact_order": window.contact_order,
        "members": list(window.members),
        "notes": list(window.notes),
    }


def turning_point_views(analysis: Analysis) -> list[View]:
    """Every turning point with its window and backlash interval."""
    windows = windows_by_point(analysis.windows)
    return [_turning_point(analysis, point, windows.get(point.index)) for point in analysis.turning_points]


def windows_by_point(windows: tuple[Window, ...]) -> dict[int, Window]:
    """Return the window of every turning point that has one, its own or a shared one."""
    return {member: window for window in windows for member in window.members}


def _turning_point(analysis: Analysis, point: TurningPoint, window: Window | None) -> View:
    return {
        "index": point.index,
        "kind": point.kind,
        "segment": point.segment,
        "xi": point.xi,
        "axis": point.axis,
        "sense": point.sense,
        "position": point.position / MM,
        "s": point.s / MM,
        "curvature": _scaled(point.curvature, 1 / MM),
        "curvature_dot": _scaled(point.curvature_dot, 1 / MM**2),
        "curvature_ddot": _scaled(point.curvature_ddot, 1 / MM**3),
        "torsion": _scaled(point.torsion, 1 / MM),
        "radius": _scaled(radius(point), MM),
        "window": window_view(window),
        "backlash": _backlash(analysis, point),
        "note": analysis.notes[point.index] or None,
        **({} if analysis.path.lines is None else {"line": line_at(analysis.path.lines, point.s)}),
    }


def line_at(lines: tuple[Array, PlaceArray, PlaceArray], s: float) -> int:
    """Return the line of a part program, from 1, at an arc length [m] of its path; of a joint the earlier one."""
    ends, motions, numbers = lines
    return int(numbers[motions[min(int(np.searchsorted(ends, s - MEETS)), motions.size - 1)]]) + 1


def radius(point: TurningPoint) -> float | None:
    """Radius of the osculating circle [m], None where it is a line or does not exist."""
    return None if not point.curvature else 1.0 / abs(point.curvature)


def _backlash(analysis: Analysis, point: TurningPoint) -> View | None:
    interval = analysis.intervals[point.index]
    if interval is None:
        return None
    travel = feed_at(analysis.path, point) * interval.duration
    return {"lag": interval.lag, "duration": interval.duration, "standstill_travel": travel / MM}


def profile_view(profile: FeedProfile | None) -> View | None:
    """Return a feed profile: t* [s], s* [mm], V_c [mm/min], V_k / V_c and V(½)/V_c.

    `pieces` always has the shape; `degree` and `coefficients` are null where it has several pieces.
    """
    if profile is None:
        return None
    single = profile.coefficients
    pieces = profile.shape.pieces
    return {
        "t_star": profile.t_star,
        "s_star": profile.s_star / MM,
        "cruise": profile.cruise / MM_PER_MIN,
        "degree": None if single is None else len(single) - 1,
        "coefficients": None if single is None else single.tolist(),
        "pieces": [{"share": one.share, "coefficients": one.coefficients.tolist()} for one in pieces],
        "turn": profile.turn,
        "ratio": profile.ratio,
        "notes": list(profile.notes),
    }


def crossing_view(one: Crossing | Jog) -> View:
    """Return a commanded crossing of a gap: times [s], travel and push [mm], signed; a jog does not push."""
    push, pushed = (one.push, one.push_duration) if isinstance(one, Crossing) else (0.0, 0.0)
    return {
        "axis": one.axis,
        "start": one.start,
        "duration": one.duration,
        "travel": one.travel / MM,
        "push": push / MM,
        "push_duration": pushed,
    }


def plan_view(analysis: Analysis, plan: Plan, command: Command) -> View:
    """Return what ``convert --json`` prints of a plan: windows, cycle time, what is added to the path.

    `other_crossings` are those at no turning point: before the motion begins. `bias` [mm]
    are the lasting offsets it begins with, `offsets` [mm] the largest distances from the path of any row of
    `command`.
    """
    views = turning_point_views(analysis)
    listed: list[Crossing | Jog] = []
    for view, point in zip(views, plan.turning_points, strict=True):
        number = window_number(plan, point)
        mine = crossings_at(plan, point)
        listed += mine
        view["strategy"] = strategy_at(plan, point)
        view["profile"] = profile_view(None if number is None else plan.profiles[number])
        view["crossings"] = [crossing_view(one) for one in mine]
    return {
        "windows": views,
        "cycle_time": {"before": cycle_time(plan.nominal), "after": plan_time(plan)},
        "standstill": standstill_view(plan, analysis.track),
        "strategy": plan.strategy,
        "other_crossings": [crossing_view(one) for one in plan.crossings if one not in listed],
        "bias": {name: offset / MM for name, offset in plan.bias.items()},
        "offsets": offsets_view(command),
        "inverse_dynamics": plan.inverse_dynamics,
        "friction_led": plan.friction_part,
        "warnings": list(plan.warnings),
    }


def standstill_view(plan: Plan, track: Track) -> View:
    """Return how long the tool stands or creeps on the contour before and after [s], and where [mm, s]."""
    found = standstills(plan, track)
    return {
        "before": standing_time(without_strategy(plan), track),
        "after": sum((one.time for one in found), start=0.0),
        "places": [{"s": one.s / MM, "time": one.time} for one in found],
    }


def offsets_view(command: Command) -> dict[str, float]:
    """Return by axis how far a command leaves the path at most [mm]: what the strategy declares to add."""
    if command.offset is None:
        return dict.fromkeys(command.axes, 0.0)
    largest = np.abs(command.offset).max(axis=0) / MM
    return dict(zip(command.axes, largest.tolist(), strict=True))


def inspection_view(found: Inspection) -> View:
    """Return what ``inspect --json`` prints."""
    view: View = {"turning_points": turning_point_views(found.analysis)}
    return view if found.certificate is None else {**view, "certificate": certificate_view(found.certificate)}


def certificate_view(certificate: Certificate) -> View:
    """Return what ``inspect --certify --json`` adds: the exact count and the isolating intervals in xi."""
    return {
        "ok": certificate.ok,
        "count": certificate.exact,
        "found": certificate.found,
        "roots": [
            {
                "segment": entry.segment,
                "axis": entry.axis,
                "intervals": [[str(low), str(high)] for low, high in entry.intervals],
                "multiplicities": list(entry.multiplicities),
                "reversals": entry.reversals,
            }
            for entry in certificate.entries
        ],
        "words": list(certificate.words),
    }


def _scaled(value: float | None, unit: float) -> float | None:
    return None if value is None else value / unit


def _finite(value: float, unit: float) -> float | None:
    return value / unit if math.isfinite(value) else None
