"""Part programs as a shop has them: a circle, a slot, a pocket, and a curve in short moves; a short path."""

from __future__ import annotations

import math

HEAD = "G21 G90 G17 G94 G64 P0.005 Q0\n"
"""Corners are rounded by no more than 5 µm."""

DOWN = "G0 Z2\nG1 Z0 F300\nG4 P0.2\n"
UP = "G0 Z5\n"

CIRCLE = f"{HEAD}G0 X15 Y0\n{DOWN}G3 X15 Y0 I-15 J0 F400\n{UP}M2\n"

SLOT = f"""{HEAD}G0 X0 Y0
{DOWN}G1 X30 F300
G3 X30 Y12 I0 J6
G1 X0
G3 X0 Y0 I0 J-6
{UP}M2
"""

POCKET = f"""{HEAD}G0 X2 Y2
{DOWN}G1 X14 F120
G1 Y10
G1 X2
G1 Y2
{UP}G0 X4 Y4
{DOWN}G1 X12 F120
G1 Y8
G1 X4
G1 Y4
{UP}M2
"""


def figure_eight(count: int = 400) -> str:
    """Sample a Lissajous figure in straight moves to 0.1 µm."""
    lines = [f"{HEAD}G0 X0 Y0\n{DOWN}F400\n"]
    for k in range(1, count + 1):
        t = math.tau * k / count
        lines.append(f"G1 X{20.0 * math.sin(t):.4f} Y{8.0 * math.sin(2.0 * t):.4f}\n")
    return "".join([*lines, UP, "M2\n"])


WIDE_CIRCLE = f"{HEAD}G0 X20 Y0\n{DOWN}G3 X20 Y0 I-20 J0 F900\n{UP}M2\n"

PROGRAMS = {
    "circle": CIRCLE,
    "slot": SLOT,
    "pocket": POCKET,
    "eight": figure_eight(),
    "wide circle": WIDE_CIRCLE,
}

HUMP = {
    "format": "ph-post-path",
    "version": 1,
    "name": "hump",
    "source": "by hand",
    "units": "mm",
    "axes": ["X", "Y"],
    "feed": 900,
    "closed": False,
    "segments": [{"type": "arc", "start": [-2, 0], "end": [2, 0], "center": [0, 0], "turn": "cw"}],
}
"""A path file with one turning point, which is planned in a moment."""
