"""Readings by hand that cannot be, or contradict each other, and the exact line with which each is refused."""

import time
from pathlib import Path

import pytest
from support.streams import without_progress

from ph_post.cli.main import main

HERE = Path(__file__).parent / "readings"
CASES = sorted(HERE.glob("*.error"))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_bad_readings_are_refused_in_their_one_line(case, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(HERE)
    (file,) = (place.name for place in HERE.glob(f"{case.stem}.*") if place != case)
    given = ["--ball-bar", file] if file.endswith(".csv") else [file]
    out = tmp_path / "out.toml"
    assert main(["machine", "measure", *given, "-m", "stepper", "-o", str(out)]) == 2
    assert without_progress(capsys.readouterr().err) == "ph-post: " + case.read_text(encoding="utf-8")
    assert not out.exists()


def test_all_of_them_have_their_line():
    files = {file.stem for file in HERE.iterdir() if file.suffix != ".error"}
    assert files == {case.stem for case in CASES}


def test_a_file_of_brackets_or_blank_lines_is_refused_soon(capsys, tmp_path):
    # Patterns went through them from each place on: 100,000 brackets took 45 s.
    file = tmp_path / "readings.toml"
    for text in ("[" * 100_000, "\n" * 100_000 + "x"):
        file.write_text(text)
        begin = time.process_time()
        assert main(["machine", "measure", str(file), "-m", "stepper"]) == 2
        assert time.process_time() - begin < 5.0
        assert "not a file of readings" in capsys.readouterr().err
