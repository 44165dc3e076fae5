"""Every shell line and every Python snippet of README and docs runs, in the order of its document."""

from __future__ import annotations

import io
import re
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from ph_post.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "samples"
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

PROVIDED = {
    "part.ngc": SAMPLES / "programs" / "pocket.ngc",
    "part.json": ROOT / "paths" / "oval.json",
    "part.dxf": next((SAMPLES / "drawings").glob("*.dxf")),
    "mill.toml": SAMPLES / "machines" / "router.toml",
    "router.toml": SAMPLES / "machines" / "router.toml",
}
"""What a reader has: file names of the documents, and what stands for them here."""

LOG = SAMPLES / "logs" / "worn_router.csv"
RECORD = b"".join(LOG.read_bytes().splitlines(keepends=True)[:2600])
"""What stands for run.csv and for the shipped record: its first moves. `samples/` is tested with the whole of it."""

STATUS = {"diff": 1, "verify": 0}
"""Exit status of commands that end with another than 0: compensated programs differ from their originals."""


SEARCHING = ("convert", "simulate", "compare", "report")
"""Commands that search, for as long as they are told to."""


def blocks(document: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", document.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def shell_lines(document: Path) -> list[str]:
    joined = [block.replace("\\\n", " ") for block in blocks(document, "sh")]
    return [line for block in joined for line in block.splitlines() if line.strip()]


WITH_SHELL = [document for document in DOCUMENTS if document.name != "cli.md" and shell_lines(document)]
WITH_PYTHON = [document for document in DOCUMENTS if blocks(document, "python")]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with what a reader has, as the current one, and as home."""
    for name, file in PROVIDED.items():
        shutil.copy(file, tmp_path / name)
    (tmp_path / "run.csv").write_bytes(RECORD)
    (tmp_path / "paths").symlink_to(ROOT / "paths")
    (tmp_path / "samples" / "logs").mkdir(parents=True)
    (tmp_path / "samples" / "logs" / LOG.name).write_bytes(RECORD)
    for file in SAMPLES.iterdir():
        if file.name != "logs":
            (tmp_path / "samples" / file.name).symlink_to(file)
    (tmp_path / "from_cam").mkdir()
    shutil.copy(PROVIDED["part.ngc"], tmp_path / "from_cam")
    for folder, file in (("logs", "run.csv"), ("machines", "router.toml")):
        (tmp_path / folder).mkdir()
        shutil.copy(tmp_path / file, tmp_path / folder / f"lathe{Path(file).suffix}")
    for snippet in blocks(ROOT / "docs" / "tutorial-curve.md", "json"):
        (tmp_path / "arch.json").write_text(snippet, encoding="utf-8")
    (tmp_path / ".local" / "share" / "FreeCAD").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path


def run(line: str, monkeypatch: pytest.MonkeyPatch) -> int:
    """Run a shell line that calls ``ph-post``, with little search; questions are answered by their defaults."""
    words = shlex.split(line, comments=True)
    assert words[0] == "ph-post", line
    if words[1] in SEARCHING and not {"--undo", "--effort"}.intersection(words):
        words += ["--effort", "0.01"]
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"\n" * 40)))
    return main(words[1:])


@pytest.mark.slow
@pytest.mark.parametrize("document", WITH_SHELL, ids=lambda file: file.name)
def test_shell_lines_run(document: Path, desk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for line in shell_lines(document):
        if line.startswith("python3 -m venv"):
            continue  # .ci/run runs it
        assert run(line, monkeypatch) == STATUS.get(line.split()[1], 0), line


@pytest.mark.slow
@pytest.mark.parametrize("document", WITH_PYTHON, ids=lambda file: file.name)
def test_python_snippets_run(document: Path, desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for snippet in blocks(document, "python"):
        exec(compile(snippet, document.name, "exec"), {})
    assert capsys.readouterr().out
