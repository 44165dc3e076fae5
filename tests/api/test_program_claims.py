"""What a program's compensation says of its error is what play alone does to the paths that are written."""

import re
from pathlib import Path

import pytest
from msgspec.structs import replace

import ph_post as ph
from tests.support.ideal_play import play_error

HEAD = "G21 G17 G90 G91.1 G94 G61\n"
PROGRAMS = {
    "circle": "G0 X20 Y0 Z0\nG1 Z-1 F200\nG3 X20 Y0 I-20 J0 F1200\nG0 Z2\nM2\n",
    "pocket": "G0 X5 Y4 Z0\nG1 Z-1 F200\nG1 X35 F900\nG3 X36 Y5 I0 J1\nG1 Y19\nG3 X35 Y20 I-1 J0\nG1 X5\n"
    "G3 X4 Y19 I0 J-1\nG1 Y5\nG3 X5 Y4 I1 J0\nG0 Z2\nG0 X46 Y12 Z0\nG1 Z-1 F200\nG3 X46 Y12 I8 J0 F900\nG0 Z10\nM2\n",
    "corners": "G0 X0 Y0 Z0\nG1 Z-1 F200\nG1 X30 Y10 F900\nG1 X20 Y40\nG1 X-10 Y30\nG1 X0 Y0\nG0 Z2\nM2\n",
}
MICROMETRE = 1e-3
"""In the millimetres of the reference."""


def stepper_with_play_in_the_plane() -> ph.Machine:
    machine = ph.read_machine("stepper")
    z = machine.axes["Z"]
    without = replace(z, gap=replace(z.gap, lost_motion=0.0))
    return replace(machine, axes={**machine.axes, "Z": without})


@pytest.mark.parametrize("allowed", [0.06, 10.0])
@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.thinned(12)
def test_the_error_that_backlash_causes_is_that_of_a_play_operator(tmp_path: Path, name: str, allowed: float) -> None:
    machine = stepper_with_play_in_the_plane()
    file = tmp_path / f"{name}.ngc"
    file.write_text(HEAD + PROGRAMS[name])
    result = ph.compensate(file, machine, max_slowdown=allowed)
    backlash = {axis: 1e3 * one.gap.lost_motion for axis, one in machine.axes.items()}
    larger = {axis: size * (1.0 + machine.axes[axis].uncertainty.backlash) for axis, size in backlash.items()}
    smaller = {axis: size * (1.0 - machine.axes[axis].uncertainty.backlash) for axis, size in backlash.items()}
    original = HEAD + PROGRAMS[name]
    sides = [{"X": side, "Y": side, "Z": 1.0} for side in (1.0, -1.0)]
    for motion, program in ((result.before, original), (result.after, result.program().decode())):
        # Moves to take up play above the work may count, or not: the rapid may as well end there.
        for found, sizes in ((motion.error_gap, (backlash,)), (motion.error_gap_worst, (backlash, larger, smaller))):
            cut, moved = (
                max(play_error(program, original, size, one, below) for size in sizes for one in sides)
                for below in (-0.05, float("inf"))
            )
            assert 0.98 * cut[0] - MICROMETRE < 1e3 * found.max < 1.02 * moved[0] + MICROMETRE
            assert 0.95 * cut[1] - MICROMETRE < 1e3 * found.rms < 1.05 * moved[1] + MICROMETRE


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl", "fanuc"])
def test_what_is_said_of_a_part_does_not_depend_on_what_its_places_are_called(tmp_path: Path, dialect: str) -> None:
    """Two squares, of which the second is written from the first one's zero, or from one that G92 names."""
    machine = replace(stepper_with_play_in_the_plane(), dialect=dialect)
    one = "G0 X5. Y0 Z2.\nG1 Z-1. F200\nG1 X25. Y10. F900\nX15. Y30.\nX-5. Y20.\nX5. Y0.\nG0 Z2.\n"
    programs = [f"G21 G17 G90 G94\n{one}{other}M30\n" for other in (shifted(one), f"G0 X45. Y3.\nG92 X5. Y0\n{one}")]
    for number, text in enumerate(programs):
        (tmp_path / f"{number}.nc").write_text(text)
    whole, named = (ph.compensate(tmp_path / f"{number}.nc", machine) for number in range(2))
    # Before a line that gives places other names the axes go back to where the program has them.
    for found, known, within in ((named.before, whole.before, 1e-3), (named.after, whole.after, 0.1)):
        for error, other in ((found.error_gap, known.error_gap), (found.error, known.error)):
            assert error.max == pytest.approx(other.max, rel=within, abs=1e-7)
            assert error.rms == pytest.approx(other.rms, rel=within, abs=1e-7)
    assert named.after.error_gap.max < 0.2 * named.before.error_gap.max


def shifted(text: str) -> str:
    """The same 40 mm on in X, and 3 mm in Y."""
    words = {"X": 40.0, "Y": 3.0}
    return re.sub(r"([XY])([-\d.]+)", lambda word: f"{word[1]}{float(word[2]) + words[word[1]]:.3f}", text)
