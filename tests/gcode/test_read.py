"""The reader against programs whose motions are worked out by hand."""

import math

import numpy as np
import pytest

from ph_post.errors import InputError
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
