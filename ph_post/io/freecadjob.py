"""What FreeCAD's post-processor asks and is told: moves and curves of a job's operations, in JSON.

Asked: ``{"format": "ph-post-freecad", "version": 1, "tolerance": mm, "operations": [{"moves": [[name,
{letter: value}]], "curves": [{"degree", "knots", "points", "weights"}]}]}``, lengths in mm, F in mm/s, as in
FreeCAD. Told: ``{"dialect", "post", "operations": [moves or null], "splines"}``; null where nothing changes.
"""

from __future__ import annotations

from typing import Any, Final, Literal

import msgspec
import numpy as np

from ph_post.errors import InputError, PhPostError
from ph_post.gcode.dialect import Dialect, require_spliceable
from ph_post.gcode.registry import find_dialect
from ph_post.gcode.tracing.cubics import cubic_track
from ph_post.gcode.tracing.record import Move
from ph_post.gcode.tracing.write import trace_moves
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.track import Track
from ph_post.io.source import Source
from ph_post.types import Machine
from ph_post.units import MM

POSTS: Final = {
    "fanuc": "fanuc",
    "grbl": "grbl",
    "grblhal": "grbl",
    "linuxcnc": "linuxcnc",
    "marlin": "marlin",
}
"""FreeCAD's own post-processor for each dialect. It has none for Klipper, and users of that name one; the
programs of Siemens and Heidenhain cannot be compensated, whoever has posted them."""


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
    """A job. `tolerance` [mm] is how far its straight moves may be from the curves."""

    format: Literal["ph-post-freecad"]
    version: Literal[1]
    tolerance: float
    operations: list[OperationRecord]


def read_job(source: Source) -> JobRecord:
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
    """Return what FreeCAD's post-processor is told: see the module.

    Raises
    ------
    InputError
        Where programs of the machine's dialect cannot be compensated.
    """
    dialect = find_dialect(machine.dialect)
    require_spliceable(dialect, machine.name)
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
        return cubic_track(
            Nurbs(curve.degree, curve.knots, np.array(curve.points) * MM, weights=curve.weights)
        )
    except PhPostError:
        return None
