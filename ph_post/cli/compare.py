"""``ph-post compare``: all strategies side by side."""

from __future__ import annotations

from typing import Any

import click

from ph_post.cli import options


@click.command()
@click.argument("source", metavar="IN")
@options.machine
@options.planning
@click.option("--plot", metavar="FILE", help="Picture of the errors: .png, .svg or .pdf.")
@options.common
def command(source: str, machine: str, plot: str | None, as_json: bool, **how: Any) -> int:
    """Plan and simulate every strategy on a path, the plain program first.

    Every strategy is planned with the options given here, as `convert --table` would, and run on the machines
    that the machine file leaves possible, as `simulate` does. The gain is how many times smaller than that of
    the plain program the largest error is. The slowest feed is that while cutting: rapid moves, standstills
    and the ramps from and to them do not count. A strategy that refuses the job, or whose samples break a
    limit, is listed with the reason.

    \b
    Examples:
      ph-post compare oval -m mill
      ph-post compare part.json -m router.toml --allow-retrograde --max-slowdown 0.2 --json
      ph-post compare circle -m paper --start moving --plot circle.png
    """
    from ph_post.cli.job import load_and_analyse, plan_options
    from ph_post.compensate.comparison import compare_strategies
    from ph_post.io.atomic import write_atomically
    from ph_post.report import assessments
    from ph_post.report.figures import picture_format, render
    from ph_post.report.motion_figures import draw_comparison
    from ph_post.report.progress import Progress
    from ph_post.report.tables import print_json

    picture = "" if plot is None else picture_format(plot)
    with Progress() as stage:
        analysis = load_and_analyse(source, machine, how["tolerance"], stage, feed=how["feed"])
        contenders = compare_strategies(analysis, lambda name: plan_options({**how, "strategy": name}), stage)
        if plot is not None:
            stage("drawing")
            write_atomically({plot: render(draw_comparison(analysis.path.name, contenders), picture)})
    if as_json:
        print_json(assessments.comparison_view(contenders))
        return 0
    click.echo(assessments.comparison_table(contenders))
    click.echo(assessments.STANDSTILLS)
    for line in assessments.refusals(contenders):
        click.echo(f"refused {line}")
    if plot is not None:
        click.echo(f"wrote {plot}", err=True)
    return 0
