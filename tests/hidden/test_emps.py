"""A real drive: the Electro-Mechanical Positioning System of Janot, Gautier and Brunot (2019)."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

from ph_post.cli.main import main
from tests.support.measured import EMPS, needs_emps

pytestmark = needs_emps

MACHINE = """
name = "EMPS"
[controller]
dialect = "linuxcnc"
servo_period_ms = 1.0
[axes.X]
feedback = "motor"
b = 6.52e-5
c = 6.536e-3
lost_motion_mm = 0
servo_stiffness_n_per_mm = 1370.7
max_velocity_mm_s = 200
max_acceleration_mm_s2 = 5000
max_jerk_mm_s3 = 100000
"""
"""b and c are those of the linear model that follows the record best."""

SHOWN = 5000
"""Rows of the 24,841 of the record that are enough to show play."""

COMMAND = ("--column", "t=t:s", "--column", "X_cmd=qg:m")
FORCE = ("--column", "X_force=vir*35.15:N")


Run = Callable[[Path, Sequence[str]], dict[str, Any]]


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    machine = tmp_path / "emps.toml"
    machine.write_text(MACHINE, encoding="utf-8")

    def diagnose(record: Path, columns: Sequence[str]) -> dict[str, Any]:
        assert main(["diagnose", str(record), "-m", str(machine), *columns, "--json"]) == 0
        found: dict[str, Any] = json.loads(capsys.readouterr().out)
        return found

    return diagnose


def sizes(found: dict[str, Any]) -> dict[str, float]:
    """Leading parameters by name."""
    return {one["name"]: next(iter(one["parameters"].values()))["value"] for one in found["effects"]}


def test_friction_and_offset_are_named_from_position_and_force(run: Run) -> None:
    found = run(EMPS, [*COMMAND, "--column", "X_motor=qm:m", *FORCE])
    effects = sizes(found)
    assert effects["coulomb_friction"] == pytest.approx(20.4, rel=0.05)
    assert effects["load_offset"] == pytest.approx(-3.17, rel=0.10)
    assert "backlash" not in effects
    steps = found["gap"]["steps"]
    assert steps[0]["holdout_rms"] == pytest.approx(0.0072, rel=0.05)
    assert steps[-1]["holdout_rms"] <= 0.0016


def test_position_alone_of_unknown_side_cannot_tell_friction_from_play(run: Run, tmp_path: Path) -> None:
    data = loadmat(EMPS)
    columns = [data["t"].ravel(), 1e3 * data["qg"].ravel(), 1e3 * data["qm"].ravel()]
    record = tmp_path / "alone.csv"
    np.savetxt(record, np.column_stack(columns)[:SHOWN], "%.6f", ",", header="t,X_cmd,X_act", comments="")
    found = run(record, ["--side", "X=unknown"])
    assert found["verdict"] == "ambiguous"
    first = found["effects"][0]
    assert {"coulomb_friction", "backlash"} <= {first["name"], *first["ambiguous_with"]}


def test_play_behind_the_encoder_is_named_and_sized(run: Run, tmp_path: Path) -> None:
    data = loadmat(EMPS)
    motor, half = data["qm"].ravel(), 15e-6
    table, place = np.empty_like(motor), motor[0]
    for k, reading in enumerate(motor):
        table[k] = place = min(max(place, reading - half), reading + half)
    columns = [data["t"].ravel(), 1e3 * data["qg"].ravel(), 1e3 * table, 35.15 * data["vir"].ravel()]
    record = tmp_path / "play.csv"
    np.savetxt(record, np.column_stack(columns)[:SHOWN], "%.6f", ",", header="t,X_cmd,X_act,X_force", comments="")
    effects = sizes(run(record, []))
    assert effects["backlash"] == pytest.approx(0.030, rel=0.15)
