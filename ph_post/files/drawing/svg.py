"""Read SVG drawings: elements, groups, layers and references; the curves are in `svgcurves`.

The tree is gone through here and not by svgelements, which skips in silence what it cannot read, takes a
millimetre for 3.77953 px, and loads no tree safely; its parsers of path data and of transforms are used.

References
----------
.. [1] Scalable Vector Graphics (SVG) 1.1 (Second Edition), W3C 2011: 5 (structure), 7 (coordinates).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Final

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.files.drawing.shapes import MAX_DEPTH, Collector, Drawing
from ph_post.files.drawing.svgcurves import SHAPES, curves_of, transform_of
from ph_post.files.drawing.svgtree import (
    Node,
    RelativeLengthError,
    View,
    fit,
    length,
    page_of,
    parse_xml,
    view_box,
    whole_of,
)
from ph_post.types import Array

SVG: Final = "http://www.w3.org/2000/svg"
_INKSCAPE: Final = "{http://www.inkscape.org/namespaces/inkscape}"
_XLINK: Final = "{http://www.w3.org/1999/xlink}"

GROUPS: Final = frozenset(("g", "a"))
SILENT: Final = frozenset(
    (
        "defs",
        "symbol",
        "title",
        "desc",
        "metadata",
        "style",
        "script",
        "linearGradient",
        "radialGradient",
        "filter",
        "clipPath",
        "mask",
        "pattern",
        "marker",
        "view",
        "font",
        "cursor",
        "color-profile",
    )
)
"""Elements that draw nothing by themselves: what they define counts where it is used."""

APPLIED: Final = ("clip-path", "mask", "marker", "marker-start", "marker-mid", "marker-end")
"""Properties that change what is seen of a shape, and not its path."""

_SHEET: Final = re.compile(
    r"(?<![\w-])(display|visibility|transform|d|x|y|r|rx|ry|cx|cy|width|height)\s*:", re.IGNORECASE
)


class _Context(msgspec.Struct, frozen=True, kw_only=True):
    """Properties that an element has from those around it."""

    matrix: Array
    view: View
    layer: str = "0"
    named: bool = False
    hidden: bool = False
    used: tuple[str, ...] = ()
    depth: int = 0


def read_svg(data: bytes, file: str, layers: Sequence[str] = (), unit: str | None = None) -> Drawing:
    """Read an SVG drawing.

    Parameters
    ----------
    data : bytes
        The file.
    file : str
        Its name for messages.
    layers : sequence of str
        Layers to read, also where they are hidden; all visible ones where there are none.
    unit : str, optional
        What one user unit is, in place of what the drawing says.

    Raises
    ------
    InputError
        Where it is damaged, too large, or holds numbers that are none.
    """
    root = parse_xml(data, file)
    if root.tag != "svg" or root.namespace not in {SVG, ""}:
        raise InputError(f"{file}:{root.line}", "not an SVG drawing", expected="<svg>", got=f"<{root.tag}>")
    found = Collector(file, layers)
    page = page_of(root.attributes, f"{file}:{root.line}", unit)
    for note in page.notes:
        found.note(note)
    walk = _SvgWalk(root, found)
    walk.children(root, _Context(matrix=page.matrix, view=page.view))
    return found.drawing("SVG", page.unit)


class _SvgWalk:
    """Goes through the tree and through what it uses."""

    def __init__(self, root: Node, found: Collector) -> None:
        self._found = found
        self._by_id: dict[str, Node] = {}
        self._layered = False
        for node in _all(root):
            self._by_id.setdefault(node.attributes.get("id", ""), node)
            self._layered |= _is_layer(node)
            if node.tag == "style" and _SHEET.search(node.text):
                found.leave_out("style sheet that moves or hides")

    def children(self, node: Node, context: _Context) -> None:
        """Gather what is drawn inside of an element."""
        for child in node.children:
            if child.namespace in {SVG, ""}:
                self._element(child, context)

    def _element(self, node: Node, context: _Context) -> None:
        if node.tag in SILENT:
            return
        layer, named = self._layer_of(node, context)
        style = _style(node)
        if style.get("display") == "none":
            self._hide(node, layer, context)
            return
        visibility = style.get("visibility")
        hidden = context.hidden if visibility is None else visibility in {"hidden", "collapse"}
        for name in APPLIED:
            if style.get(name, "none") != "none" and self._found.wants(layer):
                self._found.leave_out(f"{name} (the shape is taken whole)")
        if "transform" in style or "transform-origin" in (style | node.attributes):
            self._found.count(layer, node.tag)
            self._found.leave_out(f"{node.tag} with a CSS transform")
            return
        matrix = context.matrix @ transform_of(node, self._found.file)
        inside = msgspec.structs.replace(
            context, matrix=matrix, layer=layer, named=named, hidden=hidden, depth=context.depth + 1
        )
        self._inside(node, inside)

    def _inside(self, node: Node, context: _Context) -> None:
        """Gather an element whose place is known."""
        if node.tag in GROUPS:
            self.children(node, context)
        elif node.tag == "switch":
            chosen = [one for one in node.children if one.namespace in {SVG, ""} and _always(one)]
            for child in chosen[:1]:
                self._element(child, context)
        elif node.tag == "use":
            self._use(node, context)
        elif node.tag == "svg":
            self._view(node, node, context)
        else:
            self._drawn(node, context)

    def _drawn(self, node: Node, context: _Context) -> None:
        found = self._found
        found.count(context.layer, node.tag)
        if not found.wants(context.layer):
            return
        if context.hidden and context.layer not in found.layers:
            found.leave_out("hidden (display or visibility)")
        elif node.tag not in SHAPES:
            found.leave_out(node.tag)
        else:
            try:
                runs = list(curves_of(node, context.view, found.file))
            except RelativeLengthError as error:
                found.leave_out(f"{node.tag} with {error}")
                return
            if not runs:
                found.leave_out(f"{node.tag} without length")
            for shapes in runs:
                found.add(shapes, context.matrix, context.layer, f"{node.tag} at line {node.line}")

    def _hide(self, node: Node, layer: str, context: _Context) -> None:
        """Take a hidden layer that was asked for; count what else is hidden."""
        if layer in self._found.layers:
            shown = {key: text for key, text in node.attributes.items() if key != "display"}
            shown["style"] = re.sub(r"display\s*:\s*none", "", shown.get("style", ""))
            bare = Node(node.namespace, node.tag, shown, node.line)
            bare.children = node.children
            self._element(bare, context)
            return
        drawn = sum(1 for one in _all(node) if one.tag in SHAPES or one.tag in {"use", "text", "image"})
        self._found.leave_out("hidden (display or visibility)", drawn)
        for _ in range(drawn):
            self._found.count(layer, "hidden")

    def _use(self, node: Node, context: _Context) -> None:
        found = self._found
        target = node.attributes.get("href", node.attributes.get(f"{_XLINK}href", ""))
        used = self._by_id.get(target[1:]) if target.startswith("#") and len(target) > 1 else None
        if used is None:
            found.leave_out("use of an element that is not in the file")
            return
        if target in context.used or context.depth > MAX_DEPTH:
            raise InputError(f"{found.file}:{node.line}", f"{target[:40]} uses itself")
        found.spend(1)
        try:
            shift = _shifted(node, context.view)
        except RelativeLengthError as error:
            found.leave_out(f"use with {error}")
            return
        inside = msgspec.structs.replace(
            context, matrix=context.matrix @ shift, used=(*context.used, target), depth=context.depth + 1
        )
        if used.tag in {"symbol", "svg"}:
            self._view(used, node, inside)
        else:
            self._element(used, inside)

    def _view(self, node: Node, size: Node, context: _Context) -> None:
        """Gather an inner view, whose size the element `size` gives before its own."""
        where = f"{self._found.file}:{node.line}"
        box = view_box(node.attributes, where)
        try:
            matrix = _shifted(node, context.view) if size is node else np.eye(4)
            view = context.view
            wide, high = (self._size(node, size, axis, context) for axis in (0, 1))
            if box is not None:
                how = node.attributes.get("preserveAspectRatio", "xMidYMid")
                sx, sy, tx, ty = map(float, fit(box, Fraction(wide), Fraction(high), how))
                matrix = matrix @ np.array([[sx, 0, 0, tx], [0, sy, 0, ty], [0, 0, 1, 0], [0, 0, 0, 1.0]])
                view = (float(box.width), float(box.height))
        except RelativeLengthError as error:
            self._found.leave_out(f"{node.tag} with {error}")
            return
        self._found.note("inner views (<svg>, <symbol>) are taken whole, not cut off at their edges")
        self.children(node, msgspec.structs.replace(context, matrix=context.matrix @ matrix, view=view))

    def _size(self, node: Node, size: Node, axis: int, context: _Context) -> float:
        key = ("width", "height")[axis]
        text = size.attributes.get(key, node.attributes.get(key, "100%"))
        if context.view is None and text.endswith("%") and "viewBox" not in node.attributes:
            return 0.0  # not needed
        return length(text, whole_of(context.view, axis))

    def _layer_of(self, node: Node, context: _Context) -> tuple[str, bool]:
        """Return the layer: the innermost one of Inkscape's; without any, the outermost group with a name."""
        label = node.attributes.get(f"{_INKSCAPE}label") or node.attributes.get("id", "")
        if self._layered:
            return (label, True) if _is_layer(node) else (context.layer, context.named)
        if context.named or node.tag not in GROUPS or not label:
            return context.layer, context.named
        return label, True


def _all(root: Node) -> Iterator[Node]:
    waiting = [root]
    while waiting:
        node = waiting.pop()
        yield node
        waiting.extend(reversed(node.children))


def _is_layer(node: Node) -> bool:
    return node.attributes.get(f"{_INKSCAPE}groupmode") == "layer"


def _always(node: Node) -> bool:
    """Return whether a child of <switch> is drawn by every program."""
    return node.tag != "foreignObject" and not {
        "requiredExtensions",
        "requiredFeatures",
        "systemLanguage",
    } & set(node.attributes)


def _style(node: Node) -> dict[str, str]:
    """Properties of an element: its attributes of these names, and over them those of `style`."""
    names = ("display", "visibility", *APPLIED)
    found = {name: node.attributes[name].strip() for name in names if name in node.attributes}
    for part in node.attributes.get("style", "").split(";"):
        name, colon, value = part.partition(":")
        if colon:
            found[name.strip().lower()] = value.replace("!important", "").strip()
    return found


def _shifted(node: Node, view: View) -> Array:
    """Return the shift by `x` and `y` of an element, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:2, 3] = [length(node.attributes.get(key, "0"), whole_of(view, axis)) for axis, key in enumerate("xy")]
    return matrix
