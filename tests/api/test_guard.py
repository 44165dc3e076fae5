"""Programs for tables that run on in their backlash, executed by a cascade and a table of the tests' own equations."""

from __future__ import annotations

from functools import cache
from pathlib import Path as File

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial import cKDTree

import ph_post as ph
from ph_post.api.guard import GuardFinding, by_what_is_done
from ph_post.gcode.read import read_program
from ph_post.types import EffectSetting, Limits, Machine
from tests.support.cascade_plant import PERIOD, Drive, motor_of, play, pushed
from tests.support.cascade_records import machine_of
from tests.support.closed_loops import distances, outline
from tests.support.corpus import Entry
from tests.support.corpus_judge import judge
from tests.support.played import play_program

DRIVE, GAP = Drive(tn=12e-3, velocity=0.9), 3e-5
LIMITS = Limits(velocity=0.1, acceleration=0.8, jerk=80.0)
PROGRAM = """G21 G90 G17 G94 G64 P0.005
G0 X0 Y0
G0 Z2
G1 Z-1 F300
G1 X20 F900
G3 X21 Y1 I0 J1
G1 Y11
G3 X20 Y12 I-1 J0
G1 X4
G0 Z2
G0 X41 Y3
G1 Z-1 F300
G3 X41 Y3 I-8 J0 F900
G0 Z2
M2
"""
"""Arcs of 1 mm, across which a motor brakes with 0.225 m/s², and of 8 mm, 0.028 m/s²."""


def machine(friction: float) -> Machine:
    """Return a machine whose file has a friction [m/s²]."""
    axis = replace(machine_of(DRIVE, GAP).axes["X"], limits=LIMITS)
    error = {"following_error_mm": 1e3 * friction / (DRIVE.kv * DRIVE.wv)}
    axis = replace(axis, effects=(EffectSetting(name="coulomb_friction", parameters=error),))
    axes = {name: replace(axis, name=name) for name in "XY"}
    axes["Z"] = replace(machine_of(DRIVE).axes["X"], name="Z", limits=LIMITS)
    return replace(machine_of(DRIVE), axes=axes)


@cache
def compensated(friction: float, slowdown: float = 0.15) -> tuple[str, tuple[str, ...]]:
    found = ph.compensate(read_program(PROGRAM.encode(), "slot"), machine(friction), max_slowdown=slowdown)
    return found.program().decode(), found.warnings


def played(text: str) -> np.ndarray:
    return play_program(text, "XYZ", PERIOD, np.zeros(3)).position


@cache
def errors(text: str, brakes: float) -> tuple[float, float]:
    """Largest and rms distance [µm] of a table from the path that friction brakes by so much [m/s²]."""
    place = played(text)
    tables = []
    for column in place.T[:2]:
        motor = motor_of(DRIVE, column - column[0], fine=10) + column[0]
        tables.append(play(motor, GAP) if np.isinf(brakes) else pushed(motor, GAP, brakes))
    fine = play_program(PROGRAM, "XYZ", 2e-4, np.zeros(3)).position
    way = cKDTree(fine[fine[:, 2] < -0.5e-3, :2])
    moves = np.hypot(*np.gradient(place[:, :2], axis=0).T) > 1e-8
    off = 1e6 * way.query(np.stack(tables, axis=1)[(place[:, 2] < -0.99e-3) & moves])[0]
    return float(off.max()), float(np.sqrt((off**2).mean()))


@pytest.mark.parametrize("brakes", [0.06, 0.15, np.inf])
def test_no_table_is_worse_than_with_the_original_whether_it_runs_on_or_stays(brakes: float) -> None:
    text, said = compensated(0.06)
    before, after = errors(PROGRAM, brakes), errors(text, brakes)
    assert after[0] <= 1.01 * before[0]
    assert after[1] < 0.9 * before[1]
    # The slot is left and named; the circle is not, on which no motor brakes as hard as friction.
    slot, changed = (
        text[text.index(first) : text.index(last)]
        for first, last in (("G0 X0", "(ph-post: +6"), ("(ph-post: +6", "M2"))
    )
    assert slot in PROGRAM
    assert any("lines 2 to 9: the part would be worse where a table runs on" in one for one in said)
    assert any("the table of axis X may run on" in one and "its friction, 60 mm/s²" in one for one in said)
    assert "crossing Y-, crossing X+, crossing Y+" in changed


@pytest.mark.parametrize("brakes", [0.06, 0.15, np.inf])
def test_where_there_is_time_tight_arcs_and_stops_are_so_slow_that_tables_stay(brakes: float) -> None:
    text, said = compensated(0.06, 0.3)
    before, after = errors(PROGRAM, brakes), errors(text, brakes)
    assert after[0] < 0.25 * before[0]
    assert after[1] < 0.25 * before[1]
    assert not any("not compensated" in one for one in said)
    # Across 1 mm at √(0.75 · 60 mm/s² · 1 mm); the circle keeps its feed but for its end.
    assert text.count("F402.4922") == 2
    assert "G1 X20.015 F402.4922\nG3 X21.015 Y1.015 I0 J1\n" in text
    assert text.count("F900\n") > 4
    short = next(one for one in compensated(0.06)[1] if "which would add 0." in one)
    enough = float(short.split("--max-slowdown ")[1].split()[0])
    assert 0.15 < enough < 0.3
    assert not any("not compensated" in one for one in compensated(0.06, enough)[1])


def test_what_is_written_for_much_friction_is_worse_on_easy_guideways() -> None:
    """What the guard keeps from those who state their friction: the test above could fail."""
    text, said = compensated(0.8)
    assert errors(text, 0.06)[0] > 1.15 * errors(PROGRAM, 0.06)[0]
    assert errors(text, 0.06)[1] > 1.3 * errors(PROGRAM, 0.06)[1]
    assert errors(text, np.inf)[1] < 0.25 * errors(PROGRAM, np.inf)[1]
    assert not any("run on" in one or "not compensated" in one for one in said)


POCKET = """G21 G90 G17 G94 G64 P0.002
G0 X3 Y0
G0 Z2
G1 Z-1 F300
G1 X24 Y0 F1200
G1 X24 Y12
G3 X21 Y15 I-3 J0
G1 X8 Y15
G1 X0 Y9
G1 X0 Y3
G3 X3 Y0 I3 J0
G0 Z2
M2
"""
SWIFT = Drive(kv=67.6, wv=513.0, tn=6.1e-3, velocity=0.95)


@pytest.mark.slow
def test_the_slow_end_of_an_arc_is_slow_behind_a_controller_that_rounds_joints() -> None:
    """It went in a blend at the full feed, the table ran on there, and the whole contour was left.

    The commands are those of the package's model of LinuxCNC, with its ramps, behind which the tests' own drive and
    tables stand.
    """
    axis = replace(machine_of(SWIFT, GAP).axes["X"], limits=replace(LIMITS, acceleration=1.0, jerk=50.0))
    axes = {}
    for name, friction in (("X", 0.3), ("Y", 0.85)):
        error = {"following_error_mm": 1e3 * friction / (SWIFT.kv * SWIFT.wv)}
        own = (EffectSetting(name="coulomb_friction", parameters=error),)
        axes[name] = replace(axis, name=name, effects=own)
    axes["Z"] = replace(machine_of(SWIFT).axes["X"], name="Z", limits=axis.limits)
    found = ph.compensate(
        read_program(POCKET.encode(), "pocket"), replace(machine_of(SWIFT), axes=axes), effort=0.1, max_slowdown=0.1
    )
    assert not any("not compensated" in one for one in found.warnings)
    points = outline("pocket")
    for brakes in ((0.3, 0.85), (np.inf, np.inf)):
        sizes = []
        for command in (found.before.command.position, found.after.command.position):
            tables = []
            for column, own in zip(command.T[:2], brakes, strict=True):
                motor = motor_of(SWIFT, column - column[0], fine=10) + column[0]
                tables.append(play(motor, GAP) if np.isinf(own) else pushed(motor, GAP, own))
            off = distances(np.stack(tables, axis=1)[command[:, 2] < -0.9999e-3], points)
            sizes.append((off.max(), np.sqrt((off**2).mean())))
        assert sizes[1][0] < 1.01 * sizes[0][0]
        assert sizes[1][1] < sizes[0][1] / 5.0


def test_an_error_weighs_by_the_way_on_which_it_is_and_not_by_its_time() -> None:
    """A long first move from an unknown side ends in a stop: it takes longer then, and nothing else is any worse."""
    moves = ["X10", "X-20", "X10", "Y10", "Y-20", "Y10"]
    lines = ["G21 G90 G94", "G1 Z5 F9999", "G1 X20 Y20", "G1 Z0.5", "G91", *(["G1 Z-2", *moves] * 4), "G90", "M2"]
    found = judge(Entry("cross", File(), "grbl", "\n".join(lines) + "\n"))
    assert found.compensated == found.reversals > 10
    assert found.followed > 0.9 * found.shown > 10
    assert 5.0 * found.rms[1] < found.rms[0]


@pytest.mark.parametrize(
    ("left", "worse"),
    [({1, 2, 3}, set()), ({2, 3}, {2}), ({1, 3}, {2}), (set(), {2})],
    ids=["between others", "first of two", "alone changed", "none left"],
)
def test_a_cut_that_is_left_between_others_is_as_it_was(left: set[int], worse: set[int]) -> None:
    found = GuardFinding(worse=frozenset({2}), runs_on=frozenset({2}), slowdown=0.0, planned=0.0)
    judged = by_what_is_done(found, frozenset(left), 5)
    assert (judged.worse, judged.runs_on) == (worse, worse)
