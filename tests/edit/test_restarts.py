"""Compensated programs that are started from a line in between, on a table that a reference of the tests' own plays.

The controller has read the lines before for their modes, as its start from a line does. The table may stand on either
side of the backlash of each axis.
"""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from msgspec.structs import replace
from support.reference_player import BEGINS, distance, interpret, play, run

import ph_post as ph
from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import read_program

UM = 1e-3
GAPS = (0.06, 0.08, 0.03)
"""Backlash [mm] of the shipped stepper router."""

SIDES = tuple(itertools.product((-1.0, 1.0), repeat=2))


def pockets(count: int = 8, change: int = 6) -> str:
    """Slots with round ends, each with a small circle cut into it; the tool is changed before one of them."""
    lines = ["G21 G90 G17 G94 G64 P0.005 Q0", "T1 M6", "M3 S8000", "G0 Z30"]
    for k in range(count):
        x, y = 40.0 * (k % 4), 30.0 * (k // 4)
        lines += ["G0 Z30", "M5", "T2 M6", "M3 S9000"] if k == change else []
        lines += [f"G0 X{x} Y{y}", "G0 Z1", "G1 Z-2 F200", f"G1 X{x + 20} F800", f"G3 X{x + 20} Y{y + 12} I0 J6"]
        lines += [f"G1 X{x}", f"G1 Y{y}", f"G3 X{x} Y{y} I5 J5 F600", "G0 Z5"]
    return "\n".join([*lines, "G0 Z30", "M2", ""])


def target(dialect: str):
    return replace(read_machine("stepper"), dialect=dialect, servo_period=1e-3)


@pytest.fixture(scope="module", params=["linuxcnc", "grbl"])
def pair(request: pytest.FixtureRequest) -> tuple[str, str]:
    own = pockets()
    if request.param == "grbl":
        own = own.replace(" G64 P0.005 Q0", "")
    found = ph.compensate(read_program(own.encode(), "part.ngc"), target(request.param))
    assert not [word for word in found.warnings if "not compensated" in word]
    return own, found.program().decode()


def bare(line: str) -> str:
    return re.sub(r"\([^)]*\)", "", line)


def started(text: str, line: int, begin: tuple[float, ...]):
    """Moves from a line on (from 0), of a machine that stands at `begin` [mm]."""
    lines = text.split("\n")
    before = "\n".join(map(bare, lines[:line]))
    modes, feeds = re.findall(r"G([0-3])(?![\d.])", before), re.findall(r"F([\d.]+)", before)
    head = f"G21 G90 G17 G94 {f'G{modes[-1]}' if modes else ''} {f'F{feeds[-1]}' if feeds else ''}"
    return interpret("\n".join([head, *lines[line:]]), begin)


def tables(moves, z: float = -1.0) -> tuple[np.ndarray, np.ndarray]:
    """Tables (4, n, 3) from all sides of X and Y, from side `z` of Z, and which samples are in the material (n,)."""
    found = run(moves, 0.05)
    height = play(found.motor[:, 2], GAPS[2], z) - 0.5 * GAPS[2]
    columns = [[play(found.motor[:, axis], GAPS[axis], side) for side in (-1.0, 1.0)] for axis in range(2)]
    each = [np.column_stack([columns[0][x > 0], columns[1][y > 0], height]) for x, y in SIDES]
    return np.array(each), found.motor[:, 2] < -UM


def errors(moves, path) -> float:
    """Largest distance from the path in X and Y while the tool is in the material [mm], from all sides."""
    each, deep = tables(moves)
    flat = each[:, deep] * (1.0, 1.0, 0.0)
    return max((float(distance(one, path).max()) for one in flat if len(one)), default=0.0)


def flat_path(text: str):
    """The cuts of a program at the height of its zero."""
    moves = [one for one in interpret(text) if one.mode > 0 and one.start[2] < 0.0 and one.end[2] < 0.0]
    level = np.array((1.0, 1.0, 0.0))
    return [type(one)(**{**vars(one), "start": one.start * level, "end": one.end * level}) for one in moves]


def marks(text: str) -> list[int]:
    """Numbers, from 0, of the lines behind a mark for a restart."""
    return [n + 1 for n, line in enumerate(text.split("\n")) if re.match(r"\(ph-post: \+.*restart here", line)]


def test_there_is_a_mark_for_each_tool_and_each_minute(pair: tuple[str, str]) -> None:
    own, text = pair
    lines = text.split("\n")
    found = marks(text)
    changes = [n for n, line in enumerate(lines) if "M6" in line]
    assert len(changes) == 2
    for change in changes:
        behind = next(n for n in found if n > change)
        assert not any(re.search(r"G[123]", bare(line)) for line in lines[change:behind]), "nothing cuts before it"
    assert len(found) == 3, "and one for the second minute of the first tool"
    # A rapid that ends beyond its place, on lines that name X and Y.
    assert all(re.match(r"G0\s?X\S+\s?Y", lines[n]) for n in found)
    assert "restart" not in own


@pytest.mark.parametrize("begin", [*BEGINS, (0.0, 0.0, 30.0), (21.3, 5.2, 5.0)])
@pytest.mark.thinned(8)
def test_from_a_mark_the_part_is_as_good_as_from_the_beginning(pair: tuple[str, str], begin) -> None:
    own, text = pair
    path = flat_path(own)
    whole, plain = errors(interpret(text), path), errors(interpret(own), path)
    assert whole < 2.5 * UM
    assert plain > 39.9 * UM
    for line in marks(text):
        assert errors(started(text, line, begin), path) <= whole + 0.1 * UM


@pytest.mark.slow
@pytest.mark.thinned(4)
def test_from_any_other_line_only_the_first_way_through_the_backlash_differs(pair: tuple[str, str]) -> None:
    own, text = pair
    path = flat_path(own)
    moves = interpret(text)
    # From a line in between the plain program is off by half of the backlash of both axes.
    whole, plain = errors(moves, path), 0.5 * float(np.hypot(*GAPS[:2]))
    lines, worst, at_rest = text.split("\n"), 0.0, 0.0
    # What is cut on the next lines.
    for line in range(len(lines)):
        if not re.match(r"[GXYZ]", lines[line]) or not 0 < line < 60:
            continue
        before = [one for one in moves if one.line <= line]
        begin = tuple(before[-1].end.tolist()) if before else (0.0, 0.0, 30.0)
        found = [one for one in started(text, line, begin) if one.line < 80]
        if not found:
            continue
        each, deep = tables(found)
        if not deep.any():
            continue
        off = np.array([distance(one[deep] * (1.0, 1.0, 0.0), path) for one in each])
        worst = max(worst, float(off.max()))
        known = np.ptp(each[:, deep], axis=0).max(axis=1) < 1e-9
        assert known.any(), "both axes come through their backlash"
        at_rest = max(at_rest, float(off[:, known].max()))
    assert at_rest <= whole + 0.1 * UM
    # No farther than the backlash of both axes together, twice what the plain program is off by.
    assert plain < worst <= 2.0 * plain + whole


@pytest.mark.slow
@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.thinned(8)
def test_from_no_line_the_tool_is_lower_than_in_the_plain_program(pair: tuple[str, str], side: float) -> None:
    own, text = pair
    moves, lines = interpret(text), text.split("\n")
    low = min(one.end[2] for one in interpret(own))
    for line in range(len(lines)):
        if not re.match(r"[GXYZ]", lines[line]):
            continue
        before = [one for one in moves if one.line <= line]
        begin = tuple(before[-1].end.tolist()) if before else (0.0, 0.0, 30.0)
        found = run(started(text, line, begin), 2.0)
        height = play(found.motor[:, 2], GAPS[2], side) - 0.5 * GAPS[2]
        # The table that stands on its other side is above by the backlash, and comes down with the first move down.
        assert height.min() >= low - 1e-9 - GAPS[2] * (side < 0.0 and begin[2] <= low)
        words = [float(z) for z in re.findall(r"Z(-?[\d.]+)", bare(lines[line]))]
        assert all(z >= low for z in words)


def _cuts(moves):
    """Moves, of which the rapid at the end goes to where it does high above the work."""
    return [*moves[:-1], type(moves[-1])(**{**vars(moves[-1]), "mode": 0, "end": moves[-1].start})]


def test_nothing_comes_to_its_side_behind_the_last_cut() -> None:
    """A last rapid to the zero of all axes looked like a place to start again from, and the check refused it."""
    square = "G0 X{0} Y80\nG0 Z-1\nG1 X{1} F150\nG1 Y130\nG1 X{0}\nG1 Y80\nG0 Z20\n"
    # So far apart in time that a program may be started again between them.
    cuts = "".join(square.format(x, x + 5) for x in range(20, 140, 20))
    text = f"G21 G90\nG0 X0 Y0 Z20\n{cuts}G0 X0 Y0 Z-1\nM2\n"
    found = ph.compensate(read_program(text.encode(), "part.nc"), target("grbl"))
    assert not [word for word in found.warnings if "not compensated" in word]
    begin = (-5.0, -5.0, 30.0)
    before, after = (errors(_cuts(interpret(one, begin)), flat_path(text)) for one in (text, found.program().decode()))
    assert after < 0.2 * before


FACE = "G1 Z-1 F300\nX0 F800\nG0 Z2\nX40\nG1 Z-2 F300\nX0 F800\nG0 Z30\nM2\n"


@pytest.mark.parametrize("place", ["G0 X40 Y7\nG43 Z5 H1\n", "G0 X40 Y7\nG43 H1\nG0 Z5\n"])
def test_an_axis_that_another_chain_has_brought_to_its_place_comes_to_a_side_of_its_backlash(place: str) -> None:
    """G43 ends a chain; Y rests in the one behind it, and the part shows where its table stands."""
    lines = f"G21 G90 G17 G94 G64 P0.005 Q0\nT1 M6\nM3 S8000\n{place}{FACE}"
    found = ph.compensate(read_program(lines.encode(), "part.ngc"), target("linuxcnc"))
    text = found.program().decode()
    assert "Y approach" in text
    assert marks(text) == []
    path = flat_path(lines)
    assert errors(interpret(lines), path) > 0.5 * GAPS[1] - UM
    assert errors(interpret(text), path) < 2.0 * UM


@pytest.mark.parametrize("place", ["G0 X40\nG43 Z5 H1\n", "G0 X40 Y7 Z5\nG43 H1\nG0 Z-1\n"])
def test_one_whose_place_is_not_known_or_that_would_move_below_the_surface_is_left_alone(place: str) -> None:
    face = FACE if "Y" not in place else FACE.partition("\n")[2]
    lines = f"G21 G90 G17 G94 G64 P0.005 Q0\nT1 M6\n{place}F800\nG1 {face}"
    text = ph.compensate(read_program(lines.encode(), "part.ngc"), target("linuxcnc")).program().decode()
    assert "X" in text
    assert len(re.findall("Y", re.sub(r"\([^)]*\)", "", text))) == place.count("Y")


@pytest.mark.parametrize("down", ["G1 G43 Z5 H1\n", "G1 G43 Z5 H1\nG1 Z2\n"])
def test_axes_that_rest_on_a_line_with_g43_come_to_their_sides_behind_it(down: str) -> None:
    """What was written before that line was in the chain before, which the check refused."""
    cuts = "G1 Z-1 F300\nG1 X0 Y9 F800\nX40\nY7\nX0\n"
    lines = f"G21 G90 G17 G94 G64 P0.005 Q0\nT1 M6\nM3 S8000\nG1 X40 Y7 F800\n{down}{cuts}G0 Z30\nM2\n"
    found = ph.compensate(read_program(lines.encode(), "part.ngc"), target("linuxcnc"))
    text = found.program().decode()
    assert not [word for word in found.warnings if "not compensated" in word]
    assert text.index("G43") < text.index("(ph-post: +")
    path = flat_path(lines)
    assert errors(interpret(lines), path) > 0.5 * GAPS[1] - UM
    assert errors(interpret(text), path) < 2.0 * UM


@pytest.mark.parametrize("little", [0.002, -0.002, 0.0])
def test_an_axis_that_begins_with_a_way_below_the_dead_band_comes_to_its_side_before_it(little: float) -> None:
    """Rows of holes that are 2 µm beside each other: the first row was drilled with Y on whichever side."""
    rows = "".join(f"G0 X{x} Y{y}\nG0 Z1\nG1 Z-1 F300\nX{x - 5} F800\nG0 Z5\n" for x, y in ((40, 7), (30, 7 + little)))
    lines = f"G21 G90 G17 G94 G64 P0.005 Q0\nT1 M6\nM3 S8000\nG0 Z5\n{rows}G0 X40 Y20\nG1 Z-1\nX0 Y15\nG0 Z30\nM2\n"
    text = ph.compensate(read_program(lines.encode(), "part.ngc"), target("linuxcnc")).program().decode()
    path = flat_path(lines)
    assert errors(interpret(lines), path) > 0.5 * GAPS[1] - UM
    assert errors(interpret(text), path) < 2.0 * UM + abs(little)
