"""``ph-post demo``: the main job on a shipped part program and a shipped machine."""

from __future__ import annotations

from pathlib import PurePath
from typing import Final

import click

from ph_post.cli import options

PROGRAM: Final = "pocket_grbl"
MACHINE: Final = "stepper"
"""The shipped program and machine of the demonstration."""


@click.command()
@click.option("--out", default="ph_post_demo", show_default=True, metavar="FOLDER", help="Folder for the files.")
@options.common
def command(out: str, as_json: bool) -> int:
    """Compensate a shipped pocket for a shipped stepper router.

    Writes the original and the compensated program, a page for the browser and a picture into FOLDER, and ends
    with the line of the result: the error that backlash causes before and after, in µm, and what that costs in
    time.

    \b
    Examples:
      ph-post demo
      ph-post demo --out shown

    \b
    JSON:
      the same object as of convert, of the program
    """
    from msgspec.structs import replace

    from ph_post.api.compensation import compensate
    from ph_post.api.program_compensation import ProgramCompensation
    from ph_post.cli.conversion import print_results
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import make_folder, read_raw, shipped, write_atomically
    from ph_post.report.figures import write_figure
    from ph_post.report.product import motion_product
    from ph_post.report.programs import program_summary, program_view
    from ph_post.report.result_line import summarize
    from ph_post.report.tables import print_json
    from ph_post.report.traces import program_picture

    with ProgressPrinter() as progress:
        progress("reading")
        program = str(PurePath(out, "pocket.ngc"))
        raw = replace(read_raw(str(shipped("programs", PROGRAM))), name=program)
        result = compensate(raw, MACHINE, output="program", progress=progress)
        assert isinstance(result, ProgramCompensation)
        picture = program_picture(result.edited, result.machine, "auto", result.places, progress)
        made = motion_product(picture)
        progress("drawing")
        folder = make_folder(out)
        products: dict[str, str | bytes] = {
            program: raw.data,
            str(folder / "pocket_compensated.ngc"): result.program(),
            str(folder / "pocket.html"): made.page(),
            str(folder / "pocket.png"): write_figure(made.figure(), "pocket.png"),
        }
        write_atomically(products)
        outcome = summarize(result)
    if as_json:
        print_json(program_view(result, outcome))
    click.echo(program_summary(result), err=True)
    options.report_written(result.warnings, products)
    print_results({"program": outcome})
    return 0
