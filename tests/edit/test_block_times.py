"""How long the blocks of compensated programs last at high feeds, and whether a serial line can feed them."""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace
from support.editing import compensate
from support.reference_player import interpret

from ph_post.drive.machinefile import read_machine

RATE = 11_520.0
"""115,200 baud, ten bits a byte."""

PUSH = 700.0
"""Acceleration along the path [mm/s²] of two axes with 500 mm/s² each."""

STORE = 16
"""Blocks that Grbl's planner holds."""

HEAD = "G21 G90 G17 G94"


def circle(radius: float, feed: float) -> str:
    """A circle whose first joint is 0.8 degrees before a quadrant."""
    x, y = (radius * turn(math.radians(89.2)) for turn in (math.cos, math.sin))
    lines = [HEAD, f"G0 X{radius} Y0 Z5", f"G1 Z0 F{feed}", f"G3 X{x:.4f} Y{y:.4f} I-{radius} J0"]
    lines += [f"G3 X{-radius} Y0 I{-x:.4f} J{-y:.4f}", f"G3 X{radius} Y0 I{radius} J0"]
    return "\n".join([*lines, "G0 Z5", "M2", ""])


def eight(count: int, feed: float) -> str:
    lines = [HEAD, "G0 X0 Y0 Z5", f"G1 Z0 F{feed}"]
    turned = [math.tau * k / count for k in range(1, count + 1)]
    lines += [f"G1 X{20 * math.sin(t):.4f} Y{8 * math.sin(2 * t):.4f}" for t in turned]
    return "\n".join([*lines, "G0 Z5", "M2", ""])


CIRCLES = {f"circle R{r} F{f}": circle(r, f) for r in (2, 5, 20, 100) for f in (1200, 3000, 6000)}
EIGHTS = {f"eight {n} F{f}": eight(n, f) for n, f in ((200, 3000), (400, 3000), (400, 6000), (1000, 3000))}
PROGRAMS = {**CIRCLES, **EIGHTS}


def blocks(text: str) -> list[tuple[float, int]]:
    """Least time [s] and bytes of every block that cuts: at its feed, and no faster away from a slower neighbour."""
    lines, found = text.split("\n"), []
    moves = [one for one in interpret(text, (0.0, 0.0, 5.0)) if one.mode > 0]
    for before, one, behind in zip([None, *moves], moves, [*moves[1:], None], strict=False):
        speed = one.feed / 60.0
        slow = min(speed, *(beside.feed / 60.0 for beside in (before, behind) if beside is not None))
        ramp = (math.sqrt(slow**2 + 2.0 * PUSH * one.length) - slow) / PUSH
        found.append((max(one.length / speed, ramp), len(lines[one.line - 1]) + 1))
    return found


def written(text: str, dialect: str, period: float = 1e-3) -> str:
    machine = replace(read_machine("stepper"), dialect=dialect, servo_period=period)
    found = compensate(text.encode(), machine, dialect=dialect)
    assert found.edits.crossings or found.edits.stops
    return found.text.decode()


# 4 ms at 100 mm/s are 0.4 mm: as much as a crossing, which is then moved no farther from its reversal.
@pytest.mark.parametrize(
    ("name", "period"),
    [(name, period) for name in PROGRAMS for period in (1e-3, 2e-3) if period < 2e-3 or "F6000" not in name],
)
@pytest.mark.thinned(4)
def test_no_block_lasts_less_than_two_servo_periods(name: str, period: float) -> None:
    own = PROGRAMS[name]
    least = min(2.0 * period, *(time for time, _ in blocks(own)))
    found = blocks(written(own, "linuxcnc", period))
    # Three crossings of up to nine blocks where LinuxCNC rounds their joints, and the approaches.
    assert len(found) < 1.1 * len(blocks(own)) + 36
    assert min(time for time, _ in found) >= 0.999 * least


def starved(found: list[tuple[float, int]]) -> float:
    """Time [s] for which a machine waits for blocks that come over the line, once the first ones have come."""
    come, begins, end, waited = 0.0, [], 0.0, 0.0
    for number, (time, size) in enumerate(found):
        free = begins[number - STORE] if number >= STORE else 0.0
        come = max(come, free) + size / RATE
        begin = max(end, come)
        waited += begin - end if number >= STORE else 0.0
        begins.append(begin)
        end = begin + time
    return waited


def test_a_line_that_is_too_slow_is_noticed() -> None:
    assert starved([(0.001, 35)] * 100) == pytest.approx(84 * (35 / RATE - 0.001), rel=0.2)
    assert starved([(0.004, 35)] * 100) == 0.0


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_serial_line_feeds_the_blocks_of_crossings(name: str) -> None:
    own = PROGRAMS[name]
    before, after = starved(blocks(own)), starved(blocks(written(own, "grbl")))
    # Where the original's own blocks come too slowly those of crossings, and longer numbers, are a small part.
    assert after <= 1.25 * before + 1e-9
