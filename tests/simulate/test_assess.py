"""Assessments, against a play operator and a search of the test's own, and printed numbers."""

from itertools import product

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial import cKDTree

from ph_post.analysis.path_analysis import analyse
from ph_post.compensate.comparison import before_and_after
from ph_post.compensate.offsets import command_of
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.drive.effects.active import plant_of
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.files.storage import or_shipped
from ph_post.simulate.assess import PICKUPS, assess, resting_axes, scenario_words, scenarios
from ph_post.simulate.contour import Nominal
from ph_post.simulate.machine import first_flank, simulate
from ph_post.types import Command, EffectSetting, Scenario
from tests.support.cascade_plant import pushed


def job(path, machine, **options):
    analysis = analyse(read_path(or_shipped("paths", path)), read_machine(machine), 5e-6)
    plan = make_plan(analysis, PlanOptions(**{"strategy": "suppress", **options}))
    return analysis, plan, command_of(plan, analysis.track, plan.machine.servo_period)


def play(command, half, flank):
    """The play operator: the table stands until the motor, without lag, pushes it."""
    table, executed = command[0] - flank * half, []
    for motor in command:
        table = min(max(table, motor - half), motor + half)
        executed.append(table)
    return np.array(executed)


@pytest.mark.parametrize(("flank", "factor"), [("+", 1.0), ("-", 1.0), ("+", 1.2), ("-", 0.8)])
def test_a_stepper_is_a_play_operator(flank, factor):
    analysis, plan, command = job("oval", "stepper", strategy="none")
    case = Scenario(flank=flank, gap=factor)
    nominal = Nominal(analysis.track)
    found = assess(command, plan.machine, nominal, analysis.turning_points, [case])
    halves = [0.5 * factor * plan.machine.axes[name].gap.lost_motion for name in command.axes]
    sign = 1 if flank == "+" else -1
    executed = np.column_stack([play(command.position[:, k], half, sign) for k, half in enumerate(halves)])
    np.testing.assert_allclose(found.run.executed, executed, atol=1e-12)
    # 0.6 µm between points make less than 2e-9 m of a distance of 30 µm.
    s = np.linspace(0.0, analysis.track.length, 400_001)
    points = analysis.track.derivatives(*analysis.track.locate(s))[0]
    distance, _ = cKDTree(points).query(executed)
    assert found.error.max == pytest.approx(distance.max(), abs=2e-9)
    assert found.error.rms == pytest.approx(np.sqrt(np.mean(distance**2)), abs=2e-9)
    # Without a gap a stepper is on the path, so that all of the error is the gap's.
    assert found.error_gap.max == pytest.approx(found.error.max, abs=1e-9)


def test_the_worse_flank_and_the_worst_case_decide():
    _, plan, command = job("oval", "stepper", strategy="none")
    analysis = analyse(plan.path, plan.machine, 5e-6)
    nominal = Nominal(analysis.track)
    found = assess(command, plan.machine, nominal)
    sides = list(product("+-", ((), ("Y",))))
    alone = {
        (*side, gap): assess(
            command, plan.machine, nominal, (), [Scenario(flank=side[0], opposite=side[1], gap=gap)]
        ).error.max
        for side, gap in product(sides, (1.0, 1.2, 0.8))
    }
    assert found.error.max == max(alone[(*side, 1.0)] for side in sides)
    assert found.error_worst.max == max(alone.values())
    assert {(one.flank, one.opposite, one.gap_factor(0.2)) for one in found.scenarios} == set(alone)


@pytest.mark.parametrize(
    ("ratio", "printed"),
    [(1.0, 2.19e-3), (0.25, 1.36e-3), (-0.3, 1.05e-3), (-0.4, 2.09e-3), (-0.45, 2.76e-3)],
)
def test_the_papers_circle_with_its_rule_at_every_reversal(ratio, printed):
    # The notes on the paper, honest mode: largest error over the radius, within 3 %.
    analysis, plan, command = job(
        "circle", "paper", strategy="suppress", ratio=ratio, t_star=0.5, start="moving", allow_retrograde=True
    )
    found = assess(command, plan.machine, Nominal(analysis.track), analysis.turning_points)
    assert found.error.max / 0.25 == pytest.approx(printed, rel=0.03)
    assert found.error.max == max(one.max for one in found.turning if one is not None)


def machine(name, **gap):
    found = read_machine(name)
    axes = {key: replace(axis, gap=replace(axis.gap, **gap)) for key, axis in found.axes.items()}
    return replace(found, axes=axes)


def test_scenarios_try_what_the_file_leaves_open():
    tried = scenarios(machine("mill"), ("X", "Y"))
    assert tried[0] == Scenario(pickup="standstill", flank="+")
    nominal = [one for one in tried if one.beta == one.gain == 1.0 and one.spread == 0.0]
    assert list(tried[: len(nominal)]) == nominal
    assert {(one.pickup, one.flank, one.opposite) for one in nominal} == set(product(PICKUPS, "+-", ((), ("Y",))))
    factors = {one.gap_factor(0.2) for one in tried}
    assert factors == {one.beta for one in tried} == {one.gain for one in tried} == {1.0, 1.2, 0.8}
    assert all([one.gap_factor(0.2), one.beta, one.gain].count(1.0) >= 2 for one in tried)


def test_every_combination_of_sides_is_tried_once():
    """Of three axes eight; of an axis whose side is known, or that moves at first, no other."""

    def sides(machine, axes, **how):
        return [
            tuple(first_flank(machine.axes[name], one) for name in axes)
            for one in scenarios(machine, axes, **how)
            if one.beta == one.gain == 1.0 and one.spread == 0.0 and one.pickup in {None, "standstill"}
        ]

    drives = machine("mill", initial_flank="unknown")
    assert sorted(sides(drives, ("X", "Y", "Z"))) == sorted(product((1, -1), repeat=3))
    assert sorted(sides(drives, ("X", "Y"))) == sorted(product((1, -1), repeat=2))
    assert sorted(one[2] for one in sides(drives, ("X", "Y", "Z"), resting=("Z",))) == [-1, 1]
    assert sorted(sides(read_machine("mill"), ("X", "Z"))) == [(-1, -1), (1, -1)]


def test_scenarios_leave_alone_what_the_file_says():
    known = scenarios(machine("mill", initial_flank="-", pickup="contact"), ("X", "Y"))
    assert {(one.pickup, one.flank) for one in known} == {(None, None)}
    assert len(known) == 7
    moving = scenarios(machine("mill", pickup="contact"), ("X", "Y"), resting=())
    assert {one.flank for one in moving} == {None}
    # Outside the loop beta and C change nothing, and without a gap nothing does but they.
    assert {(one.beta, one.gain) for one in scenarios(machine("router"), ("X", "Y"))} == {(1.0, 1.0)}
    assert scenarios(machine("router", lost_motion=0.0), ("X", "Y")) == (Scenario(flank="+"),)


def test_the_backlash_of_each_axis_is_off_by_its_own_uncertainty():
    # router.toml: 0.3 on X and Y, and the default 0.2 on Z.
    axes = machine("router").axes
    tried = scenarios(machine("router"), ("X", "Z"))
    factors = {tuple(round(plant_of(axes[n], one).gap / axes[n].gap.lost_motion, 9) for n in "XZ") for one in tried}
    assert factors == {(1.0, 1.0), (1.3, 1.2), (0.7, 0.8)}
    tried = scenarios(machine("router"), ("Z",))
    assert {round(plant_of(axes["Z"], one).gap / axes["Z"].gap.lost_motion, 9) for one in tried} == {1.0, 1.2, 0.8}


def test_friction_is_tried_larger_and_smaller_on_axes_that_have_some():
    tried = scenarios(read_machine("old_mill"), ("X", "Y"))
    assert len(tried) == 48 + 6
    assert {one.friction for one in tried} == {1.0, 0.8, 1.2}
    assert {one.pickup for one in tried if one.friction == 1.2} == set(PICKUPS)
    assert [scenario_words(one) for one in tried[-1:]] == ["pick-up contact, starts on the + side, friction × 0.8"]
    # 0.04 mm of Coulomb friction on X; the load of Z is its weight, and no friction.
    less = Scenario(friction=0.5)
    axes = read_machine("old_mill").axes
    assert plant_of(axes["X"], less).coulomb_plus == pytest.approx(0.02e-3)
    assert plant_of(axes["Z"], less).load == plant_of(axes["Z"], Scenario()).load == pytest.approx(0.04e-3)


def command_at(t, position):
    """Return a command of X alone."""
    still, none = np.zeros(t.size), np.zeros(t.size, dtype=np.int64)
    return Command(
        axes=("X",), period=1e-3, t=t, segment=none, xi=still, s=still, position=position, feed=still, window=none
    )


def test_tables_run_on_where_motors_brake_harder_than_friction():
    """The table behind the motor that was simulated is where one between stiff stops is, of the test's own."""
    machine = read_machine("router")
    brakes = 0.25 * machine.axes["X"].limits.acceleration
    error = {"following_error_mm": 1e3 * machine.axes["X"].servo.b * brakes}
    axis = replace(machine.axes["X"], effects=(EffectSetting(name="coulomb_friction", parameters=error),))
    machine = replace(machine, axes={"X": axis})
    tried = [one for one in scenarios(machine, ("X",)) if one.runs_on is not None]
    assert [one.runs_on for one in tried] == [0.8, 2.0]
    assert scenario_words(tried[0]).endswith("the table runs on in its backlash")
    t = 1e-3 * np.arange(3000)
    place = (8e-3 * np.sin(9.0 * t) * np.minimum(t / 0.3, 1.0))[:, None]
    command = command_at(t, place)
    gap, stays = axis.gap.lost_motion, simulate(command, machine, Scenario()).executed[:, 0]
    for one in tried:
        run = simulate(command, machine, one)
        expected = pushed(run.motor[:, 0], gap, brakes * one.runs_on)
        # The stops give back a part of each impact: for a moment behind it they differ by up to a tenth of the gap.
        assert np.quantile(np.abs(run.executed[:, 0] - expected), 0.95) < 0.02 * gap
        assert np.abs(stays - expected).max() > 0.3 * gap
    enough = replace(axis, limits=replace(axis.limits, acceleration=0.9 * brakes))
    assert all(one.runs_on is None for one in scenarios(replace(machine, axes={"X": enough}), ("X",)))


def test_an_axis_that_moves_at_first_knows_its_flank():
    _, _, command = job("circle", "paper", strategy="none", start="moving")
    # The circle starts at (250, 0): X turns there, but was moving up before the seam, as Y is.
    assert resting_axes(command) == ()
    assert command.flanks["X"] == 1
    # Without a loop there is no motion before.
    assert resting_axes(replace(command, flanks={})) == ("X",)
    _, _, command = job("circle", "paper", strategy="none")
    assert resting_axes(command) == ("X", "Y")


def test_before_is_the_plain_program():
    analysis, plan, _ = job("oval", "mill", strategy="suppress", inverse_dynamics=True)
    _, plain, command = job("oval", "mill", strategy="none")
    before, after = before_and_after(analysis, plan)
    alone = assess(command, plain.machine, Nominal(analysis.track))
    assert before.error == alone.error
    assert after.error.rms < before.error.rms


def test_in_space_an_error_has_a_size_and_no_side():
    analysis, plan, command = job("spatial", "mill", strategy="none")
    case = [Scenario(pickup="standstill", flank="+")]
    found = assess(command, plan.machine, Nominal(analysis.track), analysis.turning_points, case)
    bare = assess(command, machine("mill", lost_motion=0.0), Nominal(analysis.track), (), case)
    s = np.linspace(0.0, analysis.track.length, 400_001)
    points = analysis.track.derivatives(*analysis.track.locate(s))[0]
    tree = cKDTree(points)
    away = [one.run.executed - points[tree.query(one.run.executed)[1]] for one in (found, bare)]
    size = np.linalg.norm(away[0], axis=1)[found.first :]
    # 70 mm in 400000 points: 0.09 µm along the path to the next one.
    assert found.error.max == pytest.approx(size.max(), abs=1e-9)
    assert all(one.extreme >= 0 for one in found.turning)
    added = np.linalg.norm(away[0] - away[1], axis=1)[found.first :]
    assert found.error_gap.max == pytest.approx(added.max(), abs=3e-7)
    assert found.error_gap.max < 2e-5
