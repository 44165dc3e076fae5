"""One test program with its heading, and the channels to record while it runs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Final

from ph_post.dialects.base import Dialect
from ph_post.dialects.registry import find_dialect
from ph_post.gcode.program import AXES
from ph_post.testprograms.builder import APPROACH, ProgramBuilder, TestVolume
from ph_post.types import Machine
from ph_post.types.diagnosis import Channel, Experiment
from ph_post.units import MM, MM_PER_MIN

EVERY: Final[tuple[Channel, ...]] = ("act", "motor", "force")

LEAST_RATE: Final = 1000.0
"""Samples a second that a log needs, where the controller's own period is longer."""


def what_to_record(
    machine: Machine,
    dialect: Dialect,
    axes: Sequence[str],
    needed: Collection[Channel],
    seconds: float,
    name: str,
    *,
    gauge: bool = False,
) -> tuple[str, ...]:
    """Say what to record of a test program, a line a thing.

    Parameters
    ----------
    machine : Machine
    dialect : Dialect
        Of the machine.
    axes : sequence of str
        Axes that move.
    needed : collection of {"act", "motor", "force"}
        Channels without which the program shows nothing; the others are welcome.
    seconds : float
        About how long the program takes [s].
    name : str
        Of the program; the log is called like it.
    gauge : bool, optional
        Whether the table has to be read by something that is no part of the loop.
    """
    rate = max(1.0 / machine.servo_period, LEAST_RATE)
    commands = ", ".join(f"{axis}_cmd" for axis in axes)
    lines = [
        f"from before the start until after the end, about {seconds:.0f} s, {rate:.0f} samples a second",
        f"{commands} [mm]: what is commanded, each sample with the rest",
    ]
    lines += [
        _channel(machine, axis, channel, needed, gauge)
        for axis in axes
        for channel in EVERY
        if _is_offered(machine, axis, channel, needed)
    ]
    if dialect.recording.lines is not None:
        lines += dialect.recording.lines(machine, axes, seconds, name, gauge)
    return tuple(lines)


def _is_offered(machine: Machine, axis: str, channel: Channel, needed: Collection[Channel]) -> bool:
    """Return whether an axis can have a channel: without feedback there is no force, and an encoder only if put on."""
    if machine.axes[axis].loop.has_controller:
        return True
    return channel == "act" or (channel == "motor" and channel in needed)


def _channel(machine: Machine, axis: str, channel: Channel, needed: Collection[Channel], gauge: bool) -> str:
    own = channel == machine.axes[axis].loop.own_channel
    if channel == "force":
        words = f"{axis}_force [N] or {axis}_current [A]: what the drive gives the motor"
    elif channel == "motor":
        words = f"{axis}_motor [mm of travel]: " + (
            "the motor's own encoder" if own else "an encoder on the motor or on the screw"
        )
    elif gauge:
        words = f"{axis}_act [mm]: a gauge at the table outside of the loop, such as a laser or a ballbar"
    else:
        words = f"{axis}_act [mm]: " + ("the table's own scale" if own else "a scale or gauge at the table")
    return words + (", needed" if channel in needed else ", if there is one")


Write = Callable[[ProgramBuilder], None]
"""Adds the motions of a program to a builder."""


def build_experiment(
    volume: TestVolume,
    name: str,
    why: str,
    write: Write,
    needed: Sequence[Channel] = ("act",),
    notes: Sequence[str] = (),
    *,
    gauge: bool = False,
) -> Experiment:
    """Write one program.

    Parameters
    ----------
    volume : TestVolume
    name : str
        What it and its log are called.
    why : str
        What it is for, a sentence.
    write : callable
        Adds the motions to a builder.
    needed : sequence of {"act", "motor", "force"}
        Channels without which it shows nothing.
    notes : sequence of str, optional
        What else the program says at its head.
    gauge : bool, optional
        Whether the table has to be read by something that is no part of the loop.
    """
    dialect = find_dialect(volume.machine.dialect, "controller.dialect")
    builder = ProgramBuilder(volume, dialect)
    write(builder)
    record = what_to_record(volume.machine, dialect, volume.axes, needed, builder.seconds, name, gauge=gauge)
    remarks = [*_remarks(volume, name, why, builder), *notes]
    return Experiment(name=name, why=why, record=record, program=builder.text(remarks))


def _remarks(volume: TestVolume, name: str, why: str, builder: ProgramBuilder) -> list[str]:
    """Say what a person must know before starting a program."""
    room = ", ".join(f"{axis} from {low / MM:g} to {high / MM:g}" for axis, (low, high) in volume.spans.items())
    middle = " ".join(f"{axis}{volume.centre(axis) / MM:g}" for axis in volume.axes)
    others = [axis for axis in AXES if axis not in volume.axes]
    still = "" if not others else f", {' and '.join(others)} not moved: the height at which the tool stands stays"
    speed = min(APPROACH, 0.25 * volume.top(*volume.axes)) / MM_PER_MIN
    return [
        f"ph-post test program {name} for {volume.machine.name}, about {builder.seconds:.0f} s",
        why.replace(";", ","),  # which ends a line to some controllers
        f"THE TOOL MUST BE CLEAR of everything: moves {room} mm{still}",
        f"go to {middle} by hand first: the program begins with a straight move to there at {speed:g} mm/min,"
        " and ends there",
        "cut air, spindle off, feed override 100 percent, work offset G54, the controller's own backlash and"
        " screw compensation off",
    ]
