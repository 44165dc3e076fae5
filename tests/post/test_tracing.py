"""Splines in place of the straight moves that were sampled from them, held against closed forms."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from ph_post.api.freecad import JobRecord, answer, read_job
from ph_post.cli.main import main
from ph_post.dialects.linuxcnc import spline_deviation
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.files.storage import SourceText
from ph_post.geometry.nurbs import Nurbs
from ph_post.post.spline_moves import cubic_track, trace_moves
from ph_post.post.tracing import Move, find_runs

LINUXCNC = find_dialect("linuxcnc")
PERIOD, TOLERANCE = 1e-3, 2e-5
A, B = 30.0, 12.0

ROOT_HALF = np.sqrt(0.5)
ELLIPSE = {
    "degree": 2,
    "knots": [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4],
    "points": [
        [A * x, B * y] for x, y in [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
    ],
    "weights": [1, ROOT_HALF] * 4 + [1],
}
"""The textbook's ellipse of four rational quadratics [mm]."""


def track(curve=ELLIPSE):
    points = np.array(curve["points"]) * 1e-3
    return cubic_track(Nurbs(curve["degree"], curve["knots"], points, weights=curve.get("weights")))


def on_ellipse(angles):
    return np.stack([A * np.cos(angles), B * np.sin(angles)], axis=-1)


def cutting(points, feed=10.0):
    """A rapid to the first point, a plunge, and straight moves, as FreeCAD has them."""
    x, y = points[0]
    lines = [Move("G1", {"X": x, "Y": y, "Z": -0.5, "F": feed}) for x, y in points[1:]]
    return [Move("G0", {"X": x, "Y": y}), Move("G1", {"Z": -0.5, "F": 2.0}), *lines]


def bezier_places(moves, count=200):
    """Places on all splines, by de Casteljau's rule [mm]."""
    u = np.linspace(0.0, 1.0, count)[:, None]
    at = None
    for move in moves:
        end = np.array([move.words.get("X", np.nan), move.words.get("Y", np.nan)])
        if move.name == "G5":
            words = move.words
            inner = (at + [words["I"], words["J"]], end + [words["P"], words["Q"]])  # noqa: RUF005
            rows = [at, *inner, end]
            while len(rows) > 1:
                rows = [(1 - u) * a + u * b for a, b in pairwise(rows)]
            yield rows[0]
        at = np.where(np.isnan(end), at, end) if at is not None else end


ANGLES = np.linspace(0.0, 2.0 * np.pi, 241)


@pytest.mark.parametrize("angles", [ANGLES, ANGLES[::-1], ANGLES[30:100]], ids=["round", "back", "part"])
def test_a_sampled_ellipse_becomes_splines_on_the_ellipse(angles):
    points = on_ellipse(angles)
    moves, count = trace_moves(cutting(points), [track()], LINUXCNC, PERIOD, TOLERANCE)
    splines = [move for move in moves if move.name == "G5"]
    assert count == len(splines) < len(angles) / 3
    assert [move.name for move in moves[:2]] == ["G0", "G1"]
    assert {move.name for move in moves[2:]} == {"G5"}
    for places in bezier_places(moves):
        x, y = places[:, 0] / A, places[:, 1] / B
        # distance from the implicit form, to first order, in mm
        apart = np.abs(x**2 + y**2 - 1) / np.hypot(2 * x / A, 2 * y / B)
        assert apart.max() < 0.21e-3
    end = [moves[-1].words["X"], moves[-1].words["Y"]]
    assert end == pytest.approx(points[-1], abs=1e-9)
    assert all(move.words["F"] == 10.0 for move in splines)


def test_each_spline_is_one_that_linuxcnc_plays_within_a_micrometre():
    moves, _ = trace_moves(cutting(on_ellipse(ANGLES)), [track()], LINUXCNC, PERIOD, TOLERANCE)
    at, control = None, []
    for move in moves:
        words = move.words
        end = np.array([words.get("X", 0.0), words.get("Y", 0.0)])
        if move.name == "G5":
            control.append([at, at + np.array([words["I"], words["J"]]), end + np.array([words["P"], words["Q"]]), end])
        if "X" in words:
            at = end
    assert spline_deviation(np.array(control) * 1e-3).max() < 1e-6


@pytest.mark.slow
def test_cubics_with_an_inflection_stay_themselves():
    curve = {
        "degree": 3,
        "knots": [0, 0, 0, 0, 1, 2, 2, 2, 2],
        "points": [[0, 0], [10, 20], [20, -10], [30, 15], [40, 0]],
    }
    exact = Nurbs(3, curve["knots"], np.array(curve["points"]))
    points = np.array([exact.derivatives(t, 0)[0] for t in np.linspace(0, 2, 300)]).reshape(-1, 2)
    moves, count = trace_moves(cutting(points), [track(curve)], LINUXCNC, PERIOD, TOLERANCE)
    assert count >= 4
    straight = [move for move in moves[2:] if move.name == "G1"]
    assert len(straight) < 60, "only around the inflections, where LinuxCNC's arcs cannot be trusted"
    wanted = np.array([exact.derivatives(t, 0)[0] for t in np.linspace(0, 2, 20001)]).reshape(-1, 2)
    for places in bezier_places(moves, 5):
        nearest = np.linalg.norm(wanted[None] - places[:, None], axis=2).min(axis=1)
        assert nearest.max() < 2e-3, "half a step of what it is held against"


def test_points_beside_the_curve_stay_as_they_are():
    moves = cutting(on_ellipse(ANGLES) * 1.0001)
    assert trace_moves(moves, [track()], LINUXCNC, PERIOD, TOLERANCE) == (moves, 0)


def test_chords_that_cut_the_curve_short_stay_as_they_are():
    """Sixteen chords a round are up to a quarter of a millimetre off: whoever wrote them may mean them."""
    moves = cutting(on_ellipse(np.linspace(0, 2 * np.pi, 17)))
    assert trace_moves(moves, [track()], LINUXCNC, PERIOD, TOLERANCE) == (moves, 0)


def test_points_out_of_order_are_not_a_trace():
    rng = np.random.default_rng(6)
    moves = cutting(on_ellipse(rng.permutation(ANGLES[:-1])))
    assert trace_moves(moves, [track()], LINUXCNC, PERIOD, TOLERANCE) == (moves, 0)


def test_what_lies_beside_the_curve_is_kept_around_the_splines():
    before, after = Move("G1", {"X": 40.0, "Y": 0.0, "Z": -0.5, "F": 10.0}), Move("G0", {"Z": 5.0})
    given = cutting(on_ellipse(ANGLES))
    given = [*given[:2], Move("G1", {"X": 40.0, "Y": 0.0, "F": 10.0}), given[2], *given[3:], before, after]
    moves, count = trace_moves(given, [track()], LINUXCNC, PERIOD, TOLERANCE)
    assert count
    assert moves[:4] == given[:4], "out to 40 and back to the second point of the ellipse"
    assert moves[-2:] == [before, after]


@pytest.mark.parametrize("feed", [10.0, 400.0])
def test_no_spline_is_shorter_than_the_controller_has_time_for(feed):
    """It is broken into 32 moves, each at least one servo period long."""
    moves, _ = trace_moves(cutting(on_ellipse(ANGLES), feed), [track()], LINUXCNC, PERIOD, TOLERANCE)
    for places in bezier_places(moves):
        length = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
        assert length > 0.999 * 32 * PERIOD * feed


def test_a_controller_without_splines_gets_the_moves_as_they_were():
    moves = cutting(on_ellipse(ANGLES))
    assert trace_moves(moves, [track()], find_dialect("grbl"), PERIOD, TOLERANCE) == (moves, 0)


BREAKS = {
    "another feed": [Move("G1", {"X": 2.0, "F": 5.0})],
    "another height": [Move("G1", {"X": 2.0, "Z": -1.0})],
    "a fourth axis": [Move("G1", {"X": 2.0, "A": 5.0})],
    "a comment": [Move("(turn)", {}), Move("G1", {"X": 2.0})],
    "coolant": [Move("M8", {}), Move("G1", {"X": 2.0})],
    "an arc": [Move("G2", {"X": 2.0, "I": 0.5, "J": 0.0}), Move("G1", {"X": 2.5})],
}


@pytest.mark.parametrize("case", BREAKS)
def test_a_run_ends_at(case):
    head = [
        Move("G0", {"X": 0.0, "Y": 0.0, "Z": -0.5}),
        Move("G1", {"X": 0.5, "F": 10.0}),
        Move("G1", {"X": 1.0}),
    ]
    tail = [Move("G1", {"X": 3.0, "Z": -1.0 if case == "another height" else -0.5}), Move("G1", {"X": 4.0})]
    runs = find_runs([*head, *BREAKS[case], *tail])
    assert runs[0].first == 1
    assert np.allclose(runs[0].points[:, 0], [0.0, 0.5e-3, 1.0e-3])


@pytest.mark.parametrize("name", ["G54", "M6", "G92", "G81", "T2"])
def test_behind_what_may_move_the_tool_its_place_is_unknown(name):
    lines = [Move("G1", {"X": float(x), "F": 10.0}) for x in range(5)]
    runs = find_runs([Move("G0", {"X": 9.0, "Y": 0.0}), Move(name, {}), *lines])
    assert runs == []


def test_behind_a_g91_nothing_is_looked_for():
    lines = [Move("G1", {"X": float(x), "F": 10.0}) for x in range(5)]
    assert find_runs([Move("G91", {}), Move("G0", {"X": 9.0, "Y": 0.0}), *lines]) == []


def test_the_command_answers_with_the_dialects_post_processor_and_moves(tmp_path, capsys):
    moves = [[move.name, move.words] for move in cutting(on_ellipse(ANGLES))]
    broken = {"degree": 3, "knots": [0, 1], "points": [[0.0, 0.0]]}
    operations = [{"moves": moves, "curves": [broken, ELLIPSE]}, {"moves": moves}]
    job = {"format": "ph-post-freecad", "version": 1, "tolerance": 0.02, "operations": operations}
    (tmp_path / "job.json").write_text(json.dumps(job))
    assert main(["freecad", "--trace", str(tmp_path / "job.json"), "-m", "mill"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["dialect"], told["post"], told["operations"][1]) == ("linuxcnc", "linuxcnc", None)
    assert sum(name == "G5" for name, _ in told["operations"][0]) == told["splines"] > 10
    assert main(["freecad", "--trace", str(tmp_path / "job.json"), "-m", "stepper"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["post"], told["operations"], told["splines"]) == ("grbl", [None, None], 0)


NO_MOVES = JobRecord(format="ph-post-freecad", version=1, tolerance=0.02, operations=[])


@pytest.mark.parametrize(
    ("dialect", "post"),
    [("fanuc+ai+nurbs", "fanuc"), ("marlin", "marlin"), ("klipper", None)],
)
def test_the_post_processor_is_that_of_the_dialect_whatever_the_machine_has_besides(dialect, post):
    assert answer(NO_MOVES, replace(read_machine("mill"), dialect=dialect))["post"] == post


@pytest.mark.parametrize(
    ("text", "got"),
    [
        ("{", "Input data was truncated"),
        ('{"format": "ph-post-path"}', "Invalid enum value 'ph-post-path' - at `$.format`"),
        (
            '{"format": "ph-post-freecad", "version": 1, "tolerance": 1, "operations": [{"moves": [["G1", 3]]}]}',
            "Expected `object`, got `int` - at `$.operations[0].moves[0][1]`",
        ),
    ],
)
def test_no_job_is_refused_in_one_line(text, got):
    with pytest.raises(InputError) as refusal:
        read_job(SourceText(name="job.json", stem="job", text=text, digest=""))
    assert str(refusal.value) == f"job.json: not a job of FreeCAD's post-processor; got {got}"
