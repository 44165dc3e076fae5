"""One test program with its heading, and what to record of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ph_post.diagnose.kitdraft import APPROACH, Draft
from ph_post.diagnose.kitground import Ground
from ph_post.diagnose.kitrecord import what_to_record
from ph_post.diagnose.record import Channel, Experiment
from ph_post.gcode.registry import find_dialect
from ph_post.units import MM, MM_PER_MIN

Write = Callable[[Draft], None]
"""Adds the motions of a program to a draft."""


def experiment(
    ground: Ground,
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
    ground : Ground
    name : str
        What it and its log are called.
    why : str
        What it is for, a sentence.
    write : callable
        Adds the motions to a draft.
    needed : sequence of {"act", "motor", "force"}
        Channels without which it tells nothing.
    notes : sequence of str, optional
        What else the program says at its head.
    gauge : bool, optional
        Whether the table has to be read by something that is no part of the loop.
    """
    draft = Draft(ground, find_dialect(ground.machine.dialect, "controller.dialect"))
    write(draft)
    record = what_to_record(ground.machine, ground.axes, needed, draft.seconds, name, gauge=gauge)
    remarks = [*_remarks(ground, name, why, draft), *notes]
    return Experiment(name=name, why=why, record=record, program=draft.text(remarks))


def _remarks(ground: Ground, name: str, why: str, draft: Draft) -> list[str]:
    """Say what a person must know before starting a program."""
    room = ", ".join(
        f"{axis} from {low / MM:g} to {high / MM:g}" for axis, (low, high) in ground.spans.items()
    )
    middle = " ".join(f"{axis}{ground.centre(axis) / MM:g}" for axis in ground.axes)
    others = [axis for axis in "XYZ" if axis not in ground.axes]
    still = (
        "" if not others else f", {' and '.join(others)} not moved: the height at which the tool stands stays"
    )
    speed = min(APPROACH, 0.25 * ground.top(*ground.axes)) / MM_PER_MIN
    return [
        f"ph-post test program {name} for {ground.machine.name}, about {draft.seconds:.0f} s",
        why.replace(";", ","),  # which ends a line to some controllers
        f"THE TOOL MUST BE CLEAR of everything: moves {room} mm{still}",
        f"go to {middle} by hand first: the program begins with a straight move to there at {speed:g} mm/min,"
        " and ends there",
        "cut air, spindle off, feed override 100 percent, work offset G54, the controller's own backlash and"
        " screw compensation off",
    ]
