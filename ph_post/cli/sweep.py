"""``ph-post sweep``: computes backlash intervals over grids of β and C, off line."""

from __future__ import annotations

import math

import click

from ph_post.bounds import MOST_INTERVALS
from ph_post.cli import options
from ph_post.units import MM, MM_PER_MIN


def _grid(_ctx: click.Context, parameter: click.Parameter, text: str | None) -> tuple[float, ...] | None:
    """Read ``low:high:count``, ``low:high:count:log`` or ``a,b,c`` as ascending numbers; β alone may be 0."""
    if text is None:
        return None
    try:
        numbers = sorted(_span(text) if ":" in text else [float(word) for word in text.split(",")])
    except (ValueError, OverflowError):
        raise click.BadParameter(f"expected low:high:count, low:high:count:log or a,b,c; got {text!r}") from None
    zero = parameter.name == "beta"
    for number in numbers:
        if not math.isfinite(number) or number < 0.0 or (number == 0.0 and not zero):
            raise click.BadParameter(f"expected numbers {'0 or more' if zero else 'above 0'}; got {number:g}")
    if len(set(numbers)) < len(numbers):
        raise click.BadParameter(f"expected each number once; got {text!r}")
    return tuple(numbers)


def _span(text: str) -> list[float]:
    """Numbers of ``low:high:count[:log]``, both ends included."""
    low_word, high_word, count_word, *rest = text.split(":")
    low, high, count = float(low_word), float(high_word), int(count_word)
    if rest not in ([], ["log"]) or not 1 <= count <= MOST_INTERVALS or high < low or (count == 1 and high != low):
        raise ValueError(text)
    if count == 1:
        return [low]
    parts = [k / (count - 1) for k in range(1, count - 1)]
    if rest:
        start, end = math.log(low), math.log(high)
        inner = [math.exp(start + (end - start) * part) for part in parts]
    else:
        inner = [low + (high - low) * part for part in parts]
    return [low, *inner, high]


@click.command()
@click.argument("source", metavar="[IN]", required=False)
@options.machine
@click.option(
    "--beta",
    callback=_grid,
    required=True,
    metavar="GRID",
    help="Values of β, the motor's own decay rate 1/τ [1/s].",
)
@click.option(
    "--gain",
    callback=_grid,
    required=True,
    metavar="GRID",
    help="Values of C = N/(η r b), the motor's acceleration in the backlash for each metre of error [rad/(m s²)].",
)
@click.option(
    "--axis",
    "axes",
    multiple=True,
    metavar="AXIS",
    help='Axis to tabulate; may be repeated. [every axis with feedback "load"]',
)
@click.option("--radius", callback=_grid, metavar="GRID", help="Radii of the circles [mm]; needs --feed.")
@click.option(
    "--feed",
    callback=_grid,
    metavar="GRID",
    help="Feeds along the circles [mm/min]; with IN one feed, in place of the path's.",
)
@click.option("-o", "--output", metavar="OUT", help="Table: .json or .csv; - for CSV on standard output.")
@options.plot("the durations over β and C, on the first circle")
@options.common
def command(
    source: str | None,
    machine: str,
    beta: tuple[float, ...],
    gain: tuple[float, ...],
    axes: tuple[str, ...],
    radius: tuple[float, ...] | None,
    feed: tuple[float, ...] | None,
    output: str | None,
    plot: str | None,
    as_json: bool,
) -> int:
    """Work out how long backlash holds an axis, over grids of β and C.

    The intervals are those of the orbit an axis settles to on a circle at constant feed, for each β and C
    with everything else as in the machine file. A controller looks its Δt up in such a table instead of
    solving for it; `convert --interval-table` does so too, for a motor whose β and C were measured anew.

    The circles are those of the turning points of IN (a path file, the name of a shipped one, or a part
    program), every radius at every feed that occurs; or those of --radius and --feed, between which Δt can
    be interpolated for any path; or else the circle of the paper's example. In space the amplitude of the
    axis stands for the radius and its peak speed for the feed.

    A GRID is low:high:count, low:high:count:log (equal ratios) or a list a,b,c. Without -o the table goes to
    standard output as CSV. In JSON, `tables` holds one entry for each axis and circle with a matrix
    `duration` [s], a row for each β and null where there is no such orbit, and likewise `lag` [s] of the
    reversal behind the command's and `position` [mm] of the standstill; `duration` beside it is the first.

    \b
    Examples:
      ph-post sweep -m paper --beta 0.5:2:16 --gain 1e5:2e5:21 --json
      ph-post sweep oval -m mill --beta 1,2,4 --gain 1e7:4e7:13:log -o mill.json --plot mill.png
      ph-post sweep -m mill --beta 2 --gain 2e7,3e7 --radius 1:99:12:log --feed 200:6000:9:log -o mill.json

    \b
    JSON:
      beta, C         the grids
      duration        a matrix [s], a row for each β; null where there is no such orbit
      tables          a list of {axis, radius [mm], feed [mm/min], duration, lag [s], position [mm]}
      machine, axes   what it was worked out for
      format, version  of the file
    """
    import ph_post as ph
    from ph_post.cli.outputs import check_places
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.drive.intervalfile import interval_content, interval_view
    from ph_post.files.storage import Content, write_atomically
    from ph_post.report.figures import draw_intervals, write_figure
    from ph_post.report.tables import print_json

    check_places({"IN": source, "-m": machine}, {"-o": output, "--plot": plot}, json=as_json)
    with ProgressPrinter() as progress:
        table = ph.sweep(
            machine,
            beta,
            gain,
            job=source,
            radius=None if radius is None else [one * MM for one in radius],
            feed=None if feed is None else [one * MM_PER_MIN for one in feed],
            axes=axes,
            progress=progress,
        )
        products: dict[str, Content] = {}
        if output is not None or not as_json:
            products[output or "-"] = interval_content(table, output or "-")
        if plot is not None:
            products[plot] = write_figure(draw_intervals(table), plot)
        write_atomically(products)
    options.report_written(table.warnings, products)
    if as_json:
        print_json(interval_view(table))
    return 0
