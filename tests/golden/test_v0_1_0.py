"""Files that version 0.1.0 wrote: each folder of tests/golden/v0_1_0 holds a program before and after, and its machine.

They are never written anew. The comments of a compensated program are a file format: whatever words later
versions write, these programs can be undone, verified and compensated again.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from support.streams import without_progress

from ph_post.api import programs
from ph_post.cli.main import main
from ph_post.dialects.declaration import read_declaration
from ph_post.drive.machinefile import read_machine
from ph_post.units import MM

WRITTEN = Path(__file__).parent / "v0_1_0"
CASES = sorted(folder for folder in WRITTEN.iterdir() if folder.is_dir())
OPTIONS = {"dips": ("--strategy", "suppress", "--max-slowdown", "5")}
"""Options of the case, where they are not those of the others."""

of_each = pytest.mark.parametrize("case", CASES, ids=lambda folder: folder.name)


def convert(case: Path, program: Path, output: Path, *more: str) -> int:
    options = OPTIONS.get(case.name, ("--max-slowdown", "5"))
    machine = ("-m", str(case / "machine.toml"))
    return main(["convert", str(program), *machine, "-o", str(output), "--no-simulation", *options, *more])


@of_each
def test_it_can_be_undone_to_the_byte(case: Path, tmp_path: Path) -> None:
    back = tmp_path / "back.ngc"
    assert main(["convert", str(case / "compensated.ngc"), "--undo", "-o", str(back)]) == 0
    assert back.read_bytes() == (case / "original.ngc").read_bytes()


@of_each
def test_it_passes_the_check(case: Path) -> None:
    files = [str(case / "original.ngc"), str(case / "compensated.ngc")]
    assert main(["verify", *files, "-m", str(case / "machine.toml")]) == 0


@of_each
def test_a_second_run_asks_for_force_and_begins_again_from_the_original(
    case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(programs, "package_version", lambda: "0.2.0")
    again, direct = tmp_path / "again.ngc", tmp_path / "direct.ngc"
    assert convert(case, case / "compensated.ngc", again) == 2
    assert "compensated before, by ph-post 0.1.0 for " in without_progress(capsys.readouterr().err)
    assert not again.exists()
    assert convert(case, case / "compensated.ngc", again, "--force") == 0
    assert convert(case, case / "original.ngc", direct) == 0
    assert again.read_bytes() == direct.read_bytes()


def test_its_declaration_is_read() -> None:
    found = read_declaration((WRITTEN / "fanuc" / "compensated.ngc").read_bytes())
    assert found is not None
    assert (found.version, found.machine, found.stops, found.dips) == ("0.1.0", "A ROUTER WITH WORN SCREWS", 5, 0)
    assert found.offset == pytest.approx({"X": 0.025 * MM, "Y": 0.02 * MM})
    assert found.pulse == pytest.approx({"X": 0.075 * MM, "Y": 0.06 * MM})


def test_the_machine_file_that_diagnose_wrote_is_read(tmp_path: Path) -> None:
    machine = read_machine(os.fspath(WRITTEN / "better.toml"))
    assert machine.axes["X"].gap.lost_motion == pytest.approx(0.1800091 * MM)
    assert [effect.name for effect in machine.axes["X"].effects] == ["coulomb_friction"]
    log = tmp_path / "run.csv"
    assert main(["simulate", "oval", "-m", str(WRITTEN / "better.toml"), "--log", str(log)]) == 0
    assert log.exists()
