"""Programs of Fanuc and Heidenhain: written, run by the tests' own interpreters, and read back."""

from __future__ import annotations

import functools
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from support.languages import Reader, run_fanuc, run_klartext, run_tnc_iso
from support.measure import samples
from support.plans import make_path, make_plan
from support.shipped_curves import PATHS, dense_points, distance

from ph_post.analysis.path_analysis import analyse
from ph_post.cli.main import main
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan as plan_path
from ph_post.dialects.reading import read_as
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.gcode.program import ARC, NURBS, RAPID
from ph_post.geometry.curves import Arc, Bezier, Line
from ph_post.geometry.track import Track
from ph_post.post.options import ProgramOptions
from ph_post.post.program import Program, make_program
from ph_post.units import MM, MM_PER_MIN

RUN = {
    "fanuc": run_fanuc,
    "fanuc+ai": run_fanuc,
    "fanuc+nurbs": run_fanuc,
    "heidenhain": run_klartext,
    "heidenhain+tolerance": run_klartext,
    "heidenhain-iso": run_tnc_iso,
    "heidenhain-iso+tolerance": run_tnc_iso,
}
NAMES = sorted(file.stem for file in PATHS.glob("*.json"))
TOLERANCE = 1e-3


@functools.cache
def written(name: str, dialect: str) -> Program:
    """The plain program of a shipped path with a feed dip where it turns."""
    path = read_path(PATHS / f"{name}.json")
    found = analyse(path, read_machine("mill"), 5e-6)
    plan = plan_path(found, PlanOptions(strategy="suppress", inverse_dynamics=False, carrier="program"))
    return make_program(plan, found.track, find_dialect(dialect), ProgramOptions())


def ran(name: str, dialect: str) -> Reader:
    return RUN[dialect](written(name, dialect).text)


@pytest.mark.thinned(12)
@pytest.mark.parametrize(("name", "dialect"), list(product(NAMES, RUN)))
def test_a_control_would_go_along_the_shipped_path(name: str, dialect: str) -> None:
    program, found = written(name, dialect), ran(name, dialect)
    moves = found.run.moves[1 - program.moves :] if program.moves > 1 else found.run.moves
    curve = dense_points(name)
    points = samples(moves)[:, : curve.shape[1]]
    quantum = find_dialect(dialect).numbers.quantum / MM
    # the ends of moves are rounded by half a decimal in each coordinate, and so are the centres of arcs
    assert distance(points, curve).max() <= TOLERANCE + 2.0 * quantum + 1e-5
    # the other way round: no part of the path is left out
    thinned = curve[:: max(1, len(curve) // 4000)]
    bent = [move.center is not None or move.control is not None for move in found.run.moves]
    fine = [move.points(4000 if curved else 1) for move, curved in zip(found.run.moves, bent, strict=True)]
    reached = np.concatenate(fine)[:, : curve.shape[1]]
    assert distance(thinned, reached).max() <= 2.0 * TOLERANCE + 2.0 * quantum


@pytest.mark.thinned(12)
@pytest.mark.parametrize(("name", "dialect"), list(product(NAMES, RUN)))
def test_reading_back_gives_what_a_control_would_do(name: str, dialect: str) -> None:
    program, expected = written(name, dialect), ran(name, dialect).run.moves
    found = read_as(dialect, program.text.encode(), "a.nc", strict=True)
    motions = found.motions
    assert found.data == program.text.encode()
    assert motions.kind.size == len(expected)
    assert (
        motions.block.tolist()
        == [move.line if dialect.startswith("heidenhain") else move.line - 1 for move in expected]
        or "nurbs" in dialect
    )
    for row, move in enumerate(expected):
        known = ~np.isnan(motions.start[row])
        assert np.allclose(motions.start[row][known] / MM, move.start[known], rtol=0.0, atol=1e-9)
        known = ~np.isnan(motions.end[row])
        assert np.allclose(motions.end[row][known] / MM, move.end[known], rtol=0.0, atol=1e-9)
        assert (motions.kind[row] == RAPID) == (move.word == "rapid")
        assert (motions.kind[row] == ARC) == (move.center is not None)
        if move.center is not None:
            assert np.allclose(motions.center[row] / MM, move.center, rtol=0.0, atol=1e-9)
            assert abs(motions.angle[row] - move.angle) <= 1e-9
        if move.feed is not None:
            assert abs(motions.feed[row] / MM_PER_MIN - move.feed) <= 1e-9 * move.feed
        if move.control is not None:
            order, control, weights = motions.nurbs[row]
            assert (motions.kind[row], order, weights.tolist()) == (NURBS, 4, [1.0] * 4)
            assert np.allclose(control[:, :2] / MM, move.control, rtol=0.0, atol=1e-12)


def planar(axes: tuple[str, str]) -> Track:
    """Arcs in every quadrant, both ways, and full circles, in the plane of two axes."""

    def mm(*rows: list[float]) -> np.ndarray:
        return np.array(rows) * MM

    curves = [
        Arc(mm([10, 0])[0], mm([0, 10])[0], mm([0, 0])[0], "ccw"),
        Arc(mm([0, 10])[0], mm([-10, 0])[0], mm([0, 0])[0], "ccw"),
        Arc(mm([-10, 0])[0], mm([0, -10])[0], mm([0, 0])[0], "ccw"),
        Arc(mm([0, -10])[0], mm([0, -20])[0], mm([0, -15])[0], "cw"),
        Arc(mm([0, -20])[0], mm([-5, -25])[0], mm([0, -25])[0], "ccw"),
        Arc(mm([-5, -25])[0], mm([-5, -25])[0], mm([-8, -25])[0], "cw"),
        Line(mm([-5, -25], [-5, -40])),
    ]
    return Track(make_path(curves, axes=axes))


@pytest.mark.parametrize("axes", [("X", "Y"), ("X", "Z"), ("Y", "Z"), ("Z", "X")], ids="".join)
@pytest.mark.parametrize("dialect", ["fanuc", "heidenhain", "heidenhain-iso"])
def test_arcs_of_every_plane_and_quadrant(dialect: str, axes: tuple[str, str]) -> None:
    track = planar(axes)
    plan = make_plan(track)
    text = make_program(plan, track, find_dialect(dialect)).text
    found = RUN[dialect](text)
    back = read_as(dialect, text.encode(), "a.nc", strict=True).motions
    circles = [move for move in found.run.moves if move.center is not None]
    flat = dialect == "fanuc" or set(axes) == {"X", "Y"}
    assert bool(circles) == flat
    assert np.count_nonzero(back.kind == ARC) == len(circles)
    columns = ["XYZ".index(axis) for axis in axes]
    points = np.concatenate([move.points(16) for move in found.run.moves[-back.kind.size // 2 :]])[:, columns]
    curve = track.derivatives(*track.locate(np.linspace(0.0, track.length, 40_001)), 0)[0] / MM
    assert distance(points, curve).max() <= TOLERANCE + 2.5e-3
    for row, move in enumerate(found.run.moves):
        if move.center is not None:
            assert abs(back.angle[row] - move.angle) <= 1e-9


def test_a_cubic_comes_back_as_the_same_nurbs_to_the_last_decimal() -> None:
    control = np.array([[0, 0], [10, 40], [50, 40], [60, 0]]) * MM
    track = Track(make_path([Bezier(control)], feed=0.04))
    dialect = find_dialect("fanuc+nurbs")
    text = make_program(make_plan(track, speed=0.04, moving=True), track, dialect).text
    cubics = [move for move in run_fanuc(text).run.moves if move.control is not None]
    assert cubics
    back = read_as("fanuc", text.encode(), "a.nc", strict=True).motions
    assert (back.kind == NURBS).sum() == len(cubics)
    whole = np.concatenate([move.points(200)[:, :2] for move in cubics])
    u = np.linspace(0.0, 1.0, 40_001)[:, None]
    basis = np.hstack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3])
    # four points, each rounded by half a decimal in both coordinates
    assert distance(whole, basis @ control / MM).max() <= 0.5e-3 * np.sqrt(2.0) + 1e-6
    opening = text.index("G5.1 Q1\n"), text.index("G6.2"), text.index("G5.1 Q0\n"), text.index("\nM30")
    assert sorted(opening) == list(opening)


@pytest.mark.slow
def test_plain_programs_hold_no_word_of_an_option() -> None:
    for name in NAMES:
        assert not {"G6.2", "G5.1", "G93", "G64", "G61"} & {*written(name, "fanuc").text.split()}
        assert "CYCL DEF 32" not in written(name, "heidenhain").text
        assert "G62" not in written(name, "heidenhain-iso").text


@pytest.mark.parametrize("dialect", ["fanuc", "heidenhain", "heidenhain-iso", "heidenhain+tolerance"])
@pytest.mark.thinned(6)
def test_the_programs_of_a_calibration_kit_are_in_the_language_too(dialect: str, tmp_path: Path) -> None:
    shipped = Path(__file__).resolve().parents[2] / "samples" / "machines" / "mill.toml"
    machine = tmp_path / "mill.toml"
    machine.write_text(re.sub(r'dialect = ".*"', f'dialect = "{dialect}"', shipped.read_text()))
    assert main(["calibrate", "-m", str(machine), "-o", str(tmp_path / "kit")]) == 0
    programs = sorted((tmp_path / "kit").glob(f"*{find_dialect(dialect).ending}"))
    assert programs
    for file in programs:
        text = file.read_text()
        found = RUN[dialect](text)
        back = read_as(dialect, text.encode(), file.name, strict=True).motions
        known = ~np.isnan(back.end[-1])
        assert np.allclose(back.end[-1][known] / MM, found.at[known], rtol=0.0, atol=1e-9)
        assert len(found.run.moves) == back.kind.size
        assert found.dwells


def test_a_conversational_program_without_its_dialect_is_told_what_to_say(capsys, tmp_path: Path) -> None:
    file = tmp_path / "a.h"
    file.write_text("0 BEGIN PGM A MM\n1 L X+1 Y+2 F100\n2 END PGM A MM\n")
    assert main(["inspect", str(file)]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == (
        f"ph-post: {file}:1: a conversational program of Heidenhain, read by other words;"
        " expected --dialect heidenhain, or a machine file with that dialect"
    )


def test_a_program_in_another_language_is_not_rehearsed_on_linuxcnc(capsys, tmp_path: Path) -> None:
    shipped = Path(__file__).resolve().parents[2] / "samples" / "machines" / "mill.toml"
    machine = tmp_path / "mill.toml"
    machine.write_text(re.sub(r'dialect = ".*"', 'dialect = "fanuc"', shipped.read_text()))
    (tmp_path / "a.nc").write_text("%\nO1\nG21\nG4 P5000\nM30\n%\n")
    assert main(["rehearse", str(tmp_path / "a.nc"), "-m", str(machine)]) == 2
    assert "not in those of another controller; expected a machine file for LinuxCNC" in capsys.readouterr().err


@pytest.mark.slow
def test_what_the_decimals_cannot_hold_is_refused_and_left_out_by_auto(capsys, tmp_path: Path) -> None:
    # jogs of 2.5 µm, which the increment system IS-B of 1 µm would round by a fifth
    out = str(tmp_path / "a.nc")
    asked = ["convert", "oval", "-m", "mill", "--dialect", "fanuc", "--effort", "0.02", "-o", out]
    assert main([*asked, "--strategy", "takeup"]) == 2
    assert "the decimals of fanuc are too few for an offset of axis" in capsys.readouterr().err
    assert main(asked) == 0
    curve = dense_points("oval")
    points = samples(run_fanuc((tmp_path / "a.nc").read_text()).run.moves[2:])[:, : curve.shape[1]]
    quantum = find_dialect("fanuc").numbers.quantum / MM
    assert distance(points, curve).max() <= TOLERANCE + 2.0 * quantum + 1e-5
