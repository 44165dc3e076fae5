"""Corner tolerances that cannot be, and the exact line with which each is refused."""

from __future__ import annotations

import pytest
from support.streams import without_progress

import ph_post as ph
from ph_post.cli.main import main
from ph_post.errors import InputError

SEE = "; see ph-post convert --help"
RANGE = "--corner-tolerance: out of range; expected a finite number >= 0.0001; got "
CASES = {
    "negative": (("-0.02",), RANGE + "-0.02"),
    "nothing": (("0",), RANGE + "0"),
    "too small": (("0.00009",), RANGE + "0.00009"),
    "no number": (("wide",), RANGE + "wide"),
    "nan": (("nan",), RANGE + "nan"),
    "feeds only": (
        ("0.02", "--feed-only"),
        "--corner-tolerance changes the path, and --feed-only leaves it as it is; leave one out",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_corner_tolerance_that_cannot_be_is_refused_in_one_line(name, capsys, tmp_path):
    options, line = CASES[name]
    out = tmp_path / "out.ngc"
    assert main(["convert", "pocket", "-m", "router", "-o", str(out), "--corner-tolerance", *options]) == 2
    see = "" if line.startswith(RANGE) else SEE
    assert without_progress(capsys.readouterr().err) == f"ph-post: {line}{see}\n"
    assert not out.exists()


def test_a_part_program_keeps_its_corners(capsys, tmp_path):
    part, out = tmp_path / "part.ngc", tmp_path / "out.ngc"
    part.write_text("G21 G90\nG1 X10 F600\nY10\nM2\n")
    assert main(["convert", str(part), "-m", "router", "-o", str(out), "--corner-tolerance", "0.02"]) == 2
    line = "--corner-tolerance is for path files; a part program keeps its own"
    assert without_progress(capsys.readouterr().err) == f"ph-post: {line}{SEE}\n"
    assert not out.exists()


@pytest.mark.parametrize("tolerance", [-1e-5, 0.0, float("nan"), float("inf"), 1e-8])
def test_python_refuses_them_too(tolerance):
    with pytest.raises(InputError, match="--corner-tolerance: out of range; expected a finite number >= 1e-07"):
        ph.compensate("pocket", "router", corner_tolerance=tolerance)


def test_a_tolerance_that_no_side_has_room_for_takes_what_there_is(capsys, tmp_path):
    out = tmp_path / "out.ngc"
    options = ("--strategy", "none", "--no-simulation", "--corner-tolerance", "1000")
    assert main(["convert", "pocket", "-m", "router", "-o", str(out), *options]) == 0
    said = capsys.readouterr().err
    assert "warning: 3 corners are rounded, within 6689 µm" in said
    assert "3 corners rounded by less than asked for, 1055 µm at least: its sides are short (at X80 Y0, " in said
