"""Read readings taken by hand: the file of ``calibrate --without-log``, single rows, and ball-bar files (CSV)."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Final, Literal

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.files.check import checked, counted, one_of, parse_toml, place, quoted
from ph_post.files.logsheet import Sheet
from ph_post.files.logtext import text_sheet
from ph_post.files.storage import decoded, read_raw, read_source
from ph_post.types import Array, AxisName
from ph_post.types.readings import CUTS, STEPS, BallBarTrace, CutWidths, DialRow, Readings
from ph_post.units import DEGREE, INCH, MICROMETRE, MM, MM_PER_MIN

UNITS: Final[Mapping[str, float]] = {"mm": MM, "um": MICROMETRE, "inch": INCH}
"""Units of readings [m]."""

SWING_MM: Final = 0.5
"""Swing where nobody says another [mm]."""

_Number = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
_Length = Annotated[float, msgspec.Meta(gt=0, le=1e4)]


class _DialRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    axis: AxisName
    place_mm: Annotated[float, msgspec.Meta(ge=-1e5, le=1e5)] | None = None
    feed_mm_min: _Length | None = None
    readings: list[_Number]


class _CutRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    size_mm: _Length
    tool_mm: _Length
    circle_ccw: dict[str, list[_Number]] = {}
    circle_cw: dict[str, list[_Number]] = {}
    square_inside: dict[str, list[_Number]] = {}
    square_outside: dict[str, list[_Number]] = {}
    slot: dict[str, list[_Number]] = {}


class _ReadingsRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    unit: Literal["mm", "um", "inch"] = "mm"
    swing_mm: Annotated[float, msgspec.Meta(gt=0, le=10)] = SWING_MM
    dial: list[_DialRecord] = []
    cut: _CutRecord | None = None


def read_readings(source: str | os.PathLike[str]) -> Readings:
    """Read a file of readings; lists that are empty were not measured.

    Raises
    ------
    InputError
        Where it is no TOML, a key is unknown, or a list has not as many numbers as it needs.
    """
    file = read_source(source)
    record = checked(_parsed(file.text, file.name), _ReadingsRecord, file.name)
    unit = UNITS[record.unit]
    rows = []
    for number, row in enumerate(record.dial):
        if row.readings:
            # The sheet numbers the rows of each axis from 1.
            count = sum(one.axis == row.axis for one in record.dial[: number + 1])
            where = f"{place(file.name, ('dial', number))} (row {count} of {row.axis})"
            rows.append(dial_row(row.axis, row.readings, unit, where, row.place_mm, row.feed_mm_min))
    return Readings(
        name=file.name, swing=record.swing_mm * MM, dial=rows, cut=_cut(record.cut, unit, f"{file.name}: cut")
    )


def _parsed(text: str, name: str) -> dict[str, Any]:
    """Decode TOML; where it is none, say what people write in place of its numbers and its file.

    Raises
    ------
    InputError
    """
    try:
        return parse_toml(text, name)
    except InputError as error:
        line = re.fullmatch(r".*:([0-9]+):[0-9]+", error.where)
        words = text.splitlines()[int(line[1]) - 1] if line else ""
        begin, end = words.find("["), words.rfind("]")
        if 0 <= begin < end and re.search(r"[0-9],[0-9]|;|,\s*,|(?<![0-9])\.[0-9]", words[begin:end]):
            expected = "decimal points, and a comma between numbers: [0.02, 0.5, 0.12]"
            raise InputError(error.where, "no list of numbers", expected=expected, got=words[begin : end + 1]) from None
        if not re.search(r"^[ \t]*\[+(dial|cut)\b", text, re.MULTILINE):
            expected = "readings.toml, which ph-post calibrate --without-log writes"
            raise InputError(error.where, "not a file of readings", expected=expected, got=quoted(words)) from None
        raise


def dial_row(
    axis: str,
    readings: Sequence[float],
    unit: float,
    where: str,
    place_mm: float | None = None,
    feed_mm_min: float | None = None,
) -> DialRow:
    """Return a row of the dial test, its readings given in a `unit` [m]; `where` names it.

    Raises
    ------
    InputError
        Where it has not three readings, or five, seven and so on.
    """
    if len(readings) < len(STEPS) or len(readings) % 2 == 0:
        expected = f"3, 5, 7 …: {', '.join(STEPS)}, then from minus and from plus again"
        if all(float(one).is_integer() for one in readings):
            expected += "; with decimal points, such as 0.12"
        raise InputError(where, "not a whole row of readings", expected=expected, got=str(len(readings)))
    return DialRow(
        axis=axis,
        readings=tuple(one * unit for one in readings),
        where=where,
        place=None if place_mm is None else place_mm * MM,
        feed=None if feed_mm_min is None else feed_mm_min * MM_PER_MIN,
    )


def _cut(record: _CutRecord | None, unit: float, where: str) -> CutWidths | None:
    """Return the widths that were measured, None where there is none."""
    if record is None:
        return None
    widths = {}
    for shape, names in CUTS.items():
        given: dict[str, list[float]] = getattr(record, shape)
        for name, values in given.items():
            if name not in names:
                raise InputError(f"{where}.{shape}", f'unknown key "{name}"', expected=one_of(names, name))
            if values:
                widths[shape, name] = tuple(value * unit for value in values)
    if not widths:
        return None
    return CutWidths(size=record.size_mm * MM, tool=record.tool_mm * MM, widths=widths, where=where)


ANGLE: Final = ("angle", "angle_deg")
RADIUS: Final = ("radius", "radius_mm")
FEWEST: Final = 90
"""Rows that one arc has at least: one in four degrees."""

_WHOLE: Final = 350.0 * DEGREE
"""Angle that an arc covers at least [rad]."""


def read_ball_bar(source: str | os.PathLike[str]) -> tuple[BallBarTrace, ...]:
    """Read a ball-bar file: a CSV with columns ``angle`` [degrees, from X towards Y] and ``radius`` [mm].

    Where the angle rises, the arc is counterclockwise; a file may hold both, one behind the other. Remarks
    ``# plane: XY``, ``# nominal_mm: 100`` (the calibrated length) and ``# feed_mm_min: 1000`` say the rest.

    Raises
    ------
    InputError
        Where a column is missing, an arc is not whole, or a number cannot be.
    """
    sheet = text_sheet(decoded(read_raw(source)))
    angle = _column(sheet, ANGLE, "angle [degrees]") * DEGREE
    radius = _column(sheet, RADIUS, "radius [mm]") * MM
    plane = sheet.remarks.get("plane", "XY").upper()
    if re.fullmatch(r"XY|XZ|YZ|ZX|YX|ZY", plane) is None:
        raise InputError(f"{sheet.name}: plane", "no plane", expected="XY, XZ or YZ", got=plane)
    nominal, feed = _remark(sheet, "nominal_mm", MM), _remark(sheet, "feed_mm_min", MM_PER_MIN)
    typical = float(np.median(radius))
    if typical <= 0.0 or (nominal is not None and not 0.98 <= typical / nominal <= 1.02):
        expected = "the bar's length in mm" if nominal is None else f"about {nominal / MM:g} mm"
        raise InputError(f"{sheet.name}: radius", "is no bar's length", expected=expected, got=f"{typical / MM:.6g} mm")
    traces = []
    for rows, turn in _arcs(np.unwrap(angle), sheet):
        traces.append(
            BallBarTrace(
                name=sheet.name,
                plane=(plane[0], plane[1]),
                angle=angle[rows],
                radius=radius[rows],
                turn=turn,
                nominal=nominal,
                feed=feed,
            )
        )
    return tuple(traces)


def _column(sheet: Sheet, names: Sequence[str], what: str) -> Array:
    found = next((name for name in sheet.names if name.lower() in names), None)
    if found is None:
        raise InputError(sheet.header, f"no column of the {what}", expected=names[0], got=sheet.listed)
    values = sheet.load([found])[found]
    if not np.all(np.isfinite(values)):
        raise InputError(sheet.where(int(np.argmin(np.isfinite(values)))), "not finite", expected="a number")
    return values


def _remark(sheet: Sheet, key: str, unit: float) -> float | None:
    text = sheet.remarks.get(key)
    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"{sheet.name}: {key}", "no number", expected="a number above 0", got=repr(text))
    return value * unit


def _arcs(angle: Array, sheet: Sheet) -> Iterator[tuple[slice, int]]:
    """Yield the rows of each arc, with +1 where its angle rises and -1 where it falls."""
    turning = int(np.argmax(np.abs(angle - angle[0]))) if angle.size else 0
    for rows in (slice(0, turning + 1), slice(turning + 1, angle.size)):
        part = angle[rows]
        if rows.start > 0 and part.size == 0:
            continue
        if part.size < FEWEST:
            got = counted(part.size, "row")
            raise InputError(sheet.name, "too few rows of an arc", expected=f"at least {FEWEST}", got=got)
        steps = np.diff(part)
        turn = 1 if part[-1] > part[0] else -1
        if np.any(turn * steps < 0.0):
            row = rows.start + 1 + int(np.argmax(turn * steps < 0.0))
            raise InputError(sheet.where(row), "the angle neither rises nor falls", expected="one arc behind the other")
        covered = abs(float(part[-1] - part[0]))
        if covered < _WHOLE:
            got = f"{covered / DEGREE:.4g} degrees"
            raise InputError(sheet.name, "the arc is not whole", expected="360 degrees", got=got)
        yield rows, turn


def words_of(text: str, where: str) -> tuple[str, list[float]]:
    """Read ``X 0 0.5 0.03``: a name and numbers, apart by blanks or commas.

    Raises
    ------
    InputError
        Where there is no name, or a number is none.
    """
    name, *numbers = re.split(r"[\s,;]+", text.strip())
    return name, [number_of(one, where) for one in numbers]


def number_of(text: str, where: str) -> float:
    """Read one number.

    Raises
    ------
    InputError
        Where it is none.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and abs(value) <= 1e6):
        raise InputError(where, "no reading", expected="numbers, apart by blanks", got=repr(text))
    return value
