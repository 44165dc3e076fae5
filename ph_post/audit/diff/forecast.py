"""What a machine makes of two programs: how long they take, and how far the table leaves the path."""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.audit.diff.pace import Pace
from ph_post.audit.diff.record import Timing
from ph_post.gcode.controller.error import moving_axes, program_error
from ph_post.gcode.controller.run import run_program
from ph_post.gcode.reader.record import RAPID, PartProgram
from ph_post.simulate.assess import at_rest, scenarios
from ph_post.simulate.contour import ContourError
from ph_post.types import Command, Machine
from ph_post.units import MINUTE

LONGEST: Final = 60.0 * MINUTE
"""No contour error is predicted of what runs longer [s]: time and memory of a simulation grow with it."""


class Forecast(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """How a controller runs a program, and what the drives make of that.

    `error` is None where nothing is cut, or the program runs too long.
    """

    pace: Pace
    error: ContourError | None


def forecast(program: PartProgram, original: PartProgram, programmed: Pace, machine: Machine) -> Forecast:
    """Run a program on the model of its controller and of the drives.

    Parameters
    ----------
    program : PartProgram
    original : PartProgram
        Whose path the table should follow: the program without what it declares.
    programmed : Pace
        What feeds and dwells ask for.
    machine : Machine
    """
    command = run_program(program, machine)
    pace = _pace(command, program, programmed)
    if command.t.size == 0 or command.t[-1] > LONGEST:
        return Forecast(pace=pace, error=None)
    moving = moving_axes(command)
    tried = [one for one in scenarios(machine, moving.axes, at_rest(moving)) if one.gap == 1.0]
    nominal = [one for one in tried if one.beta == one.gain == 1.0]
    return Forecast(pace=pace, error=program_error(command, machine, original, nominal).error)


def _pace(command: Command, program: PartProgram, programmed: Pace) -> Pace:
    """Return the times of all motions, what is waited before or behind them included."""
    count = programmed.time.size
    rows = np.bincount(np.maximum(command.segment, 0), minlength=count)[:count]
    time = np.asarray(rows * command.period, dtype=np.float64)
    rapid = program.motions.kind == RAPID
    timing = Timing(
        total=float(command.t[-1]), cutting=float(time[~rapid].sum()), rapids=float(time[rapid].sum()),
        dwells=programmed.timing.dwells, model="controller",
    )  # fmt: skip
    return Pace(speed=programmed.speed, time=time, pause=np.zeros(count + 1), timing=timing)
