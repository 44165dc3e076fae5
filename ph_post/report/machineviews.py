"""Machines in the shop's units: as JSON, and as a line each."""

from __future__ import annotations

from typing import Any

from ph_post.types import Machine
from ph_post.units import MM, MM_PER_MIN, MS


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


def _short(value: float) -> float:
    """Drop the digits that a change of units adds."""
    return float(f"{value:.12g}")
