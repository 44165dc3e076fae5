"""Machines in the shop's units: as JSON, as a line each, and as a table with a column an axis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from ph_post.types import Axis, Feedback, Machine
from ph_post.units import MM, MM_PER_MIN, MS

LOOPS: Final[dict[Feedback, str]] = {
    "load": "scale on the table",
    "motor": "encoder on the motor",
    "none": "no feedback",
}
"""Where the loop of an axis closes, in words."""


def machine_view(machine: Machine) -> dict[str, Any]:
    """Return what is told of a machine: mm, mm/min, mm/s², ms, s.

    Examples
    --------
    >>> from ph_post.io.machinefile import read_machine
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
    """Return a line of the list of machines: name, loops, dialect, lost motion by axis [mm], what it is."""
    loops = dict.fromkeys(axis.feedback for axis in machine.axes.values())
    gaps = " ".join(f"{axis} {one.gap.lost_motion / MM:.3g}" for axis, one in machine.axes.items())
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
    return axis.gap.pickup or ("every rule is tried" if axis.feedback == "load" else "-")


def _flank(axis: Axis) -> str:
    known = axis.gap.initial_flank
    return "both are tried" if known == "unknown" else known


_CELLS: Final[dict[str, Callable[[Axis], str]]] = {
    "loop": lambda axis: LOOPS[axis.feedback],
    "lost motion [mm]": lambda axis: f"{axis.gap.lost_motion / MM:.4g}",
    "lost motion known to": lambda axis: f"± {100.0 * axis.uncertainty.backlash:g} %",
    "b [s²]": lambda axis: f"{axis.servo.b:.4g}",
    "c [s]": lambda axis: f"{axis.servo.c:.4g}",
    "pick-up": _pickup,
    "stands at first on": _flank,
    "highest velocity [mm/s]": lambda axis: f"{axis.limits.velocity / MM:.6g}",
    "highest acceleration [mm/s²]": lambda axis: f"{axis.limits.acceleration / MM:.6g}",
    "highest jerk [mm/s³]": lambda axis: f"{axis.limits.jerk / MM:.6g}",
}


def _short(value: float) -> float:
    """Drop the digits that a change of units adds."""
    return float(f"{value:.12g}")
