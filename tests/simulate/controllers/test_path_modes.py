"""Path modes that round corners by more than the backlash: the warning, and its number against the model's motion."""

from __future__ import annotations

import re

import numpy as np
import pytest
from msgspec.structs import replace

from ph_post.dialects.planners import planner_of
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import read_program
from ph_post.simulate.controllers.chords import straight_blocks
from ph_post.simulate.controllers.moves import limit_table, tolerances, written_legs
from ph_post.simulate.controllers.path_modes import chord_warnings, corner_rounding, path_mode_warnings
from ph_post.simulate.controllers.run import run_program
from ph_post.types import Machine, PlannerSettings

ROUTER = replace(read_machine("router"), servo_period=1e-3)  # 80 and 110 µm of backlash
CORNER = ("G0 X0 Y0", "G1 X20 F1200", "Y10", "M2")


def program(*lines: str) -> PartProgram:
    return read_program("\n".join(["G21 G90", *lines, ""]).encode(), "test")


def warnings(*lines: str, machine: Machine = ROUTER) -> list[str]:
    return path_mode_warnings(program(*lines), machine, find_dialect(machine.dialect))


@pytest.mark.parametrize("mode", ["(none)", "G64", "G64 P0.1 Q0", "G64 P0.02 Q0"])
@pytest.mark.parametrize("end", [(20, 20), (30, 10), (19, 0.3), (17, 5)])
@pytest.mark.parametrize("feed", [600, 3000])
def test_the_number_is_what_the_motion_leaves_the_corner_by(mode, end, feed) -> None:
    part = program(mode, "G0 X0 Y0", f"G1 X20 F{feed}", f"X{end[0]} Y{end[1]}", "M2")
    found = run_program(part, ROUTER)
    apart = np.linalg.norm(found.position[:, :2] - [0.02, 0.0], axis=1).min()
    assert corner_rounding(part, ROUTER, tolerances(part))[0][1] == pytest.approx(apart, abs=1.5e-6, rel=0.01)


def test_the_line_and_the_remedy_are_named() -> None:
    assert warnings("G64", *CORNER) == [
        "line 2: G64 without P rounds corners by up to 180 µm (line 4), more than the backlash of 80 µm:"
        " G64 P0.01 Q0 keeps them within 10 µm"
    ]
    assert warnings("G64 P0.1", *CORNER) == [
        "line 2: G64 P0.1 rounds corners by up to 100 µm (line 4), more than the backlash of 80 µm:"
        " G64 P0.01 Q0 keeps them within 10 µm"
    ]
    assert warnings(*CORNER)[0].startswith("no line sets a path mode: the controller rounds corners by up to 180 µm")


def test_each_mode_is_named_where_it_is_set() -> None:
    found = warnings("G64 P0.01", *CORNER[:-1], "G64 P0.5", "X0", "Y0", "G64 P0.2", "X5", "Y5", "M2")
    assert [line.split(":")[0] for line in found] == ["line 6", "line 9"]


@pytest.mark.parametrize("mode", ["G64 P0.01", "G61", "G61.1", "G64 P0.08"])
def test_modes_within_the_backlash_are_no_trouble(mode) -> None:
    assert warnings(mode, *CORNER) == []


def test_a_small_backlash_wants_a_small_rounding() -> None:
    axes = {name: replace(axis, gap=axis.gap.with_lost_motion(8e-6)) for name, axis in ROUTER.axes.items()}
    assert warnings("G64 P0.01", *CORNER, machine=replace(ROUTER, axes=axes)) == [
        "line 2: G64 P0.01 rounds corners by up to 10 µm (line 4), more than the backlash of 8 µm:"
        " G64 P0.004 Q0 keeps them within 4 µm"
    ]


def test_a_corner_counts_the_backlash_of_the_axes_that_move_there() -> None:
    """Z has 10 µm; it does not move in the corner of X and Y, whose smaller backlash is 80 µm."""
    assert warnings("G64 P0.05", "G0 X0 Y0 Z5", "G0 Z-1", *CORNER[1:]) == []
    found = warnings("G64 P0.05", "G0 X0 Y0 Z5", "G1 Z-1 F1200", *CORNER[1:])
    assert len(found) == 1
    assert "(line 4), more than the backlash of 10 µm: G64 P0.005 Q0" in found[0]


def test_an_inch_program_gets_a_remedy_in_inches() -> None:
    part = read_program(b"G20 G90\nG64\nG0 X0 Y0\nG1 X1 F47\nY1\nM2\n", "test")
    found = path_mode_warnings(part, ROUTER, find_dialect("linuxcnc"))
    assert found[0].endswith("G64 P0.0004 Q0 keeps them within 10 µm")


@pytest.mark.parametrize("dialect", ["grbl", "grblhal", "marlin", "klipper", "fanuc"])
def test_nothing_is_said_of_controllers_without_such_a_mode(dialect) -> None:
    assert warnings(*CORNER, machine=replace(ROUTER, dialect=dialect)) == []


def test_nothing_is_said_where_nothing_is_rounded_or_lost() -> None:
    assert warnings("G0 X10 Y0", "G3 X10 Y0 I-10 J0 F1200", "G1 Y5", "M2") == [], "tangents"
    assert warnings("G0 X20 F1200", "Y10", "M2") == [], "rapids"
    axes = {name: replace(axis, gap=axis.gap.with_lost_motion(0.0)) for name, axis in ROUTER.axes.items()}
    assert warnings(*CORNER, machine=replace(ROUTER, axes=axes)) == []
    stated = replace(ROUTER, planner=PlannerSettings(path_tolerance=1e-5))
    assert warnings(*CORNER, machine=stated) == [], "the machine starts with G64 P0.01"


ARC = ("G0 X{0} Y0", "G1 Z-1 F300", "G3 X{0} Y0 I-{0} J0 F1200", "M2")


def chords(dialect: str, radius: float, tolerance: float, **settings: float) -> list[str]:
    machine = replace(read_machine("stepper"), dialect=dialect, planner=PlannerSettings(**settings))
    part = read_program("\n".join([line.format(radius) for line in ARC]).encode(), "test")
    return chord_warnings(part, machine, find_dialect(dialect), tolerance)


@pytest.mark.parametrize("radius", [0.5, 2.0, 20.0, 300.0])
@pytest.mark.parametrize("dialect", ["grbl", "grblhal", "marlin", "klipper"])
def test_what_chords_leave_is_said_once_with_a_setting_that_mends_it(dialect: str, radius: float) -> None:
    keys = {"grbl": "arc_tolerance", "grblhal": "arc_tolerance", "klipper": "arc_resolution", "marlin": "arc_segment"}
    for tolerance in (1e-6, 5e-6):
        said = chords(dialect, radius, tolerance)
        off = largest_sagitta(dialect, radius)
        assert len(said) == (off > 1.01 * tolerance)
        if said:
            assert float(re.search(r"up to ([\d.]+) µm inside them \(line 3\)", said[0])[1]) == pytest.approx(
                1e6 * off, rel=0.06
            )
            size = 1e-3 * float(re.search(r" = ([-.\de]+) keeps", said[0])[1])
            assert chords(dialect, radius, tolerance, **{keys[dialect]: size}) == []


def largest_sagitta(dialect: str, radius: float) -> float:
    """Measured on the blocks that the model gives the machine: the midpoint nearest to the centre [m]."""
    machine = replace(read_machine("stepper"), dialect=dialect)
    part = read_program("\n".join([line.format(radius) for line in ARC]).encode(), "test")
    limits = limit_table(machine)
    blocks = straight_blocks(part, written_legs(part, limits), limits, planner_of(machine))
    middle = 0.5 * (blocks.start + blocks.end)[blocks.motion == 2, :2]
    return float(1e-3 * radius - np.linalg.norm(middle, axis=1).min())


def test_linuxcnc_draws_arcs() -> None:
    assert chords("linuxcnc", 20.0, 1e-9) == []


def test_a_path_mode_that_grbl_has_not_is_named() -> None:
    said = warnings("G64 P0.01", "G0 X0 Y0", "G1 X10 F600", "G64", "M2", machine=read_machine("stepper"))
    assert len(said) == 1
    assert said[0].startswith("line 2: G64 is no word of grbl")


def test_lines_beside_a_spline_are_run_too() -> None:
    part = program("G64 P0.01", "G0 X0 Y0", "G1 X1 F600", "X2", "G5 X12 Y10 I5 J0 P0 Q-5", "G1 X2", "M2")
    found = run_program(part, ROUTER)
    assert found.position[-1, :2] == pytest.approx([0.002, 0.01], abs=1e-9)
    assert found.position[:, 0].max() == pytest.approx(0.012, abs=1e-5)


@pytest.mark.parametrize(("dialect", "word"), [("fanuc", "G64"), ("siemens", "G64"), ("heidenhain", "")])
def test_machine_tools_keep_to_their_builders_tolerance(dialect, word) -> None:
    machine = replace(ROUTER, dialect=dialect)
    part = program(word or "G90", *CORNER)
    assert tolerances(part, planner_of(machine)).max() == pytest.approx(1e-5)
    assert tolerances(part, planner_of(replace(machine, planner=PlannerSettings(path_tolerance=3e-5)))).max() == 3e-5
    assert tolerances(program("G64", *CORNER), planner_of(replace(machine, dialect="linuxcnc"))).max() == 0.0
