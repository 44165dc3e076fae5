"""``ph-post filter``: compensates a file for the screens of LinuxCNC, which call it to load the file."""

from __future__ import annotations

import os
import pathlib
import sys
from typing import Any, Final

import click

from ph_post.cli import options
from ph_post.errors import InputError

BESIDE: Final = "ph-post.toml"
"""Machine file beside LinuxCNC's INI file, where nothing else names one."""

_INI: Final = "INI_FILE_NAME"
"""Environment variable in which LinuxCNC passes the place of its INI file."""

_DIALECT: Final = "linuxcnc"


@click.command()
@click.argument("source", metavar="PATH")
@options.pipeline
@click.option(
    "--quiet",
    is_flag=True,
    help="Print only failures on standard error, no FILTER_PROGRESS: for panels of gladevcp, "
    "which in LinuxCNC 2.9 stop at the first word there.",
)
@click.pass_context
def command(ctx: click.Context, /, source: str, machine: str | None, quiet: bool, **how: Any) -> int:
    """Filter a file for LinuxCNC: the compensated program on standard output, for the screen to load.

    PATH is a part program, or a path file (.json) that is opened in the screen like a program. The words are
    LinuxCNC's, whatever dialect the machine file names. --feed, --safe-z and --depth are for path files.

    The machine file is that of -m, or else the one that the environment variable PH_POST_MACHINE names, or
    else ph-post.toml beside the INI file. Names in the [FILTER] section count from the INI file's folder.
    `ph-post-filter` is the same command under a name of its own. In the INI file:

    \b
      [FILTER]
      PROGRAM_EXTENSION = .ngc,.nc,.tap,.json  Programs and paths
      ngc = ph-post-filter -m mill.toml
      nc = ph-post-filter -m mill.toml
      tap = ph-post-filter -m mill.toml
      json = ph-post-filter -m mill.toml --safe-z 5 --depth -1

    How far it is goes to standard error as FILTER_PROGRESS=n. Warnings stand in comments at the head of the
    program, as screens show standard error only when a filter fails; then it is one line, and exit status 2.
    Its last line is the error that backlash causes before and after, for which both programs are simulated once the
    result is written; --quiet spares that.

    \b
    Examples:
      ph-post filter -m mill.toml part.ngc > filtered.ngc
      PH_POST_MACHINE=mill.toml ph-post-filter part.json
    """
    from ph_post.cli.conversion import conversion_lines, converted, print_results, silenced
    from ph_post.cli.progress import FilterProgress
    from ph_post.files.storage import STDIO, read_raw, write_atomically
    from ph_post.report.result_line import summarize

    ctx.ensure_object(dict)["one_line"] = True
    dialect = how["dialect"] or _DIALECT
    if dialect.partition("+")[0] != _DIALECT:
        raise InputError("--dialect", "LinuxCNC reads what is filtered", expected=_DIALECT, got=dialect)
    how = {**how, "machine": _in_full(machine) if machine else _beside_the_ini(), "dialect": dialect}
    progress = FilterProgress(None if quiet else sys.stderr)
    raw = read_raw(source)
    with silenced():
        result = converted(raw, how, progress, noted=True)
        program, lines = result.program(), conversion_lines(result)
    write_atomically({STDIO: program})
    progress("done")
    if quiet:
        return 0
    for line in lines:
        click.echo(line, err=True)
    with silenced():
        outcome = summarize(result)
    print_results({"program": outcome})
    return 0


def _in_full(machine: str) -> str:
    """Name a machine file with its folder, which messages tell then: the INI file's."""
    return str(pathlib.Path(machine).absolute()) if machine.lower().endswith(".toml") else machine


def _beside_the_ini() -> str:
    """Find the machine file that lies beside LinuxCNC's INI file.

    Raises
    ------
    InputError
        Where there is none.
    """
    ini = os.environ.get(_INI, "")
    found = pathlib.Path(ini).parent / BESIDE
    if ini and found.is_file():
        return str(found)
    got = f"no {found}" if ini else f"no {_INI}, so not called by LinuxCNC"
    raise InputError(
        "machine",
        "no machine file is named",
        expected=f"-m FILE, {options.MACHINE_VARIABLE}, or {BESIDE} beside the INI file",
        got=got,
    )
