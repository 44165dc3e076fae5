"""Test programs: read by the project's reader, LinuxCNC and a little interpreter, inside room and limits."""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
import pytest
from msgspec.structs import replace
from support.canon import assert_agrees, needs_rs274, number_lines, run_rs274
from support.testdrive import Drive

from ph_post.dialects.base import Recording
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.files.storage import shipped
from ph_post.gcode.read import read_program
from ph_post.simulate.controllers.run import run_program
from ph_post.testprograms import motions
from ph_post.testprograms.builder import CHORD, ProgramBuilder
from ph_post.testprograms.kit import calibration_kit, choose_volume
from ph_post.testprograms.program import what_to_record
from ph_post.types import Machine
from ph_post.types.diagnosis import Experiment

MACHINES = ("mill", "old_mill", "paper", "router", "stepper")
DIALECTS = ("grbl", "grblhal", "linuxcnc")
AXES = "XYZ"
MM = 1e-3

ROOMS = {
    "at zero": {},
    "elsewhere": {"centre": (0.15, -0.083), "travel": (0.12, 0.05), "radius": 0.02},
    "small": {"travel": (0.002,)},
}
WITH_Z = {"axes": "XYZ", "centre": (0.1, 0.05, -0.04), "travel": (0.1, 0.1, 0.03)}


@functools.cache
def kit_of(machine: str, dialect: str, room: str) -> tuple[Experiment, ...]:
    drives = replace(read_machine(machine), dialect=dialect)
    return calibration_kit(drives, **(WITH_Z if room == "with Z" else ROOMS[room]), warm_up=30.0)


def start_of(room: str) -> tuple[float, ...]:
    centre = (WITH_Z if room == "with Z" else ROOMS[room]).get("centre", (0.0, 0.0))
    return tuple(place / MM for place in (*centre, 0.0)[:3])


def reach_of(room: str, machine: Machine) -> np.ndarray:
    travel = (WITH_Z if room == "with Z" else ROOMS[room]).get("travel", (0.1,))
    whole = travel * 2 if len(travel) == 1 else travel
    return np.array([*whole, 0.0][:3]) / MM / 2.0


CASES = [
    *itertools.product(MACHINES, DIALECTS, ROOMS),
    *(("mill", dialect, "with Z") for dialect in DIALECTS),
    ("stepper", "grbl", "with Z"),
]


def test_every_shipped_machine_is_tried() -> None:
    assert {place.stem for place in shipped("machines", "mill").parent.glob("*.toml")} == set(MACHINES)


@pytest.mark.parametrize(("machine", "dialect", "room"), CASES)
@pytest.mark.thinned(12)
def test_programs_keep_to_the_room_and_end_where_they_begin(machine: str, dialect: str, room: str) -> None:
    drives, start = read_machine(machine), start_of(room)
    reach, words = reach_of(room, drives), find_dialect(dialect)
    grid = 0.5 * words.numbers.quantum / MM
    for one in kit_of(machine, dialect, room):
        drive = Drive(one.program, start)
        assert drive.run.ended
        assert drive.moves[0].length == 0.0 or drive.moves[0].word == "G4"
        np.testing.assert_allclose(drive.end, start, atol=grid + 1e-9)
        off = np.abs(drive.points - np.array(start)).max(axis=0)
        assert np.all(off <= reach + grid + 1e-9), one.name
        assert max(map(len, one.program.splitlines())) <= words.syntax.max_line
        assert "THE TOOL MUST BE CLEAR" in one.program
        assert {one.word for one in drive.moves} <= {"G1", "G2", "G3", "G4"}


@pytest.mark.parametrize(("machine", "dialect", "room"), CASES)
def test_the_reader_understands_all_of_them(machine: str, dialect: str, room: str) -> None:
    for one in kit_of(machine, dialect, room):
        program = read_program(one.program.encode(), one.name, strict=True)
        assert program.notes == ()
        # Behind the opening, which chooses the work offset, there is one chain to the end.
        assert [found.kind for found in program.breaks] == ["beginning", "frame", "end"]
        assert program.breaks[1].motion == 0
        assert not (program.motions.feed == 0.0).any()


@needs_rs274
@pytest.mark.parametrize(
    ("machine", "dialect", "room"),
    [
        ("mill", "linuxcnc", "with Z"),
        ("router", "linuxcnc", "elsewhere"),
        ("paper", "linuxcnc", "small"),
        ("stepper", "grbl", "with Z"),
        ("old_mill", "grblhal", "at zero"),
    ],
)
@pytest.mark.thinned(12)
def test_linuxcnc_reads_them_as_the_reader_does(machine: str, dialect: str, room: str) -> None:
    for one in kit_of(machine, dialect, room):
        text = number_lines(one.program)
        canon = run_rs274(text)
        assert canon.refusal == "", one.name
        assert_agrees(read_program(text.encode(), one.name), canon)


@pytest.mark.parametrize("room", ["at zero", "small"])
@pytest.mark.parametrize("machine", MACHINES)
def test_a_controller_keeps_the_limits_and_the_room(machine: str, room: str) -> None:
    drives = replace(read_machine(machine), dialect="linuxcnc")
    for one in kit_of(machine, "linuxcnc", room):
        command = run_program(read_program(one.program.encode(), one.name), drives)
        velocity = np.diff(command.position, axis=0) / command.period
        acceleration = np.diff(velocity, axis=0) / command.period
        for column, axis in enumerate(command.axes):
            limits = drives.axes[axis].limits
            reach = reach_of(room, drives)[column] * MM
            assert np.abs(command.position[:, column]).max() <= reach + 1e-8
            assert np.abs(velocity[:, column]).max() <= limits.velocity * (1.0 + 1e-6)
            assert np.abs(acceleration[:, column]).max() <= limits.acceleration * (1.0 + 1e-6)
        np.testing.assert_allclose(command.position[-1], command.position[0], atol=1e-9)
        told = float(one.record[0].split("about ")[1].split(" s")[0])
        assert command.t[-1] == pytest.approx(told, rel=0.1, abs=10.0)


@pytest.mark.parametrize(("machine", "dialect"), list(itertools.product(MACHINES, DIALECTS)))
def test_circles_go_both_ways_at_every_feed_and_below_the_acceleration(machine: str, dialect: str) -> None:
    drives = read_machine(machine)
    kit = {one.name: one for one in kit_of(machine, dialect, "at zero")}
    circles = Drive(kit["circles_xy"].program).circles
    by_feed: dict[tuple[float, float], set[int]] = {}
    for one in circles:
        by_feed.setdefault((round(one.radius, 6), one.feed), set()).add(one.sense)
    assert all(senses == {1, -1} for senses in by_feed.values())
    wide = [feed for radius, feed in by_feed if radius == 30.0]
    assert len(wide) == 3
    assert max(wide) / min(wide) == pytest.approx(6.0, rel=2e-5)  # six digits of a feed
    least = min(drives.axes[axis].limits.acceleration for axis in "XY") / MM
    pushes = [(feed / 60.0) ** 2 / radius for radius, feed in by_feed]
    assert max(pushes) < least
    assert max(pushes) / min(pushes) > 20.0


def test_each_plane_has_its_circles() -> None:
    found = {one.name: Drive(one.program, start_of("with Z")) for one in kit_of("mill", "linuxcnc", "with Z")}
    planes = {name: {one.axes for one in drive.circles} for name, drive in found.items()}
    assert planes["circles_xy"] == {(0, 1)}
    assert planes["circles_xz"] == {(0, 2)}
    assert planes["circles_yz"] == {(1, 2)}
    assert planes["mix"] == {(0, 1), (0, 2), (1, 2)}


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("axis", [0, 1])
def test_a_ladder_has_every_rung_both_ways(axis: int, dialect: str) -> None:
    kit = {one.name: one for one in kit_of("mill", dialect, "at zero")}
    drive = Drive(kit[f"ladder_{'xy'[axis]}"].program)
    steps = [round(length, 4) for length, _ in drive.strokes(axis)]
    rungs = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0]
    assert sorted(set(steps)) == sorted([*rungs, *(-rung for rung in rungs)])
    assert all(steps.count(rung) == steps.count(-rung) == 4 for rung in rungs)
    # Out and back to either side: two reversals a rung, up and down the ladder.
    assert len(drive.places(axis)) == 40
    assert drive.places(1 - axis) == []
    assert len(drive.rests()) > 80


def test_sweeps_go_over_all_of_the_way_both_ways_and_turn_round_along_it() -> None:
    kit = {one.name: one for one in kit_of("mill", "linuxcnc", "at zero")}
    drive = Drive(kit["sweep_y"].program)
    whole = [(length, feed) for length, feed in drive.strokes(1) if abs(length) == pytest.approx(100.0)]
    assert {math.copysign(1.0, length) for length, _ in whole} == {1.0, -1.0}
    feeds = sorted({feed for _, feed in whole})
    assert feeds[0] == pytest.approx(300.0)  # 100 mm in 20 s
    assert feeds[1] / feeds[0] == pytest.approx(8.0)
    assert len({round(place, -1) for place in drive.places(1)}) >= 7


def test_diagonals_go_along_both_of_them_both_ways() -> None:
    kit = {one.name: one for one in kit_of("mill", "linuxcnc", "elsewhere")}
    drive = Drive(kit["diagonals_xy"].program, start_of("elsewhere"))
    ways = {tuple(np.round(one.end - one.start, 6)) for one in drive.moves if one.length > 60.0}
    assert ways == {(50.0, 50.0, 0.0), (-50.0, -50.0, 0.0), (50.0, -50.0, 0.0), (-50.0, 50.0, 0.0)}


def test_the_mix_excites_everything() -> None:
    machine = read_machine("mill")
    one = kit_of("mill", "linuxcnc", "at zero")[0]
    assert one.name == "mix"
    drive = Drive(one.program)
    command = run_program(read_program(one.program.encode(), "mix"), machine)
    velocity = np.diff(command.position, axis=0) / command.period / MM
    acceleration = np.diff(velocity, axis=0) / command.period
    moving = np.abs(velocity).max(axis=1) > 1e-9
    for column, axis in enumerate("XY"):
        limits, speed = machine.axes[axis].limits, np.abs(velocity[:, column])
        assert speed.max() > 0.99 * limits.velocity / MM
        assert ((speed > 0.1) & (speed < 0.3)).sum() * command.period > 1.0  # a crawl that lasts
        push = acceleration[:, column] * MM / limits.acceleration
        assert push.max() > 0.95
        assert push.min() < -0.95
        assert np.ptp(command.position[:, column]) == pytest.approx(0.1)
        places = drive.places(column)
        assert len(places) > 30
        assert min(places) == pytest.approx(-50.0)
        assert max(places) == pytest.approx(50.0)
        assert min(abs(length) for length, _ in drive.strokes(column)) == pytest.approx(0.02)
    assert {(one.sense, round(one.radius)) for one in drive.circles} == {(1, 30), (-1, 30)}
    assert len({one.feed for one in drive.circles}) == 3
    assert (~moving).sum() * command.period > 6.0
    assert command.t[-1] < 300.0


def test_a_warm_up_looks_at_the_same_way_cold_and_warm() -> None:
    kit = calibration_kit(read_machine("router"), warm_up=300.0)
    drive = Drive(kit[-1].program)
    slow = [feed for length, feed in drive.strokes(0) if abs(length) == pytest.approx(100.0)]
    assert slow.count(min(slow)) >= 6  # at the beginning, after two and four minutes, at the end: to and fro
    assert 300.0 < drive.seconds < 400.0


def test_z_rests_unless_it_is_named() -> None:
    for one in calibration_kit(read_machine("mill")):
        program = read_program(one.program.encode(), one.name)
        assert not any(chr(letter) == "Z" for letter in program.words.letter)
        assert "Z not moved" in " ".join(one.program.split()).replace(") ( ", " ")
    assert {one.name.rpartition("_")[2] for one in calibration_kit(read_machine("mill"), axes="Z")} == {
        "mix",
        "z",
        "up",
    }


@pytest.mark.parametrize("dialect", ["fanuc", "linuxcnc", "siemens"])
def test_a_line_behind_an_arc_names_its_feed_anew(dialect: str) -> None:
    machine = read_machine("mill")
    builder = ProgramBuilder(choose_volume(machine, (), (), (), 0.01, ()), find_dialect(dialect))
    builder.line({"X": 0.02}, 0.4)
    builder.circle(("X", "Y"), 0.01, 1, 0.02)
    builder.line({"X": 0.03}, 0.4)
    lines = [line.replace(".", "") for line in builder.text(()).splitlines()]
    arc = next(k for k, line in enumerate(lines) if line.startswith("G3"))
    assert lines[arc].endswith("F1200")
    behind = next(line for line in lines[arc:] if line.startswith("G1"))
    assert behind == "G1 X30 F24000"


def test_without_arcs_a_circle_is_chords_within_a_micrometre() -> None:
    machine = read_machine("mill")
    dialect = find_dialect("linuxcnc")
    straight = replace(dialect, abilities=replace(dialect.abilities, arc_planes=()))
    builder = ProgramBuilder(choose_volume(machine, (), (), (), 0.01, ()), straight)
    motions.circles(builder, ("X", "Y"), (0.02,), 0.01)
    drive = Drive(builder.text(()))
    assert drive.circles == []
    radii = np.linalg.norm(drive.points[:, :2], axis=1)
    around = [one for one in drive.moves if one.word == "G1" and 0.0 < one.length < 1.0]
    middles = [np.linalg.norm((one.start + one.end) / 2.0) for one in around]
    assert len(around) > 4 * 100
    assert radii.max() == pytest.approx(10.0, abs=1e-5)
    assert min(middles) > 10.0 - CHORD / MM - 1e-5
    np.testing.assert_allclose(drive.end, 0.0)


def test_records_name_channels_and_the_lines_of_halsampler() -> None:
    kit = {one.name: one for one in kit_of("router", "linuxcnc", "at zero")}
    record = kit["circles_xy"].record
    assert "X_cmd, Y_cmd [mm]" in record[1]
    assert any(line.startswith("X_motor") and "own encoder" in line for line in record)
    assert "halcmd net kit-y-motor joint.1.pos-fb sampler.0.pin.3" in record
    assert "halcmd net kit-x-gauge PIN_OF_THE_X_GAUGE sampler.0.pin.4" in record
    assert "halcmd loadrt sampler depth=10000 cfg=ffffff" in record
    assert any(line.startswith("where nothing reads the table of X or Y, leave out") for line in record)
    # They are typed into a shell, to which an arrow of HAL is a file to write.
    assert not any(set(line) & set("<>") for line in record if line.startswith(("halcmd", "halsampler")))
    assert record[-1].endswith(
        "--column X_motor=3:mm --column Y_cmd=4:mm --column Y_motor=5:mm --column X_act=6:mm --column Y_act=7:mm"
    )
    speed = kit["speed_x"].record
    assert any(line.startswith("X_force") and line.endswith("needed") for line in speed)
    assert not any("Y_" in line for line in speed)
    hobby = kit_of("stepper", "grbl", "at zero")[0].record
    assert not any("halcmd" in line or "force" in line for line in hobby)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"axes": ("X", "W")}, r"--axes: the machine has no such axis; expected X or Y or Z; got 'W'"),
        ({"centre": (0.1,)}, "--centre: not one number an axis; expected 2, for X, Y; got 1"),
        ({"centre": (0.1, math.nan)}, "--centre: the centre of Y is out of range; expected within 100 m; got nan mm"),
        (
            {"travel": (0.001,)},
            "--travel: the travel of X is out of range; expected at least 2 mm, up to 100 m; got 1 mm",
        ),
        ({"travel": (0.1, 0.1, 0.1)}, "--travel: not one number an axis; expected 2, for X, Y; got 3"),
        (
            {"travel": (0.1, 0.04), "radius": 0.021},
            "--radius: the circles leave the travel; expected 0.5 mm up to 20 mm, half of the travel; got 21 mm",
        ),
        (
            {"radius": 0.0},
            "--radius: the radius is out of range; expected 0.5 mm up to 50 mm, half of the travel; got 0 mm",
        ),
        ({"radius": math.nan}, "--radius: the radius is out of range"),
        (
            {"feeds": (0.05, 0.11)},
            "--feeds: the feed exceeds the machine's limit; expected up to 6000 mm/min; got 6600 mm/min",
        ),
        # The saddle has 600 mm/s², half of which v²/r may take: 38.7 mm/s around 5 mm.
        (
            {"feeds": (0.04,), "radius": 0.005},
            "circles of 5 mm exceed .* expected up to 2323 mm/min, or a larger --radius; got 2400",
        ),
        ({"feeds": (-1.0,)}, "--feeds: the feed is too slow; expected at least 1 mm/min; got -60000 mm/min"),
        (
            {"warm_up": math.inf},
            "--warm-up: the warm-up time is out of range; expected minutes, above 0 up to 120; got inf",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(how: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        calibration_kit(read_machine("mill"), **how)


def test_a_machine_of_z_alone_wants_it_named() -> None:
    mill = read_machine("mill")
    lift = replace(mill, axes={"Z": mill.axes["Z"]})
    with pytest.raises(InputError, match="--axes: the machine has no axis but Z; expected Z, to have it moved"):
        calibration_kit(lift)
    assert calibration_kit(lift, axes=("Z",))[0].name == "mix"


def test_the_dialect_says_how_its_log_is_made() -> None:
    assert "some ten times a second" in kit_of("stepper", "grbl", "at zero")[0].record[-1]
    own = Recording(lines=lambda _machine, axes, _seconds, name, _gauge: [f"trace {name}: {' '.join(axes)}"])
    dialect = replace(find_dialect("fanuc"), recording=own)
    lines = what_to_record(read_machine("mill"), dialect, ("X", "Y"), ("act",), 10.0, "mix")
    assert lines[-1] == "trace mix: X Y"
