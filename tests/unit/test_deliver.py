"""Programs compensated and judged: what is written passes, and what cannot be written is said in one line."""

import numpy as np
import pytest
from msgspec.structs import replace
from support.corpus import stepper
from support.splicing import with_edits

from ph_post.audit.deliver import Request, deliver
from ph_post.audit.verify import verify
from ph_post.compensate.options import PlanOptions
from ph_post.errors import InputError
from ph_post.gcode.reader.read import read_program
from ph_post.gcode.splice.options import SpliceOptions
from ph_post.gcode.splice.record import Edits, Stop
from ph_post.units import MM


def asked(slowdown=10.0, strategy="takeup"):
    how = PlanOptions(strategy=strategy, carrier="program", max_slowdown=slowdown)
    return Request(plan=how, splice=SpliceOptions(max_slowdown=slowdown))


def delivered(text, machine=None, request=None):
    return deliver(read_program(text.encode(), "part.ngc"), machine or stepper(), request or asked())


def test_stops_that_come_to_one_seat_are_declared_as_one():
    """Parts shorter than four steps are not cut off: the stops a tenth of a nanometre apart stand at one place."""
    program = read_program(b"G21 G90\nG0 X0 Y0\nG1 X10 F600\nM2\n", "part.ngc")
    stops = tuple(Stop(motion=1, share=share, pause=0.01, shifts=()) for share in (0.5, 0.50000001))
    machine = stepper()
    made = with_edits(program, Edits(offset=np.zeros((2, 3)), stops=stops), machine, "linuxcnc")
    assert made.text.count(b"G4 P0.01") == 1
    assert b"(ph-post: 1 stops, 0 dips)" in made.text
    verdict = verify(program, read_program(made.text, "out"), tolerance=0.005 * MM, machine=machine)
    assert [one.sentence() for one in verdict.failures] == []


def test_a_machine_without_an_axis_of_the_program_is_refused():
    machine = stepper()
    axes = {name: machine.axes[name] for name in "XY"}
    with pytest.raises(InputError, match="moves axis Z, which has no drive"):
        delivered("G21 G90 G0 X0 Y0 Z5\nG1 Z0 F100\nX5\nM2\n", replace(machine, axes=axes))
