"""Read the variables of MATLAB files (``.mat``) of version 5 to 7 [1]_.

scipy.io.loadmat trusts the sizes and types that it finds, and a file that was damaged on its way ends the whole program
there, without a word.

References
----------
.. [1] MATLAB: MAT-File Format, The MathWorks; chapter 1, "Level 5 MAT-File Format".
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_MATRIX, _COMPRESSED = 14, 15

_HEADER: Final = 128

_LARGEST: Final = 1 << 30
"""Bytes that one variable may have when it is unpacked."""

_TYPES: Final = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
_WORDS: Final = {2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CHAR: Final = 4
_NUMERIC: Final = range(6, 16)
_COMPLEX: Final = 0x0800


def mat_variables(data: bytes) -> dict[str, Any]:
    """Return the variables by name: arrays, text, and None for what is neither (cells, structures, complex).

    Raises
    ------
    ValueError, zlib.error
        Where the bytes are no such file.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[126:_HEADER])
    if order is None or not data.startswith(b"MATLAB 5"):
        raise ValueError("no header of version 5 to 7")
    found: dict[str, Any] = {}
    for kind, body in _elements(data[_HEADER:], order):
        if kind == _COMPRESSED:
            unpacked = zlib.decompressobj().decompress(body, _LARGEST)
            found |= dict(_variable(inner, order) for one, inner in _elements(unpacked, order) if one == _MATRIX)
        elif kind == _MATRIX:
            found |= dict([_variable(body, order)])
    return found


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield type and bytes of the elements that follow each other."""
    place = 0
    while place < len(data):
        tag = np.frombuffer(data[place : place + 8].ljust(8, b"\0"), dtype=f"{order}u4")
        kind, size, begin = int(tag[0]), int(tag[1]), place + 8
        if kind >> 16:  # up to four bytes stand in the tag itself
            kind, size, begin = kind & 0xFFFF, kind >> 16, place + 4
            place += 8
        else:
            place = begin + size + (0 if kind == _COMPRESSED else -size % 8)
        if begin + size > len(data) or (begin == place - 4 and size > 4):
            raise ValueError("the file ends inside a variable")
        yield kind, data[begin : begin + size]


def _variable(data: bytes, order: str) -> tuple[str, Any]:
    """Return name and value of a matrix: flags, dimensions, name and real part, in this order."""
    parts = _elements(data, order)
    (_, flags), (_, shape), (_, name) = next(parts), next(parts), next(parts)
    word = int(np.frombuffer(flags[:4], dtype=f"{order}u4")[0])
    dimensions = np.frombuffer(shape, dtype=f"{order}i4").tolist()
    content = word & 0xFF
    key = name.decode("ascii", "replace")
    if content == _CHAR:
        return key, _text(next(parts, (16, b"")), order)
    if content not in _NUMERIC or word & _COMPLEX:
        return key, None
    return key, _numbers(next(parts, (9, b"")), order).reshape(dimensions, order="F")


def _numbers(part: tuple[int, bytes], order: str) -> NDArray[Any]:
    kind, body = part
    if kind not in _TYPES:
        raise ValueError(f"numbers of an unknown type {kind}")
    return np.frombuffer(body, dtype=f"{order}{_TYPES[kind]}")


def _text(part: tuple[int, bytes], order: str) -> str:
    kind, body = part
    coding = _WORDS.get(kind, "latin-1")
    end = {"<": "-le", ">": "-be"}[order] if coding in ("utf-16", "utf-32") else ""
    return body.decode(coding + end, "replace").strip()
