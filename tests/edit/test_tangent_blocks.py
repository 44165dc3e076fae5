"""The straight blocks beside a crossing on a helix touch it as they are written, read by the tests' own arithmetic."""

from __future__ import annotations

import math
import re
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from support.editing import compensate

from ph_post.drive.machinefile import read_machine
from ph_post.types import Machine

TANGENT = 1.5e-3
"""Largest angle [rad] between a helix and a block that touches it, as written to micrometres: its arcs' own ends and
centres are off by half a micrometre in some millimetres. Left as it is rounded a block of a tenth of a millimetre is
off by up to 7e-3."""

NUMBER = re.compile(r"([GXYZIJ])(-?[\d.]+)")


def machine() -> Machine:
    """Steppers with a twentieth of a millimetre of backlash, behind a controller of another maker."""
    one = read_machine("stepper")
    axes = {name: replace(axis, gap=axis.gap.with_lost_motion(5e-5)) for name, axis in one.axes.items()}
    return replace(one, axes=axes, dialect="fanuc")


def joints(text: str) -> list[float]:
    """Angles [rad] between the arcs of a program and the straight lines beside them, at each of their joints."""
    place, mode, legs = {"X": 0.0, "Y": 0.0, "Z": 0.0}, 0, []
    for line in text.splitlines():
        words = {letter: float(digits) for letter, digits in NUMBER.findall(re.sub(r"\(.*\)", "", line))}
        mode = int(words["G"]) if words.get("G") in (0.0, 1.0, 2.0, 3.0) else mode
        if not words.keys() & {*"XYZ"} or words.get("G", 0.0) > 3.0:
            continue
        start = np.array([*place.values()])
        place |= {letter: words[letter] for letter in "XYZ" if letter in words}
        end = np.array([*place.values()])
        if mode < 2:
            legs.append((mode, end - start, end - start))
            continue
        turn = 1.0 if mode == 3 else -1.0
        center = start[:2] + np.array([words["I"], words["J"]])
        first, last = start[:2] - center, end[:2] - center
        swept = (turn * (math.atan2(last[1], last[0]) - math.atan2(first[1], first[0]))) % math.tau
        rise = (end[2] - start[2]) / swept
        legs.append((mode, *(np.array([-turn * y, turn * x, rise]) for x, y in (first, last))))
    return [
        math.atan2(float(np.linalg.norm(np.cross(one[2], two[1]))), float(one[2] @ two[1]))
        for one, two in pairwise(legs)
        if {one[0], two[0]} in ({1, 2}, {1, 3})
    ]


@pytest.mark.parametrize("radius", [2.85, 4.2])
@pytest.mark.parametrize("rise", [0.16, 0.31])
def test_blocks_beside_a_crossing_on_a_helix_touch_it(radius: float, rise: float) -> None:
    # Halves begin and end between two reversals, so that no crossing is at an end of a motion.
    x, y = radius * math.cos(0.7), radius * math.sin(0.7)
    ways = [(-1.0 if n % 2 else 1.0, -0.5 * rise * n) for n in range(1, 9)]
    halves = "".join(f"G3 X{s * x:.3f} Y{s * y:.3f} Z{z:.3f} I{s * x:.3f} J{s * y:.3f}\n" for s, z in ways)
    text = f"%\nO1\nG21 G90 G17 G94\nG0 X{x:.3f} Y{y:.3f} Z1\nG1 Z0 F300\nF1500\n{halves}G0 Z5\nM30\n%\n"
    found = compensate(text.encode(), machine(), dialect="fanuc").text.decode()
    # Not those of the way in, of the jogs behind the first half, and of the way out.
    off = joints(found)[3:-1]
    assert len(off) >= 24
    assert max(off) < TANGENT
