"""Which motions of its original a program's motions stand for, and that none loses its place beside them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from support.corpus import stepper
from support.corpus_judge import Judged, compare
from support.random_cuts import random_cut

import ph_post as ph
from ph_post.gcode.read import read_program
from ph_post.simulate.controllers.counterparts import counterparts
from ph_post.simulate.controllers.deviation import program_error
from ph_post.simulate.controllers.run import run_program
from ph_post.types import Gap, Limits, Servo

LIMITS = {"X": (0.1, 1.34), "Y": (0.06, 0.46), "Z": (0.1, 0.81)}
BACK = "G21 G90 G17 G94\n{}\nG0 X10.975 Y-15.848 Z5\nX-2.106 Y13.09\nG1 Z-0.5 F120\nX2 F600\nG0 Z5\nM2\n"


RAMP = """G21 G90 G17
G0 X80 Y75 Z5
G0 Z3
G1 X77 Y78 Z0.7 F2540
X75 Y82 Z-1.7
X77 Y78 Z-4
X80 Y75 Z-6.3
G2 X72.9584 Y92 I17 J17
G1 Y140
G2 X83 Y150 I10 J0
G1 X93
X96 Z-3
X120
X123 Z-6.3
X160
G2 X170 Y140 I0 J-10
G1 Y80
X160 Y75
X80
G0 Z5
M2
"""
"""It ramps down forth and back, cuts back along the ramp, and over a tab."""


def test_an_arc_that_goes_back_beside_its_ramp_is_no_way_up_the_ramp(tmp_path: Path) -> None:
    """Raised by the backlash of Z, it is as near to the one as to the other at first."""
    file = tmp_path / "part.ngc"
    file.write_text(RAMP, encoding="utf-8")
    found = ph.compensate(file, stepper("linuxcnc"))
    assert not any("not compensated" in word for word in found.warnings)
    judged = compare(Judged("compensated"), "linuxcnc", RAMP.encode(), found.program())
    assert judged.followed == judged.shown >= 8
    assert 100.0 * judged.rms[1] < judged.rms[0]
    assert found.after.error.max < 10e-6


@pytest.mark.parametrize("mode", ["G61", "G64 P0.02"])
def test_no_cut_is_lost_behind_a_rapid_that_goes_back_beside_itself(mode: str, tmp_path: Path) -> None:
    """Shifted by a backlash in Z, the way on is 20 degrees from the way back, and no nearer."""
    machine = ph.read_machine("router")
    axes = {
        name: replace(
            axis,
            feedback="none",
            servo=Servo(b=0.0, c=0.0),
            gap=Gap(lost_motion=44e-6 if name == "Z" else 0.0, initial_flank="-"),
            limits=Limits(velocity=LIMITS[name][0], acceleration=LIMITS[name][1], jerk=100.0),
            reference_direction="+",
        )
        for name, axis in machine.axes.items()
    }
    file = tmp_path / "part.ngc"
    file.write_text(BACK.format(mode), encoding="utf-8")
    found = ph.compensate(file, replace(machine, axes=axes, dialect="linuxcnc"), max_slowdown=0.1)
    assert b"Z approach" in found.program()
    for one in (found.before, found.after):
        seconds = np.count_nonzero(one.cut.counted) * machine.servo_period
        assert seconds == pytest.approx(5.5 / 2.0 + 4.106 / 10.0, abs=0.05)


def test_rows_of_rounded_corners_between_linked_lines_are_beside_the_path() -> None:
    """Motors that do not lag leave tables no farther than the backlash and the tolerance of the controller."""
    job = random_cut(224)
    program = read_program(job.text.encode(), "part.ngc")
    assert "G64 P0.005" in job.text
    assert job.machine.axes["X"].servo.c == 0.0
    found = program_error(run_program(program, job.machine), job.machine, program, moved_by=program).error
    assert found is not None
    assert found.max < np.linalg.norm([axis.gap.lost_motion for axis in job.machine.axes.values()]) + 5e-6


def test_motions_stand_for_those_of_the_lines_that_they_are_in() -> None:
    """A rapid and an approach in place of a rapid, a line as it was, two in place of one, one that was added."""
    original = read_program(b"G21 G90\nG0 X5 Y5\nG1 X10 F600\nX20\nY10\nM2\n", "part.ngc")
    text = (
        f"(ph-post 0.2.0 compensated this program)\n(ph-post: original sha256 {original.digest})\n"
        "(ph-post: machine bench, sha256 0)\n(ph-post: options sha256 0)\n(ph-post: offset X 0.02 mm)\n"
        "(ph-post: 0 stops, 0 dips)\n(ph-post: dwell 0 s, decimals 4, chord tolerance 0.001 mm, block time 5 ms)\n"
        "G21 G90\n(ph-post: +2 -1 X approach)\nG0 X5.06 Y5\nG1 X5.02 F300\nG1 X10.02 F600\n"
        "(ph-post: +2 -1 crossing X-)\nX15.02\nX19.98\nY10\n(ph-post: +1 -0 X to 0)\nG1 X20\nM2\n"
    )
    found = counterparts(read_program(text.encode(), "part.ngc"), original, {"X": 40e-6})
    assert found is not None
    # The approach is in the air, with the rapid.
    assert found.first.tolist() == [0, 0, 1, 2, 2, 3, 4]
    assert found.end.tolist() == [1, 1, 2, 3, 3, 4, 4]
    assert found.stretch.tolist() == [0, 0, 1, 2, 2, 3, 4]
    assert found.changed.tolist() == [True, True, False, True, True, False, True]
    assert counterparts(original, read_program(b"G0 X1\n", "other.ngc"), {}) is None
    assert counterparts(original, original, {}).end.tolist() == [1, 2, 3, 4]  # type: ignore[union-attr]
