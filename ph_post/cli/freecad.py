"""``ph-post freecad``: installs FreeCAD's post-processor, and answers its questions."""

from __future__ import annotations

import click

from ph_post.cli import options


@click.command()
@click.option("--install", "installs", is_flag=True, help="Copy the post-processor to where FreeCAD finds it.")
@click.option(
    "--folder",
    metavar="FOLDER",
    help="With --install: this folder in place of FreeCAD's own for macros, which are looked for.",
)
@click.option("--trace", metavar="JOB", hidden=True, help="Answer the post-processor's question; - for stdin.")
@options.optional_machine
@options.debug
def command(installs: bool, folder: str | None, trace: str | None, machine: str | None) -> int:
    """Install the post-processor `backlash` in FreeCAD, or say where its file is.

    In FreeCAD choose in the job's output the processor `backlash` and the arguments `--machine=FILE.toml`.
    The job is posted by FreeCAD's own post-processor for the dialect of that machine (or `--post=NAME`), and
    the program compensated and verified as by `ph-post convert`. FreeCAD has one for fanuc, grbl, grblhal,
    linuxcnc and marlin; for others name one. ISO programs of Heidenhain cannot be compensated.
    Arguments that FreeCAD's post-processor knows go to it, others to `ph-post convert`; the tooltip of the
    field lists them. Arcs stay arcs, and what FreeCAD sampled from a spline is written as a spline where the
    controller plays G5. FreeCAD shows what goes wrong in one line, and nothing is written then.

    FreeCAD 0.20 and later. The copy knows where this ph-post is; another is named by `--ph-post=FILE` in the
    arguments or by PH_POST in the environment.

    \b
    Examples:
      ph-post freecad --install
      ph-post freecad --install --folder ~/.local/share/FreeCAD/v1-1/Macro
      ph-post freecad
    """
    if trace is not None:
        return _answer(trace, machine)
    from ph_post.api.freecad import POST, install
    from ph_post.files.storage import shipped

    if folder is not None and not installs:
        raise click.UsageError("--folder goes with --install")
    if not installs:
        click.echo(shipped("freecad", POST))
        click.echo("ph-post freecad --install puts it where FreeCAD finds it", err=True)
        return 0
    for file in install(folder):
        click.echo(f"written: {file}", err=True)
    click.echo("in FreeCAD's job: processor backlash, arguments --machine=FILE.toml", err=True)
    return 0


def _answer(trace: str, machine: str | None) -> int:
    """Answer FreeCAD's post-processor."""
    import msgspec

    from ph_post.api.freecad import answer, read_job
    from ph_post.drive.machinefile import read_machine
    from ph_post.files.storage import read_source

    drives = read_machine(options.require_machine(machine))
    told = answer(read_job(read_source(trace)), drives)
    click.echo(msgspec.json.encode(told, enc_hook=float))
    return 0
