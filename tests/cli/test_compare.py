"""``ph-post compare`` as other programs see it."""

import json
import math
from pathlib import Path

import pytest
from support.front_door import once, run
from support.shop import HUMP

from ph_post.compensate.strategies.none import PlainFeed
from ph_post.compensate.strategies.registry import strategy_names

ROOT = Path(__file__).resolve().parents[2]
OVAL = str(ROOT / "paths" / "oval.json")
KEYS = {
    "name",
    "error",
    "error_worst",
    "cycle_time",
    "min_feed",
    "standstill_time",
    "retrograde",
    "peak_acceleration",
    "ok",
    "reason",
}


QUICK = ("--effort", "0.01")


@pytest.fixture
def hump(tmp_path):
    file = tmp_path / "hump.json"
    file.write_text(json.dumps(HUMP))
    return str(file)


def compared(capsys, *arguments):
    status, out, _ = run(capsys, "compare", *arguments, *QUICK, "--json")
    assert status == 0
    rows = json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} in JSON"))["strategies"]
    assert all(row.keys() >= KEYS for row in rows)
    return rows


@pytest.mark.slow
def test_all_strategies_the_plain_program_first(capsys, hump):
    rows = compared(capsys, hump, "-m", "mill", "--allow-retrograde")
    assert rows[0]["name"] == "none"
    assert sorted(row["name"] for row in rows) == sorted(strategy_names())
    for row in rows:
        if row["ok"]:
            assert row["error_worst"]["max"] >= row["error"]["max"] > 0
            assert row["cycle_time"] >= rows[0]["cycle_time"]
            assert row["reason"] is None


@pytest.mark.slow
def test_the_papers_circle(capsys):
    rows = {row["name"]: row for row in compared(capsys, "circle", "-m", "paper", "--start", "moving")}
    plain = rows["none"]
    # 2.19e-3 of 250 mm within 3 %; V = 250 π / 6 mm/s, V²/ρ, 12 s.
    assert plain["error"]["max"] == pytest.approx(2.19e-3 * 250, rel=0.03)
    assert plain["min_feed"] == pytest.approx(60 * 250 * math.pi / 6, rel=1e-9)
    assert plain["peak_acceleration"] == pytest.approx((250 * math.pi / 6) ** 2 / 250, rel=1e-5)
    assert (plain["cycle_time"], plain["standstill_time"]) == (pytest.approx(12.0), 0.0)
    assert rows["suppress"]["min_feed"] == pytest.approx(0.25 * plain["min_feed"], rel=0.01)


@pytest.mark.slow
def test_a_refusal_is_listed_with_its_reason(capsys, monkeypatch, hump):
    once(monkeypatch, "compare")
    rows = {row["name"]: row for row in compared(capsys, hump, "-m", "mill")}
    refused = rows["retrograde"]
    assert not refused["ok"]
    assert "--allow-retrograde" in refused["reason"]
    assert "\n" not in refused["reason"]
    assert [refused[key] for key in ("error", "error_worst", "cycle_time", "min_feed")] == [None] * 4
    _, out, _ = run(capsys, "compare", hump, "-m", "mill", *QUICK)
    assert "refused retrograde: " in out


class ForScales(PlainFeed):
    name = "scales"
    summary = "for loops over the table alone"
    feedbacks = frozenset(("load",))


class Entry:
    name, value = "scales", "somewhere:else"
    dist = None

    def load(self):
        return ForScales()


@pytest.mark.slow
def test_a_strategy_of_another_loop_is_refused(capsys, monkeypatch, hump):
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: [Entry()])
    for machine, fits in (("mill", True), ("router", False)):
        row = next(row for row in compared(capsys, hump, "-m", machine) if row["name"] == "scales")
        assert row["ok"] is fits
        assert fits or "expected feedback load; got X: motor, Y: motor" in row["reason"]
    status, _, err = run(capsys, "convert", hump, "-m", "router", "--strategy", "scales")
    assert (status, err.count("\n")) == (2, 1)
    assert "scales does not compensate axes with these feedback loops" in err


@pytest.mark.slow
def test_broken_limits_are_a_refusal(capsys, monkeypatch, hump):
    from ph_post.compensate import comparison
    from ph_post.compensate.violations import Violation

    broken = Violation(axis="X", quantity="jerk", t=1.5, s=0.1, value=25.0, limit=20.0)
    monkeypatch.setattr(comparison, "check_command", lambda command, machine: (broken,))
    row = compared(capsys, hump, "-m", "mill")[0]
    assert not row["ok"]
    assert row["reason"] == "breaks the jerk limit of X at 1.500 s: 25000 mm/s³ where 20000 is allowed"
    assert row["error"]["max"] > 0


def test_the_table_has_a_line_a_strategy(capsys, tmp_path, hump):
    picture = tmp_path / "hump.png"
    status, out, err = run(capsys, "compare", hump, "-m", "stepper", *QUICK, "--plot", str(picture))
    assert status == 0
    assert all(any(line.split()[0] == name for line in out.splitlines()) for name in strategy_names())
    assert "standstills and their ramps excluded" in out
    assert "without backlash the error of the plain program would be" in out
    assert sum(line.startswith("auto chose ") for line in out.splitlines()) == 1
    assert f"wrote {picture}" in err
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_what_was_chosen_where_and_what_is_lag(capsys):
    status, out, _ = run(capsys, "compare", OVAL, "-m", "router", *QUICK, "--json")
    assert status == 0
    view = json.loads(out)
    rows = {row["name"]: row for row in view["strategies"]}
    assert [one["index"] for one in rows["auto"]["chosen"]] == [0, 1, 2, 3]
    assert {one["strategy"] for one in rows["none"]["chosen"]} == {"none"}
    assert {one["strategy"] for one in rows["takeup"]["chosen"]} == {"takeup"}
    # Half of either gap, 0.060 mm and 0.040 mm, is most of the error: without it there is servo lag.
    assert view["error_without_gap"]["max"] < 0.25 * rows["none"]["error"]["max"]


@pytest.mark.slow
def test_a_program_is_refused_what_it_cannot_carry(capsys):
    rows = {row["name"]: row for row in compared(capsys, OVAL, "-m", "stepper", "--carrier", "program")}
    assert rows["auto"]["ok"]
    assert "part program" in rows["step"]["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("job", ["program", "path"])
def test_programs_are_compared_by_what_convert_tells_of_them(capsys, tmp_path, job):
    source = str(ROOT / "samples" / "programs" / "pocket_grbl.ngc") if job == "program" else OVAL
    given = (source, "-m", "stepper")
    asked = () if job == "program" else ("--carrier", "program")
    status, out, _ = run(capsys, "compare", *given, *asked, "--json")
    assert status == 0
    view = json.loads(out)
    rows = {row["name"]: row for row in view["strategies"]}
    for name in ("fly", "auto"):
        output = ("-o", str(tmp_path / f"{name}.ngc"), "--strategy", name)
        told = json.loads(run(capsys, "convert", *given, *output, "--json")[1])
        row = rows[name]
        assert row["error"] == pytest.approx(told["error"]["after"])
        assert row["error_gap"]["max"] == pytest.approx(told["error_gap"]["after"]["max"])
        assert row["cycle_time"] == pytest.approx(told["cycle_time"]["after"])
        assert rows["none"]["error"] == pytest.approx(told["error"]["before"])
        assert rows["none"]["cycle_time"] == pytest.approx(told["cycle_time"]["before"])
        assert len(row["chosen"]) == told["reversals"]["all"]
    assert view["result"]["result_line"] == told["result_line"]
    # What dips and stops add to the time, the controller adds.
    assert all(row["cycle_time"] < 1.106 * rows["none"]["cycle_time"] for row in rows.values() if row["ok"])


@pytest.mark.slow
def test_effects_that_do_not_act_are_named_once(capsys, tmp_path, hump):
    text = (ROOT / "samples" / "machines" / "router.toml").read_text()
    machine = tmp_path / "router.toml"
    machine.write_text(text.replace("[axes.Y]", '[[axes.X.effects]]\nname = "servo_mismatch"\n\n[axes.Y]', 1))
    status, _, err = run(capsys, "compare", hump, "-m", str(machine), *QUICK)
    assert status == 0
    assert err.count("servo_mismatch") == 1


def test_bad_usage_is_one_line(capsys, tmp_path):
    for arguments, said in (
        ((OVAL,), "Missing option"),
        ((OVAL, "-m", "mill", "--plot", str(tmp_path / "a.txt")), "other formats"),
        (("spatial", "-m", "paper"), "axis Z, which has no drive"),
        ((OVAL, "-m", "mill", "--strategy", "none"), "No such option"),
        ((OVAL, "-m", "mill", "--carrier", "tape"), "--carrier: unknown; expected table or program; got tape"),
        (
            (OVAL, "-m", "mill", "--effort", "0"),
            "--effort: out of range; expected a finite number > 0 and at most 1000; got 0",
        ),
        ((OVAL, "-m", "mill", "--effort", "much"), "and at most 1000; got much"),
    ):
        status, out, err = run(capsys, "compare", *arguments)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert said in err
