"""``ph-post convert`` for part programs: what changes is spliced in, verified, and only then written."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import click
import msgspec

from ph_post.cli.outputs import Target, choose_target, products_of
from ph_post.io.source import STDIN
from ph_post.units import MM, MS

if TYPE_CHECKING:
    from ph_post.gcode.splice.options import SpliceOptions

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
    _refuse_path_options(how)
    target = choose_target(source, how) or (None if as_json else Target(program="-"))
    if as_json and target is not None and target.program == "-":
        raise click.UsageError("standard output can take one product; got -o and --json")
    name = "stdin" if source == STDIN else source
    if how["undo"]:
        return _undo(name, data, target)
    if how["machine"] is None:
        raise click.UsageError("Missing option '-m' / '--machine'")
    return _compensate(name, data, how, target, as_json)


def _refuse_path_options(how: dict[str, Any]) -> None:
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
    from ph_post.audit.deliver import Request, deliver
    from ph_post.audit.outcome import weigh
    from ph_post.cli.job import default_strategy, plan_options
    from ph_post.gcode.reading import read_as
    from ph_post.io.atomic import write_atomically
    from ph_post.io.machinefile import read_machine
    from ph_post.report.deliveries import delivery_lines, delivery_view
    from ph_post.report.progress import Progress
    from ph_post.report.tables import print_json

    how = {**how, "strategy": how["strategy"] or default_strategy(how)}
    with Progress() as stage:
        stage("reading")
        machine = read_machine(how["machine"])
        if how["dialect"] is not None:
            machine = msgspec.structs.replace(machine, dialect=how["dialect"])
        program = read_as(machine.dialect, data, name, strict=how["strict"])
        request = Request(plan=plan_options(how, "program"), splice=_splice_options(how), force=how["force"])
        found = deliver(program, machine, request, stage)
        products = {} if target is None else products_of(target, found.after.data, data)
        outcome = None if how["no_simulation"] else weigh(found, machine, errors=as_json, tell=stage)
        write_atomically(products)
    if as_json:
        print_json(delivery_view(found, machine, request.splice.tolerance, outcome))
    for line in delivery_lines(found, outcome, products):
        click.echo(line, err=True)
    return 0


def _splice_options(how: dict[str, Any]) -> SpliceOptions:
    from ph_post.gcode.splice.options import SpliceOptions

    scale = {"chord_tolerance": MM, "block_time": MS, "tolerance": MM, "max_slowdown": 1.0}
    return SpliceOptions(**{name: how[name] * unit for name, unit in scale.items() if how[name] is not None})
