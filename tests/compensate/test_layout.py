"""Lasting offsets of loops that do not see the table: a play operator moves it, written here."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from support.motions import look, make_machine, make_path
from support.two_masses import body_of, table_of

from ph_post.compensate.layout import first_pushes
from ph_post.compensate.offsets import command_of, lead_in, plan_time
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import Planner, make_plan
from ph_post.compensate.strategies.base import ProfileRequest, StrategyResult
from ph_post.compensate.violations import check_command
from ph_post.drive.machinefile import read_machine
from ph_post.geometry.curves import Arc, Line
from ph_post.types import Command, Gap, Machine, Path, Plan, Servo

LOST = 40e-6

NEAR = 1e-11
"""Rounding of times moves a table by some 1e-12 m."""


def play(command: np.ndarray, gap: float, flank: int) -> np.ndarray:
    """The table behind a gap: it moves when it is touched, and stays where it was left."""
    table = np.empty_like(command)
    place = command[0] - flank * 0.5 * gap
    for k, motor in enumerate(command):
        place = min(max(place, motor - 0.5 * gap), motor + 0.5 * gap)
        table[k] = place
    return table


def stepper(flank: str = "unknown", **limits: float) -> Machine:
    """Axes that follow at once, so that nothing but the gap is between command and table."""
    gap = Gap(lost_motion=LOST, initial_flank=flank)
    return make_machine(feedback="none", servo=Servo(b=0.0, c=0.0), gap=gap, **limits)


@lru_cache(maxsize=8)
def hooked(flank: str = "unknown", start: str = "rest") -> tuple[Plan, Command]:
    return take_up(hook(), stepper(flank), start)


def take_up(
    path: Path, machine: Machine, start: str = "rest", strategy: str = "takeup", **more
) -> tuple[Plan, Command]:
    analysis = look(path, machine)
    options = {"strategy": strategy, "start": start, "max_slowdown": 0.5, "effort": 0.05} | more
    plan = make_plan(analysis, PlanOptions(**options))
    return plan, command_of(plan, analysis.track, machine.servo_period)


def hook() -> Path:
    """Out along X, half a turn to the left, back, and in a sharp corner out again."""
    r, long = 0.01, 0.03
    return make_path(
        [
            Line([(0.0, 0.0), (long, 0.0)]),
            Arc(np.array([long, 0.0]), np.array([long, 2 * r]), np.array([long, r]), "ccw"),
            Line([(long, 2 * r), (0.0, 2 * r)]),
            Line([(0.0, 2 * r), (long, 2.5 * r)]),
        ]
    )


def moved_table(command: Command, gap: float, flanks: tuple[int, int]) -> np.ndarray:
    columns = zip(command.position.T, flanks, strict=True)
    return np.column_stack([play(column, gap, flank) for column, flank in columns])


FLANKS = [(1, 1), (1, -1), (-1, 1), (-1, -1)]


@pytest.mark.parametrize("flanks", FLANKS)
def test_whatever_flank_an_axis_stood_on_its_table_starts_on_the_path(flanks: tuple[int, int]) -> None:
    plan, command = hooked()
    table = moved_table(command, LOST, flanks)
    path = command.position - command.offset
    first = int(np.argmax(command.s > 0.0))
    turning = plan.turning_points[0].s
    before = (np.arange(command.t.size) >= first) & (command.s < turning - 2e-3)
    np.testing.assert_allclose(table[before, 0], path[before, 0], rtol=0.0, atol=NEAR)


@pytest.mark.parametrize("flanks", FLANKS)
def test_an_axis_is_across_its_gap_before_it_moves_out_of_a_corner(flanks: tuple[int, int]) -> None:
    _, command = hooked()
    table = moved_table(command, LOST, flanks)
    path = command.position - command.offset
    corner = 0.06 + np.pi * 0.01
    beyond = command.s > corner + 1e-12
    assert beyond.sum() > 100
    np.testing.assert_allclose(table[beyond, 0], path[beyond, 0], rtol=0.0, atol=NEAR)
    before, after = np.flatnonzero(command.s < corner - 1e-9)[-1], np.flatnonzero(beyond)[0]
    assert command.offset[after, 0] - command.offset[before, 0] == pytest.approx(LOST, rel=1e-9)


@pytest.mark.parametrize("factor", [0.8, 1.2])
@pytest.mark.parametrize("flanks", FLANKS)
def test_a_gap_of_another_size_leaves_half_the_difference(flanks: tuple[int, int], factor: float) -> None:
    _, command = hooked()
    table = moved_table(command, factor * LOST, flanks)
    path = command.position - command.offset
    # The first way out of the corner is what takes up the rest of a gap that is wider.
    beyond = command.s > 0.06 + np.pi * 0.01 + 1e-4
    left = abs(factor - 1.0) * 0.5 * LOST
    np.testing.assert_allclose(np.abs(table[beyond, 0] - path[beyond, 0]), left, rtol=0.0, atol=NEAR)


def test_a_motion_that_does_not_rest_begins_on_the_flank_it_moves_towards() -> None:
    """The step of controllers, which is not held against the plain program: X alone makes its mean square larger."""
    plan, command = take_up(hook(), stepper(), start="moving", strategy="step")
    assert plan.bias["X"] == pytest.approx(0.5 * LOST)
    np.testing.assert_allclose(command.offset[0, 0], 0.5 * LOST, rtol=1e-12)


@pytest.mark.slow
def test_a_known_flank_needs_no_approach() -> None:
    known, open_ = (hooked(flank)[0] for flank in ("+", "unknown"))
    assert not [one for one in known.crossings if one.axis == "X" and one.start == 0.0]
    assert [one for one in open_.crossings if one.axis == "X" and one.start == 0.0]
    assert known.phases[-1].start < open_.phases[-1].start


def test_where_all_turns_are_sharp_corners_the_gap_is_carried_too() -> None:
    corners = [(0.0, 0.0), (0.03, 0.004), (0.0, 0.008), (0.03, 0.012)]
    path = make_path([Line(corners[k : k + 2]) for k in range(3)])
    _, command = take_up(path, stepper("+"))
    assert command.offset is not None
    table = moved_table(command, LOST, (1, 1))
    moves = command.feed > 0.0
    np.testing.assert_allclose(table[moves], (command.position - command.offset)[moves], rtol=0.0, atol=NEAR)


def ellipse() -> Path:
    """An arch on which both axes move at first."""
    r = 0.02
    start, end = (r * np.array([np.cos(angle), np.sin(angle)]) for angle in (0.7, 5.5))
    return make_path([Arc(start, end, np.zeros(2), "ccw")])


@pytest.mark.parametrize("flanks", FLANKS)
def test_axes_come_onto_their_sides_before_the_path_begins_and_move_no_table_away(flanks: tuple[int, int]) -> None:
    """Rows before the path stand at its start, as many as whole periods; from its first row on the table is on it."""
    plan, command = take_up(ellipse(), stepper())
    period = plan.machine.servo_period
    rows = round(lead_in(plan.phases, plan.crossings) / period)
    assert rows == pytest.approx(lead_in(plan.phases, plan.crossings) / period, abs=1e-9)
    assert rows > 0
    assert not command.s[: rows + 1].any()
    assert not command.feed[: rows + 1].any()
    assert command.s[rows + 1] > 0.0
    away = moved_table(command, LOST, flanks) - (command.position - command.offset)
    # The table is where the unknown side left it, half the backlash off in each axis, and never farther.
    assert np.abs(away[:rows]).max() <= 0.5 * LOST + NEAR
    turning = min(point.s for point in plan.turning_points)
    begun = (np.arange(command.t.size) >= rows) & (command.s < turning - 2e-3)
    np.testing.assert_allclose(away[begun], 0.0, atol=NEAR)


@pytest.mark.parametrize("flanks", FLANKS)
@pytest.mark.parametrize("winds_up", [True, False])
def test_an_axis_that_rests_at_first_comes_onto_the_side_of_its_own_first_motion(
    flanks: tuple[int, int], winds_up: bool
) -> None:
    """Y rests on the first side of a closed outline, and is on its side before it moves; it crosses nothing there.

    It came onto the side on which the outline ends, and crossed the backlash where it began to move; where there was no
    time for that it waited half a backlash off on one side.
    """
    corners = [(0.0, 0.0), (0.05, 0.0), (0.03, 0.03), (0.0, 0.03), (0.0, 0.0)]
    outline = make_path([Line(pair) for pair in pairwise(corners)], closed=True)
    analysis = look(outline, stepper())
    requests = (ProfileRequest(shape=None),) * len(analysis.windows)
    result = StrategyResult(requests=requests, proven=True, shifted=("X", "Y"), winds_up=winds_up)
    plan = Planner(analysis, stepper(), PlanOptions(strategy="takeup")).plan("takeup", result)
    assert (lead_in(plan.phases, plan.crossings) > 0.0) == winds_up
    command = command_of(plan, analysis.track, 1e-3)
    assert command.offset is not None
    place = command.position - command.offset
    away = np.abs(moved_table(command, LOST, flanks) - place)
    assert away.max() <= 0.5 * LOST + NEAR
    sides = [one for one in plan.crossings if one.axis == "Y"]
    moves = command.t[np.argmax(place[:, 1] > 1e-9)]
    assert [round(one.travel / LOST, 9) for one in sides if one.start > 0.6 * moves] == [-1.0]
    resting = (command.t > 0.6 * moves) & (command.t < moves)
    np.testing.assert_allclose(away[resting], 0.0, atol=NEAR)


def test_a_table_that_has_no_time_for_it_begins_with_the_path() -> None:
    """No table is then farther off than the plain one: on the wrong side an axis waits until the path is there."""
    plan, command = take_up(ellipse(), stepper(), max_slowdown=0.02)
    plain, bare = take_up(ellipse(), stepper(), strategy="none")
    assert lead_in(plan.phases, plan.crossings) == 0.0
    assert plan_time(plan) <= 1.02 * plan_time(plain) * 1.005
    assert command.offset is not None
    for flanks in FLANKS:
        away = moved_table(command, LOST, flanks) - (command.position - command.offset)
        before = moved_table(bare, LOST, flanks) - bare.position
        assert np.abs(away).max() <= np.abs(before).max() + NEAR
        assert np.sqrt(np.mean(away**2)) < 0.2 * np.sqrt(np.mean(before**2))


@pytest.mark.parametrize("rule", ["standstill", "momentum"])
def test_an_axis_inside_its_loop_is_pushed_onto_its_side_before_the_path_begins(rule):
    """The tables of an axis that stood on either side run apart by micrometres at first, and as one behind a push."""
    machine, path = read_machine("mill"), make_path([Line([(0.0, 0.0), (0.01, -0.006)])], 0.03)
    planner = Planner(
        look(path, machine), machine, PlanOptions(strategy="takeup", inverse_dynamics=True, max_slowdown=2.0)
    )
    apart = []
    for pushes in (False, True):
        plan = planner.plan("takeup", StrategyResult(requests=(), pushes_first=pushes))
        command = command_of(plan, planner.analysis.track, machine.servo_period)
        begin = lead_in(plan.phases, plan.crossings)
        assert bool(begin) == pushes
        assert not check_command(command, machine)
        sides = [
            [table_of(body_of(machine.axes[name], rule), own, command.period, side, 0.0) for side in (1, -1)]
            for name, own in zip(command.axes, command.position.T.copy(), strict=True)
        ]
        apart.append(max(np.abs(one - other)[command.t >= begin].max() for one, other in sides))
    assert apart[0] > 5e-6
    assert apart[1] < 0.2e-6


def test_an_axis_whose_side_is_known_is_not_pushed():
    track = look(hook(), read_machine("mill")).track
    machine = read_machine("mill")
    gaps = {name: replace(axis.gap, initial_flank="-") for name, axis in machine.axes.items()}
    known = replace(machine, axes={name: replace(machine.axes[name], gap=gap) for name, gap in gaps.items()})
    assert [one.axis for one in first_pushes(track, machine, (), ())] == ["X", "Y"]
    assert [one.axis for one in first_pushes(track, machine, (), ("X",))] == ["Y"]
    # The path goes off along X.
    found = first_pushes(track, known, (), ())
    assert "X" in [one.axis for one in found]
    assert all(one.push < 0.0 for one in found)
