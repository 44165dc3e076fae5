"""Crossings on the fly within motions at whose ends the controller stops: the path mode around them, and its damage."""

from __future__ import annotations

import re

import pytest
from msgspec.structs import replace
from support.editing import compensate

from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import reread
from ph_post.units import MM
from ph_post.verify.verify import verify

TOLERANCE = 0.005 * MM
CUT = "G21 G90 G17 G94\n{mode}\nG0 X16 Y12 Z5\nG1 Z-1 F300\nG3 X-16 Y12 I-16 J-12 F1200\nG1 X-16 Y-12\nG0 Z5\nM2\n"
ROUNDED = "G64 P0.002 Q0"


def written(mode: str, dialect: str = "linuxcnc"):
    machine = replace(read_machine("stepper"), dialect=dialect)
    made = compensate(CUT.format(mode=mode).encode(), machine, dialect=dialect)
    return made.program, made.text.decode()


def judged(original, text: str):
    return verify(original, reread(original, text.encode()), tolerance=TOLERANCE)


@pytest.mark.parametrize("mode", ["G61", "G61.1"])
def test_joints_of_crossings_are_passed_and_the_ends_of_motions_are_not(mode: str) -> None:
    original, text = written(mode)
    assert judged(original, text).ok
    cuts = [line for line in text.splitlines() if not line.startswith("(")]
    begin, end = cuts.index(ROUNDED), len(cuts) - 1 - cuts[::-1].index(mode)
    # From the begin of the arc to its last part, which ends in a stop as it did.
    assert re.match(r"G3 X\S+ Y\S+ I\S+ J\S+ F1200$", cuts[begin + 1])
    assert re.match(r"G3 X-\S+ Y\S+ I\S+ J\S+", cuts[end + 1])
    assert all(line.startswith(("G1", "G3")) for line in cuts[begin + 1 : end])
    assert "crossing Y-" in text


def test_a_controller_that_follows_the_exact_path_needs_no_other_mode() -> None:
    original, text = written("G61", "grbl")
    assert judged(original, text).ok
    assert "crossing Y-" in text
    assert "G64" not in text


DAMAGE = {
    "rounded by more than the tolerance": (ROUNDED, "G64 P0.006 Q0"),
    "rounded without bound": (ROUNDED, "G64"),
    "lines joined": (ROUNDED, "G64 P0.002"),
    "no stop at the end of the arc": (r"\nG61\n(G3 X-[^\n]*\n)", r"\n\1G61\n"),
    "no stop at all": (r"\nG61\n(G3 X-[^\n]*\n)", r"\n(none)\n\1"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_to_the_path_mode_is_found(name: str) -> None:
    original, text = written("G61")
    damaged, count = re.subn(*DAMAGE[name], text, count=1)
    assert count == 1
    kinds = {failure.kind for failure in judged(original, damaged).failures}
    assert kinds
    assert kinds <= {"path", "state", "text"}
