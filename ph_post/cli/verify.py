"""``ph-post verify``: proves that only what was declared was changed."""

from __future__ import annotations

import click

from ph_post.cli import options


@click.command()
@click.argument("original", metavar="ORIGINAL")
@click.argument("compensated", metavar="COMPENSATED")
@click.option(
    "--tolerance",
    type=options.close,
    default=options.DEFAULT_TOLERANCE_MM,
    show_default=True,
    metavar="MM",
    help="Largest deviation of the path in changed stretches, and the longest move of an axis that may be"
    " ignored; the value given to `convert`.",
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
    """Prove that COMPENSATED differs from ORIGINAL only as its header declares.

    The check is independent of the code that compensates. Outside the marked stretches every byte must be that
    of the original, except numbers of axes with a declared offset, which differ by exactly this offset. After
    every block, modes, feed, spindle, coolant and tool must be the same; no command may be lost, added or
    moved. Without the declared offsets and backlash take-up moves, the tool must follow the same path within
    the tolerance, every part of it once and in order. An axis may be shifted only between two dwells, by a
    rapid or by a way of a print through the air, as the direction of travel requires, and not where a tool is
    changed, an axis is homed or probed, or the program ends. No feed may exceed that of the original, but where
    backlash is crossed on the fly: there the motor's way is longer, and F is higher by as much. With -m, shifts
    must respect the limits of the machine, and offsets its lost motion.

    The first failures are listed, all of them with --json. Exit status 0: passed; 1: failed; 2: a program
    cannot be read. Either program may be - for standard input.

    \b
    Examples:
      ph-post verify part.ngc part_compensated.ngc
      ph-post verify part.ngc part_compensated.ngc -m router --json
      ph-post convert part.ngc -m router -o - | ph-post verify part.ngc - --tolerance 0.01

    \b
    JSON:
      ok        whether the check passed
      failures  a list of failures
      found     the number of failures
      checked   the number of items checked, by kind
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
