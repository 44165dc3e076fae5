"""What is left of an arc beside its crossings is cut into chords no coarser than the arc was, and never coarse."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from support.firmware_planners import grbl_chords

import ph_post as ph

WORD = re.compile(r"([GXYZIJF])(-?[0-9.]+)")
CLOSE = 1.0
"""How much farther off the path chords may be [µm]; coordinates are rounded to one."""

COARSE, FINE = 10.0, 5.0
"""What is left of an arc whose chords are off by more than the first [µm] gets chords that are off by the second."""


def serpentine(radii: list[float], turns: list[float]) -> str:
    """Arcs that go on into one another, to the left and to the right by turns [rad]; lengths in mm."""
    lines = ["G21", "G90", "G17", "G0 X0 Y0 Z2", "G1 Z-1 F300"]
    x, y, heading = 0.0, 0.0, 0.3
    for number, (radius, turn) in enumerate(zip(radii, turns, strict=True)):
        side = 1 if number % 2 == 0 else -1
        i, j = -side * radius * math.sin(heading), side * radius * math.cos(heading)
        heading += side * turn
        x1, y1 = x + i + side * radius * math.sin(heading), y + j - side * radius * math.cos(heading)
        lines.append(f"G{3 if side > 0 else 2} X{x1:.3f} Y{y1:.3f} I{i:.3f} J{j:.3f} F900")
        x, y = round(x1, 3), round(y1, 3)
    return "\n".join([*lines, "G0 Z2", "M2", ""])


def arcs_of(text: str) -> list[tuple[float, float]]:
    """Radius [mm] and angle [rad] of the arcs of a program, in order."""
    place, mode, found = {"X": 0.0, "Y": 0.0}, 0, []
    for line in text.splitlines():
        words = dict(WORD.findall(re.sub(r"\([^)]*\)|;.*", "", line)))
        mode = int(float(words["G"])) if words.get("G") in {"0", "1", "2", "3"} else mode
        end = {name: float(words.get(name, value)) for name, value in place.items()}
        if mode in {2, 3} and {"I", "J"} & set(words):
            center = place["X"] + float(words.get("I", 0.0)), place["Y"] + float(words.get("J", 0.0))
            first, last = (math.atan2(at["Y"] - center[1], at["X"] - center[0]) for at in (place, end))
            turn = (last - first if mode == 3 else first - last) % math.tau
            found.append((math.dist(center, (place["X"], place["Y"])), turn or math.tau))
        place = end
    return found


def sagitta(dialect: str, radius: float, turn: float) -> float:
    """Distance of the chords from an arc [µm], by the rule that the firmware publishes."""
    count = max(1, math.floor(radius * turn / 1.0)) if dialect == "klipper" else int(grbl_chords(radius, turn, 0.002))
    return 1e3 * radius * (1.0 - math.cos(0.5 * turn / max(count, 1)))


@pytest.mark.parametrize("dialect", ["klipper", "grbl"])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.thinned(4)
def test_arcs_beside_crossings_keep_their_chords(dialect: str, seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    radii = rng.uniform(1.2, 6.0, 6).round(2).tolist()
    text = serpentine(radii, rng.uniform(1.5, 4.0, 6).tolist())
    machine = replace(ph.read_machine("stepper"), dialect=dialect)
    file = tmp_path / "part.gcode"
    file.write_text(text, encoding="utf-8")
    result = ph.compensate(file, machine)
    assert result.reversals.compensated == result.reversals.all > 3, result.warnings
    coarsest: dict[float, float] = {}
    for radius, turn in arcs_of(text):
        own = round(radius, 1)
        coarsest[own] = max(coarsest.get(own, 0.0), sagitta(dialect, radius, turn))
    written = arcs_of(result.program().decode())
    assert len(written) > len(radii)
    kept = {(round(radius, 1), round(turn, 1)) for radius, turn in arcs_of(text)}
    for radius, turn in written:
        own = coarsest[min(coarsest, key=lambda one: abs(one - radius))]
        divided = (round(radius, 1), round(turn, 1)) not in kept
        most = FINE if divided and own > COARSE else own
        assert sagitta(dialect, radius, turn) <= most + CLOSE, (radius, turn)
