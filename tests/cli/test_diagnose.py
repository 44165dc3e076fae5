"""``diagnose`` on the command line: what it reads, what it writes where, and what it says."""

import json
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from support.diagnoses import LADDER, diagnosis, each_verdict
from support.front_door import run

from ph_post.diagnose import diagnose as whole_diagnosis
from ph_post.drive.machinefile import read_machine

ROOT = Path(__file__).resolve().parents[2]
MILL = ROOT / "samples" / "machines" / "mill.toml"


@pytest.fixture
def log(tmp_path):
    """Return a log of X and Y whose readings lag a little behind their commands."""
    t = np.arange(3000) * 1e-3
    x = 10.0 * np.sin(2.0 * np.pi * t)
    read = 10.0 * np.sin(2.0 * np.pi * (t - 5.5e-3))
    rows = np.column_stack([t, x, read, x, read])
    file = tmp_path / "run.csv"
    np.savetxt(file, rows, "%.6f", ",", header="t,X_cmd,X_act,Y_cmd,Y_act", comments="")
    return file


@pytest.fixture
def found(monkeypatch):
    """Return how to say what the diagnosis is; the mathematics has its own tests."""

    def say(made):
        monkeypatch.setattr(whole_diagnosis, "diagnose", lambda log, machine, progress: made)

    return say


@pytest.mark.parametrize("verdict", ["named", "nothing-missing", "ambiguous", "unknown", "not-identifiable"])
def test_every_verdict_is_done(capsys, log, found, verdict):
    made = each_verdict()[verdict]
    found(made)
    status, out, err = run(capsys, "diagnose", log, "-m", MILL)
    assert (status, err) == (0, "")
    first = {
        "named": "Coulomb friction is missing from X: 20.4 ± 0.1 N.",
        "nothing-missing": "Nothing is missing: ",
        "ambiguous": "This log cannot separate: ",
        "unknown": "No known effect explains it: ",
        "not-identifiable": "This log cannot show it: ",
    }[verdict]
    assert out.startswith(first)
    status, out, err = run(capsys, "diagnose", log, "-m", MILL, "--json")
    assert (status, err) == (0, "")
    assert json.loads(out)["verdict"] == verdict


def test_log_and_machine_come_to_the_diagnosis_as_they_were_named(capsys, log, monkeypatch):
    seen = {}

    def diagnose(record, machine, progress):
        seen.update(log=record, machine=machine)
        return diagnosis(machine=machine)

    monkeypatch.setattr(whole_diagnosis, "diagnose", diagnose)
    log.write_text(log.read_text().replace("X_act", "ist").replace("Y_act", "egal"))
    mapped = ("--column", "X_act=ist*2:mm", "--column", "Y_act=egal:mm", "--side", "X=unknown")
    status, _, _ = run(capsys, "diagnose", log, "-m", MILL, *mapped)
    assert status == 0
    assert seen["machine"] == read_machine(MILL)
    assert (seen["log"].axes["X"].side, seen["log"].axes["Y"].side) == ("unknown", "table")
    assert seen["log"].axes["X"].table == pytest.approx(2.0 * seen["log"].axes["Y"].table)


def test_nothing_added_leaves_the_machine_file_as_it_was(capsys, log, found, tmp_path):
    found(replace(each_verdict()["nothing-missing"], machine=read_machine(MILL)))
    better = tmp_path / "better.toml"
    status, _, err = run(capsys, "diagnose", log, "-m", MILL, "-o", better)
    assert (status, err) == (0, f"nothing was added: {better} is the machine file as it was\n")
    assert better.read_bytes() == MILL.read_bytes()


def test_page_picture_and_next_program_are_written(capsys, log, found, tmp_path):
    found(each_verdict()["ambiguous"])
    page, picture, program = (tmp_path / name for name in ("run.html", "run.svg", "next.ngc"))
    status, out, err = run(capsys, "diagnose", log, "-m", MILL, "--html", page, "--plot", picture, "--next", program)
    assert status == 0
    assert out.startswith("This log cannot separate")
    assert err == f"wrote {page}\nwrote {picture}\nwrote {program}\n"
    assert page.read_text().startswith("<!DOCTYPE html>")
    assert "</svg>" in picture.read_text()
    assert program.read_text() == LADDER.program


def test_where_no_run_is_proposed_no_program_is_written(capsys, log, found, tmp_path):
    found(each_verdict()["unknown"])
    program = tmp_path / "next.ngc"
    status, _, err = run(capsys, "diagnose", log, "-m", MILL, "--next", program)
    assert (status, err) == (0, f"no other run is proposed: {program} is not written\n")
    assert not program.exists()


def test_a_product_on_standard_output_stands_there_alone(capsys, log, found):
    found(each_verdict()["ambiguous"])
    status, out, err = run(capsys, "diagnose", log, "-m", MILL, "--next", "-")
    assert (status, out) == (0, LADDER.program)
    assert err.startswith("This log cannot separate")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("LOG",), "Missing option '-m' / '--machine'; see ph-post diagnose --help"),
        (("LOG", "-m", "mill", "--side", "X"), "expected AXIS=SIDE, such as X=unknown; got 'X'"),
        (("LOG", "-m", "mill", "--side", "X=table", "--side", "X=motor"), "one side an axis; got two for X"),
        (("-", "-m", "-"), "standard input can give one of them; got - for LOG and -m"),
        (("LOG", "-m", "mill", "-o", "-", "--json"), "output can take one product; got --json and -o"),
        (("LOG", "-m", "mill", "-o", "a", "--html", "a"), "a can take one product; got -o and --html"),
        (("LOG", "-m", "mill", "-o", "LOG"), "-o would write over LOG (LOG)"),
        (("LOG", "-m", "mill", "--plot", "a.gif"), "pictures come in other formats; expected .png"),
        (("LOG", "-m", "mill"), "LOG: no such file"),
    ],
)
def test_bad_usage_is_one_line_and_exit_2(capsys, monkeypatch, tmp_path, given, said):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, "diagnose", *given)
    assert (status, out) == (2, "")
    assert err.startswith("ph-post: ")
    assert said in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_bad_log_leaves_what_was_there(capsys, log, tmp_path):
    log.write_text("t,X_cmd,X_act\n0,0,0\n0.001,one,0\n")
    better = tmp_path / "better.toml"
    better.write_text("kept")
    status, out, err = run(capsys, "diagnose", log, "-m", MILL, "-o", better)
    assert (status, out) == (2, "")
    assert str(log) in err
    assert better.read_text() == "kept"
