"""Conversion of one input, for ``convert``, ``filter``, ``slicer`` and ``--watch``."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

import click
import msgspec

from ph_post.cli import options
from ph_post.cli.outputs import Target, choose_target, products_of
from ph_post.files.storage import STDIO, SourceBytes
from ph_post.progress import Progress
from ph_post.units import MM, MS

if TYPE_CHECKING:
    from ph_post.api.programs import CompensatedProgram, ProgramRequest
    from ph_post.edit.edits import EditOptions
    from ph_post.types import Machine


PATH_ONLY: Final = {
    "feed": "--feed",
    "safe_z": "--safe-z",
    "depth": "--depth",
    "interval_table": "--interval-table",
}
"""Options that a program, which has its own feeds and heights, has no use for."""


def convert_program(source: str, data: bytes, how: dict[str, Any], *, as_json: bool) -> int:
    """Compensate a part program, or take its compensation back, and write it where the options say.

    Parameters
    ----------
    source : str
        File name, - for standard input.
    data : bytes
        What it holds.
    how : dict
        The command's options by name.
    as_json : bool
    """
    refuse_path_options(how)
    target = choose_target(source, how) or (None if as_json else Target(program="-"))
    if as_json and target is not None and target.program == "-":
        raise click.UsageError("standard output can take one product; got -o and --json")
    name = "stdin" if source == STDIO else source
    if how["undo"]:
        if how["plot"] is not None:
            raise click.UsageError("--undo draws nothing; leave out --plot")
        return _undo(name, data, target, as_json)
    options.require_machine(how["machine"])
    return _compensate(name, data, how, target, as_json)


def refuse_path_options(how: Mapping[str, Any]) -> None:
    """Refuse what a part program has of its own; options that a command does not have may be missing.

    Raises
    ------
    click.UsageError
        Where an option is given that is for path files.
    """
    given = [option for name, option in PATH_ONLY.items() if how.get(name) is not None]
    given += ["--feed-mode"] if how.get("feed_mode", options.PER_MINUTE) != options.PER_MINUTE else []
    given += ["--start moving"] if how["start"] != "rest" else []
    given += ["--strategy retrograde"] if how["strategy"] == "retrograde" else []
    given += ["--allow-retrograde"] if how["allow_retrograde"] else []
    if given:
        raise click.UsageError(f"{given[0]} is for path files; a part program keeps its own")


def _undo(name: str, data: bytes, target: Target | None, as_json: bool) -> int:
    """Write the original of a compensated program."""
    from ph_post.edit.undo import undo
    from ph_post.files.storage import write_atomically
    from ph_post.report.programs import undone_view
    from ph_post.report.tables import print_json

    original = undo(data, name)
    products = {} if target is None else products_of(target, original, data)
    write_atomically(products)
    if as_json:
        print_json(undone_view())
    options.report_written((), products)
    return 0


def _compensate(name: str, data: bytes, how: dict[str, Any], target: Target | None, as_json: bool) -> int:
    from ph_post.api.programs import assess_program
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import write_atomically
    from ph_post.report.programs import program_lines, program_view
    from ph_post.report.tables import print_json

    with ProgressPrinter() as progress:
        found, machine, request = deliver_program(name, data, how, progress)
        products = {} if target is None else products_of(target, found.after.data, data)
        outcome = None if how["no_simulation"] else assess_program(found, machine, errors=as_json, progress=progress)
        if how["plot"] is not None:
            products = {**products, how["plot"]: _drawn(found, machine, how, progress)}
        write_atomically(products)
    if as_json:
        print_json(program_view(found, machine, request.edit.tolerance, outcome))
    for line in program_lines(found, outcome, products):
        click.echo(line, err=True)
    return 0


def deliver_program(
    name: str, data: bytes, how: Mapping[str, Any], progress: Progress, *, noted: bool = False
) -> tuple[CompensatedProgram, Machine, ProgramRequest]:
    """Read a part program and the machine file, and compensate the one for the other.

    Parameters
    ----------
    name : str
        The program's, in messages.
    data : bytes
    how : mapping
        The command's options by name.
    progress : Progress
        Called with what is being done.
    noted : bool, optional
        Whether the head of the program is to tell the warnings too.

    Raises
    ------
    InputError
        Where program or machine file are bad, and as :func:`ph_post.api.programs.compensate_program`.
    """
    from ph_post.api.programs import ProgramRequest, compensate_program
    from ph_post.cli.job import default_strategy, plan_options, read_drives
    from ph_post.dialects.reading import read_as

    progress("reading")
    machine = read_drives(how["machine"], how["dialect"])
    program = read_as(machine.dialect, data, name, strict=how["strict"])
    plan = plan_options({**how, "strategy": how["strategy"] or default_strategy(how)}, "program")
    request = ProgramRequest(plan=plan, edit=_splice_options(how), force=how["force"], noted=noted)
    return compensate_program(program, machine, request, progress), machine, request


def _drawn(found: CompensatedProgram, machine: Machine, how: dict[str, Any], progress: Progress) -> bytes:
    """Draw a program as it was and as compensated."""
    from ph_post.report.figures import picture_format, render
    from ph_post.report.motion_figures import draw_picture
    from ph_post.report.traces import program_picture

    picture = program_picture(found, machine, how["tolerance"] * MM, how["strategy"], progress)
    return render(draw_picture(picture), picture_format(how["plot"]))


def compensated(raw: SourceBytes, machine: Machine, how: dict[str, Any], progress: Progress) -> CompensatedProgram:
    """Compensate a part program as `convert` would; of one that is compensated already, recover the original.

    Parameters
    ----------
    raw : SourceBytes
    machine : Machine
    how : dict
        The options of planning by name.
    progress : Progress
        Called with what is being done.
    """
    from ph_post.api.programs import CompensatedProgram, ProgramRequest, compensate_program
    from ph_post.cli.job import plan_options
    from ph_post.dialects.reading import read_as
    from ph_post.drive.axes import check_axes
    from ph_post.edit.edits import EditOptions
    from ph_post.edit.undo import original_of
    from ph_post.simulate.controllers.run import moved_axes

    refuse_path_options(how)
    program = read_as(machine.dialect, raw.data, raw.name)
    check_axes(moved_axes(program), "program", machine, f"machine {machine.name}")
    original = original_of(program)
    if original is not None:
        return CompensatedProgram(before=original, after=program, done=True)
    splicing = EditOptions(tolerance=how["tolerance"] * MM, max_slowdown=how["max_slowdown"])
    return compensate_program(
        program, machine, ProgramRequest(plan=plan_options(how, "program"), edit=splicing), progress
    )


def _splice_options(how: Mapping[str, Any]) -> EditOptions:
    from ph_post.edit.edits import EditOptions

    scale = {"chord_tolerance": MM, "block_time": MS, "tolerance": MM, "max_slowdown": 1.0}
    return EditOptions(**{name: how[name] * unit for name, unit in scale.items() if how[name] is not None})


DEFAULTS: Final[Mapping[str, Any]] = {"interval_table": None, "feed_mode": options.PER_MINUTE}
"""Options of ``convert`` that the commands for other programs do not have."""

_LEFT_OUT: Final[Mapping[str, Any]] = {**dict.fromkeys(PATH_ONLY), "feed_mode": options.PER_MINUTE}
"""What part programs leave out: one line with the options of path files serves both."""


class Converted(msgspec.Struct, frozen=True, kw_only=True):
    """A program to be written, and what there is to say about it.

    `said` is one line about what was done, `warnings` what was left alone or has to be known. `original` are
    the bytes that it was made of, where it is a part program; `done` says that the input was this very
    compensation already.
    """

    data: bytes
    said: str
    warnings: tuple[str, ...] = ()
    original: bytes | None = None
    done: bool = False

    @property
    def lines(self) -> tuple[str, ...]:
        """All of it, a line each."""
        return (self.said, *(f"warning: {word}" for word in self.warnings))


def convert_input(raw: SourceBytes, how: Mapping[str, Any], progress: Progress, *, noted: bool = False) -> Converted:
    """Convert a path file or a part program into a compensated program.

    Parameters
    ----------
    raw : SourceBytes
    how : mapping
        Options of ``convert`` by name; those of :data:`DEFAULTS` may be missing.
    progress : Progress
        Called with what is being done.
    noted : bool, optional
        Whether the program itself is to tell the warnings, in comments at its head.

    Raises
    ------
    InputError
        Where the input or the machine file are bad.
    click.UsageError
        Where an option does not fit a part program.
    """
    from ph_post.edit.inputs import is_program

    if is_program(raw):
        return convert_part(raw, {**how, **_LEFT_OUT}, progress, noted=noted)
    return _convert_path(raw, {**DEFAULTS, **how}, progress, noted=noted)


def convert_part(raw: SourceBytes, how: Mapping[str, Any], progress: Progress, *, noted: bool = False) -> Converted:
    """Convert a part program, whatever its name ends with; as :func:`convert_input`."""
    from ph_post.report.programs import program_summary, warnings_of

    refuse_path_options(how)
    found, _, _ = deliver_program(raw.name, raw.data, how, progress, noted=noted)
    return Converted(
        data=found.after.data,
        said=program_summary(found, None),
        warnings=warnings_of(found),
        original=found.before.data,
        done=found.done,
    )


def _convert_path(raw: SourceBytes, how: Mapping[str, Any], progress: Progress, *, noted: bool) -> Converted:
    from ph_post.cli.job import (
        default_strategy,
        effect_warnings,
        load_and_analyse,
        plan_options,
        program_of,
        program_options,
        with_warnings,
    )
    from ph_post.compensate.plan import make_plan
    from ph_post.report.tables import plan_summary

    how = {**how, "strategy": how["strategy"] or default_strategy(how)}
    analysis = load_and_analyse(
        raw,
        how["machine"],
        how["tolerance"],
        progress,
        feed=how["feed"],
        dialect=how["dialect"],
        intervals=how["interval_table"],
    )
    assert analysis.machine is not None
    progress("planning the program")
    plan = make_plan(analysis, plan_options(how, "program"), progress)
    plan = with_warnings(plan, *effect_warnings(analysis.machine, analysis.path.axes))
    progress("writing the program")
    text, plan = program_of(analysis, plan, program_options(how))
    if noted:
        text = _noted(text, plan.warnings, plan.machine.dialect)
    return Converted(data=text.encode(), said=plan_summary(plan), warnings=plan.warnings)


def _noted(program: str, warnings: tuple[str, ...], dialect: str) -> str:
    """Put warnings at the head of a program."""
    from ph_post.dialects.registry import find_dialect

    remark = find_dialect(dialect).comment
    notes = [line for word in warnings for line in remark(f"warning: {word}")]
    return "".join(f"{line}\n" for line in notes) + program


@contextlib.contextmanager
def silenced() -> Iterator[None]:
    """Keep both streams free of whatever is said on the way: who called reads them."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield
