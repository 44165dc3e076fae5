"""The reader against LinuxCNC's interpreter, on programs written by hand and on those that come with it."""

import re
from pathlib import Path

import pytest
from support.canon import assert_agrees, needs_rs274, number_lines, run_rs274

from ph_post.gcode.read import read_program

FILES = Path("/usr/share/linuxcnc/ncfiles")
PLAIN = ["3dtest", "arcspiral", "b-index", "cds", "comp", "comp-g1", "lathe_pawn", "plasmatest", "tort"]
PASSED_THROUGH = [
    "flowsnake",
    "hole-circle",
    "polar",
    "skeleton",
    "spiral",
    "systems",
    "threading",
    "toplevel",
]

BY_HAND = {
    "planes": "G0 X1 Y2 Z3\nG18 G2 X5 Z7 I4 K0\nG3 X1 Z3 R-4\nG19 G2 Y6 Z7 J4\nG3 Y2 Z3 R4\nG17 G3 X9 Y2 I4",
    "helices": "G0 X0 Y0 Z0\nG2 I5 Z-1\nG2 I5 Z-2 P3\nG18 G3 K2 Y4\nG19 G2 J-1 X3 P2\nG91 G2 J-1 X1",
    "increments": "G91 G0 X1 Y1 Z1\nG1 X-2\nG2 X2 Y2 I2\nG90 G1 X0\nG91 G3 X-1 Y1 R1\nG91 G3 X-1 Y1 R-1",
    "absolute centres": "G90.1 G0 X3 Y4 Z0\nG2 X5 Y0 I0 J0\nG91 G2 X0 Y1 I0 J0.5\nG90 G91.1 G3 X4 Y2 I-1",
    "inches": "G20 G0 X1 Y1 Z0\nG1 X2 F5\nG2 X3 I0.5\nG21 G1 X10 F100\nG20\nG1 Y1 F3\nX0.5",
    "inverse time": "G0 X0 Y0\nG93 G1 X5 F2\nX6 F3\nG2 X8 I1 F1\nG94 F60\nX9 I0.5\nG1 X1",
    "work systems": "G54 G0 X1 Y1 Z1\nG55 G1 X2\nG0 X0 Y0\nG10 L2 P2 X5\nG0 X1 Y1 Z1\nG59.3 X2 Y3 Z4\nG1 X5",
    "other names of a place": "G0 X1 Y2 Z3\nG92 X0 Y0\nG1 X5\nG91 Y1\nG90 G92.2\nG0 X1 Z1\nG92.3\nG0 X2 Y2",
    "home": "G0 X1 Y2 Z3\nG28\nG0 X5 Y5 Z5\nG91 G28 Z0\nG90 G0 X1 Y2 Z3\nG30 X1\nG0 X0 Y0\nG28.1\nX1",
    "machine coordinates": "G0 X1 Y2 Z3\nG53 G0 Z0\nX5 Y5\nG1 X6 Y6 Z1\nG53 G1 X0\nG1 X5",
    "tool lengths": "T1 M6\nG43 H2 G0 X1 Y1 Z5\nG1 Z1\nG43.1 Z3\nG0 Z9\nG49\nG0 Z1",
    "probing": "G0 X0 Y0 Z5\nG38.2 Z-5\nG0 X1 Y1 Z5\nG38.3 Z1\nG0 Z4",
    "cycles": "G0 X0 Y0 Z5\nG81 X1 Y1 Z-1 R1\nX2\nG80 G0 X0 Y0 Z5\nG98 G83 X1 Z-2 R1 Q1\nG1 X0 Y0 Z0",
    "small words": "g0x1y1z1\ng1 x 1 0 . 5\n g 1 y + 3 z - .5\nG01 X1. Y.5\n/G1 X5\nG1 X7 (a) Y8 ; b\n%",
    "words of no motion": "G0 X1 Y1 Z1\nG1\nG0\nG1 F50\nM3 S100\nX2\nG4 P1\nX3\nG61\nX4\nG64 P0.1\nX5",
    "parameters": "G0 X1 Y1 Z1\n#1=5\nG1 X#1\nG1 X2 Y2\nZ[#1+2]\nG1 X1 Y1 Z1\nX3",
    "subroutines": "o1 sub\nG1 X5\no1 endsub\nG0 X1 Y1 Z1\no1 call\nG1 X3 Y3\nX4",
    "splines": "G0 X0 Y0 Z0\nG5 I1 J1 P-1 Q1 X5 Y0\nG5 P0 Q1 X9 Y0\nG5.1 I1 J1 X12 Y0\nG1 X13",
    "NURBS": "G0 X0 Y0 Z0\nG5.2 P1 L3\nX1 Y1 P1\nX2 Y2 P1\nX3 Y0 P1\nG5.3\nG1 X9",
    "rotary axes": "G0 X1 Y1 Z1\nG1 X2\nG1 X3 A5\nG1 X4 Y4 Z4\nX5",
    "dwell and motion": "G0 X1 Y1 Z1\nG4 P0.1 G0 X2\nG4 P0.1 G1 Y2\nX5",
}


def compare(text):
    """Read a program here and there; the reader's motions."""
    numbered = number_lines(text)
    canon = run_rs274(numbered)
    assert canon.refusal == ""
    program = read_program(numbered.encode(), "a.ngc")
    assert_agrees(program, canon)
    return program


@needs_rs274
@pytest.mark.parametrize("name", BY_HAND)
def test_programs_by_hand(name):
    text = f"%\nG17 G21 G40 G90 G94 F600\n{BY_HAND[name]}\n" + ("" if name == "small words" else "%\n")
    assert compare(text).motions.block.size > 0


@needs_rs274
@pytest.mark.parametrize("name", [*PLAIN, *PASSED_THROUGH])
def test_programs_that_come_with_linuxcnc(name):
    file = FILES / f"{name}.ngc"
    if not file.exists():
        pytest.skip(f"LinuxCNC's sample program {file} is not installed")
    program = compare(re.sub(r"(?m)^[nN]\s*\d+\s*", "", file.read_text(encoding="utf-8")))
    assert program.motions.block.size > 0
    assert (program.notes == ()) or name in [*PASSED_THROUGH, "b-index", "comp", "comp-g1"]
