"""Test programs on LinuxCNC itself: they run to their end inside their room and the machine's limits."""

from __future__ import annotations

import numpy as np
import pytest
from support.rehearsing import HERE, WHY_NOT

from ph_post.drive.machinefile import read_machine
from ph_post.rehearse.linuxcnc import run_on_linuxcnc
from ph_post.testprograms.kit import calibration_kit

pytestmark = pytest.mark.skipif(not HERE, reason=WHY_NOT)

MM = 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mix", "ladder_y", "fast_x", "circles_xy", "diagonals_xy"])
@pytest.mark.thinned(8)
def test_linuxcnc_runs_it_inside_room_and_limits(name: str) -> None:
    machine = read_machine("router")
    kit = calibration_kit(machine, travel=(40.0 * MM,))
    program = next(one.program for one in kit if one.name == name)
    found = run_on_linuxcnc(program.encode(), name, machine)
    velocity = np.diff(found.position, axis=0) / machine.servo_period
    acceleration = np.diff(velocity, axis=0) / machine.servo_period
    np.testing.assert_allclose(found.position[-1], 0.0, atol=1e-9)
    assert np.abs(found.position).max() < 20.0 * MM + 1e-8
    for column, axis in enumerate("XY"):
        limits = machine.axes[axis].limits
        assert np.abs(velocity[:, column]).max() < limits.velocity * 1.001
        assert np.abs(acceleration[:, column]).max() < limits.acceleration * 1.001
    assert not velocity[:, 2].any()
