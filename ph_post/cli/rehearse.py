"""``ph-post rehearse``: runs a program on LinuxCNC's planner, and its commands through the drive model."""

from __future__ import annotations

import click

from ph_post.cli import options


@click.command()
@click.argument("program", metavar="PROGRAM")
@options.machine
@click.option("--against", metavar="ORIGINAL", help="The program that PROGRAM was made of.")
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
    help="How long each run on LinuxCNC may take.",
)
@click.option("--log", metavar="OUT.csv", help="Commanded and executed motion; - for standard output.")
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
    """Run PROGRAM on a real LinuxCNC installed here, and its commands through the machine's drives.

    LinuxCNC runs without a screen and without hardware: its own interpreter, planner and servo thread, with
    the limits and the servo period of the machine file. What it commands the joints in every servo period is
    compared with what was planned, speed and path, and simulated on the machine: that is the contour error to
    expect. Of a program that this tool compensated the original is run too; of others --against names it.

    What the machine file leaves open is tried as `simulate` does. Errors count while the tool cuts, from five
    servo time constants after the start. PROGRAM may be - for standard input.

    \b
    Examples:
      ph-post rehearse part_compensated.ngc -m router --plot part.png
      ph-post rehearse part_compensated.ngc -m router --backlash --json
      ph-post convert part.ngc -m router | ph-post rehearse - -m router --against part.ngc

    \b
    JSON:
      speed     {rms, max, windows}: how far it is from the plan's in the windows, relative
      path      {max, allowed} [mm]
      time      {plan, controller, before} [s]
      error     {before, after, planned, before_worst, after_worst, backlash}, each {max, rms} [mm]
      lockstep  whether it was run period by period, not as time passes
    """
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.dialects.registry import find_dialect
    from ph_post.drive.axes import check_axes
    from ph_post.drive.machinefile import read_machine
    from ph_post.edit.inputs import read_program_file
    from ph_post.errors import InputError
    from ph_post.files.storage import Content, write_atomically
    from ph_post.files.table import log_content
    from ph_post.gcode.program import RS274
    from ph_post.post.remarks import package_version
    from ph_post.rehearse.rehearse import original_of, rehearse
    from ph_post.report.figures import picture_format, render
    from ph_post.report.rehearsals import draw_rehearsal, rehearsal_lines, rehearsal_view
    from ph_post.report.tables import print_json
    from ph_post.simulate.controllers.run import moved_axes

    if sum([log == "-", as_json]) > 1:
        raise click.UsageError("standard output can take one product; got two for it")
    if against == program == "-":
        raise click.UsageError("standard input can give one program; got - for both")
    products: dict[str, Content] = {}
    with ProgressPrinter() as progress:
        progress("reading")
        drives = read_machine(machine)
        words = find_dialect(drives.dialect)
        if words.front is not None or words.language != RS274:
            what = "LinuxCNC runs programs in RS274's words, not in those of another controller"
            raise InputError(machine, what, expected="a machine file for LinuxCNC", got=drives.dialect)
        part = read_program_file(program)
        original = original_of(part) if against is None else read_program_file(against)
        check_axes(moved_axes(part), "program", drives, machine)
        found = rehearse(part, drives, original=original, backlash=backlash, limit=limit, progress=progress)
        if log is not None:
            remarks = {
                "made by": f"ph-post {package_version()} rehearse",
                "program": f"{part.name}, sha256 {part.digest}",
                "machine": drives.name,
                "units": "s, mm; X_cmd is LinuxCNC's command, X_act the table, X_motor the motor's side",
            }
            products[log] = log_content(found.real.error.run, remarks)
        if plot is not None:
            progress("drawing")
            products[plot] = render(draw_rehearsal(found, f"{part.name} on {drives.name}"), picture_format(plot))
        write_atomically(products)
    if as_json:
        print_json(rehearsal_view(found))
    elif log != "-":
        for line in rehearsal_lines(found, part.name):
            click.echo(line)
    for note in part.notes:
        click.echo(f"warning: {part.name}:{note.first + 1}: {note.what}: run, and not in the plan", err=True)
    for name in products:
        if name != "-":
            click.echo(f"wrote {name}", err=True)
    return 0
