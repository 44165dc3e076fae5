"""Opening a drawing: what kind it is, by what it holds and not by its name alone."""

from __future__ import annotations

import os
import pathlib
from collections.abc import Sequence
from typing import Final, Literal

import numpy as np

from ph_post.errors import InputError
from ph_post.io.drawing.record import MAX_BYTES, Drawing
from ph_post.io.exact import quoted
from ph_post.io.source import STDIN, Raw, read_raw, told_errors

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
"""What people hold for a drawing, by its first bytes."""


def read_drawing(
    source: str | os.PathLike[str], layers: Sequence[str] = (), unit: str | None = None
) -> Drawing:
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
        if kind_of(raw) == "SVG":
            from ph_post.io.drawing.svg import read_svg

            return read_svg(raw.data, raw.name, layers, unit)
        from ph_post.io.drawing.dxf import read_dxf

        return read_dxf(raw.data, raw.name, layers)


def kind_of(raw: Raw) -> Kind:
    """Tell DXF from SVG.

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
            "the name is not what the file holds",
            expected=f"{ending[1:].upper()} by its name",
            got=kind,
        )
    return kind


def _kind(raw: Raw) -> Kind:
    head = raw.data[:4096].removeprefix(b"\xef\xbb\xbf").lstrip()
    for start, what, expected in OTHERS:
        if head.startswith(start):
            raise InputError(raw.name, f"this is {what}", expected=expected)
    if head.startswith((b"<", b"\xfe\xff", b"\xff\xfe")):
        return "SVG"
    words = head.split(None, 2)
    if words[:1] in ([b"0"], [b"999"]):
        return "DXF"
    raise InputError(
        raw.name, "this is no drawing", expected="DXF or SVG", got=quoted(head[:20].decode("latin-1"))
    )


def _raw(source: str | os.PathLike[str]) -> Raw:
    if os.fspath(source) != STDIN:
        file = pathlib.Path(source)
        with told_errors(file):
            _refuse_large(os.fspath(source), file.stat().st_size)
    raw = read_raw(source)
    _refuse_large(raw.name, len(raw.data))
    return raw


def _refuse_large(name: str, size: int) -> None:
    if size > MAX_BYTES:
        raise InputError(
            name, "the drawing is too large", expected=f"at most {MAX_BYTES >> 20} MB",
            got=f"{size / 2**20:.0f} MB",
        )  # fmt: skip
