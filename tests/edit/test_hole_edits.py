"""Holes of drilling cycles, judged by a player of cycles and a table with play of the tests' own, and by LinuxCNC."""

import re

import pytest
from support.canon import needs_rs274, run_rs274
from support.corpus import stepper

import ph_post as ph
from ph_post.api.inputs import program_in
from ph_post.files.storage import SourceBytes
from ph_post.gcode.read import read_program
from ph_post.verify.shifted import verify_shifted

PLAY = 0.05
"""Backlash of the stepper's axes [mm]."""

PCB = (
    "G94\nG21\nG90\nS5000\nG0 Z5\nT1\nM6\nM3\n"
    "G81 R3 Z-2 F200 X3.81 Y2.54\nX27.94 Y3.048\nX34.544 Y2.032\nM8\nX34.544\nY9\nG0 Z5\nM9\nM2\n"
)
KNOWN = "G21 G90 G17\nG0 X0 Y0 Z5\nG83 X10 Y20 Z-3 R1 Q1 F60\nX5\nY30\nG81 X5 Y10 Z-2 R1\nX4.99\nG80\nG0 X0 Y0\nM2\n"
THERE = (
    "G21 G90 G17\nG0 X7. Y7.\nG43 Z25. H1\nG82 R2.5 Z-3.4 P200 F200.\nX39.\nY45.\nX7.\nX23. Y26.\nG80\nG0 Z25.\nM30\n"
)
TEXTS = {"pcb": PCB, "known": KNOWN, "there": THERE}


def drilled(text, play=0.0, start=1):
    """Places (x, y, z, r) of the table in every hole that is deeper than its plane R; absolute places, in G17.

    It begins with its backlash on the side `start`, at a place of which the program knows nothing.
    """
    half, at, table, cycle, data, found = 0.5 * play, {}, {}, False, {}, []
    for line in text.decode().splitlines():
        words = re.findall(r"([A-Z])\s*([-+]?[\d.]+)", re.sub(r"\(.*?\)|;.*", "", line))
        codes = {float(number) for letter, number in words if letter == "G"}
        cycle = bool(codes & {81, 82, 83, 84}) or (cycle and not codes & {0, 1, 80})
        values = {letter: float(number) for letter, number in words if letter in "XYZR"}
        data = {**data, **{letter: values[letter] for letter in "ZR" if letter in values}} if cycle else {}
        for letter in "XY":
            if letter in values:
                at[letter] = values[letter]
                was = table.get(letter, at[letter] + start * half)
                table[letter] = min(max(was, at[letter] - half), at[letter] + half)
        if cycle and values and data["Z"] < data["R"]:
            found.append((table["X"], table["Y"], data["Z"], data["R"]))
    return found


def compensated(text, dialect="linuxcnc", **options):
    return ph.compensate(
        program_in(SourceBytes(name="a", stem="a", data=text.encode()), dialect),
        stepper(dialect),
        expand=True,
        **options,
    )


@pytest.mark.parametrize("start", [1, -1])
@pytest.mark.parametrize("dialect", ["linuxcnc", "fanuc"])
@pytest.mark.parametrize("name", TEXTS)
def test_the_table_is_in_place_at_every_hole(name, dialect, start):
    text = TEXTS[name]
    if dialect == "fanuc":
        text = re.sub(r"([XYZRFQ]-?\d+)(?![\d.])", r"\1.", text)
    result = compensated(text, dialect)
    wanted = drilled(text.encode())
    ours, plain = drilled(result.program(), PLAY, start), drilled(text.encode(), PLAY, start)
    assert len(ours) == len(wanted) > 3
    off = [max(abs(a - b) for a, b in zip(one, other, strict=True)) for one, other in zip(ours, wanted, strict=True)]
    assert max(off) < 2e-4
    assert max(abs(one[0] - other[0]) for one, other in zip(plain, wanted, strict=True)) == pytest.approx(PLAY / 2)
    again = compensated(result.program().decode(), dialect)
    assert again.already_compensated
    assert again.program() == result.program()
    assert ph.undo(SourceBytes(name="b", stem="b", data=result.program())) == text.encode()
    assert not any("canned cycle" in word for word in result.warnings)
    assert all(row.compensated == row.all for row in result.axis_reversals)
    sizes = {one.axis: (1e3 * one.before.max, 1e3 * one.after.max) for one in result.shifted.hole_errors}
    assert {axis: pytest.approx((PLAY / 2, 0.0), abs=2e-4) for axis in "XY"} == sizes


@needs_rs274
@pytest.mark.parametrize("name", ["pcb", "known"])
def test_linuxcnc_drills_the_same_holes(name):
    text = TEXTS[name]
    result = compensated(text)

    def heights(data):
        made = run_rs274(data.replace("T1\nM6\n", ""))
        assert not made.refusal
        deep = [call for call in made.moves if call.numbers[2] < 1.0 - 1e-6]
        return [(round(1e3 * call.units * call.numbers[2], 3), call.kind) for call in deep]

    assert heights(result.program().decode()) == heights(text)
    assert len(heights(text)) > 4


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("G0 Z5\nM9", "G91\nG0 X5\nG90\nM9", "goes on from where they end"),
        ("G0 Z5\nM9", "G92 X0\nM9", "goes on from where they end"),
        ("G0 Z5\nM9", "G2 X40 Y9 I2 J0 F100\nM9", "goes on from where they end"),
        ("X27.94 Y3.048", "X27.94 Y3.048 L0", "L0"),
        ("X27.94 Y3.048", "G91 X2 Y3.048 L3\nG90", "G91"),
        ("G21\nG90\n", "G21\n", "G90"),
        ("G81 R3 Z-2 F200 X3.81 Y2.54", "G81 R3 Z-2 F200 Y2.54", "place of X is not known"),
        ("M3\n", "M3\nM98 P7\n", "G90"),
        ("G21\n", "G21\nG68 X0 Y0 R30\nG69\n", "frame"),
    ],
)
def test_what_is_not_sure_stays_as_it_is(old, new, why):
    text = PCB.replace(old, new, 1)
    assert text != PCB
    result = compensated(text)
    assert result.program() == text.encode()
    assert any("holes not compensated" in word and why in word for word in result.warnings)


def test_a_rigid_tap_stands_behind_its_word_at_once():
    text = THERE.replace("G82 R2.5 Z-3.4 P200", "M29 S600\nG84 R2.5 Z-3.4")
    result = compensated(text, "fanuc")
    assert result.program() == text.encode()
    assert any("M29" in word for word in result.warnings)


@pytest.mark.parametrize("dialect", ["grbl", "grblhal", "marlin"])
def test_controllers_whose_cycles_are_not_known_keep_theirs(dialect):
    text = KNOWN.replace("G17", "").replace("G0 X0 Y0\nM2", "M2")
    assert compensated(text, dialect).program() == text.encode()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("X27.965", "X27.915"),
        ("X27.965", "X27.97"),
        ("Z3 R3", "Z2 R3"),
        ("G81 X3.71 ", "G81 X2.71 "),
        ("Z3 R3", "Z2 R2"),
        ("G0 Z5\nM9", "G0 Z5\nX1\nM9"),
        ("Z-2 F200", "Z-2 F20"),
    ],
)
def test_the_checker_sees_what_was_changed(old, new):
    after = compensated(PCB).program().decode()
    original = read_program(PCB.encode(), "a")
    assert verify_shifted(original, read_program(after.encode(), "b"), stepper()).ok
    assert old in after
    head, tail = after.split("S5000")
    broken = (head + "S5000" + tail.replace(old, new, 1)).encode()
    assert not verify_shifted(original, read_program(broken, "b"), stepper()).ok
