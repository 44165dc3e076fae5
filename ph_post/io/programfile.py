"""Reading part programs from files and from standard input."""

from __future__ import annotations

import os
import pathlib
import sys
from collections.abc import Iterable
from typing import BinaryIO

from ph_post.errors import InputError
from ph_post.gcode.reader.language import RS274
from ph_post.gcode.reader.record import PartProgram
from ph_post.gcode.reading import read_as
from ph_post.gcode.splice.header import declared_language
from ph_post.io.source import STDIN, told_errors
from ph_post.types import Machine

_CHUNK = 1 << 20


def read_program_file(
    source: str | os.PathLike[str],
    *,
    strict: bool = False,
    machine: Machine | None = None,
    dialect: str | None = None,
) -> PartProgram:
    """Read a part program from a file, or from standard input for ``-``.

    It is read by the words of `dialect`, or in the language that it declares, or else in the machine's.

    Raises
    ------
    InputError
        Where the file cannot be read, and as :func:`~ph_post.gcode.reading.read_as`.
    """
    data, name = _read_bytes(source)
    return read_as(words_of([data], dialect, machine), data, name, strict=strict)


def read_program_pair(
    a: str | os.PathLike[str],
    b: str | os.PathLike[str],
    machine: Machine | None = None,
    dialect: str | None = None,
) -> tuple[PartProgram, PartProgram]:
    """Read two programs in one language: that asked for, or which one of them declares, or the machine's.

    Raises
    ------
    InputError
        As :func:`read_program_file`.
    """
    (first, one), (second, other) = _read_bytes(a), _read_bytes(b)
    words = words_of([first, second], dialect, machine)
    return read_as(words, first, one), read_as(words, second, other)


def words_of(texts: Iterable[bytes], dialect: str | None, machine: Machine | None) -> str:
    """Name the dialect of programs: that asked for, or which one declares, or the machine's, or none."""
    declared = (found.name for text in texts if (found := declared_language(text)) != RS274)
    return dialect or next(declared, "" if machine is None else machine.dialect)


def _read_bytes(source: str | os.PathLike[str]) -> tuple[bytes, str]:
    """Return what a file holds, and its name."""
    if os.fspath(source) == STDIN:
        if sys.stdin is None:
            raise InputError("stdin", "cannot be read", got="a closed stream")
        return _read_lines(sys.stdin.buffer), "stdin"
    file = pathlib.Path(source)
    with told_errors(file), file.open("rb") as stream:
        return _read_lines(stream), os.fspath(source)


def _read_lines(stream: BinaryIO) -> bytes:
    """Read all, but no further than a stretch without a line end, which the reader then refuses."""
    parts = []
    while part := stream.read(_CHUNK):
        parts.append(part)
        if len(part) == _CHUNK and b"\n" not in part and b"\r" not in part:
            break
    return b"".join(parts)
