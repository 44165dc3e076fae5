"""Where `convert` puts a program: beside the original, in its place, with a backup that is never lost."""

from pathlib import Path

import click
import pytest

from ph_post.cli.outputs import Target, choose_target, products_of
from ph_post.errors import InputError

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
