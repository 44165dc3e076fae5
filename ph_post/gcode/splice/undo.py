"""The way back: the original of a compensated program, byte for byte."""

from __future__ import annotations

import hashlib
import re
from typing import Final

import numpy as np

from ph_post.errors import InputError
from ph_post.gcode.reader.lexer import split_lines
from ph_post.gcode.reader.record import Words
from ph_post.gcode.reader.words import read_words
from ph_post.gcode.splice.header import read_declaration
from ph_post.gcode.splice.payload import Payload, read_payload
from ph_post.gcode.splice.rewrite import DECIMALS, assemble, write_numbers
from ph_post.types import Array, BoolArray, IntArray

HUNK: Final = re.compile(rb"\(ph-post: \+(\d+) -(\d+)[^)\r\n]*\)")
"""Comment line before a changed stretch."""

CANDIDATES: Final = tuple(ord(letter) for letter in "XYZIJK")
"""Letters of words that a lasting offset can change."""


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


def restore(data: bytes, name: str) -> bytes:
    """Take back what the payload of a program tells, without a look at the result."""
    payload, end = read_payload(data, name)
    if payload.whole is not None:
        return payload.whole
    body = np.frombuffer(data[:end], np.uint8)
    lines = split_lines(body)
    added, places, counts = _hunks(data[:end], lines)
    added[payload.head[0] : payload.head[0] + payload.head[1]] = True
    words = read_words(data[:end], lines).words
    try:
        starts, ends, pool, bounds = _numbers(words, added, payload)
        line_spans = _lines(lines, added, places, counts, payload, pool.size)
    except (IndexError, ValueError) as error:
        raise InputError(
            name, "the program was changed after it was compensated, and cannot be undone"
        ) from error
    starts = np.concatenate([starts, line_spans[0]])
    ends = np.concatenate([ends, line_spans[1]])
    first = np.concatenate([bounds[:-1], line_spans[2]])
    last = np.concatenate([bounds[1:], line_spans[3]])
    order = np.argsort(starts, kind="stable")
    pool = np.concatenate([pool, np.frombuffer(payload.removed, np.uint8)])
    text: bytes = assemble(body, starts[order], ends[order], pool, first[order], last[order]).tobytes()
    return text[: len(text) - _end_size(text)] if payload.bare else text


def _end_size(text: bytes) -> int:
    return 2 if text.endswith(b"\r\n") else 1


def _hunks(data: bytes, lines: IntArray) -> tuple[BoolArray, list[int], list[int]]:
    """Mark the lines that were added; lines of hunks, and how many lines each stands in place of."""
    added = np.zeros(lines.size - 1, dtype=np.bool_)
    places, counts = [], []
    for found in HUNK.finditer(data):
        line = int(np.searchsorted(lines, found.start(), side="right")) - 1
        if not added[line]:
            added[line : line + 1 + int(found.group(1))] = True
            places.append(line)
            counts.append(int(found.group(2)))
    return added, places, counts


def _numbers(words: Words, added: BoolArray, payload: Payload) -> tuple[IntArray, IntArray, Array, IntArray]:
    """Spans of the changed numbers, and the text that stood there."""
    candidate = np.flatnonzero(np.isin(words.letter, CANDIDATES) & ~added[words.block])
    code = np.frombuffer(payload.code, np.uint8)
    if code.size != candidate.size:
        raise ValueError(code.size)
    changed = candidate[code > 0]
    rows = np.array(payload.delta, dtype=np.int64).reshape(-1, 2)[code[code > 0].astype(np.int64) - 1]
    style = np.frombuffer(payload.style, np.uint16).astype(np.int64)
    digits = original_digits(words.digits[changed], words.decimals[changed], rows[:, 0], rows[:, 1], style)
    pool, bounds = write_numbers(digits, style)
    if payload.odd:
        pool, bounds = _with_odd(pool, bounds, payload.odd)
    return words.start[changed] + 1, words.end[changed], pool, bounds


def original_digits(
    digits: IntArray, decimals: IntArray, delta: IntArray, places: IntArray, style: IntArray
) -> IntArray:
    """Subtract offsets, `delta` / 10^`places`, from numbers, and bring them to the decimals they had."""
    value = digits - delta * 10 ** (decimals - places)
    original, rest = np.divmod(value, 10 ** (decimals - (style & DECIMALS)))
    if rest.any():
        raise ValueError(rest.max())
    return np.asarray(original)


def _with_odd(pool: Array, bounds: IntArray, odd: dict[int, bytes]) -> tuple[Array, IntArray]:
    """Put the text of odd numbers in the place of what their style tells."""
    texts = [
        pool[low:high].tobytes() for low, high in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)
    ]
    for number, text in odd.items():
        texts[number] = text
    sizes = np.array([len(text) for text in texts], dtype=np.int64)
    return np.frombuffer(b"".join(texts), np.uint8), np.append(0, np.cumsum(sizes))


def _lines(
    lines: IntArray, added: BoolArray, places: list[int], counts: list[int], payload: Payload, base: int
) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Spans of the added lines, and where in the pool stands what they took the place of."""
    removed = (
        split_lines(np.frombuffer(payload.removed, np.uint8)) if payload.removed else np.zeros(1, np.int64)
    )
    if sum(counts) != removed.size - 1:
        raise ValueError(sum(counts))
    marked = np.flatnonzero(added)
    first = np.zeros(marked.size, dtype=np.int64)
    last = np.zeros(marked.size, dtype=np.int64)
    before = np.append(0, np.cumsum(counts)).astype(np.int64)
    at = np.searchsorted(marked, np.array(places, dtype=np.int64))
    first[at], last[at] = base + removed[before[:-1]], base + removed[before[1:]]
    return lines[marked], lines[marked + 1], first, last
