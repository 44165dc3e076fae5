"""Write programs that compute out before they are compensated, and get the originals back."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec

from ph_post.api.options import CompensateOptions
from ph_post.dialects.declaration import is_written_here, read_declaration, shifted_origins
from ph_post.dialects.reading import read_as
from ph_post.edit.undo import original_of
from ph_post.errors import InputError
from ph_post.expand.macro import FanucNumbers, is_doubtful
from ph_post.expand.tools import ToolShape, tools_of_table
from ph_post.expand.writing import EXPANDED, SHIFTED, Spoken, Written
from ph_post.files.storage import SourceBytes, read_source, require_folder
from ph_post.gcode.numbers import masked
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import reread
from ph_post.gcode.words import lines_of
from ph_post.types import IntArray
from ph_post.units import MM

WRITTEN_AS_LINUXCNC: Final = ("linuxcnc", "grbl", "grblhal")
"""Dialects whose programs are written out as LinuxCNC would run them."""

_OTHERS: Final[Mapping[str, Spoken]] = {"siemens": "siemens", "heidenhain": "heidenhain"}
"""Languages of other dialects, but of Fanuc's."""


def expanded_job(
    job: PartProgram | SourceBytes, dialect: str, options: CompensateOptions
) -> tuple[PartProgram | SourceBytes, tuple[str, ...]]:
    """Write a program out where the options ask for it.

    Parameters
    ----------
    job : PartProgram or SourceBytes
    dialect : str
        The machine's.
    options : CompensateOptions

    Returns
    -------
    job : PartProgram or SourceBytes
        The same where nothing is asked for, nothing is computed, or it cannot be worked out.
    notes : tuple of str
        What has to be known, and why a program stays as it is, a sentence each.

    Raises
    ------
    InputError
        Where the program is no text, or the file of parameters or of tools cannot be read; of `strict` options also
        where the program cannot be written out.
    """
    if not options.expand or read_declaration(job.data) is not None or EXPANDED.first(job.data) >= 0:
        return job, ()
    from ph_post.expand.expand import ExpandError, Folders, expand  # 20 modules, of no use to most programs

    parameters, tools = controller_files(options)
    if dialect.partition("+")[0] not in (*WRITTEN_AS_LINUXCNC, "fanuc", *_OTHERS):
        return job, (f"{job.name}: not written out: programs of {dialect} are taken as they are",)
    lines_of(job.data, job.name)
    folders = Folders(_folders(job.name, options.subprograms))
    version = options.controller_version
    try:
        found = expand(
            job.data,
            job.name,
            folders,
            language=_spoken(job.data, dialect, options),
            parameters=parameters,
            tools=tools,
            inches=options.controller_units == "inch",
            version=None if version is None else tuple(int(part) for part in version.split(".")),
        )
    except ExpandError as error:
        where = f"{error.file or job.name}:{max(error.line, 1)}"
        if options.strict:
            raise InputError(where, error.what, expected=error.expected, got=error.got) from None
        said = InputError(where, error.what, expected=error.expected, got=error.got)
        return job, (f"{said}: not written out, the program stays as it is",)
    if found.origins is None:
        return job, found.notes
    made = read_as(dialect, found.data, job.name, strict=options.strict)
    return msgspec.structs.replace(made, origins=found.origins), found.notes


def _spoken(data: bytes, dialect: str, options: CompensateOptions) -> Spoken:
    """Return the language from which a program of a dialect is written out."""
    base = dialect.partition("+")[0]
    if base != "fanuc":
        return _OTHERS.get(base, "linuxcnc")
    return FanucNumbers(
        decimals=4 if "isc" in dialect else 3,
        calculator="calculator" in dialect,
        doubtful=is_doubtful(data, masked(data)),
        clearance=None if options.peck_clearance is None else options.peck_clearance / MM,
        lathe="lathe" in dialect,
    )


def _folders(name: str, asked: tuple[str, ...]) -> tuple[Path, ...]:
    """Return where subprograms may be: beside the program, and where the user says."""
    own = Path(name)
    return (*((own.parent,) if own.is_file() else ()), *(Path(folder) for folder in asked))


def controller_files(
    options: CompensateOptions,
) -> tuple[dict[int, float] | None, dict[int, ToolShape] | None]:
    """Return the controller's parameters and tools that the options name, each None where they name no file.

    Raises
    ------
    InputError
        Where such a file, or a folder of subprograms, cannot be read.
    """
    for folder in options.subprograms:
        require_folder(folder, "subprograms")
    parameters = None if options.parameters is None else read_parameters(options.parameters)
    return parameters, None if options.tool_table is None else read_tools(options.tool_table)


def read_parameters(source: str | os.PathLike[str]) -> dict[int, float]:
    """Read a controller's file of parameters: a number and a value on each line.

    Raises
    ------
    InputError
        Where it is none.
    """
    text = read_source(source)
    found: dict[int, float] = {}
    for number, line in enumerate(text.text.splitlines(), 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        try:
            key, value = words
            found[int(key)] = float(value)
        except ValueError:
            raise InputError(
                f"{text.name}:{number}", "not a parameter", expected="its number and its value", got=line.strip()[:40]
            ) from None
    return found


def read_tools(source: str | os.PathLike[str]) -> dict[int, ToolShape]:
    """Read a controller's table of tools: `InputError` with the line that is none."""
    text = read_source(source)
    try:
        return tools_of_table(text.text)
    except ValueError as error:
        number = error.args[0]
        got = text.text.splitlines()[number - 1].strip()[:40]
        raise InputError(f"{text.name}:{number}", "not a tool", expected="words as T1 P1 D6.35", got=got) from None


def before_expansion(data: bytes, name: str) -> bytes | None:
    """Return the original of a program that was written out; None where it was not.

    Raises
    ------
    InputError
        Where the program was changed after that.
    """
    found = EXPANDED.read(data, name)
    return None if found is None else found.original


def written_out(original: PartProgram, compensated: PartProgram) -> PartProgram:
    """Return what a compensated program was made of: the original, or what it comes to where that was written out.

    The original is written out again, and has to come to the same.
    """
    try:
        plain = original_of(compensated) or compensated
        kept = EXPANDED.read(plain.data, plain.name)
        if kept is None or kept.original != original.data:
            return original
    except InputError:
        return original
    origins = _origins_again(kept, plain.data, original.name)
    if origins is None:
        return original
    return msgspec.structs.replace(reread(original, plain.data), origins=origins)


def in_own_lines(program: PartProgram) -> PartProgram:
    """Return a program that knows its lines before it was written out, and before further axes or holes were shifted.

    Those people know. What was added stands for the line behind it. A program with which neither was done is returned
    itself, as is one that was changed since then.
    """
    if program.origins is not None or not is_written_here(program.data):
        return program
    origins = _own_lines(program.data, program.name)
    return program if origins is None else msgspec.structs.replace(program, origins=origins)


def _own_lines(data: bytes, name: str) -> IntArray | None:
    """Return the line (n,) of the person's own program for which each of a text stands; None where it is theirs."""
    shifted = SHIFTED.read(data, name)
    if shifted is not None:
        found, own = shifted_origins(data, shifted.original), _own_lines(shifted.original, name)
        return found if found is None or own is None else own[found]
    try:
        kept = EXPANDED.read(data, name)
    except InputError:
        return None
    return None if kept is None else _origins_again(kept, data, name)


def _origins_again(kept: Written, data: bytes, name: str) -> IntArray | None:
    """Write an original out as it was, for the lines that those of the text come of; None where that is another one."""
    from ph_post.expand.expand import ExpandError, Folders, expand

    folders = Folders(known=kept.files)
    try:
        again = expand(
            kept.original,
            name,
            folders,
            language=kept.language,
            parameters=kept.parameters,
            tools=kept.tools,
            inches=kept.inches,
            version=kept.version,
        )
    except ExpandError:
        return None
    return again.origins if again.data == data else None
