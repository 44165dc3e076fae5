"""What a compensation costs and what it is worth: time and contour error of a program before and after."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from ph_post.audit.deliver import Delivery
from ph_post.compensate.strategies.base import silent
from ph_post.gcode.controller.error import program_error
from ph_post.gcode.controller.run import run_program
from ph_post.gcode.reader.record import PartProgram
from ph_post.simulate.contour import ContourError
from ph_post.types import Machine


class Performance(msgspec.Struct, frozen=True, kw_only=True):
    """What a program does on a model of its controller and of the machine.

    `time` [s] from rest to rest. `error` [m] is the largest at the values of the machine file, `error_worst`
    that on all machines which the file leaves possible; None where they were not asked for or nothing counts.
    """

    time: float
    error: ContourError | None = None
    error_worst: ContourError | None = None


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """The original and the compensated program, both measured against the path of the original."""

    before: Performance
    after: Performance


def weigh(
    delivery: Delivery, machine: Machine, *, errors: bool, tell: Callable[[str], None] = silent
) -> Outcome:
    """Run both programs of a delivery on the models, the drives only where `errors` are wanted."""
    tell("running the original on a model of the controller")
    before = _perform(delivery.before, machine, delivery.before, errors)
    if delivery.after.data == delivery.before.data:
        return Outcome(before=before, after=before)
    tell("running the compensated program on a model of the controller")
    return Outcome(before=before, after=_perform(delivery.after, machine, delivery.before, errors))


def _perform(program: PartProgram, machine: Machine, original: PartProgram, errors: bool) -> Performance:
    command = run_program(program, machine)
    time = float(command.t[-1]) if command.t.size else 0.0
    if not errors or not command.t.size:
        return Performance(time=time)
    found = program_error(command, machine, original)
    return Performance(time=time, error=found.error, error_worst=found.error_worst)
