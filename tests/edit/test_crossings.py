"""Crossings on the fly, executed by a reference that shares nothing with the package.

It reads a few G words itself, moves ideal motors, and drags a table with backlash behind them, from all combinations of
initial sides; distances from the original are its own closed forms.
"""

from __future__ import annotations

import itertools
import math
import random
import re
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from support.editing import Compensated, compensate
from support.reference_player import BEGINS, Move, distance, interpret, run, tables

import ph_post as ph
from ph_post.drive.machinefile import read_machine
from ph_post.edit.undo import undo
from ph_post.errors import InputError
from ph_post.gcode.read import read_program, reread
from ph_post.types import Machine
from ph_post.units import MM
from ph_post.verify.verify import verify
from tests.support.cascade_plant import play as drag
from tests.support.closed_loops import DEPTH, distances, outline, program_text
from tests.support.played import play_program

PUSH = 500.0
"""Acceleration of the machines [mm/s²]."""

DIALECTS = ("linuxcnc", "grbl", "grblhal", "marlin", "klipper")
PRINTERS = ("marlin", "klipper")
STEP = 1e-4
"""Last decimal [mm]."""

XY = (0.05, 0.05, 0.0)


def machine(dialect: str, lost: tuple[float, ...] = XY, push: float = PUSH) -> Machine:
    """Machine with stepper motors that lose `lost` mm in X, Y and Z."""
    one = read_machine("stepper")
    axes = {}
    for name, size in zip("XYZ", lost, strict=True):
        axis = one.axes[name]
        limits = replace(axis.limits, acceleration=1e-3 * push, velocity=0.1)
        axes[name] = replace(axis, gap=axis.gap.with_lost_motion(1e-3 * size), limits=limits)
    return replace(one, axes=axes, dialect=dialect, servo_period=1e-3)


def points(curve: list[tuple[float, float]]) -> str:
    return "".join(f"G1 X{x:.4f} Y{y:.4f}\n" for x, y in curve)


def circle_points(radius: float, count: int) -> str:
    turns = [2 * math.pi * n / count for n in range(1, count + 1)]
    return points([(radius * math.cos(t), radius * math.sin(t)) for t in turns])


BEGIN = "G21\nG90\n"
END = "G0 Z5\nG0 X0 Y0\n"
FULL = "G17 G91.1 G94\n"

CUTS = {
    "circle": "G0 X20 Y0 Z5\nG1 Z-1 F300\nG3 X20 Y0 I-20 J0 F1200\nG3 X20 Y0 I-20 J0\n",
    "small circle": "G0 X2 Y0 Z5\nG1 Z-1 F300\nG2 X2 Y0 I-2 J0 F1200\nG2 X2 Y0 I-2 J0\n",
    "circle from between": "G0 X16 Y12 Z5\nG1 Z-1 F300\nG2 X16 Y12 I-16 J-12 F900\n",
    "pocket": (
        "G0 X0 Y-10 Z5\nG1 Z-1 F300\nG1 X8 F1200\nG3 X10 Y-8 I0 J2\nG1 Y8\nG3 X8 Y10 I-2 J0\nG1 X-10\nG1 Y-8\n"
        "G3 X-8 Y-10 I2 J0\nG1 X0\n"
    ),
    "engraving": "G0 X1 Y0 Z5\nG1 Z-0.2 F200\nG1 X1.5 F400\n"
    + "".join(
        f"G2 X{2 * n + 3.5} Y0 I1 J0\nG3 X{2 * n + 2.5} Y1 I0 J1\nG2 X{2 * n + 3.5} Y0 I0 J-1\n" for n in range(4)
    ),
}
"""Cuts that every controller with arcs is given."""

SAMPLED = {
    "ellipse of 1000": "G0 X30 Y0 Z5\nG1 Z-1 F300\nG1 X30 Y0 F1200\n"
    + points([(30 * math.cos(2 * math.pi * n / 1000), 15 * math.sin(2 * math.pi * n / 1000)) for n in range(1, 1001)]),
    "circle of 400": "G0 X20 Y0 Z5\nG1 Z-1 F300\nG1 X20 Y0 F1200\n" + circle_points(20.0, 400),
    "zigzag": "G0 X0 Y0 Z5\nG1 Z-1 F300\nG1 X20 F1500\nG1 Y3\nG1 X0\nG1 Y6\nG1 X20 Y9\nG1 X0 Y12\n",
}
"""Cuts without arcs, for Klipper too."""

RS274 = {
    "helix": "G0 X10 Y0 Z5\nG1 Z0 F300\nG2 X10 Y0 Z-1 I-10 J0 F1000\nG2 X10 Y0 Z-2 I-10 J0\nG2 X10 Y0 I-10 J0\n",
    "R": "G0 X-10 Y0 Z5\nG1 Z-1 F300\nG2 X10 Y0 R10 F1000\nG2 X0 Y-10 R-10\nG1 X-5 Y-5\n",
    "steps": "G0 X20 Y0 Z5\nG1 Z-1 F300\nG91\nG3 X0 Y0 I-20 J0 F1200\nG1 X-5\nG2 X-5 Y5 I0 J5\nG90\n",
    "absolute centres": "G0 X20 Y3 Z5\nG1 Z-1 F300\nG90.1\nG3 X20 Y3 I0 J3 F1200\nG3 X-20 Y3 I0 J3\nG91.1\n",
    "inverse time": "G0 X20 Y0 Z5\nG1 Z-1 F300\nG93\nG3 X20 Y0 I-20 J0 F9.5493\nG1 X10 F120\nG94\n",
}
"""Cuts of what RS274/NGC alone has."""

HELD = {"grbl": {"absolute centres"}, "grblhal": {"absolute centres"}}


def whole(name: str, dialect: str) -> str:
    """A program for a controller."""
    cut = {**CUTS, **SAMPLED, **RS274}[name]
    return BEGIN + ("" if dialect in PRINTERS else FULL) + cut + END


def programs() -> list[tuple[str, str]]:
    found = [(name, dialect) for name in CUTS for dialect in DIALECTS if dialect != "klipper"]
    found += [(name, dialect) for name in SAMPLED for dialect in DIALECTS]
    return found + [(name, one) for name in RS274 for one in DIALECTS[:3] if name not in HELD.get(one, ())]


def within(text: str) -> float:
    """Largest error that the head declares [mm]; 0 without crossings."""
    found = re.search(r"within ([\d.]+) mm", text)
    return float(found[1]) if found else 0.0


def lines(text: str) -> list[str]:
    return [one for one in text.splitlines() if "ph-post" not in one and not one.startswith(("(  ", ";   "))]


def errors(
    original: str, changed: str, lost: tuple[float, ...], zero: tuple[int, ...] = (0, 0, -1), surface: float = 0.0
) -> list[np.ndarray]:
    """Distances from the original while cutting below a surface [mm].

    Of a table from each combination of sides, wherever the machine stood before.
    """
    path = [move for move in interpret(original) if move.mode > 0]
    seen: list[np.ndarray] = []
    for begin in BEGINS:
        moves = interpret(changed, begin)
        done = run(moves)
        cut = np.array([move.mode > 0 for move in moves])[done.owner]
        # Of the way down only what is in the work.
        cut &= done.motor[:, 2] <= surface + 1e-6
        seen += [table[cut] for table in tables(done.motor, lost, zero)]
    found = [distance(seen[0], path)]
    for table in seen[1:]:
        # Tables that began on other sides are soon where the first one is.
        new, off = (table != seen[0]).any(axis=1), found[0].copy()
        off[new] = distance(table[new], path)
        found.append(off)
    return found


def largest(found: list[np.ndarray]) -> float:
    return max(float(one.max()) for one in found)


def rms(found: list[np.ndarray]) -> float:
    return max(float(np.sqrt((one * one).mean())) for one in found)


@pytest.fixture(scope="module")
def made() -> dict[tuple[str, str], tuple[str, Compensated]]:
    """All programs, compensated."""
    return {
        (name, one): (text := whole(name, one), compensate(text.encode(), machine(one), dialect=one))
        for name, one in programs()
    }


Made = dict[tuple[str, str], tuple[str, Compensated]]


@pytest.mark.parametrize("case", programs(), ids="/".join)
@pytest.mark.thinned(16)
def test_the_table_keeps_to_the_original_within_what_the_head_declares(made: Made, case: tuple[str, str]) -> None:
    text, found = made[case]
    changed = found.text.decode()
    after, before = errors(text, changed, XY), errors(text, text, XY)
    # Ends and centres are rounded to the last decimal, two coordinates each.
    rounding = 3.0 * STEP
    assert largest(before) > 0.03
    assert largest(after) <= within(changed) + rounding
    assert rms(after) < rms(before) / 20.0


@pytest.mark.parametrize("case", programs(), ids="/".join)
def test_nothing_stands_and_every_byte_comes_back(made: Made, case: tuple[str, str]) -> None:
    text, found = made[case]
    assert not [one for one in lines(found.text.decode()) if re.search(r"G0?4\b", one)]
    assert undo(found.text, "part.ngc") == text.encode()
    with pytest.raises(InputError, match="marks of an earlier compensation"):
        compensate(found.text, machine(case[1]), dialect=case[1])


def hunks(text: str, changed: str) -> tuple[list[tuple[int, int]], list[tuple[int, int, str]]]:
    """Numbers of lines that stay, of the original and of the result; and of new ones first, last, and the label."""
    kept, fresh, at, n = [], [], 0, 0
    new = changed.splitlines()
    commands = set(re.findall(r"ph-post: command ([^)\n]+)", changed))
    while n < len(new):
        mark = re.match(r"(?:\(|; )ph-post: \+(\d+) -(\d+) ([^)]*)", new[n])
        if mark:
            fresh.append((n + 2, n + 1 + int(mark[1]), mark[3]))
            n, at = n + 1 + int(mark[1]), at + int(mark[2])
        elif "ph-post" in new[n] or new[n].startswith(("(  ", ";   ")) or new[n] in commands:
            n += 1
        else:
            kept.append((at + 1, n + 1))
            n, at = n + 1, at + 1
    assert at == len(text.splitlines())
    return kept, fresh


@pytest.mark.parametrize("case", programs(), ids="/".join)
def test_lines_that_stay_find_feed_and_mode_as_they_were(made: Made, case: tuple[str, str]) -> None:
    text, found = made[case]
    changed = found.text.decode()
    before = {move.line: move for move in interpret(text)}
    after = {move.line: move for move in interpret(changed)}
    kept, _ = hunks(text, changed)
    compared = 0
    for old, new in kept:
        if old in before:
            assert after[new].mode == before[old].mode
            if before[old].mode > 0:
                assert after[new].feed == pytest.approx(before[old].feed, rel=1e-3)
            compared += 1
        else:
            assert new not in after
    assert compared >= 3


def crossing_moves(text: str, changed: str) -> list[Move]:
    """New straight and round moves of crossings' hunks."""
    numbers = [
        number
        for first, last, label in hunks(text, changed)[1]
        if "crossing" in label
        for number in range(first, last + 1)
    ]
    return [move for move in interpret(changed) if move.line in set(numbers)]


@pytest.mark.parametrize("case", programs(), ids="/".join)
def test_no_block_is_shorter_than_a_machine_can_tell(made: Made, case: tuple[str, str]) -> None:
    text, found = made[case]
    shortest = min(move.length for move in interpret(text) if move.mode > 0)
    for move in crossing_moves(text, found.text.decode()):
        assert move.length >= min(0.02, shortest) - 1e-3, move


@pytest.mark.parametrize("case", programs(), ids="/".join)
@pytest.mark.thinned(12)
def test_the_table_is_never_faster_than_the_program_says(made: Made, case: tuple[str, str]) -> None:
    text, found = made[case]
    changed = found.text.decode()
    moves, most = interpret(changed), max(move.feed for move in interpret(text) if move.mode > 0)
    new = {move.line for move in crossing_moves(text, changed)}
    done = run(moves)
    for table in tables(done.motor, XY, (0, 0, -1)):
        for k, move in enumerate(moves):
            if move.line in new and move.mode > 0 and move.length > 0.02:
                own = table[done.owner == k]
                way = np.linalg.norm(np.diff(own, axis=0), axis=1).sum()
                assert move.feed * way / move.length <= most * 1.003


def grbl_junction(into: np.ndarray, out: np.ndarray, deviation: float = 0.01) -> float:
    """Speed [mm/min] that Grbl 1.1 allows at a joint (its planner.c)."""
    cosine = -float(into @ out)
    if cosine > 0.999999:
        return 0.0
    if cosine < -0.999999:
        return math.inf
    across = (out - into) / np.linalg.norm(out - into)
    push = min(PUSH / abs(one) for one in across if abs(one) > 1e-12)
    half = math.sqrt(0.5 * (1.0 - cosine))
    return 60.0 * math.sqrt(push * deviation * half / (1.0 - half))


@pytest.mark.parametrize("name", ["circle", "small circle", "circle from between"])
def test_grbl_passes_the_joints_of_a_crossing_at_its_feed(made: Made, name: str) -> None:
    text, found = made[name, "grbl"]
    moves = [move for move in interpret(found.text.decode()) if move.mode > 0 and move.length > 0.0]
    new = {move.line for move in crossing_moves(text, found.text.decode())}
    joints = 0
    for one, two in itertools.pairwise(moves):
        if one.line in new and two.line in new:
            allowed = grbl_junction(one.tangent(last=True), two.tangent(last=False))
            assert allowed >= (0.9 if name == "small circle" else 0.95) * min(one.feed, two.feed), (one, two)
            joints += 1
    assert joints > 3


@pytest.mark.parametrize("name", ["circle", "circle from between"])
def test_linuxcnc_takes_the_motor_s_speed_in_three_steps_up_and_three_down(made: Made, name: str) -> None:
    # Of 0.05 mm at three quarters of the axis' acceleration a the largest speed is √(¾ g a).
    text, found = made[name, "linuxcnc"]
    moves = [move for move in interpret(found.text.decode()) if move.mode > 0 and move.length > 0.0]
    new = {move.line for move in crossing_moves(text, found.text.decode())}
    step = math.sqrt(0.75 * 0.05 * PUSH) / 3.0
    steps = []
    for one, two in itertools.pairwise(moves):
        if one.line in new and two.line in new:
            change = two.feed * two.tangent(last=False) - one.feed * one.tangent(last=True)
            steps.append(np.abs(change[:2]).max() / 60.0)
    # One block may end on a joint of the program beside it.
    assert sorted(steps)[-3] <= 1.2 * step
    assert max(steps) <= 3.0 * step
    assert max(steps) >= 0.7 * step


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("lost", [(0.02, 0.05, 0.0), (0.1, 0.1, 0.0), (0.03, 0.08, 0.06)])
@pytest.mark.thinned(12)
def test_other_sizes_of_backlash_and_z_from_one_side(dialect: str, lost: tuple[float, ...]) -> None:
    # Z goes up and down on the way; its zero was taken downwards.
    cut = "G0 X20 Y0 Z5\nG1 Z-1 F300\nG1 X20 Y10 Z-2 F900\nG1 X0 Y20 Z-1\nG1 X-20 Y0 Z-3\nG1 X0 Y-20 Z-2\n"
    text = BEGIN + cut + circle_points(20.0, 360).replace("\n", " Z-2\n") + END
    changed = compensate(text.encode(), machine(dialect, lost), dialect=dialect).text.decode()
    after, before = errors(text, changed, lost), errors(text, text, lost)
    assert largest(after) <= within(changed) + 3.0 * STEP
    assert rms(after) < rms(before) / 10.0


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.thinned(6)
def test_every_hole_is_exact_from_the_first(dialect: str) -> None:
    holes = [(x, y) for x in (5, 15, 10, 20) for y in (4, 12, 8)]
    drilled = "".join(f"G0 X{x} Y{y}\nG1 Z-2 F200\nG0 Z5\n" for x, y in holes)
    text = BEGIN + "G0 X1 Y1 Z5\n" + drilled + END
    lost = (0.06, 0.08, 0.04)
    changed = compensate(text.encode(), machine(dialect, lost), dialect=dialect).text.decode()
    begun = [run(interpret(changed, begin)).motor for begin in BEGINS]
    for table in (table for motor in begun for table in tables(motor, lost, (0, 0, -1))):
        bottom = table[np.isclose(table[:, 2], -2.0, rtol=0.0, atol=1e-6)]
        assert len(bottom) >= len(holes)
        nearest = [np.linalg.norm(np.subtract(hole, bottom[:, :2]), axis=1).min() for hole in holes]
        away = [np.linalg.norm(one[:2] - np.array(holes), axis=1).min() for one in bottom]
        assert max(*nearest, *away) < 1e-6
        # The tool is in the work at no other place.
        below = table[table[:, 2] < -1e-6]
        assert max(np.linalg.norm(np.array(holes) - one[:2], axis=1).min() for one in below) < 1e-6


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl", "grblhal"])
@pytest.mark.parametrize("plane", [18, 19])
@pytest.mark.thinned(2)
def test_other_planes(dialect: str, plane: int) -> None:
    cut = {
        18: "G0 X20 Y3 Z-30\nG1 X20 Z-30 F300\nG2 X20 Z-30 I-20 K0 F1000\nG3 X-20 Z-30 I-20 K0\n",
        19: "G0 X3 Y20 Z-30\nG1 Y20 Z-30 F300\nG3 Y20 Z-30 J-20 K0 F1000\nG2 X5 Y-20 Z-30 J-20 K0\n",
    }[plane]
    text = f"G21\nG90\nG17\nG0 X0 Y0 Z0\nG{plane} G91.1 G94\n{cut}G0 Z5\nG0 X0 Y0\nG17\n"
    lost = (0.05, 0.06, 0.04)
    changed = compensate(text.encode(), machine(dialect, lost), dialect=dialect).text.decode()
    after, before = (errors(text, one, lost, surface=-5.0) for one in (changed, text))
    assert "crossing Z" in changed
    assert largest(after) <= within(changed) + 3.0 * STEP
    assert rms(after) < rms(before) / 10.0


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl", "grblhal"])
def test_inches(dialect: str) -> None:
    cut = "G0 X0.75 Y0 Z0.2\nG1 Z-0.04 F12\nG3 X0.75 Y0 I-0.75 J0 F48\nG1 X0.5\n"
    text = "G20\nG90\nG17 G91.1 G94\n" + cut + "G0 Z0.2\nG0 X0 Y0\n"
    changed = compensate(text.encode(), machine(dialect), dialect=dialect).text.decode()
    after, before = errors(text, changed, XY), errors(text, text, XY)
    # Five decimals of an inch are 0.25 µm.
    assert largest(after) <= within(changed) + 3.0 * 25.4e-5
    assert rms(after) < rms(before) / 20.0


def test_a_tool_change_begins_anew() -> None:
    cut = CUTS["circle"]
    text = BEGIN + FULL + "T1 M6\n" + cut + "G0 Z5\nT2 M6\nS5000 M3\n" + cut + END + "M2\n"
    changed = compensate(text.encode(), machine("linuxcnc"), dialect="linuxcnc").text.decode()
    assert largest(errors(text, changed, XY)) <= within(changed) + 3.0 * STEP
    # At each change of the tool the axes stand where the original has them.
    places = []
    for one in (text, changed):
        change = one.splitlines().index("T2 M6") + 1
        places.append([move.end for move in interpret(one) if move.line < change][-1])
    assert places[0] == pytest.approx(places[1], abs=1e-9)


def test_a_second_run_changes_nothing(tmp_path: Path) -> None:
    from ph_post.cli.main import main

    part, once, twice = (tmp_path / name for name in ("part.ngc", "once.ngc", "twice.ngc"))
    part.write_text(whole("circle", "grbl"))
    assert main(["convert", str(part), "-m", "stepper", "-o", str(once)]) == 0
    assert "crossing X" in once.read_text()
    assert main(["convert", str(once), "-m", "stepper", "-o", str(twice)]) == 0
    assert twice.read_bytes() == once.read_bytes()


def test_an_axis_that_no_rapid_names_is_wound_up_before_the_cut() -> None:
    # Behind G92 no rapid goes along X, whose side is that of the way from an unknown place.
    text = "G21 G90 G17 F600\nG0 X0 Y0 Z5\nG92 X0 Y0\nG0 Y5\nG1 Z-1\nG1 X5 Y10\nG0 Z5\nM2\n"
    changed = compensate(text.encode(), machine("linuxcnc"), dialect="linuxcnc").text.decode()
    assert largest(errors(text, changed, XY)) < 3e-6


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl"])
def test_an_axis_that_rests_in_the_first_cut_comes_to_its_place_from_either_side(dialect: str) -> None:
    """No rapid leads there: the motor goes to the other side and back, the table no farther than its place."""
    text = "G21 G91\nG1 X20 F600\nX20\nG3 X0 Y20 I0 J10\nG1 X-40\n"
    changed = compensate(text.encode(), machine(dialect), dialect=dialect).text.decode()
    motor, path = run(interpret(changed)).motor, interpret(text)
    begins = int(np.argmax(motor[:, 0] > motor[0, 0] + 0.1))
    for table in tables(motor, XY, (0, 0, 0)):
        assert distance(table[begins:-200], path).max() < 3e-3
        assert np.abs(table[:begins] - motor[0])[:, 1].max() <= 0.5 * XY[1] + 1e-9


@pytest.mark.parametrize("dialect", ["linuxcnc", "marlin"])
def test_an_axis_that_comes_to_its_first_place_shares_its_stop_with_one_that_turns_there(dialect: str) -> None:
    text = "G21\nG90\nG0 X15.463\nG1 X12.656 Y13.367 F600\nG3 X11.779 Y15.136 I-1.06 J0.576\n"
    one = compensate(text.encode(), machine(dialect), dialect=dialect)
    assert re.search(r"(?:X\+, Y\+|Y\+, X\+), crossing X-", one.text.decode())
    assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=machine(dialect)).failures == ()


def test_an_axis_that_increments_alone_lift_at_the_end_is_left_where_it_is() -> None:
    """A drawing that begins in its first bead, with no mode named: where Z is nobody knows, nor could a line say it."""
    text = "G1 X90 Y160 F1200\nG1 X80 Y150 E0.3\nG1 X90 Y160 E0.6\nG1 X80 Y150 E0.9\nG91\nG1 X10 Y10 Z5 E-5\nG90\n"
    found = compensate(text.encode(), machine("marlin", (0.05, 0.05, 0.05)), dialect="marlin")
    assert re.findall("^G.*Z.*", found.text.decode(), re.MULTILINE) == ["G1 X10 Y10 Z5 E-5"]
    assert found.edits.amplitude.keys() == {"X", "Y"}
    assert undo(found.text, "part.gcode") == text.encode()


@pytest.mark.parametrize(
    ("seed", "longest", "ways"),
    [
        *((seed, 3.0, (-0.2, -0.06, -0.03, -0.012, -0.008, 0.008, 0.012, 0.03, 0.06, 0.2)) for seed in (17, 35, 57)),
        *((seed, 0.9, (-0.045, -0.02, -0.008, 0.008, 0.027, 0.042)) for seed in (13, 18, 25, 75, 98)),
    ],
)
def test_a_crossing_that_does_not_go_through_the_backlash_is_a_stop(
    seed: int, longest: float, ways: tuple[float, ...]
) -> None:
    """Between beads that hardly turn back the motor stayed in its backlash, and the check saw no crossing."""
    rng, x, y, filament, beads = random.Random(seed), 60.0, 30.0, 0.0, []
    for _ in range(60):
        x -= rng.uniform(0.3, longest)
        y += rng.choice(ways)
        filament += 0.03
        beads.append(f"G1 X{x:.3f} Y{y:.3f} E{filament:.4f} F3000\n")
    text = f"G90\nM82\nG92 E0\nG0 X60 Y30 Z0.3 F3000\n{''.join(beads)}G0 Z5\n"
    # Reckoned by the feeds alone, to which the nozzle never comes there.
    found = compensate(text.encode(), machine("klipper"), dialect="klipper", max_slowdown=3.0)
    assert found.edits.crossings
    assert verify(found.program, reread(found.program, found.text), tolerance=5e-6, machine=machine("klipper")).ok


def test_a_fast_way_through_the_air_makes_no_crossing_slower() -> None:
    """A crossing was made for the speed of the fastest line, at which no axis can turn back: it took twice as long."""
    beads = "".join(
        f"G1 X{50 + 4 * math.cos(0.1 * n):.3f} Y{50 + 4 * math.sin(0.1 * n):.3f} E{0.013 * n:.4f}\n"
        for n in range(1, 127)
    )
    slowed = {}
    for way in ("G0 X54 Y50", "G1 X54 Y50 F36000"):
        text = f"G90\nM82\nG92 E0\n{way}\nG1 F2400\n{beads}G0 X0 Y0\n"
        slowed[way[:2]] = compensate(text.encode(), machine("klipper"), dialect="klipper").edits.slowdown
    assert slowed["G1"] < 1.2 * slowed["G0"]


def test_an_axis_comes_to_its_side_as_fast_as_it_gets_between_two_rests() -> None:
    beads = "".join(f"G0 X{10 + n} Y{10 + n % 2}\nG1 X{10.5 + n} Y{10.5 - n % 2} E{n + 1} F3000\n" for n in range(6))
    found = compensate(f"G90\nM82\n{beads}G0 X0 Y0\n".encode(), machine("klipper"), dialect="klipper")
    axis = machine("klipper").axes["Y"]
    fastest = 60e3 * math.sqrt(axis.limits.acceleration * axis.gap.lost_motion)
    feeds = [float(one) for one in re.findall(r"^G1 Y\S+ F(\S+)$", found.text.decode(), re.MULTILINE)]
    assert feeds
    assert max(feeds) == pytest.approx(fastest, rel=2e-3)


def test_increments_lead_on_from_a_place_that_is_named() -> None:
    """A raster under G91, behind a line under G90 that names the place at which the tool stands."""
    rows = "".join(f"G1 X{8 if n % 2 == 0 else -8} F3600\nG1 Y0.05\n" for n in range(40))
    begin = "G92 X0 Y0 Z0\nG90\nG1 X0 Y0 F1000\n"
    found = compensate(f"{begin}G91\n{rows}G90\n".encode(), machine("marlin"), dialect="marlin")
    assert sum(one.axis == "X" for one in found.edits.crossings) >= 38
    assert found.edits.amplitude.keys() == {"X", "Y"}


def test_a_nozzle_that_is_only_lifted_behind_its_last_bead_is_not_shifted() -> None:
    beads = "".join(f"G1 X{x} Y{y} E{n + 1}\n" for n, (x, y) in enumerate([(30, 20), (20, 25), (30, 30), (20, 35)]))
    text = f"G21\nG90\nM82\nG92 E0\nG0 X20 Y20 Z0.3 F3000\n{beads}M125 S4\nG91\nG1 Z5 F600\nG1 X5 Z1\nG90\nM84\n"
    found = compensate(text.encode(), machine("marlin", (0.05, 0.05, 0.05)), dialect="marlin")
    assert found.edits.amplitude.keys() == {"X", "Y"}
    assert found.text.decode().partition("M125 S4\n")[2].startswith("G91\nG1 Z5 F600\nG1 X5 Z1\nG90\nM84\n")


BEGINS_LOWER = ["G2 X-5 Y0 I-5 J0 Z-1 F500\nG2 X5 Y0 I5 J0 Z-2\n", "G93\nG1 X-5 Y2 Z-1 F60\nX5 Y0 Z-2 F60\nG94\n"]


@pytest.mark.parametrize("cut", BEGINS_LOWER)
def test_an_axis_that_begins_in_a_cut_on_its_own_side_is_not_moved(cut: str) -> None:
    """Z is touched off downwards, and no rapid brings it to a height from which it could be wound up."""
    found = compensate((BEGIN + "G0 X5 Y0\n" + cut + END).encode(), machine("linuxcnc", (0.05, 0.05, 0.05)))
    shifts = [shift for stop in found.edits.stops for shift in stop.shifts]
    assert all(shift.travel and shift.velocity for shift in shifts)
    assert not found.edits.offset[:3, 2].any()
    assert undo(found.text, "part.ngc") == found.program.data


@pytest.mark.parametrize("between", ["(half)", "", "F1200", "F900", "N70", "(half)\n\nF900 (slower)"])
@pytest.mark.parametrize("dialect", DIALECTS[:3])
@pytest.mark.thinned(4)
def test_a_crossing_reaches_over_lines_that_move_nothing(dialect: str, between: str) -> None:
    # The arcs meet 0.2 mm behind the quadrant: the crossing there covers the joint, and the lines in it.
    x, y = (round(20.0 * turn(0.01), 4) for turn in (math.cos, math.sin))
    cut = f"G0 X0 Y-20 Z5\nG1 Z-1 F300\nG3 X{x} Y{y} I0 J20 F1200\n{between}\nG3 X0 Y20 I{-x} J{-y}\n"
    text = BEGIN + FULL + cut + END
    found = compensate(text.encode(), machine(dialect), dialect=dialect)
    changed = found.text.decode()
    assert [(one.axis, one.sign) for one in found.edits.crossings] == [("X", -1)]
    assert largest(errors(text, changed, XY)) <= within(changed) + 3.0 * STEP
    assert f"\n{between}\n" in changed
    assert undo(found.text, "part.ngc") == text.encode()
    verdict = verify(found.program, reread(found.program, found.text), tolerance=0.005 * MM, machine=machine(dialect))
    assert [one.sentence() for one in verdict.failures] == []
    # Behind the crossing the path goes on as the program says.
    last = [[move for move in interpret(one) if move.mode > 1][-1].feed for one in (text, changed)]
    assert last[1] == pytest.approx(last[0], rel=1e-3)


@pytest.mark.parametrize("dialect", DIALECTS[:2])
def test_a_crossing_reaches_over_lines_that_are_there_twice(dialect: str) -> None:
    once = circle_points(20.0, 400)
    begin = "G0 X20 Y0 Z5\nG1 Z-1 F300\nG1 X20 Y0 F1200\n"
    near = (98, 99, 1, 2)
    twice = "".join((1 + (n % 100 in near)) * f"{line}\n" for n, line in enumerate(once.splitlines(), 1))
    text, single = (BEGIN + ("" if dialect == "klipper" else FULL) + begin + one + END for one in (twice, once))
    found, other = (compensate(one.encode(), machine(dialect), dialect=dialect) for one in (text, single))
    assert len(found.edits.crossings) == len(other.edits.crossings) > 1
    assert rms(errors(text, found.text.decode(), XY)) <= 1.1 * rms(errors(single, other.text.decode(), XY))
    assert undo(found.text, "part.ngc") == text.encode()
    verdict = verify(found.program, reread(found.program, found.text), tolerance=0.005 * MM, machine=machine(dialect))
    assert [one.sentence() for one in verdict.failures] == []


@pytest.mark.parametrize("dialect", DIALECTS[:3])
def test_a_crossing_that_begins_on_a_slower_motion_keeps_its_feed(dialect: str) -> None:
    # X comes from the right, and turns back on the arc right behind the way down.
    cut = "G0 X20 Y19.928 Z5\nG1 Z-1 F300\nG1 X15\nG0 Z5\nG0 X11.142\n"
    cut += "G1 Z-1 F300\nF2400\nG3 X11.3946 Y20.1724 I0.2954 J-0.0526\n"
    text = BEGIN + FULL + cut + END
    found = compensate(text.encode(), machine(dialect, (0.1, 0.0, 0.0), 2000.0), dialect=dialect)
    down = [move for move in interpret(found.text.decode()) if move.mode > 0 and move.end[2] < move.start[2] - 1e-6]
    assert len(down) > 2
    assert all(move.feed <= 300.0 * 1.003 for move in down)
    verdict = verify(found.program, reread(found.program, found.text), tolerance=0.005 * MM)
    assert [one.sentence() for one in verdict.failures] == []


@pytest.mark.parametrize("dialect", DIALECTS[:2])
def test_an_arc_may_begin_just_before_a_turning_point(dialect: str) -> None:
    """Y goes 4 µm down before it turns, within its dead band: no table follows, and the check knows."""
    cut = "G0 X0.135 Y-2.232 Z5\nG1 Z0 F300\nG2 X-0.135 Y2.232 I-0.135 J2.232 F1000\nG2 X0.135 Y-2.232 I0.135 J-2.232\n"
    text = BEGIN + FULL + cut + END
    found = compensate(text.encode(), machine(dialect), dialect=dialect)
    verdict = verify(found.program, reread(found.program, found.text), tolerance=0.005 * MM, machine=machine(dialect))
    assert [one.sentence() for one in verdict.failures] == []
    after, before = errors(text, found.text.decode(), XY), errors(text, text, XY)
    assert rms(after) < rms(before) / 20.0
    assert largest(after) <= within(found.text.decode()) + 0.005


@pytest.mark.parametrize("case", programs(), ids="/".join)
def test_new_feeds_and_places_have_the_digits_that_matter(made: Made, case: tuple[str, str]) -> None:
    text, found = made[case]
    changed = found.text.decode()
    own = set(re.findall(r"F([\d.]+)", text))
    for first, last, _ in hunks(text, changed)[1]:
        for line in changed.splitlines()[first - 1 : last]:
            for feed in re.findall(r"F([\d.]+)", line):
                # Under inverse time F is a time, of which a divided motion loses nothing.
                assert feed in own or len(feed.replace(".", "").lstrip("0")) <= 4 or case[0] == "inverse time"
                assert float(feed) >= 1.0
            assert not re.findall(r"[XYZIJ]-?\d*\.\d{5,}", line)


def test_splines_that_turn_back_where_they_join_are_crossed() -> None:
    """Places on a cubic go by its parameter; lengths by them were 13 % too short, and the check refused them."""
    machine, text = read_machine("router"), program_text("oval")
    found = ph.compensate(read_program(text.encode(), "oval"), machine, effort=0.1)
    assert found.warnings[0].startswith("axes X, Y, Z count on friction")
    sizes = []
    for played in (text, found.program().decode()):
        motors = play_program(played, "XYZ", 1e-3, np.array([0.0, 0.0, 0.01])).position
        gaps = [machine.axes[name].gap.lost_motion for name in "XY"]
        table = np.column_stack([drag(motors[:, column], gap) for column, gap in enumerate(gaps)])
        off = distances(table[motors[:, 2] < DEPTH * 1e-3 + 1e-9], outline("oval"))
        sizes.append((off.max(), np.sqrt(np.mean(off**2))))
    assert sizes[0][0] > 55e-6
    assert sizes[1][0] < 3e-6
    assert sizes[1][1] < 0.5e-6
