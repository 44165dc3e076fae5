"""``ph-post machines``: lists the shipped machine files, and copies them."""

from __future__ import annotations

import click

from ph_post.cli import options


@click.command()
@click.option(
    "--copy",
    nargs=2,
    default=None,
    metavar="NAME FILE",
    help="Copy a shipped machine file, comments and all, to FILE (- for standard output).",
)
@click.option("--force", is_flag=True, help="Replace FILE where it is there already.")
@options.common
def command(copy: tuple[str, str] | None, force: bool, as_json: bool) -> int:
    """List the shipped machine files, a line each, or copy one to begin with.

    A machine file says what a machine is: where its loops are closed (load: a scale on the table, motor: an
    encoder on the motor, none: a stepper), its lost motion, limits and controller. Any command takes the name
    of a shipped one in place of a file. Copy the one that is nearest to yours and change what differs, or let
    `ph-post machine new` ask what it needs to know.

    \b
    Examples:
      ph-post machines
      ph-post machines --copy router my_router.toml
      ph-post machines --json

    \b
    JSON:
      machines  a list of {name, file, title, dialect, servo_period [ms], axes}
      copied    with --copy: the file that was written, else null
    """
    from ph_post.drive.machinefile import read_machine
    from ph_post.files.storage import shipped, shipped_names
    from ph_post.report.tables import print_json
    from ph_post.report.views import machine_cells, machine_view

    copied = None if copy is None else _copy(*copy, force, as_json)
    names = shipped_names("machines")
    if as_json:
        listed = [
            {"name": name, "file": str(shipped("machines", name)), **machine_view(read_machine(name))} for name in names
        ]
        print_json({"machines": listed, "copied": copied})
    elif copied is None:
        header = ("name", "loop", "dialect", "lost motion mm", "what it is")
        click.echo(_left([header, *(machine_cells(name, read_machine(shipped("machines", name))) for name in names)]))
        click.echo(f"they are in {shipped('machines', names[0]).parent}", err=True)
    return 0


def _copy(name: str, file: str, force: bool, as_json: bool) -> str:
    from ph_post.cli.outputs import refuse_existing
    from ph_post.files.storage import shipped, write_atomically

    source = shipped("machines", name)
    refuse_existing(file, force)
    if file == "-" and as_json:
        raise click.UsageError("standard output can take one product; got --copy and --json")
    write_atomically({file: source.read_bytes()})
    if file != "-":
        click.echo(f"wrote {file}", err=True)
    return file


def _left(rows: list[tuple[str, ...]]) -> str:
    """Lay out columns of words."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows)
    return "\n".join(line.rstrip() for line in lines)
