"""Write interval tables as JSON, which ``convert --interval-table`` reads back, or as CSV."""

from __future__ import annotations

import math
import os
import pathlib
from itertools import pairwise
from typing import Any, Final, Literal

import msgspec
import numpy as np

from ph_post.drive.intervals import AxisTable, IntervalTable
from ph_post.errors import InputError
from ph_post.files.check import Keys, Refused, checked, loads, one_line, one_of, place
from ph_post.files.machine import NotNegative, Positive
from ph_post.files.storage import STDIO, read_source
from ph_post.types import MACHINE_AXES, Array, AxisName, ByAxis, Servo, frozen
from ph_post.units import MM, MM_PER_MIN

FORMATS: Final = (".json", ".csv")
"""Endings of interval tables; standard output is CSV."""

FORMAT: Final = "ph-post-interval-table"

Matrix = list[list[float | None]]


class _Record(msgspec.Struct, frozen=True, kw_only=True):
    """Base of the file's tables; keys that a later version adds are passed over."""


class _MachineRecord(_Record, frozen=True, kw_only=True):
    name: str
    digest: str


class _AxisRecord(_Record, frozen=True, kw_only=True):
    """What an axis' intervals hold for."""

    b: Positive
    c: Positive
    ki_over_kp_per_s: NotNegative
    kd_over_kp_s: NotNegative
    backlash_motor_rad: NotNegative


class _AxesRecord(ByAxis[_AxisRecord], frozen=True, kw_only=True, forbid_unknown_fields=False):
    """What the intervals hold for, by axis."""


class _TableRecord(_Record, frozen=True, kw_only=True):
    """One axis on one circle [mm, mm/min]; matrices have a row per β."""

    axis: AxisName
    radius: Positive
    feed: Positive
    duration: Matrix
    lag: Matrix
    position: Matrix


class _FileRecord(_Record, frozen=True, kw_only=True):
    format: Literal["ph-post-interval-table"]
    version: Literal[1]
    machine: _MachineRecord
    axes: _AxesRecord
    beta: list[NotNegative]
    C: list[Positive]
    tables: list[_TableRecord]


def interval_view(table: IntervalTable) -> dict[str, Any]:
    """Return a table as ``sweep --json`` prints it; `duration` is that of the first axis and circle."""
    tables = [view for axis in table.axes for view in _circle_views(table, axis)]
    return {
        "format": FORMAT,
        "version": 1,
        "machine": {"name": table.machine, "digest": table.digest},
        "axes": {axis.axis: _axis_view(axis) for axis in table.axes},
        "beta": table.beta.tolist(),
        "C": table.gain.tolist(),
        "duration": tables[0]["duration"],
        "tables": tables,
    }


def _axis_view(axis: AxisTable) -> dict[str, float]:
    return {
        "b": axis.servo.b,
        "c": axis.servo.c,
        "ki_over_kp_per_s": axis.servo.ki_over_kp,
        "kd_over_kp_s": axis.servo.kd_over_kp,
        "backlash_motor_rad": axis.motor_gap,
    }


def _circle_views(table: IntervalTable, axis: AxisTable) -> list[dict[str, Any]]:
    return [
        {
            "axis": axis.axis,
            "radius": radius / MM,
            "feed": feed / MM_PER_MIN,
            "duration": _nulled(axis.duration[i, j]),
            "lag": _nulled(axis.lag[i, j]),
            "position": _nulled(axis.position[i, j] / MM),
        }
        for i, radius in enumerate(table.radius.tolist())
        for j, feed in enumerate(table.feed.tolist())
    ]


def _nulled(matrix: Array) -> Matrix:
    return [[None if math.isnan(value) else value for value in row] for row in matrix.tolist()]


def interval_content(table: IntervalTable, target: str) -> str:
    """Return a table as text in the format that a file's name asks for; ``-`` is CSV.

    Raises
    ------
    InputError
        If the ending is none of :data:`FORMATS`.
    """
    ending = ".csv" if target == STDIO else pathlib.PurePath(target).suffix.lower()
    if ending not in FORMATS:
        raise InputError(target, "unknown kind of interval table", expected=one_of(FORMATS), got=repr(ending))
    return _csv(table) if ending == ".csv" else _json(table)


def _json(table: IntervalTable) -> str:
    return msgspec.json.format(msgspec.json.encode(interval_view(table)), indent=1).decode() + "\n"


def _csv(table: IntervalTable) -> str:
    """Write a row per axis, circle, β and C; empty where there is no interval."""
    lines = [f"# machine: {table.machine}, {table.digest}"]
    for axis in table.axes:
        constants = ", ".join(f"{key} {value!r}" for key, value in _axis_view(axis).items())
        lines.append(f"# axis {axis.axis}: {constants}")
    lines.append("axis,radius_mm,feed_mm_min,beta_per_s,C_rad_per_m_s2,duration_s,lag_s,position_mm")
    for view in interval_view(table)["tables"]:
        for i, beta in enumerate(table.beta.tolist()):
            for j, gain in enumerate(table.gain.tolist()):
                where = (view["axis"], view["radius"], view["feed"], beta, gain)
                values = (view[key][i][j] for key in ("duration", "lag", "position"))
                lines.append(",".join("" if cell is None else str(cell) for cell in (*where, *values)))
    return "\n".join(lines) + "\n"


def read_intervals(source: str | os.PathLike[str]) -> IntervalTable:
    """Read an interval table in JSON; ``-`` is standard input.

    Raises
    ------
    InputError
        One line naming file, key, what was expected and what was found.
    """
    text = read_source(source)
    if pathlib.PurePath(text.name).suffix.lower() == ".csv":
        raise InputError(text.name, "CSV is for other programs", expected="JSON, as sweep -o TABLE.json writes")
    record = checked(loads(text.text, text.name, _double), _FileRecord, text.name)
    name = text.name
    grids = {"beta": record.beta, "C": record.C}
    for key, values in grids.items():
        _check_ascending(values, name, key)
    radius = sorted({table.radius for table in record.tables})
    feed = sorted({table.feed for table in record.tables})
    held = record.axes.given().items()
    axes = tuple(_read_axis(axis, own, record, radius, feed, name) for axis, own in held)
    if not axes:
        raise InputError(place(name, ("axes",)), "no axis", expected=f"at least one of {', '.join(MACHINE_AXES)}")
    return IntervalTable(
        machine=one_line(record.machine.name, name, ("machine", "name")),
        digest=one_line(record.machine.digest, name, ("machine", "digest")),
        beta=frozen(record.beta),
        gain=frozen(record.C),
        radius=frozen(np.array(radius) * MM),
        feed=frozen(np.array(feed) * MM_PER_MIN),
        axes=axes,
        name=name,
    )


def _double(text: str) -> float | Refused:
    value = float(text)
    return value if math.isfinite(value) else Refused("number out of range", "at most 1e308 in size", text)


def _check_ascending(values: list[float], name: str, key: str) -> None:
    if not values or any(b <= a for a, b in pairwise(values)):
        what = "the grid is not ascending" if values else "the grid is empty"
        raise InputError(place(name, (key,)), what, expected="at least one number, each above the one before")


def _read_axis(
    axis: str, own: _AxisRecord, record: _FileRecord, radius: list[float], feed: list[float], name: str
) -> AxisTable:
    """Lay an axis' circles out on the grid of all radii and feeds, every place of which must be held once."""
    shape = (len(radius), len(feed), len(record.beta), len(record.C))
    columns = np.full((3, *shape), np.nan)
    places: list[tuple[int, int]] = []
    for number, table in enumerate(record.tables):
        if table.axis != axis:
            continue
        where = (radius.index(table.radius), feed.index(table.feed))
        places.append(where)
        for index, key in enumerate(("lag", "duration", "position")):
            columns[(index, *where)] = _matrix(getattr(table, key), shape[2:], name, ("tables", number, key))
    if not places or len(set(places)) < len(places) or len(places) != len(radius) * len(feed):
        raise InputError(
            place(name, ("tables",)),
            f"the circles of axis {axis} do not fill the grid",
            expected=f"each of {len(radius)} radii at each of {len(feed)} feeds, once",
            got=str(len(places)),
        )
    return AxisTable(
        axis=axis,
        servo=Servo(b=own.b, c=own.c, ki_over_kp=own.ki_over_kp_per_s, kd_over_kp=own.kd_over_kp_s),
        motor_gap=own.backlash_motor_rad,
        lag=frozen(columns[0]),
        duration=frozen(columns[1]),
        position=frozen(columns[2] * MM),
    )


def _matrix(rows: Matrix, shape: tuple[int, ...], name: str, keys: Keys) -> Array:
    if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
        raise InputError(
            place(name, keys),
            "wrong count",
            expected=f"{shape[0]} rows (beta) of {shape[1]} (C)",
            got=f"{len(rows)} rows of {', '.join(sorted({str(len(row)) for row in rows}))}",
        )
    matrix = np.array([[math.nan if cell is None else cell for cell in row] for row in rows], dtype=np.float64)
    if keys[-1] == "duration" and np.any(matrix < 0.0):
        raise InputError(place(name, keys), "a duration is negative", expected="0 or more, or null")
    return matrix
