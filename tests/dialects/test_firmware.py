"""No word that firmware refuses: shipped paths, all strategies, against lists of the words it has."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from support.firmware import LINES, RefusedError, commands, travel

from ph_post.analysis.path_analysis import analyse
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.strategies.registry import strategy_names
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.geometry.track import Track
from ph_post.post.options import ProgramOptions
from ph_post.post.program import make_program
from ph_post.types import Machine, Plan
from ph_post.units import MM, MM_PER_MIN, MS

ROOT = Path(__file__).resolve().parents[2]
PATHS = sorted((ROOT / "paths").glob("*.json"))
HOW = ProgramOptions(block_time=50 * MS, chord_tolerance=0.01 * MM)
PRINTERS = ("marlin", "klipper")


def machine() -> Machine:
    """Ideal steppers on X, Y and Z: those of a golden case, Y's drive on Z as well."""
    found = read_machine(str(ROOT / "tests" / "golden" / "ring_jogs" / "machine.toml"))
    return replace(found, axes={**found.axes, "Z": replace(found.axes["Y"], name="Z")})


def plan_of(path: Path, strategy: str) -> Plan:
    how = PlanOptions(
        strategy=strategy,
        carrier="program",
        inverse_dynamics=False,
        effort=0.001,
        max_slowdown=9.0,
        allow_retrograde=strategy == "retrograde",
    )
    return make_plan(analyse(read_path(str(path)), machine(), 0.005 * MM), how)


SEARCHING = ("auto", "takeup")
"""Strategies that search, seconds a path; they write the words of the others, and are tried on the circle."""

CASES = [
    pytest.param(path, strategy, id=f"{path.stem}-{strategy}")
    for path in PATHS
    for strategy in strategy_names()
    if strategy not in ("step", "fly") and (strategy not in SEARCHING or path.stem == "circle")
]
"""No program of a path can carry `step` or `fly`."""


@pytest.mark.thinned(12)
@pytest.mark.parametrize(("path", "strategy"), CASES)
def test_no_program_has_a_word_that_firmware_refuses(path: Path, strategy: str) -> None:
    plan = plan_of(path, strategy)
    track = Track(plan.path)
    for firmware in LINES:
        text = make_program(plan, track, find_dialect(firmware), HOW).text
        words = [word for line in text.splitlines() for word, _ in commands(line, firmware)]
        assert {"G21", "G90", "G0", "G1"} <= set(words) or firmware == "grbl"


@pytest.mark.parametrize("firmware", PRINTERS)
def test_printer_firmware_goes_where_the_path_goes(firmware: str) -> None:
    plan = plan_of(ROOT / "paths" / "circle.json", "none")
    text = make_program(plan, Track(plan.path), find_dialect(firmware), HOW).text
    trip = travel(text, firmware)
    radius = np.hypot(*trip.ends[3:, :2].T)
    assert np.ptp(radius) <= 2e-3
    assert all(abs(a - b) <= 2e-4 for a, b in trip.arcs)
    assert bool(trip.arcs) == (firmware == "marlin")
    assert 0.9 < max(trip.feeds[3:]) / (plan.path.feed / MM_PER_MIN) <= 1.0


@pytest.mark.parametrize("firmware", PRINTERS)
def test_dwells_are_in_milliseconds(firmware: str) -> None:
    plan, own = plan_of(ROOT / "paths" / "circle.json", "dwell"), find_dialect(firmware)
    other = replace(find_dialect("grblhal"), abilities=own.abilities, numbers=own.numbers)
    texts = [make_program(plan, Track(plan.path), dialect, HOW).text for dialect in (own, other)]
    seconds = [float(one) for one in re.findall(r"^G4 P([\d.]+)$", texts[1], re.MULTILINE)]
    assert seconds
    assert travel(texts[0], firmware).dwells == pytest.approx(seconds, abs=1e-3)


@pytest.mark.parametrize(
    ("firmware", "line"),
    [
        ("grbl", "G64 P0.01"),
        ("grbl", "G61.1"),
        ("grbl", "G5 X1 Y1 I1 J1 P1 Q1"),
        ("grbl", "G1 X1 F1 F2"),
        ("grbl", "G1X1" + 80 * "0"),
        ("grblhal", "G64"),
        ("marlin", "G93"),
        ("marlin", "G21 G90"),
        ("marlin", "G1 X1 ; " + 99 * "x"),
        ("marlin", "(note)"),
        ("marlin", "X1 Y1"),
        ("marlin", "F600"),
        ("marlin", "G2 X1 Y1 I1 J0 P1"),
        ("marlin", "M2"),
        ("klipper", "G2 X1 Y1 I1 J0"),
        ("klipper", "G94"),
        ("klipper", "G4 S1"),
        ("klipper", "M2"),
        ("klipper", "(note)"),
    ],
)
def test_the_lists_refuse(firmware: str, line: str) -> None:
    with pytest.raises(RefusedError):
        commands(line, firmware)
