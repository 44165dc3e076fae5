"""Conversational programs changed in place, against an interpreter and a play operator of the tests' own."""

from __future__ import annotations

import re
from pathlib import Path as File

import numpy as np
import pytest
from support.corpus import Entry
from support.corpus_judge import judge
from support.in_place import KLARTEXT

from ph_post.edit.undo import undo
from ph_post.gcode.read import reread
from ph_post.verify.verify import verify

PROGRAMS, MACHINE = KLARTEXT.programs, KLARTEXT.machine


@pytest.mark.parametrize("name", PROGRAMS)
def test_what_is_added_is_conversational(name):
    """Facts and marks are comments between the first block and the last, and new blocks have no number."""
    lines = KLARTEXT.changed(name).text.decode().splitlines()
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


@pytest.mark.parametrize("name", PROGRAMS)
def test_decimals_may_stand_behind_commas(name):
    """As controls with German texts write them: what is added has commas too, and every byte comes back."""

    def with_commas(text: str) -> str:
        lines = [
            line if line.startswith(";") else re.sub(r"(?<!DEF \d)\.(?=\d)", ",", line) for line in text.split("\n")
        ]
        return "\n".join(line for line in lines if not line.startswith("; ph-post"))

    original = with_commas(PROGRAMS[name])
    found = KLARTEXT.compensate(original.encode()).text
    assert "," in original
    assert with_commas(found.decode()) == with_commas(KLARTEXT.changed(name).text.decode())
    assert undo(found, "part.h") == original.encode()


def test_what_is_not_followed_keeps_every_byte():
    text, pocket = KLARTEXT.changed("pocket").text.decode(), PROGRAMS["pocket"]
    for stretch in (
        pocket[pocket.index("CYCL DEF 200") : pocket.index("L X+40 Y+0")],
        "L X+30 Y+0 RL F500\nL X+30 Y+20\nL X+40 Y+20 R0\n",
        pocket[pocket.index("LBL 1") : pocket.index("M30")],
    ):
        assert stretch in text
    assert KLARTEXT.changed("pocket").program.notes


def test_the_centre_is_set_again_behind_a_change():
    """What turns about a pole behind the change turns about the same one, shifted as the motion is."""
    text = (
        "0 BEGIN PGM A MM\n1 L X+0 Y+0 Z+1 FMAX\n2 L Z-1 F300\n3 L X+10 Y+1\n4 CC X+10 Y+11\n5 C X+20 Y+11 DR+\n"
        "6 C X+15 Y+19.66025404 DR+\n7 L X+15 Y+30\n8 L Z+5 FMAX\n9 END PGM A MM\n"
    )
    one = KLARTEXT.compensate(text.encode())
    for side in (-1.0, 1.0):
        assert KLARTEXT.away(one.text.decode(), KLARTEXT.run(text), side).max() < 0.0045
    assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=MACHINE).ok


@pytest.mark.parametrize(
    ("plane", "upright"),
    [
        ("SPA0 SPB+0 SPC-0.0 STAY SEQ+ TABLE ROT", True),
        ("SPA+0 SPB+0 SPC+0 MOVE DIST50 F2000 TABLE ROT", True),
        ("SPA0 SPB0 SPC30 STAY TABLE ROT", False),
        ("SPA0 SPB+Q5 SPC0 STAY TABLE ROT", False),
        ("SPA0 SPB0 SPC0 STAY COORD ROT", False),
        ("SPA0 SPB0 SPC0 STAY", False),
    ],
)
def test_a_plane_that_no_angle_turns_is_the_machine_s(plane, upright):
    """With all spatial angles 0 and TABLE ROT the axes are X, Y and Z, as the tests' own interpreter plays them."""
    cut = ["L X+20 Y+0 Z+5 FMAX", "L Z-1 F300", "CC X+0 Y+0", "C X+20 Y+0 DR+ F600", "L Z+5 FMAX", "M5"]
    lines = ["BEGIN PGM A MM", "L X+0 Y+0 Z+50 FMAX", f"PLANE SPATIAL {plane}", *cut, "END PGM A MM"]
    text = "".join(f"{number} {line}\n" for number, line in enumerate(lines))
    one = KLARTEXT.compensate(text.encode())
    assert ("crossing" in one.text.decode()) == upright
    if upright:
        for side in (-1.0, 1.0):
            assert KLARTEXT.away(one.text.decode(), KLARTEXT.run(text), side).max() < 0.0045
        assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=MACHINE).ok


def test_rapids_in_increments_keep_their_numbers():
    """An increment takes no offset: what changes in the air changes ahead of the rapid."""
    lines = ["L X+4 Y+0 Z+5 R0 FMAX", "L IX+1 IY+4 R0 FMAX", "L IZ-6 F300", "L IY+9 F600", "L IZ+6 FMAX"]
    lines += ["L IX-7 IY-17 R0 FMAX", "L IZ-6 F300", "L IY-2 F600", "L IX+3", "L IZ+6 FMAX"]
    text = "".join(f"{number} {line}\n" for number, line in enumerate(["BEGIN PGM A MM", *lines, "END PGM A MM"]))
    one = KLARTEXT.compensate(text.encode())
    found = one.text.decode()
    assert all(f"{line}\n" in found for line in text.splitlines() if "FMAX" in line and " I" in line)
    for side in (-1.0, 1.0):
        # Z, which has no play here, is shifted on its way to the height above which nothing counts.
        assert KLARTEXT.away(found, KLARTEXT.run(text), side).max() < 0.01
    assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=MACHINE).ok


@pytest.mark.parametrize(
    "helix",
    [
        "6 CP IPA+1080 Z-4 DR+",
        "6 CP IPA-900 IZ-5 DR-",
        "6 CP IPA+45 IZ-0.5 DR+",
        "6 CP PA+10 Z-2.5 DR-",
        "6 CP IPA+720 DR+",
    ],
)
def test_a_helix_is_divided_into_helices(helix):
    """Its parts are CP with the height of their ends; what turns about the pole behind it turns about the same one."""
    text = (
        "0 BEGIN PGM A MM\n1 L X+0 Y+0 Z+1 FMAX\n2 L Z-1 F300\n3 L X+10 Y+1\n4 L X+4\n5 CC X+10 Y+1\n"
        f"{helix}\n7 CP IPA+45 DR+\n8 L X+2 Y-9\n9 L Y-5\n10 L X+4\n11 L Z+5 FMAX\n12 END PGM A MM\n"
    )
    one = KLARTEXT.compensate(text.encode())
    found = one.text.decode()
    assert not one.program.notes
    assert len(re.findall(r"^CP IPA\S+ Z\S+ DR", found, re.MULTILINE)) >= 2 * ("Z" in helix and "45" not in helix)
    plain = max(KLARTEXT.away(text, KLARTEXT.run(text), side).max() for side in (-1.0, 1.0))
    assert plain > 0.03
    for side in (-1.0, 1.0):
        assert KLARTEXT.away(found, KLARTEXT.run(text), side).max() < 0.0055
    assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=MACHINE).ok
    assert undo(one.text, "a.h") == text.encode()


def test_what_stands_behind_an_unknown_label_is_passed_through():
    text = b"0 BEGIN PGM A MM\n1 L X+0 Y+0 F100\n2 L X+9\n3 CALL LBL 7 REP 2\n4 L X+1\n5 END PGM A MM\n"
    program = KLARTEXT.compensate(text).program
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
    one = KLARTEXT.compensate(text)
    assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=MACHINE).ok
    assert undo(one.text, "a.h") == text


def test_what_stands_between_circles_of_two_planes_keeps_both():
    text = (
        "0 BEGIN PGM A MM\n1 L X+0 Y+0 Z+1 R0 FMAX\n2 L Z-1 F300\n3 L X+10\n4 CC X+10 Z+1\n5 CP IPA+90 DR+\n"
        "6 CC X+8 Y+5\n7 CP IPA+180 DR+\n8 L X+2\n9 L Z+5 FMAX\n10 END PGM A MM\n"
    )
    one = KLARTEXT.compensate(text.encode())
    assert one.edits.crossings
    assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=MACHINE).ok


def test_a_helix_ends_where_its_increment_says():
    """An increment of five decimals leads to a place of five: written with four it would not be the original's."""
    lines = ["L X-9.87 Y1.092 FMAX", "L Z0.5 FMAX", "CC X-6.7432 Y-2.1442", "CP IPA1053.633 IZ-1.44444 DR+ F250"]
    lines += ["L X-14.85 Y0 Z-0.944", "L X-1.364 Y-4.288", "CC X0 Y0", "C X0 Y-4.5 DR+", "L Z+5 FMAX"]
    text = "\n".join(["BEGIN PGM A MM", *lines, "END PGM A MM", ""])
    found = judge(Entry("helix", File("helix.h"), "heidenhain", text))
    assert found.reversals == found.compensated > 10
    assert found.followed == found.shown > 5
    assert 5.0 * found.rms[1] < found.rms[0]


def test_a_contour_that_appr_begins_keeps_every_byte():
    """APPR brings the cutter to the side of the contour: a block more in it would be one of the contour."""
    own = (
        "3 APPR LCT X+5 Y+5 R5 RL F300\n4 L X+5 Y+85\n5 L X+30 Y+85\n6 CR X+70 Y+95 R+30 DR-\n7 L X+95\n"
        "8 L X+95 Y+40\n9 L X+5 Y+5\n10 DEP LCT X-20 Y-20 R5 F1000\n"
    )
    begin = "0 BEGIN PGM A MM\n1 L X-10 Y-10 Z+5 R0 FMAX\n2 L Z-5 F1000\n"
    end = "11 L X-30 Y-20\n12 L X+90\n13 L X-30\n14 L Z+250 R0 FMAX M2\n15 END PGM A MM\n"
    text = KLARTEXT.compensate((begin + own + end).encode()).text.decode()
    assert own in text
    assert end not in text


def test_a_feed_that_only_the_control_knows_is_not_replaced():
    """Q10 is set elsewhere: what is added behind the block has its feed, and not the one before it."""
    text = (
        "0 BEGIN PGM A MM\n1 L X-10 Y-10 Z+5 R0 FMAX\n2 L Z-2 F200\n3 L X+0 Y+0 FQ10\n4 L X+0 Y+30\n5 L X+30\n"
        "6 L Y+0\n7 L X+0\n8 L X+20\n9 L Z+5 FMAX\n10 END PGM A MM\n"
    )
    found = KLARTEXT.compensate(text.encode()).text.decode()
    behind = found[found.index("FQ10") : found.index("L Z+5")]
    assert behind != text[text.index("FQ10") : text.index("9 L Z+5")]
    assert re.search(r"F\s*[\d.]", re.sub(r";.*", "", behind)) is None
