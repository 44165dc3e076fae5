"""Windows of a plan, told as stops and dips on the motions of the program."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import quad

from ph_post.compensate.offsets import DWELL, LEAST, plan_time
from ph_post.compensate.options import PlanOptions
from ph_post.drive.machinefile import read_machine
from ph_post.edit.edits import DipEdit, EditOptions
from ph_post.edit.window_plans import WindowEdits, edit_windows, plan_windows, planned_machine
from ph_post.gcode.paths import paths_of
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import read_program
from ph_post.types import Machine

MM, MS = 1e-3, 1e-3

SLOT = """G21 G90 G17 G94
G0 X0 Y0
G1 X40 F1000
G3 X40 Y20 I0 J10
G1 X0
G3 X0 Y0 I0 J-10
M2
"""
CIRCLE = "G21 G90 G17\nG0 X0 Y0\nG1 X20 Y20 F1000\nG3 X20 Y20 I-20 J0\nM2\n"
"""Y and X reverse a quarter, a half and three quarters on the way round."""


def program_of(text: str) -> PartProgram:
    return read_program(text.encode(), "part.ngc")


def planned(text: str, machine: str | Machine, **how: object) -> WindowEdits:
    program = program_of(text)
    drives = read_machine(machine) if isinstance(machine, str) else machine
    options = PlanOptions(**{"strategy": "suppress", "effort": 0.02, **how})  # type: ignore[arg-type]
    return edit_windows(program, plan_windows(program, paths_of(program), drives, options, 5e-6), EditOptions())


def sampled(decimals: int = 3) -> str:
    lines = [f"G1 X{10.0 * a:.{decimals}f} Y{5.0 * math.sin(a):.{decimals}f} F900" for a in np.linspace(0, 6, 181)]
    return "\n".join(["G21 G90 G17", "G0 X0 Y0", *lines[1:], "M2", ""])


def travelled(dip: DipEdit, program: PartProgram) -> np.ndarray:
    """Length of every block [m] of a dip on arcs and lines."""
    motions = program.motions
    chord = np.nan_to_num(np.linalg.norm((motions.end - motions.start)[:, :2], axis=1))
    radius = np.linalg.norm(motions.start[:, :2] - motions.center, axis=1)
    length = np.where(motions.angle != 0.0, radius * np.abs(motions.angle), chord)
    before = np.concatenate([[0.0], np.cumsum(length)[:-1]])
    return np.asarray(np.diff(before[dip.motion] + dip.share * length[dip.motion]))


def test_a_dip_follows_equation_26() -> None:
    # V / V_c = 1 - (1 - V_5) C(10, 5) τ^5 (1 - τ)^5 with V(1/2) = 1/4, over ± t*
    cruise = 1000.0 * MM / 60.0
    found = planned(CIRCLE, "router", strategy="suppress", ratio=0.25, degree=10)
    assert found.edits.stops == ()
    assert len(found.edits.dips) == 3
    program = program_of(CIRCLE)
    for dip, profile in zip(found.edits.dips, found.plans[0].plan.profiles, strict=True):
        assert profile is not None
        t_star = profile.t_star
        assert dip.duration.sum() == pytest.approx(2.0 * t_star, rel=1e-9)
        ends = np.concatenate([[0.0], np.cumsum(dip.duration)]) / (2.0 * t_star)
        exact = [
            2.0 * t_star * cruise * quad(lambda x: 1.0 - 0.75 * (4.0 * x * (1.0 - x)) ** 5, a, b)[0]
            for a, b in pairwise(ends)
        ]
        assert travelled(dip, program) == pytest.approx(exact, rel=1e-6)
        # the turning point, a quadrant, ends a block
        assert np.abs(dip.share[:, None] - np.array([0.25, 0.5, 0.75])).min() < 1e-9


def test_blocks_last_no_longer_than_they_may_and_leave_no_slivers() -> None:
    program = program_of(sampled())
    drives = read_machine("mill")
    options = PlanOptions(strategy="suppress")
    for block_time in (2.0 * MS, 5.0 * MS, 12.0 * MS):
        plans = plan_windows(program, paths_of(program), drives, options, 5e-6)
        found = edit_windows(program, plans, EditOptions(block_time=block_time))
        assert len(found.edits.dips) == 2
        for dip in found.edits.dips:
            assert dip.duration.max() <= block_time * (1.0 + 1e-9)
            # the program's own moves take some 22 ms: all blocks come from cutting these
            assert dip.duration.min() >= 0.4 * min(block_time, 5.0 * MS)
            place = dip.motion + dip.share
            assert (np.diff(place) > 0.0).all()


def test_a_dip_ends_blocks_where_moves_end() -> None:
    found = planned(sampled(), "mill", effort=1.0)
    for dip in found.edits.dips:
        inside = set(range(int(dip.motion[0]) + 1, int(dip.motion[-1])))
        ended = set(dip.motion[dip.share == 1.0].tolist())
        assert inside <= ended


def test_stops_stand_exactly_at_turning_points() -> None:
    found = planned(SLOT, "mill", strategy="dwell")
    places = [(stop.motion, stop.share) for stop in found.edits.stops]
    # both arcs turn X half-way; Y stands still along the upper line and moves back at its end
    assert places == [(2, pytest.approx(0.5, abs=1e-12)), (3, 1.0), (4, pytest.approx(0.5, abs=1e-12))]
    assert found.edits.dips == ()
    for stop, interval in zip(found.edits.stops, found.plans[0].plan.intervals, strict=True):
        assert stop.shifts == ()
        assert interval is not None
        assert stop.pause >= interval.duration * (1.0 - 1e-9)


def test_stops_on_a_sampled_curve_stand_at_its_outermost_vertices() -> None:
    program = program_of(sampled())
    end = program.motions.end
    found = planned(sampled(), "mill", strategy="dwell", max_slowdown=1.0)
    assert [stop.share for stop in found.edits.stops] == [1.0, 1.0]
    stopped = [stop.motion for stop in found.edits.stops]
    assert end[stopped[0], 1] == end[:, 1].max()
    assert end[stopped[1], 1] == end[:, 1].min()


@pytest.mark.slow
def test_pulses_go_out_and_back_between_pauses() -> None:
    found = planned(SLOT, "mill", strategy="takeup", effort=0.1)
    stops = found.edits.stops
    assert stops
    for stop in stops:
        assert stop.pause >= 0.99 * DWELL
        for axis in {shift.axis for shift in stop.shifts}:
            own = [shift for shift in stop.shifts if shift.axis == axis]
            assert sum(shift.travel for shift in own) == 0.0
            assert max(abs(shift.travel) for shift in own) >= LEAST
            assert found.edits.pulse[axis] == pytest.approx(max(abs(s.travel) for s in own for s in own))
        assert all(shift.pause >= 0.99 * DWELL for shift in stop.shifts)
    assert not found.edits.offset.any()
    assert found.edits.amplitude == {}


@pytest.mark.parametrize("machine", ["router", "stepper"])
@pytest.mark.parametrize("strategy", ["auto", "takeup"])
def test_axes_behind_their_loop_are_left_to_lasting_offsets(machine: str, strategy: str) -> None:
    found = planned(SLOT, machine, strategy=strategy)
    assert found.plans == ()
    assert (found.edits.stops, found.edits.dips) == ((), ())


def test_feed_strategies_see_the_gap_of_every_axis() -> None:
    drives = read_machine("router")
    (path,) = paths_of(program_of(SLOT))
    for strategy, feed_only, left in (("auto", False, 0.0), ("auto", True, 1.0), ("suppress", False, 1.0)):
        made = planned_machine(drives, path.path, PlanOptions(strategy=strategy, feed_only=feed_only))
        for name in path.path.axes:
            assert made.axes[name].gap.lost_motion == left * drives.axes[name].gap.lost_motion
        assert made.axes["Z"] == drives.axes["Z"]


def test_the_plain_strategy_changes_nothing() -> None:
    found = planned(SLOT, "mill", strategy="none")
    assert (found.edits.stops, found.edits.dips) == ((), ())


def test_moving_back_is_left_alone_and_named() -> None:
    found = planned(CIRCLE, "router", strategy="retrograde", allow_retrograde=True)
    assert found.edits.dips == ()
    assert sum("would move back on its path" in word for word in found.edits.warnings) >= 1


def test_what_is_not_understood_is_left_alone_and_named() -> None:
    text = SLOT.replace("M2\n", "G5 X10 Y10 I5 J0 P-5 Q0\nG5 X20 Y20 P-5 Q0\nM2\n")
    found = planned(text, "mill", strategy="suppress")
    assert (found.edits.dips, found.plans) == ((), ())
    assert any("windows not compensated: contains a G5 that continues" in word for word in found.edits.warnings)


def test_every_chain_is_planned() -> None:
    text = SLOT.replace("M2\n", "T2 M6\n") + SLOT
    found = planned(text, "mill", strategy="dwell")
    assert len(found.plans) == 2
    assert [stop.motion for stop in found.edits.stops] == [2, 3, 4, 7, 8, 9]


@pytest.mark.slow
def test_a_search_is_shared_out_and_told() -> None:
    text = SLOT.replace("M2\n", "T2 M6\n") + SLOT
    program, said = program_of(text), []
    plan_windows(
        program,
        paths_of(program),
        read_machine("mill"),
        PlanOptions(strategy="takeup", effort=0.02),
        5e-6,
        progress=said.append,
    )
    assert any(word.startswith("lines 3 to 6: ") for word in said)
    assert any(word.startswith("lines 10 to 13: ") for word in said)


def test_an_axis_without_a_gap_needs_no_plan() -> None:
    drives = read_machine("mill")
    axes = {name: replace(one, gap=replace(one.gap, lost_motion=0.0)) for name, one in drives.axes.items()}
    assert planned(SLOT, replace(drives, axes=axes), strategy="auto").plans == ()


def test_a_long_program_is_planned_in_parts_that_share_the_time() -> None:
    passes = "".join(
        f"G0 X0 Y{40 * k}\nG1 X40 F1000\nG3 X40 Y{40 * k + 20} I0 J10\nG1 X0\nG3 X0 Y{40 * k} I0 J-10\n"
        for k in range(9)
    )
    text = f"G21 G90 G17\n{passes}M2\n"
    found = planned(text, "mill", strategy="dwell", max_slowdown=1.0)
    assert len(found.plans) > 1
    motions = np.concatenate([made.path.motion for made in found.plans])
    assert (np.diff(motions) == 1).all()
    # both half circles of every pass are turned in half-way, in parts as in a whole
    arcs = [stop.motion for stop in found.edits.stops if 0.0 < stop.share < 1.0]
    assert arcs == [k for k in range(45) if k % 5 in (2, 4)]


def test_a_dip_that_is_shorter_than_a_block_at_an_end_of_a_motion_is_left_alone() -> None:
    # X turns where both arcs meet: the ends of a dip are nearer to that place than half a block
    program = program_of("G21 G90 G17\nG0 X-20 Y-20\nG1 X0 F1000\nG3 X20 Y0 I0 J20\nG3 X0 Y20 I-20 J0\nM2\n")
    options = PlanOptions(strategy="suppress", ratio=0.9, degree=10, t_star=20.0 * MS)
    for block_time, dips in ((10.0 * MS, 1), (100.0 * MS, 0)):
        plans = plan_windows(program, paths_of(program), read_machine("mill"), options, 5e-6)
        found = edit_windows(program, plans, EditOptions(block_time=block_time))
        assert len(found.edits.dips) == dips
        short = [word for word in found.edits.warnings if "the dip would be shorter than a block" in word]
        assert len(short) == 1 - dips


def test_plans_in_sections_that_are_to_be_left_make_no_edits() -> None:
    text = SLOT.replace("M2\n", "") + "G0 X60 Y0\n" + "G1 X100 F1000\nG3 X100 Y20 I0 J10\nG1 X60\nM2\n"
    program, drives = program_of(text), read_machine("mill")
    plans = plan_windows(program, paths_of(program), drives, PlanOptions(strategy="dwell", effort=0.02), 5e-6)
    whole = edit_windows(program, plans, EditOptions())
    none = edit_windows(program, plans, EditOptions(left=frozenset({0, 1})))
    assert whole.edits.stops
    # The stops are the time of the plan beyond that of its plain motion.
    (one,) = whole.plans
    last = one.plan.nominal[-1]
    assert whole.edits.slowdown == pytest.approx(plan_time(one.plan) / (last.start + last.duration) - 1.0)
    assert (none.plans, none.edits.stops, none.edits.dips, none.edits.slowdown) == ((), (), (), 0.0)
