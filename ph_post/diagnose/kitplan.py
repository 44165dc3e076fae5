"""The recording plan that goes with test programs: what to run, what to record, what to do with it."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

from ph_post.diagnose.kitrecord import READ_WITH
from ph_post.diagnose.record import Experiment
from ph_post.gcode.registry import find_dialect
from ph_post.types import Machine


def program_file(machine: Machine, one: Experiment) -> str:
    """Name of the file that a program goes to, with the ending that the machine's controller expects."""
    return one.name + find_dialect(machine.dialect).ending


def recording_plan(machine: Machine, source: str, folder: str, kit: Sequence[Experiment]) -> str:
    """Write the plan as Markdown.

    Parameters
    ----------
    machine : Machine
    source : str
        What the person called the machine: a file, or the name of a shipped one.
    folder : str
        Where the programs are, and the logs are wanted.
    kit : sequence of Experiment
    """
    lines = (*_before(machine, kit), *_runs(machine, source, folder, kit), *_by_hand(machine))
    return "\n".join(lines) + "\n"


def _before(machine: Machine, kit: Sequence[Experiment]) -> Iterator[str]:
    yield f"# Test programs for {machine.name}"
    yield ""
    yield f"`{program_file(machine, kit[0])}` alone is a good beginning; the others look at one thing each."
    yield ""
    yield "## Before"
    yield ""
    yield "- Read the head of each program: it says where it moves. The tool must be clear of all there."
    yield "- The programs cut air. Spindle off, feed override at 100 percent, work offset G54."
    yield f"- Switch off what the controller compensates{_compensation(machine)}: it would hide the gap."
    cold = program_file(machine, kit[-1])
    yield f"- `{cold}` wants a machine that was off for the night; the others a warm one."
    closed = [name for name, axis in machine.axes.items() if axis.feedback == "load"]
    if closed:
        yield (
            f"- The loops of {', '.join(closed)} follow a scale, and cannot show what is wrong with it:"
            " scale, cyclic error, growth and squareness want a gauge outside of the loop, such as a laser."
        )
    yield "- A log is a CSV file with a column t [s] and those named below, at a constant period."


def _compensation(machine: Machine) -> str:
    return " (BACKLASH and COMP_FILE in the ini file)" if machine.dialect == "linuxcnc" else ""


def _runs(machine: Machine, source: str, folder: str, kit: Sequence[Experiment]) -> Iterator[str]:
    yield ""
    yield "## Run, record, diagnose"
    for one in kit:
        yield ""
        yield f"### {program_file(machine, one)}"
        yield ""
        yield f"{one.why[:1].upper()}{one.why[1:]}."
        yield ""
        yield from (f"- {_code(line)}" for line in one.record if not line.startswith(READ_WITH))
        yield ""
        yield "```"
        yield _command(machine, source, folder, one)
        yield "```"


def _code(line: str) -> str:
    """Set what is typed as code."""
    return f"`{line}`" if line.startswith(("halcmd ", "halsampler ")) else line.replace("_", "\\_")


def _command(machine: Machine, source: str, folder: str, one: Experiment) -> str:
    """Line that judges a log; the log has the columns that were recorded, and the place of the program."""
    linuxcnc = machine.dialect == "linuxcnc"
    log = Path(folder, one.name + (".txt" if linuxcnc else ".csv"))
    words = ["ph-post", "diagnose", str(log), "-m", source]
    if not linuxcnc:
        words += ["--program", str(Path(folder, program_file(machine, one)))]
    for line in one.record:
        if line.startswith(READ_WITH):
            words += line.removeprefix(READ_WITH).split()
    return shlex.join([*words, "-o", str(Path(folder, f"better_{one.name}.toml"))])


def _by_hand(machine: Machine) -> Iterator[str]:
    """Say what no program can do."""
    closed = [name for name, axis in machine.axes.items() if axis.feedback == "load"]
    yield ""
    yield "## By hand"
    yield ""
    yield "- Repeat one program without touching anything: what differs between two runs is noise."
    if closed:
        yield (
            f"- Coast-down ({', '.join(closed)}): a program can only stop under control. For the motor's own"
            " time constant uncouple it from the screw, run it at a steady speed, take away the drive's power"
            " (never with an axis that can fall), and record the motor's encoder until it stands."
        )
