"""``ph-post convert``: compensates a path file or a part program."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import click

from ph_post.cli import options
from ph_post.progress import Progress

if TYPE_CHECKING:
    from ph_post.analysis.path_analysis import Analysis
    from ph_post.compensate.options import PlanOutput
    from ph_post.types import Plan


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
    from ph_post.cli.conversion import convert_program
    from ph_post.cli.job import default_strategy, load_and_analyse
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.edit.inputs import is_program
    from ph_post.files.storage import or_shipped, read_raw, write_atomically
    from ph_post.report.tables import print_json, print_plans

    everything = {**how, "machine": machine, "output": output, "table": table}
    if source is None or how["watch"] is not None:
        return _watch(source, everything, as_json)
    raw = read_raw(or_shipped("paths", source))
    if is_program(raw) and table is None:
        return convert_program(source, raw.data, everything, as_json=as_json)
    _refuse_program_options(how, output if is_program(raw) else None)
    machine = options.require_machine(machine)
    _check_outputs(output, table, as_json)
    how["strategy"] = how["strategy"] or default_strategy(how)
    program = output or (None if table is not None or as_json else "-")
    view = None
    with ProgressPrinter() as progress:
        analysis = load_and_analyse(
            raw,
            machine,
            how["tolerance"],
            progress,
            feed=how["feed"],
            dialect=how["dialect"],
            intervals=how["interval_table"],
        )
        plans = _plans(analysis, how, table is not None or program is None, program is not None, progress)
        products, plans = _products(analysis, plans, {"table": table, "program": program}, how, progress)
        if how["plot"] is not None:
            products[how["plot"]] = _picture(analysis, next(iter(plans.values())), how["plot"], progress)
        if as_json:
            view, plans = _view(analysis, plans, how, progress)
        write_atomically(products)
    if view is not None:
        print_json(view)
    print_plans({str(carrier): plan for carrier, plan in plans.items()}, products)
    return 0


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


def _picture(analysis: Analysis, plan: Plan, target: str, progress: Progress) -> bytes:
    """Draw a plan."""
    from ph_post.report.figures import draw_plan, picture_format, render

    progress("drawing")
    return render(draw_plan(analysis, plan), picture_format(target))


def _plans(
    analysis: Analysis, how: dict[str, Any], table: bool, program: bool, progress: Progress
) -> dict[PlanOutput, Plan]:
    """Plan what is asked for, each for what it is written as; where nothing is added they are the same."""
    from ph_post.cli.job import effect_warnings, plan_options, with_warnings
    from ph_post.compensate.plan import make_plan

    assert analysis.machine is not None
    asked: list[PlanOutput] = [*(("table",) if table else ()), *(("program",) if program else ())]
    found: dict[PlanOutput, Plan] = {}
    for carrier in asked:
        if found and how["feed_only"]:
            found[carrier] = found[asked[0]]
            continue
        progress(f"planning the {carrier}")
        found[carrier] = make_plan(analysis, plan_options(how, carrier), progress)
        if carrier == "program" and how["strategy"] == "auto":
            found[carrier] = _writable(analysis, found[carrier], how, progress)
    said = effect_warnings(analysis.machine, analysis.path.axes)
    return {**found, asked[0]: with_warnings(found[asked[0]], *said)}


def _writable(analysis: Analysis, plan: Plan, how: dict[str, Any], progress: Progress) -> Plan:
    """Return the plan, or one of feeds alone where the dialect cannot write what it adds to the path."""
    from ph_post.cli.job import plan_options, with_warnings
    from ph_post.compensate.plan import make_plan
    from ph_post.dialects.registry import find_dialect
    from ph_post.errors import InputError
    from ph_post.post.moves import check_jogs, read_jogs

    try:
        check_jogs(read_jogs(plan).jogs, find_dialect(plan.machine.dialect))
    except InputError as error:
        progress("planning the program once more, by feeds alone")
        feeds = make_plan(analysis, plan_options({**how, "feed_only": True}, "program"), progress)
        reason = str(error).removeprefix("--dialect: ")
        return with_warnings(feeds, f"nothing is added to the path: {reason}")
    return plan


def _products(
    analysis: Analysis,
    plans: dict[PlanOutput, Plan],
    targets: dict[PlanOutput, str | None],
    how: dict[str, Any],
    progress: Progress,
) -> tuple[dict[str, str | bytes], dict[PlanOutput, Plan]]:
    """Write plans as what they are for, in memory, and add the writers' warnings to them."""
    from ph_post.cli.job import program_of, program_options, with_warnings
    from ph_post.compensate.offsets import command_of
    from ph_post.files.table import table_content

    products: dict[str, str | bytes] = {}
    if (table := targets["table"]) is not None:
        progress("sampling the interpolator table")
        plan = plans["table"]
        rows = command_of(plan, analysis.track, plan.machine.servo_period)
        products[table] = table_content(rows, table)
    if (program := targets["program"]) is not None:
        progress("writing the program")
        products[program], plan = program_of(analysis, plans["program"], program_options(how))
        plans = {**plans, "program": with_warnings(plan, *_caveats(plan, plans.get("table")))}
    return products, plans


def _caveats(program: Plan, table: Plan | None) -> list[str]:
    """Say what the table beside a program holds that the program cannot."""
    if table is None:
        return []
    held = ["inverse dynamics"] if table.inverse_dynamics else []
    held += ["crossings of the gap"] if table.crossings and not program.crossings else []
    if not held:
        return []
    return [f"the program cannot carry the {' and '.join(held)} of the table"]


def _view(
    analysis: Analysis, plans: dict[PlanOutput, Plan], how: dict[str, Any], progress: Progress
) -> tuple[dict[str, Any], dict[PlanOutput, Plan]]:
    """Return the JSON object, and the plans with what the simulation has to say about them."""
    from ph_post.compensate.offsets import command_of
    from ph_post.report.views import plan_view

    errors: dict[str, Any] = {}
    if not how["no_simulation"]:
        errors, plans = _simulated(analysis, plans, how, progress)
    views = {
        carrier: plan_view(
            analysis, plan, command_of(plan, analysis.track, plan.machine.servo_period), errors.get(carrier)
        )
        for carrier, plan in plans.items()
    }
    first = next(iter(views))
    beside = {"program": views["program"] if len(views) > 1 else None, "table_error": errors.get("reached")}
    return {**views[first], "carrier": first, **beside}, plans


def _simulated(
    analysis: Analysis, plans: dict[PlanOutput, Plan], how: dict[str, Any], progress: Progress
) -> tuple[dict[str, Any], dict[PlanOutput, Plan]]:
    """Return contour errors by carrier [mm], before and after, and `reached` by a table not asked for."""
    from ph_post.cli.job import plan_options, with_warnings
    from ph_post.compensate.comparison import before_and_after
    from ph_post.compensate.plan import make_plan
    from ph_post.report.simulations import error_view, table_would_reach

    judged = list(plans.values())
    alone = list(plans) == ["program"]
    if alone:
        progress("planning the table, to compare")
        judged.append(make_plan(analysis, plan_options(how, "table"), progress))
    progress("simulating")
    before, *after = before_and_after(analysis, *judged)
    errors: dict[str, Any] = {
        carrier: {"before": error_view(before.error), "after": error_view(found.error)}
        for carrier, found in zip(plans, after, strict=False)
    }
    if alone:
        errors["reached"] = error_view(after[1].error)
        said = table_would_reach(after[0].error, after[1].error)
        plans = {"program": with_warnings(plans["program"], *said)}
    return errors, plans


def _check_outputs(output: str | None, table: str | None, as_json: bool) -> None:
    """Refuse two products for one place."""
    streams = [name for name, value in (("-o", output), ("--table", table)) if value == "-"]
    streams += ["--json"] if as_json else []
    if len(streams) > 1:
        raise click.UsageError(f"standard output can take one product; got {' and '.join(streams)}")
    if output not in (None, "-") and table is not None and FilePath(str(output)).resolve() == FilePath(table).resolve():
        raise click.UsageError(f"-o and --table name the same file; got {output}")
