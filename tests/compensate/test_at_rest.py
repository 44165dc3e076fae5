"""Backlash crossed while its axis rests, or beside a turn: on plays, cascades and rubbing tables of the tests' own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.cascade_plant import motor_of, pushed
from support.closed_loops import (
    LIMITS,
    MM,
    Rows,
    distances,
    draw_machine,
    machine_text,
    of_table,
    outline,
    path_text,
)
from support.motions import look, make_machine
from support.plants.axis import Hidden, Plant
from support.plants.loops import PERIOD, follow

import ph_post as ph
from ph_post.compensate.crossing_times import has_moved, rest_before
from ph_post.compensate.offsets import command_of
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.files.path import read_path
from ph_post.types import Gap, Servo

pytestmark = pytest.mark.drawn(4)

KNOWN = "backlash_uncertainty = 0.005\nfriction_uncertainty = 0.005\n"
"""What a diagnosed file says of its uncertainties."""

LOST = 40e-6


def pocket(folder: Path) -> Path:
    found = folder / "pocket.json"
    found.write_text(path_text("pocket"))
    return found


def known_file(folder: Path, seed: int, loop: str) -> Path:
    """A machine file with all that the plants have."""
    text = machine_text(draw_machine(seed, loop).true, friction=True)
    for name in "XY":
        text = text.replace(f"[axes.{name}.control]", KNOWN + f"[axes.{name}.control]", 1)
    file = folder / "known.toml"
    file.write_text(text)
    return file


def stepper():
    limits = {key: value / MM for key, value in LIMITS.items()}
    return make_machine(
        feedback="none",
        servo=Servo(b=0.0, c=0.0),
        gap=Gap(lost_motion=LOST),
        velocity=limits["max_velocity_mm_s"],
        acceleration=limits["max_acceleration_mm_s2"],
        jerk=limits["max_jerk_mm_s3"],
    )


def test_a_rest_is_as_long_as_its_straight_lines(tmp_path: Path) -> None:
    analysis = look(read_path(pocket(tmp_path)), stepper())
    axis = analysis.machine.axes["X"]
    # Lines of 12, 13 and 6 mm at 20 mm/s; that of Y before them takes longer than is looked.
    found = {point.index: rest_before(analysis.track, point, axis, True) for point in analysis.turning_points}
    assert [point.kind for point in analysis.turning_points] == ["dwell"] * 4
    ways = {0: 1.0, 1: 12.0 / 20.0, 2: 13.0 / 20.0, 3: 6.0 / 20.0}
    for index, time in ways.items():
        assert found[index].end == pytest.approx(-0.01)
        assert found[index].begin == pytest.approx(0.01 - time, abs=0.004)
        assert found[index].begin >= 0.01 - time - 1e-9
    assert [has_moved(analysis.track, analysis.turning_points, one) for one in analysis.turning_points] == [
        False,
        True,
        True,
        True,
    ]
    circle = tmp_path / "circle.json"
    circle.write_text(path_text("circle"))
    other = look(read_path(circle), stepper())
    assert all(rest_before(other.track, one, axis, True).start_of(0.0) is None for one in other.turning_points)


def play(motor: np.ndarray, flank: int) -> np.ndarray:
    """A table behind a backlash, at first on a side of it."""
    table, place = np.empty_like(motor), motor[0] - flank * 0.5 * LOST
    for row, x in enumerate(motor):
        place = min(max(place, x - 0.5 * LOST), x + 0.5 * LOST)
        table[row] = place
    return table


@pytest.mark.parametrize("sides", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_a_table_that_rests_before_it_turns_is_crossed_without_an_error_and_without_a_stop(
    sides: tuple[int, int], tmp_path: Path
) -> None:
    analysis = look(read_path(pocket(tmp_path)), stepper())
    plain = make_plan(analysis, PlanOptions(strategy="none"))
    plan = make_plan(analysis, PlanOptions(strategy="takeup", effort=0.05))
    before, command = (command_of(one, analysis.track, 1e-3) for one in (plain, plan))
    tables = [play(column, side) for column, side in zip(command.position.T, sides, strict=True)]
    on_path = command.t >= plan.phases[0].duration
    away = distances(np.column_stack(tables), outline("pocket"))[on_path]
    # Untouched it is half of the backlash off; at full feed into the arcs it was 11 µm.
    assert away.max() < 0.2e-6
    assert len(command.t) - len(before.t) <= np.count_nonzero(~on_path) + 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("loop", "seed", "shape", "largest"),
    [
        ("load", 2, "circle", 3e-6),
        ("load", 2, "pocket", 4e-6),
        ("load", 1, "pocket", 4e-6),
        ("motor", 1, "pocket", 2e-6),
    ],
)
def test_cascades_with_friction(loop: str, seed: int, shape: str, largest: float, tmp_path: Path) -> None:
    """All of these were 25 to 35 µm off by the same files."""
    machine = draw_machine(seed, loop)
    found = of_table(tmp_path, shape, known_file(tmp_path, seed, loop), machine.true)
    assert found.largest < largest


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "largest"), [(46, 50e-6), (51, 35e-6)])
def test_friction_that_an_integrator_has_not_taken_over_at_the_end_is_let_go(
    seed: int, largest: float, tmp_path: Path
) -> None:
    """Commands that came to rest cut off 20 µm of it, by 18 times the jerk: pockets were left 211 and 286 µm off."""
    found = of_table(tmp_path, "pocket", known_file(tmp_path, seed, "load"), draw_machine(seed, "load").true)
    assert found.largest < largest


@pytest.mark.slow
def test_all_of_the_lead_is_seen_through_the_usual_window_where_nothing_else_takes_time(tmp_path: Path) -> None:
    """A narrower window was kept that a lesser time had asked for, which broke limits: the pocket was 22 µm off."""
    found = of_table(tmp_path, "pocket", known_file(tmp_path, 44, "load"), draw_machine(44, "load").true)
    assert found.largest < 4e-6


@pytest.mark.slow
@pytest.mark.parametrize("side", [1, -1])
def test_friction_keeps_no_table_short_of_its_side(side: int, tmp_path: Path) -> None:
    """Motors were brought back while nothing led their friction, and came 4.4 of 19 µm short on one side of it."""
    machine = draw_machine(1, "motor")
    true = tuple(replace(one, flank=side) for one in machine.true)
    found = of_table(tmp_path, "pocket", known_file(tmp_path, 1, "motor"), (true[0], true[1]))
    assert found.largest < 1e-6


@pytest.mark.slow
def test_a_table_that_would_run_on_is_run_so_gently_that_friction_holds_it(tmp_path: Path) -> None:
    """Between stiff stops, with 0.8 of its friction, behind motors that another stepping makes of the table."""
    machine = draw_machine(2, "motor")
    found = ph.compensate(
        read_path(pocket(tmp_path)),
        ph.read_machine(known_file(tmp_path, 2, "motor")),
        output="table",
        effort=0.1,
    )
    assert any("X is run with at most 220 mm/s², so that friction holds its table" in one for one in found.warnings)
    assert not any("may run on" in one for one in found.warnings)
    command = found.table()
    tables = []
    for column, plant in zip(command.position.T, machine.true, strict=True):
        assert plant.drive is not None
        friction = plant.effects[0]["force"] / plant.b
        motor = motor_of(plant.drive, column - column[0], friction) + column[0]
        tables.append(pushed(motor, plant.gap, 0.8 * friction))
    counted = (command.t > 0.3) & (command.t < command.t[-1] - 0.3)
    away = distances(np.column_stack(tables), outline("pocket"))[counted]
    assert away.max() < 5e-6


def test_a_motor_that_was_pushed_hard_enough_for_an_instant_goes_on_when_it_is_pushed_again() -> None:
    """The tests' own plant had stood still for ever, its integrator with it; another stepping says where it goes."""
    from support.cascade_plant import Drive

    drive = Drive(kv=56.0, wv=236.0, tn=0.02, velocity=0.7, current=2e-4)
    b = 1.0 / (drive.kv * drive.wv)
    plant = Plant("motor", b, 1.0 / drive.kv, effects=(Hidden("coulomb_friction", {"force": 76e-6}),), drive=drive)
    t = PERIOD * np.arange(900)
    away = 76.2e-6 * np.clip((t - 0.1) / 0.03, 0.0, 1.0) * np.exp(-np.clip(t - 0.135, 0.0, None) / 0.02)
    command = away + 30e-6 * np.clip((t - 0.3) / 0.2, 0.0, 1.0)
    track = Rows(np.column_stack([command, command]))
    found = follow(plant, track, 0).motor[: len(t)]
    assert found == pytest.approx(motor_of(drive, command, 76e-6 / b), abs=0.5e-6)
    assert found[-1] > 20e-6


def test_the_ends_of_a_trial_break_no_limit(tmp_path: Path) -> None:
    """A circle at a steady feed takes far less than a limit of the axes, led or not; its trial began with 1.09."""
    from ph_post.compensate.choose import search_scenarios
    from ph_post.compensate.motion import FeedAlong, MotionLaw
    from ph_post.compensate.trial import Design, Trial, find_surroundings
    from ph_post.simulate.contour import Nominal

    file, path = known_file(tmp_path, 2, "load"), tmp_path / "circle.json"
    path.write_text(path_text("circle"))
    machine = ph.read_machine(file)
    analysis = look(read_path(path), machine)
    plan = make_plan(analysis, PlanOptions(strategy="none"))
    feed = FeedAlong(MotionLaw.from_phases(plan.phases), 1e-3, analysis.track.length, False)
    place = next(one for one in find_surroundings(analysis, feed, False) if one is not None)
    trial = Trial(
        Nominal(analysis.track), analysis.track, place, machine, search_scenarios(machine, ("X", "Y"))[0][:1], machine
    )
    # 20 of 200 mm/s; 33 of 1000 mm/s².
    assert trial.run(Design(lead=True)).use == pytest.approx(0.1, abs=0.01)
