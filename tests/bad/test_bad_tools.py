"""Programs of another tool than the machine's, and the exact line with which each is refused."""

from pathlib import Path

import pytest
from support.streams import without_progress

from ph_post.cli.main import main

HERE = Path(__file__).parent / "tools"
CASES = sorted(HERE.glob("*.error"))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_a_program_of_another_tool_is_refused_in_its_one_line(case, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(HERE)
    out = tmp_path / "out.gcode"
    assert main(["convert", f"{case.stem}.gcode", "-m", f"{case.stem}.toml", "-o", str(out)]) == 2
    assert without_progress(capsys.readouterr().err) == "ph-post: " + case.read_text(encoding="utf-8")
    assert not out.exists()


def test_every_such_program_has_its_line():
    names = {file.stem for file in HERE.iterdir()}
    assert {case.stem for case in CASES} == names
