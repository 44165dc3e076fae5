"""``ph-post machine measure``: takes readings of a dial, calipers or a ball bar, and writes the machine file."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click

from ph_post.cli import options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ph_post.types import Machine
    from ph_post.types.readings import CutWidths, DialRow, Readings

NO_MORE = "a line, empty where there is nothing more"


@click.command()
@click.argument("source", metavar="[READINGS]", required=False)
@options.machine
@click.option(
    "-o",
    "--output",
    metavar="MEASURED.toml",
    help="Write the machine file with what was measured; - for standard output.",
)
@click.option(
    "--dial",
    "dial",
    multiple=True,
    metavar="'AXIS N N N …'",
    help="A row of readings of a dial, in place of READINGS: from minus, beyond, from plus, then from minus and from"
    " plus again. May be repeated.",
)
@click.option(
    "--cut",
    "cut",
    multiple=True,
    metavar="'SHAPE.WIDTH N N …'",
    help="Readings of one width of the test cut, such as 'circle_ccw.d45 29.98 29.99'. May be repeated.",
)
@click.option("--size", type=options.positive, metavar="MM", help="Size of the shapes of --cut.")
@click.option("--tool", type=options.positive, metavar="MM", help="Diameter of the cutter of --cut.")
@click.option("--swing", type=options.positive, metavar="MM", help="Way from a place to beyond it, of --dial. [0.5]")
@click.option(
    "--unit",
    type=options.Word(["mm", "um", "inch"]),
    help="Unit of the readings of --dial, --cut and of those that are asked for. [mm]",
)
@click.option(
    "--ball-bar",
    "ball_bar",
    multiple=True,
    metavar="FILE",
    help="Arcs of a ball bar (CSV with angle in degrees and radius in mm); both ways, in one file or two.",
)
@click.option("--force", is_flag=True, help="Replace MEASURED.toml where it is there already.")
@options.common
def command(
    source: str | None,
    machine: str,
    output: str | None,
    dial: tuple[str, ...],
    cut: tuple[str, ...],
    size: float | None,
    tool: float | None,
    swing: float | None,
    unit: str | None,
    ball_bar: tuple[str, ...],
    force: bool,
    as_json: bool,
) -> int:
    """Work out lost motion, squareness and scale from readings by hand, and write the machine file.

    READINGS is the file that `ph-post calibrate --without-log` writes, with numbers between its brackets. In its
    place --dial and --cut take them on the command line. With neither, and without --ball-bar, they are asked
    for, a line each.

    Printed are the lost motion of each axis, squareness and scale; the number behind +- holds the truth in 68 of
    100 cases. -o writes the machine file with lost_motion_mm and backlash_uncertainty, which is that error and
    what the lost motion varies along the axis. Squareness and scale stand there as comments: correct them in the
    controller. Beside the results of a ball bar stand the names that its reports use.

    Readings in another unit, with the other sign, of an indicator that slipped, or that contradict each other are
    refused: exit status 2.

    \b
    Examples:
      ph-post machine measure readings.toml -m router.toml -o measured.toml
      ph-post machine measure -m router.toml --dial "X 0 0.501 0.031 0.001 0.030" --dial "Y 0 0.5 0.06 0 0.058"
      ph-post machine measure -m router.toml --ball-bar ccw.csv --ball-bar cw.csv -o measured.toml

    \b
    JSON:
      axes            by axis {lost_motion, written, backlash_uncertainty, sources, note} [mm], and repeats: how
                      often to read each place of a dial, 0 where it is enough
      squareness      by pair of axes {value, stderr} [rad]: what the angle lacks of 90 degrees
      scale           by axis {value, stderr}: 1e-4 is 0.1 mm in a metre too far
      scale_mismatch  by pair, the first axis' scale less the second's
      ball_bar        a list of results by plane
      warnings        what readings say that hardly a machine does
      file            where the machine file went, else null
    """
    import ph_post as ph
    from ph_post.api.inputs import any_machine
    from ph_post.cli.outputs import check_places, refuse_existing
    from ph_post.files.storage import write_atomically
    from ph_post.report.measurements import measurement_lines, measurement_view
    from ph_post.report.tables import print_json

    by_option = [
        name
        for name, given in (("--dial", dial), ("--cut", cut), ("--swing", swing), ("--unit", unit))
        if given or isinstance(given, float)
    ]
    if source is not None and by_option:
        raise click.UsageError(f"READINGS says that itself; got {', '.join(by_option)} beside it")
    if bool(cut) != (size is not None) or bool(cut) != (tool is not None):
        raise click.UsageError("--cut, --size and --tool go together")
    if as_json and output == "-":
        raise click.UsageError("--json takes standard output; give -o a file")
    inputs = {"READINGS": source, "-m": machine, **{f"--ball-bar {file}": file for file in ball_bar}}
    check_places(inputs, {"-o": output}, json=as_json, renews="-m")
    if output is not None:
        refuse_existing(output, force)
    drives, _ = any_machine(machine)
    readings: Readings | str | None = source
    if dial or cut:
        readings = _given(dial, cut, (size or 0.0, tool or 0.0), swing, unit)
    elif source is None and not ball_bar:
        readings = _asked(drives, swing, unit)
    found = ph.measure(readings, drives, ball_bar=ball_bar)
    if output is not None:
        write_atomically({output: found.machine_file()})
    if as_json:
        print_json({**measurement_view(found), "file": output})
    else:
        for line in measurement_lines(found):
            click.echo(line, err=output == "-")
    options.report_written(found.warnings, [] if output is None else [output])
    return 0


def _given(
    dial: Sequence[str], cut: Sequence[str], sizes: tuple[float, float], swing: float | None, unit: str | None
) -> Readings:
    """Return what stands on the command line."""
    from ph_post.files.readings import UNITS, dial_row, words_of

    scale = UNITS[unit or "mm"]
    rows: list[DialRow] = []
    for text in dial:
        axis, numbers = words_of(text, "--dial")
        again = sum(row.axis == axis.upper() for row in rows)
        where = f"--dial {axis.upper()}" + (f", row {again + 1}" if again else "")
        rows.append(dial_row(axis.upper(), numbers, scale, where))
    widths = dict(words_of(text, "--cut") for text in cut)
    return _readings("the command line", rows, _widths(widths, sizes, scale, "--cut"), swing)


def _readings(name: str, rows: Sequence[DialRow], cut: CutWidths | None, swing: float | None) -> Readings:
    from ph_post.files.readings import SWING_MM
    from ph_post.types.readings import Readings
    from ph_post.units import MM

    return Readings(name=name, swing=(swing or SWING_MM) * MM, dial=rows, cut=cut)


def _widths(given: dict[str, list[float]], sizes: tuple[float, float], scale: float, where: str) -> CutWidths | None:
    """Return widths by their names, ``circle_ccw.d45``; None where there are none."""
    from ph_post.errors import InputError
    from ph_post.files.check import one_of
    from ph_post.types.readings import CUTS, CutWidths
    from ph_post.units import MM

    if not given:
        return None
    known = [f"{shape}.{name}" for shape, names in CUTS.items() for name in names]
    widths = {}
    for key, numbers in given.items():
        if key not in known:
            raise InputError(where, "no such width", expected=one_of(known, key), got=repr(key))
        shape, _, name = key.partition(".")
        widths[shape, name] = tuple(number * scale for number in numbers)
    return CutWidths(size=sizes[0] * MM, tool=sizes[1] * MM, widths=widths, where=where)


def _asked(drives: Machine, swing: float | None, unit: str | None) -> Readings:
    """Ask for readings, a line each; an empty one ends what is asked for."""
    from ph_post.cli.interview import next_line, show
    from ph_post.files.readings import SWING_MM, UNITS, dial_row, number_of
    from ph_post.types.readings import CUTS, STEPS

    scale, name = UNITS[unit or "mm"], unit or "mm"
    terminal = sys.stdin is not None and sys.stdin.isatty()

    def numbers(question: str, where: str) -> list[float]:
        if terminal:
            show(f"{question}\n  ", end="")
        return [number_of(word, where) for word in next_line(where, NO_MORE).replace(",", " ").split()]

    if terminal:
        way = f"{swing or SWING_MM:g} mm"
        show(f"Readings in {name}, apart by blanks. Enter alone: no more. Ctrl-C writes nothing.\n")
        show(f"A row of the dial: {', '.join(STEPS)}, and from minus, from plus again; beyond is {way} further on.")
    rows: list[DialRow] = []
    for axis, drive in drives.axes.items():
        while not drive.loop.encloses_backlash:
            where = f"standard input, {axis}, row {sum(row.axis == axis for row in rows) + 1}"
            found = numbers(f"{axis}, a row of the dial:", where)
            if not found:
                break
            rows.append(dial_row(axis, found, scale, where))
    sizes = numbers("Test cut: size of the shapes and diameter of the cutter [mm]:", "standard input, test cut")
    widths: dict[str, list[float]] = {}
    if sizes:
        for shape, names in CUTS.items():
            for width in names:
                found = numbers(f"{shape}, {width}:", f"standard input, {shape}.{width}")
                if found:
                    widths[f"{shape}.{width}"] = found
    cut = _widths(widths, _two(sizes), scale, "standard input, test cut")
    return _readings("standard input", rows, cut, swing)


def _two(sizes: Sequence[float]) -> tuple[float, float]:
    from ph_post.errors import InputError

    if len(sizes) not in (0, 2) or any(size <= 0.0 for size in sizes):
        got = " ".join(f"{size:g}" for size in sizes)
        raise InputError("standard input, test cut", "not two lengths", expected="such as 30 6", got=got)
    return (sizes[0], sizes[1]) if sizes else (0.0, 0.0)
