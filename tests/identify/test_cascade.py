"""Records of cascades, stepped by the tests, whose structure and gains are to be identified."""

from __future__ import annotations

import importlib
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from support.cascade_plant import PERIOD, Drive

from ph_post.cli.main import main
from ph_post.drive.machinefile import read_machine
from ph_post.identify.drive_fit import fit_drive
from ph_post.identify.free_run import problem_of
from ph_post.identify.identify import identify
from ph_post.identify.log_quality import examine
from ph_post.types.diagnosis import Estimate
from tests.support.cascade_records import ALIKE, NOISE, WAYS, log_of, machine_of, moves, record, solved
from tests.support.identifying import Recorder, to_and_fro
from tests.support.plants.axis import Plant
from tests.support.plants.score import left_by_identify
from tests.support.plants.sizes import with_effect
from tests.support.plants.trials import Trial

pytestmark = pytest.mark.drawn(4)

CASES = [
    (0.0, 0.0, "motor"),
    (0.7, 2e-5, "motor act"),
    (0.95, 0.0, "motor"),
    (0.95, 2e-5, "act"),
    (1.0, 2e-5, "motor act"),
]


def off(found: Estimate, true: float) -> float:
    """By how many standard errors."""
    assert found.stderr
    return abs(found.value - true) / found.stderr


@pytest.mark.slow
@pytest.mark.parametrize(("weight", "gap", "channels"), CASES)
@pytest.mark.thinned(8)
def test_structure_gains_and_gap(weight: float, gap: float, channels: str) -> None:
    """What a free run leaves is the noise, though steps of the reference are 25 µs long."""
    drive = Drive(tn=12e-3, velocity=weight)
    found = identify(record(drive, gap, channels), feedback={"X": "motor"})
    axis, shown = found.machine.axes["X"], found.drives["X"]
    assert axis.servo.cascade is not None
    assert shown.rms < 1.1 * NOISE
    assert off(shown.parameters["velocity_feedforward"], 100.0 * weight) < 2.5
    assert shown.parameters["velocity_feedforward"].value == pytest.approx(100.0 * weight, abs=3.0)
    assert axis.servo.cascade.velocity_gain == pytest.approx(250.0, rel=0.01)
    assert axis.servo.cascade.position_gain == pytest.approx(40.0, rel=0.01)
    for name, true in (("position_gain", 40.0), ("velocity_gain", 250.0), ("velocity_integral_time", 12.0)):
        assert off(shown.parameters[name], true) < 2.5
    if "act" in channels:
        assert axis.gap.lost_motion == pytest.approx(gap, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 2])
@pytest.mark.thinned(2)
def test_a_position_loop_that_computes_in_steps_seems_to_feed_more_forward(steps: int) -> None:
    """It asks for a speed once a row, at once or a row later: K_v times that is like feed-forward."""
    command, fine, kv, wv, tn = moves(), 40, 40.0, 250.0, 12e-3
    h, place, speed, total, found, asked = PERIOD / fine, 0.0, 0.0, 0.0, [0.0], [0.0, 0.0]
    for k in range(command.size - 1):
        asked.append(kv * (command[k] - place) + (command[k] - command[max(k - 1, 0)]) / PERIOD)
        for _ in range(fine):
            total += h * (asked[-steps] - speed)
            speed += h * wv * (asked[-steps] - speed + total / tn)
            place += h * speed
        found.append(place)
    shown = identify(log_of(command, {"motor": np.array(found)}, 1), feedback={"X": "motor"}).drives["X"]
    late = steps * PERIOD
    assert shown.parameters["dead_time"].value == pytest.approx(1e3 * late, rel=0.05)
    assert shown.parameters["velocity_feedforward"].value == pytest.approx(100.0 * (1.0 + kv * late), abs=0.6)
    assert off(shown.parameters["velocity_feedforward"], 100.0) < 2.0
    words = next(one for one in shown.notes if one.startswith("feed-forward is 10"))
    assert "and 100 % if the position loop is" in words


@pytest.mark.slow
@pytest.mark.parametrize(("weight", "gap", "force"), [(0.7, 2e-5, 0.5), (0.95, 4e-5, 0.3), (0.0, 2e-5, 0.5)])
@pytest.mark.thinned(4)
def test_friction_takes_nothing_from_gains_and_gap(weight: float, gap: float, force: float) -> None:
    """Without friction in the fit K_v came out as 34.6 ± 2, and 20 µm of backlash as 31.8 ± 2.6."""
    drive = Drive(tn=12e-3, velocity=weight)
    found = identify(record(drive, gap, coulomb=force), feedback={"X": "motor"})
    axis, shown = found.machine.axes["X"], found.drives["X"]
    assert axis.servo.cascade is not None
    assert axis.servo.cascade.position_gain == pytest.approx(40.0, rel=0.01)
    assert axis.servo.cascade.velocity_gain == pytest.approx(250.0, rel=0.02)
    assert shown.parameters["velocity_feedforward"].value == pytest.approx(100.0 * weight, abs=3.0)
    assert axis.gap.lost_motion == pytest.approx(gap, rel=0.02)
    assert not axis.effects
    size = f"friction of {1e6 * force / (40.0 * 250.0):.2g} µm of following error"
    assert any(one.startswith(size) for one in shown.notes)
    assert not any("backlash is not identified" in one for one in shown.notes)
    assert shown.rms > 10.0 * NOISE  # of what is written, which has no friction


@pytest.mark.slow
@pytest.mark.parametrize("weight", [0.95, 1.0])
@pytest.mark.thinned(4)
def test_a_current_loop_is_found_or_allowed_for(weight: float) -> None:
    drive = Drive(tn=12e-3, velocity=weight, current=5e-4)
    shown = identify(record(drive), feedback={"X": "motor"}).drives["X"]
    assert shown.rms < 1.1 * NOISE
    assert off(shown.parameters["position_gain"], 40.0) < 2.5
    assert off(shown.parameters["velocity_gain"], 250.0) < 2.5
    if weight == 1.0:
        assert shown.parameters["current_bandwidth"].value == pytest.approx(318.3, rel=0.1)


@pytest.mark.slow
def test_a_velocity_loop_without_integrator() -> None:
    """As LinuxCNC's pid in front of a drive that is given a speed."""
    found = identify(record(Drive(velocity=0.95, wv=400.0), 2e-5), feedback={"X": "motor"})
    cascade = found.machine.axes["X"].servo.cascade
    assert cascade is not None
    assert cascade.integral_rate == 0.0
    assert cascade.position_gain == pytest.approx(40.0, rel=0.01)
    assert cascade.velocity_gain == pytest.approx(400.0, rel=0.02)


def test_a_file_with_a_cascade() -> None:
    """Gains that are off are fitted from the file's; what the log does not show stays."""
    log = record(Drive(tn=12e-3, velocity=0.7), channels="motor", ways=((0.02, 0.4), (0.004, 0.15)))
    found = identify(log, machine_of(Drive(kv=30.0, tn=20e-3, velocity=0.6), gap=3e-5))
    axis = found.machine.axes["X"]
    assert axis.servo.cascade is not None
    assert axis.servo.cascade.position_gain == pytest.approx(40.0, rel=0.01)
    assert axis.servo.cascade.velocity_feedforward == pytest.approx(0.7, abs=0.002)
    assert axis.gap.lost_motion == 3e-5


@pytest.mark.slow
@pytest.mark.parametrize("true", [0, 1])
@pytest.mark.parametrize("filed", [None, 0, 1])
@pytest.mark.thinned(2)
def test_a_gain_that_no_log_tells_from_the_integrator_is_the_files_or_the_smaller_one(
    true: int, filed: int | None
) -> None:
    """The velocity loop gets ω_v (s + K_v) (s + 1/T_n) / s of the following error: 36.8 ± 0.2 was said for 18.9."""
    kv, tn = ALIKE[true]
    log, near = solved(Drive(kv=kv, wv=140.0, tn=tn, velocity=1.0), 2e-5), None
    if filed is not None:
        near = machine_of(Drive(kv=1.1 * ALIKE[filed][0], wv=130.0, tn=0.9 * ALIKE[filed][1], velocity=1.0))
    shown = identify(log, near, feedback=None if near else {"X": "motor"}).drives["X"]
    (kv, tn), (other, slower) = ALIKE[filed or 0], ALIKE[1 - (filed or 0)]
    assert shown.parameters["position_gain"].value == pytest.approx(kv, rel=0.02)
    assert shown.parameters["velocity_integral_time"].value == pytest.approx(1e3 * tn, rel=0.02)
    words = next(one for one in shown.notes if "tells K_v from 1/T_n" in one)
    said = re.match(r"K_v = ([0-9.]+) 1/s with T_n = ([0-9.]+) ms", words)
    assert said is not None
    assert float(said[1]) == pytest.approx(other, rel=0.02)
    assert float(said[2]) == pytest.approx(1e3 * slower, rel=0.02)


@pytest.mark.slow
def test_a_gain_is_told_from_the_integrator_by_what_is_not_fed_forward() -> None:
    for kv, tn in ALIKE:
        shown = identify(solved(Drive(kv=kv, wv=140.0, tn=tn, velocity=0.95), 2e-5), feedback={"X": "motor"}).drives[
            "X"
        ]
        assert shown.parameters["position_gain"].value == pytest.approx(kv, rel=0.02)
        assert not any("tells K_v" in one for one in shown.notes)


@pytest.mark.slow
def test_a_cascade_is_found_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = record(Drive(tn=12e-3, velocity=0.7), 0.0, "motor")
    rows = np.stack([log.t, 1e3 * log.axes["X"].command, 1e3 * log.axes["X"].motor], axis=1)
    file, new = tmp_path / "log.csv", tmp_path / "new.toml"
    np.savetxt(file, rows, fmt=("%.3f", "%.7f", "%.6f"), delimiter=",", header="t,X_cmd,X_motor", comments="")
    assert main(["identify", str(file), "-o", str(new)]) == 0
    capsys.readouterr()
    written = read_machine(new).axes["X"]
    assert written.servo.cascade is not None
    assert written.servo.cascade.velocity_feedforward == pytest.approx(0.7, abs=0.01)
    old, better = tmp_path / "old.toml", tmp_path / "better.toml"
    old.write_text(
        """[controller]
dialect = "linuxcnc"
servo_period_ms = 1.0
[axes.X]
feedback = "motor"  # on the shaft
b = 0.0001
c = 0.0167
lost_motion_mm = 0.0
max_velocity_mm_s = 120
max_acceleration_mm_s2 = 1500
max_jerk_mm_s3 = 40000
"""
    )
    assert main(["identify", str(file), "-m", str(old), "-o", str(better)]) == 0
    again = read_machine(better).axes["X"].servo.cascade
    assert again is not None
    assert again.position_gain == pytest.approx(written.servo.cascade.position_gain, rel=1e-3)
    assert "# on the shaft" in better.read_text()
    assert main(["identify", str(file), "-m", str(better), "-o", str(new)]) == 0
    assert main(["diagnose", str(file), "-m", str(new)]) == 0
    assert "Nothing is missing" in capsys.readouterr().out


def test_a_single_loop_stays_one() -> None:
    """With its gap in the loop, and read on the table alone."""
    recorder = Recorder(channels=("act",), rng=np.random.default_rng(3))
    plant = Plant("load", b=2e-4, c=2e-2, gap=3e-5)
    found = identify(recorder.record(plant, to_and_fro(np.random.default_rng(4))), feedback={"X": "load"})
    assert found.machine.axes["X"].servo.cascade is None


def test_a_single_loop_with_friction_and_backlash_asks_for_no_cascade(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both beside b and c leave noise alone; of a long log a cascade came out, after three quarters of the time."""
    module = importlib.import_module("ph_post.identify.identify")
    monkeypatch.setattr(module, "fit_cascade", lambda _: pytest.fail("a cascade is fitted"))
    recorder = Recorder(channels=("act", "motor"), rng=np.random.default_rng(7))
    plant = with_effect(Plant("motor", b=6.8e-5, c=4.7e-3, gap=3e-5), "coulomb_friction", force=1.2e-5)
    found = identify(recorder.record(plant, to_and_fro(np.random.default_rng(8))), feedback={"X": "motor"})
    servo = found.machine.axes["X"].servo
    assert servo.cascade is None
    assert servo.c == pytest.approx(4.7e-3, rel=0.1)
    assert any(one.startswith("friction of ") for one in found.drives["X"].notes)


def test_an_integrator_is_no_slower_than_a_machine_file_takes() -> None:
    """Where there is none a fit takes T_n ever farther."""
    drive = Drive(velocity=0.95, wv=400.0)
    log, machine = record(drive, ways=WAYS[:2]), machine_of(replace(drive, tn=50.0))
    problem = problem_of(log, "X", machine.axes["X"], examine(log, machine))
    assert problem is not None
    plant = problem.plant
    for _ in range(3):
        plant = fit_drive(problem, plant, ("position_gain", "integral_rate"), rounds=1).plant
    assert plant.cascade is not None
    assert 1.0 / plant.cascade.integral_rate <= 100.0 * (1.0 + 1e-9)


@pytest.mark.slow
def test_a_loop_without_inertia_is_no_quicker_than_a_log_tells() -> None:
    """A first-order lag: nothing holds b up, and the smaller it is, the longer a run of the model takes."""
    recorder = Recorder(channels=("motor",), rng=np.random.default_rng(5))
    still = recorder.record(Plant("motor", b=1e-4, c=2e-2), to_and_fro(np.random.default_rng(6), 1))
    command = still.axes["X"].command
    lag = 4e-3
    motor = lfilter([1.0 - np.exp(-still.period / lag)], [1.0, -np.exp(-still.period / lag)], command)
    log = recorder.log(command, {"motor": motor, "act": motor, "force": 0.0 * motor}, 1.0)
    servo = identify(log, feedback={"X": "motor"}).machine.axes["X"].servo
    assert servo.b / servo.c > 0.04 * log.period  # of a cascade 1/ω_v


@pytest.mark.slow
def test_a_position_of_unknown_side_is_read_behind_the_backlash_of_the_file() -> None:
    """Nothing is missing there; without that backlash 33 times the noise would be left."""
    (left,) = left_by_identify(Trial("nothing", (), ("unknown",), "cascade", 5002).case(None), with_file=True)
    assert left < 1.05
