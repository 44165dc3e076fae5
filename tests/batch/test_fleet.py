"""A machine file from each log of a folder, as `identify` makes it, and what has drifted."""

import contextlib
import csv
import json
import shlex

import pytest

from ph_post.batch import fleet as engine
from ph_post.batch.fleet import DriftRow, LogOutcome, drift_text, read_drift
from ph_post.batch.workers import LostJobError
from ph_post.cli.main import main


class Here:
    """Workers without processes."""

    def __init__(self):
        self.done = []

    def wait(self, _progress):
        """They are here."""

    def on_each(self, *_):
        """Nothing has to be compiled."""

    def run(self, function, jobs, progress=None):
        for name, job in jobs:
            self.done.append(name)
            yield name, LostJobError("died") if b"deadly" in job.source.data else function(job)


@pytest.fixture
def real(monkeypatch):
    workers = Here()
    monkeypatch.setattr(engine, "open_workers", lambda count, scheduler: contextlib.nullcontext(workers))
    return workers


def quick(job):
    """Take the lost motion of a log from its text."""
    text = job.source.data.decode()
    if "bad" in text:
        return LogOutcome(rows=(DriftRow(log="", status="refused", reason="bad log"),))
    value = float(text) if "deadly" not in text else 0.0
    row = DriftRow(log="", status="identified", axis="X", parameter="lost_motion", value=value, stderr=0.001, unit="mm")
    return LogOutcome(rows=(row,), file=f"lost_motion_mm = {value}\n")


@pytest.fixture
def here(real, monkeypatch):
    monkeypatch.setattr(engine, "identify_job", quick)
    return real


@pytest.fixture
def logs(tmp_path):
    folder = tmp_path / "logs"
    (folder / "hall").mkdir(parents=True)
    (folder / "lathe.csv").write_text("0.05")
    (folder / "hall" / "mill.csv").write_text("0.10")
    return folder


def rows_of(out):
    with (out / "drift.csv").open(newline="") as file:
        return {row["log"]: row for row in csv.DictReader(file)}


def fleet(logs, out, *more):
    return main(["fleet", str(logs), "-o", str(out), *more])


@pytest.mark.slow
def test_a_log_gives_what_identify_gives(real, tmp_path, capsys):
    folder, out = tmp_path / "logs", tmp_path / "out"
    folder.mkdir()
    assert main(["simulate", "circle", "-m", "router", "--log", str(folder / "lathe.csv")]) == 0
    capsys.readouterr()
    assert fleet(folder, out, "-m", "router", "--json") == 0
    view = json.loads(capsys.readouterr().out)
    assert (
        main(["identify", str(folder / "lathe.csv"), "-m", "router", "-o", str(tmp_path / "one.toml"), "--json"]) == 0
    )
    alone = json.loads(capsys.readouterr().out)
    assert (out / "lathe.toml").read_bytes() == (tmp_path / "one.toml").read_bytes()
    found = {(row["axis"], row["parameter"]): row for row in view["rows"]}
    for axis, parameters in alone["axes"].items():
        for name, one in parameters.items():
            row = found.pop((axis, name))
            assert (row["value"], row["stderr"], row["unit"]) == (one["value"], one["stderr"], one["unit"])
    assert found == {}


def test_what_has_drifted_is_said_and_counted(here, logs, tmp_path, capsys):
    out = tmp_path / "out"
    assert fleet(logs, out) == 0
    assert "2 logs: 0 parameters drifted" in capsys.readouterr().err
    assert (out / "hall" / "mill.toml").exists()
    (logs / "lathe.csv").write_text("0.09")
    (logs / "hall" / "mill.csv").write_text("0.104")  # 2.8 standard errors of the difference
    assert fleet(logs, out) == 0
    said = capsys.readouterr().err
    assert "lathe.csv: X lost_motion has drifted from 0.05 to 0.09 mm" in said
    assert "2 logs: 1 parameter drifted" in said
    rows = rows_of(out)
    assert rows["lathe.csv"]["drifted"] == "yes"
    assert float(rows["lathe.csv"]["change"]) == pytest.approx(0.04)
    assert rows["hall/mill.csv"]["drifted"] == "no"


def test_a_log_that_shows_no_gains_is_named(real, logs, tmp_path, capsys, monkeypatch):
    # Logs of one constant speed gave machine files with K_v = 335 +- 18932 1/s, in a table of 24 lines alone.
    def slow(job):
        rows = quick(job).rows
        gain = DriftRow(log="", status="identified", axis="X", parameter="position_gain", value=335.0, stderr=18932.0)
        return LogOutcome(rows=(*rows, gain) if b"0.05" in job.source.data else rows, file="name = 'a machine'\n")

    monkeypatch.setattr(engine, "identify_job", slow)
    assert fleet(logs, tmp_path / "out") == 0
    said = capsys.readouterr().err
    assert "warning: lathe.csv: this log does not show position gain of X, which may be anything" in said
    assert "mill.csv" not in said


def test_a_second_run_does_nothing(here, logs, tmp_path, capsys):
    out = tmp_path / "out"
    fleet(logs, out)
    before = {one: (one.read_bytes(), one.stat().st_mtime_ns) for one in out.rglob("*.*")}
    here.done.clear()
    capsys.readouterr()
    assert fleet(logs, out) == 0
    assert here.done == []
    assert "2 of an earlier run" in capsys.readouterr().err
    assert {one: (one.read_bytes(), one.stat().st_mtime_ns) for one in out.rglob("*.*")} == before
    fleet(logs, out, "--feedback", "motor")
    assert here.done == ["hall/mill.csv", "lathe.csv"]


def test_the_folder_of_the_outputs_may_stand_among_the_logs(here, logs, capsys):
    # Its table was taken for one more log, which was refused in each further run.
    for _ in range(2):
        assert fleet(logs, logs / "out") == 0
    assert here.done == ["hall/mill.csv", "lathe.csv"]
    assert "2 logs: 0 parameters drifted; 2 of an earlier run" in capsys.readouterr().err


def test_names_of_logs_that_look_alike_or_like_formulas_have_their_rows(here, logs, tmp_path):
    out = tmp_path / "out"
    for name in ("=1+1.csv", "a b.csv", "a  b.csv", "a\nb.csv"):
        (logs / name).write_text("0.07")
    for _ in range(2):
        assert fleet(logs, out) == 0
    assert len(here.done) == 6
    rows = rows_of(out)
    assert sorted(rows) == ["'=1+1.csv", "a  b.csv", "a b.csv", r"a\nb.csv", "hall/mill.csv", "lathe.csv"]
    assert rows["'=1+1.csv"]["output"] == str(out / "=1+1.toml")


def test_a_refused_log_is_a_row_and_its_last_value_is_kept(here, logs, tmp_path, capsys):
    out = tmp_path / "out"
    fleet(logs, out)
    for text in ("bad", "deadly"):
        (logs / "lathe.csv").write_text(text)
        assert fleet(logs, out) == 1
    assert "ph-post: lathe.csv: failed: died" in capsys.readouterr().err
    row = rows_of(out)["lathe.csv"]
    assert (row["status"], row["value"], row["before"]) == ("failed", "", "0.05")
    (logs / "lathe.csv").write_text("0.06")
    assert fleet(logs, out) == 0
    row = rows_of(out)["lathe.csv"]
    assert (row["before"], row["drifted"]) == ("0.05", "yes")


def test_a_file_that_was_edited_is_not_overwritten(here, logs, tmp_path):
    out = tmp_path / "out"
    fleet(logs, out)
    (out / "lathe.toml").write_text("# limits by hand\n")
    (logs / "lathe.csv").write_text("0.06")
    assert fleet(logs, out) == 1
    assert "not as ph-post wrote it" in rows_of(out)["lathe.csv"]["reason"]
    assert (out / "lathe.toml").read_text() == "# limits by hand\n"
    assert fleet(logs, out, "--force") == 0
    assert rows_of(out)["lathe.csv"]["before"] == "0.05"


def test_each_log_has_its_machine_file(here, logs, tmp_path):
    machines, out = tmp_path / "machines", tmp_path / "out"
    machines.mkdir()
    (machines / "lathe.toml").write_text("name = 'lathe'\n")
    assert fleet(logs, out, "-m", str(machines)) == 1
    assert here.done == ["lathe.csv"]
    assert "mill.toml: no such file" in rows_of(out)["hall/mill.csv"]["reason"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("'' -o out", "ph-post: '': no such folder; expected a folder of logs"),
        ("logs -o ''", "ph-post: -o: no folder; expected the name of a folder; got ''"),
        ("nowhere -o out", "ph-post: nowhere: no such folder; expected a folder of logs"),
        ("empty -o out", "ph-post: empty: no logs; expected files that end in .csv"),
        ("logs -o logs", "ph-post: logs: the outputs would stand among the logs"),
        ("logs -m empty -o empty", "ph-post: empty: the outputs would overwrite the machine files"),
        ("logs -m nothing -o out", "ph-post: nothing: no such file, and none of the shipped machines"),
        ("logs -o mine", "mine/drift.csv: is there already, and no table of ph-post fleet"),
        ("logs -o out --workers 1 --scheduler a", "ph-post: --workers is for processes of this computer"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(logs, tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "drift.csv").write_text("snow,wind\n3,2\n")
    before = sorted(tmp_path.rglob("*"))
    assert main(["fleet", *shlex.split(arguments)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert words in said.err
    assert len(said.err.splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_the_table_survives_its_file(tmp_path):
    row = DriftRow(
        log='a,"b".csv', status="identified", axis="X", parameter="b", value=1.5e-7, stderr=1e-9, unit="s²", before=1e-7
    )
    bare = DriftRow(log="b.csv", status="refused", reason="why")
    (tmp_path / "drift.csv").write_text(drift_text([row, bare]))
    assert read_drift(tmp_path / "drift.csv") == [row, bare]
    assert read_drift(tmp_path / "none.csv") == []
