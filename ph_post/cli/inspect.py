"""``ph-post inspect``: what would happen, nothing written."""

from __future__ import annotations

import click

from ph_post.cli import options


@click.command()
@click.argument("source", metavar="IN")
@options.optional_machine
@options.tolerance
@options.feed
@options.dialect
@click.option(
    "--certify", is_flag=True, help="Count and isolate the turning points in exact rational arithmetic."
)
@options.common
def command(
    source: str,
    machine: str | None,
    tolerance: float,
    feed: float | None,
    dialect: str | None,
    certify: bool,
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
      ph-post inspect part.ngc -m router.toml
    """
    from ph_post.cli.job import load_and_analyse
    from ph_post.report.progress import Progress
    from ph_post.report.tables import print_certificate, print_inspection, print_json
    from ph_post.report.views import certificate_view, turning_point_views
    from ph_post.turning import certify as certify_turning_points

    with Progress() as stage:
        analysis = load_and_analyse(source, machine, tolerance, stage, feed=feed, dialect=dialect)
        certificate = None
        if certify:
            stage("counting roots in exact rational arithmetic")
            certificate = certify_turning_points(analysis.track)
    if as_json:
        view = {"turning_points": turning_point_views(analysis)}
        print_json(view if certificate is None else {**view, "certificate": certificate_view(certificate)})
    else:
        print_inspection(analysis)
        if certificate is not None:
            print_certificate(certificate)
    return 0 if certificate is None or certificate.ok else 1
