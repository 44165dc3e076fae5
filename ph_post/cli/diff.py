"""``ph-post diff``: shows the differences between two programs."""

from __future__ import annotations

import os

import click

from ph_post.cli import options


@click.command()
@click.argument("a", metavar="A")
@click.argument("b", metavar="B")
@options.optional_machine
@options.dialect
@click.option(
    "--tolerance",
    type=options.close,
    default=1e-6,
    show_default=True,
    metavar="MM",
    help="Tool paths that are no farther apart count as the same.",
)
@click.option("--html", metavar="FILE", help="Write a page with path and feed; it needs no network.")
@options.plot("the tool paths, their deviation, and the feeds")
@click.option(
    "--color/--no-color",
    "colour",
    default=None,
    help="Colour, or none. [by default on a terminal, unless NO_COLOR is set]",
)
@options.common
def command(
    a: str,
    b: str,
    machine: str | None,
    dialect: str | None,
    tolerance: float,
    html: str | None,
    plot: str | None,
    colour: bool | None,
    as_json: bool,
) -> int:
    """Show the differences between the programs A and B, and between their tool paths.

    Compared are the tool paths, as exact lines, arcs and splines in the order of travel, so that a detour
    along another part of the path counts too; the feeds; the times; and spindle, coolant, tools, offsets and
    stops. Commands that ph-post does not understand are compared as text. Either program may be - for standard
    input, and need not come from ph-post.

    Exit status 0: both make the machine do the same. Differences in spelling - comments, blanks, N words, the
    order of words, a line cut in two - are shown, but do not count. 1: they differ. 2: a program cannot be
    read.

    With -m, times include rapid moves, and the contour error of both is predicted, from the path of the original
    that a program declares, else from that of A; the last line is the error that backlash causes, from A to B.

    \b
    Examples:
      ph-post diff part.ngc part_compensated.ngc
      ph-post diff old.ngc new.ngc --tolerance 0.001 --html diff.html
      ph-post convert part.ngc -m router | ph-post diff part.ngc - -m router --json

    \b
    JSON:
      same, identical  whether the machine does the same, and whether the bytes are the same
      tolerance        [mm]
      files            {name, sha256, lines, motions, length, declares} of A and B
      blocks           a list of {kind, a, b, text_a, text_b}
      geometry         {max_deviation [mm], without_declared, stretches}
      feed             {stretches}, with feeds [mm/min]
      time             {a, b, stretches} [s]
      orders, notes    other commands that differ; stretches compared as text
      error            with -m: {a, b}, contour error [mm], else null
      error_gap        with -m: {a, b, b_worst}: what backlash adds [mm], else null
      result_line      with -m: the line of the result, else null
    """
    import ph_post as ph
    from ph_post.cli.outputs import check_places
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import STDIO, Content, write_atomically
    from ph_post.report.diff_page import diff_page
    from ph_post.report.diffs import diff_view, print_diff
    from ph_post.report.figures import write_figure
    from ph_post.report.tables import print_json
    from ph_post.units import MM

    options.require_two_sources(a, b)
    check_places({"A": a, "B": b, "-m": machine}, {"--html": html, "--plot": plot}, json=as_json)
    products: dict[str, Content] = {}
    with ProgressPrinter() as progress:
        found = ph.diff(a, b, machine, tolerance=tolerance * MM, dialect=dialect, progress=progress)
        progress("drawing")
        if html is not None:
            products[html] = diff_page(found)
        if plot is not None:
            from ph_post.report.diff_page import draw_diff

            products[plot] = write_figure(draw_diff(found), plot)
        write_atomically(products)
    if as_json:
        print_json(diff_view(found))
    elif STDIO not in products:
        # A context knows whether its words are coloured; where nobody says, the terminal does.
        click.get_current_context().color = False if colour is None and "NO_COLOR" in os.environ else colour
        print_diff(found)
    options.report_written(found.notes, products)
    return 0 if found.same else 1
