"""Arcs behind rounded corners are divided for LinuxCNC where a crossing slows them down."""

from __future__ import annotations

import math
import re

import pytest
from support.real_cuts import bench

import ph_post as ph
from ph_post.gcode.read import read_program

AT = 20.0 * math.sqrt(0.5)
"""The circle of 20 mm begins here, in X and Y [mm], half way between two reversals."""


def arcs_of(feed: float, straight_on: bool) -> list[tuple[float, float]]:
    """Ends of the arcs of a compensated circle, reached in a corner or on its tangent."""
    way = 3.0 if straight_on else 0.0
    lines = ["G21 G90 G17 G64 P0.002", f"G0 X{AT + way:.4f} Y{AT - way:.4f} Z5", "G1 Z0 F600"]
    lines += [f"G1 X{AT:.4f} Y{AT:.4f} F{feed:g}"] if straight_on else []
    lines += [f"G3 X{AT:.4f} Y{AT:.4f} I-{AT:.4f} J-{AT:.4f} F{feed:g}", "G0 Z5", "M2", ""]
    done = ph.compensate(read_program("\n".join(lines).encode(), "part.ngc"), bench(0.1, 500.0, 0.0)).program()
    found = re.findall(r"^G3 X(\S+) Y(\S+)", done.decode(), re.MULTILINE)
    return [(float(x), float(y)) for x, y in found]


def test_a_short_part_beside_the_corner_is_written_by_itself() -> None:
    arcs = arcs_of(3000.0, straight_on=False)
    assert len(arcs) == 6
    # Shifted by half of the backlash, 0.05 mm, in X and in Y.
    assert math.dist(arcs[0], (AT, AT)) == pytest.approx(0.2, abs=0.072)


@pytest.mark.parametrize(("feed", "straight_on"), [(600.0, False), (3000.0, True)], ids=["full feed", "no corner"])
def test_where_nothing_is_gained_it_is_not(feed: float, straight_on: bool) -> None:
    assert len(arcs_of(feed, straight_on)) == 5
