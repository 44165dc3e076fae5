"""Gains of LinuxCNC's pid as a cascade, beside a pid of the tests' own that commands a drive's speed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.cascade_plant import FINE, PERIOD, accelerations, to_and_fro

from ph_post.cli.interview import GivenAnswer, conduct, machine_answers, settings_of
from ph_post.cli.main import main
from ph_post.drive.effects.active import plant_of
from ph_post.identify.newmachine import NewMachine, new_machine
from ph_post.simulate.machine import AxisCommand, run_plant
from ph_post.types import Array, Scenario

INI = """
[EMCMOT]
SERVO_PERIOD = 1000000
[TRAJ]
COORDINATES = XYZ
LINEAR_UNITS = inch
[JOINT_0]
MAX_VELOCITY = 4
MAX_ACCELERATION = 30
P = 50
D = 0.25
FF1 = 0.95
FF2 = 0.001
DEADBAND = 0.0001
MAX_OUTPUT = 0
[JOINT_1]
MAX_VELOCITY = 4
MAX_ACCELERATION = 30
P = 30
I = 2
[JOINT_2]
MAX_VELOCITY = 40
MAX_ACCELERATION = 30
P = 3
MAX_OUTPUT = 10
"""


def written(path: Path, **given: str) -> tuple[NewMachine, list[str]]:
    known = {key: GivenAnswer(text, key) for key, text in {"loop": "motor", **given}.items()}
    settings = settings_of(str(path))
    made = new_machine(machine_answers(conduct(known, True, settings)))
    return made, list(settings.get("notes", {}).values())


def pid_and_drive(command: Array, bandwidth: float) -> Array:
    """P e + D de/dt + FF1 Ẋ + FF2 Ẍ is the speed that a drive is to have, which it approaches as 1 / bandwidth."""
    place = speed = 0.0
    h, band, found, bends = PERIOD / FINE, 0.0001 * 25.4e-3, [0.0], accelerations(command)
    for k in range(command.size - 1):
        rate = (command[k + 1] - command[k]) / PERIOD
        for j in range(FINE):
            at = (j + 0.5) / FINE
            error = command[k] + at * (command[k + 1] - command[k]) - place
            error -= min(max(error, -band), band)
            bend = bends[k] + at * (bends[k + 1] - bends[k])
            asked = 50.0 * error + 0.25 * (rate - speed) + 0.95 * rate + 0.001 * bend
            speed += h * bandwidth * (asked - speed)
            place += h * speed
        found.append(place)
    return np.array(found)


def test_pid_of_an_ini_file(tmp_path: Path) -> None:
    ini = tmp_path / "mill.ini"
    ini.write_text(INI)
    made, notes = written(ini, velocity_gain="250")
    cascade = made.machine.axes["X"].servo.cascade
    assert cascade is not None
    assert cascade.position_gain == pytest.approx(40.0)
    command = to_and_fro()[:400]
    # D brakes the drive too: its velocity loop, with 200 1/s of its own, is quicker by 1 + D.
    motor = run_plant(AxisCommand(command, 0.0, 0.0), plant_of(made.machine.axes["X"], Scenario()), 1, PERIOD)[1]
    assert np.abs(motor - pid_and_drive(command, 200.0)).max() < 1e-6
    assert np.abs(motor - command).max() > 1e-5
    assert made.machine.axes["Y"].servo.cascade is not None
    assert made.machine.axes["Z"].servo.cascade is None
    assert [note[0] for note in notes] == ["Y", "Z"]


def test_gains_that_hold_no_position_are_left_out_and_said(tmp_path: Path) -> None:
    ini = tmp_path / "mill.ini"
    ini.write_text(INI.partition("[JOINT_1]")[0].replace("P = 50", "P = -50").replace("XYZ", "X"))
    _, notes = written(ini)
    assert notes == ["X: P of its pid is -50, which holds no position: its gains are left out"]


def test_little_is_fed_forward(tmp_path: Path) -> None:
    ini = tmp_path / "mill.ini"
    ini.write_text(INI.replace("FF1 = 0.95", "FF1 = 0.01").replace("D = 0.25", ""))
    cascade = written(ini)[0].machine.axes["X"].servo.cascade
    assert cascade is not None
    assert cascade.velocity_feedforward == pytest.approx(0.01)


def test_pid_of_a_hal_file(tmp_path: Path) -> None:
    hal = tmp_path / "mill.hal"
    hal.write_text("setp pid.x.Pgain 35\nsetp pid.x.FF1 1.0\nsetp pid.1.Pgain 30\nsetp spindle.Pgain 7\n")
    made, notes = written(hal)
    gains = [axis.servo.cascade for axis in made.machine.axes.values()]
    assert [None if one is None else one.position_gain for one in gains] == [35.0, 30.0, None]
    assert not notes
    assert "control.velocity_gain_per_s" in made.assumed["X"]


VELOCITY_TOO = """
setp pid.x.Pgain 35
setp drive.x.Pgain 250
setp drive.x.Igain 9000
setp pid.0.Pgain 20
net x-wanted joint.0.motor-pos-cmd
net x-wanted => pid.x.command
net speed pid.x.output => drive.x.command
net y-wanted joint.1.motor-pos-cmd => pid.0.command
"""


def test_pid_is_that_which_the_joint_commands(tmp_path: Path) -> None:
    hal = tmp_path / "mill.hal"
    hal.write_text(VELOCITY_TOO)
    made, notes = written(hal)
    gains = [axis.servo.cascade for axis in made.machine.axes.values()]
    assert [None if one is None else one.position_gain for one in gains] == [35.0, 20.0, None]
    assert not notes


def test_two_pids_of_one_axis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hal = tmp_path / "mill.hal"
    hal.write_text("setp pid.x.Pgain 35\nsetp drive.x.Pgain 250\n")
    assert main(["machine", "new", "--yes", "--settings", str(hal)]) == 2
    assert capsys.readouterr().err == (
        f"ph-post: {hal}: two pids of X, pid.x and drive.x; expected a net from joint.0.motor-pos-cmd to the command"
        " of one of them\n"
    )


def test_gains_that_stand_elsewhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hal = tmp_path / "mill.hal"
    hal.write_text("setp pid.x.Pgain [JOINT_0]P\n")
    assert main(["machine", "new", "--yes", "--settings", str(hal)]) == 2
    assert capsys.readouterr().err == (
        f"ph-post: {hal}: pid.x.Pgain: the number stands in the INI file; expected that file; got [JOINT_0]P\n"
    )


BAD = {
    "--feedforward 95": (
        "--feedforward: belongs to a cascade, which this machine has not; expected --position-gain as well; got '95'"
    ),
    "--position-gain 40/s --following-error 40/s": (
        "--following-error: the cascade of axis X has one of its own; expected --position-gain alone"
    ),
    "--position-gain 40mm": (
        "--position-gain: not understood; expected a position gain with its unit, such as 10/s from 0.1 to 100000 /s;"
        " got '40mm'"
    ),
    "--position-gain 2.4": "--position-gain: the unit is missing; expected one of /s, 1/s, m/min/mm; got '2.4'",
    "--position-gain 40/s --feedforward 0.95": (
        "--feedforward: a weight or percent?; expected 95% or 0.95%; got '0.95'"
    ),
}


@pytest.mark.parametrize("options", BAD)
def test_bad_gains(options: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["machine", "new", "--yes", "--loop", "motor", *options.split()]) == 2
    assert capsys.readouterr().err == f"ph-post: {BAD[options]}\n"


def test_gains_by_option(capsys: pytest.CaptureFixture[str]) -> None:
    options = "--position-gain 2.4m/min/mm --velocity-gain 40Hz --integral-time 12ms --feedforward 95%"
    assert main(["machine", "new", "--yes", "--loop", "load", "--lost-motion", "0.03", *options.split()]) == 0
    text = capsys.readouterr().out
    for line in ("position_gain_per_s = 40.0", "velocity_gain_per_s = 251.3274", "velocity_feedforward_percent = 95.0"):
        assert f"control.{line}" in text
