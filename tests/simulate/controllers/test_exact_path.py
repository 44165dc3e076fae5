"""Planners of controllers that follow the path exactly, against their published rules in 50 digits."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import mpf
from msgspec.structs import replace
from support import firmware_planners as reference
from support.amount import examples

from ph_post.dialects.planners import planner_of
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import read_program
from ph_post.simulate.controllers.chords import chord_counts, straight_blocks
from ph_post.simulate.controllers.deviation import program_error
from ph_post.simulate.controllers.exact_path import plan_trapezoids
from ph_post.simulate.controllers.moves import limit_table, written_legs
from ph_post.simulate.controllers.run import PlannedRun, run_program
from ph_post.types import Command, ExactPath, GrblCorner, JerkCorner, Machine, MarlinCorner, PlannerSettings

RATES, PUSHES = (50.0, 40.0, 10.0), (500.0, 400.0, 100.0)


def machine_for(dialect: str, rates=RATES, pushes=PUSHES, **stated: float) -> Machine:
    base = read_machine("stepper")
    axes = {
        name: replace(axis, limits=replace(axis.limits, velocity=rate * 1e-3, acceleration=push * 1e-3))
        for (name, axis), rate, push in zip(base.axes.items(), rates, pushes, strict=True)
    }
    return replace(base, axes=axes, dialect=dialect, servo_period=1e-3, planner=PlannerSettings(**stated))


def program(*lines: str, dialect: str = "grbl") -> PartProgram:
    text = "\n".join(["G21", "G90", *lines, ""])
    return read_program(text.encode(), "test", language=find_dialect(dialect).language)


def run(machine: Machine, *lines: str) -> Command:
    return run_program(program(*lines, dialect=machine.dialect), machine)


def planned(machine: Machine, points, feeds):
    """Squared speeds at the beginnings of blocks, and the time, as the model plans them."""
    lines = [
        f"G1 F{feed!r} " + " ".join(f"{a}{x!r}" for a, x in zip("XYZ", point, strict=True))
        for point, feed in zip(points[1:], feeds, strict=True)
    ]
    start = "G92 " + " ".join(f"{a}{x!r}" for a, x in zip("XYZ", points[0], strict=True))
    part = program(start, *lines, dialect=machine.dialect)
    limits, planner = limit_table(machine), planner_of(machine)
    blocks = straight_blocks(part, written_legs(part, limits), limits, planner)
    return plan_trapezoids(blocks, planner, limits)


def settings_of(machine: Machine) -> reference.Settings:
    planner = planner_of(machine)
    assert isinstance(planner, ExactPath)
    corner = planner.corner
    limits = [[float(v) * 1e3 for v in column] for column in limit_table(machine).T]
    found = reference.Settings(
        tuple(limits[0]), tuple(limits[1]), buffer=None if planner.blocks is None else planner.blocks + 1
    )
    if isinstance(corner, JerkCorner):
        return reference.Settings(**{**vars(found), "jerk": tuple(mpf(one) * 1000 for one in corner.jerk)})
    assert isinstance(corner, GrblCorner | MarlinCorner)
    marlin = isinstance(corner, MarlinCorner)
    return reference.Settings(**{**vars(found), "deviation": mpf(corner.deviation) * 1000, "marlin": marlin})


STEPS = st.sampled_from([-20.0, -3.0, -0.5, -0.04, 0.0, 0.0, 0.0, 0.03, 0.3, 2.0, 15.0])
WAYS = st.lists(st.tuples(STEPS, STEPS, STEPS).filter(any), min_size=1, max_size=40)
MACHINES = [
    machine_for("grbl"),
    machine_for("grblhal"),
    machine_for("marlin"),
    machine_for("marlin", jerk=0.008),
    machine_for("grbl", junction_deviation=5e-5),
    machine_for("marlin", junction_deviation=1e-4),
]


@pytest.mark.parametrize("machine", MACHINES, ids=lambda one: f"{one.dialect}-{one.planner.given()}")
@given(ways=WAYS, data=st.data())
@settings(max_examples=examples(40), deadline=None)
def test_speeds_and_time_are_those_of_the_published_rules(machine, ways, data) -> None:
    points = np.round(np.cumsum(np.array([(0.0, 0.0, 0.0), *ways]), axis=0), 6).tolist()
    feeds = [data.draw(st.sampled_from([60.0, 600.0, 1200.0, 3000.0])) for _ in ways]
    found = planned(machine, points, feeds)
    rules = settings_of(machine)
    blocks = [
        reference.block(a, b, mpf(feed) / 60, rules) for a, b, feed in zip(points, points[1:], feeds, strict=False)
    ]
    speeds = reference.entry_speeds(blocks, rules)
    assert np.sqrt(found.square[:, 0]) * 1e3 == pytest.approx([float(v) for v in speeds], rel=1e-6, abs=1e-6)
    assert found.total == pytest.approx(float(reference.run_time(blocks, speeds)), rel=1e-8)


def test_the_buffer_bounds_the_speed_of_short_blocks() -> None:
    """15 blocks of 30 µm have to be enough to stop: the sixteenth is not known yet."""
    machine = machine_for("grbl")
    points = [(0.03 * k, 0.0, 0.0) for k in range(400)]
    speeds = np.sqrt(planned(machine, points, [3000.0] * 399).square[:, 0])
    assert speeds.max() == pytest.approx(math.sqrt(2 * 0.5 * 14 * 30e-6), rel=1e-9)


@given(radius=st.floats(0.05, 500.0), turn=st.floats(0.001, math.tau))
@settings(max_examples=examples(200), deadline=None)
def test_arcs_have_the_chords_of_the_firmware(radius, turn) -> None:
    """A count that rounding decides may be either."""
    for dialect, chords in (
        ("grbl", lambda size: reference.grbl_chords(size, turn, mpf("0.002"))),
        ("marlin", lambda size: reference.marlin_chords(size, turn)),
        ("klipper", lambda size: max(math.floor(size * turn), 1)),
    ):
        arc = [np.array([value]) for value in (radius * 1e-3, -turn, radius * 1e-3 * turn)]
        found = int(chord_counts(planner_of(machine_for(dialect)), *arc)[0])
        assert found in {chords(radius * (1.0 - 1e-8)), chords(radius * (1.0 + 1e-8))}


@pytest.mark.parametrize(
    ("dialect", "off"), [("grbl", 2e-6), ("grblhal", 2e-6), ("marlin", 6.4e-6), ("klipper", 6.4e-6)]
)
def test_arcs_are_off_by_their_chords_alone_and_end_exactly(dialect, off) -> None:
    found = run(machine_for(dialect), "G1 X20 Y0 F1200", "G3 X0 Y20 I-20 J0", "G1 X-5")
    on = np.flatnonzero(found.segment == 1)
    radius = np.hypot(found.position[on, 0], found.position[on, 1])
    assert 0.9 * off < 0.02 - radius.min() < 1.1 * off
    assert radius.max() < 0.02 + 1e-12
    joint = np.abs(found.position - [0.0, 0.02, 0.0]).max(axis=1).min()
    assert joint < 2e-5, "passed between two rows"
    np.testing.assert_array_equal(found.position[-1], [-0.005, 0.02, 0.0])


@pytest.mark.parametrize("dialect", ["grbl", "marlin", "klipper"])
def test_path_modes_mean_nothing(dialect) -> None:
    machine = machine_for(dialect)
    lines = ("G1 X10 F1200", "Y10", "X0")
    plain, exact = (
        run_program(read_program("\n".join(["G21 G90", mode, *lines, ""]).encode(), "t"), machine)
        for mode in ("G64", "G61")
    )
    np.testing.assert_array_equal(plain.position, exact.position)
    corner = np.abs(plain.position - [0.01, 0.0, 0.0]).sum(axis=1).min()
    assert corner < 1e-5


@pytest.mark.parametrize(
    ("dialect", "word", "seconds"),
    [
        ("grbl", "G4 P0.02", 0.05),
        ("grbl", "G4 P0.05", 0.05),
        ("grbl", "G4 P0.051", 0.1),
        ("grblhal", "G4 P0.02", 0.05),
        ("marlin", "G4 P20", 0.02),
        ("klipper", "G4 P20", 0.02),
    ],
)
def test_a_dwell_takes_as_long_as_the_firmware_waits(dialect, word, seconds) -> None:
    machine = machine_for(dialect, pushes=(500.0, 500.0, 100.0))
    with_dwell = run(machine, "G1 X5 F1200", word, "G1 X10")
    halves = run(machine, "G1 X5 F1200")
    assert with_dwell.t[-1] == pytest.approx(2 * (5 / 20 + 20 / 500) + seconds, abs=2e-3)
    resting = np.count_nonzero(np.diff(with_dwell.position[:, 0])[1:-1] == 0.0) * machine.servo_period
    assert resting == pytest.approx(seconds, abs=2e-3)
    assert halves.t[-1] == pytest.approx(5 / 20 + 20 / 500, abs=2e-3)


def test_g0_moves_at_f_where_the_firmware_knows_no_rapid() -> None:
    for dialect, speed in (("grbl", 50.0), ("marlin", 20.0), ("klipper", 20.0)):
        found = run(machine_for(dialect), "G1 X1 F1200", "G0 X40")
        assert found.feed.max() * 1e3 == pytest.approx(speed, rel=1e-6)
    for dialect in ("marlin", "klipper"):
        assert run(machine_for(dialect), "G0 X40").feed.max() * 1e3 == pytest.approx(25.0, rel=1e-6)


def test_limits_of_every_axis_hold() -> None:
    lines = ("G0 X10", "G1 X40 F1800", "G1 Y20", "G1 X10", "G1 X5 Y10", "G0 X0 Y0 Z3", "G2 X20 Y0 I10 J0 F2400")
    for dialect in ("grbl", "grblhal", "marlin"):
        machine = machine_for(dialect)
        found = run(machine, *lines)
        speed = np.diff(found.position, axis=0) / found.period
        assert (np.abs(speed).max(axis=0) * 1e3 <= np.array(RATES) * 1.0001).all()


def test_a_g5_is_played_within_its_declared_deviation() -> None:
    """grblHAL's steps of the parameter, which the dialect bounds by their widest."""
    part = program("G1 X0 Y0 F600", "G5 X20 Y10 I5 J0 P-5 Q-5", dialect="grblhal")
    found = run_program(part, machine_for("grblhal"))
    control = np.array([(0, 0), (5, 0), (15, 5), (20, 10)]) * 1e-3
    u = np.linspace(0.0, 1.0, 20_001)[:, None]
    curve = sum(c * math.comb(3, k) * u**k * (1 - u) ** (3 - k) for k, c in enumerate(control))
    apart = np.linalg.norm(curve[None] - found.position[::10, None, :2], axis=2).min(axis=1).max()
    bound = float(find_dialect("grblhal").abilities.cubic.deviation(control[None])[0])
    assert 0.1 * bound < apart <= bound


def test_every_row_knows_its_motion() -> None:
    found = run(machine_for("grbl"), "G0 X10", "G1 X20 F1200", "G1 Y10", "G3 X10 Y20 I-10 J0", "G0 X0 Y0")
    assert (np.diff(found.segment) >= 0).all()
    assert found.segment[0] == -1
    assert found.segment[-1] == 4
    assert ((found.xi >= 0.0) & (found.xi <= 1.0)).all()
    for motion in range(5):
        assert (np.diff(found.xi[found.segment == motion]) >= 0.0).all()
    assert run(machine_for("grbl"), "M3 S100").t.size == 1


def test_a_circle_with_backlash_is_off_by_what_others_measured() -> None:
    """Circle R 20 mm at 1200 mm/min, 0.05 mm in X and Y, 500 mm/s²: 27.0 and 14.8 µm by a planner of others'."""
    base = machine_for("grbl", rates=(50.0, 50.0, 50.0), pushes=(500.0, 500.0, 500.0))
    axes = {
        name: replace(axis, gap=axis.gap.with_lost_motion(0.0 if name == "Z" else 5e-5))
        for name, axis in base.axes.items()
    }
    machine = replace(base, axes=axes)
    part = program("G17", "G0 X20 Y0", "G3 X20 Y0 I-20 J0 F1200", "G3 X20 Y0 I-20 J0")
    command = run_program(part, machine)
    found = program_error(command, machine, part).error
    assert found is not None
    assert found.max == pytest.approx(27.0e-6, abs=0.1e-6)
    assert found.rms == pytest.approx(14.8e-6, abs=0.1e-6)
    rapid, circles = 0.02 / 0.05 + 0.05 / 0.5, 2.0 * math.tau * 0.02 / 0.02 + 0.02 / 0.5
    assert command.t[-1] == pytest.approx(rapid + circles, rel=3e-3)


IN_PARTS = (
    "G28",
    "G4 P0.2",
    "G1 X5 F600",
    "Y3",
    "G4 P0.1",
    "G2 X9 Y7 I4",
    "M3 S100",
    "M5",
    "G1 X9",
    "Z1",
    "G5 I1 J2 P-1 Q-2 X12 Y9",
    "G28",
    "G0 X1",
    "G1 X3 Y2",
    "X3",
    "M2",
)
"""Rests at what has no way, splines, and places that nobody knows."""


@pytest.mark.parametrize("dialect", ["grblhal", "marlin", "klipper"])
@pytest.mark.parametrize("room", [1, 3, 5])
def test_the_parts_in_which_a_program_is_planned_do_not_show(dialect, room, monkeypatch):
    machine = machine_for(dialect)
    part = program(*IN_PARTS, dialect=dialect)
    whole = run_program(part, machine)
    monkeypatch.setattr(sys.modules[PlannedRun.__module__], "ROOM", room)
    monkeypatch.setattr(sys.modules[PlannedRun.__module__], "PART", room)
    found = PlannedRun(part, machine)
    command = found.command()
    for name in ("position", "segment", "xi", "s"):
        assert np.array_equal(getattr(command, name), getattr(whole, name)), name
    timed = PlannedRun(part, machine, longest=0.0)
    assert timed.time == found.time == whole.t[-1]
    assert np.array_equal(timed.command().position, whole.position)
