"""Programs for printer firmware: what is read of them, and slicers' programs compensated from end to end."""

from __future__ import annotations

import math
import re
import time
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from support.corpus import compensated, stepper
from support.corpus_judge import Judged, compare
from support.editing import ENOUGH, compensate
from support.firmware import travel

from ph_post.cli.main import main
from ph_post.dialects.declaration import declared_language
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.edit.undo import undo
from ph_post.errors import InputError
from ph_post.gcode.program import ARC, PartProgram
from ph_post.gcode.read import read_program
from ph_post.types import Machine
from ph_post.units import MM
from ph_post.verify.verify import verify

ROOT = Path(__file__).resolve().parents[1]
SLICED = sorted((ROOT / "slicers").glob("*.gcode"))
PRINTERS = ("marlin", "klipper")
MOVED = re.compile(rb"^G[0123]\b", re.IGNORECASE)


def printer() -> Machine:
    found = read_machine(str(ROOT / "golden" / "ring_jogs" / "machine.toml"))
    still = replace(found.axes["Y"], name="Z", gap=replace(found.axes["Y"].gap, lost_motion=0.0))
    return replace(found, axes={**found.axes, "Z": still})


def read(text: str, dialect: str = "marlin") -> PartProgram:
    return read_program(text.encode(), "a.gcode", language=find_dialect(dialect).language)


def hidden(line: str, dialect: str) -> str:
    """Return a line as the reader has it, which is of the same length."""
    hide = find_dialect(dialect).language.hide
    assert hide is not None
    out = hide(line.encode()).decode()
    assert len(out) == len(line)
    return out.split(";")[0].rstrip()


BOTH = [
    ("G1 X1 Y2 E0.5 F600", "G1 X1 Y2      F600"),
    ("G1 E-.8 F2100 ; retract", "G1      F2100"),
    ("G0 X1 Y2 E0.5 F600", "G1 X1 Y2      F600"),
    ("N4 G00X1E.5", "N4 G01X1"),
    ("G0 X1 E0.00", "G0 X1"),
    ("N7 G1 X1 E2*101", "N7 G1 X1   *101"),
    ("G92 E0", ""),
    ("G92 X0 E0", "G92 X0"),
    ("G28 X Y ; home", "G28"),
    ("M117 Layer 3/20 (50%)", ""),
    ("M205 X8.00 Y8.00 Z0.40 E4.50", ""),
    ("M0 Change the tool", "M0"),
    ("M3 S12000", "M3 S12000"),
    ("G29", "$@"),
    ("T1", "$@"),
    ("M600", "$@"),
    ("M84 X Y E", "G28"),
    ("N9 M018", "N9 G28"),
    ("M84 E", ""),
    ("M84 S120", ""),
    ("G10", ""),
    ("M220 S100 ; the whole speed", ""),
    ("M220 S50", "$@"),
    ("M220 B", "$@"),
    ("SET_PIN PIN=caselight VALUE=1", ""),
    ('M862.3 P "MK3S" ; printer model check', ""),
    ("M862 P1", "$@"),
    ("M906 X800 Y800", ""),
    ("set_velocity_limit ACCEL=3000", ""),
    ("EXCLUDE_OBJECT_START NAME=cube", ""),
    ("G11", ""),
    ("G10 S1", ""),
    ("G10 P1 R225 ; standby", ""),
    ("G10 S225 P0", ""),
    ("G10 P1 X2", "$@"),
    ("G10 L2 P1 X5", "$@"),
    ("M116", ""),
    ("M568 P1 S210 R180", ""),
    ("G1 X5 F0.0 E1", "G1 X5"),
    ("G1 F0. X5", "G1     X5"),
    ("G1 X5 F0.5", "G1 X5 F0.5"),
    ("G1 X5 F.0", "G1 X5"),
    ("G1 X5 F05", "G1 X5 F05"),
    ("G90 G1 X5", "\x01G90G1 X5"),
    ("G90G1X5", "$"),
    ("G1X5M106", "$@"),
    ("M106 S255 G1 X5", "\x01M106S255 G1 X5"),
    ("M5 G0 Z5", "\x01M5G0 Z5"),
    ("M5 Z5", "M5"),
    ("G4 G91", "\x01G4G91"),
    ("M109 S200 T1", ""),
    ("M117 G1 X5", ""),
    ("M101", ""),
    ("M103 ; extruder off", ""),
    ("M486 Aleft_M3.stl", ""),
    ("M0 fit T2", "M0"),
    ("G1X5F600", "G1X5F600"),
    ("G4", ""),
    ("G4 P250", "G4 P250"),
    ("G2 X1 Y1 I1 J0 P1", "$@"),
    ("G3 Z.8 I.4 J-1.2 P1 F900", "G3 Z.8 I.4 J-1.2    F900"),
    ("G17", "G17"),
    ("G18", "$@"),
    ("G2 X1 Y1 I1 J0 K0.000 F500", "G2 X1 Y1 I1 J0        F500"),
    ("G3X1Y1I1J0K-0F500", "G3X1Y1I1J0   F500"),
    ("G2 X1 Y1 I1 J0 K0.01", "$@"),
    (";G1 X1", ""),
]


@pytest.mark.parametrize("dialect", PRINTERS)
@pytest.mark.parametrize(("line", "expected"), BOTH)
def test_a_line_of_printer_firmware(line: str, expected: str, dialect: str) -> None:
    assert hidden(line, dialect) == expected


@pytest.mark.parametrize(
    ("line", "marlin", "klipper"),
    [
        ("START_PRINT BED=60", "$@", "$"),
        ("TIMELAPSE_TAKE_FRAME", "$@", "$@"),
        ("PARK_HEAD", "$@", "$"),
        ("@Object Benchy.stl id:0 copy 0", "", ""),
        ("@objectstop Benchy.stl", "", ""),
        ("@pause", "$@", "$"),
        ("G2 X1 Y1 R5", "G2 X1 Y1 R5", "$@"),
        ("X5 Y5", "$@", "$"),
        ("G28_ALL", "$@", "$"),
        ("g1 x5", "\x01g1x5", "g1 x5"),
        ("(G1 X5)", "", "$"),
        ("G4 P150 (wait 150ms)", "G4 P150", "$@"),
        ("G1 X5 (up to Y7)", "$@", "$@"),
        ("(go) G1 X5", "$@", "$"),
    ],
)
def test_a_line_that_one_firmware_has(line: str, marlin: str, klipper: str) -> None:
    assert (hidden(line, "marlin"), hidden(line, "klipper")) == (marlin, klipper)


BEDS = "".join(f"G1 X{90 + n % 3} Y{n} E.1\n" for n in range(60))
"""As steps they go 5.4 m along X."""


RING = "".join(
    f"G3 X{50 + 20 * math.cos(n):.3f} Y{20 * math.sin(n):.3f}"
    f" I{-20 * math.cos(n - 1):.3f} J{-20 * math.sin(n - 1):.3f} E.5\n"
    for n in range(1, 5)
)
"""Arcs about X50 Y0, from X70 Y0 on."""


@pytest.mark.parametrize(
    ("behind", "known"),
    [
        ("G90\nG1 X70 Y0 F900\n" + RING, True),
        ("G90\nG1 X70 Y0 F900\nG1 E1 F200\n" + RING, True),
        ("G90\nG1 X70 Y0\n" + RING, False),  # at whatever feed the macro leaves
        ("G90\nG1 X71 Y0 F900\n" + RING, False),  # on no circle
        ("G90\nG1 X70 Y0 F900\n" + "".join(RING.splitlines(keepends=True)[:2]), False),
        ("G90\nG1 X70 Y0 F900\nPARK_HEAD\n" + RING, False),
        ("G91\nG1 X70 Y0 F900\n" + RING, False),
        ("G90\nG1 X70 Y0 F900\nG2 X30 Y0 I-20\nG2 X70 Y0 I20\nG2 X30 Y0 I-20\nG2 X70 Y0 I20\n", False),  # in XZ too
    ],
    ids=["told", "retracted", "no feed", "off", "few", "macro", "steps", "halves"],
)
def test_behind_a_macro_and_a_g90_arcs_show_that_they_lie_in_xy(behind: str, known: bool) -> None:
    program = read_program(f"START_PRINT\n{behind}".encode(), "a.gcode", language=find_dialect("klipper").language)
    arcs = behind.count("G2 ") + behind.count("G3 ")
    assert int((program.motions.kind == ARC).sum()) == (arcs if known else 0)


@pytest.mark.parametrize(
    ("before", "behind", "mark"),
    [
        ("", "G1 F900\n" + BEDS, "$@"),
        ("G90 ; places\n", "M117 go\nG92 E0\nG0 X90 F6000\n" + BEDS, "$@"),
        ("G91\n", "G1 F900\n" + BEDS, "$"),
        ("", BEDS, "$"),  # at whatever feed the macro leaves
        ("", "G1 F900\n" + BEDS[:400], "$"),  # as steps 1.8 m
        ("", "G1 F900\n" + BEDS.replace("X9", "X-9", 30), "$"),  # about the middle of the bed
        ("", "G1 F900\nG91\n" + BEDS, "$"),
        ("", "PARK_HEAD\nG1 F900\n" + BEDS, "$@"),
        ("", "G1 F900\nPARK_HEAD\n" + BEDS, "$"),
        ("", "G1 F900\nTIMELAPSE_TAKE_FRAME\n" + BEDS, "$@"),
    ],
)
def test_behind_a_macro_coordinates_are_places_that_as_steps_leave_any_machine(
    before: str, behind: str, mark: str
) -> None:
    """What a macro leaves nobody knows, but no printer is 3 m wide: so it left G90, or the print would be none."""
    text = f"{before}START_PRINT BED=60\n{behind}"
    hide = find_dialect("klipper").language.hide
    assert hide is not None
    assert hide(text.encode()).decode().splitlines()[before.count("\n")].rstrip() == mark
    program = read_program(text.encode(), "a.gcode", language=find_dialect("klipper").language)
    # Behind a G91 of its own the program counts from wherever it is.
    assert (np.isfinite(program.motions.end[:, 0]).sum() >= 60) == (mark == "$@" or "G91" in behind)


@pytest.mark.parametrize("lost", ["G1 X9\n", "G1 X9 F900\n", "G1 Z5 F900\nG91\nG1 Z1\nG90\n", ""])
def test_a_macro_behind_which_places_are_shown_brings_back_what_one_before_has_lost(lost: str) -> None:
    """Behind START_PRINT nothing shows the modes: the feed is its own, or the places end."""
    text = f"START_PRINT BED=60\n{lost}FILAMENT_ON\nG1 F900\n{BEDS}"
    program = read_program(text.encode(), "a.gcode", language=find_dialect("klipper").language)
    assert int(np.isfinite(program.motions.end[:, :2]).all(axis=1).sum()) == 60
    assert all(program.modal_after(block).absolute for block in range(program.blocks - 60, program.blocks))


def test_extrusion_is_no_part_of_the_path() -> None:
    program = read("G90\nM83\nG1 X0 Y0 F600\nG1 X10 E1\nG1 E-1 F2100\nG1 X0 F1200\n")
    assert (program.motions.end[:, 0] / MM).tolist() == pytest.approx([0.0, 10.0, 0.0])
    assert (program.motions.feed / MM * 60.0).tolist() == pytest.approx([600.0, 600.0, 1200.0])
    assert not program.notes


def test_a_tool_change_forgets_the_place_and_keeps_the_modes() -> None:
    program = read("G91\nG1 X1 F60\nT1\nG1 X2\nG90\nG1 X5\n")
    assert [one.kind for one in program.breaks] == ["beginning", "not understood", "end"]
    assert np.isnan(program.motions.end[1, 0])
    assert not program.modal_after(3).absolute


@pytest.mark.parametrize(
    ("tools", "dialect", "known"),
    [
        (("T0", "T0 ; again"), "marlin", True),
        (("T0", "T1"), "marlin", False),
        (("T0 S1", ""), "marlin", False),
        (("T0", ""), "klipper", False),
    ],
)
def test_the_first_tool_is_there_from_the_start_in_marlin(tools: tuple[str, str], dialect: str, known: bool) -> None:
    program = read(f"G28\nG90\nG1 X1 Y1 Z1 F600\n{tools[0]}\nG1 X5\n{tools[1]}\nG1 X6\n", dialect)
    assert bool(np.isfinite(program.motions.start).all(axis=1)[1]) == known


@pytest.mark.parametrize("dialect", PRINTERS)
def test_of_two_commands_in_a_line_the_second_may_be_obeyed_or_not(dialect: str) -> None:
    program = read("G21\nG90\nG1 X0 Y0 F600\nG91 G0 Z8 F300\nG1 X5\nG1 X-3\nG90\nG1 X10\nG1 X20 F900\n", dialect)
    named = [note.what for note in program.notes]
    assert named[0] == "line for the controller itself: G91 G0 Z8 F300"
    assert named[1].startswith("motion under modes")
    assert program.motions.block.tolist() == [2, 7, 8]
    assert (program.motions.end[1:, 0] / MM).tolist() == pytest.approx([10.0, 20.0])
    assert np.isnan(program.motions.start[1, :2]).all()
    assert np.isnan(program.motions.feed[1])


@pytest.mark.parametrize("first", ["M106 S255", "M3 S100", "M5", "G4 P1", "M82", "M84"])
@pytest.mark.parametrize("dialect", PRINTERS)
def test_behind_a_command_that_moves_nothing_another_may_be_obeyed_too(dialect: str, first: str) -> None:
    program = read(f"G21\nG90\nG1 X0 Y0 F600\n{first} G1 X5\nG1 Y5\nG1 X7\n", dialect)
    assert [note.what for note in program.notes] == [f"line for the controller itself: {first} G1 X5"]
    assert program.motions.block.tolist() == [2, 4, 5]
    assert np.isnan(program.motions.start[1:, 0]).all()


def test_a_feed_on_a_line_in_doubt_is_where_it_stands() -> None:
    program = read("G21\nG90\nG1 X0 Y0 F600\nG91 G0 Z8 E1 F300 ; away\nG1 X5\n")
    (word,) = [word for word in program.words_of(3) if chr(program.words.letter[word]) == "F"]
    assert program.data[program.words.start[word] : program.words.end[word]] == b"F300"


@pytest.mark.parametrize("digits", [8, 4000])
def test_many_whole_numbers_on_a_line_take_no_longer_than_others(digits: int) -> None:
    """Sixteen numbers of eight digits could be read in eight to the power of sixteen ways."""
    begun = time.process_time()
    line = "G1" + "".join(f" {letter}{digits * '1'}" for letter in "XYZIJKABCUVWPQRS"[: 16 if digits < 9 else 4])
    assert [note.first for note in read(f"G21\nG90\n{line} &\nG1 X1 F60\n").notes] == [2]
    assert time.process_time() - begun < 5.0


@pytest.mark.parametrize("line", ["G92 Z-5 (set Z to -5)", "G1 E4 F50.0 (Create Anchor)", "G0 Z0.5 (Position Height)"])
def test_text_in_parentheses_that_may_be_parameters_leaves_the_modes(line: str) -> None:
    """Built with PAREN_COMMENTS or without (parser.cpp), a letter in it may send an axis anywhere, and sets no mode."""
    program = read(f"G21\nG90\nG1 X0 Y0 Z1 F600\nG1 X3\n{line}\nG1 X5 F900\nG1 X2\n")
    assert [note.what for note in program.notes] == [f"line for the controller itself: {line}"]
    assert program.motions.block.tolist() == [2, 3, 5, 6]
    assert np.isnan(program.motions.start[2]).all()
    assert program.motions.feed[2] == pytest.approx(900.0 * MM / 60.0)
    assert program.modal_after(4).absolute


def test_a_feed_in_parentheses_may_be_one() -> None:
    program = read("G21\nG90\nG1 X0 Y0 F600\nG1 X3 (no faster than F300, X)\nG1 X5\nG1 X2\n")
    assert program.motions.block.tolist() == [2]


def test_what_says_again_what_is_in_force_changes_no_mode() -> None:
    program = read("G21\nG90 G21\nG1 X0 Y0 F600\nG1 X10\n")
    assert (program.motions.end[:, 0] / MM).tolist() == pytest.approx([0.0, 10.0])


@pytest.mark.parametrize(
    ("dialect", "head", "before"),
    [
        ("marlin", "G21\nG91 G0 F300.0 Z8.000\nG90\nG28 X\nG28 Y\nG28 Z", ""),
        ("grbl", "G21\nG90\nM300 S50 (pen up)\nG4 P0.15", "M300 S30 (pen down)\nG4 P0.15\n"),
        ("grblhal", "G21\nG90\nM280 P0 S50", "M280 P0 S30\n"),
    ],
)
def test_a_table_with_play_follows_a_plotters_program(dialect: str, head: str, before: str) -> None:
    """Squares and a saw, as makers of plotters write them; both controllers' readings of the head come to one path."""
    cuts = [
        f"G1 X{x} Y{y} F1500" for x, y in ((30, 0), (30, 20), (5, 20), (5, 5), (40, 5), (20, 30), (60, 35), (0, 40))
    ]
    text = "\n".join([head, "G0 X0 Y0 F1500", "G0 Z0 F300", before + cuts[0], *cuts[1:], ""])
    made = compensated(read(text, dialect), stepper(dialect), find_dialect(dialect))
    judged = compare(Judged("compensated"), dialect, text.encode(), made)
    assert judged.shown >= 4
    assert judged.followed == judged.shown
    assert 5.0 * judged.rms[1] < judged.rms[0]


@pytest.mark.parametrize("dialect", PRINTERS)
@pytest.mark.parametrize("way", ["G0", "G1"])
def test_a_table_with_play_follows_a_program_without_a_feed(dialect: str, way: str) -> None:
    """All moves are at the firmware's own feed, which no F could set back."""
    cuts = [f"G1 X{x} Y{y}" for x, y in ((30, 10), (30, 20), (5, 20), (5, 15), (40, 15), (20, 30), (60, 35), (0, 40))]
    text = "\n".join(["G21", "G90", "G28", f"{way} Z5", f"{way} X10 Y10", "G1 Z0", *cuts, f"{way} Z5", ""])
    made = compensated(read(text, dialect), stepper(dialect), find_dialect(dialect))
    assert not re.search(rb"^[^;]*F", made, re.MULTILINE)
    judged = compare(Judged("compensated"), dialect, text.encode(), made)
    assert judged.shown >= 4
    # The first move of a program that has no rapids comes from an unknown side.
    assert judged.followed >= judged.shown - (way == "G1")


def test_the_height_of_a_purge_line_is_come_to_from_above() -> None:
    """Nobody knows on which side of its backlash Z stands after homing, and the next layer is lower."""
    cuts = [f"G1 X{x} Y{y} E1" for x, y in ((30, 3), (30, 20), (5, 20), (5, 15), (40, 15), (20, 30), (60, 35), (0, 40))]
    head = "G21\nG90\nM83\nG28\nG1 Y1 Z0.3 F1000\nG1 X205 E19\nG1 Y1.6\nG1 X5 E19\nG1 Y2 Z0.2"
    text = "\n".join([head, *cuts, "G1 Z5", ""])
    made = compensated(read(text), stepper("marlin"), find_dialect("marlin"))
    assert b"Z take-up" in made
    judged = compare(Judged("compensated"), "marlin", text.encode(), made)
    assert judged.rms[0] > 0.02
    assert judged.rms[1] < 1e-3


@pytest.mark.parametrize("dialect", ["marlin", "klipper"])
def test_text_is_named_and_seen_through(dialect: str) -> None:
    program = read("G90\nG1 X0 Y0 F600\n# layer 2, G1 X9\nG1 X10\n", dialect)
    assert [note.what for note in program.notes] == ["text: # layer 2, G1 X9"]
    assert (program.motions.end[:, 0] / MM).tolist() == pytest.approx([0.0, 10.0])
    assert program.motions.chain.tolist() == [0, 0]


@pytest.mark.parametrize("dialect", ["marlin", "klipper"])
def test_numbered_and_checked_lines_are_read(dialect: str) -> None:
    program = read("N1 G90*18\nN2 G28 X Y*70\nN3 G1 X1 Y1 F600*57\nN4 G1 X5*33\n", dialect)
    assert not program.notes
    assert [one.kind for one in program.breaks] == ["beginning", "home", "end"]
    assert (program.motions.end[:, 0] / MM).tolist() == pytest.approx([1.0, 5.0])


@pytest.mark.parametrize("dialect", PRINTERS)
@pytest.mark.parametrize(
    ("lines", "known"),
    [
        ("M120\nG91\nG1 Z5 F600\nM121 ; back\n", False),
        ("M120\nG91\nG1 Z5 F600\nM121\nG21\nG90\n", True),
        ("M120\nG91\nG1 Z5 F600\nG90\n", True),
        ("M121\nM120\n", True),
    ],
    ids=range(4),
)
def test_behind_modes_that_are_brought_back_none_is_known(lines: str, known: bool, dialect: str) -> None:
    """M121 of RepRapFirmware brings back those of M120: places behind it were read as steps under G91."""
    program = read(f"G90\nG1 X0 Y0 F900\n{lines}G1 X50 Y50 F900\nG1 X60\n", dialect)
    assert (program.motions.block[-1] == program.blocks - 1) == known
    if known:
        assert program.motions.end[-1, :2].tolist() == pytest.approx([0.06, 0.05])


def test_increments_behind_a_tool_change_need_no_place() -> None:
    motions = read("G91\nG1 X1 F60\nT1\nG1 X2\n").motions
    assert motions.chain.tolist() == [0, 1]
    assert ((motions.end - motions.start)[:, 0] / MM).tolist() == pytest.approx([1.0, 2.0])


def test_a_macro_forgets_the_modes_too() -> None:
    program = read("G90\nG1 X1 F60\nEND_LAYER\nG1 X2\nG90\nG1 X3 F60\nG1 X4\n", "klipper")
    whats = [note.what for note in program.notes]
    assert any("END_LAYER" in what for what in whats)
    assert any("modes" in what for what in whats)
    assert (program.motions.end[:, 0] / MM).tolist() == pytest.approx([1.0, 3.0, 4.0])
    assert program.modal_after(5).units == MM


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("M808 L3\nG1 X40 F800\nG1 Y10\nG1 X0\nM808\nG1 X5\n", (4, 9)),
        ("while iterations < 3\n  G1 X40 F800\n  G1 Y10\nG1 X0\nG1 Y5\nG1 X5\n", (4, 10)),
    ],
)
def test_lines_that_run_again_are_passed_through(text: str, left: tuple[int, int]) -> None:
    program = read(f"G21\nG90\nG1 X1 Y0 F600\n{text}")
    kept = program.motions.block
    assert not ((kept >= left[0] - 1) & (kept < left[1] - 1)).any()
    assert kept.size == 1 + (left[1] < 10)


def test_a_move_before_any_feed_is_read() -> None:
    program = read("G28\nG1 Z5\nG1 X1 F600\n")
    assert np.isnan(program.motions.feed[0])
    with pytest.raises(InputError, match="feed"):
        read_program(b"G1 Z5\n", "a.ngc", strict=True)
    plain = read_program(b"G1 Z5\n", "a.ngc")
    assert np.isnan(plain.motions.feed[0])
    assert [note.what for note in plain.notes] == ["cut without a feed: G1"]


@pytest.mark.parametrize(
    ("dialect", "words", "seconds"),
    [
        ("marlin", "G4 P250", 0.25),
        ("marlin", "G4 S2", 2.0),
        ("klipper", "G4 P250", 0.25),
        ("linuxcnc", "G4 P2", 2.0),
    ],
)
def test_dwells_have_the_units_of_their_firmware(dialect: str, words: str, seconds: float) -> None:
    program = read(f"G1 X0 F60\n{words}\nG1 X1\n", dialect)
    rows, found = program.language.dwells(program.words.letter, program.words.value)
    assert found.tolist() == pytest.approx([seconds])
    assert program.words.block[rows].tolist() == [1]


def parts(data: bytes, *, moves: bool) -> list[bytes]:
    """Lines without comments that move, or those that do not, of a program without those of hunks."""
    lines = [line.partition(b";")[0].strip() for line in data.splitlines()]
    return [line for line in lines if line and (MOVED.match(line) is not None) == moves]


@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
@pytest.mark.parametrize("dialect", PRINTERS)
@pytest.mark.parametrize("file", SLICED, ids=lambda file: file.stem)
def test_a_sliced_program_is_compensated_and_comes_back(file: Path, dialect: str, end: bytes) -> None:
    data = file.read_bytes().replace(b"\n", end)
    found = compensate(data, printer(), dialect=dialect, max_slowdown=ENOUGH)
    assert found.edits.stops
    language = find_dialect(dialect).language
    assert declared_language(found.text) == language
    assert undo(found.text, "a") == data
    after = read_program(found.text, "a", language=language)
    verdict = verify(found.program, after, tolerance=5e-6, machine=printer())
    assert verdict.ok, [one.sentence() for one in verdict.failures]


def extruded(moves: list[bytes], *, relative: bool) -> list[float]:
    """What has come out of the nozzle behind each line [mm of filament], as its E words say."""
    found = [float(one) for one in re.findall(rb"E([-0-9.]+)", b"\n".join(moves))]
    return np.round(np.cumsum(found) if relative else found, 6).tolist()


@pytest.mark.parametrize("dialect", PRINTERS)
@pytest.mark.parametrize("file", SLICED, ids=lambda file: file.stem)
def test_nothing_but_axis_words_is_changed(file: Path, dialect: str) -> None:
    data = file.read_bytes()
    text = compensate(data, printer(), dialect=dialect).text
    added = [line for line in parts(text, moves=False) if line not in parts(data, moves=False)]
    assert {line.split()[0] for line in added} <= {b"G4", b"M425"}
    assert [line for line in parts(text, moves=False) if line not in added] == parts(data, moves=False)
    # Every amount that was reached is reached, and none is passed: lines that are divided share theirs.
    before, after = (extruded(parts(one, moves=True), relative=b"M83" in data) for one in (data, text))
    assert set(before) <= set(after)
    assert len(after) - len(before) < 20
    assert (after[-1], max(after), min(after)) == (before[-1], max(before), min(before))
    own = [line for line in text.splitlines() if line.startswith((b"(", b"F"))]
    assert own == []


def test_marlin_s_own_compensation_is_switched_off_and_on_where_its_value_is_known() -> None:
    data = SLICED[0].read_bytes()
    lines = compensate(data, replace(printer(), own_correction=0.95), dialect="marlin").text.splitlines()
    commands = [line for line in lines if not line.startswith(b"; ")]
    assert (commands[0], commands[-1]) == (b"M425 F0", b"M425 F0.95")
    assert sum(b"M425" in line for line in commands) == 2
    assert b"M425" not in compensate(data, printer(), dialect="klipper").text


def test_marlin_s_own_compensation_is_left_alone_where_its_value_is_not_known() -> None:
    data = SLICED[0].read_bytes()
    found = compensate(data, printer(), dialect="marlin")
    assert not [line for line in found.text.splitlines() if line.startswith(b"M425")]
    said = "the firmware's own backlash compensation, F of M425, must be 0 for the compensated axes"
    assert any(one.startswith(said) for one in found.edits.warnings)
    assert said in found.text.decode().replace("\n;  ", "")
    assert undo(found.text, "a.gcode") == data


@pytest.mark.parametrize(("word", "told"), [("M425 F1", True), ("M425 X0.1", True), ("M425 F0", False)])
def test_a_program_that_switches_it_on_is_told(word: str, told: bool) -> None:
    text = f"{word}\nG90\nG1 X0 Y0 F600\nG1 X10\nG1 X0\nG1 X10\n"
    found = compensate(text.encode(), replace(printer(), own_correction=1.0), dialect="marlin")
    assert any("M425" in one for one in found.edits.warnings) == told


@pytest.mark.parametrize(
    ("lift", "left"),
    [
        ("M207 S2 F3000 Z0.4", True),
        ("m207 s2 z.4", False),  # Marlin knows no small letters, nor whoever wrote them what it does
        ("M207 S2 F3000", False),
        ("M207 S2 Z0.00", False),
        ("M207 S2 ; Z0.4", False),
    ],
)
def test_where_the_firmware_lifts_z_by_itself_z_is_left(lift: str, left: bool) -> None:
    """On each layer it comes down last, whatever the program says: an offset for the way up was too much by a gap."""
    box = "G1 X30 Y0 E1 F600\nG1 X30 Y30 E1\nG1 X0 Y30 E1\nG1 X0 Y.4 E1\n"
    layers = "".join(f"G10\nG1 Z0.{n} F300\nG1 X1 Y1 F3000\nG11\n{box}" for n in (4, 6, 8))
    text = f"G21\nG90\nM83\n{lift}\nG28\nG1 Z5 F300\nG1 Z0.2\nG1 X0 Y0 F3000\n{box}{layers}"
    machine = printer()
    axis = replace(machine.axes["X"], name="Z")
    found = compensate(
        text.encode(), replace(machine, axes={**machine.axes, "Z": axis}), dialect="marlin", max_slowdown=ENOUGH
    )
    assert np.any(found.edits.offset[:, 0])
    assert np.any(found.edits.offset[:, 2]) != left
    said = "axis Z not compensated: by M207 in line 4 the firmware lifts it at each G10 and comes down at G11"
    assert (said in found.edits.warnings) == left


@pytest.mark.parametrize(("words", "stops"), [("", True), (" E1", False)])
def test_an_extruding_arc_is_not_divided(words: str, stops: bool) -> None:
    text = f"G90\nG1 X-10 Y0 F600\nG1 X10 Y0\nG3 X-10 Y0 I-10 J0{words}\nG1 X0 Y-5\n"
    found = compensate(text.encode(), printer(), dialect="marlin")
    assert bool(np.any(found.edits.offset[:, 1])) == stops
    assert any("extrudes (E), and is not divided" in one for one in found.edits.warnings) != stops


@pytest.mark.parametrize("command", ["F0", "F1"])
@pytest.mark.parametrize("instead", ["\n", "\nM425 F{}\n", "\nM425 {}\nM425 {}\n", "\nG1 X9 F600\n"])
def test_the_commands_that_were_added_are_verified(instead: str, command: str) -> None:
    found = compensate(SLICED[0].read_bytes(), replace(printer(), own_correction=1.0), dialect="marlin")
    assert verify(found.program, read_program(found.text, "a", language=found.program.language), tolerance=5e-6).ok
    other = instead.replace("F{}", {"F0": "F1", "F1": "F0"}[command]).replace("{}", command)
    text = found.text.replace(f"\nM425 {command}\n".encode(), other.encode(), 1)
    assert text != found.text
    after = read_program(text, "a", language=found.program.language)
    assert not verify(found.program, after, tolerance=5e-6).ok


@pytest.mark.parametrize("dialect", PRINTERS)
def test_the_commands_read_it_in_the_machine_s_language(
    dialect: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine, out, back = tmp_path / "printer.toml", tmp_path / "out.gcode", tmp_path / "back.gcode"
    own = (ROOT / "golden" / "ring_jogs" / "machine.toml").read_text().replace("linuxcnc", dialect)
    z = own[own.index("[axes.Y]") :].replace("axes.Y", "axes.Z").replace("0.04", "0.0")
    machine.write_text(f"{own}\n{z}")
    source = str(SLICED[0])
    how = ["-m", str(machine), "--max-slowdown", "5", "--no-simulation"]
    assert main(["convert", source, *how, "-o", str(out)]) == 0
    assert main(["verify", source, str(out)]) == 0
    assert main(["diff", source, str(out), "-m", str(machine)]) == 1
    assert main(["inspect", source, "-m", str(machine)]) == 0
    assert main(["convert", str(out), *how, "-o", str(back)]) == 0
    assert back.read_bytes() == out.read_bytes()
    assert main(["convert", str(out), "--undo", "-o", str(back)]) == 0
    assert back.read_bytes() == SLICED[0].read_bytes()
    assert "Traceback" not in capsys.readouterr().err


ROUTED = """G21
G90
G0 Z5 F3000
G0 X0 Y0 F6000
G1 X40 F1500{e}
G3 X40 Y40 I0 J20{e}
G1 X0 Y40{e}
G0 Z5 F3000
G1 X60 Y60 F1500{e}
"""


@pytest.mark.parametrize(("words", "dips"), [("", True), (" E1", False)])
def test_dips_are_written_in_marlin_s_words_and_never_into_extrusion(
    words: str, dips: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, out = tmp_path / "a.gcode", tmp_path / "b.gcode"
    source.write_text(ROUTED.format(e=words))
    how = ["-m", "mill", "--dialect", "marlin", "--strategy", "suppress", "--no-simulation"]
    assert main(["convert", str(source), *how, "-o", str(out)]) == 0
    assert ("extrudes (E), and is not divided" in capsys.readouterr().err) != dips
    text = out.read_text()
    assert (text != source.read_text()) == dips
    if dips:
        trip = travel(text, "marlin")
        assert len(trip.feeds) > 20
        assert trip.ends[-1].tolist() == [60.0, 60.0, 5.0]
        assert all(abs(a - b) < 2e-4 for a, b in trip.arcs)


@pytest.mark.parametrize("dialect", PRINTERS)
def test_rapids_before_any_feed_keep_the_feed_of_the_firmware(dialect: str) -> None:
    """G0 goes at the F in force there: that of a jog before it would have it crawl, and none could be set back."""
    lines = ["G21", "G90", "G0 X3 Y-16 Z5", "G0 X-6 Y3", "G0 Z1", "G1 Z-1 F120", *["G2 X-6 Y3 I2.5 J-1.8 F1200"] * 2]
    text = "\n".join([*lines, "G0 Z5", ""])
    found = compensate(text.encode(), printer(), dialect=dialect, max_slowdown=ENOUGH)
    written = found.text.decode()
    assert "approach" in written
    force = "none"
    rapids = []
    for line in written.splitlines():
        words = line.partition(";")[0]
        if word := re.search(r"F([\d.]+)", words):
            force = word[1]
        if words.startswith("G0"):
            rapids.append(force)
    assert set(rapids[:-1]) == {"none"}
    assert rapids[-1] == "1200"
