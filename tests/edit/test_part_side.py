"""Crossings beside a part leave it proud: signed distances of a table that a player of the tests' own drags along."""

from __future__ import annotations

import re

import numpy as np
import pytest
from msgspec.structs import replace
from support.editing import compensate
from support.reference_player import BEGINS, interpret, run, tables

from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import reread
from ph_post.types import Machine
from ph_post.verify.verify import verify

LOST = (0.05, 0.05, 0.05)

RADIUS = {"large": 20.0, "small": 2.0}


def machine(dialect: str) -> Machine:
    """Steppers that lose 50 µm in every axis; zeros are taken from both sides."""
    one = read_machine("stepper")
    axes = {}
    for name, axis in one.axes.items():
        limits = replace(axis.limits, acceleration=0.5, velocity=0.1)
        gap = axis.gap.with_lost_motion(5e-5)
        axes[name] = replace(axis, gap=gap, limits=limits, reference_direction="both")
    return replace(one, axes=axes, dialect=dialect, servo_period=1e-3)


def circle(radius: float, code: int, plane: int = 17) -> str:
    words = {17: "XYIJ", 18: "ZXKI", 19: "YZJK"}[plane]
    first, second, center, _ = words
    low = {17: "G1 Z-1 F300\n", 18: "G1 Y-1 F300\n", 19: "G1 X-1 F300\n"}[plane]
    turn = f"G{code} {first}{radius:g} {second}-30 {center}-{radius:g} F1200\n"
    begin, end = f"G0 {first}{radius:g} {second}-30\n{low}", "G17\nG0 Z5\nG0 X0 Y0\n"
    return f"G21\nG90\nG17 G91.1 G94\nG0 Z5\nG0 X0 Y0\nG{plane}\n{begin}{turn}{turn}{end}"


def signed(text: str, radius: float, plane: int) -> np.ndarray:
    """How far the table is outside the circle [mm] while it turns, from all sides and beginnings."""
    a, b = {17: (0, 1), 18: (2, 0), 19: (1, 2)}[plane]
    found = []
    for begin in BEGINS:
        moves = interpret(text, begin)
        done = run(moves, 0.01)
        arcs = [k for k, move in enumerate(moves) if move.mode >= 2]
        turning = (done.owner >= arcs[0]) & (done.owner <= arcs[-1])
        every = tables(done.motor, LOST, (0, 0, 0))
        found += [np.hypot(table[turning, a], table[turning, b] + 30.0) - radius for table in every]
    return np.concatenate(found)


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl"])
@pytest.mark.parametrize("size", RADIUS)
@pytest.mark.parametrize("plane", [17, 18, 19])
@pytest.mark.parametrize(("code", "side"), [(2, "left"), (2, "right"), (3, "left"), (3, "right")])
@pytest.mark.thinned(16)
def test_a_circle_is_left_proud_on_the_side_of_the_part(
    dialect: str, size: str, plane: int, code: int, side: str
) -> None:
    radius, text = RADIUS[size], circle(RADIUS[size], code, plane)
    number = {"left": 1, "right": -1}[side]
    made = compensate(text.encode(), machine(dialect), dialect=dialect, part_side=number)
    changed = made.text.decode()
    off = signed(changed, radius, plane)
    # G3 has its centre on the left.
    inside = (code == 3) == (side == "left")
    into, proud = (-off.min(), off.max()) if inside else (off.max(), -off.min())
    step = 1e-4
    declared = float(re.search(r"within ([\d.]+) mm", changed)[1])
    # The tangents are those of a parabola in place of the circle.
    assert into <= 0.02 * declared + 3.0 * step
    assert 2.0 * into < proud <= declared + 3.0 * step
    # On the small circle, where LinuxCNC gets blocks in steps.
    assert declared < 3.3e-3
    assert verify(made.program, reread(made.program, made.text), machine=machine(dialect), tolerance=5e-6).ok
    # Without a side crossings of Grbl on a small circle, which dip, are off to both sides.
    plain = signed(compensate(text.encode(), machine(dialect), dialect=dialect).text.decode(), radius, plane)
    if (dialect, size) == ("grbl", "small"):
        assert min(plain.max(), -plain.min()) > 4.0 * step
