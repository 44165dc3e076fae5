"""Restore the original of a compensated program, byte for byte, by the payload in its last lines."""

from __future__ import annotations

import base64
import binascii
import hashlib
import re
import zlib
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.dialects.declaration import (
    MARK,
    change_marks,
    comment_pattern,
    declared_language,
    find_last,
    mark_text,
    marked,
    read_declaration,
)
from ph_post.edit.word_shifts import assemble, unshift_numbers
from ph_post.errors import InputError
from ph_post.gcode.language import Language
from ph_post.gcode.lexer import split_lines
from ph_post.gcode.numbers import PARENTHESES, Comments
from ph_post.gcode.program import ByteArray, PartProgram, PlaceArray, WordTable
from ph_post.gcode.read import reread
from ph_post.gcode.words import read_words
from ph_post.types import BoolArray, IntArray, sealed

_LINES: Final = 50_000
"""So many lines are restored at a time."""

_BEGUN: Final = b"N1\n"

SHIFTABLE: Final = tuple(ord(letter) for letter in "XYZIJK")
"""Letters of words that an offset can change."""


def undo(data: bytes, name: str) -> bytes:
    """Return the original of a compensated program.

    Raises
    ------
    InputError
        Where the program was not compensated, or was changed after that.
    """
    declaration = read_declaration(data)
    if declaration is None:
        raise InputError(name, "there is nothing to undo", expected="a program compensated by ph-post")
    original = restore(data, name)
    if hashlib.sha256(original).hexdigest() != declaration.digest:
        raise InputError(name, "the program was changed after it was compensated, and cannot be undone")
    return original


def original_of(program: PartProgram, name: str | None = None) -> PartProgram | None:
    """Return the original of a compensated program, read by the same words; None where it is not compensated.

    `name` is its name in messages, by default the program's own.

    Raises
    ------
    InputError
        Where the program was changed after it was compensated.
    """
    if read_declaration(program.data) is None:
        return None
    return reread(program, undo(program.data, program.name), name)


def restore(data: bytes, name: str) -> bytes:
    """Return what the payload of a program restores, without a check of the result."""
    return b"".join(_restored(data, name))


def restores(data: bytes, name: str, original: bytes) -> bool:
    """Return true where the payload of a program restores its original, byte for byte, of which it makes no copy."""
    place = 0
    try:
        for part in _restored(data, name):
            if not original.startswith(part, place):
                return False
            place += len(part)
    except InputError:
        return False
    return place == len(original)


def _restored(data: bytes, name: str) -> Iterator[bytes]:
    """Yield what the payload of a program restores, part by part."""
    payload, end, behind = read_payload(data, name)
    if payload.whole is not None:
        yield payload.whole
        return
    try:
        last = b""
        for part in _Restorer(data, end, payload, declared_language(data)).run():
            yield last
            last = part
    except (IndexError, ValueError) as error:
        raise InputError(name, "the program was changed after it was compensated, and cannot be undone") from error
    last += data[behind:]
    yield last[: len(last) - (2 if last.endswith(b"\r\n") else 1)] if payload.bare else last


class _Restorer:
    """Takes a change back, some lines at a time, so that only their words are held.

    Parameters
    ----------
    data : bytes
    end : int
        Where the lines of the payload begin.
    payload : Payload
    language : Language
    """

    def __init__(self, data: bytes, end: int, payload: Payload, language: Language) -> None:
        self._data, self._payload, self._language = data, payload, language
        self._lines = split_lines(np.frombuffer(data, np.uint8)[:end])
        self._added, self._spans = self._find_changes(end)
        self._codes = np.frombuffer(payload.code, np.uint8)
        self._styles = np.frombuffer(payload.style, "<u2")
        self._table = np.array(payload.delta, dtype=np.int64).reshape(-1, 2)
        self._removed = np.frombuffer(payload.removed, np.uint8)
        self._code = self._style = 0
        self._closed = False
        # A language of another grammar has words of its own, which only the whole of a program says.
        self._words = None if language.read is None else language.read(data, "").words

    def run(self) -> Iterator[bytes]:
        """Yield the original, part by part.

        Raises
        ------
        ValueError
            Where the text is not what the payload was made for.
        """
        last = self._lines.size - 1
        for low in range(0, last, _LINES):
            yield self._part(low, min(low + _LINES, last))
        if self._code != self._codes.size:
            raise ValueError(self._code)

    def _find_changes(self, end: int) -> tuple[BoolArray, IntArray]:
        """Mark the lines that were added (n,); and by line the span of the removed text they replaced (n, 2)."""
        removed = split_lines(np.frombuffer(self._payload.removed, np.uint8)).astype(np.int64)
        added = np.zeros(self._lines.size - 1, dtype=np.bool_)
        spans, done = np.zeros((added.size, 2), dtype=np.int64), 0
        added[self._payload.head[0] : sum(self._payload.head)] = True
        for found in change_marks(self._data, end):
            line = int(np.searchsorted(self._lines, np.int32(found.start()), side="right")) - 1
            if not added[line]:
                new, old = map(int, mark_text(found))
                added[line : line + 1 + new] = True
                spans[line] = removed[done], removed[done + old]
                done += old
        if done != removed.size - 1:
            raise ValueError(done)
        return added, spans

    def _part(self, low: int, high: int) -> bytes:
        """Restore the lines from `low` up to `high`."""
        base = int(self._lines[low])
        # A word before it shows that the text has begun, so that a percent sign ends it.
        before = _BEGUN if low else b""
        data = before + self._data[base : self._lines[high]]
        lines = self._lines[low : high + 1] - base + len(before)
        added = self._added[low:high]
        marked = np.flatnonzero(added)
        spans = np.column_stack([lines[marked], lines[marked + 1], self._spans[low:high][marked]])
        if before:
            lines, added = np.append(np.int32(0), lines), np.append(False, added)
        start, stop, pool, bounds = self._numbers(data, lines, added, low - (1 if before else 0))
        body = np.frombuffer(data, np.uint8)
        text: bytes = assemble(body, start, stop, sealed(pool), bounds, spans, self._removed).tobytes()
        return text[len(before) :]

    def _own_words(self, first: int, lines: PlaceArray) -> WordTable:
        """Return the words of some lines, of which the first is line `first` of the program."""
        assert self._words is not None
        words = self._words
        rows = words.rows(first, first + lines.size - 1)
        part = words.take(np.arange(rows.start, rows.stop))
        shift = lines[part.block - first] - self._lines[part.block]
        return replace(part, block=part.block - np.int32(first), start=part.start + shift, end=part.end + shift)

    def _numbers(
        self, data: bytes, lines: PlaceArray, added: BoolArray, first: int
    ) -> tuple[PlaceArray, PlaceArray, ByteArray, PlaceArray]:
        """Spans of the changed numbers, and the text that stood there."""
        if self._closed:
            nothing = np.zeros(0, dtype=np.int32)
            return nothing, nothing, np.zeros(0, dtype=np.uint8), np.zeros(1, dtype=np.int32)
        if self._words is None:
            lexed = read_words(self._language.hidden(data), lines)
            self._closed, words = lexed.end < lines.size - 1, lexed.words
        else:
            words = self._own_words(first, lines)
        candidate = np.flatnonzero(np.isin(words.letter, SHIFTABLE) & ~added[words.block])
        code = self._codes[self._code : self._code + candidate.size]
        if code.size != candidate.size:
            raise ValueError(code.size)
        word, number = candidate[code > 0], code[code > 0] - np.uint8(1)
        style = self._styles[self._style : self._style + word.size]
        pool, bounds, wrong = unshift_numbers(words.digits_of(word), words.decimals[word], number, self._table, style)
        if wrong:
            raise ValueError(wrong)
        odd = {n - self._style: text for n, text in self._payload.odd.items()}
        odd = {n: text for n, text in odd.items() if 0 <= n < word.size}
        if odd:
            pool, bounds = _with_odd(pool, bounds, odd)
        self._code, self._style = self._code + candidate.size, self._style + word.size
        return words.start[word] + 1, words.end[word], pool, bounds


def _with_odd(pool: ByteArray, bounds: PlaceArray, odd: dict[int, bytes]) -> tuple[ByteArray, PlaceArray]:
    """Put the kept text of odd numbers in the place of the text that their style gives."""
    texts = [pool[low:high].tobytes() for low, high in pairwise(bounds.tolist())]
    for number, text in odd.items():
        texts[number] = text
    sizes = np.array([0, *map(len, texts)], dtype=np.int32)
    return np.frombuffer(b"".join(texts), np.uint8), np.cumsum(sizes, dtype=np.int32)


_LEVEL: Final = 6
_WIDTH: Final = 120
_LINE = comment_pattern(rf"{MARK}(undo) (\d+)/(\d+) ([A-Za-z0-9+/=]+)")
_BREAK: Final = re.compile(rb"\A[ \t]*(?:\r\n|\r|\n|\Z)")
_CAPITALS: Final = b"UNDO"
"""Lines in capitals hold base 32, which has no small letters; others base 64."""


class Payload(msgspec.Struct, frozen=True, kw_only=True, array_like=True):
    """Data that undo needs and cannot compute from the compensated program.

    `whole` is the original where nothing less would do. `head` the line of the first comment of the head, and
    their number; `bare` whether the original has no line end at its end; `removed` the lines that changes stand
    in place of. Of the numbers of X, Y, Z, I, J and K outside changes, in order: `code` 0 where the number is
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


def without_payload(data: bytes, name: str) -> bytes:
    """Return a program without the lines of its payload.

    Raises
    ------
    InputError
        As :func:`read_payload`.
    """
    _, begin, behind = read_payload(data, name)
    return data[:begin] + data[behind:]


def read_payload(data: bytes, name: str) -> tuple[Payload, int, int]:
    """Return the payload of a program, the place where its lines begin, and the one behind their end.

    Raises
    ------
    InputError
        Where lines are missing or damaged.
    """
    begin = payload_start(data)
    if begin < 0:
        raise InputError(name, "the lines at the end that undo the compensation are missing")
    found = list(_LINE.finditer(data, begin))
    rows = [mark_text(row) for row in found]
    if not rows or [int(row[1]) for row in rows] != list(range(1, int(rows[0][2]) + 1)):
        raise InputError(name, "lines that undo the compensation are missing")
    try:
        decode = base64.b32decode if rows[0][0] == _CAPITALS else base64.b64decode
        packed = decode(b"".join(row[3] for row in rows))
        behind = found[-1].end()
        behind += len(data[behind:]) - len(_BREAK.sub(b"", data[behind:], count=1))
        return msgspec.msgpack.decode(zlib.decompress(packed), type=Payload), begin, behind
    except (binascii.Error, zlib.error, msgspec.DecodeError) as error:
        raise InputError(name, "lines that undo the compensation are damaged") from error
