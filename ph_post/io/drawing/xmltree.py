"""XML into a small tree, safely: nothing is fetched, no entity is declared, size and depth are bounded.

The standard library's expat does the parsing. What makes XML dangerous are entities that a document declares
itself ("billion laughs", files pulled in), so a document that declares one is refused before it is expanded.
"""

from __future__ import annotations

from typing import Any
from xml.parsers import expat

from ph_post.errors import InputError
from ph_post.io.drawing.record import MAX_DEPTH, MAX_ENTITIES


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
        raise InputError(
            where, "the drawing is no well-formed XML", got=expat.ErrorString(error.code)
        ) from None
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
                f"{self.file}:{line}", "the drawing is too large",
                expected=f"at most {2 * MAX_ENTITIES} elements",
            )  # fmt: skip
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
            f"{self.file}:{self.parser.CurrentLineNumber}", "the drawing declares an XML entity",
            expected="a drawing without entities, as saved anew by a drawing program", got=name,
        )  # fmt: skip


def _attribute(key: str) -> str:
    namespace, _, name = key.rpartition(" ")
    return f"{{{namespace}}}{name}" if namespace else name
