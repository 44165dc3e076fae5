"""``diagnose`` from a log to a better machine: friction that the machine file lacks is found, and added."""

import json
import math

import numpy as np
import pytest

from ph_post.cli.main import main
from ph_post.drive.machinefile import read_machine

B, C, FRICTION_MM = 2e-4, 0.025, 0.02

MACHINE = f"""\
name = "one axis"  # a person's own remark

[controller]
dialect = "linuxcnc"
servo_period_ms = 1.0

[axes.X]
feedback = "motor"
b = {B}
c = {C}
lost_motion_mm = 0.0
max_velocity_mm_s = 200
max_acceleration_mm_s2 = 5000
max_jerk_mm_s3 = 100000
"""


def command_at(t):
    """Two sines that turn back at many speeds [mm]; at rest at t = 0 but for their acceleration."""
    return 8.0 * (1.0 - np.cos(2.0 * np.pi * 0.4 * t)) + 3.0 * (1.0 - np.cos(2.0 * np.pi * 1.1 * t))


def moved_with_friction(seconds, step=2e-5):
    """Integrate b x'' + c x' + x = X - F sgn(x') [mm] in small steps, sticking where F can hold it."""
    x = v = 0.0
    places = []
    every = round(1e-3 / step)
    commands = command_at(np.arange(round(seconds / step)) * step).tolist()
    for k, command in enumerate(commands):
        if k % every == 0:
            places.append(x)
        push = command - x - C * v
        if v == 0.0 and abs(push) <= FRICTION_MM:
            continue
        friction = math.copysign(FRICTION_MM, v if v != 0.0 else push)
        new = v + step * (push - friction) / B
        v = 0.0 if new * v < 0.0 else new
        x += step * v
    return np.array(places)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Write the machine file, which knows of no friction, and a noisy record of 6 s in steps of 0.1 µm."""
    folder = tmp_path_factory.mktemp("diagnose")
    (folder / "machine.toml").write_text(MACHINE)
    executed = moved_with_friction(6.0)
    t = np.arange(executed.size) * 1e-3
    noise = 3e-4 * np.random.default_rng(11).standard_normal(t.size)
    rows = np.column_stack([t, command_at(t), np.round(executed + noise, 4)])
    np.savetxt(folder / "run.csv", rows, "%.6f", ",", header="t,X_cmd,X_motor", comments="")
    return folder


def test_friction_is_named_added_and_the_gap_falls(files, capsys):
    better, page = files / "better.toml", files / "run.html"
    status = main(
        [
            "diagnose",
            str(files / "run.csv"),
            "-m",
            str(files / "machine.toml"),
            "-o",
            str(better),
            "--html",
            str(page),
            "--json",
        ]
    )
    view = json.loads(capsys.readouterr().out)
    assert status == 0
    assert view["verdict"] == "named"
    (effect,) = view["effects"]
    assert (effect["name"], effect["axis"]) == ("coulomb_friction", "X")
    assert effect["parameters"]["force"]["unit"] == "mm"
    assert effect["parameters"]["force"]["value"] == pytest.approx(FRICTION_MM, rel=0.05)
    first, last = view["gap"]["steps"]
    assert (first["added"], last["added"]) == (None, "coulomb_friction:X")
    assert first["holdout_rms"] > 10.0 * last["holdout_rms"]
    assert last["holdout_rms"] < 1.3 * view["gap"]["noise_floor"]
    # What a person wrote stays, and the machine has what was found.
    assert better.read_text().startswith('name = "one axis"  # a person\'s own remark\n')
    (setting,) = read_machine(better).axes["X"].effects
    assert setting.name == "coulomb_friction"
    assert setting.parameters["following_error_mm"] == pytest.approx(FRICTION_MM, rel=0.05)
    assert "Coulomb friction is missing from X" in page.read_text()


def test_with_the_friction_in_the_file_nothing_is_missing(files, capsys):
    known = files / "known.toml"
    effect = f'[[axes.X.effects]]\nname = "coulomb_friction"\nfollowing_error_mm = {FRICTION_MM}\n'
    known.write_text(MACHINE + effect)
    better = files / "same.toml"
    status = main(["diagnose", str(files / "run.csv"), "-m", str(known), "-o", str(better), "--json"])
    view = json.loads(capsys.readouterr().out)
    assert status == 0
    assert (view["verdict"], view["effects"]) == ("nothing-missing", [])
    assert better.read_bytes() == known.read_bytes()
