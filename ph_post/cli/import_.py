"""``ph-post import``: makes a path file of a drawing."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import click

from ph_post.cli import options

UNIT_NAMES = ("mm", "cm", "m", "um", "inch", "ft", "mil", "px", "pt")
"""What --units takes."""


def _fraction(_ctx: click.Context, _parameter: click.Parameter, text: str | None) -> Fraction | None:
    """Read a positive number exactly: ``0.1``, ``25.4`` or ``1/20``."""
    if text is None:
        return None
    try:
        value = Fraction(text) if len(text) <= 40 and "e" not in text.lower() else Fraction(float(text))
    except (ValueError, ZeroDivisionError, OverflowError):
        value = Fraction(0)
    if not 1e-9 <= value <= 1e9:
        raise click.BadParameter(f"expected a number above 0 such as 2.5 or 1/20; got {text[:40]!r}")
    return value


def _origin(_ctx: click.Context, _parameter: click.Parameter, text: str) -> str | tuple[float, float]:
    """Read ``drawing``, ``corner``, ``center`` or ``X,Y``."""
    if text in {"drawing", "corner", "center"}:
        return text
    try:
        x, y = (float(word) for word in text.split(","))
    except ValueError:
        x = y = float("nan")
    if not max(abs(x), abs(y)) < 1e9:
        raise click.BadParameter(f"expected drawing, corner, center or X,Y in mm; got {text[:40]!r}")
    return x, y


@click.command()
@click.argument("drawing", metavar="DRAWING")
@click.option("-o", "--output", metavar="PATH.json", help="The path file; - or none for standard output.")
@click.option("--list", "listing", is_flag=True, help="Show what the drawing holds, and import nothing.")
@click.option(
    "--layer",
    "layers",
    multiple=True,
    metavar="NAME",
    help="Import this layer alone, hidden or not; again for more, cut in this order.",
)
@click.option(
    "--units",
    type=options.Word(UNIT_NAMES),
    help="What one unit of the drawing is, where it does not say or says it wrongly.",
)
@click.option("--scale", callback=_fraction, default="1", metavar="FACTOR", help="Enlarge by this factor.")
@click.option("--feed", callback=_fraction, metavar="MM/MIN", help="Feed of the path. [1000]")
@click.option(
    "--join",
    type=options.positive,
    default=0.01,
    show_default=True,
    metavar="MM",
    help="Ends no farther apart belong together and are made to meet.",
)
@click.option(
    "--origin",
    callback=_origin,
    default="drawing",
    show_default=True,
    metavar="WHERE",
    help="Where X0 Y0 lies: drawing (as drawn; of an SVG the page's lower left corner), corner (of "
    "what is imported, lower left), center (its middle), or X,Y of the drawing in mm.",
)
@click.option(
    "--axes",
    type=options.Word(["XY", "XYZ"]),
    default="XY",
    show_default=True,
    help="XY needs a flat drawing; XYZ keeps its heights.",
)
@click.option(
    "--order",
    type=options.Word(["nearest", "drawn"]),
    default="nearest",
    show_default=True,
    help="Order of the contours of a layer.",
)
@click.option("--closed", is_flag=True, help="Refuse the drawing unless every contour is closed.")
@click.option("--strict", is_flag=True, help="Refuse the drawing where anything in it has to be left out.")
@options.common
def command(drawing: str, output: str | None, listing: bool, as_json: bool, **how: Any) -> int:
    """Make a path file of a DXF or SVG drawing, its curves as exact as they are drawn.

    DRAWING is a .dxf (ASCII, model space) or .svg file, or - for standard input. Lines, arcs, circles,
    ellipses, splines, polylines with their arcs, and blocks of a DXF are taken; paths and shapes of an SVG,
    filled or not, with y upwards. An arc stays an arc, a cubic stays a cubic, and an ellipse becomes the
    rational curve that it is: nothing is cut into chords. What is not understood (TEXT, HATCH, …) is counted
    and named; so is what is hidden.

    Ends that meet are chained to contours, layer by layer; a contour runs as the first of its curves was
    drawn. Rapids link the contours: give `convert` --safe-z and --depth to lift the tool there. A drawing
    without a unit needs --units.

    \b
    Examples:
      ph-post import part.dxf -o part.json --feed 800
      ph-post import part.dxf --list
      ph-post import part.dxf -o outline.json --layer OUTLINE --closed --origin corner
      ph-post import logo.svg --units mm --feed 600 | ph-post convert - -m router --safe-z 5 --depth -1 -o -
    """
    from ph_post.cli.outputs import check_places
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.drawing.convert import import_drawing, name_of, read_drawing
    from ph_post.files.storage import write_atomically
    from ph_post.report.drawings import import_view, list_view, print_import, print_list
    from ph_post.report.tables import print_json

    check_places({"DRAWING": drawing}, {"-o": output}, json=as_json)
    if listing and output is not None:
        raise click.UsageError("--list writes no path; leave out -o")
    with ProgressPrinter() as progress:
        progress("reading the drawing")
        found = read_drawing(drawing, how["layers"], how["units"])
        if listing:
            progress("measuring")
            shown = list_view(found)
        else:
            progress("joining curves")
            made = import_drawing(found, *name_of(drawing), _import_options(how))
            progress("measuring")
            shown = import_view(made, output)
    if listing:
        if as_json:
            print_json(shown)
        else:
            print_list(shown)
        return 0
    products = {output or "-": made.text} if output is not None or not as_json else {}
    write_atomically(products)
    if as_json:
        print_json(shown)
    else:
        print_import(shown)
    options.report_written(shown["warnings"], products)
    return 0


def _import_options(how: dict[str, Any]) -> Any:
    from ph_post.files.drawing.convert import ImportOptions

    return ImportOptions(
        layers=tuple(dict.fromkeys(how["layers"])),
        unit=how["units"],
        scale=how["scale"],
        feed=how["feed"],
        join=how["join"],
        axes=how["axes"],
        origin=how["origin"],
        closed=how["closed"],
        nearest=how["order"] == "nearest",
        strict=how["strict"],
    )
