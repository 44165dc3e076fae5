"""``ph-post report``: which page is made of what, what is in it, and what is refused."""

import json
import re
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from support.streams import without_progress

from ph_post.cli.main import main
from ph_post.files.storage import shipped_names
from ph_post.report.page import rows_to_draw

SUPPRESS = ("--strategy", "suppress")
WORN = Path(__file__).resolve().parents[2] / "samples" / "logs" / "worn_router.csv"


def data_of(text):
    (found,) = re.findall(r"^const D = (.*);$", text, re.MULTILINE)

    def refuse(name):
        raise AssertionError(f"{name} in the page")

    return json.loads(found, parse_constant=refuse)


@pytest.mark.thinned(8)
@pytest.mark.parametrize("name", sorted(shipped_names("paths"), key="oval".__ne__))
def test_every_shipped_path_has_a_page_without_nan_and_not_too_large(name, tmp_path, capsys):
    page = tmp_path / "page.html"
    assert main(["report", name, "-m", "mill", *SUPPRESS, "-o", str(page), "--json"]) == 0
    view = json.loads(capsys.readouterr().out)
    text = page.read_text(encoding="utf-8")
    data = data_of(text)
    assert len(text) < 3_000_000
    assert [point["index"] for point in data["points"]] == [one["index"] for one in view["windows"]]
    for run, side in zip(data["runs"], ("before", "after"), strict=False):
        # The largest error that is drawn is the one that is told.
        drawn = [abs(e) for e, counted in zip(run["e"], run["counted"], strict=True) if counted]
        assert max(drawn) == pytest.approx(1e3 * view["error"][side]["max"], abs=1e-3)
        assert run["time"] == view["cycle_time"][side]
        for point, window in zip(data["points"], view["windows"], strict=True):
            told = window["error"][side]
            found = point["errors"][("before", "after").index(side)]
            assert found == (None if told is None else pytest.approx(1e3 * told["max"]))


def test_the_object_is_that_of_simulate(capsys):
    assert main(["report", "circle", "-m", "paper", *SUPPRESS, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    for side, strategy in (("before", "none"), ("after", "suppress")):
        assert main(["simulate", "circle", "-m", "paper", "--strategy", strategy, "--json"]) == 0
        known = json.loads(capsys.readouterr().out)
        assert found["error"][side] == pytest.approx(known["error"])
        assert found["error_worst"][side] == pytest.approx(known["error_worst"])
        assert found["cycle_time"][side] == known["cycle_time"]
        own = [one["error"][side] for one in found["windows"]]
        assert own == [pytest.approx(one["error"]) for one in known["per_turning_point"]]


def test_a_compensated_program_is_shown_beside_its_original(tmp_path, capsys):
    source, made = tmp_path / "part.ngc", tmp_path / "made.ngc"
    source.write_text("G21 G90 G94\nG0 X0 Y0\nG1 X40 F600\nG3 X40 Y20 J10\nG1 X0\nG3 X0 Y0 J-10\nM2\n")
    how = ["-m", "router", "--effort", "0.01", "--max-slowdown", "3"]
    assert main(["convert", str(source), *how, "-o", str(made), "--json"]) == 0
    known = json.loads(capsys.readouterr().out)
    for place in (source, made):
        assert main(["report", str(place), *how, "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["kind"] == "program"
        for key in ("cycle_time", "error"):
            assert found[key]["before"] == pytest.approx(known[key]["before"])
            assert found[key]["after"] == pytest.approx(known[key]["after"])
        assert [one["line"] for one in found["windows"]] == [one["line"] for one in known["windows"]]


def test_a_reversal_of_an_axis_without_backlash_is_not_said_to_be_left(tmp_path, capsys):
    # Of a router without backlash in Z the page said "3 of 3" above, and "not compensated" in the fourth row.
    part, machine, page = tmp_path / "part.nc", tmp_path / "router.toml", tmp_path / "page.html"
    part.write_text("G21 G90\nG0 X0 Y0 Z5\nG1 Z-1 F300\nX20 F900\nG2 X40 Y20 I0 J20\nG1 X10\nG0 Z5\nM2\n")
    text = (WORN.parents[1] / "machines" / "stepper.toml").read_text()
    head, _, z = text.partition("[axes.Z]")
    machine.write_text(head + "[axes.Z]" + re.sub(r"lost_motion_mm = [0-9.]+", "lost_motion_mm = 0.0", z))
    assert main(["report", str(part), "-m", str(machine), "-o", str(page)]) == 0
    text = page.read_text()
    done = {(one["axis"], one["done"]) for one in data_of(text)["points"]}
    assert ("Z", "no backlash") in done
    assert "not compensated" not in {words for _, words in done}
    assert re.search(r"Z +min +[0-9.]+ +no backlash", text)


@pytest.mark.slow
def test_the_page_goes_to_standard_output_and_a_picture_beside_it(tmp_path, capsys):
    assert main(["report", "oval", "-m", "mill", *SUPPRESS]) == 0
    assert capsys.readouterr().out.startswith("<!DOCTYPE html>")
    picture = tmp_path / "oval.svg"
    assert main(["report", "oval", "-m", "mill", *SUPPRESS, "--plot", str(picture)]) == 0
    streams = capsys.readouterr()
    assert streams.out == ""
    assert f"wrote {picture}" in streams.err
    assert "<svg" in picture.read_text()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("oval",), "Missing option '-m' / '--machine'"),
        (("oval", "-m", "mill", "--program", "a.ngc"), "--program does not go with a path"),
        (("a.ngc", "b.ngc", "--strategy", "auto"), "--strategy does not go with two programs"),
        (("run.csv", "-m", "mill", "--effort", "1"), "--effort does not go with a record"),
        (
            ("oval", "-m", "mill", "--plot", "a.gif"),
            "pictures come in other formats; expected .png, .svg, .pdf",
        ),
        (("oval", "-m", "mill", "-o", "-", "--json"), "standard output can take one product"),
        (("nothing.json", "-m", "mill"), "nothing.json: no such file"),
        (("a.ngc", "-m", "mill", "--dialect", "x"), "dialect: no such dialect"),
        (("table.csv", "-m", "mill"), "table.csv: is an interpolator table; expected the path"),
    ],
)
def test_what_does_not_go_together_is_refused_in_words(tmp_path, monkeypatch, capsys, arguments, word):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run.csv").write_text("t,X_cmd,X_act\n0,0,0\n")
    (tmp_path / "table.csv").write_text("t,segment,xi,s,X,Y,feed,window\n0,0,0,0,0,0,0,-1\n")
    for name in ("a.ngc", "b.ngc"):
        (tmp_path / name).write_text("G1 X1 F100\n")
    files = sorted(tmp_path.iterdir())
    assert main(["report", *arguments]) == 2
    err = without_progress(capsys.readouterr().err)
    assert word in err
    assert err.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == files


DRAWING = [
    ("inspect", "oval"),
    ("inspect", "oval", "-m", "mill"),
    ("convert", "oval", "-m", "mill", *SUPPRESS, "-o", "oval.ngc", "--no-simulation"),
    ("sweep", "-m", "mill", "--beta", "1,2", "--gain", "1e7,2e7,3e7", "-o", "mill.json"),
    ("diff", "a.ngc", "b.ngc"),
    ("report", "a.ngc", "b.ngc"),
]


@pytest.mark.thinned(12)
@pytest.mark.parametrize(("ending", "command"), list(product(("png", "svg", "pdf"), DRAWING)))
def test_commands_draw_in_the_format_of_the_ending(tmp_path, monkeypatch, capsys, command, ending):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.ngc").write_text("G21 G90\nG0 X0 Y0\nG1 X10 F100\nY10\n")
    (tmp_path / "b.ngc").write_text("G21 G90\nG0 X0 Y0\nG1 X10 Y0.01 F100\nY10 F200\n")
    assert main([*command, "--plot", f"picture.{ending}"]) in (0, 1)
    assert f"wrote picture.{ending}" in capsys.readouterr().err
    head = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[ending]
    assert (tmp_path / f"picture.{ending}").read_bytes().startswith(head)
    assert main([*command, "--plot", "picture.bmp"]) == 2
    assert "expected .png, .svg, .pdf; got '.bmp'" in capsys.readouterr().err


def test_a_long_motion_keeps_its_peaks_and_what_is_to_be_kept():
    random = np.random.default_rng(5)
    count, most = 200_000, 5_000
    error, feed = random.normal(0.0, 1.0, count), np.full(count, 20.0)
    peaks = 1_234 + 4_999 * np.arange(40)
    error[peaks] += random.choice([-50.0, 50.0], 40)
    feed[peaks[:10]] = 0.0
    inside = np.zeros(count, dtype=bool)
    inside[50_000:51_000] = True
    always = np.array([3, 77_777])
    kept = rows_to_draw(error, feed, inside, always, most)
    assert kept.size <= most + 3
    assert set(peaks.tolist()) | {0, 3, 77_777, count - 1} <= set(kept.tolist())
    assert np.all(np.diff(kept) > 0)
    # In the window rows are closer together than outside.
    share = np.count_nonzero((kept >= 50_000) & (kept < 51_000)) / 1_000
    assert share > 4.0 * kept.size / count


def test_a_short_motion_is_drawn_as_it_is():
    rows = rows_to_draw(np.zeros(50), np.zeros(50), np.zeros(50, dtype=bool), np.array([3]), 100)
    assert rows.tolist() == list(range(50))


@pytest.mark.slow
def test_identify_draws_what_is_left_of_the_record(tmp_path, capsys):
    picture, log = tmp_path / "left.png", tmp_path / "first.csv"
    log.write_bytes(b"".join(WORN.read_bytes().splitlines(keepends=True)[:2600]))
    assert main(["identify", str(log), "-m", "router", "--plot", str(picture)]) == 0
    assert f"wrote {picture}" in capsys.readouterr().err
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_what_is_thinned_keeps_what_the_table_tells_and_says_so(tmp_path, monkeypatch):
    page, whole = tmp_path / "thin.html", tmp_path / "whole.html"
    assert main(["report", "oval", "-m", "mill", *SUPPRESS, "-o", str(whole)]) == 0
    monkeypatch.setattr("ph_post.report.motion_page.ROWS", 300)
    monkeypatch.setattr("ph_post.report.motion_page.MARKS", 2)
    assert main(["report", "oval", "-m", "mill", *SUPPRESS, "-o", str(page)]) == 0
    data, known = data_of(page.read_text(encoding="utf-8")), data_of(whole.read_text(encoding="utf-8"))
    worst = sorted(known["points"], key=lambda point: -max(point["errors"]))[:2]
    assert [one["index"] for one in data["points"]] == sorted(one["index"] for one in worst)
    for number, run in enumerate(data["runs"]):
        assert len(run["s"]) < 320
        size = np.abs(run["e"])
        for point in data["points"]:
            assert np.isclose(size, point["errors"][number], atol=1e-3).any()
    assert any("of 12658 samples are drawn" in note for note in data["notes"])
    assert "of 4 reversals the 2 with the largest errors are listed and marked" in data["notes"]
