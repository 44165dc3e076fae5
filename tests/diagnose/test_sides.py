"""Backlash by both sides of an axis whose servo is another than the file's: a cascade with feed-forward."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.engine_cases import make_axis, make_machine
from support.linear_response import response

from ph_post.diagnose.diagnose import diagnose
from ph_post.diagnose.sides import gap_between
from ph_post.identify.free_run import AxisProblem, problem_of
from ph_post.identify.log_quality import examine
from ph_post.types import AxisLog, Log, Machine
from tests.support.cascade_plant import Drive, motor_of, play, pushed
from tests.support.cascade_records import machine_of, moves

pytestmark = pytest.mark.drawn(4)

Array = NDArray[np.float64]
T = 1e-3 * np.arange(8000)
UM = 1e-6


def cascade(command: Array, lead: float = 0.95) -> Array:
    """P position, PI velocity, velocity feed-forward."""
    gain, speed, rate = 40.0, 250.0, 30.0
    a = [[0.0, 1.0, 0.0], [-speed * gain, -speed, speed * rate], [-gain, -1.0, 0.0]]
    b = [[0.0, 0.0], [speed * gain, speed * lead], [gain, lead]]
    both = np.stack([command, np.gradient(command, 1e-3)], axis=1)
    return response((a, b, [[1.0, 0.0, 0.0]], [[0.0, 0.0]]), both, T)


def friction_held(motor: Array, gap: float) -> Array:
    at, found = motor[0], []
    for place in motor:
        at = np.clip(at, place - 0.5 * gap, place + 0.5 * gap)
        found.append(at)
    return np.array(found)


def logged(gap: float, seed: int = 1, grows: bool = False, friction: float = 0.0) -> tuple[Log, Machine]:
    command = 8e-3 * np.sin(2.0 * np.pi * np.cumsum(0.3 + 1.2 * (T / T[-1]) ** 2) * 1e-3)
    motor = cascade(command)
    noise = 0.15 * UM * np.random.default_rng(seed).standard_normal((2, T.size))
    table = motor - gap * np.gradient(motor, 1e-3) / 0.05 if grows else friction_held(motor, gap)
    if friction:
        table = pushed(motor, gap, friction)
    axes = {"X": AxisLog(command=command, table=table + noise[0], motor=motor + noise[1])}
    machine = make_machine([make_axis("motor", 1e-4, 4.5e-3, 0.0)], 1e-3)
    return Log(name="cascade", t=T, period=1e-3, axes=axes), machine


def problem(log: Log, machine: Machine) -> AxisProblem:
    found = problem_of(log, "X", machine.axes["X"], examine(log, machine))
    assert found is not None
    return found


@pytest.mark.parametrize("gap", [3.0, 20.0, 90.0])
def test_the_gap_is_sized_whatever_the_servo_does(gap: float) -> None:
    found = gap_between(problem(*logged(gap * UM)))
    assert found is not None
    assert found.width == pytest.approx(gap * UM, rel=0.02, abs=0.05 * UM)
    assert found.after < 0.3 * UM


@pytest.mark.parametrize(("gap", "friction"), [(8.0, 0.15), (25.0, 0.06), (12.0, 0.05)])
def test_a_table_on_easy_guideways_runs_on_across_its_gap(gap: float, friction: float) -> None:
    """Between stops 2 F / k farther apart; the motor brakes by up to 0.7 m/s²."""
    log, machine = logged(gap * UM, friction=friction)
    found = gap_between(problem(log, machine))
    assert found is not None
    true = gap * UM + 2.0 * friction / (2.0 * np.pi * 200.0) ** 2
    assert found.width == pytest.approx(true, rel=0.05)
    # The table slides less simply than it is reckoned to: the error knows.
    assert abs(found.width - true) < 2.0 * found.error < 0.05 * true
    assert found.slows == pytest.approx(friction, rel=0.3)


@pytest.mark.slow
def test_the_gap_of_a_table_that_runs_on_is_named_and_the_spring_that_it_resembles_is_not() -> None:
    log, machine = logged(8.0 * UM, friction=0.15)
    found = diagnose(log, machine)
    assert not {"elastic_windup", "coulomb_friction"} & {one.name for one in found.findings}
    backlash = next(one for one in found.findings if one.name == "backlash")
    assert backlash.parameters["lost_motion"].value == pytest.approx(8e-3, rel=0.1)
    assert any(one.startswith("where the motor brakes harder than 1") for one in backlash.evidence)
    # Offsets of a table that friction does not hold would be wrong: the file stays without.
    assert found.machine.axes["X"].gap == machine.axes["X"].gap
    assert any(one.startswith("the backlash of X is not written to the machine file") for one in found.notes)


def test_no_gap_is_found_where_the_sides_differ_by_the_speed_or_by_noise() -> None:
    assert gap_between(problem(*logged(0.0))) is None
    assert gap_between(problem(*logged(20.0 * UM, grows=True))) is None


@pytest.mark.slow
def test_the_error_of_a_gap_read_in_counts_holds_the_truth_in_60_to_75_of_100() -> None:
    """Readings of 2 µm: an axis that rests where it rested before is rounded as it was there."""
    command, count, trials = moves(((0.02, 0.5), (0.004, 0.15), (0.01, 0.25), (0.002, 0.12))), 2.0 * UM, 60
    drive = Drive(tn=12e-3, velocity=0.95)
    motor, held = motor_of(drive, command, fine=20), 0
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        gap, size = (30.0 + rng.uniform(-1.0, 1.0)) * UM, rng.uniform(0.6, 1.4)
        zeros = rng.uniform(0.0, count, 2)
        table, turned = (
            count * np.floor((side + zero) / count)
            for side, zero in zip((play(size * motor, gap), size * motor), zeros, strict=True)
        )
        axis = AxisLog(command=size * command, table=table, motor=turned)
        t = 1e-3 * np.arange(command.size)
        found = gap_between(problem(Log(name="counts", t=t, period=1e-3, axes={"X": axis}), machine_of(drive)))
        assert found is not None
        held += abs(found.width - gap) <= found.error
    assert 0.60 * trials <= held <= 0.75 * trials


@pytest.mark.slow
def test_the_error_of_a_gap_that_a_table_runs_on_across_holds_the_truth_in_60_of_100() -> None:
    """By size and friction at random. What the table does beyond what is reckoned is the same at every trial."""
    off = []
    for seed in range(40):
        rng = np.random.default_rng([seed, 5])
        gap, friction = np.exp(rng.uniform(np.log((8.0, 0.05)), np.log((60.0, 0.35)))).tolist()
        found = gap_between(problem(*logged(gap * UM, seed=seed, friction=friction)))
        assert found is not None
        true = gap * UM + 2.0 * friction / (2.0 * np.pi * 200.0) ** 2
        off.append(abs(found.width - true) / found.error)
    assert sum(one <= 1.0 for one in off) >= 24
    assert max(off) < 2.5


@pytest.mark.slow
def test_a_gap_behind_a_servo_that_the_file_does_not_have_is_named() -> None:
    log, machine = logged(20.0 * UM)
    said = diagnose(log, machine)
    backlash = next(one for one in said.findings if one.name == "backlash")
    assert backlash.parameters["lost_motion"].value == pytest.approx(0.02, rel=0.02)
    assert said.machine.axes["X"].gap.lost_motion == pytest.approx(20.0 * UM, rel=0.02)
