"""Read part programs by the words of their dialect, if need be in translation to RS274 words.

A translation has one line for each line: lines, notes, breaks and errors keep their numbers, and the record
holds the original bytes. A line whose translation is as long as itself keeps its words at their places.
"""

from __future__ import annotations

import hashlib
import os
import pathlib
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import BinaryIO, Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.dialects.declaration import declared_language
from ph_post.dialects.registry import ENDINGS, SIGNATURES, find_dialect
from ph_post.errors import InputError
from ph_post.files.storage import STDIO, reading_errors
from ph_post.gcode.language import RS274, Language
from ph_post.gcode.program import Motions, Note, PartProgram, PlaceArray, WordSource, WordTable
from ph_post.gcode.read import read_program, shortened
from ph_post.gcode.words import excerpt
from ph_post.types import Machine

XYZ_ONLY: Final = Language(further="")
"""RS274/NGC of which moves of further axes are passed through."""

NOT_UNDERSTOOD: Final = "M98"
"""A line after which neither the position nor a mode is known."""

FORGOTTEN: Final = "G999"
"""A line after which the position is not known, and all modes are (:data:`ph_post.gcode.codes.FORGETTING`)."""

_SIDES: Final = re.compile(rb"G[ \t]*(?:0*4[12](?!\d)|[\[#])", re.IGNORECASE)
"""What brings the cutter to a side of its contour, or may, as a computed G word does."""

_PLACE: Final = re.compile(r":(\d+)(?::\d+)?$")
_GOT: Final = re.compile(r"; got (\S+)$")


class Remark(msgspec.Struct, frozen=True, kw_only=True):
    """Something on a line that is not understood, and the column (from 1) where it stands."""

    what: str
    column: int = 1


def text_of(data: bytes, lines: PlaceArray, number: int) -> bytes:
    """Return a line without its end."""
    return data[lines[number] : lines[number + 1]].rstrip(b"\r\n")


def line_error(
    data: bytes, lines: PlaceArray, name: str, number: int, what: str, expected: str, got: str
) -> InputError:
    """Make the error of a line, with the line shown."""
    line = text_of(data, lines, number).decode("utf-8", "replace")
    column = line.find(got) + 1 if got and got in line else 1
    where = f"{name}:{number + 1}:{column}"
    return InputError(where, what, expected=expected, got=got, excerpt=excerpt(line, column, len(got)))


def read_translated(
    data: bytes,
    lines: PlaceArray,
    name: str,
    texts: Sequence[bytes],
    remarks: Mapping[int, Remark],
    *,
    in_place: bool,
    language: Language = XYZ_ONLY,
    words: WordTable | None = None,
) -> PartProgram:
    """Read a program by the translations of its lines.

    Parameters
    ----------
    data, lines, name
        The program; see :func:`ph_post.gcode.words.lines_of`.
    texts : sequence of bytes
        The translation of each line, without line ends.
    remarks : mapping
        What is not understood, by line (from 0); noted in place of the translation's own note.
    in_place : bool
        Whether translations that are as long as their lines have their words at the same places.
    language : Language
        Language of the translation.
    words : WordTable, optional
        The words of the program itself, in place of those of the translation.

    Raises
    ------
    InputError
        As :func:`ph_post.gcode.read.read_program`, with the original line shown.
    """
    try:
        sided = _SIDES.search(data) is not None
        found = read_program(b"\n".join([*texts, b""]), name, language=language, sided=sided)
    except InputError as error:
        raise _retold_error(error, data, lines) from None
    return replace(
        found,
        data=data,
        digest=hashlib.sha256(data).hexdigest(),
        lines=lines,
        source=WordSource(_placed(found, data, lines, texts, in_place) if words is None else words),
        notes=_notes(found, [_shown(note, data, lines) for note in found.notes], remarks, texts),
    )


def motion_rows(motions: Motions, lines: Iterable[int]) -> list[tuple[int, int]]:
    """Return the lines that move, in order, each with the row of its first motion."""
    asked = np.array(sorted(lines), dtype=np.int32)
    row = np.searchsorted(motions.block, asked, side="left")
    moves = np.searchsorted(motions.block, asked, side="right") > row
    return list(zip(asked[moves].tolist(), row[moves].tolist(), strict=True))


def _retold_error(error: InputError, data: bytes, lines: PlaceArray) -> InputError:
    """Show the original line with an error that was found in its translation."""
    place = _PLACE.search(error.where)
    number = int(place[1]) - 1 if place else -1
    if not 0 <= number < lines.size - 1:
        return error
    where = f"{_PLACE.sub('', error.where)}:{number + 1}"
    line = text_of(data, lines, number).decode("utf-8", "replace")
    text, got = str(error).replace(error.where, where, 1), _GOT.search(str(error))
    error.args = (_GOT.sub("", text) if got is not None and got[1] not in line else text,)
    error.where, error.excerpt = where, excerpt(line, 1, len(line))
    return error


def _placed(found: PartProgram, data: bytes, lines: PlaceArray, texts: Sequence[bytes], in_place: bool) -> WordTable:
    """Return the words of the lines whose words stand at the places of the original."""
    words = found.words
    same = np.array([in_place and len(text) == len(text_of(data, lines, number)) for number, text in enumerate(texts)])
    kept = np.flatnonzero(same[words.block]) if words.block.size else np.zeros(0, np.int64)
    shift = (lines[:-1] - found.lines[:-1])[words.block[kept]]
    own = words.take(kept)
    return replace(own, start=own.start + shift, end=own.end + shift).sealed()


def _notes(
    found: PartProgram, shown: Sequence[Note], remarks: Mapping[int, Remark], texts: Sequence[bytes]
) -> tuple[Note, ...]:
    """Put in order the translation's notes on other lines, and a note for each stretch of one remark."""
    end = found.breaks[-1].block
    own: list[Note] = []
    for number in sorted(line for line in remarks if line <= end):
        remark = remarks[number]
        if own and own[-1].last == number - 1 and own[-1].what == remark.what:
            own[-1] = replace(own[-1], last=number)
        else:
            own.append(Note(first=number, last=number, column=remark.column, what=remark.what))
    others = [
        piece
        for note in shown
        for piece in _without(note, remarks)
        if piece == note or any(texts[line].strip() for line in range(piece.first, piece.last + 1))
    ]
    return tuple(sorted([*own, *others], key=lambda note: note.first))


def _shown(note: Note, data: bytes, lines: PlaceArray) -> Note:
    """Show in a note the original's line where the translation's word is not on it."""
    line = text_of(data, lines, note.first).decode("utf-8", "replace")
    what, _, word = note.what.partition(": ")
    if not word or word.upper() in line.upper():
        return note
    return replace(note, column=1, what=f"{what}: {shortened(line.strip())}")


def _without(note: Note, remarks: Mapping[int, Remark]) -> list[Note]:
    """Stretches of a note between lines that have remarks of their own."""
    pieces, first = [], None
    for number in range(note.first, note.last + 2):
        free = number <= note.last and number not in remarks
        if free and first is None:
            first = number
        elif not free and first is not None:
            pieces.append(replace(note, first=first, last=number - 1))
            first = None
    return pieces


def read_as(dialect: str, data: bytes, name: str, *, strict: bool = False) -> PartProgram:
    """Read a part program by the words of a dialect.

    Parameters
    ----------
    dialect : str
        Its name; empty for the dialect of the ending of `name`, or else for the words that most controllers
        share.
    data, name, strict
        As for :func:`ph_post.gcode.read.read_program`.

    Raises
    ------
    InputError
        If there is no such dialect, or the text is no program of it.
    """
    language = _language_of(dialect, name)
    if language.read is None:
        _refuse_another(data, name)
    return read_program(data, name, strict=strict, language=language)


def read_again_as(dialect: str, program: PartProgram, *, strict: bool = False) -> PartProgram:
    """Return a program read by the words of a dialect: itself, where it was read in that language before."""
    if program.language == _language_of(dialect, program.name) and not (strict and program.notes):
        return program
    return replace(read_as(dialect, program.data, program.name, strict=strict), origins=program.origins)


def _language_of(dialect: str, name: str) -> Language:
    """Return the language of a dialect; without its name that of the file's ending, or RS274/NGC."""
    dialect = dialect or ENDINGS.get(PurePath(name).suffix.lower(), "")
    return find_dialect(dialect).language if dialect else RS274


def _refuse_another(data: bytes, name: str) -> None:
    """Refuse a program that is of another dialect beyond doubt."""
    for dialect, beginning, title in SIGNATURES:
        if beginning.match(data):
            raise InputError(
                f"{name}:1",
                f"{title}, read by other words",
                expected=f"--dialect {dialect}, or a machine file with that dialect",
            )


_CHUNK = 1 << 20


def read_program_file(
    source: str | os.PathLike[str],
    *,
    strict: bool = False,
    machine: Machine | None = None,
    dialect: str | None = None,
) -> PartProgram:
    """Read a part program from a file, or from standard input for ``-``.

    It is read in `dialect` if given, else in the dialect that it declares, else in the machine's.

    Raises
    ------
    InputError
        Where the file cannot be read, and as :func:`read_as`.
    """
    data, name = _read_bytes(source)
    return read_as(dialect_of([data], dialect, machine), data, name, strict=strict)


def read_program_pair(
    a: PartProgram | str | os.PathLike[str],
    b: PartProgram | str | os.PathLike[str],
    machine: Machine | None = None,
    dialect: str | None = None,
) -> tuple[PartProgram, PartProgram]:
    """Read two programs in one dialect: `dialect` if given, else the one that either declares, else the machine's.

    A program read before in another language is read again.

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
    """Return the name of the dialect in which programs are read.

    It is `dialect` if given, else the first that a program declares, else the machine's; empty without any.
    """
    declared = (found.name for text in texts if (found := declared_language(text)) != RS274)
    return dialect or next(declared, "" if machine is None else machine.dialect)


def _read_bytes(source: str | os.PathLike[str]) -> tuple[bytes, str]:
    """Return the content of a file, and its name."""
    if os.fspath(source) == STDIO:
        if sys.stdin is None:
            raise InputError("stdin", "cannot be read", got="a closed stream")
        return _read_lines(sys.stdin.buffer), "stdin"
    file = pathlib.Path(source)
    with reading_errors(file), file.open("rb") as stream:
        return _read_lines(stream), os.fspath(source)


def _read_lines(stream: BinaryIO) -> bytes:
    """Read all, or up to the first chunk without a line end, which the reader then refuses."""
    parts = []
    while part := stream.read(_CHUNK):
        parts.append(part)
        if len(part) == _CHUNK and b"\n" not in part and b"\r" not in part:
            break
    return b"".join(parts)
