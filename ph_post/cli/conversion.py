"""Conversion of one input, for ``convert``, ``filter``, ``slicer`` and ``--watch``."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import click

from ph_post.cli import options
from ph_post.cli.outputs import Target, check_places, choose_target, products_of
from ph_post.progress import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ph_post.api.compensated_program import CompensatedProgram
    from ph_post.api.further_axes import ShiftedJob
    from ph_post.api.options import CompensateOptions
    from ph_post.api.outcomes import Compensation
    from ph_post.api.path_compensation import PathCompensation
    from ph_post.api.program_compensation import ProgramCompensation
    from ph_post.compensate.options import PlanOutput
    from ph_post.files.storage import Content, SourceBytes
    from ph_post.report.result_line import ResultSummary
    from ph_post.types import Machine, Plan


def converted(raw: SourceBytes, how: Mapping[str, Any], progress: Progress, *, noted: bool = False) -> Compensation:
    """Compensate a path file or a part program, which leaves out the options that are for path files alone.

    Parameters
    ----------
    raw : SourceBytes
    how : mapping
        Options of ``convert`` by name; those that a command does not have may be missing.
    progress : callable
    noted : bool, optional
        Whether the program itself holds the warnings, in comments at its head.

    Raises
    ------
    InputError
        Where the input or the machine file is bad.
    click.UsageError
        Where an option does not fit a part program.
    """
    from ph_post.api.compensation import compensated
    from ph_post.api.options import PATH_ONLY
    from ph_post.files.storage import is_program

    if is_program(raw):
        kept = {name: value for name, value in how.items() if name not in PATH_ONLY}
        return converted_program(raw, kept, progress, noted=noted)
    return compensated(raw, how["machine"], _options(how, noted), "program", progress)


def converted_program(
    raw: SourceBytes, how: Mapping[str, Any], progress: Progress, *, noted: bool = False
) -> ProgramCompensation:
    """Compensate a part program, whatever its name ends with; as :func:`converted`."""
    from ph_post.api.program_compensation import ProgramCompensation

    result = ProgramCompensation(raw, how["machine"], options_for_program(how, noted), "program", progress)
    if result.options.require_all:
        result.check_all()
    return result


def options_for_program(how: Mapping[str, Any], noted: bool = False) -> CompensateOptions:
    """Return the options of a compensation, and refuse those that a part program has no use for.

    Raises
    ------
    click.UsageError
    """
    from ph_post.errors import InputError

    found = _options(how, noted)
    try:
        found.check_for_program()
    except InputError as error:
        raise click.UsageError(str(error)) from None
    return found


def _options(how: Mapping[str, Any], noted: bool = False) -> CompensateOptions:
    from ph_post.api.options import CompensateOptions

    return CompensateOptions(**options.in_si(how), notes_in_header=noted)


def conversion_lines(result: Compensation) -> tuple[str, ...]:
    """Say what was done in one line, and what was left alone or has to be known in one line each."""
    from ph_post.api.path_compensation import PathCompensation
    from ph_post.api.program_compensation import ProgramCompensation
    from ph_post.report.programs import changes_summary, program_summary
    from ph_post.report.tables import plan_summary

    if isinstance(result, PathCompensation):
        plan, crossed = result.plans["program"], result.crossed
        said = plan_summary(plan) if crossed is None else f"{plan.path.name}: {changes_summary(crossed.edited)}"
        return said, *(f"warning: {word}" for word in plan.warnings)
    assert isinstance(result, ProgramCompensation)
    return program_summary(result), *(f"warning: {word}" for word in result.warnings)


def convert_path(raw: SourceBytes, how: Mapping[str, Any], *, as_json: bool) -> int:
    """Compensate a path file, or a part program as a path, and write what the options ask for."""
    from ph_post.api.compensation import compensated
    from ph_post.api.outcomes import require_all_compensated
    from ph_post.api.path_compensation import PathCompensation
    from ph_post.api.program_compensation import ProgramCompensation
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import write_atomically
    from ph_post.report.programs import changes_summary
    from ph_post.report.result_line import summarize
    from ph_post.report.tables import print_json, print_plans

    machine = options.require_machine(how["machine"])
    table, program = how["table"], how["output"]
    program = program or (None if table is not None or as_json else "-")
    inputs = {"IN": raw.name, "-m": how["machine"], "--interval-table": how["interval_table"]}
    check_places(inputs, {"-o": program, "--table": table, "--plot": how["plot"]}, json=as_json)
    asked: list[PlanOutput] = ["table"] if table is not None or program is None else []
    asked += ["program"] if program is not None else []
    with ProgressPrinter() as progress:
        result = compensated(raw, machine, _options(how), asked[0], progress)
        path = result.longest if isinstance(result, ProgramCompensation) else result
        assert isinstance(path, PathCompensation)
        products = _path_products(path, table, program, how["plot"], progress)
        plans = {output: path.plans[output] for output in asked}
        if how["require_all"]:
            for output, plan in plans.items():
                require_all_compensated(path.count(output), plan.warnings)
        write_atomically(products)
        simulated = not how["no_simulation"]
        if simulated:
            progress("simulating")
        found = {output: summarize(path, output, simulated=simulated) for output in asked}
        simulated = simulated and not any(one.trouble for one in found.values())
        view, plans = _view(path, plans, found, simulated) if as_json else (None, plans)
    if view is not None:
        print_json(view)
    for note in path.notes:
        click.echo(f"warning: {note}", err=True)
    lines = {output: path.crossed_for(output) for output in asked}
    said = {output: changes_summary(one.edited) for output, one in lines.items() if one is not None}
    print_plans(plans, products, said)
    print_results({str(output): one for output, one in found.items()})
    return 0


def _path_products(
    path: PathCompensation, table: str | None, program: str | None, plot: str | None, progress: Progress
) -> dict[str, Content]:
    """Make what is asked for, by the file that it goes to; the picture is of the table if there is one."""
    from ph_post.files.table import table_content
    from ph_post.report.figures import write_figure

    products: dict[str, Content] = {}
    if table is not None:
        products[table] = table_content(path.table(), table)
    if program is not None:
        products[program] = path.program()
    if plot is not None:
        progress("drawing")
        drawn: PlanOutput = "program" if table is None and program is not None else "table"
        products[plot] = write_figure(_figure(path, drawn), plot)
    return products


def _figure(path: PathCompensation, output: PlanOutput) -> Figure:
    """Draw the feed along a path, before and after; of a program that crosses on the fly also the error."""
    from ph_post.report.figures import draw_plan
    from ph_post.report.motion_figures import draw_picture
    from ph_post.report.traces import path_picture

    if path.crossed_for(output) is None:
        return draw_plan(path.analysis, path.plan(output))
    return draw_picture(path_picture(path))


def print_results(found: Mapping[str, ResultSummary]) -> None:
    """Print the results of outputs on standard error, first what is not compensated, named where there are several."""
    from ph_post.report.result_line import result_lines

    for name, one in found.items():
        for line in result_lines(one):
            click.echo(f"{name}: {line}" if len(found) > 1 else line, err=True)


def _view(
    path: PathCompensation, plans: dict[PlanOutput, Plan], found: Mapping[PlanOutput, ResultSummary], simulated: bool
) -> tuple[dict[str, Any], dict[PlanOutput, Plan]]:
    """Return the JSON object, and the plans with what the simulation has to say about them."""
    from ph_post.api.path_compensation import with_warnings
    from ph_post.report.programs import crossed_view
    from ph_post.report.result_line import plan_result_view
    from ph_post.report.simulations import table_would_reach
    from ph_post.report.views import error_view

    reached = None
    if simulated and list(plans) == ["program"]:
        table = path.planned("table").error
        reached = error_view(table)
        plans = {"program": with_warnings(plans["program"], *table_would_reach(path.after.error, table))}
    views = {}
    for output, plan in plans.items():
        crossed = path.crossed_for(output)
        if crossed is None:
            command = path.planned(output).command
            views[output] = plan_result_view(path.analysis, plan, command, found[output])
        else:
            views[output] = crossed_view(crossed, path.options.chosen_strategy, found[output], plan.warnings)
    first = next(iter(views))
    beside = {"program": views["program"] if len(views) > 1 else None, "table_error": reached}
    return {**views[first], "carrier": first, **beside}, plans


def convert_program(source: str, raw: SourceBytes, how: Mapping[str, Any], *, as_json: bool) -> int:
    """Compensate a part program, or take its compensation back, and write it where the options say.

    Parameters
    ----------
    source : str
        File name, - for standard input.
    raw : SourceBytes
        What it holds.
    how : mapping
        The command's options by name.
    as_json : bool
    """
    from ph_post.api.reversals import program_reversals
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import write_atomically
    from ph_post.report.figures import write_figure
    from ph_post.report.motion_figures import draw_picture
    from ph_post.report.programs import program_summary, program_view
    from ph_post.report.result_line import summarize
    from ph_post.report.tables import print_json
    from ph_post.report.traces import program_picture
    from ph_post.simulate.controllers.run import check_run

    found = options_for_program(how)
    target = choose_target(source, how) or (None if as_json else Target(program="-"))
    if target is not None:
        here = source if target.program != source or how["output"] is not None else None
        files = {"-m": how["machine"], "--parameters": how["parameters"], "--tool-table": how["tool_table"]}
        check_places({"IN": here, **files}, {"-o": target.program, "--plot": how["plot"]}, json=as_json)
    if how["undo"]:
        return _undo(raw, how, target, as_json)
    options.require_machine(how["machine"])
    with ProgressPrinter() as progress:
        result = converted_program(raw, how, progress)
        products = {} if target is None else products_of(target, result.program(), raw.data)
        if how["plot"] is not None:
            check_run(result.original, result.machine)
            progress("locating turning points, windows and backlash intervals")
            turns = program_reversals(result.edited, result.machine, found.tolerance)
            picture = program_picture(result.edited, result.machine, how["strategy"], turns, progress, result.shifted)
            products = {**products, how["plot"]: write_figure(draw_picture(picture), how["plot"])}
        write_atomically(products)
        outcome = summarize(result, simulated=not how["no_simulation"])
        view = program_view(result, outcome) if as_json else None
    if view is not None:
        print_json(view)
    click.echo(program_summary(result), err=True)
    options.report_written(result.warnings, products)
    print_results({"program": outcome})
    return 0


def _undo(raw: SourceBytes, how: Mapping[str, Any], target: Target | None, as_json: bool) -> int:
    """Write the original of a compensated program."""
    from ph_post.api.compensation import undo
    from ph_post.files.storage import write_atomically
    from ph_post.report.programs import undone_view
    from ph_post.report.tables import print_json

    if how["plot"] is not None:
        raise click.UsageError("--undo draws nothing; leave out --plot")
    original = undo(raw)
    products = {} if target is None else products_of(target, original, raw.data)
    write_atomically(products)
    if as_json:
        print_json(undone_view())
    options.report_written((), products)
    return 0


def compensated_or_original(
    raw: SourceBytes, machine: Machine, how: Mapping[str, Any], progress: Progress
) -> tuple[CompensatedProgram, ShiftedJob | None]:
    """Compensate a part program as `convert` would; of one that is compensated already, recover the original.

    With it comes what was compensated before X, Y and Z, where that is known.

    Parameters
    ----------
    raw : SourceBytes
    machine : Machine
    how : mapping
        The options of planning by name.
    progress : callable
    """
    from ph_post.api.compensated_program import CompensatedProgram
    from ph_post.api.expansion import in_own_lines
    from ph_post.api.inputs import program_in
    from ph_post.drive.axes import check_axes
    from ph_post.edit.undo import original_of
    from ph_post.simulate.controllers.moves import moved_axes

    options_for_program(how)
    program = program_in(raw, machine.dialect)
    check_axes(moved_axes(program), "program", machine, f"machine {machine.name}")
    original = original_of(program, f"original of {program.name}")
    if original is not None:
        return CompensatedProgram(before=in_own_lines(original), after=program, done=True), None
    found = converted_program(raw, {**how, "machine": machine}, progress)
    return found.edited, found.shifted


@contextlib.contextmanager
def silenced() -> Iterator[None]:
    """Keep both streams free of whatever is said on the way: who called reads them."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield
