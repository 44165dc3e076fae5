"""Text and JSON of an imported drawing."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from ph_post.files.check import counted
from ph_post.files.drawing.chains import SAME, without_points
from ph_post.files.drawing.convert import ImportedDrawing, extents_of
from ph_post.files.drawing.shapes import UNITS, Drawing
from ph_post.geometry.track import Track
from ph_post.quantities import NOTHING
from ph_post.report.tables import format_table
from ph_post.types import Array
from ph_post.units import MM

ROUNDING = 1e-9
"""What is smaller is shown as zero, in the drawing's unit."""


def list_view(drawing: Drawing) -> dict[str, Any]:
    """Return what a drawing holds: its unit, and by layer entities and extents, in its unit."""
    mm = 1.0 if drawing.unit is None else float(UNITS[drawing.unit])
    runs, _ = without_points(drawing.runs, 2.0 * SAME / mm)
    layers = []
    for layer, kinds in drawing.found.items():
        box = extents_of(shape for run in runs if run.layer == layer for shape in run.shapes)
        layers.append({"name": layer, "entities": dict(sorted(kinds.items())), "extents": _box(box)})
    return {
        "format": drawing.kind,
        "units": drawing.unit,
        "layers": layers,
        "left_out": drawing.left_out,
        "warnings": list(drawing.notes),
    }


def print_list(view: dict[str, Any]) -> None:
    """Print what a drawing holds, a line a layer."""
    stream = sys.stdout
    unit = view["units"]
    stream.write(f"{view['format']} drawing in {unit or 'a unit that it does not tell (--units)'}\n")
    rows = []
    for layer in view["layers"]:
        box = layer["extents"]
        kinds = ", ".join(f"{count} {kind}" for kind, count in layer["entities"].items())
        places = [NOTHING] * 3 if box is None else [_range(low, high) for low, high in zip(*box, strict=True)]
        rows.append((layer["name"], *places, kinds))
    if rows:
        stream.write(format_table(("layer", "x", "y", "z", "entities"), rows) + "\n")
    for what, count in view["left_out"].items():
        stream.write(f"not taken: {count} {what}\n")
    for note in view["warnings"]:
        stream.write(f"{note}\n")


def import_view(made: ImportedDrawing, output: str | None) -> dict[str, Any]:
    """Return what was imported; lengths in mm."""
    mm = float(UNITS[made.unit])
    track = Track(made.path)
    lengths = np.bincount(track.segment, np.diff(track.starts), len(made.path.segments)) / MM
    rapid = np.array([segment.rapid for segment in made.path.segments])
    contours, cutting = [], iter(lengths[~rapid].tolist())
    for contour in made.contours:
        ends = (contour.shapes[0].start, contour.shapes[-1].end)
        contours.append(
            {
                "layer": contour.layer,
                "closed": contour.closed,
                "segments": len(contour.shapes),
                "length": sum(next(cutting) for _ in contour.shapes),
                "start": _point(ends[0] * mm),
                "end": _point(ends[1] * mm),
            }
        )
    box = extents_of(shape for contour in made.contours for shape in contour.shapes)
    joining = made.joining
    return {
        "name": made.path.name,
        "output": output,
        "units": made.unit,
        "closed": made.path.closed,
        "contours": contours,
        "segments": int((~rapid).sum()),
        "length": float(lengths[~rapid].sum()),
        "rapid_length": float(lengths[rapid].sum()),
        "extents": _box(None if box is None else box * mm),
        "gaps": {
            "closed": joining.gaps,
            "largest": joining.largest_gap * mm,
            "moved": joining.moved * mm,
            "bridged": joining.bridges,
            "forks": joining.forks,
        },
        "left_out": made.drawing.left_out,
        "warnings": _warnings(made),
    }


def print_import(view: dict[str, Any]) -> None:
    """Print one line on what was imported; the path itself may go to standard output."""
    closed = sum(contour["closed"] for contour in view["contours"])
    layers = ", ".join(dict.fromkeys(contour["layer"] for contour in view["contours"]))
    sys.stderr.write(
        f"{view['name']}: {counted(len(view['contours']), 'contour')}, {closed} closed, on layer {layers}; "
        f"{counted(view['segments'], 'segment')}, {view['length']:.3f} mm, "
        f"x {_side(view, 0)}, y {_side(view, 1)} mm\n"
    )


def _warnings(made: ImportedDrawing) -> list[str]:
    left_out = [f"left out: {count} {what}" for what, count in made.drawing.left_out.items()]
    return left_out + list(made.notes)


def _side(view: dict[str, Any], axis: int) -> str:
    low, high = view["extents"]
    return _range(low[axis], high[axis])


def _range(low: float, high: float) -> str:
    low, high = (0.0 if abs(value) < ROUNDING else value for value in (low, high))
    return f"{low:.6g} to {high:.6g}"


def _box(box: Array | None) -> list[list[float]] | None:
    return None if box is None else [_point(row) for row in box]


def _point(row: Array | Sequence[float]) -> list[float]:
    return [float(value) for value in row]
