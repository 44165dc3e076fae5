"""``ph-post simulate`` as other programs see it."""

import json
from pathlib import Path

import numpy as np
import pytest
from support.front_door import run

ROOT = Path(__file__).resolve().parents[2]
OVAL = str(ROOT / "paths" / "oval.json")
KEYS = {
    "cycle_time",
    "error",
    "error_gap",
    "error_worst",
    "per_turning_point",
    "events",
    "scenarios",
    "warnings",
}


def simulated(capsys, *arguments):
    status, out, _ = run(capsys, "simulate", *arguments, "--json")
    assert status == 0
    return json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))


@pytest.fixture
def table(capsys, tmp_path):
    name = str(tmp_path / "oval.csv")
    arguments = ("convert", OVAL, "-m", "mill", "--strategy", "suppress", "--table", name)
    assert run(capsys, *arguments)[0] == 0
    return name


def test_json_has_the_contracts_keys(capsys):
    view = simulated(capsys, OVAL, "-m", "mill")
    assert view.keys() >= KEYS
    for name in ("error", "error_gap", "error_worst"):
        assert view[name]["max"] >= view[name]["rms"] > 0
    assert view["error_worst"]["max"] >= view["error"]["max"]
    assert len(view["per_turning_point"]) == 4
    assert max(one["error"]["max"] for one in view["per_turning_point"]) == view["error"]["max"]
    assert {event["kind"] for event in view["events"]} >= {"opens", "picks up"}
    # Two reversals of either axis, each opens its gap once.
    opened = [event["axis"] for event in view["events"] if event["kind"] == "opens"]
    assert sorted(opened) == ["X", "X", "Y", "Y"]
    assert max(one["error"]["max"] for one in view["scenarios"]) == view["error_worst"]["max"]


def test_the_papers_circle(capsys):
    # The notes on the paper, honest mode: 2.19e-3 of the radius of 250 mm, within 3 %.
    view = simulated(capsys, "circle", "-m", "paper", "--start", "moving")
    assert view["error"]["max"] == pytest.approx(2.19e-3 * 250, rel=0.03)
    assert view["cycle_time"] == pytest.approx(12.0, abs=0.0011)


@pytest.mark.slow
def test_a_table_is_the_plan_it_was_made_from(capsys, table):
    ours = simulated(capsys, OVAL, "-m", "mill", "--strategy", "suppress")
    read = simulated(capsys, table, "--path", OVAL, "-m", "mill")
    for name in ("error", "error_gap", "error_worst"):
        assert read[name]["max"] == pytest.approx(ours[name]["max"], abs=1e-8)
    assert [event["kind"] for event in read["events"]] == [event["kind"] for event in ours["events"]]


def test_a_table_without_its_path_has_no_error(capsys, table):
    view = simulated(capsys, table, "-m", "mill")
    assert [view[name] for name in ("error", "error_gap", "error_worst", "per_turning_point")] == [None] * 4
    assert any("--path" in warning for warning in view["warnings"])
    assert view["events"]


@pytest.mark.slow
def test_the_log_holds_the_motion(capsys, tmp_path, table):
    log = tmp_path / "log.csv"
    status, _, err = run(capsys, "simulate", table, "-m", "mill", "--log", str(log))
    assert status == 0
    assert f"wrote {log}" in err
    lines = log.read_text().splitlines()
    remarks = [line for line in lines if line.startswith("# ")]
    assert all(": " in line for line in remarks)
    assert lines[len(remarks)] == "t,X_cmd,X_act,X_motor,Y_cmd,Y_act,Y_motor"
    rows = np.genfromtxt(lines[len(remarks) :], delimiter=",", names=True)
    given = np.genfromtxt(table, delimiter=",", names=True)
    for axis in "XY":
        np.testing.assert_allclose(rows[f"{axis}_cmd"], given[axis], atol=1e-9)
    # Table and motor differ by half the gap at most: 0.030 mm on X, 0.045 mm on Y.
    assert np.abs(rows["X_act"] - rows["X_motor"]).max() == pytest.approx(0.015, abs=1e-6)
    assert np.abs(rows["Y_act"] - rows["Y_motor"]).max() == pytest.approx(0.0225, abs=1e-6)


def test_the_log_is_the_same_every_time(capsys):
    first, second = (run(capsys, "simulate", "circle", "-m", "paper", "--log", "-")[1] for _ in range(2))
    assert first == second
    assert first.startswith("# ")


@pytest.mark.parametrize("ending", [".png", ".svg", ".pdf"])
@pytest.mark.thinned(4)
def test_pictures_with_and_without_a_path(capsys, tmp_path, table, ending):
    for number, more in enumerate(((), ("--path", OVAL))):
        picture = tmp_path / f"{number}{ending}"
        assert run(capsys, "simulate", table, "-m", "mill", *more, "--plot", str(picture))[0] == 0
        assert picture.stat().st_size > 5000


def test_rule_and_flank_can_be_chosen(capsys):
    for rule in ("standstill", "momentum", "contact"):
        view = simulated(capsys, OVAL, "-m", "mill", "--pickup", rule, "--flank", "-")
        assert len(view["scenarios"]) == 7
        assert view["scenario"]["flank"] is None


def test_plain_output_is_short_and_names_the_turning_points(capsys):
    status, out, _ = run(capsys, "simulate", OVAL, "-m", "mill")
    assert status == 0
    assert len(out.splitlines()) <= 16
    assert {"contour", "worst", "rms", "axis"} <= set(out.split())


def with_effect(tmp_path, effect):
    text = (ROOT / "samples" / "machines" / "mill.toml").read_text()
    file = tmp_path / "mill.toml"
    file.write_text(text.replace("[axes.Y]", f'[[axes.X.effects]]\nname = "{effect}"\n\n[axes.Y]', 1))
    return str(file)


def test_effects_that_do_not_act_are_named_once(capsys, tmp_path):
    view = simulated(capsys, OVAL, "-m", with_effect(tmp_path, "servo_mismatch"))
    named = [warning for warning in view["warnings"] if "servo_mismatch" in warning]
    assert len(named) == 1
    assert "axis X" in named[0]


def test_broken_limits_are_named(capsys, tmp_path, table):
    lines = Path(table).read_text().splitlines()
    cells = lines[6000].split(",")
    cells[4] = str(float(cells[4]) + 0.5)
    Path(table).write_text("\n".join([*lines[:6000], ",".join(cells), *lines[6001:]]) + "\n")
    view = simulated(capsys, table, "-m", "mill")
    # 0.5 mm from row to row are 500 mm/s; 0.5 mm up and down again 2 · 0.5 / 0.001² mm/s².
    broken = [warning for warning in view["warnings"] if "breaks the" in warning]
    assert len(broken) == 3
    assert all("limit of X" in warning for warning in broken)
    acceleration = next(warning for warning in broken if "acceleration" in warning)
    assert float(acceleration.split(": ")[1].split()[0]) == pytest.approx(1e6, rel=1e-3)


SHORT = """{"format": "ph-post-path", "version": 1, "name": "short", "source": "a test", "units": "mm",
"axes": ["X", "Y"], "feed": 1200, "closed": false,
"segments": [{"type": "line", "points": [[0, 0], [0.01, 0]]}]}"""


def test_a_motion_too_short_to_count_has_no_error(capsys, tmp_path):
    short = written(tmp_path, "short.json", SHORT)
    picture = str(tmp_path / "short.png")
    view = simulated(capsys, short, "-m", "mill", "--plot", picture)
    assert [view[name] for name in ("error", "error_gap", "error_worst")] == [None] * 3
    # Five times 2b/c of Y, the slower axis: 5 * 2 * 0.000225 / 0.030 s.
    assert view["warnings"] == ["the motion is over before its contour error counts, 0.075 s after its start"]
    assert run(capsys, "compare", short, "-m", "mill", "--effort", "0.01", "--plot", picture)[0] == 0


def refused(capsys, *arguments):
    status, out, err = run(capsys, "simulate", *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    return err


def test_bad_input_is_one_line(capsys, tmp_path, table):
    assert "wrong columns; expected t, segment, xi, s, X, Y, feed, window; got a, b" in refused(
        capsys, written(tmp_path, "wrong.csv", "a,b\n1,2\n"), "-m", "mill"
    )
    header = "t,segment,xi,s,X,Y,feed,window\n"
    row = "0.0,0,0.0,0.0,0.0,0.0,0.0,-1\n"
    assert "at least two rows" in refused(capsys, written(tmp_path, "one.csv", header + row), "-m", "mill")
    assert "at least two rows" in refused(capsys, written(tmp_path, "none.csv", header), "-m", "mill")
    nan = header + row + row.replace("0.0,0,", "0.001,0,").replace(",0.0,-1", ",nan,-1")
    assert "feed: not a finite number" in refused(capsys, written(tmp_path, "nan.csv", nan), "-m", "mill")
    late = header + row + row.replace("0.0,", "0.001,", 1) + row.replace("0.0,", "0.009,", 1)
    assert "constant period" in refused(capsys, written(tmp_path, "late.csv", late), "-m", "mill")
    assert "no such file" in refused(capsys, str(tmp_path / "missing.csv"), "-m", "mill").lower()
    space = Path(table).read_text().replace(",Y,", ",Z,", 1)
    other = written(tmp_path, "xz.csv", space)
    assert "axis Z, which has no drive" in refused(capsys, other, "-m", "paper")
    assert "other axes than the path" in refused(capsys, other, "-m", "mill", "--path", OVAL)
    assert "another path" in refused(capsys, table, "-m", "paper", "--path", "circle")
    assert "axis Z, which has no drive" in refused(capsys, "spatial", "-m", "paper")


def written(folder, name, text):
    (folder / name).write_text(text)
    return str(folder / name)


def test_bad_usage_is_one_line(capsys, tmp_path):
    missing = str(tmp_path / "no" / "log.csv")
    assert "existing folder" in refused(capsys, OVAL, "-m", "mill", "--log", missing)
    assert "other formats" in refused(capsys, OVAL, "-m", "mill", "--plot", str(tmp_path / "a.bmp"))
    assert "one product" in refused(capsys, OVAL, "-m", "mill", "--json", "--log", "-")
    assert "--path goes with" in refused(capsys, OVAL, "-m", "mill", "--path", OVAL)
    assert "--strategy" in refused(capsys, OVAL, "-m", "mill", "--strategy", "nonsense")
    assert list(tmp_path.iterdir()) == []
