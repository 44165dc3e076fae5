"""Reading a part program by the words of its dialect."""

from __future__ import annotations

import re
from pathlib import PurePath
from typing import Final

from msgspec.structs import replace

from ph_post.errors import InputError
from ph_post.gcode.reader.language import RS274
from ph_post.gcode.reader.read import read_program, refuse_notes
from ph_post.gcode.reader.record import PartProgram
from ph_post.gcode.registry import find_dialect

_LANGUAGES: Final = {".mpf": "siemens", ".spf": "siemens"}
"""Endings of programs that are of one language alone."""

_KLARTEXT: Final = re.compile(rb"\s*(?:\d+\s+)?BEGIN\s+PGM\s")


def read_as(dialect: str, data: bytes, name: str, *, strict: bool = False) -> PartProgram:
    """Read a part program by the words of a dialect.

    Parameters
    ----------
    dialect : str
        Its name; empty for the words that most controllers share, or those that the ending of `name` tells.
    data, name, strict
        As for :func:`ph_post.gcode.reader.read.read_program`.

    Raises
    ------
    InputError
        Where there is no such dialect, or the text is not understood as a program of it.
    """
    dialect = dialect or _LANGUAGES.get(PurePath(name).suffix.lower(), "")
    found = find_dialect(dialect) if dialect else None
    front = None if found is None else found.front
    if front is None and _KLARTEXT.match(data):
        raise InputError(
            f"{name}:1", "a conversational program of Heidenhain, read by other words",
            expected="--dialect heidenhain, or a machine file with that dialect",
        )  # fmt: skip
    if front is None:
        language = RS274 if found is None else found.language
        return replace(read_program(data, name, strict=strict, language=language), dialect=dialect)
    program = replace(front(data, name), dialect=dialect)
    if strict:
        refuse_notes(program)
    return program


def read_anew(program: PartProgram, data: bytes, name: str | None = None) -> PartProgram:
    """Read what was made of a program, or what it was made of, by the words it was read by itself."""
    told = program.name if name is None else name
    if program.dialect:
        return read_as(program.dialect, data, told)
    return read_program(data, told, language=program.language)
