"""Whole programs, byte by byte: path, machine and arguments of each folder of tests/golden give its program.

A folder without a machine of its own takes that of all the others.

After a change that is meant, ``pytest tests/golden/test_golden.py --renew-golden`` writes them anew; read
the difference line by line before committing it.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from support.firmware import travel
from support.interpreter import run
from support.languages import run_fanuc, run_klartext, run_tnc_iso
from support.sinumerik import read_blocks

from ph_post.cli.main import main
from ph_post.edit import write
from ph_post.post import remarks

GOLDEN = Path(__file__).resolve().parents[1] / "golden"
CASES = sorted(file.parent for file in GOLDEN.glob("*/arguments.txt"))
LANGUAGES = {"fanuc": run_fanuc, "heidenhain": run_klartext, "iso": run_tnc_iso}
"""Interpreters of other languages, by the end of a case's name."""
OTHERS = [folder for folder in CASES if folder.name.endswith(("_marlin", "_klipper", "_siemens", *LANGUAGES))]
"""Programs in other words than RS274's."""
RS274 = shutil.which("rs274")


@pytest.mark.parametrize("case", CASES, ids=lambda folder: folder.name)
@pytest.mark.thinned(12)
def test_program_is_as_it_was(
    case: Path, tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (remarks, write):
        monkeypatch.setattr(module, "package_version", lambda: "VERSION")
    output = tmp_path / "program.ngc"
    arguments = (case / "arguments.txt").read_text().split()
    own = case / "machine.toml"
    machine = own if own.exists() else GOLDEN / "machine.toml"
    files = [str(case / "path.json"), "-m", str(machine), "-o", str(output)]
    assert main(["convert", *files, *arguments]) == 0
    expected = case / "program.ngc"
    if request.config.getoption("--renew-golden"):
        expected.write_bytes(output.read_bytes())
    assert output.read_bytes() == expected.read_bytes()


@pytest.mark.parametrize("case", CASES, ids=lambda folder: folder.name)
def test_program_can_be_read(case: Path) -> None:
    firmware = case.name.rsplit("_", 1)[-1]
    if firmware in LANGUAGES:
        assert LANGUAGES[firmware]((case / "program.ngc").read_text()).run.moves
        return
    if firmware == "siemens":
        assert list(read_blocks((case / "program.ngc").read_text()))
        return
    if case in OTHERS:
        assert travel((case / "program.ngc").read_text(), firmware).feeds
        return
    grbl = "grbl" in (case / "arguments.txt").read_text()
    result = run((case / "program.ngc").read_text(), max_line=70 if grbl else 255)
    assert result.ended


@pytest.mark.skipif(RS274 is None, reason="LinuxCNC's interpreter rs274 is not installed")
@pytest.mark.parametrize("case", [one for one in CASES if one not in OTHERS], ids=lambda folder: folder.name)
def test_linuxcnc_s_interpreter_takes_it(case: Path, tmp_path: Path) -> None:
    command = [str(RS274), "-v", str(tmp_path / "rs274.var"), "-g", str(case / "program.ngc")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path, timeout=60)
    assert done.returncode == 0, done.stderr[-500:] + done.stdout[-500:]
    assert "PROGRAM_END" in done.stdout
