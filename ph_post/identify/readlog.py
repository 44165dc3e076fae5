"""Read measured and simulated logs: commands and positions of the axes at a constant period."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.errors import InputError
from ph_post.files.check import one_of, quoted
from ph_post.files.logcolumns import AXES, TIME, Clock, Column, clock_of, columns_of, parse_columns
from ph_post.files.logsheet import Sheet, stored_ending, stored_sheet, text_sheet
from ph_post.files.storage import SourceBytes, decoded, read_raw
from ph_post.gcode.program import PartProgram
from ph_post.identify.logprogram import fill_commands, require_axes, require_program, require_readings
from ph_post.types import Array, AxisLog, Log, Machine, frozen, sealed

FEWEST: Final = 200
"""Samples that a log must have at least."""

SIDES: Final = ("table", "motor", "unknown")

_LARGEST: Final = {"t": 1e9, "cmd": 100.0, "act": 100.0, "motor": 100.0, "force": 1e12, "current": 1e12}
"""Largest number that is taken, in SI units by kind."""


def read_log(
    source: str | os.PathLike[str] | SourceBytes,
    *,
    columns: Sequence[str] = (),
    sides: Mapping[str, str] | None = None,
    program: PartProgram | None = None,
    machine: Machine | None = None,
) -> Log:
    """Read a log: CSV, a ``.mat``, ``.npz`` or ``.parquet`` file, or what LinuxCNC's ``halsampler`` wrote.

    Columns are `t` [s]; `X_cmd`, `X_act` (at the table) and `X_motor` [mm]; `X_force` [N] or `X_current` [A];
    and those of Y and Z. A file without a header has its columns numbered from 1; whole numbers that count up
    in the first of them are the numbers of the samples.

    Parameters
    ----------
    source : str, path or SourceBytes
        ``-`` is standard input; what was read already is taken as it is.
    columns : sequence of str
        Mappings ``NAME=SOURCE[*FACTOR]:UNIT``, such as ``X_act=qm:m``; they go before the file's own names.
    sides : mapping of str to str, optional
        By axis where `X_act` was read, "table", "motor" or "unknown"; goes before the remark ``X_act.side``.
    program : PartProgram, optional
        The program that ran, which gives the commands that the log lacks and must fit those that it has.
    machine : Machine, optional
        Whose record it is: refuses axes that it does not have; its servo period is that of rows without a
        time.

    Returns
    -------
    Log
        SI units, at one constant period; samples that are missing are NaN in the readings.

    Raises
    ------
    InputError
        One line naming file and line, what was expected and what was found.
    """
    raw = source if isinstance(source, SourceBytes) else read_raw(source)
    ending = stored_ending(raw)
    sheet = stored_sheet(raw, ending) if ending else text_sheet(decoded(raw))
    found, aside = columns_of(sheet, parse_columns(columns))
    names = _axes_of(found, sheet)
    require_axes(names, machine, sheet.header)
    _require_rows(sheet)
    values = _values(found, sheet)
    timed = _timed(found, values, sheet, machine)
    table = _Samples(sheet, clock_of(timed.t, sheet))
    told = _sides(sheet, names, found, {} if sides is None else sides)
    axes, doubled = {}, []
    for name in names:
        axes[name], words = _axis(name, values, table, told[name])
        doubled += words
    log = Log(
        name=sheet.stem,
        t=sealed(table.t),
        period=table.clock.period,
        axes=axes,
        digest=sheet.digest,
        jitter=table.clock.jitter,
        missing=table.missing,
        remarks=sheet.remarks,
        warnings=(*sheet.warnings, *aside, *timed.warnings, *doubled, *table.words()),
    )
    return _with_program(log, sheet, table, program, machine)


def _with_program(log: Log, sheet: Sheet, table: _Samples, program: PartProgram | None, machine: Machine | None) -> Log:
    """Fill in commands from the program, and refuse what does not belong together."""
    lacking = [name for name, axis in log.axes.items() if np.isnan(axis.command[0])]
    if lacking and (program is None or machine is None):
        raise InputError(
            sheet.header,
            f"column {quoted(f'{lacking[0]}_cmd')} is missing",
            expected=f"it, a mapping such as --column {lacking[0]}_cmd=SOURCE:mm, or the program that ran"
            + ("" if machine is not None else " and the machine"),
            got=sheet.listed,
        )
    if program is not None and machine is not None:
        if len(lacking) < len(log.axes):
            log = require_program(log, program, machine, table.where)
        if lacking:
            log = fill_commands(log, lacking, program, machine, sheet.name)
    elif program is not None:
        words = f"without a machine the commands cannot be compared with {program.name}"
        log = replace(log, warnings=(*log.warnings, words))
    require_readings(log, table.where)
    return log


class _Samples:
    """Rows of a file on the samples of a log."""

    def __init__(self, sheet: Sheet, clock: Clock) -> None:
        self.sheet = sheet
        self.clock = clock
        rows = int(clock.place[-1]) + 1
        self.missing = rows - clock.place.size
        self.t: Array = clock.start + clock.period * np.arange(rows, dtype=np.float64)

    def where(self, sample: int) -> str:
        """Where a sample, or else the next one that is there, stands in the file."""
        return self.sheet.where(int(np.searchsorted(self.clock.place, sample)))

    def reading(self, values: Array) -> Array:
        """Lay readings on the samples, NaN where one is missing."""
        spread = np.full(self.t.size, np.nan)
        spread[self.clock.place] = values
        return sealed(spread)

    def command(self, values: Array) -> Array:
        """Lay commands on the samples, along a line where one is missing."""
        return sealed(np.interp(np.arange(self.t.size), self.clock.place, values))

    def words(self) -> tuple[str, ...]:
        """Tell what was filled in."""
        if not self.missing:
            return ()
        first = self.where(int(np.argmax(np.diff(self.clock.place) > 1)) + 1)
        return (f"{self.missing} of {self.t.size} samples are missing, the first before {first}",)


def _axes_of(found: Mapping[str, Column], sheet: Sheet) -> tuple[str, ...]:
    """Name the axes in order; each needs a position that was read, or that was commanded at least."""
    names = tuple(axis for axis in AXES if any(name.startswith(f"{axis}_") for name in found))
    if not any(f"{axis}_{side}" in found for axis in names for side in ("act", "motor")):
        raise InputError(
            sheet.header,
            "no position was recorded",
            expected="X_act or X_motor [mm], or a mapping such as --column X_act=SOURCE:mm",
            got=sheet.listed,
        )
    return names


def _require_rows(sheet: Sheet) -> None:
    if sheet.rows < FEWEST:
        raise InputError(sheet.name, "too few samples", expected=f"at least {FEWEST}", got=str(sheet.rows))


def _values(found: Mapping[str, Column], sheet: Sheet) -> dict[str, Array]:
    """Read the columns in SI units, NaN where nothing was recorded."""
    raw = sheet.load(tuple(dict.fromkeys(column.source for column in found.values())))
    values = {}
    for name, column in found.items():
        kind = name.partition("_")[2] or TIME
        numbers = raw[column.source]
        with np.errstate(all="ignore"):
            values[name] = numbers * column.scale
        needed = kind in (TIME, "cmd")
        bad = ~(np.abs(values[name]) <= _LARGEST[kind]) & (needed | ~np.isnan(numbers))
        if bad.any():
            row = int(np.argmax(bad))
            what = f"no number in column {quoted(column.source)}"
            if math.isfinite(numbers[row]):
                what = f"number out of range in column {quoted(column.source)}"
            raise InputError(sheet.where(row), what, expected="a finite number", got=f"{numbers[row]:g}")
    return values


class _Timed(NamedTuple):
    """Times of the rows [s], and what was assumed of them."""

    t: Array
    warnings: tuple[str, ...] = ()


def _timed(found: Mapping[str, Column], values: Mapping[str, Array], sheet: Sheet, machine: Machine | None) -> _Timed:
    """Take `t`, or count rows or samples by a period that is told elsewhere."""
    if TIME in values:
        return _Timed(values[TIME])
    period, whence = _period(sheet, machine)
    counted = _sample_numbers(found, sheet)
    if counted is not None:
        words = f"the first column numbers the samples; their period of {period:g} s is {whence}"
        return _Timed(counted * period, (words,))
    if sheet.lost is not None:
        raise InputError(
            sheet.where(sheet.lost),
            "samples were lost before this line, and nobody knows how many",
            expected="no overrun, or numbered samples (halsampler -t)",
        )
    return _Timed(
        np.arange(sheet.rows, dtype=np.float64) * period,
        (f"no column t; the period of {period:g} s is {whence}",),
    )


def _period(sheet: Sheet, machine: Machine | None) -> tuple[float, str]:
    """Find the period of rows without a time [s], and who tells it."""
    remark = sheet.remarks.get("period")
    if remark is not None:
        try:
            period = float(remark)
        except ValueError:
            period = math.nan
        if not 1e-7 <= period <= 1e3:
            raise InputError(f"{sheet.name}: # period", "no period", expected="seconds", got=quoted(remark))
        return period, "told by the log"
    if machine is not None and not sheet.named:
        return machine.servo_period, "the machine's servo period"
    raise InputError(
        sheet.header,
        'column "t" is missing',
        got=sheet.listed,
        expected="t [s], a mapping such as --column t=SOURCE:ms, or a remark # period: SECONDS",
    )


def _sample_numbers(found: Mapping[str, Column], sheet: Sheet) -> Array | None:
    """Return the numbers of the samples, where the first column of a file without header has them."""
    if sheet.named or any(column.source == "1" for column in found.values()):
        return None
    try:
        first = sheet.load(("1",))["1"]
    except InputError:
        return None
    steps = np.diff(first)
    counts = bool(np.all(first == np.rint(first)) and np.all(steps >= 1.0) and np.median(steps) == 1.0)
    return first if counts else None


def _sides(sheet: Sheet, names: Sequence[str], found: Mapping[str, Column], asked: Mapping[str, str]) -> dict[str, str]:
    """Find where each axis was read."""
    for axis in asked:
        if f"{axis}_act" not in found:
            raise InputError(sheet.header, f"no column {axis}_act whose side could be told", got=sheet.listed)
    sides = {}
    for axis in names:
        side = asked.get(axis, sheet.remarks.get(f"{axis}_act.side", "table"))
        if side not in SIDES:
            where = f"{sheet.name}: # {axis}_act.side"
            raise InputError(where, "no side of an axis", expected=one_of(SIDES, side), got=quoted(side))
        if side == "motor" and f"{axis}_motor" in found:
            what = f"{axis}_act was read at the motor, and there is {axis}_motor too"
            raise InputError(sheet.header, what, expected="one of them")
        sides[axis] = side
    return sides


def _axis(name: str, values: Mapping[str, Array], table: _Samples, side: str) -> tuple[AxisLog, list[str]]:
    """Make the record of one axis, its command NaN where the log has none; and what was left aside."""
    laid: dict[str, Any] = {}
    for kind in ("act", "motor", "force", "current"):
        column = values.get(f"{name}_{kind}")
        laid[kind] = None if column is None else table.reading(column)
    command = values.get(f"{name}_cmd")
    both = laid["force"] is not None and laid["current"] is not None
    at_motor = side == "motor"
    axis = AxisLog(
        command=frozen(np.full(table.t.size, np.nan)) if command is None else table.command(command),
        table=None if at_motor else laid["act"],
        motor=laid["act"] if at_motor and laid["act"] is not None else laid["motor"],
        effort=laid["current"] if laid["force"] is None else laid["force"],
        effort_unit="A" if laid["force"] is None and laid["current"] is not None else "N",
        side="unknown" if side == "unknown" else "table",
    )
    return axis, ([f"{name}_current is left aside: there is {name}_force"] if both else [])
