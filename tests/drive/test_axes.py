"""Axes whose gap changes along the travel: sized where they turn back, and told where that cannot be had."""

import json

import numpy as np
import pytest
from msgspec.structs import replace

from ph_post.analysis.path_analysis import analyse
from ph_post.cli.main import main
from ph_post.compensate.layout import reversing_axes
from ph_post.compensate.offsets import command_of
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import Planner, make_plan
from ph_post.compensate.trial import Design, Trial, find_surroundings
from ph_post.drive.axes import axis_at, backlash_varies, gaps_of, has_backlash, sized_machine, with_gap
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.files.storage import shipped
from ph_post.gcode.read import read_program
from ph_post.simulate.assess import assess
from ph_post.simulate.contour import Nominal
from ph_post.simulate.controllers.cut_path import CutPath
from ph_post.simulate.controllers.run import run_program
from ph_post.simulate.machine import simulate
from ph_post.types import EffectSetting, Scenario

SLOPE = {"slope_mm_per_mm": 0.002, "reference_mm": 0.0}
BUMP = {"bump_mm": 0.05, "centre_mm": 20.0, "width_mm": 5.0}

ARCH = {
    "format": "ph-post-path",
    "version": 1,
    "name": "waves",
    "source": "by hand",
    "units": "mm",
    "axes": ["X", "Y"],
    "feed": 600,
    "closed": False,
    "segments": [
        {"type": "arc", "start": [0, 0], "end": [8, 0], "center": [4, 0], "turn": "ccw"},
        {"type": "arc", "start": [8, 0], "end": [16, 0], "center": [12, 0], "turn": "ccw"},
    ],
}


def worn(name, parameters, lost_motion=None, axis="X"):
    machine = read_machine(name)
    own = machine.axes[axis]
    if lost_motion is not None:
        own = with_gap(own, lost_motion)
    setting = EffectSetting(name="position_dependent_backlash", parameters=parameters)
    return replace(machine, axes={**machine.axes, axis: replace(own, effects=(setting,))})


def oval(tmp_path, machine):
    """An ellipse-like path whose X turns back at 0 and 16 mm."""
    path = tmp_path / "ring.json"
    ring = {
        **ARCH,
        "name": "ring",
        "closed": True,
        "segments": [
            {"type": "arc", "start": [8, -8], "end": [8, -8], "center": [8, 0], "turn": "ccw"},
        ],
    }
    path.write_text(json.dumps(ring))
    return analyse(read_path(str(path)), machine, 5e-6)


def test_the_gap_of_a_place():
    axis = worn("mill", SLOPE).axes["X"]
    assert gaps_of(axis, np.array([0.0, 0.01])) == pytest.approx([30e-6, 50e-6])
    here = axis_at(axis, 0.01)
    assert here.gap.lost_motion == pytest.approx(50e-6)
    assert here.effects == ()
    assert not backlash_varies(here)
    plain = read_machine("mill").axes["X"]
    assert axis_at(plain, 0.01) is plain


def test_the_motor_s_angle_goes_with_the_gap():
    axis = read_machine("paper").axes["X"]
    assert with_gap(axis, 2.0 * axis.gap.lost_motion).gap.motor_angle == pytest.approx(2.0 * 0.125664)


def test_a_bump_is_a_gap_where_the_file_has_none():
    axis = worn("router", BUMP, lost_motion=0.0).axes["X"]
    assert has_backlash(axis)
    assert not has_backlash(with_gap(axis, 0.0))


@pytest.mark.parametrize(("name", "gaps"), [("mill", {30e-6, 62e-6}), ("router", {136e-6})])
def test_inside_a_loop_each_reversal_has_its_gap_behind_it_all_have_the_mean(tmp_path, name, gaps):
    machine = worn(name, SLOPE)
    analysis = oval(tmp_path, machine)
    sized = sized_machine(machine, analysis.turning_points)
    found = [axis.gap.lost_motion for axis, _ in reversing_axes(sized, analysis.turning_points) if axis.name == "X"]
    assert sorted(set(np.round(found, 12))) == pytest.approx(sorted(gaps))


def test_inspect_tells_the_interval_of_the_place_s_own_gap(tmp_path):
    varied, plain = oval(tmp_path, worn("mill", SLOPE)), oval(tmp_path, read_machine("mill"))
    twice = oval(tmp_path, worn("mill", {"slope_mm_per_mm": 0.0}, lost_motion=62e-6))
    rows = zip(varied.turning_points, varied.intervals, plain.intervals, twice.intervals, strict=True)
    compared = 0
    for point, found, at_0, at_16 in rows:
        if point.axis == "X":
            assert found.duration == pytest.approx((at_0 if point.position < 0.01 else at_16).duration, rel=1e-6)
            compared += 1
    assert compared == 2


def test_a_lasting_offset_is_half_the_mean_gap_and_does_not_wander(tmp_path):
    """Where the file says that there is no gap at all, and the screw is worn by 0.05 mm in the middle."""
    machine = worn("router", {**BUMP, "centre_mm": 8.0, "width_mm": 8.0}, lost_motion=0.0)
    analysis = oval(tmp_path, machine)
    plan = make_plan(analysis, PlanOptions(strategy="auto", inverse_dynamics=True, effort=0.05))
    gap = 50e-6 * np.exp(-0.5)
    crossed = [one.travel for one in plan.crossings if one.axis == "X" and one.window >= 0]
    assert crossed
    assert np.abs(crossed) == pytest.approx(gap)
    assert any("changes along its travel" in warning for warning in plan.warnings)
    nominal = Nominal(analysis.track)
    command = command_of(plan, analysis.track, machine.servo_period)
    plain = make_plan(analysis, PlanOptions(strategy="none", inverse_dynamics=True))
    before, after = (
        assess(one, machine, nominal, analysis.turning_points).error
        for one in (command_of(plain, analysis.track, machine.servo_period), command)
    )
    assert after.max < before.max


PROGRAM = b"G21 G17 G90 G94\nG0 X0 Y0 Z5\nG1 Z0 F300\nG1 X20 F1200\nG1 Y10\nG1 X0\nG1 Y0\nG0 Z5\nM2\n"


def test_a_program_says_that_it_carries_one_offset(tmp_path, capsys):
    part, file = tmp_path / "part.ngc", tmp_path / "worn.toml"
    part.write_bytes(PROGRAM)
    effect = '[[axes.X.effects]]\nname = "position_dependent_backlash"\nslope_mm_per_mm = 0.002\n[axes.Y]'
    file.write_text(shipped("machines", "router").read_text(encoding="utf-8").replace("[axes.Y]", effect))
    assert main(["convert", str(part), "-m", str(file), "-o", str(tmp_path / "out.ngc")]) == 0
    assert "the backlash of axis X changes along its travel" in capsys.readouterr().err


def test_rows_are_looked_for_as_far_as_the_gap_is_wide_anywhere():
    """0.2 mm of play at X20, and none in the file: the rows must still find their places on the path."""
    machine = worn("router", {**BUMP, "bump_mm": 0.2}, lost_motion=0.0)
    program = read_program(PROGRAM, "part")
    command = run_program(program, machine)
    leg, place = CutPath(program, machine).follow(command)
    assert len(leg) == len(place) == len(command.t)


@pytest.mark.parametrize(
    "effect",
    [
        EffectSetting(name="cutting_force", parameters={"following_error_mm": 0.05, "feed_mm_min": 600}),
        EffectSetting(name="scale_error", parameters={"error": 0.004}),
    ],
    ids=lambda effect: effect.name,
)
def test_a_trial_knows_what_the_simulation_knows(tmp_path, effect):
    """The plain motion tried at a turning point errs as much as the same command does in `simulate`."""
    machine = read_machine("mill")
    axes = {name: replace(axis, effects=(effect,)) for name, axis in machine.axes.items()}
    machine = replace(machine, axes=axes)
    analysis = oval(tmp_path, machine)
    task = Planner(analysis, machine, PlanOptions(strategy="suppress", start="moving")).task
    nominal, scenario = Nominal(analysis.track), Scenario(pickup="standstill")
    tried = 0
    for place in find_surroundings(analysis, task.feed, task.looped):
        trial = Trial(nominal, analysis.track, place, machine, (scenario,), task.sized)
        (before, _), command, _ = trial._command(Design())
        run = simulate(replace(command, flanks=place.flanks), machine, scenario)
        error = nominal.nearest(run.executed, command.s).error[int(0.5 * before / trial.period) :]
        assert trial.run(Design()).error[0] == pytest.approx(np.abs(error).max(), rel=1e-6)
        tried += 1
    assert tried == 4
