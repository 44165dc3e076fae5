"""Part programs in place of path files: inspect, simulate, compare and sweep read their paths."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest
from support.front_door import run

from ph_post.files.storage import SourceBytes, is_program

SLOT = """%
(a slot, 20 mm wide)
G21 G90 G17 G94
G0 X0 Y0
G1 X40 F1000
G3 X40 Y20 I0 J10
G1 X0
G3 X0 Y0 I0 J-10
M2
%
"""
"""Begins and ends at rest; its bounding box is 60 by 20."""


@pytest.fixture
def slot(tmp_path: Path) -> str:
    file = tmp_path / "slot.ngc"
    file.write_text(SLOT)
    return str(file)


def test_inspect_finds_the_reversals_of_a_program(capsys, slot):
    status, out, err = run(capsys, "inspect", slot, "-m", "router", "--json")
    assert (status, err) == (0, "")
    points = json.loads(out)["turning_points"]
    assert [(p["axis"], p["sense"], p["position"]) for p in points] == [
        ("X", "max", pytest.approx(50.0)),
        ("Y", "max", pytest.approx(20.0)),
        ("X", "min", pytest.approx(-10.0)),
    ]
    assert [p["kind"] for p in points] == ["smooth", "dwell", "smooth"]
    lines = [SLOT.splitlines()[p["line"] - 1] for p in points]
    assert [line.split()[0] for line in lines] == ["G3", "G1", "G3"]
    table = run(capsys, "inspect", slot)[1].splitlines()
    assert [row.split()[4] for row in table[1:5]] == ["line", *(str(p["line"]) for p in points)]
    assert points[0]["radius"] == pytest.approx(10.0)
    assert points[0]["backlash"]["duration"] > 0.0


def test_certify_counts_the_reversals_of_a_program(capsys, slot):
    status, out, _ = run(capsys, "inspect", slot, "--certify", "--json")
    assert status == 0
    assert json.loads(out)["certificate"]["ok"] is True


def test_a_program_comes_from_standard_input(capsys, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(SLOT.encode())))
    status, out, _ = run(capsys, "inspect", "-", "--json")
    assert (status, len(json.loads(out)["turning_points"])) == (0, 3)


def test_simulate_runs_a_program(capsys, slot):
    status, out, _ = run(capsys, "simulate", slot, "-m", "router", "--strategy", "none", "--json")
    assert status == 0
    # half the lost motion at least, on the flank that the file leaves open
    assert json.loads(out)["error"]["max"] > 0.02


def test_sweep_takes_the_circles_of_a_program(capsys, slot):
    grids = ("--beta", "2", "--gain", "2e7")
    status, out, _ = run(capsys, "sweep", slot, "-m", "mill", *grids, "--json")
    assert status == 0
    assert {round(one["radius"], 9) for one in json.loads(out)["tables"]} == {10.0}


def test_what_the_path_does_not_show_is_said(capsys, tmp_path):
    file = tmp_path / "two.nc"
    file.write_text("G21\nG0 X0 Y0\nG1 X9 F100\nG28\nG0 X0 Y0\nG1 Y30 X1\nM2\n")
    status, _, err = run(capsys, "inspect", str(file))
    assert status == 0
    assert "line 3: a path of its own, 9 mm, which is not shown" in err


def test_a_program_without_a_path_is_refused_in_a_line(capsys, tmp_path):
    file = tmp_path / "empty.tap"
    file.write_text("G21\nG0 X0 Y0\nM2\n")
    status, out, err = run(capsys, "inspect", str(file))
    assert (status, out) == (2, "")
    assert "empty.tap: no path; expected motions G1, G2, G3 or G5 with a feed" in err


@pytest.mark.parametrize(
    ("name", "data", "program"),
    [
        ("part.NGC", b"", True),
        ("part.gcode", b"{}", True),
        ("part.json", b"G1 X1", False),
        ("stdin", b'  {"format": 1}', False),
        ("stdin", b"%\nG1", True),
        ("stdin", b"\xef\xbb\xbfN10 G1 X5", True),
        ("part", b"; made by hand", True),
        ("part", b"# made by hand", True),
        ("stdin", b"$H\nG1 X5", True),
        ("part.gco", b"", True),
        ("stdin", b"nonsense", False),
        ("stdin", b"[1, 2]", False),
        ("stdin", b"", False),
    ],
)
def test_how_a_program_is_told_from_a_path_file(name, data, program):
    assert is_program(SourceBytes(name=name, stem="part", data=data)) is program
