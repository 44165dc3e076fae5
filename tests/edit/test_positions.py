"""One-sided positioning, and lines for a restart, on a table with backlash that a reference of the tests' own plays."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from msgspec.structs import replace
from support.reference_player import BEGINS, distance, interpret, play, run

import ph_post as ph
from ph_post.drive.machinefile import read_machine
from ph_post.edit.undo import undo
from ph_post.gcode.read import read_program

UM = 1e-3
LOST = {"X": 0.06, "Y": 0.08}
HOLES = ((10, 10), (40, 30), (20, 50), (20, 20), (60, 10), (59.97, 10.02), (60, 45))


def machine(dialect="linuxcnc", lost=LOST, **axis):
    """A stepper machine; `lost` [mm]."""
    found = read_machine("stepper")
    axes = {
        name: replace(one, gap=one.gap.with_lost_motion(lost[name] * 1e-3), **axis) if name in lost else one
        for name, one in found.axes.items()
    }
    return replace(found, axes=axes, dialect=dialect, servo_period=1e-3)


def drilling(holes=HOLES, head="G21 G90 G17 G94", unit=1.0):
    """G81 written out: over the hole, down to the clearance, drilling, out."""
    lines = [head, f"{'G90 ' if 'G91' in head else ''}G0 Z{5 / unit:.5g}"]
    at, incremental = (0.0, 0.0), "G91" in head
    for n, (x, y) in enumerate(holes):
        place = (x - at[0], y - at[1]) if incremental and n else (x, y)
        at = (x, y)
        lines.append(f"G0 X{place[0] / unit:.6g} Y{place[1] / unit:.6g}")
        if incremental and not n:
            lines.append("G91")
        over, down, out = ((size / unit) for size in ((-4, -4, 8) if incremental else (1, -3, 5)))
        lines += [f"G0 Z{over:.5g}", f"G1 Z{down:.5g} F{200 / unit:.4g}", f"G0 Z{out:.5g}"]
    return "\n".join([*lines, "G90", "M2", ""]).encode()


def compensated(text, machine, **how):
    result = ph.compensate(read_program(text, "part.ngc"), machine, **how)
    return result.program().decode(), result


def where(text, gaps, sides, begin=BEGINS[0]):
    """Places of the table [mm] at the bottom of every hole (n, 2)."""
    moves = interpret(text, begin)
    found = run(moves)
    table = [play(found.motor[:, axis], gap, side) for axis, (gap, side) in enumerate(zip(gaps, sides, strict=True))]
    deep = found.motor[:, 2] < -2.9
    reached = deep & ~np.concatenate([[False], deep[:-1]])
    return np.stack(table, axis=1)[reached]


SIDES = tuple(itertools.product((-1.0, 0.3, 1.0), repeat=2))


@pytest.mark.parametrize("begin", BEGINS)
@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl"])
def test_holes_are_exact_from_the_first_one(dialect, begin):
    text, _ = compensated(drilling(), machine(dialect))
    for sides in SIDES:
        off = where(text, tuple(LOST.values()), sides, begin) - np.array(HOLES)
        assert np.abs(off).max() < 0.1 * UM


@pytest.mark.parametrize("side", ["+", "-"])
@pytest.mark.parametrize("true", [0.0, 0.5, 1.0, 1.7, 2.0])
@pytest.mark.thinned(12)
def test_holes_from_one_side_do_not_need_the_size_of_the_backlash(true, side):
    text, result = compensated(drilling(), machine(), position_from=side)
    plain, _ = compensated(drilling(), machine())
    gaps = tuple(true * lost for lost in LOST.values())
    # All holes alike, off by half of what the file is wrong by, against the side from which the axes come.
    wrong = 0.5 * np.array([gap - lost for gap, lost in zip(gaps, LOST.values(), strict=True)])
    for sides in SIDES:
        off = where(text, gaps, sides) - np.array(HOLES)
        assert np.abs(off - (wrong if side == "+" else -wrong)).max() < 0.1 * UM
        usual = where(plain, gaps, sides) - np.array(HOLES)
        assert np.ptp(usual, axis=0).max() > 2.0 * np.abs(wrong).max() - 0.1 * UM
    assert result.after.time < 1.1 * result.before.time


def test_an_overshoot_of_its_own_covers_as_much():
    text, _ = compensated(drilling(), machine(), position_from="-", overshoot=0.4e-3)
    for true in (3.0, 5.0):
        off = where(text, tuple(true * lost for lost in LOST.values()), (1.0, -1.0)) - np.array(HOLES)
        assert np.ptp(off, axis=0).max() < 0.1 * UM
    off = where(text, tuple(9.0 * lost for lost in LOST.values()), (1.0, -1.0)) - np.array(HOLES)
    assert np.ptp(off, axis=0).max() > 1.0 * UM


def test_only_what_comes_from_elsewhere_goes_beyond():
    text, _ = compensated(drilling(((0, 0), (10, 10), (20, 20), (30, 30))), machine(), position_from="-")
    assert text.count("approach") == 2, "the first hole, X and Y; the others are reached from below anyway"
    text, _ = compensated(drilling(((0, 0), (10, 10), (20, 20), (30, 30))), machine(), position_from="+")
    assert text.count("X approach, Y approach") == 4


@pytest.mark.parametrize("head", ["G21 G91 G17 G94", "G20 G90 G17 G94", "G21 G90 G17 G94 G64 P0.01"])
def test_other_words_for_the_same_holes(head):
    unit = 25.4 if "G20" in head else 1.0
    text, _ = compensated(drilling(head=head, unit=unit), machine(), position_from="+")
    gaps = tuple(1.6 * lost for lost in LOST.values())
    off = where(text, gaps, (1.0, -1.0)) - np.array(HOLES)
    assert np.ptp(off, axis=0).max() < (0.5 if unit != 1.0 else 0.1) * UM


SLOTS = b"""G21 G90 G17 G94 G64 P0.005 Q0
G0 Z5
G0 X10 Y0
G1 Z-3 F200
G1 Y40 F600
G0 Z5
G0 X5 Y10
G1 Z-3 F200
G1 Y40 F600
G1 Y0
G0 Z5
G0 X25 Y20
G1 Z-3 F200
G3 X25 Y20 I-5 J0
G0 Z5
G0 X0 Y0
M2
"""


def test_an_axis_that_rests_along_a_slot_comes_from_one_side_too():
    text, _ = compensated(SLOTS, machine(), position_from="+")
    gap = 1.5 * LOST["X"]
    moves = interpret(text)
    found = run(moves)
    for side in (-1.0, 1.0):
        table = play(found.motor[:, 0], gap, side)
        deep = found.motor[:, 2] < -2.9
        slots = [deep & (np.abs(found.motor[:, 0] - x) < 0.1) for x in (10.0, 5.0)]
        off = [table[rows] - x for rows, x in zip(slots, (10.0, 5.0), strict=True)]
        assert max(np.ptp(np.concatenate(off)), 0.0) < 0.1 * UM
    assert ph.verify(read_program(SLOTS, "part.ngc"), read_program(text.encode(), "new.ngc"), machine()).ok


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl", "marlin"])
@pytest.mark.parametrize("how", [{"position_from": "+"}, {"position_from": "-", "overshoot": 0.3e-3}])
def test_the_program_is_checked_undone_and_left_alone(how, dialect, tmp_path):
    head = "G21\nG90" if dialect == "marlin" else "G21 G90 G17 G94"
    own, target = drilling(head=head).replace(b"\nG90\nM2", b""), machine(dialect)
    text, _ = compensated(own, target, **how)
    assert "approach" in text
    file = tmp_path / "new.ngc"
    file.write_bytes(text.encode())
    assert undo(text.encode(), "new.ngc") == own
    again = ph.compensate(ph.read_program(file, dialect=dialect), target, **how)
    assert again.program().decode() == text
    with pytest.raises(ph.InputError, match="compensated before"):
        ph.compensate(ph.read_program(file, dialect=dialect), target).program()


def test_damage_to_an_approach_is_found():
    text, _ = compensated(drilling(), machine(), position_from="-")
    place = re.search(r"\(ph-post: \+\d -1 X approach\)\nG0 (X[0-9.]+) .*\n(G1 X[0-9.]+)", text)
    assert place is not None
    original = read_program(drilling(), "part.ngc")
    nearer = text.replace(place[1], f"X{float(place[1][1:]) + 0.07:.2f}", 1)
    gone = text.replace(place[2], f"{place[2][:-1]}9", 1)
    for damaged in (nearer, gone):
        assert damaged != text
        assert not ph.verify(original, read_program(damaged.encode(), "new.ngc"), machine()).ok


def test_words_that_are_none():
    with pytest.raises(
        ph.InputError, match=r"--overshoot: less than the lost motion of Y; expected >= 0.08 mm; got 0.07 mm"
    ):
        compensated(drilling(), machine(), position_from="-", overshoot=0.07e-3)
    with pytest.raises(ph.InputError, match=r"--position-from: unknown; expected \+ or -; got x"):
        compensated(drilling(), machine(), position_from="x")
    for how in ({"position_from": "+"}, {"overshoot": 1e-3}):
        with pytest.raises(ph.InputError, match=r"^--(position-from|overshoot) is for part programs$"):
            ph.compensate("circle", machine(), **how)


def test_from_the_side_of_the_zero_holes_are_exact_whatever_the_backlash():
    target = machine(reference_direction="-")
    text, _ = compensated(drilling(), target, position_from="+")
    for true in (0.0, 0.6, 1.0, 2.0):
        gaps = tuple(true * lost for lost in LOST.values())
        # Positions are those of the motors while they move to minus.
        off = where(text, gaps, (1.0, -1.0)) - 0.5 * np.array(gaps) - np.array(HOLES)
        assert np.abs(off).max() < 0.1 * UM


def test_short_holes_keep_the_time_that_is_allowed():
    """Time is counted as the controller needs it, ramps and all, and not at the feeds alone."""
    lines = ["G21 G90 G17 G94", "G0 Z2"]
    for k in range(30):
        lines += [f"G0 X{7 * k % 13} Y{5 * k % 11}", "G1 Z-0.2 F1000", "G0 Z0.5"]
    _, result = compensated("\n".join([*lines, "M2", ""]).encode(), machine("grbl"), position_from="+")
    assert result.reversals.compensated == result.reversals.all > 90
    assert 1.05 * result.before.time < result.after.time < 1.105 * result.before.time


@pytest.mark.parametrize("turn", ["G2", "G3"])
@pytest.mark.parametrize("side", [None, "+", "-"])
@pytest.mark.thinned(12)
def test_contours_behind_holes_are_as_good_as_without(side, turn):
    lines = ["G21 G90 G17 G94 G64 P0.005 Q0", "G0 Z5"]
    for k in range(6):
        x, y = 7.0 * (5 * k % 7), 9.0 * (3 * k % 5)
        lines += [f"G0 X{x} Y{y}", "G1 Z-3 F200", "G0 Z5", f"G0 X{x - 4 + k} Y{y + 20 - 7 * k}", "G1 Z-3 F200"]
        lines += [f"{turn} X{x - 4 + k} Y{y + 20 - 7 * k} I{6 if k % 2 else -6} J0 F1200", "G0 Z5"]
    own = "\n".join([*lines, "G0 X0 Y0", "M2", ""])
    text, result = compensated(own.encode(), machine(), position_from=side)
    assert not [word for word in result.warnings if "not compensated" in word]
    moves, path = interpret(text), [one for one in interpret(own) if one.mode > 1]
    found = run(moves)
    contour = np.array([one.mode > 0 and one.start[2] < -2.9 and one.end[2] < -2.9 for one in moves])[found.owner]
    level = np.array((1.0, 1.0, 0.0))
    cuts = [type(one)(**{**vars(one), "start": one.start * level, "end": one.end * level}) for one in path]
    assert contour.sum() > 6 * 1800
    for sides in SIDES:
        x, y = (play(found.motor[:, n], tuple(LOST.values())[n], side) for n, side in enumerate(sides))
        flat = np.column_stack([x, y, np.zeros(x.size)])[contour]
        assert distance(flat, cuts).max() < 2.5 * UM


def tools_with_one_hole(holes):
    """A tool for each hole: behind a change nobody knows where the table stands, and nothing turns after it."""
    lines = ["G21 G90 G17 G94"]
    for number, (x, y) in enumerate(holes, 1):
        lines += [f"T{number} M6", f"G0 X{x} Y{y}", "G0 Z2", "G1 Z-3 F200", "G0 Z10"]
    return "\n".join([*lines, "M2", ""]).encode()


@pytest.mark.parametrize("side", ["both", "-"])
@pytest.mark.parametrize("holes", [HOLES[:4], [HOLES[0], HOLES[0], HOLES[1], HOLES[1]]], ids=["each", "twice"])
def test_a_tool_with_one_hole_comes_to_it_from_a_side_that_is_known(holes, side):
    """A second tool is told to go where the axes stand already, on whichever side."""
    text = tools_with_one_hole(holes)
    changed, result = compensated(text, machine(reference_direction=side))
    gaps = [LOST["X"], LOST["Y"]]
    # The table is half the backlash beside its motor, or where it stands on the side of the zero.
    expected = np.array(holes, dtype=float) + (0.5 * np.array(gaps) if side == "-" else 0.0)
    plain = [where(text.decode(), gaps, sides) for sides in SIDES]
    assert max(np.abs(found - expected).max() for found in plain) > 35 * UM
    for sides in SIDES:
        assert np.abs(where(changed, gaps, sides) - expected).max() < 0.1 * UM
    assert result.after.time < 1.05 * result.before.time
    assert undo(changed.encode(), "part.ngc") == text
