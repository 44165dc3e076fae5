"""Test pulses of a motor during a run: the record that the loop alone does not explain.

The plant is integrated here: M q'' = u - F_v q' - F_c sign q' - load with u = K (cmd - q) - D q' + pulses.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ph_post as ph
from ph_post.types import Array

pytestmark = pytest.mark.drawn(4)

MASS, STIFFNESS, DAMPING = 95.0, 1.37e6, 8557.0
VISCOUS, FRICTION, LOAD = 203.0, 20.4, -3.2
PERIOD, FINE = 1e-3, 20
RUNS, RUN = 3, 4.0
"""The same motion three times [s]."""

PULSE, EVERY = 170.0, 0.938
"""Size [N] and period [s] of the pulses, which do not keep step with the motion."""

MACHINE = """
name = "axis"
[controller]
dialect = "linuxcnc"
servo_period_ms = 1.0
[axes.X]
feedback = "motor"
b = 6.9e-5
c = 6.38e-3
lost_motion_mm = 0
servo_stiffness_n_per_mm = 1370
max_velocity_mm_s = 200
max_acceleration_mm_s2 = 5000
max_jerk_mm_s3 = 100000
"""


def record(pulse: float) -> tuple[Array, Array, Array, Array]:
    """Time, command, reading and effort of a run with pulses of that size."""
    h = PERIOD / FINE
    t = np.arange(round(RUNS * RUN / h)) * h
    phase = np.mod(t, RUN)
    command = 0.03 * (1.0 - np.cos(2.0 * np.pi * phase / RUN)) + 0.004 * (1.0 - np.cos(6.0 * np.pi * phase / RUN))
    given = np.where(np.mod(t, EVERY) > EVERY / 2.0, pulse, 0.0)
    q = v = 0.0
    place, effort = np.empty(t.size), np.empty(t.size)
    for k in range(t.size):
        u = STIFFNESS * (command[k] - q) - DAMPING * v + given[k]
        place[k], effort[k] = q, u
        free = u - VISCOUS * v - LOAD
        if v == 0.0 and abs(free) <= FRICTION:
            continue
        way = np.sign(v) if v else np.sign(free)
        new = v + h * (free - way * FRICTION) / MASS
        v = 0.0 if new * v < 0.0 else new
        q += h * v
    rng = np.random.default_rng(3)
    rows = slice(None, None, FINE)
    place = place[rows] + rng.normal(0.0, 2e-7, t[rows].size)
    return t[rows], command[rows], place, effort[rows] + rng.normal(0.0, 0.3, t[rows].size)


def diagnosed(folder: Path, pulse: float, *, effort: bool = True) -> ph.LogDiagnosis:
    """Diagnose such a run."""
    t, command, place, force = record(pulse)
    columns = [t, 1e3 * command, 1e3 * place, *([force] if effort else [])]
    log, machine = folder / "run.csv", folder / "axis.toml"
    header = "t,X_cmd,X_motor" + (",X_force" if effort else "")
    np.savetxt(log, np.column_stack(columns), "%.6f", ",", header=header, comments="")
    machine.write_text(MACHINE, encoding="utf-8")
    return ph.diagnose(log, machine)


def test_friction_and_load_are_named_beneath_pulses_of_the_motor(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, PULSE)
    sizes = {one.name: one.parameters["force"].value for one in found.findings}
    assert sizes == {
        "coulomb_friction": pytest.approx(FRICTION, rel=0.05),
        "load_offset": pytest.approx(LOAD, rel=0.15),
    }
    assert found.steps[-1].holdout_rms < 1e-6
    assert "a force that its loop did not ask for" in found.quality.notes[0]
    plain = {one.name: one.parameters["force"].value for one in diagnosed(tmp_path, 0.0).findings}
    assert sizes == pytest.approx(plain, rel=0.05)


def test_pulses_stay_unknown_where_nobody_recorded_the_effort(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, PULSE, effort=False)
    assert found.verdict == "unknown"
    assert found.steps[0].holdout_rms > 3e-5


def test_identify_takes_no_stiffness_from_an_effort_that_pulses_are_part_of(tmp_path: Path) -> None:
    diagnosed(tmp_path, PULSE)
    drive = ph.identify(tmp_path / "run.csv", tmp_path / "axis.toml").drives["X"]
    assert "servo_stiffness" not in drive.parameters
    assert "motor_time_constant" not in drive.parameters
