"""``ph-post inspect``: lists turning points, windows and backlash, and writes nothing."""

from __future__ import annotations

import click

from ph_post.cli import options


@click.command()
@click.argument("source", metavar="IN")
@options.optional_machine
@options.tolerance
@options.feed
@options.dialect
@click.option("--certify", is_flag=True, help="Count and isolate the turning points in exact rational arithmetic.")
@options.plot("the path with its windows, and of what backlash does there")
@options.common
def command(
    source: str,
    machine: str | None,
    tolerance: float,
    feed: float | None,
    dialect: str | None,
    certify: bool,
    plot: str | None,
    as_json: bool,
) -> int:
    """List the turning points of a path, their windows and, with a machine, their backlash.

    IN is a path file (.json), the name of a shipped one, a part program (.ngc, .nc, .tap, …), or - for
    standard input. Of a program its longest path is taken.

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
    from ph_post.analysis.certification import certify as certify_turning_points
    from ph_post.cli.job import load_and_analyse
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import Content, write_atomically
    from ph_post.report.figures import draw_analysis, picture_format, render
    from ph_post.report.tables import print_certificate, print_inspection, print_json
    from ph_post.report.views import certificate_view, turning_point_views

    products: dict[str, Content] = {}
    with ProgressPrinter() as progress:
        analysis = load_and_analyse(source, machine, tolerance, progress, feed=feed, dialect=dialect)
        certificate = None
        if certify:
            progress("counting roots in exact rational arithmetic")
            certificate = certify_turning_points(analysis.track)
        if plot is not None:
            progress("drawing")
            products[plot] = render(draw_analysis(analysis), picture_format(plot))
        write_atomically(products)
    if as_json:
        view = {"turning_points": turning_point_views(analysis)}
        print_json(view if certificate is None else {**view, "certificate": certificate_view(certificate)})
    else:
        print_inspection(analysis)
        if certificate is not None:
            print_certificate(certificate)
    options.report_written((), products)
    return 0 if certificate is None or certificate.ok else 1
