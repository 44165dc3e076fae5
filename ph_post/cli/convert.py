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
@click.option("--in-place", is_flag=True, help="Overwrite IN. For part programs.")
@click.option(
    "--backup",
    is_flag=False,
    flag_value=options.BACKUP,
    default=None,
    metavar="[END]",
    help=f"With --in-place: keep the original as part.ngcEND. [{options.BACKUP}]",
)
@click.option("--undo", is_flag=True, help="Restore the original of a compensated program, byte for byte.")
@options.expanding
@options.force
@options.strict
@click.option(
    "--require-all",
    is_flag=True,
    help="Write nothing, with exit status 1, where a reversal at which the tool cuts is not compensated.",
)
@click.option(
    "--lead-program",
    is_flag=True,
    help="Write the lead of the servos into the path of the program, as short chords: it holds at 100 % feed override.",
)
@click.option(
    "--table",
    metavar="T",
    callback=options.known_table,
    help="Interpolator table: .csv, .npz or .parquet; - for CSV on standard output.",
)
@options.strategy(None, "auto; suppress where a profile is described")
@options.planning
@click.option(
    "--interval-table",
    metavar="FILE",
    help="Take backlash intervals from a table of `ph-post sweep -o FILE.json` in place of solving for them.",
)
@options.feed_mode
@options.writing
@click.option(
    "--watch",
    metavar="FOLDER",
    help="In place of IN: convert the files of a folder, also new ones, until Ctrl-C, "
    "to the folder of -o or beside the originals with --suffix.",
)
@click.option(
    "--settle",
    type=options.positive,
    default=2.0,
    show_default=True,
    metavar="S",
    help="With --watch: time without a change after which a file counts as complete.",
)
@click.option(
    "--no-simulation",
    is_flag=True,
    help="Skip the simulation: no errors are known, and those in the --json object are null.",
)
@options.plot("the feed along the path, before and after; of a part program also the predicted error")
@options.common
def command(
    source: str | None, machine: str | None, output: str | None, table: str | None, as_json: bool, **how: Any
) -> int:
    """Compensate the backlash of a path file or a part program.

    IN is a path file (.json), the name of a shipped one, a part program, or - for standard input. Without -o
    and --table the program goes to standard output. Files are written whole or not at all. Standard error
    has warnings for everything that was reduced, and at the end one line with the result: the error that backlash
    causes, before and after, the times, the axes and reversals that are compensated. A line NOT COMPENSATED before it
    says what is left, and what would change that.

    With -o, only the necessary blocks of a part program change: numbers of compensated axes, and stretches
    around reversals, each after a comment that counts its lines. All other bytes stay. Commands that ph-post
    does not understand are passed through and listed (--strict refuses them). The result is verified before
    it is written. Converting it again leaves it unchanged; --undo restores the original. With --table, a part
    program is read as a path.

    A table commands the path ahead by the lag of the servos (except with the strategies none, linear and
    step), and takes up backlash sample by sample. A program cannot do this: it crosses backlash in short straight
    blocks, or takes it up at full stops on axes with a scale. With both -o and --table each has a plan of its own.
    The program of a path that crosses is its plain program, changed as other programs are; --undo gives that back.

    The motion before and after is simulated for the line of the result; --no-simulation skips this. The object of
    --json describes the table, and has the program under `program` if both are written. With -o alone it describes
    the program, and `table_error` is the error that a table would reach.

    --watch converts a file when it has not changed for a while, and again when it changes, but never its own
    results. Programs keep their names; part.json becomes part.ngc, part.gcode or part.mpf as the dialect has
    it. A line reports each file, bad files too. Files that ph-post did not write are not overwritten; --force
    overrides.

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
      standstill     of a path: {before, after} [s], time on the contour below 2 % of the feed, and places,
                     a list of {s [mm], time [s]}
      error          {before, after}, each {max, rms} [mm]; null where nothing was simulated
      error_gap      {before, after, after_worst}: what backlash adds, and if it is off by its uncertainty
      error_early    {line, behind}: the line up to which most of it is left, as nobody knows yet on which side
                     of its backlash an axis is, and what backlash adds behind it; else null
      error_unknown  lines of cuts that are in no error, as nobody knows where an axis is, or on which side of its
                     backlash; else null
      error_sides    {before, after}, each {left, right} [mm]: largest distances to either side of the path
      part_side      that of --part-side, else null
      reversals      {compensated, all}, of axes with backlash
      axes           the compensated axes
      further_axes   by axis beside X, Y and Z {unit, before, after, after_worst, reversals}: its error in deg or mm
      holes          with --expand: the same of X and Y at the holes of drilling cycles that stay, in mm
      not_compensated
                     what is left and why; null where nothing is
      result_line    the line of the result
      offsets        largest added offset, by axis [mm]
      warnings       a list of sentences
      carrier        output that the object describes: table or program
      strategy       of a path: its name
      other_crossings, bias, inverse_dynamics, friction_led
                     of a path: additions outside of the windows; the part of the friction that is led
      program        the same object of the program, if -o and --table are given
      table_error    error that a table would reach, with -o alone
      crossings, stops, dips
                     of a part program, and of a path's that crosses on the fly: their numbers
      pulses         of the same: largest backlash take-up move, by axis [mm]
      lead           of the same with --lead-program: a list of {override, before, after}, the errors at feed overrides
      verified       of the same: whether the check has passed; with --undo, that of the hash
      expanded       of a part program: whether it was written out
      unchanged      of a part program: whether nothing had to change
    """
    from ph_post.cli.conversion import convert_path, convert_program
    from ph_post.files.storage import is_program, or_shipped, read_raw

    how = {**how, "machine": machine, "output": output, "table": table}
    if how["lead_program"] and table is not None and output is None:
        raise click.UsageError("--lead-program is for programs, and a table has the lead anyway; leave one out")
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
    names = ("suffix", "in_place", "backup", "undo", "force", "strict", "expand")
    given = [f"--{name.replace('_', '-')}" for name in names if how[name]]
    if given:
        raise click.UsageError(f"{given[0]} is for a part program that is written as one")
