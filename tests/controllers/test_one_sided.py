"""One-sided positioning on a real LinuxCNC, with backlash of the test's own behind its joint commands."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from msgspec.structs import replace
from support.real_cuts import behind
from support.rehearsing import HERE, WHY_NOT

import ph_post as ph
from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import read_program
from ph_post.rehearse.linuxcnc import run_on_linuxcnc

pytestmark = [pytest.mark.skipif(not HERE, reason=WHY_NOT), pytest.mark.slow]

LOST = (0.06, 0.08)
HOLES = ((10, 10), (40, 30), (20, 50), (20, 20), (59.97, 10.02), (60, 45))


def drilling(mode: str) -> bytes:
    lines = [f"G21 G90 G17 G94 {mode}", "G0 Z5"]
    for x, y in HOLES:
        lines += [f"G0 X{x} Y{y}", "G0 Z1", "G1 Z-3 F200", "G0 Z5"]
    return "\n".join([*lines, "M2", ""]).encode()


def holes(rows: np.ndarray, scale: float) -> np.ndarray:
    """How far holes are from their places [µm], from all initial sides; shape (4, n, 2)."""
    deep = rows[:, 2] < -2.99e-3
    first = np.flatnonzero(deep & ~np.append(False, deep[:-1]))
    each = []
    for sides in itertools.product((-1.0, 1.0), repeat=2):
        axes = [behind(rows[:, n], 0.5e-3 * scale * LOST[n], side)[first] for n, side in enumerate(sides)]
        each.append(1e6 * np.column_stack(axes) - 1e3 * np.array(HOLES))
    return np.array(each)


@pytest.mark.parametrize("mode", ["G61", "G64 P0.005", "G64"])
@pytest.mark.parametrize("side", [None, "-"])
@pytest.mark.thinned(4)
def test_holes_of_the_real_controller(mode: str, side: str | None) -> None:
    machine = replace(read_machine("stepper"), dialect="linuxcnc", servo_period=1e-3)
    result = ph.compensate(read_program(drilling(mode), "holes.ngc"), machine, position_from=side)
    rows = np.asarray(run_on_linuxcnc(result.program(), "holes", machine).position)
    assert np.abs(holes(rows, 1.0)).max() < 0.2
    for scale in (0.5, 2.0):
        off = holes(rows, scale)
        if side is None:
            assert np.ptp(off, axis=(0, 1)).max() > 25.0
        else:
            assert np.ptp(off, axis=(0, 1)).max() < 0.2
    assert len(rows) * 1e-3 <= 1.1 * result.before.time
