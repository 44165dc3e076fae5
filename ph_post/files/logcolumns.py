"""Map the columns of a log to names and units, and its rows to one constant period."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.files.check import one_of, quoted
from ph_post.files.logsheet import Sheet
from ph_post.files.recorders import without_unit
from ph_post.types import MACHINE_AXES, Array, IntArray
from ph_post.units import MICROMETRE, MS, lengths_in

KINDS: Final = ("cmd", "act", "motor", "force", "current")
TIME: Final = "t"

_LENGTHS: Final = lengths_in("m", ("mm", "m", "um")) | {"µm": MICROMETRE, "μm": MICROMETRE} | lengths_in("m", ("inch",))
_UNITS: Final[dict[str, dict[str, float]]] = {
    TIME: {"s": 1.0, "ms": MS, "us": 1e-6},
    "cmd": _LENGTHS,
    "act": _LENGTHS,
    "motor": _LENGTHS,
    "force": {"N": 1.0, "kN": 1e3},
    "current": {"A": 1.0, "mA": 1e-3},
}
"""Units by kind of column; the first is the default."""

_OTHER_AXIS: Final = re.compile(rf"([A-W])_(?:{'|'.join(KINDS)})")
_MAPPING: Final = re.compile(r"\s*([^=]*?)\s*=\s*(.+?)\s*(?:\*\s*([^*:]*?)\s*)?(?::\s*([^*:]*?)\s*)?")
_LIKE: Final = "NAME=SOURCE[*FACTOR]:UNIT, such as X_act=qm:m"


class Column(msgspec.Struct, frozen=True, kw_only=True):
    """A column of the contract: what it is in the file, and by what that is multiplied for SI units."""

    name: str
    source: str
    scale: float


def parse_columns(mappings: Sequence[str]) -> dict[str, Column]:
    """Read mappings of the form ``NAME=SOURCE[*FACTOR]:UNIT``; UNIT is that of SOURCE times FACTOR.

    Raises
    ------
    InputError
        Where one cannot be understood, or a name stands in two of them.

    Examples
    --------
    >>> parse_columns(["X_act=qm:m"])["X_act"]
    Column(name='X_act', source='qm', scale=1.0)
    """
    found: dict[str, Column] = {}
    for text in mappings:
        column = _parse(text)
        if column.name in found:
            raise InputError(_option(text), "a second column for one name", got=column.name)
        found[column.name] = column
    return found


def renamed(mapped: Mapping[str, Column], own: Mapping[str, Column], sheet: Sheet) -> dict[str, Column]:
    """Return columns, the source of each that has the name of a recorder's column as that one has it.

    A factor counts beside that of the recorder; a unit that is not the usual one, as of numbers that are metres, too.
    """
    found = dict(mapped)
    for name, column in mapped.items():
        if column.source in own and column.source not in sheet.names:
            one = own[column.source]
            found[name] = Column(name=name, source=one.source, scale=one.scale * column.scale / _default(name))
    return found


def columns_of(sheet: Sheet, mapped: Mapping[str, Column]) -> tuple[dict[str, Column], tuple[str, ...]]:
    """Find what of a file is a column of the contract, mapped or else by its own name.

    Returns
    -------
    columns : dict of str to Column
    warnings : tuple of str
        What is left aside.

    Raises
    ------
    InputError
        Where a mapped column does not exist or is there twice, or an axis is none of X, Y, Z.
    """
    for column in mapped.values():
        if column.source not in sheet.names:
            raise InputError(
                sheet.header,
                f"no column {quoted(column.source)} for {column.name}",
                expected="one of those that are there",
                got=sheet.listed,
            )
    found = dict(mapped)
    claimed = {column.source for column in mapped.values()}
    for source in sheet.names:
        name, unit = without_unit(source)
        if name not in found and source not in claimed and (kind := _kind(name, sheet.header)) is not None:
            if unit and unit not in _UNITS[kind]:
                raise InputError(
                    sheet.header, f"not a unit of {name}", expected=one_of(_UNITS[kind]), got=quoted(source)
                )
            found[name] = Column(name=name, source=source, scale=_UNITS[kind][unit] if unit else _default(name))
    used = {column.source for column in found.values()}
    for source in sorted(used):
        if sheet.names.count(source) > 1:
            raise InputError(sheet.header, f"column {quoted(source)} is there twice", expected="each name once")
    aside = [name for name in dict.fromkeys(sheet.names) if name not in used] if sheet.named else []
    return found, ((f"columns ignored: {', '.join(aside)}",) if aside else ())


def _parse(text: str) -> Column:
    match = _MAPPING.fullmatch(text)
    if match is None:
        raise InputError(_option(text), "not a mapping of a column", expected=_LIKE)
    name, source, factor, unit = match.groups()
    kind = _kind(name, _option(text))
    if kind is None:
        known = [TIME, *(f"{axis}_{kind}" for axis in MACHINE_AXES for kind in KINDS)]
        raise InputError(_option(text), "not the name of a column", expected=one_of(known, name), got=quoted(name))
    units = _UNITS[kind]
    if unit is not None and unit not in units:
        volts = kind == "force" and unit == "V"
        expected = f"a factor to N, such as {name}={source}*35.15:N" if volts else one_of(units)
        raise InputError(_option(text), f"not a unit of {name}", expected=expected, got=quoted(unit))
    scale = _factor(factor, text) * (_default(name) if unit is None else units[unit])
    return Column(name=name, source=source, scale=scale)


def _factor(factor: str | None, text: str) -> float:
    try:
        value = 1.0 if factor is None else float(factor)
    except ValueError:
        value = math.nan
    if not 1e-15 <= abs(value) <= 1e15:
        raise InputError(_option(text), "no factor", expected="a number other than 0", got=quoted(factor or ""))
    return value


def _kind(name: str, where: str) -> str | None:
    """Return what kind of column a name means, None where it is no name of the contract.

    Raises
    ------
    InputError
        Where the axis is a known letter but none of :data:`MACHINE_AXES`.
    """
    if name == TIME:
        return TIME
    other = _OTHER_AXIS.fullmatch(name)
    if other is not None and other[1] not in MACHINE_AXES:
        raise InputError(
            where,
            f"axis {other[1]} cannot be taken: drives are known of straight axes only",
            expected=f"{', '.join(MACHINE_AXES[:-1])} or {MACHINE_AXES[-1]}",
            got=name,
        )
    axis, _, kind = name.partition("_")
    return kind if axis in MACHINE_AXES and kind in KINDS else None


def _default(name: str) -> float:
    return next(iter(_UNITS[name.partition("_")[2] or TIME].values()))


def _option(text: str) -> str:
    return f"--column {quoted(text, 60)}"


JITTER: Final = 0.1
"""Part of the period by which a sample may be early or late."""

ANOTHER: Final = 50.0
"""Periods by which time goes back where a recorder was started again."""

HOLES: Final = 0.05
"""Part of the rows that may be missing."""

DECIMALS: Final = 9
"""Times are looked at for rounding to so many decimals of a second at most."""


class Clock(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The time of rows: `place` (n,) is the sample that each is, `jitter` [s] how far one is off at most."""

    start: float
    period: float
    place: IntArray
    jitter: float


def clock_of(t: Array, sheet: Sheet) -> Clock:
    """Find the constant period of times [s], shape (n,).

    Times may have been rounded to few decimals, coarser than the period even. Holes are whole periods.

    Raises
    ------
    InputError
        Where time repeats or runs backwards, a sample is early or late by more than a tenth of the period, or
        too many are missing; with the line.
    """
    exact = _fitted(t, 0.0)
    if isinstance(exact, Clock) and not _too_many(exact):
        return exact
    rounding = _rounding(t)
    rounded = _fitted(t, rounding) if rounding > 0.0 else exact
    if isinstance(rounded, Clock) and not _too_many(rounded):
        return rounded
    raise _with_holes(exact, sheet) if isinstance(exact, Clock) else _refusal(t, exact, sheet)


class _BadTime(msgspec.Struct, frozen=True, kw_only=True):
    """The row at which time goes wrong, and the period and the time that were expected there."""

    row: int
    period: float
    expected: float


def _fitted(t: Array, rounding: float) -> Clock | _BadTime:
    """Lay a constant period through times that were rounded to multiples of `rounding`."""
    steps = np.diff(t)
    period = _typical(steps, rounding)
    if not period > 0.0:
        return _BadTime(row=1, period=period, expected=float(t[0]))
    room = 2.0 * JITTER * period + rounding
    count = np.rint(steps / period).astype(np.int64)
    if rounding >= 0.5 * period:  # holes look like rounding
        count = np.ones(count.size, dtype=np.int64)
    count = np.maximum(count, 1)
    off = np.flatnonzero((np.abs(steps - count * period) > room) | ((steps <= 0.0) & (rounding == 0.0)))
    if off.size:
        row = int(off[0]) + 1
        return _BadTime(row=row, period=period, expected=float(t[row - 1] + count[row - 1] * period))
    place = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    start, period, error = _line(t, place)
    parts = period / rounding if rounding > 0.0 else 0.0
    if abs(parts - round(parts)) * t.size < 0.5:  # a whole number of them: rounding moves nothing
        rounding = 0.0
    row = int(np.argmax(np.abs(error)))
    if abs(error[row]) > JITTER * period + 0.5 * rounding:
        return _BadTime(row=row, period=period, expected=float(t[row] - error[row]))
    return Clock(start=start, period=period, place=place, jitter=float(np.abs(error).max()))


def _typical(steps: Array, rounding: float) -> float:
    """Return the period: the median of the steps, and the mean of all that are none of a hole."""
    median = float(np.median(steps))
    if rounding == 0.0 and median > 0.0:
        return median
    near = steps[steps <= 1.5 * max(median, rounding)]
    return float(near.mean()) if near.size else rounding


def _line(t: Array, place: IntArray) -> tuple[float, float, Array]:
    """Fit start and period, and how far each time is off; a round period is taken where it fits as well."""
    k = place - place.mean()
    period = float((k @ (t - t.mean())) / (k @ k))
    start = float(t.mean() - period * place.mean())
    error = t - (start + period * place)
    plain = float(f"{period:.4g}")
    other = t - plain * place
    other_start = float(other.mean())
    if plain > 0.0 and _size(other - other_start) <= 1.05 * _size(error) + 1e-12 * float(np.abs(t).max()):
        start, period, error = other_start, plain, other - other_start
    if abs(start - t[0]) <= float(np.abs(error).max()):
        start = float(t[0])
    return start, period, error


def _size(error: Array) -> float:
    return float(np.sqrt(np.mean(error * error)))


def _rounding(t: Array) -> float:
    """Return what all times are multiples of [s], a power of ten; 0 where they have many decimals."""
    for decimals in range(DECIMALS + 1):
        scaled = t * 10.0**decimals
        if np.all(np.abs(scaled - np.rint(scaled)) <= 1e-4):
            return float(10.0**-decimals)
    return 0.0


def _refusal(t: Array, wrong: _BadTime, sheet: Sheet) -> InputError:
    back = np.flatnonzero(np.diff(t) < 0.0)
    still = np.flatnonzero(np.diff(t) == 0.0)
    if back.size or still.size:
        row = int((back if back.size else still)[0]) + 1
        what = "time runs backwards" if back.size else "time repeats"
        if t[row - 1] - t[row] > ANOTHER * wrong.period > 0.0:
            what = "time starts again: another recording in the same file?"
            expected = f"one recording a file, or t > {t[row - 1] + 0.0:.9g} s"
            return InputError(sheet.where(row), what, expected=expected, got=f"{t[row]:.9g} s")
        return InputError(sheet.where(row), what, expected=f"t > {t[row - 1] + 0.0:.9g} s", got=f"{t[row]:.9g} s")
    return InputError(
        sheet.where(wrong.row),
        "the sampling period is not constant",
        expected=f"t = {wrong.expected:.9g} s, at a period of {wrong.period:.6g} s",
        got=f"{t[wrong.row]:.9g} s",
    )


def _too_many(clock: Clock) -> bool:
    """Return whether there are too many holes."""
    rows = int(clock.place[-1]) + 1
    return rows - clock.place.size > HOLES * rows


def _with_holes(clock: Clock, sheet: Sheet) -> InputError:
    rows = int(clock.place[-1]) + 1
    return InputError(
        sheet.where(int(np.argmax(np.diff(clock.place) > 1)) + 1),
        "too many samples are missing, here the first",
        expected=f"at most {HOLES:.0%} of the rows at a period of {clock.period:.6g} s",
        got=f"{rows - clock.place.size} of {rows}",
    )
