"""Numbers and lines of programs that are written out, and the comments that keep their originals."""

from __future__ import annotations

import base64
import binascii
import hashlib
import re
import zlib
from typing import Final

import msgspec

from ph_post.errors import InputError
from ph_post.expand.macro import FanucNumbers
from ph_post.expand.tools import ToolShape
from ph_post.version import package_version

DECIMALS: Final = 9
"""Decimals of lengths: what is added up in increments is off by less than 1 nm after a thousand of them."""

_MARK: Final = "ph-post-expand: "
_WIDTH: Final = 110
_ROW: Final = re.compile(rb"\(ph-post-expand: (undo) (\d+)/(\d+) ([A-Za-z0-9+/=]+)\)", re.IGNORECASE)
_FIRST: Final = re.compile(rb"\(ph-post-expand: undo 1/", re.IGNORECASE)


def number_text(value: float, decimals: int) -> str:
    """Write a number without digits that say nothing.

    Examples
    --------
    >>> number_text(1.25, 9), number_text(-0.0000000001, 9), number_text(1 / 3, 6), number_text(7.0, 3)
    ('1.25', '0', '0.333333', '7')
    """
    text = f"{value:.{decimals}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


class Written(msgspec.Struct, frozen=True, kw_only=True):
    """What the comments of a program that was written out keep.

    `original` program; `digest` of the text before the comments; `fanuc`, how its control counts, and
    `files`, the subprograms that it called by name, so that it can be written out again; `parameters` of the
    controller, None where none were given;
    `tools` that were known; `inches` says that both count in them.
    """

    original: bytes
    digest: str
    fanuc: FanucNumbers | None = None
    files: dict[str, bytes] = {}
    parameters: dict[int, float] | None = None
    tools: dict[int, ToolShape] = {}
    inches: bool = False


def with_original(text: bytes, written: Written, end: bytes, *, upper: bool = False) -> bytes:
    """Put the comments behind a program from which its original comes back, byte for byte."""
    packed = zlib.compress(msgspec.msgpack.encode(written), 6)
    code = (base64.b32encode(packed) if upper else base64.b64encode(packed)).decode("ascii")
    count = -(-len(code) // _WIDTH)
    rows = [f"{_MARK}undo {n + 1}/{count} {code[n * _WIDTH : (n + 1) * _WIDTH]}" for n in range(count)]
    lines = [f"({row.upper() if upper else row})".encode() for row in rows]
    return text + b"".join(line + end for line in lines)


def head_line(digest: str, *, upper: bool = False) -> str:
    """Return the comment that says what a program was written out from."""
    text = f"{_MARK}{package_version()} wrote this program out, original sha256 {digest}"
    return f"({text.upper() if upper else text})"


def is_written_out(data: bytes) -> bool:
    """Return whether a program holds its original from before it was written out."""
    return _FIRST.search(data) is not None


def read_written(data: bytes, name: str) -> Written | None:
    """Return what the comments of a program keep; None where it was not written out.

    Raises
    ------
    InputError
        Where the program was changed after that, or the comments are damaged.
    """
    first = _FIRST.search(data)
    if first is None:
        return None
    rows = list(_ROW.finditer(data, first.start()))
    if not rows or [int(row[2]) for row in rows] != list(range(1, int(rows[0][3]) + 1)):
        raise InputError(name, "comments that hold the original from before it was written out are missing")
    decode = base64.b32decode if rows[0][1] == b"UNDO" else base64.b64decode
    try:
        packed = zlib.decompress(decode(b"".join(row[4] for row in rows)))
        found = msgspec.msgpack.decode(packed, type=Written)
    except (binascii.Error, ValueError, zlib.error, msgspec.DecodeError) as error:
        raise InputError(name, "comments that hold the original from before it was written out are damaged") from error
    if hashlib.sha256(data[: first.start()]).hexdigest() != found.digest:
        raise InputError(name, "the program was changed after it was written out, and cannot be undone")
    return found
