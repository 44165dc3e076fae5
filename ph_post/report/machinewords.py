"""A machine as a table: what its file says of every axis, and which effects act there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from ph_post.types import Axis, Feedback, Machine
from ph_post.units import MM, MS

LOOPS: Final[dict[Feedback, str]] = {
    "load": "scale on the table",
    "motor": "encoder on the motor",
    "none": "no feedback",
}
"""Where the loop of an axis closes, in words."""


def machine_view(machine: Machine, axes: Sequence[str]) -> dict[str, Any]:
    """Return a machine for a page: rows with a word for each of the axes, and its effects."""
    drives = [machine.axes[name] for name in axes]
    return {
        "name": machine.name,
        "dialect": machine.dialect,
        "period": machine.servo_period / MS,
        "axes": list(axes),
        "rows": [[name, *(_cell(axis, name) for axis in drives)] for name in _CELLS],
        "effects": [
            {"axis": axis.name, "name": one.name, "parameters": dict(one.parameters)}
            for axis in drives
            for one in axis.effects
        ],
    }


def _cell(axis: Axis, name: str) -> str:
    return _CELLS[name](axis)


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
}  # fmt: skip
