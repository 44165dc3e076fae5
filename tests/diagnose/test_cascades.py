"""What is missing from a file with a cascade is found in records of cascades that the tests step."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.signal import lfilter

from ph_post.diagnose.diagnose import diagnose
from ph_post.diagnose.hypotheses.drives import SATURATION
from ph_post.identify.free_run import predict, problem_of, residuals
from ph_post.identify.log_quality import examine
from ph_post.simulate.machine import AxisCommand, run_plant
from ph_post.types import AxisLog, Gap, Log, Machine
from ph_post.types.diagnosis import Diagnosis
from tests.support.cascade_plant import DRIVES, PERIOD, Drive, motor_of, play, to_and_fro, two_bodies
from tests.support.cascade_records import ALIKE, NOISE, log_of, machine_of, moves, record, solved
from tests.support.plants.axis import Hidden
from tests.support.plants.axis import Plant as PlantOfTests
from tests.support.plants.loops import follow
from tests.support.plants.tracks import Track

pytestmark = pytest.mark.drawn(4)

KNOWN = Drive(tn=12e-3, velocity=0.95)
SHORT = ((0.02, 0.4), (0.004, 0.15), (0.01, 0.25))
ETA, BETA = 0.4, 3.0


def named(found: Diagnosis) -> dict[str, float]:
    return {one.name: next(iter(one.parameters.values())).value for one in found.findings}


def test_nothing_is_invented() -> None:
    found = diagnose(record(KNOWN, ways=SHORT), machine_of(KNOWN))
    assert found.verdict == "nothing-missing"


def test_hidden_gap() -> None:
    found = diagnose(record(KNOWN, gap=2e-5, channels="act", ways=SHORT), machine_of(KNOWN))
    assert named(found) == {"backlash": pytest.approx(0.020, rel=0.01)}
    assert found.steps[-1].holdout_rms < 1.5 * NOISE
    assert found.machine.axes["X"].servo.cascade is not None


def friction() -> Log:
    return record(KNOWN, coulomb=0.05)


def friction_and_gap() -> Log:
    return record(KNOWN, gap=2e-5, coulomb=0.05)


def feed_forward() -> Log:
    return record(Drive(tn=12e-3, velocity=0.7))


def command_filter() -> Log:
    return record(KNOWN, average=8)


def test_a_file_of_another_structure_is_said_and_nothing_is_made_of_it_but_what_both_sides_show() -> None:
    machine = machine_of(KNOWN)
    axis = machine.axes["X"]
    single = replace(machine, axes={"X": replace(axis, servo=replace(axis.servo, cascade=None))})
    found = diagnose(record(KNOWN, gap=2e-5, ways=SHORT), single)
    assert named(found) == {"backlash": pytest.approx(0.020, rel=0.01)}
    assert "earlier than the single loop of the file" in found.notes[0]
    assert "ph-post identify finds" in found.notes[0]


@pytest.mark.slow
def test_a_cascade_that_feeds_nothing_forward_is_a_single_loop() -> None:
    axis = machine_of(KNOWN).axes["X"]
    single = replace(machine_of(KNOWN), axes={"X": replace(axis, servo=replace(axis.servo, cascade=None))})
    found = diagnose(record(Drive(), gap=2e-5, ways=SHORT), single)
    assert named(found) == {"backlash": pytest.approx(0.020, rel=0.01)}
    assert not any("single loop" in one for one in found.notes)


@pytest.mark.parametrize("gain", [pytest.param(8.0, marks=pytest.mark.slow), 900.0])
def test_a_servo_far_from_the_file_is_named_with_what_it_hides(gain: float) -> None:
    """In one search beside the servo that the log shows, and not in one of every name beside the file's."""
    log = record(KNOWN, gap=2e-5, coulomb=0.05)
    found = diagnose(log, machine_of(dataclasses.replace(KNOWN, kv=gain, wv=max(KNOWN.wv, 5.0 * gain))))
    servo = next(one for one in found.findings if one.name == "servo_mismatch")
    values = {name: one.value for name, one in servo.parameters.items()}
    assert values["position_gain"] == pytest.approx(KNOWN.kv, rel=0.02)
    assert values["velocity_gain"] == pytest.approx(KNOWN.wv, rel=0.03)
    others = {name: size for name, size in named(found).items() if name != "servo_mismatch"}
    friction = 1e3 * 0.05 / (KNOWN.kv * KNOWN.wv)
    assert others == {"backlash": pytest.approx(0.020, rel=0.01), "coulomb_friction": pytest.approx(friction, rel=0.05)}
    assert found.steps[-1].holdout_rms < 1.5 * NOISE
    assert f"K_v is about 40 1/s by the log, {gain:g} by the file" in found.notes[0]


@pytest.mark.slow
def test_a_long_filter_is_not_taken_for_a_slow_servo() -> None:
    """From afar it looks like one."""
    found = diagnose(record(KNOWN, gap=2e-5, average=30), machine_of(KNOWN))
    assert named(found) == {"command_filter": pytest.approx(30.0, rel=0.01), "backlash": pytest.approx(0.02, rel=0.01)}


@pytest.mark.slow
def test_where_noise_alone_is_not_left_beside_another_servo_nothing_is_named_but_the_gap_of_both_sides() -> None:
    """The motor shakes at 31 Hz and takes the table along, which no name explains."""
    command = moves()
    t = PERIOD * np.arange(command.size)
    motor = motor_of(KNOWN, command, 0.0, fine=40)
    motor = motor + 4e-6 * np.sin(2.0 * np.pi * 31.0 * t) * (1.0 + np.sin(3.0 * t))
    shaken = log_of(command, {"motor": motor, "act": play(motor, 2e-5)}, 1)
    found = diagnose(shaken, machine_of(dataclasses.replace(KNOWN, kv=900.0, wv=4500.0)))
    assert named(found) == {"backlash": pytest.approx(0.020, rel=0.02)}
    assert "K_v is about 4" in found.notes[0]
    assert "run ph-post identify on this log without a file first" in found.notes[0]


@pytest.mark.slow
@pytest.mark.parametrize(("kv", "tn"), ALIKE)
def test_another_servo_is_the_one_near_the_file_of_two_that_move_alike(kv: float, tn: float) -> None:
    """Of a file that has ω_v = 56 1/s for 140 K_v = 36.84 ± 0.01 was said, where the file and the drive have 18.9."""
    log = solved(Drive(kv=kv, wv=140.0, tn=tn, velocity=1.0), 2e-5)
    found = diagnose(log, machine_of(Drive(kv=kv, wv=56.0, tn=tn, velocity=1.0), 2e-5))
    assert [one.name for one in found.findings] == ["servo_mismatch"]
    numbers = found.findings[0].parameters
    assert numbers["velocity_gain"].value == pytest.approx(140.0, rel=0.01)
    assert numbers["position_gain"].value == pytest.approx(kv, rel=0.01)
    assert numbers["velocity_integral_time"].value == pytest.approx(1e3 * tn, rel=0.01)


OTHERS: list[tuple[Callable[[], Log], dict[str, float]]] = [
    (friction, {"coulomb_friction": 1e3 * 0.05 / (KNOWN.kv * KNOWN.wv)}),
    (friction_and_gap, {"backlash": 0.020, "coulomb_friction": 1e3 * 0.05 / (KNOWN.kv * KNOWN.wv)}),
    (feed_forward, {"servo_mismatch": 70.0}),
    (command_filter, {"command_filter": 8.0}),
]


@pytest.mark.slow
@pytest.mark.parametrize(("hidden", "expected"), OTHERS)
@pytest.mark.thinned(4)
def test_hidden_effects(hidden: Callable[[], Log], expected: dict[str, float]) -> None:
    found = diagnose(hidden(), machine_of(KNOWN))
    assert found.verdict == "named"
    assert named(found) == {name: pytest.approx(size, rel=0.02) for name, size in expected.items()}
    assert found.steps[-1].holdout_rms < 1.5 * NOISE


@pytest.mark.slow
def test_an_integral_time_that_the_file_lacks() -> None:
    """As of a file made from the gains of LinuxCNC's `pid`, which knows nothing of the drive behind it."""
    found = diagnose(record(KNOWN, gap=2e-5), machine_of(dataclasses.replace(KNOWN, tn=math.inf, wv=100.0)))
    servo, backlash = sorted(found.findings, key=lambda one: one.name, reverse=True)
    assert (servo.name, backlash.name) == ("servo_mismatch", "backlash")
    values = {name: one.value for name, one in servo.parameters.items()}
    assert values["velocity_integral_time"] == pytest.approx(12.0, rel=0.02)
    assert values["velocity_gain"] == pytest.approx(KNOWN.wv, rel=0.02)
    assert backlash.parameters["lost_motion"].value == pytest.approx(0.020, rel=0.01)
    assert found.steps[-1].holdout_rms < 1.5 * NOISE


def test_the_other_kind_of_filter_is_said_where_it_explains_the_log_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    """An exponential filter of 2 ms, in noise in which a moving average of twice that looks the same."""
    monkeypatch.setattr("tests.support.cascade_records.NOISE", 1e-6)
    command, time = moves(SHORT), 2.0
    kept = math.exp(-1.0 / time)
    straight = [1.0 - time * (1.0 - kept), time * (1.0 - kept) - kept]
    filtered = command[0] + lfilter(straight, [1.0, -kept], command - command[0])
    found = diagnose(log_of(command, {"motor": motor_of(KNOWN, filtered, 0.0, fine=40)}, 1), machine_of(KNOWN))
    (name,) = found.findings
    assert name.name == "command_filter"
    (kind,) = name.parameters
    other = {"moving_average": "exponential filter = 2 ms", "exponential_filter": "moving average = 4 ms"}[kind]
    assert f"{other} in its place explains the log as well" in name.evidence


def test_a_filter_too_short_for_the_rows_is_said_with_the_rows_that_would_tell() -> None:
    """An average of 1 ms; one of 2.4 ms is told at 1,000 rows a second, a delay of half of it at 1.4 times that."""
    found = diagnose(record(KNOWN, average=1, channels="motor", ways=SHORT), machine_of(KNOWN))
    (name,) = found.findings
    assert found.verdict == "ambiguous"
    assert {name.name, *name.ambiguous_with} >= {"command_filter", "transport_delay"}
    (said,) = (one for one in name.evidence if "rows a second" in one)
    assert said.startswith("1,000 rows a second do not tell a filter and a delay apart")
    needed = float(said.split(": ")[1].split()[0].replace(",", ""))
    assert 0.9 * 2400.0 < needed < 1.3 * 1.4 * 2400.0


@pytest.mark.parametrize("every", [4, 10])
def test_what_a_force_shows_between_far_rows_counts_as_noise(every: int) -> None:
    """What is left of it by the true model is no more than that, and not a small part of it."""
    drive = Drive(kv=80.0, wv=430.0, tn=8e-3)
    track = Track().rest(0.3).move((0.01, 0.0), 0.05, 1.0).rest(0.2).move((-0.02, 0.0), 0.1, 1.0).rest(0.2)
    moved = follow(PlantOfTests("motor", 1.0 / (drive.kv * drive.wv), 1.0 / drive.kv, drive=drive), track)
    rows = np.s_[::every]
    axis = AxisLog(
        command=moved.command[rows], motor=moved.motor[rows], effort=1e6 * moved.drive[rows], effort_unit="N"
    )
    log = Log(name="far", t=moved.t[rows], period=every * PERIOD, axes={"X": axis})
    problem = problem_of(log, "X", machine_of(drive).axes["X"], examine(log, machine_of(drive)))
    assert problem is not None
    left = float(np.sqrt(np.mean(residuals(problem, problem.plant)["force"] ** 2)))
    assert 0.5 * left < problem.channel("force").noise < 10.0 * left


def test_torque_limits_are_tried_where_the_loops_ask_for_most() -> None:
    """By what the loops ask for: a cascade that is fed forward has hardly any following error."""
    hidden, limit = dataclasses.replace(KNOWN, limit=1.9), 1.9 / (KNOWN.kv * KNOWN.wv)
    log, machine = record(hidden, channels="motor", ways=SHORT), machine_of(KNOWN)
    problem = problem_of(log, "X", machine.axes["X"], examine(log, machine))
    assert problem is not None
    assert min(abs(start[0] / limit - 1.0) for start in SATURATION.starts(problem, {})) < 0.02


def in_the_loop(machine: Machine, gap: float) -> Machine:
    axis = machine.axes["X"]
    servo = replace(axis.servo, c=axis.servo.c + ETA * BETA * axis.servo.b)
    gapped = Gap(lost_motion=gap, inertia_fraction=ETA, beta=BETA, pickup="standstill")
    return replace(machine, axes={"X": replace(axis, feedback="load", servo=servo, gap=gapped)})


@pytest.mark.slow
@pytest.mark.parametrize("side", ["motor", "load"])
@pytest.mark.thinned(4)
def test_gap_in_the_loop(side: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.support.cascade_plant.FINE", 25)
    command = moves()
    table = two_bodies(KNOWN, command, 3e-5, ETA, BETA, ETA * BETA, "standstill", side)
    for filed, expected in ((3e-5, {}), (0.0, {"backlash": pytest.approx(0.030, rel=0.02)})):
        machine = in_the_loop(machine_of(KNOWN, velocity_feedback=side), filed)
        assert named(diagnose(log_of(command, {"act": table}, 1), machine)) == expected


@pytest.mark.parametrize("name", ["70 %", "100 %", "of LinuxCNC"])
def test_torque_of_a_motion(name: str) -> None:
    """Without friction it is the acceleration, by b."""
    drive, given = DRIVES[name], np.empty(to_and_fro().size)
    motor = run_plant(AxisCommand(to_and_fro(), 0.0, 0.0), drive.plant(), 1, PERIOD, given)[1]
    acceleration = np.gradient(np.gradient(motor, PERIOD), PERIOD) / (drive.kv * drive.wv)
    rms = np.sqrt(np.mean((given - acceleration)[50:-50] ** 2))
    assert rms < 0.03 * np.sqrt(np.mean(acceleration[50:-50] ** 2))


@pytest.mark.parametrize("tn", [8e-3, math.inf])
def test_a_constant_load_shows_in_the_torque(tn: float) -> None:
    drive, load = Drive(kv=80.0, wv=430.0, tn=tn), 2e-5
    b, track = 1.0 / (drive.kv * drive.wv), Track().rest(0.3).move((0.01, 0.0), 0.05, 1.0).rest(0.2)
    hidden = Hidden("load_offset", {"force": load})
    moved = follow(PlantOfTests("motor", b, 1.0 / drive.kv, effects=(hidden,), drive=drive), track)
    axis = AxisLog(command=moved.command, motor=moved.motor, effort=1e6 * moved.drive, effort_unit="N")
    log, machine = Log(name="load", t=moved.t, period=PERIOD, axes={"X": axis}), machine_of(drive)
    problem = problem_of(log, "X", machine.axes["X"], examine(log, machine))
    assert problem is not None
    shown = predict(problem, replace(problem.plant, load=load))["force"][:, 0]
    assert np.max(np.abs(shown - moved.drive)[200:]) < 1e-6


@pytest.mark.parametrize("current", [0.0, 2e-4])
def test_torque_where_a_motor_is_picked_up(current: float) -> None:
    """Its speed jumps, and what the loops give with it."""
    drive = Drive(kv=80.0, wv=430.0, tn=8e-3, velocity=0.7, current=current)
    b, track = 1.0 / (drive.kv * drive.wv), Track().rest(0.1).move((0.02, 0.0), 0.05, 1.0).rest(0.2)
    track.move((-0.02, 0.0), 0.05, 1.0).rest(0.2)
    hidden = PlantOfTests("load", b, 1.0 / drive.kv + 0.85 * b, gap=7e-5, beta=1.7, drive=drive)
    moved = follow(hidden, track)
    plant, given = drive.plant("load", gap=7e-5, eta=hidden.eta, beta=1.7, damping=0.85 * b), np.empty(moved.t.size)
    run_plant(AxisCommand(moved.command, 0.0, 0.0), plant, hidden.flank, PERIOD, given)
    off = np.abs(given - moved.drive)
    assert moved.times("pickup")
    assert np.count_nonzero(off > 1e-6) <= len(moved.times("pickup"))
    assert np.median(off) < 1e-9
