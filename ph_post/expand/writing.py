"""Numbers and lines of programs that are written out, and the comments that keep originals."""

from __future__ import annotations

import base64
import binascii
import hashlib
import re
import zlib
from typing import Final, Literal, TypeAlias

import msgspec

from ph_post.errors import InputError
from ph_post.expand.macro import FanucNumbers
from ph_post.expand.tools import ToolShape
from ph_post.gcode.numbers import PARENTHESES, Comments
from ph_post.version import package_version

DECIMALS: Final = 9
"""Decimals of lengths: what is added up in increments is off by less than 1 nm after a thousand of them."""

LONGEST: Final = 251
"""Characters of a line for LinuxCNC: it reads 253 with the end, and runs what a comment says before the words."""

_WIDTH: Final = 110

Spoken: TypeAlias = Literal["linuxcnc", "siemens", "heidenhain"] | FanucNumbers
"""The language that a program is written out from; of Fanuc's how its control counts."""


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
    """What the comments of a program that was changed keep of it.

    `original` program; `digest` of the text before the comments; of its language `fanuc`, how its control counts,
    `sinumerik` or `klartext`, as older programs keep it too; `files`, the subprograms that it called by name, so that
    it can be written out again; `parameters` of the controller, None where none were given; `tools` that were known;
    `inches` says that both count in them; `version` is that of the controller, None where nobody said it.
    """

    original: bytes
    digest: str
    fanuc: FanucNumbers | None = None
    sinumerik: bool = False
    klartext: bool = False
    files: dict[str, bytes] = {}
    parameters: dict[int, float] | None = None
    tools: dict[int, ToolShape] = {}
    inches: bool = False
    version: tuple[int, ...] | None = None

    @property
    def language(self) -> Spoken:
        """The language of the program."""
        return self.fanuc or ("siemens" if self.sinumerik else "heidenhain" if self.klartext else "linuxcnc")


class OriginalComments(msgspec.Struct, frozen=True, kw_only=True):
    """Comments behind a changed program from which its original comes back, byte for byte.

    `mark` is what they begin with, and `change` what was done to the program, for messages.
    """

    mark: str
    change: str

    @property
    def _begin(self) -> bytes:
        return rf"(?:\(|; ){self.mark}".encode()

    def add(self, text: bytes, written: Written, end: bytes, style: Comments = PARENTHESES) -> bytes:
        """Put them behind a program; where its comments are in capitals they are in base 32."""
        packed = zlib.compress(msgspec.msgpack.encode(written), 6)
        code = (base64.b32encode(packed) if style.upper else base64.b64encode(packed)).decode("ascii")
        count = -(-len(code) // _WIDTH)
        rows = [f"{self.mark}undo {n + 1}/{count} {code[n * _WIDTH : (n + 1) * _WIDTH]}" for n in range(count)]
        lines = [style.line(row.upper() if style.upper else row).encode() for row in rows]
        return text + b"".join(line + end for line in lines)

    def first(self, data: bytes) -> int:
        """Return the place at which they begin, -1 where there are none."""
        found = re.search(self._begin + rb"undo 1/", data, re.IGNORECASE)
        return -1 if found is None else found.start()

    def read(self, data: bytes, name: str) -> Written | None:
        """Return what they keep; None where there are none.

        Raises
        ------
        InputError
            Where the program was changed after that, or the comments are damaged.
        """
        first = self.first(data)
        if first < 0:
            return None
        row = re.compile(self._begin + rb"(undo) (\d+)/(\d+) ([A-Za-z0-9+/=]+)", re.IGNORECASE)
        rows = list(row.finditer(data, first))
        if not rows or [int(row[2]) for row in rows] != list(range(1, int(rows[0][3]) + 1)):
            raise InputError(name, f"comments that hold the original from before it was {self.change} are missing")
        decode = base64.b32decode if rows[0][1] == b"UNDO" else base64.b64decode
        try:
            packed = zlib.decompress(decode(b"".join(row[4] for row in rows)))
            found = msgspec.msgpack.decode(packed, type=Written)
        except (binascii.Error, ValueError, zlib.error, msgspec.DecodeError) as error:
            what = f"comments that hold the original from before it was {self.change} are damaged"
            raise InputError(name, what) from error
        if hashlib.sha256(data[:first]).hexdigest() != found.digest:
            raise InputError(name, f"the program was changed after it was {self.change}, and cannot be undone")
        return found


EXPANDED: Final = OriginalComments(mark="ph-post-expand: ", change="written out")
SHIFTED: Final = OriginalComments(mark="ph-post-axes: ", change="compensated")


def head_line(digest: str, style: Comments = PARENTHESES) -> str:
    """Return the comment that says what a program was written out from."""
    text = f"{EXPANDED.mark}{package_version()} wrote this program out, original sha256 {digest}"
    return style.line(text.upper() if style.upper else text)
