"""``ph-post simulate``: simulates how the axes execute a command."""

from __future__ import annotations

from typing import Any

import click

from ph_post.cli import options


@click.command()
@click.argument("source", metavar="IN")
@options.machine
@click.option("--path", "path_file", metavar="PATHFILE", help="The path that a table was made for.")
@options.strategy("none")
@options.planning
@options.carrier
@click.option(
    "--pickup",
    type=click.Choice(["standstill", "momentum", "contact"]),
    help="This pick-up rule, whatever the machine file says.",
)
@click.option(
    "--flank",
    type=click.Choice(["+", "-"]),
    help="All axes stand on this flank at first, whatever the machine file says.",
)
@click.option("--log", metavar="OUT.csv", help="Commanded and executed motion; - for standard output.")
@options.plot("the contour error")
@options.common
def command(
    source: str,
    machine: str,
    path_file: str | None,
    pickup: Any,
    flank: Any,
    log: str | None,
    plot: str | None,
    as_json: bool,
    **how: Any,
) -> int:
    """Run a path or an interpolator table on the machine, and show how far the table leaves the path.

    IN is a path file (.json), the name of a shipped one, a part program (.ngc, .nc, .tap, …) or - for
    standard input, and is planned first as `convert --table` would; or it is an interpolator table (.csv,
    .npz, .parquet). Of a table the contour error is told where --path names the path it was made for.

    What the machine file leaves open is tried: the flank on which an axis stands at first, the pick-up rule,
    and gap, beta and gain off by their uncertainties. `error` is the worse of the first two at the file's
    values, `error_worst` the worst of all; log, picture and events are those of `error`. Errors count from
    five servo time constants after the start.

    \b
    Examples:
      ph-post simulate oval -m mill
      ph-post simulate oval -m mill --strategy suppress --plot oval.png --log oval_log.csv
      ph-post simulate part.csv --path part.json -m mill.toml --json

    \b
    JSON:
      cycle_time          [s]
      error, error_gap    {max, rms} [mm], and what of it the gap adds
      error_worst         {max, rms} [mm] of the worst machine
      per_turning_point   a list of {index, axis, sense, s, extreme, error, error_gap}
      events              a list of {t [s], axis, kind}
      scenario            the machine that error is of
      scenarios           every machine that was tried, with its error
      warnings            a list of sentences
    """
    import ph_post as ph
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import Content, write_atomically
    from ph_post.report.figures import write_figure
    from ph_post.report.motion_figures import draw_run
    from ph_post.report.simulations import simulation_lines, simulation_view
    from ph_post.report.tables import print_json

    if log == "-" and as_json:
        raise click.UsageError("standard output can take one product; got two for it")
    products: dict[str, Content] = {}
    with ProgressPrinter() as progress:
        found = ph.simulate(
            source,
            machine,
            path=path_file,
            output=how["carrier"],
            pickup=pickup,
            initial_flank=flank,
            progress=progress,
            **options.in_si(how),
        )
        if log is not None:
            products[log] = found.log()
        if plot is not None:
            progress("drawing")
            products[plot] = write_figure(draw_run(found), plot)
        write_atomically(products)
    if as_json:
        print_json(simulation_view(found))
    elif log != "-":
        for line in simulation_lines(found):
            click.echo(line)
    options.report_written(found.warnings, products)
    return 0
