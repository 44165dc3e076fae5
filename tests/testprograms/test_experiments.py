"""The next experiment: it stays where the record was, differs from it, and records what separates."""

from __future__ import annotations

import collections
import itertools
import math

import numpy as np
import pytest
from msgspec.structs import replace
from support.testdrive import Drive

from ph_post.drive.effects.registry import CATALOGUE
from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import read_program
from ph_post.testprograms.experiments import SHOWN, next_experiment, separation
from ph_post.testprograms.motions import PARTS
from ph_post.types import AxisLog, Log
from ph_post.types.diagnosis import Experiment

MM = 1e-3
MILL = read_machine("mill")
CENTRE = (120.0, -60.0)
RADIUS, FEED = 40.0, 25.0
"""Of the circles of the record [mm, mm/s]."""

PAIRS = list(itertools.combinations(CATALOGUE, 2))


def record(axes: str = "XY", **channels: np.ndarray) -> Log:
    """Return a record of two turns of a circle, with the table's positions alone."""
    t = np.arange(round(2.0 * math.tau * RADIUS / FEED * 1000.0)) * 1e-3
    angle = FEED / RADIUS * t
    places = {
        "X": CENTRE[0] + RADIUS * np.cos(angle),
        "Y": CENTRE[1] + RADIUS * np.sin(angle),
        "Z": -20.0 + angle,
    }
    logs = {axis: AxisLog(command=places[axis] * MM, table=places[axis] * MM, **channels) for axis in axes}
    return Log(name="circle", t=t, period=1e-3, axes=logs)


LOG = record()


def drive_of(one: Experiment) -> Drive:
    return Drive(one.program, (*CENTRE, 0.0))


def asked(*names: str, axis: str = "X") -> Experiment:
    found = next_experiment(names, axis, LOG, MILL)
    assert found is not None
    return found


def test_the_table_knows_the_catalogue_and_its_motions() -> None:
    assert set(SHOWN) == set(CATALOGUE)
    for one, other in PAIRS:
        assert set(separation(one, other).parts) <= set(PARTS)
        assert separation(one, other) == separation(other, one) or separation(one, other).why


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_every_two_effects_have_an_experiment_inside_the_record(one: str, other: str) -> None:
    found = asked(one, other)
    program = read_program(found.program.encode(), found.name, strict=True)
    assert program.notes == ()
    drive = drive_of(found)
    off = np.abs(drive.points - np.array([*CENTRE, 0.0])).max(axis=0)
    assert np.all(off <= [RADIUS, RADIUS, 0.0])
    np.testing.assert_allclose(drive.end[:2], CENTRE, atol=2e-3)
    assert one in found.why
    assert other in found.why
    channels = {"act": "X_act", "motor": "X_motor", "force": "X_force"}
    for channel in separation(one, other).record:
        assert any(line.startswith(channels[channel]) and line.endswith("needed") for line in found.record)
    lacking = [channels[channel] for channel in separation(one, other).record if channel != "act"]
    assert found.record[0].startswith("also record") == bool(lacking)
    assert all(name in found.record[0] for name in lacking)
    # Not the same motion once more: more channels, or feeds, accelerations or ways that the record has not.
    feeds = {feed for _, feed in drive.strokes(0)} | {circle.feed for circle in drive.circles}
    assert lacking or any(not 0.5 < feed / 60.0 / FEED < 2.0 for feed in feeds)


def pushes(drive: Drive) -> list[float]:
    return [(circle.feed / 60.0) ** 2 / circle.radius for circle in drive.circles]


def has_accelerations(drive: Drive) -> bool:
    recorded = FEED**2 / RADIUS
    return max(pushes(drive)) > 5.0 * recorded and max(pushes(drive)) > 10.0 * min(pushes(drive))


def has_steady_speeds(drive: Drive) -> bool:
    speeds = {feed / 60.0 for _, feed in drive.strokes(0)}
    ways = {math.copysign(1.0, length) for length, _ in drive.strokes(0)}
    return min(speeds) <= 0.2 and max(speeds) >= 50.0 and len(speeds) >= 8 and ways == {1.0, -1.0}


def has_small_and_large_steps(drive: Drive) -> bool:
    sizes = {round(abs(length), 3) for length, _ in drive.strokes(0)}
    return {0.02, 0.1, 0.5, 2.0, 10.0} <= sizes and len(drive.places(0)) >= 16


def has_two_far_feeds(drive: Drive) -> bool:
    feeds = [feed for length, feed in drive.strokes(0) if abs(length) > 79.0]
    return max(feeds) > 7.9 * min(feeds)


def has_diagonals(drive: Drive) -> bool:
    ways = {tuple(np.sign(one.end - one.start)[:2]) for one in drive.moves if one.word == "G1" and one.length > 100.0}
    return ways == {(1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)}


def has_places(drive: Drive) -> bool:
    return len({round((place - CENTRE[0]) / 15.0) for place in drive.places(0)}) >= 5


def has_time(drive: Drive) -> bool:
    sweeps = collections.Counter(feed for length, feed in drive.strokes(0) if abs(length) > 79.0)
    return drive.seconds > 500.0 and max(sweeps.values()) >= 10


def has_stops(drive: Drive) -> bool:
    return sum(rest >= 1.0 for rest in drive.rests()) >= 6


SEPARATED = [
    ("coulomb_friction", "backlash", {"motor", "force"}, [has_small_and_large_steps]),
    ("stribeck_friction", "position_dependent_backlash", {"motor", "force"}, [has_small_and_large_steps]),
    ("viscous_friction", "transport_delay", {"force"}, [has_accelerations, has_stops, has_steady_speeds]),
    ("viscous_friction", "servo_mismatch", {"force"}, [has_accelerations, has_steady_speeds]),
    ("servo_mismatch", "transport_delay", set(), [has_accelerations, has_stops]),
    ("scale_error", "thermal_growth", set(), [has_time]),
    ("cyclic_error", "cogging", {"motor"}, [has_two_far_feeds]),
    ("load_offset", "backlash", {"force"}, [has_small_and_large_steps]),
    ("squareness", "scale_error", set(), [has_diagonals]),
    ("elastic_windup", "servo_mismatch", {"motor"}, [has_accelerations, has_stops]),
    ("friction_asymmetry", "load_offset", {"force"}, [has_steady_speeds]),
    ("friction_asymmetry", "viscous_friction", {"force"}, [has_steady_speeds]),
    ("engagement_impact", "backlash", {"motor"}, [has_accelerations, has_small_and_large_steps]),
    ("cutting_force", "coulomb_friction", {"force"}, [has_two_far_feeds]),
    ("position_dependent_backlash", "backlash", {"motor"}, [has_places]),
    ("stribeck_friction", "coulomb_friction", {"force"}, [has_steady_speeds]),
    ("torque_saturation", "elastic_windup", {"motor", "force"}, [has_accelerations]),
]


@pytest.mark.parametrize(("one", "other", "channels", "motions"), SEPARATED)
def test_it_has_the_motions_and_channels_that_separate(one: str, other: str, channels: set[str], motions: list) -> None:
    found = asked(other, one)
    missing = found.record[0] if found.record[0].startswith("also") else ""
    assert {channel for channel in ("motor", "force") if f"X_{channel}" in missing} == channels
    drive = drive_of(found)
    assert [motion.__name__ for motion in motions if not motion(drive)] == []


def test_the_feeds_of_circles_are_others_than_the_records() -> None:
    circles = drive_of(asked("backlash", "coulomb_friction")).circles
    feeds = sorted({round(circle.feed / 60.0, 2) for circle in circles})
    # A fifth and five times, but no more than 0.8 of what half of 600 mm/s² allows around 24 mm.
    assert feeds == pytest.approx([5.0, 25.0, 0.8 * math.sqrt(0.5 * 600.0 * 0.3 * 79.999)], abs=0.02)


@pytest.mark.parametrize("names", [(), ("backlash",), ("gremlins", "backlash"), ("gremlins",)])
def test_without_two_names_it_is_the_full_mix(names: tuple[str, ...]) -> None:
    found = asked(*names)
    assert found.name == "mix_x"
    drive = drive_of(found)
    assert has_small_and_large_steps(drive)
    assert has_diagonals(drive)
    assert {circle.sense for circle in drive.circles} == {1, -1}
    assert "X_motor, X_force" in found.record[0]


def test_one_name_on_two_axes_moves_one_at_a_time() -> None:
    drive = drive_of(asked("coulomb_friction:X", "coulomb_friction:Y"))
    assert drive.circles == []
    assert len(drive.places(0)) >= 16
    assert len(drive.places(1)) >= 16
    assert sum(one.length > 0.1 and np.all(one.start[:2] != one.end[:2]) for one in drive.moves) == 0


def test_three_names_have_what_every_two_of_them_want() -> None:
    found = asked("scale_error", "squareness", "thermal_growth")
    drive = drive_of(found)
    assert has_time(drive)
    assert has_diagonals(drive)
    assert found.name == "separate_x"
    # Warmth first: the rest would warm what it wants cold.
    assert found.program.index("strokes that warm") < found.program.index("both diagonals")


def test_z_moves_only_where_it_is_asked_about() -> None:
    log = record("XYZ")
    beside = next_experiment(("backlash", "coulomb_friction"), "X", log, MILL)
    assert beside is not None
    assert not np.any(Drive(beside.program, (*CENTRE, 0.0)).points[:, 2])
    span = log.axes["Z"].command
    found = next_experiment(("backlash", "coulomb_friction"), "Z", log, MILL)
    assert found is not None
    middle = 500.0 * (span.min() + span.max())
    drive = Drive(found.program, (0.0, 0.0, middle))
    assert not np.any(drive.points[:, :2])
    assert np.ptp(drive.points[:, 2]) > 5.0
    assert drive.points[:, 2].min() >= span.min() / MM
    assert drive.points[:, 2].max() <= span.max() / MM


def test_an_axis_that_did_not_move_has_no_room() -> None:
    still = replace(LOG, axes={**LOG.axes, "Y": replace(LOG.axes["Y"], command=np.full(LOG.t.size, 0.02))})
    assert next_experiment(("backlash", "coulomb_friction"), "Y", still, MILL) is None
    assert next_experiment(("backlash", "coulomb_friction"), "Z", LOG, MILL) is None
    alone = next_experiment(("squareness", "scale_error"), "X", still, MILL)
    assert alone is not None
    assert not np.any(np.diff(Drive(alone.program, (CENTRE[0], 20.0, 0.0)).points[:, 1]))


def test_what_the_record_has_is_not_asked_for_as_new() -> None:
    log = record(motor=LOG.axes["X"].command, effort=np.zeros(LOG.t.size))
    found = next_experiment(("backlash", "coulomb_friction"), "X", log, MILL)
    assert found is not None
    assert not found.record[0].startswith("also")


def test_an_unknown_side_is_to_be_told() -> None:
    log = record()
    unknown = replace(log, axes={axis: replace(one, side="unknown") for axis, one in log.axes.items()})
    found = next_experiment(("backlash", "coulomb_friction"), "X", unknown, MILL)
    assert found is not None
    assert "say where X_act is read: at the table, or at the motor, where it is X_motor" in found.record


def test_errors_of_a_scale_want_a_gauge_outside_of_its_loop() -> None:
    record_lines = asked("squareness", "scale_error").record
    assert any(line.startswith("X_act [mm]: a gauge at the table outside of the loop") for line in record_lines)
    assert any("PIN_OF_THE_X_GAUGE" in line for line in record_lines)


@pytest.mark.parametrize("dialect", ["grbl", "grblhal", "linuxcnc"])
def test_it_speaks_the_dialect_of_the_machine(dialect: str) -> None:
    found = next_experiment(("backlash", "coulomb_friction"), "X", LOG, replace(MILL, dialect=dialect))
    assert found is not None
    assert ("G61" in found.program) == (dialect == "linuxcnc")
    assert max(map(len, found.program.splitlines())) <= (70 if dialect == "grbl" else 255)
    assert len(drive_of(found).circles) >= 6
