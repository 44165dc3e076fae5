"""Servo axes inside of LinuxCNC: its `pid` around drives with a backlash, all of them LinuxCNC's own HAL components.

Nothing of ours is in the loop. A `pid` for the position asks another one for a speed, that one asks for an
acceleration, two `integ` make it a motor's place, and an encoder counts it. A `limit1` is the table: it stands where it
stood until the motor, half of the backlash ahead or behind, pushes it; a scale counts it. All of it goes from period to
period.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from ph_post.rehearse.linuxcnc import record_on_linuxcnc
from ph_post.types import Machine


class HalAxis(NamedTuple):
    """A servo axis: its backlash [mm], gains of its `pid`, and those of its velocity loop.

    `velocity_gain` [1/s] and `integral_time` [s], None for a P loop; `count` [mm] is that of encoder and scale.
    """

    gap: float
    p: float = 40.0
    ff1: float = 0.0
    velocity_gain: float = 250.0
    integral_time: float | None = 0.012
    count: float = 0.001


COMPONENTS = {
    "pid": ("pid", "drive"),
    "integ": ("speed", "motor"),
    "sum2": ("low", "high"),
    "limit1": ("table",),
    "scale": ("motor-count", "motor-mm", "table-count", "table-mm"),
    "conv_float_s32": ("motor-whole", "table-whole"),
    "conv_s32_float": ("motor-float", "table-float"),
}
"""Parts of an axis by the component that each is."""

MOVES = ("motor", "low", "high", "table")
READS = tuple(f"{side}-{step}" for side in ("motor", "table") for step in ("count", "whole", "float", "mm"))
DRIVES = ("pid", "drive", "speed")
"""Order in a period: what the last one moved, what is read of it, then LinuxCNC's planner, and what it asks for."""

AHEAD = 1_000_000
"""Counts of both encoders at zero: they are never negative, where the conversion would round the other way."""

GAUGE = re.compile(r"PIN_OF_THE_([XYZ])_GAUGE")
DEPTH = re.compile(r"\bdepth=\d+")
"""Rows that a plan lets a sampler hold are enough at a row a millisecond; here time passes ten times as fast."""


def hal_text(axes: Mapping[str, HalAxis], record: Sequence[str]) -> str:
    """Return the HAL file of a machine with X, Y and Z; those not given have ideal motors.

    `record` are lines for a shell that set a sampler up, as a recording plan has them, its gauge being the scale.
    """
    parts = [(a.lower(), part) for a in axes for names in COMPONENTS.values() for part in names]
    lines = [
        "loadrt [KINS]KINEMATICS",
        "loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS",
    ]
    for component, names in COMPONENTS.items():
        mine = [f"{part}.{a}" for a, part in parts if part in names]
        lines.append(f"loadrt {component} names={','.join(mine)}")
    lines += [_function(part, a.lower()) for a in axes for part in (*MOVES, *READS)]
    lines += ["addf motion-command-handler servo-thread", "addf motion-controller servo-thread"]
    lines += [_function(part, a.lower()) for a in axes for part in DRIVES]
    for joint, name in enumerate("XYZ"):
        if name in axes:
            lines += _axis_lines(name.lower(), joint, axes[name])
        else:
            lines.append(f"net {name.lower()}-ideal joint.{joint}.motor-pos-cmd => joint.{joint}.motor-pos-fb")
    typed = [line.removeprefix("halcmd ") for line in record if line.startswith("halcmd ") and "unloadrt" not in line]
    gauged = (GAUGE.sub(lambda found: f"table-mm.{found[1].lower()}.out", line) for line in typed)
    return "\n".join(
        [
            *lines,
            *(DEPTH.sub("depth=[PH_POST]ROWS", line) for line in gauged),
            "net estop iocontrol.0.user-enable-out => iocontrol.0.emc-enable-in",
            "net tool-prepare iocontrol.0.tool-prepare => iocontrol.0.tool-prepared",
            "net tool-change iocontrol.0.tool-change => iocontrol.0.tool-changed",
            "",
        ]
    )


def _function(part: str, a: str) -> str:
    calls = ".do-pid-calcs" if part in COMPONENTS["pid"] else ""
    return f"addf {part}.{a}{calls} servo-thread"


def _axis_lines(a: str, joint: int, axis: HalAxis) -> list[str]:
    lines = [
        f"setp pid.{a}.Pgain {axis.p}",
        f"setp pid.{a}.FF1 {axis.ff1}",
        f"setp drive.{a}.Pgain {axis.velocity_gain}",
        f"setp drive.{a}.Igain {axis.velocity_gain / axis.integral_time if axis.integral_time else 0.0}",
        f"setp low.{a}.offset {-0.5 * axis.gap}",
        f"setp high.{a}.offset {0.5 * axis.gap}",
        f"net {a}-enable joint.{joint}.amp-enable-out => pid.{a}.enable drive.{a}.enable",
        f"net {a}-command joint.{joint}.motor-pos-cmd => pid.{a}.command",
        f"net {a}-wanted pid.{a}.output => drive.{a}.command",
        f"net {a}-push drive.{a}.output => speed.{a}.in",
        f"net {a}-speed speed.{a}.out => drive.{a}.feedback motor.{a}.in",
        f"net {a}-motor motor.{a}.out => low.{a}.in0 high.{a}.in0 motor-count.{a}.in",
        f"net {a}-low low.{a}.out => table.{a}.min",
        f"net {a}-high high.{a}.out => table.{a}.max",
        f"net {a}-table table.{a}.out => table.{a}.in table-count.{a}.in",
        f"net {a}-read motor-mm.{a}.out => pid.{a}.feedback joint.{joint}.motor-pos-fb",
    ]
    for side in ("motor", "table"):
        lines += [
            f"setp {side}-count.{a}.gain {1.0 / axis.count}",
            f"setp {side}-count.{a}.offset {AHEAD + 0.5}",
            f"setp {side}-mm.{a}.gain {axis.count}",
            f"setp {side}-mm.{a}.offset {-AHEAD * axis.count}",
            f"net {a}-{side}-counts {side}-count.{a}.out => {side}-whole.{a}.in",
            f"net {a}-{side}-whole {side}-whole.{a}.out => {side}-float.{a}.in",
            f"net {a}-{side}-float {side}-float.{a}.out => {side}-mm.{a}.in",
        ]
    return lines


def run_in_hal(program: bytes, machine: Machine, hal: str) -> bytes:
    """Run a program on LinuxCNC with a HAL file; what `halsampler -t` wrote."""
    with tempfile.TemporaryDirectory(prefix="ph-post-hal-") as folder:
        Path(folder).chmod(0o755)
        file = Path(folder) / "servos.hal"
        file.write_text(hal)
        rows, _ = record_on_linuxcnc(program, "program.ngc", machine, hal=file, backlash={}, limit=120.0)
        assert b"overrun" not in rows, "rows were lost: the machine is too busy"
        return rows
