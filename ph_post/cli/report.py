"""``ph-post report``: makes one page of a path, a program, two programs or a log."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import click
from click.core import ParameterSource

from ph_post.cli import options
from ph_post.cli.log_options import log_options
from ph_post.progress import Progress

if TYPE_CHECKING:
    from ph_post.files.storage import SourceBytes
    from ph_post.report.product import ReportProduct

QUICK: Final = 0.1
"""Search effort, less than that of `convert`: a page should appear soon."""

HEAD: Final = 4096
"""Bytes at the beginning of a table that hold its header."""

OF_LOGS: Final = ("columns", "sides", "program")
OF_BOTH: Final = ("machine", "output", "plot", "as_json", "source", "other")
"""Options for logs only, and for everything; all others are for planning a motion."""


@click.command()
@click.argument("source", metavar="IN")
@click.argument("other", metavar="[OTHER]", required=False)
@options.optional_machine
@click.option("-o", "--output", metavar="PAGE.html", help="The page; - for standard output (the default).")
@options.plot("the main parts of the page")
@options.strategy("auto")
@options.planning_with(effort=QUICK)
@options.carrier
@log_options
@options.common
def command(
    source: str,
    other: str | None,
    machine: str | None,
    output: str | None,
    plot: str | None,
    as_json: bool,
    **how: Any,
) -> int:
    """Make an HTML page of a path, a part program, two programs or a log. The page needs no network.

    IN is a path file (.json), the name of a shipped one, a part program, a log of a machine (see
    `ph-post diagnose --help`), or - for standard input. With OTHER, both are part programs.

    The page of a path or a program shows the reversals with their windows, the predicted error before and
    after compensation, magnified along the path, the feed before and after, a row for every reversal, and the
    machine. A program that is already compensated is shown beside its original. For two programs the page is
    that of `ph-post diff --html`, for a log that of `ph-post diagnose --html`.

    On the page, the wheel zooms, dragging moves, and a double click shows all; pointing at a picture shows the
    numbers there, in all pictures; the keyboard does the same. The page is light or dark as the system is, and
    can be printed.

    The search for the best compensation is shorter than that of `convert`; --effort 1 makes it equal. Exit
    status 0: done, whatever the page shows.

    \b
    Examples:
      ph-post report oval -m mill -o oval.html
      ph-post report part.ngc -m router.toml -o part.html --plot part.png
      ph-post report part.ngc part_compensated.ngc -m router.toml -o both.html
      ph-post report run.csv -m router.toml -o run.html
      ph-post report part.json -m mill.toml --strategy suppress --ratio 0.4 -o part.html
    """
    from ph_post.cli.outputs import check_places
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import write_atomically
    from ph_post.report.figures import write_figure
    from ph_post.report.tables import print_json

    page = output or (None if as_json or plot is not None else "-")
    inputs = {"IN": source, "OTHER": other, "-m": machine, "--program": how["program"]}
    check_places(inputs, {"-o": page, "--plot": plot}, json=as_json)
    with ProgressPrinter() as progress:
        made = _made(source, other, machine, how, progress)
        products: dict[str, str | bytes] = {}
        if page is not None:
            progress("making the page")
            products[page] = made.page()
        if plot is not None:
            progress("drawing")
            products[plot] = write_figure(made.figure(), plot)
        write_atomically(products)
    if as_json:
        print_json(made.view())
    options.report_written((*made.notes, *made.warnings), products)
    for line in made.last:
        click.echo(line, err=True)
    return 0


def _made(
    source: str, other: str | None, machine: str | None, how: dict[str, Any], progress: Progress
) -> ReportProduct:
    """Find out what IN is, and make what it takes."""
    from ph_post.files.storage import input_kind, or_shipped, read_raw

    progress("reading")
    if other is not None:
        _refuse("two programs", keep=())
        return _of_two(source, other, machine, progress)
    raw = read_raw(or_shipped("paths", source))
    kind = input_kind(raw)
    machine = options.require_machine(machine)
    if kind == "log":
        _refuse_table(raw)
        _refuse("a record", keep=OF_LOGS)
        return _of_log(raw, machine, how, progress)
    _refuse(f"a {kind}", leave=OF_LOGS)
    return (_of_path if kind == "path" else _of_program)(raw, machine, how, progress)


def _refuse_table(raw: SourceBytes) -> None:
    """Refuse an interpolator table, which looks like a log and is not."""
    from ph_post.errors import InputError

    if b"segment,xi,s" in raw.data[:HEAD]:
        raise InputError(
            raw.name,
            "is an interpolator table",
            expected="the path that it was made of, or a record",
            got="what `ph-post simulate` takes",
        )


def _refuse(what: str, *, keep: tuple[str, ...] | None = None, leave: tuple[str, ...] = ()) -> None:
    """Refuse options that do not belong to the kind of input: none is left aside in silence."""
    context = click.get_current_context()
    for parameter in context.command.params:
        name = str(parameter.name)
        unknown = name in leave if keep is None else name not in (*keep, *OF_BOTH)
        if unknown and parameter.expose_value and context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{parameter.opts[-1]} does not go with {what}")


def _of_two(a: str, b: str, machine: str | None, progress: Progress) -> ReportProduct:
    import ph_post as ph
    from ph_post.report.product import diff_product

    options.require_two_sources(a, b)
    return diff_product(ph.diff(a, b, machine, progress=progress))


def _of_log(raw: SourceBytes, machine: str, how: dict[str, Any], progress: Progress) -> ReportProduct:
    import ph_post as ph
    from ph_post.api.inputs import any_machine
    from ph_post.report.product import diagnosis_product

    drives, _ = any_machine(machine)
    log = ph.read_log(raw, columns=how["columns"], sides=how["sides"], program=how["program"], machine=drives)
    return diagnosis_product(ph.diagnose(log, drives, progress=progress))


def _of_path(raw: SourceBytes, machine: str, how: dict[str, Any], progress: Progress) -> ReportProduct:
    from msgspec.structs import replace

    from ph_post.api.options import CompensateOptions
    from ph_post.api.path_compensation import compensated_path
    from ph_post.compensate.strategies.base import traits_of
    from ph_post.compensate.strategies.registry import find_strategy
    from ph_post.report.product import motion_product
    from ph_post.report.traces import path_picture

    result = compensated_path(raw, machine, CompensateOptions(**options.in_si(how)), how["carrier"], progress)
    progress("simulating before and after")
    picture = path_picture(result)
    chooses = result.crossed_for(result.output) is None and traits_of(find_strategy(picture.strategy)).chooses
    less = (f"the best is searched for with --effort {how['effort']:g}, `convert` does so with 1 and may find better",)
    notes = less if chooses and how["effort"] < 1.0 else ()
    return motion_product(replace(picture, notes=(*picture.notes, *notes)), (*result.notes, *notes))


def _of_program(raw: SourceBytes, machine: str, how: dict[str, Any], progress: Progress) -> ReportProduct:
    from ph_post.api.inputs import machine_named
    from ph_post.api.reversals import program_reversals
    from ph_post.cli.conversion import compensated_or_original
    from ph_post.report.product import motion_product
    from ph_post.report.traces import program_picture
    from ph_post.units import MM

    drives, _ = machine_named(machine, how["dialect"])
    found, shifted = compensated_or_original(raw, drives, how, progress)
    progress("locating turning points, windows and backlash intervals")
    turns = program_reversals(found, drives, how["tolerance"] * MM)
    return motion_product(program_picture(found, drives, how["strategy"], turns, progress, shifted))
