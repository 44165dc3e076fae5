"""``ph-post slicer``: compensates the program that a slicer has just written."""

from __future__ import annotations

import itertools
import os
import pathlib
from typing import Any, Final

import click

from ph_post.cli import options
from ph_post.errors import InputError
from ph_post.progress import no_progress

_NAME: Final = "SLIC3R_PP_OUTPUT_NAME"
"""Slicers hand over a temporary file; this is what it will be called: a path, or a name on a print host."""

_HOST: Final = "SLIC3R_PP_HOST"
"""Where the program goes: "File", or a kind of print host."""

_BINARY: Final = b"GCDE"
"""How binary G-code begins."""


@click.command()
@click.argument("source", metavar="PATH")
@options.pipeline
@click.option(
    "--backup",
    is_flag=True,
    help="Keep the original too, beside the program if the slicer writes a file, else beside PATH: "
    f"part.gcode{options.BACKUP}, with a number added if that name holds another program.",
)
@click.pass_context
def command(ctx: click.Context, /, source: str, machine: str | None, backup: bool, **how: Any) -> int:
    """Compensate the program at PATH in place, as the post-processing script of a slicer.

    PATH is a part program, whatever its name ends with. It is replaced as a whole, or on any failure left
    byte for byte as it was: then there is one line on standard error, which slicers show, and exit status 2.
    The last line is the error that backlash causes, before and after.
    The machine file is that of -m, or else the one that the environment variable PH_POST_MACHINE names.
    `ph-post-slicer` is the same command under a name of its own.

    PrusaSlicer, SuperSlicer and OrcaSlicer pass the final name of the program in SLIC3R_PP_OUTPUT_NAME, which
    messages use, and its target in SLIC3R_PP_HOST: if that is File, a backup is written beside it. The name
    does not change. Their field for post-processing scripts takes this line:

    \b
      /home/me/ph_post/.venv/bin/ph-post-slicer -m /home/me/printer.toml

    \b
    Examples:
      ph-post slicer -m stepper part.gcode
      ph-post-slicer -m router.toml --backup --max-slowdown 0.25 part.gcode
    """
    from ph_post.cli.conversion import conversion_lines, converted_program, print_results, silenced
    from ph_post.files.storage import Content, SourceBytes, read_raw, write_atomically
    from ph_post.report.result_line import summarize

    ctx.ensure_object(dict)["one_line"] = True
    if machine is None:
        raise InputError("machine", "no machine file is named", expected=f"-m FILE, or {options.MACHINE_VARIABLE}")
    name = os.environ.get(_NAME) or source
    data = _program(source, name, read_raw(source).data)
    with silenced():
        raw = SourceBytes(name=name, stem="", data=data)
        result = converted_program(raw, {**how, "machine": machine}, no_progress)
    program = result.program()
    products: dict[str, Content] = {}
    if program != data:
        if backup:
            products[_free(_final(source, name), data)] = data
        products[source] = program
        write_atomically(products)
    for line in conversion_lines(result):
        click.echo(line, err=True)
    options.report_written((), products)
    with silenced():
        outcome = summarize(result)
    print_results({"program": outcome})
    return 0


def _program(source: str, name: str, data: bytes) -> bytes:
    """See that there is a program in text.

    Raises
    ------
    InputError
        Where the file is empty, binary, or not to be written.
    """
    if not data.strip():
        raise InputError(name, "the file is empty", expected="a part program")
    if data.startswith(_BINARY):
        raise InputError(name, "binary G-code", expected="text: binary G-code switched off in the slicer")
    if not os.access(source, os.W_OK):
        raise InputError(name, "cannot be written", got="a write-protected file")
    return data


def _final(source: str, name: str) -> str:
    """Return the place that the program will have in the end, as far as that is on this machine."""
    return name if os.environ.get(_HOST) == "File" and pathlib.Path(name).is_absolute() else source


def _free(place: str, data: bytes) -> str:
    """Return a name for a backup that is free, or holds these bytes already."""
    first = place + options.BACKUP
    names = itertools.chain((first,), (f"{first}{number}" for number in itertools.count(2)))
    return next(name for name in names if not os.path.lexists(name) or _holds(pathlib.Path(name), data))


def _holds(file: pathlib.Path, data: bytes) -> bool:
    return file.is_file() and file.read_bytes() == data
