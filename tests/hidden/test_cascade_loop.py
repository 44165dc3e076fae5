"""The loop closed on a cascade of the tests' own, with friction and a gap that the file does not have."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

import ph_post as ph
from ph_post.diagnose.diagnose import diagnose
from ph_post.gcode.read import read_program
from ph_post.rehearse.linuxcnc import INSTALL, is_installed, run_on_linuxcnc
from ph_post.types import EffectSetting, Gap, Limits, Machine
from tests.hidden.test_loop import CIRCLE, RADIUS
from tests.support.cascade_plant import Drive, motor_of, play
from tests.support.cascade_records import averaged, machine_of, record
from tests.support.played import play_program

pytestmark = pytest.mark.drawn(4)

DRIVE, GAP, FRICTION = Drive(tn=12e-3, velocity=0.95), 4e-5, 0.3
OTHERS = (
    (Drive(kv=22.0, wv=130.0, tn=30e-3), 2.5e-5, 0.5, 0.2),
    (Drive(kv=90.0, wv=500.0, velocity=1.0), 7e-5, 0.35, 0.1),
    (Drive(kv=55.0, wv=300.0, tn=14e-3, velocity=0.7, current=3e-4), 1.5e-5, 0.25, 0.1),
    (Drive(kv=33.0, wv=210.0, tn=20e-3, velocity=1.0), 5e-5, 0.6, 0.1),
)
"""Other cascades, backlash [m], friction [m/s²], and the slowdown allowed.

Friction that takes 0.17 mm of following error, as of the first, is not led in a tenth more time.
"""

LIMITS = Limits(velocity=0.2, acceleration=2.0, jerk=50.0)
BESIDE = 0.4
"""Time at either end in which the table comes onto its side of the gap, and all begins and ends [s]."""


def with_all_axes(machine: Machine) -> Machine:
    """Return a machine with the axis of a file as X and Y, and a Z that has nothing."""
    axes = {"X": machine.axes["X"], "Y": machine.axes["X"], "Z": machine_of(DRIVE).axes["X"]}
    return replace(machine, axes={name: replace(axis, name=name, limits=LIMITS) for name, axis in axes.items()})


def errors(
    commands: np.ndarray, counted: np.ndarray, gap: float, friction: float, drive: Drive = DRIVE
) -> tuple[float, float]:
    """Return the largest and rms distance [m] from the circle of what the plant does with commands (n, 2)."""
    places = []
    for column in commands.T:
        motor = motor_of(drive, column - column[0], friction, fine=20)
        places.append(column[0] + play(motor, gap))
    off = np.abs(np.hypot(*places) - RADIUS)[counted]
    return float(np.max(off)), float(np.sqrt(np.mean(off**2)))


def executed(
    machine: Machine, folder: Path, drive: Drive, gap: float, friction: float, slowdown: float
) -> tuple[float, float]:
    """Errors [m] of the interpolator table of a machine file on a plant."""
    path, table = folder / "circle.json", folder / "circle.csv"
    path.write_text(json.dumps(CIRCLE))
    ph.compensate(ph.read_path(path), machine, output="table", max_slowdown=slowdown).write_table(table)
    rows = list(csv.DictReader(one for one in table.read_text().splitlines() if not one.startswith("#")))
    t = np.array([float(row["t"]) for row in rows])
    commands = np.array([[1e-3 * float(row[name]) for name in "XY"] for row in rows])
    return errors(commands, (t > BESIDE) & (t < t[-1] - BESIDE), gap, friction, drive)


def closed(drive: Drive, gap: float, friction: float, slowdown: float, folder: Path) -> tuple[float, float]:
    """Return how many times less error there is by the diagnosed file than by the one without: largest, and rms."""
    wrong = machine_of(drive)
    found = diagnose(record(drive, gap, coulomb=friction), wrong)
    assert {one.name for one in found.findings} == {"backlash", "coulomb_friction"}
    files = (with_all_axes(one) for one in (wrong, found.machine))
    before, after = (executed(one, folder, drive, gap, friction, slowdown) for one in files)
    return before[0] / after[0], before[1] / after[1]


def test_loop_closed_on_a_cascade(tmp_path: Path) -> None:
    largest, rms = closed(DRIVE, GAP, FRICTION, 0.1, tmp_path)
    assert largest > 5.0
    assert rms > 10.0


@pytest.mark.parametrize(("drive", "gap", "friction", "slowdown"), OTHERS)
@pytest.mark.thinned(4)
def test_loop_closed_on_other_cascades(
    drive: Drive, gap: float, friction: float, slowdown: float, tmp_path: Path
) -> None:
    assert min(closed(drive, gap, friction, slowdown, tmp_path)) > 5.0


PROGRAM = f"""G21 G90 G17 G94 G64 P0.002
G0 X{1e3 * RADIUS:g} Y0
G0 Z2
G1 Z-1 F300
G3 X{1e3 * RADIUS:g} Y0 I{-1e3 * RADIUS:g} J0 F1200
G0 Z2
M2
"""
HEAVY, NARROW = 0.8, 3e-5
"""Friction [m/s²] that makes more error than the backlash [m]."""


def played(text: str) -> tuple[float, float]:
    """Errors [m] of a program, from the first tenth of a millimetre of its cut on."""
    commands = play_program(text, "XY", 1e-3, np.array([RADIUS, 0.0])).position
    turned = RADIUS * np.unwrap(np.arctan2(commands[:, 1], commands[:, 0]))
    return errors(commands, (turned > 1e-4) & (turned < 2.0 * np.pi * RADIUS - 1e-4), NARROW, HEAVY)


def planned(program: bytes, machine: Machine) -> tuple[float, float]:
    """Errors [m] of the cut of a program as LinuxCNC commands it."""
    commands = run_on_linuxcnc(program, "circle", machine).position
    return errors(commands[:, :2], commands[:, 2] < 0.0, NARROW, HEAVY)


@pytest.mark.slow
def test_a_program_with_the_lead_takes_friction_out_of_a_cascade() -> None:
    machine = machine_of(DRIVE, NARROW)
    error = {"following_error_mm": 1e3 * HEAVY / (DRIVE.kv * DRIVE.wv)}
    axis = replace(machine.axes["X"], effects=(EffectSetting(name="coulomb_friction", parameters=error),))
    machine = with_all_axes(replace(machine, axes={"X": axis}))
    found = ph.compensate(
        read_program(PROGRAM.encode(), "circle"), machine, lead_program=True, effort=0.05, max_slowdown=0.2
    )
    before, after = played(PROGRAM), played(found.program().decode())
    assert after[0] < before[0] / 5.0
    assert after[1] < before[1] / 7.0
    # Backlash does no more of it.
    assert found.after.error_gap.max <= found.after.error.max
    assert not any("friction" in one and "stays" in one for one in found.warnings)
    left = ph.compensate(read_program(PROGRAM.encode(), "circle"), machine, strategy="none")
    said = "the friction of X and Y stays in the part, behind each reversal; --lead-program or --table leads it"
    assert said in left.warnings
    if not is_installed():
        pytest.skip(f"what is claimed is not tried: LinuxCNC is not installed here ({INSTALL})")
    # What is claimed is what happens where LinuxCNC's own planner rounds the corners between short lines.
    assert planned(found.program(), machine) == pytest.approx((found.after.error.max, found.after.error.rms), rel=0.05)


SMALL = """G21 G90 G17 G94 G64 P0.005
G0 X4 Y0
G1 Z-1 F200
G3 X4 Y0 I-4 J0 F900
G0 Z5
M2
"""


def test_the_worst_case_of_a_claim_holds_where_friction_decides_how_a_cut_begins() -> None:
    """At rest a micrometre decides which way an integrator pushes, and so the error of the first moments."""
    drive, friction, length = Drive(tn=12e-3, velocity=1.0), 0.4, 8
    machine = machine_of(drive, NARROW)
    error = {"following_error_mm": 1e3 * friction / (drive.kv * drive.wv)}
    axis = machine.axes["X"]
    servo = replace(axis.servo, cascade=replace(axis.servo.cascade, moving_average=1e-3 * length))
    axis = replace(axis, servo=servo, effects=(EffectSetting(name="coulomb_friction", parameters=error),))
    machine = with_all_axes(replace(machine, axes={"X": axis}))
    still = replace(ph.read_machine("stepper").axes["Z"], gap=Gap(lost_motion=0.0), limits=LIMITS)
    machine = replace(machine, axes={**machine.axes, "Z": still})
    found = ph.compensate(read_program(SMALL.encode(), "small"), machine, max_slowdown=0.3)
    commands, counted = found.after.command.position[:, :2], found.after.assessment.counted
    sizes = []
    for factor in (1.0, 0.8, 1.2):
        motors = (motor_of(drive, averaged(one - one[0], length), factor * friction, fine=20) for one in commands.T)
        place = [one[0] + play(motor, NARROW) for one, motor in zip(commands.T, motors, strict=True)]
        sizes.append(float(np.abs(np.hypot(*place) - 4e-3)[counted].max()))
    assert found.after.error.max == pytest.approx(sizes[0], rel=0.05)
    assert found.after.error_worst.max > 0.98 * max(sizes)
    assert max(sizes) > 4.0 * min(sizes)
