"""Where `convert` puts a program: beside the original, in its place, with a backup that is never lost."""

import shlex
import shutil
from pathlib import Path

import click
import pytest

from ph_post.cli.main import main
from ph_post.cli.outputs import Target, choose_target, products_of
from ph_post.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
NOTHING = {"output": None, "suffix": None, "in_place": False, "backup": None}


@pytest.mark.parametrize(
    ("given", "target"),
    [
        ({}, None),
        ({"output": "-"}, Target(program="-")),
        ({"output": "out.ngc"}, Target(program="out.ngc")),
        ({"suffix": "_bl"}, Target(program=str(Path("jobs") / "part_bl.ngc"))),
        ({"in_place": True}, Target(program="jobs/part.ngc")),
        ({"in_place": True, "backup": ".old"}, Target(program="jobs/part.ngc", backup="jobs/part.ngc.old")),
    ],
)
def test_the_place_follows_from_the_options(given, target):
    assert choose_target("jobs/part.ngc", {**NOTHING, **given}) == target


@pytest.mark.parametrize(
    ("source", "given", "said"),
    [
        ("part.ngc", {"output": "a", "in_place": True}, "got -o and --in-place"),
        ("part.ngc", {"suffix": "a", "in_place": True}, "got --suffix and --in-place"),
        ("part.ngc", {"output": "a", "backup": ".bak"}, "--backup is for --in-place"),
        ("-", {"in_place": True}, "--in-place needs a file"),
        ("-", {"suffix": "_bl"}, "--suffix needs a file"),
        ("part.ngc", {"output": ""}, "-o needs the name of a file"),
        ("part.ngc", {"suffix": ""}, "--suffix needs an end for the file's name; got ''"),
        ("part.ngc", {"suffix": "/../x"}, "--suffix needs an end for the file's name"),
    ],
)
def test_what_contradicts_itself_is_refused(source, given, said):
    with pytest.raises(click.UsageError, match=said):
        choose_target(source, {**NOTHING, **given})


def test_a_backup_keeps_what_is_replaced(tmp_path):
    target = Target(program=str(tmp_path / "a.ngc"), backup=str(tmp_path / "a.ngc.bak"))
    kept = products_of(target, b"new", b"old")
    assert kept == {target.program: b"new", target.backup: b"old"}
    # A run killed between the two leaves the original twice, never not at all.
    assert list(kept) == [target.backup, target.program]


def test_where_nothing_changes_an_older_backup_stays(tmp_path):
    place = tmp_path / "a.ngc.bak"
    place.write_bytes(b"the only original")
    target = Target(program=str(tmp_path / "a.ngc"), backup=str(place))
    assert products_of(target, b"compensated", b"compensated") == {target.program: b"compensated"}


def test_a_backup_never_overwrites_another(tmp_path):
    place = tmp_path / "a.ngc.bak"
    place.write_bytes(b"the only original")
    target = Target(program=str(tmp_path / "a.ngc"), backup=str(place))
    with pytest.raises(InputError, match="holds something else"):
        products_of(target, b"new", b"compensated before")
    assert products_of(target, b"new", b"the only original")[str(place)] == b"the only original"


@pytest.mark.parametrize(
    ("command", "option"),
    [
        ("convert part.ngc -m m.toml -o m.toml", "-m"),
        ("convert part.ngc -m stepper -o t.tbl --expand --tool-table t.tbl", "--tool-table"),
        ("convert part.ngc -m stepper -o t.tbl --expand --parameters t.tbl", "--parameters"),
        ("convert oval.json -m mill --table oval.csv --interval-table oval.csv", "--interval-table"),
        ("convert oval.json -m m.toml -o ./m.toml", "-m"),
        ("simulate oval.json -m m.toml --log m.toml", "-m"),
        ("simulate table.csv -m mill --path oval.json --log oval.json", "--path"),
        ("report part.ngc -m m.toml -o m.toml", "-m"),
        ("diff part.ngc part.ngc -m m.toml --html m.toml", "-m"),
        ("sweep oval.json -m mill --beta 1 --gain 1e7 -o oval.json", "IN"),
        ("sweep -m m.toml --beta 1 --gain 1e7 -o m.toml", "-m"),
        ("diagnose log.csv -m m.toml --html m.toml", "-m"),
        ("machine measure r.toml -m m.toml --force -o r.toml", "READINGS"),
        ("machine measure -m m.toml --ball-bar a.csv --ball-bar log.csv --force -o log.csv", "--ball-bar log.csv"),
    ],
)
def test_nothing_is_written_over_what_is_read(command, option, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "samples" / "machines" / "stepper.toml", "m.toml")
    shutil.copy(ROOT / "paths" / "oval.json", "oval.json")
    for name in ("part.ngc", "t.tbl", "table.csv", "oval.csv", "log.csv", "a.csv", "r.toml"):
        Path(name).write_text("G21 G90\nG1 X1 F100\nM2\n")
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    assert main(shlex.split(command)) == 2
    said = capsys.readouterr()
    assert (said.out, said.err.count("\n")) == ("", 1)
    assert f" would write over {option} (" in said.err
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before
