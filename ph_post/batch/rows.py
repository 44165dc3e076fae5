"""The rows of a batch's report: one for each program and machine, as record, as CSV and as Parquet."""

from __future__ import annotations

import csv
import io
import math
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final, Literal

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.files.arrays import array_content
from ph_post.units import MM

Status = Literal["compensated", "unchanged", "refused", "failed"]

SEPARATOR: Final = " | "
"""What stands between the sentences of one cell."""

DECIMALS: Final = {"mm": 6, "s": 3, "": 6}
"""Decimals in the report, by unit."""


class BatchRow(msgspec.Struct, frozen=True, kw_only=True):
    """What became of one program for one machine.

    Attributes
    ----------
    file, machine : str
        The program's name in its folder, and the name of the machine file.
    status : "compensated", "unchanged", "refused" or "failed"
        `unchanged` where nothing had to be done, `refused` where ``convert`` refuses, `failed` where a run would be
        tried again: no worker survived it.
    output : str
        The file that was written, empty where none was.
    error_gap_before, error_gap_after, error_gap_worst : float or None
        Largest error that backlash causes, before, after, and after if the backlash is off by its uncertainty [m].
    rms_gap_before, rms_gap_after : float or None
        The same, root mean square [m].
    error_before, error_after : float or None
        Largest error by all causes [m].
    time_before, time_after : float or None
        Time of the motion [s].
    reversals, compensated : int or None
        Numbers of reversals of axes with backlash, and of those that are compensated.
    axes : tuple of str
        The compensated axes.
    not_compensated : str
        What is left, why, and what would change that.
    warnings : tuple of str
    reason : str
        Why it was refused or failed, or why nothing could be simulated.
    seconds : float
        How long a worker took [s].
    key, digest : str
        Hash of all that decides the output, and of the output.
    """

    file: str
    machine: str
    status: Status
    output: str = ""
    error_gap_before: float | None = None
    error_gap_after: float | None = None
    error_gap_worst: float | None = None
    rms_gap_before: float | None = None
    rms_gap_after: float | None = None
    error_before: float | None = None
    error_after: float | None = None
    time_before: float | None = None
    time_after: float | None = None
    reversals: int | None = None
    compensated: int | None = None
    axes: tuple[str, ...] = ()
    not_compensated: str = ""
    warnings: tuple[str, ...] = ()
    reason: str = ""
    seconds: float = 0.0
    key: str = ""
    digest: str = ""

    @property
    def share(self) -> float | None:
        """Compensated part of the reversals; None where there are none, or their number is not known."""
        return self.compensated / self.reversals if self.reversals and self.compensated is not None else None


_LENGTHS: Final = (
    *("error_gap_before", "error_gap_after", "error_gap_worst"),
    *("rms_gap_before", "rms_gap_after", "error_before", "error_after"),
)
_TIMES: Final = ("time_before", "time_after", "seconds")
_LISTS: Final = ("axes", "warnings")
_NAMES: Final = ("file", "output")
_COUNTS: Final = ("reversals", "compensated")

COLUMNS: Final = {
    "file": "file",
    "machine": "machine",
    "status": "status",
    **{name: f"{name}_mm" for name in _LENGTHS},
    "time_before": "time_before_s",
    "time_after": "time_after_s",
    "reversals": "reversals",
    "compensated": "compensated",
    "share": "compensated_share",
    "axes": "axes",
    "not_compensated": "not_compensated",
    "warnings": "warnings",
    "reason": "reason",
    "seconds": "seconds",
    "output": "output",
    "key": "key",
    "digest": "output_sha256",
}
"""Columns of the report by the names of the rows' fields."""


def row_view(row: BatchRow) -> dict[str, Any]:
    """Return a row as the report and ``--json`` have it, in mm and s; None for what does not exist."""
    return {column: _shown(name, getattr(row, name)) for name, column in COLUMNS.items()}


def _shown(name: str, value: Any) -> Any:
    if isinstance(value, float):
        unit = "mm" if name in _LENGTHS else "s" if name in _TIMES else ""
        return round(value / MM if unit == "mm" else value, DECIMALS[unit]) if math.isfinite(value) else None
    if name in _LISTS:
        return [one_line(word) for word in value]
    return one_line(value) if isinstance(value, str) and name not in _NAMES else value


def one_line(text: str) -> str:
    """Return a text in one line, with a sign in place of each byte of a file's name that is no text."""
    return " ".join(text.encode("utf-8", "replace").decode().split())


def shown_name(name: str) -> str:
    r"""Return the name of a file in one line, another for each: what cannot be shown stands as Python would write it.

    Examples
    --------
    >>> print(shown_name("a\nb.ngc"), shown_name("a  b.ngc"), shown_name("b\udce4d.ngc"))
    a\nb.ngc a  b.ngc b\xe4d.ngc
    """
    return "".join(_escaped(letter) for letter in name)


def _escaped(letter: str) -> str:
    if letter.isprintable() and (letter != "\\" or os.sep == "\\"):
        return letter
    if letter.isascii():
        return letter.encode("unicode_escape").decode()
    code = ord(letter)
    return f"\\x{code - _BYTE:x}" if 0x80 <= code - _BYTE <= 0xFF else f"\\u{{{code:x}}}"


_BYTE: Final = 0xDC00
"""What Python adds to a byte of a file's name that is no text."""

_SIGNS: Final = "[=+@\uff1d\uff0b\uff0d\uff20-]"
_FORMULA: Final = re.compile(rf"(^|;)(?='*{_SIGNS})")
_TEXT: Final = re.compile(rf"(^|;)'(?='*{_SIGNS})")


def cell_text(text: str) -> str:
    """Return a text as a cell of CSV that no spreadsheet takes for a formula, also one that parts cells at semicolons.

    Examples
    --------
    >>> cell_text("=1+1.ngc"), cell_text("part.ngc")
    ("'=1+1.ngc", 'part.ngc')
    """
    return _FORMULA.sub(r"\1'", text)


def text_of_cell(cell: str) -> str:
    """Return the text that :func:`cell_text` was given."""
    return _TEXT.sub(r"\1", cell)


def csv_text(rows: Iterable[BatchRow], *, head: bool) -> str:
    """Return rows as CSV, with or without the line of the columns' names."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if head:
        writer.writerow(COLUMNS.values())
    for row in rows:
        cells = (SEPARATOR.join(one) if isinstance(one, list) else one for one in row_view(row).values())
        writer.writerow("" if one is None else cell_text(one) if isinstance(one, str) else one for one in cells)
    return text.getvalue()


def parquet_content(rows: Iterable[BatchRow], name: str) -> bytes:
    """Return rows as a Parquet file, a column each, without a number where there is none.

    Raises
    ------
    InputError
        If pyarrow is missing.
    """
    views = [row_view(row) for row in rows]
    columns: dict[str, Any] = {}
    for field, column in COLUMNS.items():
        cells = [view[column] for view in views]
        if field in _LISTS:
            columns[column] = np.array([SEPARATOR.join(cell) for cell in cells], dtype=object)
        elif field in (*_LENGTHS, *_TIMES, *_COUNTS, "share"):
            columns[column] = np.array([math.nan if cell is None else float(cell) for cell in cells])
        else:
            columns[column] = np.array(cells, dtype=object)
    return array_content(columns, name, ".parquet")


def read_rows(file: Path) -> list[BatchRow]:
    """Return the rows of an earlier report; none where there is none. What was cut off at its end is left out.

    Raises
    ------
    InputError
        Where the file cannot be read, or is no such report.
    """
    try:
        text = file.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return []
    except OSError as error:
        raise InputError(str(file), "cannot be read", got=error.strerror or str(error)) from None
    whole = text[: text.rfind("\n") + 1]
    lines = csv.reader(io.StringIO(whole, newline=""))
    try:
        head = next(lines, [])
        if head[:3] != list(COLUMNS.values())[:3]:
            wanted = "that file moved away, or --force"
            raise InputError(str(file), "is there already, and no report of ph-post batch", expected=wanted)
        found = [_row(dict(zip(head, line, strict=True))) for line in lines if len(line) == len(head)]
    except csv.Error as error:
        raise InputError(str(file), "cannot be read", got=str(error)) from None
    return [row for row in found if row is not None]


def _row(cells: dict[str, str]) -> BatchRow | None:
    """Read a row back; None where somebody changed it to what it cannot be."""
    values: dict[str, Any] = {}
    try:
        for field, column in COLUMNS.items():
            cell = text_of_cell(cells.get(column, ""))
            if field == "share" or not cell:
                continue
            if field in _LENGTHS or field in _TIMES:
                values[field] = float(cell) * (MM if field in _LENGTHS else 1.0)
            elif field in _COUNTS:
                values[field] = int(cell)
            else:
                values[field] = tuple(cell.split(SEPARATOR)) if field in _LISTS else cell
        return msgspec.convert(values, BatchRow)
    except (ValueError, msgspec.ValidationError):
        return None
