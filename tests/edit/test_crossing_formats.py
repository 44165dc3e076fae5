"""Crossings in all ways of writing a motion, executed by a player of the tests' own and read by rs274."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from support.canonical import canonical_calls
from support.editing import compensate
from support.reference_player import BEGINS, distance, interpret, run, tables

from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import reread
from ph_post.types import Machine
from ph_post.verify.verify import verify

LOST = (0.05, 0.06, 0.04)
RS274 = shutil.which("rs274")

HEAD = "G21 G90 G17 G91.1 G94\nG0 X0 Y0 Z0\n"
END = "G17 G90\nG0 Z30\nG0 X0 Y0\nM2\n"

CASES = {
    "G17, begins on a reversal": "G0 X20 Y0\nG1 Z-5 F300\nG3 X20 Y0 I-20 J0 F1200\nG3 X20 Y0 I-20 J0\n",
    "G18, begins on a reversal": "G18\nG0 X20 Z0\nG1 Y-5 F300\nG3 X20 Z0 I-20 K0 F1200\nG3 X20 Z0 I-20 K0\n",
    "G19, begins on a reversal": "G19\nG0 Y20 Z0\nG1 X-5 F300\nG3 Y20 Z0 J-20 K0 F1200\nG2 Y20 Z0 J-20 K0\n",
    "helix in G17": "G0 X16 Y12\nG1 Z-1 F300\nG2 X16 Y12 Z-2 I-16 J-12 F1000\nG2 X-20 Y0 Z-2.4 I-16 J-12\n",
    "helix in G18": "G18\nG0 X16 Z-12\nG1 Y-1 F300\nG2 X16 Z-12 Y-2 I-16 K12 F1000\nG3 X16 Z-12 Y-3 I-16 K12\n",
    "helix in G19": "G19\nG0 Y16 Z-12\nG1 X-1 F300\nG2 Y16 Z-12 X-2 J-16 K12 F1000\nG3 Y16 Z-12 X-3 J-16 K12\n",
    "R in G17": "G0 X-10 Y0\nG1 Z-1 F300\nG2 X10 Y0 R10 F1000\nG2 X0 Y-10 R-10\nG3 X-6 Y-2 R10\n",
    "R in G18": "G18\nG0 X-10 Z-10\nG1 Y-1 F300\nG2 X10 Z-10 R10 F1000\nG2 X0 Z-20 R-10\n",
    "R in G19": "G19\nG0 Y-10 Z-10\nG1 X-1 F300\nG2 Y10 Z-10 R10 F1000\nG3 Y0 Z-20 R-10\n",
    "G91": "G0 X20 Y0\nG1 Z-1 F300\nG91\nG3 X0 Y0 I-20 J0 F1200\nG1 X-5\nG2 X-5 Y5 I0 J5\nG2 X-5 Y-5 R5\nG90\n",
    "G91 in G18": "G18\nG0 X20 Z-20\nG1 Y-1 F300\nG91\nG3 X0 Z0 I-20 K0 F1200\nG1 X-5\nG90\n",
    "G90.1": "G0 X20 Y3\nG1 Z-1 F300\nG90.1\nG3 X20 Y3 I0 J3 F1200\nG3 X-20 Y3 I0 J3\nG91.1\n",
    "G90.1 in G19": "G19\nG0 Y20 Z-30\nG1 X-1 F300\nG90.1\nG3 Y20 Z-30 J0 K-30 F1200\nG2 Y0 Z-10 J0 K-30\nG91.1\n",
    "G93": "G0 X20 Y0\nG1 Z-1 F300\nG93\nG3 X20 Y0 I-20 J0 F9.5493\nG3 X-20 Y0 I-20 J0 F19.0986\nG1 X-10 F120\nG94\n",
    "G93 in G91": "G0 X20 Y0\nG1 Z-1 F300\nG93 G91\nG3 X0 Y0 I-20 J0 F9.5493\nG1 X-10 F120\nG94 G90\n",
}

INCHES = {
    "G20": "G0 X0.75 Y0\nG1 Z-0.04 F12\nG3 X0.75 Y0 I-0.75 J0 F48\nG1 X0.5\n",
    "G20, G91": "G0 X0.75 Y0\nG1 Z-0.04 F12\nG91\nG3 X0 Y0 I-0.75 J0 F48\nG1 X-0.25\nG90\n",
    "G20, R, G18": "G18\nG0 X-0.5 Z-0.5\nG1 Y-0.04 F12\nG2 X0.5 Z-0.5 R0.5 F48\nG2 X0 Z-1 R-0.5\n",
    "G20, G90.1": "G0 X0.75 Y0.1\nG1 Z-0.04 F12\nG90.1\nG3 X0.75 Y0.1 I0 J0.1 F48\nG91.1\n",
    "G20, G93": "G0 X0.75 Y0\nG1 Z-0.04 F12\nG93\nG3 X0.75 Y0 I-0.75 J0 F10\nG94\n",
}


def machine() -> Machine:
    """Steppers behind LinuxCNC; all zeros are taken from both sides."""
    one, axes = read_machine("stepper"), {}
    for (name, axis), lost in zip(one.axes.items(), LOST, strict=True):
        limits = replace(axis.limits, acceleration=0.5, velocity=0.1)
        gap = axis.gap.with_lost_motion(1e-3 * lost)
        axes[name] = replace(axis, gap=gap, limits=limits, reference_direction="both")
    return replace(one, axes=axes, dialect="linuxcnc", servo_period=1e-3)


def whole(name: str) -> str:
    if name in CASES:
        return HEAD + CASES[name] + END
    return HEAD.replace("G21", "G20") + INCHES[name] + END.replace("Z30", "Z1")


def errors(original: str, changed: str) -> np.ndarray:
    """Distances [mm] of tables from the original where it is cut, beyond the plunge."""
    path = [move for move in interpret(original) if move.mode > 0]
    seen = []
    for begin in BEGINS:
        moves = interpret(changed, begin)
        done = run(moves, 0.02)
        first = next(k for k, move in enumerate(moves) if move.mode >= 2)
        last = next(k for k, move in enumerate(moves) if move.mode == 0 and k > first)
        cut = (done.owner >= first) & (done.owner < last)
        seen += [table[cut] for table in tables(done.motor, LOST, (0, 0, 0))]
    return np.concatenate([distance(one, path) for one in seen])


@pytest.mark.parametrize("name", [*CASES, *INCHES])
@pytest.mark.thinned(12)
def test_the_table_keeps_to_the_path_however_it_is_written(name: str, tmp_path: Path) -> None:
    text = whole(name)
    made = compensate(text.encode(), machine())
    changed = made.text.decode()
    assert made.program.notes == ()
    assert "crossing" in changed
    declared = float(re.search(r"within ([\d.]+) mm", changed)[1])
    # Places are rounded to four decimals of a millimetre, of an inch to five.
    step = 25.4e-5 if name in INCHES else 1e-4
    after, before = errors(text, changed), errors(text, text)
    assert after.max() <= declared + step
    assert np.sqrt((after**2).mean()) < 0.1 * np.sqrt((before**2).mean())
    assert verify(made.program, reread(made.program, made.text), machine=machine(), tolerance=5e-6).ok
    if RS274 is not None:
        calls = [canonical_calls(one.encode(), tmp_path) for one in (text, changed)]
        assert None not in calls
        assert calls[1].others == calls[0].others


def test_feeds_per_turn_are_left_alone_and_named() -> None:
    text = HEAD + "S1000 M3\nG0 X20 Y0\nG1 Z-1 F300\nG95\nG3 X20 Y0 I-20 J0 F0.2\nG94\n" + END
    made = compensate(text.encode(), machine())
    assert made.text == text.encode()
    assert any("the feed is not known (G95" in said for said in made.edits.warnings)


def test_an_inch_has_five_decimals_on_grbl() -> None:
    text = whole("G20").replace(" G91.1", "")
    changed = compensate(text.encode(), replace(machine(), dialect="grbl"), dialect="grbl").text.decode()
    decimals = {len(digits) for digits in re.findall(r"[XY]-?\d*\.(\d+)", changed)}
    assert max(decimals) == 5
    assert errors(text, changed).max() <= float(re.search(r"within ([\d.]+) mm", changed)[1]) + 25.4e-5
