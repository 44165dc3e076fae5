"""Read the file of a log: commands and positions of the axes at a constant period.

Whether the log belongs to a machine and a part program is checked by :mod:`ph_post.identify.logprogram`.
"""

from __future__ import annotations

import math
import os
from collections.abc import Container, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from ph_post.errors import InputError
from ph_post.files.check import one_of, quoted
from ph_post.files.logcolumns import TIME, Clock, Column, clock_of, columns_of, parse_columns, renamed
from ph_post.files.logsheet import Sheet, stored_ending, stored_sheet
from ph_post.files.logtext import text_sheet
from ph_post.files.recorders import spread
from ph_post.files.storage import SourceBytes, decoded, read_raw
from ph_post.types import MACHINE_AXES, Array, AxisLog, Log, Machine, frozen, sealed

TWICE: Final = 0.05
"""Part of the rows that are those before them, from which on a file is refused for it."""

FEWEST: Final = 200
"""Samples that a log must have at least."""

SIDES: Final = ("table", "motor", "unknown")

_LARGEST: Final = {"t": 1e9, "cmd": 100.0, "act": 100.0, "motor": 100.0, "force": 1e12, "current": 1e12}
"""Largest number that is taken, in SI units by kind."""


class LogFile(NamedTuple):
    """A log as its file has it: the commands of an axis are NaN where the file has no column of them."""

    log: Log
    sheet: Sheet
    samples: _Samples

    @property
    def lacking(self) -> list[str]:
        """Axes without a column of commands."""
        return [name for name, axis in self.log.axes.items() if np.isnan(axis.command[0])]


def read_log_file(
    source: str | os.PathLike[str] | SourceBytes,
    *,
    columns: Sequence[str] = (),
    sides: Mapping[str, str] | None = None,
    machine: Machine | None = None,
) -> LogFile:
    """Read the file of a log; parameters and errors as :func:`ph_post.identify.logprogram.read_log`."""
    raw = source if isinstance(source, SourceBytes) else read_raw(source)
    ending = stored_ending(raw)
    sheet = stored_sheet(raw, ending) if ending else text_sheet(decoded(raw, foreign=True))
    asked = {} if sides is None else sides
    said = {*asked, *(axis for axis in MACHINE_AXES if f"{axis}_act.side" in sheet.remarks)}
    mappings, taken, own, loops = spread(columns, sheet, _motor_loops(machine, said))
    found, ignored = columns_of(sheet, renamed(parse_columns(mappings), parse_columns(own), sheet))
    names = _axes_of(found, sheet)
    require_axes(names, machine, sheet.header)
    _require_samples(sheet, sheet.rows)
    values = _values(found, sheet)
    _require_single_rows(values, sheet)
    _require_samples(sheet, min(one.size for one in values.values()))
    timed = _timed(found, values, sheet, machine)
    samples = _Samples(sheet, clock_of(timed.t, sheet))
    side_of = _sides(sheet, names, found, asked)
    axes, doubled = {}, []
    for name in names:
        axes[name], words = _axis(name, values, samples, side_of[name])
        doubled += words
    log = Log(
        name=sheet.stem,
        t=sealed(samples.t),
        period=samples.clock.period,
        axes=axes,
        digest=sheet.digest,
        jitter=samples.clock.jitter,
        missing=samples.missing,
        remarks=sheet.remarks,
        warnings=(
            *sheet.warnings,
            *taken,
            *_words_of_sides(loops, said, machine),
            *ignored,
            *timed.warnings,
            *doubled,
            *samples.words(),
        ),
    )
    return LogFile(log=log, sheet=sheet, samples=samples)


def _require_samples(sheet: Sheet, count: int) -> None:
    if count < FEWEST:
        raise InputError(sheet.name, "too few samples", expected=f"at least {FEWEST}", got=str(count))


def _require_single_rows(values: Mapping[str, Array], sheet: Sheet) -> None:
    """Refuse rows that stand twice: a command would rest at every second sample."""
    t = values.get(TIME)
    if t is None:
        return
    again = np.diff(t) == 0.0
    same = again.copy()
    for one in values.values():
        if one.size == t.size:
            same &= (one[1:] == one[:-1]) | (np.isnan(one[1:]) & np.isnan(one[:-1]))
    # Times that are rounded to the same digits have other positions.
    if np.count_nonzero(again) > TWICE * t.size and np.array_equal(again, same):
        row = int(np.argmax(again)) + 1
        got = f"{np.count_nonzero(again)} of {t.size} rows like the one before, time and all"
        raise InputError(sheet.where(row), "rows stand twice", expected="each sample once", got=got)


def require_axes(names: Sequence[str], machine: Machine | None, where: str) -> None:
    """Refuse axes that the machine does not have.

    Raises
    ------
    InputError
    """
    other = [] if machine is None else [name for name in names if name not in machine.axes]
    if machine is not None and other:
        raise InputError(
            where,
            f"the machine has no axis {', '.join(other)}; is it a log of another machine?",
            expected=", ".join(machine.axes),
            got=", ".join(names),
        )


class _Samples:
    """Rows of a file on the samples of a log."""

    def __init__(self, sheet: Sheet, clock: Clock) -> None:
        self.sheet = sheet
        self.clock = clock
        rows = int(clock.place[-1]) + 1
        self.missing = rows - clock.place.size
        self.t: Array = clock.start + clock.period * np.arange(rows, dtype=np.float64)

    def where(self, sample: int) -> str:
        """Return the place in the file of a sample, or of the next one that is there."""
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
        """Say what was filled in."""
        if not self.missing:
            return ()
        first = self.where(int(np.argmax(np.diff(self.clock.place) > 1)) + 1)
        return (f"{self.missing} of {self.t.size} samples are missing, the first before {first}",)


def _axes_of(found: Mapping[str, Column], sheet: Sheet) -> tuple[str, ...]:
    """Name the axes in order; each needs a position that was read, or that was commanded at least."""
    names = tuple(axis for axis in MACHINE_AXES if any(name.startswith(f"{axis}_") for name in found))
    if not any(f"{axis}_{side}" in found for axis in names for side in ("act", "motor")):
        raise InputError(
            sheet.header,
            "no position was recorded",
            expected="X_act or X_motor [mm], or a mapping such as --column X_act=SOURCE:mm",
            got=sheet.listed,
        )
    return names


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
    """Take `t`, or count rows or samples by a period that is given elsewhere."""
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
            "samples were lost before this line, and their number is unknown",
            expected="no overrun, or numbered samples (halsampler -t)",
        )
    return _Timed(
        np.arange(sheet.rows, dtype=np.float64) * period,
        (f"no column t; the period of {period:g} s is {whence}",),
    )


def _period(sheet: Sheet, machine: Machine | None) -> tuple[float, str]:
    """Find the period of rows without a time [s], and its source."""
    remark = sheet.remarks.get("period")
    if remark is not None:
        try:
            period = float(remark)
        except ValueError:
            period = math.nan
        if not 1e-7 <= period <= 1e3:
            raise InputError(f"{sheet.name}: # period", "no period", expected="seconds", got=quoted(remark))
        return period, "from the log"
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
            raise InputError(sheet.header, f"no column {axis}_act whose side could be given", got=sheet.listed)
    sides = {}
    for axis in names:
        side = asked.get(axis, sheet.remarks.get(f"{axis}_act.side", "table"))
        if side not in SIDES:
            where = f"{sheet.name}: # {axis}_act.side"
            raise InputError(where, "no side of an axis", expected=one_of(SIDES, side), got=quoted(side))
        if side == "motor" and f"{axis}_motor" in found:
            what = f"{axis}_act was read at the motor, and the log has {axis}_motor too"
            raise InputError(sheet.header, what, expected="one of them")
        sides[axis] = side
    return sides


def _motor_loops(machine: Machine | None, said: Container[str]) -> list[str]:
    """Return the axes whose loops read the motor by the machine file, but for those of which another side is said.

    A reading of the motor that is taken for one of the table shows no backlash, however much there is.
    """
    axes = {} if machine is None else machine.axes
    return [name for name, axis in axes.items() if not axis.loop.encloses_backlash and name not in said]


def _words_of_sides(loops: Sequence[str], said: Container[str], machine: Machine | None) -> list[str]:
    """Say on which side what loops read is taken to be, where nobody says it."""
    words = []
    if motors := [name for name in loops if name.endswith("_motor")]:
        axis = motors[0][0]
        words.append(
            f"{', '.join(motors)}: what the loop reads, as the machine file says that no scale is on the table; --side"
            f" {axis}=table or {axis}=unknown says otherwise"
        )
    if machine is None and (unsaid := [name for name in loops if name.endswith("_act") and name[0] not in said]):
        axis = unsaid[0][0]
        words.append(
            f"{', '.join(unsaid)}: nobody says whether read at the table or at the motor, taken as at the table; --side"
            f" {axis}=motor or {axis}=unknown says otherwise"
        )
    return words


def _axis(name: str, values: Mapping[str, Array], samples: _Samples, side: str) -> tuple[AxisLog, list[str]]:
    """Return the log of one axis, its command NaN where the file has none, and the columns ignored in words."""
    laid: dict[str, Any] = {}
    for kind in ("act", "motor", "force", "current"):
        column = values.get(f"{name}_{kind}")
        laid[kind] = None if column is None else samples.reading(column)
    command = values.get(f"{name}_cmd")
    both = laid["force"] is not None and laid["current"] is not None
    at_motor = side == "motor"
    axis = AxisLog(
        command=frozen(np.full(samples.t.size, np.nan)) if command is None else samples.command(command),
        table=None if at_motor else laid["act"],
        motor=laid["act"] if at_motor and laid["act"] is not None else laid["motor"],
        effort=laid["current"] if laid["force"] is None else laid["force"],
        effort_unit="A" if laid["force"] is None and laid["current"] is not None else "N",
        side="unknown" if side == "unknown" else "table",
    )
    return axis, ([f"{name}_current is ignored because the log has {name}_force"] if both else [])
