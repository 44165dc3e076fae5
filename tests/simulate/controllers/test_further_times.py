"""Times of axes beside X, Y and Z, against what the words of a controller's manual come to on paper."""

import math

import pytest
from msgspec.structs import replace

from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import read_program
from ph_post.simulate.controllers.run import run_program
from ph_post.types import Axis, Gap, Limits, Servo
from ph_post.units import DEGREE

TURN = Axis(
    name="A",
    feedback="none",
    servo=Servo(b=0.0, c=0.0),
    gap=Gap(lost_motion=0.0),
    limits=Limits(velocity=60 * DEGREE, acceleration=600 * DEGREE, jerk=1e9),
)


def time_of(text, dialect, further=True):
    machine = replace(read_machine("stepper"), dialect=dialect, further={"A": TURN} if further else {})
    command = run_program(read_program(f"G21 G90 G94\n{text}M2\n".encode(), "a.ngc"), machine)
    return float(command.t[-1])


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl"])
@pytest.mark.parametrize(
    ("words", "seconds"),
    [
        ("G0 A90\n", 90 / 60 + 60 / 600),
        ("G0 A3\n", 2 * math.sqrt(3 / 600)),
        ("F1800 G1 A90\n", 3.0),
        ("G93 G1 A90 F15\nG94 F600\n", 4.0),
        ("G0 A-90 B5\n", 1.6),
    ],
)
def test_x_y_and_z_wait_for_an_axis_that_moves_alone(dialect, words, seconds):
    cuts = "G0 X0 Y0 A0\nG1 X10 F600\n{}G1 X20 F600\n"
    added = time_of(cuts.format(words), dialect) - time_of(cuts.format(""), dialect)
    assert added == pytest.approx(seconds, abs=0.12)


@pytest.mark.parametrize(
    ("dialect", "words", "seconds"),
    [
        ("linuxcnc", "G1 X45 A30 F600\n", 4.0),  # F along X, Y and Z
        ("linuxcnc", "G1 X45 A600 F600\n", 10.0),  # but no quicker than the axis turns
        ("grbl", "G1 X45 A30 F600\n", 5.0),  # F along all, degrees as mm
        ("grbl", "G1 X45 A-30 F1200\n", 2.5),
        ("linuxcnc", "G93 G1 X45 A600 F30\n", 10.0),
        ("linuxcnc", "G0 X15 A120\n", 2.1),
    ],
)
def test_axes_of_a_line_begin_and_end_together(dialect, words, seconds):
    begin = "G0 X0 Y0 A0\nG0 X5\n"
    assert time_of(begin + words, dialect) - time_of(begin, dialect) == pytest.approx(seconds, abs=0.2)


def test_an_axis_that_the_machine_file_has_not_is_as_quick_as_asked():
    text = "G0 X0 Y0 A0\nG1 X45 A600 F600\n"
    assert time_of(text, "linuxcnc", further=False) == pytest.approx(4.5, abs=0.2)
