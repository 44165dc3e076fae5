"""Programs with jogs, read back by an interpreter of their own: where they go, and what they declare."""

from __future__ import annotations

import re
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial import cKDTree
from support.interpreter import Move, run
from support.plans import make_path, make_plan

from ph_post.analysis.path_analysis import analyse
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan as plan_motion
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.geometry.curves import Arc, Bezier, Line
from ph_post.geometry.track import Track
from ph_post.post.options import ProgramOptions
from ph_post.post.program import make_program
from ph_post.types import Jog, Plan
from ph_post.units import MM

HOW = ProgramOptions(safe_z=5 * MM, depth=-1 * MM)
RING = Arc(start=np.array([6, 8]) * MM, end=np.array([6, 8]) * MM, center=np.zeros(2), turn="ccw")
CUBIC = Bezier(np.array([[0, 0], [10, 40], [50, 40], [60, 0]]) * MM)
CORNERS = [Line(np.array(ends) * MM) for ends in ([[0, 0], [20, 5]], [[20, 5], [0, 10]], [[0, 10], [20, 4]])]
CASES = {"ring": ([RING], True, 4), "cubic": ([CUBIC], False, 1), "corners": (CORNERS, False, 3)}


@lru_cache
def planned(name: str) -> tuple[Plan, Track]:
    curves, closed, _ = CASES[name]
    analysis = analyse(make_path(curves, closed=closed), read_machine("stepper"), 5e-6)
    options = PlanOptions(strategy="takeup", carrier="program", max_slowdown=0.6, effort=0.05)
    return plan_motion(analysis, options), analysis.track


def jogs_of(moves: list[Move]) -> list[int]:
    """Moves between two dwells."""
    words = [move.word for move in moves]
    return [k for k in range(1, len(moves) - 1) if words[k - 1] == words[k + 1] == "G4" and words[k] == "G1"]


@pytest.mark.parametrize("mode", ["per-minute", "inverse-time"])
@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl"])
@pytest.mark.parametrize("name", list(CASES))
@pytest.mark.thinned(8)
def test_the_path_plus_the_offset_is_what_is_run(name: str, dialect: str, mode: str) -> None:
    plan, track = planned(name)
    program = make_program(plan, track, find_dialect(dialect), replace(HOW, feed_mode=mode))
    result = run(program.text)
    assert result.ended
    cut = [k for k, move in enumerate(result.moves) if move.start[2] == move.end[2] == -1.0]
    moves = [result.moves[k] for k in cut]
    jogs = jogs_of(moves)
    assert len(jogs) == CASES[name][2] == sum(move.word == "G4" for move in moves) - corners_shared(moves)
    half = {axis: plan.machine.axes[axis].gap.lost_motion / 2 / MM for axis in "XY"}
    offset = moves[0].start[:2] - track.derivatives(*track.locate(np.zeros(1)))[0][0] / MM
    # An axis that never turns back is shifted with the others: the lags of two may cancel across the path.
    assert np.abs(offset) == pytest.approx([half[axis] for axis in "XY"], abs=1e-4)
    dense = np.linspace(0, track.length * (1 - 1e-12), 200_001)
    path = cKDTree(track.derivatives(*track.locate(dense))[0] / MM)
    for k, move in enumerate(moves):
        if k in jogs:
            change = (move.end - move.start)[:2]
            axis = int(np.argmax(np.abs(change)))
            assert abs(change[axis]) == pytest.approx(2 * half["XY"[axis]], abs=2e-4)
            assert change[1 - axis] == 0.0
            # From the side that the axis came from to the side that it goes to.
            assert np.sign(change[axis]) == -np.sign(offset[axis])
            offset = offset + change
            continue
        assert path.query(move.points(4)[:, :2] - offset)[0].max() < 1e-3 + 3e-4
    # lifted off, the offset is taken back
    last = result.moves[-1]
    assert last.start[2] == 5.0
    end = track.derivatives(*track.locate(np.array([track.length])))[0][0] / MM
    assert last.end[:2] == pytest.approx(end, abs=1e-4)


def corners_shared(moves: list[Move]) -> int:
    """Dwells beyond one a jog: each run of jogs has one more than jogs."""
    words = "".join("4" if move.word == "G4" else "1" for move in moves)
    return len(re.findall(r"4(?:14)+", words))


@pytest.mark.parametrize("mode", ["per-minute", "inverse-time"])
def test_rests_before_rapids_carry_jogs(mode: str) -> None:
    """X turns back where a rapid begins, and where two rapids meet: there the tool stays up."""
    corners = [[0, 0], [20, 0], [10, 10], [30, 10], [40, 20]]
    curves = [Line(np.array(ends) * MM) for ends in pairwise(corners)]
    analysis = analyse(make_path(curves, rapid=(1, 2)), read_machine("stepper"), 5e-6)
    plan = plan_motion(analysis, PlanOptions(strategy="takeup", carrier="program", max_slowdown=0.6))
    program = make_program(plan, analysis.track, find_dialect("linuxcnc"), replace(HOW, feed_mode=mode))
    moves = run(program.text).moves
    heights = [(moves[k].start[2], moves[k].end[2]) for k in jogs_of(moves)]
    assert heights == [(-1.0, -1.0), (5.0, 5.0)]
    assert [round(moves[k].start[0] - moves[k].end[0], 4) for k in jogs_of(moves)] == [0.06, -0.06]
    down = [tuple(move.start[:2].round(4)) for move in moves if move.end[2] < move.start[2]]
    # Y goes on to plus all along, and carries its half of 0.08 mm.
    assert down == [(0.03, 0.04), (30.03, 10.04)]


def ring_plan(max_slowdown: float) -> Plan:
    """Plan a circle that begins and ends 0.8 mm behind the place where X turns back."""
    at = 8 * np.array([np.cos(0.1), np.sin(0.1)]) * MM
    ring = Arc(start=at, end=at, center=np.zeros(2), turn="ccw")
    analysis = analyse(make_path([ring]), read_machine("stepper"), 5e-6)
    options = PlanOptions(strategy="auto", carrier="program", max_slowdown=max_slowdown, effort=0.05)
    return plan_motion(analysis, options)


def test_the_motion_stops_for_jogs_where_there_is_no_room_for_a_profile() -> None:
    plan = ring_plan(1.0)
    assert [jog.axis for jog in plan.crossings if jog.start > 0] == ["Y", "X", "Y", "X"]
    # Each costs the ramps down and up, a jog and two dwells; a profile took several times that.
    assert plan.phases[-1].start - plan.nominal[-1].start < 4 * 0.35


@pytest.mark.slow
def test_the_slowdown_that_is_named_allows_the_stops() -> None:
    """With less only the axis with more play has its stops, or none."""
    [said] = [one for one in ring_plan(0.2).warnings if "not compensated" in one]
    assert re.match(r"axis X is not compensated: stopping at every reversal would add [\d.]+ s; ", said)
    [named] = re.findall(r"--max-slowdown ([\d.]+) allows it", said)
    assert {jog.axis for jog in ring_plan(float(named)).crossings} == {"X", "Y"}
    [said] = [one for one in ring_plan(0.01).warnings if "not compensated" in one]
    assert said.startswith("axes X, Y are not compensated: stopping")


def test_jogs_run_at_the_feed_they_were_simulated_with() -> None:
    plan, track = planned("ring")
    written = [jog for jog in plan.crossings if isinstance(jog, Jog) and jog.start > 0]
    for mode in ("per-minute", "inverse-time"):
        moves = run(make_program(plan, track, find_dialect("linuxcnc"), replace(HOW, feed_mode=mode)).text).moves
        found = [moves[k] for k in jogs_of(moves)]
        speeds = [move.length / move.duration * MM for move in found]
        assert speeds == pytest.approx([jog.velocity for jog in written], rel=1e-5)
        dwells = [move.duration for move in moves if move.word == "G4"]
        assert min(dwells) >= 10e-3 * (1 - 1e-6)


def test_arcs_stay_arcs_about_a_shifted_centre() -> None:
    plan, track = planned("ring")
    moves = run(make_program(plan, track, find_dialect("linuxcnc"), HOW).text).moves
    arcs = [move for move in moves if move.word == "G3"]
    centres = {tuple(np.round(move.center, 3)) for move in arcs}
    # Half the gaps of 0.06 and 0.08 mm: one centre for every pair of directions.
    assert centres == {(x, y) for x in (-0.03, 0.03) for y in (-0.04, 0.04)}
    swept = sum(abs(move.angle) for move in arcs)
    assert swept > 0.95 * 2 * np.pi


def test_the_header_declares_the_offsets() -> None:
    plan, track = planned("ring")
    text = " ".join(make_program(plan, track, find_dialect("linuxcnc"), HOW).text.split())
    for axis, size in (("X", "0.03"), ("Y", "0.04")):
        assert f"axis {axis} carries an offset of {size} mm from the path" in text
    plain = make_program(make_plan(track), track, find_dialect("linuxcnc"), HOW).text
    assert "offset of" not in plain


LINUXCNC = find_dialect("linuxcnc")


def test_a_dialect_that_cannot_carry_jogs_is_refused() -> None:
    plan, track = planned("ring")
    restless = replace(LINUXCNC, abilities=replace(LINUXCNC.abilities, dwells=False))
    with pytest.raises(InputError, match="decimals of linuxcnc are too few for an offset of axis X"):
        make_program(plan, track, replace(LINUXCNC, numbers=replace(LINUXCNC.numbers, decimals=2)), HOW)
    with pytest.raises(InputError, match="no dwell in which the axes stand still"):
        make_program(plan, track, restless, HOW)
    assert make_program(make_plan(track), track, restless, HOW).text


def test_a_jog_in_motion_is_refused() -> None:
    track = Track(make_path([CUBIC]))
    jog = Jog(axis="X", start=1.0, travel=5e-5, velocity=1e-3, acceleration=0.1)
    plan = replace(make_plan(track), crossings=(jog,), bias={"X": -2.5e-5})
    with pytest.raises(InputError, match="does not lie in a rest of the path"):
        make_program(plan, track, find_dialect("linuxcnc"), HOW)


def touched_off(motor: np.ndarray, gap: float, side: int) -> np.ndarray:
    """Table of an axis behind a play, from a zero that was taken in one direction (1, -1), or half-way (0).

    It begins on the other side of the play, as nobody has said where it stands.
    """
    table = motor[0] - 0.5 * gap
    places = []
    for place in motor:
        table = min(max(table, place - 0.5 * gap), place + 0.5 * gap)
        places.append(table)
    return np.array(places) + 0.5 * side * gap


RAMPS = {
    "up": [[0, 0, -1], [20, 0, 0]],
    "down": [[0, 0, -1], [20, 0, -2]],
    "both": [[0, 0, -1], [20, 0, 0], [40, 0, -1], [60, 0, -0.5]],
}


@pytest.mark.parametrize("start", ["approached", "as it stands"])
@pytest.mark.parametrize("said", [-1, 0, 1])
@pytest.mark.parametrize("name", list(RAMPS))
def test_a_cut_up_and_down_keeps_its_depth_from_the_zero_that_the_file_names(name: str, said: int, start: str) -> None:
    machine = read_machine("stepper")
    directions = {-1: "-", 0: "both", 1: "+"}
    rigid = replace(machine.axes["X"], gap=machine.axes["X"].gap.with_lost_motion(0.0))
    touched = replace(machine.axes["Z"], reference_direction=directions[said])
    machine = replace(machine, axes={**machine.axes, "X": rigid, "Z": touched})
    curves = [Line(np.array(ends) * MM) for ends in pairwise(RAMPS[name])]
    analysis = analyse(make_path(curves, axes=("X", "Y", "Z")), machine, 5e-6)
    plan = plan_motion(analysis, PlanOptions(strategy="takeup", carrier="program", max_slowdown=0.6, effort=0.05))
    safe = 5 * MM if start == "approached" else None
    program = make_program(plan, analysis.track, find_dialect("linuxcnc"), ProgramOptions(safe_z=safe))
    moves = run(program.text).moves
    z = np.concatenate([move.points(4)[:, 2] for move in moves])
    x = np.concatenate([move.points(4)[:, 0] for move in moves])
    words = np.repeat([move.word for move in moves], 5)
    gap = machine.axes["Z"].gap.lost_motion / MM
    table = touched_off(z, gap, said)
    places = np.array(RAMPS[name], dtype=float)
    wanted = np.interp(x, places[:, 0], places[:, 2])
    cuts = np.flatnonzero((words == "G1") & (x > 0.2) & (x < places[-1, 0] - 0.2))
    corners = np.abs(x[cuts, None] - places[None, :, 0]).min(axis=1) < 0.2
    off = np.abs(table - wanted)[cuts[~corners]]
    turns = len(RAMPS[name]) > 2
    # What never turns back, and has no side that is exact, is left alone: half the backlash all along.
    left = said == 0 and not turns
    assert off.max() == pytest.approx(0.5 * gap if left else 0.0, abs=3e-4)


@pytest.mark.parametrize(("dialect", "part"), [("marlin", 0.9), ("marlin", None), ("klipper", 0.9)])
def test_marlin_s_own_compensation_is_off_meanwhile_where_it_can_be_set_back(dialect: str, part: float | None) -> None:
    plan, track = planned("ring")
    plan = replace(plan, machine=replace(plan.machine, own_correction=part))
    text = make_program(plan, track, find_dialect(dialect), HOW).text
    commands = [line for line in text.splitlines() if not line.startswith(";")]
    stated = dialect == "marlin" and part is not None
    assert [line for line in commands if "M425" in line] == (["M425 F0", "M425 F0.9"] if stated else [])
    if stated:
        assert commands.index("M425 F0") < min(n for n, line in enumerate(commands) if line.startswith(("G0", "G1")))
        assert commands[-1] == "M425 F0.9"
    said = "own backlash compensation, F of M425, must be 0"
    assert (said in text.replace("\n;  ", "")) == (dialect == "marlin" and part is None)
