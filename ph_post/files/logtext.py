"""Read the columns of a log from text.

Text has remarks, a header and a row per sample; or rows alone, as ``halsampler`` of LinuxCNC writes them.
``halsampler`` [1]_ prints a line per sample and no header: with ``-t`` the number of the sample first, from 0
on, then every pin of the sampler with a blank behind it, floats with six decimals, bits as 0 and 1. Where it
was too slow and samples were lost it prints a line ``overrun`` before the next one. ``halscope`` [2]_ and TwinCAT Scope
have heads of their own.

References
----------
.. [1] LinuxCNC, halsampler(1) and sampler(9), and src/hal/components/sampler_usr.c of its source.
.. [2] LinuxCNC, src/hal/utils/scope_files.c of its source, write_log_file.
"""

from __future__ import annotations

import contextlib
import csv
import functools
import itertools
import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from ph_post.errors import InputError
from ph_post.files.check import quoted
from ph_post.files.logsheet import Sheet
from ph_post.files.storage import SourceText
from ph_post.types import Array

REMARK: Final = "#"

OVERRUN: Final = "overrun"
"""Line that ``halsampler`` prints where samples were lost."""

_NUMBER: Final = re.compile(
    r"\s*(?:[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]?(?:nan|inf|infinity))\s*",
    re.IGNORECASE,
)

_ROW: Final = re.compile(r'[-+0-9.,;eE\s"]*[0-9][-+0-9.,;eE\s"]*')
"""A line that begins the rows rather than naming them."""


def text_sheet(source: SourceText) -> Sheet:
    """Find remarks, header and rows of a log.

    Cells are separated by semicolons, tabs, commas or blanks, whichever the first line has, in this order. Between
    semicolons or tabs numbers may have decimal commas. What ``halscope`` of LinuxCNC [2]_ saves is read, too.

    Raises
    ------
    InputError
        Where there is nothing but remarks; and, when columns are loaded, where a row has more or fewer cells
        than the header or a cell holds no number.
    """
    lines = source.text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    first = scope_header(lines)
    if first is not None:
        return scope_sheet(source, lines, first)
    lines = _labelled(lines)
    remarks = [line.strip() for line in lines if line.lstrip().startswith(REMARK)]
    kept = [k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(REMARK)]
    if not kept:
        raise InputError(source.name, "no rows, only remarks", expected="a header and a row a sample")
    rows = [k for k in kept if lines[k].strip() != OVERRUN]
    begin = lines[rows[0]] if rows else OVERRUN
    named = _ROW.fullmatch(begin) is None
    names = _cells(begin, _delimiter(begin))
    table = _TextRows(source.name, names if named else [f"{k + 1}" for k in range(len(names))], _delimiter(begin))
    table.fill(lines, rows[1:] if named else rows)
    overruns = [k for k in kept if lines[k].strip() == OVERRUN]
    before = [int(np.searchsorted(table.lines, k)) for k in overruns]
    return Sheet(
        name=source.name,
        stem=source.stem,
        digest=source.digest,
        rows=len(table.body),
        names=tuple(name for name in table.names if name),
        load=table.load,
        where=table.where,
        header=f"{source.name}:{rows[0] + 1 if rows else 1}",
        named=named,
        remarks=_remarks(remarks),
        lost=next((row for row in before if row > 0), None),
    )


_SCOPE: Final = ("sampletime[ms]", "starttime of export")
"""Begins of lines of which an export of TwinCAT Scope has one before the first row, in lower case."""

_SCOPE_TIME: Final = "time"
"""Name that its times are given."""

_SCOPE_UNITS: Final = ("m", "um", "µm", "inch", "in")
"""Units of lengths that stand beside the name of a channel; millimetres are what is taken without."""

_SCOPE_STEPS: Final = 1e3
"""Times of groups are compared in steps of 1 ms over this."""

_SCOPE_HEAD: Final = 80
"""Lines in which it is."""

_FILETIME: Final = 1e15
"""Times from which on they are counts of 100 ns since 1601, not milliseconds."""


def scope_header(lines: Sequence[str]) -> int | None:
    """Return the number of the line from which on TwinCAT Scope describes channels; None for other texts."""
    head = lines[:_SCOPE_HEAD]
    names = [k for k, line in enumerate(head) if re.match(r"Name[;,\t]", line)]
    if len(names) < 2 or not any(line.lower().startswith(_SCOPE) for line in head):
        return None
    return names[-1]


class _Scope:
    """What TwinCAT Scope exports as text: channels in columns, each group of them behind a column of its times.

    Groups have rows of their own: what was sampled less often ends sooner, or is filled up.
    """

    def __init__(self, source: SourceText, lines: Sequence[str], first: int) -> None:
        self.delimiter = next(one for one in "\t;," if f"Name{one}" in lines[first])
        self.source = source
        self.header = f"{source.name}:{first + 1}"
        described = {
            cells[0]: [one.strip() for one in cells]
            for cells in (line.split(self.delimiter) for line in lines[first : first + _SCOPE_HEAD])
        }
        names, symbols, units = (described.get(key, []) for key in ("Name", "SymbolName", "Unit"))
        clocks = [k for k, name in enumerate(names) if name == "Name"]
        self.places: dict[str, int] = {}
        self.clocks: dict[str, int] = {}
        for k, name in enumerate(names):
            if k in clocks or not name:
                continue
            symbol = symbols[k] if k < len(symbols) and symbols.count(symbols[k]) == 1 else ""
            unit = units[k].partition(" ")[0] if k < len(units) else ""
            plain = (symbol or name) + (f" [{unit}]" if unit in _SCOPE_UNITS else "")
            self.places.setdefault(plain, k)
            self.clocks.setdefault(plain, max(one for one in clocks if one < k))
        begins = re.compile(r"\s*-?[0-9]")
        self.rows = np.fromiter((k for k in range(first, len(lines)) if begins.match(lines[k])), np.int32)
        self.body = [lines[k] for k in self.rows]
        self.kept = np.arange(len(self.body))

    def where(self, row: int) -> str:
        """Return the place of a row."""
        return f"{self.source.name}:{self.rows[int(self.kept[row])] + 1}"

    def load(self, wanted: Sequence[str]) -> dict[str, Array]:
        """Read channels where all of them were sampled, and these times in milliseconds as `time`."""
        channels = [name for name in wanted if name != _SCOPE_TIME]
        groups = sorted({self.clocks[name] for name in channels} or set(self.clocks.values()))
        own = {clock: [name for name in channels if self.clocks[name] == clock] for clock in groups}
        self.kept = np.arange(len(self.body))
        tables = [self._table([clock, *(self.places[name] for name in own[clock])]) for clock in groups]
        begin = tables[0][0, 0] if tables[0].size else 0.0
        if begin > _FILETIME:
            for table in tables:
                table[:, 0] = (table[:, 0] - begin) * 1e-4
        if len(tables) > 1:
            tables = self._met(tables)
        found = {_SCOPE_TIME: tables[0][:, 0]}
        for clock, table in zip(groups, tables, strict=True):
            found |= dict(zip(own[clock], table.T[1:], strict=True))
        return {name: found[name] for name in wanted}

    def _met(self, tables: Sequence[Array]) -> list[Array]:
        """Return the rows of the times that all groups have; what is filled up says the last of them again."""
        times, kept = [], []
        for table in tables:
            t = np.rint(_SCOPE_STEPS * table[:, 0])
            steps = np.diff(t, prepend=-np.inf)
            if (steps < 0.0).any():
                row = int(np.argmax(steps < 0.0))
                what, expected = "time runs backwards", f"one recording a file, or t > {table[row - 1, 0]:.9g} ms"
                raise InputError(self.where(row), what, expected=expected, got=f"{table[row, 0]:.9g} ms")
            kept.append(steps > 0.0)
            times.append(t[steps > 0.0])
        common = functools.reduce(np.intersect1d, times)
        if 2 * common.size < max(1, min(t.size for t in times)):
            what = "channels that were not sampled at the same times"
            raise InputError(self.header, what, expected="one sampling time and one task for all that are used")
        rows = [np.flatnonzero(own)[np.searchsorted(t, common)] for own, t in zip(kept, times, strict=True)]
        self.kept = rows[0]
        return [table[own] for table, own in zip(tables, rows, strict=True)]

    def _table(self, places: list[int]) -> Array:
        """Read the rows of some columns, as far as the first of them goes."""
        end = len(self.body)
        while end and not self._cell(end - 1, places[0]):
            end -= 1
        if not end:
            return np.empty((0, len(places)))
        comma = self.delimiter != ","
        body = (line.replace(",", ".") if comma else line for line in self.body[:end])
        with contextlib.suppress(ValueError):  # the refusal says where
            return np.loadtxt(body, delimiter=self.delimiter, usecols=places, ndmin=2, comments=None)
        for row, place in itertools.product(range(end), places):
            cell = self._cell(row, place)
            if not _NUMBER.fullmatch(cell.replace(",", ".") if comma else cell):
                raise InputError(self.where(row), "no number where the other rows have one", got=quoted(cell))
        raise InputError(self.source.name, "the rows cannot be read as numbers")

    def _cell(self, row: int, place: int) -> str:
        cells = self.body[row].split(self.delimiter, place + 1)
        return cells[place].strip() if place < len(cells) else ""


def scope_sheet(source: SourceText, lines: Sequence[str], first: int) -> Sheet:
    """Read what TwinCAT Scope exports as text.

    A block of lines describes the channels, in each a key where a column holds times and a value a channel;
    channels of one sampling time may share the times. Rows follow, perhaps with decimal commas, and ``EOF``. `first` is
    the line of the names, see :func:`scope_header`.
    Channels that were sampled at other times are taken where their times meet.

    Raises
    ------
    InputError
        As columns are loaded: where their times do not meet, or a cell holds no number.
    """
    scope = _Scope(source, lines, first)
    return Sheet(
        name=source.name,
        stem=source.stem,
        digest=source.digest,
        rows=len(scope.body),
        names=(_SCOPE_TIME, *scope.places),
        load=scope.load,
        where=scope.where,
        header=scope.header,
    )


_HALSCOPE: Final = re.compile(r"(?:# )?Sampling period is ([0-9]+) ns\s*")
"""First line of what ``halscope`` saves; its older versions write the name before each value, and a row too many."""


def _labelled(lines: list[str]) -> list[str]:
    """Put the names of older versions of ``halscope`` into a header, line by line; other lines stay."""
    if len(lines) < 3 or lines[0].startswith(REMARK) or not _HALSCOPE.fullmatch(lines[0]) or lines[1].strip():
        return lines
    last = max(k for k, line in enumerate(lines) if line.strip())
    rows = [" ".join(line.split()[1::2]) for line in lines[2:last]]
    return [f"{REMARK} {lines[0]}", " ".join(lines[2].split()[::2]), *rows]


def _remarks(lines: Sequence[str]) -> dict[str, str]:
    """Read the lines ``# key: value``, and the period of ``halscope``; others are for people."""
    pairs = (line.lstrip("# ").partition(":") for line in lines)
    found = {key.strip(): value.strip() for key, colon, value in pairs if colon and key.strip()}
    first = _HALSCOPE.fullmatch(lines[0]) if lines else None
    return found if first is None else {"period": f"{int(first[1]) * 1e-9:.12g}"} | found


def _delimiter(line: str) -> str | None:
    """Return what stands between the cells of a line, None for blanks."""
    return next((one for one in ";\t," if one in line), None)


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.replace('"', "").split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]


class _TextRows:
    """The rows of a text, and the numbers of their lines from 0 on."""

    def __init__(self, file: str, names: list[str], delimiter: str | None) -> None:
        self.file = file
        self.names = names
        self.delimiter = delimiter
        self.lines: list[int] = []
        self.body: list[str] = []

    def fill(self, lines: Sequence[str], rows: list[int]) -> None:
        """Take the rows; quoted cells lose their quotes, and what separates cells inside them."""
        self.lines = rows
        self.body = [self._plain(lines[k]) for k in rows]

    def where(self, row: int) -> str:
        """Return the place of a row."""
        return f"{self.file}:{self.lines[row] + 1}"

    def load(self, names: Sequence[str]) -> dict[str, Array]:
        """Read columns, an empty cell as NaN."""
        self._require_width()
        places = [self.names.index(name) for name in names]
        try:
            values = self._parsed(self.body, places)
        except ValueError:
            values = self._parsed_with_holes(places)
        return {name: np.ascontiguousarray(column) for name, column in zip(names, values.T, strict=True)}

    def _parsed(self, body: list[str], places: list[int]) -> Array:
        return np.loadtxt(body, delimiter=self.delimiter, usecols=places, ndmin=2, comments=None)

    def _parsed_with_holes(self, places: list[int]) -> Array:
        if self.delimiter is not None:
            empty = re.compile(rf"(?m)(?<={self.delimiter}) *(?={self.delimiter}|$)|^ *(?={self.delimiter})")
            filled = empty.sub("nan", "\n".join(self.body)).split("\n")
            with contextlib.suppress(ValueError):  # the refusal says where
                return self._parsed(filled, places)
            if self.delimiter != "," and not any("." in line for line in self.body):  # 1.234,5 may be either
                with contextlib.suppress(ValueError):
                    return self._parsed([line.replace(",", ".") for line in filled], places)
        raise self._refusal(places)

    def _refusal(self, places: list[int]) -> InputError:
        """Find the first cell that holds no number."""
        for row, line in enumerate(self.body):
            cells = line.split(self.delimiter)
            for place in places:
                cell = cells[place]
                if _NUMBER.fullmatch(cell) or (self.delimiter and not cell.strip()):
                    continue
                comma = re.fullmatch(r"\s*[-+]?[0-9.]*,[0-9]+\s*", cell)
                what = (
                    "a decimal comma beside decimal points"
                    if comma
                    else f"no number in column {quoted(self.names[place])}"
                )
                expected = "numbers with a decimal point"
                return InputError(self.where(row), what, expected=expected, got=quoted(cell.strip()))
        return InputError(self.file, "the rows cannot be read as numbers")

    def _require_width(self) -> None:
        """Refuse the first row that has more or fewer cells than the others."""
        if self.delimiter is None:
            found = [len(line.split()) for line in self.body]
        else:
            found = [line.count(self.delimiter) + 1 for line in self.body]
        wrong = np.flatnonzero(np.array(found) != len(self.names))
        if wrong.size:
            row = int(wrong[0])
            raise InputError(
                self.where(row),
                "a row of another length than the first line",
                expected=f"{len(self.names)} cells",
                got=str(found[row]),
            )

    def _plain(self, line: str) -> str:
        if '"' not in line:
            return line
        if self.delimiter is None:
            return line.replace('"', "")
        return self.delimiter.join(cell.replace(self.delimiter, " ") for cell in _cells(line, self.delimiter))
