"""Reading part programs from files and from standard input."""

from __future__ import annotations

import os
import pathlib
import sys
from typing import BinaryIO

from ph_post.errors import InputError
from ph_post.gcode.reader.record import PartProgram
from ph_post.gcode.reading import read_as
from ph_post.io.source import STDIN, told_errors
from ph_post.types import Machine

_CHUNK = 1 << 20


def read_program_file(
    source: str | os.PathLike[str], *, strict: bool = False, dialect: str = ""
) -> PartProgram:
    """Read a part program from a file, or from standard input for ``-``, by the words of a dialect.

    Raises
    ------
    InputError
        Where the file cannot be read, and as :func:`~ph_post.gcode.reading.read_as`.
    """
    if os.fspath(source) == STDIN:
        if sys.stdin is None:
            raise InputError("stdin", "cannot be read", got="a closed stream")
        return read_as(dialect, _read_lines(sys.stdin.buffer), "stdin", strict=strict)
    file = pathlib.Path(source)
    with told_errors(file), file.open("rb") as stream:
        data = _read_lines(stream)
    return read_as(dialect, data, os.fspath(source), strict=strict)


def words_of(dialect: str | None, machine: Machine | None) -> str:
    """Name the dialect by which programs are read: the one asked for, or the machine's, or none."""
    return dialect or ("" if machine is None else machine.dialect)


def _read_lines(stream: BinaryIO) -> bytes:
    """Read all, but no further than a stretch without a line end, which the reader then refuses."""
    parts = []
    while part := stream.read(_CHUNK):
        parts.append(part)
        if len(part) == _CHUNK and b"\n" not in part and b"\r" not in part:
            break
    return b"".join(parts)
