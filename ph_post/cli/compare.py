"""``ph-post compare``: plans and simulates all strategies side by side."""

from __future__ import annotations

from typing import Any

import click

from ph_post.cli import options


@click.command()
@click.argument("source", metavar="IN")
@options.machine
@options.planning
@options.carrier_of_job
@options.plot("the errors")
@options.common
def command(source: str, machine: str, plot: str | None, as_json: bool, **how: Any) -> int:
    """Plan and simulate every strategy on a job, the plain program first.

    Of a part program every strategy writes its own, as by `convert -o`, which is run on a model of the controller; so
    it is of a path with --carrier program. Else every strategy plans the path's table, as by `convert --table`. All
    cases that the machine file leaves open are simulated, as by `simulate`. The gain is the largest error of the plain
    program over that of the strategy. The slowest feed is the lowest feed while cutting: rapid moves, standstills and
    their ramps do not count. A strategy that refuses the job, or exceeds a limit of the machine, is listed with the
    reason.

    \b
    Examples:
      ph-post compare oval -m mill
      ph-post compare part.ngc -m stepper
      ph-post compare part.json -m router.toml --allow-retrograde --max-slowdown 0.2 --json
      ph-post compare part.json -m stepper --carrier program
      ph-post compare circle -m paper --start moving --plot circle.png

    \b
    JSON:
      strategies         a list of {name, error, error_worst, error_gap, cycle_time [s], min_feed [mm/min],
                         standstill_time [s], retrograde, peak_acceleration, ok, reason, chosen, warnings}
      error_without_gap  {max, rms} [mm]
      result             of the strategy that chooses: {strategy, error_gap, reversals, axes, not_compensated,
                         result_line, …} as in convert
      warnings           a list of sentences
    """
    import ph_post as ph
    from ph_post.cli.outputs import check_places
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import write_atomically
    from ph_post.report.figures import write_figure
    from ph_post.report.motion_figures import draw_comparison
    from ph_post.report.simulations import comparison_lines, comparison_view, warnings_of_choice
    from ph_post.report.tables import print_json

    check_places({"IN": source, "-m": machine}, {"--plot": plot}, json=as_json)
    with ProgressPrinter() as progress:
        found = ph.compare(source, machine, output=how["carrier"], progress=progress, **options.in_si(how))
        if plot is not None:
            progress("drawing")
            picture = draw_comparison(found.name, found.strategies)
            write_atomically({plot: write_figure(picture, plot)})
    if as_json:
        print_json(comparison_view(found))
        options.report_written(found.notes, ())
        return 0
    for line in comparison_lines(found):
        click.echo(line)
    options.report_written((*found.warnings, *warnings_of_choice(found.strategies)), () if plot is None else (plot,))
    return 0
