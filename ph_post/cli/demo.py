"""``ph-post demo``: the main job on a shipped path and a shipped machine."""

from __future__ import annotations

import click

from ph_post.cli import options

PATH, MACHINE = "oval", "mill"
"""The shipped path and machine of the demonstration."""

EFFORT = 0.01
"""Search effort, much less than that of `convert`: a demonstration should be quick."""


@click.command()
@click.option("--out", default="ph_post_demo", show_default=True, metavar="FOLDER", help="Folder for the files.")
@options.common
def command(out: str, as_json: bool) -> int:
    """Compensate a shipped oval for a shipped mill.

    Writes the part program, the interpolator table and a picture into FOLDER, planned with the strategy
    `auto` after a short search, and prints a line for every reversal of the table: lag, duration of the
    backlash, window, feed dip, backlash take-up and strategy.

    \b
    Examples:
      ph-post demo
      ph-post demo --out shown

    \b
    JSON:
      windows, cycle_time, error, error_gap, reversals, axes, not_compensated, strategy, other_crossings, bias,
      offsets, inverse_dynamics, warnings
               as of convert, of the table
      carrier  table
      program  the same object of the program
    """
    from ph_post.api.compensation import PathCompensation, compensate
    from ph_post.cli.conversion import print_results
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import make_folder, write_atomically
    from ph_post.files.table import table_content
    from ph_post.report.figures import draw_plan, write_figure
    from ph_post.report.result_line import plan_result_view, summarize
    from ph_post.report.tables import dip_table, print_json, print_plans

    with ProgressPrinter() as progress:
        result = compensate(PATH, MACHINE, output="table", strategy="auto", effort=EFFORT, progress=progress)
        assert isinstance(result, PathCompensation)
        analysis, rows = result.analysis, result.table()
        program = result.program()
        progress("drawing")
        folder = make_folder(out)
        products: dict[str, str | bytes] = {
            str(folder / f"{PATH}.ngc"): program,
            str(folder / f"{PATH}.csv"): table_content(rows, f"{PATH}.csv"),
            str(folder / f"{PATH}.png"): write_figure(draw_plan(analysis, result.plans["table"]), f"{PATH}.png"),
        }
        write_atomically(products)
        progress("simulating")
        found = {output: summarize(result, output) for output in result.plans}
    if as_json:
        program_rows = result.motion("program").command
        beside = plan_result_view(analysis, result.plans["program"], program_rows, found["program"])
        table = plan_result_view(analysis, result.plans["table"], rows, found["table"])
        print_json({**table, "carrier": "table", "program": beside})
    else:
        click.echo(dip_table(analysis, result.plans["table"]))
    print_plans({str(output): plan for output, plan in result.plans.items()}, products)
    print_results({str(output): one for output, one in found.items()})
    return 0
