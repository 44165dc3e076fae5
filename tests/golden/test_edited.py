"""Compensated programs, byte by byte: the original of each folder of tests/edited gives its other program.

After a change that is meant, ``pytest tests/golden/test_edited.py --renew-golden`` writes them anew;
read the difference line by line before committing it.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
from support.canonical import canonical_calls
from support.editing import compensate

from ph_post.drive.machinefile import read_machine
from ph_post.edit import write
from ph_post.edit.undo import undo

EDITED = Path(__file__).resolve().parents[1] / "edited"
CASES = sorted(folder for folder in EDITED.iterdir() if folder.is_dir())
RS274 = shutil.which("rs274")


@pytest.mark.parametrize("case", CASES, ids=lambda folder: folder.name)
def test_program_is_as_it_was(case: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(write, "package_version", lambda: "VERSION")
    machine = read_machine(str(EDITED / "machine.toml"))
    found = compensate((case / "original.ngc").read_bytes(), machine).text
    expected = case / "compensated.ngc"
    if request.config.getoption("--renew-golden"):
        expected.write_bytes(found)
    # What is packed for the way back may differ with the version of zlib.
    assert _without_undo(found) == _without_undo(expected.read_bytes())


@pytest.mark.parametrize("case", CASES, ids=lambda folder: folder.name)
def test_the_way_back(case: Path) -> None:
    text = (case / "compensated.ngc").read_bytes()
    assert undo(text, case.name) == (case / "original.ngc").read_bytes()


@pytest.mark.skipif(RS274 is None, reason="LinuxCNC's interpreter rs274 is not installed")
@pytest.mark.parametrize("case", CASES, ids=lambda folder: folder.name)
def test_linuxcnc_s_interpreter_finds_nothing_else_changed(case: Path, tmp_path: Path) -> None:
    before = canonical_calls((case / "original.ngc").read_bytes(), tmp_path)
    after = canonical_calls((case / "compensated.ngc").read_bytes(), tmp_path)
    assert before is not None
    assert after is not None
    assert after.others == before.others


def _without_undo(text: bytes) -> bytes:
    return re.sub(rb"\(ph-post: undo [^)]*\)\r?\n", b"", text)
