"""``ph-post convert``: the main job, a path file in, a compensated program and table out."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import click

from ph_post.cli import options
from ph_post.units import MM, MS

if TYPE_CHECKING:
    from ph_post.analysis import Analysis
    from ph_post.gcode.options import ProgramOptions
    from ph_post.types import Plan


@click.command()
@click.argument("source", metavar="IN")
@options.machine
@click.option(
    "-o", "--output", metavar="OUT", help="Part program; - for standard output (the default without --table)."
)
@click.option(
    "--table", metavar="T", help="Interpolator table: .csv, .npz or .parquet; - for CSV on standard output."
)
@options.strategy("suppress")
@options.planning
@click.option(
    "--interval-table",
    metavar="FILE",
    help="Look backlash intervals up in a table of `ph-post sweep -o FILE.json`, not solving for them.",
)
@click.option("--dialect", help="Controller dialect in place of the machine file's.")
@click.option(
    "--feed-mode",
    type=click.Choice(["per-minute", "inverse-time"]),
    default="per-minute",
    show_default=True,
    help="F words in mm/min (G94) or in 1/min (G93).",
)
@click.option(
    "--chord-tolerance", type=options.positive, metavar="MM", help="How far a G1 chord may leave the path."
)
@click.option(
    "--block-time", type=options.positive, metavar="MS", help="Duration of the blocks in ramps and dips."
)
@click.option("--safe-z", type=float, metavar="MM", help="Height at which the path is approached and left.")
@click.option("--depth", type=float, metavar="MM", help="Z at which a planar path is cut; needs --safe-z.")
@click.option(
    "--no-simulation", is_flag=True, help="Leave `error` null in the --json object, and save its time."
)
@options.common
def command(
    source: str, machine: str, output: str | None, table: str | None, as_json: bool, **how: Any
) -> int:
    """Convert a path file into a compensated part program and/or an interpolator table.

    IN is a path file (.json), the name of a shipped one, or - for standard input. Without -o and --table the
    program goes to standard output. Files are written whole or not at all; what was reduced, shortened or
    left alone is said on standard error.

    A table leads the path by what the servos lag behind it (not with the strategies none, linear and step),
    which no program can carry. With --json the motion is simulated too, before and after: that of the table,
    or of the program where -o stands alone.

    \b
    Examples:
      ph-post convert oval -m mill -o oval.ngc
      ph-post convert part.json -m router.toml --ratio 0.3 --table part.csv -o part.ngc
      ph-post convert circle -m paper --start moving --table - > circle.csv
    """
    from ph_post.cli.job import load_and_analyse, plan_options, program_of
    from ph_post.compensate.offsets import command_of
    from ph_post.compensate.plan import make_plan
    from ph_post.io.atomic import write_atomically
    from ph_post.io.table import table_content
    from ph_post.report.progress import Progress
    from ph_post.report.tables import print_json, print_plan
    from ph_post.report.views import plan_view

    _check_outputs(output, table, as_json)
    plain = output is None and table is None and not as_json
    with Progress() as stage:
        analysis = load_and_analyse(
            source, machine, how["tolerance"], stage,
            feed=how["feed"], dialect=how["dialect"], intervals=how["interval_table"],
        )  # fmt: skip
        stage("planning the feed")
        plan = make_plan(
            analysis, plan_options(how, leading=table is not None or (as_json and output is None))
        )
        products: dict[str, str | bytes] = {}
        if table is not None:
            stage("sampling the interpolator table")
            rows = command_of(plan, analysis.track, plan.machine.servo_period)
            products[table] = table_content(rows, table)
        if output is not None or plain:
            stage("writing the program")
            products[output or "-"], plan = program_of(analysis, plan, _program_options(how))
            plan = _with_caveat(plan)
        error = None
        if as_json and not how["no_simulation"]:
            stage("simulating")
            error = _errors(analysis, plan)
        write_atomically(products)
    if as_json:
        print_json(plan_view(analysis, plan, error))
    print_plan(analysis, plan, products)
    return 0


def _errors(analysis: Analysis, plan: Plan) -> dict[str, Any]:
    """Contour errors of the motion without and with the strategy [mm]."""
    from ph_post.compensate.comparison import before_and_after
    from ph_post.report.assessments import error_view

    before, after = before_and_after(analysis, plan)
    return {"before": error_view(before.error), "after": error_view(after.error)}


def _with_caveat(plan: Plan) -> Plan:
    """Warn where the table beside a program holds what the program cannot."""
    from msgspec.structs import replace

    if not plan.inverse_dynamics:
        return plan
    warning = "the program follows the path itself: it cannot carry the inverse dynamics that is in the table"
    return replace(plan, warnings=(*plan.warnings, warning))


def _program_options(how: dict[str, Any]) -> ProgramOptions:
    """Gather what concerns the program's text, in SI; what is not given keeps its default."""
    from ph_post.gcode.options import ProgramOptions

    scale = {"chord_tolerance": MM, "block_time": MS, "safe_z": MM, "depth": MM}
    given = {name: how[name] * unit for name, unit in scale.items() if how[name] is not None}
    return ProgramOptions(feed_mode=how["feed_mode"], **given)


def _check_outputs(output: str | None, table: str | None, as_json: bool) -> None:
    """Refuse two products for one place."""
    streams = [name for name, value in (("-o", output), ("--table", table)) if value == "-"]
    streams += ["--json"] if as_json else []
    if len(streams) > 1:
        raise click.UsageError(f"standard output can take one product; got {' and '.join(streams)}")
    if (
        output not in (None, "-")
        and table is not None
        and FilePath(str(output)).resolve() == FilePath(table).resolve()
    ):
        raise click.UsageError(f"-o and --table name the same file; got {output}")
