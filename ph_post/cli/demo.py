"""``ph-post demo``: the main job on a shipped path and a shipped machine."""

from __future__ import annotations

import click

from ph_post.cli import options

PATH, MACHINE = "oval", "mill"
"""The shipped path and machine of the demonstration."""


@click.command()
@click.option(
    "--out", default="ph_post_demo", show_default=True, metavar="FOLDER", help="Where the files go."
)
@options.common
def command(out: str, as_json: bool) -> int:
    """Convert a shipped oval for a shipped mill, and show what was done.

    Writes the part program, the interpolator table and a picture into FOLDER and prints a line for every
    turning point: lag of the reversal, duration of the backlash, window, and how far the feed dips.
    """
    from ph_post.cli.job import load_and_analyse, program_of
    from ph_post.compensate.options import PlanOptions
    from ph_post.compensate.plan import make_plan
    from ph_post.compensate.sample import sample
    from ph_post.io.atomic import make_folder, write_atomically
    from ph_post.io.shipped import shipped
    from ph_post.io.table import table_content
    from ph_post.report.figures import draw_plan, render
    from ph_post.report.progress import Progress
    from ph_post.report.tables import dip_table, print_json, print_plan
    from ph_post.report.views import plan_view

    with Progress() as stage:
        analysis = load_and_analyse(str(shipped("paths", PATH)), MACHINE, options.DEFAULT_TOLERANCE_MM, stage)
        stage("planning the feed")
        plan = make_plan(analysis, PlanOptions())
        program, plan = program_of(analysis, plan)
        stage("sampling and drawing")
        folder = make_folder(out)
        command_rows = sample(plan, analysis.track, plan.machine.servo_period)
        products: dict[str, str | bytes] = {
            str(folder / f"{PATH}.ngc"): program,
            str(folder / f"{PATH}.csv"): table_content(command_rows, f"{PATH}.csv"),
            str(folder / f"{PATH}.png"): render(draw_plan(analysis, plan), "png"),
        }
        write_atomically(products)
    if as_json:
        print_json(plan_view(analysis, plan))
    else:
        click.echo(dip_table(analysis, plan))
    print_plan(analysis, plan, products)
    return 0
