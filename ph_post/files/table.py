"""Write and read interpolator tables, and write logs of simulated motion.

A table has a row per servo period, as CSV, ``.npz`` or ``.parquet``, in mm, mm/min and s. A log is CSV in s and
mm: a row per sample with the command and the positions of table and motor.
"""

from __future__ import annotations

import io
import os
import pathlib
import warnings
import zipfile
from collections.abc import Mapping
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.errors import InputError
from ph_post.files.arrays import ARRAY_FORMATS, array_content, read_arrays
from ph_post.files.check import one_of
from ph_post.files.storage import Content, decoded, read_raw, write_atomically
from ph_post.geometry.track import Track
from ph_post.types import MACHINE_AXES, Array, Command, IntArray, Run, frozen
from ph_post.units import MM, MM_PER_MIN

DECIMALS: Final = 12
"""Decimals of s, mm and mm/min: a thousandth of the contract's 1e-9 mm, and no binary noise behind it."""

CHUNK: Final = 65536
"""Rows turned into text at a time, so that a long table needs little memory."""

FORMATS: Final = (".csv", *ARRAY_FORMATS)
"""Endings of table files; standard output is CSV."""

UNEVEN: Final = 1e-3
"""Part of the period by which rows may come early or late: others may write fewer decimals."""

ROOM: Final = 1e-3
"""Part of a unit of xi, and of a mm of s, that others may have rounded away."""

MOST_WRONG: Final = 0.01
"""Part of the rows that may stand at a joint, or be written otherwise."""

_WHOLE: Final = ("segment", "window")


def write_table(command: Command, target: str) -> None:
    """Write `command` to `target`, whole or not at all; the ending chooses the format.

    Raises
    ------
    InputError
        Where the ending is unknown, pyarrow is missing for ``.parquet``, or the place cannot be written.
    """
    write_atomically({target: table_content(command, target)})


def table_content(command: Command, target: str) -> Content:
    """Return what :func:`write_table` would write to a file of this name; ``-`` is CSV.

    Raises
    ------
    InputError
        Where the ending is unknown, or pyarrow is missing for ``.parquet``.
    """
    columns = table_columns(command)
    ending = table_ending(target)
    return csv_rows(columns) if ending == ".csv" else array_content(columns, target, ending)


def table_columns(command: Command) -> dict[str, NDArray[Any]]:
    """Return the columns of the table by name, in its order and its units.

    Positions and times are rounded to 1e-12; `xi`, whose scale is the curve's own, is not.
    """
    places = {axis: _shop(command.position[:, index], MM) for index, axis in enumerate(command.axes)}
    return {
        "t": _shop(command.t, 1.0),
        "segment": command.segment,
        "xi": command.xi,
        "s": _shop(command.s, MM),
        **places,
        "feed": _shop(command.feed, MM_PER_MIN),
        "window": command.window,
    }


def read_table(source: str | os.PathLike[str]) -> Command:
    """Read a table back, in SI units.

    Raises
    ------
    InputError
        Where the file cannot be read or is no such table.
    """
    name = os.fspath(source)
    ending, raw = table_ending(name), read_raw(source)
    text = decoded(raw).text if ending == ".csv" else ""
    try:
        columns = _read_csv(text) if ending == ".csv" else read_arrays(raw.data, name, ending)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(name, "not an interpolator table", got=str(error).split("\n")[0]) from None
    return _command(columns, name)


def require_path(command: Command, track: Track, name: str) -> Command:
    """Check that a table belongs to a path, and return what was added to its points.

    Parameters
    ----------
    command : Command
        As :func:`read_table` returns it.
    track : Track
        Of the path.
    name : str
        Of the table, for the refusal.

    Raises
    ------
    InputError
        Where the table moves other axes, or its rows stand on other places than their arc length says.
    """
    if command.axes != track.path.axes:
        raise InputError(
            name,
            "the table moves other axes than the path",
            expected=", ".join(track.path.axes),
            got=", ".join(command.axes),
        )
    if command.s.min() < -MM * ROOM or command.s.max() > track.length + MM * ROOM:
        raise InputError(
            f"{name}: s",
            "the table is that of another path",
            expected=f"0 to {track.length / MM:.6f} mm",
            got=f"{command.s.min() / MM:.6f} to {command.s.max() / MM:.6f} mm",
        )
    piece, u = track.locate(np.clip(command.s, 0.0, track.length))
    segment, xi = track.to_xi(piece, u)
    # At a joint either segment may be named.
    wrong = (segment != command.segment) | (np.abs(xi - command.xi) > ROOM * np.maximum(1.0, np.abs(xi)))
    if wrong.mean() > MOST_WRONG:
        raise InputError(
            name,
            "the table is that of another path",
            expected="segment and xi of the path at s",
            got=f"others in {int(wrong.sum())} of {wrong.size} rows",
        )
    offset = command.position - track.derivatives(piece, u)[0]
    return msgspec.structs.replace(command, offset=frozen(offset))


def table_ending(target: str) -> str:
    """Return the kind of table that a file's name asks for, of standard output CSV.

    Raises
    ------
    InputError
        If it is none of :data:`FORMATS`.
    """
    ending = pathlib.PurePath(target).suffix.lower()
    if target == "-":
        return ".csv"
    if ending not in FORMATS:
        raise InputError(target, "unknown kind of table", expected=one_of(FORMATS), got=ending or "no ending")
    return ending


def _shop(values: Array, unit: float) -> Array:
    """Convert to the unit and round; adding 0 makes -0 into 0."""
    return np.round(values / unit, DECIMALS) + 0.0


def csv_rows(columns: Mapping[str, NDArray[Any]]) -> bytes:
    """Write columns as a line of names and a line a row, shortest decimals that read back as the same."""
    # msgspec writes the shortest decimals that read back as the same double, several times faster than repr
    encode = msgspec.json.encode
    lines = [",".join(columns).encode()]
    for start in range(0, len(columns["t"]), CHUNK):
        rows = zip(*(column[start : start + CHUNK].tolist() for column in columns.values()), strict=True)
        lines.append(encode(list(rows))[2:-2].replace(b"],[", b"\n"))
    return b"\n".join([*lines, b""])


def _read_csv(text: str) -> dict[str, NDArray[Any]]:
    lines = io.StringIO(text, newline=None)
    names = next(lines, "").strip().split(",")
    with warnings.catch_warnings():
        # Whoever misses the rows of an empty table refuses it in one line.
        warnings.simplefilter("ignore", UserWarning)
        body = np.loadtxt(lines, delimiter=",", ndmin=2)
    if body.size and body.shape[1] != len(names):
        raise ValueError(f"{body.shape[1]} columns under {len(names)} names")
    return dict(zip(names, body.T if body.size else np.empty((len(names), 0)), strict=True))


def _command(columns: dict[str, NDArray[Any]], name: str) -> Command:
    axes = tuple(column for column in columns if column in MACHINE_AXES)
    needed = ("t", "segment", "xi", "s", *(axes if len(axes) > 1 else ("X", "Y")), "feed", "window")
    if tuple(columns) != needed:
        raise InputError(name, "wrong columns", expected=", ".join(needed), got=", ".join(columns))
    _check_rows(columns, name)
    t: Array = columns["t"]
    whole: dict[str, IntArray] = {key: columns[key].astype(np.int64) for key in _WHOLE}
    return Command(
        axes=axes,
        period=float(t[-1] - t[0]) / (len(t) - 1),
        t=t,
        segment=whole["segment"],
        xi=columns["xi"],
        s=columns["s"] * MM,
        position=np.column_stack([columns[axis] for axis in axes]) * MM,
        feed=columns["feed"] * MM_PER_MIN,
        window=whole["window"],
    )


def _check_rows(columns: dict[str, NDArray[Any]], name: str) -> None:
    """Refuse what is no motion: less than two rows, numbers that are none, another period in between."""
    rows = len(columns["t"])
    if rows < 2:
        raise InputError(name, "no motion", expected="at least two rows", got=str(rows))
    for key, column in columns.items():
        bad = np.flatnonzero(~np.isfinite(np.asarray(column, dtype=np.float64)))
        if bad.size:
            got = f"{column[bad[0]]} in row {bad[0] + 1}"
            raise InputError(f"{name}: {key}", "not a finite number", expected="a number", got=got)
    steps = np.diff(columns["t"])
    period = float(steps.mean())
    uneven = np.flatnonzero(~(np.abs(steps - period) <= UNEVEN * period))
    if uneven.size:
        place = int(uneven[0])
        raise InputError(
            f"{name}: t",
            "rows must follow each other at a constant period",
            expected=f"{period:.9g} s after row {place + 1}",
            got=f"{steps[place]:.9g} s",
        )


def log_content(run: Run, remarks: Mapping[str, str]) -> bytes:
    """Return a simulated motion as a log.

    Columns are `t`, and for every axis what it was commanded, where its table is (`_act`) and where its motor
    is, in units of the table (`_motor`).

    Parameters
    ----------
    run : Run
    remarks : mapping of str to str
        Written first, as ``# key: value``; line breaks become spaces.
    """
    columns: dict[str, Array] = {"t": np.round(run.t, DECIMALS) + 0.0}
    for number, axis in enumerate(run.axes):
        sides = (("cmd", run.commanded), ("act", run.executed), ("motor", run.motor))
        for side, position in sides:
            columns[f"{axis}_{side}"] = np.round(position[:, number] / MM, DECIMALS) + 0.0
    head = "".join(f"# {key}: {' '.join(value.split())}\n" for key, value in remarks.items())
    return head.encode() + csv_rows(columns)
