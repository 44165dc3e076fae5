"""Programs compensated and rehearsed on the LinuxCNC installed here, each once."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

from ph_post.cli.main import main
from ph_post.drive.machinefile import read_machine
from ph_post.edit.undo import original_of
from ph_post.gcode.read import read_program
from ph_post.rehearse.linuxcnc import INSTALL, is_installed
from ph_post.rehearse.rehearse import Rehearsal, rehearse
from support.shop import PROGRAMS

MACHINES = Path(__file__).parents[1] / "controllers" / "machines"

HERE = is_installed()
WHY_NOT = f"LinuxCNC is not installed here ({INSTALL})"

EFFORT = "0.05"
"""Of the search: what is found is to be as good as promised, not the best there is."""


def machine_file(name: str) -> str:
    """Return a machine of these tests, else a shipped one."""
    place = MACHINES / f"{name}.toml"
    return str(place) if place.exists() else name


def compensated(program: str, machine: str) -> bytes:
    """Convert a program as a user does."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / f"{program}.ngc", Path(folder) / "out.ngc"
        source.write_text(PROGRAMS[program])
        words = ["convert", str(source), "-m", machine_file(machine), "-o", str(target), "--effort", EFFORT]
        assert main([*words, "--max-slowdown", "0.5"]) == 0
        return target.read_bytes()


@functools.cache
def rehearsed(program: str, machine: str) -> Rehearsal:
    """Rehearse a compensated program beside its original, also with LinuxCNC's own compensation."""
    part = read_program(compensated(program, machine), program)
    drives = read_machine(machine_file(machine))
    return rehearse(part, drives, original=original_of(part), backlash=True)
