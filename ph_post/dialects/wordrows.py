"""The words of a program in a language of its own as a word table, by which it is changed in place."""

from __future__ import annotations

import zlib
from decimal import Decimal
from typing import Final

import numpy as np

from ph_post.gcode.program import WordTable, long_numbers
from ph_post.types import sealed

OTHER: Final = "O"
"""Letter of a word that the table has no number of: by the sum of its characters it is found again."""

_MOST: Final = 18
"""Digits of a 64-bit number."""


class WordRows:
    """The rows of a word table in the making."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, int, int, int, int, int]] = []

    def put(self, block: int, letter: str, start: int, end: int, number: Decimal | None) -> None:
        """Add a word from `start` to `end`; None for a number that the table cannot have."""
        self._rows.append((block, ord(letter), start, end, *_exact(number)))

    def table(self) -> WordTable:
        """Return the table."""
        block, letter, start, end, digits, decimals = np.array(self._rows, dtype=np.int64).reshape(-1, 6).T
        value = np.where(decimals >= 0, digits / 10.0 ** np.maximum(decimals, 0), np.nan)
        return WordTable(
            block=sealed(block.astype(np.int32)),
            letter=sealed(letter.astype(np.uint8)),
            start=sealed(start.astype(np.int32)),
            end=sealed(end.astype(np.int32)),
            value=sealed(value),
            decimals=sealed(decimals.astype(np.int16)),
            long={word: int(digits[word]) for word in long_numbers(value, decimals).tolist()},
        )


def sum_of(text: str) -> Decimal:
    """Return the number by which a word of :data:`OTHER` is found again, the same in small letters."""
    return Decimal(zlib.crc32(text.upper().encode()) % 10**6)


def _exact(number: Decimal | None) -> tuple[int, int]:
    """Return a number as digits and decimals; -1 decimals where it is none, or has too many."""
    if number is None:
        return 0, -1
    sign, digits, exponent = number.as_tuple()
    if not isinstance(exponent, int) or len(digits) + max(exponent, 0) > _MOST or -exponent > _MOST:
        return 0, -1
    whole = int("".join(map(str, digits))) * 10 ** max(exponent, 0)
    return -whole if sign else whole, max(-exponent, 0)
