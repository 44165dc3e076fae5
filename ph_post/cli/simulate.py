"""``ph-post simulate``: simulates how the axes execute a command."""

from __future__ import annotations

from typing import Any

import click

from ph_post.cli import options


@click.command()
@click.argument("source", metavar="IN")
@options.machine
@click.option("--path", "path_file", metavar="PATHFILE", help="Path file that the table was made for.")
@options.strategy("none")
@options.planning
@options.carrier
@click.option(
    "--pickup",
    type=options.Word(["standstill", "momentum", "contact"]),
    help="Pick-up rule in place of that of the machine file.",
)
@click.option(
    "--flank",
    type=options.Word(["+", "-"]),
    help="Way in which all axes moved last before the start, in place of that of the machine file.",
)
@click.option("--log", metavar="OUT.csv", help="Write commanded and executed motion; - for standard output.")
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
    """Simulate a path or an interpolator table on the machine, and show the errors of the part.

    IN is a path file (.json), the name of a shipped one, a part program (.ngc, .nc, .tap, …) or - for
    standard input; it is planned first, as by `convert --table`. (`ph-post report` runs a part program on a
    model of its controller instead.) Or IN is an interpolator table (.csv, .npz, .parquet); its contour error
    is computed if --path names the path that it was made for.

    All cases that the machine file leaves open are simulated: the side of the backlash on which an axis
    starts, the pick-up rule, and backlash, beta and gain off by their uncertainties. `error` is the worst of
    the first two at the values of the file, `error_worst` the worst of all cases; log, picture and events
    belong to `error`. Errors count from five servo time constants after the start.

    \b
    Examples:
      ph-post simulate oval -m mill
      ph-post simulate oval -m mill --strategy suppress --plot oval.png --log oval_log.csv
      ph-post simulate part.csv --path part.json -m mill.toml --json

    \b
    JSON:
      cycle_time          [s]
      error, error_gap    {max, rms} [mm], and the part of it that backlash causes
      error_worst         {max, rms} [mm] of the worst case
      per_turning_point   a list of {index, axis, sense, s, extreme, error, error_gap}
      events              a list of {t [s], axis, kind}
      scenario            the case that error belongs to
      scenarios           every simulated case, with its error
      reversals, axes     {compensated, all}, and the compensated axes
      not_compensated     what is not, and what would change that
      result_line         the line of the result
      warnings            a list of sentences
    """
    import ph_post as ph
    from ph_post.cli.outputs import check_places
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import Content, write_atomically
    from ph_post.report.figures import write_figure
    from ph_post.report.motion_figures import draw_run
    from ph_post.report.simulations import simulation_lines, simulation_view
    from ph_post.report.tables import print_json

    check_places({"IN": source, "-m": machine, "--path": path_file}, {"--log": log, "--plot": plot}, json=as_json)
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
