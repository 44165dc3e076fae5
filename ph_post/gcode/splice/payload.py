"""What the inverse of a change cannot know, packed into comments at the end of the program."""

from __future__ import annotations

import base64
import binascii
import zlib
from typing import Final

import msgspec

from ph_post.errors import InputError
from ph_post.gcode.format import PARENTHESES, Comments
from ph_post.gcode.splice.marks import MARK, comment_pattern, find_last, marked, said

_LEVEL: Final = 6
_WIDTH: Final = 120
_LINE = comment_pattern(rf"{MARK}(undo) (\d+)/(\d+) ([A-Za-z0-9+/=]+)")
_CAPITALS: Final = b"UNDO"
"""Lines in capitals hold base 32, which has no small letters; others base 64."""


class Payload(msgspec.Struct, frozen=True, kw_only=True, array_like=True):
    """What is needed to take a change back.

    `whole` is the original where nothing less would do. `head` the line of the first comment of the head, and
    their number; `bare` whether the original has no line end at its end; `removed` the lines that hunks stand
    in place of. Of the numbers of X, Y, Z, I, J and K outside hunks, in order: `code` 0 where the number is
    the original's, else one more than the row of `delta` (steps, decimals of a step) that was added to it. Of
    those changed, in order: `style` of the original (two bytes), and the text of `odd` ones by their number.
    """

    whole: bytes | None = None
    head: tuple[int, int] = (0, 0)
    bare: bool = False
    removed: bytes = b""
    delta: tuple[tuple[int, int], ...] = ()
    code: bytes = b""
    style: bytes = b""
    odd: dict[int, bytes] = {}


def payload_lines(payload: Payload, max_line: int, style: Comments = PARENTHESES) -> list[str]:
    """Write a payload as numbered comment lines."""
    packed = zlib.compress(msgspec.msgpack.encode(payload), _LEVEL)
    text = (base64.b32encode(packed) if style.upper else base64.b64encode(packed)).decode("ascii")
    room, figures = min(max_line, _WIDTH) - len(f"{MARK}undo / ") - style.extra, 1
    while len(str(-(-len(text) // (room - 2 * figures)))) > figures:
        figures += 1
    width = room - 2 * figures
    count = -(-len(text) // width)
    rows = (text[n * width : (n + 1) * width] for n in range(count))
    return [marked(f"undo {n}/{count} {row}", style) for n, row in enumerate(rows, 1)]


def payload_start(data: bytes) -> int:
    """Place at which the lines of the payload begin, -1 where there are none."""
    return find_last(data, "undo 1/")


def read_payload(data: bytes, name: str) -> tuple[Payload, int]:
    """Return the payload of a program, and the place where its lines begin.

    Raises
    ------
    InputError
        Where lines are missing or damaged.
    """
    begin = payload_start(data)
    if begin < 0:
        raise InputError(name, "the lines at the end that undo the compensation are missing")
    rows = [said(row) for row in _LINE.finditer(data, begin)]
    if not rows or [int(row[1]) for row in rows] != list(range(1, int(rows[0][2]) + 1)):
        raise InputError(name, "lines that undo the compensation are missing")
    try:
        decode = base64.b32decode if rows[0][0] == _CAPITALS else base64.b64decode
        packed = decode(b"".join(row[3] for row in rows))
        return msgspec.msgpack.decode(zlib.decompress(packed), type=Payload), begin
    except (binascii.Error, zlib.error, msgspec.DecodeError) as error:
        raise InputError(name, "lines that undo the compensation are damaged") from error
