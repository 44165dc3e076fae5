"""Bad drawings and the exact line with which each is refused: ``NAME-dxf.error`` beside ``NAME.dxf``."""

from pathlib import Path

import pytest
from support.streams import without_progress

from ph_post.cli.main import main

HERE = Path(__file__).parent / "drawings"
DRAWINGS = sorted(file for file in HERE.iterdir() if file.suffix != ".error")


def line_of(drawing):
    return drawing.with_name(f"{drawing.stem}-{drawing.suffix[1:]}.error")


@pytest.mark.parametrize("drawing", DRAWINGS, ids=lambda drawing: drawing.name)
def test_a_bad_drawing_is_refused_in_its_one_line(drawing, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(HERE)
    assert main(["import", drawing.name, "-o", str(tmp_path / "out.json")]) == 2
    streams = capsys.readouterr()
    assert streams.out == ""
    assert without_progress(streams.err) == "ph-post: " + line_of(drawing).read_text(encoding="utf-8")
    assert list(tmp_path.iterdir()) == []


def test_every_bad_drawing_has_its_line():
    assert {line_of(drawing) for drawing in DRAWINGS} == set(HERE.glob("*.error"))
