"""Reversals are those of the machine's axes: turned, mirrored, scaled, or beside a cutter, it is left alone."""

from __future__ import annotations

import re

import pytest
from msgspec.structs import replace
from support.editing import Compensated, compensate

from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import reread
from ph_post.verify.verify import verify

MACHINE = read_machine("stepper")

HEAD = "G21\nG90\nG0 Z5.\nG0 X20. Y0.\nG1 Z-1. F300.\n"
CIRCLE = "G3 X20. Y0. I-20. J0. F1200.\n"
END = "G0 Z5.\nG0 X0. Y0.\nM30\n"

FRAMES = {
    "turned": ("G68 X0. Y0. R30.", "G69", "turned"),
    "scaled": ("G51 X0. Y0. P2.", "G50", "scaled"),
    "mirrored": ("G51.1 X0.", "G50.1", "scaled"),
    "cutter on the left": ("G41 D1", "G40", "cutter compensation"),
    "cutter on the right": ("G42 D1", "G40", "cutter compensation"),
    "cutter of a given size": ("G41.1 D3.", "G40", "cutter compensation"),
}
DIALECTS = {
    "linuxcnc": tuple(FRAMES),
    "grbl": tuple(FRAMES),
    "grblhal": tuple(FRAMES),
    "fanuc": tuple(name for name in FRAMES if not name.startswith("cutter of")),
}
"""Of Grbl, which refuses all of these words, programs are read as any."""

CASES = [(dialect, name) for dialect, names in DIALECTS.items() for name in names]


def made(text: str, dialect: str) -> Compensated:
    return compensate(text.encode(), replace(MACHINE, dialect=dialect), dialect=dialect)


@pytest.mark.parametrize(("dialect", "name"), CASES)
@pytest.mark.thinned(4)
def test_a_stretch_in_another_frame_is_left_to_the_byte_and_named(dialect: str, name: str) -> None:
    begin, end, word = FRAMES[name]
    # The lead-in and the lead-out turn X and Y round, as the circle does four times.
    stretch = f"{begin}\nG1 X22. Y1. F300.\nX19.\nX20. Y0.\n{CIRCLE}X21. Y1.\nX20. Y0.\n{end}\n"
    after = "G0 Z5.\nG0 X0. Y30.\nG0 X20. Y0.\nG1 Z-1. F300.\n"
    text = f"{HEAD}{CIRCLE}{stretch}{after}{CIRCLE}{END}"
    found = made(text, dialect)
    changed = found.text.decode()
    assert verify(found.program, reread(found.program, found.text), machine=MACHINE, tolerance=1e-6).ok
    assert stretch in changed
    before, behind = changed.split(stretch)
    # The circle before it is compensated; that behind it where all modes and places are known again.
    assert len(re.findall(r"crossing [xy]", before.lower())) == 3
    assert "crossing" in behind.lower()
    note = found.program.notes[0]
    assert word in note.what
    assert text.splitlines()[note.first] == begin
    assert note.last < text.splitlines().index("G0 X0. Y30.", note.first)


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl", "grblhal", "fanuc"])
@pytest.mark.parametrize(
    ("line", "turned"),
    [
        ("G10 L2 P1 R30.", True),
        ("G10 L20 P1 X0. R30.", True),
        ("G10 L2 P1 R0.", False),
        ("G10 L2 P1 X5. Y5.", False),
        ("G10 L1 P1 R3.", False),
    ],
)
def test_a_turned_work_system_leaves_all_alone(dialect: str, line: str, turned: bool) -> None:
    text = f"G21\n{line}\n{HEAD}{CIRCLE}{END}"
    found = made(text, dialect)
    said = [one for one in found.edits.warnings if "turns the work system" in one]
    assert ["line 2" in one for one in said] == [True] * turned
    assert (found.text.decode() == text) is turned


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl", "grblhal", "fanuc", "marlin"])
def test_the_head_says_once_for_which_work_offsets_it_holds(dialect: str) -> None:
    changed = made(f"{HEAD}{CIRCLE}G0 Z5.\n", dialect).text.decode().lower()
    joined = re.sub(r"\)?\r?\n[(;]  ", " ", changed)
    assert joined.count("not rotated, mirrored or scaled") == 1
    assert "not rotated" in " ".join(find_dialect("linuxcnc").assumed)


@pytest.mark.parametrize(
    "line", ["G68 X0. Y0. R30.", "G51.1 X0.", "G92 X20. Y0.", "G52 X1. Y1.", "G10 L2 P1 X5.", "G65 P100 X5.", "G31 X5."]
)
@pytest.mark.parametrize("between", ["", "(half)\n", "M8\n"])
@pytest.mark.thinned(4)
def test_no_motion_word_comes_beside_a_word_that_takes_the_axis_words(line: str, between: str) -> None:
    # The circle before it ends in a crossing or in a stop, whose last block is a G1.
    text = f"{HEAD}{CIRCLE}{between}{line}\nX20. Y0. I-20. J0.\n{END}"
    found = made(text, "linuxcnc")
    changed = found.text.decode()
    assert f"\n{line}\n" in changed
    assert "ph-post: +" in changed
    damaged = changed.replace(f"\n{line}\n", f"\n(ph-post: +1 -1 mode)\nG3 {line}\n")
    verdict = verify(found.program, reread(found.program, damaged.encode()), machine=MACHINE, tolerance=1e-6)
    assert "takes the axis words" in str([one.what for one in verdict.failures])
