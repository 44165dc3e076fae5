"""Read DXF drawings: the document, its unit, layers and blocks; the curves are in `dxfcurves`.

Read by ezdxf; what that library would put right or make up in silence is looked at here: it gives a drawing
without a unit metres, and rounds knots.

References
----------
.. [1] AutoCAD 2012 DXF Reference, Autodesk 2011: HEADER ($INSUNITS), ENTITIES, BLOCKS.
"""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.files.drawing.dxfcurves import EntityError, entity_errors, shapes_of, value_of
from ph_post.files.drawing.shapes import MAX_DEPTH, MAX_ENTITIES, Collector, Drawing
from ph_post.types import Array

if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document
    from ezdxf.entities.insert import Insert


UNIT_CODES: Final = {1: "inch", 2: "ft", 4: "mm", 5: "cm", 6: "m", 9: "mil", 13: "um"}
"""Units by the codes of $INSUNITS; no workpiece is drawn in the others."""

MAX_RECORDS: Final = 5 * MAX_ENTITIES
"""Most entities, vertices and table entries, which are counted before ezdxf makes objects of them."""

MOST_TOLD: Final = 5
"""Most warnings of ezdxf that are passed on word for word."""

_UNIT = re.compile(r"^\s*9\s*\n\s*\$INSUNITS\s*\n\s*70\s*\n\s*(-?\d+)\s*$", re.MULTILINE)
_RECORD = re.compile(r"^ *0 *\n *[A-Z]", re.MULTILINE)
_HIDDEN = "hidden (layer off or frozen, or invisible)"


class _Where(msgspec.Struct, frozen=True, kw_only=True):
    """Surroundings of the entities of a block: their map, the layer that "0" means, the blocks around them."""

    matrix: Array
    layer: str = "0"
    blocks: tuple[str, ...] = ()
    hidden: bool = False


def read_dxf(data: bytes, file: str, layers: Sequence[str] = ()) -> Drawing:
    """Read the model space of a DXF drawing.

    Parameters
    ----------
    data : bytes
        The file, in ASCII DXF of any release.
    file : str
        Its name for messages.
    layers : sequence of str
        Layers to read, also where they are hidden; all visible ones where there are none.

    Raises
    ------
    InputError
        Where it is damaged, too large, or holds numbers that are none.
    """
    # on its first import ezdxf looks for fonts, and warns where it cannot keep what it found
    logging.getLogger("ezdxf").addHandler(logging.NullHandler())
    text = _text(data)
    told = _EzdxfWarnings()
    document = _document(text, file, told)
    found = Collector(file, layers)
    for message in told.messages[:MOST_TOLD]:
        found.note(f"ezdxf: {message}")
    if len(told.messages) > MOST_TOLD:
        found.note(f"ezdxf: {len(told.messages) - MOST_TOLD} more such warnings")
    for layout in document.layouts:
        if layout.name != "Model" and len(layout):
            found.leave_out("in paper space", sum(1 for entity in layout if entity.dxftype() != "VIEWPORT"))
    _DxfWalk(document, found).walk(document.modelspace(), _Where(matrix=np.eye(4)))
    return found.drawing("DXF", _unit(text, found))


class _DxfWalk:
    """Goes through a layout and, block by block, through what it refers to."""

    def __init__(self, document: Document, found: Collector) -> None:
        self._document = document
        self._found = found
        names = (layer.dxf.name for layer in document.layers)
        self._layers = {str(name).casefold(): str(name) for name in names}
        self._hidden = {
            str(layer.dxf.name).casefold(): (layer.is_frozen(), layer.is_off()) for layer in document.layers
        }

    def walk(self, entities: Iterable[Any], where: _Where) -> None:
        """Gather the entities of a layout or block."""
        for entity in entities:
            layer = self._layer_of(entity, where)
            if entity.dxftype() == "INSERT":
                self._insert(entity, layer, where)
            else:
                self._entity(entity, layer, where)

    def _layer_of(self, entity: Any, where: _Where) -> str:
        layer = str(value_of(entity, "layer", "0"))
        layer = self._layers.get(layer.casefold(), layer)
        return where.layer if layer == "0" else layer

    def _entity(self, entity: Any, layer: str, where: _Where) -> None:
        found, kind = self._found, entity.dxftype()
        found.count(layer, kind)
        if not found.wants(layer):
            return
        if layer not in found.layers and (where.hidden or value_of(entity, "invisible", 0) or self._off(layer)):
            found.leave_out(_HIDDEN)
            return
        name = f"{kind} {value_of(entity, 'handle', '')}".rstrip()
        try:
            shapes, matrix = shapes_of(entity, found)
        except EntityError as fault:
            found.leave_out(f"{kind}, {fault}" if str(fault) else kind)
            return
        found.add(shapes, where.matrix @ matrix, layer, name)

    def _insert(self, insert: Insert, layer: str, where: _Where) -> None:
        found = self._found
        found.count(layer, "INSERT")
        try:
            with entity_errors():
                block, number = insert.block(), insert.mcount
        except EntityError as fault:
            found.leave_out(f"INSERT, {fault}")
            return
        if insert.attribs and found.wants(layer):
            found.leave_out("ATTRIB", len(insert.attribs))
        if block is None or block.block is None or block.block.is_xref:
            found.leave_out("INSERT of a block that is not in the file")
            return
        name = str(insert.dxf.name)
        if name in where.blocks or len(where.blocks) >= MAX_DEPTH:
            raise InputError(f"{found.file}: INSERT {insert.dxf.handle}", f"block {name} contains itself")
        frozen = self._hidden.get(layer.casefold(), (False,))[0]
        inside = _Where(
            matrix=where.matrix,
            layer=layer,
            blocks=(*where.blocks, name),
            hidden=bool(where.hidden or insert.dxf.get("invisible", 0) or frozen),
        )
        found.spend(max(0, number - 1))
        try:
            matrices = _places(insert, number)
        except EntityError as fault:
            found.leave_out(f"INSERT, {fault}")
            return
        for matrix in matrices:
            self.walk(block, msgspec.structs.replace(inside, matrix=where.matrix @ matrix))

    def _off(self, layer: str) -> bool:
        return any(self._hidden.get(layer.casefold(), (False,)))


def _places(insert: Insert, number: int) -> list[Array]:
    """Return the maps of an insert's rows and columns, shape (4, 4) each.

    Raises
    ------
    EntityError
        Where its values are missing or impossible.
    """
    with entity_errors():
        each = list(insert.multi_insert()) if number > 1 else [insert]
        return [np.array(list(one.matrix44()), dtype=np.float64).reshape(4, 4).T for one in each]


class _EzdxfWarnings(logging.Handler):
    """Keeps what ezdxf warns of while it reads."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep one message."""
        self.messages.append(" ".join(record.getMessage().split()))


def _text(data: bytes) -> str:
    """Decode: UTF-8 from release 2007 on, before in the code page that the header names."""
    from ezdxf.filemanagement import dxf_stream_info

    rough = data.decode("utf-8-sig", errors="replace")
    try:
        encoding = dxf_stream_info(io.StringIO(rough, newline=None)).encoding
        text = data.decode(encoding, errors="surrogateescape")
    except Exception:  # a damaged header: the reader below says what is wrong with it
        return rough.replace("\r\n", "\n")
    return text.removeprefix("\ufeff").replace("\r\n", "\n")


def _document(text: str, file: str, told: _EzdxfWarnings) -> Document:
    import ezdxf

    log = logging.getLogger("ezdxf")
    log.addHandler(told)
    spread, log.propagate = log.propagate, False
    try:
        if text.rstrip().rpartition("\n")[2].strip() != "EOF":
            raise InputError(file, "the DXF drawing ends too early", expected="EOF in the last line")
        if sum(1 for _ in _RECORD.finditer(text)) > MAX_RECORDS:
            raise InputError(file, "the drawing is too large", expected=f"at most {MAX_RECORDS} records")
        return ezdxf.read(io.StringIO(text))  # type: ignore[attr-defined]
    except InputError:
        raise
    except Exception as error:  # ezdxf lets through whatever its parts raise
        got = " ".join(str(error).split()) or type(error).__name__
        raise InputError(file, "the DXF drawing is damaged", got=got[:200]) from None
    finally:
        log.removeHandler(told)
        log.propagate = spread


def _unit(text: str, found: Collector) -> str | None:
    """Name the unit of $INSUNITS, None where there is none."""
    match = _UNIT.search(text)
    code = int(match[1]) if match else 0
    if code not in UNIT_CODES and code != 0:
        found.note(f"$INSUNITS is {code}, which is no unit of a workpiece")
    return UNIT_CODES.get(code)
