"""The reader against programs whose motions are worked out by hand."""

import math

import numpy as np
import pytest

from ph_post.errors import InputError
from ph_post.gcode.program import ARC
from ph_post.gcode.read import read_program

PROGRAM = b"""%
(hello) G21 G90 G17 ; x
N10 G0 X0 Y0 Z5
g1 z-1 f100
G1 X 1 0. Y-.5 F600\r
G2 X20 I5 J0
X20 I-5
G3 X10 Y9.5 R10
G91 G1 X1
M30
foo bar
%
"""


def test_every_byte_is_kept_and_what_stands_behind_the_end_is_not_read():
    program = read_program(PROGRAM, "a.ngc")
    assert b"".join(program.text(block) for block in range(program.blocks)) == PROGRAM
    assert program.breaks[-1].kind == "end"
    assert program.breaks[-1].block == 9
    assert program.notes == ()


def test_lines_and_arcs_lead_where_they_say():
    motions = read_program(PROGRAM, "a.ngc").motions
    ends = np.array(
        [[0, 0, 5], [0, 0, -1], [10, -0.5, -1], [20, -0.5, -1], [20, -0.5, -1], [10, 9.5, -1], [11, 9.5, -1]]
    )
    np.testing.assert_allclose(motions.end * 1e3, ends, atol=1e-12)
    np.testing.assert_allclose(motions.center[3:6] * 1e3, [[15, -0.5], [15, -0.5], [10, -0.5]], atol=1e-12)
    np.testing.assert_allclose(motions.angle[3:6], [-math.pi, -math.tau, math.pi / 2])
    np.testing.assert_allclose(motions.feed[1:], [0.1 / 60, *5 * [0.01]])
    assert motions.kind.tolist() == [0, 1, 1, 2, 2, 2, 1]


def test_an_arc_without_a_centre_is_refused_with_its_place():
    with pytest.raises(InputError) as refusal:
        read_program(b"G0 X0 Y0 F100\nG2 X10\n", "a.ngc", strict=True)
    assert str(refusal.value).startswith("a.ngc:2:1: arc without centre or radius; ")
    assert refusal.value.excerpt == "    G2 X10\n    ^^"


@pytest.mark.parametrize("turns", [b"0", b"1.5", b"1001", b"1000000000"])
def test_an_arc_of_absurdly_many_turns_is_refused(turns):
    with pytest.raises(InputError, match="a whole P from 1 to 1000"):
        read_program(b"G0 X0 Y0\nG3 X0 Y0 I5 P" + turns + b" F100\nM2\n", "a.ngc", strict=True)


PLACED = (
    "G21 G90 G17\nG0 X0 Y60 Z5\nG1 Z-5 F500\nY50\nX-40\nG3 X-30 Y40 I-40 J40\nG1 X-50\nY-40\n"
    "G3 X-40 Y-30 I-40 J-40\nM2\n"
)
"""Two arcs of three quarters of a circle about corners of a plate, whose centres are places."""


def centres_of(text):
    motions = read_program(text.encode(), "a.ngc").motions
    return (1e3 * motions.center[motions.kind == ARC]).round(6).tolist()


def test_centres_are_places_where_no_arc_fits_otherwise():
    assert centres_of(PLACED) == [[-40.0, 40.0], [-40.0, -40.0]]
    program = read_program(PLACED.encode(), "a.ngc")
    assert not program.notes
    assert program.absolute_centres().all()
    assert np.degrees(program.motions.angle[program.motions.kind == ARC]).round(9).tolist() == [270.0, 270.0]


@pytest.mark.parametrize(
    ("old", "new"),
    [("G90 ", "G90 G91.1 "), ("I-40 J-40", "I0 J10"), ("I-40 J-40", "I-40 J-41")],
    ids=["said otherwise", "one fits from its start", "one fits neither"],
)
def test_an_arc_that_does_not_end_about_its_centre_stays_passed_through(old, new):
    program = read_program(PLACED.replace(old, new).encode(), "a.ngc")
    assert not program.language.places_centres
    assert program.notes[0].what.startswith("radii of the arc differ: G3")


def test_text_before_the_first_percent_sign_opens_no_program():
    program = read_program(
        b"gcode\n// filepath: d:\\part\n(a plate)\n%\nG21 G90\nG0 X0 Y0\nG1 X5 F100\n%\nG1 X9\n", "a.ngc"
    )
    assert program.motions.block.tolist() == [5, 6]
