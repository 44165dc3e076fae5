"""Crossings on the fly in each path mode of a real LinuxCNC, with backlash of the test's own behind its joint commands.

A circle is cut twice around. What the controller's own path does to the original, without backlash behind the same
drive, is taken off: beyond it a crossing may cost 1.5 µm.
"""

from __future__ import annotations

import itertools
import math
import re
from typing import NamedTuple

import numpy as np
import pytest
from support.corpus import stepper
from support.editing import compensate
from support.real_cuts import behind, bench, lagging, outline
from support.rehearsing import HERE, WHY_NOT

import ph_post as ph
from ph_post.gcode.read import read_program
from ph_post.rehearse.linuxcnc import run_on_linuxcnc

pytestmark = [pytest.mark.skipif(not HERE, reason=WHY_NOT), pytest.mark.slow]


class Case(NamedTuple):
    """A circle: radius [mm], feed [mm/min], sense, lost motion [mm], acceleration [mm/s²], lag of the motors [s]."""

    radius: float
    feed: float
    sense: int = 3
    lost: float = 0.05
    push: float = 500.0
    lag: float = 0.0


CASE = Case(20, 1200)


def program(case: Case, mode: str = "G64 P0.002", chords: int = 0) -> bytes:
    """Two turns of a circle, as arcs or in as many chords."""
    r = case.radius
    lines = [f"G21 G90 G17 {mode}", f"G0 X{r} Y0 Z5", f"G1 Z0 F{case.feed}"]
    if chords:
        turned = [math.tau * k / chords for k in range(1, 2 * chords + 1)]
        lines += [f"G1 X{r * math.cos(t):.4f} Y{r * math.sin(t):.4f}" for t in turned]
    else:
        lines += 2 * [f"G{case.sense} X{r} Y0 I-{r} J0"]
    return "\n".join([*lines, "G0 Z5", "M2", ""]).encode()


def machine_of(case: Case):
    return bench(case.lost, case.push, case.lag)


def errors(rows: np.ndarray, case: Case, lost: float) -> tuple[float, float, float]:
    """Largest and rms distance from the circle [µm], from all initial sides, and the time of the cut [s]."""
    down = rows[:, 2] < 0.5e-3
    down[: int(np.argmax(rows[:, 2] > 4.9e-3))] = False
    first, last = np.flatnonzero(down)[[0, -1]]
    motors = [lagging(rows[:, axis], case.lag) for axis in range(2)]
    worst = 0.0, 0.0
    for sides in itertools.product((-1.0, 1.0), repeat=2):
        x, y = (behind(motor, 0.5e-3 * lost, side) for motor, side in zip(motors, sides, strict=True))
        away = np.abs(np.hypot(x, y)[first:last] - case.radius * 1e-3) * 1e6
        worst = max(worst, (float(away.max()), float(np.sqrt((away**2).mean()))))
    return *worst, (last - first) * 1e-3


def recorded(text: bytes, case: Case, backlash=None) -> np.ndarray:
    found = run_on_linuxcnc(text, "circle", machine_of(case), backlash=backlash)
    return np.asarray(found.position if backlash is None else found.motor)


def crossed(case: Case, text: bytes | None = None) -> bytes:
    job = read_program(program(case) if text is None else text, "circle.ngc")
    return ph.compensate(job, machine_of(case), max_slowdown=0.25).program()


@pytest.mark.parametrize(
    ("mode", "chords"),
    [
        ("G61", 0),
        ("G61.1", 0),
        # A quarter of the backlash, and all of it.
        ("G64 P0.0125", 0),
        ("G64 P0.05", 0),
        # The detector of collinear moves joins chords, and takes 10 and 50 µm from the radius; crossings stay.
        ("G64 P0.0125 Q0.0125", 400),
        ("G64 P0.05", 400),
    ],
)
@pytest.mark.thinned(4)
def test_path_modes_leave_crossings_as_they_are(mode: str, chords: int) -> None:
    case = CASE
    text = program(case, mode, chords)
    plain = recorded(text, case)
    own, untouched = errors(plain, case, 0.0), errors(plain, case, case.lost)
    done = errors(recorded(crossed(case, text), case), case, case.lost)
    assert untouched[0] > own[0] + 24.0
    assert done[0] <= own[0] + 1.5
    assert done[1] <= own[1] + 0.5
    assert done[2] <= 1.02 * untouched[2]


@pytest.mark.parametrize("chords", [0, 400])
def test_without_a_tolerance_crossings_stay_but_corners_are_cut_and_said(chords: int) -> None:
    case = CASE
    text = program(case, "G64", chords)
    plain = recorded(text, case)
    own, untouched = errors(plain, case, 0.0), errors(plain, case, case.lost)
    written = compensate(text, machine_of(case), max_slowdown=0.25).text
    done = errors(recorded(written, case), case, case.lost)
    assert untouched[0] > own[0] + 24.0
    assert done[0] <= own[0] + 1.5
    result = ph.compensate(read_program(text, "circle.ngc"), machine_of(case), max_slowdown=0.25)
    said = r"line 1: G64 without P rounds corners by up to \d+ µm \(line 3\), .*: G64 P0.01 Q0 keeps them"
    assert any(re.match(said, word) for word in result.warnings)


def off_outline(rows: np.ndarray, corners: list[tuple[float, float]], lost: float) -> tuple[float, float, float]:
    """Largest and rms distance from an outline [µm], from all initial sides, and the time of the cut [s]."""
    down = rows[:, 2] < 0.5e-3
    down[: int(np.argmax(rows[:, 2] > 4.9e-3))] = False
    first, last = np.flatnonzero(down)[[0, -1]]
    ends = 1e-3 * np.array(corners)
    start, way = ends[:-1], np.diff(ends, axis=0)
    worst = 0.0, 0.0
    for sides in itertools.product((-1.0, 1.0), repeat=2):
        place = np.stack([behind(rows[:, n], 0.5e-3 * lost, side) for n, side in enumerate(sides)], axis=1)[first:last]
        away = np.full(len(place), np.inf)
        for begin, line in zip(start, way, strict=True):
            share = np.clip((place - begin) @ line / (line @ line), 0.0, 1.0)
            away = np.minimum(away, np.linalg.norm(place - begin - share[:, None] * line, axis=1))
        worst = max(worst, (1e6 * float(away.max()), 1e6 * float(np.sqrt((away**2).mean()))))
    return *worst, (last - first) * 1e-3


@pytest.mark.parametrize("seed", [0, 1, 8, 11])
@pytest.mark.thinned(2)
def test_jogs_stay_in_corners_that_the_detector_of_collinear_moves_may_cut_off(seed: int) -> None:
    corners = outline(seed)
    moves = [f"G1 X{x:.3f} Y{y:.3f}" for x, y in corners[1:]]
    text = "\n".join(["G21 G90 G17 G64 P0.05", "G0 X0 Y0 Z5", "G1 Z0 F100", *moves, "G0 Z5", "M2", ""]).encode()
    machine = bench(0.05, 500.0, 0.0)
    written = ph.compensate(read_program(text, "outline.ngc"), machine).program()
    untouched, done = (
        off_outline(np.asarray(run_on_linuxcnc(one, "outline", machine).position), corners, 0.05)
        for one in (text, written)
    )
    assert untouched[1] > 12.0
    assert done[0] <= untouched[0]
    assert done[1] <= 0.1 * untouched[1]
    assert done[2] <= 1.1 * untouched[2]


def off_passes(rows: np.ndarray, ends: tuple[float, float], depth: float, lost: float) -> tuple[float, float]:
    """Largest and rms distance [µm] from passes along Y at a depth, with the way down to them and up from them."""
    worst = 0.0, 0.0
    for side in (-1.0, 1.0):
        y = 1e3 * behind(rows[:, 1], 0.5e-3 * lost, side)
        # Its zero is where it comes down.
        z = 1e3 * behind(rows[:, 2], 0.5e-3 * lost, side) - 0.5 * lost
        low = int(np.argmax(z < depth + 0.2))
        y, z = y[low:], z[low:]
        along = np.hypot(y - np.clip(y, *sorted(ends)), z - depth)
        up = [np.hypot(y - end, z - np.maximum(z, depth)) for end in ends]
        away = 1e3 * np.minimum(along, np.minimum(*up))[z < depth + 0.2]
        worst = max(worst, (float(away.max()), float(np.sqrt((away**2).mean()))))
    return worst


def test_corners_that_would_be_rounded_more_are_halted_in() -> None:
    # Without backlash the controller cuts the corner at the end of a pass by more than a table does that is not there.
    one = "G0 Z1\nG0 Y13\nG0 Z0.1\nG1 F40 Z-0.4\nG1 F300 Y-13\n"
    text = ("G21 G90 G17 G64\nG0 Z1\nG0 X-3 Y13\n" + 4 * one + "G0 Z1\nM2\n").encode()
    result = ph.compensate(read_program(text, "face.ngc"), stepper("linuxcnc"))
    plain, done = (
        off_passes(np.asarray(run_on_linuxcnc(data, "face", stepper("linuxcnc")).position), (13.0, -13.0), -0.4, 0.05)
        for data in (text, result.program())
    )
    assert plain[0] > 50.0
    assert done[0] <= plain[0]
    assert done[1] <= plain[1] / 5.0
    assert result.after.time <= 1.1 * result.before.time
