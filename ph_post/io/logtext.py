"""Logs as text: remarks, a header and a row a sample; or rows alone, as ``halsampler`` of LinuxCNC writes.

``halsampler`` [1]_ prints a line a sample and no header: with ``-t`` the number of the sample first, from 0
on, then every pin of the sampler with a blank behind it, floats with six decimals, bits as 0 and 1. Where it
was too slow and samples were lost it prints a line ``overrun`` before the next one.

References
----------
.. [1] LinuxCNC, halsampler(1) and sampler(9), and src/hal/components/sampler_usr.c of its source.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from ph_post.errors import InputError
from ph_post.io.exact import quoted
from ph_post.io.logsheet import Sheet
from ph_post.io.source import Source
from ph_post.types import Array

REMARK: Final = "#"
OVERRUN: Final = "overrun"
"""What ``halsampler`` prints where samples were lost."""

_NUMBER: Final = re.compile(
    r"\s*(?:[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|[-+]?(?:nan|inf|infinity))\s*",
    re.IGNORECASE,
)
_ROW: Final = re.compile(r'[-+0-9.,;eE\s"]*[0-9][-+0-9.,;eE\s"]*')
"""A line that begins the rows rather than naming them."""


def text_sheet(source: Source) -> Sheet:
    """Find remarks, header and rows of a log.

    Cells are separated by semicolons, tabs, commas or blanks, whichever the first line has, in this order.

    Raises
    ------
    InputError
        Where there is nothing but remarks; and, when columns are loaded, where a row has more or fewer cells
        than the header or a cell holds no number.
    """
    lines = source.text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    told = [line.strip() for line in lines if line.lstrip().startswith(REMARK)]
    kept = [k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(REMARK)]
    if not kept:
        raise InputError(source.name, "no rows, only remarks", expected="a header and a row a sample")
    rows = [k for k in kept if lines[k].strip() != OVERRUN]
    first = lines[rows[0]] if rows else OVERRUN
    named = _ROW.fullmatch(first) is None
    names = _cells(first, _delimiter(first))
    table = _Rows(source.name, names if named else [f"{k + 1}" for k in range(len(names))], _delimiter(first))
    table.fill(lines, rows[1:] if named else rows)
    overruns = [k for k in kept if lines[k].strip() == OVERRUN]
    before = [int(np.searchsorted(table.lines, k)) for k in overruns]
    return Sheet(
        name=source.name, stem=source.stem, digest=source.digest, rows=len(table.body),
        names=tuple(name for name in table.names if name), load=table.load, where=table.where,
        header=f"{source.name}:{rows[0] + 1 if rows else 1}", named=named, remarks=_remarks(told),
        lost=next((row for row in before if row > 0), None),
    )  # fmt: skip


def _remarks(lines: Sequence[str]) -> dict[str, str]:
    """Read the lines ``# key: value``; others are for people."""
    pairs = (line.lstrip("# ").partition(":") for line in lines)
    return {key.strip(): value.strip() for key, colon, value in pairs if colon and key.strip()}


def _delimiter(line: str) -> str | None:
    """Return what stands between the cells of a line, None for blanks."""
    return next((one for one in ";\t," if one in line), None)


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.replace('"', "").split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))]


class _Rows:
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
        """Where a row is."""
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
            try:
                return self._parsed(filled, places)
            except ValueError:
                pass
        raise self._refusal(places)

    def _refusal(self, places: list[int]) -> InputError:
        """Find the first cell that holds no number."""
        for row, line in enumerate(self.body):
            cells = line.split(self.delimiter)
            for place in places:
                cell = cells[place]
                if _NUMBER.fullmatch(cell) or (self.delimiter and not cell.strip()):
                    continue
                comma = re.fullmatch(r"\s*[-+]?[0-9]*,[0-9]+\s*", cell)
                what = "a decimal comma" if comma else f"no number in column {quoted(self.names[place])}"
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
                self.where(row), "a row of another length than the first line",
                expected=f"{len(self.names)} cells", got=str(found[row]),
            )  # fmt: skip

    def _plain(self, line: str) -> str:
        if '"' not in line:
            return line
        if self.delimiter is None:
            return line.replace('"', "")
        return self.delimiter.join(cell.replace(self.delimiter, " ") for cell in _cells(line, self.delimiter))
