"""Where the post-processor goes, and what is written there."""

from __future__ import annotations

import importlib.util
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from support.stub_freecad import load_post

from ph_post.api import freecad as module
from ph_post.api.freecad import install, macro_folders, this_command
from ph_post.cli.main import main
from ph_post.errors import InputError


def test_all_usual_places_where_freecad_has_been_are_found(tmp_path):
    data, flatpak = tmp_path / "data" / "FreeCAD", tmp_path / ".var/app/org.freecad.FreeCAD/data/FreeCAD"
    (data / "v1-1" / "Macro").mkdir(parents=True)
    flatpak.mkdir(parents=True)
    found = macro_folders({"HOME": str(tmp_path), "XDG_DATA_HOME": str(tmp_path / "data"), "PATH": ""})
    assert found == [data / "v1-1" / "Macro", data / "Macro", flatpak / "Macro"]


def test_windows_has_its_own_place(tmp_path):
    (tmp_path / "Roaming" / "FreeCAD").mkdir(parents=True)
    found = macro_folders({"HOME": str(tmp_path), "APPDATA": str(tmp_path / "Roaming"), "PATH": ""})
    assert found == [tmp_path / "Roaming" / "FreeCAD" / "Macro"]


@pytest.mark.parametrize(("says", "found"), [("macro folder: {}/set by hand", 1), ("", 0)])
def test_what_freecad_says_itself_comes_first(says, found, tmp_path):
    command = tmp_path / "freecadcmd"
    command.write_text(f"#!/bin/sh\necho FreeCAD 0.20\necho '{says.format(tmp_path)}'\n")
    command.chmod(0o755)
    folders = macro_folders({"HOME": str(tmp_path / "none"), "PATH": f"{tmp_path}:/bin:/usr/bin"})
    assert folders == [tmp_path / "set by hand"] * found


def test_the_copy_knows_where_ph_post_is(tmp_path, monkeypatch):
    original, _ = load_post(monkeypatch, "0.20")
    (file,) = install(str(tmp_path))
    assert file == tmp_path / "backlash_post.py"
    spec = importlib.util.spec_from_file_location("backlash_post", file)
    copy = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(copy)
    assert not original.INSTALLED
    assert this_command() == copy.INSTALLED
    before, after = Path(original.__file__).read_text(), file.read_text()
    changed = [pair for pair in zip(before.splitlines(), after.splitlines(), strict=True) if pair[0] != pair[1]]
    assert len(changed) == 1


def test_the_command_that_is_noted_starts_ph_post(monkeypatch, tmp_path):
    monkeypatch.setattr(sys, "executable", str(tmp_path / "a venv" / "python"))
    assert this_command() == f'"{tmp_path}/a venv/python" -m ph_post'
    monkeypatch.undo()
    words = [this_command()] if Path(this_command()).exists() else shlex.split(this_command())
    assert subprocess.run([*words, "--version"], capture_output=True, check=False).stdout.startswith(b"ph-post")


def test_all_folders_of_freecads_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "macro_folders", lambda: [tmp_path / "v1-1" / "Macro", tmp_path / "Macro"])
    files = install()
    assert [file.relative_to(tmp_path).as_posix() for file in files] == [
        "v1-1/Macro/backlash_post.py",
        "Macro/backlash_post.py",
    ]
    assert all(file.is_file() for file in files)


def test_no_freecad_is_told_with_what_to_do(monkeypatch):
    monkeypatch.setattr(module, "macro_folders", list)
    with pytest.raises(InputError, match="no folder of FreeCAD's was found; expected FreeCAD to have run once, or"):
        install()


def test_a_folder_that_is_not_there_is_told(tmp_path):
    with pytest.raises(InputError, match=r"cannot be written; expected an existing folder"):
        install(str(tmp_path / "none"))


def test_the_command_installs_or_says_where_the_file_is(tmp_path, capsys):
    assert main(["freecad", "--install", "--folder", str(tmp_path)]) == 0
    assert (tmp_path / "backlash_post.py").is_file()
    assert "processor backlash, arguments --machine=FILE.toml" in capsys.readouterr().err
    assert main(["freecad"]) == 0
    assert Path(capsys.readouterr().out.strip()).name == "backlash_post.py"


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--folder", "x"], "ph-post: --folder goes with --install; see ph-post freecad --help"),
        (["--trace", "x"], "ph-post: Missing option '-m' / '--machine'; see ph-post freecad --help"),
    ],
)
def test_bad_usage_is_one_line(words, line, capsys):
    assert main(["freecad", *words]) == 2
    assert capsys.readouterr().err.strip() == line
