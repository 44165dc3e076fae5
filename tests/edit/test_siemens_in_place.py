"""SINUMERIK programs changed in place, against an interpreter and a play operator of the tests' own."""

from __future__ import annotations

import re

from support.in_place import SIEMENS

from ph_post.edit.edits import EditOptions
from ph_post.gcode.read import reread
from ph_post.verify.verify import verify

PROGRAMS, MACHINE = SIEMENS.programs, SIEMENS.machine


def test_what_is_added_is_siemens():
    """No word of RS274 alone, and facts and marks behind semicolons."""
    lines = [line for one in map(SIEMENS.changed, PROGRAMS) for line in one.text.decode().splitlines()]
    assert not any(line.startswith("(") for line in lines)
    fresh = [line for line in lines if line not in "\n".join(PROGRAMS.values()).splitlines() and line[0] != ";"]
    word = r"(?:[XYZIJ]-?[\d.]+|[IJ]=AC\(-?[\d.]+\)|F(?:[\d.]+|=R1\*20)|CR=-?\d+|M8|M\d+)"
    shape = re.compile(rf"(?:N\d+ )?(?:G17 G71 G90 )?(?:G4|G[0-3])?(?: ?{word} *)*(?:;.*)?")
    assert [line for line in fresh if not shape.fullmatch(line)] == []


def test_places_of_centres_stay_places_where_a_line_is_shifted():
    text = "G90 G17 G71\nG0 X0 Y0 Z0\nG1 X10 Y10 F600\nG3 X8 Y12 I=AC(8) J=AC(10) F500\nG1 X0\nG0 Z5\nM30\n"
    found = SIEMENS.compensate(text.encode()).text.decode()
    assert "G3 X7.97 Y12.04 I=AC(7.97) J=AC(10.04)" in found or "I=AC(" not in found


def test_a_rounded_corner_is_left_alone_on_both_sides():
    text = "G90 G17 G71\nG0 X0 Y0 Z0\nG1 X10 Y10 F600\nX5 RND=2\nY0\nX20\nX0\nG0 Z5\nM30\n"
    found = SIEMENS.compensate(text.encode()).text.decode()
    assert "\nX5 RND=2\nY0\n" in found


def test_what_may_run_twice_is_left_alone():
    repeated = "\nA1:\nX5\nX20\nREPEAT A1 P=2\n"
    text = f"G90 G17 G71\nG0 X0 Y0 Z0\nG1 X10 Y10 F600{repeated}G90 G94 G40 G17 G71 G0 X0\nG1 X5 F500\nM30\n"
    found = SIEMENS.compensate(text.encode()).text.decode()
    assert repeated in found


def test_the_mode_of_a_circle_through_a_point_is_named_again():
    text = (
        "G90 G17 G71\nG0 X0 Y0 Z1\nG1 Z-1 F600\nG1 X10 Y0\nCIP X-10 Y0 I1=0 J1=10\nX10 Y0 I1=0 J1=-10\n"
        "X0 Y0 I1=5 J1=5\nG0 Z5\nM30\n"
    )
    one = SIEMENS.compensate(text.encode())
    assert verify(one.program, reread(one.program, one.text), tolerance=EditOptions().tolerance, machine=MACHINE).ok
    assert SIEMENS.away(one.text.decode(), SIEMENS.run(text), -1.0).max() < 0.0045
