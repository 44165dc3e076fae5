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
    type=options.positive,
    default=1e-6,
    show_default=True,
    metavar="MM",
    help="Tool paths that are no farther apart are the same.",
)
@click.option("--html", metavar="FILE", help="A page with path and feed drawn; it needs no network.")
@options.plot("the tool paths, how far they are apart, and the feeds")
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
    """Show what differs between the programs A and B, and where the tool would go another way.

    Compared is what the programs do: the tool path as exact lines, arcs and splines, in the order of travel,
    so that a detour counts also where it runs along another part of the path; the feed along it; the time;
    and spindle, coolant, tools, offsets and stops. What is not understood is compared as text. Either
    program may be - for standard input, and need not be written by ph-post.

    Exit status 0: a machine does the same with both. That they are written differently - comments, blanks,
    N words, spelling, the order of words, a line cut in two - is shown and is no difference. 1: they differ.
    2: one of them cannot be read.

    With -m rapid moves count in the times, and the contour error that the machine would make is predicted
    for both.

    \b
    Examples:
      ph-post diff part.ngc part_compensated.ngc
      ph-post diff old.ngc new.ngc --tolerance 0.001 --html diff.html
      ph-post convert part.ngc -m router | ph-post diff part.ngc - -m router --json

    \b
    JSON:
      same, identical  whether a machine does the same, and whether the bytes are the same
      tolerance        [mm]
      files            {name, sha256, lines, motions, length, declares} of A and B
      blocks           a list of {kind, a, b, text_a, text_b}
      geometry         {max_deviation [mm], without_declared, stretches}
      feed             {stretches}, with feeds [mm/min]
      time             {a, b, stretches} [s]
      orders, notes    other commands that differ; what was compared as text
      error            with -m: contour error of A and B [mm], else null
    """
    import ph_post as ph
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import STDIO, Content, write_atomically
    from ph_post.report.diff_page import diff_page
    from ph_post.report.diffs import diff_view, print_diff
    from ph_post.report.figures import write_figure
    from ph_post.report.tables import print_json
    from ph_post.units import MM

    if as_json and html == STDIO:
        raise click.UsageError("standard output can take one product; got two for it")
    options.require_two_sources(a, b)
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
