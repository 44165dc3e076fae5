"""SINUMERIK programs changed in place, against an interpreter and a play operator of the tests' own."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from support.editing import compensate
from support.ideal_play import distances, table
from support.sinumerik_motions import Run

from ph_post.dialects.declaration import declared_language
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.edit.edits import EditOptions
from ph_post.edit.undo import undo
from ph_post.gcode.read import reread
from ph_post.verify.verify import verify

FOLDER = Path(__file__).parents[1] / "changed_dialects"
PROGRAMS = {name: (FOLDER / f"{name}.mpf").read_text() for name in ("post", "hand", "steps")}
MACHINE = replace(read_machine("stepper"), dialect="siemens")
BACKLASH = {"X": 0.06, "Y": 0.08}
DEEP = -0.99
"""The tool cuts where it is lower [mm]."""


@pytest.fixture(scope="module")
def changed():
    """Each program with what it became."""
    return {name: compensate(text.encode(), MACHINE, dialect="siemens") for name, text in PROGRAMS.items()}


def _away(text: str, original: Run, side: float) -> np.ndarray:
    """Distances [mm] of the table from the original's cuts while the tool cuts; the motors begin on one side."""
    run = Run(text)
    places = table(run.path, BACKLASH, dict.fromkeys("XYZ", side))
    return distances(places[run.cutting & (run.path[:, 2] < DEEP)], original.path[original.cutting])


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_table_follows_the_original_within_micrometres(name, changed):
    text, original = changed[name].text.decode(), Run(PROGRAMS[name])
    for side in (-1.0, 1.0):
        before, after = (_away(one, original, side) for one in (PROGRAMS[name], text))
        assert after.max() < 0.0045
        assert np.sqrt((before**2).mean()) > 0.02
        assert np.sqrt((after**2).mean()) < 0.0005
    assert Run(text).seconds < 1.1 * original.seconds


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_check_passes_and_undo_gives_every_byte_back(name, changed):
    one = changed[name]
    after = reread(one.program, one.text)
    verdict = verify(one.program, after, tolerance=EditOptions().tolerance, machine=MACHINE)
    assert verdict.ok, verdict
    assert undo(one.text, "part.mpf") == PROGRAMS[name].encode()
    assert declared_language(one.text) == find_dialect("siemens").language


def test_what_is_added_is_siemens(changed):
    """No word of RS274 alone, and facts and marks behind semicolons."""
    lines = [line for one in changed.values() for line in one.text.decode().splitlines()]
    assert not any(line.startswith("(") for line in lines)
    fresh = [line for line in lines if line not in "\n".join(PROGRAMS.values()).splitlines() and line[0] != ";"]
    word = r"(?:[XYZIJ]-?[\d.]+|[IJ]=AC\(-?[\d.]+\)|F(?:[\d.]+|=R1\*20)|CR=-?\d+|M8|M\d+)"
    shape = re.compile(rf"(?:N\d+ )?(?:G17 G71 G90 )?(?:G4|G[0-3])?(?: ?{word} *)*(?:;.*)?")
    assert [line for line in fresh if not shape.fullmatch(line)] == []


def test_places_of_centres_stay_places_where_a_line_is_shifted():
    text = "G90 G17 G71\nG0 X0 Y0 Z0\nG1 X10 Y10 F600\nG3 X8 Y12 I=AC(8) J=AC(10) F500\nG1 X0\nG0 Z5\nM30\n"
    found = compensate(text.encode(), MACHINE, dialect="siemens").text.decode()
    assert "G3 X7.97 Y12.04 I=AC(7.97) J=AC(10.04)" in found or "I=AC(" not in found


def test_a_rounded_corner_is_left_alone_on_both_sides():
    text = "G90 G17 G71\nG0 X0 Y0 Z0\nG1 X10 Y10 F600\nX5 RND=2\nY0\nX20\nX0\nG0 Z5\nM30\n"
    found = compensate(text.encode(), MACHINE, dialect="siemens").text.decode()
    assert "\nX5 RND=2\nY0\n" in found


def test_what_may_run_twice_is_left_alone():
    repeated = "\nA1:\nX5\nX20\nREPEAT A1 P=2\n"
    text = f"G90 G17 G71\nG0 X0 Y0 Z0\nG1 X10 Y10 F600{repeated}G90 G94 G40 G17 G71 G0 X0\nG1 X5 F500\nM30\n"
    found = compensate(text.encode(), MACHINE, dialect="siemens").text.decode()
    assert repeated in found


def test_the_mode_of_a_circle_through_a_point_is_named_again():
    text = (
        "G90 G17 G71\nG0 X0 Y0 Z1\nG1 Z-1 F600\nG1 X10 Y0\nCIP X-10 Y0 I1=0 J1=10\nX10 Y0 I1=0 J1=-10\n"
        "X0 Y0 I1=5 J1=5\nG0 Z5\nM30\n"
    )
    one = compensate(text.encode(), MACHINE, dialect="siemens")
    assert verify(one.program, reread(one.program, one.text), tolerance=EditOptions().tolerance, machine=MACHINE).ok
    assert _away(one.text.decode(), Run(text), -1.0).max() < 0.0045
