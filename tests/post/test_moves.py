"""The approach, and options that cannot be."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from support.interpreter import run
from support.plans import make_machine, make_path, make_plan

from ph_post.analysis.turning_points import find_turning_points
from ph_post.dialects.registry import find_dialect
from ph_post.errors import InputError
from ph_post.gcode.blocks import read_shape
from ph_post.geometry.curves import Arc, Bezier, Line
from ph_post.geometry.ph import PH
from ph_post.geometry.track import Track
from ph_post.post.options import ProgramOptions
from ph_post.post.program import first_directions, make_program
from ph_post.units import MM

DIALECTS = ("linuxcnc", "grbl")


def mm(points: object) -> np.ndarray:
    return np.array(points, dtype=float) * MM


def track_of(*curves: object, **how: object) -> Track:
    return Track(make_path(curves, **how))


CASES = {
    # start at an extremum of x, which then moves towards -x; y towards +y
    "circle": (
        track_of(Arc(start=mm([20, 0]), end=mm([20, 0]), center=mm([0, 0]), turn="ccw"), closed=True),
        (-1, 1),
    ),
    "backwards": (track_of(Line(mm([[5, 5], [-5, -25]]))), (-1, -1)),
    # y stands still for 30 mm and then goes down
    "later": (track_of(Line(mm([[0, 0], [30, 0]])), Line(mm([[30, 0], [30, -10]]))), (1, -1)),
    "never": (track_of(Line(mm([[0, 7], [30, 7]]))), (1, 0)),
    # a cubic whose x first creeps: x = 3 u² - 2 u³ backwards
    "creeping": (track_of(Bezier(mm([[9, 0], [9, 5], [0, 5], [0, 10]]))), (-1, 1)),
}


def test_a_first_motion_however_short_decides() -> None:
    """x = 10.1 u² - 0.1 u turns back after 0.25 µm, at 1/200 of the curve."""
    track = track_of(Bezier(mm([[0, 0], [-0.05, 5], [10, 10]])))
    senses = first_directions(
        read_shape(track, arcs=True, splines=False), find_turning_points(track), ("X", "Y"), 0.0, track.length
    )
    assert senses.tolist() == [-1.0, 1.0]


@pytest.mark.parametrize("lost", [0.0, 20e-6, 120e-6])
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("name", list(CASES))
def test_every_axis_comes_onto_its_flank(name: str, dialect: str, lost: float) -> None:
    track, senses = CASES[name]
    plan = make_plan(track, machine=make_machine(lost=lost))
    program = make_program(plan, track, find_dialect(dialect))
    result = run(program.text, start=(-50.0, 70.0, 30.0))
    approach = result.moves[: -program.moves]
    # A motor that lags, and carries an offset on its side, waits there.
    assert [move.word for move in approach] == ["G0", "G1", *(["G4"] if lost else [])]
    travel = approach[1].end - approach[1].start
    distance = max(2 * lost, 0.1 * MM) / MM
    assert travel[:2] == pytest.approx(np.array(senses) * distance, abs=1e-4)
    assert travel[2] == 0.0
    assert approach[1].feed == 300.0
    start = track.derivatives(*track.locate(np.array([0.0])), 0)[0, 0] / MM
    assert approach[1].end[:2] == pytest.approx(start, abs=1e-9)
    # the first travel of each axis on the path is in the sense of the approach
    for axis, sense in enumerate(senses):
        steps = [move.end[axis] - move.start[axis] for move in result.moves[-program.moves :]]
        first = next((step for step in steps if step), 0.0)
        assert np.sign(first) == sense


@pytest.mark.parametrize("dialect", DIALECTS)
def test_heights_of_planar_paths(dialect: str) -> None:
    track, _ = CASES["circle"]
    options = ProgramOptions(safe_z=5 * MM, depth=-1.5 * MM)
    program = make_program(make_plan(track), track, find_dialect(dialect), options)
    moves = run(program.text, start=(1.0, 2.0, 3.0)).moves
    steps = [(move.word, *move.end.tolist()) for move in moves[:4]]
    assert steps == [
        ("G0", 1.0, 2.0, 5.0),
        ("G0", 20.1, -0.1, 5.0),
        ("G1", 20.0, 0.0, 5.0),
        ("G1", 20.0, 0.0, -1.5),
    ]
    assert {move.end[2] for move in moves[4:-1]} == {-1.5}
    assert (moves[-1].word, moves[-1].end[2]) == ("G0", 5.0)


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("safe", [None, 40 * MM])
def test_spatial_paths_are_entered_from_above(dialect: str, safe: float | None) -> None:
    preimage = np.array([[4, 1, 0, 1], [2, 3, 1, 0], [3, 0, 2, 2]]) * MM**0.5
    track = Track(make_path([PH(mm([0, 0, -3]), preimage)]))
    plan = make_plan(track)
    program = make_program(plan, track, find_dialect(dialect), ProgramOptions(safe_z=safe))
    moves = run(program.text, start=(1.0, 2.0, 30.0)).moves
    approach = moves[: len(moves) - program.moves - (safe is not None)]
    heights = [move.end[2] for move in approach]
    assert heights == ([40.0, 40.0, 40.0, -3.0, -3.0] if safe else [30.0, -2.9, -2.9, -3.0, -3.0])
    assert [move.word for move in approach] == ["G0", "G0", "G1", "G1", "G4"]
    assert min(min(move.start[2], move.end[2]) for move in approach) >= -3.0
    seat = approach[2].end - approach[2].start
    first = np.sign(track.derivatives(*track.locate(np.array([1e-6])), 1)[1, 0])
    assert np.sign(seat[:2]).tolist() == first[:2].tolist()
    assert moves[-1].end[2] == (40.0 if safe else pytest.approx(moves[-1].end[2]))


def test_the_approach_stops_at_the_start() -> None:
    """LinuxCNC would otherwise round the corner between the approach and the cut by the chord tolerance."""
    track, _ = CASES["circle"]
    program = make_program(make_plan(track), track, find_dialect("linuxcnc"))
    moves = run(program.text).moves
    exact = [move.exact for move in moves]
    assert exact == [True] * 3 + [False] * program.moves


def test_a_slow_path_is_approached_as_slowly() -> None:
    track = track_of(Line(mm([[0, 0], [30, 10]])), feed=0.002)
    program = make_program(make_plan(track, speed=0.002), track, find_dialect("linuxcnc"))
    assert run(program.text).moves[1].feed == pytest.approx(120.0)


def test_the_approach_is_in_mm_per_minute_under_g93_too() -> None:
    track, _ = CASES["circle"]
    program = make_program(make_plan(track), track, find_dialect("grbl"), ProgramOptions(feed_mode="inverse-time"))
    lines = program.text.split("\n")
    assert "G1X20Y0F300" in lines[: lines.index("G93")]
    assert lines[-3:] == ["G94", "M2", ""]


PLANAR = track_of(Line(mm([[0, 0], [30, 10]])))
SPATIAL = track_of(Line(mm([[0, 0, 0], [30, 10, 5]])))


@pytest.mark.parametrize(
    ("track", "how", "message"),
    [
        (
            PLANAR,
            {"depth": -MM},
            "--depth: a depth needs a height to come from; expected --safe-z beside it; got -1",
        ),
        (
            PLANAR,
            {"safe_z": MM},
            "--safe-z: a safe height needs a depth to go to; expected --depth beside it; got 1",
        ),
        (PLANAR, {"safe_z": MM, "depth": 2 * MM}, "--safe-z: not above the depth; expected > 2 mm; got 1"),
        (SPATIAL, {"depth": -MM}, "--depth: the path has its own Z; expected no depth; got -1"),
        (SPATIAL, {"safe_z": MM}, "--safe-z: below an end of the path; expected >= 5 mm; got 1"),
        (PLANAR, {"chord_tolerance": 0.0}, "--chord-tolerance: not positive; expected > 0 mm; got 0"),
        (
            PLANAR,
            {"block_time": 5e-4},
            "--block-time: shorter than the servo period; expected >= 1 ms; got 0.5",
        ),
    ],
)
def test_options_that_cannot_be(track: Track, how: dict[str, float], message: str) -> None:
    with pytest.raises(InputError) as error:
        make_program(make_plan(track), track, find_dialect("grbl"), ProgramOptions(**how))
    assert str(error.value) == message


def test_a_dialect_without_inverse_time_is_not_asked_for_it() -> None:
    grbl = find_dialect("grbl")
    plain = msgspec.structs.replace(
        grbl, name="plain", abilities=msgspec.structs.replace(grbl.abilities, inverse_time=frozenset())
    )
    with pytest.raises(InputError, match="the dialect plain has no inverse time; expected per-minute"):
        make_program(make_plan(PLANAR), PLANAR, plain, ProgramOptions(feed_mode="inverse-time"))
