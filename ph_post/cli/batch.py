"""``ph-post batch``: compensates every program of a folder, on many processes."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ph_post.cli import options

if TYPE_CHECKING:
    from ph_post.batch.rows import BatchRow
    from ph_post.batch.run import BatchResult


@click.command()
@click.argument("folder", metavar="FOLDER")
@click.argument("more", metavar="[MACHINE]...", nargs=-1)
@click.option(
    "-m",
    "--machine",
    "machines",
    multiple=True,
    required=True,
    metavar="MACHINE",
    help="Machine file (.toml), or the name of a shipped one; several times, or several names behind FOLDER and -m,"
    " for several machines.",
)
@click.option("-o", "--output", required=True, metavar="FOLDER", help="Where programs and report are written.")
@options.workers
@options.scheduler
@options.strategy(None, "auto; suppress where a profile is described")
@options.planning
@options.writing
@options.feed_mode
@options.expanding
@options.force
@options.strict
@click.option(
    "--require-all",
    is_flag=True,
    help="Refuse a program where a reversal at which the tool cuts is not compensated.",
)
@click.option("--no-simulation", is_flag=True, help="Skip the simulation: the report has no errors then.")
@options.common
def command(
    folder: str, more: tuple[str, ...], machines: tuple[str, ...], output: str, as_json: bool, **how: Any
) -> int:
    """Compensate every program of a folder, for every machine, on many processes.

    All part programs and path files of FOLDER, and of the folders inside it, are compensated as by `convert`, to the
    same bytes. They keep their names in the folder of -o (part.json becomes part.ngc, part.gcode or part.mpf as the
    dialect has it); for several machines each machine has a folder there, named as its file. --feed,
    --corner-tolerance, --safe-z, --depth and --feed-mode are for path files. Links to folders are not followed.

    Beside them stand report.csv, with a row for each program and machine, the same as report.parquet where pyarrow is
    installed, and report.html for people. Rows are written as results come. A program that is refused is a row with
    the reason; it does not stop the others. What a worker was at that dies is given to another. Of names, line ends
    and bytes that are no text stand as \\n and \\xff; in report.csv a ' stands before what a spreadsheet would compute.

    After Ctrl-C, the same command goes on where it stopped; where nothing has changed it does nothing. What counts are
    the contents of program and machine file, the options and the version of ph-post. A program that is already there,
    and that ph-post did not write, is not overwritten; --force overrides.

    Without --scheduler, each of N processes has an equal share of the memory; one that needs more is ended, and its
    program given to another, in the end refused. With --scheduler the workers are those of `dask worker`, with the
    same versions of ph-post and Dask; they need no common disk.

    Exit status: 0 where every program is done; 1 where at least one was refused; 2 bad usage or input, before
    anything is written, or a scheduler that went away; 130 interrupted.

    \b
    Examples:
      ph-post batch from_cam -m router.toml -o to_machine
      ph-post batch from_cam -m router.toml -m mill.toml -o compensated --workers 4
      ph-post batch from_cam -m router.toml -o to_machine --scheduler tcp://node1:8786

    \b
    JSON:
      programs       number of rows
      compensated, unchanged, refused, failed
                     how many of them; failed: no worker survived it
      kept           rows of an earlier run
      report         the files of the report
      rows           a list of objects with the columns of report.csv [mm, s]
    """
    from ph_post.api.options import CompensateOptions
    from ph_post.batch.run import BatchRequest, run_batch
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.report.tables import print_json

    request = BatchRequest(
        options=CompensateOptions(**options.in_si(how)),
        simulated=not how["no_simulation"],
        workers=how["workers"],
        scheduler=how["scheduler"],
    )
    with terminated(), ProgressPrinter() as progress:
        result = run_batch(folder, (*machines, *more), output, request, progress, _say_refused)
    if as_json:
        print_json(_view(result, output))
    click.echo(_summary(result, output), err=True)
    return 0 if result.ok else 1


@contextlib.contextmanager
def terminated() -> Iterator[None]:
    """Stop as by Ctrl-C where the system ends the process, as SLURM does."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _say_refused(row: BatchRow) -> None:
    if row.status in ("refused", "failed"):
        click.echo(f"ph-post: {row.file} for {row.machine}: {row.status}: {row.reason}", err=True)


def _summary(result: BatchResult, output: str) -> str:
    from ph_post.batch.run import TABLE
    from ph_post.files.check import counted

    said = [f"{number} {status}" for status, number in result.counts.items() if number]
    kept = f"; {result.kept} of an earlier run" if result.kept else ""
    # Refusals of an earlier run are not listed again, and a script sees but the exit status.
    why = "" if result.ok else f"; why is in {Path(output) / TABLE}, exit status 1"
    return f"{counted(len(result.rows), 'result')}: {', '.join(said)}{kept}{why}"


def _view(result: BatchResult, output: str) -> dict[str, Any]:
    from ph_post.batch.rows import row_view
    from ph_post.batch.run import report_files

    return {
        "programs": len(result.rows),
        **result.counts,
        "kept": result.kept,
        "report": report_files(output),
        "rows": [row_view(row) for row in result.rows],
    }
