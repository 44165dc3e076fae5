"""The model of LinuxCNC's planner and what is measured with it, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace

from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError, TooLargeError
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import read_program
from ph_post.geometry.closest import closest_within
from ph_post.simulate.controllers.cut_path import CutPath, pieces_of
from ph_post.simulate.controllers.deviation import program_error
from ph_post.simulate.controllers.moves import linking_of, moved_axes, tolerance_of
from ph_post.simulate.controllers.run import DRAINED, DWELL, SMOOTHING, PlannedRun, run_program
from ph_post.types import Command, Machine, PlannerSettings

ROUTER = read_machine("router")
STEPPER = replace(read_machine("stepper"), dialect="linuxcnc")
SOME_PERIODS = SMOOTHING.size + 3


def program(*lines: str) -> PartProgram:
    return read_program("\n".join(["G21 G90 G17 G94", *lines, "M2", ""]).encode(), "test")


def run(machine: Machine, *lines: str) -> Command:
    return run_program(program(*lines), machine)


def periods(command: Command) -> int:
    return command.t.size - 1


def test_a_lone_move_has_half_the_acceleration() -> None:
    """The end of the queue may yet be blended with what comes: LinuxCNC keeps half for that."""
    way, limits = 0.05, ROUTER.axes["X"].limits
    seconds = way / limits.velocity + limits.velocity / (0.5 * limits.acceleration)
    assert periods(run(ROUTER, "G0 X50")) == pytest.approx(seconds / ROUTER.servo_period, abs=SOME_PERIODS)


def test_an_exact_stop_has_the_whole_acceleration() -> None:
    way, limits, feed = 0.02, ROUTER.axes["X"].limits, 0.05
    seconds = 2.0 * (way / feed + feed / limits.acceleration)
    found = run(ROUTER, "G61.1", "G1 X20 F3000", "X0")
    assert periods(found) == pytest.approx(seconds / ROUTER.servo_period, abs=SOME_PERIODS + 2)


@pytest.mark.parametrize("seconds", [0.01, 0.2])
def test_axes_rest_in_a_dwell(seconds: float) -> None:
    found = run(ROUTER, "G1 X1 F600", f"G4 P{seconds}", "X2")
    resting = np.count_nonzero(np.diff(found.position[:, 0])[1:-1] == 0.0)
    spread = SMOOTHING.size - 1
    assert resting == pytest.approx(seconds / ROUTER.servo_period + DWELL - spread, abs=2)


def test_a_spindle_word_stops_the_axes() -> None:
    steady, stopped = (run(ROUTER, "G1 X10 F600", word, "X20") for word in ("(M3)", "M3 S100"))
    ramps = 0.01 / (0.5 * ROUTER.axes["X"].limits.acceleration) / ROUTER.servo_period
    assert periods(stopped) - periods(steady) == pytest.approx(2 * ramps / 2 + DRAINED, abs=4)


def test_the_time_is_that_of_the_last_row_where_rows_are_only_counted() -> None:
    part = program("G1 X10 F600", "G4 P0.1", "M3 S100", "Y20", "G0 X0 Y0")
    whole = run_program(part, ROUTER)
    counted = PlannedRun(part, ROUTER, longest=0.5 * float(whole.t[-1]))
    assert counted.time == whole.t[-1]
    assert np.array_equal(counted.command().position, whole.position)


def test_arcs_keep_a_share_of_the_acceleration_across() -> None:
    radius, axes = 0.002, (ROUTER.axes["X"], ROUTER.axes["Y"])
    fastest = math.sqrt(math.sqrt(0.75) * min(axis.limits.acceleration for axis in axes) * radius)
    found = run(ROUTER, "G1 X2 F60", *["G3 X2 Y0 I-2 J0 F6000"] * 3)
    assert found.feed.max() == pytest.approx(fastest, rel=0.01)


def test_chords_are_no_faster_than_one_a_period() -> None:
    chord = 20e-6
    lines = [f"X{0.02 * k:.2f}" for k in range(1, 400)]
    found = run(ROUTER, "G64 P0.001 Q0", "G1 F6000", *lines)
    assert found.feed.max() <= chord / ROUTER.servo_period * 1.0001


def test_a_place_that_is_set_moves_no_joint() -> None:
    """Where X is 10 it is called -70, and goes to -60: 10 on; an arc about X-60 Y2 lies 70 on, too."""
    found = run(ROUTER, "G1 X10 Y0 F600", "G92 X-70", "X-60", "G3 X-60 Y4 I0 J2")
    assert np.abs(np.diff(found.position, axis=0)).max() <= 0.01 * ROUTER.servo_period * 1.0001
    assert found.position[-1] == pytest.approx([0.02, 0.004, 0.0])
    assert found.position[:, 0].max() == pytest.approx(0.022, abs=1e-5)


def test_places_that_are_set_do_not_lose_the_way() -> None:
    """Two squares one over the other, of which each begins at a zero of its own."""
    square = ["G1 X5 F600", "Y5", "X0", "Y0"]
    axes = {name: replace(axis, gap=axis.gap.with_lost_motion(0.0)) for name, axis in STEPPER.axes.items()}
    machine = replace(STEPPER, dialect="grbl", axes=axes)
    part = program("G1 X0 Y0 Z0 F600", "G0 X50 Y50", "G92 X0 Y0", *square, "G0 X9 Y0", "G92 X0 Y0", *square)
    found = program_error(run_program(part, machine), machine, part)
    assert found.error.max < 1e-9


def test_a_short_arc_that_both_of_its_roundings_would_take_whole_has_places() -> None:
    """31 µm of an arc between lines of 46 and 109 µm, as a crossing in a small pocket leaves it."""
    lines = ["G1 X49.2249 Y116.2825 F305.8", "X49.2251 Y116.3105 F281.7", "X49.2416 Y116.3391", "X49.2749 Y116.3675"]
    lines += ["X49.2993 Y116.4069 F305.8", "G2 X49.3191 Y116.4313 I0.1257 J-0.0819 F2000", "G1 X49.4246 Y116.4583 F800"]
    found = run(STEPPER, "G64", "G0 X49.2493 Y116.2432", *lines, "X49.4458 Y116.4699 F305.8", "X49.4668 Y116.4563")
    assert np.isfinite(found.position).all()
    cut = np.linalg.norm(np.diff(found.position[found.segment > 0], axis=0), axis=1)
    assert cut.max() <= 2.0 / 60.0 * STEPPER.servo_period * 1.0001


def test_every_row_knows_its_motion() -> None:
    found = run(ROUTER, "G64 P0.01 Q0", "G0 X10", "G1 X20 F1200", "Y10", "G3 X10 Y20 I-10", "G0 X0 Y0")
    assert (np.diff(found.segment) >= 0).all()
    assert found.segment[0] == -1
    assert found.segment[-1] == 4
    assert ((found.xi >= 0.0) & (found.xi <= 1.0)).all()
    np.testing.assert_allclose(found.position[-1], [0.0, 0.0, 0.0], atol=1e-12)


def test_rows_of_linked_lines_belong_to_the_one_they_are_on() -> None:
    """On one straight line X says which, and how much of it is done; the one that goes nowhere has no rows."""
    ends = np.array([0.0, 0.4, 0.5, 2.0, 2.0, 2.7, 5.0])
    found = run(ROUTER, "G64 P0.01", "G1 F600", *(f"X{end}" for end in ends[1:]), "G0 Y10")
    moving = (found.segment >= 0) & (found.segment < ends.size - 1)
    told = np.interp((found.segment + found.xi)[moving], np.arange(ends.size), ends)
    np.testing.assert_allclose(told, 1e3 * found.position[moving, 0], atol=10.0 * ROUTER.servo_period)
    assert set(found.segment[moving].tolist()) == {0, 1, 2, 4, 5}


def test_limits_of_the_axes_hold() -> None:
    found = run(STEPPER, "G64 P0.05", "G0 X10", "G1 X40 F1800", "Y20", "X10", "X5 Y10", "G0 X0 Y0 Z3")
    for number, name in enumerate(found.axes):
        speed = np.diff(found.position[:, number]) / found.period
        assert np.abs(speed).max() <= STEPPER.axes[name].limits.velocity * 1.0001
        push = np.abs(np.diff(speed)).max() / found.period
        assert push <= STEPPER.axes[name].limits.acceleration * 1.01


def test_corners_are_rounded_by_what_the_path_mode_allows() -> None:
    lines = ("G0 X0 Y0", "G1 X20 F2400", "Y20")
    corner = np.array([0.02, 0.0, 0.0])
    near = {}
    for tolerance in (0.01, 0.1):
        found = run(ROUTER, f"G64 P{tolerance} Q0", *lines)
        near[tolerance] = np.linalg.norm(found.position - corner, axis=1).min()
        assert near[tolerance] <= tolerance * 1e-3 + 1e-6
    assert near[0.1] > 3.0 * near[0.01]


def test_a_stepper_with_a_gap_is_off_a_circle_by_half_of_it() -> None:
    """Along the radius by (g/2)(cos - sin) in the first quadrant: most at the quadrant's ends."""
    gap = 50e-6
    axes = {
        name: replace(axis, gap=replace(axis.gap, lost_motion=gap if name != "Z" else 0.0))
        for name, axis in STEPPER.axes.items()
    }
    machine = replace(STEPPER, axes=axes)
    circle = program("G0 X15 Y0", "G3 X15 Y0 I-15 J0 F600", "G3 X15 Y0 I-15 J0")
    found = program_error(run_program(circle, machine), machine, circle)
    assert found.error.max == pytest.approx(gap / 2, rel=0.01)
    worst = 1.0 + max(axis.uncertainty.backlash for axis in axes.values())
    assert found.error_worst.max == pytest.approx(worst * found.error.max, rel=0.01)


def test_without_a_gap_a_stepper_is_on_the_path() -> None:
    axes = {name: replace(axis, gap=replace(axis.gap, lost_motion=0.0)) for name, axis in STEPPER.axes.items()}
    machine = replace(STEPPER, axes=axes)
    slot = program("G61", "G0 X0 Y0", "G1 X10 F600", "G3 X10 Y6 J3", "G1 X0", "G3 X0 Y0 J-3")
    found = program_error(run_program(slot, machine), machine, slot)
    assert found.error.max < 1e-6


def test_the_place_is_followed_there_and_back() -> None:
    part = program("G61.1", "G1 X10 F600", "X0", "X10")
    command = run_program(part, ROUTER)
    leg, place = CutPath(part, ROUTER).follow(command)
    assert place[-1] == pytest.approx(0.03, abs=1e-9)
    assert np.diff(place).min() > -2e-6
    assert leg[-1] == 2


def test_distances_from_a_helix_are_those_of_a_fine_sampling() -> None:
    path = CutPath(program("G0 X10 Y0 Z0", "G3 X10 Y0 Z-4 I-10 J0 F600"), ROUTER)
    angle = np.linspace(0.0, math.tau, 200_001)
    fine = np.stack([0.01 * np.cos(angle), 0.01 * np.sin(angle), -0.004 * angle / math.tau], axis=1)
    random = np.random.default_rng(7)
    rows = random.integers(20_000, 180_000, 50)
    points = fine[rows] + random.normal(0.0, 5e-5, (50, 3))
    expected = [float(np.linalg.norm(fine - point, axis=1).min()) for point in points]
    place = path.starts[1] + rows / 200_000 * path.legs.length[1]
    found = closest_within(pieces_of(path.legs), path.starts, points, place, np.full(50, 1e-3))[0]
    np.testing.assert_allclose(found, expected, atol=1e-8)


@pytest.mark.parametrize(
    ("mode", "tolerance", "linking"),
    [
        (None, 0.0, 0.0),
        ("G64", 0.0, 0.0),
        ("G64 P0.01", 1e-5, 1e-5),
        ("G64 P0.01 Q0", 1e-5, 0.0),
        ("G64 P0.02 Q0.005", 2e-5, 5e-6),
        ("G61", -1.0, 0.0),
        ("G61.1", -2.0, 0.0),
    ],
)
def test_path_modes_are_read(mode: str | None, tolerance: float, linking: float) -> None:
    assert tolerance_of(mode, 1e-3) == pytest.approx(tolerance)
    assert linking_of(mode, 1e-3) == pytest.approx(linking)


def test_only_axes_that_move_are_asked_for() -> None:
    assert moved_axes(program("G0 X10", "G1 X20 F100")) == ("X",)
    assert moved_axes(program("G0 X10 Y0", "G1 X20 F100")) == ("X", "Y"), "sent there from wherever it is"
    assert moved_axes(program("G0 X10 Y0", "G3 X10 Y0 I-5 J0 F100")) == ("X", "Y")


def test_a_program_without_motion_has_no_path() -> None:
    empty = program("M3 S100")
    assert run_program(empty, ROUTER).t.size >= 1
    with pytest.raises(InputError, match="moves nothing"):
        CutPath(empty, ROUTER)


def test_splines_are_as_long_as_their_curves() -> None:
    part = program("G0 X0 Y0", "G5 X20 Y10 I5 J0 P-5 Q-5 F600")
    u = np.linspace(0.0, 1.0, 100_001)[:, None]
    p = [np.array(point) * 1e-3 for point in ((0, 0), (5, 0), (15, 5), (20, 10))]
    curve = (1 - u) ** 3 * p[0] + 3 * u * (1 - u) ** 2 * p[1] + 3 * u**2 * (1 - u) * p[2] + u**3 * p[3]
    length = np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
    assert CutPath(part, ROUTER).starts[-1] == pytest.approx(length, rel=1e-6)
    command = run_program(part, ROUTER)
    apart = np.linalg.norm(curve[None, ::100] - command.position[::50, None, :2], axis=2).min(axis=1)
    assert apart.max() < 2e-5


ZERO_LENGTH = ("G64 P0.03", "G0 X0 Y0 Z0", "G1 X25 F150", "{}", "G1 Y25", "G1 X0")


@pytest.mark.parametrize("nowhere", ["G1 X25 Z0", "X25 F150", "G1 X25\nX25\nX25"])
def test_a_line_that_goes_nowhere_takes_no_speed_from_the_line_it_is_linked_into(nowhere: str) -> None:
    with_it = run(ROUTER, *(line.format(nowhere) for line in ZERO_LENGTH))
    without = run(ROUTER, *(line for line in ZERO_LENGTH if line != "{}"))
    assert with_it.t[-1] == pytest.approx(3 * 25 / 2.5, rel=0.01)  # three times 25 mm at 2.5 mm/s, and corners
    assert with_it.t[-1] == pytest.approx(without.t[-1], abs=10 * ROUTER.servo_period)


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl"])
def test_a_run_that_accelerations_make_too_long_is_refused(dialect: str) -> None:
    axes = {name: replace(axis, limits=replace(axis.limits, acceleration=1e-13)) for name, axis in ROUTER.axes.items()}
    lazy = replace(ROUTER, axes=axes, dialect=dialect)
    with pytest.raises(TooLargeError, match=r"too long to be sampled.* most of it in line 3"):
        run(lazy, "G0 X0 Y0", "G1 X1 F6000")


def test_arcs_of_too_many_chords_are_refused() -> None:
    part = program("G0 X0 Y0", "G2 X0 Y0 I9000000 F999999999")  # 56.5 km in chords of 1 mm
    with pytest.raises(TooLargeError, match=r"its arcs have too many chords to be run; .* got about 5.65e\+07"):
        run_program(part, replace(ROUTER, dialect="marlin"))


def test_the_machines_path_tolerance_is_that_of_a_program_without_a_path_mode() -> None:
    """As LinuxCNC does with G64 P0.03 in its startup code: corners, and lines that become one."""
    lines = ["G0 X0 Y0", "G1 X10 F1800", *(f"X{10 - 0.1 * k:.1f} Y{0.005 * (k % 2) + k * 0.3:.3f}" for k in range(30))]
    machine = replace(ROUTER, planner=PlannerSettings(path_tolerance=3e-5))
    expected, without = run(ROUTER, "G64 P0.03", *lines), run(ROUTER, *lines)
    np.testing.assert_array_equal(run(machine, *lines).position, expected.position)
    rows = min(len(expected.position), len(without.position))
    assert np.abs(expected.position[:rows] - without.position[:rows]).max() > 1e-6
    np.testing.assert_array_equal(run(machine, "G61", *lines).position, run(ROUTER, "G61", *lines).position)


def test_a_dwell_step_holds_for_linuxcnc_too() -> None:
    machine = replace(ROUTER, planner=PlannerSettings(dwell_step=0.1))
    lines = ("G1 X1 F600", "G4 P0.02", "X2")
    assert periods(run(machine, *lines)) - periods(run(ROUTER, *lines)) == round(0.08 / ROUTER.servo_period)
