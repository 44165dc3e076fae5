"""LinuxCNC's own rendering of cubics, by its formulas in exact enough arithmetic, and its own interpreter."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from support.interpreter import run
from support.plans import make_path, make_plan

from ph_post.dialects.linuxcnc import DIALECT, spline_deviation
from ph_post.geometry.curves import Arc, Bezier, Line
from ph_post.geometry.ph import PH
from ph_post.geometry.track import Track
from ph_post.post.options import ProgramOptions
from ph_post.post.program import make_program
from ph_post.units import MM

RS274 = shutil.which("rs274")

CUBICS = {
    "bow": [[0, 0], [1, 2], [3, 2], [4, 0]],
    "hook": [[0, 0], [0.5, 3], [2, 3.5], [6, 3]],
    "flat": [[0, 0], [10, 0.3], [20, 0.35], [30, 0]],
}


def _point(c: list, u: mp.mpf) -> mp.matrix:
    weights = [(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3]
    return mp.matrix([mp.fdot(weights, [point[i] for point in c]) for i in (0, 1)])


def _direction(c: list, u: mp.mpf) -> mp.matrix:
    d = [[c[k + 1][i] - c[k][i] for i in (0, 1)] for k in range(3)]
    v = mp.matrix([(1 - u) ** 2 * d[0][i] + 2 * u * (1 - u) * d[1][i] + u**2 * d[2][i] for i in (0, 1)])
    return v / mp.norm(v)


def _circle_distance(q: mp.matrix, start: mp.matrix, tangent: mp.matrix, end: mp.matrix) -> mp.mpf:
    """As ``arc`` of LinuxCNC's emccanon.cc finds its centre."""
    x, y = end[0] - start[0], end[1] - start[1]
    r = -(x * x + y * y) / (2 * (y * tangent[0] - x * tangent[1]))
    center = start + mp.matrix([tangent[1] * r, -tangent[0] * r])
    return abs(mp.norm(q - center) - abs(r))


def reference_deviation(c: list, probes: int = 40) -> mp.mpf:
    """Largest distance of the cubic from the 32 arcs of ``biarc`` in LinuxCNC's emccanon.cc."""
    worst = mp.mpf(0)
    for span in range(16):
        a, b = mp.mpf(span) / 16, mp.mpf(span + 1) / 16
        p0, p4, ts, te = _point(c, a), _point(c, b), _direction(c, a), _direction(c, b)
        v = p0 - p4
        cc = mp.norm(v) ** 2
        bb = 2 * mp.fdot(v, ts + te)
        aa = 2 * (mp.fdot(ts, te) - 1)
        root = mp.sqrt(bb * bb - 4 * aa * cc)
        beta = max((-bb - root) / 2 / aa, (-bb + root) / 2 / aa)
        p1, p3 = p0 + beta * ts, p4 - beta * te
        p2 = (p1 + p3) / 2
        tm = (p3 - p2) / mp.norm(p3 - p2)
        for k in range(1, probes):
            q = _point(c, a + (b - a) * k / probes)
            before = mp.fdot(q - p2, tm) < 0
            distance = _circle_distance(q, p0, ts, p2) if before else _circle_distance(q, p2, tm, p4)
            worst = max(worst, distance)
    return worst


@pytest.mark.parametrize("name", list(CUBICS))
def test_deviation_of_a_g5_is_that_of_linuxcnc_s_arcs(name: str) -> None:
    with mp.workdps(40):
        expected = float(reference_deviation(CUBICS[name]))
    found = float(spline_deviation(np.array([CUBICS[name]], dtype=float))[0])
    # seven probes a span instead of 39: they may miss the largest of them by a part of it
    assert 0.9 * expected <= found <= expected * (1 + 1e-6)


@pytest.mark.parametrize(
    "control",
    [
        [[0, 0], [1, 0], [2, 0], [3, 0]],  # straight: LinuxCNC would divide zero by zero
        [[0, 0], [1, 1e-9], [2, 1e-9], [3, 0]],  # nearly so
        [[0, 0], [1, 1], [2, -1], [3, 0]],  # an inflection: somewhere the tangent does not turn
        [[0, 0], [1, 1], [0, 1], [1, 0]],  # a cusp
        [[0, 0], [0, 0], [2, 1], [3, 0]],  # no tangent at the start
    ],
)
def test_cubics_that_linuxcnc_cannot_be_trusted_with(control: list) -> None:
    assert spline_deviation(np.array([control], dtype=float))[0] == np.inf


X_INFLECTION = 32.5390964748205
"""[mm], where x'y'' = y'x'' on the curve below."""


def test_g5_only_where_it_holds_the_tolerance() -> None:
    curve = Bezier(np.array([[0, 0], [20, 30], [45, -30], [60, 0]]) * MM)  # with an inflection inside
    track = Track(make_path([curve], feed=0.02))
    for tolerance, least, word in ((1e-6, 2, "G5"), (1e-8, 6, "G1")):
        program = make_program(make_plan(track), track, DIALECT, ProgramOptions(chord_tolerance=tolerance))
        moves = run(program.text).moves[-program.moves :]
        splines = [move for move in moves if move.word == "G5"]
        assert len(splines) >= least
        control = np.array([move.control for move in splines])
        assert spline_deviation(control).max() <= tolerance / MM * (1 + 1e-3)
        assert min(move.duration for move in splines) >= 32 * 1e-3 * (1 - 1e-6)
        # where it turns too little for the tolerance it is as good as straight, and chords
        inflection = next(move for move in moves if move.start[0] <= X_INFLECTION <= move.end[0])
        assert inflection.word == word


needs_rs274 = pytest.mark.skipif(RS274 is None, reason="LinuxCNC's interpreter rs274 is not installed")


def canonical(text: str, folder: Path) -> str:
    """What LinuxCNC's interpreter makes of a program."""
    program = folder / "program.ngc"
    program.write_text(text)
    # a parameter file of its own: rs274 keeps one in the working directory
    done = subprocess.run(
        [str(RS274), "-v", str(folder / "rs274.var"), "-g", str(program)],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr[-500:] + done.stdout[-500:]
    return done.stdout


@needs_rs274
@pytest.mark.parametrize("mode", ["per-minute", "inverse-time"])
def test_linuxcnc_s_interpreter_takes_the_programs(mode: str, tmp_path: Path) -> None:
    arc = Arc(start=np.array([0.02, 0]), end=np.array([0.02, 0]), center=np.zeros(2), turn="cw")
    cubic = Bezier(np.array([[0, 0], [10, 40], [50, 40], [60, 0]]) * MM)
    spatial = PH([0, 0, 0], np.array([[4, 1, 0, 1], [2, 3, 1, 0], [3, 0, 2, 2]]) * MM**0.5)
    lines = [Line(np.array([[0, 0], [30, 0]]) * MM), Line(np.array([[30, 0], [30, 20]]) * MM)]
    for curves, how in (
        ([arc], {"safe_z": 5 * MM, "depth": -MM}),
        ([cubic], {}),
        ([spatial], {"safe_z": 0.2}),
        (lines, {}),
    ):
        track = Track(make_path(curves))
        plan = make_plan(track, dips=[(track.length / 3, -1.0, 0.1)])
        program = make_program(plan, track, DIALECT, ProgramOptions(feed_mode=mode, **how))
        calls = canonical(program.text, tmp_path)
        own = run(program.text).moves
        counts = {word: sum(move.word == word for move in own) for word in ("G0", "G1", "G5")}
        assert len(re.findall("STRAIGHT_TRAVERSE", calls)) == counts["G0"]
        assert len(re.findall("STRAIGHT_FEED", calls)) == counts["G1"]
        assert len(re.findall("NURBS_FEED", calls)) == counts["G5"]
        assert len(re.findall("ARC_FEED", calls)) == sum(move.word in ("G2", "G3") for move in own)


@needs_rs274
@pytest.mark.parametrize("mode", ["per-minute", "inverse-time"])
def test_linuxcnc_s_own_feeds_give_the_planned_time(mode: str, tmp_path: Path) -> None:
    track = Track(make_path([Line(np.array([[0, 0], [30, 10]]) * MM)]))
    plan = make_plan(track, dips=[(track.length / 2, 0.2, 0.1)], moving=True)
    program = make_program(plan, track, DIALECT, ProgramOptions(feed_mode=mode))
    calls = re.findall(r"(SET_FEED_RATE|STRAIGHT_\w+)\(([^)]*)\)", canonical(program.text, tmp_path))
    feed, at, times = 0.0, np.zeros(2), []
    for name, arguments in calls:
        values = np.array([float(value) for value in arguments.split(",")])
        if name == "SET_FEED_RATE":
            feed = values[0]
            continue
        if name == "STRAIGHT_FEED":
            times.append(60.0 * np.linalg.norm(values[:2] - at) / feed)
        at = values[:2]
    assert len(times) == program.moves + 1
    # end points come with 4 decimals: 1e-4 mm in blocks of 20 µm and more
    assert sum(times[1:]) == pytest.approx(sum(phase.duration for phase in plan.phases), rel=1e-3)
