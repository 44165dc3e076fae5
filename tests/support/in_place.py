"""Programs in a language of their own, changed in place, beside interpreters and a play operator of the tests."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from ph_post.drive.machinefile import read_machine
from support.editing import compensate
from support.ideal_play import distances, table
from support.sinumerik_motions import Run
from support.tnc_motions import TncRun, iso_run

FOLDER = Path(__file__).parents[1] / "changed_dialects"
BACKLASH = {"X": 0.06, "Y": 0.08}
DEEP = -0.99
"""The tool cuts where it is lower [mm]."""


class InPlace:
    """A language: its dialect, the programs in it by name, their ending, and what runs one."""

    def __init__(self, dialect: str, ending: str, names: tuple[str, ...], run: Callable[[str], Any]) -> None:
        self.dialect, self.ending, self.run = dialect, ending, run
        self.programs = {name: (FOLDER / f"{name}{ending}").read_text() for name in names}
        self.machine = replace(read_machine("stepper"), dialect=dialect)
        self.changed = cache(self._changed)

    def compensate(self, text: bytes) -> Any:
        """Return what a program becomes."""
        return compensate(text, self.machine, dialect=self.dialect)

    def _changed(self, name: str) -> Any:
        return self.compensate(self.programs[name].encode())

    def away(self, text: str, original: Any, side: float) -> np.ndarray:
        """Distances [mm] of the table from the original's cuts while the tool cuts; the motors begin on one side."""
        run = self.run(text)
        places = table(run.path, BACKLASH, dict.fromkeys("XYZ", side))
        return distances(places[run.cutting & (run.path[:, 2] < DEEP)], original.path[original.cutting])


ISO = InPlace("heidenhain-iso", ".i", ("plate",), iso_run)
KLARTEXT = InPlace("heidenhain", ".h", ("plate", "pocket", "polar"), TncRun)
SIEMENS = InPlace("siemens", ".mpf", ("post", "hand", "steps"), Run)
