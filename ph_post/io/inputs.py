"""What commands take as IN: a path file, or a part program whose path is read from its motions."""

from __future__ import annotations

import os
import pathlib
import re
from typing import Final, Literal

from ph_post.errors import InputError
from ph_post.gcode.paths.build import line_words, main_path
from ph_post.gcode.reading import read_as
from ph_post.io.pathfile import path_of
from ph_post.io.programfile import words_of
from ph_post.io.source import Raw, decoded, read_raw
from ph_post.types import Machine, Path

ENDINGS: Final = frozenset((".ngc", ".nc", ".tap", ".gcode", ".cnc", ".txt", ".h", ".i", ".mpf", ".spf"))
"""Endings of part programs."""

STORED: Final = frozenset((".mat", ".npz", ".parquet"))
"""Endings of records that are no text."""

DRAWINGS: Final = frozenset((".dxf", ".svg"))
"""Endings of drawings, which are imported first."""

Kind = Literal["path", "program", "log"]

_BLOCK: Final = re.compile(
    rb"(?:\s|\xef\xbb\xbf)*(?:[%(;]|/?\s*[A-Za-z]\s*[-+.#\[<\d]|(?:\d+\s+)?BEGIN\s+PGM)"
)
"""How part programs begin: with a percent sign, a comment, a word, or as Heidenhain has it."""


def is_program(raw: Raw) -> bool:
    """Tell a part program from a path file, by its ending or else by how it begins.

    Examples
    --------
    >>> is_program(Raw(name="a.nc", stem="a", data=b"")), is_program(Raw(name="a", stem="a", data=b"{}"))
    (True, False)

    Raises
    ------
    InputError
        Where it is neither, but a drawing.
    """
    ending = _ending(raw)
    return ending in ENDINGS or (ending != ".json" and _BLOCK.match(raw.data) is not None)


def kind_of(raw: Raw) -> Kind:
    """Tell a path file, a part program, and a record of what a machine did, by ending or by how it begins.

    Examples
    --------
    >>> named = (("a.json", b"{"), ("a.nc", b"G1"), ("run.csv", b"t,X_cmd"), ("run.txt", b"0.5 0.25"))
    >>> [kind_of(Raw(name=name, stem="", data=data)) for name, data in named]
    ['path', 'program', 'log', 'log']

    Raises
    ------
    InputError
        Where it is none of them, but a drawing.
    """
    ending = _ending(raw)
    if ending == ".json" or (ending not in STORED and raw.data.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{"):
        return "path"
    # A text file may be either.
    if ending in ENDINGS and ending != ".txt":
        return "program"
    return "program" if ending not in (".csv", *STORED) and _BLOCK.match(raw.data) is not None else "log"


def _ending(raw: Raw) -> str:
    """Return what a name ends with, in small letters; a drawing is refused."""
    ending = pathlib.PurePath(raw.name).suffix.lower()
    if ending in DRAWINGS:
        wanted = "a path file, such as ph-post import makes of it"
        raise InputError(raw.name, "this is a drawing", expected=wanted)
    return ending


def read_input(
    source: str | os.PathLike[str] | Raw, machine: Machine | None = None, dialect: str | None = None
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
    raw = source if isinstance(source, Raw) else read_raw(source)
    if not is_program(raw):
        return path_of(decoded(raw)), ()
    program = read_as(words_of([raw.data], dialect, machine), raw.data, raw.name)
    found, warnings = main_path(program)
    notes = (f"{line_words(note.first, note.last)}: {note.what}: not in the path" for note in program.notes)
    return found.path, (*warnings, *notes)
