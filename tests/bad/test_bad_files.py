"""Bad inputs and the exact line with which each is refused: ``NAME.error`` beside the input."""

from pathlib import Path

import pytest
from support.streams import without_progress

from ph_post.cli.main import main
from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.files.path import read_path

HERE = Path(__file__).parent
CIRCLE = HERE.parents[1] / "paths" / "circle.json"
READERS = {"paths": (read_path, ".json"), "machines": (read_machine, ".toml")}
CASES = sorted(case for folder in READERS for case in HERE.glob(f"{folder}/*.error"))


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.parent.name}/{case.stem}")
def test_a_bad_file_is_refused_in_its_one_line(case, monkeypatch):
    read, ending = READERS[case.parent.name]
    monkeypatch.chdir(case.parent)
    with pytest.raises(InputError) as refusal:
        read(case.stem + ending)
    assert f"{refusal.value}\n" == case.read_text(encoding="utf-8")


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.parent.name}/{case.stem}")
def test_the_command_says_that_line_writes_nothing_and_exits_with_2(case, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(case.parent)
    path, machine = str(CIRCLE), "paper"
    if case.parent.name == "paths":
        path = f"{case.stem}.json"
    else:
        machine = f"{case.stem}.toml"
    status = main(["convert", path, "-m", machine, "-o", str(tmp_path / "out.ngc")])
    streams = capsys.readouterr()
    assert (status, streams.out) == (2, "")
    assert without_progress(streams.err) == "ph-post: " + case.read_text(encoding="utf-8")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", READERS)
def test_every_bad_file_has_its_line(folder):
    inputs = {file.stem for file in (HERE / folder).glob(f"*{READERS[folder][1]}")}
    lines = {file.stem for file in (HERE / folder).glob("*.error")}
    assert inputs | {"no-such-file"} == lines
