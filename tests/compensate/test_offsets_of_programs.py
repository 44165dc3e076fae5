"""Jogs: their motion in closed form, where they are laid, and what they leave of the error on a play."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp

from ph_post.analysis.path_analysis import Analysis, analyse
from ph_post.compensate.comparison import before_and_after
from ph_post.compensate.motion import MotionLaw, cycle_time, without_strategy
from ph_post.compensate.offsets import DWELL, command_of, jog_travel, make_jog
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.violations import check_command
from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.files.path import read_path
from ph_post.files.storage import shipped
from ph_post.geometry.curves import Line
from ph_post.simulate.assess import assess
from ph_post.simulate.contour import Nominal
from ph_post.types import Jog, Path, Plan, Scenario, Segment
from ph_post.units import MM

UM = 1e-6


def written(path: Path, machine: str, strategy: str = "takeup", **options) -> tuple[Analysis, Plan]:
    analysis = analyse(path, read_machine(machine), 5 * UM)
    options = PlanOptions(strategy=strategy, carrier="program", **options)
    return analysis, make_plan(analysis, options)


def zigzag(*points: tuple[float, float]) -> Path:
    corners = np.array(points) * MM
    segments = tuple(Segment(curve=Line(np.array(ends))) for ends in pairwise(corners))
    return Path(name="zigzag", source="a test", axes=("X", "Y"), feed=0.02, closed=False, segments=segments)


@pytest.mark.parametrize(
    ("travel", "velocity", "acceleration"),
    [(60e-6, 1.0, 0.25), (-60e-6, 2e-3, 0.25), (1e-3, 5e-3, 0.5), (-2e-6, 1e-3, 0.5)],
)
def test_a_jog_is_the_integral_of_its_acceleration(travel, velocity, acceleration) -> None:
    jog = Jog(axis="X", start=0.3, travel=travel, velocity=velocity, acceleration=acceleration)
    size = abs(travel)
    peak = min(velocity, np.sqrt(acceleration * size))
    ramp, level = peak / acceleration, (size - peak**2 / acceleration) / peak
    assert jog.duration == pytest.approx(2 * ramp + level, rel=1e-12)
    edges = [0.3, 0.3 + ramp, 0.3 + ramp + level, 0.3 + 2 * ramp + level]
    state = np.array([0.0, 0.0])
    for (t0, t1), rate in zip(pairwise(edges), (1.0, 0.0, -1.0), strict=True):
        if t1 <= t0:
            continue
        inside = np.linspace(t0, t1, 7)
        push = rate * acceleration * np.sign(travel)
        run = solve_ivp(lambda _t, y, a=push: [y[1], a], (t0, t1), state, t_eval=inside, rtol=1e-10, atol=1e-15)
        assert jog_travel(jog, inside) == pytest.approx(run.y[0], abs=1e-9 * size)
        state = run.y[:, -1]
    ends = jog_travel(jog, np.array([0.0, 0.3, jog.end, 9.0]))
    assert ends == pytest.approx([0.0, 0.0, travel, travel], abs=1e-15)


def test_a_jog_takes_half_the_acceleration_and_no_more_velocity_than_there_is() -> None:
    axis = read_machine("stepper").axes["X"]
    quick = make_jog(axis, 60e-6, 1.0)
    assert quick.acceleration == 0.125
    assert quick.velocity == pytest.approx(np.sqrt(0.125 * 60e-6), rel=1e-12)
    assert make_jog(axis, 60e-6, 1.0, feed=1e-3).velocity == 1e-3
    assert make_jog(axis, 0.1, 1.0).velocity == axis.limits.velocity


def behind_play(position: np.ndarray, gap: float) -> np.ndarray:
    """The table of one axis that its motor pushes through a play, and that stays where it is left."""
    table, half = np.empty(position.size), 0.5 * gap
    last = position[0]
    for k, place in enumerate(position):
        last = min(max(last, place - half), place + half)
        table[k] = last
    return table


@pytest.mark.parametrize("flank", [-1, 1])
@pytest.mark.thinned(4)
def test_a_table_behind_a_play_stays_on_the_path(flank) -> None:
    analysis, plan = written(read_path(shipped("paths", "oval")), "stepper")
    track, period = analysis.track, plan.machine.servo_period
    command = command_of(plan, track, period)
    path = track.derivatives(*track.locate(command.s))[0]
    assert check_command(command, plan.machine) == ()
    assert len([jog for jog in plan.crossings if jog.start > 0]) == 4
    begun = command.t > plan.phases[0].duration
    away = begun.copy()
    for jog in plan.crossings:
        away &= (command.t < jog.start) | (command.t > jog.end)
    for number, name in enumerate(command.axes):
        gap = plan.machine.axes[name].gap.lost_motion
        position = command.position[:, number].copy()
        first = position[0] + 0.5 * flank * gap
        table = behind_play(np.concatenate([[first], position]), gap)[1:]
        assert np.abs(table - path[:, number])[away].max() < 1 * UM
        # The command itself is off by half the gap, always, and the plain one would leave the table so.
        assert np.abs(position - path[:, number])[away] == pytest.approx(0.5 * gap, rel=1e-9)


@pytest.mark.slow
def test_the_path_rests_during_jogs_and_dwells() -> None:
    _, plan = written(read_path(shipped("paths", "oval")), "router")
    motion = MotionLaw.from_phases(plan.phases)
    jogs = [jog for jog in plan.crossings if jog.start > 0]
    assert len(jogs) == 4
    for jog in jogs:
        s, feed = motion.place_and_feed(np.linspace(jog.start - DWELL * 0.99, jog.end + DWELL * 0.99, 50))
        assert np.ptp(s) < 1e-12
        assert np.all(feed == 0.0)


@pytest.mark.parametrize("machine", ["stepper", "router"])
@pytest.mark.thinned(4)
def test_the_gain_over_none_of_loops_that_are_not_closed_over_the_table(machine) -> None:
    analysis, plan = written(read_path(shipped("paths", "oval")), machine)
    before, after = before_and_after(analysis, plan)
    # A program cannot lead the path: what the servos lag behind it stays, and is no matter of the gap.
    still = command_of(without_strategy(plan), analysis.track, plan.machine.servo_period)
    lag = assess(still, plan.machine, Nominal(analysis.track), tried=[Scenario(gap=0.0)]).error.max
    assert before.error.max - lag > 40 * (after.error.max - lag)
    assert after.error_worst.max < before.error_worst.max / 3
    approach = plan.phases[0].duration
    assert cycle_time(plan.phases) - approach <= 1.1 * cycle_time(plan.nominal)


@pytest.mark.slow
def test_a_program_for_a_loop_over_the_table_is_never_worse() -> None:
    analysis, plan = written(read_path(shipped("paths", "circle")), "paper", "auto", effort=0.05)
    before, after = before_and_after(analysis, plan)
    assert after.error.max <= before.error.max + 1e-9
    assert after.error_worst.max <= before.error_worst.max + 1e-9
    assert not plan.inverse_dynamics


def test_corners_are_stops_too() -> None:
    analysis, plan = written(zigzag((0, 0), (20, 5), (0, 10), (20, 4)), "stepper")
    jogs = [(jog.axis, round(jog.travel / UM)) for jog in plan.crossings if jog.start > 0]
    # At the second corner both turn back, one after the other.
    assert jogs == [("X", -60), ("X", 60), ("Y", -80)]
    before, after = before_and_after(analysis, plan)
    assert after.error.max < 0.01 * before.error.max


def test_an_axis_that_does_not_stop_at_every_reversal_has_no_offset() -> None:
    oval = read_path(shipped("paths", "oval"))
    _, plan = written(oval, "stepper", max_slowdown=0.01)
    assert plan.crossings == ()
    assert plan.bias == {}
    assert plan.phases == plan.nominal or cycle_time(plan.phases) <= 1.01 * cycle_time(plan.nominal)
    _, plan = written(oval, "stepper", min_feed=1e-3)
    assert plan.crossings == ()


def test_a_gap_too_small_for_a_jog_is_left_alone() -> None:
    machine = read_machine("stepper")
    small = {name: replace(axis, gap=replace(axis.gap, lost_motion=2 * UM)) for name, axis in machine.axes.items()}
    for path in (read_path(shipped("paths", "oval")), zigzag((0, 0), (20, 5), (0, 10))):
        analysis = analyse(path, replace(machine, axes=small), 5 * UM)
        assert make_plan(analysis, PlanOptions(strategy="takeup", carrier="program")).crossings == ()


def test_what_a_program_cannot_carry_is_refused() -> None:
    with pytest.raises(InputError, match="shifts single samples"):
        written(read_path(shipped("paths", "oval")), "stepper", "step")
