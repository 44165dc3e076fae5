"""``ph-post compare``: plans and simulates all strategies side by side."""

from __future__ import annotations

from itertools import chain
from typing import Any

import click

from ph_post.cli import options


@click.command()
@click.argument("source", metavar="IN")
@options.machine
@options.planning
@options.carrier
@options.plot("the errors")
@options.common
def command(source: str, machine: str, plot: str | None, as_json: bool, **how: Any) -> int:
    """Plan and simulate every strategy on a path, the plain program first.

    Every strategy is planned with the options given here, as `convert --table` would (as `convert -o` with
    --carrier program), and run on the machines that the machine file leaves possible, as `simulate` does. The
    gain is how many times smaller than that of the plain program the largest error is. The slowest feed is
    that while cutting: rapid moves, standstills and the ramps from and to them do not count. A strategy that
    refuses the job, or whose samples break a limit, is listed with the reason.

    \b
    Examples:
      ph-post compare oval -m mill
      ph-post compare part.json -m router.toml --allow-retrograde --max-slowdown 0.2 --json
      ph-post compare part.json -m stepper --carrier program
      ph-post compare circle -m paper --start moving --plot circle.png

    \b
    JSON:
      strategies         a list of {name, error, error_worst, error_gap, cycle_time [s], min_feed [mm/min],
                         standstill_time [s], retrograde, peak_acceleration, ok, reason, chosen, warnings}
      error_without_gap  {max, rms} [mm]
      warnings           a list of sentences
    """
    from ph_post.cli.job import effect_warnings, load_and_analyse, plan_options
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.compensate.comparison import compare_strategies, without_backlash
    from ph_post.files.storage import write_atomically
    from ph_post.report import simulations
    from ph_post.report.figures import picture_format, render
    from ph_post.report.motion_figures import draw_comparison
    from ph_post.report.tables import print_json

    with ProgressPrinter() as progress:
        analysis = load_and_analyse(
            source, machine, how["tolerance"], progress, feed=how["feed"], dialect=how["dialect"]
        )
        contenders = compare_strategies(
            analysis, lambda name: plan_options({**how, "strategy": name}, how["carrier"]), progress
        )
        floor = without_backlash(analysis, contenders[0])
        if plot is not None:
            progress("drawing")
            write_atomically({plot: render(draw_comparison(analysis.path.name, contenders), picture_format(plot))})
    assert analysis.machine is not None
    warnings = effect_warnings(analysis.machine, analysis.path.axes)
    if as_json:
        view = {"error_without_gap": simulations.error_view(floor), "warnings": warnings}
        print_json({**simulations.comparison_view(contenders), **view})
        return 0
    click.echo(simulations.comparison_table(contenders))
    said = (simulations.floor_words(floor), simulations.COLUMN_NOTES, simulations.refusals(contenders))
    for line in (*chain(*said), *simulations.choices(contenders)):
        click.echo(line)
    for warning in (*warnings, *simulations.warnings_of_choice(contenders)):
        click.echo(f"warning: {warning}", err=True)
    if plot is not None:
        click.echo(f"wrote {plot}", err=True)
    return 0
