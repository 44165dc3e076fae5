"""``ph-post diff``: what differs between programs whose differences are known."""

import json
import math
import re
from pathlib import Path

import pytest
from support.corpus import compensated, entries, stepper
from support.front_door import run
from support.streams import without_progress

from ph_post.cli.main import main
from ph_post.dialects.registry import find_dialect
from ph_post.diff.compare import compare_programs
from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import read_program

PART = """%
(part)
G21 G90 G17 G94 G64 P0.01
M3 S1000
G0 X0 Y0 Z5
G1 Z-1 F100
G1 X10 F600
G3 X20 Y10 I0 J10
G1 X20 Y20
G4 P0.5
M8
G2 X10 Y30 R10
G1 X0
G1 Y0
M5
G0 Z5
M2
%
"""


def compared(old, new, text=PART, **how):
    """Compare a program with itself after one replacement."""
    assert old in text
    a, b = (read_program(one.encode(), name) for one, name in ((text, "a"), (text.replace(old, new), "b")))
    return compare_programs(a, b, **how)


def kinds(found):
    return [(one.kind, one.a, one.b) for one in found.blocks]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("(part)", "(another part) ; and more"),
        ("G1 X10 F600", "N40 g1   x10.000 f600."),
        ("G1 X20 Y20", "Y20 X20 G1"),
        ("\n", "\r\n"),
        ("G2 X10 Y30 R10", "G2 X10 Y30 J10"),
        ("G1 X0\n", "G1 X5\n\nX0\n"),
        ("G1 X10 F600\n", "G1 X10 F600\nS1000\nM3\n"),
        ("G1 X20 Y20\n", "G91 G1 X0 Y10\nG90\n"),
        ("G1 X0\n", "G20 G1 X0\nG21\n"),
    ],
)
def test_other_words_for_the_same_motion_are_no_difference(old, new):
    found = compared(old, new)
    assert found.same
    assert not found.identical
    assert found.max_deviation == pytest.approx(0.0, abs=1e-12)


def test_identical_programs():
    found = compared("M5", "M5")
    assert found.same
    assert found.identical
    assert found.blocks == ()


def test_a_moved_point_tells_block_stretch_and_amount():
    found = compared("G1 X20 Y20", "G1 X20 Y20.5")
    assert not found.same
    assert kinds(found) == [("changed", (8, 8), (8, 8))]
    assert found.max_deviation == pytest.approx(0.5e-3, rel=1e-9)
    (stretch,) = found.deviations
    assert stretch.block == 8
    assert stretch.where == pytest.approx((0.020, 0.0205, -0.001))
    # The line goes on to where the old one ended; from there on the paths are apart.
    before = 6e-3 + 10e-3 + 0.5 * 3.141592653589793 * 10e-3
    assert stretch.s_a[0] == pytest.approx(before + 10e-3, abs=5e-5)
    assert found.feeds == ()


def test_another_feed_is_told_with_its_ratio_as_far_as_it_lasts():
    found = compared("G1 X20 Y20", "G1 X20 Y20 F300")
    assert found.deviations == ()
    (change,) = found.feeds
    assert change.ratio == (0.5, 0.5)
    assert change.feed_a == pytest.approx((0.01, 0.01))
    # From that block to the last one that cuts.
    assert change.a == (8, 13)
    cut = 10.0 + 0.5 * 3.141592653589793 * 10.0 + 10.0 + 30.0
    (time,) = found.times
    assert time.time_b - time.time_a == pytest.approx(cut / 5.0 - cut / 10.0)
    assert found.timing[1].total - found.timing[0].total == pytest.approx(cut / 5.0 - cut / 10.0)


def test_a_dwell_counts_as_time():
    found = compared("G4 P0.5", "G4 P0.75")
    (time,) = found.times
    assert time.time_b - time.time_a == pytest.approx(0.25)
    assert not found.same


def test_inverse_time_tells_the_same_feed():
    text = "G21 G90 G17 G94\nG0 X0 Y0 Z0\nG1 X10 F600\nM2\n"
    found = compared("G1 X10 F600\n", "G93\nG1 X10 F60\nG94\n", text)
    assert found.feeds == ()
    assert found.times == ()
    assert found.same


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("M8\n", "", "flood on"),
        ("M3 S1000", "M4 S1000", "spindle M3"),
        ("S1000", "S1200", "spindle speed 1000"),
        ("G64 P0.01", "G61", "path mode G64 P0.01"),
        ("M5\n", "", "spindle M5"),
        ("(part)", "G55", "work offset G55"),
        ("M8\n", "M8\nM1\n", "M1"),
        ("M5\n", "M5\nT2 M6\n", "T2M6"),
    ],
)
def test_what_is_done_beside_moving_is_compared(old, new, what):
    found = compared(old, new)
    assert what in [one.what for one in found.orders]
    assert not found.same


def test_an_order_at_another_place_is_a_difference():
    moved = PART.replace("M8\n", "").replace("G1 Y0\n", "M8\nG1 Y0\n")
    found = compare_programs(*(read_program(one.encode(), "p") for one in (PART, moved)))
    assert [one.what for one in found.orders] == ["flood on, at another place"]
    assert (found.orders[0].a, found.orders[0].b) == (10, 12)


def test_what_is_not_understood_is_compared_as_text():
    text = "G21 G90 G17 G94\nG0 X0 Y0 Z0\n#1=5\nG1 X#1 F100\nM2\n"
    found = compared("#1=5", "#1=6", text)
    assert not found.same
    assert any("not understood" in one.what for one in found.orders)
    assert compared("#1=5", "#1 = 5 (five)", text).same


def test_a_detour_far_along_the_path_is_found_where_it_is():
    """A long zigzag in which one line goes to a wrong neighbour and back."""
    rows = [f"G1 X{100 * (k % 2)} Y{k // 2 + k % 2}" for k in range(1, 400)]
    text = "\n".join(["G21 G90 G17 G94", "G0 X0 Y0 Z0", "F600", *rows, "M2", ""])
    wrong = rows[200] + "\nG1 Y90\n" + rows[200]
    found = compared(rows[200] + "\n", wrong + "\n", text)
    assert found.max_deviation == pytest.approx(0.011, rel=0.02)
    assert len(found.deviations) == 1


def test_a_tolerance_forgives_what_is_nearer():
    assert compared("G1 X20 Y20", "G1 X20 Y20.0004", tolerance=1e-6).deviations == ()
    assert compared("G1 X20 Y20", "G1 X20 Y20.0004").max_deviation == pytest.approx(4e-7, rel=1e-6)


def test_a_machine_tells_how_long_and_how_far_off():
    """A stepper machine is off by half its play on each axis: at most by 0.03 mm in X and 0.04 mm in Y.

    Both at once are seen where the cut begins, which is 0.02 mm behind the rapid.
    """
    text = "G21 G90 G17 G94 G61\nG0 X0 Y0 Z0\nG1 X30 F600\nG3 X30 Y10 J5\nG1 X0\nG1 Y0\nM2\n"
    found = compared("F600", "F300", text, machine=read_machine("stepper"))
    a, b = found.timing
    assert a.model == b.model == "controller"
    # 70 mm and half a circle of 5 mm radius, and some ramps.
    cut = 70.0 + 5.0 * math.pi
    assert cut / 10.0 < a.total < cut / 10.0 + 1.0
    assert cut / 5.0 < b.total < cut / 5.0 + 1.0
    expected = math.hypot(0.04e-3, 0.01e-3)
    assert [error.max for error in found.predicted.errors] == pytest.approx([expected] * 2, rel=0.003)
    assert compared("F600", "F300", text).predicted is None


def test_what_is_declared_is_said_and_taken_off():
    data = PART.encode()
    program = read_program(data, "part")
    output = read_program(compensated(program, stepper(), find_dialect("linuxcnc")), "part")
    found = compare_programs(program, output)
    assert not found.same
    assert found.undone == 0.0
    assert found.declared[0] == ()
    assert "X is commanded 0.025 mm ahead in the direction it moves" in found.declared[1]
    # Three axes carry 0.025 mm each, and an axis is seated from three halves of its gap before its place.
    assert 0.025e-3 <= found.max_deviation <= 0.2e-3


def test_what_was_edited_before_it_was_compensated_is_told_apart():
    program = read_program(PART.replace("G1 X20 Y20", "G1 X20 Y20.5").encode(), "edited")
    output = read_program(compensated(program, stepper(), find_dialect("linuxcnc")), "part")
    found = compare_programs(read_program(PART.encode(), "part"), output)
    assert found.undone == pytest.approx(0.5e-3, rel=1e-6)


def test_a_declaration_that_cannot_be_taken_off_is_said():
    program = read_program(PART.encode(), "part")
    output = compensated(program, stepper(), find_dialect("linuxcnc")).replace(b"M8", b"M7")
    found = compare_programs(program, read_program(output, "part"))
    assert any("cannot be undone" in words for words in found.declared[1])
    assert found.undone is None


@pytest.fixture
def files(tmp_path):
    a, b = tmp_path / "a.ngc", tmp_path / "b.ngc"
    a.write_text(PART)
    b.write_text(PART.replace("G1 X20 Y20", "G1 X20 Y20.5 F500").replace("M8\n", ""))
    return str(a), str(b)


def test_exit_status_and_text(capsys, files):
    status, out, err = run(capsys, "diff", *files)
    assert (status, err) == (1, "")
    assert "tool paths up to 500 µm apart" in out
    assert "-G1 X20 Y20\n+G1 X20 Y20.5 F500\n" in out
    assert "- A:11: flood on" in out
    assert "\x1b" not in out
    assert run(capsys, "diff", files[0], files[0])[0] == 0
    assert run(capsys, "diff", files[0], "nowhere.ngc")[0] == 2
    assert run(capsys, "diff", "-", "-")[0] == 2


def test_paths_of_two_parts_are_millimetres_apart(capsys, files):
    Path(files[1]).write_text(PART.replace("G1 Y0\n", "G1 Y-53\n"))
    assert "tool paths up to 53.000 mm apart" in run(capsys, "diff", *files)[1]


def test_colour_is_on_when_asked_for_and_never_with_no_color(capsys, files, monkeypatch):
    assert "\x1b[31m-G1 X20 Y20" in run(capsys, "diff", *files, "--color")[1]
    assert "\x1b" not in run(capsys, "diff", *files, "--no-color")[1]
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in run(capsys, "diff", *files)[1]


def test_json_has_the_agreed_keys(capsys, files):
    status, out, _ = run(capsys, "diff", *files, "--json")
    found = json.loads(out)
    assert status == 1
    assert {"blocks", "geometry", "feed", "time", "error"} <= found.keys()
    assert found["same"] is False
    assert found["geometry"]["max_deviation"] == pytest.approx(0.5, rel=1e-9)
    assert found["blocks"][0]["text_b"] == ["G1 X20 Y20.5 F500"]
    assert found["blocks"][0]["a"] == [9, 9]
    assert found["error"] is None


def test_the_page_stands_alone_and_holds_the_data(capsys, files, tmp_path):
    page = tmp_path / "page.html"
    status, _, err = run(capsys, "diff", *files, "--html", str(page))
    assert status == 1
    assert f"wrote {page}" in err
    text = page.read_text()
    assert not re.search(r"https?:|src=|href=|@import|fetch\(|XMLHttp", text)
    data = json.loads(re.search(r"const D = (\{.*\});", text)[1].replace("<\\/", "</"))
    assert data["geometry"]["max_deviation"] == pytest.approx(0.5, rel=1e-9)
    assert data["path"]["line"][0] == 5
    assert len(data["speed"][0]["s"]) == len(data["speed"][0]["feed"]) + 1
    away = [max(map(abs, data["off"][1][name])) for name in ("dx", "dy", "dz")]
    assert away[1] == pytest.approx(0.5, rel=1e-6)


def test_a_script_in_a_comment_stays_text(capsys, tmp_path):
    a, b, page = (tmp_path / name for name in ("a.ngc", "b.ngc", "page.html"))
    a.write_text(PART)
    b.write_text(PART.replace("(part)", "(</script><script>alert[1]</script>)"))
    run(capsys, "diff", str(a), str(b), "--html", str(page))
    assert page.read_text().count("</script>") == 1


FREECAD = [
    entry
    for entry in entries()
    if entry.name.startswith("freecad/") and "adaptive" not in entry.name and "helix" not in entry.name
]


@pytest.mark.parametrize("entry", FREECAD, ids=lambda entry: entry.name)
@pytest.mark.thinned(12)
def test_compensated_programs_differ_by_what_they_declare(entry):
    """Three axes carry 0.025 mm each, and come onto their flanks from 0.075 mm beside their places."""
    program = read_program(entry.file.read_bytes(), entry.name)
    output = read_program(compensated(program, stepper(), find_dialect(entry.dialect)), entry.name)
    found = compare_programs(program, output)
    assert found.orders == ()
    if output.data == program.data:
        assert found.same
        return
    assert found.undone == 0.0
    assert 0.025e-3 - 1e-9 <= found.max_deviation <= 0.075e-3 * math.sqrt(3.0)
    back = compare_programs(output, program)
    assert back.max_deviation == pytest.approx(found.max_deviation, rel=1e-9)


def test_a_machine_without_a_drive_for_an_axis_predicts_nothing(tmp_path, capsys):
    # An axis left out of the prediction would count as wholly off its path.
    part, flat = tmp_path / "part.ngc", tmp_path / "flat.toml"
    part.write_text(PART)
    flat.write_text(
        'name = "flat"\n[controller]\ndialect = "linuxcnc"\nservo_period_ms = 1\n'
        + "".join(
            f'[axes.{axis}]\nfeedback = "none"\nb = 0\nc = 0\nlost_motion_mm = 0.06\n'
            "max_velocity_mm_s = 100\nmax_acceleration_mm_s2 = 1000\nmax_jerk_mm_s3 = 20000\n"
            for axis in "XY"
        )
    )
    assert main(["diff", str(part), str(part), "-m", str(flat)]) == 2
    said = without_progress(capsys.readouterr().err)
    assert said == (
        f"ph-post: {flat}: the program moves axis Z, which has no drive; expected [axes.Z]; got [axes.X], [axes.Y]\n"
    )
