"""Machines drawn at random, measured by hand as a person would, and what ph_post makes of the readings."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

import ph_post as ph
from ph_post.testprograms.gauges import GaugeKit, gauge_kit

from . import hand_machine

MM = 1e-3
AXES = "XY"


@dataclass(frozen=True)
class Shop:
    """How a person reads: standard errors of dial and calipers and the steps in which they are read [mm]."""

    dial: float = 0.005
    dial_grain: float = 0.001
    calipers: float = 0.02
    calipers_grain: float = 0.01
    repeats: int = 2
    widths: int = 3


@functools.cache
def kit(repeats: int = 2) -> GaugeKit:
    return gauge_kit(ph.read_machine("stepper"), tool=6.0 * MM, repeats=repeats)


def draw(random: np.random.Generator, *, worn: bool = True) -> hand_machine.HandMachine:
    """Draw a machine; if `worn`, the play of every other axis changes along its travel, by 10 µm from middle to end."""
    return hand_machine.HandMachine(
        play={axis: random.uniform(0.0, 0.25) for axis in AXES},
        slope={axis: random.choice([0.0, random.normal(0.0, 2e-4)]) if worn else 0.0 for axis in AXES},
        squareness=random.normal(0.0, 1e-3),
        scale={axis: random.normal(0.0, 5e-4) for axis in AXES},
        cutter=6.0 + random.normal(0.0, 0.03),
        climb=abs(random.normal(0.0, 0.02)),
    )


def program(name: str, repeats: int = 2) -> str:
    return next(one.program for one in kit(repeats).programs if one.name == name)


def centres() -> dict[str, tuple[float, float]]:
    cut = kit().cut
    assert cut is not None
    return {shape: (x / MM, y / MM) for shape, (x, y) in cut.centres.items()}


def readings(
    machine: hand_machine.HandMachine, random: np.random.Generator, shop: Shop, dial: bool = True, cut: bool = False
) -> str:
    """Return a file of readings, as a person fills it in from the two tables of the sheet."""
    lines = ["swing_mm = 0.5"]
    for axis in AXES if dial else "":
        places = [row.place / MM for row in kit(shop.repeats).dial.rows if row.axis == axis]
        text = program(f"dial_{axis.lower()}", shop.repeats)
        for place, row in zip(places, machine.dial(text, axis, shop.dial, random, shop.dial_grain), strict=True):
            lines += ["[[dial]]", f'axis = "{axis}"', f"place_mm = {place}", f"readings = {row}"]
    if cut:
        lines += ["[cut]", "size_mm = 30", "tool_mm = 6"]
        for shape, widths in machine.cut(program("test_cut"), centres()).items():
            lines.append(f"[cut.{shape}]")
            for name, width in widths.items():
                read = width + random.normal(0.0, shop.calipers, shop.widths)
                grain = shop.calipers_grain
                lines.append(f"{name} = {[round(float(np.round(one / grain) * grain), 5) for one in read]}")
    return "\n".join(lines) + "\n"


def true_play(machine: hand_machine.HandMachine, axis: str) -> float:
    """Lost motion [mm] in the mean of the places at which the dial is read."""
    return float(np.mean([machine.width(axis, row.place / MM) for row in kit().dial.rows if row.axis == axis]))
