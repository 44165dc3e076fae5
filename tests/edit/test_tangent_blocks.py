"""The straight blocks beside a crossing on a helix touch it as they are written, read by the tests' own arithmetic."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace
from support.editing import compensate

from ph_post.drive.machinefile import read_machine
from ph_post.types import Machine
from ph_post.units import MM

TANGENT = 1.5e-3
"""Largest angle [rad] between a helix and a block that touches it, as written to micrometres: its arcs' own ends and
centres are off by half a micrometre in some millimetres. Left as it is rounded a block of a tenth of a millimetre is
off by up to 7e-3."""

FLAT = 0.01
"""Height [mm] of an arc that LinuxCNC takes for a line, where that is what it rounds corners by."""

NUMBER = re.compile(r"([GXYZIJ])(-?[\d.]+)")


def machine() -> Machine:
    """Steppers with a twentieth of a millimetre of backlash, behind a controller of another maker."""
    one = read_machine("stepper")
    axes = {name: replace(axis, gap=axis.gap.with_lost_motion(5e-5)) for name, axis in one.axes.items()}
    return replace(one, axes=axes, dialect="fanuc")


class Leg(NamedTuple):
    """A motion: its G word, the directions in which it begins and ends, and how high an arc is above its chord [mm]."""

    mode: int
    begins: np.ndarray
    ends: np.ndarray
    height: float = 0.0


def legs_of(text: str) -> list[Leg]:
    """Lines and arcs of a program."""
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
            legs.append(Leg(mode, end - start, end - start))
            continue
        turn = 1.0 if mode == 3 else -1.0
        center = start[:2] + np.array([words["I"], words["J"]])
        first, last = start[:2] - center, end[:2] - center
        swept = (turn * (math.atan2(last[1], last[0]) - math.atan2(first[1], first[0]))) % math.tau
        rise = (end[2] - start[2]) / swept
        tangents = (np.array([-turn * y, turn * x, rise]) for x, y in (first, last))
        legs.append(Leg(mode, *tangents, float(np.linalg.norm(first)) * (1.0 - math.cos(0.5 * swept))))
    return legs


def joints(legs: list[Leg]) -> list[float]:
    """Angles [rad] between arcs and the straight lines beside them, at each of their joints."""
    return [
        math.atan2(float(np.linalg.norm(np.cross(one.ends, two.begins))), float(one.ends @ two.begins))
        for one, two in pairwise(legs)
        if {one.mode, two.mode} in ({1, 2}, {1, 3})
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
    off = joints(legs_of(found))[3:-1]
    assert len(off) >= 24
    assert max(off) < TANGENT


@pytest.mark.parametrize("slowdown", [0.3, 0.5, 1.0])
def test_of_a_helix_in_short_arcs_no_line_is_left(slowdown: float) -> None:
    """A ramp as a CAM system writes it: between a line and a helix LinuxCNC rounds no joint, and nearly stops."""
    ends = [(0.577, -1.393), (1.393, 0.577), (-0.577, 1.393), (-1.393, -0.577)]
    starts = [ends[-1], *ends[:-1]]
    quarters = [f"G3 X{x} Y{y} Z%.3f I{-a} J{-b}" for (x, y), (a, b) in zip(6 * ends, 6 * starts, strict=True)]
    ramp = "".join(line % (2.55 - 0.083 * n) + "\n" for n, line in enumerate(quarters, 1))
    text = f"G21 G90 G17 G94\nG0 X-1.393 Y-0.577 Z5\nG1 Z2.55 F1275\n{ramp}G0 Z5\nM30\n"
    own = replace(machine(), dialect="linuxcnc")
    own = replace(own, planner=replace(own.planner, path_tolerance=FLAT * MM))
    found = compensate(text.encode(), own, dialect="linuxcnc", max_slowdown=slowdown)
    assert len(found.edits.crossings) >= 12
    legs = legs_of(found.text.decode())
    assert min(one.height for one in legs if one.mode > 1) > FLAT
    assert max(joints(legs)[3:-1]) < TANGENT


def test_ends_of_a_block_that_is_shorter_than_their_ways_stay_in_order() -> None:
    """A reversal a millimetre before the end of a turn, where the block before its crossing has a tenth of one."""
    turns = "".join(f"G3 Z-{n}.879 I0.833 J-6.015\n" for n in (14, 15))
    text = f"%\nO1\nG21 G90 G17 G94\nG0 X-1.218 Y5.956 Z5.\nG1 Z-13.879 F600\nF3000\n{turns}G0 Z5.\nM30\n%\n"
    found = compensate(text.encode(), machine(), dialect="fanuc")
    assert {"X+", "X-", "Y+", "Y-"} <= {f"{one.axis}{'+' if one.sign > 0 else '-'}" for one in found.edits.crossings}
    # Not the shifts before the first cut and behind the last.
    cuts = [leg for leg in legs_of(found.text.decode()) if leg.mode]
    assert all(one.ends @ two.begins > 0.0 for one, two in pairwise(cuts[3:-2]))
