"""Programs read back by an interpreter of the tests' own: where they go, when, and how they end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from support.interpreter import Move, Run, run
from support.measure import distance_to_path, place_at, samples
from support.plans import RISE, Timetable, make_machine, make_path, make_plan

from ph_post.dialects.registry import find_dialect
from ph_post.geometry.curves import Arc, Bezier, Line
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.ph import PH
from ph_post.geometry.track import Track
from ph_post.post.options import ProgramOptions
from ph_post.post.program import Program, make_program
from ph_post.types import Plan
from ph_post.units import MM

DIALECTS = ("linuxcnc", "grbl")
MODES = ("per-minute", "inverse-time")
TOLERANCE_MM = 1e-3


def mm(points: Sequence) -> np.ndarray:
    return np.array(points, dtype=float) * MM


def circle() -> Track:
    curve = Arc(start=mm([20, 0]), end=mm([20, 0]), center=mm([0, 0]), turn="ccw")
    return Track(make_path([curve], closed=True, feed=0.04))


def slot() -> Track:
    """Two straight sides and two half turns clockwise, all tangent."""
    curves = [
        Line(mm([[0, 5], [30, 5]])),
        Arc(start=mm([30, 5]), end=mm([30, -5]), center=mm([30, 0]), turn="cw"),
        Line(mm([[30, -5], [0, -5]])),
        Arc(start=mm([0, -5]), end=mm([0, 5]), center=mm([0, 0]), turn="cw"),
    ]
    return Track(make_path(curves, closed=True))


def bezier() -> Track:
    return Track(make_path([Bezier(mm([[0, 0], [10, 40], [50, 40], [60, 0]]))], feed=0.04))


def quintic() -> Track:
    """A planar PH quintic."""
    return Track(make_path([PH(mm([0, 0]), np.array([[5, 1], [2, 6], [6, -2]]) * math.sqrt(MM))], feed=0.03))


def rational() -> Track:
    points = mm([[0, 0], [10, 20], [30, 20], [40, 0], [50, -20]])
    return Track(make_path([Nurbs(3, [0, 0, 0, 0, 0.5, 1, 1, 1, 1], points, weights=[1, 2, 1, 0.5, 1])]))


def space() -> Track:
    preimage = np.array([[4, 1, 0, 1], [2, 3, 1, 0], [3, 0, 2, 2]]) * math.sqrt(MM)
    return Track(make_path([PH(mm([0, 0, 0]), preimage)], feed=0.02))


def rectangle() -> Track:
    corners = mm([[0, 0], [30, 0], [30, 20], [0, 20], [0, 0]])
    return Track(make_path([Line(corners[i : i + 2]) for i in range(4)], closed=True))


def plan_of(name: str) -> tuple[Track, Plan]:
    """A track with a plan that has what its name says."""
    what = {
        "circle": (
            circle,
            lambda t: {"speed": 0.04, "dips": [(t.length * k / 4, -0.1, 0.12) for k in (1, 2, 3)]},
        ),
        "retrograde": (circle, lambda t: {"speed": 0.04, "dips": [(t.length / 4, -1.5, 0.12)]}),
        "slot": (slot, lambda t: {"dips": [(t.length * 0.32, 0.1, 0.1)]}),
        "bezier": (bezier, lambda t: {"speed": 0.04, "dips": [(t.length / 2, 0.0, 0.1)]}),
        "quintic": (quintic, lambda t: {"speed": 0.03, "dips": [(t.length / 2, 0.0, 0.1)]}),
        "rational": (rational, lambda t: {"dips": [(0.021, 0.2, 0.1)]}),
        "space": (space, lambda t: {"dips": [(t.length / 2, 0.2, 0.1)]}),
        "rectangle": (rectangle, lambda t: {"stops": mm([30, 50, 80])}),
        "moving": (circle, lambda t: {"speed": 0.04, "moving": True}),
    }
    make, how = what[name]
    track = make()
    return track, make_plan(track, **how(track))


NAMES = ("circle", "retrograde", "slot", "bezier", "quintic", "rational", "space", "rectangle", "moving")


def convert(name: str, dialect: str, mode: str, **more) -> tuple[Track, Plan, Program, Run, list[Move]]:
    track, plan = plan_of(name)
    program = make_program(plan, track, find_dialect(dialect), ProgramOptions(feed_mode=mode, **more))
    result = run(program.text, max_line=find_dialect(dialect).syntax.max_line)
    return track, plan, program, result, result.moves[-program.moves :]


def quantum(dialect: str) -> float:
    """Last decimal [mm]."""
    return find_dialect(dialect).numbers.quantum / MM


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("name", NAMES)
def test_moves_keep_to_the_path_and_to_the_time(name: str, dialect: str, mode: str) -> None:
    track, plan, _, result, moves = convert(name, dialect, mode)
    dim = track.dimension
    # the ends of moves are rounded by half a decimal in each coordinate, and so are the centres of arcs
    limit = TOLERANCE_MM + 2.0 * quantum(dialect) + 4e-6
    assert distance_to_path(track, samples(moves)[:, :dim]).max() <= limit

    planned = sum(phase.duration for phase in plan.phases)
    times = np.cumsum([move.duration for move in moves])
    assert times[-1] == pytest.approx(planned, rel=1e-5 if mode == "inverse-time" else 1e-3)

    length = abs(np.diff(place_at(plan.phases, np.linspace(0.0, planned, 20_001)))).sum() / MM
    # chords are shorter than what they span by κ δ / 3 of it, 2e-3 on the smallest radius of 0.2 mm or so
    assert sum(move.length for move in moves) == pytest.approx(length, rel=2e-3)

    end = track.derivatives(*track.locate(np.array([track.length])), 0)[0, 0] / MM
    assert np.abs(moves[-1].end[:dim] - end).max() <= 0.5001 * quantum(dialect)
    assert result.ended
    assert {key: value for key, value in result.state.items() if key not in ("motion", "path")} == {
        key: value for key, value in result.opening.items() if key not in ("motion", "path")
    }


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("name", NAMES)
def test_moves_end_where_the_plan_is_at_that_time(name: str, dialect: str) -> None:
    track, plan, _, _, moves = convert(name, dialect, "inverse-time")
    times = np.cumsum([move.duration for move in moves])
    planned = plan.phases[-1].start + plan.phases[-1].duration
    place = place_at(plan.phases, np.minimum(times, planned))
    expected = track.derivatives(*track.locate(place), 0)[0] / MM
    ends = np.array([move.end[: track.dimension] for move in moves])
    # F has 6 digits or more: each time is right to 5e-6 of itself, at speeds up to 40 mm/s
    limit = quantum(dialect) + 5e-6 * times[-1] * 40.0
    assert np.abs(ends - expected).max() <= limit


@pytest.mark.parametrize("dialect", DIALECTS)
def test_constant_speed_takes_the_longest_moves(dialect: str) -> None:
    *_, moves = convert("moving", dialect, "per-minute")
    assert [(move.word, round(math.degrees(move.angle), 6)) for move in moves] == [
        ("G3", 180.0),
        ("G3", 180.0),
    ]
    *_, moves = convert("slot", dialect, "per-minute")
    longest = sorted(moves, key=lambda move: -move.length)
    assert (longest[0].word, longest[0].length) == ("G1", 30.0)  # a whole straight side
    assert {move.word for move in moves if move.length > 2.0} == {"G1", "G2"}


def test_ramps_and_dips_take_blocks_of_at_most_the_block_time() -> None:
    for name in ("circle", "bezier", "space"):
        _, plan, _, _, moves = convert(name, "linuxcnc", "inverse-time", block_time=8e-3)
        times = np.cumsum([0.0, *(move.duration for move in moves)])
        place = place_at(plan.phases, np.minimum(times, times[-1] - 1e-9))
        middle = place_at(plan.phases, 0.5 * (times[1:] + times[:-1]))
        changing = np.abs(middle - 0.5 * (place[1:] + place[:-1])) > 1e-9
        durations = np.diff(times)
        assert changing.sum() > 20
        long = changing & (durations > 8e-3 * (1 + 1e-5))
        # Only blocks beside a rest, of which one alone would be shorter than a micrometre, are joined to a neighbour.
        lengths = np.array([move.length for move in moves])
        assert long.sum() <= 4
        assert lengths[long].max(initial=0.0) < 10e-3
        assert durations[long].max(initial=0.0) < 4.0 * 8e-3


def test_an_even_number_of_blocks_ends_one_at_the_turning_point() -> None:
    *_, moves = convert("circle", "linuxcnc", "per-minute")
    ends = np.array([move.end for move in moves])
    for top in ([0.0, 20.0], [-20.0, 0.0], [0.0, -20.0]):
        assert np.linalg.norm(ends[:, :2] - top, axis=1).min() <= 1e-6


@pytest.mark.parametrize("dialect", DIALECTS)
def test_retrograde_stretches_are_moves_back(dialect: str) -> None:
    _, plan, _, _, moves = convert("retrograde", dialect, "per-minute")
    ends = np.array([moves[0].start, *(move.end for move in moves)])
    angle = np.unwrap(np.arctan2(ends[:, 1], ends[:, 0]))
    back = np.flatnonzero(np.diff(angle) < -1e-12)
    assert (np.diff(back) == 1).all()
    planned = place_at(plan.phases, np.linspace(0.0, plan.phases[-1].start, 400_001))
    retreat = -np.minimum(np.diff(planned), 0.0).sum() / MM
    assert -np.diff(angle)[back].sum() * 20.0 == pytest.approx(retreat, abs=2 * quantum(dialect))
    # arcs the other way round; all of them lines to Grbl's decimals, as slow as it is here
    assert {moves[i].word for i in back} - {"G1"} == ({"G2"} if dialect == "linuxcnc" else set())


@pytest.mark.parametrize("dialect", DIALECTS)
def test_no_move_is_empty_and_no_time_is_lost(dialect: str) -> None:
    track, plan = plan_of("circle")
    crawl = Timetable()
    for _ in range(3):
        crawl.add(0.05, [0.0, 0.0, 1e-7])  # 1.7 nm in 50 ms: below Grbl's last decimal
        crawl.add(0.05, [1e-7, 0.0, 0.0])
    crawl.add(0.2, [0.0, 0.0, 0.02, 0.02])
    crawl.hold_until(track.length, 0.02)
    slow = msgspec.structs.replace(plan, phases=tuple(crawl.phases), windows=(), profiles=())
    program = make_program(slow, track, find_dialect(dialect))
    moves = run(program.text).moves[-program.moves :]
    assert all(np.abs(move.end - move.start).max() >= 0.999 * quantum(dialect) for move in moves)
    if dialect == "grbl":
        # Grbl's MINIMUM_FEED_RATE, 1 mm/min (config.h): it passes the crawl of 0.3 s at that, whatever F says.
        feeds = [60.0 * move.length / move.duration for move in moves]
        assert min(feeds) == pytest.approx(1.0, rel=1e-6)
        assert crawl.t - 0.3 < sum(move.duration for move in moves) < crawl.t
    else:
        assert sum(move.duration for move in moves) == pytest.approx(crawl.t, rel=1e-5)


def test_a_rest_is_a_dwell() -> None:
    track = rectangle()
    plan = make_plan(track)
    table = Timetable()
    table.rise(0.02)
    table.hold_until(0.029, 0.02)
    table.fall(0.02)
    table.add(0.25, [0.0])
    table.rise(0.02)
    table.hold_until(track.length, 0.02)
    for mode in MODES:
        program = make_program(
            msgspec.structs.replace(plan, phases=tuple(table.phases)),
            track,
            find_dialect("grbl"),
            ProgramOptions(feed_mode=mode),
        )
        moves = run(program.text).moves[-program.moves :]
        dwells = [move for move in moves if move.word == "G4"]
        # with the blocks before and after it that move by less than a decimal
        assert [0.25 <= move.duration <= 0.265 for move in dwells] == [True]
        assert dwells[0].end[0] == pytest.approx(30.0)
        assert sum(move.duration for move in moves) == pytest.approx(table.t, rel=1e-4)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_corners_are_reached(dialect: str) -> None:
    for name in ("rectangle", "moving"):
        track, plan = plan_of("rectangle")
        if name == "moving":
            plan = make_plan(track, moving=True)
        program = make_program(plan, track, find_dialect(dialect))
        ends = np.array([move.end[:2] for move in run(program.text).moves])
        for corner in ([30, 0], [30, 20], [0, 20], [0, 0]):
            assert (np.abs(ends - corner).max(axis=1) == 0.0).any()


def test_rapids_are_lifted_where_heights_are_known() -> None:
    curves = [
        Line(mm([[0, 0], [20, 0]])),
        Line(mm([[20, 0], [20, 10]])),
        Bezier(mm([[20, 10], [10, 20], [0, 10]])),
        Line(mm([[0, 10], [-10, 10]])),
    ]
    track = Track(make_path(curves, rapid=(1, 2)))
    between = 1e-3 * 10 + (track.length - 0.04)
    plan = make_plan(track, stops=[0.02, 0.02 + between])
    for dialect in DIALECTS:
        flat = run(make_program(plan, track, find_dialect(dialect)).text)
        # the approach, and then the rapid segments, whose Bézier is chords
        assert [move.word for move in flat.moves].count("G0") > 10
        assert {move.end[2] for move in flat.moves} == {0.0}
        options = ProgramOptions(safe_z=5 * MM, depth=-2 * MM)
        program = make_program(plan, track, find_dialect(dialect), options)
        moves = run(program.text).moves
        height = 2.0
        for move in moves:
            if move.word == "G0" and np.abs(np.diff([move.start[:2], move.end[:2]], axis=0)).max() > 0:
                assert move.start[2] == 5.0
            height = min(height, move.end[2])
        assert height == -2.0
        assert moves[-1].end[2] == 5.0
        down = [i for i, move in enumerate(moves) if move.end[2] < move.start[2] and move.end[2] == -2.0]
        assert [moves[i].end[:2].tolist() for i in down] == [[0.0, 0.0], [0.0, 10.0]]
        assert all(moves[i].word == "G1" for i in down)


@pytest.mark.parametrize("axes", [("X", "Z"), ("Y", "Z"), ("Y", "X"), ("Z", "X")])
@pytest.mark.parametrize("dialect", DIALECTS)
def test_arcs_turn_the_right_way_in_every_plane(axes: tuple[str, str], dialect: str) -> None:
    curve = Arc(start=mm([20, 5]), end=mm([-10, 5]), center=mm([5, 5]), turn="ccw")
    track = Track(make_path([curve], axes=axes, feed=0.02))
    program = make_program(make_plan(track), track, find_dialect(dialect))
    result = run(program.text)
    columns = ["XYZ".index(axis) for axis in axes]
    points = samples(result.moves[-program.moves :])[:, columns]
    assert distance_to_path(track, points).max() <= 2 * quantum(dialect) + 4e-6
    assert points[:, 1].max() == pytest.approx(20.0, abs=1e-3)  # over the top, not below
    assert result.opening["plane"] == {"XY": "G17", "XZ": "G18", "YZ": "G19"}["".join(sorted(axes))]


def test_cubics_run_backwards_as_well() -> None:
    track = bezier()
    table = Timetable()
    table.rise(0.03)
    table.hold_until(0.07, 0.03)
    table.fall(0.03)
    table.rise(-0.03)
    table.hold_until(0.02, -0.03)
    table.fall(-0.03)
    plan = msgspec.structs.replace(make_plan(track), phases=tuple(table.phases))
    program = make_program(plan, track, find_dialect("linuxcnc"))
    moves = run(program.text).moves[-program.moves :]
    assert sum(move.word == "G5" for move in moves) >= 2  # there, and back
    assert distance_to_path(track, samples(moves)[:, :2]).max() <= TOLERANCE_MM + 6e-6
    end = track.derivatives(*track.locate(np.array([table.s])), 0)[0, 0] / MM
    assert np.abs(moves[-1].end[:2] - end).max() <= 1e-6


def test_a_closed_path_may_be_run_over_its_seam() -> None:
    track = circle()
    table = Timetable()
    table.rise(0.04)
    table.hold_until(1.25 * track.length, 0.04)
    table.dip(0.04, 0.0, 0.1, 0)
    table.hold_until(1.5 * track.length, 0.04)
    plan = msgspec.structs.replace(make_plan(track), phases=tuple(table.phases))
    program = make_program(plan, track, find_dialect("linuxcnc"))
    moves = run(program.text).moves[-program.moves :]
    assert distance_to_path(track, samples(moves)[:, :2]).max() <= TOLERANCE_MM
    assert sum(move.length for move in moves) == pytest.approx(1.5 * track.length / MM, rel=1e-6)
    assert moves[-1].end[:2] == pytest.approx([-20.0, 0.0], abs=1e-6)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_the_same_bytes_twice_and_short_lines(dialect: str) -> None:
    for name in ("circle", "bezier", "space"):
        track, plan = plan_of(name)
        first = make_program(plan, track, find_dialect(dialect)).text
        assert first == make_program(plan, track, find_dialect(dialect)).text
        assert first.isascii()
        assert "\r" not in first
        assert first.endswith("M2\n")
        assert max(map(len, first.split("\n"))) <= find_dialect(dialect).syntax.max_line


def test_grbl_lines_are_terse() -> None:
    _, _, program, _, _ = convert("slot", "grbl", "per-minute")
    lines = [line for line in program.text.split("\n") if line and line[0] != "("]
    assert not any(" " in line for line in lines[1:])
    feeds = [line.split("F")[1] for line in lines if "F" in line]
    assert all(a != b for a, b in pairwise(feeds))  # F only where it changes


def test_under_g93_grbl_has_no_arcs_and_linuxcnc_no_splines() -> None:
    words = {move.word for move in convert("circle", "grbl", "inverse-time")[4]}
    assert words == {"G1"}
    assert "G5" in {move.word for move in convert("bezier", "linuxcnc", "per-minute")[4]}
    assert {move.word for move in convert("bezier", "linuxcnc", "inverse-time")[4]} == {"G1"}
    assert {move.word for move in convert("circle", "linuxcnc", "inverse-time")[4]} == {"G1", "G3"}


def test_the_header_tells_what_was_done() -> None:
    text = convert("circle", "linuxcnc", "per-minute")[2].text
    head = " ".join(text.split("G21")[0].replace(")\n(  ", " ").split("\n"))
    for words in (
        "strategy suppress",
        "path part, sha256 0123456789abcdef",
        "machine bench",
        "dialect linuxcnc",
        "planned time 3.1416 s without feed dips",
        "chords within 0.001 mm",
        "blocks of at most 5 ms",
        "window 1: segment 0, s 62.832 mm, X max, feed 2400 to 667.5 mm/min, t* 0.1200 s",
        "G54",
        "no Z word",
    ):
        assert words in head


def test_warnings() -> None:
    track, plan = plan_of("moving")
    told = make_program(plan, track, find_dialect("linuxcnc")).warnings
    assert [words.split(",")[0] for words in told] == [
        "no Z word is written",
        "the plan begins or ends at speed",
    ]
    options = ProgramOptions(safe_z=5 * MM, depth=-MM)
    track, plan = plan_of("circle")
    assert make_program(plan, track, find_dialect("linuxcnc"), options).warnings == ()
    slow = msgspec.structs.replace(options, feed_mode="inverse-time")
    assert "no G2 and G3" in make_program(plan, track, find_dialect("grbl"), slow).warnings[0]
    dense = msgspec.structs.replace(options, chord_tolerance=1e-9)
    assert "bytes a second" in make_program(*reversed(plan_of("quintic")), find_dialect("grbl"), dense).warnings[-1]
    track, plan = plan_of("quintic")
    late = make_plan(track, speed=0.03, machine=make_machine(period=4e-3))
    told = make_program(late, track, find_dialect("linuxcnc"), msgspec.structs.replace(dense, block_time=5e-3)).warnings
    assert "shorter than the servo period of 4 ms" in told[0]


@pytest.mark.parametrize("dialect", DIALECTS)
def test_stretches_that_are_hardly_any_make_no_blocks(dialect: str) -> None:
    """Such blocks would be nanometres long, turned any way by rounding, and LinuxCNC would stop for them."""
    track = quintic()
    table = Timetable()
    table.rise(0.02)
    table.hold_until(table.s + 0.02 * 2e-9, 0.02)
    table.dip(0.02, 0.3, 0.1, 0)
    table.hold_until(table.s + 0.02 * 4e-4, 0.02)
    table.dip(0.02, 0.3, 0.1, 1)
    table.hold_until(track.length - 0.02 * RISE / 2, 0.02)
    table.fall(0.02)
    plan = msgspec.structs.replace(make_plan(track), phases=tuple(table.phases))
    for tolerance in (1e-6, 1e-5):
        options = ProgramOptions(chord_tolerance=tolerance)
        program = make_program(plan, track, find_dialect(dialect), options)
        moves = run(program.text).moves[-program.moves :]
        assert min(move.duration for move in moves) >= 1e-3
        assert sum(move.duration for move in moves) == pytest.approx(table.t, rel=1e-4)
        limit = tolerance / MM + 2 * quantum(dialect) + 4e-6
        assert distance_to_path(track, samples(moves)[:, :2]).max() <= limit


@pytest.mark.parametrize("dialect", DIALECTS)
def test_pieces_passed_in_less_than_a_period_share_blocks(dialect: str) -> None:
    angles = np.linspace(0.0, math.pi / 4, 1501)
    points = 20e-3 * np.column_stack([np.cos(angles), np.sin(angles)])  # 10 µm apart, 0.5 ms at 20 mm/s
    track = Track(make_path([Line(points[i : i + 2]) for i in range(1500)]))
    program = make_program(make_plan(track), track, find_dialect(dialect))
    moves = run(program.text).moves[-program.moves :]
    assert len(moves) < 300
    assert min(move.duration for move in moves) >= 1e-3
    assert distance_to_path(track, samples(moves)[:, :2]).max() <= TOLERANCE_MM + 2 * quantum(dialect) + 4e-6
