"""``ph-post convert`` for part programs: what changes is spliced in, verified, and only then written."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import click

from ph_post.cli.outputs import Target, choose_target, products_of
from ph_post.io.source import STDIN
from ph_post.units import MM, MS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from ph_post.audit.deliver import Delivery, Request
    from ph_post.gcode.splice.options import SpliceOptions
    from ph_post.io.source import Raw
    from ph_post.types import Machine

PATH_ONLY: Final = {
    "feed": "--feed", "safe_z": "--safe-z", "depth": "--depth",
    "interval_table": "--interval-table",
}  # fmt: skip
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
    name = "stdin" if source == STDIN else source
    if how["undo"]:
        if how["plot"] is not None:
            raise click.UsageError("--undo draws nothing; leave out --plot")
        return _undo(name, data, target)
    if how["machine"] is None:
        raise click.UsageError("Missing option '-m' / '--machine'")
    return _compensate(name, data, how, target, as_json)


def refuse_path_options(how: Mapping[str, Any]) -> None:
    """Refuse what a part program has of its own.

    Raises
    ------
    click.UsageError
        Where an option is given that is for path files.
    """
    given = [option for name, option in PATH_ONLY.items() if how[name] is not None]
    given += ["--feed-mode"] if how["feed_mode"] != "per-minute" else []
    given += ["--start moving"] if how["start"] != "rest" else []
    given += ["--strategy retrograde"] if how["strategy"] == "retrograde" else []
    given += ["--allow-retrograde"] if how["allow_retrograde"] else []
    if given:
        raise click.UsageError(f"{given[0]} is for path files; a part program keeps its own")


def _undo(name: str, data: bytes, target: Target | None) -> int:
    """Write the original of a compensated program."""
    from ph_post.gcode.splice.undo import undo
    from ph_post.io.atomic import write_atomically
    from ph_post.report.deliveries import written_lines

    if target is None:
        raise click.UsageError("--undo writes a program and prints no object; leave out --json")
    products = products_of(target, undo(data, name), data)
    write_atomically(products)
    for line in written_lines(products):
        click.echo(line, err=True)
    return 0


def _compensate(name: str, data: bytes, how: dict[str, Any], target: Target | None, as_json: bool) -> int:
    from ph_post.audit.outcome import weigh
    from ph_post.io.atomic import write_atomically
    from ph_post.report.deliveries import delivery_lines, delivery_view
    from ph_post.report.progress import Progress
    from ph_post.report.tables import print_json

    with Progress() as stage:
        found, machine, request = deliver_program(name, data, how, stage)
        products = {} if target is None else products_of(target, found.after.data, data)
        outcome = None if how["no_simulation"] else weigh(found, machine, errors=as_json, tell=stage)
        if how["plot"] is not None:
            products = {**products, how["plot"]: _drawn(found, machine, how, stage)}
        write_atomically(products)
    if as_json:
        print_json(delivery_view(found, machine, request.splice.tolerance, outcome))
    for line in delivery_lines(found, outcome, products):
        click.echo(line, err=True)
    return 0


def deliver_program(
    name: str, data: bytes, how: Mapping[str, Any], stage: Callable[[str], None], *, noted: bool = False
) -> tuple[Delivery, Machine, Request]:
    """Read a part program and the machine file, and compensate the one for the other.

    Parameters
    ----------
    name : str
        The program's, in messages.
    data : bytes
    how : mapping
        The command's options by name.
    stage : callable
        Told what is being done.
    noted : bool, optional
        Whether the head of the program is to tell the warnings too.

    Raises
    ------
    InputError
        Where program or machine file are bad, and as :func:`ph_post.audit.deliver.deliver`.
    """
    from ph_post.audit.deliver import Request, deliver
    from ph_post.cli.job import default_strategy, in_words_of, plan_options
    from ph_post.gcode.reading import read_as
    from ph_post.io.machinefile import read_machine

    stage("reading")
    machine = in_words_of(read_machine(how["machine"]), how["machine"], how["dialect"])
    program = read_as(machine.dialect, data, name, strict=how["strict"])
    plan = plan_options({**how, "strategy": how["strategy"] or default_strategy(how)}, "program")
    request = Request(plan=plan, splice=_splice_options(how), force=how["force"], noted=noted)
    return deliver(program, machine, request, stage), machine, request


def _drawn(found: Delivery, machine: Machine, how: dict[str, Any], stage: Callable[[str], None]) -> bytes:
    """Draw a program as it was and as compensated."""
    from ph_post.report.figures import picture_format, render
    from ph_post.report.picture_figures import draw_picture
    from ph_post.report.programtraces import program_picture

    picture = program_picture(found, machine, how["tolerance"] * MM, how["strategy"], stage)
    return render(draw_picture(picture), picture_format(how["plot"]))


def compensated(raw: Raw, machine: Machine, how: dict[str, Any], stage: Callable[[str], None]) -> Delivery:
    """Compensate a part program as `convert` would; of one that is compensated already, recover the original.

    Parameters
    ----------
    raw : Raw
    machine : Machine
    how : dict
        The options of planning by name.
    stage : callable
        Told what is being done.
    """
    from ph_post.audit.deliver import Delivery, Request, deliver
    from ph_post.audit.rehearse import original_of
    from ph_post.cli.job import plan_options
    from ph_post.drive.required import require_drives
    from ph_post.gcode.controller.moves import moved_axes
    from ph_post.gcode.reading import read_as
    from ph_post.gcode.splice.options import SpliceOptions

    refuse_path_options({**dict.fromkeys((*PATH_ONLY, "feed_mode")), "feed_mode": "per-minute", **how})
    program = read_as(machine.dialect, raw.data, raw.name)
    require_drives(moved_axes(program), "program", machine, f"machine {machine.name}")
    original = original_of(program)
    if original is not None:
        return Delivery(before=original, after=program, done=True)
    splicing = SpliceOptions(tolerance=how["tolerance"] * MM, max_slowdown=how["max_slowdown"])
    return deliver(program, machine, Request(plan=plan_options(how, "program"), splice=splicing), stage)


def _splice_options(how: Mapping[str, Any]) -> SpliceOptions:
    from ph_post.gcode.splice.options import SpliceOptions

    scale = {"chord_tolerance": MM, "block_time": MS, "tolerance": MM, "max_slowdown": 1.0}
    return SpliceOptions(**{name: how[name] * unit for name, unit in scale.items() if how[name] is not None})
