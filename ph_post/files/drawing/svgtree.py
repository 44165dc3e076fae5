"""Parse SVG into a small tree, and read its lengths and its page.

XML is parsed safely by the standard library's expat: nothing is fetched, size and depth are bounded. What
makes XML dangerous are entities that a document declares itself ("billion laughs", files pulled in), so a
document that declares one is refused before it is expanded. Lengths and the view box give the map from user
units to the page in mm, y upwards.

References
----------
.. [1] Scalable Vector Graphics (SVG) 1.1 (Second Edition), W3C 2011: 4.2 (lengths), 7 (coordinates).
.. [2] CSS Values and Units Level 3, W3C: 6.2, an inch is 96 px.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from typing import Any, Final
from xml.parsers import expat

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.files.check import quoted
from ph_post.files.drawing.shapes import MAX_DEPTH, MAX_ENTITIES, UNITS
from ph_post.types import Array
from ph_post.units import LENGTHS

NUMBER: Final = r"[+-]?(?:\d++\.?\d*+|\.\d++)(?:[eE][+-]?\d++)?"

USER_UNITS: Final = {
    "": Fraction(1),
    **{name: LENGTHS[name] / LENGTHS["px"] for name in ("px", "cm", "mm", "pt")},
    "in": LENGTHS["inch"] / LENGTHS["px"],
    "q": LENGTHS["mm"] / 4 / LENGTHS["px"],
    "pc": 12 * LENGTHS["pt"] / LENGTHS["px"],
}
"""User units to a unit of length [2]_."""

_LENGTH = re.compile(rf"\s*({NUMBER})\s*([a-zA-Z]*|%)\s*")
_FOUR = re.compile(rf"\s*({NUMBER})[\s,]+({NUMBER})[\s,]+({NUMBER})[\s,]+({NUMBER})\s*")
_FIT = re.compile(r"\s*(?:defer\s+)?(?:(none)|x(Min|Mid|Max)Y(Min|Mid|Max))(?:\s+(meet|slice))?\s*")
_PART: Final = {"Min": Fraction(0), "Mid": Fraction(1, 2), "Max": Fraction(1)}


View = tuple[float, float] | None
"""Size of what percentages are parts of, in user units."""


class RelativeLengthError(Exception):
    """A length that has no size in mm, such as one in em."""


class Box(msgspec.Struct, frozen=True, kw_only=True):
    """A rectangle in user units, exact."""

    x: Fraction
    y: Fraction
    width: Fraction
    height: Fraction


class Page(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Attributes of the outermost element.

    `matrix` maps to `unit`, y upwards; to user units where that is None. `view` is the size in user units.
    """

    matrix: Array
    view: View
    unit: str | None
    notes: tuple[str, ...]


def length(text: str, whole: float | None) -> float:
    """Return a length in user units; a percentage is one of `whole`.

    Raises
    ------
    RelativeLengthError
        Where it has no size by itself.
    """
    return float(_exact(text, None if whole is None else Fraction(whole)))


def whole_of(view: View, axis: int) -> float | None:
    """Return what a percentage along an axis is a part of."""
    return None if view is None else view[axis]


def _exact(text: str, whole: Fraction | None) -> Fraction:
    match = _LENGTH.fullmatch(text)
    if match is None or len(text) > 100:
        raise RelativeLengthError(f"{quoted(text)} for a length")
    number, unit = _number(match[1]), match[2].lower()
    if unit == "%" and whole is not None:
        return number / 100 * whole
    if unit not in USER_UNITS:
        raise RelativeLengthError(f"a length in {unit}")
    return number * USER_UNITS[unit]


def _number(word: str) -> Fraction:
    """Return a decimal number exactly; one that is out of all proportion would fill the memory."""
    size = abs(float(word))
    if size == 0.0:
        return Fraction(0)
    if not 1e-100 < size < 1e100:
        raise RelativeLengthError(word[:40])
    return Fraction(word)


def view_box(attributes: Mapping[str, str], where: str) -> Box | None:
    """Read a view box.

    Raises
    ------
    InputError
        Where it is not four numbers, or has no area.
    """
    text = attributes.get("viewBox")
    if text is None:
        return None
    match = _FOUR.fullmatch(text)
    if match is None or len(text) > 400:
        raise InputError(where, "viewBox is not understood", expected="four numbers", got=quoted(text))
    x, y, width, height = map(_number, match.groups())
    box = Box(x=x, y=y, width=width, height=height)
    if box.width <= 0 or box.height <= 0:
        raise InputError(where, "viewBox has no area", expected="a width and a height above 0", got=quoted(text))
    return box


def fit(box: Box, width: Fraction, height: Fraction, how: str) -> tuple[Fraction, Fraction, Fraction, Fraction]:
    """Return scales and shifts (sx, sy, tx, ty) that put a view box into a viewport, as [1]_ 7.8 has it.

    Raises
    ------
    RelativeLengthError
        Where preserveAspectRatio is not understood.
    """
    match = _FIT.fullmatch(how)
    if match is None:
        raise RelativeLengthError(f"{quoted(how)} for preserveAspectRatio")
    sx, sy = width / box.width, height / box.height
    tx, ty = Fraction(0), Fraction(0)
    if match[1] is None:
        sx = sy = max(sx, sy) if match[4] == "slice" else min(sx, sy)
        tx = (width - box.width * sx) * _PART[match[2]]
        ty = (height - box.height * sy) * _PART[match[3]]
    return sx, sy, tx - box.x * sx, ty - box.y * sy


def page_of(attributes: Mapping[str, str], where: str, unit: str | None) -> Page:
    """Read width, height and view box of the outermost element.

    Parameters
    ----------
    attributes : mapping
        Of the outermost element.
    where : str
        Its place for messages.
    unit : str, optional
        What one user unit is, in place of what the drawing says.

    Raises
    ------
    InputError
        Where they are not understood.
    """
    try:
        box = view_box(attributes, where)
        size, said = _size(attributes, box, unit)
        if size is None:
            return _plain(box, unit)
        box = box or Box(x=Fraction(0), y=Fraction(0), width=size[0], height=size[1])
        sx, sy, tx, ty = fit(box, *size, attributes.get("preserveAspectRatio", "xMidYMid"))
    except RelativeLengthError as error:
        expected = "a width and a height such as 100mm"
        raise InputError(where, "the size is not understood", expected=expected, got=str(error)) from None
    mm = UNITS["px"]
    matrix = _upright(sx * mm, sy * mm, tx * mm, (size[1] - ty) * mm)
    notes = ("its px are taken as 1/96 inch; --units says otherwise",) if said == "px" else ()
    return Page(matrix=matrix, view=(float(box.width), float(box.height)), unit="mm", notes=notes)


def _size(
    attributes: Mapping[str, str], box: Box | None, unit: str | None
) -> tuple[tuple[Fraction, Fraction] | None, str]:
    """Return the viewport in px and its unit; None where nothing or --units gives it."""
    written = [attributes.get("width", "").strip(), attributes.get("height", "").strip()]
    known = [text if text and not text.endswith("%") and text != "auto" else None for text in written]
    if unit is not None or not any(known):
        return None, ""
    sizes = [None if text is None else _exact(text, None) for text in known]
    if any(size is not None and size <= 0 for size in sizes):
        raise RelativeLengthError("a size that is not positive")
    if None in sizes and box is None:
        return None, ""
    ratio = Fraction(1) if box is None else box.height / box.width
    width = sizes[0] if sizes[0] is not None else (sizes[1] or 0) / ratio
    height = sizes[1] if sizes[1] is not None else width * ratio
    pixels = any(text is not None and re.search(r"(?:\d|\.|px)$", text.lower()) for text in known)
    return (width, height), "px" if pixels else "mm"


def _plain(box: Box | None, unit: str | None) -> Page:
    """Map user units as they are, the view box' lower left corner to the origin."""
    one = Fraction(1)
    if box is None:
        return Page(matrix=_upright(one, one, 0 * one, 0 * one), view=None, unit=unit, notes=())
    matrix = _upright(one, one, -box.x, box.y + box.height)
    return Page(matrix=matrix, view=(float(box.width), float(box.height)), unit=unit, notes=())


def _upright(sx: Fraction, sy: Fraction, tx: Fraction, ty: Fraction) -> Array:
    matrix = np.eye(4)
    matrix[0, 0], matrix[1, 1] = float(sx), -float(sy)
    matrix[0, 3], matrix[1, 3] = float(tx), float(ty)
    return matrix


class Node:
    """An element: namespace and local name, attributes by local name, children, text and line.

    Attributes in a foreign namespace keep it: ``{namespace}name``.
    """

    __slots__ = ("attributes", "children", "line", "namespace", "tag", "text")

    def __init__(self, namespace: str, tag: str, attributes: dict[str, str], line: int) -> None:
        self.namespace, self.tag, self.attributes, self.line = namespace, tag, attributes, line
        self.children: list[Node] = []
        self.text = ""


def parse_xml(data: bytes, file: str) -> Node:
    """Parse a document.

    Raises
    ------
    InputError
        ``file:line:column`` where it is no XML, declares entities, or is too deep or too large.
    """
    builder = _Builder(file)
    try:
        builder.parser.Parse(data, True)
    except expat.ExpatError as error:
        where = f"{file}:{error.lineno}:{error.offset + 1}"
        raise InputError(where, "the drawing is no well-formed XML", got=expat.ErrorString(error.code)) from None
    except (ValueError, LookupError) as error:  # an encoding that is not known
        raise InputError(file, "the drawing is no well-formed XML", got=str(error)) from None
    assert builder.root is not None
    return builder.root


class _Builder:
    def __init__(self, file: str) -> None:
        self.file = file
        self.root: Node | None = None
        self._open: list[Node] = []
        self._count = 0
        self.parser = expat.ParserCreate(namespace_separator=" ")
        self.parser.buffer_text = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.EntityDeclHandler = self._entity

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        namespace, _, tag = name.rpartition(" ")
        line = self.parser.CurrentLineNumber
        self._count += 1
        if len(self._open) >= 4 * MAX_DEPTH:
            raise InputError(f"{self.file}:{line}", "elements are nested too deeply")
        if self._count > 2 * MAX_ENTITIES:
            raise InputError(
                f"{self.file}:{line}",
                "the drawing is too large",
                expected=f"at most {2 * MAX_ENTITIES} elements",
            )
        named = {_attribute(key): value for key, value in attributes.items()}
        node = Node(namespace, tag, named, line)
        if self._open:
            self._open[-1].children.append(node)
        else:
            self.root = node
        self._open.append(node)

    def _end(self, _name: str) -> None:
        self._open.pop()

    def _characters(self, text: str) -> None:
        if self._open[-1].tag == "style":
            self._open[-1].text += text

    def _entity(self, name: str, *_: Any) -> None:
        raise InputError(
            f"{self.file}:{self.parser.CurrentLineNumber}",
            "the drawing declares an XML entity",
            expected="a drawing without entities, as saved anew by a drawing program",
            got=name,
        )


def _attribute(key: str) -> str:
    namespace, _, name = key.rpartition(" ")
    return f"{{{namespace}}}{name}" if namespace else name
