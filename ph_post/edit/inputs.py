"""Read what commands take as IN: a path file, or a part program whose path is read from its motions."""

from __future__ import annotations

import os
import pathlib
import re
import sys
from collections.abc import Iterable
from typing import BinaryIO, Final, Literal

from ph_post.dialects.reading import read_again_as, read_as
from ph_post.edit.header import declared_language
from ph_post.errors import InputError
from ph_post.files.path import path_of
from ph_post.files.storage import STDIO, SourceBytes, decoded, read_raw, reading_errors
from ph_post.gcode.paths import line_words, main_path
from ph_post.gcode.program import RS274, PartProgram
from ph_post.types import Machine, Path

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
        Where the file cannot be read, and as :func:`~ph_post.dialects.reading.read_as`.
    """
    data, name = _read_bytes(source)
    return read_as(dialect_of([data], dialect, machine), data, name, strict=strict)


def read_program_pair(
    a: PartProgram | str | os.PathLike[str],
    b: PartProgram | str | os.PathLike[str],
    machine: Machine | None = None,
    dialect: str | None = None,
) -> tuple[PartProgram, PartProgram]:
    """Read two programs in one language: `dialect`, or the one that either declares, or the machine's.

    A program that was read already is read again where that was in another language.

    Raises
    ------
    InputError
        As :func:`read_program_file`.
    """
    (first, one), (second, other) = (
        (source.data, source.name) if isinstance(source, PartProgram) else _read_bytes(source) for source in (a, b)
    )
    words = dialect_of([first, second], dialect, machine)
    return (
        read_again_as(words, a) if isinstance(a, PartProgram) else read_as(words, first, one),
        read_again_as(words, b) if isinstance(b, PartProgram) else read_as(words, second, other),
    )


def dialect_of(texts: Iterable[bytes], dialect: str | None, machine: Machine | None) -> str:
    """Name the dialect of programs: that asked for, or which one declares, or the machine's, or none."""
    declared = (found.name for text in texts if (found := declared_language(text)) != RS274)
    return dialect or next(declared, "" if machine is None else machine.dialect)


def _read_bytes(source: str | os.PathLike[str]) -> tuple[bytes, str]:
    """Return what a file holds, and its name."""
    if os.fspath(source) == STDIO:
        if sys.stdin is None:
            raise InputError("stdin", "cannot be read", got="a closed stream")
        return _read_lines(sys.stdin.buffer), "stdin"
    file = pathlib.Path(source)
    with reading_errors(file), file.open("rb") as stream:
        return _read_lines(stream), os.fspath(source)


def _read_lines(stream: BinaryIO) -> bytes:
    """Read all, but no further than a stretch without a line end, which the reader then refuses."""
    parts = []
    while part := stream.read(_CHUNK):
        parts.append(part)
        if len(part) == _CHUNK and b"\n" not in part and b"\r" not in part:
            break
    return b"".join(parts)


PROGRAM_ENDINGS: Final = frozenset((".ngc", ".nc", ".tap", ".gcode", ".cnc", ".txt", ".h", ".i", ".mpf", ".spf"))
"""Endings of part programs."""

BINARY_LOG_ENDINGS: Final = frozenset((".mat", ".npz", ".parquet"))
"""Endings of records that are no text."""

DRAWING_ENDINGS: Final = frozenset((".dxf", ".svg"))
"""Endings of drawings, which are imported first."""

Kind = Literal["path", "program", "log"]

_BLOCK: Final = re.compile(rb"(?:\s|\xef\xbb\xbf)*(?:[%(;]|/?\s*[A-Za-z]\s*[-+.#\[<\d]|(?:\d+\s+)?BEGIN\s+PGM)")
"""First characters of part programs: a percent sign, a comment, a word, or ``BEGIN PGM`` of Heidenhain."""


def is_program(raw: SourceBytes) -> bool:
    """Return true for a part program, false for a path file, by the ending or else by the first characters.

    Examples
    --------
    >>> is_program(SourceBytes(name="a.nc", stem="a", data=b""))
    True
    >>> is_program(SourceBytes(name="a", stem="a", data=b"{}"))
    False

    Raises
    ------
    InputError
        Where it is neither, but a drawing.
    """
    ending = _ending(raw)
    return ending in PROGRAM_ENDINGS or (ending != ".json" and _BLOCK.match(raw.data) is not None)


def input_kind(raw: SourceBytes) -> Kind:
    """Return the kind of an input file, by its ending or else by its first characters.

    Examples
    --------
    >>> named = (("a.json", b"{"), ("a.nc", b"G1"), ("run.csv", b"t,X_cmd"), ("run.txt", b"0.5 0.25"))
    >>> [input_kind(SourceBytes(name=name, stem="", data=data)) for name, data in named]
    ['path', 'program', 'log', 'log']

    Raises
    ------
    InputError
        Where it is none of them, but a drawing.
    """
    ending = _ending(raw)
    if ending == ".json" or (ending not in BINARY_LOG_ENDINGS and raw.data.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{"):
        return "path"
    # A text file may be either.
    if ending in PROGRAM_ENDINGS and ending != ".txt":
        return "program"
    return "program" if ending not in (".csv", *BINARY_LOG_ENDINGS) and _BLOCK.match(raw.data) is not None else "log"


def _ending(raw: SourceBytes) -> str:
    """Return what a name ends with, in small letters; a drawing is refused."""
    ending = pathlib.PurePath(raw.name).suffix.lower()
    if ending in DRAWING_ENDINGS:
        wanted = "a path file, such as ph-post import makes of it"
        raise InputError(raw.name, "this is a drawing", expected=wanted)
    return ending


def read_input(
    source: str | os.PathLike[str] | SourceBytes, machine: Machine | None = None, dialect: str | None = None
) -> tuple[Path, tuple[str, ...]]:
    """Read a path file, or the longest path of a part program; ``-`` is standard input.

    What was read already, to tell one from the other, is taken as it is. A program is read by the words of
    `dialect`, or in the language that it declares, or else in the machine's.

    Returns
    -------
    path : Path
    warnings : tuple of str
        What of the program the path does not show, by lines.

    Raises
    ------
    InputError
        One line naming file and place, what was expected and what was found.
    """
    raw = source if isinstance(source, SourceBytes) else read_raw(source)
    if not is_program(raw):
        return path_of(decoded(raw)), ()
    program = read_as(dialect_of([raw.data], dialect, machine), raw.data, raw.name)
    found, warnings = main_path(program)
    notes = (f"{line_words(note.first, note.last)}: {note.what}: not in the path" for note in program.notes)
    return found.path, (*warnings, *notes)
