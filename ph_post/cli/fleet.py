"""``ph-post fleet``: a machine file from every log of a folder, and what has drifted since the run before."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import click

from ph_post.cli import options
from ph_post.cli.batch import terminated
from ph_post.cli.identify import feedback_option, transmission_options
from ph_post.cli.log_options import column_option, side_option

if TYPE_CHECKING:
    from ph_post.batch.fleet import DriftRow
    from ph_post.types.diagnosis import Estimate


@click.command()
@click.argument("folder", metavar="LOGS")
@click.option(
    "-m",
    "--machine",
    metavar="MACHINE",
    help="Machine file (.toml) for all logs, the name of a shipped one, or a folder in which each log has its own: "
    "lathe.toml for lathe.csv.",
)
@click.option("-o", "--output", required=True, metavar="FOLDER", help="Where machine files and table are written.")
@options.workers
@options.scheduler
@feedback_option
@transmission_options
@column_option
@side_option
@click.option("--force", is_flag=True, help="Overwrite machine files that were changed since they were written.")
@options.common
def command(folder: str, machine: str | None, output: str, as_json: bool, **how: Any) -> int:
    """Identify a machine from every log of a folder, and say what has drifted since the run before.

    Each log of LOGS (.csv, .mat, .npz, .parquet) is that of a machine with its name: of lathe.csv `identify` makes
    lathe.toml in the folder of -o. Beside them stands drift.csv, with a row for each parameter of each axis: its value
    and standard error, those of the run before, and whether it has drifted: by more than three standard errors of
    the difference. Names stand there as in the report of `batch`. For the next run put new logs under the same
    names in place of the old ones.

    A log that is refused is a row with the reason. What an earlier run has done, of the same log, machine file,
    options and version, is not done again. Logs go to the processes of this computer, or to the workers of a Dask
    scheduler, as programs do with `batch`.

    Exit status: 0 where every log is done, whether or not anything has drifted; 1 where one was refused; 2 bad usage
    or input.

    \b
    Examples:
      ph-post fleet logs -m machines -o identified
      ph-post fleet logs --feedback motor -o identified --workers 4

    \b
    JSON:
      logs           number of logs
      kept           logs of an earlier run
      drifted        rows that have drifted
      rows           a list of objects with the columns of drift.csv
    """
    import msgspec

    from ph_post.batch.fleet import FleetRequest, drift_view, run_fleet
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.check import counted
    from ph_post.report.diagnoses import unshown_words
    from ph_post.report.tables import print_json
    from ph_post.units import MM

    lead = how.pop("screw_lead")
    request = FleetRequest(**how, screw_lead=None if lead is None else lead * MM)
    request = msgspec.structs.replace(request, columns=tuple(request.columns))
    with terminated(), ProgressPrinter() as progress:
        result = run_fleet(folder, machine, output, request, progress)
    logs = {row.log: row for row in result.rows}
    if as_json:
        drifted, rows = ([drift_view(row) for row in some] for some in (result.drifted, result.rows))
        print_json({"logs": len(logs), "kept": result.kept, "drifted": drifted, "rows": rows})
    for row in logs.values():
        if row.status != "identified":
            click.echo(f"ph-post: {row.log}: {row.status}: {row.reason}", err=True)
    for log, axes in _estimates(result.rows).items():
        for words in unshown_words(axes):
            click.echo(f"warning: {log}: {words}", err=True)
    for row in result.drifted:
        change = f"{row.before:.4g} to {row.value:.4g} {row.unit}"
        click.echo(f"{row.log}: {row.axis} {row.parameter} has drifted from {change}", err=True)
    kept = f"; {result.kept} of an earlier run" if result.kept else ""
    said = f"{counted(len(logs), 'log')}: {counted(len(result.drifted), 'parameter')} drifted"
    click.echo(f"{said}{kept}", err=True)
    return 0 if result.ok else 1


def _estimates(rows: Iterable[DriftRow]) -> dict[str, dict[str, dict[str, Estimate]]]:
    """Return what was identified by log, axis and parameter."""
    from ph_post.types.diagnosis import Estimate

    found: dict[str, dict[str, dict[str, Estimate]]] = {}
    for row in rows:
        if row.axis and row.parameter and row.value is not None:
            axes = found.setdefault(row.log, {})
            axes.setdefault(row.axis, {})[row.parameter] = Estimate(value=row.value, stderr=row.stderr, unit=row.unit)
    return found
