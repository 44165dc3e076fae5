"""The sheet of a machine without a log: what to do, a table to write readings into, and the file that takes them."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from ph_post.dialects.registry import find_dialect
from ph_post.testprograms.gauges import CutTest, GaugeKit, plate
from ph_post.testprograms.kit import program_file
from ph_post.types import Machine
from ph_post.types.readings import CUTS
from ph_post.units import MM, MM_PER_MIN

READINGS: Final = "readings.toml"
"""File name of the readings."""

SHEET: Final = "sheet.md"
"""File name of the sheet."""

_ACROSS: Final = {
    "d0": "across X",
    "d45": "at 45°, from X towards Y",
    "d90": "across Y",
    "d135": "at 135°",
    "x": "across X, at the middle of the edges",
    "y": "across Y, at the middle of the edges",
    "width": "of the groove around square_inside, with the inner jaws, where it is straight",
}

_SHAPES: Final = {
    "circle_ccw": "left, in front: circle, cut counterclockwise",
    "circle_cw": "right, in front: circle, cut clockwise",
    "square_inside": "left, behind: square, edges reached from inside",
    "square_outside": "right, behind: square, edges reached from outside",
    "slot": "the groove, once through, which is as wide as the cutter really is",
}

CALIPER_READINGS: Final = 3
"""How often each width is read."""

APART: Final = 0.03 * MM
"""What readings from one side may differ by where two of each do: one is off by about 15 µm then."""

ENOUGH: Final = 4
"""How often a place is read where readings are off by 20 µm."""


def readings_template(kit: GaugeKit) -> str:
    """Write the file of readings with empty lists (TOML)."""
    return "\n".join(_template(kit)) + "\n"


def _template(kit: GaugeKit) -> Iterator[str]:
    dial, cut = kit.dial, kit.cut
    yield "# Readings for `ph-post machine measure`: numbers between the brackets, with commas. Empty: not measured."
    yield 'unit = "mm"  # of the readings: "mm", "um" or "inch"; everything else in this file is in mm'
    if dial.rows:
        yield f"swing_mm = {dial.swing / MM:g}"
        yield ""
        yield "# The dial, a row of readings in the order in which the program stops:"
        yield f"# {', '.join(dial.steps)}. It has to count up while the axis counts up."
    counts = Counter[str]()
    for row in dial.rows:
        counts[row.axis] += 1
        yield ""
        yield f"[[dial]]  # {row.axis}, row {counts[row.axis]}: {row.name}"
        yield f'axis = "{row.axis}"'
        yield f"place_mm = {row.place / MM:.6g}"
        yield f"feed_mm_min = {row.feed / MM_PER_MIN:.6g}"
        yield "readings = []"
    if cut is not None:
        yield ""
        yield "# Calipers on the test cut: each width three times, at another height or a little aside."
        yield "[cut]"
        yield f"size_mm = {cut.size / MM:g}"
        yield f"tool_mm = {cut.tool / MM:g}"
        for shape, names in CUTS.items():
            yield ""
            yield f"[cut.{shape}]  # {_SHAPES[shape]}"
            yield from (f"{name} = []  # {_ACROSS[name]}" for name in names)


def sheet(machine: Machine, source: str, folder: str, kit: GaugeKit) -> str:
    """Write the sheet as Markdown.

    Parameters
    ----------
    machine : Machine
    source : str
        What the person called the machine: a file, or the name of a shipped one.
    folder : str
        Where the programs are.
    kit : GaugeKit
    """
    lines = [*_before(machine), *_dial(machine, kit), *_cut(machine, kit.cut), *_after(machine, source, folder)]
    return "\n".join(lines) + "\n"


def _before(machine: Machine) -> Iterator[str]:
    tables = find_dialect(machine.dialect).notices.own_tables
    where = f" ({tables})" if tables else ""
    yield f"# {machine.name}: measured without a log"
    yield ""
    yield "- Read the head of each program: it says where it moves. Feed override 100 percent, work offset G54."
    yield f"- Switch off what the controller compensates{where}: it would hide the backlash."
    yield "- Warm up: run the axes to and fro for some minutes."
    if find_dialect(machine.dialect).syntax.stop is None:
        yield "- This controller has no stop in a program that is safe to use: it waits 20 s at each reading."
    closed = [name for name, axis in machine.axes.items() if axis.loop.encloses_backlash]
    if closed:
        yield (
            f"- {', '.join(closed)}: the scale on the table hides the backlash from a dial. Drive off, turn the screw"
            " by hand to and fro: the part of a turn before the table moves, times the lead, is `lost_motion_mm`."
        )


def _dial(machine: Machine, kit: GaugeKit) -> Iterator[str]:
    test = kit.dial
    if not test.rows:
        return
    swing = test.swing / MM
    yield ""
    yield "## Dial indicator"
    yield ""
    yield (
        f"An indicator with at least {3.0 * swing:g} mm of travel between spindle and table: its foot on one, its tip"
        " on the other, along the axis."
    )
    yield ""
    yield "1. Spindle off, nothing in the way. Go to the middle by hand, start the program."
    yield "2. At the first stop take the indicator away, go on. The axis goes to a place, and stops again."
    yield (
        f"3. Set the indicator against the table along the axis, pressed in by {1.5 * swing:g} mm, and turn its dial to"
        " 0. It has to count up while the axis counts up: set it on the other side, or write every reading with the"
        " other sign. Go on."
    )
    yield (
        f"4. At every further stop read the dial, estimate between its lines, write the number down, go on. *Beyond* is"
        f" about {swing:g} mm more than *from minus*: if not, the indicator slips or sits askew."
    )
    yield "5. At the end of the row take the indicator away when the comment says so."
    if test.repeats < ENOUGH:
        yield (
            f"6. Where readings of a row from the same side differ by {APART / MM:g} mm or more, {test.repeats} are too"
            f" few: write the programs anew with `--repeats {ENOUGH}`. `machine measure` says how many it takes."
        )
    axes = list(dict.fromkeys(row.axis for row in test.rows))
    for axis in axes:
        program = next(one for one in kit.programs if one.name == f"dial_{axis.lower()}")
        yield ""
        yield f"### {program_file(machine, program)}"
        yield ""
        yield f"| row | place | feed | {' | '.join(test.steps)} |"
        yield f"|---|---|---|{'---|' * len(test.steps)}"
        rows = (row for row in enumerate(test.rows, 1) if row[1].axis == axis)
        for number, (_, row) in enumerate(rows, 1):
            feed, place = f"{row.feed / MM_PER_MIN:.6g}", f"{row.name}, {row.place / MM:.6g}"
            yield f"| {number} | {place} | {feed} |{' |' * len(test.steps)}"


def _cut(machine: Machine, cut: CutTest | None) -> Iterator[str]:
    if cut is None:
        return
    wide = plate(cut)
    yield ""
    yield f"## Test cut: test_cut{find_dialect(machine.dialect).ending}"
    yield ""
    yield (
        f"A flat plate of at least {wide / MM:.0f} x {wide / MM:.0f} mm of wood, plastic or aluminium, thicker than"
        f" {cut.depth / MM:g} mm, clamped outside of the shapes. A sharp cutter of {cut.tool / MM:g} mm that cuts"
        " straight down. Zero: the middle of the plate as the head of the program says, Z0 on its top."
    )
    yield ""
    yield "Seen from above, Y away from you:"
    yield ""
    yield "```"
    yield "square_inside   square_outside"
    yield "circle_ccw      circle_cw"
    yield "```"
    yield ""
    yield f"Brush off the burr. Then calipers, each width {CALIPER_READINGS} times, in mm:"
    yield ""
    yield "| shape | width | 1 | 2 | 3 |"
    yield "|---|---|---|---|---|"
    for shape, names in CUTS.items():
        yield from (f"| {shape} | {name}: {_ACROSS[name]} | | | |" for name in names)


def _after(machine: Machine, source: str, folder: str) -> Iterator[str]:
    words = ["ph-post", "machine", "measure", str(Path(folder, READINGS)), "-m", source, "-o"]
    yield ""
    yield "## Then"
    yield ""
    yield f"Type the readings into `{READINGS}` beside this sheet; what stays empty was not measured. Then"
    yield ""
    yield "```"
    yield shlex.join([*words, f"measured_{Path(source).stem}.toml"])
    yield "```"
    yield ""
    yield f"prints what they say about {machine.name}, and writes its machine file with the lost motion in it."
