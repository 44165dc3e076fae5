"""The model of the controller against LinuxCNC's planner: corners, arcs, short moves, stops, path modes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.rehearsing import HERE, WHY_NOT
from support.shop import figure_eight

from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import read_program
from ph_post.rehearse.linuxcnc import run_on_linuxcnc
from ph_post.simulate.controllers.run import run_program
from ph_post.types import RoundedPath

pytestmark = pytest.mark.skipif(not HERE, reason=WHY_NOT)

CORNERS = """G21 G90 G17 {mode}
G0 X10 Y0
G1 X40 F1800
G1 Y20
G1 X10
G1 X5 Y10
G1 X10 Y0
G1 X40 Y0.5
G3 X40 Y10.5 I0 J5
G1 X10
G3 X10 Y0.5 I0 J-5
M2
"""

STOPS = """G21 G90 G17 G64 P0.005 Q0
G0 X10 Y0
G3 X0 Y10 I-10 J0 F1200
G4 P0.01
G1 Y9.95 F600
G4 P0.01
G3 X-10 Y-0.05 I0 J-10 F1200
G4 P0.2
G1 X20 Y5 F2000
M3 S100
G1 X25 Y5
M5
G1 X30 Y8
M2
"""

HELIX = """G21 G90 G17 G64 P0.01 Q0
G0 X20 Y0 Z5
G1 Z0 F600
G3 X20 Y0 Z-2 I-20 J0 F2400
G3 X-20 Y0 Z-3 I-20 J0 F1200
G0 Z5
M2
"""


def timed_dip() -> str:
    """Write a circle in blocks of 5 ms, slower around the quadrants."""
    lines, radius, angle = ["G21 G90 G17 G64 P0.002 Q0\nG0 X20 Y0\n"], 20.0, 0.0
    while angle < math.tau:
        off = min(abs(angle - k * math.pi / 2.0) for k in range(5))
        speed = 10.0 + 30.0 * min(1.0, (off / 0.25) ** 2)
        after = min(angle + speed * 0.005 / radius, math.tau)
        x, y, i, j = (
            radius * f(a) for f, a in ((math.cos, after), (math.sin, after), (math.cos, angle), (math.sin, angle))
        )
        lines.append(f"G3 X{x:.6f} Y{y:.6f} I{-i:.6f} J{-j:.6f} F{60.0 * speed:.3f}\n")
        angle = after
    return "".join([*lines, "M2\n"])


SPLINES = """G21 G90 G17 G64 P0.005 Q0
G0 X0 Y0
F1200
G5 X20 Y10 I5 J0 P-5 Q-5
G5 X40 Y20 P-10 Q2 I5 J5
G5.1 X60 Y0 I5 J10
G5.2 X60 Y0 P1 L3
X65 Y5 P1
X70 Y-5 P1
X75 Y0 P1
G5.3
G1 X80
M2
"""

MANY_CORNERS = """G21 G90 G17 G64 P0.002
G0 X14.1171 Y14.1671
G3 X0.5147 Y20.0177 I-14.142136 J-14.142136 F3000
G1 X0.2423 Y20.0251 F2998
G1 X0.1172 Y20.0207 F1834
G1 X-0.0079 Y20.0086 F1841
G1 X-0.1148 Y19.9916 F1854
G1 X-0.2036 Y19.9814 F1844
G1 X-0.2924 Y19.9751 F1837
G1 X-0.5648 Y19.9677 F2998
G3 X-20.0178 Y0.5147 I0.539764 J-19.992736 F3000
M2
"""
"""Six corners in a row, each as fast as it may be: looking ahead, LinuxCNC does not come to the line before them."""

CASES = {
    "rounded corners": (CORNERS.format(mode="G64 P0.02 Q0"), "router"),
    "corners rounded at will": (CORNERS.format(mode="G64"), "router"),
    "exact path": (CORNERS.format(mode="G61"), "mill"),
    "exact stop": (CORNERS.format(mode="G61.1"), "router"),
    "stops": (STOPS, "router"),
    "splines": (SPLINES, "router"),
    "helix": (HELIX, "router"),
    "timed blocks": (timed_dip(), "stepper"),
    "short moves": (figure_eight(3000).replace("F400", "F2400"), "stepper"),
    "six corners in a row": (MANY_CORNERS, "stepper"),
    "linked moves": (figure_eight().replace("Q0", "Q0.02"), "mill"),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.thinned(8)
def test_the_model_commands_what_the_planner_commands(case: str) -> None:
    text, name = CASES[case]
    machine = read_machine(name)
    model = run_program(read_program(text.encode(), case), machine, RoundedPath())
    real = run_on_linuxcnc(text.encode(), case, machine)
    assert len(model.t) == pytest.approx(len(real.position), rel=0.01)
    one, two = _speeds(model.position, machine.servo_period), _speeds(real.position, machine.servo_period)
    where = np.linspace(0.0, min(one[0][-1], two[0][-1]), 4000)
    off = np.interp(where, *one) - np.interp(where, *two)
    assert np.sqrt(np.mean(off * off)) < 0.005 * two[1].max()
    assert one[0][-1] == pytest.approx(two[0][-1], rel=1e-4)


def _speeds(position: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Way travelled and speed in the middle of every period that moves."""
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    way = np.cumsum(steps) - 0.5 * steps
    return way[steps > 0.0], steps[steps > 0.0] / period
