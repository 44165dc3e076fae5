"""Reading part programs from files and from standard input."""

from __future__ import annotations

import os
import pathlib
import sys
from collections.abc import Iterable
from typing import BinaryIO

from ph_post.errors import InputError
from ph_post.gcode.reader.language import RS274, Language
from ph_post.gcode.reader.read import read_program
from ph_post.gcode.reader.record import PartProgram
from ph_post.gcode.registry import find_dialect
from ph_post.gcode.splice.header import declared_language
from ph_post.io.source import STDIN, told_errors
from ph_post.types import Machine

_CHUNK = 1 << 20


def read_program_file(
    source: str | os.PathLike[str], *, strict: bool = False, machine: Machine | None = None
) -> PartProgram:
    """Read a part program from a file, or from standard input for ``-``.

    It is read in the language that it declares, or else in the machine's.

    Raises
    ------
    InputError
        Where the file cannot be read, and as :func:`~ph_post.gcode.reader.read.read_program`.
    """
    data, name = _read_bytes(source)
    return read_program(data, name, strict=strict, language=language_of([data], machine))


def read_program_pair(
    a: str | os.PathLike[str], b: str | os.PathLike[str], machine: Machine | None = None
) -> tuple[PartProgram, PartProgram]:
    """Read two programs in one language: that which one of them declares, or else the machine's.

    Raises
    ------
    InputError
        As :func:`read_program_file`.
    """
    (first, one), (second, other) = _read_bytes(a), _read_bytes(b)
    language = language_of([first, second], machine)
    return read_program(first, one, language=language), read_program(second, other, language=language)


def language_of(texts: Iterable[bytes], machine: Machine | None) -> Language:
    """Return the language that one of these programs declares, or else that of the machine's dialect."""
    own = RS274 if machine is None else find_dialect(machine.dialect).language
    return next((found for text in texts if (found := declared_language(text)) != RS274), own)


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
