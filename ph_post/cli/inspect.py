"""``ph-post inspect``: lists turning points, windows and backlash, and writes nothing."""

from __future__ import annotations

from typing import Any

import click

from ph_post.cli import options


@click.command()
@click.argument("source", metavar="IN")
@options.optional_machine
@options.tolerance
@options.feed
@options.dialect
@click.option("--certify", is_flag=True, help="Count and isolate the turning points in exact rational arithmetic.")
@options.plot("the path with its windows, and of the standstill at each reversal")
@options.common
def command(
    source: str,
    machine: str | None,
    certify: bool,
    plot: str | None,
    as_json: bool,
    **how: Any,
) -> int:
    """List the reversals of a path with their windows and, with a machine, their backlash.

    IN is a path file (.json), the name of a shipped one, a part program (.ngc, .nc, .tap, …), or - for
    standard input. For a program, its longest path is inspected.

    \b
    Examples:
      ph-post inspect circle -m paper
      ph-post inspect part.json -m mill.toml --json
      ph-post inspect part.json --certify
      ph-post inspect part.ngc -m router.toml --plot part.png

    \b
    JSON:
      turning_points  a list of {index, kind, segment, xi, axis, sense, position [mm], s [mm],
                      curvature [1/mm], curvature_dot, curvature_ddot, torsion, radius [mm], note,
                      window {half_length [mm], limited_by, estimate},
                      backlash {lag [s], duration [s], standstill_travel [mm]}}
      certificate     with --certify: {ok, count, found, roots, words}
    """
    import ph_post as ph
    from ph_post.cli.outputs import check_places
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import Content, write_atomically
    from ph_post.report.figures import draw_analysis, write_figure
    from ph_post.report.tables import print_inspection, print_json
    from ph_post.report.views import inspection_view

    check_places({"IN": source, "-m": machine}, {"--plot": plot}, json=as_json)
    products: dict[str, Content] = {}
    with ProgressPrinter() as progress:
        found = ph.inspect(source, machine, certify=certify, progress=progress, **options.in_si(how))
        if plot is not None:
            progress("drawing")
            products[plot] = write_figure(draw_analysis(found.analysis), plot)
        write_atomically(products)
    if as_json:
        print_json(inspection_view(found))
    else:
        print_inspection(found)
    options.report_written(found.warnings, products)
    return 0 if found.certificate is None or found.certificate.ok else 1
