"""Install FreeCAD's post-processor, and answer its questions about a job, in JSON.

Question: ``{"format": "ph-post-freecad", "version": 1, "tolerance": mm, "operations": [{"moves": [[name,
{letter: value}]], "curves": [{"degree", "knots", "points", "weights"}]}]}``, lengths in mm, F in mm/s, as in
FreeCAD. Answer: ``{"dialect", "post", "operations": [moves or null], "splines"}``; null where nothing changes.
"""

from __future__ import annotations

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from typing import Any, Final, Literal

import msgspec
import numpy as np

from ph_post.dialects.base import Dialect
from ph_post.dialects.registry import find_dialect
from ph_post.errors import InputError, PhPostError
from ph_post.files.storage import SourceText, make_folder, shipped, write_atomically
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.track import Track
from ph_post.post.spline_moves import cubic_track, trace_moves
from ph_post.post.tracing import Move
from ph_post.types import Machine
from ph_post.units import MM

POST: Final = "backlash_post"
"""The file's name without its ending; FreeCAD lists it without `_post` and makes a class `Backlash` of it."""

_MARK: Final = "macro folder: "
_ASK: Final = f"""import FreeCAD
group = FreeCAD.ParamGet("User parameter:BaseApp/Preferences/Macro")
print("{_MARK}" + group.GetString("MacroPath", FreeCAD.getUserMacroDir()))
"""
_COMMANDS: Final = ("freecadcmd", "FreeCADCmd", "freecad.cmd", "freecadcmd-daily")
_PATIENCE: Final = 60.0
"""Seconds that FreeCAD gets to say where its macros are; it takes about half a second."""

_VERSIONED: Final = "v*-*/Macro"
"""FreeCAD 1.1 and later keep a folder for each version."""


def macro_folders(environment: Mapping[str, str] = os.environ) -> list[pathlib.Path]:
    """Find the macro folders of this user's FreeCADs: the one that FreeCAD names, and those in the usual places.

    A usual place counts if the folder above it exists, which FreeCAD makes when it first runs.
    """
    usual = [root / "Macro" for root in _roots(environment) if root.is_dir()]
    versions = [found for root in _roots(environment) for found in sorted(root.glob(_VERSIONED))]
    said = _set_in_freecad(environment)
    return list(dict.fromkeys([*said, *versions, *usual]))


def _roots(environment: Mapping[str, str]) -> Iterator[pathlib.Path]:
    """FreeCAD's folders for a user's data, by system and kind of package."""
    home = pathlib.Path(environment.get("HOME") or pathlib.Path.home())
    if "APPDATA" in environment:
        yield pathlib.Path(environment["APPDATA"]) / "FreeCAD"
    yield home / "Library" / "Application Support" / "FreeCAD"
    yield pathlib.Path(environment.get("XDG_DATA_HOME") or home / ".local" / "share") / "FreeCAD"
    yield home / ".FreeCAD"
    for name in ("org.freecad.FreeCAD", "org.freecadweb.FreeCAD"):
        yield home / ".var" / "app" / name / "data" / "FreeCAD"
    yield home / "snap" / "freecad" / "common"


def _set_in_freecad(environment: Mapping[str, str]) -> list[pathlib.Path]:
    """Ask the FreeCAD on the path, if there is one, for its macro folder: the user may have set another."""
    command = next(filter(None, (shutil.which(c, path=environment.get("PATH")) for c in _COMMANDS)), None)
    if command is None:
        return []
    kept = {name: value for name, value in environment.items() if not name.startswith("PYTHON")}
    try:
        with tempfile.TemporaryDirectory() as folder:
            script = pathlib.Path(folder) / "ask.py"
            script.write_text(_ASK, encoding="utf-8")
            done = subprocess.run(  # noqa: S603 - found on the user's own path
                [command, os.fspath(script)],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                check=False,
                timeout=_PATIENCE,
                encoding="utf-8",
                errors="replace",
                env=kept,
            )
    except (OSError, subprocess.TimeoutExpired):
        return []
    found = re.search(f"{_MARK}(.+)", done.stdout)
    return [pathlib.Path(found.group(1).strip())] if found else []


def this_command() -> str:
    """Return the command line that starts this ph-post, for a program without it on its path."""
    beside = pathlib.Path(sys.executable).with_name("ph-post.exe" if os.name == "nt" else "ph-post")
    return os.fspath(beside) if beside.is_file() else f'"{sys.executable}" -m ph_post'


def install(folder: str | None = None) -> list[pathlib.Path]:
    """Write the post-processor into FreeCAD's macro folders, or into `folder`, and return the files.

    The copies hold the command that starts this ph-post.

    Raises
    ------
    InputError
        Where the folder does not exist, or no folder of FreeCAD's is found.
    """
    folders = macro_folders() if folder is None else [pathlib.Path(folder)]
    if not folders:
        raise InputError(
            "freecad --install",
            "no folder of FreeCAD's was found",
            expected="FreeCAD to have run once, or --folder FOLDER, where its Macro dialog shows the user's macros",
        )
    if folder is None:
        folders = [make_folder(os.fspath(one)) for one in folders]
    text = shipped("freecad", POST).read_text(encoding="utf-8")
    text = text.replace('INSTALLED = ""', f"INSTALLED = {this_command()!r}", 1)
    files = [one / f"{POST}.py" for one in folders]
    write_atomically({os.fspath(file): text for file in files})
    return files


POSTS: Final = {
    "fanuc": "fanuc",
    "grbl": "grbl",
    "grblhal": "grbl",
    "linuxcnc": "linuxcnc",
    "marlin": "marlin",
}
"""FreeCAD's own post-processor for each dialect. Users of Klipper, Siemens and Heidenhain name one; ISO
programs of Heidenhain cannot be compensated, whoever has posted them."""


class CurveRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A plane NURBS [mm]; one knot more than points and degree together."""

    degree: int
    knots: list[float]
    points: list[tuple[float, float]]
    weights: list[float] | None = None


class OperationRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An operation's moves, and the curves of its geometry."""

    moves: list[Move]
    curves: list[CurveRecord] = []


class JobRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A job of FreeCAD; `tolerance` [mm] is the largest distance of its straight moves from the curves."""

    format: Literal["ph-post-freecad"]
    version: Literal[1]
    tolerance: float
    operations: list[OperationRecord]


def read_job(source: SourceText) -> JobRecord:
    """Read a job as FreeCAD's post-processor gives it.

    Raises
    ------
    InputError
        Where the text is no JSON, or not of this format.
    """
    try:
        return msgspec.json.decode(source.text, type=JobRecord)
    except msgspec.DecodeError as error:
        raise InputError(source.name, "not a job of FreeCAD's post-processor", got=str(error)) from None


def answer(job: JobRecord, machine: Machine) -> dict[str, Any]:
    """Return the answer to FreeCAD's post-processor, in the format that the module describes."""
    dialect = find_dialect(machine.dialect)
    traced = [_traced(operation, dialect, machine, job.tolerance * MM) for operation in job.operations]
    return {
        "dialect": dialect.name,
        "post": POSTS.get(dialect.name.partition("+")[0]),
        "operations": [moves for moves, _ in traced],
        "splines": sum(count for _, count in traced),
    }


def _traced(
    operation: OperationRecord, dialect: Dialect, machine: Machine, tolerance: float
) -> tuple[list[Move] | None, int]:
    tracks = [track for curve in operation.curves if (track := _track(curve)) is not None]
    moves, count = trace_moves(operation.moves, tracks, dialect, machine.servo_period, tolerance)
    return (moves if count else None), count


def _track(curve: CurveRecord) -> Track | None:
    """Return the curve as cubics, None where it is degenerate: its moves then stay straight."""
    try:
        return cubic_track(Nurbs(curve.degree, curve.knots, np.array(curve.points) * MM, weights=curve.weights))
    except PhPostError:
        return None
