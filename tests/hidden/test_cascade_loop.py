"""The loop closed on a cascade of the tests' own, with friction and a gap that the file does not have."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
from msgspec.structs import replace

import ph_post as ph
from ph_post.diagnose.diagnose import diagnose
from ph_post.types import Limits, Machine
from tests.hidden.test_loop import CIRCLE, RADIUS
from tests.support.cascade_plant import Drive, motor_of, play
from tests.support.cascade_records import machine_of, record

DRIVE, GAP, FRICTION = Drive(tn=12e-3, velocity=0.95), 4e-5, 0.3
LIMITS = Limits(velocity=0.2, acceleration=2.0, jerk=50.0)
BESIDE = 0.4
"""Time at either end in which the table comes onto its side of the gap, and all begins and ends [s]."""


def with_both_axes(machine: Machine) -> Machine:
    axis = replace(machine.axes["X"], limits=LIMITS)
    return replace(machine, axes={name: replace(axis, name=name) for name in "XY"})


def executed(machine: Machine, folder: Path) -> tuple[float, float]:
    """Largest and rms distance [m] from the circle as the plant executes the table of a machine file."""
    path, table = folder / "circle.json", folder / "circle.csv"
    path.write_text(json.dumps(CIRCLE))
    ph.compensate(ph.read_path(path), machine, output="table").write_table(table)
    rows = list(csv.DictReader(one for one in table.read_text().splitlines() if not one.startswith("#")))
    t = np.array([float(row["t"]) for row in rows])
    places = []
    for name in "XY":
        command = np.array([1e-3 * float(row[name]) for row in rows])
        places.append(command[0] + play(motor_of(DRIVE, command - command[0], FRICTION, fine=20), GAP))
    off = np.abs(np.hypot(*places) - RADIUS)[(t > BESIDE) & (t < t[-1] - BESIDE)]
    return float(np.max(off)), float(np.sqrt(np.mean(off**2)))


def test_loop_closed_on_a_cascade(tmp_path: Path) -> None:
    wrong = machine_of(DRIVE)
    found = diagnose(record(DRIVE, GAP, coulomb=FRICTION), wrong)
    assert {one.name for one in found.findings} == {"backlash", "coulomb_friction"}
    before, after = (executed(with_both_axes(one), tmp_path) for one in (wrong, found.machine))
    assert after[0] < before[0] / 5.0
    assert after[1] < before[1] / 10.0
