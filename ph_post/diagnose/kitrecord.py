"""What to record beside a test program, in words and in the lines that a controller wants."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

from ph_post.diagnose.record import Channel
from ph_post.types import Machine

EVERY: Final[tuple[Channel, ...]] = ("act", "motor", "force")

LEAST_RATE: Final = 1000.0
"""Samples a second that a record wants, where the controller's own period is longer."""

_PINS: Final[dict[Channel, str]] = {"act": "pos-fb"}


def what_to_record(
    machine: Machine, axes: Sequence[str], needed: Collection[Channel], seconds: float, name: str
) -> tuple[str, ...]:
    """Say what to record of a test program, a line a thing.

    Parameters
    ----------
    machine : Machine
    axes : sequence of str
        Axes that move.
    needed : collection of {"act", "motor", "force"}
        Channels without which the program tells nothing; the others are welcome.
    seconds : float
        About how long the program takes [s].
    name : str
        Of the program; the log is called like it.
    """
    rate = max(1.0 / machine.servo_period, LEAST_RATE)
    lines = [f"from before the start until after the end, about {seconds:.0f} s, {rate:.0f} samples a second"]
    lines.append(f"{_columns(axes, 'cmd')} [mm]: what is commanded, each sample with the rest")
    for axis in axes:
        lines += [_channel(machine, axis, channel, channel in needed) for channel in _offered(machine, axis)]
    if machine.dialect == "linuxcnc":
        lines += halsampler_lines(machine, axes, seconds, name)
    elif machine.dialect.startswith("grbl"):
        lines.append(
            "the controller reports positions some ten times a second, which is too few: record with a"
            f" scale or encoder of its own logger, and give {name}.ngc beside the log in place of the columns"
            f" {_columns(axes, 'cmd')}"
        )
    return tuple(lines)


def halsampler_lines(machine: Machine, axes: Sequence[str], seconds: float, name: str) -> list[str]:
    """Lines for HAL and for a shell with which LinuxCNC records its joints every servo period.

    The joints are taken to be numbered as the axes are; their positions are those of the machine, not of the
    work offset. Scales and forces come from pins that only the person who wired them knows.
    """
    rows = round((seconds + 60.0) / machine.servo_period)
    lines = [
        f"halcmd loadrt sampler depth={10 * round(1.0 / machine.servo_period)} cfg={'ff' * len(axes)}",
        "halcmd addf sampler.0 servo-thread",
    ]
    known = [axis for axis in "XYZ" if axis in machine.axes]
    for k, axis in enumerate(axes):
        joint = known.index(axis)
        for n, (pin, column) in enumerate((("pos-cmd", "cmd"), ("pos-fb", _own(machine, axis)))):
            lines.append(
                f"halcmd net kit-{axis.lower()}-{column} joint.{joint}.{pin} => sampler.0.pin.{2 * k + n}"
            )
    columns = " ".join(f"{axis}_cmd {axis}_{_own(machine, axis)}" for axis in axes)
    lines.append(f"halsampler -t -n {rows} {name}.txt; the columns are the sample's number, then {columns}")
    return lines


def _own(machine: Machine, axis: str) -> str:
    """Which side of the gap the loop's own feedback is on."""
    return "act" if machine.axes[axis].feedback == "load" else "motor"


def _offered(machine: Machine, axis: str) -> tuple[Channel, ...]:
    """Channels that an axis can have: without an encoder the motor is where it is commanded."""
    return ("act",) if machine.axes[axis].feedback == "none" else EVERY


def _channel(machine: Machine, axis: str, channel: Channel, needed: bool) -> str:
    feedback = machine.axes[axis].feedback
    if channel == "act":
        own = "the table's own scale" if feedback == "load" else "a scale or gauge at the table"
        words = f"{axis}_act [mm]: {own}"
    elif channel == "motor":
        own = "the motor's own encoder" if feedback == "motor" else "an encoder on motor or screw"
        words = f"{axis}_motor [mm of travel]: {own}"
    else:
        words = f"{axis}_force [N] or {axis}_current [A]: what the drive gives the motor"
    return words + (", needed" if needed else ", if there is one")


def _columns(axes: Sequence[str], side: str) -> str:
    return ", ".join(f"{axis}_{side}" for axis in axes)
