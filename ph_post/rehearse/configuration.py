"""Configuration of a LinuxCNC without a screen: a machine's limits and backlash as ini, tool table and parameters."""

from __future__ import annotations

import math
import pathlib
from collections.abc import Mapping, Sequence
from typing import Final

from ph_post.gcode.program import AXES
from ph_post.types import Limits, Machine
from ph_post.units import MM

IDEAL: Final = pathlib.Path(__file__).parent / "machine.hal"
"""HAL file of ideal motors."""

REACH_MM: Final = 1e6
"""Soft limits and the following error that stops a joint [mm]: none."""

RING: Final = 200_000
"""Rows that the recorder may fall behind: some seconds."""

TOOLS: Final = 99
"""Tools 1 to this one are in the table, of no length."""

START_UP_CODE: Final = "G21 G17 G90 G94 G40 G49 G54 G64"
"""LinuxCNC's own state at power on, said aloud."""

NANOSECOND: Final = 1e-9


def write_configuration(
    folder: pathlib.Path, machine: Machine, backlash: Mapping[str, float], hal: pathlib.Path = IDEAL
) -> pathlib.Path:
    """Write ini, tool table and parameters into a folder; `backlash` [m] by axis is LinuxCNC's own."""
    (folder / "machine.tbl").write_text("".join(f"T{n} P{n} Z0\n" for n in range(1, TOOLS + 1)))
    (folder / "machine.var").write_text("")
    ini = folder / "machine.ini"
    ini.write_text(_ini_text(folder, machine, backlash, hal))
    return ini


def _ini_text(folder: pathlib.Path, machine: Machine, backlash: Mapping[str, float], hal: pathlib.Path) -> str:
    # It always runs with three joints; those that the machine lacks get the limits of its fastest.
    limits = [_limits(machine, name) for name in AXES]
    velocity = math.hypot(*(one.velocity for one in limits)) / MM
    acceleration = math.hypot(*(one.acceleration for one in limits)) / MM
    sections: dict[str, Mapping[str, object]] = {
        "EMC": {"VERSION": 1.1, "MACHINE": "rehearsal", "DEBUG": 0},
        "DISPLAY": {
            "DISPLAY": folder / "display",
            "PROGRAM_PREFIX": folder,
            "CYCLE_TIME": 0.1,
            "MAX_FEED_OVERRIDE": 1.0,
        },
        "TASK": {"TASK": "milltask", "CYCLE_TIME": 0.001},
        "RS274NGC": {"PARAMETER_FILE": folder / "machine.var", "RS274NGC_STARTUP_CODE": START_UP_CODE},
        "EMCMOT": {
            "EMCMOT": "motmod",
            "COMM_TIMEOUT": 5.0,
            "SERVO_PERIOD": round(machine.servo_period / NANOSECOND),
        },
        "HAL": {"HALFILE": hal},
        "PH_POST": {"ROWS": RING},
        "TRAJ": {
            "COORDINATES": "X Y Z",
            "LINEAR_UNITS": "mm",
            "ANGULAR_UNITS": "degree",
            "DEFAULT_LINEAR_VELOCITY": velocity,
            "MAX_LINEAR_VELOCITY": velocity,
            "DEFAULT_LINEAR_ACCELERATION": acceleration,
            "MAX_LINEAR_ACCELERATION": acceleration,
            "NO_FORCE_HOMING": 1,
        },
        "EMCIO": {"EMCIO": "io", "CYCLE_TIME": 0.01, "TOOL_TABLE": folder / "machine.tbl"},
        "KINS": {"KINEMATICS": f"trivkins coordinates={''.join(AXES)}", "JOINTS": len(AXES)},
    }
    for number, (name, one) in enumerate(zip(AXES, limits, strict=True)):
        kept = {
            "MIN_LIMIT": -REACH_MM,
            "MAX_LIMIT": REACH_MM,
            "MAX_VELOCITY": one.velocity / MM,
            "MAX_ACCELERATION": one.acceleration / MM,
        }
        sections[f"AXIS_{name}"] = kept
        sections[f"JOINT_{number}"] = {**kept, **_joint(backlash.get(name, 0.0))}
    lines = ([f"[{name}]", *(f"{key} = {value}" for key, value in one.items()), ""] for name, one in sections.items())
    return "\n".join(line for section in lines for line in section)


def _joint(backlash: float) -> dict[str, object]:
    """Return what a joint has beside its limits; `backlash` [m]."""
    return {
        "TYPE": "LINEAR",
        "HOME": 0,
        "HOME_SEQUENCE": 0,
        "FERROR": REACH_MM,
        "MIN_FERROR": REACH_MM,
        "BACKLASH": backlash / MM,
    }


def _limits(machine: Machine, name: str) -> Limits:
    if name in machine.axes:
        return machine.axes[name].limits
    every: Sequence[Limits] = [axis.limits for axis in machine.axes.values()]
    return max(every, key=lambda one: one.velocity)
