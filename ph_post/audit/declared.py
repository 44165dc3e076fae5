"""What a compensated program says of itself, read from its comment lines: a public format, read here anew."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from decimal import Decimal, InvalidOperation
from typing import Any

import msgspec

from ph_post.units import LENGTH_UNITS, MS

_COMPENSATED = re.compile(rb"\(ph-post \S.* compensated this program\)\s*")
_LINE = re.compile(rb"\(ph-post: (.*)\)\s*")
_BEFORE = re.compile(rb"\s*(?:%.*|O\d+\b.*)?\s*", re.IGNORECASE)
"""What may stand before the header: blank lines, ``%`` and an O-number."""

_UNDO = re.compile(rb"\(ph-post: undo (\d+)/(\d+) ([A-Za-z0-9+/=_-]*)\)\s*")
_LEADING = 8
"""The header begins on one of the first lines."""

_NUMBER = r"(-?\d*\.?\d+)"
_KNOWN = {
    "original": re.compile(r"original sha256 ([0-9a-f]{64})"),
    "machine": re.compile(r"machine (.*), sha256 ([0-9a-f]*)"),
    "options": re.compile(r"options sha256 ([0-9a-f]+)"),
    "offset": re.compile(rf"offset ([XYZ]) {_NUMBER} (mm|inch)"),
    "pulse": re.compile(rf"pulse ([XYZ]) {_NUMBER} (mm|inch)"),
    "edits": re.compile(r"(\d+) stops?, (\d+) dips?"),
    "dwell": re.compile(
        rf"dwell {_NUMBER} s, decimals (\d+), chord tolerance {_NUMBER} mm, block time {_NUMBER} ms.*"
    ),
    "note": re.compile(r"note.*"),
}  # fmt: skip


class Amount(msgspec.Struct, frozen=True, kw_only=True):
    """A declared length: the exact number, as it is written, and the unit [m]."""

    number: Decimal
    unit: float

    @property
    def metres(self) -> float:
        """In SI."""
        return float(self.number) * self.unit


class Declaration(msgspec.Struct, frozen=True, kw_only=True):
    """What the header declares.

    `first`, `last` its lines, `tail` the first of the undo lines at the end (the number of lines where there
    are none). `offsets` and `pulses` by axis; `dwell` [s] and `block_time` [s]; `decimals` of lengths;
    `chord` tolerance [m]; `stops`, `dips` their numbers. `faults` what could not be read, with its line.
    """

    first: int
    last: int
    tail: int
    original: str = ""
    machine: str = ""
    machine_digest: str = ""
    offsets: Mapping[str, Amount] = {}
    pulses: Mapping[str, Amount] = {}
    stops: int | None = None
    dips: int | None = None
    dwell: float | None = None
    decimals: int | None = None
    chord: float | None = None
    block_time: float | None = None
    faults: tuple[tuple[int, str], ...] = ()


def read_declared(line: Callable[[int], bytes], lines: int) -> Declaration | None:
    """Read the header of a program and find its undo lines; None where there is no header.

    Parameters
    ----------
    line : callable
        ``line(k)``: the bytes of the line with that number.
    lines : int
        Number of lines.
    """
    first = _find_header(line, lines)
    if first is None:
        return None
    last = first + 1
    found: list[tuple[str, re.Match[str]]] = []
    while last < lines and (match := _LINE.fullmatch(line(last))) is not None:
        known = _recognise(match[1].decode("latin-1"))
        if known is None:
            break
        found.append(known)
        last += 1
    tail, faults = _read_tail(line, lines, last)
    fields, more = _fields(found, first + 1)
    return Declaration(first=first, last=last, tail=tail, faults=(*more, *faults), **fields)


def _find_header(line: Callable[[int], bytes], lines: int) -> int | None:
    for number in range(min(lines, _LEADING)):
        text = line(number)
        if _COMPENSATED.fullmatch(text):
            return number
        if not _BEFORE.fullmatch(text):
            return None
    return None


def _recognise(words: str) -> tuple[str, re.Match[str]] | None:
    return next(
        ((name, match) for name, pattern in _KNOWN.items() if (match := pattern.fullmatch(words))), None
    )


def _fields(
    found: list[tuple[str, re.Match[str]]], first: int
) -> tuple[dict[str, Any], list[tuple[int, str]]]:
    """Values of the declaration, and what is said twice or missing."""
    fields: dict[str, Any] = {"offsets": {}, "pulses": {}}
    faults: list[tuple[int, str]] = []
    seen: set[str] = set()
    for number, (name, match) in enumerate(found, first):
        key = f"{name} {match[1]}" if name in ("offset", "pulse") else name
        if key in seen and name != "note":
            faults.append((number, f"the header tells {key} twice"))
        seen.add(key)
        _take(fields, name, match)
    missing = [name for name in ("original", "edits", "dwell") if name not in seen]
    faults += [(first - 1, f"the header does not tell {name}") for name in missing]
    return fields, faults


def _take(fields: dict[str, Any], name: str, match: re.Match[str]) -> None:
    """Put one line of the header into the declaration's fields."""
    if name == "original":
        fields["original"] = match[1]
    elif name == "machine":
        fields["machine"], fields["machine_digest"] = match[1], match[2]
    elif name in ("offset", "pulse"):
        fields[f"{name}s"][match[1]] = Amount(number=_decimal(match[2]), unit=LENGTH_UNITS[match[3]])
    elif name == "edits":
        fields["stops"], fields["dips"] = int(match[1]), int(match[2])
    elif name == "dwell":
        fields["dwell"], fields["decimals"] = float(match[1]), int(match[2])
        fields["chord"], fields["block_time"] = float(match[3]) * LENGTH_UNITS["mm"], float(match[4]) * MS


def _decimal(text: str) -> Decimal:
    try:
        return Decimal(text)
    except InvalidOperation:
        return Decimal("NaN")


def _read_tail(line: Callable[[int], bytes], lines: int, last: int) -> tuple[int, list[tuple[int, str]]]:
    """First of the undo lines at the end, and what is wrong with their numbers."""
    tail = lines
    while tail > last and _UNDO.fullmatch(line(tail - 1)):
        tail -= 1
    faults = []
    for place, number in enumerate(range(tail, lines), 1):
        match = _UNDO.fullmatch(line(number))
        assert match is not None
        if (int(match[1]), int(match[2])) != (place, lines - tail):
            told = f"undo {int(match[1])}/{int(match[2])}"
            faults.append(
                (number, f"the undo lines are not in order: {told} where {place}/{lines - tail} belongs")
            )
    return tail, faults
