"""Open a drawing and make a path file of it.

The kind of drawing follows from its content and not from its name alone. Unit, scale and origin are applied, the
contours are put in order, and the path file is read back before it is returned.
"""

from __future__ import annotations

import os
import pathlib
from collections import Counter
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Final, Literal

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.files.check import counted, quoted
from ph_post.files.drawing import chains
from ph_post.files.drawing.chains import SAME, Contour, JoinedContours, path_text
from ph_post.files.drawing.shapes import MAX_BYTES, UNITS, Drawing, DrawnShape, Subpath, transformed
from ph_post.files.path import path_of
from ph_post.files.pathcurves import MAX_LENGTH
from ph_post.files.storage import STDIO, SourceBytes, read_raw, reading_errors, source_of
from ph_post.geometry.curves import Arc, Bezier, Line
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.piecewise import PiecewiseCurve
from ph_post.geometry.reversals import find_stationary_points
from ph_post.geometry.track import Track
from ph_post.types import Array, Path
from ph_post.units import MM


def extents_of(shapes: Iterable[DrawnShape]) -> Array | None:
    """Return the least and the largest coordinates, shape (2, 3), in the shapes' unit; None of nothing.

    Curves are looked at where they turn, not at samples or control points.
    """
    curves = [_curve(shape) for shape in shapes]
    if not curves:
        return None
    track = Track.from_curves(curves)
    turns = find_stationary_points(track)
    ends = np.arange(len(track.pieces))
    piece = np.concatenate([turns.piece, ends, ends])
    u = np.concatenate([turns.u, np.zeros(len(ends)), np.ones(len(ends))])
    places = track.derivatives(piece, u)[0] / MM
    return np.array([places.min(axis=0), places.max(axis=0)])


def _curve(shape: DrawnShape) -> PiecewiseCurve:
    """Return the curve of a shape, its unit taken for mm."""
    points = shape.points * MM
    if shape.kind == "line":
        return Line(points)
    if shape.kind == "arc":
        return Arc(points[0], points[1], points[2], shape.turn)
    if shape.kind == "bezier":
        return Bezier(points)
    assert shape.knots is not None
    return Nurbs(len(shape.knots) - len(points) - 1, shape.knots, points, shape.weights)


DEFAULT_FEED: Final = Fraction(1000)
"""Feed where none is given [mm/min]; `convert --feed` sets another."""

DEFAULT_JOIN: Final = 0.01
"""Distance up to which ends belong together [mm]."""

KEPT: Final = ("mm", "m", "inch")
"""Units that a path file has: a drawing's numbers stay as they are."""

Origin = Literal["drawing", "corner", "center"] | tuple[float, float]


class ImportOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of an import; lengths in mm, the feed in mm/min."""

    layers: tuple[str, ...] = ()
    unit: str | None = None
    scale: Fraction = Fraction(1)
    feed: Fraction | None = None
    join: float = DEFAULT_JOIN
    axes: Literal["XY", "XYZ"] = "XY"
    origin: Origin = "drawing"
    closed: bool = False
    nearest: bool = True
    strict: bool = False


class ImportedDrawing(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The path file's text, the path it reads as, and what there is to say."""

    text: str
    path: Path
    contours: tuple[Contour, ...]
    joining: JoinedContours
    unit: str
    drawing: Drawing
    notes: tuple[str, ...]


def name_of(source: str) -> tuple[str, str]:
    """Return what messages call a drawing, and a name for its content.

    Examples
    --------
    >>> name_of("parts/plate.dxf"), name_of("-")
    (('parts/plate.dxf', 'plate'), ('stdin', 'stdin'))
    """
    return ("stdin", "stdin") if source == STDIO else (source, pathlib.Path(source).stem)


def import_drawing(drawing: Drawing, file: str, stem: str, wish: ImportOptions) -> ImportedDrawing:
    """Make a path file of a drawing, and read it back.

    Raises
    ------
    InputError
        Where nothing is left to import, the unit is not known, or a wish cannot be granted.
    """
    notes = list(drawing.notes)
    _require_known(drawing, file, wish)
    unit, factor = _unit(drawing, file, wish, notes)
    mm = float(UNITS[unit])
    runs = [msgspec.structs.replace(run, shapes=_scaled(run.shapes, factor)) for run in drawing.runs]
    _require_near(runs, file, mm)
    runs, points = chains.without_points(runs, 2.0 * SAME / mm)
    if points:
        drawing = msgspec.structs.replace(drawing, left_out={**drawing.left_out, "entities without length": points})
    _require_something(drawing, runs, file, wish)
    runs = _level(runs, file, wish, mm, notes)
    joining = chains.join(runs, wish.join / mm, SAME / mm)
    contours = tuple(chains.in_order(joining.contours, wish.layers, wish.nearest))
    if wish.closed:
        _require_closed(contours, file, wish, mm, unit)
    contours = _moved(contours, wish, mm)
    feed = wish.feed if wish.feed is not None else DEFAULT_FEED
    if wish.feed is None:
        notes.append(f"the feed is {DEFAULT_FEED} mm/min, as a drawing has none; set it with --feed")
    notes.extend(_join_notes(joining, wish, mm))
    notes.extend(_cut_warnings(contours, wish, mm))
    text = path_text(contours, unit, feed / UNITS[unit], wish.axes, (stem, pathlib.Path(file).name))
    path = path_of(source_of(text, f"{file}, imported", stem))
    return ImportedDrawing(
        text=text,
        path=path,
        contours=contours,
        joining=joining,
        unit=unit,
        drawing=drawing,
        notes=tuple(notes),
    )


def _require_known(drawing: Drawing, file: str, wish: ImportOptions) -> None:
    missing = [layer for layer in wish.layers if layer not in drawing.found]
    if missing:
        known = ", ".join(sorted(drawing.found)) or "none"
        raise InputError(file, f"nothing is drawn on layer {missing[0]!r}", expected=f"one of {known}")


def _require_something(drawing: Drawing, runs: Sequence[Subpath], file: str, wish: ImportOptions) -> None:
    names = ", ".join(f"{count} {what}" for what, count in drawing.left_out.items())
    if not runs:
        what = "the drawing holds nothing to cut"
        raise InputError(file, what, expected="lines, arcs or curves", got=names or "an empty drawing")
    if wish.strict and names:
        raise InputError(file, "some of the drawing cannot be taken, and --strict is given", got=names)


def _require_near(runs: Sequence[Subpath], file: str, mm: float) -> None:
    """Refuse what lies where no machine reaches, before numbers lose their digits."""
    most = MAX_LENGTH / MM / mm
    for run in runs:
        size = max(float(np.abs(shape.points).max()) for shape in run.shapes)
        if not size <= most:
            raise InputError(
                f"{file}: {run.name}",
                "a coordinate is too large",
                expected=f"at most {most * mm:g} mm",
                got=f"{size * mm:.6g} mm",
            )


def _unit(drawing: Drawing, file: str, wish: ImportOptions, notes: list[str]) -> tuple[str, Fraction]:
    """Return the path file's unit, and what the drawing's numbers are multiplied by."""
    unit = wish.unit or drawing.unit
    if unit is None:
        raise InputError(
            file,
            "the drawing states no unit",
            expected="--units mm, or another of " + ", ".join(UNITS),
        )
    if wish.unit and drawing.unit and wish.unit != drawing.unit:
        notes.append(f"the drawing says {drawing.unit}, and is taken in {wish.unit}, as --units says")
    if unit in KEPT:
        return unit, wish.scale
    return "mm", wish.scale * UNITS[unit]


def _scaled(shapes: Sequence[DrawnShape], factor: Fraction) -> tuple[DrawnShape, ...]:
    if factor == 1:
        return tuple(shapes)
    up, down = float(factor.numerator), float(factor.denominator)
    with np.errstate(over="ignore"):  # met by _require_near
        return tuple(msgspec.structs.replace(shape, points=shape.points * up / down) for shape in shapes)


def _level(runs: Sequence[Subpath], file: str, wish: ImportOptions, mm: float, notes: list[str]) -> list[Subpath]:
    """Take a flat drawing down to the height 0; refuse one that is not flat, unless heights are kept."""
    if wish.axes == "XYZ":
        return list(runs)
    heights = [float(z) for run in runs for shape in run.shapes for z in shape.points[:, 2]]
    low, high = min(heights) * mm, max(heights) * mm
    if high - low > wish.join:
        raise InputError(
            file,
            "the drawing is not flat",
            expected="one height, or --axes XYZ to keep the heights",
            got=f"heights from {low:.6g} to {high:.6g} mm",
        )
    if low != 0.0 or high != 0.0:
        notes.append(f"the drawing lies at a height of {0.5 * (low + high):.6g} mm, which X and Y do not show")
    flat = np.diag([1.0, 1.0, 0.0, 1.0])
    return [
        msgspec.structs.replace(run, shapes=tuple(transformed(shape, flat) for shape in run.shapes)) for run in runs
    ]


def _require_closed(contours: Sequence[Contour], file: str, wish: ImportOptions, mm: float, unit: str) -> None:
    still = [contour for contour in contours if not contour.closed]
    if still:
        ends = [still[0].shapes[0].start, still[0].shapes[-1].end]
        gap = float(np.linalg.norm(ends[1] - ends[0])) * mm
        shown = " and ".join(f"({point[0]:.6g}, {point[1]:.6g})" for point in ends)
        raise InputError(
            f"{file}: layer {still[0].layer}",
            f"{len(still)} of {len(contours)} contours are open",
            expected=f"ends within --join {wish.join:g} mm",
            got=f"ends at {shown} {unit}, {gap:.6g} mm apart",
        )


def _moved(contours: tuple[Contour, ...], wish: ImportOptions, mm: float) -> tuple[Contour, ...]:
    """Shift contours so that the origin lies where it was asked for."""
    if wish.origin == "drawing":
        return contours
    if isinstance(wish.origin, tuple):
        origin = np.array([*wish.origin, 0.0]) / mm
    else:
        box = extents_of(shape for contour in contours for shape in contour.shapes)
        assert box is not None
        origin = box[0] if wish.origin == "corner" else 0.5 * (box[0] + box[1])
        origin[2] = 0.0
    shift = np.eye(4)
    shift[:3, 3] = -origin
    return tuple(
        msgspec.structs.replace(contour, shapes=tuple(transformed(shape, shift) for shape in contour.shapes))
        for contour in contours
    )


def _join_notes(joining: JoinedContours, wish: ImportOptions, mm: float) -> list[str]:
    notes = []
    if joining.gaps:
        bridged = f", {joining.bridges} of them by a line" if joining.bridges else ""
        notes.append(
            f"{counted(joining.gaps, 'gap')} up to {joining.largest_gap * mm:.3g} mm closed"
            f" (--join {wish.join:g} mm){bridged}; no point moved by more than {joining.moved * mm:.3g} mm"
        )
    if joining.forks:
        places = counted(joining.forks, "place")
        notes.append(f"at {places} more than two ends meet; the straightest continuation was taken")
    return notes


def _cut_warnings(contours: Sequence[Contour], wish: ImportOptions, mm: float) -> list[str]:
    """Say what surprises at the machine: curves that are cut again, and rapids that do not lift."""
    places = Counter(_place(shape, wish.join / mm) for contour in contours for shape in contour.shapes)
    again, notes = places.total() - len(places), []
    if again:
        one, many = "curve coincides with another and is", "curves coincide with others and are"
        notes.append(f"{counted(again, one, many)} cut twice")
    if len(contours) > 1 and wish.axes == "XY":
        rapids = counted(len(contours) - 1, "rapid")
        notes.append(f"{rapids} between the contours: give convert --safe-z and --depth, or the tool stays down there")
    return notes


def _place(shape: DrawnShape, grid: float) -> tuple[str, tuple[float, ...]]:
    """Return where a curve lies, whichever way it runs, and wherever a circle begins: points on a grid."""
    points = shape.points
    if shape.kind == "arc" and np.array_equal(shape.start, shape.end):
        radius = float(np.linalg.norm(points[0] - points[2]))
        points = np.array([points[2], [radius, radius, radius]])
    elif shape.kind == "arc":
        ends = points[:2] if shape.turn == "ccw" else points[1::-1]
        return "arc", tuple(np.round(np.vstack([ends, points[2:]]) / grid).ravel().tolist())
    rows = np.round(points / grid)
    return shape.kind, min(tuple(rows.ravel().tolist()), tuple(rows[::-1].ravel().tolist()))


Kind = Literal["DXF", "SVG"]

OTHERS: Final = (
    (b"AutoCAD Binary DXF", "a binary DXF drawing", "ASCII DXF"),
    (b"AC10", "a DWG drawing", "DXF or SVG"),
    (b"%PDF", "a PDF file", "DXF or SVG"),
    (b"\x1f\x8b", "a compressed file (svgz?)", "SVG as text"),
    (b"PK\x03\x04", "a ZIP archive", "the drawing inside of it"),
    (b"\x89PNG", "a picture of pixels", "DXF or SVG"),
    (b"\xff\xd8\xff", "a picture of pixels", "DXF or SVG"),
    (b"ISO-10303-21", "a STEP model", "DXF or SVG"),
    (b"solid ", "an STL model", "DXF or SVG"),
    (b"%!PS", "a PostScript file", "DXF or SVG"),
)
"""Files that are not drawings but often taken for one, by their first bytes."""


def read_drawing(source: str | os.PathLike[str], layers: Sequence[str] = (), unit: str | None = None) -> Drawing:
    """Read a DXF or SVG drawing; ``-`` is standard input.

    Parameters
    ----------
    source : str or path
        The file.
    layers : sequence of str
        Layers to read; all visible ones where there are none.
    unit : str, optional
        What one unit of the drawing is, in place of what it says itself.

    Raises
    ------
    InputError
        One line: where it is missing, damaged, too large, or no drawing.
    """
    raw = _raw(source)
    # what leaves a double's range is met by the checks, not by a warning
    with np.errstate(all="ignore"):
        if drawing_kind(raw) == "SVG":
            from ph_post.files.drawing.svg import read_svg

            return read_svg(raw.data, raw.name, layers, unit)
        from ph_post.files.drawing.dxf import read_dxf

        return read_dxf(raw.data, raw.name, layers)


def drawing_kind(raw: SourceBytes) -> Kind:
    """Return the kind of a drawing, DXF or SVG.

    Raises
    ------
    InputError
        Where it is neither, or the file's name says the other.
    """
    if not raw.data.strip():
        raise InputError(raw.name, "the file is empty")
    kind = _kind(raw)
    ending = pathlib.Path(raw.name).suffix.lower()
    if ending in {".dxf", ".svg"} and ending != f".{kind.lower()}":
        raise InputError(
            raw.name,
            "the file does not hold what its name says",
            expected=f"{ending[1:].upper()} by its name",
            got=kind,
        )
    return kind


def _kind(raw: SourceBytes) -> Kind:
    head = raw.data[:4096].removeprefix(b"\xef\xbb\xbf").lstrip()
    for start, what, expected in OTHERS:
        if head.startswith(start):
            raise InputError(raw.name, f"this is {what}", expected=expected)
    if head.startswith((b"<", b"\xfe\xff", b"\xff\xfe")):
        return "SVG"
    words = head.split(None, 2)
    if words[:1] in ([b"0"], [b"999"]):
        return "DXF"
    raise InputError(raw.name, "this is no drawing", expected="DXF or SVG", got=quoted(head[:20].decode("latin-1")))


def _raw(source: str | os.PathLike[str]) -> SourceBytes:
    if os.fspath(source) != STDIO:
        file = pathlib.Path(source)
        with reading_errors(file):
            _refuse_large(os.fspath(source), file.stat().st_size)
    raw = read_raw(source)
    _refuse_large(raw.name, len(raw.data))
    return raw


def _refuse_large(name: str, size: int) -> None:
    if size > MAX_BYTES:
        raise InputError(
            name,
            "the drawing is too large",
            expected=f"at most {MAX_BYTES >> 20} MB",
            got=f"{size / 2**20:.0f} MB",
        )
