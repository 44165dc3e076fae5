"""Compile what most programs need while the package is built, so that the first program does not wait for it.

No C compiler is needed: numba compiles, as it would when a program first asks for it. The code is for this kind of
processor, this Python and this numba; where another is found it is not used, and what is needed is compiled there.
"""

from __future__ import annotations

import compileall
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

COMMANDS = (
    "convert samples/programs/pocket.ngc -m samples/machines/router.toml -o -",
    "convert samples/programs/pocket_grbl.ngc -m samples/machines/stepper.toml -o -",
    "convert paths/circle.json -m samples/machines/mill.toml -o -",
)
"""Commands that use what most programs need; where two need the same code, one waits for the other."""

LONGEST = 600
"""Time [s] after which an installation goes on without."""


class CompilingHook(BuildHookInterface[Any]):
    """Puts compiled code into the wheel, or beside the sources where these are installed as they are."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Run the commands on a copy of the package, or on the package itself for an editable installation."""
        self.folder = Path(tempfile.mkdtemp(prefix="ph-post-build-"))
        if version == "editable":
            # Sources read anew are half of a start; other installations get bytecode from pip.
            compileall.compile_dir(str(Path(self.root, "ph_post")), quiet=2)
            self.compile_in(Path(self.root))
            return
        without = shutil.ignore_patterns("__pycache__")
        shutil.copytree(Path(self.root, "ph_post"), self.folder / "ph_post", ignore=without)
        self.compile_in(self.folder)
        for file in self.folder.rglob("*.nb[ic]"):
            build_data["force_include"][str(file)] = str(file.relative_to(self.folder))

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove the copy."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def compile_in(self, place: Path) -> None:
        """Run the commands with the package in a folder; what goes wrong is told, and nothing else."""
        environment = {key: value for key, value in os.environ.items() if not key.startswith("NUMBA_")}
        environment["PYTHONPATH"] = os.pathsep.join([str(place), *sys.path])

        def run(command: str) -> str:
            words = [sys.executable, "-P", "-m", "ph_post", *command.split()]  # -P: this package, and not that of `cwd`
            try:
                subprocess.run(  # noqa: S603 - our own commands
                    words, cwd=self.root, env=environment, capture_output=True, text=True, check=True, timeout=LONGEST
                )
            except (OSError, subprocess.SubprocessError) as error:
                return f"{error} {getattr(error, 'stderr', '')}"
            return ""

        with ThreadPoolExecutor() as side_by_side:
            for trouble in filter(None, side_by_side.map(run, COMMANDS)):
                self.app.display_warning(f"not all code is compiled in advance, programs will wait for it: {trouble}")
