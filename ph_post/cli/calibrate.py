"""``ph-post calibrate``: writes test programs for a machine, and the recording plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ph_post.cli import options
from ph_post.units import MINUTE, MM, MM_PER_MIN

if TYPE_CHECKING:
    from collections.abc import Mapping

PLAN = "plan.md"
"""File name of the recording plan."""


def _numbers(_ctx: click.Context, _parameter: click.Parameter, text: str | None) -> tuple[float, ...]:
    """Read ``10,20``; nothing where the option is not given."""
    if text is None:
        return ()
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise click.BadParameter(f"expected numbers separated by commas; got {text!r}") from None


@click.command()
@options.machine
@click.option(
    "-o",
    "--output",
    default="ph_post_calibration",
    show_default=True,
    metavar="FOLDER",
    help="Folder for the programs and the plan.",
)
@click.option(
    "--axes",
    metavar="X,Y,...",
    help="Axes to move. [all but Z, which moves only where it is named]",
)
@click.option(
    "--centre",
    callback=_numbers,
    metavar="X,Y,...",
    help="Centre of the test volume in work coordinates, a number for each axis [mm]. [0]",
)
@click.option(
    "--travel",
    callback=_numbers,
    metavar="MM",
    help="Travel around it from end to end: one number, or one for each axis. [100]",
)
@click.option(
    "--radius", type=options.Number(), metavar="MM", help="Radius of the circles. [0.3 of the smallest travel]"
)
@click.option(
    "--feeds",
    callback=_numbers,
    metavar="F,F,...",
    help="Feeds of the circles [mm/min]. [three, up to 0.8 of the limit of the machine]",
)
@click.option(
    "--warm-up",
    type=options.Number(),
    default=10.0,
    show_default=True,
    metavar="MIN",
    help="Duration of the warm-up run.",
)
@click.option(
    "--without-log",
    is_flag=True,
    help="Write programs for a dial indicator, a sheet, and a file for its readings, in place of those for a log.",
)
@click.option("--tool", type=options.positive, metavar="MM", help="Diameter of a cutter: a test cut for calipers too.")
@click.option("--size", type=options.positive, metavar="MM", help="Size of its shapes. [what the travel allows, to 60]")
@click.option("--depth", type=options.positive, metavar="MM", help="Depth of the test cut. [2]")
@click.option(
    "--swing", type=options.positive, metavar="MM", help="Way of the dial test beyond a place and back. [0.5]"
)
@click.option("--repeats", type=int, metavar="N", help="Readings of the dial at a place from either side. [2]")
@click.option("--force", is_flag=True, help="Overwrite existing files of these names.")
@options.common
def command(
    machine: str,
    output: str,
    axes: str | None,
    centre: tuple[float, ...],
    travel: tuple[float, ...],
    radius: float | None,
    feeds: tuple[float, ...],
    warm_up: float,
    without_log: bool,
    repeats: int | None,
    force: bool,
    as_json: bool,
    **sizes: float | None,
) -> int:
    """Write test programs that show what a machine file should know, and the plan of what to record.

    Circles at several feeds both ways, ladders of reversals, sweeps, speeds from a crawl up, full
    acceleration, stops, diagonals, standstill and a long run that warms the screws, each a program of its
    own; and mix.ngc, a little of everything, which alone is a good beginning. All are in the dialect of the
    machine file and within its limits, move only inside the room that you state, and end where they begin,
    in its middle. The tool must be clear of everything there: the programs cut air.

    plan.md says what to record with each program, and the `ph-post diagnose` line for its log.

    --without-log is for machines that record nothing. It writes a program for each axis that stops where a dial
    indicator is to be set and read, at both ends and the middle, at two --feeds; with --tool also test_cut.ngc,
    two circles and two squares for calipers. sheet.md says what to do, readings.toml takes the readings, and
    `ph-post machine measure` makes a machine file of them.

    \b
    Examples:
      ph-post calibrate -m mill --centre 150,80 --travel 120
      ph-post calibrate -m router.toml -o tests --travel 300,200 --radius 40 --feeds 600,1800,4500
      ph-post calibrate -m mill --axes X,Y,Z --centre 150,80,-40 --travel 100,100,30
      ph-post calibrate -m router --without-log --axes X,Y,Z --centre 150,80,-40 --travel 200,200,30
      ph-post calibrate -m router --without-log --tool 6 --travel 150 --swing 0.3

    \b
    JSON:
      folder, plan  where the programs are, and the file name of the plan or sheet
      programs      a list of {name, file, why, record}
    """
    import ph_post as ph
    from ph_post.api.inputs import any_machine
    from ph_post.files.check import counted
    from ph_post.files.storage import make_folder, write_atomically
    from ph_post.report.tables import print_json
    from ph_post.testprograms.gauges import gauge_kit
    from ph_post.testprograms.kit import program_file, recording_plan
    from ph_post.testprograms.sheet import READINGS, SHEET, readings_template, sheet

    if output in ("", "-"):
        raise click.UsageError(f"-o takes a folder; got {output!r}")
    drives, _ = any_machine(machine)
    room: dict[str, Any] = {
        "axes": () if axes is None else [word.strip().upper() for word in axes.split(",")],
        "centre": _scaled(centre, MM),
        "travel": _scaled(travel, MM),
        "feeds": _scaled(feeds, MM_PER_MIN),
    }
    by_hand: dict[str, Any] = {name: None if size is None else size * MM for name, size in sizes.items()}
    by_hand["repeats"] = repeats
    circle = None if radius is None else radius * MM
    kit = ph.calibrate(drives, **room, radius=circle, warm_up=warm_up * MINUTE, without_log=without_log, **by_hand)
    texts = {program_file(drives, one): one.program for one in kit}
    if without_log:
        gauges = gauge_kit(drives, **room, **by_hand)
        plan = SHEET
        texts |= {SHEET: sheet(drives, machine, output, gauges), READINGS: readings_template(gauges)}
    else:
        plan = PLAN
        texts[PLAN] = recording_plan(drives, machine, output, kit)
    if not force:
        _refuse_others(Path(output), texts)
    folder = make_folder(output)
    write_atomically({str(folder / name): text for name, text in texts.items()})
    if as_json:
        programs = [
            {"name": one.name, "file": program_file(drives, one), "why": one.why, "record": one.record} for one in kit
        ]
        print_json({"folder": output, "plan": plan, "programs": programs})
    else:
        for one in kit:
            click.echo(f"{folder / program_file(drives, one)}: {one.why}")
    click.echo(f"wrote {counted(len(kit), 'program')} and {folder / plan}: read that first", err=True)
    return 0


def _scaled(values: tuple[float, ...], unit: float) -> tuple[float, ...]:
    return tuple(value * unit for value in values)


def _refuse_others(folder: Path, texts: Mapping[str, str]) -> None:
    """Refuse to replace what is not of the same content: it may be a person's own."""
    from ph_post.errors import InputError

    for name, text in texts.items():
        there = folder / name
        if there.exists() and (not there.is_file() or there.read_bytes() != text.encode()):
            raise InputError(
                str(there), "is there already and holds something else", expected="--force, or another folder"
            )
