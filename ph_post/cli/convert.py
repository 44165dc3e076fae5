"""``ph-post convert``: compensates a path file or a part program."""

from __future__ import annotations

from typing import Any

import click

from ph_post.cli import options


@click.command()
@click.argument("source", metavar="IN", required=False)
@options.optional_machine
@click.option(
    "-o", "--output", metavar="OUT", help="Part program; - for standard output (the default without --table)."
)
@click.option("--suffix", metavar="END", help="Write part.ngc to partEND.ngc. For part programs.")
@click.option("--in-place", is_flag=True, help="Write over IN. For part programs.")
@click.option(
    "--backup",
    is_flag=False,
    flag_value=options.BACKUP,
    default=None,
    metavar="[END]",
    help=f"With --in-place: keep what was there as part.ngcEND. [{options.BACKUP}]",
)
@click.option("--undo", is_flag=True, help="Give the original of a compensated program back, byte for byte.")
@options.force
@options.strict
@click.option("--table", metavar="T", help="Interpolator table: .csv, .npz or .parquet; - for CSV on standard output.")
@options.strategy(None, "auto; suppress where a profile is described")
@options.planning
@click.option(
    "--interval-table",
    metavar="FILE",
    help="Look backlash intervals up in a table of `ph-post sweep -o FILE.json`, not solving for them.",
)
@click.option(
    "--feed-mode",
    type=click.Choice([options.PER_MINUTE, "inverse-time"]),
    default=options.PER_MINUTE,
    show_default=True,
    help="F words in mm/min (G94) or in 1/min (G93).",
)
@options.writing
@click.option(
    "--watch",
    metavar="FOLDER",
    help="In place of IN: convert what is in a folder and what comes into it, until Ctrl-C, "
    "to the folder of -o or beside it with --suffix.",
)
@click.option(
    "--settle",
    type=options.positive,
    default=2.0,
    show_default=True,
    metavar="S",
    help="With --watch: a file that has not changed for so long is wholly written.",
)
@click.option("--no-simulation", is_flag=True, help="Leave the errors in the --json object null, and save their time.")
@options.plot("the feed along the path, before and after; of a part program also the predicted error")
@options.common
def command(
    source: str | None, machine: str | None, output: str | None, table: str | None, as_json: bool, **how: Any
) -> int:
    """Convert a path file or a part program into a compensated one, a path file also into a table.

    IN is a path file (.json), the name of a shipped one, a part program, or - for standard input. Without -o
    and --table the program goes to standard output. Files are written whole or not at all; what was reduced,
    shortened or left alone is said on standard error.

    With --table a part program is taken as a path. With -o only what has to change of it is changed: numbers
    of axes that carry a lasting offset, and stretches around turning points, each behind a comment that tells
    its lines; all other bytes stay. What is not understood is passed through and named (--strict: refused).
    The outcome is verified before it is written. Converted a second time it stays as it is, and --undo gives
    the original back.

    A table leads the path by what the servos lag behind it (not with the strategies none, linear and step),
    and carries axes through their gaps sample by sample. A program cannot, and jogs them at full stops; so it
    is planned apart: where -o and --table are both given, they hold two plans.

    With --json the motion is simulated too, before and after. The object tells of the table, and has that of
    the program under `program` where both are written. Where -o stands alone it tells of the program, and
    `table_error` is what a table would reach; --no-simulation saves the time for that.

    With --watch a file is taken when it has not changed for a while, again when it changes, and never what
    was written here. Programs keep their names, that of part.json has the ending of the dialect (part.ngc,
    part.gcode, part.mpf); a line tells of each. A bad file is named and the next has its turn; what ph-post
    did not write is not overwritten (--force: is).

    \b
    Examples:
      ph-post convert oval -m mill -o oval.ngc
      ph-post convert part.json -m router.toml --ratio 0.3 --table part.csv -o part.ngc
      ph-post convert circle -m paper --start moving --table - > circle.csv
      ph-post convert part.ngc -m router -o part_compensated.ngc --plot part.png
      ph-post convert part.ngc -m router --in-place --backup
      cat part.ngc | ph-post convert - -m router -o - | sender
      ph-post convert part_compensated.ngc --undo -o part.ngc
      ph-post convert --watch from_cam -m router.toml -o to_machine

    \b
    JSON:
      windows        as turning_points of inspect, with strategy, profile and crossings
      cycle_time     {before, after} [s]
      error          {before, after}, each {max, rms} [mm]; null where nothing was simulated
      offsets        largest that is added, by axis [mm]
      warnings       a list of sentences
      carrier        what the object tells of: table or program
      strategy       of a path: its name
      other_crossings, bias, inverse_dynamics
                     of a path: what is added beside the windows
      program        the same object of the program, where -o and --table are given
      table_error    what a table would reach, where -o stands alone
      stops, dips    of a part program: how many
      pulses         of a part program: by axis [mm]
      verified       of a part program: whether the judge, of --undo the hash of the original, has passed it
      unchanged      of a part program: whether nothing had to change
    """
    from ph_post.cli.conversion import convert_path, convert_program
    from ph_post.files.storage import is_program, or_shipped, read_raw

    how = {**how, "machine": machine, "output": output, "table": table}
    if source is None or how["watch"] is not None:
        return _watch(source, how, as_json)
    raw = read_raw(or_shipped("paths", source))
    if is_program(raw) and table is None:
        return convert_program(source, raw, how, as_json=as_json)
    _refuse_program_options(how, output if is_program(raw) else None)
    return convert_path(raw, how, as_json=as_json)


def _watch(source: str | None, how: dict[str, Any], as_json: bool) -> int:
    """Watch a folder in place of converting one file."""
    if how["watch"] is None:
        raise click.UsageError("Missing argument 'IN'")
    if source is not None:
        raise click.UsageError(f"--watch takes a folder in place of IN; got {source}")
    if as_json:
        raise click.UsageError("--json does not go with --watch")
    from ph_post.cli.watch import watch_folder

    return watch_folder(how["watch"], how)


def _refuse_program_options(how: dict[str, Any], program: str | None) -> None:
    """Refuse what only an existing program can be asked for, and to splice one and sample it in one go."""
    if program is not None:
        raise click.UsageError("of a part program either -o or --table is made at a time; got both")
    names = ("suffix", "in_place", "backup", "undo", "force", "strict")
    given = [f"--{name.replace('_', '-')}" for name in names if how[name]]
    if given:
        raise click.UsageError(f"{given[0]} is for a part program that is written as one")
