"""``ph-post rehearse``: runs a program on LinuxCNC's planner, and its commands through the drive model."""

from __future__ import annotations

import click

from ph_post.cli import options


@click.command()
@click.argument("program", metavar="PROGRAM")
@options.machine
@click.option("--against", metavar="ORIGINAL", help="The original of PROGRAM.")
@click.option(
    "--backlash",
    is_flag=True,
    help="Also run the original with LinuxCNC's own compensation of the machine's lost motion.",
)
@click.option(
    "--limit",
    type=options.positive,
    default=600.0,
    show_default=True,
    metavar="S",
    help="Longest duration of each run on LinuxCNC.",
)
@click.option("--log", metavar="OUT.csv", help="Write commanded and executed motion; - for standard output.")
@options.plot("contour error and feed")
@options.common
def command(
    program: str,
    machine: str,
    against: str | None,
    backlash: bool,
    limit: float,
    log: str | None,
    plot: str | None,
    as_json: bool,
) -> int:
    """Run PROGRAM on an installed LinuxCNC, and simulate its commands on the machine.

    LinuxCNC runs without screen and hardware: its interpreter, planner and servo thread, with the limits and
    the servo period of the machine file. The commands to the joints in every servo period are compared with
    the plan, in speed and path, and simulated on the machine, which gives the contour error to expect. The
    original of a program that ph-post edited is run too; --against names the original of other programs, of one made
    from a path its plain program (`convert --strategy none`). Errors are measured from the original's path; the last
    line is the error that backlash causes, before and after.

    Cases that the machine file leaves open are simulated as by `simulate`. Errors count while the tool cuts,
    from five servo time constants after the start. PROGRAM may be - for standard input.

    \b
    Examples:
      ph-post rehearse part_compensated.ngc -m router --plot part.png
      ph-post rehearse part_compensated.ngc -m router --backlash --json
      ph-post convert part.ngc -m router | ph-post rehearse - -m router --against part.ngc

    \b
    JSON:
      speed     {rms, max, windows}: relative deviation from the plan in the windows
      path      {max, allowed} [mm]
      time      {plan, controller, before} [s]
      error     {before, after, planned, before_worst, after_worst, backlash}, each {max, rms} [mm]
      error_gap {before, after, after_worst}: what backlash adds; null without the original
      axes      axes that the program declares as compensated
      result_line  the line of the result; null without the original
      lockstep  whether it ran period by period, not in real time
    """
    import ph_post as ph
    from ph_post.cli.outputs import check_places
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import Content, write_atomically
    from ph_post.report.figures import write_figure
    from ph_post.report.rehearsals import draw_rehearsal, rehearsal_lines, rehearsal_view
    from ph_post.report.tables import print_json

    inputs = {"PROGRAM": program, "--against": against, "-m": machine}
    check_places(inputs, {"--log": log, "--plot": plot}, json=as_json)
    options.require_two_sources(against, program)
    products: dict[str, Content] = {}
    with ProgressPrinter() as progress:
        found = ph.rehearse(program, machine, original=against, backlash=backlash, limit=limit, progress=progress)
        if log is not None:
            products[log] = found.log()
        if plot is not None:
            progress("drawing")
            products[plot] = write_figure(draw_rehearsal(found), plot)
        write_atomically(products)
    if as_json:
        print_json(rehearsal_view(found))
    elif log != "-":
        for line in rehearsal_lines(found):
            click.echo(line)
    options.report_written(found.warnings, products)
    return 0
