"""Records of cascades, stepped by the tests, whose structure and gains are to be identified."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.cascade_plant import PERIOD, Drive, motor_of, play

from ph_post.cli.main import main
from ph_post.drive.machinefile import read_machine
from ph_post.identify.identify import identify
from ph_post.types import Array, AxisLog, Log
from tests.support.identifying import Recorder, to_and_fro
from tests.support.plants.axis import Plant

NOISE = 1e-7


def moves() -> Array:
    """Several ways there and back, of another length and duration each."""
    t, begin = PERIOD * np.arange(5200), 0.3
    found = np.zeros(t.size)
    for way, lasts in ((0.02, 0.5), (0.03, 0.8), (0.004, 0.15), (0.01, 0.25), (0.002, 0.12)):
        for sense, pace in ((1.0, 1.0), (-1.0, 0.8)):
            u = np.clip((t - begin) / (pace * lasts), 0.0, 1.0)
            found += sense * way * u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
            begin += pace * lasts + 0.12
    assert begin < t[-1]
    return np.asarray(found)


def record(drive: Drive, gap: float, channels: str, seed: int = 1) -> Log:
    command, rng = moves(), np.random.default_rng(seed)
    motor = motor_of(drive, command, fine=40)
    read = {"motor": motor, "act": play(motor, gap)}
    noisy = {name: true + NOISE * rng.standard_normal(true.size) for name, true in read.items() if name in channels}
    axis = AxisLog(command=command, table=noisy.get("act"), motor=noisy.get("motor"), side="table")
    return Log(name="cascade", t=PERIOD * np.arange(command.size), period=PERIOD, axes={"X": axis})


CASES = [
    (0.0, 0.0, "motor"),
    (0.7, 2e-5, "motor act"),
    (0.95, 0.0, "motor"),
    (0.95, 2e-5, "act"),
    (1.0, 2e-5, "motor act"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("weight", "gap", "channels"), CASES)
def test_structure_gains_and_gap(weight: float, gap: float, channels: str) -> None:
    """What a free run leaves is the noise, though steps of the reference are 25 µs long."""
    drive = Drive(tn=12e-3, velocity=weight)
    found = identify(record(drive, gap, channels), feedback={"X": "motor"})
    axis, shown = found.machine.axes["X"], found.drives["X"]
    assert axis.servo.cascade is not None
    assert shown.rms < 2.0 * NOISE
    assert shown.parameters["velocity_feedforward"].value == pytest.approx(100.0 * weight, abs=3.0)
    assert axis.servo.cascade.velocity_gain == pytest.approx(250.0, rel=0.05)
    if weight < 1.0:
        assert axis.servo.cascade.position_gain == pytest.approx(40.0, rel=0.05)
    if "act" in channels:
        assert axis.gap.lost_motion == pytest.approx(gap, rel=0.05)


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
    assert main(["diagnose", str(file), "-m", str(better)]) == 2
    assert "diagnose knows no cascades yet" in capsys.readouterr().err


def test_a_single_loop_stays_one() -> None:
    """With its gap in the loop, and read on the table alone."""
    recorder = Recorder(channels=("act",), rng=np.random.default_rng(3))
    plant = Plant("load", b=2e-4, c=2e-2, gap=3e-5)
    found = identify(recorder.record(plant, to_and_fro(np.random.default_rng(4))), feedback={"X": "load"})
    assert found.machine.axes["X"].servo.cascade is None
