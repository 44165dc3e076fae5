"""Reading part programs from files and from standard input."""

from __future__ import annotations

import os
import pathlib
import sys
from typing import BinaryIO

from ph_post.errors import InputError
from ph_post.gcode.reader.read import read_program
from ph_post.gcode.reader.record import PartProgram
from ph_post.io.source import STDIN, told_errors

_CHUNK = 1 << 20


def read_program_file(source: str | os.PathLike[str], *, strict: bool = False) -> PartProgram:
    """Read a part program from a file, or from standard input for ``-``.

    Raises
    ------
    InputError
        Where the file cannot be read, and as :func:`~ph_post.gcode.reader.read.read_program`.
    """
    if os.fspath(source) == STDIN:
        if sys.stdin is None:
            raise InputError("stdin", "cannot be read", got="a closed stream")
        return read_program(_read_lines(sys.stdin.buffer), "stdin", strict=strict)
    file = pathlib.Path(source)
    with told_errors(file), file.open("rb") as stream:
        data = _read_lines(stream)
    return read_program(data, os.fspath(source), strict=strict)


def _read_lines(stream: BinaryIO) -> bytes:
    """Read all, but no further than a stretch without a line end, which the reader then refuses."""
    parts = []
    while part := stream.read(_CHUNK):
        parts.append(part)
        if len(part) == _CHUNK and b"\n" not in part and b"\r" not in part:
            break
    return b"".join(parts)
