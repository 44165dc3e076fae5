"""Cutter compensation that is written out, beside the canonical calls of LinuxCNC's interpreter."""

import random

import pytest
from support.canon import needs_rs274
from support.interpreted import difference, interpret
from support.random_contours import contour

from ph_post.expand.expand import expand
from ph_post.expand.tools import ToolShape

HEAD = "G21 G90 G17 G98 G40 G91.1 G64 P0.01 F600\n"


def program(lines):
    return (HEAD + "\n".join(lines) + "\nM2\n").encode()


@needs_rs274
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.thinned(2)
def test_random_contours_come_to_the_same_calls_or_are_refused_by_both(seed):
    rng = random.Random(seed)
    fit, unfit = [], []
    for number in range(60):
        lines = contour(rng, number)
        stands = any("stays as it is" in note for note in expand(program(lines), "a.ngc").notes)
        (unfit if stands else fit).append(lines)
    assert len(fit) > 35
    assert len(unfit) > 5
    data = program([line for lines in fit for line in lines])
    written = expand(data, "a.ngc")
    assert b"G41" not in written.data.split(b"undo 1/")[0]
    assert b"G42" not in written.data.split(b"undo 1/")[0]
    before = interpret(data)
    assert before.refusal == ""
    assert difference(before, interpret(written.data)) == ""
    for lines in unfit[:4]:
        assert interpret(program(lines)).refusal != ""


CASES = {
    "increments and another unit": "G20 G0 X0 Y0 Z.5\nG91 G42.1 D.2\nG1 X2\nY1\nG3 X-1 Y1 I-1\nG1 X-2\nG40 X-1\nY2\n",
    "a lathe's tool": "G18 G8 G0 X10 Z5\nG42.1 D.8 L2\nG1 X5 Z0\nZ-5\nG2 X8 Z-8 R3\nG1 X12\nG40 G0 X20 Z10\n",
    "diameters": "G18 G7 G0 X20 Z5\nG42.1 D.8 L3\nG1 X10 Z0\nZ-5\nG2 X16 Z-8 R3\nG1 X24\nG40 G0 X40 Z10\n",
    "absolute centres": "G90.1 G0 X0 Y0\nG41.1 D2\nG3 X10 Y0 I5 J0\nG1 X20\nG2 X30 Y-10 I20 J-10\nG40 G1 X40\n",
    "stops": "G0 X0 Y0\nG41.1 D2\nG1 X10\nM0\nX20\nY-10\nX30 M1\nG40 X40\n",
    "a diameter below zero": "G0 X0 Y0\nG41.1 D-2\nG1 X10\nX20\nY-10\nX30\nG40 X40\n",
    "the program's end": "G0 X0 Y0\nG41.1 D2 G1 X10\nX20\nY-10\nX30\n",
    "a radius of G10": "G0 X0 Y0\nG10 L1 P3 R2\nG42.1 D4 G1 X10 \nX20\nY-10\nX30\nG40 X40\n",
    "another plane": "G0 X0 Y0 Z5\nG41.1 D2\nG1 X10\nX20\nY-10\nX30\nG40\nG18\nG0 X5 Z3\nG2 X9 Z3 R4\nG1 Y3\n",
    "another plane, one axis": "G0 X0 Y0 Z5\nG42.1 D2\nG1 X10\nX20\nY-10\nX30\nG40\nG18\nG0 Z3\nG2 X9 Z3 R40\nG17\n",
    "no move": "G0 X0 Y0\nG91 G41.1 D2\nF90\nG40\nG1 X5\nG90\nX3\n",
    "subprograms, twice": "o1 sub\nG1 X[#1]\n(inner)\nY[#1]\nX0\nY0\nX[#1/2]\no1 endsub\nG0 X-5 Y0\nG42.1 D1\n"
    "o1 call [10]\no1 call [5]\nG40 X-9\nG41.1 D3\nX5 Y30\nX0 Y40\nG40\nT2 M6\nG0 X1 Y1\n",
}


@needs_rs274
@pytest.mark.parametrize("name", CASES)
@pytest.mark.thinned(4)
def test_compensated_programs_come_to_the_same_calls(name):
    data = program([CASES[name].rstrip()])
    written = expand(data, "a.ngc", parameters={})
    assert written.notes == ()
    before = interpret(data)
    assert before.refusal == ""
    assert difference(before, interpret(written.data)) == ""


@needs_rs274
def test_radii_of_the_table_are_those_of_linuxcnc():
    data = program(["T4 M6", "G0 X0 Y0", "G41 D7 G1 X5", "Y5", "X0", "G40 X-5", "G42 G1 Y9", "X20", "Y0", "G40 X40"])
    tools = {number: ToolShape(diameter=0.1) for number in (4, 7)}
    written = expand(data, "a.ngc", tools=tools, inches=True)  # as rs274 takes its table
    assert (written.data != data, written.notes) == (True, ())
    # The module of Python has no tools; the interpreter alone has the table that it was given.
    found, meant = (
        [call.replace("-0.0000", "0.0000") for call in interpret(one).calls] for one in (written.data, data)
    )
    assert found == meant
