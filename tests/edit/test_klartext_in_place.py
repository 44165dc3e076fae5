"""Conversational programs changed in place, against an interpreter and a play operator of the tests' own."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from support.editing import compensate
from support.ideal_play import distances, table
from support.tnc_motions import TncRun

from ph_post.dialects.declaration import declared_language
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.edit.edits import EditOptions
from ph_post.edit.undo import undo
from ph_post.gcode.read import reread
from ph_post.verify.verify import verify

FOLDER = Path(__file__).parents[1] / "changed_dialects"
PROGRAMS = {name: (FOLDER / f"{name}.h").read_text() for name in ("plate", "pocket", "polar")}
MACHINE = replace(read_machine("stepper"), dialect="heidenhain")
BACKLASH = {"X": 0.06, "Y": 0.08}
DEEP = -0.99
"""The tool cuts where it is lower [mm]."""


@pytest.fixture(scope="module")
def changed():
    """Each program with what it became."""
    return {name: compensate(text.encode(), MACHINE, dialect="heidenhain") for name, text in PROGRAMS.items()}


def _away(text: str, original: TncRun, side: float) -> np.ndarray:
    """Distances [mm] of the table from the original's cuts while the tool cuts; the motors begin on one side."""
    run = TncRun(text)
    places = table(run.path, BACKLASH, dict.fromkeys("XYZ", side))
    return distances(places[run.cutting & (run.path[:, 2] < DEEP)], original.path[original.cutting])


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_table_follows_the_original_within_micrometres(name, changed):
    text, original = changed[name].text.decode(), TncRun(PROGRAMS[name])
    for side in (-1.0, 1.0):
        before, after = (_away(one, original, side) for one in (PROGRAMS[name], text))
        assert after.max() < 0.0045
        assert np.sqrt((before**2).mean()) > 0.02
        assert np.sqrt((after**2).mean()) < 0.0005
    assert TncRun(text).seconds < 1.1 * original.seconds
    assert TncRun(text).functions == original.functions


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_check_passes_and_undo_gives_every_byte_back(name, changed):
    one = changed[name]
    verdict = verify(one.program, reread(one.program, one.text), tolerance=EditOptions().tolerance, machine=MACHINE)
    assert verdict.ok, verdict
    assert undo(one.text, "part.h") == PROGRAMS[name].encode()
    assert declared_language(one.text) == find_dialect("heidenhain").language


@pytest.mark.parametrize("name", PROGRAMS)
def test_what_is_added_is_conversational(name, changed):
    """Facts and marks are comments between the first block and the last, and new blocks have no number."""
    lines = changed[name].text.decode().splitlines()
    assert "BEGIN PGM" in lines[0]
    assert "END PGM" in lines[-1]
    assert lines[-2].startswith("; ph-post: undo")
    own = set(PROGRAMS[name].splitlines())
    place = r" ?[XYZ][+-][\d.]+"
    shape = re.compile(
        rf"(?:\d+ +)?(?:L(?: {place})*|CC(?: {place})*|C(?: {place})* DR[+-]|CR(?: {place})* R[+-][\d.]+ DR[+-])"
        r"(?: R0)?(?: M8)?(?: FQ52)?(?: FMAX)?(?: F[\d.]+)?(?: M\d+)*(?: ;.*)?|M\d+|;.*"
    )
    assert [line for line in lines if line not in own and not shape.fullmatch(line)] == []


def test_what_is_not_followed_keeps_every_byte(changed):
    text, pocket = changed["pocket"].text.decode(), PROGRAMS["pocket"]
    for stretch in (
        pocket[pocket.index("CYCL DEF 200") : pocket.index("L X+40 Y+0")],
        "L X+30 Y+0 RL F500\nL X+30 Y+20\nL X+40 Y+20 R0\n",
        pocket[pocket.index("LBL 1") : pocket.index("M30")],
    ):
        assert stretch in text
    assert changed["pocket"].program.notes


def test_the_centre_is_set_again_behind_a_change():
    """What turns about a pole behind the change turns about the same one, shifted as the motion is."""
    text = (
        "0 BEGIN PGM A MM\n1 L X+0 Y+0 Z+1 FMAX\n2 L Z-1 F300\n3 L X+10 Y+1\n4 CC X+10 Y+11\n5 C X+20 Y+11 DR+\n"
        "6 C X+15 Y+19.66025404 DR+\n7 L X+15 Y+30\n8 L Z+5 FMAX\n9 END PGM A MM\n"
    )
    one = compensate(text.encode(), MACHINE, dialect="heidenhain")
    for side in (-1.0, 1.0):
        assert _away(one.text.decode(), TncRun(text), side).max() < 0.0045
    assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=MACHINE).ok


def test_a_helix_keeps_its_bytes_and_its_pole():
    text = (
        "0 BEGIN PGM A MM\n1 L X+0 Y+0 Z+1 FMAX\n2 L Z-1 F300\n3 L X+10 Y+1\n4 L X+4\n5 CC X+10 Y+1\n"
        "6 CP IPA+1080 Z-4 DR+\n7 L X+4 Y-9\n8 L Y-5\n9 CP IPA+45 DR+\n10 L X+2\n11 L Z+5 FMAX\n12 END PGM A MM\n"
    )
    one = compensate(text.encode(), MACHINE, dialect="heidenhain")
    found = one.text.decode()
    assert "5 CC X+10 Y+1\n6 CP IPA+1080 Z-4 DR+\n" in found
    assert [note.what for note in one.program.notes] == ["helix, or more than one turn: CP IPA+1080 Z-4 DR+"]
    assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=MACHINE).ok
    assert undo(one.text, "a.h") == text.encode()


def test_what_stands_behind_an_unknown_label_is_passed_through():
    text = b"0 BEGIN PGM A MM\n1 L X+0 Y+0 F100\n2 L X+9\n3 CALL LBL 7 REP 2\n4 L X+1\n5 END PGM A MM\n"
    program = compensate(text, MACHINE, dialect="heidenhain").program
    assert [(note.first, note.last, note.what) for note in program.notes] == [(3, 5, "label that is not known: 7")]


def test_the_centre_of_a_circle_that_is_divided_by_stops_stays():
    """Short circles about centres of lines of their own, with corners between them."""
    lines = ["0 BEGIN PGM A MM", "1 L X+0 Y+0 Z+1 R0 FMAX", "2 L Z-1 F300"]
    for k in range(200, 216):
        x, y = (20.0 + 0.001 * k) * np.cos(0.05 * k), (20.0 + 0.001 * k) * np.sin(0.05 * k)
        lines += (
            [f"3 CC X{x - 1:+.3f} Y{y:+.3f}", "4 CP IPA+20 DR+"] if k % 4 == 3 else [f"5 L X{x:+.3f} Y{y:+.3f} F900"]
        )
    text = "\n".join([*lines, "6 L Z+5 FMAX", "7 END PGM A MM", ""]).encode()
    one = compensate(text, MACHINE, dialect="heidenhain")
    assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=MACHINE).ok
    assert undo(one.text, "a.h") == text


def test_what_stands_between_circles_of_two_planes_keeps_both():
    text = (
        "0 BEGIN PGM A MM\n1 L X+0 Y+0 Z+1 R0 FMAX\n2 L Z-1 F300\n3 L X+10\n4 CC X+10 Z+1\n5 CP IPA+90 DR+\n"
        "6 CC X+8 Y+5\n7 CP IPA+180 DR+\n8 L X+2\n9 L Z+5 FMAX\n10 END PGM A MM\n"
    )
    one = compensate(text.encode(), MACHINE, dialect="heidenhain")
    assert one.edits.crossings
    assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=MACHINE).ok
