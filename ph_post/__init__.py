"""Backlash compensation of CNC toolpaths by localized feedrate modulation.

The method is that of [1]_; docs/architecture.md follows one reversal through the package. Everything
listed in ``__all__`` is the public interface; it is loaded when it is first used.

References
----------
.. [1] "Real-time compensation of backlash positional errors in CNC machines by localized feedrate
   modulation", Int. J. Adv. Manuf. Technol. 119 (2022), doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from ph_post.api.checks import diff, rehearse, verify
    from ph_post.api.comparison import StrategyComparison, compare
    from ph_post.api.compensation import compensate, undo
    from ph_post.api.hand_measurements import measure
    from ph_post.api.inputs import read_log, read_machine, read_path, read_program
    from ph_post.api.interval_tables import sweep
    from ph_post.api.measurements import calibrate, diagnose, identify
    from ph_post.api.motion import Inspection, Simulation, inspect, simulate
    from ph_post.api.outcomes import Compensation
    from ph_post.batch.run import batch as batch
    from ph_post.diff.compare import Comparison
    from ph_post.errors import InputError, PhPostError
    from ph_post.gcode.program import PartProgram
    from ph_post.types import Log, Machine, Path
    from ph_post.types.diagnosis import Diagnosis
    from ph_post.verify.verdict import Verdict

__all__ = [
    "Comparison",
    "Compensation",
    "Diagnosis",
    "InputError",
    "Inspection",
    "Log",
    "Machine",
    "PartProgram",
    "Path",
    "PhPostError",
    "Simulation",
    "StrategyComparison",
    "Verdict",
    "calibrate",
    "compare",
    "compensate",
    "diagnose",
    "diff",
    "identify",
    "inspect",
    "measure",
    "read_log",
    "read_machine",
    "read_path",
    "read_program",
    "rehearse",
    "simulate",
    "sweep",
    "undo",
    "verify",
]

_HOMES: Final = {
    "api.checks": ("diff", "rehearse", "verify"),
    "api.comparison": ("StrategyComparison", "compare"),
    "api.compensation": ("compensate", "undo"),
    "api.hand_measurements": ("measure",),
    "api.inputs": ("read_log", "read_machine", "read_path", "read_program"),
    "api.interval_tables": ("sweep",),
    "api.measurements": ("calibrate", "diagnose", "identify"),
    "api.motion": ("Inspection", "Simulation", "inspect", "simulate"),
    "api.outcomes": ("Compensation",),
    "batch.run": ("batch",),
    "diff.compare": ("Comparison",),
    "errors": ("InputError", "PhPostError"),
    "gcode.program": ("PartProgram",),
    "types": ("Log", "Machine", "Path"),
    "types.diagnosis": ("Diagnosis",),
    "verify.verdict": ("Verdict",),
}
"""Public names by the module that holds them; `batch`, which starts processes, is called by its full name only."""

_PUBLIC: Final = frozenset(name for names in _HOMES.values() for name in names)


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names:
            return getattr(importlib.import_module(f"ph_post.{home}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _FrontDoor(ModuleType):
    """A package whose public functions keep their names where a room is called the same.

    Importing ``ph_post.simulate.assess`` sets the attribute `simulate` of its package to the room, in place of
    the function; rooms are imported by their full names, and need no attribute.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in _PUBLIC and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _FrontDoor
