"""Crossings without a stop in tables, judged by an axis with ideal backlash of the test's own."""

from __future__ import annotations

import numpy as np
import pytest
from long.claims import run_table
from support.motions import look, worst_use

import ph_post as ph
from ph_post.compensate.crossing_times import crossing_at_turn, shortest_crossing, turning_error
from ph_post.compensate.offsets import command_of, lead_in, plan_time
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.files.path import read_path
from ph_post.files.storage import or_shipped


def behind(motor: np.ndarray, lost: float, table: float) -> np.ndarray:
    """Positions of a table that its motor pushes from either side of its backlash, at first at `table`."""
    found = np.empty_like(motor)
    for row, x in enumerate(motor):
        table = min(max(table, x - 0.5 * lost), x + 0.5 * lost)
        found[row] = table
    return found


@pytest.fixture(scope="module")
def circle():
    return ph.compensate("circle", "stepper", output="table", strategy="fly", effort=0.1)


@pytest.mark.parametrize("sides", [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)])
def test_the_table_stays_on_the_circle_and_never_stops(circle, sides):
    command = circle.table()
    machine, on_path = circle.machine, command.t >= 0.0
    lost = [machine.axes[name].gap.lost_motion for name in command.axes]
    table = [
        behind(column, gap, column[0] + side * gap)
        for column, gap, side in zip(command.position.T, lost, sides, strict=True)
    ]
    away = np.abs(np.hypot(*table) - 0.25)[on_path]
    # Untouched it is half of the larger backlash off, 40 µm.
    assert away.max() < 2e-6
    assert circle.after.error.max == pytest.approx(away.max(), rel=0.02)
    moving = (command.t > 1.0) & (command.t < command.t[-1] - 1.0)
    assert command.feed[moving].min() > 0.19 * command.feed.max()
    assert circle.before.error.max == pytest.approx(40e-6, rel=0.02)


def test_programs_that_cannot_be_edited_and_loops_with_the_backlash_inside_are_refused():
    with pytest.raises(InputError, match="programs of siemens cannot be changed by lines, and cross backlash at stops"):
        ph.compensate("oval", "stepper", dialect="siemens", strategy="fly").program()
    with pytest.raises(InputError, match="fly does not compensate axes with these feedback loops"):
        ph.compensate("circle", "mill", output="table", strategy="fly")


@pytest.fixture(scope="module")
def crossed():
    """The butterfly on the worn router: what its plain motion does, and one that crosses at full feed."""
    machine = read_machine("router")
    analysis = look(read_path(or_shipped("paths", "butterfly")), machine)
    before = make_plan(analysis, PlanOptions(strategy="none"))
    return analysis.track, before, make_plan(analysis, PlanOptions(strategy="fly", inverse_dynamics=True))


def test_a_path_that_is_crossed_at_full_feed_is_within_a_half_and_a_fifth_of_its_plain_errors(crossed):
    track, *plans = crossed
    plain, found = (run_table(command_of(plan, track, 1e-3), plan.machine, track) for plan in plans)
    before, after = plans
    assert plan_time(after) - lead_in(after.phases, after.crossings) <= 1.01 * plan_time(before)
    assert found.max < plain.max / 2.0
    assert found.rms < plain.rms / 5.0


def test_crossings_at_full_feed_leave_the_lead_to_the_path(crossed):
    track, _, plan = crossed
    command, whole = (command_of(plan, track, 1e-3, fade=fade) for fade in (True, False))
    assert max(worst_use(whole, plan.machine)) <= 1.0 + 1e-6
    assert (command.position == whole.position).all()


@pytest.mark.parametrize("acceleration", [0.02, 0.2, 2.0])
def test_no_other_delay_of_a_crossing_is_better(acceleration):
    axis = read_machine("router").axes["X"]
    lost, duration = axis.gap.lost_motion, shortest_crossing(axis, True, 1e-3)
    t = np.linspace(-2.0 * duration, 2.0 * duration, 4001)
    path = -0.5 * acceleration * t**2

    def error(begin: float) -> float:
        u = np.clip((t - begin) / duration, 0.0, 1.0)
        way = u**5 * (126.0 - 420.0 * u + 540.0 * u**2 - 315.0 * u**3 + 70.0 * u**4)
        motor = path + lost * (0.5 - way)
        return float(np.abs(behind(motor, lost, path[0]) - path).max())

    own = error(crossing_at_turn(axis, -1, duration, acceleration).start)
    assert own == pytest.approx(turning_error(axis, duration, acceleration), rel=0.03)
    assert own <= 1.02 * min(error(begin) for begin in np.linspace(-0.7, 0.0, 36) * duration)
