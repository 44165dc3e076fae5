"""`calibrate --without-log` and `machine measure`: sheet, readings from a file, options and questions, the file."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from support.front_door import answered, run
from support.hand_machine import HandMachine

import ph_post as ph

MEASURE = ("machine", "measure")
SEE = "; see ph-post calibrate --help\n"
ROWS = ("--dial", "X 0 0.501 0.031 0.001 0.030", "--dial", "X 0 0.499 0.033 -0.001 0.031")


def test_from_the_kit_to_a_machine_file(capsys, tmp_path):
    """As a person does it: programs, stops, numbers into the file, the machine file."""
    kit = tmp_path / "kit"
    status, out, err = run(capsys, "calibrate", "-m", "stepper", "--without-log", "-o", str(kit))
    assert status == 0
    assert [line.split(":")[0] for line in out.splitlines()] == [str(kit / f"dial_{axis}.ngc") for axis in "xy"]
    assert err == f"wrote 2 programs and {kit / 'sheet.md'}: read that first\n"
    machine, random = HandMachine(play={"X": 0.07, "Y": 0.12}), np.random.default_rng(5)
    text = (kit / "readings.toml").read_text()
    for axis in "XY":
        for row in machine.dial((kit / f"dial_{axis.lower()}.ngc").read_text(), axis, 0.005, random, 0.001):
            text = text.replace("readings = []", f"readings = {row}", 1)
    assert "[]" not in text
    (kit / "readings.toml").write_text(text)
    line = next(line for line in (kit / "sheet.md").read_text().splitlines() if line.startswith("ph-post machine"))
    assert line == f"ph-post machine measure {kit}/readings.toml -m stepper -o measured_stepper.toml"
    measured = tmp_path / "measured.toml"
    status, out, err = run(capsys, *MEASURE, str(kit / "readings.toml"), "-m", "stepper", "-o", str(measured))
    assert (status, err) == (0, f"wrote {measured}\n")
    assert out.startswith("X: lost motion 0.0")
    axes = ph.read_machine(measured).axes
    assert axes["X"].gap.lost_motion == pytest.approx(70e-6, abs=6e-6)
    assert axes["Y"].gap.lost_motion == pytest.approx(120e-6, abs=6e-6)
    assert axes["X"].uncertainty.backlash < 0.1
    assert axes["Z"] == ph.read_machine("stepper").axes["Z"]
    assert "measured by dial indicator" in measured.read_text()


def test_options_take_rows_and_json_says_what_was_found(capsys):
    status, out, _ = run(capsys, *MEASURE, "-m", "router", *ROWS, "--json")
    assert status == 0
    view = json.loads(out)
    assert list(view["axes"]) == ["X"]
    assert view["axes"]["X"]["lost_motion"]["value"] == pytest.approx(0.0315, abs=1e-3)
    assert view["axes"]["X"]["written"] == pytest.approx(view["axes"]["X"]["lost_motion"]["value"], abs=1e-4)
    assert (view["file"], view["squareness"], view["ball_bar"]) == (None, {}, [])


def test_an_inch_dial_is_an_inch_dial(capsys):
    rows = ("--dial", "x 0 0.0197 0.0012 0.0001 0.0013", "--dial", "x 0 0.0197 0.0013 0 0.0012")
    status, out, _ = run(capsys, *MEASURE, "-m", "router", *rows, "--unit", "inch", "--json")
    assert status == 0
    assert json.loads(out)["axes"]["X"]["lost_motion"]["value"] == pytest.approx(0.0312, abs=2e-3)


def test_scales_that_no_screw_has_are_warned_of(capsys):
    widths = {"x": 0.17, "y": 0.0}
    cut = [
        f"{shape}.{name} {base + wide:.2f} {base + wide + 0.01:.2f}"
        for shape, base in (("square_inside", 29.95), ("square_outside", 30.05))
        for name, wide in widths.items()
    ]
    given = [word for one in cut for word in ("--cut", one)]
    status, out, err = run(capsys, *MEASURE, "-m", "router", *given, "--size", "30", "--tool", "6", "--json")
    assert status == 0
    (warning,) = json.loads(out)["warnings"]
    assert warning.startswith("the scales of X and Y differ by +4.7")
    assert f"warning: {warning}" in err


def test_readings_are_asked_for_where_none_are_given(capsys, monkeypatch):
    answered(monkeypatch, "0 0.501 0.031 0.001 0.030", "0, 0.499, 0.033, -0.001, 0.031", "", "", "", "")
    status, out, _ = run(capsys, *MEASURE, "-m", "router", "-o", "-")
    assert status == 0
    assert tomllib.loads(out)["axes"]["X"]["lost_motion_mm"] == pytest.approx(0.0312, abs=1e-3)


def test_widths_are_asked_for_behind_the_rows(capsys, monkeypatch):
    widths = ["29.97 29.98", "29.99 30.0", "29.93 29.95", "30.05 30.04", "29.98 29.97", "30.04 30.05", "29.94 29.94"]
    widths += ["29.99 30.01", "29.98 29.97", "29.94 29.93", "30.06 30.07", "30.10 30.1", ""]
    answered(monkeypatch, "", "", "", "30 6", *widths)
    status, out, _ = run(capsys, *MEASURE, "-m", "stepper")
    assert status == 0
    assert "X: lost motion 0.0462" in out
    assert "scale of X less that of Y" in out  # without the groove the cutter's own diameter is not known
    assert "scale of X:" not in out


def test_the_end_of_the_input_is_told(capsys, monkeypatch):
    answered(monkeypatch, "0 0.501 0.031 0.001 0.030")
    status, _, err = run(capsys, *MEASURE, "-m", "router")
    assert status == 2
    assert err.startswith("ph-post: standard input, X, row 2: no answer")


def test_an_axis_with_a_scale_is_refused_and_says_what_helps(capsys):
    status, _, err = run(capsys, *MEASURE, "-m", "mill", *ROWS)
    assert status == 2
    assert "a dial does not show the backlash of X: its scale on the table hides it" in err


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--dial", "X 0 b 0.03"), "--dial: no reading; expected numbers, apart by blanks; got 'b'"),
        (("--dial", "A 0 0.5 0.03"), "--dial A: the machine has no such axis; expected X or Y or Z; got A"),
        (
            ("--cut", "circle.d45 29", "--size", "30", "--tool", "6"),
            "--cut: no such width; expected circle_cw.d45; got 'circle.d45'",
        ),
        (("--cut", "circle_cw.d45 29"), "--cut, --size and --tool go together; see ph-post machine measure --help"),
        (
            ("readings.toml", "--unit", "um"),
            "READINGS says that itself; got --unit beside it; see ph-post machine measure --help",
        ),
        (("none.toml",), "none.toml: no such file"),
    ],
)
def test_bad_options_are_one_line(capsys, tmp_path, monkeypatch, words, expected):
    monkeypatch.chdir(tmp_path)
    assert run(capsys, *MEASURE, "-m", "router", *words) == (2, "", f"ph-post: {expected}\n")


def test_a_file_that_is_there_is_kept(capsys, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("mine\n")
    status, _, err = run(capsys, *MEASURE, "-m", "router", *ROWS, "-o", str(file))
    assert status == 2
    assert err == f"ph-post: {file}: is there already; expected --force, or another name\n"
    assert file.read_text() == "mine\n"
    assert run(capsys, *MEASURE, "-m", "router", *ROWS, "-o", str(file), "--force")[0] == 0


def test_a_person_s_own_file_keeps_its_words(capsys, tmp_path):
    file = tmp_path / "mine.toml"
    original = Path(ph.__file__).parent.parent / "samples" / "machines" / "router.toml"
    file.write_text(original.read_text())
    status, _, _ = run(capsys, *MEASURE, "-m", str(file), *ROWS, "-o", str(file), "--force")
    assert status == 0
    before, after = original.read_text().splitlines(), file.read_text().splitlines()
    assert len([line for line in before if line not in after]) == 1
    # Read at one place alone: what the person wrote about the rest of the screw stays.
    assert any(line.startswith("backlash_uncertainty = 0.3 ") for line in after)


def test_options_of_one_way_are_refused_by_the_other(capsys, tmp_path):
    kit = ("calibrate", "-m", "router", "-o", str(tmp_path / "kit"))
    assert run(capsys, *kit, "--tool", "6") == (2, "", f"ph-post: --tool needs --without-log{SEE}")
    told = "ph-post: --radius and --warm-up are for programs with a log; got --without-log" + SEE
    assert run(capsys, *kit, "--without-log", "--radius", "20") == (2, "", told)


def test_readings_that_are_all_the_same_are_as_sure_as_their_last_digit(capsys):
    rows = ("--dial", "X 0 0.50 0.03 0 0.03", "--dial", "X 0 0.50 0.03 0 0.03")
    view = json.loads(run(capsys, *MEASURE, "-m", "router", *rows, "--json")[1])
    assert view["axes"]["X"]["lost_motion"] == {"value": 0.03, "stderr": pytest.approx(0.01 / 12**0.5, rel=1e-3)}
    none = ("--dial", "X 0 0.50 0 0 0", "--dial", "X 0 0.50 0 0 0")
    status, out, _ = run(capsys, *MEASURE, "-m", "router", *none)
    assert status == 0
    assert "no lost motion that these readings show: 0 in the machine file" in out


def test_a_coarse_dial_is_to_be_read_more_often(capsys):
    coarse = ("--dial", "X 0 0.52 0.03 0.04 0.06", "--dial", "X 0 0.48 0.05 -0.03 0.02")
    status, out, _ = run(capsys, *MEASURE, "-m", "router", *coarse)
    assert status == 0
    asked = next(line for line in out.splitlines() if "90 of 100" in line)
    assert asked.startswith("   for a lost motion within 10 µm in 90 of 100 cases read each place ")
    status, out, _ = run(capsys, *MEASURE, "-m", "router", *ROWS)
    assert "90 of 100" not in out


def test_how_readings_scatter_names_no_single_one(capsys):
    # Twice two readings that are 1 µm apart: a standard error of 1 µm by the root of two.
    status, said, _ = run(capsys, *MEASURE, "-m", "stepper", "--dial", "X 0 0.501 0.031 0.001 0.030")
    assert status == 0
    assert "readings scatter by 0.71 µm, the standard error of each" in said
    assert "one reading is off" not in said
