"""What backlash adds: nothing where there is none, however fast a program runs; else what closed forms say."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from support.corpus import stepper
from support.corpus_judge import Judged, compare

import ph_post as ph
from ph_post.gcode.read import read_program
from ph_post.simulate.contour import ContourError
from ph_post.simulate.controllers.deviation import follow_cut
from ph_post.simulate.controllers.gap_error import program_gap_error
from ph_post.simulate.controllers.run import run_program
from ph_post.types import Gap, Limits, Machine, Scenario, Servo

LAG = 0.025
"""Time [s] that the tables are behind their commands."""

GAP = 50e-6
HEAD = "G21 G17 G90 G94 G61\nG0 X5 Y0 Z5\nG1 Z-1 F300\n"
TURNS = 8
RING = HEAD + TURNS * "G3 X5 Y0 I-5 J0 F1200\n" + "G0 Z5\nM2\n"
SQUARE = HEAD + "G1 X20 F1200\nY15\nX5\nY0\nX12 Y4\nX5 Y8\nG0 Z5\nM2\n"

CUSP = """G21 G90 G17 G94 G64 P0.005
G0 X11.238 Y-7.439 Z5
G1 Z-0.257 F120
G2 X9.469 Y-2.978 I-1.256 J2.083 F600
X6.033 Y-0.935 I-2.395 J-0.118
G3 X6.751 Y-0.214 I0.445 J0.274
G0 Z5
M2
"""
QUICK = 0.5e-3
"""Time [s] that the tables of a quick machine are behind their commands."""


def late(gap: float) -> Machine:
    """A machine whose tables lag, with backlash in X and Y."""
    machine = ph.read_machine("router")
    axes = {
        name: replace(
            axis,
            feedback="motor",
            servo=Servo(b=(0.2 * LAG) ** 2, c=LAG),
            gap=Gap(lost_motion=gap if name != "Z" else 0.0, initial_flank="-"),
            reference_direction="both",
        )
        for name, axis in machine.axes.items()
    }
    return replace(machine, axes=axes)


@pytest.mark.parametrize("text", [RING, SQUARE], ids=["ring", "square"])
def test_a_slower_program_adds_nothing_without_backlash(text: str) -> None:
    """The lag of the drives leaves much at full speed, and less at half of it: not by backlash."""
    machine = late(0.0)
    fast, slow = (read_program(one.encode(), "part.ngc") for one in (text, text.replace("F1200", "F600")))
    plain, cut = (follow_cut(run_program(one, machine), machine, fast, moved_by=one) for one in (fast, slow))
    away = [np.sqrt(np.mean(one.simulate(Scenario())[1][one.counted] ** 2)) for one in (plain, cut)]
    assert away[0] > 8e-6
    assert away[1] < 0.8 * away[0]
    for one in (plain, cut):
        found = program_gap_error(one, plain, (Scenario(),))
        assert found is not None
        assert found.max < 1e-6


def require_within_all_causes(found: Any, without: ContourError | None) -> None:
    """Backlash adds no more than all causes leave, and what is left without it."""
    after, gap = found.after.error, found.after.error_gap
    assert after is not None
    assert gap is not None
    assert without is not None
    assert gap.max < after.max + without.max


def test_on_a_late_circle_it_is_that_of_play_on_the_smaller_one() -> None:
    """Play holds a table g/2 back along each axis: g/2 (cos - sin) from the circle, g √(1/4 - 1/2π) in all.

    While an axis crosses its backlash the table goes from one side of the circle to the other; that is less.
    """
    machine = late(GAP)
    program = read_program(RING.encode(), "ring.ngc")
    cut = follow_cut(run_program(program, machine), machine, program, moved_by=program)
    found = program_gap_error(cut, cut, (Scenario(),))
    assert found is not None
    # On the way down both axes are on their wrong sides.
    assert found.max == pytest.approx(math.sqrt(0.5) * GAP, rel=0.001)
    ring, plunge = TURNS * 2.0 * math.pi * 5.0 / 20.0, 6.0 / 5.0
    crossed = 4.0 * math.acos(1.0 - GAP / 5e-3) / (2.0 * math.pi)
    least, most = (
        GAP * math.sqrt((share * (0.25 - 0.5 / math.pi) * ring + 0.5 * plunge) / (ring + plunge))
        for share in (1.0 - crossed, 1.0)
    )
    assert 0.99 * least < found.rms < 1.01 * most


@pytest.mark.parametrize(("step", "tolerance"), [(0.5, 0.02), (1.0, 0.01), (0.3, 0.01)])
def test_what_backlash_adds_to_linked_chords_is_no_more_than_all_causes_leave(
    step: float, tolerance: float, tmp_path: Path
) -> None:
    """What all causes leave, and what is left without backlash: from a place of the table to its place without."""
    angles = np.arange(-0.5, 0.5, step / 20.0)
    chords = [f"G1 X{20.0 * math.sin(angle):.3f} Y{20.0 * math.cos(angle) - 20.0:.3f}" for angle in angles]
    lines = ["G21 G17 G90 G94", f"G64 P{tolerance}", f"G0 {chords[0][3:]} Z5", "G1 Z-1 F600", *chords[1:], "G0 Z5"]
    file = tmp_path / "arc.ngc"
    file.write_text("\n".join([*lines, "M2", ""]), encoding="utf-8")
    rounded = replace(late(40e-6), dialect="linuxcnc")
    found = ph.compensate(file, rounded, max_slowdown=0.1)
    assert any(row.compensated for row in found.axis_reversals)
    without = ph.compensate(file, replace(late(0.0), dialect="linuxcnc")).before.error
    require_within_all_causes(found, without)


def test_what_backlash_adds_to_a_cusp_is_no_more_than_all_causes_leave(tmp_path: Path) -> None:
    """A crossing goes beyond the cusp and back: the motion without it does not leap there from arc to arc."""
    file = tmp_path / "cusp.ngc"
    file.write_text(CUSP, encoding="utf-8")

    def quick(gap: float) -> Machine:
        servo, limits = Servo(b=0.25 * QUICK**2, c=QUICK), Limits(velocity=0.1, acceleration=0.4, jerk=40.0)
        slow = late(gap)
        axes = {name: replace(axis, servo=servo, limits=limits) for name, axis in slow.axes.items()}
        return replace(slow, axes=axes, dialect="linuxcnc")

    found = ph.compensate(file, quick(20e-6), max_slowdown=0.1)
    assert [(row.compensated, row.all) for row in found.axis_reversals] == [(4, 4), (5, 5)]
    without = ph.compensate(file, quick(0.0), max_slowdown=0.1).before.error
    require_within_all_causes(found, without)


def test_nothing_is_left_of_backlash_where_a_late_table_goes_as_without_it(tmp_path: Path) -> None:
    """In corners that a lag of 10 ms and the controller round, crossings leave what is left without backlash."""
    file = tmp_path / "square.ngc"
    text = SQUARE.replace("G61", "G64 P0.02").replace("F1200", "F3000").replace("X12 Y4\nX5 Y8\n", "")
    file.write_text(text, encoding="utf-8")

    def later(gap: float) -> Machine:
        slow, lag = late(gap), 0.01
        servo = Servo(b=(0.2 * lag) ** 2, c=lag)
        return replace(
            slow, dialect="linuxcnc", axes={name: replace(axis, servo=servo) for name, axis in slow.axes.items()}
        )

    found = ph.compensate(file, later(GAP), max_slowdown=0.1)
    without = ph.compensate(file, later(0.0), max_slowdown=0.1).before.error
    after, gap = found.after.error, found.after.error_gap
    assert after is not None
    assert gap is not None
    assert without is not None
    assert after.max == pytest.approx(without.max, abs=0.5e-6)
    assert gap.max < 2e-6


@pytest.mark.parametrize("feedback", ["none", "motor"])
def test_each_scenario_is_as_if_it_were_the_only_one(feedback: str) -> None:
    """What machines have in common is run and measured once; that changes no bit of it."""
    machine = late(GAP)
    servo = Servo(b=0.0, c=0.0) if feedback == "none" else machine.axes["X"].servo
    unknown = {"gap": Gap(lost_motion=GAP, initial_flank="unknown"), "feedback": feedback, "servo": servo}
    machine = replace(machine, axes={name: replace(axis, **unknown) for name, axis in machine.axes.items()})
    program = read_program(SQUARE.encode(), "square.ngc")
    command = run_program(program, machine)
    together = follow_cut(command, machine, program, moved_by=program)
    assert len(together.scenarios()) == 24
    for scenario in together.scenarios():
        alone = follow_cut(command, machine, program, moved_by=program)
        (run, distance), (expected, away) = (one.simulate(scenario) for one in (together, alone))
        assert np.array_equal(run.executed, expected.executed)
        assert np.array_equal(distance, away)
        assert run.events == expected.events


FAR_CUT = """G21 G90 G17{}
G0 X80 Y75 Z5
G0 Z3
G1 X75 Y82 Z-1.7 F2540
X80 Y75 Z-6.3
G2 X72.9584 Y92 I17 J17
G1 Y140
X76 Z-3
X120
X123 Z-6.3
X160
Y75
X80
G0 Z5
M2
"""


@pytest.mark.parametrize("mode", ["", " G64 P0.01"])
def test_a_crossing_behind_a_joint_that_is_cut_far_is_no_error(mode: str, tmp_path: Path) -> None:
    """Between a circle and its tangent a controller leaves the one long before it ends: all that is of one motion."""
    text = FAR_CUT.format(mode)
    file = tmp_path / "part.ngc"
    file.write_text(text, encoding="utf-8")
    found = ph.compensate(file, stepper("linuxcnc"))
    judged = compare(Judged("compensated"), "linuxcnc", text.encode(), found.program())
    assert judged.followed == judged.shown >= 4
    assert judged.rms is not None
    assert judged.rms[1] < 1e-4
    assert found.after.error_gap is not None
    assert found.after.error_gap.max < 12e-6
    assert found.after.error_gap.rms < 1e-6


@pytest.mark.parametrize(("words", "off"), [("Y0 ", 0.5), ("", 0.0)], ids=["sent", "not named"])
def test_an_axis_that_is_sent_to_where_the_model_stands_came_by_an_unknown_side(words: str, off: float) -> None:
    """Closed form: it came from where nobody knows, so it is off by half of its backlash as long as it rests there."""
    axes = {
        name: replace(axis, gap=Gap(lost_motion=GAP if name == "Y" else 0.0), reference_direction="both")
        for name, axis in ph.read_machine("stepper").axes.items()
    }
    machine = replace(ph.read_machine("stepper"), axes=axes)
    text = f"G21 G90 G94\nG0 X0 {words}Z5\nG1 Z-1 F300\nG1 X20 F600\nX0\nX20\nG0 Z5\nM2\n"
    program = read_program(text.encode(), "part.ngc")
    cut = follow_cut(run_program(program, machine), machine, program, moved_by=program)
    for flank in ("+", "-"):
        found = cut.error(Scenario(flank=flank))  # type: ignore[arg-type]
        assert found is not None
        assert found.max == pytest.approx(off * GAP, abs=1e-9)
        assert found.rms == pytest.approx(off * GAP, abs=1e-9)
    result = ph.compensate(program, machine)
    before, after = result.before.error_gap, result.after.error_gap
    assert before is not None
    assert after is not None
    assert after.max <= before.max + 1e-9
