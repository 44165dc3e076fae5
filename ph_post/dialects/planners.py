"""The planner of a machine: its dialect's, with what the machine file states in place of the firmware's defaults."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from msgspec.structs import replace

from ph_post.dialects.registry import find_dialect, is_dialect
from ph_post.files.machine import PLANNER_KEYS
from ph_post.types import (
    ControllerPlanner,
    ExactPath,
    GrblChords,
    GrblCorner,
    JerkCorner,
    KlipperChords,
    KlipperCorner,
    Machine,
    MarlinChords,
    MarlinCorner,
    PlannerSettings,
    RoundedPath,
)
from ph_post.units import MM

_SLOW_JERK: Final = 0.3 * MM
"""Jerk of Z in Marlin's defaults [m/s]; a machine file states that of X and Y."""

_SETTINGS: Final[Mapping[type, tuple[str, ...]]] = {
    RoundedPath: ("path_tolerance",),
    GrblCorner: ("junction_deviation",),
    MarlinCorner: ("junction_deviation", "jerk"),
    JerkCorner: ("jerk",),
    KlipperCorner: ("square_corner_velocity", "max_accel_to_decel"),
    GrblChords: ("arc_tolerance",),
    KlipperChords: ("arc_resolution",),
    MarlinChords: ("arc_segment",),
}
"""Settings by the record that they change."""


def settings_of(planner: ControllerPlanner) -> tuple[str, ...]:
    """Name the settings of a planner that a machine file may state.

    Examples
    --------
    >>> settings_of(RoundedPath())
    ('path_tolerance', 'dwell_step')
    """
    parts = (planner,) if isinstance(planner, RoundedPath) else (planner.corner, planner.chords)
    return (*(name for part in parts for name in _SETTINGS[type(part)]), "dwell_step")


def values_of(planner: ControllerPlanner) -> dict[str, float]:
    """Return the settings of a planner that decide on corners and chords, by name; those that are off are left out.

    Examples
    --------
    >>> values_of(find_dialect("klipper").planner)
    {'square_corner_velocity': 0.005, 'arc_resolution': 0.001}
    """
    if isinstance(planner, RoundedPath):
        return {"path_tolerance": planner.tolerance} if planner.tolerance > 0.0 else {}
    found: dict[str, float] = {}
    match planner.corner:
        case GrblCorner(deviation=deviation) | MarlinCorner(deviation=deviation):
            found["junction_deviation"] = deviation
        case JerkCorner(jerk=jerk):
            found["jerk"] = jerk[0]
        case KlipperCorner(velocity=velocity):
            found["square_corner_velocity"] = velocity
    match planner.chords:
        case GrblChords(tolerance=tolerance):
            found["arc_tolerance"] = tolerance
        case KlipperChords(length=length):
            found["arc_resolution"] = length
        case MarlinChords(longest=longest):
            found["arc_segment"] = longest
    return found


def planner_notes(machine: Machine) -> tuple[str, ...]:
    """Say which defaults of its firmware stand for what a machine file does not state; nothing of LinuxCNC.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> planner_notes(replace(read_machine("mill"), dialect="klipper"))
    ('the machine file does not state square_corner_velocity_mm_s (5), arc_resolution_mm (1): defaults of klipper',)
    """
    planner, stated = planner_of(machine), machine.planner.given()
    lacking = [
        f"{PLANNER_KEYS[name][0]} ({value / PLANNER_KEYS[name][1]:.6g})"
        for name, value in values_of(planner).items()
        if name not in stated
    ]
    if not lacking:
        return ()
    return (f"the machine file does not state {', '.join(lacking)}: defaults of {machine.dialect}",)


def with_settings(planner: ControllerPlanner, stated: PlannerSettings) -> ControllerPlanner:
    """Return a planner with what a machine file states; settings that it has not are passed over."""
    step = planner.dwell_step if stated.dwell_step is None else stated.dwell_step
    if isinstance(planner, RoundedPath):
        tolerance = planner.tolerance if stated.path_tolerance is None else stated.path_tolerance
        return replace(planner, tolerance=tolerance, dwell_step=step)
    corner, chords = _corner(planner.corner, stated), _chords(planner.chords, stated)
    return replace(planner, corner=corner, chords=chords, dwell_step=step)


Corner = GrblCorner | MarlinCorner | JerkCorner | KlipperCorner
Chords = GrblChords | KlipperChords | MarlinChords


def _corner(corner: Corner, stated: PlannerSettings) -> Corner:
    if isinstance(corner, KlipperCorner):
        velocity = corner.velocity if stated.square_corner_velocity is None else stated.square_corner_velocity
        smooth = corner.accel_to_decel if stated.max_accel_to_decel is None else stated.max_accel_to_decel
        return KlipperCorner(velocity=velocity, accel_to_decel=smooth)
    if stated.jerk is not None and "jerk" in _SETTINGS[type(corner)]:
        return JerkCorner(jerk=(stated.jerk, stated.jerk, min(stated.jerk, _SLOW_JERK)))
    if isinstance(corner, JerkCorner) or stated.junction_deviation is None:
        return corner
    return replace(corner, deviation=stated.junction_deviation)


def _chords(chords: Chords, stated: PlannerSettings) -> Chords:
    if isinstance(chords, GrblChords):
        return chords if stated.arc_tolerance is None else GrblChords(tolerance=stated.arc_tolerance)
    if isinstance(chords, KlipperChords):
        return chords if stated.arc_resolution is None else KlipperChords(length=stated.arc_resolution)
    longest = chords.longest if stated.arc_segment is None else stated.arc_segment
    return replace(chords, longest=longest, shortest=min(chords.shortest, longest))


def with_finer_chords(planner: ExactPath, size: float) -> ExactPath:
    """Return a planner whose setting for the chords of arcs is `size` [m]: their error for Grbl, their length else.

    Examples
    --------
    >>> with_finer_chords(find_dialect("klipper").planner, 0.5e-3).chords
    KlipperChords(length=0.0005)
    """
    return replace(planner, chords=_chords(planner.chords, PlannerSettings(**{chord_setting(planner): size})))


def chord_setting(planner: ExactPath) -> str:
    """Name the setting of a planner that decides on the chords of arcs."""
    return _SETTINGS[type(planner.chords)][0]


def planner_of(machine: Machine) -> ControllerPlanner:
    """Return the planner of a machine's controller.

    Parameters
    ----------
    machine : Machine
        A dialect that nobody registered counts as LinuxCNC's.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> planner_of(read_machine("stepper")).corner
    GrblCorner(deviation=1e-05)
    """
    planner = find_dialect(machine.dialect).planner if is_dialect(machine.dialect) else RoundedPath()
    return with_settings(planner, machine.planner)
