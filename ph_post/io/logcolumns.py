"""The columns of a log: their names in the contract, their units, and how others are mapped to them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from ph_post.errors import InputError
from ph_post.io.check import one_of
from ph_post.io.exact import quoted
from ph_post.io.logsheet import Sheet
from ph_post.units import INCH, MM, MS

AXES: Final = ("X", "Y", "Z")
KINDS: Final = ("cmd", "act", "motor", "force", "current")
TIME: Final = "t"

_LENGTHS: Final = {"mm": MM, "m": 1.0, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "inch": INCH}
_UNITS: Final[dict[str, dict[str, float]]] = {
    TIME: {"s": 1.0, "ms": MS, "us": 1e-6},
    "cmd": _LENGTHS,
    "act": _LENGTHS,
    "motor": _LENGTHS,
    "force": {"N": 1.0, "kN": 1e3},
    "current": {"A": 1.0, "mA": 1e-3},
}
"""Units by kind of column; the first is that of a column whose unit is not told."""

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
                sheet.header, f"no column {quoted(column.source)} for {column.name}",
                expected="one of those that are there", got=sheet.listed,
            )  # fmt: skip
    found = dict(mapped)
    claimed = {column.source for column in mapped.values()}
    for name in sheet.names:
        if name not in found and name not in claimed and _kind(name, sheet.header) is not None:
            found[name] = Column(name=name, source=name, scale=_default(name))
    used = {column.source for column in found.values()}
    for source in sorted(used):
        if sheet.names.count(source) > 1:
            raise InputError(
                sheet.header, f"column {quoted(source)} is there twice", expected="each name once"
            )
    aside = [name for name in dict.fromkeys(sheet.names) if name not in used] if sheet.named else []
    return found, ((f"columns left aside: {', '.join(aside)}",) if aside else ())


def _parse(text: str) -> Column:
    match = _MAPPING.fullmatch(text)
    if match is None:
        raise InputError(_option(text), "no mapping of a column", expected=_LIKE)
    name, source, factor, unit = match.groups()
    kind = _kind(name, _option(text))
    if kind is None:
        known = [TIME, *(f"{axis}_{kind}" for axis in AXES for kind in KINDS)]
        raise InputError(
            _option(text), "no name of a column", expected=one_of(known, name), got=quoted(name)
        )  # fmt: skip
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
        raise InputError(
            _option(text), "no factor", expected="a number other than 0", got=quoted(factor or "")
        )
    return value


def _kind(name: str, where: str) -> str | None:
    """Return what kind of column a name means, None where it is no name of the contract.

    Raises
    ------
    InputError
        Where it is that of an axis other than X, Y and Z.
    """
    if name == TIME:
        return TIME
    other = _OTHER_AXIS.fullmatch(name)
    if other is not None:
        raise InputError(
            where, f"axis {other[1]} cannot be taken: drives are known of straight axes only",
            expected="X, Y or Z", got=name,
        )  # fmt: skip
    axis, _, kind = name.partition("_")
    return kind if axis in AXES and kind in KINDS else None


def _default(name: str) -> float:
    return next(iter(_UNITS[name.partition("_")[2] or TIME].values()))


def _option(text: str) -> str:
    return f"--column {quoted(text, 60)}"
