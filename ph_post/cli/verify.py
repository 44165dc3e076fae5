"""``ph-post verify``: proves that only what was declared was changed."""

from __future__ import annotations

import click

from ph_post.cli import options


@click.command()
@click.argument("original", metavar="ORIGINAL")
@click.argument("compensated", metavar="COMPENSATED")
@click.option(
    "--tolerance",
    type=options.positive,
    default=options.DEFAULT_TOLERANCE_MM,
    show_default=True,
    metavar="MM",
    help="How far the way may be off in changed stretches, and the longest excursion of an axis that need"
    " not be followed; give the one of `convert`.",
)
@options.optional_machine
@options.dialect
@options.common
def command(
    original: str,
    compensated: str,
    tolerance: float,
    machine: str | None,
    dialect: str | None,
    as_json: bool,
) -> int:
    """Prove that COMPENSATED is ORIGINAL but for what its header declares.

    Whatever wrote the program is not asked. Outside the marked stretches every byte has to be the original's,
    but for numbers of axes with a declared offset, which differ by exactly that. After every block the modes,
    the feed, spindle, coolant and tool have to be the same; no command may be lost, added or moved. Less the
    declared offsets and pulses the tool has to go the same way within the tolerance, each part of it once and
    in order; an axis is shifted only between two dwells or by a rapid, as the direction of travel asks, and
    not where a tool is changed, an axis is homed or probed, or the program ends. No feed may be above the
    original's. With -m the shifts are held to the machine's limits, and the declaration to its lost motion.

    The first failures are listed, with --json all of them. Exit status 0: it holds; 1: it does not; 2: one
    of the programs cannot be read. Either may be - for standard input.

    \b
    Examples:
      ph-post verify part.ngc part_compensated.ngc
      ph-post verify part.ngc part_compensated.ngc -m router --json
      ph-post convert part.ngc -m router -o - | ph-post verify part.ngc - --tolerance 0.01

    \b
    JSON:
      ok        whether it holds
      failures  a list of what does not
      found     how many failures there are
      checked   how much of each kind was looked at
    """
    import ph_post as ph
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.report.diffs import verdict_lines, verdict_view
    from ph_post.report.tables import print_json
    from ph_post.units import MM

    options.require_two_sources(original, compensated)
    with ProgressPrinter() as progress:
        verdict = ph.verify(
            original, compensated, machine, tolerance=tolerance * MM, dialect=dialect, progress=progress
        )
    if as_json:
        print_json(verdict_view(verdict))
    else:
        for line in verdict_lines(verdict):
            click.echo(line)
    return 0 if verdict.ok else 1
