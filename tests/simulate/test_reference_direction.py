"""Executed positions against a play operator of their own, touched off from the side that the file names."""

import itertools
import re

import numpy as np
import pytest
from msgspec.structs import replace

from ph_post.analysis.path_analysis import analyse
from ph_post.compensate.offsets import command_of
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.drive.machinefile import machine_of, read_machine
from ph_post.files.storage import shipped, source_of
from ph_post.geometry.curves import Arc
from ph_post.simulate.assess import assess
from ph_post.simulate.contour import Nominal
from ph_post.simulate.machine import simulate
from ph_post.types import Command, EffectSetting, Path, Scenario, Segment, Servo, frozen
from ph_post.units import MM

GAP = 50e-6
SIDES = {"-": [-1], "+": [1], "both": [-1, 1]}
TOUCH = 1.0
"""Way over which a side is touched [m]."""


def play(motor, gap, table):
    """Drag a table along, from where it stands, by a motor that has `gap` between two flanks."""
    places = []
    for place in motor:
        table = min(max(table, place - 0.5 * gap), place + 0.5 * gap)
        places.append(table)
    return np.array(places)


def read_off(motor, gap, table, said):
    """Places of a table behind a play, from a zero that was taken in the directions named."""
    touched = [play([-direction * TOUCH, 0.0], gap, 0.0)[-1] for direction in SIDES[said]]
    return play(motor, gap, table) - sum(touched) / len(touched)


def stepper(said, **more):
    """An ideal stepper of three equal axes that are touched off as said."""
    machine = read_machine("stepper")
    own = machine.axes["X"]
    axis = replace(own, servo=Servo(b=0.0, c=0.0), gap=own.gap.with_lost_motion(GAP), reference_direction=said, **more)
    return replace(machine, axes={name: replace(axis, name=name) for name in "XYZ"})


def command_along(position, axes=("Z",), period=1e-3):
    rows = np.asarray(position, dtype=np.float64).reshape(len(position), -1)
    count = np.arange(len(rows))
    zero = np.zeros(len(rows), dtype=np.int64)
    return Command(
        axes=axes,
        period=period,
        t=frozen(count * period),
        segment=zero,
        xi=frozen(count * 0.0),
        s=frozen(np.append(0.0, np.cumsum(np.linalg.norm(np.diff(rows, axis=0), axis=1)))),
        position=frozen(rows),
        feed=frozen(count * 0.0),
        window=zero,
    )


def wander(seed):
    """A motion that turns back at random places, near and far, and rests between."""
    random = np.random.default_rng(seed)
    ends = np.cumsum(random.normal(0.0, 1.0, 40) * random.choice([0.1, 1.0, 10.0], 40)) * GAP
    return np.interp(np.arange(0, 40, 0.05), np.arange(40), ends)


@pytest.mark.parametrize("flank", ["+", "-"])
@pytest.mark.parametrize("factor", [0.8, 1.0, 1.2])
@pytest.mark.parametrize("said", SIDES)
@pytest.mark.parametrize("seed", range(3))
def test_a_stepper_is_referred_to_the_side_where_its_zero_was_taken(seed, said, factor, flank):
    motor = wander(seed)
    run = simulate(command_along(motor), stepper(said), Scenario(gap=factor, flank=flank))
    begins = motor[0] - 0.5 * factor * GAP * (1 if flank == "+" else -1)
    wanted = read_off(motor, factor * GAP, begins, said)
    np.testing.assert_allclose(run.executed[:, 0], wanted, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("said", SIDES)
def test_a_servo_with_its_encoder_on_the_motor_is_too(said):
    machine = read_machine("router")
    axis = replace(machine.axes["Z"], reference_direction=said)
    slow = 10.0 * GAP * np.cumsum(np.sin(np.cumsum(np.sin(np.arange(4000) / 150.0)) / 60.0)) / 40.0
    run = simulate(command_along(slow), replace(machine, axes={"Z": axis}), Scenario(flank="-"))
    motor, gap = run.motor[:, 0], axis.gap.lost_motion
    wanted = read_off(motor, gap, motor[0] + 0.5 * gap, said)
    # Between two samples the motor turns back a little beyond both of them.
    np.testing.assert_allclose(run.executed[:, 0], wanted, rtol=0.0, atol=2e-8)


@pytest.mark.parametrize("said", SIDES)
def test_a_scale_on_the_table_knows_no_side(said):
    machine = read_machine("mill")
    runs = [
        simulate(command_along(wander(2)), replace(machine, axes={"Z": one}))
        for one in (machine.axes["Z"], replace(machine.axes["Z"], reference_direction=said))
    ]
    np.testing.assert_array_equal(runs[0].executed, runs[1].executed)


@pytest.mark.parametrize(("said", "exact"), [("-", -1), ("+", 1)])
def test_the_plain_motion_is_exact_on_that_side_wherever_the_screw_is_worn(said, exact):
    worn = EffectSetting(name="position_dependent_backlash", parameters={"slope_mm_per_mm": 0.002, "reference_mm": 0.0})
    motor = 0.02 * np.sin(np.linspace(0.0, 4.0 * np.pi, 2001))
    run = simulate(command_along(motor), stepper(said, effects=(worn,)))
    place = run.executed[:, 0]
    moves = np.diff(place) != 0.0
    engaged = np.append(False, moves) & np.append(moves, False)
    ways = np.sign(np.gradient(motor))
    before, behind = (engaged & (ways == way) for way in (exact, -exact))
    assert min(before.sum(), behind.sum()) > 500
    np.testing.assert_allclose(place[before], motor[before], rtol=0.0, atol=1e-12)
    # On the other side it is off by the gap where the table is, which the file counts from the gap's middle.
    lag = exact * (place - motor)[behind]
    np.testing.assert_allclose(lag, GAP + 0.002 * (place[behind] - exact * 0.5 * lag), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("name", ["router", "mill", "stepper"])
def test_gravity_leaves_the_axis_on_one_side(name):
    text = shipped("machines", name).read_text(encoding="utf-8")
    bare = re.sub(r"(?m)^(\[axes\.Z\][^#\n]*)(#.*)?$", r'\1\ngravity_side = "-"', text)
    machine = machine_of(source_of(bare, "test.toml", "test"))
    position = wander(4)
    for scenario in (Scenario(), Scenario(gap=1.2, flank="-")):
        run = simulate(command_along(position), machine, scenario)
        np.testing.assert_array_equal(run.executed, run.motor)
        assert not any(event.kind == "opens" for event in run.events)


def test_gravity_closes_a_worn_gap_too():
    worn = EffectSetting(name="position_dependent_backlash", parameters={"slope_mm_per_mm": 0.002, "reference_mm": 0.0})
    machine = stepper("both", effects=(worn,), gravity_side="-")
    run = simulate(command_along(wander(5)), machine)
    np.testing.assert_allclose(run.executed, run.motor, rtol=0.0, atol=1e-15)


def waves(feed=0.01):
    """Three half circles in the plane of X and Z, up and down."""
    ends = np.array([[0, 0], [8, 0], [16, 0], [24, 0]]) * MM
    turns = itertools.cycle(["cw", "ccw"])
    curves = [Arc(a, b, 0.5 * (a + b), turn) for a, b, turn in zip(ends, ends[1:], turns, strict=False)]
    segments = tuple(Segment(curve=curve) for curve in curves)
    return Path(name="waves", source="a test", axes=("X", "Z"), feed=feed, closed=False, segments=segments)


def distances(points):
    """Distance of points from the half circles."""
    found = np.full(len(points), np.inf)
    for centre, up in ((4e-3, 1), (12e-3, -1), (20e-3, 1)):
        away = points - [centre, 0.0]
        own = away[:, 1] * up >= -1e-4
        found = np.where(own, np.minimum(found, np.abs(np.linalg.norm(away, axis=1) - 4e-3)), found)
    return found


def with_still_x(said):
    """A stepper whose X has no backlash."""
    machine = stepper(said)
    still = replace(machine.axes["X"], gap=machine.axes["X"].gap.with_lost_motion(0.0))
    return replace(machine, axes={**machine.axes, "X": still})


def planned(said, **options):
    machine = with_still_x(said)
    analysis = analyse(waves(), machine, 5e-6)
    plan = make_plan(analysis, PlanOptions(effort=0.05, max_slowdown=0.5, **options))
    return machine, analysis, command_of(plan, analysis.track, machine.servo_period)


@pytest.mark.parametrize("start", ["rest", "moving"])
@pytest.mark.parametrize("strategy", ["step", "takeup"])
@pytest.mark.parametrize("said", SIDES)
@pytest.mark.thinned(8)
def test_a_table_is_exact_on_both_sides_and_adds_nothing_on_that_of_the_zero(said, strategy, start):
    machine, analysis, command = planned(said, strategy=strategy, start=start)
    first = int(0.5 / machine.servo_period)
    way = np.sign(np.gradient(command.position - command.offset, axis=0))[first:, 1]
    z = command.offset[first:, 1]
    for direction, wanted in zip((-1, 1), {"-": (0, 1), "+": (-1, 0), "both": (-0.5, 0.5)}[said], strict=True):
        assert np.median(z[way == direction]) == pytest.approx(wanted * GAP, abs=1e-12)
    # The backlash as the file has it, and off by a fifth: the whole fifth where the offset is the whole backlash.
    for factor, most in ((1.0, 0.0), (0.8, 0.1), (1.2, 0.1)):
        for side in (1, -1):
            motors = zip(command.position.T, (0.0, factor * GAP), strict=True)
            tables = [read_off(motor, gap, motor[0] - 0.5 * side * gap, said) for motor, gap in motors]
            off = distances(np.stack(tables, axis=1)[first:])
            limit = most * (1 if said == "both" else 2) * GAP
            assert np.quantile(off, 0.9) <= limit + 1e-8
            # A step begins at the reversal and lasts: meanwhile the table stands while the path goes on.
            assert off.max() <= limit + (0.3 * GAP if strategy == "step" else 0.01 * GAP)
    measured = assess(command, machine, Nominal(analysis.track))
    assert measured.error.max < (0.3 if strategy == "step" else 0.01) * GAP
    assert measured.error_worst.max == pytest.approx(
        (0.1 if said == "both" else 0.2) * GAP, abs=(0.3 if strategy == "step" else 0.01) * GAP
    )


@pytest.mark.parametrize("said", ["+", "-"])
def test_the_same_motion_from_another_zero_is_the_same_command_moved_as_a_whole(said):
    _, _, command = planned(said, strategy="step", start="rest")
    _, _, middle = planned("both", strategy="step", start="rest")
    moved = [0.0, -SIDES[said][0] * 0.5 * GAP]
    np.testing.assert_allclose(command.position - middle.position, np.tile(moved, (command.t.size, 1)), atol=1e-15)


@pytest.mark.parametrize("said", ["+", "-"])
def test_the_error_of_the_plain_motion_is_nothing_on_that_side_and_the_whole_gap_on_the_other(said):
    machine = stepper(said)
    down = command_along(np.linspace(0.0, -0.01, 1000), ("Z",))
    up = command_along(np.linspace(0.0, 0.01, 1000), ("Z",))
    for command, way in ((down, -1), (up, 1)):
        lag = command.position[-1, 0] - simulate(command, machine).executed[-1, 0]
        wanted = 0.0 if SIDES[said] == [way] else way * GAP
        assert lag == pytest.approx(wanted, abs=1e-12)
